"""The Zhuravlev-Ivanov transform between ``(x, x')`` and ``(s, v)``."""

from __future__ import annotations

from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

import zivi._zivi as _zivi
from zivi.base.check import Array, real, real_array

__all__ = ["lift", "project"]


def lift(
    x: ArrayLike,
    xdot: ArrayLike,
    *,
    e: float | None = None,
    kappa: float | None = None,
    branch: Literal["positive", "negative"] = "positive",
) -> tuple[Array, Array]:
    r"""Lift physical states to the transform's coordinates.

    .. math:: s = \sigma x, \qquad v = \sigma \dot x / (1 - \kappa\,\mathrm{sgn}\,\dot x)

    Parameters
    ----------
    x : array_like
        Distance from the wall, :math:`x \ge 0` (m), any shape.
    xdot : array_like
        Velocity (m/s), broadcast against `x`. At the wall, a velocity into it lifts to the
        state at the impact, whose projection is the velocity after it.
    e, kappa : float
        Exactly one of the coefficient of restitution and :math:`\kappa = (1-e)/(1+e)`,
        in [0, 1].
    branch : {"positive", "negative"}
        The sign :math:`\sigma` of `s`.

    Returns
    -------
    s, v : ndarray
        Transformed position (m) and velocity (m/s), of the broadcast shape.

    Raises
    ------
    ValueError
        If some `x` is negative, `x` or `xdot` is not finite, `e`, `kappa` or `branch` is out of
        range, or ``e = 0`` and some `xdot` is positive: it has no finite image.

    Examples
    --------
    >>> s, v = zivi.lift(1.0, -3.0, kappa=0.5)
    >>> float(s), float(v)
    (1.0, -2.0)
    """
    e, kappa = coefficients(e, kappa)
    if branch not in ("positive", "negative"):
        raise ValueError(f"branch must be 'positive' or 'negative', got {branch!r}")
    position, velocity = _broadcast(x=x, xdot=xdot)
    if not (np.all(position >= 0.0) and np.all(np.isfinite(position))):
        raise ValueError("x must be finite and >= 0 (the wall is at 0)")
    if not np.all(np.isfinite(velocity)):
        raise ValueError("xdot must be finite")
    if kappa == 1.0 and np.any(velocity > 0.0):
        raise ValueError("e must be > 0 to lift a velocity away from the wall (R = 0 there)")
    sigma = 1.0 if branch == "positive" else -1.0
    s, v = _zivi.lift(np.ravel(position), np.ravel(velocity), sigma, kappa)
    return s.reshape(position.shape), v.reshape(position.shape)


def project(
    s: ArrayLike, v: ArrayLike, *, e: float | None = None, kappa: float | None = None
) -> tuple[Array, Array]:
    r"""Project lifted states back to physical coordinates.

    .. math:: x = |s|, \qquad \dot x = R\,v\,\mathrm{sgn}\,s, \qquad
              R = 1 - \kappa\,\mathrm{sgn}\,s\,\mathrm{sgn}\,v

    Parameters
    ----------
    s, v : array_like
        Transformed position (m) and velocity (m/s), broadcast against each other.
    e, kappa : float
        Exactly one of the coefficient of restitution and :math:`\kappa`, in [0, 1].

    Returns
    -------
    x, xdot : ndarray
        Distance from the wall (m) and velocity (m/s); at the wall, the velocity after the
        impact, :math:`(1-\kappa)|v|`.

    Examples
    --------
    >>> x, xdot = zivi.project(-1.0, 2.0, kappa=0.5)
    >>> float(x), float(xdot)
    (1.0, -3.0)
    """
    _, kappa = coefficients(e, kappa)
    position, velocity = _broadcast(s=s, v=v)
    x, xdot = _zivi.project(np.ravel(position), np.ravel(velocity), kappa)
    return x.reshape(position.shape), xdot.reshape(position.shape)


def coefficients(e: float | None, kappa: float | None) -> tuple[float, float]:
    """Return `e` and `kappa` from exactly one of them, in [0, 1]."""
    given = _zivi.Restitution(
        e=None if e is None else real("e", e),
        kappa=None if kappa is None else real("kappa", kappa),
    )
    return given.e, given.kappa


def _broadcast(**named: Any) -> tuple[Array, Array]:
    (name_a, a), (name_b, b) = named.items()
    first, second = real_array(name_a, a), real_array(name_b, b)
    try:
        first, second = np.broadcast_arrays(first, second)
    except ValueError as error:
        raise ValueError(f"{name_a} and {name_b} must have shapes that agree: {error}") from None
    return first, second
