"""What a model of a mechanical system gives at a state, and its place in one row of numbers."""

from __future__ import annotations

import dataclasses
import functools
import math

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
    tangents : ndarray
        Directions of slip :math:`B_c` of the p channels of dry friction, of shape (p, n).
    slip_curvatures : ndarray
        :math:`k_c`, what the derivatives of the slip speeds are without acceleration, of shape
        (p,).
    slip_rates : ndarray
        :math:`\beta_c`, of shape (p,): the slip speeds are :math:`w_c = B_c \dot q + \beta_c`.
    limits, static_limits : ndarray
        What friction takes in slip and holds in stick, of shape (p,): coefficients of friction at
        gaps, forces in joints.
    """

    mass: Array
    force: Array
    gaps: Array
    gradients: Array
    curvatures: Array
    rates: Array
    tangents: Array
    slip_curvatures: Array
    slip_rates: Array
    limits: Array
    static_limits: Array


@dataclasses.dataclass(frozen=True)
class Layout:
    """Where the parts of an evaluation stand in the row of numbers that a model fills.

    Parameters
    ----------
    n, m, p : int
        Numbers of coordinates, of gaps and of channels of dry friction.
    """

    n: int
    m: int
    p: int = 0

    @property
    def size(self) -> int:
        """How many numbers there are."""
        return self.n * (self.n + 1) + self.m + (self.m + self.p) * (self.n + 2) + 2 * self.p

    @property
    def shapes(self) -> dict[str, tuple[int, ...]]:
        """The parts in their order, by the names of `Evaluation`."""
        n, m, p = self.n, self.m, self.p
        return {
            "mass": (n, n),
            "force": (n,),
            "gaps": (m,),
            "gradients": (m, n),
            "tangents": (p, n),
            "curvatures": (m,),
            "slip_curvatures": (p,),
            "rates": (m,),
            "slip_rates": (p,),
            "limits": (p,),
            "static_limits": (p,),
        }

    def views(self, row: Array) -> dict[str, Array]:
        """Give the parts of a row as arrays that share its memory."""
        return {name: row[at].reshape(shape) for name, at, shape in places(self)}

    def read(self, row: Array) -> Evaluation:
        """Give a copy of a row by its parts."""
        return Evaluation(**self.views(row.copy()))


@functools.lru_cache(maxsize=256)
def places(layout: Layout) -> list[tuple[str, slice, tuple[int, ...]]]:
    """Name the parts of a row, and give their places and shapes."""
    found, start = [], 0
    for name, shape in layout.shapes.items():
        end = start + math.prod(shape)
        found.append((name, slice(start, end), shape))
        start = end
    return found
