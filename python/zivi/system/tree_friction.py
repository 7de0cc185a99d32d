"""Dry friction of trees: in joints and between bodies and fixed planes."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from zivi.base.check import Array, finite, real_array
from zivi.system.gap import Channel, DryFriction
from zivi.system.mechanism import ControlInputs, control_inputs
from zivi.system.tree_bodies import ROTATIONS, BallGap, Body, PlaneGap, TreeGap, is_rough

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
