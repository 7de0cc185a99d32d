"""Runs of mechanical systems as tables and labelled datasets."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

import numpy as np

from zivi.base.table import Field, Table
from zivi.simulation.friction_result import FRICTION

if TYPE_CHECKING:
    import pandas

__all__ = ["MEANING", "TABLES", "labels_of", "rows_of", "table_of"]

TABLES = {
    "impacts": "impact",
    "zeno": "zeno",
    "liftoffs": "liftoff",
    "openings": "opening",
    "corners": "corner",
    "flags": "flag",
}
"""The tables of events of a run, and the dimensions over which they are."""

MEANING: dict[str, Field] = {
    "q": (("time", "coordinate"), "", "coordinates"),
    "qdot": (("time", "coordinate"), "", "velocities"),
    "gaps": (("time", "gap"), "", "gaps"),
    "gap_rates": (("time", "gap"), "", "rates of the gaps"),
    "contacts": (("time", "gap"), "", "which gaps are closed"),
    "reactions": (("time", "gap"), "", "multipliers of the gaps' gradients"),
}
COORDS: dict[str, Field] = {
    "time": ("time", "", "time"),
    "coordinate": ("coordinate", "", "name of the coordinate"),
    "gap": ("gap", "", "name of the gap"),
}


def rows_of(sol: Any) -> dict[str, str]:
    """Tell a run in rows of a table."""

    def times(events: Any) -> str:
        told = [f"{event['t']:.9g} ({sol.gap_names[int(event['gap'])]})" for event in events[:5]]
        return ", ".join(told) + (" ..." if len(events) > 5 else "") or "none"

    last = sol.contacts[-1] if len(sol.t) else []
    closed = [name for name, shut in zip(sol.gap_names, last, strict=False) if shut]
    return {
        "status": f"{sol.status.name.lower()}: {sol.message}",
        "time": f"{sol.t[0]:.6g} to {sol.t[-1]:.6g} s" if len(sol.t) else "no samples",
        "coordinates": ", ".join(sol.coordinate_names),
        "impacts": ", ".join(_counts(sol)) + " resolved",
        "Zeno points": times(sol.zeno),
        "lift-offs": times(sol.liftoffs),
        **_friction_of(sol),
        "corners": ", ".join(f"{t:.9g}" for t in sol.corners["t"][:5]) or "none",
        "flags": ", ".join(f"{f['kind']} at {f['t']:.6g}" for f in sol.flags[:5]) or "none",
        "closed at the end": ", ".join(closed) or "none",
        "steps": f"{sol.n_steps}, {sol.n_rejected} more rejected",
        "evaluations of the system": str(sol.nfev),
    }


def _friction_of(sol: Any) -> dict[str, str]:
    """Tell when friction sticks, if there is any."""
    if not sol.channel_names:
        return {}
    told = [
        f"{sol.channel_names[it['channel']]} {it['t_start']:.6g} .. {it['t_end']:.6g}"
        for it in sol.stick[:5]
    ]
    more = " ..." if len(sol.stick) > 5 else ""
    return {"sticks": (", ".join(told) + more) or "never"}


def _counts(sol: Any) -> list[str]:
    return [str(len(np.unique(it["group"]))) for it in (sol.impacts, sol.resolved_impacts)]


def table_of(sol: Any) -> pandas.DataFrame:
    """Give the samples of a run as a table over time."""
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
    for c, name in enumerate(sol.channel_names):
        columns[f"slip_{name}"] = sol.slips[:, c]
        columns[f"friction_{name}"] = sol.friction_forces[:, c]
        columns[f"mode_{name}"] = sol.modes[:, c]
    if sol.channel_names:
        columns["dissipated"] = sol.dissipated
    return pandas.DataFrame(columns, index=pandas.Index(sol.t, name="time"))


def labels_of(sol: Any) -> Table:
    """Tell what is in the dataset of a run: samples, then events over their numbers."""
    fields, values = dict(MEANING), {"time": sol.t}
    values["coordinate"] = np.array(sol.coordinate_names, dtype=object)
    values["gap"] = np.array(sol.gap_names, dtype=object)
    tables, coords = dict(TABLES), dict(COORDS)
    if sol.channel_names:
        fields |= FRICTION
        tables["transitions"], tables["stick"] = "transition", "stick"
        coords["channel"] = "channel", "", "name of the channel of friction"
        values["channel"] = np.array(sol.channel_names, dtype=object)
    for attribute, dim in tables.items():
        rows = getattr(sol, attribute)
        for field in rows.dtype.names or ():
            values[f"{dim}_{field}"] = np.asarray(rows[field])
            dims = (dim, "gap") if values[f"{dim}_{field}"].ndim == 2 else dim
            fields[f"{dim}_{field}"] = (dims, "", f"{field} of {attribute}")
    attrs = {
        "config": json.dumps(sol.config),  # with infinity, for files give it back
        "status": int(sol.status),
        "message": sol.message,
        "nfev": sol.nfev,
        "n_steps": sol.n_steps,
        "n_rejected": sol.n_rejected,
    }
    return Table("Run of a mechanical system with impacts", fields, coords, values, attrs)
