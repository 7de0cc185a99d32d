"""Single runs and studies from files: ``zivi simulate``, ``control`` and ``sweep``."""

from __future__ import annotations

import dataclasses
import inspect
import math
import re
import tomllib
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np

from zivi.control import twisting
from zivi.control.closed_loop import simulate_closed_loop
from zivi.control.loop_run import ClosedLoop
from zivi.files.file_keys import (
    CONTROL,
    GAPS,
    MECHANICS,
    SHAPES,
    SIMULATE,
    SWEEP,
    TREE,
    Key,
    is_mechanism,
    is_tree,
    read_keys,
)
from zivi.files.kinds import FileError, Mistakes, dotted, suggestion
from zivi.simulation.mechanical_trajectory import MechanicalTrajectory
from zivi.simulation.methods import METHODS
from zivi.simulation.run import simulate
from zivi.simulation.trajectory import Trajectory
from zivi.study import EXPERIMENTS, Design, Study, grid, points, sample, sweep
from zivi.system.gap import DryFriction, HarmonicWall
from zivi.system.impact_law import LAWS
from zivi.system.mass import Force, ImpactSystem, LinearForce
from zivi.system.mechanism import MechanicalSystem
from zivi.system.space import Contact
from zivi.system.symbolic_system import SymbolicSystem, system as symbolic_system
from zivi.system.tree import Tree
from zivi.system.tree_bodies import Body

# Reads a file into checked values.

Keys: TypeAlias = tuple[Key, ...]

LARGEST = 50_000_000
"""Bytes of a file that is read."""
DEEPEST = 50
"""Parts of a key, parted by dots: tomllib takes a time that grows with their square."""
PART = r"""(?:[\w-]++|"[^"\n]*+"|'[^'\n]*+')[ \t]*+"""
DEEP = re.compile(rf"(?<![\w-])(?:{PART}\.[ \t]*+){{{DEEPEST}}}")


@dataclasses.dataclass(frozen=True)
class FileContent:
    """Content of a file.

    Parameters
    ----------
    values : dict
        The values of the keys that are there, checked one by one.
    mistakes : Mistakes
        For what only shows when they are put together.
    """

    values: dict[str, Any]
    mistakes: Mistakes


def read_file(
    path: Path, keys: Keys | Callable[[dict[str, Any]], Keys], command: str | None = None
) -> FileContent:
    """Read a file; a `FileError` tells all that is wrong with it.

    Parameters
    ----------
    path : Path
        The file.
    keys : tuple of Key, or callable
        Its keys, or a function that returns them for the content.
    command : str, optional
        The command that reads it; a file for another one is rejected in one line.
    """
    mistakes = Mistakes(path)
    content = _parse_toml(path)
    meant = command_of(content)
    if command is not None and meant not in (command, None):
        raise FileError(f"{path}: is a file for zivi {meant}, not for zivi {command}")
    values = read_keys(keys(content) if callable(keys) else keys, content, "", mistakes)
    mistakes.stop()
    return FileContent(values, mistakes)


def command_of(content: dict[str, Any]) -> str | None:
    """Return the command whose files have the keys of a file, None if several do or none."""
    found = [
        command
        for command, key in {"simulate": "system", "sweep": "experiment"}.items()
        if key in content
    ]
    if len(found) != 1:
        return None
    if "params" in content or "data" in content:
        return "fit" if found == ["simulate"] else None
    if "controller" in content:
        return "control" if found == ["simulate"] else None
    return found[0]


def _parse_toml(path: Path) -> dict[str, Any]:
    try:
        if path.stat().st_size > LARGEST:
            raise FileError(f"{path}: is larger than {LARGEST // 10**6} MB")
        # a byte order mark is no content, and lines may end as they do elsewhere
        text = path.read_text("utf-8-sig")
        if deep := DEEP.search(text):
            line = text.count("\n", 0, deep.start()) + 1
            raise FileError(f"{path}: a key must have at most {DEEPEST} parts (line {line})")
        return tomllib.loads(text)
    except FileNotFoundError:
        raise FileError(f"{path}: does not exist") from None
    except tomllib.TOMLDecodeError as error:  # it tells line and column
        raise FileError(f"{path}: is not a TOML file: {error}") from None
    except UnicodeDecodeError as error:
        raise FileError(f"{path}: is not UTF-8 text (byte {error.start})") from None
    except (OSError, RecursionError) as error:
        reason = getattr(error, "strerror", None) or "too deeply nested"
        raise FileError(f"{path}: cannot be read: {reason}") from None


