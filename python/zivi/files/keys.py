"""All keys of all files: what they hold, their units, ranges and defaults."""

from __future__ import annotations

import inspect
import math

import zivi._zivi as _zivi
from zivi.control import twisting
from zivi.files.kinds import Choice, Either, Kind, Number, Numbers, Pair, Switch, Whole
from zivi.files.tables import Key, Open, Table, Tagged
from zivi.study import EXPERIMENTS

__all__ = ["CONTROL", "MAX_NUM", "SIMULATE", "SWEEP"]

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

LINEAR = Table(
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

WALL = Table(
    (
        Key("amplitude", ANY, "a in offset + a cos(omega t + phase)", "m"),
        Key("omega", ANY, "omega", "rad/s"),
        Key("phase", ANY, "phase", "rad", "0"),
        Key("offset", ANY, "middle position", "m", "0"),
    )
)


def _restitution(of: str, default: str) -> tuple[Key, Key]:
    return (
        Key(f"e{of}", UNIT, "coefficient of restitution", "1", default),
        Key(f"kappa{of}", UNIT, "(1 - e)/(1 + e), instead of e", "1", default),
    )


def _setting(it: _zivi.Setting) -> Key:
    """Give a setting of a method, which the core knows, as a key."""
    kind: Kind
    if it.choices is not None:
        kind = Choice(it.choices)
    elif it.whole:
        kind = Whole(it.least, it.most) if it.most is not None else Whole(it.least)
    else:
        below, most = (None if bound == math.inf else bound for bound in (it.below, it.most))
        above = None if it.above == -math.inf else it.above
        kind = Number(above, it.least, below, most, infinite=it.most == math.inf)
    default = it.comes or (None if it.required else _written(it.default))
    return Key(it.name, kind, it.meaning, it.unit, default)


def _written(value: str | float) -> str:
    """Write a default as a file has it."""
    if isinstance(value, str):
        return f'"{value}"'
    return str(value) if isinstance(value, int) else f"{value:g}".replace("e-0", "e-")


LAW = Tagged(
    "law", {name: tuple(map(_setting, given)) for name, given in _zivi.IMPACT_LAWS.items()}
)
_ONE = "one of e and kappa is required"


FRICTION = Table(
    (
        Key("limit", NOT_NEGATIVE, "largest friction while it slips, per unit mass", "m/s^2"),
        Key("static", NOT_NEGATIVE, "the same while it sticks", "m/s^2", "limit"),
        Key("velocity", ANY, "velocity of the guide or belt", "m/s", "0"),
    )
)


def _system(e: Kind, meaning: str, *more: Key) -> Key:
    """Give the key of a system whose wall has an `e` of this kind."""
    keys = (
        Key("force", FORCE, "force per unit mass", "m/s^2"),
        Key("e", e, meaning, "1", _ONE),
        Key("kappa", UNIT, "(1 - e)/(1 + e), instead of e", "1", _ONE),
        Key("wall", WALL, "a wall that vibrates", default="the wall is fixed"),
        *more,
    )
    return Key("system", Table(keys), "the mass and its wall")


SYSTEM = _system(
    Either(UNIT, LAW),
    "coefficient of restitution, or an impact law",
    Key("friction", FRICTION, "dry friction in a guide, beside a wall at rest", default="none"),
)
PLANT = _system(UNIT, "coefficient of restitution")


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
    SYSTEM,
    Key("method", Tagged("name", METHODS, "SwitchedRK"), "the method", default="SwitchedRK"),
    Key(
        "t_eval",
        Either(Numbers(), Table(RANGE)),
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
    *_restitution("", "that of system"),
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
REFERENCE = _restitution("_ref", "that of the controller")
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
    Table(
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
