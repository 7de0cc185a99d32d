"""Derivatives of a run of a mechanical system, by its state and named parameters."""

from __future__ import annotations

import copy
import dataclasses
import functools
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

import zivi._zivi as _zivi
from zivi.base.check import Array
from zivi.base.extras import ProgressBar
from zivi.base.habits import closest
from zivi.base.machine_code import listening_always
from zivi.base.table import Field, ResultTable
from zivi.derivatives.result import EVENTS, KINDS, Nearest, OrbitStatus, Sensitivity
from zivi.simulation.mechanical_run import RunRequest, closer_of, setup_of, state_of
from zivi.simulation.mechanical_trajectory import MechanicalTrajectory
from zivi.simulation.methods import SwitchedRK
from zivi.simulation.run import pair
from zivi.simulation.run_result import as_raised, with_partial
from zivi.system.impact_law import (
    ImpactLaw,
    NewtonImpact,
    law_parameters,
    law_with,
    restitutions,
)
from zivi.system.mass import ImpactSystem
from zivi.system.mechanism import MechanicalSystem, Model
from zivi.system.parameters import (
    INITIAL,
    ParametricSystem,
    check_planar_friction,
    codes_of,
    contact_numbers,
    friction_numbers,
    with_contact_numbers,
    with_friction_numbers,
    with_value,
)
from zivi.system.start import check_start

if TYPE_CHECKING:
    from zivi.system.model_parts import Partials


# Parameters of the derivatives of a mechanical system: names, numbers, values.

Q0, QDOT0, T0, ALL_E, LAW, PARAMETER, FRICTION, CONTACT = range(8)
"""Kinds of columns, as the extension numbers them."""


@dataclasses.dataclass(frozen=True)
class Column:
    """A derivative by one number.

    Parameters
    ----------
    name : str
        What it is called.
    code : (int, int)
        What it is for the extension.
    value : float
        The number.
    of : int
        Which parameter of an impact law, or number of friction or of a contact law, it is.
    """

    name: str
    code: tuple[int, int]
    value: float
    of: int = 0


def columns_of(
    wrt: Sequence[str],
    state: tuple[Array, Array],
    duration: float,
    laws: Mapping[str, ImpactLaw],
    coordinates: Sequence[str],
    parameters: Mapping[str, float],
    system: MechanicalSystem,
) -> list[Column]:
    """Read the names of columns, ``"q0"`` and ``"qdot0"`` as those of all coordinates.

    Raises
    ------
    ValueError
        For an unknown name, with the names that are known; for one that is given twice.
    """
    single = {"t0": Column("t0", (T0, 0), duration), **_of_laws(laws)}
    groups: dict[str, list[Column]] = {}
    for name, kind, values in (("q0", Q0, state[0]), ("qdot0", QDOT0, state[1])):
        groups[name] = [
            Column(f"{name}.{own}", (kind, i), float(values[i]))
            for i, own in enumerate(coordinates)
        ]
        for i, column in enumerate(groups[name]):
            single[column.name] = column
            single[f"{name}[{i}]"] = column
    own = {
        name: Column(name, (PARAMETER, k), value)
        for k, (name, value) in enumerate(parameters.items())
    }
    rough = _of_friction(system)
    # a parameter does not hide what every system has, but for the one that `replace(e=)` sets
    known = rough | own | single
    if isinstance(system, ParametricSystem) and "e" in own:
        known["e"] = own["e"]
    found: list[Column] = []
    for name in wrt:
        if name in groups:
            found += groups[name]
        elif name in known:
            found.append(known[name])
        else:
            raise ValueError(_unknown_column(name, coordinates, laws, [*parameters, *rough]))
    names = [column.name for column in found]
    if not found or len(set(names)) != len(names):
        raise ValueError(f"wrt must be one or more different names, got {tuple(wrt)!r}")
    return found