# Builds systems, methods and controllers from checked values.


def build_force(value: Any) -> Force:
    """Build a force from a number or coefficients."""
    return LinearForce(**value) if isinstance(value, dict) else value


def build_system(values: dict[str, Any], mistakes: Mistakes) -> ImpactSystem:
    """Build a system."""
    wall = values.get("wall")
    given: dict[str, Any] = {name: values[name] for name in ("e", "kappa") if name in values}
    given = with_law(given, mistakes)
    if friction := values.get("friction"):
        with mistakes.naming(argument_keys("system.friction", friction), "system.friction"):
            given["friction"] = DryFriction(**friction)
    with mistakes.naming(argument_keys("system", (*given, "wall")), "system"):
        return ImpactSystem(
            build_force(values["force"]),
            wall=None if wall is None else HarmonicWall(**wall),
            **given,
        )


def with_law(values: dict[str, Any], mistakes: Mistakes) -> dict[str, Any]:
    """Build the impact laws among what `e` has, one or a list."""
    e = values.get("e")
    if isinstance(e, list):
        return values | {"e": [law(it, f"system.e[{n}]", mistakes) for n, it in enumerate(e)]}
    return values if e is None else values | {"e": law(e, "system.e", mistakes)}


def law(value: Any, key: str, mistakes: Mistakes) -> Any:
    """Build an impact law from its table; a number stays one."""
    if not isinstance(value, dict):
        return value
    settings = {name: it for name, it in value.items() if name != "law"}
    with mistakes.naming(argument_keys(key, settings), key):
        return LAWS[value["law"]](**settings)


def build_mechanism(values: dict[str, Any], mistakes: Mistakes) -> MechanicalSystem:
    """Build a mechanical system from its energies."""
    values = with_law(values, mistakes)
    with mistakes.naming(argument_keys("system", values), "system"):
        return symbolic_system(**values)


def build_tree(values: dict[str, Any], mistakes: Mistakes) -> Tree:
    """Build a tree of bodies."""
    settings_of = ("gravity", "e", "impact_law", "paradox")
    given = {name: it for name, it in values.items() if name in settings_of}
    settings = with_law(given, mistakes)
    names = ("bodies", "gaps", *settings_of)
    tables = values.get("shapes", {})
    keys = {name: dotted("system.shapes", name) for name in tables}
    shapes = {name: shape(it, keys[name], mistakes) for name, it in tables.items()}
    contacts = [
        contact(it, f"system.contacts[{n}]", mistakes)
        for n, it in enumerate(values.get("contacts", ()))
    ]
    with mistakes.naming(keys | argument_keys("system", names), "system"):
        of_joints = ("friction", "friction_static")
        bodies = [
            Body(**{name: it for name, it in body.items() if name not in of_joints})
            for body in values["bodies"]
        ]
        friction = [
            DryFriction(body.joint, it.get("friction", 0.0), it.get("friction_static"))
            for body, it in zip(bodies, values["bodies"], strict=True)
            if any(it.get(name) for name in of_joints)
        ]
        gaps = [
            GAPS[gap["kind"]](**{name: it for name, it in gap.items() if name != "kind"})
            for gap in values.get("gaps", ())
        ]
        found = Tree(
            bodies, gaps=gaps, friction=friction, contacts=contacts, shapes=shapes, **settings
        )
    for name, value in values.get("parameters", {}).items():
        key = f"system.parameters.{name}"
        if name not in found.parameters:
            known = ", ".join(found.parameters)
            mistakes.add(key, f"is not a parameter of the tree; allowed: {known}")
            mistakes.stop()
        with mistakes.naming({}, key):
            found.parameters[name] = value
    return found


