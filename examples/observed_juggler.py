"""A juggler that sees positions only, under a force that nobody told it of.

The reference is a ball on a vibrating table in its periodic orbit, seen from the table: one impact
every half second, without end. The mass that shall follow it is pushed by an unknown sine force,
and its position is measured to 0.1 mm, its velocity not at all. An `ImpactObserver` estimates both
and the force, through the impacts; the tracker is given the orbit itself. The mass stays within
0.14 mm of the orbit (0.050 mm rms).

Run as ``python examples/observed_juggler.py [out.png]``.
"""

import math
import sys
from typing import Any

import numpy as np

import zivi

GRAVITY, E, PERIOD, EXCITATION, H = 9.81, 0.5, 0.5, 1.25, 1e-3
OMEGA = 2 * math.pi / PERIOD
PHASE = math.acos(math.pi * (1 - E) / ((1 + E) * EXCITATION))
"""Phase of the table at the impacts of the orbit."""
LAUNCH = GRAVITY * PERIOD / 2 - EXCITATION * GRAVITY / OMEGA * math.cos(PHASE)
"""Velocity after an impact, relative to the table (m/s)."""
TABLE = zivi.LinearForce(
    gravity=GRAVITY, amplitude=EXCITATION * GRAVITY, omega=OMEGA, phase=-math.pi / 2
)
PUSH, RATE, NOISE = 1.5, 2 * math.pi * 1.1, 1e-4
"""Amplitude (m/s^2) and angular frequency (1/s) of the unknown force; noise of the position (m)."""
T0 = PHASE / OMEGA
SPAN = (T0, T0 + 20 * PERIOD)


def orbit() -> zivi.Trajectory:
    """Give the periodic orbit."""
    return zivi.simulate(zivi.ImpactSystem(TABLE, e=E), SPAN, (0.0, LAUNCH))


def juggle(seed: int = 1, *, observed: bool = True) -> zivi.ClosedLoop:
    """Track the orbit, with the observer or with exact measurements of the whole state."""
    plant = zivi.LinearForce(gravity=GRAVITY, amplitude=PUSH, omega=RATE)
    observer = zivi.ImpactObserver(E, H, noise=NOISE, q_d=1e-3, dmax=5.0, position_only=True)
    more: dict[str, Any] = (
        {"observer": observer, "noise": (NOISE, 0.0), "seed": seed} if observed else {}
    )
    return zivi.simulate_closed_loop(
        zivi.ImpactSystem(plant, e=E),
        zivi.TwistingTracker(60, 34, h=H, e=E, horizon=3),
        SPAN,
        (0.3, 0.0),
        reference=orbit(),
        force_model=-GRAVITY,
        progress=False,
        **more,
    )


def errors(run: zivi.ClosedLoop) -> tuple[float, float]:
    """Give the root mean square and the largest error of the last ten periods (m)."""
    late = run.t > SPAN[1] - 10 * PERIOD
    return float(np.sqrt(np.mean(run.error[late] ** 2))), float(np.abs(run.error[late]).max())


def main(path: str | None) -> None:
    """Measure, print, and draw if a path is given."""
    runs = {name: juggle(observed=name == "observed") for name in ("observed", "exact state")}
    for name, run in runs.items():
        rms, largest = errors(run)
        print(f"{name:12}: error {rms * 1e3:.3f} mm rms, {largest * 1e3:.2f} mm at most")
    if path is not None:
        draw(path, runs["observed"])


def draw(path: str, run: zivi.ClosedLoop) -> None:
    """Draw the beginning, the force and what is thought of it, and the error."""
    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt

    plt.style.use("zivi.plot.figures")
    figure, axes = plt.subplots(3, 1, layout="constrained", figsize=(9.0, 6.0), sharex=True)
    zivi.plot.position(run, axes[0]).set(xlabel="")
    axes[1].plot(run.t, PUSH * np.cos(RATE * run.t), color="0.5", label="unknown force")
    axes[1].plot(run.t, run.d_est, color=zivi.plot.ORANGE, lw=0.8, label="estimate")
    axes[1].set(ylabel="force (m/s$^2$)", ylim=(-4, 4))
    axes[1].legend(loc="upper left", bbox_to_anchor=(1, 1))
    axes[2].plot(run.t, 1e3 * run.error, color=zivi.plot.BLUE, lw=0.6)
    axes[2].set(xlabel="time $t$ (s)", ylabel="error (mm)", ylim=(-5, 5))
    figure.suptitle("A juggler that measures positions only")
    figure.savefig(path, dpi=150)


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else None)
