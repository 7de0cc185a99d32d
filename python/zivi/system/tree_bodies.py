"""Bodies, joints, gaps and constraints of a tree."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any, ClassVar, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from zivi.base.check import Array, finite, real_array
from zivi.base.expressions import UnknownNameError, c_source, expression, python_source
from zivi.base.extras import needed
from zivi.base.formula import FormulaError
from zivi.base.machine_code import Native, compile_model
from zivi.system.gap import Channel, ContactLaw, DryFriction, HarmonicWall, contact_law
from zivi.system.mechanism import ControlInputs, control_inputs
from zivi.system.table import Table

# Bodies of a tree, each with the joint that carries it.

KINDS = ("hinge", "slide", "ball", "free", "fixed")
ROTATIONS = ("rotation0", "rotation1", "rotation2")
"""The three coordinates of a rotation in space."""

OF_JOINT = ("stiffness", "spring", "damping", "armature", "torque")
"""What belongs to the joint of a body."""
REMEDIES = {
    "position": "its place is in the initial state",
    "rotation": "its rotation is in the initial state",
    "reference": "its rotation is in the initial state",
    "anchor": "it turns about its centre of mass",
    "parent": "a free body moves in the world",
}
"""What to do about fields that a body without an axis does not have."""
OF_INERTIA = ("xx", "yy", "zz", "xy", "xz", "yz")


@dataclasses.dataclass(frozen=True, eq=False)
class Body:
    r"""A rigid body of a `zivi.Tree`, with the joint that carries it.

    Parameters
    ----------
    name : str
        Its name.
    parent : str, optional
        The body that carries it; by default the world.
    kind : {"hinge", "slide", "ball", "free", "fixed"}
        Its joint: it turns about the axis (rad), slides along it (m), turns about the anchor in any
        direction, moves freely in the world, or is fixed to its parent.
    position : array_like
        The origin of its frame in that of its parent (m), where its coordinate is `reference`.
    rotation : array_like, optional
        Its axes there as the columns of a rotation, of shape (3, 3); by default the parent's.
    axis : array_like
        Direction of the joint in the body's frame, of any length.
    anchor : array_like
        A point on the axis of a hinge, or the centre of a ball joint, in the body's frame (m).
    mass : float
        Mass (kg), >= 0.
    com : array_like
        Centre of mass in the body's frame (m).
    inertia : array_like
        Inertia about the centre of mass along the body's axes (kg m^2): a number for all axes,
        three, or a symmetric matrix of shape (3, 3).
    stiffness, spring : float
        A spring in the joint, :math:`-k (q - s)`.
    damping : float
        :math:`c` in :math:`-c \dot q`.
    armature : float
        Inertia of a rotor, added to the diagonal of the mass matrix, >= 0.
    torque : float
        A constant torque, or force of a slide.
    reference : float
        The coordinate at which the frame is at `position`.
    coordinate : str, optional
        Name of the coordinate; by default that of the body. A free body has the coordinates
        ``name.x``, ``name.y``, ``name.z``, the place of its frame in the world, and as a ball joint
        ``name.rx``, ``name.ry``, ``name.rz`` of its rotation.

    Raises
    ------
    ValueError, TypeError
        If a number is not finite or out of range, an axis is zero, or a ball joint or free body
        has a spring, damping, armature or torque, or a free body a parent, position or rotation.

    See Also
    --------
    zivi.Tree.state : coordinates from positions and unit quaternions.

    Examples
    --------
    >>> zivi.mechanics.Body("arm", axis=[0, 1, 0], mass=1.0, com=[0, 0, -0.5], inertia=0.08).mass
    1.0
    """

    name: str
    parent: str | None = None
    kind: str = "hinge"
    position: ArrayLike = (0.0, 0.0, 0.0)
    rotation: ArrayLike | None = None
    axis: ArrayLike = (0.0, 0.0, 1.0)
    anchor: ArrayLike = (0.0, 0.0, 0.0)
    mass: float = 0.0
    com: ArrayLike = (0.0, 0.0, 0.0)
    inertia: ArrayLike = 0.0
    stiffness: float = 0.0
    spring: float = 0.0
    damping: float = 0.0
    armature: float = 0.0
    torque: float = 0.0
    reference: float = 0.0
    coordinate: str | None = None

    _kinds: ClassVar[tuple[str, ...]] = KINDS

    def __post_init__(self) -> None:
        if not isinstance(self.name, str) or not self.name:
            raise TypeError(f"name of a body must be a string, got {self.name!r}")
        if self.kind not in self._kinds:
            raise ValueError(
                f"kind of body {self.name!r} must be one of {', '.join(KINDS)}, got {self.kind!r}"
            )
        for field in ("position", "axis", "anchor", "com"):
            self._take(field, vector(f"{field} of body {self.name!r}", getattr(self, field)))
        if not np.any(np.asarray(self.axis)):
            raise ValueError(f"axis of body {self.name!r} must not be zero")
        self._take("rotation", self._rotation())
        self._take("inertia", self._inertia())
        for field in ("mass", *OF_JOINT, "reference"):
            value = finite(f"{field} of body {self.name!r}", getattr(self, field))
            if field in ("mass", "armature") and value < 0.0:
                raise ValueError(f"{field} of body {self.name!r} must be >= 0, got {value}")
            self._take(field, value)
        if self.kind in ("ball", "free"):
            self._check_rotation()

    def _check_rotation(self) -> None:
        """Reject what a joint without an axis does not have."""
        without: tuple[str, ...] = (*OF_JOINT, "reference")
        without += ("position", "anchor") if self.kind == "free" else ()
        given = [field for field in without if np.any(np.asarray(getattr(self, field)))]
        if self.kind == "free" and np.any(np.asarray(self.rotation) != np.eye(3)):
            given.append("rotation")
        if self.kind == "free" and self.parent is not None:
            given.append("parent")
        if given:
            raise NotImplementedError(
                f"{given[0]} of body {self.name!r} is not supported for kind={self.kind!r}; "
                + REMEDIES.get(given[0], "use hinges and slides, or an external force")
            )

    def _take(self, field: str, value: Any) -> None:
        object.__setattr__(self, field, value)

    def _rotation(self) -> Array:
        if self.rotation is None:
            return np.eye(3)
        given = real_array(f"rotation of body {self.name!r}", self.rotation)
        good = given.shape == (3, 3) and np.allclose(given.T @ given, np.eye(3), atol=1e-9)
        if not good or np.linalg.det(given) < 0.0:
            raise ValueError(
                f"rotation of body {self.name!r} must be a rotation of shape (3, 3), "
                f"got {given.tolist()}"
            )
        return given

    def _inertia(self) -> Array:
        given = real_array(f"inertia of body {self.name!r}", self.inertia)
        if given.shape in ((), (3,)):
            given = np.diag(np.broadcast_to(given, 3)).copy()
        finite_and_square = given.shape == (3, 3) and bool(np.all(np.isfinite(given)))
        if not finite_and_square or np.max(np.abs(given - given.T)) > 1e-10 * np.max(np.abs(given)):
            raise ValueError(
                f"inertia of body {self.name!r} must be a number, three, or a symmetric matrix of "
                f"shape (3, 3), got {given.tolist()}"
            )
        if np.linalg.eigvalsh(given)[0] < -1e-10 * np.max(np.abs(given)):
            raise ValueError(f"inertia of body {self.name!r} must not be negative")
        return given

    @property
    def moves(self) -> bool:
        """Whether it has a coordinate."""
        return self.kind != "fixed"

    @property
    def joint(self) -> str:
        """The name of its coordinate."""
        return self.coordinate or self.name


class Coordinate(Body):
    """One coordinate of a ball joint or free body; the last one carries it."""

    _kinds: ClassVar[tuple[str, ...]] = ("slide", *ROTATIONS)


def coordinates_of_body(body: Body) -> list[Body]:
    """Return the body, preceded by a massless one for each of its coordinates but the last."""
    if body.kind not in ("ball", "free"):
        return [body]
    found: list[Body] = []
    parent, called = body.parent, body.joint
    if body.kind == "free":
        for axis, k in zip(np.eye(3), "xyz", strict=True):
            found.append(
                Coordinate(
                    f"{body.name}.{k}", parent, "slide", axis=axis, coordinate=f"{called}.{k}"
                )
            )
            parent = found[-1].name
    placed: dict[str, Any] = {
        "position": body.position,
        "rotation": body.rotation,
        "anchor": body.anchor,
    }
    for kind, k in zip(ROTATIONS[:2], "xy", strict=True):
        name = f"{body.name}.r{k}"
        found.append(Coordinate(name, parent, kind, coordinate=f"{called}.r{k}", **placed))
        parent, placed = name, {"anchor": body.anchor}
    own: dict[str, Any] = {"mass": body.mass, "com": body.com, "inertia": body.inertia}
    last = Coordinate(body.name, parent, ROTATIONS[2], coordinate=f"{called}.rz", **placed, **own)
    return [*found, last]


def body_values(body: Body) -> dict[str, float]:
    """Return names and values of the parameters of a body."""
    values = {f"{body.name}.mass": body.mass}
    for field in ("com", "position"):
        vector = np.asarray(getattr(body, field))
        values |= {f"{body.name}.{field}.{k}": float(vector[i]) for i, k in enumerate("xyz")}
    inertia = np.asarray(body.inertia)
    entries = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))
    return values | {
        f"{body.name}.inertia.{k}": float(inertia[at])
        for k, at in zip(OF_INERTIA, entries, strict=True)
    }


def joint_values(body: Body) -> dict[str, float]:
    """Return names and values of the parameters of a joint."""
    return {f"{body.joint}.{field}": getattr(body, field) for field in OF_JOINT if body.moves}


def vector(name: str, value: Any) -> Array:
    """Read a finite vector in space."""
    array = real_array(name, value)
    if array.shape != (3,) or not np.all(np.isfinite(array)):
        raise ValueError(f"{name} must be three finite numbers, got {array.tolist()}")
    return array


# Gaps of a tree: limits of joints, balls on planes, balls on balls.


@dataclasses.dataclass(frozen=True, eq=False)
class JointLimit:
    r"""Limits of a joint of a `zivi.Tree`, :math:`q_j \ge` lower and :math:`q_j \le` upper.

    Parameters
    ----------
    joint : str
        The coordinate.
    lower, upper : float, optional
        The limits, one at least; each is a gap, ``joint.lower`` and ``joint.upper``.
    contact : SpringDamper, Hertz, HuntCrossley or callable, optional
        Makes both gaps compliant (see `zivi.Gap`): torques over angles at a hinge.

    Raises
    ------
    ValueError, TypeError
        If there is none, or lower is not below upper.
    """

    joint: str
    lower: float | None = None
    upper: float | None = None
    contact: ContactLaw | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "contact", contact_law(f"joint {self.joint!r}", self.contact))
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
    mu : float
        Coefficient of dry friction, >= 0. With friction the body must move in a plane: the axes of
        all hinges that carry it are parallel, its slides and the normal orthogonal to these. The
        slip speed is the velocity of the point of contact along axis x normal (without hinges,
        along the first slide).
    mu_static : float, optional
        Coefficient while sticking, at least `mu`; by default `mu`.
    contact : SpringDamper, Hertz, HuntCrossley or callable, optional
        Makes the gap compliant (see `zivi.Gap`).

    Raises
    ------
    ValueError, TypeError
        If a number is not finite, `normal` is zero, or the radius or a coefficient out of range.
    """

    body: str
    point: ArrayLike = (0.0, 0.0, 0.0)
    normal: ArrayLike = (0.0, 0.0, 1.0)
    offset: float = 0.0
    radius: float = 0.0
    name: str | None = None
    mu: float = 0.0
    mu_static: float | None = None
    contact: ContactLaw | None = None

    def __post_init__(self) -> None:
        called = f"of the gap of body {self.body!r}"
        object.__setattr__(self, "contact", contact_law(called.removeprefix("of "), self.contact))
        _coefficients(self, called)
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
    r"""Gap between balls on two bodies, :math:`|p - p'| - r \ge 0`.

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
    contact : SpringDamper, Hertz, HuntCrossley or callable, optional
        Makes the gap compliant (see `zivi.Gap`).
    mu : float
        Coefficient of dry friction, >= 0, of bodies that move in space: there are two directions of
        slip. The ball of `body` must not come to lie exactly below the other one.
    mu_static : float, optional
        Coefficient while sticking, at least `mu`; by default `mu`.
    share : float
        Part of `radius` that belongs to the ball of `body`, in [0, 1].

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
    contact: ContactLaw | None = None
    mu: float = 0.0
    mu_static: float | None = None
    share: float = 0.5

    def __post_init__(self) -> None:
        called = f"of the gap of body {self.body!r}"
        object.__setattr__(self, "contact", contact_law(called.removeprefix("of "), self.contact))
        _coefficients(self, called)
        object.__setattr__(self, "share", finite(f"share {called}", self.share))
        if not 0.0 <= self.share <= 1.0:
            raise ValueError(f"share {called} must be in [0, 1], got {self.share:.6g}")
        for field in ("point", "other_point"):
            value = vector(f"{field} {called}", getattr(self, field))
            object.__setattr__(self, field, value)
        if self.other == self.body:
            raise ValueError(f"other {called} must be another body")
        _lengths(self, called)
        if self.radius == 0.0:
            raise ValueError(f"radius {called} must be > 0, got 0.0")


def is_rough(gap: Any) -> bool:
    """Whether a gap has dry friction."""
    return isinstance(gap, PlaneGap | BallGap) and (gap.mu > 0.0 or bool(gap.mu_static))


TreeGap: TypeAlias = JointLimit | PlaneGap | BallGap
"""A gap of a tree, or two of them."""


def _coefficients(gap: PlaneGap | BallGap, called: str) -> None:
    object.__setattr__(gap, "mu", finite(f"mu {called}", gap.mu))
    if gap.mu < 0.0:
        raise ValueError(f"mu {called} must be >= 0, got {gap.mu}")
    if gap.mu_static is not None:
        object.__setattr__(gap, "mu_static", finite(f"mu_static {called}", gap.mu_static))
        if gap.mu_static < gap.mu:
            raise ValueError(
                f"mu_static {called} must be at least mu, got {gap.mu_static} < {gap.mu}"
            )


def _lengths(gap: PlaneGap | BallGap, called: str) -> None:
    for field in ("offset", "radius"):
        if hasattr(gap, field):
            object.__setattr__(gap, field, finite(f"{field} {called}", getattr(gap, field)))
    if gap.radius < 0.0:
        raise ValueError(f"radius {called} must be >= 0, got {gap.radius}")


# Dry friction of trees: in joints and between bodies and fixed planes.


PARALLEL = 1e-9
"""Sine of the angle up to which directions are parallel."""
LIMITS = (".mu", ".mu_static", ".friction", ".friction_static")
"""Endings of the parameters that limit friction."""


@dataclasses.dataclass(frozen=True)
class Rubbing:
    """A channel of dry friction of a tree.

    Parameters
    ----------
    kind : {"plane", "tangent", "between0", "between1", "joint"}
        Whether it is of a gap above a plane, one of two of it or of a gap of balls, or of a joint.
    at : int
        The number of the gap or joint.
    channel : Channel
        The same for a run.
    limits : dict
        Names and values of the parameters: the limit in slip, and that in stick if it differs.
    tangent : ndarray
        Direction of slip in axes of the world, empty for a joint.
    radius : str
        Parameter of the radius of the ball, or of the sum of two radii; empty for a joint.
    shares : tuple of float
        Parts of it: the radii.
    """

    kind: str
    at: int
    channel: Channel
    limits: Mapping[str, float]
    tangent: Array = dataclasses.field(default_factory=lambda: np.empty(0))
    radius: str = ""
    shares: tuple[float, ...] = (1.0,)

    def numbers(self, values: Mapping[str, Any]) -> list[Any]:
        """Return the numbers of the channel."""
        names = list(self.limits)
        radius = [values[self.radius] * part for part in self.shares] if self.radius else []
        return [*self.tangent, *radius, values[names[0]], values[names[-1]]]


def rubbings(
    bodies: Sequence[Body],
    gaps: Sequence[tuple[str, TreeGap]],
    joints: Sequence[DryFriction],
) -> list[Rubbing]:
    """Return the channels of friction: those of gaps with their names, then those of joints."""
    found = []
    for i, (name, gap) in enumerate(gaps):
        if not is_rough(gap):
            continue
        assert isinstance(gap, PlaneGap | BallGap)
        limits = {f"{name}.mu": gap.mu}
        if gap.mu_static is not None:
            limits[f"{name}.mu_static"] = gap.mu_static
        if isinstance(gap, BallGap):
            parts = gap.share, 1.0 - gap.share
            for row in (0, 1):
                channel, none = Channel(name, i, 0.0, row), np.empty(0)
                found.append(
                    Rubbing(f"between{row}", i, channel, limits, none, f"{name}.radius", parts)
                )
            continue
        tangents = tangents_of(bodies, gap)
        for row, tangent in enumerate(tangents):
            channel = Channel(name, i, 0.0, row) if len(tangents) > 1 else Channel(name, i)
            kind = "tangent" if len(tangents) > 1 else "plane"
            found.append(Rubbing(kind, i, channel, limits, tangent, f"{name}.radius"))
    coordinates = [body.joint for body in bodies if body.moves]
    for friction in joints:
        joint = str(friction.direction)
        limits = {f"{joint}.friction": finite("limit", friction.limit)}
        if friction.static is not None:
            limits[f"{joint}.friction_static"] = finite("static", friction.static)
        # a gap has the name of its body, which may be that of the joint
        name = f"{joint}.friction" if joint in {gap for gap, _ in gaps} else joint
        channel = Channel(friction.name or name, None)
        found.append(Rubbing("joint", coordinates.index(joint), channel, limits))
    return found


def friction_of_joints(friction: Any, coordinates: Sequence[str]) -> tuple[DryFriction, ...]:
    """Read the dry friction of joints, ``DryFriction("elbow", limit=0.1)`` by their names."""
    several = (friction,) if isinstance(friction, DryFriction) else tuple(friction)
    names = []
    for i, it in enumerate(several):
        where = f"friction[{i}]"
        if not isinstance(it, DryFriction):
            raise TypeError(f"{where} must be a zivi.DryFriction, got {it!r}")
        if not isinstance(it.direction, str):
            raise TypeError(
                f"{where} must name a joint of the tree, zivi.DryFriction({coordinates[0]!r}, "
                f"limit=...), got {it!r}"
            )
        if it.direction not in coordinates:
            raise ValueError(
                f"{where} names {it.direction!r}: there are {', '.join(sorted(coordinates))}"
            )
        for field in ("limit", "static", "velocity"):
            value = getattr(it, field)
            if callable(value) or (field == "velocity" and value != 0.0):
                raise NotImplementedError(
                    f"{field} of {where} must be {'0' if field == 'velocity' else 'a number'} in a "
                    "zivi.Tree; a zivi.MechanicalSystem takes functions and moving surfaces"
                )
        names.append(it.direction)
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise ValueError(f"friction must name each joint once, got {twice[0]!r} twice")
    return several


# Directions of slip along a plane: one of a body that moves in a plane, two of one in space.


def tangents_of(bodies: Sequence[Body], gap: PlaneGap) -> list[Array]:
    """Return the directions in which a body slips along a plane."""
    normal = np.asarray(gap.normal)
    axes = _axes(bodies, gap.body)
    if axes is None:
        return _in_both_directions(normal)
    hinges, slides = axes
    if hinges:
        axis = hinges[0]
        in_plane = abs(axis @ normal) <= PARALLEL
        in_plane &= all(np.linalg.norm(np.cross(axis, it)) <= PARALLEL for it in hinges)
        in_plane &= all(abs(axis @ it) <= PARALLEL for it in slides)
        if not in_plane:
            return _in_both_directions(normal)
        tangent = np.cross(axis, normal)
        return [np.asarray(tangent / np.linalg.norm(tangent))]
    along = [axis - normal * (normal @ axis) for axis in slides]
    along = [it for it in along if np.linalg.norm(it) > PARALLEL]
    if not along:
        return []
    tangent = along[0] / np.linalg.norm(along[0])
    spans = [np.linalg.norm(np.cross(tangent, it)) > PARALLEL * np.linalg.norm(it) for it in along]
    return _in_both_directions(normal) if any(spans) else [np.asarray(tangent)]


def _in_both_directions(normal: Array) -> list[Array]:
    """Return two directions that are orthogonal to a normal and to each other."""
    k = int(np.argmin(np.abs(normal)))
    first = np.eye(3)[k] - normal[k] * normal
    first /= np.linalg.norm(first)
    return [first, np.asarray(np.cross(normal, first))]


def _axes(bodies: Sequence[Body], body: str) -> tuple[list[Array], list[Array]] | None:
    """Return unit axes of the hinges and slides of a body, in axes of the world.

    They are from the world outwards; None if it rotates in space.
    """
    known = {it.name: it for it in bodies}
    turns = _rotations(bodies)
    hinges: list[Array] = []
    slides: list[Array] = []
    at: str | None = body
    while at is not None:
        it = known[at]
        if it.kind in ROTATIONS:
            return None
        if it.moves:
            axis = np.asarray(it.axis) / np.linalg.norm(np.asarray(it.axis))
            (hinges if it.kind == "hinge" else slides).append(turns[at] @ axis)
        at = it.parent
    return hinges[::-1], slides[::-1]


def _rotations(bodies: Sequence[Body]) -> dict[str | None, Array]:
    """Return the axes of all bodies at their references, in axes of the world."""
    turns: dict[str | None, Array] = {None: np.eye(3)}
    for it in bodies:
        turns[it.name] = turns[it.parent] @ np.asarray(it.rotation)
    return turns


# Controls that act on joints.


def inputs_of_tree(given: Any, coordinates: Sequence[str]) -> ControlInputs:
    """Read inputs: by column (see `MechanicalSystem`), by joint or by joints with gears."""
    if isinstance(given, Mapping):
        given = {name: _column(name, it, coordinates) for name, it in given.items()}
    inputs = control_inputs(given)
    if isinstance(inputs.matrix, np.ndarray) and len(inputs.matrix) != len(coordinates):
        raise ValueError(
            f"inputs must have {len(coordinates)} rows, one for each joint, got "
            f"{len(inputs.matrix)}"
        )
    return inputs


def _column(name: Any, given: Any, coordinates: Sequence[str]) -> Any:
    """Return the forces on the coordinates for a control of 1."""
    gears = {given: 1.0} if isinstance(given, str) else given
    if not isinstance(gears, Mapping):
        return given
    column = np.zeros(len(coordinates))
    for joint, gear in gears.items():
        if joint not in coordinates:
            raise ValueError(
                f"inputs[{name!r}] names {joint!r}: there are {', '.join(sorted(coordinates))}"
            )
        column[list(coordinates).index(joint)] = real_array(f"inputs[{name!r}]", gear)
    return column


# Constraints of trees: connected points, welded bodies, joints that are driven or coupled.


@dataclasses.dataclass(frozen=True, eq=False)
class Connect:
    """A joint that closes a chain: points of two bodies coincide.

    Three equality rows, along the axes of the world.

    Parameters
    ----------
    body : str
        A body of the `zivi.Tree`.
    other : str, optional
        The other body. Default: the world.
    point : array_like
        The point in the frame of `body` (m), of shape (3,). Default: its origin.
    other_point : array_like, optional
        The point in the frame of `other` (m). Default: where `point` is at coordinates of zero.
    name : str, optional
        Name of the rows, ``name.x``, ``name.y``, ``name.z``. Default: ``body-other``.

    Raises
    ------
    ValueError, TypeError
        If a point is not three finite numbers, or both are points of one body.

    Examples
    --------
    A four-bar linkage: two cranks of 1 m and the rod between them.

    >>> from zivi.mechanics import Body, Connect
    >>> link = dict(axis=[0, 1, 0], mass=1.0, com=[0, 0, 0.5], inertia=0.1)
    >>> bars = [
    ...     Body("left", **link),
    ...     Body("rod", "left", position=[0, 0, 1], reference=-np.pi / 2, **link),
    ...     Body("right", position=[1, 0, 0], **link),
    ... ]
    >>> frame = zivi.Tree(bars, constraints=[Connect("rod", "right", point=[0, 0, 1])])
    >>> sol = zivi.simulate(frame, (0, 1), zivi.consistent(frame, [0.1, -0.1, 0.1]))
    >>> bool(np.abs(sol.q[:, 0] - sol.q[:, 2]).max() < 1e-12)  # a parallelogram
    True
    """

    body: str
    other: str | None = None
    point: ArrayLike = (0.0, 0.0, 0.0)
    other_point: ArrayLike | None = None
    name: str | None = None

    def __post_init__(self) -> None:
        _read_points(self)


@dataclasses.dataclass(frozen=True, eq=False)
class Weld:
    """Two bodies that are fixed to each other.

    Six equality rows: three of `Connect`, and three of the relative rotation.

    Parameters
    ----------
    body, other, point, other_point, name
        As for `Connect`; the rows of the rotation are ``name.rx``, ``name.ry`` and ``name.rz``.
    rotation : array_like, optional
        The axes of `body` in the frame of `other`, as the columns of a rotation of shape (3, 3).
        Default: as at coordinates of zero.

    Raises
    ------
    ValueError, TypeError
        As for `Connect`, or if the rotation is none.

    Examples
    --------
    >>> zivi.mechanics.Weld("hand", "tool").body
    'hand'
    """

    body: str
    other: str | None = None
    point: ArrayLike = (0.0, 0.0, 0.0)
    other_point: ArrayLike | None = None
    rotation: ArrayLike | None = None
    name: str | None = None

    def __post_init__(self) -> None:
        _read_points(self)
        if self.rotation is None:
            return
        given = real_array(f"rotation of weld {self.body!r}", self.rotation)
        good = given.shape == (3, 3) and np.allclose(given.T @ given, np.eye(3), atol=1e-9)
        if not good or np.linalg.det(given) < 0.0:
            raise ValueError(
                f"rotation of weld {self.body!r} must be a rotation of shape (3, 3), "
                f"got {given.tolist()}"
            )
        object.__setattr__(self, "rotation", given)


@dataclasses.dataclass(frozen=True, eq=False)
class Drive:
    """A joint whose coordinate moves as prescribed.

    One equality row; its multiplier is the torque of the drive (N m), or its force (N).

    Parameters
    ----------
    joint : str
        The coordinate.
    motion : Table, HarmonicWall or str
        The coordinate as a function of time: a table of kind "cubic" or "monotone", a harmonic
        motion, or a formula in ``t`` (s), such as ``"3*t"``.
    name : str, optional
        Name of the row. Default: ``joint.drive``.

    Raises
    ------
    ValueError, TypeError
        If the motion is none of these, or not smooth.

    Examples
    --------
    >>> arm = zivi.mechanics.Body("arm", mass=1.0, inertia=0.1)
    >>> tree = zivi.Tree([arm], constraints=[zivi.mechanics.Drive("arm", "0.2*sin(5*t)")])
    >>> start = zivi.consistent(tree, [0.0])
    >>> float(start[1][0])
    1.0
    """

    joint: str
    motion: Table | HarmonicWall | str
    name: str | None = None

    def __post_init__(self) -> None:
        if isinstance(self.motion, Table):
            self.motion._wall(f"motion of joint {self.joint!r}")
        elif not isinstance(self.motion, HarmonicWall | str):
            raise TypeError(
                f"motion of joint {self.joint!r} must be a zivi.Table, a zivi.HarmonicWall or a "
                f"formula in t, got {self.motion!r}"
            )


@dataclasses.dataclass(frozen=True, eq=False)
class Couple:
    r"""A joint that follows another one, such as a gear.

    .. math:: q - q_0 = \sum_{k=0}^4 c_k (p - p_0)^k

    Parameters
    ----------
    joint : str
        The coordinate :math:`q`.
    other : str, optional
        The coordinate :math:`p`. Default: none, the joint is held at :math:`q_0 + c_0`.
    coefficients : sequence of float
        :math:`c_0` to :math:`c_4`, at most five. Default (0, 1).
    reference, other_reference : float
        :math:`q_0` and :math:`p_0`.
    name : str, optional
        Name of the row. Default: ``joint.couple``.

    Raises
    ------
    ValueError, TypeError
        If a number is not finite or there are more than five coefficients.

    Examples
    --------
    >>> zivi.mechanics.Couple("wheel", "pinion", coefficients=(0.0, -0.5)).joint
    'wheel'
    """

    joint: str
    other: str | None = None
    coefficients: Sequence[float] = (0.0, 1.0)
    reference: float = 0.0
    other_reference: float = 0.0
    name: str | None = None

    def __post_init__(self) -> None:
        given = np.atleast_1d(real_array(f"coefficients of {self.joint!r}", self.coefficients))
        if given.ndim != 1 or not 1 <= len(given) <= 5 or not np.isfinite(given).all():
            raise ValueError(
                f"coefficients of joint {self.joint!r} must be one to five finite numbers, got "
                f"{given.tolist()}"
            )
        object.__setattr__(self, "coefficients", tuple(given.tolist()))
        for field in ("reference", "other_reference"):
            value = finite(f"{field} of joint {self.joint!r}", getattr(self, field))
            object.__setattr__(self, field, value)
        if self.other == self.joint:
            raise ValueError(f"other of joint {self.joint!r} must be another joint")


TreeConstraint: TypeAlias = Connect | Weld | Drive | Couple
"""Equality rows of a tree."""


def _read_points(it: Connect | Weld) -> None:
    called = f"of the constraint of body {it.body!r}"
    if it.other == it.body:
        raise ValueError(f"other {called} must be another body")
    for field in ("point", "other_point"):
        given = getattr(it, field)
        if given is not None:
            object.__setattr__(it, field, vector(f"{field} {called}", given))


# The rows of a tree in the form of the extension.


@dataclasses.dataclass(frozen=True, eq=False)
class ConstraintRows:
    """The constraints of a tree with their values at coordinates of zero.

    Parameters
    ----------
    given : tuple of TreeConstraint
        The constraints.
    names : tuple of str
        Names of the rows.
    core : list
        Kind and joints of each constraint, -1 for the world.
    own : list
        For each constraint its numbers: points and axes in frames of bodies.
    drives : list
        Numbers of rows and the motions that they follow.
    native : list
        Numbers of rows and compiled formulas of time.
    """

    given: tuple[TreeConstraint, ...] = ()
    names: tuple[str, ...] = ()
    core: Sequence[tuple[str, int, int]] = ()
    own: Sequence[tuple[Any, ...]] = ()
    drives: Sequence[tuple[int, Table | HarmonicWall]] = ()
    native: Sequence[tuple[int, Native]] = ()

    def numbers(self, frames: Mapping[str | None, Any]) -> list[Any]:
        """Return the numbers of the constraints, with points in the frames of joints."""
        rows = []
        for it, own in zip(self.given, self.own, strict=True):
            if isinstance(it, Drive | Couple):
                rows.append(np.array(own))
                continue
            first, second = frames[it.body], frames[it.other]
            point, other_point, *axes = own
            row = [
                first.position + first.rotation @ point,
                second.position + second.rotation @ other_point,
            ]
            if axes:
                row += [(first.rotation @ axes[0]).T.ravel(), (second.rotation @ axes[1]).T.ravel()]
            rows.append(np.concatenate(row))
        return rows


def rows_of_constraints(given: Any, bodies: Sequence[Body]) -> ConstraintRows:
    """Read the constraints of a tree; an error names the constraint."""
    constraints = tuple(given)
    moving = [body for body in bodies if body.moves]
    joints = {body.joint: i for i, body in enumerate(moving)}
    poses, carriers = _poses_at_zero(bodies)
    names, core, own = [], [], []
    drives: list[tuple[int, Any]] = []
    native: list[tuple[int, Native]] = []
    for i, it in enumerate(constraints):
        if isinstance(it, Connect | Weld):
            for name in (it.body, it.other):
                if name not in poses:
                    raise ValueError(
                        f"constraints[{i}] names {name!r}: there are {_body_names(bodies)}"
                    )
            at = carriers[it.body], carriers[it.other]
            if at[0] == at[1]:
                raise ValueError(
                    f"constraints[{i}] is between bodies that never move to each other"
                )
            core.append(("connect" if isinstance(it, Connect) else "weld", *at))
            own.append(_numbers_in_frames(it, poses))
            called = it.name or f"{it.body}-{it.other or 'world'}"
            axes = "xyz" if isinstance(it, Connect) else ("x", "y", "z", "rx", "ry", "rz")
            names += [f"{called}.{axis}" for axis in axes]
        elif isinstance(it, Drive | Couple):
            other = it.other if isinstance(it, Couple) else None
            for name in (it.joint, other):
                if name is not None and name not in joints:
                    known = ", ".join(joints)
                    raise ValueError(f"constraints[{i}] names {name!r}: there are {known}")
            core.append(("joint", joints[it.joint], -1 if other is None else joints[other]))
            if isinstance(it, Drive):
                own.append((0.0,) * 7)
                row = len(names)
                if isinstance(it.motion, str):
                    native.append((row, _time_formula(it.joint, it.motion)))
                else:
                    drives.append((row, it.motion))
            else:
                padded = [*it.coefficients, *[0.0] * (5 - len(it.coefficients))]
                own.append((it.reference, it.other_reference, *padded))
            names.append(it.name or f"{it.joint}.{'drive' if isinstance(it, Drive) else 'couple'}")
        else:
            raise TypeError(
                f"constraints[{i}] must be a Connect, Weld, Drive or Couple of zivi.mechanics, "
                f"got {it!r}"
            )
    return ConstraintRows(constraints, tuple(names), core, own, drives, native)


def _body_names(bodies: Sequence[Body]) -> str:
    return ", ".join(sorted(body.name for body in bodies))


def _numbers_in_frames(
    it: Connect | Weld, poses: Mapping[str | None, tuple[Array, Array]]
) -> tuple[Any, ...]:
    """Return points, and of a weld axes, in the frames of the bodies."""
    (turn, place), (other_turn, other_place) = poses[it.body], poses[it.other]
    point = np.asarray(it.point)
    other_point = it.other_point
    if other_point is None:
        other_point = other_turn.T @ (place + turn @ point - other_place)
    if isinstance(it, Connect):
        return point, np.asarray(other_point)
    axes = other_turn.T @ turn if it.rotation is None else np.asarray(it.rotation)
    return point, np.asarray(other_point), np.eye(3), axes


def _poses_at_zero(
    bodies: Sequence[Body],
) -> tuple[dict[str | None, tuple[Array, Array]], dict[str | None, int]]:
    """Return the axes and origins of the bodies at coordinates of zero, and their joints."""
    poses: dict[str | None, tuple[Array, Array]] = {None: (np.eye(3), np.zeros(3))}
    carriers: dict[str | None, int] = {None: -1}
    count = 0
    for body in bodies:
        turn, place = poses[body.parent]
        place = place + turn @ np.asarray(body.position)
        turn = turn @ np.asarray(body.rotation)
        axis, anchor = np.asarray(body.axis), np.asarray(body.anchor)
        axis = axis / np.linalg.norm(axis)
        if body.kind == "slide":
            place = place - turn @ axis * body.reference
        elif body.kind == "hinge":
            turned = turn @ _rotation_about(axis, -body.reference)
            place = place + turn @ anchor - turned @ anchor
            turn = turned
        poses[body.name] = turn, place
        carriers[body.name] = count if body.moves else carriers[body.parent]
        count += body.moves
    return poses, carriers


def _rotation_about(axis: Array, angle: float) -> Array:
    """Return the rotation about an axis (Rodrigues)."""
    x, y, z = axis
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    turned: Array = np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross
    return turned


def _time_formula(joint: str, formula: str) -> Native:
    """Compile a formula of time with its first two derivatives."""
    sympy = needed("sympy", "formulas of drives")
    t = sympy.Symbol("t", real=True)
    try:
        place = expression(formula, {"t": t})
    except UnknownNameError as error:
        raise FormulaError(
            f"motion of joint {joint!r} has {error.name}, which is not the time t"
        ) from None
    except FormulaError as error:
        raise FormulaError(f"motion of joint {joint!r} must be a formula in t: {error}") from None
    entries = [sympy.sympify(it) for it in (place, place.diff(t), place.diff(t, 2))]
    return compile_model({"c": c_source(entries), "numba": python_source(entries)}, "auto")
