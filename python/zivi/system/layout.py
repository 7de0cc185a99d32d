"""What a model of a mechanical system gives at a state, and its place in one row of numbers."""

from __future__ import annotations

import dataclasses

import numpy as np

from zivi.base.check import Array

__all__ = ["Evaluation", "Layout"]


@dataclasses.dataclass(frozen=True, eq=False)
class Evaluation:
    r"""A mechanical system at one time and state.

    Attributes
    ----------
    mass : ndarray
        :math:`M`, of shape (n, n).
    force : ndarray
        :math:`F`, of shape (n,).
    gaps : ndarray
        :math:`g_i`, of shape (m,).
    gradients : ndarray
        :math:`\partial g_i/\partial q`, of shape (m, n).
    curvatures : ndarray
        :math:`h_i = \dot q^T H_i \dot q + 2 g_{i,tq} \dot q + g_{i,tt}`, of shape (m,).
    rates : ndarray
        :math:`\partial g_i/\partial t`, of shape (m,).
    """

    mass: Array
    force: Array
    gaps: Array
    gradients: Array
    curvatures: Array
    rates: Array


@dataclasses.dataclass(frozen=True)
class Layout:
    """Where M, F, g, N, h and g_t stand in the row of numbers that a model fills.

    Parameters
    ----------
    n, m : int
        Numbers of coordinates and of gaps.
    """

    n: int
    m: int

    @property
    def size(self) -> int:
        """How many numbers there are."""
        return self.n * (self.n + 1) + self.m * (self.n + 3)

    @property
    def shapes(self) -> dict[str, tuple[int, ...]]:
        """The parts in their order, by the names of `Evaluation`."""
        n, m = self.n, self.m
        return {
            "mass": (n, n),
            "force": (n,),
            "gaps": (m,),
            "gradients": (m, n),
            "curvatures": (m,),
            "rates": (m,),
        }

    def views(self, row: Array) -> dict[str, Array]:
        """Give the parts of a row as arrays that share its memory."""
        parts, start = {}, 0
        for name, shape in self.shapes.items():
            end = start + int(np.prod(shape))
            parts[name] = row[start:end].reshape(shape)
            start = end
        return parts

    def read(self, row: Array) -> Evaluation:
        """Give a copy of a row by its parts."""
        return Evaluation(**self.views(row.copy()))
