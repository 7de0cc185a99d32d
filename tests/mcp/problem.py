"""What a test problem is."""

import dataclasses
from collections.abc import Callable

import numpy as np

INF = np.inf


@dataclasses.dataclass(frozen=True)
class Problem:
    """A mixed complementarity problem with its starts, its truth and where it was published."""

    name: str
    F: Callable
    jac: Callable
    lower: np.ndarray
    upper: np.ndarray
    starts: tuple
    source: str
    solutions: tuple = ()
    """Isolated solutions; where they are all there are, `complete` is true."""
    accepts: Callable | None = None
    """Decides membership where the solutions form a continuum, or only a part is known."""
    solvable: bool = True
    near: float = 1e-5
    """How near to a listed solution a residual of 1e-9 brings."""

    @property
    def n(self):
        return len(self.lower)

    def residual(self, x):
        """The natural residual, written anew: it shares no code with the solver."""
        F = self.F(x)
        return float(np.max(np.abs(np.maximum(x - self.upper, np.minimum(x - self.lower, F)))))

    def is_true(self, x):
        """Whether `x` is one of the known solutions, or none is known."""
        if self.accepts is not None:
            return bool(self.accepts(x))
        if not self.solutions:
            return True
        return min(np.max(np.abs(x - s)) for s in self.solutions) <= self.near * (
            1 + np.max(np.abs(x))
        )


def _points(points):
    return tuple(np.asarray(point, float) for point in points)


def _bound(bound, n):
    return np.full(n, bound, float) if np.isscalar(bound) else np.asarray(bound, float)


def nonlinear(name, F, jac, lower, upper, starts, source, solutions=(), **truth):
    starts = _points(starts)
    n = len(starts[0])
    return Problem(
        name,
        F,
        jac,
        _bound(lower, n),
        _bound(upper, n),
        starts,
        source,
        _points(solutions),
        **truth,
    )


def affine(name, M, q, lower, upper, starts, source, solutions=(), **truth):
    M, q = np.asarray(M, float), np.asarray(q, float)
    return nonlinear(
        name,
        lambda x: M @ x + q,
        lambda x: M.copy(),
        lower,
        upper,
        starts,
        source,
        solutions,
        **truth,
    )
