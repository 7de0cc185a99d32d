"""The search of the sparse solver: problem, best point so far, termination."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any, Protocol

import numpy as np

from zivi.base.check import Array
from zivi.vi.factorisation import Factoriser
from zivi.vi.types import VIStatus


class Map(Protocol):
    """``F`` and its Jacobian, None where undefined."""

    is_affine: bool
    rounding: float
    nfev: int

    @property
    def undefined_points(self) -> str:
        """Text about points where `F` is not defined."""

    def value(self, x: Array) -> Array | None:
        """Return ``F(x)``."""

    def slopes(self, x: Array) -> Any:
        """Return the Jacobian as a ``csr_array``."""


class EndedError(Exception):
    """The search has ended from within, with a status."""

    def __init__(self, status: VIStatus) -> None:
        super().__init__(status.name)
        self.status = status


def natural_map(x: Array, F: Array, lower: Array, upper: Array) -> Array:
    """Return ``max(x - u, min(x - l, F))``, zero at a solution; it does not cancel at large `x`."""
    return np.maximum(x - upper, np.minimum(x - lower, F))


class Search:
    """Shared state of the stages.

    Parameters
    ----------
    map_ : Map
        The problem.
    lower, upper, x0 : ndarray
        The box and the initial point.
    tol, rtol : float
        Tolerances (see `solve_vi`).
    max_iterations : int
        Of all stages together.
    row_scale : ndarray or None
        Factors of the rows.
    time_limit : float or None
        Seconds.
    observe : callable or None
        Called after every iteration.
    """

    def __init__(
        self,
        map_: Map,
        lower: Array,
        upper: Array,
        x0: Array,
        *,
        tol: float,
        rtol: float,
        max_iterations: int,
        row_scale: Array | None,
        time_limit: float | None,
        observe: Callable[[int, float, int, str], object] | None,
    ) -> None:
        self.map = map_
        self.lower, self.upper, self.x0 = lower, upper, x0
        self.n = len(x0)
        self.tol, self._rtol = tol, rtol
        self._max_iterations = max_iterations
        self.scale = np.ones(self.n) if row_scale is None else row_scale
        self._deadline = None if time_limit is None else time.perf_counter() + time_limit
        self._observe = observe
        self.factoriser = Factoriser(self.poll)
        self.stage = "S0"
        self.found_in = "S0"
        self.n_iter = self.njev = 0
        self.best_x, self.best_residual = x0, np.inf
        self.best_F = np.full(self.n, np.nan)
        self.ratio = np.nan
        self._last = np.nan

    def poll(self) -> None:
        """End the search where its time is over."""
        if self._deadline is not None and time.perf_counter() > self._deadline:
            raise EndedError(VIStatus.TIME_LIMIT)

    @property
    def time_left(self) -> float | None:
        """Seconds until the time limit."""
        if self._deadline is None:
            return None
        return max(self._deadline - time.perf_counter(), 1e-3)

    def value(self, x: Array) -> Array | None:
        """Return `F` with its rows scaled; None if not finite."""
        self.poll()
        F = self.map.value(x)
        if F is None or not np.isfinite(F).all():
            return None
        return self.scale * F

    def slopes(self, x: Array) -> Any:
        """Return the Jacobian with its rows scaled; None if not finite."""
        self.poll()
        self.njev += 1
        J = self.map.slopes(x)
        if J is None or not np.isfinite(J.data).all():
            return None
        self.factoriser.see_pattern(J)
        if np.any(self.scale != 1):
            J = J.copy()
            J.data *= np.repeat(self.scale, np.diff(J.indptr))
        return J

    def inside(self, x: Array) -> Array:
        """Return the nearest point of the box."""
        return np.minimum(np.maximum(x, self.lower), self.upper)

    def consider(self, x: Array, F: Array) -> bool:
        """Store a point of the box if it is the best so far; return whether it is a solution."""
        residual = float(np.max(np.abs(natural_map(x, F, self.lower, self.upper))))
        if self._rtol and not np.isfinite(self.best_residual):
            self.tol = max(self.tol, self._rtol * residual)
        if residual < self.best_residual:
            self.best_x, self.best_F, self.best_residual = x, F, residual
            self.found_in = self.stage
        return residual <= self.tol

    def end_iteration(self, x: Array, F: Array) -> bool:
        """End an iteration at the point of the box nearest to `x`; whether that is a solution.

        It is counted and reported to the caller; limits are checked.
        """
        clipped = self.inside(x)
        value = F if np.array_equal(clipped, x) else self.value(clipped)
        solved = value is not None and self.consider(clipped, value)
        self._report(clipped, F if value is None else value)
        return solved

    def _report(self, x: Array, F: Array) -> None:
        self.n_iter += 1
        sizes = np.abs(natural_map(x, F, self.lower, self.upper))
        worst = int(np.argmax(sizes))
        residual = float(sizes[worst])
        with np.errstate(all="ignore"):
            self.ratio = float(np.float64(residual) / self._last)
        self._last = residual
        if self._observe is not None:
            try:
                self._observe(self.n_iter, residual, worst, self.stage)
            except StopIteration:
                raise EndedError(VIStatus.STOPPED) from None
        self.poll()
        if self.n_iter >= self._max_iterations and self.best_residual > self.tol:
            raise EndedError(VIStatus.ITERATION_LIMIT)