def _of_laws(laws: Mapping[str, ImpactLaw]) -> dict[str, Column]:
    """Return the columns by the impact laws: ``e``, ``e.gap``; of others as ``law.gap.e0``."""
    found = {}
    newton = {gap: law.e for gap, law in laws.items() if isinstance(law, NewtonImpact)}
    if newton and len(newton) == len(laws):
        found["e"] = Column("e", (ALL_E, 0), max(newton.values()))
    for i, (gap, law) in enumerate(laws.items()):
        if gap in newton:
            found[f"e.{gap}"] = found[f"e[{i}]"] = Column(f"e.{gap}", (LAW, i), newton[gap])
            continue
        for of, (name, value) in enumerate(law_parameters(law).items()):
            column = Column(f"law.{gap}.{name}", (LAW, i), value, of)
            found[column.name] = column
    return found


def _of_friction(system: MechanicalSystem) -> dict[str, Column]:
    """Return the columns by numbers of friction and contact: ``belt.limit``, ``floor.k``."""
    rough = {
        name: Column(name, (FRICTION, it.channel), it.value, it.kind)
        for name, it in friction_numbers(system).items()
    }
    return rough | {
        name: Column(name, (CONTACT, gap), value, of)
        for name, (gap, of, value) in contact_numbers(system).items()
    }


def _unknown_column(
    name: str,
    coordinates: Sequence[str],
    laws: Mapping[str, ImpactLaw],
    parameters: Sequence[str],
) -> str:
    names = ["q0", "qdot0", *(f"q0.{own}" for own in coordinates)]
    names += [*(f"qdot0.{own}" for own in coordinates), "t0"]
    names += [known for known in _of_laws(laws) if not known.endswith("]")]
    close = closest(name, [*names, *parameters])
    hint = f"; did you mean {close!r}?" if close else ""
    if not (parameters or close):
        hint = (
            "; this system does not have named parameters: use zivi.symbolic.system(..., "
            "parameters={...}) or zivi.ParametricSystem(build, {...})"
        )
    known = ", ".join(dict.fromkeys([*names, *parameters]))
    return f"unknown parameter {name!r}; the parameters are {known}{hint}"


# Derivatives of a run of a mechanical system.

FIELDS: dict[str, Field] = {
    "q": (("coordinate", "wrt"), "", "derivatives of the coordinates at the end"),
    "qdot": (("coordinate", "wrt"), "", "derivatives of the velocities at the end"),
    "impact_dt": (("impact", "wrt"), "", "derivatives of the times of impacts"),
    "impact_du": (("impact", "wrt"), "", "derivatives of the gaps' speeds after impacts"),
    **EVENTS,
}
COORDS: dict[str, Field] = {
    "wrt": ("wrt", "", "parameter"),
    "coordinate": ("coordinate", "", "name of the coordinate"),
    **{
        f"{event}_{name}": (event, unit, f"{meaning} of the {event}")
        for event in ("impact", "zeno", "liftoff")
        for name, unit, meaning in (("t", "s", "time"), ("gap", "", "gap"))
    },
}
"""Dimensions, unit and meaning of what is in the dataset."""

FIELDS_OF_CONTACT: dict[str, Field] = {
    "touchdown_time": (("touchdown", "wrt"), "", "derivatives of the times of touchdown"),
}
COORDS_OF_CONTACT: dict[str, Field] = {
    "touchdown_t": ("touchdown", "s", "time of the touchdown"),
    "touchdown_gap": ("touchdown", "", "gap of the touchdown"),
}

