"""Variational inequalities on a box, or mixed complementarity problems, by zivi's own solver."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Mapping
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

import zivi._zivi as _zivi
from zivi.base.check import MAX_DENSE, Array, bound, count, matrix, real, require_finite, vector
from zivi.base.habits import hinted
from zivi.vi.jacobian import (
    ColouredDifferences,
    Converters,
    IsSparseError,
    ValueWithJacobian,
    complex_steps,
    converters,
    jacobian,
    pattern_of,
    wants_sparse,
)
from zivi.vi.sparse import (
    AffineMap,
    CallableMap,
    require_finite_entries,
    solve_sparse,
    sparse_matrix,
)
from zivi.vi.types import VIOptions, VIProgress, VIResult, result_of

# Bounds, options and starts of the solver of box VIs as users of SciPy write them.


def arranged(lower: Any, upper: Any, x0: Any, bounds: Any) -> tuple[Any, Any, Any]:
    """Return lower bounds, upper bounds and start, wherever they were given.

    ``(F, x0, bounds=...)`` and ``(F, Bounds(...), x0)`` are as good as ``(F, lower, upper, x0)``.
    """
    if bounds is None and _is_bounds(lower):
        bounds, lower = lower, None
        if x0 is None:
            upper, x0 = None, upper
    elif bounds is not None and x0 is None and upper is None:
        lower, x0 = None, lower
    if bounds is not None:
        if lower is not None or upper is not None:
            raise TypeError("bounds must be given once: by lower and upper, or by bounds")
        lower, upper = _split_bounds(bounds)
    if x0 is None:
        raise TypeError("x0 must be given, the starting point")
    return lower, upper, x0


def _is_bounds(value: Any) -> bool:
    """Whether it is a `scipy.optimize.Bounds`, or looks like one."""
    return hasattr(value, "lb") and hasattr(value, "ub")


def _split_bounds(bounds: Any) -> tuple[Any, Any]:
    if _is_bounds(bounds):
        return bounds.lb, bounds.ub
    told = "bounds must be a scipy.optimize.Bounds or a sequence of pairs (lower, upper)"
    try:
        pairs = [tuple(pair) for pair in bounds]
    except TypeError:
        raise TypeError(f"{told}, got {bounds!r}") from None
    for i, pair in enumerate(pairs):
        if len(pair) != 2:
            raise ValueError(f"{told}, got {pair!r} as number {i}")
    return [pair[0] for pair in pairs], [pair[1] for pair in pairs]


def read_bounds(lower: Any, upper: Any, n: int) -> tuple[Array | float, Array | float]:
    """Read both bounds; a bound with one entry applies to all components (SciPy's rule)."""
    return _read_bound("lower", lower, n), _read_bound("upper", upper, n)


def _read_bound(name: str, value: Any, n: int) -> Array | float:
    if type(value) is float:
        return value
    if isinstance(value, np.ndarray) and value.shape == (1,) and n > 1:
        value = value[0]  # scipy.optimize.Bounds makes arrays of numbers
    return bound(name, value, n)


def settings_of(
    tol: float | None,
    rtol: float,
    max_iter: int | None,
    options: VIOptions | Mapping[str, Any] | None,
) -> dict[str, Any]:
    """Return what differs from the defaults, by the names of the extension."""
    if isinstance(options, Mapping):
        options, max_iter = _of_mapping(options, max_iter)
    if options is None:
        settings = {}
    elif isinstance(options, VIOptions):
        settings = options._settings()
    else:
        raise TypeError(f"options must be a VIOptions or a dict, got {type(options).__name__}")
    if tol is not None:
        settings["tol"] = real("tol", tol)
    if rtol:
        settings["rtol"] = real("rtol", rtol)
    if max_iter is not None:
        settings["max_iterations"] = count("max_iter", max_iter, least=1)
    return settings


def _of_mapping(options: Mapping[str, Any], max_iter: int | None) -> tuple[VIOptions, int | None]:
    """Read the fields of `VIOptions`, and SciPy's ``maxiter``."""
    given = dict(options)
    for name in ("maxiter", "max_iter"):
        max_iter = given.pop(name, max_iter)
    known = [field.name for field in dataclasses.fields(VIOptions)]
    for name in given:
        if name not in known:
            raise TypeError(
                f"options has unknown entry {name!r}; the options are maxiter and the fields of "
                f"VIOptions, {', '.join(known)}"
            )
    return VIOptions(**given), max_iter


def seconds(limit: float | None) -> float | None:
    """Read a time limit."""
    if limit is None:
        return None
    found = real("time_limit", limit)
    if not found > 0:
        raise ValueError(f"time_limit must be > 0 seconds, got {found}")
    return found


def observer(
    callback: Callable[[VIProgress], object] | None,
) -> Callable[[int, float, int, str], object] | None:
    """Return what hands a `VIProgress` to the callback."""
    if callback is None:
        return None
    if not callable(callback):
        raise TypeError(f"callback must be callable, got {type(callback).__name__}")
    return lambda *progress: callback(VIProgress(*progress))


# Units: an absolute tolerance of 1e-9 means nothing where all numbers are of 1e-10.

TOL = 1e-9
"""Default tolerance, and that of a small problem relative to its values at the start."""
_FEW = 64
"""Up to so many numbers a loop of Python takes less than NumPy."""
_SMALL = 1e-3
"""Rows and unknowns of this size and above are compared with the tolerance as they are."""
_ROUNDS = 10
"""Of the equilibration of rows and columns."""
_NOISE, _NEAR = 1e-13, 1e-6
"""Such a residual, or one so far below the start's, that cannot be made better is a solution."""

Solve: TypeAlias = Callable[["Affine"], VIResult]


@dataclasses.dataclass(frozen=True)
class Affine:
    """``F(x) = M x + q`` on a box, and the initial point; `M` may be a ``csr_array``."""

    M: Any
    q: Array
    lower: Array
    upper: Array
    x0: Array


class _Entries:
    """The absolute values of a matrix, dense or sparse."""

    def __init__(self, M: Any) -> None:
        self._dense: Array | None = None
        if isinstance(M, np.ndarray):
            self._dense = np.abs(M)
        else:
            coordinates = M.tocoo()
            self._row, self._column = coordinates.coords
            self._values = np.abs(coordinates.data)

    def moves(self, value: Array) -> Array:
        """Return ``max_i value_i / |M_ij|``, zero where a column is empty."""
        if self._dense is not None:
            moved = np.where(self._dense > 0, value[:, None] / self._dense, 0.0)
            return np.asarray(moved.max(axis=0))
        moved = np.where(self._values > 0, value[self._row] / self._values, 0.0)
        return _segment_max(moved, self._column, len(value))

    def largest(self, rows: Array, columns: Array) -> tuple[Array, Array]:
        """Return the largest of each row and of each column of ``rows_i |M_ij| columns_j``."""
        if self._dense is not None:
            scaled = rows[:, None] * self._dense * columns
            return scaled.max(axis=1), scaled.max(axis=0)
        scaled = rows[self._row] * self._values * columns[self._column]
        n = len(rows)
        return _segment_max(scaled, self._row, n), _segment_max(scaled, self._column, n)


def _segment_max(values: Array, places: Any, n: int) -> Array:
    found = np.zeros(n)
    np.maximum.at(found, places, values)
    return found


def _scale_matrix(rows: Array, M: Any, columns: Array) -> Any:
    """Return ``rows_i M_ij columns_j``."""
    if isinstance(M, np.ndarray):
        return rows[:, None] * M * columns
    scaled = M.copy()
    scaled.data *= np.repeat(rows, np.diff(M.indptr)) * columns[M.indices]
    return scaled


def _sizes(a: Affine) -> tuple[Array, Array]:
    """Return the scales of rows and unknowns, from the initial point.

    For the unknowns, the step that balances a row, ``max_i |F_i / M_ij|``, at most the width of the
    box; for the rows, their value and its change by these steps.
    """
    entries = _Entries(a.M)
    value = np.abs(a.M @ a.x0 + a.q)
    with np.errstate(divide="ignore", over="ignore", invalid="ignore"):
        moves = entries.moves(value)
        width = a.upper - a.lower
        moves = np.minimum(np.where(moves > 0, moves, 1.0), np.where(width > 0, width, 1.0))
        columns = np.maximum(moves, np.abs(a.x0))
        rows = np.maximum(value, entries.largest(np.ones(len(value)), np.minimum(columns, 1.0))[0])
    return np.where(rows > 0, rows, 1.0), columns


def is_off_scale(a: Affine) -> bool:
    """Whether some rows or unknowns are so small that an absolute tolerance means nothing."""
    rows, columns = _sizes(a)
    return bool(rows.min() < _SMALL or columns.min() < _SMALL)


def _units(a: Affine) -> tuple[Array, Array]:
    """Return factors of rows and units of unknowns that bring all entries to 1 or below."""
    rows, columns = np.ones(len(a.q)), np.ones(len(a.q))
    entries = _Entries(a.M)
    for _ in range(_ROUNDS):
        across, along = entries.largest(rows, columns)
        rows /= np.sqrt(np.where(across > 0, across, 1.0))
        columns /= np.sqrt(np.where(along > 0, along, 1.0))
    # with a constant term of order 1 the solution is of order 1
    size = max(np.abs(rows * (a.M @ a.x0 + a.q)).max(), np.abs(a.x0 / columns).max()) or 1.0
    return rows / size, columns * size


def solve_scaled(a: Affine, solve: Solve) -> VIResult:
    """Solve in the problem's own units, then to the absolute tolerance."""
    rows, columns = _units(a)
    scaled = Affine(
        _scale_matrix(rows, a.M, columns),
        rows * a.q,
        a.lower / columns,
        a.upper / columns,
        a.x0 / columns,
    )
    found = solve(scaled)
    x = np.clip(found.x * columns, a.lower, a.upper)
    if not found.success:
        F = a.M @ x + a.q
        residual = _zivi.natural_residual(x, F, a.lower, a.upper)
        return dataclasses.replace(found, x=x, F=F, residual=residual)
    last = solve(dataclasses.replace(a, x0=x))
    counts = _total_work(found, last)
    return dataclasses.replace(
        last, stage=found.stage if last.n_iter == 0 else last.stage, projected=False, **counts
    )


_COUNTS = (
    "n_iter",
    "nfev",
    "njev",
    "n_pivots",
    "n_semismooth_steps",
    "n_gradient_steps",
    "n_restarts",
    "n_factorisations",
)


def _total_work(first: VIResult, last: VIResult) -> dict[str, Any]:
    """Return the work of both."""
    counts = {name: getattr(first, name) + getattr(last, name) for name in _COUNTS}
    return counts | {"fill": max(first.fill, last.fill)}


class Watched:
    """A map that remembers how large its first value was."""

    def __init__(self, F: Callable[[Array], Any]) -> None:
        self._F = F
        self._first: Array | None = None
        self.calls = 0

    def __call__(self, x: Array) -> Any:
        """Return the values."""
        self.calls += 1
        value = self._F(x)
        if self._first is None:
            self._first = np.array(value)  # the caller may write over it
        return value

    @property
    def size(self) -> float:
        """The largest of the first values; infinite if they are not finite."""
        if self._first is None:
            return np.inf
        if self._first.size > _FEW:
            size = float(np.abs(self._first).max())
            return size if math.isfinite(size) else np.inf
        sizes = [abs(value) for value in self._first.ravel().tolist()]
        return float(max(sizes, default=0.0)) if all(map(math.isfinite, sizes)) else np.inf


def polished(first: VIResult, size: float, solve: Callable[[Array, float], VIResult]) -> VIResult:
    """Continue from a solution if `F` was initially small, possibly by its units only.

    Parameters
    ----------
    first : VIResult
        The end of the solve.
    size : float
        The largest value of `F` at the start.
    solve : callable
        The same from another start, to another tolerance.

    Returns
    -------
    VIResult
        `first`, or a better one.
    """
    if not first.success or not size or size >= _SMALL or first.residual <= TOL * size:
        return first
    last = solve(first.x, TOL * size)
    counts = _total_work(first, last)
    if not last.success and first.residual <= max(_NOISE, _NEAR * size):
        return dataclasses.replace(first, **counts)
    return dataclasses.replace(last, projected=first.projected, **counts)


# Dispatch of `solve_vi` and `solve_avi` to the sparse solver, with checks.

Observer: TypeAlias = Callable[[int, float, int, str], object] | None


def pattern_for(jac_sparsity: Any, jac: Any, n: int) -> tuple[Any, str]:
    """Return the pattern and the scheme of coloured differences."""
    scheme = "3-point" if jac is None or jac is False else jac
    if not isinstance(scheme, str):
        raise ValueError(
            "jac_sparsity needs finite differences; omit jac, or use '2-point', '3-point' or 'cs'"
        )
    if scheme not in ("2-point", "3-point", "cs"):
        raise ValueError(f"jac must be '2-point', '3-point' or 'cs', got {scheme!r}")
    return pattern_of(jac_sparsity, n), scheme


def _validated_bounds(
    box: tuple[Array | float, Array | float], start: Array, settings: dict[str, Any]
) -> tuple[Array, Array]:
    """Return both bounds as arrays; the extension rejects bounds and settings that are wrong."""
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
    lower, upper = _validated_bounds(box, begin, settings)
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
        Convert values of `F` and of its Jacobian to arrays.
    box, start
        Bounds and initial point.
    settings, time_limit, observe
        Arguments of the extension.
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
        lower, upper = _validated_bounds(self.box, start, settings)
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


# Variational inequalities on a box, or mixed complementarity problems, by zivi's own solver.
#
# Find ``x`` in ``[lower, upper]`` with, for every component,
#
# * ``F_i(x) >= 0`` where ``x_i = lower_i``,
# * ``F_i(x) <= 0`` where ``x_i = upper_i``,
# * ``F_i(x) = 0`` where ``lower_i < x_i < upper_i``.


@hinted("solve_vi")
def solve_vi(
    F: Callable[..., Any],
    lower: Any = None,
    upper: Any = None,
    x0: ArrayLike | None = None,
    *,
    bounds: Any = None,
    args: tuple[Any, ...] = (),
    jac: Callable[..., Any] | Any | None = None,
    jac_sparsity: Any = None,
    tol: float | None = None,
    rtol: float = 0.0,
    max_iter: int | None = None,
    time_limit: float | None = None,
    callback: Callable[[VIProgress], object] | None = None,
    options: VIOptions | Mapping[str, Any] | None = None,
) -> VIResult:
    """Solve a variational inequality on a box (a mixed complementarity problem).

    Parameters
    ----------
    F : callable
        ``F(x, *args)`` returns an array of the length of `x` (or a number if `x` has one entry).
        Values that are not finite mean that `F` is not defined there; the solver backs off. So do
        an `ArithmeticError` or a `ValueError` after the first call; other exceptions, and these
        at `x0`, reach the caller.
    lower, upper : array_like or None
        Bounds, infinite ones allowed; a number stands for all components, None for no bound.
    x0 : array_like
        Where to begin; its length is the number of unknowns. A number is one unknown.
    bounds : scipy.optimize.Bounds or sequence of (lower, upper), optional
        Instead of `lower` and `upper`: ``solve_vi(F, x0, bounds=bounds)``.
    args : tuple
        Further arguments of `F` and `jac`.
    jac : callable, matrix, True or {"2-point", "3-point", "cs"}, optional
        ``jac(x, *args)`` returns the ``n x n`` matrix of ``dF_i/dx_j``, dense or sparse; a matrix
        is a constant Jacobian; with True, `F` returns ``(F(x), jac(x))``. By default, and as
        ``"3-point"``, it is taken by differences of second order of `F` in the box (``2 n`` calls);
        ``"2-point"`` are differences of first order (``n`` calls), ``"cs"`` complex steps (``n``
        calls of an analytic `F`). Entries that are not finite are replaced by differences. A sparse
        one is kept sparse where that pays: see ``VIOptions.linear_algebra``.
    jac_sparsity : array_like or sparse matrix, optional
        Where the Jacobian may be nonzero, ``n x n``: then the differences, or complex steps, take
        one or two calls for each group of columns that share no row. Not with a `jac` that is
        given.
    tol : float, optional
        Largest natural residual of a solution. By default 1e-9, and less where rows or unknowns
        are so small at the start that this would mean nothing.
    rtol : float
        The same relative to the residual at `x0`; the larger of the two holds.
    max_iter : int, optional
        Iterations of all stages together, 10000 by default.
    time_limit : float, optional
        Seconds after which the best point so far is returned; checked between evaluations and
        during long factorisations. A Jacobian by differences counts as one evaluation.
    callback : callable, optional
        Called with a `VIProgress` after every iteration; it may raise `StopIteration` to end the
        solve.
    options : VIOptions or dict, optional
        Row scaling and enabled stages of the solver; a dict has the names of `VIOptions`.

    Returns
    -------
    VIResult
        Returned in all cases; check ``success``.

    Raises
    ------
    ValueError, TypeError
        Before `F` is called, if an argument is not as above; the message names the index.

    See Also
    --------
    solve_avi : affine problems.
    solve_lcp : linear complementarity problems.
    solve_ncp : nonlinear complementarity problems.
    check_jacobian : test a Jacobian.
    scipy.optimize.root : equations without bounds.

    Notes
    -----
    The natural residual of the returned point decides about success. Dense problems are solved by
    pivotal (Lemke-type), semismooth Newton and smoothing stages, with cost of order ``n**3`` per
    iteration; large sparse problems by an active-set Newton and an interior-point method.

    References
    ----------
    F. Facchinei and J.-S. Pang, Finite-Dimensional Variational Inequalities and Complementarity
    Problems, Springer, 2003.

    Examples
    --------
    >>> res = zivi.solve_vi(lambda x: x**2 - 2, 0, np.inf, [1.0])
    >>> res.success, float(res.x[0].round(8))
    (True, 1.41421356)
    """
    lower, upper, x0 = arranged(lower, upper, x0, bounds)
    start = vector("x0", x0, scalar=True).reshape(-1)
    n = len(start)
    if not n:
        raise ValueError("x0 must have at least one entry, got none")
    if not callable(F):
        raise TypeError(f"F must be callable, got {type(F).__name__}")
    if args and not isinstance(args, tuple):
        raise TypeError(f"args must be a tuple, got {type(args).__name__}")
    map_: Any = (lambda x: F(x, *args)) if args else F
    box = read_bounds(lower, upper, n)
    settings = settings_of(tol, rtol, max_iter, options)
    algebra = settings.pop("linear_algebra", "auto")
    limit, observe = seconds(time_limit), observer(callback)
    is_adaptive = _is_adaptive(settings)
    calls = [0]
    both = ValueWithJacobian(map_) if jac is True else None
    if both is not None:
        map_ = both
    if is_adaptive or both is not None or callable(jac):
        map_ = seen = Watched(map_)
    converts = converters(n, algebra)

    def by_sparse(slopes: Any) -> VIResult:
        problem = SparseVI(map_, slopes, converts, box, start, settings, limit, observe)
        result = problem.solve()
        return polished(result, seen.size, problem.solve) if is_adaptive else result

    kept = _kept_sparse(jac, jac_sparsity, both, args, start, algebra)
    if kept is not None:
        return by_sparse(kept)
    if both is not None:
        slopes: Any = both.jac
    elif jac_sparsity is not None:
        slopes = _by_colours(map_, pattern_for(jac_sparsity, jac, n), box, start, calls)
    elif isinstance(jac, str) and jac == "cs":
        slopes = complex_steps(map_, n, calls)
    else:
        slopes = jacobian(jac, start, args)

    def by_dense(x: Array, tol: float | None = None) -> VIResult:
        chosen = settings if tol is None else settings | {"tol": tol}
        return result_of(_zivi.solve_vi(map_, *box, x, slopes, converts, chosen, limit, observe))

    try:
        result = by_dense(start)
    except IsSparseError:
        before = seen.calls
        result = by_sparse(slopes)
        result.__dict__["nfev"] += before
        result.__dict__["njev"] += 1
        return result
    if is_adaptive:
        result = polished(result, seen.size, by_dense)
    result.__dict__["nfev"] += calls[0] + (both.more_calls if both is not None else 0)
    return result


def _kept_sparse(
    jac: Any,
    jac_sparsity: Any,
    both: ValueWithJacobian | None,
    args: tuple[Any, ...],
    x0: Array,
    algebra: str,
) -> Any:
    """Return the Jacobian for the sparse solver if it is known to be sparse; None where not.

    The dense solver checks the values of a callable itself. For more unknowns than it supports,
    they are checked here, before `F` is called.
    """
    n = len(x0)
    if jac_sparsity is not None:
        pattern = pattern_for(jac_sparsity, jac, n)
        return pattern if wants_sparse(pattern[0], n, algebra) else None
    if jac is None or jac is False or isinstance(jac, str):
        return pattern_for(np.ones((n, n)), jac, n) if algebra == "sparse" else None
    if both is None and not callable(jac):
        return jac if wants_sparse(jac, n, algebra) else None
    function = both.jac if both is not None else jacobian(jac, x0, args)
    if algebra == "sparse":
        return function
    if n <= MAX_DENSE or isinstance(function, str):
        return None
    value = function(x0.copy())
    if algebra == "dense":
        matrix("jac(x)", value, n)  # a sparse one is refused before F is called
    return function if wants_sparse(value, n, algebra) else None


def _by_colours(
    map_: Callable[[Any], Any],
    pattern: tuple[Any, str],
    box: tuple[Array | float, Array | float],
    x0: Array,
    calls: list[int],
) -> Callable[[Array], Array]:
    """Return coloured differences as a dense Jacobian; their calls of `F` are counted."""
    n = len(x0)
    values = converters(n)[0]
    rounding = [float(np.finfo(float).eps)]

    def value(x: Any) -> Any:
        calls[0] += 1
        given = map_(x)
        if np.iscomplexobj(given):
            return np.asarray(given)
        array, rounding[0] = values(given)
        return array

    lower, upper = (np.broadcast_to(it, n).astype(float) for it in box)
    differences = ColouredDifferences(value, *pattern, lower, upper)

    def slopes(x: Array) -> Array:
        return np.asarray(differences(x, rounding[0]).toarray())

    return slopes


@hinted("solve_vi")
def solve_avi(
    M: Any,
    q: ArrayLike,
    lower: Any = None,
    upper: Any = None,
    x0: ArrayLike | None = None,
    *,
    bounds: Any = None,
    tol: float | None = None,
    rtol: float = 0.0,
    max_iter: int | None = None,
    time_limit: float | None = None,
    callback: Callable[[VIProgress], object] | None = None,
    options: VIOptions | Mapping[str, Any] | None = None,
) -> VIResult:
    """Solve the affine variational inequality with ``F(x) = M x + q`` on a box.

    Parameters
    ----------
    M : array_like or sparse matrix
        The matrix, ``n x n``. A sparse one is kept sparse where that pays: see
        ``VIOptions.linear_algebra``.
    q : array_like
        The constant term.
    lower, upper : array_like or None
        Bounds, infinite ones allowed; a number stands for all components, None for no bound.
    x0 : array_like, optional
        Where to begin; by default the point of the box nearest to zero.
    bounds : scipy.optimize.Bounds or sequence of (lower, upper), optional
        Instead of `lower` and `upper`.
    tol, rtol, max_iter, time_limit, callback, options
        As for `solve_vi`.

    Returns
    -------
    VIResult
        Returned in all cases; check ``success``. If a row has the wrong sign everywhere in the box,
        the status is `VIStatus.INFEASIBLE` without iterations.

    Raises
    ------
    ValueError, TypeError
        If an argument is not as above.

    See Also
    --------
    solve_vi : nonlinear problems.
    solve_lcp : problems with the bounds 0 and infinity.

    Notes
    -----
    Stages as in `solve_vi`; affine problems need no linearisation, so a pivotal path or an active
    set ends in a solution up to rounding.

    References
    ----------
    M. Cao and M. C. Ferris, A pivotal method for affine variational inequalities, Math. Oper. Res.
    21, 1996.

    F. Facchinei and J.-S. Pang, Finite-Dimensional Variational Inequalities and Complementarity
    Problems, Springer, 2003.

    Examples
    --------
    >>> res = zivi.solve_avi([[2, 1], [1, 2]], [-5, -6], -1, 1)
    >>> res.x.tolist()
    [1.0, 1.0]
    """
    if bounds is not None or upper is None:
        lower, upper, _ = arranged(lower, upper, 0.0, bounds)
    chosen = settings_of(tol, rtol, max_iter, options)
    limit, observe = seconds(time_limit), observer(callback)
    return solve_affine((M, q), (lower, upper), x0, chosen, limit, observe)


def solve_affine(
    numbers: tuple[Any, ArrayLike],
    bounds: tuple[Any, Any],
    x0: ArrayLike | None,
    settings: dict[str, Any],
    limit: float | None,
    observe: Observer,
) -> VIResult:
    """Solve the affine problem of a matrix and a constant term, as `solve_avi`."""
    M, constant = numbers[0], vector("q", numbers[1])
    n = len(constant)
    if not n:
        raise ValueError("q must have at least one entry, got none")
    keeps = wants_sparse(M, n, settings.pop("linear_algebra", "auto"))
    given: Any = M if keeps else matrix("M", M, n)
    start = None if x0 is None else vector("x0", x0)
    if start is not None and len(start) != n:
        raise ValueError(f"x0 must have {n} entries, as q has, got {len(start)}")
    box = read_bounds(*bounds, n)
    is_adaptive = _is_adaptive(settings)
    if not keeps and not (is_adaptive and _zivi.is_off_scale(given, constant, *box, start, _SMALL)):
        return result_of(_zivi.solve_avi(given, constant, *box, start, settings, limit, observe))

    def solve(a: Affine) -> VIResult:
        if keeps:
            return affine_by_sparse(a, settings, limit, observe)
        return result_of(
            _zivi.solve_avi(a.M, a.q, a.lower, a.upper, a.x0, settings, limit, observe)
        )

    if keeps:
        problem = checked_affine(given, constant, box, start, settings)
        begin = np.clip(problem.x0, problem.lower, problem.upper)
        if is_adaptive and is_off_scale(inside := dataclasses.replace(problem, x0=begin)):
            return solve_scaled(inside, solve)
        return solve(problem)
    low, high = (np.broadcast_to(it, n).astype(float) for it in box)
    begin = np.clip(np.zeros(n) if start is None else start, low, high)
    return solve_scaled(Affine(given, constant, low, high, begin), solve)


def _is_adaptive(settings: Mapping[str, Any]) -> bool:
    """Whether the problem's own numbers say what is small."""
    return not ("tol" in settings or "rtol" in settings or "row_scale" in settings)


def natural_residual(x: ArrayLike, F: ArrayLike, lower: ArrayLike, upper: ArrayLike) -> float:
    """Return ``max |max(x - upper, min(x - lower, F))|``, zero exactly at a solution.

    Parameters
    ----------
    x : array_like
        The point.
    F : array_like
        The value of the map there.
    lower, upper : array_like
        Bounds, infinite ones allowed; a number stands for all components.

    Returns
    -------
    float
        The residual; NaN if some `F` is NaN.

    Raises
    ------
    ValueError, TypeError
        If lengths differ or a bound is impossible.

    See Also
    --------
    solve_vi : the solver whose error this measures.

    Notes
    -----
    The residual is zero exactly at solutions; for affine problems it bounds the distance to the
    solution set locally.

    References
    ----------
    F. Facchinei and J.-S. Pang, Finite-Dimensional Variational Inequalities and Complementarity
    Problems, Springer, 2003.

    Examples
    --------
    >>> zivi.natural_residual([1.0, 0.5], [-3.0, 0.25], 0, 1)
    0.25
    """
    point, value = vector("x", x), vector("F", F)
    if len(value) != len(point):
        raise ValueError(f"F must have {len(point)} entries, as x has, got {len(value)}")
    n = len(point)
    return _zivi.natural_residual(point, value, bound("lower", lower, n), bound("upper", upper, n))
