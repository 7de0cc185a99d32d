"""Gaps between the geoms of MuJoCo's models."""

from __future__ import annotations

import dataclasses
import warnings
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np

from zivi.base.check import Array
from zivi.base.status import ModelWarning
from zivi.interop.mujoco.refusals import element_name, is_off
from zivi.system.tree import Tree
from zivi.system.tree_bodies import (
    BallGap,
    Body,
    JointLimit,
    PlaneGap,
    TreeGap,
    coordinates_of_body,
    is_rough,
    tangents_of,
)

CHOICES = ("read", "refuse", "ignore")
"""What becomes of the friction of a model."""


def rotation_of(quat: Any) -> Array:
    """Return the rotation matrix of a quaternion."""
    import mujoco

    out = np.empty(9)
    mujoco.mju_quat2Mat(out, np.asarray(quat, np.float64))
    return out.reshape(3, 3)


# Joints, pairs of geoms and gaps of zivi as the gaps of a system.


def read_gaps(
    model: Any, gaps: Sequence[Any] | str | None, friction: str, bodies: Sequence[Body] = ()
) -> list[TreeGap]:
    """Read joints, pairs of geoms and gaps of zivi; all limits by default.

    With the bodies of a tree, points of a geom with friction that are always equally far from a
    plane become one gap; for ``"all"``, all such points do.
    """
    if friction not in CHOICES:
        raise ValueError(f"friction must be one of {', '.join(CHOICES)}, got {friction!r}")
    joints = {element_name(model, "joint", i): i for i in range(model.njnt)}
    off = is_off(model, "LIMIT")
    limited = [name for name, i in joints.items() if model.jnt_limited[i] and not off]
    every = isinstance(gaps, str) and gaps == "all"
    if gaps is None:
        gaps = limited
    elif isinstance(gaps, str):
        gaps = [*limited, *_above_planes(model)] if every else [gaps]
    geoms = {element_name(model, "geom", i): i for i in range(model.ngeom)}
    found: list[TreeGap] = []
    for i, given in enumerate(gaps):
        if isinstance(given, str):
            if given not in joints:
                raise ValueError(f"gaps[{i}] must be a joint, got {given!r}: {', '.join(joints)}")
            found.append(_joint_limit(model, given, joints[given]))
        elif isinstance(given, JointLimit | PlaneGap | BallGap):
            found.append(given)
        else:
            where = f"gaps[{i}]"
            pair = _named(where, given, geoms)
            several = _of_pair(model, where, pair, friction, bodies)
            rough = any(map(is_rough, several))
            if rough and bodies:
                _refuse_torsion(model, pair, several[0], bodies)
            found += _distinct(bodies, several) if bodies and rough and not every else several
    return _distinct(bodies, found) if bodies and every else found


def _distinct(bodies: Sequence[Body], gaps: Sequence[TreeGap]) -> list[TreeGap]:
    """Leave out points above planes that are as far as another one before, wherever the bodies are.

    The front and back corners of a box coincide in planar motion, and the end of a leg may coincide
    with a point of the trunk.
    """
    above = [(i, gap) for i, gap in enumerate(gaps) if isinstance(gap, PlaneGap)]
    if len(above) < 2:
        return list(gaps)
    smooth = [
        dataclasses.replace(gap, mu=0.0, mu_static=None, name=f"point{i}") for i, gap in above
    ]
    tree, rng = Tree(bodies, gaps=smooth), np.random.default_rng(0)
    places = rng.normal(size=(3, len(tree.coordinate_names(0))))
    values = np.array([tree.at(0.0, q, np.zeros_like(q)).gaps for q in places]).T
    kept: list[int] = []
    for k, value in enumerate(values):
        if np.all([np.max(np.abs(value - values[other])) > 1e-9 for other in kept]):
            kept.append(k)
    again = {i for k, (i, _) in enumerate(above) if k not in kept}
    return [gap for i, gap in enumerate(gaps) if i not in again]


