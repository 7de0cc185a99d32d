"""Models of MuJoCo (MJCF, URDF) as trees."""

from __future__ import annotations

import dataclasses
import math
import os
import re
import warnings
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from zivi.base.check import Array, real_array
from zivi.base.extras import needed
from zivi.base.status import ModelWarning
from zivi.system.impact_law import GivenRestitutions
from zivi.system.tree import Tree
from zivi.system.tree_bodies import BallGap, Body, JointLimit, PlaneGap, TreeGap

__all__ = [
    "Drive",
    "check_sizes",
    "drives",
    "element_name",
    "read_ctrl",
    "read_gaps",
    "read_mjcf",
    "read_text",
    "read_urdf",
    "refuse_for_all",
    "refuse_for_tree",
    "rotation_of",
    "tree",
]

# What a tree has not, refused by its name.


def element_name(model: Any, kind: str, index: int) -> str:
    """Give the name of an element, or one by its number."""
    return str(getattr(model, kind)(index).name) or f"{kind}{index}"


def _which(kind: str, condition: Callable[[Any], Any]) -> Callable[[Any], str | None]:
    """Find the first element for which a condition holds."""

    def found(model: Any) -> str | None:
        wrong = np.flatnonzero(np.asarray(condition(model)))
        return None if not len(wrong) else f"{kind} {element_name(model, kind, int(wrong[0]))!r}"

    return found


def _some(what: str, condition: Callable[[Any], Any]) -> Callable[[Any], str | None]:
    return lambda model: what if condition(model) else None


def _joints(field: str) -> Callable[[Any], Any]:
    """Look at a field of degrees of freedom by joint."""

    def by_joint(model: Any) -> Any:
        wrong = np.zeros(model.njnt, bool)
        rows = np.asarray(getattr(model, field)).reshape(model.nv, -1)
        np.logical_or.at(wrong, model.dof_jntid, np.any(rows != 0, axis=1))
        return wrong

    return by_joint


def _limited_drives(model: Any) -> Any:
    """Find the joints that have actuators and a limit of their force."""
    driven = np.zeros(model.njnt, bool)
    at_joints = model.actuator_trntype <= 1
    driven[model.actuator_trnid[at_joints, 0]] = True
    return driven & (model.jnt_actfrclimited != 0)


def _callbacks(_: Any) -> bool:
    import mujoco

    names = ("control", "passive", "act_gain", "act_bias", "act_dyn")
    return any(getattr(mujoco, f"get_mjcb_{name}")() is not None for name in names)


def _disabled(flag: str) -> Callable[[Any], bool]:
    def off(model: Any) -> bool:
        import mujoco

        return bool(model.opt.disableflags & getattr(mujoco.mjtDisableBit, f"mjDSBL_{flag}"))

    return off


FREE, BALL = 0, 1
FOR_ALL: dict[str, Callable[[Any], str | None]] = {
    "models without joints": _some("nv = 0", lambda model: model.nv == 0),
    "free joints (see zivi.interop.mujoco.scalar_joints)": _which(
        "joint", lambda model: model.jnt_type == FREE
    ),
    "ball joints (see zivi.interop.mujoco.scalar_joints)": _which(
        "joint", lambda model: model.jnt_type == BALL
    ),
    "equality constraints": _some("equality", lambda model: model.neq > 0),
    "friction in joints (frictionloss)": _which("joint", _joints("dof_frictionloss")),
    "friction in tendons (frictionloss)": _which("tendon", lambda m: m.tendon_frictionloss != 0),
    "limits of tendons": _which("tendon", lambda model: model.tendon_limited != 0),
    "activations of actuators": _some("na > 0", lambda model: model.na > 0),
    "delays": _some("nhistory > 0", lambda model: model.nhistory > 0),
    "plugins": _some("nplugin > 0", lambda model: model.nplugin > 0),
    "flexes": _some("nflex > 0", lambda model: model.nflex > 0),
    "springs that yield": _some("nplastic > 0", lambda model: model.nplastic > 0),
    "mocap bodies": _which("body", lambda model: model.body_mocapid >= 0),
    "callbacks of the user": _some("mjcb", _callbacks),
}
"""What neither a tree nor `system` takes: no force of a smooth mechanism in scalar coordinates."""

