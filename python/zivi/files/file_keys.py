"""Keys of all input files: types, units, ranges, defaults."""

from __future__ import annotations

import dataclasses
import inspect
import json
import math
import re
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

import zivi._zivi as _zivi
from zivi.control import twisting
from zivi.files.kinds import (
    Choice,
    Each,
    Either,
    Expression,
    Few,
    Kind,
    Mistakes,
    Names,
    Number,
    Numbers,
    OneOrEach,
    Pair,
    Switch,
    Whole,
    dotted,
    got_value,
    read_each,
    suggestion,
)
from zivi.study import EXPERIMENTS
from zivi.system.gap import IMPACT_LAWS, PARADOXES
from zivi.system.impact_law import NewtonImpact
from zivi.system.space import Ball, Box, Capsule, Plane
from zivi.system.tree import Tree
from zivi.system.tree_bodies import KINDS, BallGap, JointLimit, PlaneGap

# Tables in a file: which keys they have, and which of them belong together.


@dataclasses.dataclass(frozen=True)
class Key:
    """One key of a table.

    Parameters
    ----------
    name : str
        Its name.
    kind : Kind
        What it may hold.
    meaning : str
        What it is.
    unit : str
        Its unit, "" if it has none.
    default : str or None
        Its default, in words or as written in the file; None if it is required.
    """

    name: str
    kind: Kind
    meaning: str
    unit: str = ""
    default: str | None = None


@dataclasses.dataclass(frozen=True)
class KeyTable:
    """A table of known keys."""

    keys: tuple[Key, ...]

    @property
    def allowed(self) -> str:
        """Allowed values, in words."""
        return f"a table with {', '.join(key.name for key in self.keys)}"

    def read(self, value: Any, key: str, mistakes: Mistakes) -> dict[str, Any] | None:
        """Return the values of the keys that are there."""
        if not isinstance(value, dict):
            mistakes.add(key, f"must be {self.allowed}, {got_value(value)}")
            return None
        return read_keys(self.keys, value, key, mistakes)


@dataclasses.dataclass(frozen=True)
class Tagged:
    """A table in which one key, the tag, decides which others there are."""

    tag: str
    variants: Mapping[str, tuple[Key, ...]]
    default: str | None = None
    others: str = ""

    @property
    def allowed(self) -> str:
        """Allowed values, in words."""
        return f"a table with {self.tag} = {Choice(tuple(self.variants)).allowed}"

    def read(self, value: Any, key: str, mistakes: Mistakes) -> dict[str, Any] | None:
        """Return the tag and the values of the keys that are there."""
        if not isinstance(value, dict):
            mistakes.add(key, f"must be {self.allowed}, {got_value(value)}")
            return None
        where = dotted(key, self.tag)
        choice = Choice(tuple(self.variants), others=self.others)
        if self.tag not in value and self.default is None:
            mistakes.add(where, f"is missing: it must be {choice.allowed}")
            return None
        tag = choice.read(value.get(self.tag, self.default), where, mistakes)
        if tag is None:
            return None
        rest = {name: it for name, it in value.items() if name != self.tag}
        for name in [name for name in rest if name in self._elsewhere(tag)]:
            others = " and ".join(self._elsewhere(tag)[name])
            mistakes.add(dotted(key, name), f"is not a setting of {tag}, but of {others}")
            del rest[name]
        return {self.tag: tag} | read_keys(self.variants[tag], rest, key, mistakes)

    def _elsewhere(self, tag: str) -> dict[str, list[str]]:
        """Return the keys that only other variants have, with those."""
        own = {key.name for key in self.variants[tag]}
        found: dict[str, list[str]] = {}
        for variant, keys in self.variants.items():
            for key in keys:
                if key.name not in own:
                    found.setdefault(key.name, []).append(variant)
        return found


@dataclasses.dataclass(frozen=True)
class Open:
    """A table whose names are the user's, all with one kind of value."""

    kind: Kind
    names: str

    @property
    def allowed(self) -> str:
        """Allowed values, in words."""
        return f"a table of {self.names}"

    def read(self, value: Any, key: str, mistakes: Mistakes) -> dict[str, Any] | None:
        """Return the values by name."""
        if not isinstance(value, dict):
            mistakes.add(key, f"must be {self.allowed}, {got_value(value)}")
            return None
        return {name: self.kind.read(it, dotted(key, name), mistakes) for name, it in value.items()}


