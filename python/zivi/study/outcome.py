"""What a point gives: numbers, arrays of one shape, and events."""

from __future__ import annotations

import functools
from collections.abc import Mapping
from typing import Any, Protocol, TypeAlias, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from zivi.base.check import Array, unmasked
from zivi.simulation.mechanical_trajectory import MechanicalTrajectory
from zivi.simulation.run_result import MassRun
from zivi.study.design import name_of

__all__ = ["RUN_UNITS", "Events", "Values", "split", "units_of"]

Values: TypeAlias = dict[str, float | Array]
Events: TypeAlias = NDArray[np.void]


@runtime_checkable
class Summarised(Protocol):
    """A result of a room above that says what a study keeps of it."""

    def _summary(self) -> tuple[dict[str, Any], dict[str, str]]:
        """Give the values, and the units of those that have one."""


RUN_UNITS = {
    "t": "s",
    "x": "m",
    "xdot": "m/s",
    "x_ref": "m",
    "xdot_ref": "m/s",
    "u": "m/s^2",
    "rest_time": "s",
    "n_impacts": "1",
    "n_zeno": "1",
    "n_liftoffs": "1",
    "nfev": "1",
    "n_steps": "1",
    "n_refused": "1",
    "n_saturated": "1",
    "run_status": "1",
}
"""What is kept of a `Trajectory` or a `ClosedLoop`, with its unit; x, u, ... are the last ones."""


def split(returned: Any) -> tuple[Values, Events | None, bool]:
    """Split what a function returned into values and events, and tell whether it gave events."""
    has_events = isinstance(returned, tuple)
    if not has_events:
        return values_of(returned), None, False
    if len(returned) != 2:
        raise TypeError(f"a tuple must be (values, events), got {len(returned)} things")
    return values_of(returned[0]), events_of(returned[1]), True


def values_of(returned: Any) -> Values:
    """Give the values that are kept, by name."""
    if isinstance(returned, Mapping):
        if not returned:
            raise ValueError("the function returned an empty dict")
        return {name: _value(name, value) for name, value in returned.items()}
    if isinstance(returned, MassRun):
        return _summary(returned)
    if isinstance(returned, MechanicalTrajectory):
        return _mechanical_summary(returned)
    if hasattr(returned, "_summary"):  # quicker than the protocol: numbers come here
        return {name: _value(name, value) for name, value in returned._summary()[0].items()}
    return {"value": _value("the result", returned)}


def _value(name: str, value: Any) -> float | Array:
    if type(value) is float or isinstance(value, float | int):
        return float(value)
    if value is None:
        return np.nan
    unmasked(name, value)
    array = np.asarray(value)
    if array.dtype.kind not in "biuf":
        raise TypeError(
            f"{name} must be a real number or an array of them, got {type(value).__name__} "
            f"{value!r:.60}"
        )
    return array.astype(np.float64)


def _summary(run: MassRun) -> Values:
    last = {
        name: float(samples[-1]) if len(samples := getattr(run, name)) else np.nan
        for name in ("t", "x", "xdot", "x_ref", "xdot_ref", "u")
        if hasattr(run, name)
    }
    counts: dict[str, float] = {
        "n_impacts": len(run.impacts),
        "n_zeno": len(run.zeno_times),
        "n_liftoffs": len(run.liftoff_times),
        "nfev": run.nfev,
        "run_status": int(run.status),
    }
    for name in ("n_steps", "n_refused", "n_saturated"):
        if hasattr(run, name):
            counts[name] = getattr(run, name)
    rest = np.nan if run.rest_time is None else run.rest_time
    return {**last, "rest_time": rest, **{name: float(count) for name, count in counts.items()}}


def _mechanical_summary(run: MechanicalTrajectory) -> Values:
    last: Values = {name: getattr(run, name)[-1] for name in ("q", "qdot", "gaps")}
    counts: dict[str, float] = {
        "n_impacts": len(np.unique(run.impacts["group"])),
        "n_zeno": len(run.zeno),
        "n_liftoffs": len(run.liftoffs),
        "n_corners": len(run.corners),
        "n_flags": len(run.flags),
        "nfev": run.nfev,
        "n_steps": run.n_steps,
        "run_status": int(run.status),
    }
    contacts = run.contacts[-1].astype(np.float64)
    counted = {name: float(count) for name, count in counts.items()}
    return {"t": float(run.t[-1]), **last, "contacts": contacts, **counted}


def units_of(returned: Any) -> dict[str, str]:
    """Give the units of what is kept, as far as they are known: of runs."""
    given = returned[0] if isinstance(returned, tuple) else returned
    if isinstance(given, MassRun):
        return {name: RUN_UNITS[name] for name in _summary(given)}
    if isinstance(given, MechanicalTrajectory):  # those of its coordinates are the user's
        return {"t": "s"}
    if isinstance(given, Summarised):
        return given._summary()[1]
    return {}


def events_of(given: Any) -> Events | None:
    """Give the events of a point as a structured array."""
    if given is None:
        return None
    if isinstance(given, Mapping):
        given = _structured(given)
    if not isinstance(given, np.ndarray) or given.dtype.names is None or given.ndim != 1:
        raise TypeError(
            "events must be a structured array such as sol.impacts, or a dict of arrays of one "
            f"length, got {type(given).__name__} {given!r:.60}"
        )
    for field in given.dtype.names:
        name_of("field of events", field)
        kind = given.dtype[field]
        if kind.kind not in "biuf" or kind.shape:
            raise TypeError(f"events must hold real numbers, got {kind} in {field!r}")
    # without titles, second names of fields, which files do not keep
    return given.astype(_without_titles(given.dtype), copy=False)


@functools.cache
def _without_titles(dtype: np.dtype[Any]) -> np.dtype[Any]:
    return np.dtype([(name, dtype[name]) for name in dtype.names or ()])


def _structured(given: Mapping[str, Any]) -> Events:
    columns = {name: np.asarray(column) for name, column in given.items()}
    lengths = {column.shape for column in columns.values()}
    if len(lengths) != 1 or len(next(iter(lengths))) != 1:
        shapes = {name: column.shape for name, column in columns.items()}
        raise ValueError(f"events must be columns of one length, got the shapes {shapes}")
    dtype = [(name, column.dtype) for name, column in columns.items()]
    table = np.empty(next(iter(lengths)), dtype)
    for name, column in columns.items():
        table[name] = column
    return table
