"""Options, statuses and results of the solver of box VIs."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING, Any, Literal

from numpy.typing import ArrayLike

from zivi.base.check import Array, count, vector
from zivi.base.habits import attribute_error
from zivi.base.status import NamedStatus
from zivi.base.table import counted, page


class VIStatus(NamedStatus):
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
    """`F` or its Jacobian is not finite at all trial points."""
    INFEASIBLE = 8
    """A row of an affine problem has the wrong sign everywhere in the box: no solution exists."""
    STOPPED = 9
    """The callback raised `StopIteration`."""
    TIME_LIMIT = 10
    """The time limit was reached."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class VIOptions:
    """How `solve_vi` and `solve_avi` go about it. Every fall-back can be switched off.

    Parameters
    ----------
    row_scale : None, "jacobian" or array_like
        Positive factors of the rows of `F`: none; one over the largest entry of each row of the
        Jacobian at the start; or as given. They change the residual, not the solutions.
    max_pivots : int, optional
        Pivots of one affine subproblem; by default ``20 n + 50`` in the first iteration and
        ``4 n + 50`` after it.
    total_pivots : int, optional
        Pivots of all stages together; by default ``200 n + 10000`` and, while they are cheap,
        ``min(100 n**2, 3e8 / n**2)`` more. Each stage may use a share of them. Other work counts
        as the pivots it costs: a column of a starting basis as one, a factorisation as ``n/6``.
    stage_iterations : int
        Iterations of one stage.
    line_search : bool
        Search along Josephy-Newton directions; without it every full step is taken.
    memory : int
        Merit values the nonmonotone search looks back on, 1 (monotone) to 16.
    descent_steps : bool
        Semismooth and gradient steps where a Josephy-Newton step fails.
    active_set : bool
        Try the active-set Newton method for an affine problem before pivoting.
    ray_start_first : bool
        Try the ray start of the pivotal solver before the start at the iterate.
    josephy_newton, smoothing, semismooth, proximal : bool
        Stages S0, SM, S1 and S2. With `proximal` S0 also takes proximal steps where the active set
        of an affine problem cycles: singular monotone ones.
    restarts : int
        Number of restarts from random points with fixed seeds, 0 to 8.
    enumerate_up_to : int
        Largest `n`, at most 6, for which all patterns of active bounds are tried in the end.
    test_isolation : bool
        Distinguish `SOLVED_NOT_ISOLATED` from `SOLVED`, at the cost of one more Jacobian; a
        finite-difference one is reused from the last iterate.
    linear_algebra : {"auto", "dense", "sparse"}
        With sparse matrices, or as usual. By default a sparse Jacobian, or its pattern, is solved
        with as such where there are more than 300 unknowns or less than a tenth of the entries are
        stored. The sparse solver has stages of its own: S0 (`active_set`), IP, an interior-point
        method for affine problems, and SM (`smoothing`), S2 (`proximal`); then the dense solver
        runs with the remaining options, for at most ``zivi.vi.MAX_DENSE`` unknowns.

    See Also
    --------
    solve_vi : the argument ``options``.

    Notes
    -----
    The defaults try all stages in the order of their cost. To switch stages off shortens the time
    until a failure is reported; it does not make a success faster.
    """

    row_scale: Literal["jacobian"] | ArrayLike | None = None
    max_pivots: int | None = None
    total_pivots: int | None = None
    stage_iterations: int = 200
    line_search: bool = True
    memory: int = 8
    descent_steps: bool = True
    active_set: bool = True
    ray_start_first: bool = False
    josephy_newton: bool = True
    smoothing: bool = True
    semismooth: bool = True
    proximal: bool = True
    restarts: int = 8
    enumerate_up_to: int = 6
    test_isolation: bool = True
    linear_algebra: Literal["auto", "dense", "sparse"] = "auto"

    def _settings(self) -> dict[str, Any]:
        """Return what differs from the defaults, checked, by the names of the extension."""
        settings = {
            field.name: value
            for field in dataclasses.fields(self)
            if (value := getattr(self, field.name)) is not field.default
        }
        if self.linear_algebra not in _ALGEBRAS:
            raise ValueError(
                f"linear_algebra must be 'auto', 'dense' or 'sparse', got {self.linear_algebra!r}"
            )
        scale = settings.pop("row_scale", None)
        if isinstance(scale, str):
            if scale != "jacobian":
                raise ValueError(f"row_scale must be None, 'jacobian' or an array, got {scale!r}")
            settings["scale_by_jacobian"] = True
        elif scale is not None:
            settings["row_scale"] = vector("row_scale", scale)
        for name in _COUNTS & settings.keys():
            settings[name] = count(name, settings[name])
        return settings