def read_keys(
    keys: tuple[Key, ...], value: Mapping[str, Any], path: str, mistakes: Mistakes
) -> dict[str, Any]:
    """Read the keys of a table, and note those that are unknown or missing."""
    known = {key.name: key for key in keys}
    for name in value:
        if name not in known:
            mistakes.add(dotted(path, name), f"is not a known key{suggestion(name, known)}")
    for key in keys:
        if key.default is None and key.name not in value:
            text = f"is missing: {key.meaning}, {key.kind.allowed}"
            mistakes.add(dotted(path, key.name), text)
    return {
        name: known[name].kind.read(it, dotted(path, name), mistakes)
        for name, it in value.items()
        if name in known
    }


@dataclasses.dataclass(frozen=True)
class Row:
    """One key as a page lists it; `variant` is the tag that it needs, "" if it needs none."""

    path: str
    variant: str
    key: Key


def flatten_keys(keys: tuple[Key, ...], path: str = "", variant: str = "") -> Iterator[Row]:
    """List keys with all keys below them."""
    for key in keys:
        here = dotted(path, key.name)
        yield Row(here, variant, key)
        yield from _below(key.kind, here, variant)


def _below(kind: Kind, path: str, variant: str) -> Iterator[Row]:
    if isinstance(kind, Either):
        yield from _below(kind.table, path, variant)
    elif isinstance(kind, KeyTable):
        yield from flatten_keys(kind.keys, path, variant)
    elif isinstance(kind, Each):
        yield from _below(kind.of, path, variant)
    elif isinstance(kind, Open):
        values = Key("NAME", kind.kind, f"one of the {kind.names}", default="")
        yield Row(f"{path}.NAME", variant, values)
        yield from _below(kind.kind, f"{path}.NAME", variant)
    elif isinstance(kind, Tagged):
        choice = Choice(tuple(kind.variants))
        default = None if kind.default is None else f'"{kind.default}"'
        yield Row(dotted(path, kind.tag), variant, Key(kind.tag, choice, "which", default=default))
        first, *others = kind.variants.values()
        shared = tuple(key for key in first if all(key in keys for keys in others))
        yield from flatten_keys(shared, path, variant)
        for tag, keys in kind.variants.items():
            yield from flatten_keys(tuple(key for key in keys if key not in shared), path, tag)


# All keys of all files: what they hold, their units, ranges and defaults.

ANY = Number()
POSITIVE = Number(above=0.0)
NOT_NEGATIVE = Number(least=0.0)
UNIT = Number(least=0.0, most=1.0)
STEP = Number(above=0.0, most=1.0)
MAX_NUM = 1_000_000
"""Most values of one range."""

SPAN = Key("t_span", Pair(ANY, ANY, ("t0", "t1 > t0")), "start and end", "s")
STATE = Pair(NOT_NEGATIVE, ANY, ("x", "xdot"))
START = Key("y0", STATE, "initial distance from the wall and velocity", "m, m/s")

LINEAR = KeyTable(
    (
        Key("stiffness", ANY, "k in -k x - c x' - g + A cos(omega t + phase)", "1/s^2", "0"),
        Key("damping", ANY, "c", "1/s", "0"),
        Key("gravity", ANY, "g, a pull towards the wall", "m/s^2", "0"),
        Key("amplitude", ANY, "A", "m/s^2", "0"),
        Key("omega", ANY, "omega", "rad/s", "1"),
        Key("phase", ANY, "phase", "rad", "0"),
    )
)
FORCE = Either(ANY, LINEAR)

WALL = KeyTable(
    (
        Key("amplitude", ANY, "a in offset + a cos(omega t + phase)", "m"),
        Key("omega", ANY, "omega", "rad/s"),
        Key("phase", ANY, "phase", "rad", "0"),
        Key("offset", ANY, "middle position", "m", "0"),
    )
)


def _e_or_kappa(of: str, default: str) -> tuple[Key, Key]:
    return (
        Key(f"e{of}", UNIT, "coefficient of restitution", "1", default),
        Key(f"kappa{of}", UNIT, "(1 - e)/(1 + e), instead of e", "1", default),
    )


