"""Makes runs of datasets again."""

from __future__ import annotations

import dataclasses
import json
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from zivi._zivi import MotionPath
from zivi.base.check import Array
from zivi.base.status import Status
from zivi.control import loop_run
from zivi.control.loop_path import BallisticPath, SampledReference
from zivi.control.loop_run import ClosedLoop
from zivi.control.updates import Updates
from zivi.files.mechanical import holds_mechanical, mechanical_run
from zivi.simulation.dense import LinearPath, LostPath, PenetratingPath
from zivi.simulation.impacts import IMPACT, SLOWEST
from zivi.simulation.mechanical_trajectory import MechanicalTrajectory
from zivi.simulation.trajectory import LIFTED, QUANTITIES, Trajectory, Transformed
from zivi.system.table import Table, TableMotion
from zivi.system.wall import HarmonicWall, MovingWall

if TYPE_CHECKING:
    import xarray

__all__ = ["drawn", "loop_variables", "path_variables", "run_of"]

PATHS: dict[str, Any] = {kind.__name__: kind for kind in (LinearPath, PenetratingPath)}
"""What interpolates the samples of methods with fixed steps."""
LOOP_PATHS = {
    "BallisticPath": ("t", "x", "xdot", "net", "side", "full"),
    "LinearPath": ("t", "s", "v"),
}
"""What the path of a closed loop is made of."""
MOTION, NOTHING, LOST = "MotionPath", "none", ""
"""Other names: the dense output of a method, no path, and that of files which never held one."""


def run_of(dataset: xarray.Dataset) -> Trajectory | ClosedLoop | MechanicalTrajectory:
    """Give the run that a dataset holds."""
    if holds_mechanical(dataset):
        return mechanical_run(dataset)
    return _closed_loop(dataset) if "u" in dataset else _trajectory(dataset)


def drawn(dataset: xarray.Dataset) -> Trajectory | ClosedLoop | MechanicalTrajectory:
    """Give the run with the samples that its plots show."""
    run = run_of(dataset)
    if "curve_time" not in dataset or not isinstance(run, Trajectory):
        return run
    x, xdot, s, v = (dataset[f"curve_{name}"].values for name in ("x", "xdot", "s", "v"))
    lifted = dataclasses.replace(run.transformed, s=s, v=v)
    curve: dict[str, Any] = {"x": x, "xdot": xdot, "transformed": lifted}
    times = dataset["curve_time"].values
    impacts = np.zeros(dataset.sizes["curve_impacts"], IMPACT)
    impacts["t"] = times[dataset["curve_impact"].values]
    return dataclasses.replace(run, t=times, **curve, resolved_impacts=impacts, _path=None)


def _common(dataset: xarray.Dataset) -> dict[str, Any]:
    attrs = dataset.attrs
    return {
        "t": dataset["time"].values,
        "resolved_impacts": _impacts(dataset),
        "slowest": float(attrs.get("slowest", SLOWEST)),
        "zeno_times": dataset["zeno_time"].values,
        "liftoff_times": dataset["liftoff_time"].values,
        "rest_time": None if np.isnan(attrs["rest_time"]) else float(attrs["rest_time"]),
        "status": Status(int(attrs["status"])),
        "message": str(attrs["message"]),
        "nfev": int(attrs["nfev"]),
    }


def _config(dataset: xarray.Dataset) -> dict[str, Any]:
    config: dict[str, Any] = json.loads(dataset.attrs["config"])
    return config


def _impacts(dataset: xarray.Dataset) -> NDArray[np.void]:
    # version 0.1 had those that were computed where now those are that are listed
    name = "resolved_impact" if "resolved_impact_time" in dataset else "impact"
    impacts = np.empty(len(dataset[f"{name}_time"]), IMPACT)
    impacts["t"] = dataset[f"{name}_time"].values
    for field in ("xdot_before", "xdot_after"):
        impacts[field] = dataset[f"{name}_{field}"].values
    return impacts


def _closed_loop(dataset: xarray.Dataset) -> ClosedLoop:
    names = (*loop_run.QUANTITIES, "signs", "tick_status", *loop_run.ESTIMATES)
    sampled: dict[str, Any] = {it: dataset[it].values for it in names if it in dataset}
    config, span = _config(dataset), dataset.attrs.get("span")
    times, states = _events(dataset)
    return ClosedLoop(
        **_common(dataset),
        **sampled,
        config=config,
        updates=Updates.of_attrs(dataset.attrs, sampled["tick_status"]),
        t_events=times,
        y_events=states,
        _path=_loop_path(dataset, (config["e"], config["kappa"])),
        _reference=_loop_reference(dataset),
        _span=None if span is None else (float(span[0]), float(span[1])),
    )


