"""Trees of rigid bodies as mechanical systems."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Collection, Iterator, Mapping, MutableMapping, Sequence
from os import PathLike
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

import zivi._zivi as _zivi
from zivi.base.check import Array, finite, real_array
from zivi.base.extras import import_attribute
from zivi.system.gap import IMPACT_LAWS, PARADOXES, ContactLaw, DryFriction, one_of
from zivi.system.impact_law import GivenRestitutions, laws_of, restitutions, written
from zivi.system.mechanism import (
    MAX_SIZE,
    MechanicalSystem,
    Model,
    check_compliant,
    check_mass,
    coordinates_of,
    distinct_names,
)
from zivi.system.model_parts import Layout, Partials
from zivi.system.space import (
    Contact,
    Shape,
    chart_of,
    chart_rates,
    gaps_of_contacts,
    rotate,
    with_angular_velocities,
    with_quaternions,
)
from zivi.system.tree_bodies import (
    LIMITS,
    ROTATIONS,
    BallGap,
    Body,
    ConstraintRows,
    Coordinate,
    JointLimit,
    PlaneGap,
    Rubbing,
    TreeConstraint,
    TreeGap,
    body_values,
    coordinates_of_body,
    friction_of_joints,
    inputs_of_tree,
    joint_values,
    rows_of_constraints,
    rubbings,
    vector,
)

# The numbers of a tree in the order of the extension, from named values.

INERTIA = ((0, 1, 2, 0, 0, 1), (0, 1, 2, 1, 2, 2))
"""Rows and columns of the entries xx, yy, zz, xy, xz, yz."""


@dataclasses.dataclass(frozen=True)
class Side:
    """One gap: its kind, name, joints (-1 for the world) and numbers."""

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
    friction : sequence of DryFriction
        The dry friction of joints.
    constraints : ConstraintRows
        The equality rows.
    """

    bodies: tuple[Body, ...]
    gaps: tuple[TreeGap, ...]
    friction: tuple[DryFriction, ...] = ()
    constraints: ConstraintRows = dataclasses.field(default_factory=ConstraintRows)

    @property
    def moving(self) -> list[Body]:
        """The bodies that have a coordinate."""
        return [body for body in self.bodies if body.moves]

    def values(self, gravity: Array) -> dict[str, float]:
        """Names and values of all that can change."""
        values = {f"gravity.{k}": float(gravity[i]) for i, k in enumerate("xyz")}
        for body in self.bodies:
            values |= body_values(body) | joint_values(body)
        values = {name: value for name, value in values.items() if name not in self.hidden}
        for side in self.sides:
            values |= _of_side(side)
        for rubbing in self.rubbings:
            values |= rubbing.limits
        return values

    @functools.cached_property
    def hidden(self) -> dict[str, float]:
        """Names and values of what ball joints and free bodies need, which never changes."""
        found: dict[str, float] = {}
        for body in self.bodies:
            if isinstance(body, Coordinate):
                inner = body.kind != ROTATIONS[2]
                found |= joint_values(body) | (body_values(body) if inner else {})
                place = {f"{body.name}.position.{k}": 0.0 for k in "xyz"}
                found |= {} if inner else place
        return found

    @functools.cached_property
    def rotations(self) -> dict[str, tuple[int, bool]]:
        """First coordinate of each rotation in space by its body, and whether that is free."""
        moving = [body.kind for body in self.moving]
        return {
            body.name: (i - 2, i >= 5 and f"{body.name}.x" in self.carriers)
            for i, body in enumerate(self.moving)
            if moving[i] == ROTATIONS[2]
        }

    @functools.cached_property
    def rubbings(self) -> list[Rubbing]:
        """The channels of dry friction."""
        gaps = [(side.name, side.gap) for side in self.sides]
        return rubbings(self.bodies, gaps, self.friction)

    @functools.cached_property
    def carriers(self) -> Mapping[str, int]:
        """The joint that moves each body, -1 for the world."""
        joints: dict[str | None, int] = {None: -1}
        count = 0
        for body in self.bodies:
            joints[body.name] = count if body.moves else joints[body.parent]
            count += body.moves
        return {name: joint for name, joint in joints.items() if name is not None}

    def joints(self) -> list[tuple[int, str]]:
        """Return the parent of each joint, and its kind."""
        carriers = self.carriers
        return [
            (-1 if body.parent is None else carriers[body.parent], body.kind)
            for body in self.moving
        ]

    @functools.cached_property
    def sides(self) -> Sequence[Side]:
        """The gaps one by one."""
        carriers = self.carriers
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
        """Return the numbers, complex ones of complex values."""
        values = {**self.hidden, **values}
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
        rows += [_gap(side, frames, values) for side in self.sides]
        rows += [np.array(rubbing.numbers(values)) for rubbing in self.rubbings]
        rows += self.constraints.numbers(frames)
        return np.concatenate(rows)

    def directions(self, values: Mapping[str, float], names: Sequence[str] | None = None) -> Array:
        """Return the derivatives of the numbers with respect to named values, by default all.

        They are complex steps, exact to rounding.
        """
        tiny, plain = 1e-40, dict(values)
        named = plain if names is None else names
        rows = [self.numbers(plain | {name: plain[name] + 1j * tiny}) for name in named]
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
    """Return axes whose third is along an axis; the body's own axes if one of them is."""
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
    """Return mass, first moment and inertia about the origin of the joint, ten numbers."""
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
    """Return the numbers of a gap."""
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