def _setting(it: _zivi.Setting) -> Key:
    """Return a setting of a method, which the core knows, as a key."""
    kind: Kind
    if it.choices is not None:
        kind = Choice(it.choices)
    elif it.whole:
        kind = Whole(it.least, it.most) if it.most is not None else Whole(it.least)
    else:
        below, most = (None if bound == math.inf else bound for bound in (it.below, it.most))
        above = None if it.above == -math.inf else it.above
        kind = Number(above, it.least, below, most, infinite=it.most == math.inf)
    default = it.comes or (None if it.required else _toml_default(it.default))
    return Key(it.name, kind, it.meaning, it.unit, default)


def _toml_default(value: str | float) -> str:
    """Write a default as a file has it."""
    if isinstance(value, str):
        return f'"{value}"'
    return str(value) if isinstance(value, int) else f"{value:g}".replace("e-0", "e-")


_TABULATED = (
    Key("v", Numbers(NOT_NEGATIVE), "increasing speeds of impact", "m/s"),
    Key("e", Numbers(UNIT), "coefficients of restitution at them, linear between", "1"),
)
LAW = Tagged(
    "law",
    {name: tuple(map(_setting, given)) for name, given in _zivi.IMPACT_LAWS.items()}
    | {"RestitutionTable": _TABULATED},
)
_ONE = "one of e and kappa is required"


FRICTION = KeyTable(
    (
        Key("limit", NOT_NEGATIVE, "largest friction while it slips, per unit mass", "m/s^2"),
        Key("static", NOT_NEGATIVE, "the same while it sticks", "m/s^2", "limit"),
        Key("velocity", ANY, "velocity of the guide or belt", "m/s", "0"),
    )
)


def _system_key(e: Kind, meaning: str, *more: Key) -> Key:
    """Return the key of a system whose wall has an `e` of this kind."""
    keys = (
        Key("force", FORCE, "force per unit mass", "m/s^2"),
        Key("e", e, meaning, "1", _ONE),
        Key("kappa", UNIT, "(1 - e)/(1 + e), instead of e", "1", _ONE),
        Key("wall", WALL, "a wall that vibrates", default="the wall is fixed"),
        *more,
    )
    return Key("system", KeyTable(keys), "the mass and its wall")


MASS_SYSTEM = _system_key(
    Either(UNIT, LAW),
    "coefficient of restitution, or an impact law",
    Key("friction", FRICTION, "dry friction in a guide, beside a wall at rest", default="none"),
)
PLANT = _system_key(UNIT, "coefficient of restitution")


METHODS = {
    name: tuple(_setting(it) for it in settings) for name, settings in _zivi.SETTINGS.items()
}

RANGE = (
    Key("start", ANY, "first value"),
    Key("stop", ANY, "last value"),
    Key("num", Whole(1, MAX_NUM), "number of values", "1"),
)

SIMULATE = (
    SPAN,
    START,
    MASS_SYSTEM,
    Key("method", Tagged("name", METHODS, "SwitchedRK"), "the method", default="SwitchedRK"),
    Key(
        "t_eval",
        Either(Numbers(), KeyTable(RANGE)),
        "increasing times within t_span to report",
        "s",
        "all steps",
    ),
    Key("tstops", Numbers(), "times where the force is not smooth", "s", "none"),
)

_SOLVER, _LINEARISATIONS = (
    key for key in METHODS["ThetaGamma"] if key.name in ("solver", "linearisations")
)
_DEPTH, _HORIZON = (_setting(it) for it in _zivi.CONTROL_SETTINGS["TwistingTracker"])
TWISTING = (
    Key("mu1", POSITIVE, "gain on the sign of the position", "m/s^2"),
    Key("mu2", POSITIVE, "gain on the sign of the velocity, mu2 < mu1", "m/s^2"),
    Key("h", POSITIVE, "sampling period", "s"),
    *_e_or_kappa("", "that of system"),
    Key("bound", NOT_NEGATIVE, "bound of the unknown force; checks the gains", "m/s^2", "no check"),
    _DEPTH,
    Key(
        "u_limits",
        Pair(ANY, ANY, ("u_min", "u_max > u_min")),
        "range of the actuator",
        "m/s^2",
        "no limits",
    ),
)
LANDING = (
    Key("landing", Switch(), "whether a sampled loop ends in exact rest", default="true"),
    Key("ahead", Whole(1, 10**9), "horizon of the landing: 1 + delay", "1", "1"),
    Key("delay", Whole(0, 64), "periods over which the state is predicted", "1", "0"),
    Key("quiet", NOT_NEGATIVE, "velocity that the landing takes for noise", "m/s", "0"),
    _SOLVER,
    _LINEARISATIONS,
)
REFERENCE = _e_or_kappa("_ref", "that of the controller")
TRACKING = (
    Key("branch", Choice(twisting.BRANCHES), "how a measurement is lifted", default='"positive"'),
    Key("press", NOT_NEGATIVE, "acceleration towards the wall at rest", "m/s^2", "the law's"),
    _HORIZON,
    Key("shift", Switch(), "take the velocity half a period back in the air", default="false"),
)
CONTROLLERS = {
    kind.__name__: tuple(
        key
        for key in (*TWISTING, *LANDING, *REFERENCE, *TRACKING)
        if key.name in inspect.signature(kind).parameters
    )
    for kind in twisting.CONTROLLERS
}
IN_PYTHON = "a file has no code: a controller of your own is for zivi.simulate_closed_loop"
MEASURED = Pair(NOT_NEGATIVE, NOT_NEGATIVE, ("of x", "of xdot"))

