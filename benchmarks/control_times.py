"""Times of a tick: within one Rust process, called from Python, and in the closed loop."""

from __future__ import annotations

import dataclasses
import math
import subprocess
from collections.abc import Callable

import instructions
import timing
import zivi
from zivi.paper import tracking_steps

F, F_REF, H = tracking_steps.F, tracking_steps.F_REF, tracking_steps.H


@dataclasses.dataclass(frozen=True)
class Tick:
    """Times of the ticks of one case (ns)."""

    mean: float
    median: float
    most: float
    """The 99.9 % quantile of the ticks."""
    with_system: float
    """The same of all samples."""


def ticks(count: int, rounds: int) -> dict[str, Tick]:
    """Time the ticks in Rust, by case."""
    program = instructions.example("zivi-core", "tick_time")
    run = subprocess.run(
        [program, str(count), str(rounds)], capture_output=True, text=True, check=True
    )
    cases = {}
    for line in run.stdout.splitlines():
        case, *figures = line.split()
        cases[case] = Tick(*map(float, figures))
    return cases


@dataclasses.dataclass(frozen=True)
class Calls:
    """Times from Python."""

    step: float
    """One call of ``tracker.step`` (ns)."""
    hypot: float
    """One call of ``math.hypot`` with four numbers (ns): as cheap as such a call can be."""
    ratio: float
    """Of the two, in one round."""


def _tracker() -> zivi.TwistingTracker:
    tracker = zivi.TwistingTracker(
        tracking_steps.MU1, tracking_steps.MU2, h=H, kappa=tracking_steps.KAPPA
    )
    tracker.reset(*tracking_steps.START_REF)
    return tracker


def _plant() -> zivi.ImpactSystem:
    return zivi.ImpactSystem(F, kappa=tracking_steps.KAPPA)


def _loop(
    t_end: float, method: zivi.ThetaGamma | None, h: float = H
) -> Callable[[], zivi.ClosedLoop]:
    plant = _plant()
    tracker = zivi.TwistingTracker(
        tracking_steps.MU1, tracking_steps.MU2, h=h, kappa=tracking_steps.KAPPA
    )
    return lambda: zivi.simulate_closed_loop(
        plant,
        tracker,
        (0.0, t_end),
        tracking_steps.START,
        y_ref0=tracking_steps.START_REF,
        force_ref=F_REF,
        method=method,
    )


def calls(rounds: int) -> Calls:
    """Time the call of a tick on the samples of the paper's loop."""
    run = _loop(tracking_steps.T_END, zivi.ThetaGamma(H))()
    x, xdot = run.x.tolist(), run.xdot.tolist()
    tracker = _tracker()
    begin = tracker.state

    def over(call: Callable[[float, float, float, float], float]) -> Callable[[], None]:
        def walk() -> None:
            tracker.state = begin
            for one, other in zip(x, xdot, strict=True):
                call(one, other, F, F_REF)

        return walk

    contenders = {
        "step": (over(tracker.step), timing.nothing),
        "hypot": (over(math.hypot), timing.nothing),
    }
    times = timing.interleaved(contenders, rounds)
    medians = timing.medians(times, len(x))
    return Calls(medians["step"], medians["hypot"], timing.ratio(times, "step", "hypot"))


def loops(rounds: int) -> dict[str, float]:
    """Time a period of the closed loop (ns), call and record and all."""
    kinds: dict[str, tuple[zivi.ThetaGamma | None, float]] = {
        "plant exact between the samples, h = 1e-3 s": (None, H),
        "plant on the same grid (the paper's loop), h = 1e-3 s": (zivi.ThetaGamma(H), H),
        "plant exact between the samples, h = 1e-5 s": (None, 1e-5),
        "plant on the same grid (the paper's loop), h = 1e-5 s": (zivi.ThetaGamma(1e-5), 1e-5),
    }
    t_end = tracking_steps.T_END
    medians = {}
    for name, (method, h) in kinds.items():
        contender = (_loop(t_end, method, h), timing.nothing)
        times = timing.interleaved({name: contender}, rounds)
        medians |= timing.medians(times, round(t_end / h))
    return medians


def written_in_python(rounds: int) -> float:
    """Time a period of the loop whose controller is any Python object with a ``step`` (ns)."""

    class Other:
        h = H

        def step(self, x: float, xdot: float, force: float) -> float:
            return -force

    plant = _plant()
    span = (0.0, tracking_steps.T_END)
    run: Callable[[], zivi.ClosedLoop] = lambda: zivi.simulate_closed_loop(  # noqa: E731
        plant, Other(), span, tracking_steps.START
    )
    times = timing.interleaved({"python": (run, timing.nothing)}, rounds)
    return timing.medians(times, round(tracking_steps.T_END / H))["python"]
