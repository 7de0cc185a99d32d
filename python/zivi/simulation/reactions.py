"""Contact forces at given states, and those of friction."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

import zivi._zivi as _zivi
from zivi.base.check import Array
from zivi.system.friction import Channel
from zivi.system.mechanism import Model

__all__ = ["forces_at"]


def forces_at(
    model: Model | None,
    channels: tuple[Channel, ...],
    states: tuple[Array, Array, Array],
    contacts: NDArray[np.bool_],
    modes: NDArray[np.int8] | None = None,
) -> tuple[Array, Array]:
    r"""Compute contact forces and forces of friction at several states.

    .. math::

        K (\lambda_A, f_S) = -(R M^{-1} \tilde F + (h_A, k_S)), \qquad
        R = (N_A; B_S), \quad K = R M^{-1} (N_A - \mu \sigma B; B_S)^T

    with the sticking channels :math:`S`; the forces of joints that slip are in
    :math:`\tilde F`. Forces that the motion does not determine are the least within their limits.

    Parameters
    ----------
    model : Model or None
        The system, None if it is not known.
    channels : tuple of Channel
        The channels of friction.
    states : (ndarray, ndarray, ndarray)
        ``(t, q, qdot)``, of shapes (k,), (k, n), (k, n).
    contacts : ndarray of bool
        The closed gaps, of shape (k, m).
    modes : ndarray of int8, optional
        What the channels do, of shape (k, p).

    Returns
    -------
    (ndarray, ndarray)
        Shapes (k, m) and (k, p); zero where there is no contact, NaN where the model is not known
        or no forces keep the gaps closed.
    """
    t, q, qdot = (np.ascontiguousarray(it) for it in states)  # compiled parts take rows
    if modes is None:
        modes = np.full((len(t), 0), 2, dtype=np.int8)
    reactions, friction = np.zeros(contacts.shape), np.zeros(modes.shape)
    gap_of = [channel.gap for channel in channels]
    for k in np.flatnonzero(contacts.any(axis=1) | (modes != 2).any(axis=1)):
        found = None
        if model is not None:
            row = model.evaluate(float(t[k]), q[k], qdot[k])
            closed, does = contacts[k].tolist(), modes[k].tolist()
            found = _zivi.contact_forces(row, q.shape[1], gap_of, closed, does)
        if found is None:
            reactions[k, contacts[k]] = np.nan
            friction[k, modes[k] != 2] = np.nan
        else:
            reactions[k], friction[k] = np.split(found, [contacts.shape[1]])
    return reactions, friction