CONTROL = (
    SPAN,
    START,
    PLANT,
    Key("controller", Tagged("name", CONTROLLERS, others=IN_PYTHON), "the controller"),
    Key("y_ref0", STATE, "initial state of the reference", "m, m/s", "at rest"),
    Key("force_ref", FORCE, "force on the reference", "m/s^2", "force_model"),
    Key("force_model", FORCE, "force that the controller believes in", "m/s^2", "system.force"),
    Key("noise", MEASURED, "standard deviations of the measurement", "m, m/s", "[0, 0]"),
    Key("seed", Whole(0), "seed of the noise", "1", "drawn, and kept in the result"),
    Key("quantization", MEASURED, "resolution of the measurement", "m, m/s", "[0, 0]"),
    Key("delay", Whole(0, 10**9), "periods until a control acts", "1", "0"),
    Key(
        "method",
        Tagged(
            "name", {name: METHODS[name] for name in ("SwitchedRK", "ThetaGamma")}, "SwitchedRK"
        ),
        "how the plant moves between samples",
        default="exactly where the force is constant, else SwitchedRK, rtol 1e-9, atol 1e-12",
    ),
)

VALUES = Either(
    Numbers(),
    KeyTable(
        (
            Key("start", ANY, "first value, or lower bound of a sample", "the parameter's"),
            Key("stop", ANY, "last value, or upper bound", "the parameter's"),
            Key("num", Whole(1, MAX_NUM), "number of values", "1", "required, none for a sample"),
            Key("log", Switch(), "even in the logarithm; start and stop > 0", default="false"),
        )
    ),
)
DESIGNS = {
    "grid": (),
    "list": (),
    "sample": (
        Key("n", Whole(1, MAX_NUM), "number of points", "1"),
        Key("sampler", Choice(("sobol", "lhs", "halton")), "what draws", default='"sobol"'),
        Key("seed", Whole(0), "seed of the sampler", "1", "0"),
    ),
}

SWEEP = (
    Key(
        "experiment",
        Choice(tuple(EXPERIMENTS), "the name of an experiment"),
        "what is computed, see `--experiments`",
    ),
    Key("parameters", Open(VALUES, "parameters of the experiment"), "where it is computed"),
    Key("fixed", Open(ANY, "parameters of the experiment"), "further parameters", default="none"),
    Key("design", Tagged("kind", DESIGNS, "grid"), "which points", default='kind = "grid"'),
    Key(
        "executor",
        Choice(("serial", "threads", "processes")),
        "who computes",
        default='"serial"',
    ),
    Key("workers", Whole(1), "threads or processes", "1", "number of cores"),
    Key("seed", Whole(0), "seed of an experiment that draws", "1", "drawn, kept in the result"),
    Key(
        "chunk",
        Whole(1),
        "points of a task and of a file at most",
        "1",
        "tasks of half a second, files of 256 MB",
    ),
)


# All keys of a file of a mechanical system.

FORMULA = Expression()
RESTITUTIONS = Key(
    "e", OneOrEach(Either(UNIT, LAW)), "restitution or law, of all gaps or of each", "1", "0"
)
SHARED = {key.name: key for key in SIMULATE}

