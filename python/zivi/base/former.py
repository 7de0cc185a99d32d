"""Former names of modules and attributes, which pickles of earlier versions hold."""

import importlib
import sys
from collections.abc import Mapping
from typing import Any

from zivi.base.habits import CallableHint, hint_calls

FORMER = {
    "_compiled": "base.machine_code",
    "_complementarity": "vi.complementarity",
    "_controllers": "control.component",
    "_derivatives": "derivatives.result",
    "_functions": "base.check",
    "_loop_path": "control.loop_run",
    "_loop_reference": "control.loop_arguments",
    "_vi_jacobian": "vi.jacobian",
    "_vi_types": "vi.types",
    "_warnings": "base.status",
    "batch": "simulation.batch",
    "closed_loop": "control.closed_loop",
    "control.loop_path": "control.loop_run",
    "control.mechanical_loop_batch": "control.loop_batch",
    "dense": "simulation.dense",
    "derivatives.parameter_runs": "derivatives.mechanical_sensitivity",
    "derivatives.wrt": "derivatives.mechanical_sensitivity",
    "design": "control.design",
    "estimation.parameters": "estimation.runs",
    "events": "simulation.events",
    "loop_batch": "control.loop_batch",
    "loop_run": "control.loop_run",
    "maps": "derivatives.impact_map",
    "mechanics.batch_result": "simulation.batch",
    "mechanics.gap": "system.gap",
    "mechanics.glue": "system.mechanism",
    "mechanics.layout": "system.model_parts",
    "mechanics.linear_motion": "simulation.mechanical_trajectory",
    "mechanics.parametric": "system.parameters",
    "mechanics.partials": "system.model_parts",
    "mechanics.pieces": "system.model_parts",
    "mechanics.sensitivity": "derivatives.mechanical_sensitivity",
    "mechanics.system": "system.mechanism",
    "mechanics.trajectory": "simulation.mechanical_trajectory",
    "mechanics.wrt": "derivatives.mechanical_sensitivity",
    "methods": "simulation.methods",
    "native": "interop.native",
    "observer": "control.observer",
    "orbits.branch": "orbits.orbit",
    "orbits.mechanical.branch": "orbits.orbit",
    "orbits.mechanical.critical": "orbits.critical",
    "orbits.mechanical.curve": "orbits.curve",
    "orbits.mechanical.flow": "orbits.flows",
    "orbits.mechanical.frame": "orbits.equations",
    "orbits.mechanical.impulses": "orbits.equations",
    "orbits.mechanical.linear_flow": "orbits.flows",
    "orbits.mechanical.mass_flow": "orbits.flows",
    "orbits.mechanical.word": "orbits.flows",
    "orbits.sequence": "orbits.orbit",
    "parametric": "system.mass",
    "sensitivity": "derivatives.sensitivity",
    "simulate": "simulation.run",
    "simulation.friction_result": "simulation.mechanical_trajectory",
    "simulation.impacts": "simulation.events",
    "simulation.linear_motion": "simulation.mechanical_trajectory",
    "simulation.mechanical_batch": "simulation.batch",
    "status": "base.status",
    "study.codec": "study.folder",
    "study.head": "study.folder",
    "study.pools": "study.drive",
    "system.constraints.connections": "system.tree_bodies",
    "system.constraints.equality": "system.model_parts",
    "system.force": "system.mass",
    "system.friction": "system.gap",
    "system.gap_coordinates": "system.start",
    "system.impact_law.laws": "system.impact_law",
    "system.impact_law.restitution": "system.impact_law",
    "system.impact_law.restitutions": "system.impact_law",
    "system.space.rotations": "system.space",
    "system.space.shapes": "system.space",
    "system.symbolic.derive": "system.symbolic_system",
    "system.symbolic.system": "system.symbolic_system",
    "system.tree.body": "system.tree_bodies",
    "system.tree.gaps": "system.tree_bodies",
    "system.tree_friction": "system.tree_bodies",
    "trajectory": "simulation.trajectory",
    "transform": "system.mass",
    "wall": "system.gap",
}
"""The modules that users may have imported from, or that pickles name: then, now."""
RENAMED = {("orbits.sequence", "Frame"): "MassFrame"}
"""The classes that pickles name by another name: module and name then, name now."""


class _Former(CallableHint):
    """A module under its former name, imported at the first access to an attribute."""

    def __init__(self, name: str, now: str) -> None:
        super().__init__(name)
        self._now = now

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__") and name != "__all__":
            raise AttributeError(f"module {self.__name__!r} has no attribute {name!r}")
        now = RENAMED.get((self.__name__.removeprefix("zivi."), name), name)
        return getattr(importlib.import_module(self._now), now)

    def __dir__(self) -> list[str]:
        now = importlib.import_module(self._now)
        return sorted({*super().__dir__(), *getattr(now, "__all__", ())})


def hand_on(names: Mapping[str, str] = FORMER) -> None:
    """Register the former names of modules for `import` and pickles."""
    for former, name in names.items():
        sys.modules[f"zivi.{former}"] = _Former(f"zivi.{former}", f"zivi.{name}")


def of_zivi(names: Mapping[str, Any]) -> None:
    """Set ``__module__`` of public classes to `zivi`, from where users import them.

    Pickles and stored studies do not name the rooms of this package. Whoever calls the module of
    these names gets a hint.
    """
    hint_calls(names["__name__"])
    for public in list(names.values()):
        if isinstance(public, type) and public.__module__.startswith("zivi."):
            public.__module__ = "zivi"


def with_resolved_impacts(state: Mapping[str, Any]) -> Mapping[str, Any]:
    """Return a result's state; version 0.1 stored the computed impacts as ``impacts``."""
    if "resolved_impacts" in state:
        return state
    return {name: it for name, it in state.items() if name != "impacts"} | {
        "resolved_impacts": state["impacts"]
    }
