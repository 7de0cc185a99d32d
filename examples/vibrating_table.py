r"""A ball on a vibrating table, in both frames, and where its period doubles.

The table is at ``w = a sin(omega t)``. In its frame the ball feels gravity and the excitation,
``x'' = -g + a omega^2 sin(omega t)``: a `LinearForce` above a wall at rest. In the fixed frame it
feels gravity alone, above a `HarmonicWall`. Both must be the same motion.

The orbit that hits once in n periods T, always at the phase phi: it flies for n T under gravity
from and to the same height, so it leaves with the speed ``V = n g T/2`` and returns with ``-V``.
Restitution relative to the table, ``V - w' = e (V + w')``, gives ``w' = V (1 - e)/(1 + e)``, and
with ``w' = a omega cos(phi)`` and ``G = a omega^2/g``

    cos(phi) = n pi (1 - e) / ((1 + e) G),        u = V - w' = 2 e V / (1 + e)

where u is the speed relative to the table after an impact. It exists from ``G = n pi (1-e)/(1+e)``.
The map from impact to impact has, at this orbit, the determinant ``e^2`` and the trace
``1 + e^2 - (1 + e)^2 G sin(phi)`` (a later impact by dt leaves faster by ``-(1 + e) a omega^2
sin(phi) dt``). Its period doubles where a Floquet multiplier is -1,
``1 + trace + determinant = 0``:

    G sin(phi) = 2 (1 + e^2)/(1 + e)^2
    G^2 = (n pi (1 - e)/(1 + e))^2 + (2 (1 + e^2)/(1 + e)^2)^2

None of this is used to find it here: the map is differenced from runs, and long runs just below and
just above settle on one phase and on two.

A bisection on the map finds 1.526824 for `e = 0.5` and 1.070836 for `e = 0.8`, the digits of the
formula, in brackets.

Run as ``python examples/vibrating_table.py [out.png]``.
"""

import math
import sys

import numpy as np

import zivi

GRAVITY, OMEGA = 9.81, 2 * math.pi
PERIOD = 2 * math.pi / OMEGA
SINE = -math.pi / 2
"""Phase with which a cosine is a sine."""
TIGHT = zivi.SwitchedRK(rtol=1e-12, atol=1e-13)
LONG = zivi.SwitchedRK(rtol=1e-9)


def in_table_frame(excitation: float, e: float) -> zivi.ImpactSystem:
    """Ball seen from the table; `excitation` is ``a omega^2 / g``."""
    force = zivi.LinearForce(
        gravity=GRAVITY, amplitude=excitation * GRAVITY, omega=OMEGA, phase=SINE
    )
    return zivi.ImpactSystem(force, e=e)


def in_fixed_frame(excitation: float, e: float) -> zivi.ImpactSystem:
    """Ball under gravity alone, above a table that moves."""
    table = zivi.HarmonicWall(excitation * GRAVITY / OMEGA**2, OMEGA, SINE)
    return zivi.ImpactSystem(-GRAVITY, e=e, wall=table)


def orbit(excitation: float, e: float, n: int = 1) -> tuple[float, float]:
    """Time (s) and relative speed (m/s) after an impact of the orbit of n periods."""
    phase = math.acos(n * math.pi * (1 - e) / ((1 + e) * excitation))
    return phase / OMEGA, n * GRAVITY * PERIOD * e / (1 + e)


def difference_of_frames(excitation: float = 1.5, e: float = 0.5) -> float:
    """Largest difference of the two frames in x and x', through rests and lift-offs."""
    times = np.linspace(0, 10, 1001)
    own, fixed = (
        zivi.simulate(frame(excitation, e), (0, 10), (0.2, 0), t_eval=times)
        for frame in (in_table_frame, in_fixed_frame)
    )
    difference = np.stack([own.x - fixed.x, own.xdot - fixed.xdot])
    return float(np.abs(difference).max())


def return_map(state: np.ndarray, excitation: float, e: float) -> np.ndarray:
    """From one impact, ``(t, speed after it)``, to the next, a period earlier."""
    t, speed = state
    span = (t, t + 1.9 * PERIOD)
    sol = zivi.simulate(in_table_frame(excitation, e), span, (0, speed), TIGHT, dense_output=False)
    following = sol.impacts[0]
    return np.array([following["t"] - PERIOD, following["xdot_after"]])


