"""The result of a run of a mechanical system, with contact forces and friction."""

from __future__ import annotations

import dataclasses
import functools
import json
import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, ClassVar, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

import zivi._zivi as _zivi
from zivi.base.check import Array
from zivi.base.extras import needed
from zivi.base.status import Status
from zivi.base.table import Field, ResultTable, counted
from zivi.simulation.events import (
    FIELDS,
    SLOWEST,
    EventTable,
    Rows,
    down_to_of_gaps,
    listed_of_gaps,
    table,
)
from zivi.simulation.run_result import Closer, SampledRun, Setup, trust_note, trusted
from zivi.simulation.trajectory import STATUSES
from zivi.system.gap import Channel
from zivi.system.mechanism import MechanicalSystem, Model
from zivi.system.model_parts import Evaluation
from zivi.system.space import (
    continuous,
    quaternions_of,
    rotate,
    with_angular_velocities,
    with_quaternions,
    without_charts,
)

if TYPE_CHECKING:
    import pandas


# Friction results of a run of a mechanical system.

OPEN = 2
"""The mode of a channel whose gap is open."""

IMPACTS = FIELDS["impacts"] | {
    "tangential_impulse": "f8",
    "slip_before": "f8",
    "slip_after": "f8",
    "sticks": "?",
}
"""Fields of impacts where there is friction, and their types."""
TRANSITIONS = {"t": "f8", "channel": "i8", "before": "i1", "after": "i1"}
STICK = {"t_start": "f8", "t_end": "f8", "channel": "i8"}

FRICTION: dict[str, Field] = {
    "slips": (("time", "channel"), "", "slip speeds"),
    "slip_distances": (("time", "channel"), "", "integrals of the slip speeds"),
    "friction_forces": (("time", "channel"), "", "forces of friction along the directions of slip"),
    "modes": (("time", "channel"), "", "1 and -1 slip, 0 stick, 2 the gap is open"),
    "dissipated": ("time", "", "work that friction has dissipated"),
}
"""Quantities of the samples."""


@dataclasses.dataclass(frozen=True, eq=False)
class FrictionSamples:
    """Samples and transitions of the channels of dry friction, p of them.

    Parameters
    ----------
    names : tuple of str
        The channels.
    gaps : tuple of int or None
        The gap of each, None of a joint.
    slips, slip_distances, friction_forces : ndarray
        Shape (k, p).
    modes : ndarray of int8
        Shape (k, p).
    dissipated : ndarray
        Shape (k,).
    transitions : recarray
        Where a channel sticks, slips or turns.
    """

    names: tuple[str, ...]
    gaps: tuple[int | None, ...]
    slips: Array
    slip_distances: Array
    friction_forces: Array
    modes: NDArray[np.int8]
    dissipated: Array
    transitions: Rows

    @property
    def rows(self) -> tuple[int | None, ...]:
        """The number of the direction of each channel, of a gap with two."""
        several = [gap is not None and self.gaps.count(gap) > 1 for gap in self.gaps]
        first = [self.gaps.index(gap) for gap in self.gaps]
        return tuple(c - first[c] if two else None for c, two in enumerate(several))


def friction_samples(
    record: _zivi.FrictionRecord | None, channels: tuple[Channel, ...]
) -> FrictionSamples | None:
    """Return the friction data of a record; None without friction."""
    if record is None:
        return None
    columns = {name: getattr(record, f"transition_{name}") for name in TRANSITIONS}
    return FrictionSamples(
        names=tuple(channel.label for channel in channels),
        gaps=tuple(channel.gap for channel in channels),
        slips=record.slips,
        slip_distances=record.slip_distances,
        friction_forces=record.forces,
        modes=record.modes,
        dissipated=record.dissipated,
        transitions=table(TRANSITIONS, 0, columns),
    )


def impacts_with(
    columns: dict[str, Any], record: _zivi.FrictionRecord, channels: tuple[Channel, ...]
) -> dict[str, Any]:
    """Add to the columns of impacts what friction did in them: no impulse without a tangent."""
    count = len(columns["t"])
    more: dict[str, Any] = {
        "tangential_impulse": np.zeros(count),
        "slip_before": np.full(count, np.nan),
        "slip_after": np.full(count, np.nan),
        "sticks": np.zeros(count, dtype=bool),
    }
    known = zip(columns["group"].tolist(), columns["gap"].tolist(), strict=True)
    places = {key: i for i, key in enumerate(known)}
    told = zip(record.tangential_group.tolist(), record.tangential_channel.tolist(), strict=True)
    at = [places[group, channels[channel].gap] for group, channel in told]
    more["sticks"][at] = record.tangential_sticks
    rows = [channels[channel].row for channel in record.tangential_channel.tolist()]
    for name, values in (
        ("tangential_impulse", record.tangential_impulse),
        ("slip_before", record.tangential_slip_before),
        ("slip_after", record.tangential_slip_after),
    ):
        into = more[name]
        for place, row, value in zip(at, rows, values.tolist(), strict=True):
            # of two directions, which follow each other, the size
            into[place] = math.hypot(into[place], value) if row else value
            if row == 0:
                into[place] = abs(value)
    return columns | more


