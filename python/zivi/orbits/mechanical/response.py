"""The response of linear systems without impacts, and where it grazes."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from zivi.base.check import Array, real_array
from zivi.orbits.mechanical.family import value_of
from zivi.orbits.mechanical.linear_flow import is_exact
from zivi.system.gap import HarmonicWall, LinearGap
from zivi.system.linear import Harmonic, LinearSystem

__all__ = ["grazing_curve", "response_amplitude"]


def response_amplitude(system: LinearSystem, gap: str, omegas: ArrayLike) -> Array:
    r"""Give how far a gap swings where nothing is hit.

    .. math:: R = | n \cdot (K - \omega^2 M + i \omega C)^{-1} p - w |

    Parameters
    ----------
    system : LinearSystem
        A system with `Harmonic` loads or walls of one frequency.
    gap : str
        The name of a gap.
    omegas : array_like
        Angular frequencies (rad/s).

    Returns
    -------
    ndarray
        Amplitudes, of the shape of `omegas`.

    Raises
    ------
    ValueError
        For another gap, or loads of several frequencies.

    Examples
    --------
    >>> system = zivi.LinearSystem(
    ...     1.0, 0.1, 1.0, excitation=zivi.Harmonic([1.0], 0.8),
    ...     gaps=[zivi.LinearGap([-1.0], 1.0, name="stop")], e=0.8)
    >>> zivi.response_amplitude(system, "stop", [1.0]).round(9)  # 1/c at resonance
    array([10.])
    """
    own, normal = _gap(system, gap)
    value_of(system, "omega")
    omega = real_array("omegas", omegas)
    load = np.zeros(len(system.M), np.complex128)
    for part in system.excitation:
        if isinstance(part, Harmonic):
            load = load + np.asarray(part.amplitude) * np.exp(1j * part.phase)
    wall: Any = own.motion
    moved = wall.amplitude * np.exp(1j * wall.phase) if isinstance(wall, HarmonicWall) else 0.0
    found = [
        abs(normal @ np.linalg.solve(system.K - w * w * system.M + 1j * w * system.C, load) - moved)
        for w in omega.ravel()
    ]
    return np.asarray(found, np.float64).reshape(omega.shape)


def grazing_curve(system: LinearSystem, gap: str, omegas: ArrayLike) -> Array:
    """Give the load at which the motion without impacts touches a gap, in closed form.

    Parameters
    ----------
    system : LinearSystem
        A system with `Harmonic` loads of one frequency and walls that do not move.
    gap : str
        The name of a gap.
    omegas : array_like
        Angular frequencies (rad/s), shape (k,).

    Returns
    -------
    ndarray
        Rows ``(omega, F)``, shape (k, 2); `F` as in `continue_orbit`, the largest amplitude.

    Raises
    ------
    ValueError
        As for `response_amplitude`, and if the gap is not open at rest.

    Examples
    --------
    >>> system = zivi.LinearSystem(
    ...     1.0, 0.1, 1.0, excitation=zivi.Harmonic([1.0], 0.8),
    ...     gaps=[zivi.LinearGap([-1.0], 1.0, name="stop")], e=0.8)
    >>> zivi.grazing_curve(system, "stop", [1.0]).round(9)
    array([[1. , 0.1]])
    """
    own, normal = _gap(system, gap)
    if own.motion is not None:
        raise ValueError(f"gap {gap!r} must not move: its load would not be in proportion")
    constant = np.zeros(len(system.M))
    for part in system.excitation:
        if isinstance(part, np.ndarray):
            constant = constant + part
    rest = own.offset
    if np.any(constant):
        rest = float(normal @ np.linalg.solve(system.K, constant)) + own.offset
    if not rest > 0.0:
        raise ValueError(f"gap {gap!r} must be open at rest, it is {rest:.6g}")
    omega = np.atleast_1d(real_array("omegas", omegas))
    strength = value_of(system, "F")
    return np.column_stack([omega, strength * rest / response_amplitude(system, gap, omega)])


def _gap(system: LinearSystem, gap: str) -> tuple[LinearGap, Array]:
    if not is_exact(system):
        raise TypeError(f"system must be a zivi.LinearSystem under waves, got {system!r}")
    if gap not in system.gap_names:
        raise ValueError(f"gap must be one of {', '.join(system.gap_names)}, got {gap!r}")
    own = system.gaps[system.gap_names.index(gap)]
    assert isinstance(own, LinearGap)
    return own, own.normal
