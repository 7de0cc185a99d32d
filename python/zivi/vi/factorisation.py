"""Sparse LU factors by SuperLU, with an eye on the clock and on Ctrl-C while they are made."""

from __future__ import annotations

import atexit
import os
import sys
import threading
import weakref
from collections.abc import Callable
from functools import partial
from typing import Any, TypeVar

import numpy as np

import zivi._zivi as _zivi
from zivi.base.check import Array

_SHORT = 4_000
"""Entries of a matrix below which its factorisation is too short to be interrupted."""
_LOOK = 0.05
"""Seconds between two readings of the clock."""
_EXACT, _USELESS = 1e-14, 1e-6
"""Componentwise backward errors that need no refinement, and above which there is no solution."""
_DECAYED = 1e-8
"""Components of this size, relative to the largest, need not be as exact."""

_FULLER = 10
"""Entries of the product A'A that may be, over those of A, from which on it gives no order."""

_PANEL = 4
"""Columns that SuperLU takes together where few of them have the same pattern; 20 by default."""
_PIVOTING: dict[str, dict[str, Any]] = {
    "none": {
        "diag_pivot_thresh": 0.0,
        "panel_size": _PANEL,
        "options": {"SymmetricMode": True},
    },
    "some": {"diag_pivot_thresh": 1e-3, "panel_size": _PANEL},
    "partial": {},
}
"""What SuperLU is told: to keep the diagonal, to leave it where it is small, to pivot by size."""

_THREAD = "zivi-factorisation"
_QUIET = 1.0
"""Seconds for which the end of the interpreter waits without a word."""
_WAITING = "zivi: a sparse factorisation is still under way; Ctrl-C again ends the process at once"
_INTERRUPTED = 130
"""Exit status of shells after Ctrl-C."""

Outcome = TypeVar("Outcome")


class ReleaseEvent(threading.Event):
    """Set when what a thread made is needed no more; the thread is the last that lets go of it.

    SuperLU frees memory only in the thread that took it.
    """

    thread: threading.Thread | None = None

    def settle(self) -> None:
        """Wait briefly for the thread to release its objects."""
        if self.is_set() and self.thread is not None:
            self.thread.join(_LOOK)


def in_thread(
    work: Callable[[], Outcome],
    poll: Callable[[], None],
    until: ReleaseEvent | None = None,
) -> Outcome:
    """Return what `work` returns, which does not hold the interpreter's lock while it computes.

    A signal, or an exception of `poll`, ends the waiting promptly; the thread, which cannot be
    stopped, ends its work in the background; the interpreter ends after it. With `until` the
    thread lives on until that is set.
    """
    found: list[Outcome] = []
    raised: list[BaseException] = []
    ended = threading.Event()

    def run() -> None:
        try:
            found.append(work())
        except BaseException as error:  # raised again where it is waited for
            raised.append(error)
        finally:
            ended.set()
        if until is not None and found:
            until.wait()
            found.clear()

    thread = threading.Thread(target=run, daemon=True, name=_THREAD)
    if until is not None:
        until.thread = thread
    thread.start()
    try:
        while not ended.wait(_LOOK):
            poll()
    except BaseException:
        if until is not None:
            until.set()
        raise
    if raised:
        raise raised[0]
    return found[0]


class Order:
    """Elimination order of a matrix and of others with its sparsity pattern.

    Parameters
    ----------
    A : csc_array
        The matrix.
    pivoting : str
        How it is factorised.
    places : ndarray
        The rows and columns in this order.
    """

    def __init__(self, A: Any, pivoting: str, places: Any) -> None:
        self.pivoting = pivoting
        self.places = places
        self._pattern = A.indptr, A.indices
        self._moved: tuple[Any, Any, Any] | None = None

    def fits(self, A: Any, pivoting: str) -> bool:
        """Whether this is an order for `A`."""
        return pivoting == self.pivoting and all(
            map(np.array_equal, self._pattern, (A.indptr, A.indices))
        )

    def of(self, A: Any) -> Any:
        """Return `A` with its rows and columns in this order."""
        from scipy.sparse import csc_array

        if self._moved is None:
            numbers = np.arange(A.nnz, dtype=A.indices.dtype)
            numbered = csc_array((numbers, A.indices, A.indptr), shape=A.shape)
            moved = numbered[self.places][:, self.places]
            moved.sort_indices()
            self._moved = moved.data, moved.indices, moved.indptr
        entries, indices, indptr = self._moved
        return csc_array((A.data[entries], indices, indptr), shape=A.shape)