class FrictionRun:
    """The friction of a run: `MechanicalTrajectory` has it."""

    if TYPE_CHECKING:
        t: Array
        liftoffs: Any
        openings: Any
        _friction: FrictionSamples | None

    def _rubbed(self, name: str) -> Any:
        if self._friction is None:
            return np.empty((len(self.t), 0), np.int8 if name == "modes" else float)
        return getattr(self._friction, name)

    @property
    def channel_names(self) -> tuple[str, ...]:
        """Names of the channels of dry friction: gaps with friction, then joints."""
        return () if self._friction is None else self._friction.names

    @property
    def channel_gaps(self) -> tuple[int | None, ...]:
        """The gap of each channel, None of a joint."""
        return () if self._friction is None else self._friction.gaps

    @property
    def slips(self) -> Array:
        """Slip speeds, shape (k, p); exactly 0 while sticking."""
        return self._rubbed("slips")  # type: ignore[no-any-return]

    @property
    def slip_directions(self) -> Array:
        """Directions of slip, shape (k, p); 0 where nothing slips.

        Of a gap with two tangents the components of the unit vector, in a channel of its own the
        sign.
        """
        sizes = np.abs(self.slips)
        channels = () if self._friction is None else self._friction.rows
        for c, row in enumerate(channels):
            if row == 0:
                sizes[:, c] = sizes[:, c + 1] = np.hypot(sizes[:, c], sizes[:, c + 1])
        slipping = (np.abs(self.modes) == 1) & (sizes > 0.0)
        return np.divide(self.slips, sizes, out=np.zeros_like(sizes), where=slipping)

    @property
    def slip_distances(self) -> Array:
        """Integrals of the slip speeds from the start, shape (k, p)."""
        return self._rubbed("slip_distances")  # type: ignore[no-any-return]

    @property
    def friction_forces(self) -> Array:
        """Forces of friction along the directions of slip, shape (k, p)."""
        return self._rubbed("friction_forces")  # type: ignore[no-any-return]

    @property
    def modes(self) -> NDArray[np.int8]:
        """Mode of each channel, shape (k, p): 1 and -1 slip, 0 stick, 2 open gap."""
        return self._rubbed("modes")  # type: ignore[no-any-return]

    @property
    def dissipated(self) -> Array:
        """Work that friction has dissipated since the start, shape (k,)."""
        return np.zeros(len(self.t)) if self._friction is None else self._friction.dissipated

    @property
    def transitions(self) -> Rows:
        """Where a channel sticks, slips or turns: ``t``, ``channel``, ``before``, ``after``.

        The numbers of modes are those of ``modes``: before the first one of a contact is 2.
        """
        if self._friction is None:
            return table(TRANSITIONS, 0, {name: np.empty(0) for name in TRANSITIONS})
        return self._friction.transitions

    @functools.cached_property
    def stick(self) -> Rows:
        """Intervals of sticking: ``t_start``, ``t_end``, ``channel``."""
        rows: list[tuple[float, float, int]] = []
        if self._friction is not None:
            for channel in range(len(self._friction.gaps)):
                spans = self._spans(channel)
                rows += [(start, end, channel) for start, end, mode in spans if mode == 0]
        return np.array(sorted(rows), dtype=list(STICK.items())).view(EventTable)

    def _spans(self, channel: int) -> list[tuple[float, float, int]]:
        """Return start, end and mode of the intervals of a channel."""
        own = self.transitions[self.transitions["channel"] == channel]
        gap = self.channel_gaps[channel]
        opened = [rows["t"][rows["gap"] == gap] for rows in (self.liftoffs, self.openings)]
        ends = np.sort(np.concatenate([own["t"], *opened, self.t[-1:]]))
        found = []
        for row in own:
            end = ends[ends > row["t"]]
            if len(end):
                found.append((float(row["t"]), float(end[0]), int(row["after"])))
        return found


# The motion between the steps of a method of first order.


@dataclasses.dataclass(frozen=True, eq=False)
class LinearMotion:
    """State and gaps linear between steps; what is held, of the step that contains the time.

    Parameters
    ----------
    t : ndarray
        Times of the steps, shape (k,).
    q, qdot, gaps, gap_rates, reactions : ndarray
        Their values there, shapes (k, n) and (k, m).
    contacts : ndarray of bool
        Which gaps are pressed in the step that ends there, shape (k, m).
    friction : FrictionSamples or None
        What friction does there.
    """

    t: Array
    q: Array
    qdot: Array
    gaps: Array
    gap_rates: Array
    reactions: Array
    contacts: NDArray[np.bool_]
    friction: FrictionSamples | None = None

    @property
    def span(self) -> tuple[float, float]:
        """The times of the first and the last step."""
        return float(self.t[0]), float(self.t[-1])

    def at(self, times: Array) -> tuple[Array, Array, Array, Array, NDArray[np.bool_]]:
        """Return ``(q, qdot, gaps, gap_rates, contacts)`` at `times`."""
        sampled = (self.q, self.qdot, self.gaps, self.gap_rates)
        q, qdot, gaps, rates = (self._between(times, values) for values in sampled)
        return q, qdot, gaps, rates, self.contacts[self._step(times)]

    def reactions_at(self, times: Array) -> Array:
        """Return the reactions of the steps that contain `times`."""
        return self.reactions[self._step(times)]

    def friction_at(self, times: Array) -> FrictionSamples | None:
        """Return the friction data at times: slips interpolated, forces of the steps."""
        if self.friction is None:
            return None
        step, given = self._step(times), self.friction
        return dataclasses.replace(
            given,
            slips=self._between(times, given.slips),
            slip_distances=self._between(times, given.slip_distances),
            dissipated=np.interp(times, self.t, given.dissipated),
            friction_forces=given.friction_forces[step],
            modes=given.modes[step],
        )

    def _between(self, times: Array, values: Array) -> Array:
        columns = [np.interp(times, self.t, column) for column in values.T]
        return np.array(columns).T.reshape(len(times), values.shape[1])

    def _step(self, times: Array) -> NDArray[np.intp]:
        return np.clip(np.searchsorted(self.t, times), 0, len(self.t) - 1)