def _above_planes(model: Any) -> Iterator[tuple[str, str]]:
    """Yield the pairs of a moving geom and a plane that may touch."""
    import mujoco

    if is_off(model, "CONTACT"):
        return
    plane = int(mujoco.mjtGeom.mjGEOM_PLANE)
    is_plane = np.asarray(model.geom_type) == plane
    bodies = np.asarray(model.geom_bodyid)
    moves = np.asarray(model.body_weldid)[bodies] != 0
    excluded = {(int(it) >> 16, int(it) & 0xFFFF) for it in model.exclude_signature}
    for geom in np.flatnonzero(moves & ~is_plane):
        for other in np.flatnonzero(is_plane & ~moves):
            pair = int(geom), int(other)
            between = int(min(bodies[[*pair]])), int(max(bodies[[*pair]]))
            masks = (model.geom_contype[list(pair)] & model.geom_conaffinity[list(pair[::-1])]) != 0
            if _explicit(model, pair) is not None or (masks.any() and between not in excluded):
                yield element_name(model, "geom", pair[0]), element_name(model, "geom", pair[1])


def _joint_limit(model: Any, name: str, joint: int) -> JointLimit:
    """Read the limits of a joint; their margin says only where MuJoCo's soft force begins."""
    if not model.jnt_limited[joint]:
        raise ValueError(f"joint {name!r} is not limited")
    lower, upper = model.jnt_range[joint]
    return JointLimit(name, float(lower), float(upper))


def _named(where: str, given: Any, geoms: dict[str, int]) -> tuple[int, int]:
    if not (isinstance(given, tuple | list) and len(given) == 2):
        raise TypeError(f"{where} must be a joint, a pair of geoms or a gap, got {given!r}")
    for name in given:
        if name not in geoms:
            raise ValueError(f"{where} names the geom {name!r}: there are {', '.join(geoms)}")
    return geoms[given[0]], geoms[given[1]]


def _of_pair(
    model: Any, where: str, pair: tuple[int, int], friction: str, bodies: Sequence[Body]
) -> list[TreeGap]:
    import mujoco

    names = [element_name(model, "geom", geom) for geom in pair]
    called = f"{names[0]}-{names[1]}"
    _refuse_contact(model, called, pair)
    mu = _coefficient(model, called, pair, friction)
    plane, sphere = int(mujoco.mjtGeom.mjGEOM_PLANE), int(mujoco.mjtGeom.mjGEOM_SPHERE)
    kinds = [int(model.geom_type[geom]) for geom in pair]
    if kinds[1] != plane and kinds[0] == plane:
        pair, kinds = pair[::-1], kinds[::-1]
    if kinds[1] == plane and kinds[0] != plane:
        return _above_plane(model, called, pair, mu, bodies)
    if kinds == [sphere, sphere]:
        if mu:
            raise NotImplementedError(
                f"friction of pairs is not supported: {called!r}; friction must belong to geoms "
                "above planes; friction='ignore' leaves it out"
            )
        (one, radius), (other, more) = (_balls(model, geom) for geom in pair)
        first, second = (_body(model, geom) for geom in pair)
        centers = one[0], other[0]
        if first is None:
            first, second, centers = second, first, centers[::-1]
        if first is None:
            raise ValueError(f"{where}: neither {names[0]!r} nor {names[1]!r} moves")
        return [BallGap(first, centers[0], second, centers[1], radius + more, called)]
    told = " and ".join(mujoco.mjtGeom(int(kind)).name[7:].lower() for kind in kinds)
    raise NotImplementedError(
        f"gaps between {told} are not supported: {called!r}; use spheres, capsules, boxes, "
        "rolling cylinders or meshes above planes, or spheres beside spheres"
    )


# Friction and other properties of a contact.


