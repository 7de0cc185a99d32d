"""What functions of parameters with derivatives have in common."""

from __future__ import annotations

import dataclasses
from abc import ABC, abstractmethod
from typing import Any, Generic, NamedTuple, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from zivi.base.check import Array, real_array

__all__ = ["ParameterFunction"]

Point = TypeVar("Point", bound=NamedTuple)


@dataclasses.dataclass(frozen=True)
class ParameterFunction(ABC, Generic[Point]):
    """A function of parameters whose value comes with its derivative; the last point is kept."""

    _last: dict[bytes, Any] = dataclasses.field(
        default_factory=dict, init=False, repr=False, compare=False
    )

    @property
    @abstractmethod
    def wrt(self) -> tuple[str, ...]:
        """What the entries of ``p`` are, tuple of str."""

    @property
    @abstractmethod
    def shape(self) -> tuple[int, ...]:
        """The shape of the value."""

    @abstractmethod
    def evaluate(self, p: ArrayLike) -> Point:
        """Give the value, its derivative, and how they were found."""

    @abstractmethod
    def _computed(self, p: Array) -> Point:
        """Give a point that is not known yet."""

    def _at(self, p: ArrayLike) -> Any:
        values = self._point(p)
        key = values.tobytes()
        found: Any = self._last.get(key)
        if found is None:
            found = self._computed(values)
            self._last.clear()
            self._last[key] = found
        # who changes what is given does not change what is kept
        value = np.copy(found.value) if self.shape else found.value
        return found._replace(value=value, derivative=found.derivative.copy())

    def _point(self, p: ArrayLike) -> Array:
        values = real_array("p", p).ravel()
        if len(values) != len(self.wrt):
            raise ValueError(f"p must have {len(self.wrt)} entries, got {len(values)}")
        return values

    def __call__(self, p: ArrayLike) -> tuple[Any, Array]:
        """Give the value and its derivative, of the shapes `shape` and ``(*shape, len(wrt))``."""
        found: Any = self.evaluate(p)
        return found.value, found.derivative

    def fun(self, p: ArrayLike) -> Array:
        """Give the value as a vector, for `scipy.optimize.least_squares`.

        Parameters
        ----------
        p : array_like
            A value for each of `wrt`.

        Returns
        -------
        ndarray
            One-dimensional.
        """
        found: Any = self.evaluate(p)
        return np.ravel(found.value)

    def jac(self, p: ArrayLike) -> Array:
        """Give the derivative as a matrix; where `fun` was just computed, without computing again.

        Parameters
        ----------
        p : array_like
            A value for each of `wrt`.

        Returns
        -------
        ndarray
            A row for each entry of `fun`, a column for each of `wrt`.
        """
        found: Any = self.evaluate(p)
        derivative: Array = found.derivative
        return derivative.reshape(-1, len(self.wrt))