MECHANICAL_SYSTEM = KeyTable(
    (
        Key("q", Names(), "the coordinates; the velocity of x is xdot, the time t"),
        Key("T", FORMULA, "kinetic energy, quadratic in the velocities"),
        Key("V", FORMULA, "potential energy", default="0"),
        Key("Q", Each(FORMULA, "expressions"), "other forces, one for each of q", default="none"),
        Key("gaps", Open(FORMULA, "gaps"), "what stays >= 0, by name", default="none"),
        Key("parameters", Open(ANY, "parameters"), "values of all other names", default="none"),
        RESTITUTIONS,
        Key(
            "slips",
            Open(FORMULA, "gaps"),
            "slip speeds of gaps with dry friction, linear in the velocities",
            default="none",
        ),
        Key("mu", Open(Few(("mu", "mu_static"), 1), "gaps"), "their coefficients", "1", "none"),
        Key("e_t", Open(UNIT, "gaps"), "their tangential restitutions", "1", "0"),
        Key(
            "friction",
            Open(Few(("slip speed", "limit", "static limit"), 2), "joints"),
            "dry friction in joints, by names of yours",
            default="none",
        ),
        Key(
            "impact_law",
            Choice(IMPACT_LAWS),
            "the law of impacts with friction",
            default='"newton"',
        ),
        Key(
            "paradox",
            Choice(PARADOXES),
            "what follows where a sliding contact is jammed",
            default='"stop"',
        ),
    )
)

MECHANICS = (
    SHARED["t_span"],
    Key("y0", Each(Numbers(), "two lists of numbers, [q0, qdot0]"), "coordinates and velocities"),
    Key("system", MECHANICAL_SYSTEM, "the system, by its energies"),
    Key(
        "method",
        Tagged(
            "name",
            {name: METHODS[name] for name, it in _zivi.METHODS.items() if it.takes_mechanism}
            # of this family the one member only
            | {"ThetaGamma": (Key("h", POSITIVE, "step", "s"),)},
            "SwitchedRK",
        ),
        "the method",
        default="SwitchedRK",
    ),
    SHARED["t_eval"],
    SHARED["tstops"],
)


def is_mechanism(content: Mapping[str, Any]) -> bool:
    """Whether a file describes a mechanical system, and not a mass above a wall."""
    system = content.get("system")
    return isinstance(system, dict) and bool({"q", "T", "V", "Q", "gaps"} & set(system))


# All keys of a file of a tree of bodies, and such a file from a tree.


