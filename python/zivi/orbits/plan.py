"""What is done at each value of a bifurcation diagram."""

from __future__ import annotations

import dataclasses
from abc import ABC, abstractmethod
from typing import Any

import numpy as np

from zivi.base.check import Array
from zivi.orbits.attractor import Attractor, Settled, classify, settle
from zivi.orbits.mechanical.family import period_of, with_values
from zivi.simulation.methods import SwitchedRK
from zivi.system.mass import ImpactSystem

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
    def settle(self, systems: list[Any], states: Array, periods: list[float], *how: Any) -> Any:
        """Run each from its state; how: threads, and whether progress is shown."""

    @abstractmethod
    def points(self, system: Any, settled: Any, period: float) -> Found:
        """Give the points of a run, and what it settled on."""

    def at(self, value: float) -> tuple[Any, float]:
        """Give the system with a value, and its period."""
        own = getattr(self.system, "parameters", {})
        is_e = self.name not in own and (self.name == "e" or self.name.startswith("e."))
        if is_e and not 0.0 <= value <= 1.0:
            raise ValueError(f"e must lie in [0, 1], got {value}")
        system = with_values(self.system, {self.name: float(value)})
        return system, period_of(system, self.period)

    def batch(
        self, grid: Array, states: Array, threads: int | None, progress: bool | None
    ) -> list[Found]:
        """Run each value from each state."""
        pairs = [self.at(value) for value in np.repeat(grid, len(states))]
        systems, periods = [it[0] for it in pairs], [it[1] for it in pairs]
        rows = np.concatenate([states] * len(grid))
        settled = self.settle(systems, rows, periods, threads, progress)
        return [self.points(*it) for it in zip(systems, settled, periods, strict=True)]

    def one(self, value: float, state: Array) -> tuple[Found, Array]:
        """Run one value from one state; also its end."""
        system, period = self.at(value)
        (settled,) = self.settle([system], state[None], [period], 1, False)
        return self.points(system, settled, period), settled.end

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

    def settle(
        self, systems: list[Any], states: Array, periods: list[float], *how: Any
    ) -> list[Settled]:
        """Run each from its state."""
        rule = self.method
        settled = settle(systems, states, periods, self.transient, self.keep, rule, *how)
        if self.section == "impacts":
            return settled
        rows = [np.array([it.end for it in settled])]
        for _ in range(self.keep - 1):
            more = settle(systems, rows[-1], periods, 0, 1, rule, how[0], False)
            rows.append(np.array([it.end for it in more]))
        both = zip(settled, np.stack(rows, axis=1), strict=True)
        return [dataclasses.replace(it, states=own) for it, own in both]

    def points(self, system: ImpactSystem, settled: Settled, period: float) -> Found:
        """Give phases and speeds of the impacts, or states at the starts of periods."""
        kind = classify(system, settled, period, self.keep)
        if self.section == "impacts":
            rows = np.column_stack([settled.impacts, np.zeros(len(settled.impacts))])
            rows[:, 0] = rows[:, 0] / period % 1.0
            return rows, kind
        assert settled.states is not None
        # at no gap
        return np.column_stack([settled.states, np.full(self.keep, -1.0)]), kind
