"""Branches of periodic orbits over a parameter, their events, resting orbits."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Generic, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from zivi.base.check import Array, of_three
from zivi.base.extras import late
from zivi.base.table import Field, ResultTable, Tabulated, listed_by
from zivi.derivatives.result import OrbitStatus
from zivi.orbits.flows import shortened
from zivi.orbits.orbit import ORBIT_IMPACT, MassFrame, MechanicalOrbit, PeriodicOrbit
from zivi.simulation.run import simulate
from zivi.system.mass import ImpactSystem
from zivi.system.parameters import parameter, with_value

__all__ = [
    "BRANCH_FIELDS",
    "BRANCH_MESSAGES",
    "MASS_MESSAGES",
    "MECHANICAL_MESSAGES",
    "Branch",
    "BranchArc",
    "BranchEvent",
    "Follower",
    "MechanicalBranch",
    "MechanicalEvent",
    "OrbitsAlong",
    "chatter_exponent",
    "cycle_of",
    "ending",
    "failed_text",
    "follow_rest",
    "force_at_rest",
    "highest_pull",
    "rest_beyond",
    "resting_orbit",
    "rises",
    "with_failed",
]

# What branches of orbits of one mass and of mechanical systems have in common.

BRANCH_MESSAGES = {
    OrbitStatus.RANGE_END: "The branch was followed to the ends of the range.",
    OrbitStatus.MAX_POINTS: "The branch has max_points points.",
    OrbitStatus.LEFT_ADMISSIBLE: "The branch ends where the orbit is no motion any more.",
    OrbitStatus.CLOSED: "The branch is closed: it came back to a point of its own.",
    OrbitStatus.NOT_CONVERGED: "No step was short enough for Newton's iteration to converge.",
}

BRANCH_FIELDS: dict[str, Field] = {
    "stable": ("point", "", "whether the orbit is stable"),
    "admissible": ("point", "", "whether it is a motion of the system"),
    "multiplier_real": (("point", "multiplier"), "", "real parts of the multipliers"),
    "multiplier_imag": (("point", "multiplier"), "", "imaginary parts of the multipliers"),
}
"""Dimensions, unit and meaning of what is in the dataset, beside the parameter and the impact."""

Event = TypeVar("Event")


def failed_text(orbits: Sequence[Any]) -> str:
    """Say how many orbits have another status than success, nothing if none has."""
    failed = [it.status.name.lower() for it in orbits if it.status is not OrbitStatus.COMPLETED]
    unknown = sum(bool(np.isnan(it.multipliers).any()) for it in orbits)
    found = [listed_by(len(orbits), "orbits with a status", failed)] if failed else []
    found += [f"{unknown} of {len(orbits)} orbits without multipliers"] if unknown else []
    return ", ".join(found)


def with_failed(message: str, failed: str) -> str:
    """Return the message of a result with what failed in it."""
    return f"{message} {failed[0].upper()}{failed[1:]}." if failed else message


class OrbitsAlong(Tabulated, Generic[Event]):
    """Orbits along a parameter, with events."""

    if TYPE_CHECKING:
        name: str
        events: list[Any]
        status: OrbitStatus

        @property
        def orbits(self) -> Sequence[Any]: ...  # noqa: D102
        @property
        def values(self) -> Array: ...  # noqa: D102
        @property
        def multipliers(self) -> np.ndarray: ...  # noqa: D102

    def __len__(self) -> int:
        return len(self.orbits)

    @property
    def stable(self) -> np.ndarray:
        """Whether each orbit is stable."""
        return np.array([orbit.stable for orbit in self.orbits], dtype=bool)

    @property
    def admissible(self) -> np.ndarray:
        """Whether each orbit is a motion of the system."""
        return np.array([orbit.admissible for orbit in self.orbits], dtype=bool)

    def of_kind(self, kind: str) -> list[Event]:
        """Give the events of one kind.

        Parameters
        ----------
        kind : str
            As in `events`.

        Returns
        -------
        list
            In the order of the branch.
        """
        return [event for event in self.events if event.kind == kind]

    def _failed_text(self) -> str:
        """Say what failed behind a comma, nothing if nothing did."""
        failed = failed_text(self.orbits)
        return f", {failed}" if failed else ""

    def _columns(self) -> dict[str, Any]:
        """Give the parameter, the first impact and the multipliers of each orbit."""
        first = [orbit.impacts[0] if len(orbit.impacts) else None for orbit in self.orbits]
        return {
            self.name: self.values,
            "t": [math.nan if it is None else it["t"] for it in first],
            "u": [math.nan if it is None else it["u"] for it in first],
            "multiplier_real": self.multipliers.real,
            "multiplier_imag": self.multipliers.imag,
        }

    def _end_and_events(self) -> dict[str, Any]:
        """Give the end of the branch and its events."""
        return {
            "status": self.status.name,
            "events": [event.kind for event in self.events],
            "event_values": [event.value for event in self.events],
        }


# Branches of periodic orbits over a parameter, with the events at which they change.

MASS_MESSAGES = {
    **BRANCH_MESSAGES,
    OrbitStatus.COMPLETED: "The branch was followed to where it begins, at a period doubling.",
}

MASS_FIELDS: dict[str, Field] = {
    "t": ("point", "s", "time of the first impact"),
    "u": ("point", "m/s", "speed after the first impact"),
    **BRANCH_FIELDS,
}
"""Dimensions, unit and meaning of what is in the dataset, beside the parameter."""


class BranchEvent(NamedTuple):
    """Where a branch changes.

    Attributes
    ----------
    kind : str
        ``fold``, ``period_doubling``, ``grazing`` (an impact dies), ``interior_impact`` (a new
        one), ``end_of_rest`` (the time at rest vanishes), ``end_of_liftoff``, ``rest_appears``
        (near a new impact they become infinitely many, and the orbit rests), ``neimark_sacker``
        (a pair of multipliers passes the unit circle).
    value : float
        The parameter.
    orbit : PeriodicOrbit
        The orbit there.
    """

    kind: str
    value: float
    orbit: PeriodicOrbit


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class Branch(OrbitsAlong[BranchEvent]):
    """Orbits along a parameter.

    Attributes
    ----------
    name : str
        The parameter.
    orbits : list of PeriodicOrbit
        The points in the order of the arc.
    values : ndarray
        The parameter at each.
    events : list of BranchEvent
        Folds, period doublings, grazings, the end of rest, in the order of the arc.
    status : OrbitStatus
        Why the arc ends: ``COMPLETED`` (where a doubled orbit begins), ``RANGE_END``, ``CLOSED``
        (it came back to itself), ``LEFT_ADMISSIBLE``, ``MAX_POINTS``, ``NOT_CONVERGED``; of its two
        ends the one that needs more attention.
    message : str
        What happened.
    n_flights : int
        Flights that were computed; for a resting branch simulations.
    """

    name: str
    orbits: list[PeriodicOrbit]
    values: Array
    events: list[BranchEvent]
    status: OrbitStatus
    message: str
    n_flights: int

    @property
    def multipliers(self) -> np.ndarray:
        """The multipliers of each orbit, of shape (n, 2)."""
        return np.array([orbit.multipliers for orbit in self.orbits]).reshape(-1, 2)

    def switch(self, event: BranchEvent) -> PeriodicOrbit:
        """Give an orbit on the branch that meets this one in an event, to be continued.

        Parameters
        ----------
        event : BranchEvent
            One of `events`. At a period doubling the orbit of twice the period, a little away, or
            from a doubled orbit the single one where it begins; at
            a grazing the orbit without the impact; at an interior impact that with it; at the
            end of a rest an orbit of finitely many impacts beyond; where rest appears the orbit
            that rests; at a fold the orbit there.

        Returns
        -------
        PeriodicOrbit
            Its ``status`` says whether it was found.
        """
        orbit: PeriodicOrbit = late("zivi.orbits.follow", "switched")(self, event)
        return orbit

    def _table(self) -> ResultTable:
        """Tell the points of the branch; its events are among the attributes."""
        fields: dict[str, Field] = {self.name: ("point", "", "parameter"), **MASS_FIELDS}
        return ResultTable(
            "Branch of periodic orbits", fields, {}, self._columns(), self._end_and_events()
        )

    def __repr__(self) -> str:
        told = ", ".join(f"{event.kind} at {event.value:.9g}" for event in self.events)
        known = f"{told or 'no events'}{self._failed_text()}"
        return (
            f"<Branch of {len(self)} orbits over {self.name}: {known}; {self.status.name.lower()}>"
        )


# Branches of periodic orbits of mechanical systems: arcs of one word each, and events.

MECHANICAL_MESSAGES = {
    **BRANCH_MESSAGES,
    OrbitStatus.RETRACED: "The branch came to where it begins, at a period doubling.",
    OrbitStatus.SIMULTANEOUS: "The branch ends where two events happen at once.",
}

MECHANICAL_FIELDS: dict[str, Field] = {
    "arc": ("point", "", "number of the arc, of one word each"),
    "n_impacts": ("point", "", "impacts of a period of the motion"),
    "t": ("point", "", "time of the first impact"),
    "u": ("point", "", "speed of its gap after the first impact"),
    **BRANCH_FIELDS,
}
"""Dimensions, unit and meaning of what is in the dataset, beside the parameter."""


class MechanicalEvent(NamedTuple):
    """Where a branch of orbits of a mechanical system changes.

    Attributes
    ----------
    kind : str
        ``fold``, ``period_doubling``, ``pitchfork`` (of a symmetric orbit), ``neimark_sacker``,
        ``grazing`` (an impact dies), ``interior_impact`` (a new one), ``contact_ends`` (the force
        of a contact vanishes), ``end_of_rest`` (a contact lasts no time), ``rest_appears`` (a chain
        of impacts accumulates), ``opening`` (an impact no longer presses a contact that stays),
        ``simultaneous`` (two events at once).
    value : float
        The parameter.
    orbit : MechanicalOrbit
        The orbit there.
    gap : str or None
        The gap that it belongs to.
    kappa : float or None
        Of a Neimark-Sacker point the cosine of the angle of its multipliers.
    name : str
        The parameter's name.
    cubic : float or None
        Of a period doubling or a pitchfork the coefficient `c` of its normal form
        ``xi -> -xi + c xi**3``, for states relative to the size of the motion: positive where it is
        supercritical, so that the other branch takes over the stability.
    """

    kind: str
    value: float
    orbit: MechanicalOrbit
    gap: str | None = None
    kappa: float | None = None
    name: str = ""
    cubic: float | None = None


@dataclasses.dataclass(frozen=True, eq=False)
class BranchArc:
    """A part of a branch on which the orbits have one word."""

    word: tuple[str, ...]
    orbits: list[MechanicalOrbit]
    values: Array

    def __len__(self) -> int:
        return len(self.orbits)

    def __repr__(self) -> str:
        ends = f"{self.values[0]:.9g} .. {self.values[-1]:.9g}"
        return f"<BranchArc {shortened(self.word)!r}, {len(self)} orbits, {ends}>"


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class MechanicalBranch(OrbitsAlong[MechanicalEvent]):
    """Orbits of a mechanical system along a parameter, from word to word.

    Attributes
    ----------
    name : str
        The parameter.
    arcs : list of BranchArc
        Parts of one ``word`` each, in order, with their ``orbits`` and ``values``; where one ends
        at a grazing the next begins there.
    events : list of MechanicalEvent
        What happens, in order.
    status : OrbitStatus
        Why the branch ends: ``RANGE_END``, ``CLOSED`` (it came back to itself), ``RETRACED``,
        ``LEFT_ADMISSIBLE``, ``SIMULTANEOUS``, ``MAX_POINTS``, ``NOT_CONVERGED``; of its two ends
        the one that needs more attention.
    message : str
        What happened.
    n_flights : int
        Flights that were computed.
    """

    name: str
    arcs: list[BranchArc]
    events: list[MechanicalEvent]
    status: OrbitStatus
    message: str
    n_flights: int

    @property
    def orbits(self) -> list[MechanicalOrbit]:
        """The orbits of all arcs."""
        return [orbit for arc in self.arcs for orbit in arc.orbits]

    @property
    def values(self) -> Array:
        """The parameter at each orbit."""
        return np.concatenate([arc.values for arc in self.arcs])

    @property
    def words(self) -> list[str]:
        """The words of the arcs, in short."""
        return [shortened(arc.word) for arc in self.arcs]

    @property
    def multipliers(self) -> np.ndarray:
        """The multipliers of each orbit, a row each."""
        return np.array([orbit.multipliers for orbit in self.orbits])

    def switch(self, event: MechanicalEvent) -> MechanicalOrbit:
        """Give an orbit on the branch that meets this one in an event, to be continued.

        Parameters
        ----------
        event : MechanicalEvent
            One of `events`. At a period doubling the orbit of twice the period, a little away; at
            a pitchfork one that is not symmetric; at a grazing the orbit without the impact, at an
            interior impact that with it; at the end of a rest one of many impacts beyond; else the
            orbit there.

        Returns
        -------
        MechanicalOrbit
            Its ``status`` says whether it was found.
        """
        orbit: MechanicalOrbit = late("zivi.orbits.follow", "mechanical_switched")(self, event)
        return orbit

    def _table(self) -> ResultTable:
        """Tell the points of the branch; its events are among the attributes."""
        values = self._columns() | {
            "arc": np.repeat(np.arange(len(self.arcs)), [len(arc) for arc in self.arcs]),
            "n_impacts": [len(orbit.impacts) for orbit in self.orbits],
        }
        attrs = self._end_and_events() | {"words": self.words}
        fields: dict[str, Field] = {self.name: ("point", "", "parameter"), **MECHANICAL_FIELDS}
        return ResultTable("Branch of periodic orbits", fields, {}, values, attrs)

    def __repr__(self) -> str:
        listed = ", ".join(f"{event.kind} at {event.value:.9g}" for event in self.events)
        words = " | ".join(self.words)
        return (
            f"<MechanicalBranch of {len(self)} orbits over {self.name}, {words}: "
            f"{listed or 'no events'}{self._failed_text()}; {self.status.name.lower()}>"
        )


# Orbits that rest: they start at a lift-off, and one simulation is the orbit.

MOST_PERIODS = 64
REST_LOOKS = 256


def rises(system: ImpactSystem, period: float, start: float = 0.0) -> list[float]:
    """Give times, one for each lift-off of a period, shortly before which the force holds."""
    times = start + period * np.arange(REST_LOOKS + 1) / REST_LOOKS
    force = np.array([force_at_rest(system, float(t)) for t in times])
    found = [float(times[i]) for i in range(REST_LOOKS) if force[i] <= 0.0 < force[i + 1]]
    if found or force[0] > 0.0:
        return found
    # the force may be positive between two looks
    t, highest = _maximum(system, times, force)
    return [t - period / REST_LOOKS] if highest > 0.0 else []


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
    times = period * np.arange(REST_LOOKS + 1) / REST_LOOKS
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
    system: ImpactSystem, frame: MassFrame, phase: float, most: int | None = None
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
    new = MassFrame(multiple, frame.period, frame.method, frame.start)
    why = "The motion rests and lifts off again at the same phase."
    completed = OrbitStatus.COMPLETED
    return _orbit(system, new, lifted + shift, zeno + shift, impacts, completed, why)


def _orbit(
    system: ImpactSystem,
    frame: MassFrame,
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


# Branches of orbits that rest, and the parameter at which they end.

Inside = tuple[float, PeriodicOrbit]
"""A value of the parameter, and the resting orbit there."""

CLOSEST = 1e-13
ENOUGH = 1e-11
"""Two roots in turn that differ by less, relative to them, are the end."""
SHORT = 1e-2
"""How far a look stays short of a root, relative to its distance: beyond is nothing to see."""
MOST_SECANTS = 12


class Follower:
    """Simulates the orbit at values of the parameter."""

    def __init__(self, orbit: PeriodicOrbit, name: str) -> None:
        self.orbit, self.name, self.runs = orbit, name, 0
        self.phase = (orbit.liftoff_time or 0.0) - 0.5 * (orbit.margin or 0.0)

    def at(self, value: float) -> PeriodicOrbit | None:
        """Give the orbit with as many periods as the first, None where there is none."""
        self.runs += 1
        first = self.orbit
        system = with_value(first.system, self.name, value)
        frame = MassFrame(first.multiple, first._frame.period, first._frame.method)
        found = resting_orbit(system, frame, self.phase, first.multiple + 1)
        same = found.success and found.multiple == first.multiple
        return found if same and (found.margin or 0.0) > 0.0 else None


def follow_rest(
    orbit: PeriodicOrbit, name: str, span: tuple[float, float], step: float, most: int
) -> Branch:
    """Follow an orbit that rests to both ends of a range, or of itself."""
    follower = Follower(orbit, name)
    width = span[1] - span[0]
    arms = [_arm(follower, end, step * width, most // 2) for end in span]
    (below, first, ends_below), (above, last, ends_above) = arms
    orbits = [*below[::-1], orbit, *above]
    values = np.array([parameter(it.system, name) for it in orbits])
    events = [it for it in (first, last) if it is not None]
    status = OrbitStatus.RANGE_END
    for ended in (ends_below, ends_above):
        status = ended if ended is not OrbitStatus.RANGE_END else status
    message = with_failed(MASS_MESSAGES[status], failed_text(orbits))
    return Branch(name, orbits, values, events, status, message, follower.runs)


def _arm(
    follower: Follower, end: float, step: float, most: int
) -> tuple[list[PeriodicOrbit], BranchEvent | None, OrbitStatus]:
    """Go from the first orbit towards one end of the range."""
    now = follower.orbit
    value = parameter(now.system, follower.name)
    sign = 1.0 if end > value else -1.0
    found: list[PeriodicOrbit] = []
    before: Inside | None = None
    while len(found) < most and value != end:
        new = value + sign * step
        if sign * (end - new) <= 1e-12 * step:
            new = end
        there = follower.at(new)
        if there is None:
            event = ending(follower, (value, now), new, before)
            return found, event, OrbitStatus.LEFT_ADMISSIBLE
        found.append(there)
        before, value, now = (value, now), new, there
    status = OrbitStatus.RANGE_END if value == end else OrbitStatus.MAX_POINTS
    return found, None, status


def ending(
    follower: Follower, inside: Inside, outside: float, before: Inside | None = None
) -> BranchEvent:
    """Find where the branch ends: where the time at rest vanishes, or the lift-off does.

    With ``s`` the time at rest ``s^(1/beta)`` is a smooth function of the parameter that vanishes
    at the end: its secants converge, those of ``s`` hardly do. `before` is a point further inside.
    """
    lifts = _end_of_liftoff(follower, inside, outside)
    if lifts is not None:
        return lifts
    beta = chatter_exponent(follower.orbit.system.e)
    value, orbit = inside
    step = outside - value
    points = [inside]
    if before is None and (near := follower.at(value - 0.25 * step)) is not None:
        before = (value - 0.25 * step, near)
    points = points if before is None else [before, inside]
    root = np.nan
    for _ in range(MOST_SECANTS):
        last, root = root, _root(points, beta)
        if abs(root - last) <= ENOUGH * abs(root):
            break
        guess = _next_guess(root, value, outside)
        if abs(guess - value) <= CLOSEST * max(abs(value), 1e-3):
            break
        there = follower.at(guess)
        if there is None:
            outside, root = guess, np.nan
            if abs(outside - value) <= 4e-12 * abs(value):
                break
            continue
        value, orbit = guess, there
        points.append((value, orbit))
    end = _root(points, beta)
    return BranchEvent("end_of_rest", end if np.isfinite(end) else value, orbit)


def _end_of_liftoff(follower: Follower, inside: Inside, outside: float) -> BranchEvent | None:
    """Find where the force at rest no longer becomes positive, if that is why there is no orbit."""
    first, period = follower.orbit, follower.orbit.period

    def highest(value: float) -> float:
        return highest_pull(with_value(first.system, follower.name, value), period)

    (low, orbit), high = inside, outside
    one, other = highest(low), highest(high)
    if other > 0.0 or one <= 0.0:
        return None
    for _ in range(60):
        middle = low - one * (high - low) / (other - one)
        if not min(low, high) < middle < max(low, high):
            middle = 0.5 * (low + high)
        value = highest(middle)
        if value > 0.0:
            low, one = middle, value
        else:
            high, other = middle, value
        if abs(value) < 1e-14 or abs(high - low) < 1e-15 * abs(high):
            break
    return BranchEvent("end_of_liftoff", middle, orbit)


def _root(points: list[Inside], beta: float) -> float:
    """Give the zero of the line through the last two values of ``s^(1/beta)``."""
    if len(points) < 2:
        return np.nan
    (p, one), (q, other) = points[-2:]
    a, b = ((it.margin or 0.0) ** (1.0 / beta) for it in (one, other))
    return q - b * (q - p) / (b - a) if a != b else np.nan


def _next_guess(root: float, inside: float, outside: float) -> float:
    """Give the next place to look: short of the root, or the middle of the bracket."""
    if min(inside, outside) < root < max(inside, outside):
        return float(inside + (1.0 - SHORT) * (root - inside))
    return 0.5 * (inside + outside)


# Where an orbit with ever more impacts turns into one that rests.
#
# Near the end of a resting orbit, on its other side, there are orbits with a chain of impacts that
# the force throws off before they accumulate. Their number grows without bound towards the end, by
# one at each grazing: a branch of any of them ends there, and the point at which rest appears lies
# near it. It is the end of the resting orbit, located from within it.

CHAIN = 3
"""Impacts, each slower than the one before, that make a chain."""
ALIKE = 0.05
"""How far the fastest impacts of both orbits may be apart, relative to the period and its speed."""
REST_APPEARS_LOOKS = 12
FIRST = 1e-4


def rest_beyond(
    edge: PeriodicOrbit, name: str, end: float, span: tuple[float, float]
) -> tuple[float, PeriodicOrbit] | None:
    """Give the parameter near the end of a branch at which rest appears, and the orbit there.

    `edge` is where the branch ends with one impact more; it may have turned before, so both sides
    are looked at. None where there is no such orbit near it.
    """
    impacts, e = edge.impacts, edge.system.e
    if edge._frame.free or not len(impacts):
        return None
    speeds = -impacts["xdot_before"]
    if e > 0.0 and not _is_chain(speeds):
        return None
    # where the chain, or the one plastic impact that the force holds, is
    pulls = speeds if e > 0.0 else [force_at_rest(edge.system, float(t)) for t in impacts["t"]]
    slowest = int(np.argmin(pulls))
    near = _Impacting(impacts["t"], speeds, float(impacts["t"][slowest]))
    outside = {1.0: end, -1.0: end}
    for look in range(REST_APPEARS_LOOKS):
        for side in outside:
            value = end + side * FIRST * 2.0**look * (span[1] - span[0])
            if not span[0] <= value <= span[1]:
                continue
            orbit = _resting(edge, name, near, value)
            if orbit is None:
                outside[side] = value
                continue
            event = ending(Follower(orbit, name), (value, orbit), outside[side])
            return (event.value, event.orbit) if event.kind == "end_of_rest" else None
    return None


@dataclasses.dataclass(frozen=True)
class _Impacting:
    """The orbit at the end of the branch."""

    times: Array
    speeds: Array
    """Of the impacts, before them."""
    slowest: float
    """When it nearly rests."""


def _is_chain(speeds: Array) -> bool:
    """Whether impacts, in any turn of the cycle, end with slower and slower ones."""
    k = len(speeds)
    if k <= CHAIN:
        return False
    turned = np.roll(speeds, -int(np.argmax(speeds)))
    falls = np.diff(turned) < 0.0
    return int(np.argmin(np.append(falls, False))) >= CHAIN


def _resting(
    edge: PeriodicOrbit, name: str, near: _Impacting, value: float
) -> PeriodicOrbit | None:
    """Give the resting orbit with the fastest impact of an impacting one."""
    system = with_value(edge.system, name, value)
    frame = dataclasses.replace(edge._frame, start=0.0)
    period, i = frame.period_of(system), int(np.argmax(near.speeds))
    phase = near.slowest - 0.125 * period
    orbit = resting_orbit(system, frame, phase, frame.multiple + 1)
    if not orbit.success or orbit.multiple != frame.multiple or not len(orbit.impacts):
        return None
    fastest = orbit.impacts[np.argmin(orbit.impacts["xdot_before"])]
    turn = (fastest["t"] - near.times[i]) / (frame.multiple * period)
    faster = -fastest["xdot_before"] / near.speeds[i] - 1.0
    return orbit if max(abs(turn - round(turn)), abs(faster)) < ALIKE else None
