"""Bifurcation diagrams and basins of attraction by brute force."""

from __future__ import annotations

import dataclasses
from abc import ABC, abstractmethod
from collections.abc import Sequence
from os import PathLike
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from zivi.base.check import Array, integer, real_array
from zivi.base.habits import hinted
from zivi.base.table import Field, ResultTable, Tabulated, listed_by
from zivi.orbits.attractor import (
    TOLERANCE,
    Attractor,
    MechanicalSettled,
    Settled,
    attractor_of,
    classify,
    classify_mechanical,
    open_starts,
    settle,
    settle_cells,
    settle_mechanical,
    settle_mechanical_cells as settle_mechanical_cells,
)
from zivi.orbits.orbit import MechanicalOrbit, PeriodicOrbit, with_failed
from zivi.orbits.path import period_of, value_of, with_values
from zivi.simulation.mechanical_run import state_of
from zivi.simulation.methods import SwitchedRK
from zivi.system.mass import ImpactSystem
from zivi.system.mechanism import MechanicalSystem
from zivi.system.parameters import check_newton, parameter

# Task at each value of a bifurcation diagram for one mass.

RunFound = tuple[Array, Attractor]
"""The points of a run, rows of two numbers and a gap, and what it settled on."""

ATTRACTOR_KINDS = ("flight", "impacting", "resting", "rest", "irregular", "failed")
OF_POINT = ("first", "second", "gap")
OF_ORBIT = ("in_orbit", "orbit_phase", "orbit_speed", "orbit_gap")
POINT = np.dtype([(name, "f8") for name in (*OF_POINT, *OF_ORBIT)])


@dataclasses.dataclass(frozen=True)
class Plan(ABC):
    """Task at each parameter value, for one mass or a mechanical system."""

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
    def points(self, system: Any, settled: Any, period: float) -> RunFound:
        """Return the points of a run and its attractor."""

    def at(self, value: float) -> tuple[Any, float]:
        """Return the system with a value, and its period."""
        own = getattr(self.system, "parameters", {})
        is_e = self.name not in own and (self.name == "e" or self.name.startswith("e."))
        if is_e and not 0.0 <= value <= 1.0:
            raise ValueError(f"e must lie in [0, 1], got {value}")
        system = with_values(self.system, {self.name: float(value)})
        return system, period_of(system, self.period)

    def batch(
        self, grid: Array, states: Array, threads: int | None, progress: bool | None
    ) -> list[RunFound]:
        """Run each value from each state."""
        pairs = [self.at(value) for value in np.repeat(grid, len(states))]
        systems, periods = [it[0] for it in pairs], [it[1] for it in pairs]
        rows = np.concatenate([states] * len(grid))
        settled = self.settle(systems, rows, periods, threads, progress)
        return [self.points(*it) for it in zip(systems, settled, periods, strict=True)]

    def one(self, value: float, state: Array) -> tuple[RunFound, Array]:
        """Run one value from one state; also its end."""
        system, period = self.at(value)
        (settled,) = self.settle([system], state[None], [period], 1, False)
        return self.points(system, settled, period), settled.end

    def following(self, grid: Array, state: Array) -> list[RunFound]:
        """Run each value from the end of the run at the last."""
        all_found = []
        for value in grid:
            found, end = self.one(value, state)
            all_found.append(found)
            state = end if found[1].kind != "failed" else state
        return all_found

    def study(
        self, grid: Array, states: Array, out: Any, executor: Any, progress: bool | None
    ) -> list[RunFound]:
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
            kind = "failed" if np.isnan(kinds[i]) else ATTRACTOR_KINDS[int(kinds[i])]
            multiple = 0 if np.isnan(multiples[i]) else int(multiples[i])
            points = np.column_stack([own[name] for name in OF_POINT])
            points = points[~np.isnan(points[:, 2])]
            found.append((points, Attractor(kind, multiple, orbit, gaps)))
        return found


def _columns(events: Any) -> dict[str, Array]:
    """Return the events of a study as arrays by name."""
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
    return {"kind": ATTRACTOR_KINDS.index(attractor.kind), "multiple": attractor.multiple}, events