FIELDS_OF_FRICTION: dict[str, Field] = {
    "transition_time": (
        ("transition", "wrt"),
        "",
        "derivatives of the times at which friction changes",
    ),
}
COORDS_OF_FRICTION: dict[str, Field] = {
    "transition_t": ("transition", "s", "time of the transition"),
    "transition_channel": ("transition", "", "channel of the transition"),
}


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class MechanicalSensitivity(Sensitivity):
    """A run of a mechanical system with n coordinates and m gaps, and its derivatives.

    Calling it, ``s(t)``, returns the derivatives of ``(q, qdot)`` at any time of the run, of shape
    (2, n, k) for k columns. In contact they are those of the motion on the surface: across it they
    are zero.

    Attributes
    ----------
    trajectory : MechanicalTrajectory
        The run itself.
    wrt : tuple of str
        What the columns are derivatives by.
    final : ndarray
        Derivatives of ``(q, qdot)`` at the end of the run, at a fixed time, of shape (2, n, k).
    resolved_impacts : structured ndarray
        For each row of ``trajectory.resolved_impacts`` its ``t`` (s) and ``gap``, and the
        derivatives ``dt`` of the time and ``du`` of the gap's speed after it, each of k numbers.
        ``impacts`` has them for those of ``trajectory.impacts``.
    zeno_times : ndarray
        Derivatives of ``trajectory.zeno["t"]``, a row of k numbers for each.
    liftoff_times : ndarray
        Derivatives of ``trajectory.liftoffs["t"]``, the same.
    radius : ndarray
        For each column how far its number may be moved, to first order, before an impact or a
        Zeno point appears or disappears, or passes the end: an estimate, of shape (k,).
    limits : list of Nearest or None
        For each column the event that the radius belongs to.
    status : OrbitStatus
        ``COMPLETED``; ``GRAZING`` when an impact, or the order of two, is decided by the
        tolerances; ``NOT_DIFFERENTIABLE`` where some derivative does not exist, see `lost_at`;
        ``RUN_ENDED``.
    n_slopes : int
        How often the partial derivatives of the system were evaluated.
    lost_at : float or None
        Time from which some column is unknown (NaN): a corner, a simultaneous impact or lift-off
        of coupled gaps, a slip that only touches zero, friction between stick and slip. Where the
        contacts determine the state the columns are known again.
    transition_times : ndarray
        Derivatives of ``trajectory.transitions["t"]``: changes of dry friction.
    touchdown_times : ndarray
        Derivatives of ``trajectory.touchdowns["t"]``: compliant gaps that come into contact.
    """

    trajectory: MechanicalTrajectory  # type: ignore[assignment]
    lost_at: float | None = None
    transition_times: Array = dataclasses.field(default_factory=lambda: np.empty((0, 0)))
    touchdown_times: Array = dataclasses.field(default_factory=lambda: np.empty((0, 0)))

    @functools.cached_property
    def monodromy(self) -> Array:
        """Derivative of the final state by the initial one, of shape (2 n, 2 n): q, then qdot.

        Taken from the run where the whole initial state is among its columns, else computed once.
        """
        n = self.final.shape[1]
        codes: Any = self._problem.codes
        wanted = [(kind, i) for kind in (0, 1) for i in range(n)]
        if all(code in codes for code in wanted):
            columns = [codes.index(code) for code in wanted]
            return self.final[:, :, columns].reshape(2 * n, 2 * n)
        whole: Sensitivity = self._problem.with_wrt(("q0", "qdot0")).solve()
        return whole.final.reshape(2 * n, 2 * n)

    def _table(self) -> ResultTable:
        """Describe the dataset: derivatives over ``wrt``, with names of coordinates and gaps."""
        sol: Any = self.trajectory
        values = {"q": self.final[0], "qdot": self.final[1], **self._values()}
        values["coordinate"] = list(sol.coordinate_names)
        events = {
            "impact": self.impacts,
            "zeno": sol.zeno[: len(self.zeno_times)],
            "liftoff": sol.liftoffs[: len(self.liftoff_times)],
        }
        for event, rows in events.items():
            values[f"{event}_t"] = rows["t"]
            values[f"{event}_gap"] = [sol.gap_names[int(gap)] for gap in rows["gap"]]
        title, attrs = "Derivatives of a run of a mechanical system", {"status": self.status.name}
        fields, coords = dict(FIELDS), dict(COORDS)
        if len(self.touchdown_times):
            contacts = sol.touchdowns[: len(self.touchdown_times)]
            values["touchdown_time"], values["touchdown_t"] = self.touchdown_times, contacts["t"]
            values["touchdown_gap"] = [sol.gap_names[int(gap)] for gap in contacts["gap"]]
            fields, coords = fields | FIELDS_OF_CONTACT, coords | COORDS_OF_CONTACT
        if not sol.channel_names:
            return ResultTable(title, fields, coords, values, attrs, rows="wrt")
        changes = sol.transitions[: len(self.transition_times)]
        values["transition_time"], values["transition_t"] = self.transition_times, changes["t"]
        values["transition_channel"] = [sol.channel_names[int(c)] for c in changes["channel"]]
        fields, coords = fields | FIELDS_OF_FRICTION, coords | COORDS_OF_FRICTION
        return ResultTable(title, fields, coords, values, attrs, rows="wrt")


