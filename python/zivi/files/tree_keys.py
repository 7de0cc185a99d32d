"""All keys of a file of a tree of bodies, and such a file from a tree."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Mapping
from typing import Any

import numpy as np

from zivi.files.expressions import Each
from zivi.files.keys import ANY, NOT_NEGATIVE
from zivi.files.kinds import Choice, Kind, Number, read_each
from zivi.files.mechanical_keys import MECHANICS, RESTITUTIONS
from zivi.files.tables import Key, Open, Table, Tagged
from zivi.files.validation import Mistakes, got_value
from zivi.system.impact_law import NewtonImpact
from zivi.system.tree.body import KINDS
from zivi.system.tree.gaps import BallGap, JointLimit, PlaneGap
from zivi.system.tree.system import Tree

__all__ = ["GAPS", "TREE", "is_tree", "tree_text"]


@dataclasses.dataclass(frozen=True)
class Text:
    """A name of any characters."""

    allowed = "a name"

    def read(self, value: Any, key: str, mistakes: Mistakes) -> str | None:
        """Give the name."""
        if isinstance(value, str) and value:
            return value
        mistakes.add(key, f"must be {self.allowed}, {got_value(value)}")
        return None


@dataclasses.dataclass(frozen=True)
class Triple:
    """Three numbers; or rows of them."""

    rows: int = 0

    @property
    def allowed(self) -> str:
        """What is allowed, in words."""
        return "three rows of three numbers" if self.rows else "a list of three numbers"

    def read(self, value: Any, key: str, mistakes: Mistakes) -> Any:
        """Give lists of floats."""
        if not (isinstance(value, list) and len(value) == 3):
            mistakes.add(key, f"must be {self.allowed}, {got_value(value)}")
            return None
        of: Kind = Triple() if self.rows else Number()
        return read_each(self, of, value, key, mistakes)


@dataclasses.dataclass(frozen=True)
class Inertia:
    """A number, three, or a matrix."""

    allowed = "a finite number, a list of three numbers, or three rows of three numbers"

    def read(self, value: Any, key: str, mistakes: Mistakes) -> Any:
        """Give a float or lists of floats."""
        if not isinstance(value, list):
            return NOT_NEGATIVE.read(value, key, mistakes)
        rows = 3 if value and isinstance(value[0], list) else 0
        return Triple(rows).read(value, key, mistakes)


NAME = Text()
POINT = Triple()
BODY = (
    Key("name", NAME, "its name"),
    Key("parent", NAME, "the body that carries it", default="the world"),
    Key("kind", Choice(tuple(KINDS)), "its joint", default='"hinge"'),
    Key("position", POINT, "its origin in the frame of its parent", "m", "[0, 0, 0]"),
    Key("rotation", Triple(3), "its axes there, as columns", default="those of its parent"),
    Key("axis", POINT, "direction of the joint in its frame", default="[0, 0, 1]"),
    Key("anchor", POINT, "a point on the axis of a hinge", "m", "[0, 0, 0]"),
    Key("mass", NOT_NEGATIVE, "mass", "kg", "0"),
    Key("com", POINT, "centre of mass", "m", "[0, 0, 0]"),
    Key("inertia", Inertia(), "inertia about the centre of mass", "kg m^2", "0"),
    Key("stiffness", ANY, "k in -k (q - spring) - c q' + torque", "N m or N/m", "0"),
    Key("spring", ANY, "where the spring is at rest", "rad or m", "0"),
    Key("damping", ANY, "c", "N m s or N s/m", "0"),
    Key("armature", NOT_NEGATIVE, "inertia of a rotor", "kg m^2 or kg", "0"),
    Key("torque", ANY, "a constant torque or force", "N m or N", "0"),
    Key("reference", ANY, "coordinate at which the frame is at position", "rad or m", "0"),
    Key("coordinate", NAME, "name of the coordinate", default="that of the body"),
)
BALL = (
    Key("body", NAME, "the body"),
    Key("point", POINT, "centre of its ball", "m", "[0, 0, 0]"),
)
CALLED = Key("name", NAME, "name of the gap", default="that of the body")
GAPS = {"limit": JointLimit, "plane": PlaneGap, "ball": BallGap}
GAP = Tagged(
    "kind",
    {
        "limit": (
            Key("joint", NAME, "the coordinate"),
            Key("lower", ANY, "its lower limit", "rad or m", "none"),
            Key("upper", ANY, "its upper limit", "rad or m", "none"),
        ),
        "plane": (
            *BALL,
            Key("normal", POINT, "n in n . p - offset - radius", default="[0, 0, 1]"),
            Key("offset", ANY, "offset", "m", "0"),
            Key("radius", NOT_NEGATIVE, "radius of the ball", "m", "0"),
            CALLED,
        ),
        "ball": (
            *BALL,
            Key("other", NAME, "the other body", default="the world"),
            Key("other_point", POINT, "centre of the other ball", "m", "[0, 0, 0]"),
            Key("radius", Number(above=0.0), "the sum of both radii", "m"),
            CALLED,
        ),
    },
)
SYSTEM = Table(
    (
        Key("bodies", Each(Table(BODY), "tables"), "the bodies, parents before children"),
        Key("gaps", Each(GAP, "tables"), "the gaps", default="none"),
        Key("gravity", POINT, "acceleration of free fall", "m/s^2", "[0, 0, -9.81]"),
        RESTITUTIONS,
        Key("parameters", Open(ANY, "parameters"), "other values, by their names", default="none"),
    )
)
TREE = tuple(
    Key("system", SYSTEM, "the tree of bodies") if key.name == "system" else key
    for key in MECHANICS
)


def is_tree(content: Mapping[str, Any]) -> bool:
    """Whether a file describes a tree of bodies."""
    system = content.get("system")
    return isinstance(system, dict) and "bodies" in system


def tree_text(tree: Tree, t_span: tuple[float, float], y0: Any) -> str:
    """Write a tree as a file of ``zivi simulate``.

    Parameters
    ----------
    tree : Tree
        The tree, read from a file of MuJoCo for example.
    t_span : tuple of float
        Start and end.
    y0 : tuple of array_like
        Coordinates and velocities.

    Returns
    -------
    str
        The file, in TOML, which needs neither MuJoCo nor Python code.

    Examples
    --------
    >>> from zivi.mechanics import Body, PlaneGap
    >>> bob = Body("bob", axis=[0, 1, 0], mass=2.0, com=[0, 0, -1], inertia=0.01)
    >>> tree = zivi.Tree([bob], gaps=[PlaneGap("bob", [0, 0, -1], offset=-0.8)], e=0.5)
    >>> print(zivi.files.tree_text(tree, (0, 2), ([1.5], [0.0])).splitlines()[-1])
    offset = -0.8
    """
    start = [np.asarray(part, dtype=float).tolist() for part in y0]
    if [len(part) for part in start] != [len(tree._coordinates or ())] * 2:
        raise ValueError(f"y0 must have two lists of {len(tree._coordinates or ())}, got {start}")
    first = {"t_span": [float(t) for t in t_span], "y0": start}
    made = dict(tree._structure.values(tree._gravity))
    changed = {name: value for name, value in tree.parameters.items() if made[name] != value}
    gravity = np.asarray(tree._gravity).tolist()
    system = {"gravity": gravity, "e": _laws(tree)} if len(tree._e) else {"gravity": gravity}
    if changed:
        system["parameters"] = changed
    parts = [_lines(first), "[system]", _lines(system)]
    kinds = {kind: name for name, kind in GAPS.items()}
    for body in tree.bodies:
        parts += ["[[system.bodies]]", _lines(_not_default(body))]
    for gap in tree._structure.gaps:
        parts += ["[[system.gaps]]", _lines({"kind": kinds[type(gap)]} | _not_default(gap))]
    return "\n".join(parts)


def _laws(tree: Tree) -> list[Any]:
    """Give the coefficients of restitution, or where one is not Newton's the laws, as tables."""
    if not isinstance(tree._e, tuple):
        numbers: list[Any] = tree._e.tolist()
        return numbers
    return [
        law.e if isinstance(law, NewtonImpact) else {"law": type(law).__name__} | _not_default(law)
        for law in tree._e
    ]


def _not_default(it: Any) -> dict[str, Any]:
    """Give the fields that are not their defaults."""
    found = {}
    for field in dataclasses.fields(it):
        value = getattr(it, field.name)
        value = value.tolist() if isinstance(value, np.ndarray) else value
        default = field.default
        default = list(default) if isinstance(default, tuple) else default
        if value is not None and value != default:
            found[field.name] = list(value) if isinstance(value, tuple) else value
    if found.get("rotation") == np.eye(3).tolist():
        del found["rotation"]
    return found


def _lines(values: Mapping[str, Any]) -> str:
    return "".join(f"{key} = {_value(value)}\n" for key, value in values.items()).rstrip("\n")


def _value(value: Any) -> str:
    if isinstance(value, Mapping):
        inner = ", ".join(f"{json.dumps(key)} = {_value(it)}" for key, it in value.items())
        return f"{{ {inner} }}"
    if isinstance(value, list):
        return f"[{', '.join(map(_value, value))}]"
    return json.dumps(value, ensure_ascii=False)