def _explicit(model: Any, pair: tuple[int, int]) -> int | None:
    """Find the element ``pair`` of two geoms."""
    for i in range(model.npair):
        if {int(model.pair_geom1[i]), int(model.pair_geom2[i])} == set(pair):
            return i
    return None


def _coefficient(model: Any, called: str, pair: tuple[int, int], friction: str) -> float:
    """Return the coefficient of friction: the greater one, or that of the geom with priority."""
    if (own := _explicit(model, pair)) is not None:
        dimension, of = int(model.pair_dim[own]), np.array(model.pair_friction[own])
        both, rolling = of[:2], of[3:]
    else:
        priority = np.asarray(model.geom_priority)[[*pair]]
        first = np.flatnonzero(priority == priority.max())
        dimension = int(np.max(model.geom_condim[[*pair]][first]))
        of = np.max(np.array(model.geom_friction[[*pair]])[first], axis=0)
        both, rolling = of[[0, 0]], of[2:]
    if dimension == 1 or not np.any(both) or friction == "ignore":
        return 0.0
    if friction == "refuse":
        raise NotImplementedError(
            f"friction of pairs is not supported: {called!r}; friction='ignore' leaves it out, "
            "condim='1' of both geoms disables it"
        )
    if both[0] != both[1]:
        raise NotImplementedError(
            f"friction that differs by direction is not supported: pair {called!r}; set its first "
            "two friction numbers equal"
        )
    if dimension == 6 and np.any(rolling):
        raise NotImplementedError(
            f"rolling friction is not supported: {called!r}; condim='3' is sliding friction alone"
        )
    return float(both[0])


def _refuse_torsion(
    model: Any, pair: tuple[int, int], gap: TreeGap, bodies: Sequence[Body]
) -> None:
    """Reject friction about the normal of a body that moves in space."""
    if (own := _explicit(model, pair)) is not None:
        dimension, torsion = int(model.pair_dim[own]), float(model.pair_friction[own][2])
    else:
        priority = np.asarray(model.geom_priority)[[*pair]]
        first = np.flatnonzero(priority == priority.max())
        dimension = int(np.max(model.geom_condim[[*pair]][first]))
        torsion = float(np.max(np.array(model.geom_friction[[*pair]])[first, 1]))
    inner = [it for body in bodies for it in coordinates_of_body(body)]
    in_space = isinstance(gap, PlaneGap) and len(tangents_of(inner, gap)) == 2
    if dimension >= 4 and torsion != 0.0 and in_space:
        called = "-".join(element_name(model, "geom", geom) for geom in pair)
        raise NotImplementedError(
            f"torsional friction is not supported: {called!r}; condim='3' is sliding friction alone"
        )


def _refuse_contact(model: Any, called: str, pair: tuple[int, int]) -> None:
    """Reject what a gap does not have; a margin says where MuJoCo's soft force begins."""
    own = _explicit(model, pair)
    values = {
        field: np.asarray(getattr(model, f"geom_{field}"))[[*pair]]
        if own is None
        else np.asarray(getattr(model, f"pair_{field}"))[own]
        for field in ("margin", "adhesion")
    }
    if np.any(values["adhesion"] != 0):
        raise NotImplementedError(
            f"adhesion of geoms is not supported: {called!r}; set adhesion='0'"
        )
    if (margin := float(np.sum(values["margin"]))) != 0.0:
        warnings.warn(
            f"the margin of {called!r}, {margin:g} m, is left out: contact is at the surfaces",
            ModelWarning,
            stacklevel=8,
        )
    if np.any(np.asarray(model.geom_surfacevel)[[*pair]] != 0):
        raise NotImplementedError(
            f"surface velocities in pairs are not supported: {called!r}; set surfacevel='0 0 0'"
        )


# Points and balls of geoms above planes.


def _body(model: Any, geom: int) -> str | None:
    body = int(model.geom_bodyid[geom])
    return None if body == 0 else element_name(model, "body", body)


