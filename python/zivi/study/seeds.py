"""The seeds of the points of a study: children of its ``numpy.random.SeedSequence``."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["child", "generators", "seeds"]

# of numpy/random/bit_generator.pyx, whose results NumPy promises not to change (NEP 19)
INIT_A, MULT_A = 0x43B0D7E5, 0x931E8875
INIT_B, MULT_B = 0x8B51F9DD, 0x58F38DED
MIX_L, MIX_R = 0xCA01F9DD, 0x4973F715
WORDS = 4
"""Words of the pool of a sequence."""


def child(seed: int | None, point: int) -> np.random.SeedSequence:
    """Give what ``SeedSequence(seed).spawn(n)[point]`` is."""
    return np.random.SeedSequence(seed, spawn_key=(point,))


def generators(seed: int | None, points: NDArray[np.int64]) -> list[np.random.Generator]:
    """Make the generators of some points."""
    return [np.random.default_rng(child(seed, point)) for point in points.tolist()]


def seeds(seed: int | None, points: NDArray[np.int64]) -> NDArray[np.uint64]:
    """Give ``child(seed, point).generate_state(1, np.uint64)[0]`` of all points, < 2**32, at once.

    A child mixes the number of its point, one more word of entropy, into the pool of its parent.
    """
    pool = np.asarray(np.random.SeedSequence(seed).pool, np.uint32)
    # the constants that the parent's words have used up: one for each, and for each pair
    factor = _product(INIT_A, MULT_A, WORDS * WORDS)
    state = []
    for word in pool[:2]:
        hashed, factor = _hashed(points.astype(np.uint32), factor, MULT_A)
        mixed = np.uint32(MIX_L) * np.full(1, word, np.uint32) - np.uint32(MIX_R) * hashed
        state.append(mixed ^ (mixed >> np.uint32(16)))
    low, factor = _hashed(state[0], INIT_B, MULT_B)
    high, _ = _hashed(state[1], factor, MULT_B)
    return low.astype(np.uint64) | (high.astype(np.uint64) << np.uint64(32))


def _hashed(
    words: NDArray[np.uint32], factor: int, multiplier: int
) -> tuple[NDArray[np.uint32], int]:
    after = _product(factor, multiplier, 1)
    words = (words ^ np.uint32(factor)) * np.uint32(after)
    return words ^ (words >> np.uint32(16)), after


def _product(start: int, multiplier: int, times: int) -> int:
    return start * pow(multiplier, times, 2**32) % 2**32