@dataclasses.dataclass(frozen=True, eq=False)
class _Problem:
    """A run with its parameters."""

    system: MechanicalSystem
    model: Model
    partials: Partials
    span: tuple[float, float]
    state: tuple[Array, Array]
    columns: list[Column]
    method: SwitchedRK
    errsens: bool
    stops: Array

    def __getstate__(self) -> dict[str, Any]:
        # compiled models do not travel: they are made again of the system
        state = {field.name: getattr(self, field.name) for field in dataclasses.fields(self)}
        return {name: state[name] for name in state if name not in ("model", "partials")}

    def __setstate__(self, state: dict[str, Any]) -> None:
        system: MechanicalSystem = state["system"]
        model: Model = system.model(len(state["state"][0]))
        wanted = [column.name for column in state["columns"]]
        self.__dict__.update(state, model=model, partials=system.partials(model, wanted))

    @functools.cached_property
    def sizes(self) -> Array:
        return np.array([abs(column.value) or 1.0 for column in self.columns])

    @property
    def codes(self) -> list[tuple[int, int, int]]:
        return [(*column.code, column.of) for column in self.columns]

    def with_wrt(self, wrt: Sequence[str]) -> _Problem:
        columns = _read_columns(self.system, self.model, self.partials, self.span, self.state, wrt)
        return dataclasses.replace(self, columns=columns)

    def record(
        self, span: tuple[float, float], times: Array, dense: bool, progress: bool | None = False
    ) -> _zivi.MechanicalSensitivityRecord:
        with ProgressBar(progress, "sensitivity") as bar:
            return _zivi.mechanical_sensitivity(
                self.system.mechanism(self.model),
                self.partials.spec,
                self.method._core,
                span,
                _zivi.Configuration(*self.state),
                wrt=self.codes,
                sizes=self.sizes,
                controlled=self.errsens,
                dense=dense,
                tstops=self.stops,
                times=times,
                progress=bar.report,
            )

    def solve(self, dense: bool = False, progress: bool | None = False) -> MechanicalSensitivity:
        with listening_always() as ear:
            record = self.record(self.span, np.empty(0), dense, progress)
        asked = RunRequest(self.span, *self.state, None, self.stops, [], dense)
        sol = MechanicalTrajectory._from_record(
            record.run,
            self.system,
            self.model,
            setup_of(self.system, self.model, self.method, asked),
            closer_of(self.system, self.method, asked),
        )
        error = record.run.raised
        if error is None and (error := ear.ends(sol.success)):
            sol = as_raised(sol)
        if error is None:
            return self._result(record, sol)
        try:
            raise with_partial(error, sol)
        finally:
            del error, ear

    def _result(
        self, record: _zivi.MechanicalSensitivityRecord, sol: MechanicalTrajectory
    ) -> MechanicalSensitivity:
        k, n = len(self.columns), self.model.layout.n
        dt, du = record.impact_dt.reshape(-1, k), record.impact_du.reshape(-1, k)
        fields = [("t", "f8"), ("gap", "i8"), ("dt", "f8", (k,)), ("du", "f8", (k,))]
        known = sol.resolved_impacts
        count = min(len(dt), len(known))  # the last may lack them in a run that ended early
        impacts = np.empty(count, fields)
        impacts["t"], impacts["gap"] = known["t"][:count], known["gap"][:count]
        impacts["dt"], impacts["du"] = dt[:count], du[:count]
        limits = [it and Nearest(KINDS[it.limit], it.t, it.depth) for it in record.nearest]
        status = OrbitStatus.GRAZING if record.grazing else OrbitStatus.COMPLETED
        if record.lost_at is not None:
            status = OrbitStatus.NOT_DIFFERENTIABLE
        final = np.stack([record.q.reshape(k, n).T, record.qdot.reshape(k, n).T])
        return MechanicalSensitivity(
            trajectory=sol,
            wrt=tuple(column.name for column in self.columns),
            final=final,
            resolved_impacts=impacts,
            zeno_times=record.zeno_times.reshape(-1, k),
            liftoff_times=record.liftoff_times.reshape(-1, k),
            transition_times=record.transition_times.reshape(-1, k),
            touchdown_times=record.touchdown_times.reshape(-1, k),
            radius=record.radius,
            limits=limits,
            status=status if sol.success else OrbitStatus.RUN_ENDED,
            n_slopes=record.n_slopes,
            lost_at=record.lost_at,
            _problem=self,
        )

    def at(self, times: Array) -> Array:
        """Return derivatives at times, of shape (2, n, k, number of times)."""
        k, n = len(self.columns), self.model.layout.n
        order = np.argsort(times, kind="stable")
        record = self.record(self.span, np.ascontiguousarray(times[order]), dense=False)
        if (error := record.run.raised) is not None:
            raise error
        columns = np.empty((2, n, k, len(times)))
        found = record.samples.reshape(-1, 2, k, n).transpose(1, 3, 2, 0)
        columns[..., order] = found
        lost = np.inf if record.lost_at is None else record.lost_at
        for j in np.flatnonzero(np.isnan(columns).any(axis=(0, 1, 2))):
            # where the impacts accumulate the run goes from one to the next, up to there
            if times[j] < lost:
                columns[..., j] = self._ending_at(float(times[j]))
        return columns

    def ending_within(self, t: float, zeno: float) -> MechanicalSensitivity:
        """Run up to a time shortly after an impact of an accumulation, from impact to impact."""
        return dataclasses.replace(self, span=(self.span[0], t + 0.25 * (zeno - t))).solve()

    def _ending_at(self, t: float) -> Array:
        k, n = len(self.columns), self.model.layout.n
        record = self.record((self.span[0], t), np.empty(0), dense=False)
        return np.stack([record.q.reshape(k, n).T, record.qdot.reshape(k, n).T])


