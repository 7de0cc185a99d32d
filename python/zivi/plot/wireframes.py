"""Wireframes of shapes on free bodies, for animations in space."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

if TYPE_CHECKING:
    from zivi.base.check import Array
    from zivi.simulation.mechanical_trajectory import MechanicalTrajectory

Lines: TypeAlias = Callable[[float, "Array"], Sequence[tuple[Any, ...]]]

POINTS = 33
"""Points of a circle."""
SQUARES = 6
"""Squares along an edge of the part of a plane that is drawn."""
FARTHEST = 5.0
"""Largest distance between the motion and a plane that is drawn, as a multiple of its size."""


def is_in_space(run: Any) -> bool:
    """Return whether a run has free bodies."""
    return any(is_free for _, is_free in run.config.get("rotations", {}).values())


def wireframes(
    run: MechanicalTrajectory, shapes: Mapping[str, Any] | None
) -> tuple[Lines, Lines | None]:
    """Return the lines of the bodies and of the planes of a run.

    Without shapes a body is the three axes of its frame.
    """
    free = [name for name, (_, is_free) in run.config["rotations"].items() if is_free]
    origins = np.concatenate([run.pose(name)[0] for name in free])
    low, high = origins.min(axis=0), origins.max(axis=0)
    size = max(float(np.max(high - low)), 1e-9)
    if shapes is None:
        axes = 0.1 * size * np.eye(3)
        moving = [(name, np.stack([0 * axis, axis])) for name in free for axis in axes]
        return _lines_of_bodies(run, moving), None
    moving, still = [], []
    largest = [float(np.nanmax(np.abs(_outline(it)))) for it in shapes.values()]
    size += 2 * max(largest, default=0.0)
    middle = (low + high) / 2
    for name, shape in shapes.items():
        body = getattr(shape, "body", None) or name
        if hasattr(shape, "normal"):
            away = abs(_height(shape, middle))
            if away <= FARTHEST * size:
                still += _plane_grid(shape, middle, 0.6 * max(size, away))
        elif body in free:
            moving.append((body, _outline(shape)))
        elif getattr(shape, "body", None) is None:
            still.append(_outline(shape))
        else:
            raise ValueError(
                f"shape {name!r} must be on a free body or on the world, got body {body!r}; "
                "use bodies, a function that returns lines (x, y, z)"
            )
    walls = [tuple(line.T) for line in still]
    return _lines_of_bodies(run, moving), (lambda t, q: walls) if walls else None


def _lines_of_bodies(run: MechanicalTrajectory, moving: Sequence[tuple[str, Array]]) -> Lines:
    return lambda t, q: [tuple(run._in_world(name, q, outline).T) for name, outline in moving]


def _circle(radius: float, one: Array, other: Array) -> Array:
    angles = np.linspace(0, 2 * np.pi, POINTS)[:, None]
    circle: Array = radius * (np.cos(angles) * one + np.sin(angles) * other)
    return circle


def _joined(lines: Sequence[Array]) -> Array:
    """Return lines as one with interruptions."""
    gap = np.full((1, 3), np.nan)
    return np.concatenate([part for line in lines for part in (line, gap)][:-1])


def _outline(shape: Any) -> Array:
    """Return the points of the wireframe of a shape in the frame of its body."""
    if hasattr(shape, "normal"):
        return np.zeros((1, 3))
    center = np.asarray(shape.center, dtype=float)
    if hasattr(shape, "half_extents"):
        half = np.asarray(shape.half_extents, dtype=float)
        corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1], [-1, -1]])
        faces = [np.column_stack([corners, np.full(5, z)]) for z in (-1, 1)]
        edges = [np.array([[x, y, -1], [x, y, 1]]) for x, y in corners[:4]]
        return center + half * _joined([*faces, *edges])
    if not hasattr(shape, "half_length"):
        return center + _joined(
            [_circle(shape.radius, *pair) for pair in _coordinate_planes(np.eye(3))]
        )
    along = np.asarray(shape.axis, dtype=float)
    along = along / np.linalg.norm(along)
    one, other = _across(along)
    ends = [side * shape.half_length * along for side in (-1, 1)]
    circles = [end + _circle(shape.radius, *pair) for end in ends
               for pair in _coordinate_planes(np.array([one, other, along]))]  # fmt: skip
    sides = [np.array(ends) + shape.radius * it for it in (one, -one, other, -other)]
    return center + _joined([*circles, *sides])


def _coordinate_planes(axes: Array) -> list[tuple[Array, Array]]:
    return [(axes[0], axes[1]), (axes[1], axes[2]), (axes[2], axes[0])]


def _across(normal: Array) -> tuple[Array, Array]:
    """Return two directions at right angles to a unit vector and to each other."""
    one = np.eye(3)[np.argmin(np.abs(normal))]
    one = one - normal * (normal @ one)
    one = one / np.linalg.norm(one)
    return one, np.cross(normal, one)


def _height(plane: Any, point: Array) -> float:
    return float(np.asarray(plane.normal) @ point) - float(plane.offset or 0.0)


def _plane_grid(plane: Any, near: Array, reach: float) -> list[Array]:
    """Return the grid of a plane below the motion."""
    normal = np.asarray(plane.normal, dtype=float)
    foot = near - normal * _height(plane, near)
    one, other = _across(normal)
    places = reach * np.linspace(-1, 1, SQUARES + 1)
    across = [[foot + at * one + side * reach * other for side in (-1, 1)] for at in places]
    along = [[foot + at * other + side * reach * one for side in (-1, 1)] for at in places]
    return [_joined([np.array(line) for line in (*across, *along)])]
