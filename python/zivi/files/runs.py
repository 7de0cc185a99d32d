"""Single runs from files: ``zivi simulate`` and ``zivi control``."""

from __future__ import annotations

import dataclasses
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
    SIMULATE,
    TREE,
    Key,
    is_mechanism,
    is_tree,
    read_keys,
)
from zivi.files.kinds import FileError, Mistakes
from zivi.simulation.mechanical_trajectory import MechanicalTrajectory
from zivi.simulation.methods import METHODS
from zivi.simulation.run import simulate
from zivi.simulation.trajectory import Trajectory
from zivi.system.gap import DryFriction, HarmonicWall
from zivi.system.impact_law import LAWS
from zivi.system.mass import Force, ImpactSystem, LinearForce
from zivi.system.mechanism import MechanicalSystem
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
    with mistakes.naming(argument_keys("system", names), "system"):
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
        found = Tree(bodies, gaps=gaps, friction=friction, **settings)
    for name, value in values.get("parameters", {}).items():
        key = f"system.parameters.{name}"
        if name not in found.parameters:
            known = ", ".join(found.parameters)
            mistakes.add(key, f"is not a parameter of the tree; allowed: {known}")
            mistakes.stop()
        with mistakes.naming({}, key):
            found.parameters[name] = value
    return found


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
        keys |= {"q0": "y0", "qdot0": "y0"}
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
