"""From wanted accelerations to the controls of a mechanical system."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np

from zivi.base.check import Array, real_array
from zivi.control.box_least_squares import allocated
from zivi.control.reference_run import pushed
from zivi.system.gap_coordinates import GapKinetics

__all__ = ["Allocation", "limits_of", "reach"]

RANK = 1e-6
"""Singular values below this part of the largest leave a gap without control."""


@dataclasses.dataclass(frozen=True, eq=False)
class Allocation:
    """The controls of a tick.

    Parameters
    ----------
    u : ndarray
        Shape (r,).
    limited : bool
        Whether limits act.
    least : float or None
        The least singular value of ``D^-1/2 N M^-1 B``, where it was computed.
    """

    u: Array
    limited: bool = False
    least: float | None = None

    @classmethod
    def of(
        cls, kinetics: GapKinetics, matrix: Array, a: Array, wanted: Array, limits: Array | None
    ) -> Allocation:
        r"""Find them for :math:`\ddot g = a` and, as far as they can, :math:`Z \ddot q = Z b`.

        Parameters
        ----------
        kinetics : GapKinetics
            The state.
        matrix : ndarray
            :math:`B`, shape (n, r).
        a, wanted : ndarray
            a, shape (m,), and b, shape (n,).
        limits : ndarray or None
            Shape (r, 2).

        Raises
        ------
        ValueError
            If the controls do not reach all gaps.
        """
        here, r = kinetics.here, matrix.shape[1]
        if matrix.shape[0] == r:
            force = pushed(kinetics, a, wanted) - here.force
            try:
                u: Array = np.linalg.solve(matrix, force).astype(np.float64, copy=False)
            except np.linalg.LinAlgError:
                pass
            else:
                if limits is None or bool(np.all((u >= limits[:, 0]) & (u <= limits[:, 1]))):
                    return cls(u)
        size = np.ones(r)
        if limits is not None and np.all(np.isfinite(limits)):
            size = np.abs(limits).max(axis=1)
        root = np.linalg.cholesky(kinetics.D)
        free = kinetics.mobility.T @ here.force + here.curvatures
        columns = np.column_stack([kinetics.mobility.T @ matrix, a - free])
        scaled = np.linalg.solve(root, columns)
        least = _checked(scaled[:, :r] * size)
        rest = _rest(kinetics, matrix, wanted)
        u, limited = allocated((scaled[:, :r], scaled[:, r]), rest, limits, size)
        return cls(u, limited, least)


def _rest(kinetics: GapKinetics, matrix: Array, wanted: Array) -> tuple[Array, Array]:
    """Give what the controls do beside the gaps, measured by the kinetic energy."""
    here = kinetics.here
    root = np.linalg.cholesky(here.mass).T
    moved = np.linalg.solve(here.mass, np.column_stack([matrix, here.force]))
    by, free = kinetics.without_gaps(moved[:, :-1]), kinetics.without_gaps(moved[:, -1])
    kept: Array = root @ (kinetics.without_gaps(wanted) - free)
    return root @ by, kept


def reach(kinetics: GapKinetics, matrix: Array) -> float:
    """Give the least singular value of ``D^-1/2 N M^-1 B``."""
    root = np.linalg.cholesky(kinetics.D)
    return _checked(np.linalg.solve(root, kinetics.mobility.T @ matrix))


def _checked(scaled: Array) -> float:
    m = len(scaled)
    if not m:
        return np.inf
    values = np.linalg.svd(scaled, compute_uv=False)
    least = float(values[m - 1]) if len(values) >= m else 0.0
    if not least > RANK * float(values.max(initial=0.0)):
        raise ValueError(
            f"the controls do not reach all of the {m} gaps: N M^-1 B has the singular values "
            f"{values.tolist()} here, in the metric of the masses"
        )
    return least


def limits_of(limits: Any) -> Array | None:
    """Read the range of each control."""
    if limits is None:
        return None
    rows = real_array("u_limits", limits)
    if rows.ndim != 2 or rows.shape[1] != 2 or not np.all(rows[:, 0] < rows[:, 1]):
        raise ValueError(f"u_limits must be pairs (u_min, u_max) with u_min < u_max, got {limits}")
    return rows
