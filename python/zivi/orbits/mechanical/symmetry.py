"""Symmetric motions: half of the word, whose image under the symmetry is the other half."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np

from zivi.base.check import Array, real_array
from zivi.orbits.mechanical.equations import Terms
from zivi.orbits.mechanical.flow import Flow
from zivi.orbits.mechanical.word import Segment, Word

__all__ = ["gaps_turned", "turn_of", "whole_word"]


def turn_of(symmetry: Any, n: int) -> Array:
    r"""Read a symmetry: :math:`\Sigma` of shape (2n, 2n).

    Raises
    ------
    ValueError
        If it is no linear map of the coordinates, or of the states.
    """
    if callable(symmetry):
        columns = [np.asarray(symmetry(row), np.float64).ravel() for row in np.eye(2 * n)]
        matrix = np.array(columns).T
    else:
        matrix = np.atleast_2d(real_array("symmetry", symmetry))
    if matrix.shape == (n, n):
        matrix = np.asarray(np.kron(np.eye(2), matrix), np.float64)
    if matrix.shape != (2 * n, 2 * n) or not np.all(np.isfinite(matrix)):
        raise ValueError(
            f"symmetry must be a matrix of shape {(n, n)} for the coordinates, or {(2 * n, 2 * n)} "
            f"for the states, got {matrix.shape}"
        )
    if not np.allclose(matrix @ matrix, np.eye(2 * n), atol=1e-12):
        raise ValueError("symmetry must give the same state when it is applied twice")
    return matrix


def gaps_turned(flow: Flow, turn: Array, half: float) -> list[int]:
    """Give for each gap the one that it is for the image, half a period later.

    Raises
    ------
    ValueError
        If a gap has no image.
    """
    rng = np.random.default_rng(0)
    times = rng.uniform(0.0, 2.0 * half, 3)
    states = rng.uniform(-1.0, 1.0, (3, 2 * flow.n))
    here, there = flow.gaps(times, states)[0], flow.gaps(times + half, states @ turn.T)[0]
    found = []
    for i in range(flow.m):
        same = [j for j in range(flow.m) if np.allclose(here[:, i], there[:, j], atol=1e-9)]
        if len(same) != 1:
            raise ValueError(f"symmetry: gap {i} has no image among the gaps")
        found.append(same[0])
    return found


def whole_word(terms: Terms) -> tuple[Word, Array, list[Array]]:
    """Give the word of the whole period, its unknowns and its impulses."""
    frame = terms.frame
    if frame.turn is None:
        return frame.word, terms.x, terms.impulses
    to = gaps_turned(frame.flow, frame.turn, terms.length)
    image = tuple(_turned(segment, to) for segment in frame.word)
    x = terms.x.copy()
    x[:, [0, -1]] += terms.length
    x[:, 1:-1] = x[:, 1:-1] @ frame.turn.T
    return frame.word + image, np.vstack([terms.x, x]), terms.impulses * 2


def _turned(segment: Segment, to: list[int]) -> Segment:
    gap = segment.gap if segment.gap < 0 else to[segment.gap]
    contacts, after = (tuple(sorted(to[i] for i in it)) for it in (segment.contacts, segment.after))
    return dataclasses.replace(segment, contacts=contacts, gap=gap, after=after)
