r"""Rotations in space: unit quaternions, and the three coordinates of a run.

.. math:: s = p / (1 + p_0), \quad \omega = \tfrac{4}{(1 + s^2)^2}
          \left((1 - s^2) \dot s + 2 s \times \dot s + 2 s (s \cdot \dot s)\right)

is the stereographic projection of the unit quaternion :math:`(p_0, p)`, and the angular velocity in
axes of the frame that carries the rotation (J. Stuelpnagel, SIAM Review 6, 1964).
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from zivi.base.check import Array


def quaternions_of(s: Any) -> Array:
    """Return the unit quaternions (w, x, y, z) of coordinates of shape (..., 3)."""
    s = np.asarray(s)
    square = np.sum(s * s, axis=-1, keepdims=True)
    found: Array = np.concatenate([1.0 - square, 2.0 * s], axis=-1) / (1.0 + square)
    return found


def continuous(s: Array) -> Array:
    """Return the unit quaternions of successive coordinates, of shape (k, 3), without jumps."""
    p = quaternions_of(s)
    turns = np.sum(p[1:] * p[:-1], axis=1) < 0.0
    signs = np.cumprod(np.where(turns, -1.0, 1.0))
    p[1:] *= signs[:, None]
    return p


def chart_of(quaternions: Any) -> Array:
    """Return the coordinates, at most one in size, of unit quaternions of shape (..., 4)."""
    p = np.asarray(quaternions)
    p = np.where(p[..., :1] < 0.0, -p, p)
    found: Array = p[..., 1:] / (1.0 + p[..., :1])
    return found


def angular_velocities_of(s: Any, rates: Any) -> Array:
    """Return the angular velocities, in axes of the frame that carries the rotations."""
    s, rates = np.asarray(s), np.asarray(rates)
    square = np.sum(s * s, axis=-1, keepdims=True)
    along = np.sum(s * rates, axis=-1, keepdims=True)
    moved = (1.0 - square) * rates + 2.0 * np.cross(s, rates) + 2.0 * s * along
    found: Array = 4.0 * moved / (1.0 + square) ** 2
    return found


def chart_rates(s: Any, omega: Any) -> Array:
    """Return the rates of the coordinates for angular velocities in those axes."""
    s, omega = np.asarray(s), np.asarray(omega)
    square = np.sum(s * s, axis=-1, keepdims=True)
    along = np.sum(s * omega, axis=-1, keepdims=True)
    moved = (1.0 - square) * omega - 2.0 * np.cross(s, omega) + 2.0 * s * along
    found: Array = 0.25 * moved
    return found


def rotate_back(quaternions: Any, vectors: Any) -> Array:
    """Return vectors in axes of the rotated bodies, for quaternions of shape (..., 4)."""
    p = np.asarray(quaternions)
    u, v = -p[..., 1:], np.asarray(vectors)
    once = 2.0 * np.cross(u, v)
    found: Array = v + p[..., :1] * once + np.cross(u, once)
    return found


def rotate(quaternions: Any, vectors: Any) -> Array:
    """Return vectors of bodies in axes of the frame that carries the rotations."""
    p = np.asarray(quaternions) * np.array([1.0, -1.0, -1.0, -1.0])
    return rotate_back(p, vectors)


# States of trees. Rotations are given by body: the first coordinate, and whether the body is free.


def with_quaternions(rotations: Mapping[str, Any], q: Array) -> Array:
    """Return coordinates of shape (..., n) with unit quaternions in place of rotations."""
    parts, at = [], 0
    for first, _ in rotations.values():
        parts += [q[..., at:first], quaternions_of(q[..., first : first + 3])]
        at = first + 3
    return np.concatenate([*parts, q[..., at:]], axis=-1)


def with_angular_velocities(rotations: Mapping[str, Any], q: Array, qdot: Array) -> Array:
    """Return velocities with angular velocities, in axes of the bodies, in place of rates."""
    found = np.array(qdot)
    for first, _ in rotations.values():
        s, rates = q[..., first : first + 3], qdot[..., first : first + 3]
        omega = rotate_back(quaternions_of(s), angular_velocities_of(s, rates))
        found[..., first : first + 3] = omega
    return found


def without_charts(rotations: Mapping[str, Any], q: Array) -> Array:
    """Return numbers that tell the configuration, and do not depend on the chart of rotations."""
    parts, at = [], 0
    for first, _ in rotations.values():
        p = quaternions_of(q[..., first : first + 3])
        squares = p[..., :, None] * p[..., None, :]
        parts += [q[..., at:first], squares.reshape(*p.shape[:-1], 16)]
        at = first + 3
    return np.concatenate([*parts, q[..., at:]], axis=-1)