def shape(value: dict[str, Any], key: str, mistakes: Mistakes) -> Any:
    """Build a shape of a body or of the world from its table."""
    given = {name: it for name, it in value.items() if name != "kind"}
    with mistakes.naming(argument_keys(key, given), key):
        return SHAPES[value["kind"]](**given)


def contact(value: dict[str, Any], key: str, mistakes: Mistakes) -> Contact:
    """Build a contact of two shapes from its table."""
    given = value | ({"e": law(value["e"], f"{key}.e", mistakes)} if "e" in value else {})
    with mistakes.naming(argument_keys(key, given), key):
        return Contact(**given)


def build_method(values: dict[str, Any], mistakes: Mistakes) -> Any:
    """Build a method by its name."""
    settings = {name: value for name, value in values.items() if name != "name"}
    with mistakes.naming(argument_keys("method", settings), "method"):
        return METHODS[values["name"]](**settings)


def build_controller(
    values: dict[str, Any], plant: ImpactSystem, keys: dict[str, str], mistakes: Mistakes
) -> Any:
    """Build a controller by its name; its default wall is the plant's."""
    settings = {name: value for name, value in values.items() if name != "name"}
    names = argument_keys("controller", settings)
    names |= dict.fromkeys(("u_min", "u_max"), "controller.u_limits")
    if not ("e" in settings or "kappa" in settings):
        settings["kappa"] = plant.kappa
        names |= {"e": keys["e"], "kappa": keys["kappa"]}
    with mistakes.naming(names, "controller"):
        return getattr(twisting, values["name"])(**settings)


def argument_keys(table: str, names: Iterable[str]) -> dict[str, str]:
    """Return the key of each argument that a table holds."""
    return {name: f"{table}.{name}" for name in names}


def restitution_key(values: dict[str, Any]) -> dict[str, str]:
    """Return the key of the restitution of a system, ``e`` or ``kappa``."""
    key = "system.kappa" if "kappa" in values else "system.e"
    return {"e": key, "kappa": key}


def spaced(values: dict[str, Any], *, log: bool = False) -> np.ndarray:
    """Return the values of a range."""
    make = np.geomspace if log else np.linspace
    return make(values["start"], values["stop"], values["num"])


# Single runs from files: ``zivi simulate`` and ``zivi control``.

Run: TypeAlias = Trajectory | ClosedLoop | MechanicalTrajectory
"""What a single run gives."""

PAIRS = {"x0": "y0", "xdot0": "y0", "x_ref": "y_ref0", "xdot_ref": "y_ref0"}
"""The arguments that the library names where a pair is wrong, and their keys."""


@dataclasses.dataclass(frozen=True)
class Prepared:
    """A run whose file was read and whose parts were built.

    Parameters
    ----------
    call : callable
        The run, called with whether to show progress.
    keys : dict
        The key of each argument that an error may name.
    mistakes : Mistakes
        Of the file.
    """

    call: Callable[[bool | None], Run]
    keys: dict[str, str]
    mistakes: Mistakes

    def run(self, progress: bool | None = None) -> Run:
        """Run it; raise a `FileError` for a fault that only the whole reveals."""
        with self.mistakes.naming(self.keys):
            return self.call(progress)


def plant_of(path: Path) -> tuple[dict[str, Any], Any, Mistakes]:
    """Read a file of ``zivi simulate``: its values, the system, and its list of mistakes."""
    content = read_file(path, keys_of_run, "simulate")
    values, mistakes = content.values, content.mistakes
    return values, system_of(values, mistakes), mistakes


def system_of(values: dict[str, Any], mistakes: Mistakes) -> Any:
    """Build the system of a file, whatever its kind."""
    builds: Callable[[dict[str, Any], Mistakes], Any] = build_system
    if is_tree(values):
        builds = build_tree
    elif is_mechanism(values):
        builds = build_mechanism
    return builds(values["system"], mistakes)


