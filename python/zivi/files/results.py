"""Single runs in netCDF files."""

from __future__ import annotations

import dataclasses
import hashlib
import json
import os
import uuid
from collections.abc import Callable
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

from zivi._zivi import FORMAT, MechanicalPath, MotionPath
from zivi.base.check import Array
from zivi.base.extras import needed
from zivi.base.status import Status
from zivi.base.table import Tabulated
from zivi.control import loop_run
from zivi.control.loop_run import BallisticPath, ClosedLoop, SampledReference, Updates
from zivi.control.mechanical_loop import LOOP_FIELDS, MechanicalClosedLoop
from zivi.plot.curves import Line, line_of
from zivi.simulation.dense import LinearPath, LostPath, PenetratingPath
from zivi.simulation.events import FIELDS, IMPACT, SLOWEST, table
from zivi.simulation.mechanical_trajectory import (
    FRICTION,
    IMPACTS,
    MEANING,
    TABLES,
    TRANSITIONS,
    FrictionSamples,
    LinearMotion,
    MechanicalTrajectory,
)
from zivi.simulation.trajectory import LIFTED, QUANTITIES, Trajectory, Transformed
from zivi.system.gap import HarmonicWall, MovingWall
from zivi.system.kicks import kicks_table
from zivi.system.table import Table, TableMotion

if TYPE_CHECKING:
    import xarray

# Runs of mechanical systems in datasets, and back.

JOINT = -1
"""The gap of a channel of friction that has none."""
ATTRIBUTE = {"impacts": "resolved_impacts"}
"""Fields that hold tables of another name."""


def holds_mechanical(dataset: xarray.Dataset) -> bool:
    """Whether a dataset is a run of a mechanical system."""
    return "reactions" in dataset


def mechanical_dataset(run: MechanicalTrajectory) -> xarray.Dataset:
    """Return all that a run is: its labelled dataset, the events of the user and the motion."""
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
    """Return the run that a dataset holds; its system is not in it."""
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
        **{ATTRIBUTE.get(name, name): _read_table(dataset, name, len(names)) for name in TABLES},
        slowest=float(attrs.get("slowest", SLOWEST)),
        status=Status(int(attrs["status"])),
        message=str(attrs["message"]),
        nfev=int(attrs["nfev"]),
        n_steps=int(attrs["n_steps"]),
        n_rejected=int(attrs["n_rejected"]),
        coordinate_names=tuple(str(name) for name in dataset["coordinate"].values),
        gap_names=names,
        **_equalities(dataset),
        _setup=json.loads(attrs["config"]),
        t_events=[dataset["event_time"].values[own] for own in each],
        q_events=[dataset["event_q"].values[own] for own in each],
        qdot_events=[dataset["event_qdot"].values[own] for own in each],
        _path=_mechanical_path(dataset),
        _friction=_friction(dataset),
    )


def _of_loop(dataset: xarray.Dataset) -> tuple[type[MechanicalTrajectory], dict[str, Any]]:
    """Return the data of a closed loop that a run does not have."""
    if "control" not in dataset.coords:
        return MechanicalTrajectory, {}
    more: dict[str, Any] = {name: dataset[name].values for name in LOOP_FIELDS}
    more["latched"] = more["latched"].astype(bool)
    names = tuple(str(name) for name in dataset["control"].values)
    return MechanicalClosedLoop, more | {"control_names": names}


def _equalities(dataset: xarray.Dataset) -> dict[str, Any]:
    """Return the constraint forces and the names of the equality rows."""
    if "equality" not in dataset.coords:
        return {"constraint_forces": np.empty((len(dataset["time"]), 0))}
    names = tuple(str(name) for name in dataset["equality"].values)
    return {"constraint_forces": dataset["constraint_forces"].values, "equality_names": names}


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


def _mechanical_path(dataset: xarray.Dataset) -> Any:
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


def _read_table(dataset: xarray.Dataset, name: str, m: int) -> Any:
    fields, dim = FIELDS[name], TABLES[name]
    if "channel_gap" in dataset:
        fields = {"impacts": IMPACTS}.get(name, fields)
    # version 0.1 had the impacts that were computed where now those are that are listed
    if f"resolved_{dim}_t" in dataset:
        dim = f"resolved_{dim}"
    # version 0.2 had no touchdowns
    known = name != "touchdowns" or f"{dim}_t" in dataset
    columns = {field: dataset[f"{dim}_{field}"].values for field in fields} if known else {"t": ()}
    return table(fields, m, columns)


