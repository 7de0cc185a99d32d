"""Branches of periodic orbits over a parameter, with the events at which they change."""

from __future__ import annotations

import dataclasses
from typing import NamedTuple

import numpy as np

from zivi.base.check import Array
from zivi.base.extras import late
from zivi.base.table import Field, Table
from zivi.derivatives.sensitivity import OrbitStatus
from zivi.orbits import along
from zivi.orbits.orbit import PeriodicOrbit

__all__ = ["MESSAGES", "Branch", "BranchEvent"]

MESSAGES = {
    **along.MESSAGES,
    OrbitStatus.COMPLETED: "The branch was followed to where it begins, at a period doubling.",
}

FIELDS: dict[str, Field] = {
    "t": ("point", "s", "time of the first impact"),
    "u": ("point", "m/s", "speed after the first impact"),
    **along.FIELDS,
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
class Branch(along.OrbitsAlong[BranchEvent]):
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
        orbit: PeriodicOrbit = late("zivi.orbits.switch", "switched")(self, event)
        return orbit

    def _table(self) -> Table:
        """Tell the points of the branch; its events are among the attributes."""
        fields: dict[str, Field] = {self.name: ("point", "", "parameter"), **FIELDS}
        return Table(
            "Branch of periodic orbits", fields, {}, self._columns(), self._end_and_events()
        )

    def __repr__(self) -> str:
        told = ", ".join(f"{event.kind} at {event.value:.9g}" for event in self.events)
        known = f"{told or 'no events'}{self._failed_text()}"
        return (
            f"<Branch of {len(self)} orbits over {self.name}: {known}; {self.status.name.lower()}>"
        )
