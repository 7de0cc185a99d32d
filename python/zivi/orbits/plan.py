"""What is done at each value of a bifurcation diagram."""

from __future__ import annotations

import dataclasses
from abc import ABC, abstractmethod
from typing import Any

import numpy as np

from zivi.base.check import Array
from zivi.orbits.attractor import Attractor, Settled, classify, settle, settle_one
from zivi.orbits.flights import period_of
from zivi.simulation.methods import SwitchedRK
from zivi.system.mass import ImpactSystem
from zivi.system.parameters import with_value

__all__ = ["Found", "MassPlan", "Plan", "settled_point"]

Found = tuple[Array, Attractor]
"""The points of a run, rows of two numbers and a gap, and what it settled on."""

KINDS = ("flight", "impacting", "resting", "rest", "irregular", "failed")
OF_POINT = ("first", "second", "gap")
OF_ORBIT = ("in_orbit", "orbit_phase", "orbit_speed", "orbit_gap")
POINT = np.dtype([(name, "f8") for name in (*OF_POINT, *OF_ORBIT)])


@dataclasses.dataclass(frozen=True)
class Plan(ABC):
    """What is done at each value, of one mass and of a mechanical system."""

    system: Any
    name: str
    section: str
    transient: int
    keep: int
    period: float | None
    method: SwitchedRK

    @abstractmethod
    def batch(
        self, grid: Array, states: Array, threads: int | None, progress: bool | None
    ) -> list[Found]:
        """Run each value from each state."""

    @abstractmethod
    def one(self, value: float, state: Array) -> tuple[Found, Array]:
        """Run one value from one state; also its end."""

    def following(self, grid: Array, state: Array) -> list[Found]:
        """Run each value from the end of the run at the last."""
        all_found = []
        for value in grid:
            found, end = self.one(value, state)
            all_found.append(found)
            state = end if found[1].kind != "failed" else state
        return all_found

    def study(
        self, grid: Array, states: Array, out: Any, executor: Any, progress: bool | None
    ) -> list[Found]:
        """Run each value from each state as a study."""
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
            gaps = own["orbit_gap"][listed].astype(np.int64)
            kind = "failed" if np.isnan(kinds[i]) else KINDS[int(kinds[i])]
            multiple = 0 if np.isnan(multiples[i]) else int(multiples[i])
            points = np.column_stack([own[name] for name in OF_POINT])
            points = points[~np.isnan(points[:, 2])]
            found.append((points, Attractor(kind, multiple, orbit, gaps)))
        return found


def _columns(events: Any) -> dict[str, Array]:
    """Give the events of a study as arrays by name."""
    names = ("point", *(POINT.names or ()))
    if events is None:
        return {name: np.empty(0) for name in names}
    return {name: np.asarray(events[name]) for name in names}


def settled_point(value: float, start: int, *, plan: Plan, states: Array) -> Any:
    """Compute one run of a diagram, as a point of a study."""
    (rows, attractor), _ = plan.one(float(value), states[int(start)])
    orbit = attractor.impacts
    events = np.zeros(max(len(rows), len(orbit)), POINT)
    for name, column in zip(OF_POINT, rows.T, strict=True):
        events[name] = np.nan
        events[name][: len(rows)] = column
    n = len(orbit)
    events["in_orbit"][:n] = 1.0
    events["orbit_phase"][:n], events["orbit_speed"][:n] = orbit.T
    events["orbit_gap"][:n] = 0 if attractor.gaps is None else attractor.gaps
    return {"kind": KINDS.index(attractor.kind), "multiple": attractor.multiple}, events


@dataclasses.dataclass(frozen=True)
class MassPlan(Plan):
    """What is done at each value, of one mass."""

    def at(self, value: float) -> tuple[ImpactSystem, float]:
        """Give the system with a value, and its period."""
        system = with_value(self.system, self.name, float(value))
        return system, period_of(system, self.period)

    def batch(
        self, grid: Array, states: Array, threads: int | None, progress: bool | None
    ) -> list[Found]:
        """Run each value from each state."""
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
        return [(_states(rows), kind) for rows, kind in zip(strobed, kinds, strict=True)]

    def points(self, system: ImpactSystem, settled: Settled, period: float) -> Found:
        """Give phases and speeds of the impacts."""
        rows = np.column_stack([settled.impacts, np.zeros(len(settled.impacts))])
        rows[:, 0] = rows[:, 0] / period % 1.0
        return rows, classify(system, settled, period, self.keep)

    def one(self, value: float, state: Array) -> tuple[Found, Array]:
        """Run one value from one state; also its end."""
        system, period = self.at(value)
        settled = settle_one(system, tuple(state), period, self.transient, self.keep, self.method)
        if self.section == "impacts":
            return self.points(system, settled, period), settled.end
        rows = [settled.end]
        for _ in range(self.keep - 1):
            rows.append(settle_one(system, tuple(rows[-1]), period, 0, 1, self.method).end)
        return (_states(rows), classify(system, settled, period, self.keep)), settled.end


def _states(rows: list[Array]) -> Array:
    """Give states, which are at no gap, as points."""
    return np.column_stack([np.array(rows), np.full(len(rows), -1.0)])