@dataclasses.dataclass(frozen=True)
class Text:
    """A name of any characters."""

    allowed = "a name"

    def read(self, value: Any, key: str, mistakes: Mistakes) -> str | None:
        """Return the name."""
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
        """Allowed values, in words."""
        return "three rows of three numbers" if self.rows else "a list of three numbers"

    def read(self, value: Any, key: str, mistakes: Mistakes) -> Any:
        """Return lists of floats."""
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
        """Return a float or lists of floats."""
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
    Key("friction", NOT_NEGATIVE, "dry friction of the joint in slip", "N m or N", "0"),
    Key("friction_static", NOT_NEGATIVE, "what it holds in stick", "N m or N", "friction"),
    Key("torque", ANY, "a constant torque or force", "N m or N", "0"),
    Key("reference", ANY, "coordinate at which the frame is at position", "rad or m", "0"),
    Key("coordinate", NAME, "name of the coordinate", default="that of the body"),
)
BALL = (
    Key("body", NAME, "the body"),
    Key("point", POINT, "centre of its ball", "m", "[0, 0, 0]"),
)
CALLED = Key("name", NAME, "name of the gap", default="that of the body")
ROUGH = (
    Key("mu", NOT_NEGATIVE, "coefficient of dry friction", "1", "0"),
    Key("mu_static", NOT_NEGATIVE, "coefficient of friction in stick", "1", "mu"),
)
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
            *ROUGH,
            CALLED,
        ),
        "ball": (
            *BALL,
            Key("other", NAME, "the other body", default="the world"),
            Key("other_point", POINT, "centre of the other ball", "m", "[0, 0, 0]"),
            Key("radius", POSITIVE, "the sum of both radii", "m"),
            *ROUGH,
            Key("share", UNIT, "part of radius that belongs to body", "1", "0.5"),
            CALLED,
        ),
    },
)
SHAPES = {"ball": Ball, "box": Box, "capsule": Capsule, "plane": Plane}
_CENTER = Key("center", POINT, "its middle in the frame of the body", "m", "[0, 0, 0]")
_OWNER = Key("body", NAME, "its body", default="that of the same name, or else the world")
SHAPE = Tagged(
    "kind",
    {
        "ball": (Key("radius", POSITIVE, "radius", "m"), _CENTER, _OWNER),
        "box": (Key("half_extents", POINT, "half its edges", "m"), _CENTER, _OWNER),
        "capsule": (
            Key("radius", POSITIVE, "radius", "m"),
            Key("half_length", POSITIVE, "half the distance of its ends' centres", "m"),
            Key("axis", POINT, "its direction in the frame of the body", default="[0, 0, 1]"),
            _CENTER,
            _OWNER,
        ),
        "plane": (
            Key("normal", POINT, "its normal, in axes of the world", default="[0, 0, 1]"),
            Key("offset", ANY, "its distance from the origin along the normal", "m", "0"),
            Key("point", POINT, "one of its points, instead of offset", "m", "none"),
        ),
    },
)
CONTACT = KeyTable(
    (
        Key("first", NAME, "a shape"),
        Key("second", NAME, "another shape"),
        *ROUGH,
        Key("e", Either(UNIT, LAW), "restitution or law", "1", "that of the tree"),
        Key("name", NAME, "name of its gaps", default="first-second"),
    )
)
CHOICES = tuple(key for key in MECHANICAL_SYSTEM.keys if key.name in ("impact_law", "paradox"))
TREE_SYSTEM = KeyTable(
    (
        Key("bodies", Each(KeyTable(BODY), "tables"), "the bodies, parents before children"),
        Key("gaps", Each(GAP, "tables"), "the gaps", default="none"),
        Key("shapes", Open(SHAPE, "shapes"), "shapes of bodies and of the world", default="none"),
        Key("contacts", Each(CONTACT, "tables"), "contacts of shapes", default="none"),
        Key("gravity", POINT, "acceleration of free fall", "m/s^2", "[0, 0, -9.81]"),
        RESTITUTIONS,
        *CHOICES,
        Key("parameters", Open(ANY, "parameters"), "other values, by their names", default="none"),
    )
)
_OF_TREE = {
    "system": Key("system", TREE_SYSTEM, "the tree of bodies"),
    "y0": Key(
        "y0",
        Each(Numbers(), "two lists of numbers, [q0, qdot0]"),
        "coordinates and velocities; with free bodies or ball joints [qpos, qvel]",
    ),
}
TREE = tuple(_OF_TREE.get(key.name, key) for key in MECHANICS)


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
        Coordinates and velocities, as for `zivi.simulate`: ``(q, qdot)`` or ``(qpos, qvel)``.

    Returns
    -------
    str
        The file, in TOML, which needs neither MuJoCo nor Python code. Contacts of shapes are
        written as their gaps.

    Raises
    ------
    ValueError
        If `y0` has another number of coordinates than the tree.
    NotImplementedError
        For constraints, inputs and compliant gaps.

    Examples
    --------
    >>> from zivi.mechanics import Body, PlaneGap
    >>> bob = Body("bob", axis=[0, 1, 0], mass=2.0, com=[0, 0, -1], inertia=0.01)
    >>> tree = zivi.Tree([bob], gaps=[PlaneGap("bob", [0, 0, -1], offset=-0.8)], e=0.5)
    >>> print(zivi.files.tree_text(tree, (0, 2), ([1.5], [0.0])).splitlines()[-1])
    offset = -0.8
    """
    if tree.constraints:
        raise NotImplementedError(
            "constraints are not supported by zivi.files.tree_text; use zivi.simulate, got "
            f"{', '.join(map(repr, tree.equality_names))}"
        )
    compliant = [it.name for it in tree._structure.sides if it.gap.contact is not None]
    if compliant or tree._given_inputs is not None:
        what = f"compliant gaps ({', '.join(compliant)})" if compliant else "inputs"
        raise NotImplementedError(
            f"{what} are not supported by zivi.files.tree_text; use zivi.simulate"
        )
    start = [np.asarray(part, dtype=float).tolist() for part in y0]
    n = len(tree._coordinates or ())
    if [len(part) for part in start] not in ([n, n], [tree.nq, n]):
        sizes = f"two lists of {n}" if tree.nq == n else f"lists of {tree.nq} and {n} or two of {n}"
        raise ValueError(f"y0 must have {sizes}, got {start}")
    first = {"t_span": [float(t) for t in t_span], "y0": start}
    made = dict(tree._structure.values(tree._gravity))
    changed = {name: value for name, value in tree.parameters.items() if made[name] != value}
    gravity = np.asarray(tree._gravity).tolist()
    system = {"gravity": gravity, "e": _laws(tree)} if len(tree._e) else {"gravity": gravity}
    system |= tree._chosen()
    if changed:
        system["parameters"] = changed
    parts = [_toml_lines(first), "[system]", _toml_lines(system)]
    kinds = {kind: name for name, kind in GAPS.items()}
    rough = {
        it.direction: {"friction": it.limit, "friction_static": it.static} for it in tree.friction
    }
    for body in tree.bodies:
        of_joint = rough.get(body.joint, {}) if body.moves else {}
        told = {name: value for name, value in of_joint.items() if value is not None}
        parts += ["[[system.bodies]]", _toml_lines(_not_default(body) | told)]
    for gap in tree._structure.gaps:
        parts += ["[[system.gaps]]", _toml_lines({"kind": kinds[type(gap)]} | _not_default(gap))]
    return "\n".join(parts)


def _laws(tree: Tree) -> list[Any]:
    """Return the coefficients of restitution, or tables of laws if one is not Newton's."""
    if not isinstance(tree._e, tuple):
        numbers: list[Any] = tree._e.tolist()
        return numbers
    return [
        law.e if isinstance(law, NewtonImpact) else {"law": type(law).__name__} | _not_default(law)
        for law in tree._e
    ]


