"""Bifurcation diagrams by brute force: what runs settle on over a parameter."""

from __future__ import annotations

import dataclasses
from os import PathLike
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from zivi.base.check import Array, integer, real_array
from zivi.base.habits import hinted
from zivi.base.plain import listed_by
from zivi.base.table import Field, Table, Tabulated
from zivi.orbits.along import with_failed
from zivi.orbits.attractor import Attractor
from zivi.orbits.mechanical.family import value_of
from zivi.orbits.mechanical.plan import MechanicalPlan, number_of, read_states
from zivi.orbits.plan import Found, MassPlan, Plan
from zivi.simulation.methods import SwitchedRK
from zivi.system.mass import ImpactSystem
from zivi.system.mechanism import MechanicalSystem
from zivi.system.parameters import check_newton, parameter

__all__ = ["Diagram", "bifurcation_diagram"]

USUAL = SwitchedRK(rtol=1e-8, atol=1e-10)
OPEN = ("irregular", "failed")
"""Kinds of what a run did that are no periodic motion."""
FIELDS: dict[str, Field] = {
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
        """Which runs rest, for good or again and again."""
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
        """What the runs settled on, and how many of them on nothing."""
        failed = self._failed_text()
        if not failed:
            return "Every run settled on a periodic motion, or rests."
        advice = "irregular ones may be chaotic, or need a longer transient"
        return with_failed("", f"{failed}; {advice}").strip()

    def _table(self) -> Table:
        """Tell the points over ``point``, what each run settled on over ``run``."""
        first, second = SECTIONS[self.section]
        fields = {self.name: ("point", "", "parameter"), **first, **second, **FIELDS}
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
        return Table("Bifurcation diagram", fields, {}, values)


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
    """Simulate over values of a parameter, and note what the runs settle on.

    Forces and models that need no interpreter run as batches on all cores. With `out` or
    `executor` it is a study: it can be stopped and continues, in processes, or on Dask.

    Parameters
    ----------
    system : ImpactSystem or MechanicalSystem
        A system with a periodic excitation.
    name : str
        The parameter, as in `sensitivity`; of a mechanical system as in `continue_orbit`.
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
        states, plan = _of_mechanism(common, given, gap, coordinate)
    else:
        if gap is not None or coordinate is not None:
            raise ValueError("gap and coordinate are for a zivi.MechanicalSystem")
        states, plan = _of_mass(common, given)
    if follows:
        found = plan.following(grid, states[0])
    elif out is not None or executor is not None:
        found = plan.study(grid, states, out, executor, progress)
    else:
        found = plan.batch(grid, states, threads, progress)
    return _diagram(plan, np.repeat(grid, len(states)), len(states), found)


def _of_mass(common: Any, given: Array | None) -> tuple[Array, Plan]:
    check_newton(common[0])
    parameter(common[0], common[1])
    states = np.atleast_2d([1.0, 0.0] if given is None else given)
    if states.ndim != 2 or states.shape[1] != 2:
        raise ValueError(f"starts must have rows (x0, xdot0), got shape {states.shape}")
    return states, MassPlan(*common)


def _of_mechanism(
    common: Any, given: Array | None, gap: str | None, coordinate: str | None
) -> tuple[Array, Plan]:
    system: MechanicalSystem = common[0]
    value_of(system, common[1])
    if given is None:
        if system._n is None:
            raise ValueError("starts must be given: the system does not tell its coordinates")
        given = np.zeros((2, system._n))
    states = read_states("starts", given)
    names = system.coordinate_names(states.shape[2])
    of_gap = number_of("gap", gap, system.gap_names)
    of_coordinate = number_of("coordinate", coordinate, names) or 0
    plan = MechanicalPlan(*common)
    return states, dataclasses.replace(plan, gap=of_gap, coordinate=of_coordinate)


def _diagram(plan: Plan, values: Array, n_starts: int, found: list[Found]) -> Diagram:
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