# Trees of rigid bodies as mechanical systems.


class TreeParameters(MutableMapping[str, float]):
    """The parameters of a tree by their names; they can be changed, not added.

    Parameters
    ----------
    values : dict
        Names and values.

    Attributes
    ----------
    state : object
        Another object after each change.
    """

    def __init__(self, values: Mapping[str, float]) -> None:
        self._values = dict(values)
        self.state = object()

    def __getitem__(self, name: str) -> float:
        return self._values[self._known(name)]

    def __setitem__(self, name: str, value: float) -> None:
        value = finite(f"parameters[{name!r}]", value)
        if self._known(name).endswith((".mass", ".armature", *LIMITS)) and value < 0.0:
            raise ValueError(f"parameters[{name!r}] must be >= 0, got {value}")
        self._values[name] = value
        self.state = object()

    def _known(self, name: str) -> str:
        if name not in self._values:
            known = ", ".join(self._values)
            raise KeyError(f"unknown parameter {name!r}; the parameters are {known}")
        return name

    def __delitem__(self, name: str) -> None:
        raise TypeError("a parameter can be changed, not removed")

    def __iter__(self) -> Iterator[str]:
        return iter(self._values)

    def __len__(self) -> int:
        return len(self._values)

    def __repr__(self) -> str:
        return repr(self._values)

    def as_dict(self) -> dict[str, float]:
        """Return a dictionary of names and values, faster than ``dict(parameters)``."""
        return self._values.copy()


