"""Runs of mechanical systems as tables and labelled datasets."""

from __future__ import annotations

import html
import json
from typing import TYPE_CHECKING, Any

import numpy as np

from zivi import _zivi
from zivi.base.extras import needed
from zivi.simulation.runs import MechanismRun

if TYPE_CHECKING:
    import pandas
    import xarray

__all__ = ["MEANING", "TABLES", "dataset_of", "html_of", "rows_of", "table_of"]

TABLES = {
    "impacts": "impact",
    "zeno": "zeno",
    "liftoffs": "liftoff",
    "openings": "opening",
    "corners": "corner",
    "flags": "flag",
}
"""The tables of events of a run, and the dimensions over which they are."""

MEANING = {
    "q": (("time", "coordinate"), "coordinates"),
    "qdot": (("time", "coordinate"), "velocities"),
    "gaps": (("time", "gap"), "gaps"),
    "gap_rates": (("time", "gap"), "rates of the gaps"),
    "contacts": (("time", "gap"), "which gaps are closed"),
    "reactions": (("time", "gap"), "multipliers of the gaps' gradients"),
}


def rows_of(sol: MechanismRun) -> dict[str, str]:
    """Tell a run in rows of a table."""

    def times(events: Any) -> str:
        told = [f"{event['t']:.9g} ({sol.gap_names[int(event['gap'])]})" for event in events[:5]]
        return ", ".join(told) + (" ..." if len(events) > 5 else "") or "none"

    last = sol.contacts[-1] if len(sol.t) else []
    closed = [name for name, shut in zip(sol.gap_names, last, strict=False) if shut]
    return {
        "status": f"{sol.status.name.lower()}: {sol.message}",
        "span": f"{sol.t[0]:.6g} to {sol.t[-1]:.6g}" if len(sol.t) else "no samples",
        "coordinates": ", ".join(sol.coordinate_names),
        "impacts": f"{len(np.unique(sol.impacts['group']))} resolved",
        "Zeno points": times(sol.zeno),
        "lift-offs": times(sol.liftoffs),
        "corners": ", ".join(f"{t:.9g}" for t in sol.corners["t"][:5]) or "none",
        "flags": ", ".join(f"{f['kind']} at {f['t']:.6g}" for f in sol.flags[:5]) or "none",
        "closed at the end": ", ".join(closed) or "none",
        "steps": f"{sol.n_steps}, {sol.n_rejected} more rejected",
        "evaluations of the system": str(sol.nfev),
    }


def html_of(sol: MechanismRun) -> str:
    """Tell a run in a table of HTML."""
    lines = "".join(
        f"<tr><th style='text-align:left'>{name}</th>"
        f"<td style='text-align:left'>{html.escape(value)}</td></tr>"
        for name, value in rows_of(sol).items()
    )
    return f"<table><caption>zivi.MechanicalTrajectory</caption>{lines}</table>"


def table_of(sol: MechanismRun) -> pandas.DataFrame:
    """Give the samples of a run as a table over time."""
    needed("pandas", "tables")
    import pandas

    columns: dict[str, Any] = {}
    for j, name in enumerate(sol.coordinate_names):
        columns[name] = sol.q[:, j]
    for j, name in enumerate(sol.coordinate_names):
        columns[f"{name}dot"] = sol.qdot[:, j]
    for i, name in enumerate(sol.gap_names):
        columns[name] = sol.gaps[:, i]
    for i, name in enumerate(sol.gap_names):
        columns[f"reaction_{name}"] = sol.reactions[:, i]
    return pandas.DataFrame(columns, index=pandas.Index(sol.t, name="time"))


def dataset_of(sol: MechanismRun) -> xarray.Dataset:
    """Give a run as a labelled dataset."""
    needed("xarray", "labelled datasets")
    import xarray

    variables: dict[str, Any] = {
        name: (dims, getattr(sol, name), {"long_name": meaning})
        for name, (dims, meaning) in MEANING.items()
    }
    for attribute, dim in TABLES.items():
        rows = getattr(sol, attribute)
        for field in rows.dtype.names or ():
            values = np.asarray(rows[field])
            dims = (dim, "gap") if values.ndim == 2 else (dim,)
            variables[f"{dim}_{field}"] = (dims, values, {"long_name": f"{field} of {attribute}"})
    return xarray.Dataset(
        variables,
        coords={
            "time": ("time", sol.t, {"long_name": "time"}),
            "coordinate": ("coordinate", np.array(sol.coordinate_names, dtype=object)),
            "gap": ("gap", np.array(sol.gap_names, dtype=object)),
        },
        attrs={
            "title": "Run of a mechanical system with impacts",
            "source": f"zivi {_zivi.__version__}",
            "config": json.dumps(sol.config),
            "status": int(sol.status),
            "message": sol.message,
            "nfev": sol.nfev,
            "n_steps": sol.n_steps,
            "n_rejected": sol.n_rejected,
        },
    )