def loop_variables(run: ClosedLoop) -> tuple[str, dict[str, Array], dict[str, Array]]:
    """Name the path of a closed loop; what makes it again, and what makes its reference again."""
    path, reference = run._path, run._reference
    of_reference = {}
    if isinstance(reference, SampledReference):
        of_reference = {name: getattr(reference, name) for name in ("t", "x", "xdot")}
        of_reference["kappa"] = np.full(1, reference.kappa)
    if isinstance(path, MotionPath):
        numbers = {"motion": path.numbers()}
        return MOTION, numbers, of_reference
    if isinstance(path, BallisticPath | LinearPath):
        names = LOOP_PATHS[type(path).__name__]
        return type(path).__name__, {name: getattr(path, name) for name in names}, of_reference
    return NOTHING, {}, of_reference


def _loop_path(dataset: xarray.Dataset, wall: tuple[float, float]) -> Any:
    name = dataset.attrs["path"]
    if name == MOTION:
        return MotionPath.restored(dataset["motion"].values)
    if name == NOTHING:
        return None
    values: dict[str, Any] = {it: dataset[f"path_{it}"].values for it in LOOP_PATHS[name]}
    if name == "BallisticPath":
        full = values.pop("full").reshape(-1, 3)
        return BallisticPath(**values, wall=wall, full=full)
    return LinearPath(**values, kappa=wall[1])


def _loop_reference(dataset: xarray.Dataset) -> SampledReference | None:
    if "reference_t" not in dataset:
        return None
    t, x, xdot = (dataset[f"reference_{name}"].values for name in ("t", "x", "xdot"))
    return SampledReference(t, x, xdot, float(dataset["reference_kappa"].values[0]))


def _trajectory(dataset: xarray.Dataset) -> Trajectory:
    attrs, common = dataset.attrs, _common(dataset)
    samples: dict[str, Any] = {name: dataset[name].values for name in QUANTITIES}
    config = _config(dataset)
    times, states = _events(dataset)
    path = _path(dataset, common["t"], samples, config["kappa"])
    lifted = Transformed(*(samples.pop(name) for name in LIFTED))
    return Trajectory(
        **common,
        **samples,
        transformed=lifted,
        _setup=config,
        failed_steps=dataset["failed_step"].values,
        n_steps=int(attrs["n_steps"]),
        n_rejected=int(attrs["n_rejected"]),
        t_events=times,
        y_events=states,
        _path=path,
        _wall=_wall(config["wall"]),
    )


def path_variables(run: Trajectory) -> tuple[str, dict[str, Array]]:
    """Name what gives the motion between the samples, and what must be kept to make it again."""
    path = run._path
    if isinstance(path, MotionPath):
        return MOTION, {"motion": path.numbers()}
    name = type(path).__name__
    if path is None or name not in PATHS:
        return NOTHING if path is None else LOST, {}
    samples = {field: getattr(path, field) for field in _sampled(PATHS[name])}
    own = {"t": run.t, "x": run.x, "xdot": run.xdot, **vars(run.transformed)}
    same = all(np.array_equal(own[field], samples[field]) for field in samples)
    return name, {} if same else {f"path_{field}": samples[field] for field in samples}


def _sampled(kind: Any) -> list[str]:
    """Name the samples that a path goes through."""
    known = ("t", *QUANTITIES)
    return [field.name for field in dataclasses.fields(kind) if field.name in known]


def _path(
    dataset: xarray.Dataset, t: Array, samples: dict[str, Array], kappa: float
) -> MotionPath | LinearPath | LostPath | None:
    name = dataset.attrs["path"]
    if name == MOTION:
        return MotionPath.restored(dataset["motion"].values)
    if name in (NOTHING, LOST):
        return None if name == NOTHING else LostPath()
    kind, known = PATHS[name], {"t": t, **samples}
    if "path_t" in dataset:
        known = {field: dataset[f"path_{field}"].values for field in _sampled(kind)}
    path: LinearPath = kind(**{field: known[field] for field in _sampled(kind)}, kappa=kappa)
    return path


def _events(dataset: xarray.Dataset) -> tuple[list[Array], list[Array]]:
    """Part the events by their functions."""
    function, times = dataset["event_function"].values, dataset["event_time"].values
    states = np.column_stack([dataset["event_x"].values, dataset["event_xdot"].values])
    each = [function == number for number in range(int(dataset.attrs["n_event_functions"]))]
    return [times[own] for own in each], [states[own] for own in each]


def _wall(told: dict[str, Any] | None) -> HarmonicWall | MovingWall | TableMotion | None:
    if told is None:
        return None
    values = {name: value for name, value in told.items() if name != "name"}
    if told["name"] == "HarmonicWall":
        return HarmonicWall(**values)
    if told["name"] == "Table":
        return TableMotion(Table(**values))
    return MovingWall(_lost, _lost, _lost)


def _lost(t: float) -> float:
    raise ValueError("the functions of the wall are not kept in the file")
