"""Variational inequalities on a box, or mixed complementarity problems, by zivi's own solver.

Find ``x`` in ``[lower, upper]`` with, for every component,

* ``F_i(x) >= 0`` where ``x_i = lower_i``,
* ``F_i(x) <= 0`` where ``x_i = upper_i``,
* ``F_i(x) = 0`` where ``lower_i < x_i < upper_i``.
"""

import dataclasses
import enum
from collections.abc import Callable
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from zivi import _zivi
from zivi._arrays import MAX_DENSE, Array, bound, matrix, of_shape, require_finite, vector
from zivi._check import real

__all__ = [
    "MAX_DENSE",
    "VIOptions",
    "VIResult",
    "VIStatus",
    "natural_residual",
    "solve_avi",
    "solve_vi",
]


class VIStatus(enum.IntEnum):
    """How a solve ended. Only a residual recomputed from `F` makes it solved."""

    SOLVED = 0
    """The natural residual is within the tolerance."""
    SOLVED_NOT_ISOLATED = 1
    """Solved; the Jacobian on the components inside the box is singular there."""
    STATIONARY = 2
    """The merit function is stationary where the residual is not small."""
    STALLED = 3
    """The merit function has not fallen by a tenth over twenty iterations."""
    ITERATION_LIMIT = 4
    """The iteration limit was reached."""
    PIVOT_LIMIT = 5
    """Pivoting reached its limit in the affine subproblems."""
    DOMAIN_ERROR = 6
    """`F` or its Jacobian is not finite wherever it was tried."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class VIOptions:
    """How `solve_vi` and `solve_avi` go about it. Every fall-back can be switched off.

    Parameters
    ----------
    row_scale : None, "jacobian" or array_like
        Positive factors of the rows of `F`: none; one over the largest entry of each row of the
        Jacobian at the start; or as given. They change the residual, not the solutions.
    max_pivots : int, optional
        Pivots of one affine subproblem; ``20 n + 50`` by default.
    total_pivots : int, optional
        Pivots of all affine subproblems together; ``200 n + 10000`` by default.
    stage_iterations : int
        Iterations of one stage.
    line_search : bool
        Search along Josephy-Newton directions; without it every full step is taken.
    memory : int
        Merit values the nonmonotone search looks back on, 1 (monotone) to 16.
    descent_steps : bool
        Semismooth and gradient steps where a Josephy-Newton step fails.
    ray_start_first : bool
        Try the ray start of the pivotal solver before the start at the iterate.
    josephy_newton, semismooth, proximal : bool
        Stages S0, S1 and S2.
    restarts : int
        Number of restarts from random points with fixed seeds, 0 to 8.
    enumerate_up_to : int
        Largest `n`, at most 6, for which all patterns of active bounds are tried in the end.
    test_isolation : bool
        Tell `SOLVED_NOT_ISOLATED` from `SOLVED`, at the cost of one more Jacobian.
    """

    row_scale: Literal["jacobian"] | ArrayLike | None = None
    max_pivots: int | None = None
    total_pivots: int | None = None
    stage_iterations: int = 200
    line_search: bool = True
    memory: int = 8
    descent_steps: bool = True
    ray_start_first: bool = False
    josephy_newton: bool = True
    semismooth: bool = True
    proximal: bool = True
    restarts: int = 8
    enumerate_up_to: int = 6
    test_isolation: bool = True

    def _settings(self) -> dict[str, Any]:
        settings = {field.name: getattr(self, field.name) for field in dataclasses.fields(self)}
        scale = settings.pop("row_scale")
        if isinstance(scale, str):
            if scale != "jacobian":
                raise ValueError(f"row_scale must be None, 'jacobian' or an array, got {scale!r}")
            settings["scale_by_jacobian"] = True
        elif scale is not None:
            settings["row_scale"] = vector("row_scale", scale)
        for name in (
            "max_pivots",
            "total_pivots",
            "stage_iterations",
            "memory",
            "restarts",
            "enumerate_up_to",
        ):
            if settings[name] is not None:
                settings[name] = _count(name, settings[name])
        return settings


@dataclasses.dataclass(frozen=True, eq=False)
class VIResult:
    """The end of a solve.

    Attributes
    ----------
    x : ndarray
        The solution, or the point with the smallest residual that was found.
    F : ndarray
        `F` there.
    residual : float
        ``max |max(x - upper, min(x - lower, F))|``.
    status : VIStatus
        How it ended.
    success : bool
        True when `x` is a solution within the tolerance.
    message : str
        What happened and what to try.
    n_iter, nfev, njev, n_pivots : int
        Iterations, evaluations of `F` and of its Jacobian, pivots.
    n_semismooth_steps, n_gradient_steps, n_restarts : int
        Work of the fall-backs.
    stage : str
        Which part of the solver found `x`: ``S0``, ``S1``, ``S2``, ``R0`` to ``R7``, ``E``.
    scaled_residual : float
        The residual with the rows scaled: what is compared with `tolerance`.
    tolerance : float
        `tol`, raised to ten roundings of a row, ``10 eps sum |J_ij x_j|``, where nothing better
        could be reached.
    convergence_ratio : float
        The last residual over the one before. Where it is not small while ``|x|`` is large, it
        tells the approach to a solution at infinity, which a small residual alone cannot.
    projected : bool
        `x0` was outside the box and was moved to its nearest point.
    """

    x: Array
    F: Array
    residual: float
    status: VIStatus
    success: bool
    message: str
    n_iter: int
    nfev: int
    njev: int
    n_pivots: int
    n_semismooth_steps: int
    n_gradient_steps: int
    n_restarts: int
    stage: str
    scaled_residual: float
    tolerance: float
    convergence_ratio: float
    projected: bool


def solve_vi(
    F: Callable[[Array], ArrayLike],
    lower: ArrayLike,
    upper: ArrayLike,
    x0: ArrayLike,
    *,
    jac: Callable[[Array], Any] | Any | None = None,
    tol: float = 1e-9,
    max_iter: int | None = None,
    options: VIOptions | None = None,
) -> VIResult:
    """Solve a variational inequality on a box (a mixed complementarity problem).

    Parameters
    ----------
    F : callable
        ``F(x)`` returns an array as long as `x`. Values that are not finite mean that `F` is
        not defined there; the solver backs off. Exceptions reach the caller.
    lower, upper : array_like
        Bounds, infinite ones allowed; a number stands for all components.
    x0 : array_like
        Where to begin; its length is the number of unknowns.
    jac : callable or matrix, optional
        ``jac(x)`` returns the ``n x n`` matrix of ``dF_i/dx_j``, dense or sparse; a matrix
        stands for a constant one. By default it is taken by differences of `F` in the box.
    tol : float
        Largest natural residual of a solution.
    max_iter : int, optional
        Iterations of all stages together, 10000 by default.
    options : VIOptions, optional
        Row scaling, and which parts of the solver take part.

    Returns
    -------
    VIResult
        Always; look at ``success``.

    Raises
    ------
    ValueError, TypeError
        Before `F` is called, if an argument is not as above; the message names the index.

    Examples
    --------
    >>> res = zivi.solve_vi(lambda x: x**2 - 2, 0, np.inf, [1.0])
    >>> res.success, float(res.x[0].round(8))
    (True, 1.41421356)
    """
    start = vector("x0", x0)
    n = len(start)
    if not callable(F):
        raise TypeError(f"F must be callable, got {type(F).__name__}")
    record = _zivi.solve_vi(
        of_shape("F(x)", F, (n,)),
        bound("lower", lower, n),
        bound("upper", upper, n),
        start,
        _jacobian(jac, n),
        _settings(tol, max_iter, options),
    )
    return _result(record)


def solve_avi(
    M: Any,
    q: ArrayLike,
    lower: ArrayLike,
    upper: ArrayLike,
    x0: ArrayLike | None = None,
    *,
    tol: float = 1e-9,
    options: VIOptions | None = None,
) -> VIResult:
    """Solve the affine variational inequality with ``F(x) = M x + q`` on a box.

    Parameters
    ----------
    M : array_like or sparse matrix
        The matrix, ``n x n``. A sparse one is made dense, up to ``zivi.vi.MAX_DENSE`` unknowns.
    q : array_like
        The constant term.
    lower, upper : array_like
        Bounds, infinite ones allowed; a number stands for all components.
    x0 : array_like, optional
        Where to begin; by default the point of the box nearest to zero.
    tol : float
        Largest natural residual of a solution.
    options : VIOptions, optional
        Row scaling, and which parts of the solver take part.

    Returns
    -------
    VIResult
        Always; look at ``success``.

    Raises
    ------
    ValueError, TypeError
        If an argument is not as above.

    Examples
    --------
    >>> res = zivi.solve_avi([[2, 1], [1, 2]], [-5, -6], -1, 1)
    >>> res.x.tolist()
    [1.0, 1.0]
    """
    constant = vector("q", q)
    n = len(constant)
    dense = matrix("M", M, n)
    for name, array in (("M", dense), ("q", constant)):
        require_finite(name, array)
    start = np.zeros(n) if x0 is None else vector("x0", x0)
    if len(start) != n:
        raise ValueError(f"x0 must have {n} entries, as q has, got {len(start)}")
    record = _zivi.solve_avi(
        dense,
        constant,
        bound("lower", lower, n),
        bound("upper", upper, n),
        start,
        _settings(tol, None, options),
    )
    return _result(record)


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


def _result(record: _zivi.ViRecord) -> VIResult:
    status = VIStatus(record.status)
    names = {field.name for field in dataclasses.fields(VIResult)} - {"F", "status", "success"}
    return VIResult(
        F=record.f,
        status=status,
        success=status in (VIStatus.SOLVED, VIStatus.SOLVED_NOT_ISOLATED),
        **{name: getattr(record, name) for name in names},
    )


def _settings(tol: float, max_iter: int | None, options: VIOptions | None) -> dict[str, Any]:
    if options is not None and not isinstance(options, VIOptions):
        raise TypeError(f"options must be a VIOptions, got {type(options).__name__}")
    settings = (options or VIOptions())._settings()
    settings["tol"] = real("tol", tol)
    if max_iter is not None:
        settings["max_iterations"] = _count("max_iter", max_iter)
    return settings


def _count(name: str, value: object) -> int:
    if isinstance(value, bool) or not isinstance(value, int | np.integer):
        raise TypeError(f"{name} must be an integer, got {type(value).__name__} {value!r}")
    if value < 0:
        raise ValueError(f"{name} must be >= 0, got {value}")
    return int(value)


def _jacobian(jac: Any, n: int) -> Callable[[Array], Array] | None:
    if jac is None:
        return None
    if callable(jac):
        return of_shape("jac(x)", jac, (n, n))
    constant = matrix("jac", jac, n)
    require_finite("jac", constant)
    return lambda x: constant
