"""A mass on a still floor follows a ball that bounces on a vibrating table.

Seen from the table, a ball moves under f_r = -g + A w^2 sin(w t). For A w^2/g = 1.25 and e = 1/2 it
has a stable orbit with one impact a period (pi (1-e)/(1+e) = 1.047 < 1.25 < 1.527, where the
period doubles), which never rests. The tracker makes a mass under plain gravity do the same; or a
mass on the table itself, whose true force then depends on time between the samples too.

It shows three things: how far the mass is from the reference over hundreds of impacts; that from
every start it gets into step with it, by either branch; and what a wrong coefficient of restitution
costs.

Run as ``python examples/periodic_reference.py [out.png]``.
"""

import dataclasses
import math
import sys
import warnings
from collections.abc import Sequence
from typing import Literal

import numpy as np

import zivi

GRAVITY, E, PERIOD, EXCITATION, H = 9.81, 0.5, 0.5, 1.25, 1e-3
OMEGA = 2 * math.pi / PERIOD
PHASE = math.acos(math.pi * (1 - E) / ((1 + E) * EXCITATION))
"""Phase w t of the table at the impacts of the orbit."""
LAUNCH = GRAVITY * PERIOD / 2 - EXCITATION * GRAVITY / OMEGA * math.cos(PHASE)
"""Velocity after an impact, relative to the table (m/s)."""
FORCE_REF = zivi.LinearForce(
    gravity=GRAVITY, amplitude=EXCITATION * GRAVITY, omega=OMEGA, phase=-math.pi / 2
)

GAINS, STRONG = (30.0, 17.0), (60.0, 34.0)
Name = Literal["positive", "nearest", "explicit"]
BRANCHES: tuple[Name, ...] = ("positive", "nearest")
CONTROLLERS: tuple[Name, ...] = (*BRANCHES, "explicit")
START = (1.0, 0.0)
AWAY = 0.02
"""Samples within this time of an impact of the reference are not "away from impacts" (s)."""
IN_STEP = 0.01
"""The mass follows when it ends closer than this (m)."""
STARTS, SEED = 40, 0


def run(
    controller: Name,
    gains: Sequence[float] = GAINS,
    start: Sequence[float] = START,
    periods: int = 400,
    e_plant: float = E,
    force: zivi.LinearForce | float = -GRAVITY,
) -> zivi.ClosedLoop:
    """Track the orbit from an impact of the reference on; the true force is known."""
    if controller == "explicit":
        tracker: zivi.Controller = zivi.ExplicitTwisting(*gains, h=H, e=E)
    else:
        tracker = zivi.TwistingTracker(*gains, h=H, e=E, branch=controller)
    t0 = PHASE / OMEGA
    return zivi.simulate_closed_loop(
        zivi.ImpactSystem(force, e=e_plant),
        tracker,
        (t0, t0 + periods * PERIOD),
        start,
        y_ref0=(0.0, LAUNCH),
        force_ref=FORCE_REF,
        progress=False,
    )


@dataclasses.dataclass(frozen=True)
class Statistics:
    """Errors over the second half of a run (m, m/s), and what the control does there.

    Attributes
    ----------
    impacts : int
        Impacts of the mass in the whole run.
    largest, rms : float
        Of ``|x - x_r|`` (m).
    away, away_velocity : float
        Largest ``|x - x_r|`` (m) and ``|x' - x_r'|`` (m/s) away from impacts.
    variation : float
        Sum of the changes of the control, per second (m/s^3).
    """

    impacts: int
    largest: float
    rms: float
    away: float
    away_velocity: float
    variation: float


def statistics(sol: zivi.ClosedLoop) -> Statistics:
    """Measure the second half of a run."""
    half = sol.t >= (sol.t[0] + sol.t[-1]) / 2
    t, error = sol.t[half], np.abs(sol.error[half])
    since = (t - PHASE / OMEGA) % PERIOD
    away = (since > AWAY) & (since < PERIOD - AWAY)
    velocity = np.abs(sol.xdot - sol.xdot_ref)[half]
    return Statistics(
        impacts=len(sol.impacts),
        largest=float(error.max()),
        rms=float(np.sqrt(np.mean(error**2))),
        away=float(error[away].max()),
        away_velocity=float(velocity[away].max()),
        variation=float(np.abs(np.diff(sol.u[half])).sum() / (t[-1] - t[0])),
    )


