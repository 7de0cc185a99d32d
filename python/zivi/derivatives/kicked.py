"""Derivatives of runs with impulses: products of the derivatives of the intervals between them."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from zivi.base.check import Array
from zivi.derivatives.mechanical_sensitivity import PARAMETER, Q0, QDOT0, T0, columns_of
from zivi.derivatives.result import Nearest, OrbitStatus, Sensitivity
from zivi.simulation.mechanical_run import state_of
from zivi.simulation.run import simulate
from zivi.system.kicks import Kick, KickSchedule
from zivi.system.mass import ImpactSystem
from zivi.system.mechanism import MechanicalSystem
from zivi.system.parameters import codes_of, parameter

STEP = 8e-4
"""Relative step of the differences of kicks: their error of fourth order is that of rounding."""
RANK = (
    OrbitStatus.COMPLETED,
    OrbitStatus.GRAZING,
    OrbitStatus.NOT_DIFFERENTIABLE,
    OrbitStatus.RUN_ENDED,
)


@dataclasses.dataclass(frozen=True, eq=False)
class _Stretch:
    """A run between two kicks.

    Parameters
    ----------
    of : Sensitivity
        Its derivatives by the state at its start, then by the parameters.
    before : ndarray
        Derivatives of these by the columns, of shape (2 n + p, m).
    """

    of: Sensitivity
    before: Array

    def by_columns(self, derivatives: Array) -> Array:
        """Multiply derivatives by state and parameters, along their last axis."""
        known = np.where(np.isnan(derivatives), 0.0, derivatives) @ self.before
        unknown = np.isnan(derivatives).astype(float) @ (self.before != 0.0)
        return np.where(unknown > 0.0, np.nan, known)

    @property
    def end(self) -> Array:
        """Derivatives of the state at its end, of shape (2 n, m)."""
        size = len(self.before)
        return self.by_columns(self.of.final.reshape(-1, size))

    def impacts(self) -> np.ndarray:
        """Return the derivatives of its impacts by the columns."""
        own, m = self.of.resolved_impacts, self.before.shape[1]
        kept = [(name, own.dtype[name]) for name in ("t", "gap") if name in (own.dtype.names or ())]
        rows = np.empty(len(own), [*kept, ("dt", "f8", (m,)), ("du", "f8", (m,))])
        for field, _ in kept:
            rows[field] = own[field]
        rows["dt"], rows["du"] = self.by_columns(own["dt"]), self.by_columns(own["du"])
        return rows

    def closeness(self) -> tuple[Array, list[Nearest | None]]:
        """Return the sum of the inverse radii by column, and the largest contribution."""
        parts = np.abs(self.before) / self.of.radius[:, None]
        largest = np.argmax(parts, axis=0)
        return parts.sum(axis=0), [self.of.limits[int(j)] for j in largest]


@dataclasses.dataclass(frozen=True, eq=False)
class KickedProblem:
    """A run with kicks and its columns, from which derivatives are recomputed."""

    system: Any
    span: tuple[float, float]
    y0: Any
    wrt: tuple[str, ...]
    kicks: Sequence[Kick]
    differentiate: Callable[..., Any]
    settings: dict[str, Any]
    names: tuple[str, ...]
    codes: list[tuple[int, int, int]]
    sizes: Array
    n: int | None

    @property
    def state_names(self) -> list[str]:
        """Derivatives with respect to the state at the start of an interval."""
        if self.n is None:
            return ["x0", "xdot0"]
        return [f"{name}[{i}]" for name in ("q0", "qdot0") for i in range(self.n)]

    def with_wrt(self, wrt: Sequence[str]) -> KickedProblem:
        """Return the same problem for other parameters."""
        given = (self.system, self.span, self.y0, wrt, self.kicks)
        return problem_of(*given, self.differentiate, self.settings)

    def solve(self, dense: bool = False, progress: bool | None = False) -> Sensitivity:
        """Run and return the derivatives."""
        run: dict[str, Any] = {"kicks": self.kicks, "dense_output": dense, "progress": progress}
        method, stops = self.settings["method"], self.settings["tstops"]
        sol: Any = simulate(self.system, self.span, self.y0, method, tstops=stops, **run)
        return self._result(sol, self.stretches(self.span[1]))

    def stretches(self, until: float) -> list[_Stretch]:
        """Return the intervals up to a time, fewer if one ends early."""
        (t0, t1), found = self.span, list[_Stretch]()
        schedule = KickSchedule(self.kicks, self.system, self.n, self.span)
        size, t = 2 * (self.n or 1), t0
        state = np.concatenate([np.atleast_1d(part) for part in self.y0])
        moving, parameters = self._at_start(size)
        own = [name for name, code in zip(self.names, self.codes, strict=True) if code[0] > QDOT0]
        for end in [*schedule.stops[schedule.stops > t0].tolist(), t1]:
            if t > until:
                break
            state, moving = self._kick(schedule, t, state, moving)
            # the start of the run moves no later stretch
            rows = [i for i, name in enumerate(own) if name != "t0" or t == t0]
            stops = self.settings["tstops"]
            of = self.differentiate(
                self.system,
                (t, end),
                (state[0], state[1]) if self.n is None else (state[: self.n], state[self.n :]),
                [*self.state_names, *(own[i] for i in rows)],
                **self.settings | {"tstops": stops[(stops > t) & (stops < end)]},
                dense_output=False,
                progress=False,
            )
            found.append(_Stretch(of, np.concatenate([moving, parameters[rows]])))
            if not of.trajectory.success:
                break
            moving, t, state = found[-1].end, end, _last_state(of.trajectory, self.n)
        return found

    def _at_start(self, size: int) -> tuple[Array, Array]:
        """Return derivatives of the initial state and of the parameters by the columns."""
        own = [k for k, code in enumerate(self.codes) if code[0] > QDOT0]
        moving, parameters = np.zeros((size, len(self.codes))), np.eye(len(self.codes))[own]
        for k, (kind, i, _) in enumerate(self.codes):
            if kind in (Q0, QDOT0):
                moving[i + (kind == QDOT0) * (size // 2), k] = 1.0
        return moving, parameters

    def _kick(
        self, schedule: KickSchedule, t: float, state: Array, moving: Array
    ) -> tuple[Array, Array]:
        """Return the state and its derivatives after the kicks at a time."""
        half = len(state) // 2

        def after(schedule: KickSchedule, state: Array) -> Array:
            at = state if self.n is None else (state[:half], state[half:])
            velocity = schedule.after(t, *at)
            return np.asarray(state[half:] if velocity is None else velocity).reshape(half)

        if t not in schedule.at:
            return state, moving
        jacobian = np.eye(2 * half)
        if schedule.depends_on_state(t):
            for j, value in enumerate(state.tolist()):
                unit = np.eye(2 * half)[j]
                jacobian[half:, j] = _slope(
                    lambda h, unit=unit: after(schedule, state + h * unit), max(1.0, abs(value))
                )
        moving = jacobian @ moving
        for k, (kind, *_) in enumerate(self.codes):
            if kind == PARAMETER and schedule.depends_on_mass(t):
                name, value = self.names[k], self.system.parameters[self.names[k]]

                def moved(h: float, name: str = name, value: float = value) -> Array:
                    system = self.system.replace(**{name: value + h})
                    return after(KickSchedule(self.kicks, system, self.n, self.span), state)

                moving[half:, k] += _slope(moved, self.sizes[k])
        return np.concatenate([state[:half], after(schedule, state)]), moving

    def _result(self, sol: Any, stretches: list[_Stretch]) -> Sensitivity:
        m, last = len(self.codes), stretches[-1]
        impacts = np.concatenate([it.impacts() for it in stretches])
        own = sol.resolved_impacts["t"]
        if len(own) == len(impacts):  # the same to the tolerances
            impacts["t"] = own
        closest, nearest = np.zeros(m), np.full(m, -1.0)
        limits: list[Nearest | None] = [None] * m
        for stretch in stretches:
            inverse, kinds = stretch.closeness()
            closest = np.maximum(closest, inverse)
            for k in np.flatnonzero(inverse > np.maximum(nearest, 0.0)):
                nearest[k], limits[k] = inverse[k], kinds[k]
        status = max((it.of.status for it in stretches), key=RANK.index)
        if not sol.success:
            status = OrbitStatus.RUN_ENDED
        with np.errstate(divide="ignore"):
            radius = 1.0 / closest
        of: Any = type(last.of)
        result: Sensitivity = of(
            trajectory=sol,
            wrt=self.names,
            final=last.end.reshape(*last.of.final.shape[:-1], m),
            resolved_impacts=impacts,
            zeno_times=np.concatenate([it.by_columns(it.of.zeno_times) for it in stretches]),
            liftoff_times=np.concatenate([it.by_columns(it.of.liftoff_times) for it in stretches]),
            radius=radius,
            limits=limits,
            status=status,
            n_slopes=sum(it.of.n_slopes for it in stretches),
            _problem=self,
            **({} if self.n is None else self._of_contacts(sol, stretches)),
        )
        return result

    def _of_contacts(self, sol: Any, stretches: list[_Stretch]) -> dict[str, Any]:
        """Return what the derivatives of mechanisms have besides."""
        lost = [getattr(it.of, "lost_at", None) for it in stretches]
        tables = ("transitions", "transition_times"), ("touchdowns", "touchdown_times")
        return {
            "lost_at": min((t for t in lost if t is not None), default=None),
            **{name: self._times(sol, stretches, table, name) for table, name in tables},
        }

    def _times(self, sol: Any, stretches: list[_Stretch], table: str, name: str) -> Array:
        """Return the derivatives of the times in a table; times of kicks are fixed."""
        kicks, rows = sol.kicks["t"], [np.empty((0, len(self.codes)))]
        for it in stretches:
            derivatives = getattr(it.of, name)
            own = getattr(it.of.trajectory, table)["t"][: len(derivatives)]
            rows.append(it.by_columns(derivatives[~np.isin(own, kicks)]))
        moving = np.concatenate(rows)
        times = getattr(sol, table)["t"]
        at = np.flatnonzero(~np.isin(times, kicks))
        found = np.zeros((len(times), len(self.codes)))
        found[at] = moving if len(at) == len(moving) else np.nan
        return found

    def at(self, times: Array) -> Array:
        """Return the derivatives of positions and velocities at times."""
        stretches = self.stretches(float(np.max(times, initial=self.span[0])))
        starts = np.array([it.of._problem.span[0] for it in stretches])
        which = np.searchsorted(starts, times, side="right") - 1
        shape = stretches[0].of.final.shape[:-1]
        columns = np.empty((*shape, len(self.codes), len(times)))
        for k, stretch in enumerate(stretches):
            here = np.flatnonzero(which == k)
            if len(here):
                found = np.moveaxis(stretch.of._problem.at(times[here]), -1, 0)
                columns[..., here] = np.moveaxis(stretch.by_columns(found), 0, -1)
        return columns

    def ending_within(self, t: float, zeno: float) -> Any:
        """Return the derivatives of a run that ends between an impact and its Zeno point."""
        last = self.stretches(t)[-1]
        of = last.of._problem.ending_within(t, zeno)
        return dataclasses.replace(of, resolved_impacts=_Stretch(of, last.before).impacts())


def _slope(of: Any, size: float) -> Array:
    """Return the derivative of a function of a displacement, by differences of fourth order."""
    h = STEP * size
    wide, narrow = of(h) - of(-h), of(0.5 * h) - of(-0.5 * h)
    slope: Array = (8.0 * narrow - wide) / (6.0 * h)
    return slope


def _last_state(sol: Any, n: int | None) -> Array:
    if n is None:
        return np.array([sol.x[-1], sol.xdot[-1]])
    return np.concatenate([sol.q[-1], sol.qdot[-1]])


def problem_of(
    system: ImpactSystem | MechanicalSystem,
    span: tuple[float, float],
    y0: Any,
    wrt: Sequence[str],
    kicks: Sequence[Kick],
    differentiate: Callable[..., Any],
    settings: dict[str, Any],
) -> KickedProblem:
    """Read the columns of a run with kicks.

    Raises
    ------
    ValueError
        For an unknown name; for ``"t0"`` with a kick at the start.
    """
    if isinstance(system, MechanicalSystem):
        state: Any = state_of(y0, system._n)
        size = len(state[0])
        model, n = system.model(size), size
        laws = dict(zip(system.gap_names, system.laws, strict=True))
        parameters = system.partials(model, tuple(wrt)).parameters
        coordinates = system.coordinate_names(size)
        given = (span[1] - span[0], laws, coordinates, parameters, system)
        columns = columns_of(wrt, state, *given)
        names = tuple(column.name for column in columns)
        codes = [(*column.code, column.of) for column in columns]
        values = [column.value for column in columns]
    else:
        n, state, names = None, (y0[0], y0[1]), tuple(wrt)
        codes_of(system, names)  # or an error
        kinds = {"x0": (Q0, 0, 0), "xdot0": (QDOT0, 0, 0), "t0": (T0, 0, 0)}
        codes = [kinds.get(name, (PARAMETER, 0, 0)) for name in names]
        starts = {"x0": state[0], "xdot0": state[1], "t0": span[1] - span[0]}
        values = [starts[name] if name in starts else parameter(system, name) for name in names]
    schedule = KickSchedule(kicks, system, n, span)
    if "t0" in names and span[0] in schedule.at:
        raise ValueError(
            f"wrt must not have 't0' with a kick at the start t = {span[0]:g}: a later start "
            "misses the kick"
        )
    sizes = np.array([abs(value) or 1.0 for value in values])
    return KickedProblem(
        system, span, state, tuple(wrt), kicks, differentiate, settings, names, codes, sizes, n
    )


def differentiate_kicked(
    system: Any,
    span: tuple[float, float],
    y0: Any,
    wrt: Sequence[str],
    kicks: Sequence[Kick],
    differentiate: Callable[..., Any],
    settings: dict[str, Any],
    *,
    dense: bool,
    progress: bool | None,
) -> Sensitivity:
    """Implement `zivi.sensitivity` for runs with kicks, by that of the stretches between them."""
    return problem_of(system, span, y0, wrt, kicks, differentiate, settings).solve(dense, progress)