class Factors:
    """The factors of one matrix.

    Parameters
    ----------
    lu : scipy.sparse.linalg.SuperLU
        The factors.
    A : csc_array
        The matrix.
    places : ndarray or None
        The permutation of rows and columns used; None without one.
    released : ReleaseEvent, optional
        Set when the factors are needed no more.
    """

    def __init__(
        self, lu: Any, A: Any, places: Any = None, released: ReleaseEvent | None = None
    ) -> None:
        from scipy.sparse import csc_array

        self._lu, self._places = lu, places
        self._released = released
        if released is not None:
            _KEPT.add(self)
        self._A = A
        self._sizes = csc_array((np.abs(A.data), A.indices, A.indptr), shape=A.shape)
        self._sums = np.asarray(self._sizes.sum(axis=1)).ravel()

    def __del__(self) -> None:
        """Release the factors."""
        self.release()

    def release(self) -> None:
        """Release the factors here and in their thread."""
        self._lu = None
        if self._released is not None:
            self._released.set()

    def solve(self, b: Array) -> Array | None:
        """Return the solution of ``A x = b``, refined where it needs to be; None without one."""
        with np.errstate(all="ignore"):
            x = self._substitute(b)
            for _ in range(2):
                if not np.isfinite(x).all():
                    return None
                left = b - self._A @ x
                error = self._error(left, x, b)
                if error <= _EXACT:
                    return x
                x = x + self._substitute(left)
            if not np.isfinite(x).all() or not self._error(b - self._A @ x, x, b) <= _USELESS:
                return None
        return x

    def _substitute(self, b: Array) -> Array:
        """Return what the factors alone give for ``A x = b``."""
        if self._places is None:
            x: Array = self._lu.solve(b)
            return x
        x = np.empty_like(b)
        x[self._places] = self._lu.solve(b[self._places])
        return x

    def _error(self, left: Array, x: Array, b: Array) -> float:
        """Return ``max |b - A x| / (|A||x| + |b|)``; what has decayed to nothing counts less."""
        size = self._sizes @ np.abs(x) + np.abs(b)
        size += _DECAYED * np.max(np.abs(x), initial=0.0) * self._sums
        return float(np.max(np.abs(left) / np.where(size > 0, size, 1.0), initial=0.0))


_KEPT: weakref.WeakSet[Factors] = weakref.WeakSet()
"""Factors that a thread keeps, which is to end before the interpreter does."""


@atexit.register
def _end_threads() -> None:
    """Wait for all threads: SuperLU takes memory through the interpreter, which must be there."""
    for factors in list(_KEPT):
        factors.release()
    threads = [it for it in threading.enumerate() if it.name == _THREAD]
    try:
        for thread in threads:
            thread.join(_QUIET)
        if any(it.is_alive() for it in threads) and sys.stderr is not None:
            print(_WAITING, file=sys.stderr, flush=True)
        for thread in threads:
            thread.join()
    except KeyboardInterrupt:
        for stream in (sys.stdout, sys.stderr):
            if stream is not None:
                stream.flush()
        os._exit(_INTERRUPTED)


