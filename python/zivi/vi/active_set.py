"""Newton's method on the active set, the first stage of the sparse solver.

```text
w = x - F/c,  A = {w <= l} and {w >= u},  I = the rest
x_A at its bounds,  J_II d_I = -F_I - J_IA d_A
```

The semismooth Newton method for the projection equation (Hintermüller, Ito & Kunisch, *SIAM J.
Optim.* 13 (2002) 865-888): from a good start, as from a coarser grid, two to four factorisations.
From afar the boundary of the active set may move by one cell a step; then it is given up.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from zivi.base.arrays import Array
from zivi.vi.factorisation import rows_of_sizes
from zivi.vi.sparse_search import Search, natural_map

__all__ = ["SETTLED", "ActiveSetEnd", "active_set_newton", "places"]

SETTLED = 2e-3
"""Changes of the active set, of all components, from which on other methods try it."""
_PATIENCE = 2
"""Steps whose changes of the active set are not half of those before."""
_FAR = 1e15
_SHORTEST = 2e-3
_MEMORY = 5
_ARMIJO = 1e-4


class ActiveSetEnd(NamedTuple):
    """How the stage ended."""

    solved: bool
    """A point within the tolerance was found."""
    move: float
    """Root mean square of the first step: that of the solution, perhaps."""
    largest: float
    """Largest component of the smallest step, 0 without one."""


def places(search: Search, x: Array, F: Array, c: Array) -> Any:
    """Return -1 where ``x - F/c`` is at or below the lower bound, 1 at the upper, 0 inside."""
    w = x - F / c
    up = (w >= search.upper).astype(np.int8)
    return up - (w <= search.lower).astype(np.int8) * (1 - up)


def active_set_newton(
    search: Search, x: Array, F: Array, J: Any, *, patience: int = _PATIENCE
) -> ActiveSetEnd:
    """Take steps from `x`, which need not be in the box for affine `F`, while they are promising.

    Parameters
    ----------
    search : Search
        The problem.
    x, F, J : ndarray, ndarray, csr_array
        Where to begin, and the map and its Jacobian there.
    patience : int
        Steps whose changes of the active set may be more than half of those before.
    """
    c = rows_of_sizes(J)
    at = places(search, x, F, c)
    sizes = [float(np.linalg.norm(natural_map(x, F, search.lower, search.upper)))]
    fewest, slow, moves = search.n + 1, 0, (0.0, 0.0)
    while True:
        step = _step(search, x, F, J, at)
        if step is None:
            return ActiveSetEnd(False, *moves)
        largest = float(np.max(np.abs(step)))
        moves = moves[0] or float(np.sqrt(np.mean(step**2))), min(moves[1] or largest, largest)
        moved = _moved(search, x, step, sizes)
        if moved is None:
            return ActiveSetEnd(False, *moves)
        x, F = moved
        if search.end_iteration(x, F):
            return ActiveSetEnd(True, *moves)
        if not search.map.is_affine:
            J = search.slopes(x)
            if J is None:
                return ActiveSetEnd(False, *moves)
            c = rows_of_sizes(J)
        now = places(search, x, F, c)
        changes = int(np.count_nonzero(now != at))
        if changes == 0 and search.map.is_affine:
            return ActiveSetEnd(False, *moves)  # as exact as it gets
        slow = slow + 1 if 2 * changes > fewest else 0
        fewest, at = min(fewest, changes), now
        is_converging = not search.map.is_affine and sizes[-1] <= 0.1 * sizes[-2]
        if slow >= patience and not is_converging:
            return ActiveSetEnd(False, *moves)


def _step(search: Search, x: Array, F: Array, J: Any, at: Any) -> Array | None:
    """Return the step of the active set; None where its Jacobian is singular."""
    step = np.where(at < 0, search.lower, search.upper) - x
    free = np.flatnonzero(at == 0)
    step[free] = 0.0
    if len(free):
        rows = J[free]
        solved = search.factoriser.solve(rows[:, free], -F[free] - rows @ step, free=free)
        if solved is None:
            return None
        step[free] = solved[0]
    if not np.isfinite(step).all() or np.max(np.abs(x + step)) > _FAR:
        return None
    return step


def _moved(search: Search, x: Array, step: Array, sizes: list[float]) -> tuple[Array, Array] | None:
    """Return the next point with `F` there: a full step for affine `F`, else a search in the box.

    ``|natural map| <= (1 - 1e-4 t) max of the last five``.
    """
    if search.map.is_affine:
        F = search.value(x + step)
        return None if F is None else (x + step, F)
    t = 1.0
    while t >= _SHORTEST:
        trial = search.inside(x + t * step)
        F = search.value(trial)
        if F is not None:
            size = float(np.linalg.norm(natural_map(trial, F, search.lower, search.upper)))
            if size <= (1 - _ARMIJO * t) * max(sizes[-_MEMORY:]):
                sizes.append(size)
                return trial, F
        t *= 0.5
    return None