@dataclasses.dataclass(frozen=True)
class MassPlan(Plan):
    """Task at each parameter value for one mass."""

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

    def points(self, system: ImpactSystem, settled: Settled, period: float) -> RunFound:
        """Return phases and speeds of the impacts, or states at the starts of periods."""
        kind = classify(system, settled, period, self.keep)
        if self.section == "impacts":
            rows = np.column_stack([settled.impacts, np.zeros(len(settled.impacts))])
            rows[:, 0] = rows[:, 0] / period % 1.0
            return rows, kind
        assert settled.states is not None
        # at no gap
        return np.column_stack([settled.states, np.full(self.keep, -1.0)]), kind


# Task at each value of a bifurcation diagram of a mechanical system.


def number_of(what: str, name: str | None, names: tuple[str, ...]) -> int | None:
    """Return the number of a gap or a coordinate by its name."""
    if name is None:
        return None
    if name not in names:
        raise ValueError(f"{what} must be one of {', '.join(map(repr, names))}, got {name!r}")
    return names.index(name)


def read_states(name: str, starts: Array) -> Array:
    """Return states of shape (N, 2, n) of one, ``(q0, qdot0)``, or several."""
    states = starts[None] if starts.ndim == 2 else starts
    if states.ndim != 3 or states.shape[1] != 2 or not states.shape[2]:
        raise ValueError(f"{name} must be (q0, qdot0), or several, got shape {starts.shape}")
    return states


def _place(name: str, names: tuple[str, ...]) -> tuple[int, int]:
    """Return where an initial value is in ``(q0, qdot0)``."""
    for part, kind in enumerate(("q0", "qdot0")):
        for i, own in enumerate(names):
            if name in (f"{kind}.{own}", f"{kind}[{i}]"):
                return part, i
    known = ", ".join(f"'{kind}.{own}'" for kind in ("q0", "qdot0") for own in names)
    raise ValueError(f"axes must be two of {known}, got {name!r}")


def starts_of(
    system: MechanicalSystem, values: Array, axes: Sequence[str] | None, y0: Any
) -> tuple[tuple[str, str], Array]:
    """Return the names of two initial values, and states of shape (N, 2, n) with pairs of them."""
    if y0 is None and system._n is None:
        raise ValueError(
            "y0 must be given: the number of coordinates cannot be derived from the system"
        )
    base = np.zeros((2, system._n or 0)) if y0 is None else np.array(state_of(y0, system._n))
    names = system.coordinate_names(base.shape[1])
    given = (f"q0.{names[0]}", f"qdot0.{names[0]}") if axes is None else tuple(axes)
    places = [_place(name, names) for name in given]
    if len(places) != 2 or places[0] == places[1]:
        raise ValueError(f"axes must be two different initial values, got {given!r}")
    states = np.repeat(base[None], len(values), axis=0)
    for (part, i), column in zip(places, values.T, strict=True):
        states[:, part, i] = column
    return (given[0], given[1]), states


@dataclasses.dataclass(frozen=True)
class MechanicalPlan(Plan):
    """Task at each parameter value."""

    gap: int | None = None
    """Of which gap the impacts are noted, None for all."""
    coordinate: int = 0
    """Of which coordinate the states are noted."""

    def settle(
        self, systems: list[Any], states: Array, periods: list[float], *how: Any
    ) -> list[MechanicalSettled]:
        """Run each from its state."""
        return settle_mechanical(
            systems, states, periods, self.transient, self.keep, self.method, *how
        )

    def points(
        self, system: MechanicalSystem, settled: MechanicalSettled, period: float
    ) -> RunFound:
        """Return phases and speeds of the impacts, or states."""
        kind = classify_mechanical(settled, period, self.keep, TOLERANCE)
        if self.section == "impacts":
            rows = settled.impacts.copy()
            rows[:, 0] = rows[:, 0] / period % 1.0
            return (rows if self.gap is None else rows[rows[:, 2] == self.gap]), kind
        n = settled.states.shape[1] // 2
        states = settled.states[1:, [self.coordinate, n + self.coordinate]]
        return np.column_stack([states, np.full(len(states), -1.0)]), kind