def prepare_simulate(path: Path) -> Prepared:
    """Read a file of ``zivi simulate``."""
    values, plant, mistakes = plant_of(path)
    keys = {name: name for name in ("t_span", "y0", "t_eval", "tstops")} | {"h": "method.h"}
    if isinstance(plant, MechanicalSystem):
        keys |= dict.fromkeys(("q0", "qdot0", "quaternion", "qpos", "qvel"), "y0")
    else:
        keys |= PAIRS | restitution_key(values["system"])
    arguments: dict[str, Any] = {"t_eval": _read_times(values.get("t_eval"), mistakes)}
    if "tstops" in values:
        arguments["tstops"] = np.array(values["tstops"])
    if "method" in values:
        arguments["method"] = build_method(values["method"], mistakes)

    def call(progress: bool | None) -> Run:
        run: Run = simulate(plant, values["t_span"], values["y0"], progress=progress, **arguments)
        return run

    return Prepared(call, keys, mistakes)


def keys_of_run(content: dict[str, Any]) -> tuple[Key, ...]:
    """Return the keys of a file of ``zivi simulate`` by the kind of its system."""
    if is_tree(content):
        return TREE
    return MECHANICS if is_mechanism(content) else SIMULATE


def _read_times(value: Any, mistakes: Mistakes) -> np.ndarray | None:
    if not isinstance(value, dict):
        return None if value is None else np.array(value)
    if value["start"] > value["stop"]:
        mistakes.add("t_eval.stop", f"must be >= start, got {value['stop']}")
        mistakes.stop()
    return spaced(value)


OPTIONS = ("y_ref0", "noise", "seed", "quantization", "delay")
"""Keys that are arguments as they are."""
FORCES = ("force_ref", "force_model")


def prepare_control(path: Path) -> Prepared:
    """Read a file of ``zivi control``."""
    content = read_file(path, CONTROL, "control")
    values, mistakes = content.values, content.mistakes
    plant = build_system(values["system"], mistakes)
    wall = restitution_key(values["system"])
    law = build_controller(values["controller"], plant, wall, mistakes)
    if not hasattr(law, "x_ref"):
        name = values["controller"]["name"]
        for key in ("y_ref0", "force_ref"):
            if key in values:
                mistakes.add(key, f"must be left out: a {name} does not follow a reference")
        mistakes.stop()
    options = {name: values[name] for name in OPTIONS if name in values}
    options |= {name: build_force(values[name]) for name in FORCES if name in values}
    if "method" in values:
        options["method"] = build_method(values["method"], mistakes)
    keys = {name: name for name in (*OPTIONS, *FORCES, "t_span", "y0")} | PAIRS | wall
    keys |= {"h": "controller.h", "method": "method", "controller": "controller"}

    def call(progress: bool | None) -> ClosedLoop:
        return simulate_closed_loop(
            plant, law, values["t_span"], values["y0"], progress=progress, **options
        )

    return Prepared(call, keys, mistakes)


# Mechanical systems from files: those of ``zivi simulate``, MJCF and URDF.

Start: TypeAlias = tuple[Any, Any]
READERS = {".xml": Tree.from_mjcf, ".mjcf": Tree.from_mjcf, ".urdf": Tree.from_urdf}
"""What reads a file of a model, by its ending."""