def multipliers(excitation: float, e: float, step: float = 1e-5) -> np.ndarray:
    """Differences of runs: the multipliers of the orbit of one period."""
    state = np.array(orbit(excitation, e))
    columns = [
        return_map(state + shift, excitation, e) - return_map(state - shift, excitation, e)
        for shift in step * np.eye(2)
    ]
    return np.linalg.eigvals(np.column_stack(columns) / (2 * step))


def threshold(e: float, above: float = 2.0) -> float:
    """Bisect for the excitation at which a multiplier is -1."""
    below = 1.01 * math.pi * (1 - e) / (1 + e)
    for _ in range(40):
        middle = 0.5 * (below + above)
        stable = np.real(multipliers(middle, e)).min() > -1
        below, above = (middle, above) if stable else (below, middle)
    return 0.5 * (below + above)


def impact_phases(excitation: float, e: float, periods: int, kept: int) -> np.ndarray:
    """Phases of the last impacts of a run from beside the orbit of one period (rad)."""
    t, speed = orbit(excitation, e)
    span = (t, t + periods * PERIOD)
    start = (0, 1.001 * speed)
    sol = zivi.simulate(in_table_frame(excitation, e), span, start, LONG, dense_output=False)
    turns = sol.impacts["t"][-kept:] / PERIOD
    return 2 * math.pi * (turns - np.round(turns))


def main(path: str | None) -> None:
    """Measure, print beside what is expected, and draw if a path is given."""
    print(f"the two frames differ by {difference_of_frames():.1e} m, m/s at most in 10 s")
    for e in (0.5, 0.8):
        alone, doubling = math.pi * (1 - e) / (1 + e), 2 * (1 + e**2) / (1 + e) ** 2
        found, expected = threshold(e), math.hypot(alone, doubling)
        print(f"e = {e}: the period doubles at {found:.6f}, expected {expected:.6f}")
        for excitation in (expected - 1e-3, expected + 1e-3):
            one, other = impact_phases(excitation, e, 3000, 2)
            print(
                f"    at {excitation:.6f} after 3000 periods: impacts at {one:.6f}, {other:.6f}"
                f" (one period: {OMEGA * orbit(excitation, e)[0]:.6f})"
            )
    if path is not None:
        draw(path)


def draw(path: str) -> None:
    """Draw the fixed frame above the doubled period, and the phases over the excitation."""
    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt

    plt.style.use("zivi.plot.figures")
    figure, (left, right) = plt.subplots(1, 2, layout="constrained", figsize=(9.6, 3.6))
    system = in_fixed_frame(1.5, 0.5)
    times = np.linspace(0, 4, 4001)
    sol = zivi.simulate(system, (0, 4), (0.2, 0), t_eval=times)
    left.plot(times, sol.fixed()[0], color=zivi.plot.BLUE, label="ball")
    left.plot(times, system.wall(times)[0], color=zivi.plot.ORANGE, ls="--", label="table")
    left.set(xlabel="time $t$ (s)", ylabel="height (m)")
    left.set_title("fixed frame: $e = 0.5$, $\\Gamma = 1.5$", fontsize="medium")
    left.set_ylim(-0.45, 0.65)
    left.legend(loc="upper right", ncols=2)
    for excitation in np.linspace(1.2, 1.75, 400):
        phases = impact_phases(excitation, 0.5, 1000, 60)
        right.plot(np.full(60, excitation), phases, ".", ms=0.6, color=zivi.plot.BLUE)
    right.axvline(threshold(0.5), color="0.5", ls=":", lw=1)
    right.text(threshold(0.5) - 0.005, 1.5, f"{threshold(0.5):.6f}", ha="right", fontsize="small")
    right.set(xlabel="excitation $\\Gamma = a \\omega^2/g$", ylabel="phase of the impacts (rad)")
    right.set_title("$e = 0.5$: the period doubles", fontsize="medium")
    figure.savefig(path, dpi=160)


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else None)