# Bifurcation diagrams by brute force: what runs settle on over a parameter.

USUAL = SwitchedRK(rtol=1e-8, atol=1e-10)
OPEN = ("irregular", "failed")
"""Kinds of what a run did that are no periodic motion."""
DIAGRAM_FIELDS: dict[str, Field] = {
    "run_of_point": ("point", "", "run of the point"),
    "gap": ("point", "", "number of the gap, -1 of a state"),
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
    """Attractors of runs over parameter values and initial states.

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
    gap : ndarray of int or None
        The gap of each point, 0 of one mass, -1 of a state.
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
    gap: NDArray[np.int64] | None = None

    @property
    def resting(self) -> NDArray[np.bool_]:
        """Which runs rest, permanently or repeatedly."""
        return np.array([it.kind in ("rest", "resting") for it in self.attractors], dtype=bool)

    def __repr__(self) -> str:
        runs, rest = len(self.attractors), int(self.resting.sum())
        failed = f", {text}" if (text := self._failed_text()) else ""
        counted = f"{runs} runs, {rest} at rest, {len(self.value)} points{failed}"
        return f"<Diagram over {self.name}: {counted}>"

    def _failed_text(self) -> str:
        kinds = [it.kind for it in self.attractors if it.kind in OPEN]
        return listed_by(len(self.attractors), "runs without a periodic motion", kinds)

    @property
    def message(self) -> str:
        """Summary of the attractors, and the number of runs without one."""
        failed = self._failed_text()
        if not failed:
            return "Every run settled on a periodic motion, or rests."
        advice = "irregular ones may be chaotic, or need a longer transient"
        return with_failed("", f"{failed}; {advice}").strip()

    def _table(self) -> ResultTable:
        """Describe the dataset: points over ``point``, the attractor of each run over ``run``."""
        first, second = SECTIONS[self.section]
        fields = {self.name: ("point", "", "parameter"), **first, **second, **DIAGRAM_FIELDS}
        values = {
            self.name: self.value,
            next(iter(first)): self.first,
            next(iter(second)): self.second,
            "run_of_point": self.run,
            "gap": np.zeros(len(self.value)) if self.gap is None else self.gap,
            "start": self.run_start,
            "kind": [it.kind for it in self.attractors],
            "multiple": [it.multiple for it in self.attractors],
        }
        return ResultTable("Bifurcation diagram", fields, {}, values)


@hinted("settled")
def bifurcation_diagram(
    system: ImpactSystem | MechanicalSystem,
    name: str,
    values: ArrayLike,
    section: Literal["impacts", "strobe"] = "impacts",
    starts: ArrayLike | Literal["follow"] | None = None,
    *,
    gap: str | None = None,
    coordinate: str | None = None,
    transient: int = 300,
    keep: int = 64,
    period: float | None = None,
    method: SwitchedRK = USUAL,
    threads: int | None = None,
    out: str | PathLike[str] | None = None,
    executor: Any = None,
    progress: bool | None = None,
) -> Diagram:
    """Simulate over values of a parameter, and record the attractors of the runs.

    Forces and models that need no interpreter run as batches on all cores. With `out` or `executor`
    it is a study, which can be interrupted and resumed and runs in processes or on Dask.

    Parameters
    ----------
    system : ImpactSystem or MechanicalSystem
        A system with a periodic excitation.
    name : str
        The parameter (see `sensitivity`; for a mechanical system `continue_orbit`).
    values : array_like
        Its values.
    section : {"impacts", "strobe"}
        Which points are noted: the impacts, or the states at the starts of periods.
    starts : array_like or "follow"
        Initial states at the start of a period, ``(x0, xdot0)`` or rows of them, by default
        ``(1, 0)``; each value is run from each. Of a mechanical system ``(q0, qdot0)`` or several,
        by default zeros. ``"follow"``: the end of the run at the last value, from the default at
        first.
    gap, coordinate : str, optional
        Of a mechanical system the gap whose impacts are noted, by default all; and the coordinate
        whose states are, by default the first.
    transient : int
        Periods before those that are noted, >= 0. Of one mass under a force that needs no
        interpreter they may be fewer, at least 100: a run whose last `keep` periods are the same
        to rounding has settled.
    keep : int
        Periods that are, >= 2.
    period : float, optional
        The period of the excitation (s), by default from the system.
    method : SwitchedRK
        Tolerances.
    threads : int, optional
        Threads of a batch; by default the number of cores.
    out : path, optional
        Folder of a study, which the same call continues; see `sweep`.
    executor : optional
        Who computes the study; see `sweep`.
    progress : bool, optional
        Show a progress bar; by default on a terminal only.

    Returns
    -------
    Diagram
        The points and the attractor of each run.

    Raises
    ------
    ValueError, TypeError
        For an argument out of range.

    See Also
    --------
    continue_orbit : orbits, unstable ones included, by continuation.
    basins : attractors over initial states.

    Notes
    -----
    Each value costs one run per initial state. Unstable orbits are invisible in it; use
    `continue_orbit` for them.

    References
    ----------
    S. W. Shaw and P. J. Holmes, A periodically forced piecewise linear oscillator, J. Sound Vib.
    90, 1983.

    A. B. Nordmark, Non-periodic motion caused by grazing incidence, J. Sound Vib. 145, 1991.

    Examples
    --------
    >>> table = zivi.ImpactSystem(
    ...     zivi.LinearForce(gravity=1.0, amplitude=1.3, phase=-np.pi / 2), e=0.5)
    >>> found = zivi.bifurcation_diagram(
    ...     table, "amplitude", [1.3, 1.6], starts=(0.3, 1.9), transient=100)
    >>> [(it.kind, it.multiple) for it in found.attractors]
    [('impacting', 1), ('impacting', 2)]
    """
    grid = real_array("values", values).ravel()
    if not len(grid) or not np.all(np.isfinite(grid)):
        raise ValueError("values must be finite numbers, at least one")
    if section not in ("impacts", "strobe"):
        raise ValueError(f"section must be 'impacts' or 'strobe', got {section!r}")
    if integer("transient", transient) < 0 or integer("keep", keep) < 2:
        raise ValueError(f"transient must be >= 0 and keep >= 2, got {transient} and {keep}")
    follows = isinstance(starts, str)
    if follows and starts != "follow":
        raise ValueError(f"starts must be states or 'follow', got {starts!r}")
    given = None if follows or starts is None else real_array("starts", starts)
    common = (system, name, section, transient, keep, period, method)
    if isinstance(system, MechanicalSystem):
        states, plan = _mechanical_plan(common, given, gap, coordinate)
    else:
        if gap is not None or coordinate is not None:
            raise ValueError("gap and coordinate are for a zivi.MechanicalSystem")
        states, plan = _mass_plan(common, given)
    if follows:
        found = plan.following(grid, states[0])
    elif out is not None or executor is not None:
        found = plan.study(grid, states, out, executor, progress)
    else:
        found = plan.batch(grid, states, threads, progress)
    return _diagram(plan, np.repeat(grid, len(states)), len(states), found)


def _mass_plan(common: Any, given: Array | None) -> tuple[Array, Plan]:
    check_newton(common[0])
    parameter(common[0], common[1])
    states = np.atleast_2d([1.0, 0.0] if given is None else given)
    if states.ndim != 2 or states.shape[1] != 2:
        raise ValueError(f"starts must have rows (x0, xdot0), got shape {states.shape}")
    return states, MassPlan(*common)


def _mechanical_plan(
    common: Any, given: Array | None, gap: str | None, coordinate: str | None
) -> tuple[Array, Plan]:
    system: MechanicalSystem = common[0]
    value_of(system, common[1])
    if given is None:
        if system._n is None:
            raise ValueError(
                "starts is required for this system, whose number of coordinates is unknown"
            )
        given = np.zeros((2, system._n))
    states = read_states("starts", given)
    names = system.coordinate_names(states.shape[2])
    of_gap = number_of("gap", gap, system.gap_names)
    of_coordinate = number_of("coordinate", coordinate, names) or 0
    plan = MechanicalPlan(*common)
    return states, dataclasses.replace(plan, gap=of_gap, coordinate=of_coordinate)


def _diagram(plan: Plan, values: Array, n_starts: int, found: list[RunFound]) -> Diagram:
    counts = [len(rows) for rows, _ in found]
    rows = np.vstack([rows for rows, _ in found]) if sum(counts) else np.empty((0, 3))
    run = np.repeat(np.arange(len(found)), counts)
    return Diagram(
        name=plan.name,
        section=plan.section,
        value=values[run],
        first=rows[:, 0],
        second=rows[:, 1],
        run=run,
        run_value=values,
        run_start=np.tile(np.arange(n_starts), len(values) // n_starts),
        attractors=[attractor for _, attractor in found],
        gap=rows[:, 2].astype(np.int64),
    )


# Basins of attraction: the attractor of each initial state.

SAME_ATTRACTOR = 100.0
"""Runs are of one attractor if they differ by less than so many times the tolerance."""
BASIN_FIELDS: dict[str, Field] = {
    "label": (("xdot0", "x0"), "", "number of the attractor"),
    "border": (("xdot0", "x0"), "", "whether a neighbour settles on something else"),
    "grazing": (("xdot0", "x0"), "", "whether a grazing decided"),
    "kind": ("attractor", "", "kind of the attractor"),
    "multiple": ("attractor", "", "after how many periods it repeats"),
}
COORDS: dict[str, Field] = {
    "x0": ("x0", "m", "initial distance"),
    "xdot0": ("xdot0", "m/s", "initial velocity"),
}
"""Dimensions, unit and meaning of what is in the dataset."""


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class Basins(Tabulated):
    """Attractor to which each initial state converges.

    Attributes
    ----------
    x0s, v0s : ndarray
        Initial distances (m) and velocities (m/s), or the values of the two `axes`.
    label : ndarray of int
        Of shape (len(v0s), len(x0s)): the number of the attractor, -1 where a gap is negative.
    attractors : list of Attractor
        Those given first, then those that were found.
    grazing : ndarray of bool
        Cells of which the run passed a grazing: an impact, or the want of one, that the tolerances
        decided. Their labels are those of the runs as computed, and uncertain. It is not available
        for a mechanical system.
    border : ndarray of bool
        Cells with a neighbour that converges to another attractor, and grazing cells.
    axes : (str, str)
        What is varied.
    """

    x0s: Array
    v0s: Array
    label: NDArray[np.int64]
    attractors: list[Attractor]
    grazing: NDArray[np.bool_]
    axes: tuple[str, str] = ("x0", "xdot0")

    @property
    def border(self) -> NDArray[np.bool_]:
        """Cells with a neighbour that settles on something else, and grazing ones."""
        label, edge = self.label, self.grazing.copy()
        across, along = label[1:] != label[:-1], label[:, 1:] != label[:, :-1]
        edge[1:] |= across
        edge[:-1] |= across
        edge[:, 1:] |= along
        edge[:, :-1] |= along
        return edge

    @property
    def shares(self) -> Array:
        """Share of the cells with gaps >= 0 that converges to each attractor."""
        inside = self.label[self.label >= 0]
        counts = np.bincount(inside, minlength=len(self.attractors))
        return np.asarray(counts / max(inside.size, 1), np.float64)

    def __repr__(self) -> str:
        pairs = zip(self.attractors, self.shares, strict=True)
        told = ", ".join(f"{it.kind} x{it.multiple}: {share:.1%}" for it, share in pairs)
        unsure = f", {unsure} cells graze" if (unsure := np.count_nonzero(self.grazing)) else ""
        penetrating = int(np.count_nonzero(self.label < 0))
        unsure += f", {penetrating} cells with a negative gap" if penetrating else ""
        return f"<Basins of {self.label.size} cells: {told}{unsure}>"

    def _table(self) -> ResultTable:
        """Describe the dataset: attractor numbers over states, attractors over ``attractor``."""
        values = {
            "kind": [it.kind for it in self.attractors],
            "multiple": [it.multiple for it in self.attractors],
            "x0": self.x0s,
            "xdot0": self.v0s,
        }
        attrs = {} if self.axes == ("x0", "xdot0") else {"axes": list(self.axes)}
        return ResultTable(
            "Basins of attraction", BASIN_FIELDS, COORDS, values, attrs, rows="attractor"
        )


@hinted("settled")
def basins(
    system: ImpactSystem | MechanicalSystem,
    x0s: ArrayLike,
    v0s: ArrayLike,
    attractors: Sequence[PeriodicOrbit | MechanicalOrbit] | None = None,
    *,
    axes: Sequence[str] | None = None,
    y0: Any = None,
    transient: int = 200,
    keep: int = 32,
    period: float | None = None,
    tolerance: float = TOLERANCE,
    method: SwitchedRK = USUAL,
    threads: int | None = None,
    progress: bool | None = None,
) -> Basins:
    """Compute basins of attraction: simulate from a grid of initial states.

    Attractors are distinguished by their kind, the number of periods after which they repeat, and
    the phases and speeds of their impacts. A motion that rests is one class for each phase of its
    lift-off. Runs whose states at the start of a period differ by less than the tolerances are one
    from there on. A cell of which a grazing decided is marked.

    Parameters
    ----------
    system : ImpactSystem or MechanicalSystem
        A system with a periodic excitation. Forces that need no interpreter run as a batch.
    x0s, v0s : array_like
        Initial distances, >= 0 (m), and velocities (m/s), at the start of a period; of a mechanical
        system the values of the two `axes`.
    attractors : sequence of PeriodicOrbit or MechanicalOrbit, optional
        Known orbits: they get the first numbers.
    axes : (str, str), optional
        Of a mechanical system the two initial values that are varied, as ``"q0.x"`` or
        ``"qdot0[1]"``; by default those of the first coordinate.
    y0 : (array_like, array_like), optional
        For a mechanical system ``(q0, qdot0)`` with the other initial values; by default zeros.
    transient, keep : int
        Numbers of transient periods, which are discarded, and of inspected periods.
    period : float, optional
        The period of the excitation (s), by default from the system.
    tolerance : float
        How well a periodic motion repeats, relative to the period and the largest speed.
    method : SwitchedRK
        Tolerances.
    threads : int, optional
        Threads of the batch; by default the number of cores.
    progress : bool, optional
        Show a progress bar; by default on a terminal only.

    Returns
    -------
    Basins
        The number of the attractor of each cell, and whether a grazing decided it.

    Raises
    ------
    ValueError, TypeError
        For an argument out of range.

    See Also
    --------
    bifurcation_diagram : attractors over a parameter.
    zivi.plot.basins : draw the basins.

    Notes
    -----
    The cost is one run per cell of the grid.

    References
    ----------
    M. di Bernardo et al., Piecewise-smooth Dynamical Systems, Springer, 2008.

    Examples
    --------
    >>> table = zivi.LinearForce(gravity=1.0, amplitude=1.3, phase=-np.pi / 2)
    >>> found = zivi.basins(
    ...     zivi.ImpactSystem(table, e=0.5), np.linspace(0, 2, 6), np.linspace(-2, 2, 5))
    >>> sorted({it.kind for it in found.attractors})  # both are stable
    ['impacting', 'resting']
    """
    across, along = (real_array(n, v).ravel() for n, v in (("x0s", x0s), ("v0s", v0s)))
    is_mass = not isinstance(system, MechanicalSystem)
    if not len(across) or not len(along) or (is_mass and np.any(across < 0.0)):
        told = ", those of x0s >= 0" if is_mass else ""
        raise ValueError(f"x0s and v0s must hold numbers{told}")
    if integer("transient", transient) < 0 or integer("keep", keep) < 2:
        raise ValueError(f"transient must be >= 0 and keep >= 2, got {transient} and {keep}")
    if not tolerance > 0.0:
        raise ValueError(f"tolerance must be > 0, got {tolerance}")
    found = _Cells(transient, keep, tolerance, method, threads, progress)
    states = np.stack(np.meshgrid(across, along), axis=-1).reshape(-1, 2)
    known = [_of_orbit(orbit, is_mass) for orbit in attractors or ()]
    if isinstance(system, MechanicalSystem):
        names, starts = starts_of(system, states, axes, y0)
        label, grazing = found.of_mechanism(system, starts, period, known)
    else:
        if axes is not None or y0 is not None:
            raise ValueError("axes and y0 are for a zivi.MechanicalSystem")
        check_newton(system)
        names = ("x0", "xdot0")
        label, grazing = found.of_mass(system, states, period, known)
    shape = (len(along), len(across))
    return Basins(across, along, label.reshape(shape), known, grazing.reshape(shape), names)


Labels = tuple[NDArray[np.int64], NDArray[np.bool_]]
"""The number of the attractor of each state, and which a grazing decided."""


@dataclasses.dataclass(frozen=True)
class _Cells:
    """Settings that identify the attractors of the states."""

    transient: int
    keep: int
    tolerance: float
    method: SwitchedRK
    threads: int | None
    progress: bool | None

    def of_mass(
        self, system: ImpactSystem, states: Array, period: float | None, known: list[Attractor]
    ) -> Labels:
        length = period_of(system, period)
        cells = settle_cells(
            system,
            states,
            length,
            self.transient,
            self.keep,
            self.method,
            self.threads,
            self.progress,
        )
        kinds = [classify(system, it, length, self.keep, self.tolerance) for it in cells.settled]
        return self.numbers(kinds, cells.which, known)[cells.which], cells.grazing

    def of_mechanism(
        self, system: MechanicalSystem, states: Array, period: float | None, known: list[Attractor]
    ) -> Labels:
        length = period_of(system, period)
        label = np.full(len(states), -1, dtype=np.int64)
        inside = open_starts(system, states)
        if inside.any():
            settled, which = settle_mechanical_cells(
                system,
                states[inside],
                length,
                self.transient,
                self.keep,
                self.method,
                self.threads,
                self.progress,
            )
            kinds = [classify_mechanical(it, length, self.keep, self.tolerance) for it in settled]
            label[inside] = self.numbers(kinds, which, known)[which]
        return label, np.zeros(len(states), dtype=bool)

    def numbers(
        self, kinds: list[Attractor], which: NDArray[np.int64], known: list[Attractor]
    ) -> NDArray[np.int64]:
        """Return the numbers of the attractors; new ones are added in the order of cells."""
        label = np.empty(len(kinds), dtype=np.int64)
        for i in np.argsort(np.unique(which, return_index=True)[1]):
            same = (
                j
                for j, other in enumerate(known)
                if kinds[i].is_same(other, SAME_ATTRACTOR * self.tolerance)
            )
            label[i] = next(same, len(known))
            if label[i] == len(known):
                known.append(kinds[i])
        return label


def _of_orbit(orbit: PeriodicOrbit | MechanicalOrbit, is_mass: bool) -> Attractor:
    if not isinstance(orbit, PeriodicOrbit if is_mass else MechanicalOrbit):
        name = "PeriodicOrbit" if is_mass else "MechanicalOrbit"
        raise TypeError(f"attractors must be zivi.{name}, got {orbit!r}")
    rows = np.column_stack([orbit.impacts["t"] / orbit.period % 1.0, orbit.impacts["u"]])
    if isinstance(orbit, MechanicalOrbit):
        return attractor_of(orbit.kind, orbit.multiple, rows, orbit.impacts["gap"])
    if orbit.kind == "resting":
        return Attractor("resting", orbit.multiple, rows[:1])
    return Attractor(orbit.kind, orbit.multiple, rows[np.argsort(rows[:, 0])])
