"""Tables and pictures that sum up a run or a study."""

from __future__ import annotations

import inspect
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
from rich.table import Table
from rich.text import Text

from zivi.base.check import Array
from zivi.base.status import StudyStatus
from zivi.control.loop_run import ClosedLoop
from zivi.files.runs import experiment_parameters
from zivi.simulation.mechanical_trajectory import MechanicalTrajectory, summary_rows
from zivi.simulation.trajectory import Trajectory
from zivi.study import EXPERIMENTS, Study

NARROWEST = 6
"""Characters of a column at least."""
SHOWN = 3
"""Failed points that are shown."""


def opening(path: Path, study: bool) -> str:
    """Return one line that shows how to open a result."""
    return f'xarray.{"open_zarr" if study else "open_dataset"}("{path}")'


def _summary_table(title: str, rows: Iterable[tuple[str, str]]) -> Table:
    table = Table(title=title, show_header=False, title_justify="left")
    # both columns wrap where the terminal is narrow
    table.add_column(overflow="fold", min_width=NARROWEST)
    table.add_column(overflow="fold", min_width=NARROWEST)
    for name, value in rows:
        table.add_row(name, Text(value, style=_style(name, value)))
    return table


def _style(name: str, value: str) -> str:
    """Return the terminal colour of a value: status or warning."""
    if name == "status":
        return "green" if value.startswith("completed") else "bold red"
    return "bold red" if name in ("failed", "missing") and value != "0" else ""


def record_of_run(run: Trajectory | ClosedLoop | MechanicalTrajectory) -> dict[str, Any]:
    """Sum up one run as plain values: numbers where there are some, and the rows of `of_run`."""
    return {
        "kind": type(run).__name__,
        "status": run.status.name.lower(),
        "success": run.success,
        "message": run.message,
        "t_start": float(run.t[0]) if len(run.t) else None,
        "t_end": float(run.t[-1]) if len(run.t) else None,
        "samples": len(run.t),
        "impacts": len(run.impacts),
        "rest_time": getattr(run, "rest_time", None),
        "nfev": run.nfev,
        "summary": dict(_run_rows(run)),
    }


def run_table(run: Trajectory | ClosedLoop | MechanicalTrajectory) -> Table:
    """Sum up one run."""
    titles = {"ClosedLoop": "Closed loop", "MechanicalTrajectory": "Mechanical system"}
    return _summary_table(titles.get(type(run).__name__, "Trajectory"), _run_rows(run))


def _run_rows(run: Trajectory | ClosedLoop | MechanicalTrajectory) -> list[tuple[str, str]]:
    if isinstance(run, MechanicalTrajectory):
        return list(summary_rows(run).items())
    rows = [("status", f"{run.status.name.lower()}: {run.message}"), ("time", _span(run.t, "s"))]
    rows += _wall_rows(run)
    rows += _loop_rows(run) if isinstance(run, ClosedLoop) else _step_rows(run)
    rows.append(("evaluations of the force", str(run.nfev)))
    return rows


def _wall_rows(run: Trajectory | ClosedLoop) -> list[tuple[str, str]]:
    rest = "no" if run.rest_time is None else f"from {run.rest_time:.9g} s"
    return [
        ("impacts", f"{len(run.impacts)}, {len(run.resolved_impacts)} resolved"),
        ("Zeno points", _times_text(run.zeno_times)),
        ("lift-offs", _times_text(run.liftoff_times)),
        ("at rest at the end", rest),
    ]


def _step_rows(run: Trajectory) -> list[tuple[str, str]]:
    steps = f"{run.n_steps}, {run.n_rejected} more rejected"
    if len(run.failed_steps):
        steps += f", {len(run.failed_steps)} not solved by the chosen solver"
    last = f"x = {run.x[-1]:.6g} m, x' = {run.xdot[-1]:.6g} m/s" if len(run.t) else "none"
    return [("last state", last), ("steps", steps)]


