"""The matrix through which controls act on a mechanical system."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

import zivi._zivi as _zivi
from zivi.base.check import Array, real_array
from zivi.base.functions import check_arguments

__all__ = ["ControlInputs", "control_inputs", "every_coordinate"]


@dataclasses.dataclass(frozen=True, eq=False)
class ControlInputs:
    """The matrix :math:`B` of the forces :math:`B u` of r controls.

    Parameters
    ----------
    names : tuple of str
        Names of the controls; empty as long as a function has not told how many there are.
    matrix : ndarray or callable
        :math:`B`, of shape (n, r), or a function of the coordinates that gives it.
    """

    names: tuple[str, ...]
    matrix: Array | Callable[[Array], Any]

    @property
    def r(self) -> int:
        """How many controls there are."""
        return len(self.names)

    def known(self, q: Array) -> ControlInputs:
        """Give the same with the names of all controls, and its shape checked at coordinates."""
        shape = np.shape(self.matrix if isinstance(self.matrix, np.ndarray) else self.matrix(q))
        if len(shape) != 2 or shape[0] != len(q) or not shape[1]:
            raise ValueError(f"inputs must have shape ({len(q)}, r), got {shape}")
        if self.names and len(self.names) != shape[1]:
            raise ValueError(f"inputs must have {len(self.names)} columns, got {shape[1]}")
        return self if self.names else dataclasses.replace(self, names=numbered(shape[1]))

    def at(self, q: Array) -> Array:
        """Give the matrix at coordinates, shape (n, r)."""
        if isinstance(self.matrix, np.ndarray):
            return self.matrix
        return np.ascontiguousarray(self.matrix(q), dtype=np.float64)

    def spec(self) -> _zivi.Inputs:
        """Give what the extension takes."""
        if isinstance(self.matrix, np.ndarray):
            return _zivi.Inputs.constant(self.r, self.matrix.ravel().tolist())
        return _zivi.Inputs.callable(self.r, lambda t, q: self.at(q))


def control_inputs(given: Any) -> ControlInputs:
    """Read a matrix, a function of the coordinates, or columns by the names of the controls."""
    if isinstance(given, Mapping):
        names = tuple(str(name) for name in given)
        columns = [np.atleast_1d(real_array(f"inputs[{n!r}]", it)) for n, it in given.items()]
        if not columns or any(it.ndim != 1 or it.shape != columns[0].shape for it in columns):
            raise ValueError("inputs must give columns of one length, one for each control")
        return ControlInputs(names, _finite(np.column_stack(columns)))
    if callable(given):
        check_arguments("inputs", given, "q")
        return ControlInputs((), given)
    matrix = real_array("inputs", given)
    matrix = matrix.reshape(-1, 1) if matrix.ndim < 2 else matrix
    if matrix.ndim != 2 or not matrix.shape[1]:
        raise ValueError(f"inputs must have shape (n, r), got {matrix.shape}")
    return ControlInputs(numbered(matrix.shape[1]), _finite(matrix))


def every_coordinate(n: int) -> ControlInputs:
    """Give the inputs of a system without any of its own: a force on each coordinate."""
    return ControlInputs(numbered(n), np.eye(n))


def numbered(r: int) -> tuple[str, ...]:
    """Name controls by their numbers."""
    return tuple(f"u{j}" for j in range(r))


def _finite(matrix: Array) -> Array:
    if not np.all(np.isfinite(matrix)):
        raise ValueError(f"inputs must be finite, got {matrix.tolist()}")
    return np.ascontiguousarray(matrix)
