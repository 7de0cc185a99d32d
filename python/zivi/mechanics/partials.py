"""Partial derivatives of a mechanical system's numbers: given, derived, or differenced."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any

__all__ = ["Partials"]


@dataclasses.dataclass(frozen=True)
class Partials:
    """What the extension takes for the derivatives of a model.

    Parameters
    ----------
    spec : tuple
        ``("differences", [(step, six models), ...])``, or the model of a function that fills in the
        derivatives of all numbers by time, coordinates, velocities and parameters, one after the
        other.
    parameters : dict
        Names and values of the parameters, in their order.
    owner : object
        What keeps compiled functions alive.
    """

    spec: tuple[Any, ...] = ("differences", [])
    parameters: Mapping[str, float] = dataclasses.field(default_factory=dict)
    owner: object = None
