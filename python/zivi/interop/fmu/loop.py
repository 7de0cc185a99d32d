"""Closed loops of mechanical systems as FMUs: numbers and compiled systems beside the binary."""

from __future__ import annotations

import hashlib
import os
import platform
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

import zivi._zivi as _zivi
from zivi.base.check import Array, identifier
from zivi.base.machine_code import shared_library
from zivi.control.gap_tracker import GapTracker, check_gap_tracker
from zivi.control.loop_arguments import period_of
from zivi.control.mechanical_loop import check_reference, times_ahead
from zivi.control.mechanical_reference import MechanicalReference, reference_of
from zivi.control.model_based import check_believes
from zivi.interop.fmu.export import PLATFORMS, binaries_of, chosen_versions, write_archive
from zivi.interop.fmu.table import Model, Variable
from zivi.interop.fmu.tree import tree_numbers
from zivi.simulation.mechanical_run import state_of
from zivi.simulation.run import pair
from zivi.system.start import check_start
from zivi.system.symbolic.inputs import SymbolicInputs
from zivi.system.symbolic.system import SymbolicSystem
from zivi.system.tree.system import Tree

__all__ = ["export_loop"]

VERSION = 2.0
"""Of the numbers."""
MOST = 512
"""Variables of the largest loop."""


def export_loop(
    out: str | os.PathLike[str],
    system: SymbolicSystem | Tree,
    controller: GapTracker,
    t_span: Sequence[float],
    y0: Any,
    *,
    reference: Any = None,
    name: str = "MechanicalLoop",
    fmi: int | Iterable[int] | None = None,
) -> list[Path]:
    """Write an FMU of a mechanism with its `GapTracker`: no Python where it runs.

    A period is one of `simulate_closed_loop` with ``method=zivi.RKPeriod()`` and the ``delay`` of
    the controller. Inputs are disturbances, a generalised force on each coordinate; outputs are
    coordinates, velocities, gaps, contacts, contact forces, contacts that are held, controls, and
    bits of `TickStatus`. Parameters are the start and those of the system (``plant_...``) and of
    the one that the controller believes in (``model_...``).

    Parameters
    ----------
    out : path
        The folder into which it is written.
    system : SymbolicSystem or Tree
        The plant without friction: of `zivi.symbolic.system`, for which the export needs a C
        compiler, or a `zivi.Tree`.
    controller : GapTracker
        The controller, without `tasks` and with constant forces; it starts anew.
    t_span : (float, float)
        Where the reference is told (s); beyond it stays where it is at the end.
    y0 : (array_like, array_like)
        Coordinates and velocities at the start, shape (n,) each.
    reference : MechanicalTrajectory, str or dict, optional
        As for `simulate_closed_loop`; without one all gaps land and rest.
    name : str
        Of the model: a letter, then letters, digits and underscores.
    fmi : {2, 3} or sequence of int, optional
        Version of FMI, by default both.

    Returns
    -------
    list of pathlib.Path
        The files, such as ``MechanicalLoop2.fmu``. They run on this kind of machine.

    Raises
    ------
    ValueError, TypeError
        For a system, a controller or an argument of another kind or out of range.
    FileNotFoundError
        If this installation was built without the binary; the message says how to build it.

    See Also
    --------
    export_fmu : the models of one mass.

    Examples
    --------
    >>> import tempfile
    >>> ball = zivi.symbolic.system(
    ...     "y", T="ydot**2/2", V="9.81*y", gaps={"floor": "y"}, e=0.5, inputs={"f": [1]}
    ... )
    >>> ctl = zivi.GapTracker(ball, h=1e-3, gains={"floor": (30, 17)})
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     files = zivi.fmu.export_loop(folder, ball, ctl, (0, 1), ([0.3], [0.0]), fmi=3)
    ...     [path.name for path in files]
    ['MechanicalLoop3.fmu']
    """
    plant = _told("system", system)
    believed = _told("controller's system", getattr(controller, "system", None))
    check_gap_tracker(controller)
    if controller.tasks:
        raise ValueError(f"tasks must not be set in an FMU of a loop, got {controller.tasks}")
    identifier("name", name)
    versions, binaries = chosen_versions(fmi), binaries_of("fmu_loops")
    here = machine()
    if here not in binaries:
        raise FileNotFoundError(f"no binary for loops on {here}: there is {', '.join(binaries)}")
    span, h = pair("t_span", t_span, "(t0, t1)"), period_of(controller)
    q, qdot = state_of(y0, system._n)
    model = system.model(len(q))
    check_start(system, model, span, q, qdot)
    check_believes("controller", controller.system, system, q)
    times = times_ahead(_zivi.grid_times(*span, h, 1), h, controller.delay, reference)
    given = reference_of(reference, times, system.gap_names, q, controller.tasks)
    told = times, system.gap_names, controller.tasks
    check_reference(controller, given, model, (q, qdot), told)
    source = _source(plant, believed)
    numbers = _numbers((plant, believed), controller, q, qdot, given)
    content = np.array(list(numbers), dtype="<f8").tobytes()
    digest = hashlib.sha256(source.encode() + b"\0" + content).hexdigest()[:32]
    loop = _model(plant, believed, name, f"zivi-loop-{digest}", (q, qdot))
    if len(loop.variables) > MOST:
        raise ValueError(
            f"an FMU of a loop has at most {MOST} variables, {len(loop.variables)} here"
        )
    _, ending = PLATFORMS[here]
    beside = {f"resources/{loop.token}.bin": content}
    if source:
        beside[f"resources/{loop.token}{ending}"] = shared_library(source)
    return [write_archive(out, loop, it, {here: binaries[here]}, beside) for it in versions]