def _not_default(it: Any) -> dict[str, Any]:
    """Return the fields that are not their defaults."""
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


def _toml_lines(values: Mapping[str, Any]) -> str:
    return "".join(f"{key} = {_toml_value(value)}\n" for key, value in values.items()).rstrip("\n")


def _toml_value(value: Any) -> str:
    if isinstance(value, Mapping):
        inner = ", ".join(f"{json.dumps(key)} = {_toml_value(it)}" for key, it in value.items())
        return f"{{ {inner} }}"
    if isinstance(value, list):
        return f"[{', '.join(map(_toml_value, value))}]"
    return json.dumps(value, ensure_ascii=False)


# Tables of all keys of a file, for the page of the command line and ``--keys``.
#
FIT_RANGE = Pair(ANY, ANY, ("lower", "upper > lower"))
SIGMA = Key("sigma", POSITIVE, "standard deviation of the data", default="estimated")
CSV = Key("file", NAME, "CSV file with a row of names, beside this file", default="none")
OTHER_RUN = Key(
    "y0",
    Each(Numbers(), "two lists of numbers, [q0, qdot0]"),
    "initial state of another run, which these data and those after them measure",
    default="of the run before",
)
DATA = Tagged(
    "kind",
    {
        "bounces": (
            CSV,
            Key("times", Numbers(), "times of impacts, without a file", "s", "those of file"),
            Key("column", NAME, "column of the file", default='"t"'),
            SIGMA,
            Key("gap", NAME, "gap that is hit", default="any"),
            Key("missed", NOT_NEGATIVE, "cost of a missed impact, in sigma", "1", "3"),
            Key("spurious", NOT_NEGATIVE, "cost of a spurious time, in sigma", "1", "3"),
            OTHER_RUN,
        ),
        "record": (
            CSV,
            Key("t", Numbers(), "times of samples, without a file", "s", "those of file"),
            Key("values", Numbers(), "their values", default="those of file"),
            Key("time", NAME, "column of the times", default='"t"'),
            Key("column", NAME, "column of the values", default="of"),
            Key("of", NAME, "coordinate, velocity, gap or reaction", default='"x"'),
            SIGMA,
            OTHER_RUN,
        ),
    },
)
FIT = (
    Key("params", Each(NAME, "names"), "parameters to estimate, as of `zivi.fit`"),
    Key("own", Each(NAME, "names"), "parameters with a value for each run", default="none"),
    Key("data", Each(DATA, "tables"), "measurements"),
    Key("bounds", Open(FIT_RANGE, "parameters"), "their bounds", default="e in [0, 1]"),
    Key(
        "prior",
        Open(Pair(ANY, POSITIVE, ("mean", "sigma")), "parameters"),
        "prior knowledge",
        default="none",
    ),
    Key("starts", Whole(1, 10_000), "number of starts", "1", "8"),
    Key("seed", Whole(0), "seed of the starts", "1", "0"),
    Key(
        "loss",
        Choice(("linear", "soft_l1", "huber", "cauchy", "arctan")),
        "loss function of the residuals",
        default='"linear"',
    ),
    Key("t0", ANY, "time of y0 by the clock of the data", "s", "0"),
)


