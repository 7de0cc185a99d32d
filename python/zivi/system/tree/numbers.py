"""The numbers of a tree in the order in which the extension takes them, from named values."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from zivi.base.check import Array
from zivi.system.tree.body import Body, body_values, joint_values
from zivi.system.tree.gaps import BallGap, JointLimit, PlaneGap, TreeGap

__all__ = ["Side", "Structure", "ordered"]

INERTIA = ((0, 1, 2, 0, 0, 1), (0, 1, 2, 1, 2, 2))
"""Rows and columns of the entries xx, yy, zz, xy, xz, yz."""


@dataclasses.dataclass(frozen=True)
class Side:
    """One gap: its kind, name and joints (-1 for the world), and what it is made of."""

    kind: str
    name: str
    joints: tuple[int, int]
    gap: TreeGap


@dataclasses.dataclass(frozen=True)
class Frame:
    """The frame of a body in that of the joint that moves it (-1 for the world)."""

    joint: int
    rotation: Array
    position: Array


@dataclasses.dataclass(frozen=True)
class Structure:
    """Bodies and gaps of a tree.

    Parameters
    ----------
    bodies : sequence of Body
        Parents before children.
    gaps : sequence of TreeGap
        The gaps.
    """

    bodies: tuple[Body, ...]
    gaps: tuple[TreeGap, ...]

    @property
    def moving(self) -> list[Body]:
        """The bodies that have a coordinate."""
        return [body for body in self.bodies if body.moves]

    def values(self, gravity: Array) -> dict[str, float]:
        """Names and values of all that can change."""
        values = {f"gravity.{k}": float(gravity[i]) for i, k in enumerate("xyz")}
        for body in self.bodies:
            values |= body_values(body) | joint_values(body)
        for side in self.sides():
            values |= _of_side(side)
        return values

    def carriers(self) -> dict[str, int]:
        """Give the joint that moves each body, -1 for the world."""
        joints: dict[str | None, int] = {None: -1}
        count = 0
        for body in self.bodies:
            joints[body.name] = count if body.moves else joints[body.parent]
            count += body.moves
        return {name: joint for name, joint in joints.items() if name is not None}

    def joints(self) -> list[tuple[int, bool]]:
        """Give the parent of each joint, and whether it is a slide."""
        carriers = self.carriers()
        return [
            (-1 if body.parent is None else carriers[body.parent], body.kind == "slide")
            for body in self.moving
        ]

    def sides(self) -> list[Side]:
        """Give the gaps one by one."""
        carriers = self.carriers()
        places = {body.joint: i for i, body in enumerate(self.moving)}
        found = []
        for gap in self.gaps:
            if isinstance(gap, JointLimit):
                for side in ("lower", "upper"):
                    if getattr(gap, side) is not None:
                        at = (places[gap.joint], -1)
                        found.append(Side(side, f"{gap.joint}.{side}", at, gap))
            elif isinstance(gap, PlaneGap):
                at = (carriers[gap.body], -1)
                found.append(Side("plane", gap.name or gap.body, at, gap))
            else:
                other = -1 if gap.other is None else carriers[gap.other]
                at = (carriers[gap.body], other)
                found.append(Side("balls", gap.name or gap.body, at, gap))
        return found

    def numbers(self, values: Mapping[str, Any]) -> Any:
        """Give the numbers, complex ones of complex values."""
        kind = np.result_type(np.float64, *(type(value) for value in values.values()))
        frames, placements = self._frames(values, kind)
        masses: list[list[Any]] = [[] for _ in placements]
        for body in self.bodies:
            frame = frames[body.name]
            if frame.joint >= 0:
                masses[frame.joint].append(_mass(body, frame, values, kind))
        rows = [_vector(values, "gravity", kind)]
        for body, placement, mass in zip(self.moving, placements, masses, strict=True):
            of_joint = [values[name] for name in joint_values(body)]
            rows += [*placement, np.sum(mass, axis=0), np.array([*of_joint, body.reference])]
        rows += [_gap(side, frames, values) for side in self.sides()]
        return np.concatenate(rows)

    def directions(self, values: Mapping[str, float]) -> Array:
        """Give the derivatives of the numbers by each value, to rounding, by complex steps."""
        tiny = 1e-40
        rows = [self.numbers({**values, name: values[name] + 1j * tiny}) for name in values]
        return np.imag(np.array(rows)) / tiny

    def _frames(
        self, values: Mapping[str, Any], kind: Any
    ) -> tuple[dict[str | None, Frame], list[list[Any]]]:
        """Follow the frames of the bodies; origin and axes of the joints in those before them."""
        frames: dict[str | None, Frame] = {None: Frame(-1, np.eye(3), np.zeros(3, kind))}
        placements: list[list[Any]] = []
        for body in self.bodies:
            parent = frames[body.parent]
            rotation = parent.rotation @ np.asarray(body.rotation)
            position = _vector(values, f"{body.name}.position", kind)
            origin = parent.position + parent.rotation @ position
            if not body.moves:
                frames[body.name] = Frame(parent.joint, rotation, origin)
                continue
            turned, anchor = _towards(np.asarray(body.axis)), np.asarray(body.anchor)
            placements.append([origin + rotation @ anchor, (rotation @ turned).T.ravel()])
            own = Frame(len(placements) - 1, turned.T, -turned.T @ anchor)
            frames[body.name] = own
        return frames, placements


def _towards(axis: Array) -> Array:
    """Give axes of which the third is along an axis, those of the body as far as it is one."""
    unit = axis / np.linalg.norm(axis)
    k = int(np.argmax(np.abs(unit)))
    if abs(unit[k]) == 1.0:
        third, first = unit, np.roll(np.eye(3)[k], 1)
    else:
        third, first = unit, np.cross(np.eye(3)[int(np.argmin(np.abs(unit)))], unit)
        first /= np.linalg.norm(first)
    return np.column_stack([first, np.cross(third, first), third])


def _vector(values: Mapping[str, Any], name: str, kind: Any) -> Any:
    return np.array([values[f"{name}.{k}"] for k in "xyz"], dtype=kind)


def _mass(body: Body, frame: Frame, values: Mapping[str, Any], kind: Any) -> Any:
    """Give mass, first moment and inertia about the origin of the joint, ten numbers."""
    mass = values[f"{body.name}.mass"]
    c = frame.position + frame.rotation @ _vector(values, f"{body.name}.com", kind)
    entries = [values[f"{body.name}.inertia.{k}"] for k in ("xx", "yy", "zz", "xy", "xz", "yz")]
    xx, yy, zz, xy, xz, yz = entries
    own = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]], dtype=kind)
    turned = frame.rotation @ own @ frame.rotation.T
    about = turned + mass * ((c @ c) * np.eye(3) - np.outer(c, c))
    return np.array([mass, *(mass * c), *about[INERTIA]])


def _of_side(side: Side) -> dict[str, float]:
    gap = side.gap
    if isinstance(gap, JointLimit):
        return {side.name: getattr(gap, side.kind)}
    if isinstance(gap, PlaneGap):
        return {f"{side.name}.offset": gap.offset, f"{side.name}.radius": gap.radius}
    return {f"{side.name}.radius": gap.radius}


def _gap(side: Side, frames: Mapping[str | None, Frame], values: Mapping[str, Any]) -> Any:
    """Give the numbers of a gap."""
    gap = side.gap

    def own(body: str | None, point: Any) -> Any:
        frame = frames[body]
        return frame.position + frame.rotation @ np.asarray(point)

    if isinstance(gap, JointLimit):
        return np.array([values[side.name]])
    if isinstance(gap, PlaneGap):
        beyond = values[f"{side.name}.offset"] + values[f"{side.name}.radius"]
        return np.concatenate([own(gap.body, gap.point), np.asarray(gap.normal), [beyond]])
    assert isinstance(gap, BallGap)
    points = own(gap.body, gap.point), own(gap.other, gap.other_point)
    return np.concatenate([*points, [values[f"{side.name}.radius"]]])


def ordered(bodies: Sequence[Body]) -> tuple[Body, ...]:
    """Check names and parents; parents must come first."""
    known: set[str] = set()
    for body in bodies:
        if not isinstance(body, Body):
            raise TypeError(f"bodies must be zivi.mechanics.Body, got {body!r}")
        if body.name in known:
            raise ValueError(f"names of bodies must differ, got {body.name!r} twice")
        if body.parent is not None and body.parent not in known:
            raise ValueError(
                f"parent of body {body.name!r} must be a body before it, got {body.parent!r}"
            )
        known.add(body.name)
    return tuple(bodies)
