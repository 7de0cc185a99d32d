"""Bifurcation diagrams by brute force: what runs settle on over a parameter."""

from __future__ import annotations

import dataclasses
from os import PathLike
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from zivi.base.check import Array, real_array, whole
from zivi.base.table import Field, Table, Tabulated
from zivi.orbits.attractor import Attractor, Settled, classify, settle, settle_one
from zivi.orbits.flights import period_of
from zivi.simulation.methods import SwitchedRK
from zivi.system.mass import ImpactSystem
from zivi.system.parameters import check_newton, parameter, with_value

__all__ = ["Diagram", "bifurcation_diagram"]

USUAL = SwitchedRK(rtol=1e-8, atol=1e-10)
FIELDS: dict[str, Field] = {
    "run_of_point": ("point", "", "run of the point"),
    "run_value": ("run", "", "parameter of the run"),
    "start": ("run", "", "number of its start"),
    "kind": ("run", "", "what it settled on"),
    "multiple": ("run", "", "after how many periods that repeats"),
}
"""Dimensions, unit and meaning of what is in the dataset."""
SECTIONS: dict[str, tuple[dict[str, Field], dict[str, Field]]] = {
    "impacts": (
        {"phase": ("point", "", "phase of the impact, a part of the period")},
        {"u": ("point", "m/s", "speed after the impact")},
    ),
    "strobe": ({"x": ("point", "m", "distance")}, {"xdot": ("point", "m/s", "velocity")}),
}
"""The same for the two numbers of a point."""


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class Diagram(Tabulated):
    """What runs settled on, over values of a parameter and starts.

    Attributes
    ----------
    name : str
        The parameter.
    section : str
        ``"impacts"``: points are phases and speeds after impacts; ``"strobe"``: states at the
        starts of periods.
    value : ndarray
        The parameter of each point.
    first, second : ndarray
        Phase of the impact (a part of the period) and speed after it (m/s); or distance (m) and
        velocity (m/s).
    run : ndarray of int
        The run of each point, an index into the following.
    run_value : ndarray
        The parameter of each run.
    run_start : ndarray of int
        Its start.
    attractors : list of Attractor
        What each run settled on; resting ones too, which a diagram by impacts alone would lose.
    """

    name: str
    section: str
    value: Array
    first: Array
    second: Array
    run: NDArray[np.int64]
    run_value: Array
    run_start: NDArray[np.int64]
    attractors: list[Attractor]

    @property
    def resting(self) -> NDArray[np.bool_]:
        """Which runs rest, for good or again and again."""
        return np.array([it.kind in ("rest", "resting") for it in self.attractors], dtype=bool)

    def __repr__(self) -> str:
        runs, rest = len(self.attractors), int(self.resting.sum())
        return f"<Diagram over {self.name}: {runs} runs, {rest} at rest, {len(self.value)} points>"

    def _table(self) -> Table:
        """Tell the points over ``point``, what each run settled on over ``run``."""
        first, second = SECTIONS[self.section]
        fields = {self.name: ("point", "", "parameter"), **first, **second, **FIELDS}
        values = {
            self.name: self.value,
            next(iter(first)): self.first,
            next(iter(second)): self.second,
            "run_of_point": self.run,
            "start": self.run_start,
            "kind": [it.kind for it in self.attractors],
            "multiple": [it.multiple for it in self.attractors],
        }
        return Table("Bifurcation diagram", fields, {}, values)