FOR_TREE: dict[str, Callable[[Any], str | None]] = {
    "tendons": _which("tendon", lambda model: np.ones(model.ntendon, bool)),
    "compensation of gravity (gravcomp)": _which("body", lambda model: model.body_gravcomp != 0),
    "springs that are not linear": _which("joint", lambda m: np.any(m.jnt_stiffnesspoly, axis=1)),
    "dampers that are not linear": _which("joint", _joints("dof_dampingpoly")),
    "fluids": _some("density or viscosity", lambda m: m.opt.density != 0 or m.opt.viscosity != 0),
    "limits of the forces at joints (actuatorfrcrange)": _which("joint", _limited_drives),
    "inertia of actuators": _which("actuator", lambda model: model.actuator_armature != 0),
    "damping of actuators": _which("actuator", lambda model: model.actuator_damping != 0),
    "groups of actuators that are off": _some(
        "actuatorgroupdisable", lambda model: model.opt.disableactuator != 0
    ),
    "springs that are off": _some("the flag spring", _disabled("SPRING")),
    "dampers that are off": _some("the flag damper", _disabled("DAMPER")),
    "actuators that are off": _some("the flag actuation", _disabled("ACTUATION")),
    "controls without their range": _some("the flag clampctrl", _disabled("CLAMPCTRL")),
}
"""What a tree has not, but `system` takes."""


def refuse_for_all(model: Any) -> None:
    """Refuse what is not a smooth mechanism in scalar coordinates."""
    _reject(model, FOR_ALL, "zivi takes no {what} of MuJoCo: {which}")


def refuse_for_tree(model: Any) -> None:
    """Refuse what a tree has not."""
    refuse_for_all(model)
    _reject(model, FOR_TREE, "zivi.Tree takes no {what}: {which}; zivi.interop.mujoco.system does")


def _reject(model: Any, table: dict[str, Callable[[Any], str | None]], told: str) -> None:
    for what, look in table.items():
        if (which := look(model)) is not None:
            raise NotImplementedError(told.format(what=what, which=which))


# What MuJoCo would make of a file, before it reads it: it cannot be interrupted.

ELEMENTS = 100_000
"""Elements of a model, with all copies of those that are repeated."""
LARGEST = 50_000_000
"""Characters of all files of a model."""
LIMITS: dict[tuple[str, ...], int] = {
    ("nrow", "ncol"): 10_000_000,
    ("width", "height"): 100_000_000,
    ("gridsize",): 1_000_000,
    ("dim",): 1_000_000,
}
"""Attributes whose product is a size, and the largest."""
SIZE = 10_000
"""Largest number in an element ``size``, of data for each body, joint or the like."""

TAG = re.compile(r"""<(/?)([A-Za-z_][\w.-]*+)((?:[^<>"']++|"[^"]*+"|'[^']*+')*+)>""")
ATTRIBUTE = re.compile(r"""([\w-]++)\s*+=\s*+(?:"([^"]*+)"|'([^']*+)')""")


def read_text(path: str) -> str:
    """Read a file of a model; a ValueError says why it is none."""
    try:
        with open(path, encoding="utf-8-sig") as file:
            return file.read(LARGEST + 1)
    except UnicodeDecodeError as error:
        raise ValueError(
            f"{path} must be a text in UTF-8, got the byte {error.object[error.start]:#04x}; save "
            "it in UTF-8"
        ) from None


def check_sizes(text: str, folder: str) -> None:
    """Raise a ValueError for a model, with the files that it includes, that is too large."""
    _charge(text, folder, 1, [LARGEST, ELEMENTS], ())


