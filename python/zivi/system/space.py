r"""Rotations in space: unit quaternions, and the three coordinates of a run.

.. math:: s = p / (1 + p_0), \quad \omega = \tfrac{4}{(1 + s^2)^2}
          \left((1 - s^2) \dot s + 2 s \times \dot s + 2 s (s \cdot \dot s)\right)

is the stereographic projection of the unit quaternion :math:`(p_0, p)`, and the angular velocity in
axes of the frame that carries the rotation (J. Stuelpnagel, SIAM Review 6, 1964).
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from zivi.base.check import Array, finite, positive
from zivi.base.habits import hinted
from zivi.system.gap import ContactLaw
from zivi.system.tree_bodies import BallGap, Body, PlaneGap, vector


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


# Shapes of bodies, and the contacts between them as gaps of a tree.


@dataclasses.dataclass(frozen=True, eq=False)
class Ball:
    """A ball that is fixed in a body of a `zivi.Tree`.

    Parameters
    ----------
    radius : float
        Radius (m), > 0.
    center : array_like
        Centre in the frame of the body (m), of shape (3,).
    body : str, optional
        The body. Default: the one that has the name of the shape.

    Raises
    ------
    ValueError, TypeError
        If a number is not finite or the radius not positive.

    See Also
    --------
    Contact : a contact of two shapes.

    Examples
    --------
    >>> zivi.mechanics.Ball(0.2).radius
    0.2
    """

    radius: float
    center: ArrayLike = (0.0, 0.0, 0.0)
    body: str | None = None

    def __post_init__(self) -> None:
        _set(self, "radius", positive("radius of a ball", self.radius))
        _set(self, "center", vector("center of a ball", self.center))

    def points(self) -> Array:
        """Return the centres of the balls of which the shape is the hull, in the body's frame."""
        return np.atleast_2d(self.center)


@dataclasses.dataclass(frozen=True, eq=False)
class Capsule:
    """A cylinder with half balls at its ends, fixed in a body of a `zivi.Tree`.

    Parameters
    ----------
    radius : float
        Radius (m), > 0.
    half_length : float
        Half the distance of the centres of both half balls (m), > 0.
    axis : array_like
        Direction of the cylinder in the frame of the body, of any length.
    center : array_like
        Its middle there (m).
    body : str, optional
        As for `Ball`.

    Raises
    ------
    ValueError, TypeError
        If a number is not finite or out of range, or the axis is zero.

    Examples
    --------
    >>> zivi.mechanics.Capsule(0.1, 0.5).points()
    array([[ 0. ,  0. , -0.5],
           [ 0. ,  0. ,  0.5]])
    """

    radius: float
    half_length: float
    axis: ArrayLike = (0.0, 0.0, 1.0)
    center: ArrayLike = (0.0, 0.0, 0.0)
    body: str | None = None

    def __post_init__(self) -> None:
        _set(self, "radius", positive("radius of a capsule", self.radius))
        _set(self, "half_length", positive("half_length of a capsule", self.half_length))
        _set(self, "center", vector("center of a capsule", self.center))
        _set(self, "axis", _direction("axis of a capsule", self.axis))

    def points(self) -> Array:
        """Return the centres of the half balls, in the body's frame."""
        along = self.half_length * np.asarray(self.axis)
        ends: Array = np.asarray(self.center) + np.array([-along, along])
        return ends


@dataclasses.dataclass(frozen=True, eq=False)
class Box:
    """A box that is fixed in a body of a `zivi.Tree`; its corners touch planes.

    Parameters
    ----------
    half_extents : array_like
        Half the lengths of its edges (m), each > 0, along the axes of the body.
    center : array_like
        Its middle in the frame of the body (m).
    body : str, optional
        As for `Ball`.

    Raises
    ------
    ValueError, TypeError
        If a number is not finite or a length not positive.

    Examples
    --------
    >>> zivi.mechanics.Box((0.1, 0.2, 0.3)).points().shape
    (8, 3)
    """

    half_extents: ArrayLike
    center: ArrayLike = (0.0, 0.0, 0.0)
    body: str | None = None
    radius: float = dataclasses.field(default=0.0, init=False)

    def __post_init__(self) -> None:
        extents = vector("half_extents of a box", self.half_extents)
        if np.any(extents <= 0.0):
            raise ValueError(f"half_extents of a box must be > 0, got {extents.tolist()}")
        _set(self, "half_extents", extents)
        _set(self, "center", vector("center of a box", self.center))

    def points(self) -> Array:
        """Return the corners, in the body's frame."""
        signs = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
        corners: Array = np.asarray(self.center) + signs * np.asarray(self.half_extents)
        return corners