_ALGEBRAS = ("auto", "dense", "sparse")

_COUNTS = {
    "max_pivots",
    "total_pivots",
    "stage_iterations",
    "memory",
    "restarts",
    "enumerate_up_to",
}


@dataclasses.dataclass(frozen=True, eq=False)
class VIResult:
    """The end of a solve. SciPy's names `fun` and `nit`, and ``res["x"]``, work as well.

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
        Reason of the end with advice, and whether `F` raised at points that were skipped.
    n_iter, nfev, njev, n_pivots : int
        Iterations, evaluations of `F` and of its Jacobian, pivots.
    n_semismooth_steps, n_gradient_steps, n_restarts : int
        Work of the fall-backs.
    stage : str
        Which part of the solver found `x`: ``S0``, ``IP``, ``SM``, ``S1``, ``S2``, ``R0`` to
        ``R7``, ``E``.
    scaled_residual : float
        The residual with the rows scaled: what is compared with `tolerance`.
    tolerance : float
        `tol`, or `rtol` times the residual at `x0` if that is larger, raised to ten roundings of a
        row, ``10 eps sum |J_ij x_j|``, where nothing better could be reached; ``eps`` is that of
        the type that `F` returns.
    convergence_ratio : float
        The last residual over the one before. Where it is not small while ``|x|`` is large, it
        tells the approach to a solution at infinity, which a small residual alone cannot.
    projected : bool
        `x0` was outside the box and was moved to its nearest point.
    n_factorisations : int
        Sparse factorisations; 0 with dense matrices.
    fill : int
        Entries of the largest sparse factors, L and U together: each takes 12 bytes and more.
    """

    if not TYPE_CHECKING:  # which would take any name for granted

        def __getattr__(self, name):
            raise attribute_error("VI result", self, name)

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
    n_factorisations: int = 0
    fill: int = 0

    @property
    def fun(self) -> Array:
        """`F` at `x`."""
        return self.F

    @property
    def nit(self) -> int:
        """Number of iterations."""
        return self.n_iter

    def _repr_html_(self) -> str:
        """Show how the solve ended, in a notebook."""
        work = f"{counted(self.n_iter, 'iteration')}, {counted(self.nfev, 'evaluation')} of F"
        return page(
            "zivi.VIResult",
            {
                "status": f"{self.status.name.lower()}: {self.message}",
                "residual": f"{self.residual:.3g}",
                "x": ", ".join(f"{it:.6g}" for it in self.x[:6])
                + (f", ... ({len(self.x)})" if len(self.x) > 6 else ""),
                "work": f"{work}, stage {self.stage}",
            },
        )

    def keys(self) -> list[str]:
        """Return the names of the entries."""
        return [*(field.name for field in dataclasses.fields(self)), "fun", "nit"]

    def __getitem__(self, name: str) -> Any:
        if name not in self.keys():
            raise KeyError(f"{name!r}: there are {', '.join(self.keys())}")
        return getattr(self, name)

    def __contains__(self, name: object) -> bool:
        return name in self.keys()


@dataclasses.dataclass(frozen=True)
class VIProgress:
    """Where a solve is after one of its iterations, as its callback sees it.

    Attributes
    ----------
    iteration : int
        Iterations so far.
    residual : float
        Natural residual, with the rows scaled.
    worst : int
        The component that is farthest from its condition.
    stage : str
        The stage of the solver (see `VIResult.stage`).
    """

    iteration: int
    residual: float
    worst: int
    stage: str


_STATUSES = {int(status): status for status in VIStatus}
_SUCCESSES = (VIStatus.SOLVED, VIStatus.SOLVED_NOT_ISOLATED)


def result_of(entries: dict[str, Any]) -> VIResult:
    """Make the public result from the record of the extension."""
    status = _STATUSES[entries["status"]]
    entries["status"], entries["success"] = status, status in _SUCCESSES
    result = object.__new__(VIResult)
    object.__setattr__(result, "__dict__", entries)  # not field by field in a frozen class
    return result
