"""Loads of linear systems: constants, waves, tables."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from zivi.base.check import Array, finite, real_array
from zivi.base.habits import hinted
from zivi.system.table import Table

__all__ = ["Excitation", "Harmonic", "parts_of", "projected"]


@hinted("Harmonic")
@dataclasses.dataclass(frozen=True, eq=False)
class Harmonic:
    r"""A harmonic load, :math:`p \cos(\omega t + \varphi)`.

    Parameters
    ----------
    amplitude : array_like
        :math:`p`, a force for each coordinate, shape (n,).
    omega : float
        :math:`\omega` (rad/s).
    phase : float
        :math:`\varphi` (rad).

    Raises
    ------
    ValueError
        If a number is not finite.

    Examples
    --------
    >>> zivi.Harmonic([0.0, 2.0], 3.0)
    Harmonic(amplitude=[0.0, 2.0], omega=3.0, phase=0.0)
    """

    amplitude: ArrayLike
    omega: float
    phase: float = 0.0

    def __post_init__(self) -> None:
        amplitude = np.atleast_1d(real_array("amplitude", self.amplitude))
        if amplitude.ndim != 1 or not np.all(np.isfinite(amplitude)):
            raise ValueError(f"amplitude must be a finite vector, got {amplitude.tolist()}")
        object.__setattr__(self, "amplitude", amplitude)
        for name in ("omega", "phase"):
            object.__setattr__(self, name, finite(name, getattr(self, name)))

    def __repr__(self) -> str:
        amplitude = np.asarray(self.amplitude).tolist()
        return f"Harmonic(amplitude={amplitude}, omega={self.omega}, phase={self.phase})"


Excitation: TypeAlias = "ArrayLike | Harmonic | Table | Sequence[ArrayLike | Harmonic | Table]"
"""A constant load (n,), a `Harmonic`, a `Table` of shape (k, n), or several of them."""


def parts_of(excitation: Any, n: int) -> tuple[Array | Harmonic | Table, ...]:
    """Read the parts of a load and check their sizes."""
    if excitation is None:
        return ()
    named = (Harmonic, Table)
    several = isinstance(excitation, list | tuple) and any(
        isinstance(it, named) or np.ndim(it) > 0 for it in excitation
    )
    parts: list[Array | Harmonic | Table] = []
    for part in excitation if several else [excitation]:
        if isinstance(part, Harmonic):
            size: tuple[int, ...] = np.shape(part.amplitude)
        elif isinstance(part, Table):
            size = (part.width or 1,)
        else:
            part = np.atleast_1d(real_array("excitation", part))
            if not np.all(np.isfinite(part)):
                raise ValueError(f"excitation must be finite, got {part.tolist()}")
            size = part.shape
        if size != (n,):
            raise ValueError(f"excitation must have a number for each of {n} loads, got {part!r}")
        parts.append(part)
    return tuple(parts)


def projected(part: Array | Harmonic | Table, shapes: Array) -> Array | Harmonic | Table:
    """Give the modal load of a part."""
    if isinstance(part, Harmonic):
        return dataclasses.replace(part, amplitude=shapes.T @ np.asarray(part.amplitude))
    if isinstance(part, Table):
        values = part.values.reshape(len(part.times), -1) @ shapes
        return Table(part.times, values, part.kind, part.extend)
    modal: Array = shapes.T @ part
    return modal
