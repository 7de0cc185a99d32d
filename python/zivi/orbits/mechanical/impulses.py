r"""The equations of a linear system whose events are impacts: times and impulses are unknown.

With the impulses :math:`P_k` at :math:`t_k`, and what they make of the gaps (see `modes`), each
impact has two equations,

.. math:: g_k(t_k) = 0, \qquad (1 + e_k)\,\dot g_k(t_k^-) + D_k P_k = 0,

whatever the number of coordinates. They are regular where an impact grazes, `P = 0`, and so is
their Jacobian :math:`J(\theta) = R(\kappa) + i \sin\theta\,S(\kappa)` for disturbances that turn
by :math:`\theta` a period, :math:`\kappa = \cos\theta`.
"""

from __future__ import annotations

import functools
from typing import Any

import numpy as np

from zivi.base.check import Array
from zivi.base.status import Status
from zivi.orbits.flights import FlightError
from zivi.orbits.mechanical.accumulation import Accumulation
from zivi.orbits.mechanical.flow import Flights
from zivi.orbits.mechanical.frame import Frame
from zivi.orbits.mechanical.mass_flow import Evaluated, MassImpulses, impact_maps
from zivi.orbits.mechanical.segments import SegmentTerms, of_segments

__all__ = ["ImpulseTerms", "MassTerms"]

STEP = 1e-6
"""Of a difference by kappa: only the convergence depends on it."""


class ImpulseTerms:
    """The equations at some unknowns, rows ``(P, t)`` of the impacts."""

    def __init__(self, frame: Frame, y: Array) -> None:
        assert frame.impulses is not None
        self.frame, self.y, self.length = frame, y, frame.length
        self.kernel: Any = frame.impulses
        self.accumulations: dict[int, Accumulation] = {}
        self.residual, self.rates, self.jacobian = self._evaluated()

    def _evaluated(self) -> tuple[Array, Array, Array]:
        """Give the residual, the speeds before the impacts, the derivative."""
        times = self.y[1::2]
        if not np.isfinite(self.y).all() or times.max() - times.min() > 1e3 * abs(self.length):
            raise FlightError(Status.STEP_SIZE_TOO_SMALL)
        found: tuple[Array, Array, Array] = self.kernel.equations(self.y)
        return found

    @functools.cached_property
    def x(self) -> Array:
        """The segments between the impacts, rows ``(t, z, tau)``."""
        return self.frame.split(self.y)[0]

    @functools.cached_property
    def flights(self) -> Flights:
        """The flights to the impacts."""
        return self.frame.flow.fly((), self.x[:, 0], self.x[:, 1:-1], self.x[:, -1])

    @functools.cached_property
    def segments(self) -> SegmentTerms:
        """The equations of the same motion in segments."""
        return of_segments(self.frame, self.y, self.x, self.length)

    @property
    def impulses(self) -> list[Array]:
        """The impulses, those of `segments` too."""
        return [np.array([it]) for it in self.y[::2]]

    def matrix(self, factor: complex = 1.0) -> Any:
        r"""Give :math:`J`, for disturbances with a factor :math:`e^{i \theta}` a period."""
        if factor == 1.0:
            return self.jacobian
        real, sine = self.parts(float(np.real(factor)))
        return real if np.imag(factor) == 0.0 else real + 1j * np.imag(factor) * sine

    def by_multiplier(self) -> Array:
        """Give the derivative of the matrix by the factor, at -1."""
        return self.parts(-1.0)[1]

    def parts(self, kappa: float) -> tuple[Array, Array]:
        """Give R and S."""
        real, sine = self.kernel.turned(self.y, kappa)
        return real, sine

    def turned(self, kappa: float) -> tuple[Array, Array]:
        r"""Give the real matrix of a pair with :math:`\kappa = \cos \theta`, and its derivative.

        .. math:: \begin{pmatrix} R & -(1 - \kappa^2) S \\ S & R \end{pmatrix}
        """
        sides = [self._turned(kappa + h) for h in (STEP, -STEP)]
        return self._turned(kappa), (sides[0] - sides[1]) / (2.0 * STEP)

    def _turned(self, kappa: float) -> Array:
        real, sine = self.parts(kappa)
        return np.block([[real, (kappa * kappa - 1.0) * sine], [sine, real]])

    def curvature(self, factor: float, w: Array, v: Array) -> Array:
        """Give the gradient of w J v by the unknowns, of the matrix with a factor."""
        found: Array = self.kernel.curvature(self.y, factor, w, v)[0]
        return found

    def turned_curvature(self, kappa: float, w: Array, v: Array) -> list[Array]:
        """Give the gradients of w J v of the matrix of a pair, w and v of shape (2n, 2)."""
        n, square = len(self.y), kappa * kappa - 1.0

        def part(rows: int, i: int, columns: int, j: int) -> tuple[Array, Array]:
            left, right = w[rows : rows + n, i], v[columns : columns + n, j]
            own, sine = self.kernel.curvature(self.y, kappa, left, right)
            return own, sine

        return [
            part(0, i, 0, j)[0]
            + square * part(0, i, n, j)[1]
            + part(n, i, 0, j)[1]
            + part(n, i, n, j)[0]
            for i in (0, 1)
            for j in (0, 1)
        ]

    def rate_gradient(self, s: int) -> Array:
        """Give the derivative of the speed before an impact by the unknowns."""
        row = self.jacobian[2 * s + 1].copy()
        row[2 * s] -= self.kernel.mobilities[s]
        return np.asarray(row / (1.0 + self.frame.flow.e[self.frame.word[s].gap]), np.float64)

    def return_map(self, first: int = 0) -> Array:
        """Give the derivative of ``(t, z)`` at a segment's start one word later."""
        return self.segments.return_map(first)


class MassTerms(ImpulseTerms):
    """The equations of one mass, whose flights are computed once."""

    kernel: MassImpulses

    def __init__(
        self, frame: Frame, y: Array, name: str | None = None, found: Evaluated | None = None
    ) -> None:
        self.name, self._found = name, found
        super().__init__(frame, y)

    def _evaluated(self) -> tuple[Array, Array, Array]:
        found = self._found or self.kernel.equations(self.y, self.name)
        self._found, self.flights = found, found.flights
        return found.residual, self.flights.z[:, 1], found.own + found.before

    def parts(self, kappa: float) -> tuple[Array, Array]:
        """Give R and S."""
        assert self._found is not None
        return self._found.own + kappa * self._found.before, -self._found.before

    def column(self, name: str, longer: float) -> Array:
        """Give the derivative by a parameter, by which the length has one too."""
        assert self._found is not None
        found = self._found if name == self.name else self.kernel.equations(self.y, name)
        return found.by_parameter(longer)

    def return_map(self, first: int = 0) -> Array:
        """Give the derivative of ``(t, x, u)`` after an impact one word later."""
        maps = impact_maps(self.flights, self.kernel.e)
        product: Array = maps[first]
        if len(maps) == 1:
            return product
        with np.errstate(all="ignore"):
            for s in range(first + 1, first + len(maps)):
                product = maps[s % len(maps)] @ product
        return product