# Contact forces at given states, and those of friction.


def forces_at(
    model: Model | None,
    states: tuple[Array, Array, Array],
    contacts: NDArray[np.bool_],
    modes: NDArray[np.int8] | None = None,
) -> tuple[Array, Array, Array]:
    r"""Compute contact forces, forces of friction and multipliers of equality rows.

    .. math::

        K (\lambda_A, f_S) = -(R M^{-1} \tilde F + (h_A, k_S)), \qquad
        R = (N_A; B_S), \quad K = R M^{-1} (N_A - \mu \sigma B; B_S)^T

    with the sticking channels :math:`S`; the forces of joints that slip are in
    :math:`\tilde F`. Forces that the motion does not determine are the least within their limits.

    Parameters
    ----------
    model : Model or None
        The system; None if unknown.
    states : (ndarray, ndarray, ndarray)
        ``(t, q, qdot)``, of shapes (k,), (k, n), (k, n).
    contacts : ndarray of bool
        The closed gaps, of shape (k, m).
    modes : ndarray of int8, optional
        What the channels do, of shape (k, p).

    Returns
    -------
    (ndarray, ndarray, ndarray)
        Shapes (k, m), (k, p) and (k, rows); zero without contact, NaN if the model is unknown or no
        forces keep the gaps closed.
    """
    t, q, qdot = (np.ascontiguousarray(it) for it in states)  # compiled parts take rows
    if modes is None:
        modes = np.full((len(t), 0), 2, dtype=np.int8)
    reactions, friction = np.zeros(contacts.shape), np.zeros(modes.shape)
    rows = 0 if model is None else model.layout.k
    multipliers, acts = np.zeros((len(t), rows)), contacts.any(axis=1) | (modes != 2).any(axis=1)
    for k in np.flatnonzero(acts | (rows > 0)):
        found = None
        if model is not None:
            row = model.evaluate(float(t[k]), q[k], qdot[k])
            closed, does = contacts[k].tolist(), modes[k].tolist()
            found = _zivi.contact_forces(row, qdot[k], model.friction, closed, does)
        if found is None:
            reactions[k, contacts[k]] = np.nan
            friction[k, modes[k] != 2] = np.nan
            multipliers[k] = np.nan
        else:
            m, p = contacts.shape[1], modes.shape[1]
            reactions[k], friction[k], multipliers[k] = np.split(found, [m, m + p])
    return reactions, friction, multipliers


# Messages of runs of mechanical systems, with the names of their gaps.

TOUCHING = 1e-9
"""Gaps below this, relative to the coordinates, touch where a run ends."""

UNSOLVED = (
    Status.REDUNDANT_CONTACTS,
    Status.IMPACT_NOT_SOLVED,
    Status.INCONSISTENT_IMPACT,
    Status.CONTACT_NOT_SOLVED,
)

NOT_FINITE = (
    "The mass, the force, or a part of a gap is NaN or infinite; the trajectory ends at the last "
    "step before. Check them behind the last sample: system.at(t, q, qdot)."
)


PARADOXES = (
    Status.INCONSISTENT_CONTACT,
    Status.INDETERMINATE_CONTACT,
    Status.PAINLEVE_SINGULAR,
)


PRESTRESS = (
    "Several motions obey the law of friction from here on: contacts and joints hold each other by "
    "forces that the motion does not determine, and this prestress decides what sticks; the "
    "trajectory ends there. Give a gap a contact= law."
)
PAINLEVE = (
    "Several motions obey the law of friction from here on (Painlevé's paradox); the trajectory "
    "ends there. Lower mu."
)


def end_message(record: _zivi.MechanicalRecord, system: MechanicalSystem, model: Model) -> str:
    """Return the message of a record; where contacts are not solved, with those that touch."""
    status, gaps, channels = Status(record.status), system.gap_names, system._channels
    if status is Status.FORCE_NOT_FINITE:
        return NOT_FINITE
    if status not in (*UNSOLVED, *PARADOXES) or not len(record.t):
        return record.message
    size = TOUCHING * (1.0 + float(np.max(np.abs(record.q[-1]))))
    touching = record.contacts[-1] | (record.gaps[-1] <= size)
    names = ", ".join(repr(name) for name, on in zip(gaps, touching, strict=True) if on)
    if status in PARADOXES:
        qdot = _velocity_after(record, model)
        here = model.layout.read(model.evaluate(record.t[-1], record.q[-1], qdot))
        numbers = _paradoxes(here, qdot, channels, touching)
        several = status is Status.INDETERMINATE_CONTACT
        if several and _is_prestressed(here, channels, touching, numbers):
            told = f"At t = {record.t[-1]:.9g} these gaps touch: {names}."
            return f"{PRESTRESS}{_remedies(system, status)} {told}"
        told = "; ".join(
            f"{name!r} slides with {slip:.6g}, K = {k:.6g}, b = {b:.6g}"
            for name, slip, k, b in numbers
        )
        message = (PAINLEVE if several else record.message) + _remedies(system, status)
        return f"{message} At t = {record.t[-1]:.9g}: {told or 'no sliding contact touches'}."
    return f"{record.message} At t = {record.t[-1]:.9g} these gaps touch: {names}."


