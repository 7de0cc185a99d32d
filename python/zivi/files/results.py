"""Single runs on disk: netCDF files that hold all that a run is."""

from __future__ import annotations

import hashlib
import os
import uuid
from collections.abc import Callable
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from zivi._zivi import FORMAT
from zivi.base.extras import needed
from zivi.base.table import Tabulated
from zivi.control.closed_loop import ClosedLoop
from zivi.files.mechanical import mechanical_dataset
from zivi.files.restore import loop_variables, path_variables, run_of
from zivi.plot.curve import Line, line_of
from zivi.simulation.mechanical_trajectory import MechanicalTrajectory
from zivi.simulation.trajectory import Trajectory

if TYPE_CHECKING:
    import xarray

__all__ = [
    "ResultError",
    "check_kind",
    "load",
    "open_result",
    "require_folder",
    "require_library",
    "require_regular",
    "restored",
    "save",
]

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
    """A file that is no result, or a damaged one; the text says which and why."""


def check_suffix(name: str, path: Path) -> None:
    """Raise a ValueError for a path whose suffix is that of another kind of file."""
    if path.suffix.lower() not in (*NETCDF, TABLE):
        known = ", ".join(it for it in (*NETCDF, TABLE) if it)
        raise ValueError(f"{name} must end in one of {known}, or have no suffix, got {str(path)!r}")


def require_library() -> None:
    """Raise an ImportError that says what to install if results cannot be written or read."""
    needed(ENGINE, "results in netCDF")


def save(run: Tabulated, path: str | PathLike[str], *, overwrite: bool = False) -> None:
    """Write a result to a file, which is there as a whole or not at all.

    ``xarray.open_dataset(path)`` opens a netCDF file, `load` gives a run back.

    Parameters
    ----------
    run : Trajectory, ClosedLoop, MechanicalTrajectory or another result with ``to_xarray``
        The run, or a batch, derivatives, an orbit, a branch, a diagram, basins, estimates.
    path : path
        The file, in a folder that is there. Its suffix says what is written: that of netCDF
        (``.nc``, ``.nc4``, ``.cdf``, ``.h5``, ``.hdf5`` or none), or ``.csv``: the table of
        ``to_pandas``, for other programs. `load` reads netCDF only: save that, too.
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
    _refuse(path, overwrite)
    require_folder(path)
    draft = path.with_name(f".{path.name}.{uuid.uuid4().hex[:8]}")
    try:
        if path.suffix.lower() == TABLE:
            run.to_pandas().to_csv(draft)
        else:
            dataset_of(run).to_netcdf(draft, engine=ENGINE, format="NETCDF4")
            _seal(draft)
        _refuse(path, overwrite)
        os.replace(draft, path)
    finally:
        draft.unlink(missing_ok=True)


def _refuse(path: Path, overwrite: bool) -> None:
    if path.exists() and not overwrite:
        raise FileExistsError(f"{path} is there already")
    require_regular(path)


def require_folder(path: Path) -> None:
    """Raise a FileNotFoundError if a file cannot be made for want of its folder."""
    if not path.parent.is_dir():
        raise FileNotFoundError(f"{path}: there is no folder {path.parent}; make it first")


def require_regular(path: Path) -> None:
    """Raise if there is something else than a file, which a result must not replace."""
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


def check_kind(file: Path) -> None:
    """Raise an OSError if there is no file, or none that begins as a netCDF file does."""
    if not file.is_file():
        raise FileNotFoundError(f"{file}: there is no such file")
    if file.suffix.lower() == TABLE:
        raise ResultError(f"{file}: is a table, for reading elsewhere; save the run as .nc too")
    with file.open("rb") as opened:
        if opened.read(len(HDF5)) == HDF5:
            return
    hint = ""
    if file.suffix.lower() == ".toml":
        hint = "; zivi simulate, control or sweep computes a result of such a file"
    raise ResultError(f"{file}: is no netCDF file, or damaged{hint}")


def _check_seal(file: Path) -> None:
    """Raise if a file is not, to the last bit, what was written."""
    content = file.read_bytes()
    body, mark, digest = content[:-LENGTH], content[-LENGTH:-64], content[-64:]
    if mark != SEAL:
        raise ResultError(
            f"{file}: does not end as zivi ends a result: it was cut or changed, or something else "
            "wrote it; xarray.open_dataset reads what can be read"
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
        All samples, events and settings. It gives ``sol(t)`` and `impacts_down_to` to the last bit
        as before it was saved.

    Raises
    ------
    FileNotFoundError
        If there is no file.
    ResultError
        If it is something else, or damaged.
    """
    return restored(path, open_result(path), run_of)


def restored(
    path: str | PathLike[str],
    dataset: xarray.Dataset,
    make: Callable[[xarray.Dataset], Trajectory | ClosedLoop | MechanicalTrajectory],
) -> Trajectory | ClosedLoop | MechanicalTrajectory:
    """Make a run of what a file holds; a `ResultError` if it does not hold one."""
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
        raise ResultError(f"{path}: holds no run of zivi ({reason:.200})") from error


def _check_format(path: str | PathLike[str], form: Any) -> None:
    """Raise for a file of a newer zivi; files before format 3 do not tell theirs."""
    try:
        newer = float(form) > FORMAT
    except (TypeError, ValueError):
        raise ResultError(f"{path}: holds no run of zivi (its format is {form!r:.50})") from None
    if newer:
        raise ResultError(f"{path}: has format {form}, this zivi reads {FORMAT}: a newer wrote it")


def open_result(path: str | PathLike[str]) -> xarray.Dataset:
    """Read a file as `load` does, but into a dataset."""
    require_library()
    import xarray

    path = Path(path)
    check_kind(path)
    _check_seal(path)
    try:
        with xarray.open_dataset(path, engine=ENGINE) as opened:
            return opened.load()
    except Exception as error:  # whatever the library of the format raises
        reason = f"{type(error).__name__}: {error}"
        raise ResultError(f"{path}: cannot be read ({reason:.200})") from error


def dataset_of(run: Tabulated) -> xarray.Dataset:
    """Give all that a run is, with the curve that plots draw if it is finer than the samples."""
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