@dataclasses.dataclass(frozen=True, eq=False)
class Plane:
    r"""A fixed plane, :math:`n \cdot p \ge c` in front of it.

    Parameters
    ----------
    normal : array_like
        :math:`n` in axes of the world, of any length; made of length one.
    offset : float, optional
        :math:`c`, the distance from the origin along the normal (m). Default 0.
    point : array_like, optional
        A point of the plane (m), in place of `offset`.

    Raises
    ------
    ValueError, TypeError
        If a number is not finite, the normal is zero, or both offset and point are given.

    Examples
    --------
    >>> zivi.mechanics.Plane((0, 0, 1), point=(3, 0, 0.5)).offset
    0.5
    """

    normal: ArrayLike = (0.0, 0.0, 1.0)
    offset: float | None = None
    point: ArrayLike | None = None

    def __post_init__(self) -> None:
        unit = _direction("normal of a plane", self.normal)
        if self.offset is not None and self.point is not None:
            raise ValueError("offset and point of a plane must not be given both")
        offset = 0.0 if self.offset is None else finite("offset of a plane", self.offset)
        if self.point is not None:
            offset = float(unit @ vector("point of a plane", self.point))
        _set(self, "normal", unit)
        _set(self, "offset", offset)
        _set(self, "point", None)


Shape: TypeAlias = Ball | Capsule | Box | Plane
"""A shape of a body, or of the world."""


@hinted("Contact")
@dataclasses.dataclass(frozen=True, eq=False)
class Contact:
    """A contact of two shapes of a `zivi.Tree`, by their names.

    A ball above a plane is one gap, a capsule two, a box its eight corners; two balls have
    one gap. With friction `first` of two balls must not come to lie exactly below `second`. Both
    ends of a capsule that lies, and the corners of a box on a face, touch together.

    Parameters
    ----------
    first, second : str
        Names of the shapes, in any order.
    mu : float
        Coefficient of dry friction, >= 0. A body that moves in space slips in two directions; one
        that moves in a plane in one.
    mu_static : float, optional
        Coefficient while sticking, at least `mu`. Default: `mu`.
    e : float, ImpactLaw or callable, optional
        Restitution of the gaps. Default: that of the tree.
    name : str, optional
        Name of the gap. Default: ``first-second``; several gaps are ``name.0``, ``name.1``, ...
    contact : SpringDamper, Hertz, HuntCrossley or callable, optional
        Makes the gaps compliant (see `zivi.Gap`).

    Raises
    ------
    ValueError, TypeError
        If a coefficient is out of range, or both are one shape.

    See Also
    --------
    PlaneGap, BallGap : the gaps themselves.

    Examples
    --------
    A ball that is thrown slides first, and then rolls at 5/7 of its speed:

    >>> from zivi.mechanics import Ball, Body, Contact, Plane
    >>> ball = Body("ball", kind="free", mass=1.3, inertia=0.4 * 1.3 * 0.2**2)
    >>> table = zivi.Tree(
    ...     [ball],
    ...     contacts=[Contact("ball", "table", mu=0.3)],
    ...     shapes={"ball": Ball(0.2), "table": Plane((0, 0, 1))},
    ... )
    >>> sol = zivi.simulate(table, (0, 1), ([0, 0, 0.2, 1, 0, 0, 0], [1.4, 0, 0, 0, 0, 0]))
    >>> sol.qvel[-1, :3].round(6) + 0.0
    array([1., 0., 0.])
    """

    first: str
    second: str
    mu: float = 0.0
    mu_static: float | None = None
    e: Any = None
    name: str | None = None
    contact: ContactLaw | None = None

    def __post_init__(self) -> None:
        for field in ("first", "second"):
            if not isinstance(getattr(self, field), str):
                raise TypeError(
                    f"{field} of a contact must be the name of a shape, got "
                    f"{getattr(self, field)!r}"
                )
        if self.first == self.second:
            raise ValueError(f"a contact must be between two shapes, got {self.first!r} twice")

    @property
    def called(self) -> str:
        """The name of its gap."""
        return self.name or f"{self.first}-{self.second}"


