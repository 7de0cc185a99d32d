"""Runs of mechanical systems in datasets, and back."""

from __future__ import annotations

import dataclasses
import json
from typing import TYPE_CHECKING, Any

import numpy as np

from zivi._zivi import MechanicalPath
from zivi.base.status import Status
from zivi.control.mechanical_loop_run import LOOP_FIELDS, MechanicalClosedLoop
from zivi.simulation.friction_result import FRICTION, IMPACTS, TRANSITIONS, FrictionSamples
from zivi.simulation.impacts import FIELDS, SLOWEST, table
from zivi.simulation.linear_motion import LinearMotion
from zivi.simulation.mechanical_labelled import MEANING, TABLES
from zivi.simulation.mechanical_trajectory import MechanicalTrajectory

if TYPE_CHECKING:
    import xarray

__all__ = ["holds_mechanical", "mechanical_dataset", "mechanical_run"]

JOINT = -1
"""The gap of a channel of friction that has none."""
ATTRIBUTE = {"impacts": "resolved_impacts"}
"""Fields that hold tables of another name."""


def holds_mechanical(dataset: xarray.Dataset) -> bool:
    """Whether a dataset is a run of a mechanical system."""
    return "reactions" in dataset


def mechanical_dataset(run: MechanicalTrajectory) -> xarray.Dataset:
    """Give all that a run is: its labelled dataset, the events of the user and the motion."""
    dataset = run.to_xarray()
    for name in run.resolved_impacts.dtype.names or ():
        meaning = f"{name} of an impact that was computed"
        values = np.asarray(run.resolved_impacts[name])
        dataset[f"resolved_impact_{name}"] = "resolved", values, {"long_name": meaning}
    dataset.attrs["slowest"] = run.slowest
    if run._friction is not None:
        gaps = [JOINT if gap is None else gap for gap in run._friction.gaps]
        dataset["channel_gap"] = "channel", np.array(gaps), {"long_name": "its gap, or -1"}
    numbers = np.repeat(np.arange(len(run.t_events)), [len(times) for times in run.t_events])
    nothing = np.empty((0, run.q.shape[1]))
    dataset["event_function"] = "event", numbers, {"long_name": "number of the event function"}
    dataset["event_time"] = "event", np.concatenate([*run.t_events, np.empty(0)])
    for name, states in (("event_q", run.q_events), ("event_qdot", run.qdot_events)):
        dataset[name] = ("event", "coordinate"), np.concatenate([*states, nothing])
    dataset.attrs["n_event_functions"] = len(run.t_events)
    if isinstance(run._path, LinearMotion):
        for field in dataclasses.fields(run._path):
            if field.name == "friction":
                continue  # its samples are those of the run
            values = getattr(run._path, field.name)
            dims = ("step", "coordinate") if field.name in ("q", "qdot") else ("step", "gap")
            dataset[f"step_{field.name}"] = dims[: values.ndim], values
    elif run._path is not None:
        meaning = "the motion between the samples, in zivi's own form"
        dataset["motion"] = "motion_number", run._path.numbers(), {"long_name": meaning}
    return dataset


def mechanical_run(dataset: xarray.Dataset) -> MechanicalTrajectory:
    """Give the run that a dataset holds; its system is not in it."""
    attrs = dataset.attrs
    names = tuple(str(name) for name in dataset["gap"].values)
    function = dataset["event_function"].values
    each = [function == number for number in range(int(attrs["n_event_functions"]))]
    sampled: dict[str, Any] = {name: dataset[name].values for name in MEANING}
    kind, more = _of_loop(dataset)
    return kind(
        **more,
        t=dataset["time"].values,
        **sampled | {"contacts": dataset["contacts"].values.astype(bool)},
        **{ATTRIBUTE.get(name, name): _table(dataset, name, len(names)) for name in TABLES},
        slowest=float(attrs.get("slowest", SLOWEST)),
        status=Status(int(attrs["status"])),
        message=str(attrs["message"]),
        nfev=int(attrs["nfev"]),
        n_steps=int(attrs["n_steps"]),
        n_rejected=int(attrs["n_rejected"]),
        coordinate_names=tuple(str(name) for name in dataset["coordinate"].values),
        gap_names=names,
        _setup=json.loads(attrs["config"]),
        t_events=[dataset["event_time"].values[own] for own in each],
        q_events=[dataset["event_q"].values[own] for own in each],
        qdot_events=[dataset["event_qdot"].values[own] for own in each],
        _path=_path(dataset),
        _friction=_friction(dataset),
    )


def _of_loop(dataset: xarray.Dataset) -> tuple[type[MechanicalTrajectory], dict[str, Any]]:
    """Give what a closed loop has beside a run."""
    if "control" not in dataset.coords:
        return MechanicalTrajectory, {}
    more: dict[str, Any] = {name: dataset[name].values for name in LOOP_FIELDS}
    more["latched"] = more["latched"].astype(bool)
    names = tuple(str(name) for name in dataset["control"].values)
    return MechanicalClosedLoop, more | {"control_names": names}


def _friction(dataset: xarray.Dataset) -> FrictionSamples | None:
    if "channel_gap" not in dataset:
        return None
    gaps = [None if gap == JOINT else int(gap) for gap in dataset["channel_gap"].values]
    columns = {name: dataset[f"transition_{name}"].values for name in TRANSITIONS}
    sampled: dict[str, Any] = {name: dataset[name].values for name in FRICTION}
    return FrictionSamples(
        names=tuple(str(name) for name in dataset["channel"].values),
        gaps=tuple(gaps),
        transitions=table(TRANSITIONS, 0, columns),
        **sampled,
    )


def _path(dataset: xarray.Dataset) -> Any:
    if "motion" in dataset:
        return MechanicalPath.restored(dataset["motion"].values)
    if "step_t" not in dataset:
        return None
    names = [field.name for field in dataclasses.fields(LinearMotion) if field.name != "friction"]
    steps: dict[str, Any] = {name: dataset[f"step_{name}"].values for name in names}
    friction = _friction(dataset)
    if friction is not None and len(steps["t"]) != len(friction.slips):
        return None  # the run was asked for other samples than its steps
    return LinearMotion(**steps | {"contacts": steps["contacts"].astype(bool)}, friction=friction)


def _table(dataset: xarray.Dataset, name: str, m: int) -> Any:
    fields, dim = FIELDS[name], TABLES[name]
    if "channel_gap" in dataset:
        fields = {"impacts": IMPACTS}.get(name, fields)
    # version 0.1 had the impacts that were computed where now those are that are listed
    if f"resolved_{dim}_t" in dataset:
        dim = f"resolved_{dim}"
    columns = {field: dataset[f"{dim}_{field}"].values for field in fields}
    return table(fields, m, columns)