def mechanism_of(
    path: Path,
    *,
    gaps: Sequence[str] = (),
    e: Sequence[float] = (),
    q0: Sequence[float] = (),
    friction: str = "refuse",
) -> tuple[Tree | SymbolicSystem, Start]:
    """Read a tree of bodies or a system with energies, and its initial state.

    Parameters
    ----------
    path : Path
        A TOML file of ``zivi simulate``, or MJCF (.xml) or URDF (.urdf) as MuJoCo reads it.
    gaps : sequence of str
        Of MJCF and URDF: joints with limits, and pairs of geoms such as ``"ball,floor"``; none for
        the limits of all joints.
    e : sequence of float
        Common key: one restitution for all gaps or one for each; empty for 0.
    q0 : sequence of float
        Common key: the initial coordinates; empty for 0.
    friction : {"refuse", "ignore"}
        Common key: treatment of pairs with friction.

    Returns
    -------
    (Tree or SymbolicSystem, (q0, qdot0))
        The system, and its start.
    """
    reader = READERS.get(path.suffix.lower())
    if reader is None:
        given = {"--gap": gaps, "--e": e, "--q0": q0}
        for option in (name for name, value in given.items() if len(value)):
            raise FileError(f"{option} is for MJCF and URDF: {path} has it as a key")
        values, plant, _ = plant_of(path)
        if not isinstance(plant, Tree | SymbolicSystem):
            raise FileError(f"{path}: is a mass: --model mass has its numbers as parameters")
        return plant, values["y0"]
    if not path.is_file():
        raise FileError(f"{path}: is not a file")
    pairs = [tuple(gap.split(",")) if "," in gap else gap for gap in gaps]
    laws: Any = e[0] if len(e) == 1 else list(e) or 0.0
    tree = reader(path, gaps=pairs or None, e=laws, friction=friction)
    zeros = [0.0] * (tree._n or 0)
    return tree, (list(q0) or zeros, zeros)


# Studies from files: ``zivi sweep``.


MAX_POINTS = 10_000_000
"""Most points of a study from a file."""
EXECUTORS = {"serial": None, "threads": "threads", "processes": "processes"}


@dataclasses.dataclass(frozen=True)
class PreparedSweep:
    """A study whose file was read.

    Parameters
    ----------
    experiment : str
        What is computed.
    design : Design
        Where.
    options : dict
        Further arguments of `zivi.sweep`.
    mistakes : Mistakes
        Of the file.
    """

    experiment: str
    design: Design
    options: dict[str, Any]
    mistakes: Mistakes

    def run(self, out: Path, **options: Any) -> Study:
        """Run it; raise a `FileError` for a fault that only the whole reveals."""
        keys = {name: name for name in ("workers", "seed", "chunk", "fixed", "executor")}
        with self.mistakes.naming(keys):
            return sweep(self.experiment, self.design, out=out, **self.options, **options)


def experiment_parameters(experiment: str) -> dict[str, inspect.Parameter]:
    """Return the parameters of an experiment."""
    return dict(inspect.signature(EXPERIMENTS[experiment]).parameters)


def prepare_sweep(path: Path) -> PreparedSweep:
    """Read a file of ``zivi sweep``."""
    content = read_file(path, SWEEP, "sweep")
    values, mistakes = content.values, content.mistakes
    known = experiment_parameters(values["experiment"])
    fixed = values.get("fixed", {})
    _check_parameter_names(values["parameters"], fixed, known, mistakes)
    mistakes.stop()
    kind = values.get("design", {"kind": "grid"})
    make = _read_sample if kind["kind"] == "sample" else _read_list
    design = make(values["parameters"], kind, known, mistakes)
    options: dict[str, Any] = {
        name: values[name] for name in ("workers", "seed", "chunk") if name in values
    }
    options |= {
        "executor": EXECUTORS[values.get("executor", "serial")],
        "fixed": {name: _as_integers(fixed[name], known[name], dotted("fixed", name), mistakes)
                  for name in fixed},
    }  # fmt: skip
    mistakes.stop()
    if options["executor"] is None and "workers" in options:
        mistakes.add("workers", 'goes with executor = "threads" or "processes"')
        mistakes.stop()
    return PreparedSweep(values["experiment"], design, options, mistakes)


def _check_parameter_names(
    given: dict[str, Any],
    fixed: dict[str, Any],
    known: dict[str, inspect.Parameter],
    mistakes: Mistakes,
) -> None:
    for table, names in (("parameters", given), ("fixed", fixed)):
        for name in names:
            if name not in known:
                text = f"is not a parameter of the experiment{suggestion(name, known)}"
                mistakes.add(dotted(table, name), text)
    for name in set(given) & set(fixed):
        mistakes.add(dotted("fixed", name), "is among the parameters, too")
    if not given:
        mistakes.add("parameters", f"must have one at least{suggestion('', known)}")
    for name, parameter in known.items():
        if parameter.default is parameter.empty and name not in {*given, *fixed}:
            mistakes.add(f"parameters.{name}", "is missing and does not have a default")


