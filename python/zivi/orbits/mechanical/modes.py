r"""Linear systems as modes, for the equations in impulses.

Every motion is the forced response and what the impulses have made of it. With the eigenvalues
:math:`\lambda` and eigenvectors `V` of the free motion the kernel of a gap `i` for impulses of a
gap `j` is

.. math:: G_{ij}(d) = \sum_\lambda (n_i V)_\lambda (V^{-1} M^{-1} n_j)_\lambda e^{\lambda d}.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from zivi._zivi import PeriodicImpulses
from zivi.base.check import Array
from zivi.orbits.mechanical.linear_flow import WORST, LinearFlow

__all__ = ["periodic_impulses"]

UNDAMPED = 1e-9
"""How near 1 a multiplier of the free motion may be: beyond, it resonates with the impulses."""

Complex = NDArray[np.complex128]


class _Modes(NamedTuple):
    """What does not depend on loads, walls and periods. Of conjugate pairs one mode is kept."""

    state: Array
    """Matrix of the free motion."""
    values: Complex
    parts: dict[str, Array]
    """Of the equations, complex numbers as pairs."""


@functools.lru_cache(maxsize=32)
def _modes(state: bytes, inverse: bytes, normals: bytes, n: int) -> _Modes | None:
    """Give the modes; None where eigenvectors nearly depend on each other."""
    whole = np.zeros((2 * n, 2 * n))
    whole[:n, n:] = np.eye(n)
    whole[n:] = np.frombuffer(state).reshape(n, 2 * n)
    values, vectors = np.linalg.eig(whole)
    if np.linalg.cond(vectors) > WORST:
        return None
    kept = np.imag(values) >= 0.0
    twice = np.where(np.imag(values[kept]) > 0.0, 2.0, 1.0)[:, None]
    back = np.linalg.inv(vectors)[kept] * twice
    values, vectors = values[kept], vectors[:, kept]
    rows = np.frombuffer(normals).reshape(-1, n)
    spread = np.frombuffer(inverse).reshape(n, n) @ rows.T
    inputs = back[:, n:] @ spread
    weights = (rows @ vectors[:n])[:, None, :] * inputs.T[None, :, :]
    parts = {
        "rates": _parts(values),
        "kernels": _parts(weights * values ** np.arange(4)[:, None, None, None]),
        "vectors": _parts(vectors),
        "inputs": _parts(inputs.T),
        "pushes": np.vstack([np.zeros_like(spread), spread]).T.copy(),
        "mobilities": np.einsum("in,ni->i", rows, spread),
    }
    return _Modes(whole, values.astype(np.complex128), parts)


def _parts(values: NDArray[Any]) -> Array:
    return np.stack([np.real(values), np.imag(values)], axis=-1)


@functools.lru_cache(maxsize=64)
def _resolvent(whole: bytes, size: int, omega: float) -> Complex:
    """Give what a wave of a load makes of a motion, for all amplitudes of the load."""
    matrix = np.frombuffer(whole).reshape(size, size)
    found = np.linalg.inv(1j * omega * np.eye(size) - matrix)[:, size // 2 :]
    return np.asarray(found, np.complex128)


def _forced(flow: LinearFlow, whole: Array) -> Array:
    """Give the states of the forced response, columns of a constant, then cosines and sines."""
    n, push = flow.n, flow.push
    found = np.zeros((2 * n, push.shape[1]))
    key = whole.tobytes()
    if push[:, 0].any():
        found[:, 0] = (_resolvent(key, 2 * n, 0.0) @ push[:, 0]).real
    for k, omega in enumerate(flow.waves):
        moved = _resolvent(key, 2 * n, omega) @ (push[:, 1 + 2 * k] - 1j * push[:, 2 + 2 * k])
        found[:, 1 + 2 * k], found[:, 2 + 2 * k] = moved.real, -moved.imag
    return found


def periodic_impulses(
    flow: LinearFlow, gaps: Sequence[int], period: float
) -> PeriodicImpulses | None:
    """Give the equations of impacts in impulses; None where the free motion has no such modes."""
    modes = _modes(flow.state.tobytes(), flow.inverse.tobytes(), flow.normals.tobytes(), flow.n)
    if modes is None or np.min(np.abs(1.0 - np.exp(modes.values * period))) < UNDAMPED:
        return None
    states = _forced(flow, modes.state)
    return PeriodicImpulses(
        list(gaps),
        period=period,
        forced_gaps=flow.normals @ states[: flow.n] - flow.wall,
        forced_states=states,
        omegas=np.array(flow.waves),
        e=flow.e,
        **modes.parts,
    )
