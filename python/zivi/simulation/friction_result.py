"""Friction quantities and contact forces of a run of a mechanical system."""

from __future__ import annotations

import dataclasses
import functools
import math
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

import zivi._zivi as _zivi
from zivi.base.check import Array
from zivi.base.table import Field
from zivi.simulation.impacts import FIELDS, EventTable, Rows, table
from zivi.system.gap import Channel
from zivi.system.mechanism import Model

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
        """Slip speeds, shape (k, p); exactly 0 in stick."""
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