def _read_list(
    given: dict[str, Any],
    kind: dict[str, Any],
    known: dict[str, inspect.Parameter],
    mistakes: Mistakes,
) -> Design:
    """Make a grid or a list of points."""
    columns = {}
    for name, value in given.items():
        key = dotted("parameters", name)
        column = _range(value, key, mistakes) if isinstance(value, dict) else np.array(value)
        columns[name] = _as_integers(column, known[name], key, mistakes)
    mistakes.stop()
    _check_count({name: len(column) for name, column in columns.items()}, kind["kind"], mistakes)
    return grid(**columns) if kind["kind"] == "grid" else points(**columns)


def _check_count(lengths: dict[str, int], kind: str, mistakes: Mistakes) -> None:
    number = math.prod(lengths.values())
    if kind == "grid" and number > MAX_POINTS:
        mistakes.add("parameters", f"must give at most {MAX_POINTS} points, they give {number}")
    if kind == "list" and len(set(lengths.values())) > 1:
        told = ", ".join(f"{name} {length}" for name, length in lengths.items())
        mistakes.add("parameters", f"must be of one length in a list of points, got {told}")
    mistakes.stop()


def _range(value: dict[str, Any], key: str, mistakes: Mistakes) -> np.ndarray:
    if "num" not in value:
        mistakes.add(f"{key}.num", "is missing: number of values")
    if not _ends(value, key, mistakes) or "num" not in value:
        return np.zeros(1)
    return spaced(value, log=value.get("log", False))


def _ends(value: dict[str, Any], key: str, mistakes: Mistakes) -> bool:
    """Check the ends of a range; return whether they are usable."""
    missing = [end for end in ("start", "stop") if end not in value]
    for end in missing:
        mistakes.add(f"{key}.{end}", "is missing: a finite number")
    wrong = [
        end
        for end in ("start", "stop")
        if value.get("log") and end not in missing and not value[end] > 0.0
    ]
    for end in wrong:
        mistakes.add(f"{key}.{end}", f"must be > 0 with log = true, got {value[end]}")
    return not (missing or wrong)


def _read_sample(
    given: dict[str, Any],
    kind: dict[str, Any],
    known: dict[str, inspect.Parameter],
    mistakes: Mistakes,
) -> Design:
    """Draw points."""
    for name, value in given.items():
        key = dotted("parameters", name)
        if not isinstance(value, dict):
            text = "must be a table with start and stop, the bounds of a sample"
            mistakes.add(key, f"{text}, got a list")
        else:
            _check_sample_range(value, key, mistakes)
        if known[name].annotation in ("int", int):
            mistakes.add(key, "takes whole numbers, and a sample draws others")
    mistakes.stop()
    bounds = {name: (value["start"], value["stop"]) for name, value in given.items()}
    logs = [name for name, value in given.items() if value.get("log")]
    settings: dict[str, Any] = {"sampler": "sobol", "seed": 0} | kind
    with mistakes.naming({name: f"parameters.{name}" for name in given}, "design"):
        return sample(settings["sampler"], settings["n"], bounds, log=logs, seed=settings["seed"])


def _check_sample_range(value: dict[str, Any], key: str, mistakes: Mistakes) -> None:
    if "num" in value:
        mistakes.add(f"{key}.num", "is not allowed in a sample: design.n is the number of points")
    if _ends(value, key, mistakes) and not value["start"] < value["stop"]:
        mistakes.add(f"{key}.stop", f"must be > start in a sample, got {value['stop']}")


def _as_integers(values: Any, parameter: inspect.Parameter, key: str, mistakes: Mistakes) -> Any:
    """Convert values to integers for an integer parameter."""
    if parameter.annotation not in ("int", int):
        return values
    if not np.all(np.equal(np.mod(values, 1), 0)):
        mistakes.add(key, f"must hold whole numbers, got {values}")
        return values
    return int(values) if np.ndim(values) == 0 else np.asarray(values).astype(np.int64)
