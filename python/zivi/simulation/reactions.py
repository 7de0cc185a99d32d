"""Contact forces at given states, and those of friction."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from zivi.base.check import Array
from zivi.system.friction import Channel
from zivi.system.layout import Evaluation
from zivi.system.mechanism import Model

__all__ = ["forces_at", "multipliers", "reactions_at"]

SINGULAR = 1e-9
"""Singular values below this part of the largest are zero."""


def multipliers(here: Evaluation, closed: NDArray[np.bool_]) -> Array:
    r"""Give the multipliers that keep gaps closed.

    .. math:: \lambda_A = -W_{AA}^{-1} (N_A M^{-1} F + h_A), \qquad W = N M^{-1} N^T

    Parameters
    ----------
    here : Evaluation
        The system.
    closed : ndarray of bool
        The set A.

    Returns
    -------
    ndarray
        Shape (m,), 0 where a gap is open.
    """
    found = np.zeros(len(closed))
    if np.any(closed):
        normals = here.gradients[closed]
        inverse = np.linalg.solve(here.mass, np.column_stack([here.force, normals.T]))
        free = normals @ inverse[:, 0] + here.curvatures[closed]
        found[closed] = -np.linalg.solve(normals @ inverse[:, 1:], free)
    return found


def reactions_at(
    model: Model | None, t: Array, q: Array, qdot: Array, contacts: NDArray[np.bool_]
) -> Array:
    """Give the multipliers at several states, NaN where the model is needed and not known."""
    found = np.zeros(contacts.shape)
    q, qdot = (np.ascontiguousarray(it) for it in (q, qdot))  # compiled parts take rows
    for k in np.flatnonzero(np.any(contacts, axis=1)):
        if model is None:
            found[k, contacts[k]] = np.nan
        else:
            here = model.layout.read(model.evaluate(float(t[k]), q[k], qdot[k]))
            found[k] = multipliers(here, contacts[k])
    return found


def forces_at(
    model: Model | None,
    channels: tuple[Channel, ...],
    states: tuple[Array, Array, Array],
    contacts: NDArray[np.bool_],
    modes: NDArray[np.int8],
) -> tuple[Array, Array]:
    """Give contact forces and forces of friction at several ``(t, q, qdot)``, as `reactions_at`."""
    t, q, qdot = states
    reactions, friction = np.zeros(contacts.shape), np.zeros(modes.shape)
    q, qdot = (np.ascontiguousarray(it) for it in (q, qdot))
    for k in range(len(t)):
        if model is None:
            reactions[k, contacts[k]] = np.nan
            friction[k, modes[k] != 2] = np.nan
        else:
            here = model.layout.read(model.evaluate(float(t[k]), q[k], qdot[k]))
            reactions[k], friction[k] = rubbing(here, channels, contacts[k], modes[k])
    return reactions, friction


def rubbing(
    here: Evaluation,
    channels: tuple[Channel, ...],
    closed: NDArray[np.bool_],
    modes: NDArray[np.int8],
) -> tuple[Array, Array]:
    r"""Give contact forces and forces of friction of a mode.

    .. math::

        K (\lambda_A, f_S) = -(R M^{-1} \tilde F + (h_A, k_S)), \qquad
        R = (N_A; B_S), \quad K = R M^{-1} (N_A - \mu \sigma B; B_S)^T

    with the sticking channels :math:`S`; the forces of joints that slip are in
    :math:`\tilde F`.

    Parameters
    ----------
    here : Evaluation
        The system.
    channels : tuple of Channel
        Which gaps the channels belong to.
    closed : ndarray of bool
        The set A.
    modes : ndarray of int8
        What the channels do.

    Returns
    -------
    (ndarray, ndarray)
        Shapes (m,) and (p,).
    """
    number = {int(gap): place for place, gap in enumerate(np.flatnonzero(closed))}
    force, columns = here.force.copy(), here.gradients[closed].copy()
    friction = np.zeros(len(channels))
    for c, channel in enumerate(channels):
        sigma = int(modes[c])
        if abs(sigma) == 1 and channel.gap is None:
            friction[c] = -here.limits[c] * sigma
            force += friction[c] * here.tangents[c]
        elif abs(sigma) == 1:
            assert channel.gap is not None
            columns[number[channel.gap]] -= here.limits[c] * sigma * here.tangents[c]
    stick = modes == 0
    rows = np.concatenate([here.gradients[closed], here.tangents[stick]])
    columns = np.concatenate([columns, here.tangents[stick]])
    inverse = np.linalg.solve(here.mass, np.column_stack([force, columns.T]))
    free = np.concatenate([here.curvatures[closed], here.slip_curvatures[stick]])
    found = _solved(rows @ inverse[:, 1:], -(rows @ inverse[:, 0] + free))
    pressed, held = found[: len(number)], found[len(number) :]
    friction[stick] = held
    for c, channel in enumerate(channels):
        if abs(int(modes[c])) == 1 and channel.gap is not None:
            friction[c] = -here.limits[c] * modes[c] * pressed[number[channel.gap]]
    reactions = np.zeros(len(closed))
    reactions[closed] = pressed
    return reactions, friction


def _solved(matrix: Array, right: Array) -> Array:
    """Solve for the forces; those that are not determined are the smallest."""
    if not len(right):
        return right
    return np.asarray(np.linalg.lstsq(matrix, right, rcond=SINGULAR)[0], dtype=np.float64)
