"""The result of a run of a mechanical system."""

from __future__ import annotations

import dataclasses
import functools
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from zivi import _zivi
from zivi.base.check import Array, real_array, whole
from zivi.base.status import Status
from zivi.simulation import mechanical_labelled as labelled
from zivi.simulation.linear_motion import LinearMotion
from zivi.simulation.mechanical_messages import ending
from zivi.simulation.reactions import reactions_at
from zivi.simulation.trust import Closer, told, trusted
from zivi.system.mechanism import Model

if TYPE_CHECKING:
    import pandas
    import xarray

__all__ = ["FIELDS", "MechanicalTrajectory", "table"]


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class MechanicalTrajectory:
    """Samples and events of one run of a mechanical system: n coordinates, m gaps.

    Calling it, ``sol(t)``, gives ``(q, qdot)`` between the samples. Tables of events are record
    arrays: ``sol.zeno["t"]`` and ``sol.zeno.t`` are the same.

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
    impacts : recarray
        Fields ``t``, ``gap`` (its number), ``speed_before`` (<= 0) and ``speed_after`` of the gap,
        ``impulse``, ``group``: a row for each gap with a part in an impact; rows of one impact
        share the number of its group.
    zeno : recarray
        Accumulations: ``t``, ``gap``, and ``closed``, the m flags of the gaps closed after it.
    liftoffs : recarray
        Contacts that ended because their force vanished: ``t``, ``gap``.
    openings : recarray
        Contacts that an impact on another gap opened: ``t``, ``gap``.
    corners : recarray
        Points where several gaps came to rest together: ``t``, ``gaps`` (m flags).
    flags : recarray
        What the result hangs on: ``kind``, ``t``, ``gaps`` (m flags), ``size``. "simultaneous":
        coupled gaps were hit at once, a little earlier or later gives another motion.
        "order_uncertain": which of them came first is within the tolerance.
    status : Status
        How the run ended, 0 for success.
    message : str
        What happened, and what to try.
    nfev, n_steps, n_rejected : int
        Evaluations of the system, accepted steps, rejected ones.
    t_events : list of ndarray
        For each event of the user the times at which it happened.
    q_events, qdot_events : list of ndarray
        The states there, each of shape (j, n).
    coordinate_names, gap_names : tuple of str
        Names.
    config : dict
        System, method, span and initial state, as plain values.
    """

    t: Array
    q: Array
    qdot: Array
    gaps: Array
    gap_rates: Array
    contacts: NDArray[np.bool_]
    reactions: Array
    impacts: np.recarray[Any, Any]
    zeno: np.recarray[Any, Any]
    liftoffs: np.recarray[Any, Any]
    openings: np.recarray[Any, Any]
    corners: np.recarray[Any, Any]
    flags: np.recarray[Any, Any]
    status: Status
    message: str
    nfev: int
    n_steps: int
    n_rejected: int
    coordinate_names: tuple[str, ...]
    gap_names: tuple[str, ...]
    config: dict[str, Any]
    t_events: list[Array] = dataclasses.field(default_factory=list)
    q_events: list[Array] = dataclasses.field(default_factory=list)
    qdot_events: list[Array] = dataclasses.field(default_factory=list)
    _path: Any = None
    _model: Model | None = None
    _closer: Closer | None = None

    def __getstate__(self) -> dict[str, Any]:
        # samples can be sent where a model cannot
        return self.__dict__ | {"_model": None, "_closer": None}

    @property
    def success(self) -> bool:
        """Whether the end of the span was reached, or a terminal event."""
        return self.status in (Status.COMPLETED, Status.TERMINATED_BY_EVENT)

    @functools.cached_property
    def trusted_until(self) -> float:
        """Time up to which the run is near the motion, the end if all of it is (s).

        The tolerances bound the errors of steps; in a chaotic motion these grow until the run is
        another one. The same run at a hundredth of the tolerances, restitution and velocities moved
        by some roundings, tells when: up to here both agree in every coordinate to 300 times what
        `rtol` and `atol` allow. It is made when this is first asked for, takes about twice the time
        of the run, and calls its force again.

        Raises
        ------
        ValueError
            For a method of fixed steps, and for a run that was loaded or sent to another process
            before it was asked.

        Examples
        --------
        >>> ball = zivi.MechanicalSystem(
        ...     mass=1.0, force=[-9.81], gaps=[zivi.LinearGap([1])], e=0.5
        ... )
        >>> zivi.simulate(ball, (0, 3), ([1], [0])).trusted_until
        3.0
        """
        return trusted(self, self.q)

    @classmethod
    def _from_record(
        cls,
        record: _zivi.MechanicalRecord,
        model: Model,
        config: dict[str, Any],
        closer: Closer | None,
    ) -> MechanicalTrajectory:
        m = model.layout.m
        # a method of fixed steps: its steps are all there is
        steps = ("t", "q", "qdot", "gaps", "gap_rates", "reactions", "contacts")
        stepped = config["method"]["name"] != "SwitchedRK"
        linear = LinearMotion(**{name: getattr(record, name) for name in steps})
        impacts = {name: getattr(record, f"impact_{name}") for name in IMPACT}
        flags = {
            "kind": np.array(record.flag_kind, dtype="U16"),
            "t": record.flag_t,
            "gaps": record.flag_gaps,
            "size": record.flag_size,
        }
        return cls(
            t=record.t,
            q=record.q,
            qdot=record.qdot,
            gaps=record.gaps,
            gap_rates=record.gap_rates,
            contacts=record.contacts,
            reactions=record.reactions,
            impacts=table(IMPACT, m, impacts),
            zeno=table(
                ZENO,
                m,
                {"t": record.zeno_t, "gap": record.zeno_gap, "closed": record.zeno_closed},
            ),
            liftoffs=table(EVENT, m, {"t": record.liftoff_t, "gap": record.liftoff_gap}),
            openings=table(EVENT, m, {"t": record.opened_t, "gap": record.opened_gap}),
            corners=table(CORNER, m, {"t": record.corner_t, "gaps": record.corner_gaps}),
            flags=table(FLAG, m, flags),
            status=Status(record.status),
            message=ending(record, config["gaps"]),
            nfev=record.nfev,
            n_steps=record.n_steps,
            n_rejected=record.n_rejected,
            coordinate_names=tuple(config["coordinates"]),
            gap_names=tuple(config["gaps"]),
            config=config,
            t_events=[hits.t for hits in record.hits],
            q_events=[hits.q for hits in record.hits],
            qdot_events=[hits.qdot for hits in record.hits],
            _path=linear if stepped else record.path,
            _model=model,
            _closer=closer,
        )

    def __call__(self, t: ArrayLike) -> Array:
        """Give the state between the samples, through impacts, accumulations and contact.

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
        times = real_array("t", t)
        q, qdot, *_ = self._at(times.ravel())
        shape = (*times.shape, q.shape[1])
        return np.stack([q.reshape(shape), qdot.reshape(shape)])

    def _at(self, times: Array) -> tuple[Array, Array, Array, Array, NDArray[np.bool_]]:
        if self._path is None:
            raise ValueError("sol(t) needs a run with dense_output=True")
        start, end = self._path.span
        if not np.all((times >= start) & (times <= end)):
            raise ValueError(f"t must lie within the computed span [{start}, {end}]")
        return self._path.at(np.ascontiguousarray(times))  # type: ignore[no-any-return]

    def resample(self, t: ArrayLike | None = None, *, n: int | None = None) -> MechanicalTrajectory:
        """Report the run at other times.

        Parameters
        ----------
        t : array_like, optional
            Times within the computed span that do not decrease.
        n : int, optional
            So many equidistant times instead, >= 2.

        Returns
        -------
        MechanicalTrajectory
            The same run with other samples. Reactions are NaN if the system is no longer known,
            as in a run that was loaded or sent to another process.

        Raises
        ------
        TypeError
            If not exactly one of `t` and `n` is given.
        ValueError
            If a time lies outside the computed span, or the run kept no dense output.
        """
        if (t is None) == (n is None):
            raise TypeError("exactly one of t and n must be given")
        if n is not None:
            if whole("n", n) < 2:
                raise ValueError(f"n must be >= 2, got {n}")
            start, end = (self.t[0], self.t[-1]) if self._path is None else self._path.span
            times = np.linspace(start, end, n)
        else:
            times = np.atleast_1d(real_array("t", t))
            if times.ndim != 1 or np.any(np.diff(times) < 0):
                raise ValueError("t must be times that do not decrease")
        q, qdot, gaps, rates, contacts = self._at(times)
        return dataclasses.replace(
            self,
            t=times,
            q=q,
            qdot=qdot,
            gaps=gaps,
            gap_rates=rates,
            contacts=contacts,
            reactions=self._path.reactions_at(times)
            if isinstance(self._path, LinearMotion)
            else reactions_at(self._model, times, q, qdot, contacts),
        )

    def __repr__(self) -> str:
        span = f"{self.t[0]:.6g} .. {self.t[-1]:.6g}" if len(self.t) else "no samples"
        counts = f"{len(np.unique(self.impacts['group']))} impacts, {len(self.zeno)} Zeno points"
        counts += f", {len(self.liftoffs)} lift-offs"
        if len(self.corners):
            counts += f", {len(self.corners)} corners"
        if len(self.flags):
            counts += f", {len(self.flags)} flags"
        return (
            f"<MechanicalTrajectory {span}, {self.n_steps} steps, {counts}{told(self)}: "
            f"{self.status.name.lower()}>"
        )

    def _repr_html_(self) -> str:
        """Show the run as a table, in a notebook."""
        return labelled.html_of(self)

    def to_pandas(self, t: ArrayLike | None = None, *, n: int | None = None) -> pandas.DataFrame:
        """Convert the samples to a table, a row for each time.

        Parameters
        ----------
        t, n
            Other times than those of the samples, as in `resample`.

        Returns
        -------
        pandas.DataFrame
            Coordinates by name, velocities (``x`` and ``xdot``), gaps by name, reactions
            (``reaction_`` and the gap's name), over the index ``time``.
        """
        return labelled.table_of(self if t is None and n is None else self.resample(t, n=n))

    def to_xarray(self, t: ArrayLike | None = None, *, n: int | None = None) -> xarray.Dataset:
        """Convert to a labelled dataset that can be plotted, selected and saved.

        Parameters
        ----------
        t, n
            Other times than those of the samples, as in `resample`.

        Returns
        -------
        xarray.Dataset
            ``q`` and ``qdot`` over ``time`` and ``coordinate``, ``gap``, ``gap_rate``, ``contact``
            and ``reaction`` over ``time`` and ``gap``, by their names; events over their
            numbers; the configuration (JSON) in the attributes.
        """
        return labelled.dataset_of(self if t is None and n is None else self.resample(t, n=n))


IMPACT = {
    "t": "f8",
    "gap": "i8",
    "speed_before": "f8",
    "speed_after": "f8",
    "impulse": "f8",
    "group": "i8",
}
ZENO = {"t": "f8", "gap": "i8", "closed": "?m"}
EVENT = {"t": "f8", "gap": "i8"}
CORNER = {"t": "f8", "gaps": "?m"}
FLAG = {"kind": "U16", "t": "f8", "gaps": "?m", "size": "f8"}
"""Fields of the tables and their types, ``?m`` for m flags."""
FIELDS = {
    "impacts": IMPACT,
    "zeno": ZENO,
    "liftoffs": EVENT,
    "openings": EVENT,
    "corners": CORNER,
    "flags": FLAG,
}
"""The tables of a run."""


def table(fields: dict[str, str], m: int, columns: dict[str, Any]) -> np.recarray[Any, Any]:
    """Make a record array of columns; `m` is the number of gaps."""
    kinds: list[Any] = [
        (name, "?", (m,)) if kind == "?m" else (name, kind) for name, kind in fields.items()
    ]
    rows = np.recarray(len(columns["t"]), dtype=kinds)
    for name in fields:
        rows[name] = columns[name]
    return rows
