"""Contact forces at given states."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from zivi.base.check import Array
from zivi.system.layout import Evaluation
from zivi.system.mechanism import Model

__all__ = ["multipliers", "reactions_at"]


def multipliers(here: Evaluation, closed: NDArray[np.bool_]) -> Array:
    r"""Give the multipliers that keep gaps closed.

    .. math:: \lambda_A = -D_{AA}^{-1} (N_A M^{-1} F + h_A), \qquad D = N M^{-1} N^T

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
