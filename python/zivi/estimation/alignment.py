"""Alignment of measured times of impacts with predicted ones, some missed and some spurious."""

from __future__ import annotations

import dataclasses
import itertools

import numpy as np
from numpy.typing import NDArray

from zivi.base.check import Array

SPURIOUS = -1
"""Index of a measured time that is no impact."""
Indices = NDArray[np.int64]


@dataclasses.dataclass(frozen=True, eq=False)
class Alignment:
    """Which predicted impact belongs to each measured time.

    Parameters
    ----------
    index : ndarray
        Number of the predicted impact, `SPURIOUS` for none.
    missed : int
        Predicted impacts before the last measured time that were not measured.
    """

    index: Indices
    missed: int

    @property
    def spurious(self) -> int:
        """Number of spurious times."""
        return int(np.count_nonzero(self.index == SPURIOUS))


def align(
    measured: Array, predicted: Array, sigma: Array, missed: float, spurious: float
) -> Alignment:
    """Align two increasing sequences at the least sum of squares, by dynamic programming.

    Parameters
    ----------
    measured, predicted : ndarray
        Times of n and m impacts (s).
    sigma : ndarray
        Standard deviations of the measured times, shape (n,) (s).
    missed, spurious : float
        Costs of a predicted time without a measured one, and of a measured time without a
        predicted one, in standard deviations. Predicted times after the last measured one cost
        nothing.

    Returns
    -------
    Alignment
        Indices into `predicted`.
    """
    n, m = len(measured), len(predicted)
    skip, alone = missed**2, spurious**2
    steps = skip * np.arange(m + 1)
    cost = np.empty((n + 1, m + 1))
    cost[0] = steps
    for i in range(n):
        apart = ((predicted - measured[i]) / sigma[i]) ** 2
        best = cost[i] + alone
        best[1:] = np.minimum(best[1:], cost[i, :-1] + apart)
        # a missed one is a step along the row: the running minimum of what is left without them
        cost[i + 1] = np.minimum.accumulate(best - steps) + steps
    late = int(np.searchsorted(predicted, measured[-1])) if n else 0
    rest = skip * np.maximum(late - np.arange(m + 1), 0)
    j = int(np.argmin(cost[n] + rest))
    index = np.full(n, SPURIOUS)
    i = n
    while i > 0:
        if j > 0 and cost[i, j] >= cost[i, j - 1] + skip - 1e-9 * (1.0 + cost[i, j]):
            j -= 1
            continue
        apart_j = ((predicted[j - 1] - measured[i - 1]) / sigma[i - 1]) ** 2 if j > 0 else np.inf
        if j > 0 and cost[i - 1, j - 1] + apart_j <= cost[i - 1, j] + alone:
            index[i - 1] = j - 1
            j -= 1
        i -= 1
    return counted_missed(index, late)


def counted_missed(index: Indices, late: int) -> Alignment:
    """Return an alignment with its missed impacts, of `late` before the last measured time."""
    used = index[index != SPURIOUS]
    due = max(late, int(used[-1]) + 1 if len(used) else 0)
    return Alignment(index, due - len(used))


LONGEST = 12
"""Measured times whose indices are enumerated."""
RATIOS = np.concatenate([np.linspace(0.05, 0.85, 25), np.linspace(0.87, 0.995, 10)])
FINE = np.linspace(-0.035, 0.035, 15)
"""Ratios around the best of `RATIOS`."""
ROUGH = 0.01
"""Misfit of a geometric sequence that drag and gravity cause, of the median interval."""


def geometric_indices(
    measured: Array, sigma: Array, penalty: float, number: int, *, most: int = 3
) -> list[Indices]:
    """Return likely indices of the first measured times, without a model of the motion.

    Times of a body that bounces to rest are nearly ``a - b r**k``, with the coefficient of
    restitution r: a missed impact shows as the sum of two intervals. All sets of at most `most`
    missed and one spurious time are compared by the misfit of this sequence.

    Parameters
    ----------
    measured, sigma : ndarray
        Times and their standard deviations (s).
    penalty : float
        Cost of a missed or a spurious time, in standard deviations.
    number : int
        At most so many candidates.
    most : int
        Largest number of missed impacts.

    Returns
    -------
    list of ndarray
        Indices of the first measured times from 0, the likeliest first.
    """
    n = min(len(measured), LONGEST)
    if n < 4:
        return []
    t = measured[:n]
    rough = np.hypot(sigma[:n], ROUGH * float(np.median(np.diff(t))))
    found: list[tuple[float, Indices]] = []
    for alone in range(-1, n):
        kept = np.arange(n) != alone
        candidates = _increasing(int(kept.sum()), most)
        extra = penalty**2 * (candidates[:, -1] + 1 - kept.sum() + (alone >= 0))
        misfits, ratios = _misfits(t[kept], rough[kept], candidates, RATIOS)
        few = np.argsort(misfits + extra)[: 5 * number]
        for k in few:
            near = np.clip(ratios[k] + FINE, 1e-3, 0.999)
            least = _misfits(t[kept], rough[kept], candidates[k : k + 1], near)[0][0]
            index = np.full(n, SPURIOUS)
            index[kept] = candidates[k]
            found.append((float(least + extra[k]), index))
    found.sort(key=lambda it: it[0])
    return [index for _, index in found[:number]]


def _increasing(n: int, most: int) -> Indices:
    """Return all sequences 0 < k1 < ... of `n` indices that leave out at most `most`."""
    rows = []
    for left_out in range(most + 1):
        for where in itertools.combinations_with_replacement(range(1, n), left_out):
            steps = np.zeros(n, int)
            np.add.at(steps, list(where), 1)
            rows.append(np.arange(n) + np.cumsum(steps))
    return np.array(rows)


def _misfits(t: Array, sigma: Array, index: Indices, ratios: Array) -> tuple[Array, Array]:
    """Return the least sums of squares of ``a - b r**k`` over ratios and the best ratios."""
    w = 1.0 / sigma**2
    w /= w.sum()
    centred = t - w @ t
    values = np.empty((len(ratios), len(index)))
    for i, r in enumerate(ratios):
        power = r**index
        power -= (power @ w)[:, None]
        square, product = (power**2) @ w, power @ (w * centred)
        values[i] = (centred**2) @ w - product**2 / (square + 1e-300)
    best = np.argmin(values, axis=0)
    least = np.maximum(values[best, np.arange(len(index))], 0.0) * np.sum(1.0 / sigma**2)
    return least, ratios[best]