def gaps_of_contacts(
    contacts: Sequence[Any], shapes: Mapping[str, Any], bodies: Sequence[Body]
) -> list[tuple[PlaneGap | BallGap, Any]]:
    """Return the gaps of contacts, each with its restitution.

    Raises
    ------
    NotImplementedError
        For a pair of shapes without a gap.
    """
    known = {body.name for body in bodies}
    for name, shape in shapes.items():
        if not isinstance(shape, Shape):
            raise TypeError(
                f"shapes[{name!r}] must be a Ball, Capsule, Box or Plane of zivi.mechanics, got "
                f"{shape!r}"
            )
    found: list[tuple[PlaneGap | BallGap, Any]] = []
    for i, contact in enumerate(contacts):
        if not isinstance(contact, Contact):
            raise TypeError(f"contacts[{i}] must be a zivi.mechanics.Contact, got {contact!r}")
        for name in (contact.first, contact.second):
            if name not in shapes:
                told = ", ".join(map(repr, shapes)) or "none"
                raise ValueError(f"contacts[{i}] names the shape {name!r}; shapes has {told}")
        pair = [
            (shapes[name], _owner(name, shapes[name], known))
            for name in (contact.first, contact.second)
        ]
        found += [(gap, contact.e) for gap in _gaps_between(contact, pair)]
    return found


def _owner(name: str, shape: Shape, known: set[str]) -> str | None:
    """Return the body of a shape, None for the world."""
    if isinstance(shape, Plane):
        if name in known:
            raise NotImplementedError(
                f"shapes[{name!r}] is a plane on a body, which zivi.Tree does not support; planes "
                "are fixed to the world: give the shape a name that no body has"
            )
        return None
    if shape.body is not None and shape.body not in known:
        raise ValueError(f"shapes[{name!r}] names the body {shape.body!r}, which is not there")
    return shape.body or (name if name in known else None)


def _gaps_between(
    contact: Contact, pair: Sequence[tuple[Shape, str | None]]
) -> list[PlaneGap | BallGap]:
    (one, body), (other, other_body) = pair
    if isinstance(one, Plane):
        (one, body), (other, other_body) = pair[::-1]
    called = contact.called
    if isinstance(other, Plane) and not isinstance(one, Plane):
        if body is None:
            raise ValueError(f"contact {called!r} is between shapes of the world; neither moves")
        points = one.points()
        return [
            PlaneGap(
                body,
                point,
                other.normal,
                float(other.offset or 0.0),
                one.radius,
                called if len(points) == 1 else f"{called}.{k}",
                contact.mu,
                contact.mu_static,
                contact.contact,
            )
            for k, point in enumerate(points)
        ]
    if isinstance(one, Ball) and isinstance(other, Ball):
        if body is None:
            (one, body), (other, other_body) = (other, other_body), (one, body)
        if body is None:
            raise ValueError(f"contact {called!r} is between shapes of the world; neither moves")
        radius = one.radius + other.radius
        ends = one.center, other_body, other.center
        rubs = contact.mu, contact.mu_static, one.radius / radius
        return [BallGap(body, *ends, radius, called, contact.contact, *rubs)]
    kinds = " and ".join(type(it).__name__ for it, _ in pair)
    raise NotImplementedError(
        f"contact {called!r} is between {kinds}, which is not supported; use a ball, capsule or "
        "box above a plane, or a ball beside a ball"
    )


def _set(it: Any, field: str, value: Any) -> None:
    object.__setattr__(it, field, value)


def _direction(name: str, value: Any) -> Array:
    given = vector(name, value)
    length = float(np.linalg.norm(given))
    if length == 0.0:
        raise ValueError(f"{name} must not be zero")
    return given / (1.0 if abs(length - 1.0) < 4e-16 else length)