def _charge(text: str, folder: str, copies: int, left: list[int], files: tuple[str, ...]) -> None:
    """Take what a text holds, so many times, from the characters and elements that are left."""
    left[0] -= len(text)
    if left[0] < 0:
        raise ValueError(f"a model must have at most {LARGEST // 10**6} MB of text")
    inside: list[int] = [copies]
    for end, tag, rest in TAG.findall(_without_comments(text)):
        if end:
            if tag == "replicate" and len(inside) > 1:
                inside.pop()
            continue
        given = {name: one or other for name, one, other in ATTRIBUTE.findall(rest)}
        times = math.prod(map(_whole, given.get("count", "").split()))
        left[1] -= inside[-1] * times
        if left[1] < 0:
            raise ValueError(
                f"a model must have at most {ELEMENTS} elements with all copies, got more at "
                f"<{tag}>; lower its count"
            )
        _check_sizes(tag, given)
        file = os.path.join(folder, given.get("file", ""))
        if tag in ("include", "model") and os.path.isfile(file):
            if file in files:
                raise ValueError(f"{file} must not include itself")
            _charge(read_text(file), folder, inside[-1], left, (*files, file))
        if tag == "replicate" and not rest.endswith("/"):
            inside.append(inside[-1] * times)


def _without_comments(text: str) -> str:
    parts, at = [], 0
    while (start := text.find("<!--", at)) >= 0:
        parts.append(text[at:start])
        end = text.find("-->", start + 4)
        at = len(text) if end < 0 else end + 3
    return "".join([*parts, text[at:]])


def _check_sizes(tag: str, given: dict[str, str]) -> None:
    limits = {(name,): SIZE for name in given} if tag == "size" else LIMITS
    for names, limit in limits.items():
        sizes = [_whole(it) for name in names for it in given.get(name, "").split()]
        if sizes and math.prod(sizes) > limit:
            told = " x ".join(names)
            raise ValueError(f"<{tag}> must have {told} <= {limit}, got {math.prod(sizes)}")


def _whole(text: str) -> int:
    """Return a whole number > 0 that a text has; 1 for any other text, which MuJoCo refuses."""
    return max(1, int(text)) if text.isdecimal() and len(text) < 20 else 1


# Actuators at joints with constant controls: springs, dampers and forces.


@dataclasses.dataclass
class Drive:
    r"""What the actuators do to a joint, :math:`\tau - k q - c \dot q`."""

    torque: float = 0.0
    stiffness: float = 0.0
    damping: float = 0.0


def read_ctrl(model: Any, ctrl: Any) -> Array:
    """Read the controls."""
    if ctrl is None:
        return np.zeros(model.nu)
    given = np.atleast_1d(real_array("ctrl", ctrl))
    if given.shape != (model.nu,) or not np.all(np.isfinite(given)):
        raise ValueError(f"ctrl must be {model.nu} finite numbers, got {given.tolist()}")
    return given


def drives(model: Any, ctrl: Any) -> dict[int, Drive]:
    """Give what acts on each joint."""
    import mujoco

    given, found = read_ctrl(model, ctrl), {i: Drive() for i in range(model.njnt)}
    joints = [int(mujoco.mjtTrn.mjTRN_JOINT), int(mujoco.mjtTrn.mjTRN_JOINTINPARENT)]
    none, affine = int(mujoco.mjtBias.mjBIAS_NONE), int(mujoco.mjtBias.mjBIAS_AFFINE)
    fixed = int(mujoco.mjtGain.mjGAIN_FIXED)
    for i in range(model.nactuator):
        called = f"actuator {element_name(model, 'actuator', i)!r}"
        one = (model.actuator_ctrlnum[i], model.actuator_outnum[i]) == (1, 1)
        if model.actuator_trntype[i] not in joints or not one:
            raise NotImplementedError(
                f"zivi.Tree takes no actuators but at joints: {called}; "
                "zivi.interop.mujoco.system does"
            )
        if model.actuator_gaintype[i] != fixed or model.actuator_biastype[i] not in (none, affine):
            raise NotImplementedError(
                f"zivi.Tree takes no gains and biases of actuators but constant and affine ones: "
                f"{called}; zivi.interop.mujoco.system does"
            )
        control = float(given[model.actuator_ctrladr[i]])
        if model.actuator_ctrllimited[i]:
            control = float(np.clip(control, *model.actuator_ctrlrange[i]))
        bias = np.zeros(3)
        if model.actuator_biastype[i] == affine:
            bias = np.array(model.actuator_biasprm[i][:3])
        force = float(model.actuator_gainprm[i][0]) * control + float(bias[0])
        if model.actuator_forcelimited[i]:
            if bias[1] != 0 or bias[2] != 0:
                raise NotImplementedError(
                    f"zivi.Tree takes no limits of forces that depend on the state (forcerange): "
                    f"{called}; zivi.interop.mujoco.system does"
                )
            force = float(np.clip(force, *model.actuator_forcerange[i]))
        gear, drive = float(model.actuator_gear[i][0]), found[int(model.actuator_trnid[i][0])]
        drive.torque += gear * force
        drive.stiffness -= gear**2 * float(bias[1])
        drive.damping -= gear**2 * float(bias[2])
    return found


