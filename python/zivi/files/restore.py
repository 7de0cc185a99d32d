"""Makes runs of datasets again."""

from __future__ import annotations

import dataclasses
import json
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from zivi import closed_loop, trajectory
from zivi._check import Array
from zivi.closed_loop import ClosedLoop
from zivi.dense import LinearPath, PenetratingPath
from zivi.status import Status
from zivi.trajectory import IMPACT, Trajectory
from zivi.wall import HarmonicWall, MovingWall

if TYPE_CHECKING:
    import xarray

__all__ = ["drawn", "path_name", "run_of"]

PATHS: dict[str, Any] = {kind.__name__: kind for kind in (LinearPath, PenetratingPath)}
"""What interpolates the samples of methods with fixed steps."""


def run_of(dataset: xarray.Dataset) -> Trajectory | ClosedLoop:
    """Give the run that a dataset holds."""
    return _closed_loop(dataset) if "u" in dataset else _trajectory(dataset)


def drawn(dataset: xarray.Dataset) -> Trajectory | ClosedLoop:
    """Give the run with the samples that its plots show."""
    run = run_of(dataset)
    if "curve_time" not in dataset or isinstance(run, ClosedLoop):
        return run
    curve: dict[str, Any] = {
        name: dataset[f"curve_{name}"].values for name in ("x", "xdot", "s", "v")
    }
    times = dataset["curve_time"].values
    impacts = np.zeros(dataset.sizes["curve_impacts"], IMPACT)
    impacts["t"] = times[dataset["curve_impact"].values]
    return dataclasses.replace(run, t=times, **curve, impacts=impacts, _path=None)


def _common(dataset: xarray.Dataset) -> dict[str, Any]:
    attrs = dataset.attrs
    return {
        "t": dataset["time"].values,
        "impacts": _impacts(dataset),
        "zeno_times": dataset["zeno_time"].values,
        "liftoff_times": dataset["liftoff_time"].values,
        "rest_time": None if np.isnan(attrs["rest_time"]) else float(attrs["rest_time"]),
        "status": Status(int(attrs["status"])),
        "message": str(attrs["message"]),
        "nfev": int(attrs["nfev"]),
        "config": json.loads(attrs["config"]),
    }


def _impacts(dataset: xarray.Dataset) -> NDArray[np.void]:
    impacts = np.empty(dataset.sizes["impact_time"], IMPACT)
    impacts["t"] = dataset["impact_time"].values
    for field in ("xdot_before", "xdot_after"):
        impacts[field] = dataset[f"impact_{field}"].values
    return impacts


def _closed_loop(dataset: xarray.Dataset) -> ClosedLoop:
    names = (*closed_loop.QUANTITIES, "signs", "tick_status")
    sampled: dict[str, Any] = {name: dataset[name].values for name in names}
    return ClosedLoop(**_common(dataset), **sampled)


def _trajectory(dataset: xarray.Dataset) -> Trajectory:
    attrs, common = dataset.attrs, _common(dataset)
    samples: dict[str, Any] = {name: dataset[name].values for name in trajectory.QUANTITIES}
    config = common["config"]
    times, states = _events(dataset)
    return Trajectory(
        **common,
        **samples,
        failed_steps=dataset["failed_step"].values,
        n_steps=int(attrs["n_steps"]),
        n_rejected=int(attrs["n_rejected"]),
        t_events=times,
        y_events=states,
        _path=_path(attrs["path"], common["t"], samples, config["kappa"]),
        _wall=_wall(config["wall"]),
    )


def path_name(run: Trajectory) -> str:
    """Name what interpolates a run if the samples suffice to make it again, else ""."""
    path = run._path
    known = type(path).__name__
    suffices = known in PATHS and len(run.t) and np.array_equal(getattr(path, "t", ()), run.t)
    return known if suffices else ""


def _path(name: str, t: Array, samples: dict[str, Array], kappa: float) -> Any:
    if not name:
        return None
    kind = PATHS[name]
    known = {"t": t, "kappa": kappa, **samples}
    fields = [field.name for field in dataclasses.fields(kind) if field.name in known]
    return kind(**{field: known[field] for field in fields})


def _events(dataset: xarray.Dataset) -> tuple[list[Array], list[Array]]:
    """Part the events by their functions."""
    function, times = dataset["event_function"].values, dataset["event_time"].values
    states = np.column_stack([dataset["event_x"].values, dataset["event_xdot"].values])
    each = [function == number for number in range(int(dataset.attrs["n_event_functions"]))]
    return [times[own] for own in each], [states[own] for own in each]


def _wall(told: dict[str, Any] | None) -> HarmonicWall | MovingWall | None:
    if told is None:
        return None
    values = {name: value for name, value in told.items() if name != "name"}
    if told["name"] == "HarmonicWall":
        return HarmonicWall(**values)
    return MovingWall(_lost, _lost, _lost)


def _lost(t: float) -> float:
    raise ValueError("the functions of the wall are not kept in the file")
