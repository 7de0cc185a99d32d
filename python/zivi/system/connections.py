"""Constraints of trees: connected points, welded bodies, joints that are driven or coupled."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from zivi.base.check import Array, finite, real_array
from zivi.base.expressions import UnknownNameError, c_source, expression, python_source
from zivi.base.extras import needed
from zivi.base.formula import FormulaError
from zivi.base.machine_code import Native, compile_model
from zivi.system.gap import HarmonicWall
from zivi.system.table import Table
from zivi.system.tree_bodies import Body, vector


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