def _read_columns(
    system: MechanicalSystem,
    model: Model,
    partials: Partials,
    span: tuple[float, float],
    state: tuple[Array, Array],
    wrt: Sequence[str],
) -> list[Column]:
    names = system.coordinate_names(model.layout.n)
    laws = dict(zip(system.gap_names, system.laws, strict=True))
    return columns_of(wrt, state, span[1] - span[0], laws, names, partials.parameters, system)


def differentiate_mechanical(
    system: MechanicalSystem,
    span: tuple[float, float],
    y0: Any,
    wrt: Sequence[str],
    method: SwitchedRK,
    *,
    errsens: bool,
    stops: Array,
    dense: bool,
    progress: bool | None,
) -> MechanicalSensitivity:
    """Implement `zivi.sensitivity` for mechanical systems: check, run and return the result."""
    state = state_of(y0, system._n)
    model: Model = system.model(len(state[0]))
    check_start(system, model, span, *state)
    partials = system.partials(model, wrt)
    columns = _read_columns(system, model, partials, span, state, wrt)
    problem = _Problem(system, model, partials, span, state, columns, method, errsens, stops)
    return problem.solve(dense, progress)


# Runs whose system and initial state are functions of named parameters.


Moved: TypeAlias = tuple[Any, tuple[float, float], Any]
"""A system, a span and a start."""