def _remedies(system: MechanicalSystem, status: Status) -> str:
    """Return what else continues a run in Painlevé's paradox, of what the system allows."""
    told = ""
    in_space = any(channel.row is not None for channel in system._channels)
    if status is Status.INCONSISTENT_CONTACT and system.paradox == "stop" and not in_space:
        told += " paradox='impact' continues by an impact without a collision."
    rigid = not (system.equality_names or system._compliant() or system._rotations())
    if rigid and system.impact_law == "newton" and not isinstance(system._e, tuple):
        told += " zivi.MoreauJean chooses one motion."
    return told


def _velocity_after(record: _zivi.MechanicalRecord, model: Model) -> NDArray[np.float64]:
    """Return the velocities at the end: after an impact there from which no motion goes on."""
    qdot: NDArray[np.float64] = record.qdot[-1]
    events, rough = record.occurrences, record.friction
    if events is None or not len(events.impact_t) or events.impact_t[-1] != record.t[-1]:
        return qdot
    group = events.impact_group[-1]
    last = events.impact_group == group
    gaps = events.impact_gap[last]
    rates = record.gap_rates[-1, gaps]
    off = [events.impact_speed_before[last] - rates, events.impact_speed_after[last] - rates]
    if np.abs(off[0]).sum() >= np.abs(off[1]).sum():
        return qdot
    here = model.layout.read(model.evaluate(record.t[-1], record.q[-1], qdot))
    push = events.impact_impulse[last] @ here.gradients[gaps]
    if rough is not None:
        mine = rough.tangential_group == group
        push += rough.tangential_impulse[mine] @ here.tangents[rough.tangential_channel[mine]]
    after: NDArray[np.float64] = qdot + np.linalg.solve(here.mass, push)
    return after


def _is_prestressed(
    here: Evaluation,
    channels: Sequence[Channel],
    touching: NDArray[np.bool_],
    numbers: Sequence[tuple[str, float, float, float]],
) -> bool:
    """Return whether no sliding contact is in the paradox and the rows depend on each other."""
    rough = [channel.gap is None or bool(touching[channel.gap]) for channel in channels]
    rows = np.concatenate([here.gradients[touching], here.tangents[rough]])
    paradox = any(k <= 0.0 for _, _, k, _ in numbers)
    return not paradox and int(np.linalg.matrix_rank(rows)) < len(rows)


def _paradoxes(
    here: Evaluation,
    qdot: NDArray[np.float64],
    channels: Sequence[Channel],
    touching: NDArray[np.bool_],
) -> list[tuple[str, float, float, float]]:
    r"""Return the numbers that decide about each sliding contact, taken alone: name, slip, K, b.

    .. math:: \ddot g = K \lambda + b, \qquad K = (N M^{-1} (N - \mu \sigma B)^T)
    """
    free = np.linalg.solve(here.mass, here.force)
    slips = here.tangents @ qdot + here.slip_rates
    told = []
    for i in dict.fromkeys(channel.gap for channel in channels):
        if i is None or not touching[i]:
            continue
        mine = [c for c, channel in enumerate(channels) if channel.gap == i]
        # a contact with two directions slips along both at once
        slip = float(slips[mine[0]]) if len(mine) == 1 else float(np.hypot(*slips[mine]))
        along = slips[mine] / (abs(slip) or 1.0)
        edge = here.gradients[i] - here.limits[mine[0]] * along @ here.tangents[mine]
        k = float(here.gradients[i] @ np.linalg.solve(here.mass, edge))
        b = float(here.gradients[i] @ free + here.curvatures[i])
        told.append((channels[mine[0]].name, slip, k, b))
    return told


# Runs of mechanical systems as tables and labelled datasets.

