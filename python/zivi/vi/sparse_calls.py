"""How `solve_vi` and `solve_avi` reach the sparse solver: when, and with what checked."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any, TypeAlias

import numpy as np

import zivi._zivi as _zivi
from zivi.base.arrays import MAX_DENSE, Array, require_finite
from zivi.vi.coloured import pattern_of
from zivi.vi.jacobian import Converters
from zivi.vi.scale import Affine
from zivi.vi.sparse import solve_sparse
from zivi.vi.sparse_maps import AffineMap, CallableMap, require_finite_entries, sparse_matrix
from zivi.vi.types import VIResult, result_of

__all__ = [
    "SparseVI",
    "affine_by_sparse",
    "checked_affine",
    "pattern_for",
]

Observer: TypeAlias = Callable[[int, float, int, str], object] | None


def pattern_for(jac_sparsity: Any, jac: Any, n: int) -> tuple[Any, str]:
    """Return the pattern and the scheme of coloured differences."""
    scheme = "3-point" if jac is None or jac is False else jac
    if not isinstance(scheme, str):
        raise ValueError("jac_sparsity is for differences: leave out jac, or name their scheme")
    if scheme not in ("2-point", "3-point", "cs"):
        raise ValueError(f"jac must be '2-point', '3-point' or 'cs', got {scheme!r}")
    return pattern_of(jac_sparsity, n), scheme


def _checked(
    box: tuple[Array | float, Array | float], start: Array, settings: dict[str, Any]
) -> tuple[Array, Array]:
    """Return both bounds as arrays; the extension refuses bounds and settings that are wrong."""
    n = len(start)
    lower, upper = (np.array(np.broadcast_to(it, n), float) for it in box)
    _zivi.natural_residual(np.zeros(n), np.zeros(n), lower, upper)
    others = {name: value for name, value in settings.items() if name != "row_scale"}
    _zivi.solve_avi(np.eye(1), np.zeros(1), 0.0, 1.0, None, others)
    require_finite("x0", start)
    scale = settings.get("row_scale")
    if scale is not None:
        if scale.shape != (n,):
            raise ValueError(f"row_scale must have {n} entries, got {len(scale)}")
        if not np.all((scale > 0) & np.isfinite(scale)):
            worst = scale[~((scale > 0) & np.isfinite(scale))][0]
            raise ValueError(f"row_scale must be finite and > 0, got {worst}")
    return lower, upper


def checked_affine(
    M: Any,
    q: Array,
    box: tuple[Array | float, Array | float],
    start: Array | None,
    settings: dict[str, Any],
) -> Affine:
    """Return a sparse affine problem whose parts have been checked."""
    n = len(q)
    matrix = sparse_matrix("M", M, n)
    require_finite_entries("M", matrix)
    require_finite("q", q)
    begin = np.zeros(n) if start is None else start
    lower, upper = _checked(box, begin, settings)
    return Affine(matrix, q, lower, upper, begin)


def affine_by_sparse(
    a: Affine,
    settings: dict[str, Any],
    time_limit: float | None,
    observe: Observer,
) -> VIResult:
    """Solve a sparse affine problem."""

    def dense(seconds: float | None) -> VIResult:
        M = a.M.toarray()
        return result_of(
            _zivi.solve_avi(M, a.q, a.lower, a.upper, a.x0, settings, seconds, observe)
        )

    map_ = AffineMap(a.M, a.q)
    box = a.lower, a.upper
    return solve_sparse(map_, box, a.x0, settings, time_limit, observe, dense)


@dataclasses.dataclass(frozen=True)
class SparseVI:
    """A problem with a sparse Jacobian.

    Attributes
    ----------
    F : callable
        The map.
    jac : callable, matrix, or tuple of pattern and scheme
        Its Jacobian.
    converts : tuple of callables
        Make arrays of the values of `F` and of its Jacobian.
    box, start
        Bounds, and where to begin.
    settings, time_limit, observe
        As the extension takes them.
    """

    F: Callable[[Array], Any]
    jac: Any
    converts: Converters
    box: tuple[Array | float, Array | float]
    start: Array
    settings: dict[str, Any]
    time_limit: float | None
    observe: Observer

    def solve(self, x0: Array | None = None, tol: float | None = None) -> VIResult:
        """Solve it, perhaps from another start to another tolerance."""
        start = self.start if x0 is None else x0
        settings = self.settings if tol is None else self.settings | {"tol": tol}
        lower, upper = _checked(self.box, start, settings)
        jac = self.jac
        if not callable(jac) and not isinstance(jac, tuple):
            constant = sparse_matrix("jac", jac, len(start))
            require_finite_entries("jac", constant)
            jac = lambda x: constant  # noqa: E731
        map_ = CallableMap(self.F, jac, self.converts[0], lower, upper)

        def dense(seconds: float | None) -> VIResult:
            def slopes(x: Array) -> Array:
                J = map_.slopes(x)
                return np.full((len(x), len(x)), np.nan) if J is None else np.asarray(J.toarray())

            record = _zivi.solve_vi(
                self.F, lower, upper, start, slopes, self.converts, settings, seconds, self.observe
            )
            return result_of(record)

        small = dense if len(start) <= MAX_DENSE else None
        return solve_sparse(
            map_, (lower, upper), start, settings, self.time_limit, self.observe, small
        )
