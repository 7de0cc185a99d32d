"""Orbits that rest: they start at a lift-off, and one simulation is the orbit."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from zivi.base.check import Array, of_three
from zivi.derivatives.sensitivity import OrbitStatus
from zivi.orbits.orbit import ORBIT_IMPACT, PeriodicOrbit
from zivi.orbits.sequence import Frame
from zivi.simulation.run import simulate
from zivi.system.mass import ImpactSystem

__all__ = [
    "chatter_exponent", "cycle_of", "force_at_rest", "highest_pull", "resting_orbit", "rises",
]  # fmt: skip

MOST_PERIODS = 64
LOOKS = 256


def rises(system: ImpactSystem, period: float, start: float = 0.0) -> list[float]:
    """Give times, one for each lift-off of a period, shortly before which the force holds."""
    times = start + period * np.arange(LOOKS + 1) / LOOKS
    force = np.array([force_at_rest(system, float(t)) for t in times])
    found = [float(times[i]) for i in range(LOOKS) if force[i] <= 0.0 < force[i + 1]]
    if found or force[0] > 0.0:
        return found
    # the force may be positive between two looks
    t, highest = _maximum(system, times, force)
    return [t - period / LOOKS] if highest > 0.0 else []


def _maximum(system: ImpactSystem, times: Array, force: Array) -> tuple[float, float]:
    """Give when the force at rest is largest, and how large."""
    i = int(np.argmax(force))
    t, h = float(times[i]), float(times[1] - times[0])
    best = float(force[i])
    for _ in range(4):
        left, right = (force_at_rest(system, t + side) for side in (-h, h))
        bend = left - 2.0 * best + right
        if bend >= 0.0:
            break
        there = t - 0.5 * h * (right - left) / bend
        value = force_at_rest(system, there)
        if value <= best:
            break
        t, best, h = there, value, 0.1 * h
    return t, best


def highest_pull(system: ImpactSystem, period: float) -> float:
    """Give the largest force on the mass at rest over a period."""
    times = period * np.arange(LOOKS + 1) / LOOKS
    force = np.array([force_at_rest(system, float(t)) for t in times])
    return _maximum(system, times, force)[1]


def force_at_rest(system: ImpactSystem, t: float) -> float:
    """Give the force on the mass at rest at the wall."""
    w, wdot, wddot = (0.0, 0.0, 0.0) if system.wall is None else map(float, system.wall(t))
    force = system.force
    value = float(force) if isinstance(force, int | float) else float(_called(system, t, w, wdot))
    return value - wddot


def _called(system: ImpactSystem, t: float, x: float, xdot: float) -> float:
    force: Any = system.force
    # a compiled callable is called as it is; a function may be one of (t, y)
    compiled = getattr(force, "ctypes", None)
    function = compiled or of_three("force", force, more_than_y=False)
    return float(function(t, x, xdot))


def cycle_of(lifts: Array, period: float) -> tuple[int, int] | None:
    """Give the first two lift-offs with the same phase, None if there are none.

    The motion after a lift-off is a function of its phase, so it repeats from there on.
    """
    turns = (lifts - lifts[:, None]) / period
    whole = np.rint(turns)
    same = (np.abs(turns - whole) < 1e-8) & (whole >= 1.0)
    ends = np.flatnonzero(same.any(axis=0))
    return (int(np.flatnonzero(same[:, ends[0]])[-1]), int(ends[0])) if len(ends) else None


def earliest(lifts: Array, period: float) -> int:
    """Give the lift-off of the smallest phase, with which a cycle of several begins."""
    return int(np.argmin((lifts / period + 1e-9) % 1.0))


def resting_orbit(
    system: ImpactSystem, frame: Frame, phase: float, most: int | None = None
) -> PeriodicOrbit:
    """Simulate the motion that lifts off first after a time, until it does so at the same phase.

    At most so many periods are simulated, at first two, and the motion must come back to that
    lift-off. By default it may do so from another one on, within `MOST_PERIODS`, and the orbit
    begins with its lift-off of the smallest phase.
    """
    period, longest = frame.period_of(system), most or MOST_PERIODS
    nothing, empty = OrbitStatus.NOT_CONVERGED, np.empty(0, ORBIT_IMPACT)
    starts = rises(system, period, phase)
    if not starts:
        resting = force_at_rest(system, phase) <= 0.0
        why = "The mass rests and never lifts off." if resting else "The mass never stays at rest."
        status = OrbitStatus.RESTS if resting else nothing
        return _orbit(system, frame, None, None, empty, status, why)
    for periods in sorted({min(it, longest) for it in (2, 8, longest)}):
        span = (starts[0], starts[0] + periods * period)
        run = simulate(system, span, (0.0, 0.0), frame.method, dense_output=False)
        lifts, zenos = run.liftoff_times, run.zeno_times
        cycle = cycle_of(lifts, period)
        if cycle is not None and len(zenos):
            break
    if cycle is None or not len(zenos) or (most is not None and cycle[0]):
        why = f"The motion after the lift-off does not rest again within {longest} periods."
        if len(lifts) > 1 and len(zenos):
            why = f"The motion lifts off at no phase a second time within {longest} periods."
        return _orbit(system, frame, None, None, empty, nothing, why)
    first, end = cycle
    multiple = round((lifts[end] - lifts[first]) / period)
    if most is None and (other := earliest(lifts[first:end], period)):
        lift = float(lifts[first + other])
        rest = 0.5 * (float(zenos[zenos < lift][-1]) + lift)
        return resting_orbit(system, frame, rest, multiple + 1)
    own = run.resolved_impacts
    own = own[(own["t"] > lifts[first]) & (own["t"] < lifts[end])]
    shift = float(lifts[first] % period - lifts[first])
    impacts = np.empty(len(own), ORBIT_IMPACT)
    impacts["t"], impacts["u"] = own["t"] + shift, own["xdot_after"]
    impacts["xdot_before"], impacts["xdot_after"] = own["xdot_before"], own["xdot_after"]
    zeno, lifted = float(zenos[zenos < lifts[end]][-1]), float(lifts[first])
    new = Frame(multiple, frame.period, frame.method, frame.start)
    why = "The motion rests and lifts off again at the same phase."
    completed = OrbitStatus.COMPLETED
    return _orbit(system, new, lifted + shift, zeno + shift, impacts, completed, why)


def _orbit(
    system: ImpactSystem,
    frame: Frame,
    lift: float | None,
    zeno: float | None,
    impacts: NDArray[np.void],
    status: OrbitStatus,
    message: str,
) -> PeriodicOrbit:
    found = status is OrbitStatus.COMPLETED
    rests = status is OrbitStatus.RESTS
    return PeriodicOrbit(
        system=system,
        kind="resting",
        period=frame.period_of(system),
        multiple=frame.multiple,
        impacts=impacts,
        multipliers=np.zeros(2, np.complex128) if found or rests else np.full(2, np.nan + 0j),
        residual=0.0 if found or rests else np.inf,
        iterations=0,
        depth=np.inf,
        admissible=found or rests,
        status=status,
        message=message,
        _frame=frame,
        _y=np.column_stack([impacts["t"], impacts["u"]]),
        zeno_time=zeno,
        liftoff_time=lift,
    )


def chatter_exponent(e: float) -> float:
    r"""Give the exponent with which a resting orbit ends.

    Near the parameter at which the impacts no longer accumulate before the force turns outward, the
    time at rest vanishes like :math:`(F_c - F)^\beta` with

    .. math::

        \lambda^3 + 2 \lambda^2 = e (1 + 2 \lambda), \quad \tau = 1 - \lambda, \quad
        \beta = \frac{\ln 1/\lambda}{\ln \mu}

    One plastic impact (e = 0) moves smoothly past the lift-off: :math:`\beta = 1`.
    """
    if e == 0.0:
        return 1.0
    roots = np.roots([1.0, 2.0, -2.0 * e, -e])
    lam = float(max(root.real for root in roots if abs(root.imag) < 1e-12))
    tau = 1.0 - lam
    half = tau / 2.0 - tau**2 / 3.0
    top = e * ((0.5 - 2.0 * tau / 3.0) * (1.0 - tau) + 2.0 * half)
    mu = top / ((1.0 - tau) ** 3 * (0.5 - tau / 3.0))
    return math.log(1.0 / lam) / math.log(mu)
