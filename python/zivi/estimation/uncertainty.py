"""Covariance at the optimum, directions that the data do not determine, parameters at bounds."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np

from zivi.base.check import Array
from zivi.base.extras import needed

SINGULAR = 1e8
"""Condition of the scaled Jacobian from which on a direction is undetermined."""
SINGULAR_DIFFERENCED = 1e6
"""The same for a Jacobian of differences."""
PART = 0.1
"""Parameters with this part of the largest entry belong to an undetermined direction."""
NEAR = 0.05
"""Distance from a bound, in standard deviations, below which a parameter is at it."""


@dataclasses.dataclass(frozen=True)
class Uncertainty:
    """Covariance and determinacy from the Jacobian at the optimum.

    Parameters
    ----------
    covariance : ndarray
        Shape (m, m); infinite variances of undetermined parameters, NaN of those at a bound.
    undetermined : tuple of tuple of int
        Groups of parameters that are not determined separately.
    at_bound : dict of int to float
        Parameters at a bound, and the bound.
    """

    covariance: Array
    undetermined: tuple[tuple[int, ...], ...]
    at_bound: dict[int, float]


def estimate(
    p: Array,
    r: Array,
    jacobian: Array,
    bounds: tuple[Array, Array],
    weights: Array | None,
    differenced: bool,
) -> Uncertainty:
    """Return the covariance of least squares.

    Parameters
    ----------
    p : ndarray
        Optimum, shape (m,).
    r, jacobian : ndarray
        Residuals in standard deviations, shape (n,), and their derivatives, (n, m).
    bounds : (ndarray, ndarray)
        Bounds of the parameters.
    weights : ndarray or None
        Derivatives of a robust loss by the squared residuals; None for least squares.
    differenced : bool
        Whether the derivatives are differences.

    Returns
    -------
    Uncertainty

    Notes
    -----
    With a robust loss the covariance is the sandwich estimate of Huber (1967).
    """
    w = np.ones(len(r)) if weights is None else weights
    root = jacobian * np.sqrt(w)[:, None]
    at_bound = _at_bounds(p, jacobian.T @ (w * r), root, bounds)
    free = np.array([j not in at_bound for j in range(len(p))])
    covariance = np.full((len(p), len(p)), np.nan)
    groups: list[tuple[int, ...]] = []
    if np.any(free):
        limit = SINGULAR_DIFFERENCED if differenced else SINGULAR
        inverse, among = _inverse(root[:, free], limit)
        numbers = np.flatnonzero(free)
        groups = [tuple(int(numbers[j]) for j in group) for group in among]
        if weights is not None:
            rows = jacobian[:, free] * (w * r)[:, None]
            finite = np.where(np.isfinite(inverse), inverse, 0.0)
            robust = finite @ (rows.T @ rows) @ finite
            inverse = np.where(np.isfinite(inverse), robust, inverse)
        covariance[np.ix_(free, free)] = inverse
    return Uncertainty(covariance, tuple(groups), at_bound)


def _at_bounds(p: Array, gradient: Array, root: Array, bounds: tuple[Array, Array]) -> Any:
    """Return the parameters that a bound holds, and the bound."""
    sizes = np.linalg.norm(root, axis=0)
    found = {}
    for j, value in enumerate(p):
        near = NEAR / sizes[j] if sizes[j] > 0.0 else 0.0
        near = max(near, 1e-6 * max(1.0, abs(value)))
        for bound, outward in ((bounds[0][j], 1.0), (bounds[1][j], -1.0)):
            if abs(value - bound) <= near and outward * gradient[j] > 0.0:
                found[j] = float(bound)
    return found


def _inverse(root: Array, limit: float) -> tuple[Array, list[list[int]]]:
    """Return the inverse of the normal matrix, and the groups of undetermined columns."""
    sizes = np.linalg.norm(root, axis=0)
    scale = np.where(sizes > 0.0, sizes, 1.0)
    _, s, vt = np.linalg.svd(root / scale, full_matrices=True)
    s = np.concatenate([s, np.zeros(len(vt) - len(s))])
    poor = s * limit <= max(s[0], 1e-300)
    inverse = (vt[~poor].T / s[~poor] ** 2) @ vt[~poor] / np.outer(scale, scale)
    groups: list[list[int]] = [[int(j)] for j in np.flatnonzero(sizes == 0.0)]
    for row in vt[poor]:
        row = np.where(sizes > 0.0, np.abs(row), 0.0)
        if np.max(row) > 1e-6:
            group = [int(j) for j in np.flatnonzero(row > PART * np.max(row))]
            if group not in groups:
                groups.append(group)
    for j in {j for group in groups for j in group}:
        inverse[j, j] = np.inf
    return inverse, groups


def quantile(level: float, freedom: float | None) -> float:
    """Return the half-width of a two-sided interval, in standard deviations.

    Normal distribution; Student's distribution with degrees of freedom for an estimated variance.
    """
    special = needed("scipy.special", "fits")
    above = 0.5 + 0.5 * level
    return float(special.ndtri(above) if freedom is None else special.stdtrit(freedom, above))
