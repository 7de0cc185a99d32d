"""Gaps of a tree: limits of joints, balls above planes, balls beside balls."""

from __future__ import annotations

import dataclasses
from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from zivi.base.check import finite
from zivi.system.tree.body import vector

__all__ = ["BallGap", "JointLimit", "PlaneGap", "TreeGap"]


@dataclasses.dataclass(frozen=True, eq=False)
class JointLimit:
    r"""Limits of a joint of a `zivi.Tree`, :math:`q_j \ge` lower and :math:`q_j \le` upper.

    Parameters
    ----------
    joint : str
        The coordinate.
    lower, upper : float, optional
        The limits, one at least; each is a gap, ``joint.lower`` and ``joint.upper``.

    Raises
    ------
    ValueError, TypeError
        If there is none, or lower is not below upper.
    """

    joint: str
    lower: float | None = None
    upper: float | None = None

    def __post_init__(self) -> None:
        if self.lower is None and self.upper is None:
            raise ValueError(f"the limit of joint {self.joint!r} needs lower or upper")
        for side in ("lower", "upper"):
            if (value := getattr(self, side)) is not None:
                value = finite(f"{side} of joint {self.joint!r}", value)
                object.__setattr__(self, side, value)
        if self.lower is not None and self.upper is not None and self.lower >= self.upper:
            raise ValueError(
                f"lower of joint {self.joint!r} must be below upper, got {self.lower} and "
                f"{self.upper}"
            )


@dataclasses.dataclass(frozen=True, eq=False)
class PlaneGap:
    r"""A ball, or a point, of a body above a fixed plane, :math:`n \cdot p - c - r \ge 0`.

    Parameters
    ----------
    body : str
        The body.
    point : array_like
        The centre of the ball in the body's frame (m).
    normal : array_like
        :math:`n` in axes of the world, made of length one.
    offset : float
        :math:`c` (m).
    radius : float
        :math:`r` (m), >= 0.
    name : str, optional
        By default that of the body.

    Raises
    ------
    ValueError, TypeError
        If a number is not finite, `normal` is zero or the radius negative.
    """

    body: str
    point: ArrayLike = (0.0, 0.0, 0.0)
    normal: ArrayLike = (0.0, 0.0, 1.0)
    offset: float = 0.0
    radius: float = 0.0
    name: str | None = None

    def __post_init__(self) -> None:
        called = f"of the gap of body {self.body!r}"
        for field in ("point", "normal"):
            value = vector(f"{field} {called}", getattr(self, field))
            object.__setattr__(self, field, value)
        length = float(np.linalg.norm(np.asarray(self.normal)))
        if length == 0.0:
            raise ValueError(f"normal {called} must not be zero")
        # a normal of length one keeps its digits
        unit = np.asarray(self.normal) / (1.0 if abs(length - 1.0) < 4e-16 else length)
        object.__setattr__(self, "normal", unit)
        _lengths(self, called)


@dataclasses.dataclass(frozen=True, eq=False)
class BallGap:
    r"""A ball of a body beside one of another, :math:`|p - p'| - r \ge 0`.

    Parameters
    ----------
    body : str
        The body.
    point : array_like
        The centre of its ball in its frame (m).
    other : str, optional
        The other body; by default the world.
    other_point : array_like
        The centre of the other ball, in the frame of `other` (m).
    radius : float
        :math:`r`, the sum of both radii (m), > 0.
    name : str, optional
        By default the name of the body.

    Raises
    ------
    ValueError, TypeError
        If a number is not finite or the radius not positive, or both are of one body.
    """

    body: str
    point: ArrayLike = (0.0, 0.0, 0.0)
    other: str | None = None
    other_point: ArrayLike = (0.0, 0.0, 0.0)
    radius: float = 0.0
    name: str | None = None

    def __post_init__(self) -> None:
        called = f"of the gap of body {self.body!r}"
        for field in ("point", "other_point"):
            value = vector(f"{field} {called}", getattr(self, field))
            object.__setattr__(self, field, value)
        if self.other == self.body:
            raise ValueError(f"other {called} must be another body")
        _lengths(self, called)
        if self.radius == 0.0:
            raise ValueError(f"radius {called} must be > 0, got 0.0")


TreeGap: TypeAlias = JointLimit | PlaneGap | BallGap
"""A gap of a tree, or two of them."""


def _lengths(gap: PlaneGap | BallGap, called: str) -> None:
    for field in ("offset", "radius"):
        if hasattr(gap, field):
            object.__setattr__(gap, field, finite(f"{field} {called}", getattr(gap, field)))
    if gap.radius < 0.0:
        raise ValueError(f"radius {called} must be >= 0, got {gap.radius}")