def bifurcation_diagram(
    system: ImpactSystem,
    name: str,
    values: ArrayLike,
    section: Literal["impacts", "strobe"] = "impacts",
    starts: ArrayLike | Literal["follow"] = (1.0, 0.0),
    *,
    transient: int = 300,
    keep: int = 64,
    period: float | None = None,
    method: SwitchedRK = USUAL,
    threads: int | None = None,
    out: str | PathLike[str] | None = None,
    executor: Any = None,
    progress: bool | None = None,
) -> Diagram:
    """Simulate over values of a parameter, and note what the runs settle on.

    Forces that need no interpreter run as batches on all cores. With `out` or `executor` it is a
    study: it can be stopped and goes on, in processes, or on Dask.

    Parameters
    ----------
    system : ImpactSystem
        A system with a periodic excitation.
    name : str
        The parameter, as in `sensitivity`.
    values : array_like
        Its values.
    section : {"impacts", "strobe"}
        Which points are noted: the impacts, or the states at the starts of periods.
    starts : array_like or "follow"
        Initial states at the start of a period, ``(x0, xdot0)`` or rows of them; each value is run
        from each. ``"follow"``: the end of the run at the last value, from ``(1, 0)`` at first.
    transient : int
        Periods that are not looked at, >= 0.
    keep : int
        Periods that are, >= 2.
    period : float, optional
        The period of the excitation (s), by default from the system.
    method : SwitchedRK
        Tolerances.
    threads : int, optional
        Threads of a batch; by default as many as the machine runs at once.
    out : path, optional
        Folder of a study, which the same call continues; see `sweep`.
    executor : optional
        Who computes the study; see `sweep`.
    progress : bool, optional
        Show a progress bar; by default on a terminal only.

    Returns
    -------
    Diagram
        The points and what each run settled on.

    Raises
    ------
    ValueError, TypeError
        For an argument out of range.

    Examples
    --------
    >>> table = zivi.ImpactSystem(
    ...     zivi.LinearForce(gravity=1.0, amplitude=1.3, phase=-np.pi / 2), e=0.5)
    >>> found = zivi.bifurcation_diagram(
    ...     table, "amplitude", [1.3, 1.6], starts=(0.3, 1.9), transient=100)
    >>> [(it.kind, it.multiple) for it in found.attractors]
    [('impacting', 1), ('impacting', 2)]
    """
    check_newton(system)
    parameter(system, name)
    grid = real_array("values", values).ravel()
    if not len(grid) or not np.all(np.isfinite(grid)):
        raise ValueError("values must be finite numbers, at least one")
    if section not in ("impacts", "strobe"):
        raise ValueError(f"section must be 'impacts' or 'strobe', got {section!r}")
    if whole("transient", transient) < 0 or whole("keep", keep) < 2:
        raise ValueError(f"transient must be >= 0 and keep >= 2, got {transient} and {keep}")
    follows = isinstance(starts, str)
    if follows and starts != "follow":
        raise ValueError(f"starts must be states or 'follow', got {starts!r}")
    states = np.atleast_2d([1.0, 0.0] if follows else real_array("starts", starts))
    if states.ndim != 2 or states.shape[1] != 2:
        raise ValueError(f"starts must have rows (x0, xdot0), got shape {states.shape}")
    plan = _Plan(system, name, section, transient, keep, period, method)
    if follows:
        found = plan.following(grid, states[0])
    elif out is not None or executor is not None:
        found = plan.study(grid, states, out, executor, progress)
    else:
        found = plan.batch(grid, states, threads, progress)
    return plan.diagram(np.repeat(grid, len(states)), len(states), found)


Found = tuple[Array, Attractor]
"""The points of a run, and what it settled on."""


