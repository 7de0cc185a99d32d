"""A reference that comes to rest and lifts off again, every half second.

Seen from a table that vibrates with A w^2/g = 1.3, a ball with e = 1/3 rests until the table falls
away from under it, at sin(w t) = 1/1.3; it hops, bounces infinitely often, and rests again. A mass
on a still floor is made to do the same, with the plant between the samples exact, and in the
paper's own loop.

With e = 1/2 the paper's law, without the contact-establishing law, follows as closely, but in the
sampled loop never rests exactly.

Run as ``python examples/rest_and_liftoff.py [out.png]``.
"""

import dataclasses
import math
import sys
from typing import Literal

import numpy as np

import zivi

GRAVITY, PERIOD, EXCITATION, H = 9.81, 0.5, 1.3, 1e-3
OMEGA = 2 * math.pi / PERIOD
LIFTOFF = math.asin(1 / EXCITATION) / OMEGA
"""Time of the lift-offs within a period (s)."""
FORCE_REF = zivi.LinearForce(
    gravity=GRAVITY, amplitude=EXCITATION * GRAVITY, omega=OMEGA, phase=-math.pi / 2
)
GAINS, START = (30.0, 17.0), (0.5, 0.0)
PERIODS, CAUGHT = 100, 20
"""Periods of a run, and of its beginning that is not measured."""


def run(
    branch: Literal["positive", "nearest"],
    e: float = 1 / 3,
    *,
    sampled: bool = True,
    landing: bool = True,
) -> zivi.ClosedLoop:
    """Track the reference from a start half a metre above it."""
    return zivi.simulate_closed_loop(
        zivi.ImpactSystem(-GRAVITY, e=e),
        zivi.TwistingTracker(*GAINS, h=H, e=e, branch=branch, landing=landing),
        (0.0, PERIODS * PERIOD),
        START,
        y_ref0=(0.0, 0.0),
        force_ref=FORCE_REF,
        method=None if sampled else zivi.ThetaGamma(H),
        progress=False,
    )


@dataclasses.dataclass(frozen=True)
class Statistics:
    """What happens after the mass has caught the reference.

    Attributes
    ----------
    liftoffs : int
        Lift-offs of the mass from exact rest.
    late : float
        Largest distance of one of them from that of the exact reference (s), NaN without any.
    error : float
        Largest ``|x - x_r|`` (m).
    rests_ref, rests : float
        Share of the time in which the reference and the mass rest exactly.
    speed : float
        Largest ``|x'|`` while the reference rests (m/s).
    """

    liftoffs: int
    late: float
    error: float
    rests_ref: float
    rests: float
    speed: float


def statistics(sol: zivi.ClosedLoop) -> Statistics:
    """Measure a run."""
    caught = CAUGHT * PERIOD
    window = sol.t > caught
    liftoffs = sol.liftoff_times[sol.liftoff_times > caught]
    reference = window & (sol.x_ref == 0) & (sol.xdot_ref == 0)
    mass = window & (sol.x == 0) & (sol.xdot == 0)
    return Statistics(
        liftoffs=len(liftoffs),
        late=float(np.abs(liftoffs % PERIOD - LIFTOFF).max()) if len(liftoffs) else math.nan,
        error=float(np.abs(sol.error[window]).max()),
        rests_ref=float(reference.sum() / window.sum()),
        rests=float(mass.sum() / window.sum()),
        speed=float(np.abs(sol.xdot[reference]).max()),
    )


def main(path: str | None) -> None:
    """Measure, print, and draw if a path is given."""
    print(f"{PERIODS - CAUGHT} periods; late: against the exact lift-off at {LIFTOFF:.4f} s")
    for e in (1 / 3, 1 / 2):
        for sampled in (True, False):
            for branch in ("positive", "nearest"):
                s = statistics(run(branch, e, sampled=sampled))
                loop = "sampled" if sampled else "paper's"
                print(
                    f"e = {e:.3f}, {loop} loop, {branch:8}: "
                    f"{s.liftoffs} lift-offs, late {s.late * 1e3:.2f} ms, "
                    f"max |e| {s.error * 1e3:.4f} mm, at rest {s.rests:.3f} of the time "
                    f"(reference {s.rests_ref:.3f}), speed there {s.speed:.3f} m/s"
                )
    s = statistics(run("positive", 1 / 2, landing=False))
    print(f"e = 0.500, the paper's law: {s.liftoffs} lift-offs from exact rest")
    if path is not None:
        draw(path)


def draw(path: str) -> None:
    """Draw two periods: positions, velocities, control."""
    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt

    sol = run("positive")
    plt.style.use("zivi.plot.figures")
    figure, axes = plt.subplots(3, 1, layout="constrained", figsize=(6.4, 5.6), sharex=True)
    zivi.plot.position(sol, axes[0]).set(xlabel="")
    zivi.plot.velocity(sol, axes[1]).set(xlabel="")
    zivi.plot.control(sol, axes[2], lw=1).set_xlim(20.0, 21.0)
    axes[0].set_ylim(0, 0.03)
    axes[1].set_ylim(-1, 1)
    axes[2].set_ylim(-40, 40)
    for ax in axes:
        for k in (40, 41):
            ax.axvline(k * PERIOD + LIFTOFF, color="0.5", ls=":", lw=1)
    axes[0].text(20 + LIFTOFF, 0.026, " exact lift-off")
    axes[0].legend(loc="upper right", ncols=2)
    axes[1].legend(loc="upper right", ncols=2)
    figure.suptitle("A reference that rests and lifts off")
    figure.savefig(path, dpi=160)


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else None)
