"""What branches of orbits of one mass and of mechanical systems have in common."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Generic, TypeVar

import numpy as np

from zivi.base.check import Array
from zivi.base.table import Field, Tabulated, listed_by
from zivi.derivatives.result import OrbitStatus

__all__ = ["FIELDS", "MESSAGES", "OrbitsAlong", "failed_text", "with_failed"]

MESSAGES = {
    OrbitStatus.RANGE_END: "The branch was followed to the ends of the range.",
    OrbitStatus.MAX_POINTS: "The branch has max_points points.",
    OrbitStatus.LEFT_ADMISSIBLE: "The branch ends where the orbit is no motion any more.",
    OrbitStatus.CLOSED: "The branch is closed: it came back to a point of its own.",
    OrbitStatus.NOT_CONVERGED: "No step was short enough for Newton's iteration to converge.",
}

FIELDS: dict[str, Field] = {
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
