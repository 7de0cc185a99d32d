"""Branches of periodic orbits of mechanical systems: arcs of one word each, and events."""

from __future__ import annotations

import dataclasses
from typing import NamedTuple

import numpy as np

from zivi.base.check import Array
from zivi.base.extras import late
from zivi.base.table import Field, Table
from zivi.derivatives.result import OrbitStatus
from zivi.orbits import along
from zivi.orbits.mechanical.orbit import MechanicalOrbit
from zivi.orbits.mechanical.word import shortened

__all__ = ["MESSAGES", "BranchArc", "MechanicalBranch", "MechanicalEvent"]

MESSAGES = {
    **along.MESSAGES,
    OrbitStatus.RETRACED: "The branch came to where it begins, at a period doubling.",
    OrbitStatus.SIMULTANEOUS: "The branch ends where two events happen at once.",
}

FIELDS: dict[str, Field] = {
    "arc": ("point", "", "number of the arc, of one word each"),
    "n_impacts": ("point", "", "impacts of a period of the motion"),
    "t": ("point", "", "time of the first impact"),
    "u": ("point", "", "speed of its gap after the first impact"),
    **along.FIELDS,
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
class MechanicalBranch(along.OrbitsAlong[MechanicalEvent]):
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
        orbit: MechanicalOrbit = late("zivi.orbits.mechanical.switch", "switched")(self, event)
        return orbit

    def _table(self) -> Table:
        """Tell the points of the branch; its events are among the attributes."""
        values = self._columns() | {
            "arc": np.repeat(np.arange(len(self.arcs)), [len(arc) for arc in self.arcs]),
            "n_impacts": [len(orbit.impacts) for orbit in self.orbits],
        }
        attrs = self._end_and_events() | {"words": self.words}
        fields: dict[str, Field] = {self.name: ("point", "", "parameter"), **FIELDS}
        return Table("Branch of periodic orbits", fields, {}, values, attrs)

    def __repr__(self) -> str:
        listed = ", ".join(f"{event.kind} at {event.value:.9g}" for event in self.events)
        words = " | ".join(self.words)
        return (
            f"<MechanicalBranch of {len(self)} orbits over {self.name}, {words}: "
            f"{listed or 'no events'}{self._failed_text()}; {self.status.name.lower()}>"
        )