class Factoriser:
    """Makes and counts factorisations.

    Where the pattern is symmetric and the diagonal positive the diagonal is pivoted on in an order
    of minimum degree, which costs least; where that fails, and elsewhere, SuperLU pivots. Its
    order of columns then is that of ``A'A``, unless a few long rows would fill that. The order is
    kept while the pattern stays.

    Parameters
    ----------
    poll : callable
        Called while a long factorisation runs; what it raises ends the waiting.
    """

    def __init__(self, poll: Callable[[], None]) -> None:
        self._poll = poll
        self._trusts_diagonal: bool | None = None
        self._has_long_rows = False
        self.count = 0
        """Factorisations so far."""
        self.fill = 0
        """Entries of the largest factors, L and U together."""
        self._last: tuple[Factors, Any] | None = None
        self._order: Order | None = None
        self._kept = ReleaseEvent()

    def last_of(self, free: Any) -> Factors | None:
        """Return the last factors if they belong to the rows and columns `free`."""
        if self._last is None or not np.array_equal(self._last[1], free):
            return None
        return self._last[0]

    def forget(self) -> None:
        """Release the last factors."""
        self._last = None

    def see_pattern(self, J: Any) -> None:
        """Find out from a Jacobian whether its pattern is symmetric, or has long rows."""
        if self._trusts_diagonal is None:
            pattern = J.copy()
            pattern.data = np.ones(len(pattern.data))
            self._trusts_diagonal = (pattern - pattern.T).count_nonzero() <= 0.01 * J.nnz
            lengths = np.diff(J.indptr).astype(float)
            most = min(lengths @ lengths, float(len(lengths)) ** 2)
            self._has_long_rows = most > _FULLER * J.nnz

    def _ways(self, A: Any) -> list[str]:
        """Return how to pivot, the cheapest first."""
        ways = ["some", "partial"] if self._has_long_rows else ["partial"]
        if self._trusts_diagonal and np.all(A.diagonal() > 0):
            ways.insert(0, "none")
        return ways

    def solve(self, A: Any, *rights: Array, free: Any = None) -> list[Array] | None:
        """Return the solutions for several right-hand sides; None where `A` is singular.

        With `free`, the rows and columns of a Jacobian that `A` has, its factors are kept for
        `last_of`.
        """
        A, self._last = A.tocsc(), None
        for pivoting in self._ways(A):
            factors = self._factors(A, pivoting)
            solutions: list[Array] = []
            for right in rights if factors is not None else ():
                solution = factors.solve(right)  # type: ignore[union-attr]
                if solution is None:
                    break
                solutions.append(solution)
            if factors is not None and len(solutions) == len(rights):
                self._last = None if free is None else (factors, free)
                return solutions
            if pivoting == "none":
                self._trusts_diagonal = False
            elif factors is None:
                break  # singular, however it is pivoted
        return None

    def factors_of(self, A: Any) -> Factors | None:
        """Return factors to solve with several times; None where `A` is singular."""
        A, self._last = A.tocsc(), None
        return self._factors(A, self._ways(A)[0])

    def _factors(self, A: Any, pivoting: str) -> Factors | None:
        self._poll()
        self.count += 1
        known = self._order if self._order and self._order.fits(A, pivoting) else None
        work = partial(_factorised, A, pivoting, known)
        self._kept.settle()  # the memory of former factors is free
        released = None if A.nnz < _SHORT else ReleaseEvent()
        try:
            if released is None:
                lu, order = work()
            else:
                self._kept = released
                lu, order = in_thread(work, self._poll, released)
        except RuntimeError:  # exactly singular
            return None
        self.fill = max(self.fill, int(lu.nnz))
        self._order = order or Order(A, pivoting, np.argsort(lu.perm_c))
        return Factors(lu, A, order.places if order else None, released)


def _factorised(A: Any, pivoting: str, order: Order | None) -> tuple[Any, Order | None]:
    """Return the factors of `A` and the permutation used, None without one.

    SuperLU's own minimum-degree order needs minutes for random patterns and holds the GIL
    meanwhile.
    """
    from scipy.sparse.linalg import splu

    if order is None and _is_singular_by_pattern(A):
        raise RuntimeError("no pivots, whatever the entries are")
    told = _PIVOTING[pivoting]
    if order is None and pivoting == "partial":
        return splu(A, permc_spec="COLAMD", **told), None
    if order is None:
        pattern = (part.astype(np.int32, copy=False) for part in (A.indptr, A.indices))
        order = Order(A, pivoting, _zivi.minimum_degree(*pattern))
    return splu(order.of(A), permc_spec="NATURAL", **told), order


def _is_singular_by_pattern(A: Any) -> bool:
    """Whether there are too few places for pivots: SuperLU then writes out of bounds."""
    from scipy.sparse.csgraph import structural_rank

    return not np.all(A.diagonal()) and bool(structural_rank(A) < A.shape[0])


def rows_of_sizes(J: Any) -> Array:
    """Return ``c_i = max_j |J_ij|``, 1 for an empty row."""
    sizes: Array = np.asarray(abs(J).max(axis=1).todense(), float).ravel()
    return np.where(sizes > 0, sizes, 1.0)