# Makes runs of datasets again.

PATHS: dict[str, Any] = {kind.__name__: kind for kind in (LinearPath, PenetratingPath)}
"""What interpolates the samples of methods with fixed steps."""
LOOP_PATHS = {
    "BallisticPath": ("t", "x", "xdot", "net", "side", "full"),
    "LinearPath": ("t", "s", "v"),
}
"""What the path of a closed loop is made of."""
MOTION, NOTHING, LOST = "MotionPath", "none", ""
"""Other names: the dense output of a method, no path, and that of files which never held one."""


def read_run(dataset: xarray.Dataset) -> Trajectory | ClosedLoop | MechanicalTrajectory:
    """Return the run that a dataset holds."""
    run: Trajectory | ClosedLoop | MechanicalTrajectory
    if holds_mechanical(dataset):
        run = mechanical_run(dataset)
    else:
        run = _closed_loop(dataset) if "u" in dataset else _trajectory(dataset)
    if "kick_t" in dataset:
        n = dataset.sizes["coordinate"] if dataset["kick_dv"].ndim > 1 else None
        names = kicks_table([], n).dtype.names or ()
        columns = (dataset[f"kick_{name}"].values for name in names)
        vars(run)["_kicks"] = kicks_table(list(zip(*columns, strict=True)), n)
    return run


def read_curve(dataset: xarray.Dataset) -> Trajectory | ClosedLoop | MechanicalTrajectory:
    """Return the run with the samples that its plots show."""
    run = read_run(dataset)
    if "curve_time" not in dataset or not isinstance(run, Trajectory):
        return run
    x, xdot, s, v = (dataset[f"curve_{name}"].values for name in ("x", "xdot", "s", "v"))
    lifted = dataclasses.replace(run.transformed, s=s, v=v)
    curve: dict[str, Any] = {"x": x, "xdot": xdot, "transformed": lifted}
    times = dataset["curve_time"].values
    impacts = np.zeros(dataset.sizes["curve_impacts"], IMPACT)
    impacts["t"] = times[dataset["curve_impact"].values]
    return dataclasses.replace(run, t=times, **curve, resolved_impacts=impacts, _path=None)