def _loop_rows(run: ClosedLoop) -> list[tuple[str, str]]:
    if not len(run.t):
        return []
    error = run.error[-1]
    told = f"x = {run.x[-1]:.6g} m" if np.isnan(error) else f"x - x_ref = {error:.6g} m"
    rows = [
        ("last position" if np.isnan(error) else "final error", told),
        ("control", _span(run.u, "m/s^2")),
        ("samples", f"{len(run.t)}"),
        ("control updates", f"{run.n_updates}{run._failed_text()}"),
    ]
    if run.config["seed"] is not None:
        rows.append(("seed of the noise", str(run.config["seed"])))
    return rows


def _span(values: Array, unit: str) -> str:
    if not len(values):
        return "nothing"
    return f"{np.min(values):.6g} .. {np.max(values):.6g} {unit}"


def _times_text(times: Array) -> str:
    shown = ", ".join(f"{time:.9g}" for time in times[:SHOWN])
    more = ", ..." if len(times) > SHOWN else ""
    return f"{len(times)}" + (f", at {shown}{more} s" if shown else "")


def record_of_study(study: Study) -> dict[str, Any]:
    """Sum up a study as plain values."""
    status = study.status
    counts = {state.name.lower(): int(np.count_nonzero(status == state)) for state in StudyStatus}
    results = {}
    for name, variable in study.dataset.data_vars.items():
        if variable.dtype.kind == "f":
            found = variable.values[np.isfinite(variable.values)]
            ends = [float(found.min()), float(found.max())] if len(found) else [None, None]
            unit = str(variable.attrs.get("units", "1"))
            results[str(name)] = {"min": ends[0], "max": ends[1], "unit": unit}
    failed = study.failed if counts["failed"] else None
    return {
        "kind": "Study",
        "title": str(study.dataset.attrs.get("title", "Study")),
        "points": len(status),
        **counts,
        "parameters": [str(name) for name in study.dataset.coords],
        "results": results,
        "messages": {}
        if failed is None
        else {str(number): str(point["message"]) for number, point in failed.iterrows()},
    }


def study_table(study: Study) -> Table:
    """Sum up a study."""
    status = study.status
    rows = [("points", f"{len(status)}: {', '.join(map(str, study.dataset.coords))}")]
    for state in (StudyStatus.COMPLETED, StudyStatus.FAILED, StudyStatus.MISSING):
        rows.append((state.name.lower(), str(np.count_nonzero(status == state))))
    for name, variable in study.dataset.data_vars.items():
        if variable.dtype.kind == "f":
            found = variable.values[np.isfinite(variable.values)]
            rows.append((str(name), _span(found, _unit(variable.attrs.get("units"))).strip()))
    if np.any(status == StudyStatus.FAILED):
        failed = study.failed.head(SHOWN)
        for number, point in failed.iterrows():
            rows.append((f"point {number}", str(point["message"])))
    return _summary_table(str(study.dataset.attrs.get("title", "Study")), rows)


def _unit(unit: object) -> str:
    return "" if unit in (None, "1") else str(unit)


def experiments_table() -> Table:
    """List the experiments that a file of ``zivi sweep`` can name."""
    table = Table("experiment", "parameters and their defaults", "results", show_lines=True)
    for name, function in EXPERIMENTS.items():
        units = getattr(function, "units", {})
        known = experiment_parameters(name)
        first = (inspect.getdoc(function) or "").partition("\n")[0].replace(":math:", "")
        told = "\n".join(_parameter_text(it, units.get(it.name, "")) for it in known.values())
        results = [f"{it} ({unit})" for it, unit in units.items() if it not in known]
        table.add_row(f"{name}\n{first}", told, "\n".join(results))
    return table


def _parameter_text(parameter: inspect.Parameter, unit: str) -> str:
    default = parameter.default
    shown = "" if default is parameter.empty else f" = {default:.6g}"
    return f"{parameter.name}{shown} {f'({unit})' if _unit(unit) else ''}".rstrip()