def _told(name: str, system: Any) -> SymbolicSystem | Tree:
    if not isinstance(system, SymbolicSystem | Tree):
        raise TypeError(
            f"{name} must be a zivi.symbolic.system or a zivi.Tree: an FMU runs without "
            f"Python; got {type(system).__name__}"
        )
    return system


def machine() -> str:
    """Name this kind of machine as FMI 3 does."""
    system = platform.system().lower()
    kind = platform.machine().lower()
    return f"{ {'amd64': 'x86_64', 'arm64': 'aarch64'}.get(kind, kind) }-{system}"


def _source(plant: SymbolicSystem | Tree, model: SymbolicSystem | Tree) -> str:
    """Write plant and model, and how controls act on them, as functions of one C source."""
    functions = []
    for name, system in (("plant", plant), ("model", model)):
        if system._channels:
            raise ValueError(f"an FMU of a loop has no friction, the {name} has")
        if isinstance(system, Tree):
            continue
        functions.append(_named(system.source, name))
        if isinstance(inputs := system._symbolic_inputs, SymbolicInputs) and inputs.sources:
            functions.append(_named(inputs.sources["c"], f"{name}_inputs"))
    return "\n".join(functions)


def _named(source: str, name: str) -> str:
    return source.replace("int model(", f"int {name}(")


def _numbers(
    systems: tuple[SymbolicSystem | Tree, SymbolicSystem | Tree],
    controller: GapTracker,
    q: Array,
    qdot: Array,
    given: MechanicalReference | None,
) -> Iterator[float]:
    """Give all numbers in the order in which the binary reads them."""
    told, (plant, model) = controller.settings, systems
    n, m, r = len(q), plant.m, plant.control_inputs(q).r
    yield from (VERSION, n, m, r, told["delay"], told["h"], *told["posture"], told["learn_offset"])
    yield from _optional(told["latch"])
    limits = told["u_limits"]
    yield from _optional(None if limits is None else limits.ravel())
    deviations, steps = controller._law.noise
    yield from (*deviations, *steps)
    for i, name in enumerate(plant.gap_names):
        force = told["force"].get(name, np.nan)
        if callable(force):
            raise TypeError(f"force[{name!r}] must be a number in an FMU, not a function")
        yield from (*told["gains"][name], float(model.e[i]), told["horizon"], told["shift"], force)
    yield from (*q, *qdot)
    for system in systems:
        yield from (float(it) for it in system.e)
        inputs = None if isinstance(system, Tree) else system._symbolic_inputs
        compiled = isinstance(inputs, SymbolicInputs) and bool(inputs.sources)
        matrix = system.control_inputs(q).matrix
        if not compiled and callable(matrix):
            raise TypeError("inputs of a system in an FMU must be numbers or expressions")
        yield from _optional(None if compiled else np.ravel(np.asarray(matrix)))
        yield len(system.parameters)
        yield from system.parameters.values()
        yield isinstance(system, Tree)
        if isinstance(system, Tree):
            yield from tree_numbers(system)
    yield 0 if given is None else len(given.q)
    if given is not None:
        for rows in (given.q, given.qdot, given.qddot, given.gaps, given.gap_rates):
            yield from rows.ravel()
        for rows in (given.accelerations, given.sides, given.contacts.astype(np.float64)):
            yield from rows.ravel()


def _optional(values: Any) -> Iterator[float]:
    if values is None:
        yield 0.0
    else:
        yield 1.0
        yield from values


def _model(
    plant: SymbolicSystem | Tree,
    believed: SymbolicSystem | Tree,
    name: str,
    token: str,
    start: tuple[Array, Array],
) -> Model:
    """Describe the variables, in the order of the binary."""
    coordinates, gaps = plant.coordinate_names(len(start[0])), plant.gap_names
    controls = plant.control_inputs(start[0]).names
    rows: list[Variable] = [Variable("time", "real", "time", 0.0, "s", "time")]

    def add(prefix: str, names: Iterable[str], kind: Any, role: Any, text: str) -> list[str]:
        new = [Variable(f"{prefix}{it}", kind, role, 0.0, None, text.format(it)) for it in names]
        rows.extend(new)
        return [it.name for it in new]

    pushed = add("disturbance_", coordinates, "real", "input", "generalised force on {}")
    add("q_", coordinates, "real", "output", "coordinate {}")
    add("qdot_", coordinates, "real", "output", "velocity of {}")
    add("gap_", gaps, "real", "output", "gap {}")
    add("contact_", gaps, "boolean", "output", "whether gap {} is closed")
    forces = add("force_", gaps, "real", "output", "contact force of {}")
    add("held_", gaps, "boolean", "output", "whether the controller holds the contact {}")
    add("u_", controls, "real", "output", "control {}")
    rows.append(Variable("status", "integer", "output", 0, None, "bits of TickStatus"))
    outputs = [it.name for it in rows if it.role == "output"]
    parameters: list[tuple[str, float, str]] = []
    for prefix, values in zip(("q0_", "qdot0_"), start, strict=True):
        parameters += [
            (f"{prefix}{it}", value, f"{prefix[:-1]} of {it} at the start")
            for it, value in zip(coordinates, values.tolist(), strict=True)
        ]
    for prefix, system, text in (("plant_", plant, "plant"), ("model_", believed, "model")):
        parameters += [
            (f"{prefix}{it}", value, f"parameter {it} of the {text}")
            for it, value in system.parameters.items()
        ]
    rows += [Variable(it, "real", "parameter", value, None, text) for it, value, text in parameters]
    names = tuple(it for it, _, _ in parameters)
    return Model(
        "loop",
        name,
        token,
        "A mechanical system with its tracker of gaps",
        tuple(rows),
        dict.fromkeys(forces, tuple(pushed)),
        dict.fromkeys(outputs, names),
    )