# Which gaps the joints and pairs of geoms of a model of MuJoCo are.


def rotation_of(quat: Any) -> Array:
    """Give the rotation of a quaternion."""
    import mujoco

    out = np.empty(9)
    mujoco.mju_quat2Mat(out, np.asarray(quat, np.float64))
    return out.reshape(3, 3)


def read_gaps(model: Any, gaps: Sequence[Any] | None, friction: str) -> list[TreeGap]:
    """Read joints, pairs of geoms and gaps of zivi; all limits by default."""
    if friction not in ("refuse", "ignore"):
        raise ValueError(f"friction must be 'refuse' or 'ignore', got {friction!r}")
    joints = {element_name(model, "joint", i): i for i in range(model.njnt)}
    if gaps is None:
        gaps = [name for name, i in joints.items() if model.jnt_limited[i]]
    found: list[TreeGap] = []
    for i, given in enumerate([gaps] if isinstance(gaps, str) else gaps):
        if isinstance(given, str):
            if given not in joints:
                raise ValueError(f"gaps[{i}] must be a joint, got {given!r}: {', '.join(joints)}")
            found.append(_joint_limit(model, given, joints[given]))
        elif isinstance(given, JointLimit | PlaneGap | BallGap):
            found.append(given)
        else:
            found += _of_pair(model, f"gaps[{i}]", given, friction)
    return found


def _joint_limit(model: Any, name: str, joint: int) -> JointLimit:
    if not model.jnt_limited[joint]:
        raise ValueError(f"joint {name!r} has no limits")
    if model.jnt_margin[joint] != 0:
        raise NotImplementedError(f"zivi takes no margins of limits: joint {name!r}")
    lower, upper = model.jnt_range[joint]
    return JointLimit(name, float(lower), float(upper))


def _of_pair(model: Any, where: str, given: Any, friction: str) -> list[TreeGap]:
    import mujoco

    geoms = {element_name(model, "geom", i): i for i in range(model.ngeom)}
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
    return None if body == 0 else element_name(model, "body", body)


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
            f"zivi takes no gaps of a {told}: geom {element_name(model, 'geom', geom)!r}"
        )
    points, radius = of[kind]()
    return [origin + rotation @ np.asarray(point) for point in points], float(radius)