def _above_plane(
    model: Any, called: str, pair: tuple[int, int], mu: float, bodies: Sequence[Body]
) -> list[TreeGap]:
    """Return the gaps of the balls of a geom above a plane."""
    geom, plane = pair
    if model.body_weldid[model.geom_bodyid[plane]] != 0:
        raise NotImplementedError(
            f"moving planes are not supported: {called!r}; fix the plane to the world"
        )
    body = _body(model, geom)
    if body is None:
        raise ValueError(f"{called!r}: neither geom moves")
    # of a body that is fixed to the world
    rotation, origin = np.eye(3), np.array(model.geom_pos[plane])
    rotation = rotation_of(model.geom_quat[plane])
    at = int(model.geom_bodyid[plane])
    while at:
        turn = rotation_of(model.body_quat[at])
        rotation, origin = turn @ rotation, model.body_pos[at] + turn @ origin
        at = int(model.body_parentid[at])
    normal = rotation[:, 2]
    rolls = int(model.geom_type[geom]) == CYLINDER
    points, radius = _cylinder_ends(model, geom) if rolls else _balls(model, geom)
    one = len(points) == 1
    gaps = [
        PlaneGap(
            body,
            point,
            normal,
            float(normal @ origin),
            radius,
            called if one else f"{called}.{k}",
            mu=mu,
        )
        for k, point in enumerate(points)
    ]
    if not rolls:
        return list(gaps)
    if not bodies or len(_distinct(bodies, gaps)) > 1:
        raise NotImplementedError(
            f"gaps of a cylinder that tilts are not supported: {called!r}, whose rim touches the "
            "plane; use the type capsule, or keep its axis parallel to the plane"
        )
    middle = (points[0] + points[1]) / 2
    return [dataclasses.replace(gaps[0], point=middle, name=called)]


CYLINDER = 5
"""The kind of geoms that are cylinders (mjGEOM_CYLINDER)."""


def _cylinder_ends(model: Any, geom: int) -> tuple[list[Array], float]:
    """Return the middles of both ends of a cylinder, in the frame of its body, and its radius."""
    radius, half = model.geom_size[geom][:2]
    axis = rotation_of(model.geom_quat[geom])[:, 2]
    return [np.array(model.geom_pos[geom]) + k * half * axis for k in (-1, 1)], float(radius)


def _balls(model: Any, geom: int) -> tuple[list[Array], float]:
    """Return the balls of which a geom is the hull, in the frame of its body."""
    import mujoco

    kinds, kind = mujoco.mjtGeom, int(model.geom_type[geom])
    size, origin = np.array(model.geom_size[geom]), np.array(model.geom_pos[geom])
    rotation = rotation_of(model.geom_quat[geom])
    of: dict[int, Callable[[], tuple[Any, float]]] = {
        int(kinds.mjGEOM_SPHERE): lambda: ([[0, 0, 0]], size[0]),
        int(kinds.mjGEOM_CAPSULE): lambda: ([[0, 0, -size[1]], [0, 0, size[1]]], size[0]),
        int(kinds.mjGEOM_BOX): lambda: (size * np.array(CORNERS), 0.0),
        int(kinds.mjGEOM_MESH): lambda: (_vertices(model, geom), 0.0),
    }
    if kind not in of:
        told = mujoco.mjtGeom(kind).name[7:].lower()
        raise NotImplementedError(
            f"gaps of a {told} are not supported: geom {element_name(model, 'geom', geom)!r}; use "
            "the type sphere, capsule, box, cylinder or mesh"
        )
    points, radius = of[kind]()
    return [origin + rotation @ np.asarray(point) for point in points], float(radius)


CORNERS = [[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]


def _vertices(model: Any, geom: int) -> Array:
    mesh = int(model.geom_dataid[geom])
    start, count = int(model.mesh_vertadr[mesh]), int(model.mesh_vertnum[mesh])
    return np.unique(np.asarray(model.mesh_vert[start : start + count], np.float64), axis=0)
