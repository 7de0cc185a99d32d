"""A run as a dataset, a table, a page: what it is called elsewhere."""

from __future__ import annotations

import html
from typing import TYPE_CHECKING, Any

import numpy as np

from zivi import _zivi
from zivi.base.check import Array
from zivi.base.extras import needed
from zivi.base.plain import text_of
from zivi.simulation.runs import MassRun

if TYPE_CHECKING:
    import pandas
    import xarray

__all__ = ["QUANTITIES", "dataset_of", "html_of", "table_of"]

QUANTITIES = {
    "x": ("m", "distance from the wall"),
    "xdot": ("m/s", "velocity"),
    "s": ("m", "transformed position"),
    "v": ("m/s", "transformed velocity"),
    "lambda_s": ("1", "multiplier of the sign of s"),
    "lambda_v": ("1", "multiplier of the sign of v"),
    "residual": ("1", "relative natural residual of the step"),
}
"""Unit and meaning of each sampled quantity, in the order of the record's rows after time."""


def html_of(sol: MassRun) -> str:
    """Give a run as a table of HTML."""
    fast = np.max(np.abs(sol.impacts["xdot_before"]), initial=0.0)
    rest = "no" if sol.rest_time is None else f"from {sol.rest_time:.9g} s"
    rows = {
        "ended": f"{sol.status.name.lower()}: {sol.message}",
        "time": f"{sol.t[0]:.6g} to {sol.t[-1]:.6g} s" if len(sol.t) else "no samples",
        "impacts": f"{len(sol.impacts)}, the fastest at {fast:.6g} m/s",
        "Zeno points": ", ".join(f"{t:.9g} s" for t in sol.zeno_times[:5]) or "none",
        "at rest at the end": rest,
        "work": f"{sol.n_steps} steps, {sol.nfev} evaluations of the force",
    }
    lines = "".join(
        f"<tr><th style='text-align:left'>{name}</th>"
        f"<td style='text-align:left'>{html.escape(value)}</td></tr>"
        for name, value in rows.items()
    )
    return f"<table><caption>zivi.Trajectory</caption>{lines}</table>"


def table_of(sol: MassRun) -> pandas.DataFrame:
    """Give the samples of a run as a table over time."""
    needed("pandas", "tables")
    import pandas

    columns = {name: getattr(sol, name) for name in QUANTITIES}
    return pandas.DataFrame(columns, index=pandas.Index(sol.t, name="time"))


def dataset_of(sol: MassRun) -> xarray.Dataset:
    """Give a run as a labelled dataset."""
    needed("xarray", "labelled datasets")
    import xarray

    def labelled(dim: str, values: Array, unit: str, meaning: str) -> Any:
        return dim, values, {"units": unit, "long_name": meaning}

    events = {
        "impact_xdot_before": ("impact_time", "xdot_before", "velocity before the impact"),
        "impact_xdot_after": ("impact_time", "xdot_after", "velocity after the impact"),
    }
    return xarray.Dataset(
        {
            name: labelled("time", getattr(sol, name), unit, meaning)
            for name, (unit, meaning) in QUANTITIES.items()
        }
        | {
            name: labelled(dim, sol.impacts[field], "m/s", meaning)
            for name, (dim, field, meaning) in events.items()
        }
        | {
            name: labelled("time", values, unit, meaning)
            for name, (values, unit, meaning) in _in_fixed_frame(sol).items()
        }
        | {
            "zeno_time": labelled("zeno", sol.zeno_times, "s", "time of a Zeno point"),
            "liftoff_time": labelled("liftoff", sol.liftoff_times, "s", "time of a lift-off"),
        },
        coords={
            "time": labelled("time", sol.t, "s", "time"),
            "impact_time": labelled("impact_time", sol.impacts["t"], "s", "time of an impact"),
        },
        attrs={
            "title": "Trajectory of a mechanical system with impacts",
            "source": f"zivi {_zivi.__version__}",
            "config": text_of(sol.config),
            "status": int(sol.status),
            "message": sol.message,
            "rest_time": np.nan if sol.rest_time is None else sol.rest_time,
            "nfev": sol.nfev,
            "n_steps": sol.n_steps,
            "n_rejected": sol.n_rejected,
            "n_failed_steps": len(sol.failed_steps),
        },
    )


def _in_fixed_frame(sol: MassRun) -> dict[str, tuple[Array, str, str]]:
    """Name what a moving wall adds: values, unit and meaning."""
    if sol._wall is None:
        return {}
    x, xdot = sol.fixed()
    return {
        "x_fixed": (x, "m", "position in the fixed frame"),
        "xdot_fixed": (xdot, "m/s", "velocity in the fixed frame"),
        "wall": (sol._wall(sol.t)[0], "m", "position of the wall"),
    }
