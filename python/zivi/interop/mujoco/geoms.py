"""Which gaps the joints and pairs of geoms of a model of MuJoCo are."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from zivi.base.check import Array
from zivi.interop.mujoco.refuse import name_of
from zivi.system.tree.gaps import BallGap, JointLimit, PlaneGap, TreeGap

__all__ = ["gaps_of", "rotation_of"]


def rotation_of(quat: Any) -> Array:
    """Give the rotation of a quaternion."""
    import mujoco

    out = np.empty(9)
    mujoco.mju_quat2Mat(out, np.asarray(quat, np.float64))
    return out.reshape(3, 3)


def gaps_of(model: Any, gaps: Sequence[Any] | None, friction: str) -> list[TreeGap]:
    """Read joints, pairs of geoms and gaps of zivi; all limits by default."""
    if friction not in ("refuse", "ignore"):
        raise ValueError(f"friction must be 'refuse' or 'ignore', got {friction!r}")
    joints = {name_of(model, "joint", i): i for i in range(model.njnt)}
    if gaps is None:
        gaps = [name for name, i in joints.items() if model.jnt_limited[i]]
    found: list[TreeGap] = []
    for i, given in enumerate([gaps] if isinstance(gaps, str) else gaps):
        if isinstance(given, str):
            if given not in joints:
                raise ValueError(f"gaps[{i}] must be a joint, got {given!r}: {', '.join(joints)}")
            found.append(_limit(model, given, joints[given]))
        elif isinstance(given, JointLimit | PlaneGap | BallGap):
            found.append(given)
        else:
            found += _of_pair(model, f"gaps[{i}]", given, friction)
    return found


def _limit(model: Any, name: str, joint: int) -> JointLimit:
    if not model.jnt_limited[joint]:
        raise ValueError(f"joint {name!r} has no limits")
    if model.jnt_margin[joint] != 0:
        raise NotImplementedError(f"zivi takes no margins of limits: joint {name!r}")
    lower, upper = model.jnt_range[joint]
    return JointLimit(name, float(lower), float(upper))


def _of_pair(model: Any, where: str, given: Any, friction: str) -> list[TreeGap]:
    import mujoco

    geoms = {name_of(model, "geom", i): i for i in range(model.ngeom)}
    if not (isinstance(given, tuple | list) and len(given) == 2):
        raise TypeError(f"{where} must be a joint, a pair of geoms or a gap, got {given!r}")
    for name in given:
        if name not in geoms:
            raise ValueError(f"{where} names the geom {name!r}: there are {', '.join(geoms)}")
    pair = [geoms[name] for name in given]
    called = f"{given[0]}-{given[1]}"
    _refuse_contact(model, called, pair, friction)
    plane, sphere = int(mujoco.mjtGeom.mjGEOM_PLANE), int(mujoco.mjtGeom.mjGEOM_SPHERE)
    kinds = [int(model.geom_type[geom]) for geom in pair]
    if kinds[1] != plane and kinds[0] == plane:
        pair, kinds = pair[::-1], kinds[::-1]
    if kinds[1] == plane and kinds[0] != plane:
        return _above_plane(model, called, *pair)
    if kinds == [sphere, sphere]:
        (one, radius), (other, more) = (_balls(model, geom) for geom in pair)
        bodies = [_body(model, geom) for geom in pair]
        points = [one[0], other[0]]
        if bodies[0] is None:
            bodies, points = bodies[::-1], points[::-1]
        if bodies[0] is None:
            raise ValueError(f"{where}: neither {given[0]!r} nor {given[1]!r} moves")
        return [BallGap(bodies[0], points[0], bodies[1], points[1], radius + more, called)]
    told = " and ".join(mujoco.mjtGeom(int(kind)).name[7:].lower() for kind in kinds)
    raise NotImplementedError(
        f"zivi takes no gaps between {told}: {called!r}; spheres, capsules, boxes and meshes above "
        "planes, and spheres beside spheres"
    )


def _refuse_contact(model: Any, called: str, pair: list[int], friction: str) -> None:
    """Refuse what a gap has not."""
    rough = max(model.geom_condim[pair]) > 1 and np.max(model.geom_friction[pair, 0]) > 0
    if rough and friction == "refuse":
        raise NotImplementedError(
            f"zivi takes no friction of pairs: {called!r}; friction='ignore' leaves it out, "
            "condim='1' of both geoms is a pair without"
        )
    for field, what in (("geom_margin", "margins"), ("geom_gap", "gaps"), ("geom_adhesion", "")):
        if np.any(np.asarray(getattr(model, field))[pair] != 0):
            raise NotImplementedError(
                f"zivi takes no {what or 'adhesion'} of geoms in pairs: {called!r}"
            )
    if np.any(np.asarray(model.geom_surfacevel)[pair] != 0):
        raise NotImplementedError(f"zivi takes no velocities of surfaces in pairs: {called!r}")


def _body(model: Any, geom: int) -> str | None:
    body = int(model.geom_bodyid[geom])
    return None if body == 0 else name_of(model, "body", body)


def _above_plane(model: Any, called: str, geom: int, plane: int) -> list[TreeGap]:
    """Give the gaps of the balls of a geom above a plane."""
    if model.body_weldid[model.geom_bodyid[plane]] != 0:
        raise NotImplementedError(f"zivi takes no planes that move: {called!r}")
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
    points, radius = _balls(model, geom)
    one = len(points) == 1
    return [
        PlaneGap(
            body, point, normal, float(normal @ origin), radius, called if one else f"{called}.{k}"
        )
        for k, point in enumerate(points)
    ]


def _balls(model: Any, geom: int) -> tuple[list[Array], float]:
    """Give the balls of which a geom is the hull, in the frame of its body."""
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
            f"zivi takes no gaps of a {told}: geom {name_of(model, 'geom', geom)!r}"
        )
    points, radius = of[kind]()
    return [origin + rotation @ np.asarray(point) for point in points], float(radius)


CORNERS = [[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]


def _vertices(model: Any, geom: int) -> Array:
    mesh = int(model.geom_dataid[geom])
    start, count = int(model.mesh_vertadr[mesh]), int(model.mesh_vertnum[mesh])
    return np.unique(np.asarray(model.mesh_vert[start : start + count], np.float64), axis=0)