@dataclasses.dataclass(frozen=True)
class SmoothMassRun:
    """A run of one mass."""

    system: ImpactSystem
    span: tuple[float, float]
    state: tuple[float, float]
    wrt: tuple[str, ...]

    def at(self, p: Array) -> Moved:
        """Return the run at values of its parameters; a ValueError for one out of its range."""
        given = dict(zip(self.wrt, map(float, p), strict=True))
        system, (x0, v0) = self.system, self.state
        for name, value in given.items():
            if name not in INITIAL:
                system = with_value(system, name, value)
        start = given.get("t0", self.span[0])
        return system, (start, self.span[1]), (given.get("x0", x0), given.get("xdot0", v0))


@dataclasses.dataclass(frozen=True)
class MechanicalRun:
    """A run of a mechanical system."""

    system: MechanicalSystem
    span: tuple[float, float]
    state: tuple[Array, Array]
    columns: tuple[Column, ...]

    @property
    def wrt(self) -> tuple[str, ...]:
        """Names of the parameters, one for each coordinate."""
        return tuple(column.name for column in self.columns)

    def at(self, p: Array) -> Moved:
        """Return the run at values of its parameters; a ValueError for one out of its range."""
        start, state = self.span[0], (self.state[0].copy(), self.state[1].copy())
        laws: list[ImpactLaw] = list(self.system.laws)
        parameters: dict[str, float] = {}
        rough: dict[str, float] = {}
        soft: dict[str, float] = {}
        for column, value in zip(self.columns, map(float, p), strict=True):
            kind, i = column.code
            if kind <= QDOT0:
                state[kind][i] = value
            elif kind == T0:
                start = value
            elif kind == ALL_E:
                laws = [_law_moved(law, "e", value - column.value) for law in laws]
            elif kind == LAW:
                name = list(law_parameters(laws[i]))[column.of]
                laws[i] = _law_moved(laws[i], name, value - column.value)
            elif kind == PARAMETER:
                parameters[column.name] = value
            elif kind == FRICTION:
                rough[column.name] = value
            elif kind == CONTACT:
                soft[column.name] = value
        system = with_friction_numbers(self.system, rough)
        system = with_contact_numbers(system, soft)
        if parameters:
            system = system.replace(**parameters)
        if tuple(laws) != self.system.laws:
            system = _with_laws(system, tuple(laws))
        return system, (start, self.span[1]), state


def _law_moved(law: ImpactLaw, name: str, by: float) -> ImpactLaw:
    """Return a law with one parameter moved; "e" and "e.floor" may move the same one."""
    return law_with(law, name, law_parameters(law)[name] + by)


def _with_laws(system: MechanicalSystem, laws: tuple[ImpactLaw, ...]) -> MechanicalSystem:
    """Return the same system with other impact laws."""
    if isinstance(system, ParametricSystem):
        build = functools.partial(_built, system._build, laws)
        return ParametricSystem(build, system.parameters)
    other = copy.copy(system)
    other._e = restitutions(laws, system.m)
    return other


def _built(build: Any, laws: tuple[ImpactLaw, ...], **parameters: float) -> MechanicalSystem:
    return _with_laws(build(**parameters), laws)


def smooth_run(system: Any, span: tuple[float, float], y0: Any, wrt: tuple[str, ...]) -> Any:
    """Check that a run has derivatives, and return it as `run_of`."""
    check_planar_friction(system)
    return run_of(system, span, y0, wrt)


def run_of(system: Any, span: tuple[float, float], y0: Any, wrt: tuple[str, ...]) -> Any:
    """Check the initial state and the names, and return the run."""
    if not isinstance(system, MechanicalSystem):
        codes_of(system, wrt)
        return SmoothMassRun(system, span, pair("y0", y0, "(x0, xdot0)"), wrt)
    state = state_of(y0, system._n)
    model = system.model(len(state[0]))
    columns = columns_of(
        wrt,
        state,
        span[0],
        dict(zip(system.gap_names, system.laws, strict=True)),
        system.coordinate_names(model.layout.n),
        _model_parameters(system),
        system,
    )
    return MechanicalRun(system, span, state, tuple(columns))


def _model_parameters(system: MechanicalSystem) -> Mapping[str, float]:
    found: Mapping[str, float] = getattr(system, "parameters", {})
    return found