CORNERS = [[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]


def _vertices(model: Any, geom: int) -> Array:
    mesh = int(model.geom_dataid[geom])
    start, count = int(model.mesh_vertadr[mesh]), int(model.mesh_vertnum[mesh])
    return np.unique(np.asarray(model.mesh_vert[start : start + count], np.float64), axis=0)


# Models of MuJoCo as trees.


def tree(
    model: Any,
    gaps: Sequence[Any] | None = None,
    e: GivenRestitutions = 0.0,
    ctrl: ArrayLike | None = None,
    friction: str = "refuse",
) -> Tree:
    """Give a model of MuJoCo as a `zivi.Tree`.

    Parameters
    ----------
    model : mujoco.MjModel
        The model.
    gaps, e, ctrl, friction
        As for `zivi.Tree.from_mjcf`.

    Returns
    -------
    Tree
        The same bodies, with their names; nothing of MuJoCo is needed any more.

    Raises
    ------
    NotImplementedError
        For what a tree has not, by its name.
    """
    return Tree._of(read_parts(model, gaps, ctrl, friction), e)


def read_mjcf(path: Any, *, gaps: Any, ctrl: Any, friction: str) -> dict[str, Any]:
    """Read the parts of a tree from MJCF."""
    return read_parts(_compile_model(path, "from_mjcf"), gaps, ctrl, friction)


def read_urdf(path: Any, *, gaps: Any, friction: str) -> dict[str, Any]:
    """Read the parts of a tree from URDF; links keep their names."""
    return read_parts(_compile_model(path, "from_urdf"), gaps, None, friction)


def _compile_model(path: Any, caller: str) -> Any:
    """Read a file or its text, with bodies as they are written."""
    mujoco = needed("mujoco", "models in MJCF and URDF")
    text = os.fspath(path)
    if not isinstance(text, str):
        raise TypeError(f"path of {caller} must be a path or a text, got {path!r}")
    is_text = text.lstrip().startswith("<")
    if not is_text and not os.path.exists(text):
        raise FileNotFoundError(f"{caller}: there is no file {text!r}")
    check_sizes(text if is_text else read_text(text), "" if is_text else os.path.dirname(text))
    said: list[str] = []
    before = mujoco.get_mju_user_warning()
    mujoco.set_mju_user_warning(said.append)  # else MuJoCo leaves a file MUJOCO_LOG.TXT
    try:
        read = mujoco.MjSpec.from_string if is_text else mujoco.MjSpec.from_file
        spec = read(text)
        spec.compiler.fusestatic = False
        model = spec.compile()
    finally:
        mujoco.set_mju_user_warning(before)
    for words in dict.fromkeys(said):
        warnings.warn(f"{caller}: MuJoCo warns: {words.strip()}", ModelWarning, stacklevel=2)
    return model


def read_parts(model: Any, gaps: Any, ctrl: Any, friction: str) -> dict[str, Any]:
    """Give bodies, gaps and gravity of a model."""
    mujoco = needed("mujoco", "models of MuJoCo")
    if not isinstance(model, mujoco.MjModel):
        raise TypeError(f"model must be a mujoco.MjModel, got {model!r}")
    refuse_for_tree(model)
    driven = drives(model, ctrl)
    bodies = [part for body in range(1, model.nbody) for part in _bodies(model, body, driven)]
    off = model.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_GRAVITY
    gravity = np.zeros(3) if off else np.array(model.opt.gravity)
    return {"bodies": bodies, "gaps": read_gaps(model, gaps, friction), "gravity": gravity}


def _bodies(model: Any, body: int, driven: dict[int, Drive]) -> list[Body]:
    """Give a body, behind one without mass for each joint but its last."""
    name = element_name(model, "body", body)
    parent = int(model.body_parentid[body])
    carrier = None if parent == 0 else element_name(model, "body", parent)
    inertial = rotation_of(model.body_iquat[body])
    own: dict[str, Any] = {
        "mass": float(model.body_mass[body]),
        "com": np.array(model.body_ipos[body]),
        "inertia": _symmetric(inertial * model.body_inertia[body] @ inertial.T),
    }
    placed: dict[str, Any] = {
        "position": np.array(model.body_pos[body]),
        "rotation": rotation_of(model.body_quat[body]),
    }
    first, count = int(model.body_jntadr[body]), int(model.body_jntnum[body])
    if count == 0:
        return [Body(name, carrier, "fixed", **placed, **own)]
    parts = []
    for joint in range(first, first + count):
        last = joint == first + count - 1
        coordinate = element_name(model, "joint", joint)
        called = name if last else f"{name}:{coordinate}"
        more = _joint(model, joint, driven[joint]) | (own if last else {})
        parts.append(Body(called, carrier, coordinate=coordinate, **placed, **more))
        carrier, placed = called, {}
    return parts


def _joint(model: Any, joint: int, drive: Drive) -> dict[str, Any]:
    dof, at = int(model.jnt_dofadr[joint]), int(model.jnt_qposadr[joint])
    stiffness, spring = float(model.jnt_stiffness[joint]), float(model.qpos_spring[at])
    # -k (q - s) + tau - k' q = -(k + k') (q - s) + tau - k' s
    return {
        "kind": "slide" if model.jnt_type[joint] == 2 else "hinge",
        "axis": np.array(model.jnt_axis[joint]),
        "anchor": np.array(model.jnt_pos[joint]),
        "stiffness": stiffness + drive.stiffness,
        "spring": spring,
        "damping": float(model.dof_damping[dof]) + drive.damping,
        "armature": float(model.dof_armature[dof]),
        "torque": drive.torque - drive.stiffness * spring,
        "reference": float(model.qpos0[at]),
    }


def _symmetric(matrix: Any) -> Any:
    return (matrix + matrix.T) / 2