def reference_is_the_orbit(sol: zivi.ClosedLoop) -> tuple[float, float]:
    """Return how far the reference's launches are from the orbit (s, m/s), over the whole run."""
    launches = np.flatnonzero(np.diff(sol.xdot_ref) > 1.0) + 1
    late = (sol.t[launches] - PHASE / OMEGA + PERIOD / 2) % PERIOD - PERIOD / 2
    return float(np.abs(late).max()), float(np.abs(sol.xdot_ref[launches] - LAUNCH).max())


def out_of_step(branch: Name, gains: Sequence[float]) -> int:
    """Count starts (x in 0 .. 2 m, |x'| up to 4 m/s) that do not end on the reference."""
    generator = np.random.default_rng(SEED)
    starts = [(generator.uniform(0, 2), generator.uniform(-4, 4)) for _ in range(STARTS)]
    runs = (run(branch, gains, start, periods=100) for start in starts)
    return sum(statistics(sol).largest > IN_STEP for sol in runs)


def wrong_restitution() -> dict[float, dict[str, Statistics]]:
    """Track with e = 1/2 in the controller on plants with another one."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", zivi.ModelWarning)  # what it does is the question
        return {
            e: {it: statistics(run(it, STRONG, periods=200, e_plant=e)) for it in BRANCHES}
            for e in (0.4, 0.45, 0.49, 0.5, 0.51, 0.55, 0.6)
        }


def main(path: str | None) -> None:
    """Measure, print, and draw if a path is given."""
    late, off = reference_is_the_orbit(run("positive", STRONG))
    print(f"reference: launches at most {late * 1e3:.1f} ms and {off:.3f} m/s off the exact orbit")
    print("\n400 periods, last 200; x in mm, x' in m/s; away: not within 20 ms of an impact")
    for gains in (GAINS, STRONG):
        for name in CONTROLLERS:
            s = statistics(run(name, gains))
            print(
                f"gains {gains}, {name:8}: {s.impacts:3} impacts, max {s.largest * 1e3:8.3f}, "
                f"rms {s.rms * 1e3:7.3f}, away {s.away * 1e3:7.3f} and {s.away_velocity:.3f}, "
                f"sum |du| {s.variation:.3g} a second"
            )
    s = statistics(run("positive", STRONG, force=FORCE_REF))
    print(f"on the table, positive: max {s.largest * 1e3:.3f}, rms {s.rms * 1e3:.3f}")
    print(f"\nof {STARTS} starts, out of step in the end:")
    for gains in (GAINS, STRONG):
        counts = ", ".join(f"{branch} {out_of_step(branch, gains)}" for branch in BRANCHES)
        print(f"gains {gains}: {counts}")
    print("\nthe plant's e is not the 0.5 of controller and reference, gains", STRONG)
    for e, found in wrong_restitution().items():
        cells = (
            f"{b}: max {s.largest * 1e3:7.2f}, rms {s.rms * 1e3:6.2f}" for b, s in found.items()
        )
        print(f"e = {e:4}: {'; '.join(cells)} mm")
    if path is not None:
        draw(path)


def draw(path: str) -> None:
    """Draw the first seconds from both branches, and the controls."""
    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt

    plt.style.use("zivi.plot.figures")
    figure, axes = plt.subplots(2, 2, layout="constrained", figsize=(9.0, 4.8), sharex="col")
    shown = (
        ("positive, gains 30, 17", run("positive", periods=8)),
        ("nearest, gains 30, 17", run("nearest", periods=8)),
    )
    for (above, below), (title, sol) in zip(axes.T, shown, strict=True):
        zivi.plot.position(sol, above).set(xlabel="", title=title)
        above.get_legend().remove()
        zivi.plot.control(sol, below, lw=1)
        above.title.set_fontsize("medium")
        above.set_ylim(0, 1.1)
    figure.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside lower center", ncols=2)
    figure.savefig(path, dpi=160)


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else None)
