"""Branches of periodic orbits over a parameter, and their events."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Generic, NamedTuple, TypeVar

import numpy as np

from zivi.base.check import Array
from zivi.base.extras import late
from zivi.base.table import Field, ResultTable, Tabulated, listed_by
from zivi.derivatives.result import OrbitStatus
from zivi.orbits.flows import shortened
from zivi.orbits.orbit import MechanicalOrbit, PeriodicOrbit

# Base class of branches of orbits of one mass and of mechanical systems.

BRANCH_MESSAGES = {
    OrbitStatus.RANGE_END: "The branch was followed to the ends of the range.",
    OrbitStatus.MAX_POINTS: "The branch has max_points points.",
    OrbitStatus.LEFT_ADMISSIBLE: "The branch ends where the orbit becomes inadmissible.",
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
    """Describe how many orbits failed, by status; "" if none did."""
    failed = [it.status.name.lower() for it in orbits if it.status is not OrbitStatus.COMPLETED]
    unknown = sum(bool(np.isnan(it.multipliers).any()) for it in orbits)
    found = [listed_by(len(orbits), "orbits with a status", failed)] if failed else []
    found += [f"{unknown} of {len(orbits)} orbits without multipliers"] if unknown else []
    return ", ".join(found)


def with_failed(message: str, failed: str) -> str:
    """Return the message of a result with its failures."""
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
        """Return the events of one kind.

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
        """Describe the failures after a comma; "" if there are none."""
        failed = failed_text(self.orbits)
        return f", {failed}" if failed else ""

    def _columns(self) -> dict[str, Any]:
        """Return the parameter, the first impact and the multipliers of each orbit."""
        first = [orbit.impacts[0] if len(orbit.impacts) else None for orbit in self.orbits]
        return {
            self.name: self.values,
            "t": [math.nan if it is None else it["t"] for it in first],
            "u": [math.nan if it is None else it["u"] for it in first],
            "multiplier_real": self.multipliers.real,
            "multiplier_imag": self.multipliers.imag,
        }

    def _end_and_events(self) -> dict[str, Any]:
        """Return the end of the branch and its events."""
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
        (a pair of multipliers passes the unit circle), ``contact_ends`` (the force lifts a mass
        that rests off once more).
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
        Flights that were computed.
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
        """Return an orbit on the branch that meets this one in an event, to be continued.

        Parameters
        ----------
        event : BranchEvent
            One of `events`. At a period doubling, a nearby orbit of twice the period (from a
            doubled orbit, the orbit of half the period); at a grazing, the orbit without the
            impact; at an interior impact, the orbit with it; at the end of a rest, an orbit of
            finitely many impacts past it; where rest appears, the resting orbit; at a fold, the
            orbit there.

        Returns
        -------
        PeriodicOrbit
            See its ``status`` for success.
        """
        orbit: PeriodicOrbit = late("zivi.orbits.follow", "switched")(self, event)
        return orbit

    def _table(self) -> ResultTable:
        """Describe the dataset: points of the branch, with its events as attributes."""
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
        ``grazing`` (an impact vanishes), ``interior_impact`` (a new one appears), ``contact_ends``
        (the force of a contact vanishes), ``end_of_rest`` (the duration of a contact vanishes),
        ``rest_appears`` (an impact sequence accumulates), ``opening`` (the impulse of an impact on
        a closed contact vanishes), ``simultaneous`` (two events coincide).
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
        For a period doubling or a pitchfork, the coefficient `c` of its normal form
        ``xi -> -xi + c xi**3``, for states relative to the size of the motion: positive if the
        bifurcation is supercritical, so that the other branch is stable.
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
        """Return an orbit on the branch that meets this one in an event, to be continued.

        Parameters
        ----------
        event : MechanicalEvent
            One of `events`. At a period doubling, a nearby orbit of twice the period; at a
            pitchfork, an asymmetric orbit; at a grazing, the orbit without the impact; at an
            interior impact, the orbit with it; at the end of a rest, an orbit of many impacts past
            it; otherwise the orbit there.

        Returns
        -------
        MechanicalOrbit
            See its ``status`` for success.
        """
        orbit: MechanicalOrbit = late("zivi.orbits.follow", "switched")(self, event)
        return orbit

    def _table(self) -> ResultTable:
        """Describe the dataset: points of the branch, with its events as attributes."""
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


# How a resting orbit ends.


def chatter_exponent(e: float) -> float:
    r"""Return the exponent with which a resting orbit ends.

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
