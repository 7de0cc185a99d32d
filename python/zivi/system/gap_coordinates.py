"""Gap coordinates of a mechanical system, and velocities that impacts do not change."""

from __future__ import annotations

import dataclasses
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from zivi.base.check import Array, real_array
from zivi.system.mechanism import MechanicalSystem
from zivi.system.model_parts import Evaluation


class GapCoordinates(NamedTuple):
    r"""A state of a mechanical system, split into gaps and velocities that impacts do not change.

    .. math::

        \dot q = M^{-1} N^T W^{-1} (\dot g - g_t) + T w, \qquad W = N M^{-1} N^T, \qquad
        Z = (T^T M T)^{-1} T^T M

    with :math:`N T = 0`, :math:`Z T = 1` and :math:`Z M^{-1} N^T = 0`: an impact on any gaps
    changes :math:`\dot g` but not :math:`w = Z \dot q`.

    Attributes
    ----------
    g, gdot : ndarray
        Gaps and their rates, shape (m,).
    D : ndarray
        The Delassus matrix W, shape (m, m): an impulse P changes the rates by ``D @ P``.
    N : ndarray
        Gradients of the gaps, shape (m, n).
    T : ndarray
        A basis of the velocities that keep all gaps, shape (n, n - m).
    Z : ndarray
        Shape (n - m, n).
    w : ndarray
        The velocities ``Z @ qdot``, shape (n - m,): in general not those of coordinates.
    c : ndarray
        Kinetic cosines of the gaps, ``D[i, j]/sqrt(D[i, i] D[j, j])``, shape (m, m): if nonzero, an
        impact on one gap changes the velocity of the other.
    """

    g: Array
    gdot: Array
    D: Array
    N: Array
    T: Array
    Z: Array
    w: Array
    c: Array


def gap_coordinates(
    system: MechanicalSystem, q: ArrayLike, qdot: ArrayLike, t: float = 0.0
) -> GapCoordinates:
    """Split a state of a mechanical system into gaps and velocities that impacts do not change.

    Parameters
    ----------
    system : MechanicalSystem
        The system; its gaps must be independent, ``m <= n``.
    q, qdot : array_like
        Coordinates and velocities, shape (n,).
    t : float
        Time.

    Returns
    -------
    GapCoordinates
        A named tuple ``g, gdot, D, N, T, Z, w, c``.

    Raises
    ------
    ValueError
        If the gaps are not independent at this state: `D` is singular.

    Examples
    --------
    >>> box = zivi.MechanicalSystem(
    ...     mass=np.eye(2), force=[0.0, -9.81], gaps=[zivi.LinearGap([0, 1], name="floor")], e=0.5
    ... )
    >>> split = zivi.mechanics.gap_coordinates(box, [0.0, 1.0], [3.0, -2.0])
    >>> split.gdot, abs(split.w)
    (array([-2.]), array([3.]))
    """
    if not isinstance(system, MechanicalSystem):
        raise TypeError(f"system must be a zivi.MechanicalSystem, got {type(system).__name__}")
    for name, it in (("q", q), ("qdot", qdot)):
        if not np.all(np.isfinite(real_array(name, it))):
            raise ValueError(f"{name} must be finite, got {it!r}")
    here = system.at(t, q, qdot)
    velocity = np.atleast_1d(np.asarray(qdot, dtype=np.float64))
    kinetics = GapKinetics.of(here, velocity)
    normals, m = here.gradients, len(here.gaps)
    basis = np.linalg.qr(normals.T, mode="complete")[0][:, m:]
    momenta = basis.T @ here.mass
    inverse = np.linalg.solve(momenta @ basis, momenta)
    cosines = kinetic_cosines(kinetics.D)
    np.fill_diagonal(cosines, 1.0)
    return GapCoordinates(
        here.gaps, kinetics.gdot, kinetics.D, normals, basis, inverse, inverse @ velocity, cosines
    )


REDUNDANT = 1e-10
"""Least eigenvalue of the matrix of cosines of independent gaps."""


def kinetic_cosines(D: Array) -> Array:
    """Return ``D_ij/sqrt(D_ii D_jj)`` of one Delassus matrix or of many, (..., m, m)."""
    size = np.sqrt(np.diagonal(D, axis1=-2, axis2=-1))
    return np.asarray(D / (size[..., :, None] * size[..., None, :]), dtype=np.float64)


def check_independent(D: Array) -> None:
    """Raise a ValueError if gaps are not independent, of one matrix D or of many, (..., m, m)."""
    single = D.shape[-1] == 1
    least = D if single else np.linalg.eigvalsh(kinetic_cosines(D))[..., 0]
    if not np.all(least > (0.0 if single else REDUNDANT)):
        raise ValueError("the gaps must be independent: N M^-1 N^T is singular here")


@dataclasses.dataclass(frozen=True, eq=False)
class GapKinetics:
    """Kinetics of gaps and controls at a state.

    Parameters
    ----------
    here : Evaluation
        The system.
    gdot : ndarray
        Rates of the gaps, shape (m,).
    mobility : ndarray
        ``M^-1 N^T``, shape (n, m).
    D : ndarray
        The Delassus matrix, shape (m, m).
    """

    here: Evaluation
    gdot: Array
    mobility: Array
    D: Array

    @classmethod
    def of(cls, here: Evaluation, qdot: Array) -> GapKinetics:
        """Compute them; a ValueError if the gaps are not independent."""
        normals = here.gradients
        mobility: Any = np.linalg.solve(here.mass, normals.T)
        D: Array = normals @ mobility
        D = 0.5 * (D + D.T)
        check_independent(D)
        return cls(here, normals @ qdot + here.rates, mobility, D)

    def without_gaps(self, vector: Any, gaps: Any = slice(None)) -> Array:
        """Remove the gap-changing part of a velocity vector by M-orthogonal projection."""
        normals, mobility = self.here.gradients[gaps], self.mobility[:, gaps]
        if not len(normals):
            return np.asarray(vector, dtype=np.float64)
        D = self.D[np.ix_(np.arange(len(self.D))[gaps], np.arange(len(self.D))[gaps])]
        left: Array = vector - mobility @ np.linalg.solve(D, normals @ vector)
        return left
