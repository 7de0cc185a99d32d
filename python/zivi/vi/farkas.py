"""Sparse affine problems without a solution, told by a row or by a certificate of Farkas.

A solution needs ``F_i >= 0`` where ``u_i = inf`` and ``F_i <= 0`` where ``l_i = -inf``. The sum of
what is missing to that is minimised over the box by HiGHS; where it stays above zero its
multipliers prove that no point satisfies these rows. The proof is checked on the data:

```text
y_i >= 0 where F_i >= 0 is needed, y_i <= 0 where F_i <= 0 is, y_i = 0 where neither is:
y'F >= 0 at every solution, but   max y'F over the box < 0
```
"""

from __future__ import annotations

from typing import Any

import numpy as np

from zivi.base.arrays import Array
from zivi.vi.factorisation import in_thread
from zivi.vi.sparse_search import Search

__all__ = ["a_row_is_infeasible", "is_infeasible"]

_NEGLIGIBLE = 1e-11
"""Slopes of the proof below this, relative to their terms, are rounding."""
_FAR = 1e8
"""Where a column of the proof vanishes but for rounding, it holds for components up to this."""


def _most(search: Search, M: Any, q: Array) -> Array:
    """Return ``max F_i`` over the box, row by row."""
    up, down = M.maximum(0), M.minimum(0)
    for part in (up, down):
        part.eliminate_zeros()  # 0 inf
    value: Array = up @ search.upper + down @ search.lower + q
    return value


def a_row_is_infeasible(search: Search, M: Any, q: Array) -> bool:
    """Whether a row has the wrong sign everywhere in the box."""
    most, least = _most(search, M, q), -_most(search, -M, -q)
    sizes = abs(M) @ np.where(np.isfinite(search.lower), np.abs(search.lower), 0.0)
    sizes += abs(M) @ np.where(np.isfinite(search.upper), np.abs(search.upper), 0.0)
    slack = search.tol + _NEGLIGIBLE * (sizes + np.abs(q))
    never_positive = np.isposinf(search.upper) & (most < -slack)
    never_negative = np.isneginf(search.lower) & (least > slack)
    return bool(np.any(never_positive | never_negative))


def is_infeasible(search: Search, M: Any, q: Array) -> bool:
    """Whether it is proved that no point satisfies all rows, by more than the tolerance."""
    positive = np.flatnonzero(np.isposinf(search.upper))
    negative = np.flatnonzero(np.isneginf(search.lower))
    if not len(positive) + len(negative):
        return False
    y = np.zeros(search.n)
    found = _multipliers(search, M, q, positive, negative)
    if found is None:
        return False
    y[positive] += np.maximum(found[: len(positive)], 0.0)
    y[negative] -= np.maximum(found[len(positive) :], 0.0)
    y[np.abs(y) <= _NEGLIGIBLE * np.max(np.abs(y), initial=0.0)] = 0.0
    return bool(np.any(y)) and _proves(search, M, q, y)


def _multipliers(search: Search, M: Any, q: Array, positive: Any, negative: Any) -> Array | None:
    """Return multipliers of ``min sum s``, ``F_i + s_i >= 0`` (or ``-F_i``), over the box."""
    from scipy.optimize import linprog
    from scipy.sparse import eye_array, hstack, vstack

    rows = vstack([M[positive], -M[negative]], format="csr")
    constant = np.concatenate([q[positive], -q[negative]])
    sizes = np.maximum(abs(rows).max(axis=1).toarray().ravel(), np.abs(constant))
    sizes = np.where(sizes > 0, sizes, 1.0)
    rows.data /= np.repeat(sizes, np.diff(rows.indptr))
    k = len(constant)
    limit = search.time_left
    options: dict[str, float] = {} if limit is None else {"time_limit": limit}
    bounds = np.column_stack(
        [np.append(search.lower, np.zeros(k)), np.append(search.upper, np.full(k, np.inf))]
    )
    costs = np.append(np.zeros(search.n), np.ones(k))
    matrix = hstack([-rows, -eye_array(k)], format="csc")
    found = in_thread(
        lambda: linprog(
            costs, matrix, constant / sizes, bounds=bounds, method="highs", options=options
        ),
        search.poll,
    )
    if found.status != 0 or not found.fun > 0:
        return None
    multipliers: Array = -np.asarray(found.ineqlin.marginals, float) / sizes
    return multipliers


def _proves(search: Search, M: Any, q: Array, y: Array) -> bool:
    """Whether ``max y'F`` over the box is below zero, by more than tolerance and rounding."""
    by_columns = M.T.tocsr()
    slopes, terms = by_columns @ y, abs(by_columns) @ np.abs(y)
    bound = np.where(slopes > 0, search.upper, search.lower)
    is_finite = np.isfinite(bound)
    vanishes = np.abs(slopes) <= _NEGLIGIBLE * terms
    if np.any(~is_finite & ~vanishes & (slopes != 0)):
        return False
    reach = np.where(is_finite, bound, 0.0)
    most = float(y @ q + slopes @ reach)
    slack = search.tol * float(np.sum(np.abs(y)))
    slack += _FAR * float(np.sum(np.abs(slopes[~is_finite])))
    size = float(np.abs(y) @ np.abs(q) + terms @ np.abs(reach))
    return bool(most + slack + search.n * np.finfo(float).eps * size < 0)