class Tree(MechanicalSystem):
    r"""Rigid bodies that joints connect to a tree, or that are free, with points of them as gaps.

    .. math:: M(q) \ddot q = -b(q, \dot q) - k (q - s) - c \dot q + \tau + N^T \lambda

    A `MechanicalSystem` without the interpreter: the mass matrix of composite bodies, :math:`b` by
    the recursive equations of Newton and Euler, gradients and curvatures of the gaps, and all their
    derivatives, by parameters too.

    Parameters
    ----------
    bodies : sequence of Body
        The bodies (`zivi.mechanics.Body`), parents before children. Those that are not fixed have
        the coordinates, in this order.
    gaps : sequence of JointLimit, PlaneGap or BallGap
        The gaps (of `zivi.mechanics`).
    gravity : array_like
        Acceleration of free fall (m/s^2), in axes of the world.
    e : float or array_like
        As for `MechanicalSystem`.
    friction : sequence of DryFriction
        Dry friction of joints, by their names: ``zivi.DryFriction("elbow", limit=0.1)``, with
        numbers for `limit` and `static`. That of points above planes is ``PlaneGap(..., mu=)``.
    inputs : array_like, callable or dict, optional
        See `MechanicalSystem`; a dict may have a joint, or gears by joint, in place of a column:
        ``{"thigh": "hip", "belt": {"hip": 1.0, "knee": -1.0}}``.
    impact_law, paradox : str
        As for `MechanicalSystem`.
    constraints : sequence of Connect, Weld, Drive or Couple
        Equality rows (of `zivi.mechanics`): joints that close chains, bodies that are fixed to each
        other, joints that are driven or coupled.
    contacts : sequence of Contact
        Contacts of shapes (of `zivi.mechanics`), each with its friction and restitution: they are
        the gaps after `gaps`.
    shapes : dict
        The shapes (`Ball`, `Capsule`, `Box`, `Plane` of `zivi.mechanics`) by name: a shape with the
        name of a body is part of that body.

    Raises
    ------
    ValueError, TypeError
        If a name is not known or used twice, or the mass matrix is singular at coordinates of zero.
    NotImplementedError
        For a contact of shapes that have no gap, by its name.

    See Also
    --------
    Tree.from_mjcf, Tree.from_urdf : the same from files.
    Tree.state : initial states from unit quaternions.

    Notes
    -----
    The parameters are ``body.mass``, ``body.com.x``, ``body.position.x``, ``body.inertia.xx``, ...;
    ``joint.stiffness``, ``.spring``, ``.damping``, ``.armature``, ``.torque``; ``gravity.z``; of
    gaps ``joint.lower``, ``joint.upper``, ``gap.offset``, ``gap.radius``; of friction ``gap.mu``,
    ``gap.mu_static``, ``joint.friction``, ``joint.friction_static``. `zivi.sensitivity` takes
    derivatives by them.

    References
    ----------
    R. Featherstone, Rigid Body Dynamics Algorithms, Springer, 2008.

    Examples
    --------
    A pendulum with a ball of radius 0.1 at its end, above a floor 0.8 below its hinge:

    >>> from zivi.mechanics import Body, PlaneGap
    >>> bob = Body("bob", axis=[0, 1, 0], mass=2.0, com=[0, 0, -1], inertia=0.01)
    >>> floor = PlaneGap("bob", point=[0, 0, -1], offset=-0.8, radius=0.1, name="floor")
    >>> pendulum = zivi.Tree([bob], gaps=[floor], e=0.5)
    >>> sol = zivi.simulate(pendulum, (0, 9), ([1.5], [0.0]))
    >>> sol.q[-1].round(12)  # at rest on the floor, arccos 0.7
    array([0.79539883])
    >>> pendulum.parameters["bob.mass"]
    2.0
    """

    derived = True

    def __init__(
        self,
        bodies: Sequence[Body],
        *,
        gaps: Sequence[TreeGap] = (),
        gravity: ArrayLike = (0.0, 0.0, -9.81),
        e: GivenRestitutions = 0.0,
        friction: Sequence[DryFriction] = (),
        inputs: Any = None,
        impact_law: str = "newton",
        paradox: str = "stop",
        constraints: Sequence[TreeConstraint] = (),
        contacts: Sequence[Contact] = (),
        shapes: Mapping[str, Shape] | None = None,
    ) -> None:
        self._bodies = ordered(bodies)
        inner = ordered([it for body in self._bodies for it in coordinates_of_body(body)])
        touching = gaps_of_contacts(contacts, shapes or {}, self._bodies)
        self._structure = Structure(inner, (*gaps, *(gap for gap, _ in touching)))
        self._gravity = vector("gravity", gravity)
        moving = self._structure.moving
        if not 1 <= len(moving) <= MAX_SIZE:
            raise ValueError(f"bodies must have from 1 to {MAX_SIZE} joints, got {len(moving)}")
        self._coordinates = coordinates_of([body.joint for body in moving], None)
        self._n = len(moving)
        self._check_gaps()
        self._gaps = ()
        sides = self._structure.sides
        if len(sides) > MAX_SIZE:
            raise ValueError(f"gaps must be at most {MAX_SIZE}, got {len(sides)}")
        self._gap_names = distinct_names("gaps", [side.name for side in sides])
        self._e = restitutions(e, len(sides))
        check_compliant(e, self._contact_laws(), self._gap_names)
        if any(of_contact is not None for _, of_contact in touching):
            laws: list[Any] = list(laws_of(self._e))
            first = len(sides) - len(touching)
            for i, (_, own) in enumerate(touching):
                laws[first + i] = laws[first + i] if own is None else own
            self._e = restitutions(laws, len(sides))
        self._read_friction(friction)
        rows = rows_of_constraints(constraints, self._structure.bodies)
        self._structure = dataclasses.replace(self._structure, constraints=rows)
        distinct_names("equalities", rows.names)
        if len(rows.names) > MAX_SIZE:
            raise ValueError(
                f"constraints must have at most {MAX_SIZE} rows, got {len(rows.names)}"
            )
        self._given_inputs = inputs
        if inputs is not None:
            self._controls = inputs_of_tree(inputs, self._coordinates or ())
            self._check_inputs()
        self._impact_law = one_of("impact_law", impact_law, IMPACT_LAWS)
        self._paradox = one_of("paradox", paradox, PARADOXES)
        self._parameters = TreeParameters(self._structure.values(self._gravity))
        rest = np.zeros(self._n)
        mass = self.at(0.0, rest, rest).mass
        check_mass(mass, self.coordinate_names(len(mass)))

    def _contact_laws(self) -> list[ContactLaw | None]:
        return [side.gap.contact for side in self._structure.sides]

    def _read_friction(self, friction: Any) -> None:
        """Read the dry friction of joints and gaps."""
        self._joints = friction_of_joints(friction, self._axes_of_joints())
        self._structure = dataclasses.replace(self._structure, friction=self._joints)
        self._channels = tuple(rubbing.channel for rubbing in self._structure.rubbings)
        of_joints = [channel.name for channel in self._channels if channel.gap is None]
        distinct_names("gaps and friction", [*self._gap_names, *of_joints])
        if self.m + len(self._channels) > MAX_SIZE:
            raise ValueError(
                f"gaps and friction must be at most {MAX_SIZE} together, a gap with friction "
                f"counts as two, got {self.m + len(self._channels)}"
            )

    def _axes_of_joints(self) -> tuple[str, ...]:
        """Return the coordinates but for those of rotations in space."""
        moving = self._structure.moving
        return tuple(body.joint for body in moving if body.kind not in ROTATIONS)

    def _check_inputs(self) -> None:
        """Reject controls along the coordinates of rotations in space."""
        assert self._controls is not None
        turns = [i for i, body in enumerate(self._structure.moving) if body.kind in ROTATIONS]
        matrix = self._controls.matrix
        if turns and (callable(matrix) or np.any(np.asarray(matrix)[turns])):
            raise NotImplementedError(
                "inputs that turn a ball joint or free body are not supported by zivi.Tree; let "
                "them act on hinges and slides"
            )

    def _check_gaps(self) -> None:
        bodies = {body.name for body in self._bodies}
        joints = set(self._axes_of_joints())
        for i, gap in enumerate(self._structure.gaps):
            if not isinstance(gap, JointLimit | PlaneGap | BallGap):
                raise TypeError(
                    f"gaps[{i}] must be a JointLimit, PlaneGap or BallGap of zivi.mechanics, "
                    f"got {gap!r}"
                )
            named = [gap.joint] if isinstance(gap, JointLimit) else [gap.body]
            if isinstance(gap, BallGap) and gap.other is not None:
                named.append(gap.other)
            known = joints if isinstance(gap, JointLimit) else bodies
            for name in named:
                if name not in known:
                    told = ", ".join(sorted(known))
                    raise ValueError(f"gaps[{i}] names {name!r}: there are {told}")
        carriers = self._structure.carriers
        for i, gap in enumerate(self._structure.gaps):
            if isinstance(gap, JointLimit):
                continue
            at = {carriers[gap.body]}
            if isinstance(gap, BallGap):
                at.add(-1 if gap.other is None else carriers[gap.other])
            if at == {-1} or (isinstance(gap, BallGap) and len(at) == 1):
                raise ValueError(f"gaps[{i}] is between bodies that never move to each other")

    @classmethod
    def from_mjcf(
        cls,
        path: str | PathLike[str] | Any,
        *,
        gaps: Sequence[Any] | str | None = None,
        e: GivenRestitutions = 0.0,
        ctrl: ArrayLike | None = None,
        friction: str = "read",
        inputs: Any = None,
        impact_law: str = "newton",
        paradox: str = "stop",
    ) -> Tree:
        """Read a model of MuJoCo (MJCF); MuJoCo is needed for this only.

        Parameters
        ----------
        path : str, path-like, mujoco.MjSpec or mujoco.MjModel
            The file; or its text, which starts with ``<``; or the model as MuJoCo has it.
        gaps : sequence or "all", optional
            Which joints and pairs of geoms are gaps: names of limited joints, and pairs of names
            ``("geom1", "geom2")``. A sphere is one gap, a capsule two, a box its eight corners,
            a mesh its vertices; their counterparts are planes or spheres. ``"all"``: the limits of
            all joints, and all geoms above all planes that ``contype`` and ``conaffinity`` allow.
            By default the limits of all joints, and no pairs.
        e : float or array_like
            See `MechanicalSystem`; contact parameters of the file are not read.
        ctrl : array_like, optional
            Constant controls of the actuators at joints, of shape (nu,); by default zero.
        friction : {"read", "refuse", "ignore"}
            Dry friction of joints (``frictionloss``) and of geoms above planes, with the greater
            coefficient of both: it is read, rejected, or left out.
        inputs : dict or array_like, optional
            As for `Tree`. By default the actuators, by name; one without a name has that of its
            joint. The control of a closed loop is added to `ctrl`; ``ctrlrange`` does not limit
            it, ``u_limits`` of the controllers do.
        impact_law, paradox : str
            As for `MechanicalSystem`.

        Returns
        -------
        Tree
            The same bodies, with their names.

        Raises
        ------
        NotImplementedError
            For what a tree does not have, by its name: with friction also for geoms that do not
            move in a plane.
        ImportError
            Without MuJoCo: ``pip install 'zivi[mujoco]'``.

        See Also
        --------
        zivi.interop.mujoco.system : what is rejected here, computed by MuJoCo.

        Notes
        -----
        Margins of limits are not read: they define the onset of MuJoCo's soft force.
        """
        read = import_attribute("zivi.interop.mujoco", "read_mjcf")
        parts = read(path, gaps=gaps, ctrl=ctrl, friction=friction)
        chosen = {} if inputs is None else {"inputs": inputs}
        return cls(**parts | chosen, e=e, impact_law=impact_law, paradox=paradox)

    @classmethod
    def from_urdf(
        cls,
        path: str | PathLike[str] | Any,
        *,
        gaps: Sequence[Any] | str | None = None,
        e: GivenRestitutions = 0.0,
        friction: str = "read",
        inputs: Any = None,
        impact_law: str = "newton",
        paradox: str = "stop",
    ) -> Tree:
        """Read a URDF file; MuJoCo is needed for this only.

        Parameters
        ----------
        path, gaps, e, friction, inputs, impact_law, paradox
            As for `from_mjcf`; a URDF file has no actuators.

        Returns
        -------
        Tree
            The same bodies, with their names; links without a joint are parts of their parents.

        Raises
        ------
        NotImplementedError, ImportError
            As for `from_mjcf`.

        Warns
        -----
        ModelWarning
            If numbers of the file are changed: an inertia that violates the triangle inequality
            becomes its mean (MuJoCo's ``balanceinertia``). If the mass matrix would be singular,
            masses (kg) and inertias (kg m^2) of zero become 1e-6 (``boundmass``).

        Notes
        -----
        Visual geometry is not read. Links without mass stay massless if the mass matrix has full
        rank without them.
        """
        read = import_attribute("zivi.interop.mujoco", "read_urdf")
        parts = read(path, gaps=gaps, friction=friction)
        chosen = {} if inputs is None else {"inputs": inputs}
        return cls(**parts | chosen, e=e, impact_law=impact_law, paradox=paradox)

    @property
    def bodies(self) -> tuple[Body, ...]:
        """The bodies as given."""
        return self._bodies

    @property
    def parameters(self) -> TreeParameters:
        """The parameters by name; a change holds for the runs that start after it."""
        return self._parameters

    def replace(self, e: GivenRestitutions | None = None, **parameters: float) -> Tree:
        """Return the same system with other parameters.

        Parameters
        ----------
        e : float or array_like, optional
            Other coefficients of restitution.
        **parameters
            Names and values of the changes; for example ``**{"hand.mass": 2.0}``.

        Returns
        -------
        Tree
            A system of its own: this one keeps its parameters.

        Raises
        ------
        KeyError
            For a name that is no parameter.
        """
        new: Tree = type(self).__new__(type(self))
        vars(new).update(vars(self))
        new._parameters = TreeParameters(self._parameters.as_dict())
        new._parameters.update(parameters)
        if e is not None:
            new._e = restitutions(e, self.m)
            check_compliant(e, self._contact_laws(), self._gap_names)
        return new

    def _revision(self) -> object:
        return self._parameters.state

    def _told(self) -> tuple[str | None, dict[str, float] | None]:
        return None, self._parameters.as_dict()

    def _new_model(self, n: int) -> Model:
        rows = self._structure.constraints
        layout = Layout(n, self.m, len(self._channels), len(rows.names))
        drives = [(row, native.address) for row, native in rows.native]
        spec = _zivi.Model.tree(self._core_tree(), drives=drives, owner=rows.native)
        return Model.native(layout, spec)

    @property
    def constraints(self) -> tuple[TreeConstraint, ...]:
        """The constraints as given."""
        return self._structure.constraints.given

    @property
    def equality_names(self) -> tuple[str, ...]:
        """Names of the equality rows of the constraints."""
        return self._structure.constraints.names

    def _motions(self) -> list[Any]:
        return [motion for _, motion in self._structure.constraints.drives]

    def _units(self) -> dict[str, list[str]]:
        kinds = {"hinge": "rad", "slide": "m"} | dict.fromkeys(ROTATIONS, "1")
        of_joint = {body.joint: kinds[body.kind] for body in self._structure.moving}
        sides = [getattr(side.gap, "joint", "") for side in self._structure.sides]
        return {
            "coordinates": list(of_joint.values()),
            "gaps": [of_joint.get(joint, "m") for joint in sides],
        }

    def _core_tree(self) -> _zivi.Tree:
        structure = self._structure
        sides = [(side.kind, *side.joints) for side in structure.sides]
        friction = [(rubbing.kind, rubbing.at) for rubbing in structure.rubbings]
        numbers = structure.numbers(self._parameters)
        rows = structure.constraints
        drives = [(row, motion._spec()) for row, motion in rows.drives]
        return _zivi.Tree(structure.joints(), sides, friction, numbers, list(rows.core), drives)

    def partials(self, model: Model, wanted: Collection[str] | None = None) -> Partials:
        """Return the derivatives of the numbers of the tree with respect to parameters."""
        values, used = self._parameters, self._parameters if wanted is None else wanted
        names = [name for name in values if name in used]
        rows = dict(zip(names, self._structure.directions(values, names).tolist(), strict=True))
        directions = [rows.get(name, []) for name in values]
        return Partials(_zivi.Partials.tree(directions), dict(values))

    # States with unit quaternions.

    @property
    def nq(self) -> int:
        """Numbers of a state with unit quaternions, ``nv`` and one more for each rotation."""
        return int(self._n or 0) + len(self._structure.rotations)

    def state(self, qpos: ArrayLike, qvel: ArrayLike | None = None) -> tuple[Array, Array]:
        """Return coordinates and velocities of a run from places and unit quaternions.

        Parameters
        ----------
        qpos : array_like
            By joint, in the order of the bodies: the coordinate of a hinge or slide; the unit
            quaternion (w, x, y, z) of a ball joint; the place of a free body (m), then its
            quaternion. Shape (..., nq). The layout is that of MuJoCo's ``qpos``.
        qvel : array_like, optional
            Their rates: of a rotation the angular velocity in axes of the body (rad/s). Shape
            (..., nv), with one number less for each quaternion; default zero. The layout is that
            of MuJoCo's ``qvel``.

        Returns
        -------
        q0, qdot0 : ndarray
            Coordinates and velocities of a run, shapes (..., n).

        Raises
        ------
        ValueError
            If a shape is wrong, a number is not finite or a quaternion not of length one to 1e-6.

        See Also
        --------
        qpos, qvel : the way back.

        Notes
        -----
        `simulate` takes ``(qpos, qvel)`` directly. A rotation has three coordinates in a run, the
        stereographic projection p / (1 + w) of its quaternion (w, p). Both p and -p are the same
        rotation, so that coordinates larger than one change to -s / s^2 between steps.

        References
        ----------
        J. Stuelpnagel, On the parametrization of the three-dimensional rotation group, SIAM Review
        6, 1964.

        Examples
        --------
        >>> top = zivi.Tree([zivi.mechanics.Body("top", kind="free", mass=1.0, inertia=[1, 2, 3])])
        >>> q, qdot = top.state([0, 0, 1, 0.8, 0.6, 0, 0], [0, 0, 0, 0, 0, 5])
        >>> top.coordinate_names(6)[3:], (3 * q[3:]).round(12)
        (('top.rx', 'top.ry', 'top.rz'), array([1., 0., 0.]))
        >>> float(top.qvel(q, qdot)[5].round(12))
        5.0
        """
        given = self._finite("qpos", qpos, self.nq)
        rates = np.zeros((*given.shape[:-1], int(self._n or 0)))
        if qvel is not None:
            rates = self._finite("qvel", qvel, int(self._n or 0))
        places, velocities, at = [], np.array(rates), 0
        for count, name in self._blocks():
            block = given[..., at : at + count]
            if name is not None:
                size = np.linalg.norm(block, axis=-1)
                if np.any(np.abs(size - 1.0) > 1e-6):
                    raise ValueError(
                        f"quaternion of body {name!r} must have length 1, got {size.flat[0]:.6g}"
                    )
                block = block / size[..., None]
                first = self._structure.rotations[name][0]
                omega = rotate(block, rates[..., first : first + 3])
                block = chart_of(block)
                velocities[..., first : first + 3] = chart_rates(block, omega)
            places.append(block)
            at += count
        return np.concatenate(places, axis=-1), velocities

    def qpos(self, q: ArrayLike) -> Array:
        """Return places and unit quaternions for coordinates of a run.

        Parameters
        ----------
        q : array_like
            Coordinates, shape (..., n).

        Returns
        -------
        ndarray
            As for `state`, shape (..., nq); the first number of a quaternion may have either sign.
        """
        return with_quaternions(self._structure.rotations, np.asarray(q, dtype=float))

    def qvel(self, q: ArrayLike, qdot: ArrayLike) -> Array:
        """Return velocities with angular velocities for a state of a run.

        Parameters
        ----------
        q, qdot : array_like
            Coordinates and velocities, shapes (..., n).

        Returns
        -------
        ndarray
            As for `state`, shape (..., nv).
        """
        state = np.asarray(q, dtype=float), np.asarray(qdot, dtype=float)
        return with_angular_velocities(self._structure.rotations, *state)

    def _finite(self, name: str, value: Any, size: int) -> Array:
        array = np.atleast_1d(real_array(name, value))
        if array.shape[-1] != size or not np.all(np.isfinite(array)):
            raise ValueError(f"{name} must be {size} finite numbers, got {array.tolist()}")
        return array

    def _blocks(self) -> Iterator[tuple[int, str | None]]:
        """Yield how many numbers of `qpos` belong together, and the body of a quaternion."""
        firsts = {first: name for name, (first, _) in self._structure.rotations.items()}
        at = 0
        while at < int(self._n or 0):
            name = firsts.get(at)
            yield (1, None) if name is None else (4, name)
            at += 1 if name is None else 3

    def _rotations(self) -> dict[str, tuple[int, bool]]:
        return self._structure.rotations

    def _start_of(self, y0: Any) -> Any:
        """Return the coordinates of a run for a state with quaternions, other states as given."""
        if not self._structure.rotations:
            return y0
        try:
            q, qdot = y0
            size = len(q)
        except (TypeError, ValueError):
            return y0
        if size == self.nq:
            return self.state(q, qdot)
        if size != self._n:
            raise ValueError(
                f"y0 must be (qpos, qvel) with {self.nq} and {self._n} numbers or (q, qdot) with "
                f"{self._n} each, got {size} numbers first"
            )
        return y0

    def __repr__(self) -> str:
        told = f"joints=({', '.join(self._coordinates or ())}), gaps=({', '.join(self._gap_names)})"
        rough = f", friction=({', '.join(self.channel_names)})" if self._channels else ""
        held = self.equality_names
        rough += f", equalities=({', '.join(held)})" if held else ""
        chosen = "".join(f", {name}={value!r}" for name, value in self._chosen().items())
        return f"Tree({told}, e={written(self._e)}{rough}{chosen})"

    def __getstate__(self) -> dict[str, Any]:
        more: dict[str, Any] = {"friction": self._joints} if self._joints else {}
        more |= {} if self._given_inputs is None else {"inputs": self._given_inputs}
        more |= {"constraints": self.constraints} if self.constraints else {}
        return (
            more
            | self._chosen()
            | {
                "bodies": self._bodies,
                "gaps": self._structure.gaps,
                "gravity": self._gravity,
                "e": self._e,
                "parameters": dict(self._parameters),
            }
        )

    def __setstate__(self, state: dict[str, Any]) -> None:
        parameters = state.pop("parameters")
        Tree.__init__(self, **state)
        self._parameters.update(parameters)