def _common_fields(dataset: xarray.Dataset) -> dict[str, Any]:
    attrs = dataset.attrs
    return {
        "t": dataset["time"].values,
        "resolved_impacts": _read_impacts(dataset),
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


def _read_impacts(dataset: xarray.Dataset) -> NDArray[np.void]:
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
    times, states = _split_events(dataset)
    return ClosedLoop(
        **_common_fields(dataset),
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
    """Return the path type of a closed loop, and the data of its path and its reference."""
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
    attrs, common = dataset.attrs, _common_fields(dataset)
    samples: dict[str, Any] = {name: dataset[name].values for name in QUANTITIES}
    config = _config(dataset)
    times, states = _split_events(dataset)
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
        _wall=_read_wall(config["wall"]),
    )


def path_variables(run: Trajectory) -> tuple[str, dict[str, Array]]:
    """Return the path type of a run and the data from which it is restored."""
    path = run._path
    if isinstance(path, MotionPath):
        return MOTION, {"motion": path.numbers()}
    name = type(path).__name__
    if path is None or name not in PATHS:
        return NOTHING if path is None else LOST, {}
    samples = {field: getattr(path, field) for field in _sampled_fields(PATHS[name])}
    own = {"t": run.t, "x": run.x, "xdot": run.xdot, **vars(run.transformed)}
    same = all(np.array_equal(own[field], samples[field]) for field in samples)
    return name, {} if same else {f"path_{field}": samples[field] for field in samples}


def _sampled_fields(kind: Any) -> list[str]:
    """List the samples that a path interpolates."""
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
        known = {field: dataset[f"path_{field}"].values for field in _sampled_fields(kind)}
    path: LinearPath = kind(**{field: known[field] for field in _sampled_fields(kind)}, kappa=kappa)
    return path


def _split_events(dataset: xarray.Dataset) -> tuple[list[Array], list[Array]]:
    """Split the events by event function."""
    function, times = dataset["event_function"].values, dataset["event_time"].values
    states = np.column_stack([dataset["event_x"].values, dataset["event_xdot"].values])
    each = [function == number for number in range(int(dataset.attrs["n_event_functions"]))]
    return [times[own] for own in each], [states[own] for own in each]


def _read_wall(told: dict[str, Any] | None) -> HarmonicWall | MovingWall | TableMotion | None:
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


# Single runs on disk: netCDF files that hold all that a run is.

ENGINE: Literal["h5netcdf"] = "h5netcdf"
NETCDF, TABLE = (".nc", ".nc4", ".cdf", ".h5", ".hdf5", ""), ".csv"
"""Suffixes of what can be written."""
HDF5 = b"\x89HDF\r\n\x1a\n"
"""How a netCDF file begins."""
SEAL = b"\nend of a result of zivi, sha256 "
"""How ours ends, before the digest of all that is before."""
LENGTH = len(SEAL) + 64
CURVE = {
    "x": ("m", "distance from the wall, as a curve"),
    "xdot": ("m/s", "velocity, as a curve"),
    "s": ("m", "transformed position, as a curve"),
    "v": ("m/s", "transformed velocity, as a curve"),
}


class ResultError(OSError):
    """Raised for a file that is not a result or is damaged; the message says why."""


def check_suffix(name: str, path: Path) -> None:
    """Raise a ValueError for a path whose suffix is that of another kind of file."""
    if path.suffix.lower() not in (*NETCDF, TABLE):
        known = ", ".join(it for it in (*NETCDF, TABLE) if it)
        raise ValueError(f"{name} must end in one of {known} or in no suffix, got {str(path)!r}")


def require_library() -> None:
    """Raise an ImportError that names the missing package if results cannot be read or written."""
    needed(ENGINE, "results in netCDF")


def save(run: Tabulated, path: str | PathLike[str], *, overwrite: bool = False) -> None:
    """Write a result to a file, which is there as a whole or not at all.

    ``xarray.open_dataset(path)`` opens a netCDF file; `load` restores the run.

    Parameters
    ----------
    run : Trajectory, ClosedLoop, MechanicalTrajectory or another result with ``to_xarray``
        The run, or a batch, derivatives, an orbit, a branch, a diagram, basins, estimates.
    path : path
        The file, in a folder that is there. Its suffix selects the format: netCDF (``.nc``,
        ``.nc4``, ``.cdf``, ``.h5``, ``.hdf5`` or none), or ``.csv``, the table of ``to_pandas`` for
        other programs. `load` reads netCDF only: save the run in that format as well.
    overwrite : bool
        Whether a file that is there may be replaced.

    Raises
    ------
    TypeError
        For what is no result of zivi.
    ValueError
        For another suffix.
    FileNotFoundError
        If the folder is not there.
    FileExistsError
        If the file is there, or something that is no file.
    ImportError
        If h5netcdf is missing, the extra ``files``; for a table pandas, the extra ``xarray``.

    Examples
    --------
    >>> import os, tempfile, zivi.files
    >>> ball = zivi.ImpactSystem(-9.81, e=0.5)
    >>> sol = zivi.simulate(ball, (0, 3), (1, 0))
    >>> file = os.path.join(tempfile.mkdtemp(), "ball.nc")
    >>> zivi.files.save(sol, file)
    >>> zivi.files.load(file).rest_time == sol.rest_time
    True
    """
    path = Path(path)
    if not isinstance(run, Tabulated):
        raise TypeError(f"run must be a result of zivi with to_xarray, got {type(run).__name__}")
    check_suffix("path", path)
    if path.suffix.lower() != TABLE:
        require_library()
    _check_target(path, overwrite)
    require_folder(path)
    draft = path.with_name(f".{path.name}.{uuid.uuid4().hex[:8]}")
    try:
        if path.suffix.lower() == TABLE:
            run.to_pandas().to_csv(draft)
        else:
            dataset_of(run).to_netcdf(draft, engine=ENGINE, format="NETCDF4")
            _seal(draft)
        _check_target(path, overwrite)
        os.replace(draft, path)
    finally:
        draft.unlink(missing_ok=True)


def _check_target(path: Path, overwrite: bool) -> None:
    if path.exists() and not overwrite:
        raise FileExistsError(f"{path} is there already; overwrite=True replaces it")
    require_regular(path)


def require_folder(path: Path) -> None:
    """Raise a FileNotFoundError if a file cannot be made for want of its folder."""
    if not path.parent.is_dir():
        raise FileNotFoundError(f"{path}: folder {path.parent} does not exist; create it first")


def require_regular(path: Path) -> None:
    """Raise if the path exists and is not a file, which a result must not replace."""
    if path.is_dir():
        raise FileExistsError(f"{path}: is a folder")
    if path.exists() and not path.is_file():
        raise FileExistsError(f"{path}: is a device or a pipe, no file that could be replaced")


def _seal(file: Path) -> None:
    """Append the digest of a file, which HDF5 does not mind, and wait until it is on the disk."""
    with file.open("r+b") as opened:
        seal = SEAL + hashlib.file_digest(opened, "sha256").hexdigest().encode()
        opened.seek(0, os.SEEK_END)
        opened.write(seal)
        opened.flush()
        os.fsync(opened.fileno())


def check_netcdf(file: Path) -> None:
    """Raise an OSError if the file does not exist or does not begin like a netCDF file."""
    if not file.is_file():
        raise FileNotFoundError(f"{file}: does not exist")
    if file.suffix.lower() == TABLE:
        raise ResultError(f"{file}: is a table, for reading elsewhere; save the run as .nc too")
    with file.open("rb") as opened:
        if opened.read(len(HDF5)) == HDF5:
            return
    hint = ""
    if file.suffix.lower() == ".toml":
        hint = "; zivi simulate, control or sweep computes a result of such a file"
    raise ResultError(f"{file}: is not a netCDF file, or is damaged{hint}")


def _check_seal(file: Path) -> None:
    """Raise if a file is not, to the last bit, what was written."""
    content = file.read_bytes()
    body, mark, digest = content[:-LENGTH], content[-LENGTH:-64], content[-64:]
    if mark != SEAL:
        raise ResultError(
            f"{file}: lacks the end mark of zivi: it was truncated, changed or written by another "
            "program; xarray.open_dataset reads the readable part"
        )
    if hashlib.sha256(body).hexdigest().encode() != digest:
        raise ResultError(f"{file}: was damaged or changed since zivi wrote it")


def load(path: str | PathLike[str]) -> Trajectory | ClosedLoop | MechanicalTrajectory:
    """Read a run back from a netCDF file.

    Parameters
    ----------
    path : path
        What `save`, ``zivi simulate`` or ``zivi control`` wrote.

    Returns
    -------
    Trajectory, ClosedLoop or MechanicalTrajectory
        All samples, events and settings. ``sol(t)`` and `impacts_down_to` are bit-identical to the
        saved run.

    Raises
    ------
    FileNotFoundError
        If there is no file.
    ResultError
        If it is something else, or damaged.
    """
    return restored(path, open_result(path), read_run)


def restored(
    path: str | PathLike[str],
    dataset: xarray.Dataset,
    make: Callable[[xarray.Dataset], Trajectory | ClosedLoop | MechanicalTrajectory],
) -> Trajectory | ClosedLoop | MechanicalTrajectory:
    """Restore a run from a dataset; raise a `ResultError` if that is impossible."""
    _check_format(path, dataset.attrs.get("format", 0))
    if "result" in dataset.attrs:
        kind = dataset.attrs["result"]
        raise ResultError(f"{path}: holds a {kind}, no run: xarray.open_dataset reads it")
    try:
        return make(dataset)
    except KeyError as error:
        raise ResultError(f"{path}: lacks {error}; it is of another version") from error
    except Exception as error:  # whatever stands there in place of what was written
        reason = f"{type(error).__name__}: {error}"
        raise ResultError(f"{path}: is not a run of zivi ({reason:.200})") from error


def _check_format(path: str | PathLike[str], form: Any) -> None:
    """Raise for a file of a newer zivi; files before format 3 do not tell theirs."""
    try:
        newer = float(form) > FORMAT
    except (TypeError, ValueError):
        raise ResultError(f"{path}: is not a run of zivi (its format is {form!r:.50})") from None
    if newer:
        raise ResultError(
            f"{path}: was written by a newer version of zivi (format {form}; this version reads "
            f"{FORMAT}); update zivi"
        )


def open_result(path: str | PathLike[str]) -> xarray.Dataset:
    """Read a file as `load` does, but into a dataset."""
    require_library()
    import xarray

    path = Path(path)
    check_netcdf(path)
    _check_seal(path)
    try:
        with xarray.open_dataset(path, engine=ENGINE) as opened:
            return opened.load()
    except Exception as error:  # whatever the library of the format raises
        reason = f"{type(error).__name__}: {error}"
        raise ResultError(f"{path}: cannot be read ({reason:.200})") from error


def dataset_of(run: Tabulated) -> xarray.Dataset:
    """Return the complete dataset of a run, with the plot curve if finer than the samples."""
    dataset = _contents(run)
    dataset.attrs["format"] = FORMAT
    return dataset


def _contents(run: Tabulated) -> xarray.Dataset:
    if isinstance(run, MechanicalTrajectory):
        return mechanical_dataset(run)
    dataset = run.to_xarray()
    if not isinstance(run, Trajectory | ClosedLoop):
        dataset.attrs["result"] = type(run).__name__
        return dataset
    for field in run.resolved_impacts.dtype.names or ():
        name = f"resolved_impact_{'time' if field == 't' else field}"
        meaning = f"{field} of an impact that was computed"
        dataset[name] = "resolved", run.resolved_impacts[field], {"long_name": meaning}
    dataset.attrs["slowest"] = run.slowest
    if isinstance(run, Trajectory):
        dataset["failed_step"] = "failed", run.failed_steps, {"long_name": "number of a step"}
        _add_events(dataset, run)
        line = line_of(run)
        if len(line.t) != len(run.t):
            _add_curve(dataset, line)
        _add_path(dataset, run)
    else:
        _add_events(dataset, run)
        _add_loop_path(dataset, run)
    return dataset


def _add_loop_path(dataset: xarray.Dataset, run: ClosedLoop) -> None:
    """Add what the motion of plant and reference between the samples is made of."""
    dataset.attrs["path"], of_path, of_reference = loop_variables(run)
    if run._span is not None:
        dataset.attrs["span"] = np.array(run._span)
    named = {it if it == "motion" else f"path_{it}": values for it, values in of_path.items()}
    named |= {f"reference_{it}": values for it, values in of_reference.items()}
    for name, values in named.items():
        meaning = "the motion between the samples, in zivi's own form"
        dataset[name] = f"{name}_number", np.ravel(values), {"long_name": meaning}


def _add_path(dataset: xarray.Dataset, run: Trajectory) -> None:
    """Add what the motion between the samples is made of."""
    dataset.attrs["path"], variables = path_variables(run)
    dim = "motion" if "motion" in variables else "path_time"
    for name, values in variables.items():
        meaning = "the motion between the samples, in zivi's own form"
        dataset[name] = f"{dim}_number", values, {"long_name": meaning}


def _add_events(dataset: xarray.Dataset, run: Trajectory | ClosedLoop) -> None:
    """Add the events of the user, one table for all functions."""
    numbers = np.repeat(np.arange(len(run.t_events)), [len(times) for times in run.t_events])
    times = np.concatenate([*run.t_events, np.empty(0)])
    states = np.concatenate([*run.y_events, np.empty((0, 2))])
    dataset["event_function"] = "event", numbers, {"long_name": "number of the event function"}
    dataset["event_time"] = "event", times, {"units": "s", "long_name": "time of an event"}
    for column, (name, unit) in enumerate((("x", "m"), ("xdot", "m/s"))):
        dataset[f"event_{name}"] = "event", states[:, column], {"units": unit, "long_name": name}
    dataset.attrs["n_event_functions"] = len(run.t_events)


def _add_curve(dataset: xarray.Dataset, line: Line) -> None:
    attrs = {"units": "s", "long_name": "time, of the curve"}
    dataset.coords["curve_time"] = "curve_time", line.t, attrs
    for name, (unit, meaning) in CURVE.items():
        attrs = {"units": unit, "long_name": meaning}
        dataset[f"curve_{name}"] = "curve_time", getattr(line, name), attrs
    attrs = {"long_name": "index of the first point of the curve after an impact"}
    dataset["curve_impact"] = "curve_impacts", np.asarray(line.impacts, np.int64), attrs