# Each command has a table, and so has each object that several commands or keys take: where one of
# these is a value, the table of the command has a link in place of its keys.

COMMANDS = {
    "simulate": SIMULATE,
    "mechanics": MECHANICS,
    "tree": TREE,
    "control": CONTROL,
    "sweep": SWEEP,
    "fit": FIT,
}
HEAD = "| key | only for | unit | allowed | default | meaning |\n|---|---|---|---|---|---|\n"


def _tagged(keys: tuple[Key, ...], name: str) -> Tagged:
    kind = next(key.kind for key in keys if key.name == name)
    if not isinstance(kind, Tagged):
        raise TypeError(f"{name} does not have variants")
    return kind


OBJECTS: dict[str, tuple[str, KeyTable | Tagged]] = {
    "force": ("force force_ref force_model", LINEAR),
    "wall": ("wall", WALL),
    "method": ("method", _tagged(SIMULATE, "method")),
    "controller": ("controller", _tagged(CONTROL, "controller")),
    "times": ("t_eval", KeyTable(RANGE)),
}
"""What has a table of its own: the keys that may hold it, and its own keys."""


def markdown(keys: tuple[Key, ...]) -> str:
    """Return the table of the keys of a command, with links where an object is a value."""
    linked = ""
    shown: list[tuple[str, tuple[str, ...]]] = []
    for row in flatten_keys(keys):
        if linked and row.path.startswith(linked):
            continue
        link = next((it for it, (of, _) in OBJECTS.items() if row.key.name in of.split()), None)
        linked = f"{row.path}." if link else ""
        shown.append((row.variant, _key_cells(row, _see(link, row.key) if link else "")))
    return _markdown_table(iter(shown))


def of_object(name: str) -> str:
    """Return the table of the keys of an object."""
    kind = OBJECTS[name][1]
    found = flatten_keys((Key(name, kind, ""),))
    return _markdown_table((row.variant, _key_cells(row)) for row in found if row.path != name)


def _see(name: str, key: Key) -> str:
    """Return the link to an object, with the restrictions that apply here."""
    said = f", see [{name}](#{name})"
    of, here = OBJECTS[name][1], key.kind
    if isinstance(of, Tagged) and isinstance(here, Tagged):
        for variant, keys in here.variants.items():
            if len(keys) < len(of.variants[variant]):
                said += f", of {variant} only {', '.join(it.name for it in keys)}"
    return said


def _markdown_table(found: Iterator[tuple[str, tuple[str, ...]]]) -> str:
    """Write rows; those that several kinds of a thing share are one."""
    kinds: dict[tuple[str, ...], list[str]] = {}
    for variant, cells in found:
        kinds.setdefault(cells, []).append(variant)
    return HEAD + "".join(
        f"| {path} | {', '.join(filter(None, only))} | {' | '.join(rest)} |\n"
        for (path, *rest), only in kinds.items()
    )


def _key_cells(row: Row, more: str = "") -> tuple[str, ...]:
    key = row.key
    default = "**required**" if key.default is None else key.default
    allowed = getattr(key.kind, "words", "") or key.kind.allowed
    return f"`{row.path}`", key.unit, allowed + more, default, key.meaning


MARK = re.compile(r"^<!-- keys of (\w+) -->$", re.MULTILINE)
"""Where a page has a table."""


def insert(page: str) -> str:
    """Insert the tables of commands and objects at their marks in a page."""

    def table(match: re.Match[str]) -> str:
        name = match[1]
        return markdown(COMMANDS[name]) if name in COMMANDS else of_object(name)

    return MARK.sub(table, page)


def keys_as_text(*names: str) -> str:
    """Return the tables of kinds of files and of their objects."""
    tables = [f"# {name}\n\n{markdown(COMMANDS[name])}" for name in names]
    for name in OBJECTS:
        if any(f"(#{name})" in table for table in tables):
            tables.append(f"# {name}\n\n{of_object(name)}")
    return "\n".join(tables)
