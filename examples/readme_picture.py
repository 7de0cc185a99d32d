"""The picture of the README: one ball, three programs, at the accumulation of its impacts.

Run as ``python examples/readme_picture.py out.png`` (needs SciPy).
"""

import sys
import time

import matplotlib as mpl
import numpy as np
from scipy.integrate import solve_ivp

import zivi
from zivi.paper.ball import GRAVITY, XDOT0, Exact, simulate_ball
from zivi.plot import BLUE, ORANGE

MAX_EVENTS = 60


def scipy_restarts() -> tuple[np.ndarray, int]:
    """Integrate from event to event as a careful SciPy user does; stop when time stands still.

    Returns
    -------
    times : ndarray
        Times of the impacts that were found (s).
    stuck : int
        How many of the last restarts did not advance the time at all.
    """

    @zivi.event(terminal=True, direction=-1)
    def floor(t: float, y: np.ndarray) -> float:
        return float(y[0])

    t, state, found = 0.0, np.array([1.0, XDOT0]), []
    for _ in range(MAX_EVENTS):
        leg = solve_ivp(
            lambda t, y: [y[1], -GRAVITY],
            (t, 4.0),
            state,
            "DOP853",
            events=floor,
            rtol=1e-10,
            atol=1e-13,
        )
        t, state = leg.t[-1], np.array([0.0, -Exact.e * leg.y[1, -1]])
        found.append(t)
    times = np.array(found)
    return times, int(np.sum(np.diff(times) == 0.0))


def main(path: str) -> None:
    """Draw the three panels into `path`."""
    mpl.use("Agg")
    import matplotlib.pyplot as plt

    plt.style.use("zivi.plot.figures")
    figure, (left, middle, right) = plt.subplots(
        1, 3, figsize=(10.2, 3.1), layout="constrained", gridspec_kw={"wspace": 0.06}
    )
    times, stuck = scipy_restarts()
    left.plot(times, np.arange(1, len(times) + 1), ".-", color="0.35", ms=4, lw=0.8)
    left.axvline(Exact.zeno, color="0.5", ls=":", lw=1)
    left.set(xlabel="time $t$ (s)", ylabel="restarts after an impact", xlim=(1.3, 2.6))
    left.set_title("events and restarts (SciPy): stuck", fontsize="medium")
    left.text(
        1.36,
        len(times) * 0.78,
        f"time stands still at {times[-1]:.4f} s:\n"
        f"{stuck} of {len(times)} restarts\nadvance by 0 s",
        fontsize="small",
    )
    times = np.linspace(2.4, 2.6, 20_001)
    for ax, method, title, color in [
        (middle, zivi.ExplicitEuler(1e-3), "explicit signs: chattering", ORANGE),
        (right, zivi.SwitchedRK(), "zivi: exactly at rest", BLUE),
    ]:
        sol = simulate_ball(method)
        ax.plot(times, sol(times)[1], color=color, lw=1)
        ax.axvline(Exact.zeno, color="0.5", ls=":", lw=1)
        ax.set(xlabel="time $t$ (s)", ylim=(-0.35, 0.3))
        ax.set_title(title, fontsize="medium")
        if sol.rest_time is not None:
            ax.annotate(
                f"$x = \\dot x = 0$ from {sol.rest_time:.6f} s",
                (sol.rest_time, 0.0),
                (2.47, 0.14),
                arrowprops={"arrowstyle": "->", "color": "0.3"},
                fontsize="small",
            )
    middle.set_ylabel(r"velocity $\dot x$ (m/s)")
    figure.savefig(path, dpi=160)


if __name__ == "__main__":
    started = time.perf_counter()
    main(sys.argv[1])
    print(f"{sys.argv[1]} in {time.perf_counter() - started:.1f} s")
