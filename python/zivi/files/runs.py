"""Single runs from files: ``zivi simulate`` and ``zivi control``."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np

from zivi.control.closed_loop import ClosedLoop, simulate_closed_loop
from zivi.files import build
from zivi.files.keys import CONTROL, SIMULATE
from zivi.files.mechanical_keys import MECHANICS, is_mechanical
from zivi.files.reading import read
from zivi.files.tables import Key
from zivi.files.tree_keys import TREE, is_tree
from zivi.files.validation import Mistakes
from zivi.simulation.mechanical_trajectory import MechanicalTrajectory
from zivi.simulation.run import simulate
from zivi.simulation.trajectory import Trajectory
from zivi.system.mechanism import MechanicalSystem

__all__ = ["Prepared", "Run", "plant_of", "prepare_control", "prepare_simulate"]

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
        """Compute; a `FileError` tells what only shows when everything is put together."""
        with self.mistakes.naming(self.keys):
            return self.call(progress)


def plant_of(path: Path) -> tuple[dict[str, Any], Any, Mistakes]:
    """Read a file of ``zivi simulate``: its values, the system, and where mistakes of it go."""
    content = read(path, _keys, "simulate")
    values, mistakes = content.values, content.mistakes
    builds: Callable[[dict[str, Any], Mistakes], Any] = build.system
    if is_tree(values):
        builds = build.tree
    elif is_mechanical(values):
        builds = build.mechanics
    return values, builds(values["system"], mistakes), mistakes


def prepare_simulate(path: Path) -> Prepared:
    """Read a file of ``zivi simulate``."""
    values, plant, mistakes = plant_of(path)
    keys = {name: name for name in ("t_span", "y0", "t_eval", "tstops")} | {"h": "method.h"}
    if isinstance(plant, MechanicalSystem):
        keys |= {"q0": "y0", "qdot0": "y0"}
    else:
        keys |= PAIRS | build.restitution(values["system"])
    arguments: dict[str, Any] = {"t_eval": _times(values.get("t_eval"), mistakes)}
    if "tstops" in values:
        arguments["tstops"] = np.array(values["tstops"])
    if "method" in values:
        arguments["method"] = build.method(values["method"], mistakes)

    def call(progress: bool | None) -> Run:
        run: Run = simulate(plant, values["t_span"], values["y0"], progress=progress, **arguments)
        return run

    return Prepared(call, keys, mistakes)


def _keys(content: dict[str, Any]) -> tuple[Key, ...]:
    if is_tree(content):
        return TREE
    return MECHANICS if is_mechanical(content) else SIMULATE


def _times(value: Any, mistakes: Mistakes) -> np.ndarray | None:
    if not isinstance(value, dict):
        return None if value is None else np.array(value)
    if value["start"] > value["stop"]:
        mistakes.add("t_eval.stop", f"must be >= start, got {value['stop']}")
        mistakes.stop()
    return build.spaced(value)


OPTIONS = ("y_ref0", "noise", "seed", "quantization", "delay")
"""Keys that are arguments as they are."""
FORCES = ("force_ref", "force_model")


def prepare_control(path: Path) -> Prepared:
    """Read a file of ``zivi control``."""
    content = read(path, CONTROL, "control")
    values, mistakes = content.values, content.mistakes
    plant = build.system(values["system"], mistakes)
    wall = build.restitution(values["system"])
    law = build.controller(values["controller"], plant, wall, mistakes)
    if not hasattr(law, "x_ref"):
        name = values["controller"]["name"]
        for key in ("y_ref0", "force_ref"):
            if key in values:
                mistakes.add(key, f"is given, but a {name} follows no reference")
        mistakes.stop()
    options = {name: values[name] for name in OPTIONS if name in values}
    options |= {name: build.force(values[name]) for name in FORCES if name in values}
    if "method" in values:
        options["method"] = build.method(values["method"], mistakes)
    keys = {name: name for name in (*OPTIONS, *FORCES, "t_span", "y0")} | PAIRS | wall
    keys |= {"h": "controller.h", "method": "method", "controller": "controller"}

    def call(progress: bool | None) -> ClosedLoop:
        return simulate_closed_loop(
            plant, law, values["t_span"], values["y0"], progress=progress, **options
        )

    return Prepared(call, keys, mistakes)
