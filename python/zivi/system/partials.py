"""Partial derivatives of a mechanical system's numbers: given, derived, or differenced."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping

import zivi._zivi as _zivi

__all__ = ["Partials"]


@dataclasses.dataclass(frozen=True)
class Partials:
    """What the extension takes for the derivatives of a model.

    Parameters
    ----------
    spec : _zivi.Partials
        Differences, or a function that fills in all derivatives.
    parameters : dict
        Names and values of the parameters, in their order.
    """

    spec: _zivi.Partials = dataclasses.field(default_factory=lambda: _zivi.Partials.differences([]))
    parameters: Mapping[str, float] = dataclasses.field(default_factory=dict)