TABLES = {
    "impacts": "impact",
    "zeno": "zeno",
    "touchdowns": "touchdown",
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
EQUALITIES: dict[str, Field] = {
    "constraint_forces": (("time", "equality"), "", "multipliers of the equality rows"),
}
"""Quantities of the samples where there are equality rows."""
COORDS: dict[str, Field] = {
    "time": ("time", "", "time"),
    "coordinate": ("coordinate", "", "name of the coordinate"),
    "gap": ("gap", "", "name of the gap"),
}


def summary_rows(sol: Any) -> dict[str, str]:
    """Return the rows of the summary table of a run."""

    def times(events: Any) -> str:
        told = [f"{event['t']:.9g} ({sol.gap_names[int(event['gap'])]})" for event in events[:5]]
        return ", ".join(told) + (" ..." if len(events) > 5 else "") or "none"

    last = sol.contacts[-1] if len(sol.t) else []
    closed = [name for name, shut in zip(sol.gap_names, last, strict=False) if shut]
    return {
        "status": f"{sol.status.name.lower()}: {sol.message}",
        "time": f"{sol.t[0]:.6g} to {sol.t[-1]:.6g} s" if len(sol.t) else "no samples",
        "coordinates": ", ".join(sol.coordinate_names),
        "impacts": ", ".join(_impact_counts(sol)) + " resolved",
        "Zeno points": times(sol.zeno),
        **({"touchdowns": times(sol.touchdowns)} if len(sol.touchdowns) else {}),
        "lift-offs": times(sol.liftoffs),
        **_stick_rows(sol),
        **_equality_rows(sol),
        "corners": ", ".join(f"{t:.9g}" for t in sol.corners["t"][:5]) or "none",
        "flags": ", ".join(f"{f['kind']} at {f['t']:.6g}" for f in sol.flags[:5]) or "none",
        "closed at the end": ", ".join(closed) or "none",
        "steps": f"{sol.n_steps}, {sol.n_rejected} more rejected",
        "evaluations of the system": str(sol.nfev),
    }


def _stick_rows(sol: Any) -> dict[str, str]:
    """Describe when friction sticks, if the system has friction."""
    if not sol.channel_names:
        return {}
    told = [
        f"{sol.channel_names[it['channel']]} {it['t_start']:.6g} .. {it['t_end']:.6g}"
        for it in sol.stick[:5]
    ]
    more = " ..." if len(sol.stick) > 5 else ""
    return {"sticks": (", ".join(told) + more) or "never"}


def _equality_rows(sol: Any) -> dict[str, str]:
    """Tell the largest constraint forces, if there are equality rows."""
    if not sol.equality_names:
        return {}
    forces = np.abs(sol.constraint_forces).max(axis=0, initial=0.0)
    told = zip(sol.equality_names[:5], forces, strict=False)
    more = " ..." if len(sol.equality_names) > 5 else ""
    return {"largest constraint forces": ", ".join(f"{n} {f:.6g}" for n, f in told) + more}


def _impact_counts(sol: Any) -> list[str]:
    return [str(len(np.unique(it["group"]))) for it in (sol.impacts, sol.resolved_impacts)]


def table_of(sol: Any) -> pandas.DataFrame:
    """Return the samples of a run as a table over time."""
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
    for i, name in enumerate(sol.equality_names):
        columns[f"force_{name}"] = sol.constraint_forces[:, i]
    for c, name in enumerate(sol.channel_names):
        columns[f"slip_{name}"] = sol.slips[:, c]
        columns[f"friction_{name}"] = sol.friction_forces[:, c]
        columns[f"mode_{name}"] = sol.modes[:, c]
    if sol.channel_names:
        columns["dissipated"] = sol.dissipated
    return pandas.DataFrame(columns, index=pandas.Index(sol.t, name="time"))


def labels_of(sol: Any) -> ResultTable:
    """Describe the dataset of a run: samples, then events over their numbers."""
    fields, values = dict(MEANING), {"time": sol.t}
    values["coordinate"] = np.array(sol.coordinate_names, dtype=object)
    values["gap"] = np.array(sol.gap_names, dtype=object)
    tables, coords = dict(TABLES), dict(COORDS)
    if sol.equality_names:
        fields |= EQUALITIES
        coords["equality"] = "equality", "", "name of the equality row"
        values["equality"] = np.array(sol.equality_names, dtype=object)
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
    return ResultTable("Run of a mechanical system with impacts", fields, coords, values, attrs)


# The result of a run of a mechanical system.


def no_touchdowns() -> Rows:
    """Return the table of a run without compliant gaps."""
    return table(FIELDS["touchdowns"], 0, {"t": ()})


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class MechanicalTrajectory(FrictionRun, SampledRun):
    r"""Samples and events of one run of a mechanical system: n coordinates, m gaps.

    Calling it, ``sol(t)``, gives ``(q, qdot)`` between the samples. Tables of events are record
    arrays: ``sol.zeno["t"]`` and ``sol.zeno.t`` are the same. The impacts are the table ``impacts``
    with fields ``t``, ``gap`` (its number), ``speed_before`` (<= 0) and ``speed_after`` of the gap,
    ``impulse``, ``group``: a row for each gap with a part in an impact; rows of one impact share
    the number of its group. With dry friction also ``tangential_impulse``, ``slip_before`` and
    ``slip_after``, the slip speeds (NaN at a gap without friction and where a jump skipped the
    impact), and ``sticks``.

    Attributes
    ----------
    t : ndarray
        Times of the samples, shape (k,).
    q, qdot : ndarray
        Coordinates and velocities, shape (k, n); at an impact the velocities after it.
    gaps, gap_rates : ndarray
        Gaps and their rates, shape (k, m).
    contacts : ndarray of bool
        Which gaps are closed and stay so, shape (k, m).
    reactions : ndarray
        Multipliers of the gradients, the contact forces, shape (k, m): 0 where a gap is open.
    constraint_forces : ndarray
        Multipliers :math:`\mu` of the equality rows, shape (k, rows): :math:`G^T \mu` is the
        generalised force of the rows, for a row in metres :math:`\mu` is in newtons. Where
        dependent rows leave them open they are those of least norm.
    resolved_impacts : recarray
        The impacts that the steps resolve, with the fields of ``impacts``; those that a jump to a
        Zeno point skips are not among them.
    zeno : recarray
        Accumulations: ``t``, ``gap``, and ``closed``, the m flags of the gaps closed after it.
    touchdowns : recarray
        Where compliant gaps came into contact: ``t``, ``gap``.
    liftoffs : recarray
        Contacts that ended because their force vanished: ``t``, ``gap``.
    openings : recarray
        Contacts that an impact on another gap opened: ``t``, ``gap``.
    corners : recarray
        Points where several gaps came to rest together: ``t``, ``gaps`` (m flags).
    flags : recarray
        What the result hangs on: ``kind``, ``t``, ``gaps`` (m flags), ``size``. "simultaneous":
        coupled gaps were hit simultaneously, or one was hit while others touched without force; a
        slightly different time yields another motion, and the size is their kinetic cosine.
        "order_uncertain": their times differ by less than the tolerance. With friction also
        "energy_gain": an impact raised the energy, by so much; "impact_not_unique": other impulses
        solve it too; "motion_not_unique": several motions obey the laws where slip begins or ends;
        "undetermined_forces": the contact forces are not unique, the motion is;
        "undetermined_motion": the motion depends on how contacts share a load; "slip_graze": a slip
        speed touched zero; "forced_landing": an accumulation was ended at the smallest speed;
        "impact_without_collision": a jammed contact went on by one.
    status : Status
        How the run ended, 0 for success.
    message : str
        Reason of the end, with advice.
    nfev, n_steps, n_rejected : int
        Evaluations of the system, accepted steps, rejected ones.
    t_events : list of ndarray
        For each event of the user the times at which it happened.
    q_events, qdot_events : list of ndarray
        The states there, each of shape (j, n).
    slowest : float
        The slowest of ``impacts``, as a part of the fastest. Of what a jump skips, impacts of one
        gap with a constant ratio are listed; impacts that lead into a corner, and those of a gap
        whose slip turns in each flight, are not.
    coordinate_names, gap_names, equality_names : tuple of str
        Names.
    config : dict
        System, method, span and initial state, as plain values.
    """

    _habits: ClassVar[str] = "mechanical run"

    t: Array
    q: Array
    qdot: Array
    gaps: Array
    gap_rates: Array
    contacts: NDArray[np.bool_]
    reactions: Array
    resolved_impacts: Rows
    zeno: Rows
    liftoffs: Rows
    openings: Rows
    corners: Rows
    flags: Rows
    status: Status
    message: str
    nfev: int
    n_steps: int
    n_rejected: int
    coordinate_names: tuple[str, ...]
    gap_names: tuple[str, ...]
    _setup: Setup
    t_events: list[Array] = dataclasses.field(default_factory=list)
    q_events: list[Array] = dataclasses.field(default_factory=list)
    qdot_events: list[Array] = dataclasses.field(default_factory=list)
    slowest: float = SLOWEST
    touchdowns: Rows = dataclasses.field(default_factory=lambda: no_touchdowns())
    constraint_forces: Array = dataclasses.field(default_factory=lambda: np.empty((0, 0)))
    equality_names: tuple[str, ...] = ()
    _path: Any = None
    _model: Model | None = None
    _closer: Closer | None = None
    _friction: FrictionSamples | None = None
    _channels: tuple[Channel, ...] = ()

    @functools.cached_property
    def config(self) -> dict[str, Any]:
        """System, method, span and initial state, as plain values."""
        return self._setup() if callable(self._setup) else self._setup

    if not TYPE_CHECKING:  # which would take any name for granted

        def __getattr__(self, name):
            # computed at the first access: batches make millions of short runs
            own = vars(self)
            if (unread := own.get("_unread")) is not None:
                own.update(_read(*unread) | own)
                own.pop("_unread", None)
            return own[name] if name in own else super().__getattr__(name)

    def __getstate__(self) -> dict[str, Any]:
        _ = self.t  # which reads the record
        # samples can be sent where a model cannot
        return self.__dict__ | {"_setup": self.config, "_model": None, "_closer": None}

    def __setstate__(self, state: dict[str, Any]) -> None:
        # version 0.2 had no compliant gaps and no equality rows
        forces = {"constraint_forces": np.empty((0, 0)), "equality_names": ()}
        self.__dict__.update({"touchdowns": no_touchdowns()} | forces | state)

    @functools.cached_property
    def trusted_until(self) -> float:
        """Time up to which the run is near the motion, the end if all of it is (s).

        The tolerances bound the errors of steps; in a chaotic motion these grow until the run is
        another one. It is compared with a run at a hundredth of the tolerances, with restitution
        and velocities perturbed by some roundings: up to this time both agree in every coordinate
        to 300 times the tolerance of `rtol` and `atol`. It is made when this is first asked for,
        takes about twice the time of the run, and calls its force again.

        Raises
        ------
        ValueError
            For a fixed-step method, and for a run that was loaded or sent to another process before
            the first access.

        Examples
        --------
        >>> ball = zivi.MechanicalSystem(
        ...     mass=1.0, force=[-9.81], gaps=[zivi.LinearGap([1])], e=0.5
        ... )
        >>> zivi.simulate(ball, (0, 3), ([1], [0])).trusted_until
        3.0
        """
        return trusted(self, self.q, self._without_charts)

    @classmethod
    def _from_record(
        cls,
        record: _zivi.MechanicalRecord,
        system: MechanicalSystem,
        model: Model,
        setup: Setup,
        closer: Closer | None,
        *,
        stepped: bool = False,
    ) -> Self:
        """Make it of a record; `stepped` if the steps of the method are all there is."""
        channels = system._channels
        friction = friction_samples(record.friction, channels)
        path: Any = record.path
        if stepped:
            parts = {name: getattr(record, name) for name in STEPS}
            path = LinearMotion(**parts, friction=friction)
        sol = object.__new__(cls)
        own, status = vars(sol), STATUSES[record.status]
        own["status"], own["_setup"] = status, setup
        own["_path"], own["_model"], own["_closer"] = path, model, closer
        own["_friction"], own["_channels"] = friction, channels
        own["_unread"] = record, system, model
        if status not in (Status.COMPLETED, Status.TERMINATED_BY_EVENT):
            own["message"] = end_message(record, system, model)
        if record.speeds is not None:
            # samples of steps would tell it
            rests = sol.contacts[-1].any() or (sol.modes[-1:] == 0).any()
            vars(sol)["rest_time"] = time_of_rest(record.speeds, rests=rests)
        return sol

    @property
    def qpos(self) -> Array:
        """Places and unit quaternions of the samples, shape (k, nq), as `zivi.Tree.state` has them.

        For a system without rotations in space this is `q`.
        """
        return with_quaternions(self._rotations(), self.q)

    @property
    def qvel(self) -> Array:
        """Velocities with angular velocities in axes of the bodies (rad/s), shape (k, nv).

        For a system without rotations in space this is `qdot`.
        """
        return with_angular_velocities(self._rotations(), self.q, self.qdot)

    def _in_world(self, body: str, q: Array, points: Array) -> Array:
        """Return points of a free body, shape (k, 3), in the world at coordinates `q`."""
        first, _ = self._rotations()[body]
        turned = rotate(quaternions_of(q[first : first + 3]), points)
        return q[first - 3 : first] + turned

    def pose(self, body: str) -> tuple[Array, Array]:
        """Return places and unit quaternions of a free body at the samples.

        Parameters
        ----------
        body : str
            Its name.

        Returns
        -------
        position : ndarray
            Origin of its frame in the world (m), shape (k, 3).
        quaternion : ndarray
            Its rotation (w, x, y, z), shape (k, 4); there is no jump between samples.

        Raises
        ------
        KeyError
            If no free body has this name.
        """
        free = {name: first for name, (first, is_free) in self._rotations().items() if is_free}
        if body not in free:
            known = ", ".join(map(repr, free)) or "none"
            raise KeyError(f"body must be a free body of the system, {known}, got {body!r}")
        first = free[body]
        return self.q[:, first - 3 : first].copy(), continuous(self.q[:, first : first + 3])

    def _rotations(self) -> dict[str, Any]:
        found: dict[str, Any] = self.config.get("rotations", {})
        return found

    def _without_charts(self, q: Array) -> Array:
        return without_charts(self._rotations(), q)

    def __call__(self, t: ArrayLike) -> Array:
        """Return the state between the samples, through impacts, accumulations and contact.

        Parameters
        ----------
        t : float or array_like
            Times within the computed span, k of them.

        Returns
        -------
        ndarray
            ``(q, qdot)``, of shape (2, n) for a scalar `t`, else (2, k, n).

        Raises
        ------
        ValueError
            If a time lies outside the computed span, or the run kept no dense output.
        """
        times = self._within(t)
        q, qdot, *_ = self._known().at(np.ascontiguousarray(times.ravel()))
        shape = (*times.shape, q.shape[1])
        return np.stack([q.reshape(shape), qdot.reshape(shape)])

    def _resampled(self, times: Array) -> MechanicalTrajectory:
        times = np.ascontiguousarray(times)
        q, qdot, gaps, rates, contacts = self._known().at(times)
        if isinstance(self._path, LinearMotion):
            reactions, friction = self._path.reactions_at(times), self._path.friction_at(times)
            multipliers = np.empty((len(times), 0))
        elif self._friction is not None:
            slips, distances, dissipated, modes = self._path.friction_at(times)
            states = times, q, qdot
            forces = forces_at(self._model, states, contacts, modes)
            reactions, rubbing, multipliers = forces
            friction = dataclasses.replace(
                self._friction,
                slips=slips,
                slip_distances=distances,
                dissipated=dissipated,
                modes=modes,
                friction_forces=rubbing,
            )
        else:
            reactions, _, multipliers = forces_at(self._model, (times, q, qdot), contacts)
            friction = None
        if self.equality_names and not multipliers.shape[1]:
            multipliers = np.full((len(times), len(self.equality_names)), np.nan)
        return dataclasses.replace(
            self,
            t=times,
            q=q,
            qdot=qdot,
            gaps=gaps,
            gap_rates=rates,
            contacts=contacts,
            reactions=reactions,
            constraint_forces=multipliers,
            _friction=friction,
        )

    def _listed(self) -> Rows:
        return listed_of_gaps(self.resolved_impacts, self.zeno, self._path, self.slowest)

    def _down_to(self, speed: float, limit: int) -> Rows:
        return down_to_of_gaps(self.resolved_impacts, self.zeno, self._path, speed, limit)

    @property
    def zeno_times(self) -> Array:
        """Times of the accumulations: ``zeno["t"]``, as a run of one mass had it in version 0.1."""
        return np.asarray(self.zeno["t"])

    @property
    def liftoff_times(self) -> Array:
        """Times of lift-off: ``liftoffs["t"]``, as a run of one mass had it in version 0.1."""
        return np.asarray(self.liftoffs["t"])

    @property
    def y_events(self) -> list[Array]:
        """The states ``(q, qdot)`` at the events of the user, each of shape (j, 2, n)."""
        pairs = zip(self.q_events, self.qdot_events, strict=True)
        return [np.stack([q, qdot], axis=1) for q, qdot in pairs]

    @functools.cached_property
    def rest_time(self) -> float | None:
        """Time from which nothing moves until the end of the run, None if something does."""
        gaps = (self.resolved_impacts, self.zeno, self.liftoffs, self.openings, self.corners)
        tables = (*gaps, self.touchdowns, self.transitions)
        since = max(self.t[0], *(rows["t"].max(initial=-np.inf) for rows in tables))
        speeds = np.abs(self.qdot)
        fastest_since = speeds[self.t >= since].max(initial=0.0)
        rests = self.contacts[-1].any() or (self.modes[-1:] == 0).any()
        return time_of_rest((since, speeds.max(), fastest_since), rests=rests)

    def __repr__(self) -> str:
        span = f"{self.t[0]:.6g} .. {self.t[-1]:.6g} s" if len(self.t) else "no samples"
        counts = f"{len(np.unique(self.impacts['group']))} impacts"
        if len(self.zeno):
            counts += f" that accumulate at {self.zeno['t'][0]:.6g}"
            counts += f" and {len(self.zeno) - 1} more times" if len(self.zeno) > 1 else ""
        if len(self.touchdowns):
            counts += f", {len(self.touchdowns)} touchdowns"
        counts += f", {len(self.liftoffs)} lift-offs"
        if len(self.corners):
            counts += f", {len(self.corners)} corners"
        if self.equality_names:
            counts += f", {counted(len(self.equality_names), 'equality row')}"
        if len(self.stick):
            counts += f", {len(self.stick)} times stick"
        if len(self.flags):
            counts += f", {len(self.flags)} flags"
        return (
            f"<MechanicalTrajectory {span}, {self.n_steps} steps, {counts}"
            f"{self._kicks_text()}{trust_note(self)}: {self.status.name.lower()}>"
        )

    def _facts(self) -> dict[str, str]:
        return summary_rows(self)

    def _as_frame(self) -> pandas.DataFrame:
        needed("pandas", "tables")
        return table_of(self)

    def _table(self) -> ResultTable:
        return labels_of(self)


def _read(record: _zivi.MechanicalRecord, system: MechanicalSystem, model: Model) -> dict[str, Any]:
    """Return what a result has of the record of its run."""
    channels, gap_names = system._channels, system.gap_names
    return {
        **{name: getattr(record, name) for name in STEPS},
        **_tables_of(record, model.layout.m, channels),
        "constraint_forces": (
            np.empty((len(record.t), 0))
            if record.constraint_forces is None
            else record.constraint_forces
        ),
        "equality_names": system.equality_names,
        "message": record.message,
        "nfev": record.nfev,
        "n_steps": record.n_steps,
        "n_rejected": record.n_rejected,
        "coordinate_names": system.coordinate_names(model.layout.n),
        "gap_names": gap_names,
        "t_events": [hits.t for hits in record.hits],
        "q_events": [hits.q for hits in record.hits],
        "qdot_events": [hits.qdot for hits in record.hits],
    }


def time_of_rest(speeds: tuple[float, float, float], *, rests: bool) -> float | None:
    """Return since when nothing moves, if anything is at rest in the end.

    Of when something last happened, the largest speed, and that from then on.
    """
    since, fastest, fastest_since = speeds
    return float(since) if rests and not fastest_since > AT_REST * fastest else None


def _tables_of(
    record: _zivi.MechanicalRecord, m: int, channels: tuple[Channel, ...]
) -> dict[str, Rows]:
    """Return the event tables of a run."""
    known, rubbing = record.occurrences, record.friction
    fields = FIELDS if rubbing is None else WITH_FRICTION
    if known is None:
        return _by_result_name(_empty_tables(m, rubbing is not None))
    impacts = {name: getattr(known, f"impact_{name}") for name in FIELDS["impacts"]}
    if rubbing is not None:
        impacts = impacts_with(impacts, rubbing, channels)
    columns: dict[str, dict[str, Any]] = {
        "impacts": impacts,
        "zeno": {"t": known.zeno_t, "gap": known.zeno_gap, "closed": known.zeno_closed},
        "touchdowns": {"t": known.contact_t, "gap": known.contact_gap},
        "liftoffs": {"t": known.liftoff_t, "gap": known.liftoff_gap},
        "openings": {"t": known.opened_t, "gap": known.opened_gap},
        "corners": {"t": known.corner_t, "gaps": known.corner_gaps},
        "flags": {
            "kind": known.flag_kind,
            "t": known.flag_t,
            "gaps": known.flag_gaps,
            "size": known.flag_size,
        },
    }
    return _by_result_name({name: table(fields[name], m, it) for name, it in columns.items()})


@functools.lru_cache
def _empty_tables(m: int, rubbing: bool) -> dict[str, Rows]:
    """Return the tables of a run in which nothing happened."""
    fields = WITH_FRICTION if rubbing else FIELDS
    return {name: table(it, m, {"t": ()}) for name, it in fields.items()}


WITH_FRICTION = FIELDS | {"impacts": IMPACTS}
"""The tables of a run with dry friction."""


def _by_result_name(tables: dict[str, Rows]) -> dict[str, Rows]:
    """Return the tables by the names of the result."""
    named = tables.copy()
    named["resolved_impacts"] = named.pop("impacts")
    return named


STEPS = ("t", "q", "qdot", "gaps", "gap_rates", "contacts", "reactions")
"""What is known of each sample of a run."""

AT_REST = 1e-12
"""What rounding leaves of velocities at rest, as a part of the largest velocity."""