@dataclasses.dataclass(frozen=True)
class _Plan:
    """What is done at each value."""

    system: ImpactSystem
    name: str
    section: str
    transient: int
    keep: int
    period: float | None
    method: SwitchedRK

    def at(self, value: float) -> tuple[ImpactSystem, float]:
        system = with_value(self.system, self.name, float(value))
        return system, period_of(system, self.period)

    def batch(
        self, grid: Array, states: Array, threads: int | None, progress: bool | None
    ) -> list[Found]:
        pairs = [self.at(value) for value in np.repeat(grid, len(states))]
        systems, periods = [it[0] for it in pairs], [it[1] for it in pairs]
        rows = np.tile(states, (len(grid), 1))
        settled = settle(
            systems, rows, periods, self.transient, self.keep, self.method, threads, progress
        )
        if self.section == "impacts":
            return [self.points(*it) for it in zip(systems, settled, periods, strict=True)]
        strobed = [[it.end] for it in settled]
        for _ in range(self.keep - 1):
            ends = np.array([it[-1] for it in strobed])
            more = settle(systems, ends, periods, 0, 1, self.method, threads, progress=False)
            for own, it in zip(strobed, more, strict=True):
                own.append(it.end)
        triples = zip(systems, settled, periods, strict=True)
        kinds = [classify(*it, self.keep) for it in triples]
        return [(np.array(rows), kind) for rows, kind in zip(strobed, kinds, strict=True)]

    def points(self, system: ImpactSystem, settled: Settled, period: float) -> Found:
        rows = settled.impacts / np.array([period, 1.0])
        rows[:, 0] %= 1.0
        return rows, classify(system, settled, period, self.keep)

    def one(self, value: float, state: Array) -> tuple[Found, Array]:
        system, period = self.at(value)
        settled = settle_one(system, tuple(state), period, self.transient, self.keep, self.method)
        if self.section == "impacts":
            return self.points(system, settled, period), settled.end
        rows = [settled.end]
        for _ in range(self.keep - 1):
            rows.append(settle_one(system, tuple(rows[-1]), period, 0, 1, self.method).end)
        return (np.array(rows), classify(system, settled, period, self.keep)), settled.end

    def following(self, grid: Array, state: Array) -> list[Found]:
        all_found = []
        for value in grid:
            found, end = self.one(value, state)
            all_found.append(found)
            state = end if found[1].kind != "failed" else state
        return all_found

    def study(
        self, grid: Array, states: Array, out: Any, executor: Any, progress: bool | None
    ) -> list[Found]:
        from zivi.study import grid as product, sweep

        fixed = {"plan": self, "states": states}
        study = sweep(
            settled_point,
            product(value=grid, start=np.arange(len(states))),
            fixed=fixed,
            out=out,
            executor=executor,
            progress=progress,
        )
        data, columns = study.dataset, _columns(study.events)
        kinds, multiples = data["kind"].values.ravel(), data["multiple"].values.ravel()
        found = []
        for i in range(kinds.size):
            own = {name: column[columns["point"] == i] for name, column in columns.items()}
            listed = own["in_orbit"] > 0
            orbit = np.column_stack([own["orbit_phase"][listed], own["orbit_speed"][listed]])
            kind = "failed" if np.isnan(kinds[i]) else KINDS[int(kinds[i])]
            multiple = 0 if np.isnan(multiples[i]) else int(multiples[i])
            points = np.column_stack([own["first"], own["second"]])
            found.append((points, Attractor(kind, multiple, orbit)))
        return found

    def diagram(self, values: Array, n_starts: int, found: list[Found]) -> Diagram:
        counts = [len(rows) for rows, _ in found]
        rows = np.vstack([rows for rows, _ in found]) if sum(counts) else np.empty((0, 2))
        run = np.repeat(np.arange(len(found)), counts)
        return Diagram(
            name=self.name,
            section=self.section,
            value=values[run],
            first=rows[:, 0],
            second=rows[:, 1],
            run=run,
            run_value=values,
            run_start=np.tile(np.arange(n_starts), len(values) // n_starts),
            attractors=[attractor for _, attractor in found],
        )


KINDS = ("flight", "impacting", "resting", "rest", "irregular", "failed")
POINT = np.dtype(
    [(name, "f8") for name in ("first", "second", "in_orbit", "orbit_phase", "orbit_speed")]
)


def _columns(events: Any) -> dict[str, Array]:
    """Give the events of a study as arrays by name."""
    names = ("point", *(POINT.names or ()))
    if events is None:
        return {name: np.empty(0) for name in names}
    return {name: np.asarray(events[name]) for name in names}


def settled_point(value: float, start: int, *, plan: _Plan, states: Array) -> Any:
    """Compute one run of a diagram, as a point of a study."""
    (rows, attractor), _ = plan.one(float(value), states[int(start)])
    events = np.zeros(len(rows), POINT)
    events["first"], events["second"] = rows.T if len(rows) else (0.0, 0.0)
    n = min(len(attractor.impacts), len(rows))
    events["in_orbit"][:n] = 1.0
    events["orbit_phase"][:n], events["orbit_speed"][:n] = attractor.impacts[:n].T
    return {"kind": KINDS.index(attractor.kind), "multiple": attractor.multiple}, events
