"""Closed loops of mechanical systems as FMUs: numbers and compiled systems beside the binary."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

import zivi._zivi as _zivi
from zivi.base.check import Array, identifier
from zivi.control.gap_tracker import GapTracker, check_gap_tracker
from zivi.control.loop_arguments import period_of
from zivi.control.mechanical_loop import check_reference, times_ahead
from zivi.control.mechanical_reference import MechanicalReference, reference_of
from zivi.control.model_based import check_believes
from zivi.interop.fmu.archive import chosen_versions
from zivi.interop.fmu.mechanism import (
    VERSION,
    Exported,
    Rows,
    binary_here,
    optional,
    part_numbers,
    told,
    write_systems,
)
from zivi.interop.fmu.table import Model
from zivi.simulation.mechanical_run import state_of
from zivi.simulation.run import pair
from zivi.system.start import check_start
from zivi.system.symbolic.system import SymbolicSystem
from zivi.system.tree.system import Tree

__all__ = ["export_loop"]


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
    coordinates, velocities, gaps, contacts, contact forces, contacts that are held, controls, bits
    of `TickStatus`, and how many updates of past periods were rejected (``n_refused``) and
    saturated (``n_saturated``). Parameters are the start and those of the system (``plant_...``)
    and of the one that the controller believes in (``model_...``).

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
    export_fmu : the models of one mass, and a mechanical system alone.

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
    plant = told("system", system)
    believed = told("controller's system", getattr(controller, "system", None))
    check_gap_tracker(controller)
    if controller.tasks:
        raise ValueError(f"tasks must not be set in an FMU of a loop, got {controller.tasks}")
    identifier("name", name)
    versions, binary = chosen_versions(fmi), binary_here()
    span, h = pair("t_span", t_span, "(t0, t1)"), period_of(controller)
    q, qdot = state_of(y0, system._n)
    model = system.model(len(q))
    check_start(system, model, span, q, qdot)
    check_believes("controller", controller.system, system, q)
    times = times_ahead(_zivi.grid_times(*span, h, 1), h, controller.delay, reference)
    given = reference_of(reference, times, system.gap_names, q, controller.tasks)
    sampled = times, system.gap_names, controller.tasks
    check_reference(controller, given, model, (q, qdot), sampled)
    numbers = _numbers((plant, believed), controller, q, qdot, given)
    loop = _model(plant, believed, name, (q, qdot))
    systems = {"plant": plant, "model": believed}
    return write_systems(out, "loop", systems, numbers, loop, versions, binary)


def _numbers(
    systems: tuple[Exported, Exported],
    controller: GapTracker,
    q: Array,
    qdot: Array,
    given: MechanicalReference | None,
) -> Iterator[float]:
    """Give all numbers in the order in which the binary reads them."""
    settings, (plant, model) = controller.settings, systems
    n, m, r = len(q), plant.m, plant.control_inputs(q).r
    yield from (VERSION, n, m, r, 1, settings["delay"], settings["h"])
    yield from (*settings["posture"], settings["learn_offset"])
    yield from optional(settings["latch"])
    limits = settings["u_limits"]
    yield from optional(None if limits is None else limits.ravel())
    deviations, steps = controller._law.noise
    yield from (*deviations, *steps)
    for i, name in enumerate(plant.gap_names):
        force = settings["force"].get(name, np.nan)
        if callable(force):
            raise TypeError(f"force[{name!r}] must be a number in an FMU, not a function")
        yield from (
            *settings["gains"][name],
            float(model.e[i]),
            settings["horizon"],
            settings["shift"],
            force,
        )
    yield from (*q, *qdot)
    for system in systems:
        yield from part_numbers(system, q)
    yield 0 if given is None else len(given.q)
    if given is not None:
        for rows in (given.q, given.qdot, given.qddot, given.gaps, given.gap_rates):
            yield from rows.ravel()
        for rows in (given.accelerations, given.sides, given.contacts.astype(np.float64)):
            yield from rows.ravel()


def _model(
    plant: Exported,
    believed: Exported,
    name: str,
    start: tuple[Array, Array],
) -> Model:
    """Describe the variables, in the order of the binary."""
    coordinates, gaps = plant.coordinate_names(len(start[0])), plant.gap_names
    controls = plant.control_inputs(start[0]).names
    rows = Rows()
    pushed = rows.add("disturbance_", coordinates, "real", "input", "generalised force on {}")
    forces = rows.add_motion(coordinates, gaps), pushed
    rows.add("held_", gaps, "boolean", "output", "whether the controller holds the contact {}")
    rows.add("u_", controls, "real", "output", "control {}")
    rows.add("status", ("",), "integer", "output", "bits of TickStatus")
    rows.add("n_refused", ("",), "integer", "output", "control updates so far that were rejected")
    rows.add("n_saturated", ("",), "integer", "output", "those whose control was cut")
    systems = {"plant_": plant, "model_": believed}
    parameters = rows.add_parameters(coordinates, start, systems)
    text = "A mechanical system with its tracker of gaps"
    return rows.model("loop", name, text, forces, parameters)
