"""Unknowns of a fit, and runs at trial values of them."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from zivi.base.check import Array, finite, real_array
from zivi.base.extras import needed
from zivi.base.habits import closest
from zivi.derivatives.mechanical_sensitivity import Moved, run_of
from zivi.derivatives.sensitivity import sensitivity
from zivi.estimation.data import Data, Experiment, Record
from zivi.simulation.methods import SwitchedRK
from zivi.simulation.run import simulate
from zivi.system.mass import ImpactSystem
from zivi.system.mechanism import MechanicalSystem
from zivi.system.parameters import parameter

# The unknowns of a fit: names, bounds, prior knowledge, and what each experiment has of them.


WIDE = 4.0
"""Starts of an unbounded parameter lie within this factor of its value."""
GROUPS = ("q0", "qdot0")


@dataclasses.dataclass(frozen=True, eq=False)
class Unknowns:
    """The parameters of a fit as a vector.

    Parameters
    ----------
    names : tuple of str
        Names; a parameter of one of several experiments has its number after ``@``.
    local : tuple of tuple of str
        Names within each experiment.
    places : tuple of ndarray
        Where each experiment has its parameters in the vector.
    lower, upper : ndarray
        Bounds.
    priors : tuple of (int, float, float)
        Place, mean and standard deviation of what is known beforehand.
    """

    names: tuple[str, ...]
    local: tuple[tuple[str, ...], ...]
    places: tuple[Any, ...]
    lower: Array
    upper: Array
    priors: tuple[tuple[int, float, float], ...]

    def __len__(self) -> int:
        return len(self.names)

    def clipped(self, p: Array) -> Array:
        """Return values within the bounds."""
        return np.clip(p, self.lower, self.upper)

    def starts(self, given: Array, number: int, seed: int) -> Array:
        """Return initial values: the given ones, then points of a Sobol sequence in the bounds."""
        rows = [self.clipped(given)]
        if number > 1:
            qmc = needed("scipy.stats.qmc", "fits with several starts")
            engine = qmc.Sobol(len(self), seed=seed)
            unit = engine.random_base2(int(np.ceil(np.log2(number))))[: number - 1]
            low, high = self.box(given)
            rows += list(low + unit * (high - low))
        return np.array(rows)

    def sizes(self, given: Array) -> Array:
        """Return the widths of the ranges in which starts lie."""
        low, high = self.box(given)
        return high - low

    def box(self, given: Array) -> tuple[Array, Array]:
        """Return the range of starts: the bounds, or values around the given one."""
        size = np.where(given == 0.0, 1.0, np.abs(given))
        low = np.where(given > 0.0, given / WIDE, given - WIDE * size)
        high = np.where(given < 0.0, given / WIDE, given + (WIDE - 1.0) * size)
        low = np.where(np.isfinite(self.lower), self.lower, np.minimum(low, self.upper - size))
        high = np.where(np.isfinite(self.upper), self.upper, np.maximum(high, low + size))
        return low, high


def expanded(system: Any, experiment: Experiment, names: Sequence[str]) -> list[str]:
    """Return names with ``"q0"`` and ``"qdot0"`` as the names of all coordinates."""
    found: list[str] = []
    for name in names:
        if name in GROUPS and isinstance(system, MechanicalSystem):
            span = (experiment.t0, experiment.end)
            found += run_of(system, span, experiment.y0, (name,)).wrt
        else:
            found.append(name)
    return found


def read_unknowns(
    system: Any,
    experiments: Sequence[Experiment],
    params: Sequence[str] | str,
    own: Sequence[str] | str,
    bounds: Mapping[str, Any] | None,
    prior: Mapping[str, Any] | None,
) -> Unknowns:
    """Read the arguments of `zivi.fit` that name parameters."""
    separate = expanded(system, experiments[0], _names_in("own", own))
    shared = [
        it for it in expanded(system, experiments[0], _names_in("params", params)) if it not in own
    ]
    if not shared and not separate:
        raise ValueError("params must be one or more names of parameters, got none")
    for known in (shared, separate):
        if len(set(known)) != len(known):
            raise ValueError(f"params must be different names, got {tuple(known)}")
    several = len(experiments) > 1
    names, base, places = list(shared), list(shared), []
    for k in range(len(experiments)):
        first = len(names)
        names += [f"{name}@{k}" if several else name for name in separate]
        base += separate
        places.append(np.array([*range(len(shared)), *range(first, len(names))], int))
    lower, upper = _bound_vectors(names, base, bounds or {})
    local = tuple((*shared, *separate) for _ in experiments)
    priors = _priors(names, base, prior or {})
    return Unknowns(tuple(names), local, tuple(places), lower, upper, priors)


def _names_in(argument: str, value: Sequence[str] | str) -> list[str]:
    names = [value] if isinstance(value, str) else list(value)
    if not all(isinstance(name, str) for name in names):
        raise TypeError(f"{argument} must be names of parameters, got {value!r}")
    return names


def _matching(argument: str, key: str, names: Sequence[str], base: Sequence[str]) -> list[int]:
    """Return the places that a key of `bounds` or `prior` names."""
    found = [j for j, name in enumerate(names) if key in (name, base[j])]
    if not found:
        close = closest(key, [*names, *base])
        hint = f"; did you mean {close!r}?" if close else ""
        raise ValueError(f"{argument} must name parameters of the fit, got {key!r}{hint}")
    return found


def _two_numbers(argument: str, key: str, value: ArrayLike) -> tuple[float, float]:
    array = real_array(f"{argument}[{key!r}]", value)
    if array.shape != (2,):
        raise ValueError(f"{argument}[{key!r}] must be a pair of numbers, got {value!r}")
    return float(array[0]), float(array[1])


def _bound_vectors(
    names: Sequence[str], base: Sequence[str], bounds: Mapping[str, Any]
) -> tuple[Array, Array]:
    lower, upper = np.full(len(names), -np.inf), np.full(len(names), np.inf)
    for j, name in enumerate(base):
        if name == "e" or name.startswith(("e.", "e[")):
            lower[j], upper[j] = 0.0, 1.0
    for key, value in bounds.items():
        if not isinstance(value, Sequence | np.ndarray) or len(value) != 2:
            raise ValueError(f"bounds[{key!r}] must be a pair of numbers or None, got {value!r}")
        given = [
            free if it is None else it for it, free in zip(value, (-np.inf, np.inf), strict=True)
        ]
        low, high = _two_numbers("bounds", key, given)
        if not low < high:
            raise ValueError(f"bounds[{key!r}] must increase, got ({low:.6g}, {high:.6g})")
        for j in _matching("bounds", key, names, base):
            lower[j], upper[j] = low, high
    return lower, upper


def _priors(
    names: Sequence[str], base: Sequence[str], prior: Mapping[str, Any]
) -> tuple[tuple[int, float, float], ...]:
    found = []
    for key, value in prior.items():
        mean, sigma = _two_numbers("prior", key, value)
        if not (finite(f"prior[{key!r}][1]", sigma) > 0.0):
            raise ValueError(f"prior[{key!r}] must be (mean, sigma) with sigma > 0, got {value!r}")
        found += [(j, finite("mean", mean), sigma) for j in _matching("prior", key, names, base)]
    return tuple(found)


# Runs at trial values of parameters: what they predict for measurements, with derivatives.


STEP = 1e-4
"""Step of a difference by a parameter, relative to it."""
NEAR = 1e-6
"""Step of a difference of a measured function of the state, relative to the parameter."""
SLOWEST = 1e-6
"""Speed of the slowest impacts that are counted, as a part of the fastest."""
OUTSIDE = (ValueError, ArithmeticError, np.linalg.LinAlgError)
"""What a run at values outside of the model raises."""


class NoRunError(ValueError):
    """There is no run at these values, or it ended early."""


class Prediction(NamedTuple):
    """Predicted values of one data set, and their derivatives."""

    value: Array
    jacobian: Array
    """A row for each value, a column for each parameter of the experiment."""


class Motion:
    """A run and its derivatives, exact or by differences.

    Parameters
    ----------
    moved : tuple
        System, span and initial state.
    trajectory : Trajectory or MechanicalTrajectory
        The run.
    """

    def __init__(self, moved: Moved, trajectory: Any) -> None:
        self.moved, self.trajectory = moved, trajectory

    @property
    def start(self) -> float:
        """Time of the initial state (s)."""
        return self.moved[1][0]

    def states(self, t: Array) -> Array:
        """Return positions and velocities, shape (2, n, k)."""
        return _states_of(self.trajectory, np.maximum(t, self.start))

    def impacts(self, gap: int | None, number: int) -> Array:
        """Return times of impacts of a gap, at least `number` where there are so many."""
        return _impact_times(self.trajectory, gap, number)


class SmoothMotion(Motion):
    """A run with the derivatives of `zivi.sensitivity`."""

    def __init__(self, moved: Moved, columns: Any) -> None:
        super().__init__(moved, columns.trajectory)
        self.by_parameters = columns

    @property
    def width(self) -> int:
        """Number of parameters."""
        return len(self.by_parameters.wrt)

    def columns(self, t: Array) -> Array:
        """Return derivatives of positions and velocities, shape (2, n, m, k)."""
        found = np.asarray(self.by_parameters(np.maximum(t, self.start)))
        found = found[:, None] if found.ndim == 3 else found
        if "t0" in self.by_parameters.wrt and np.any(held := t < self.start):
            found[:, :, self.by_parameters.wrt.index("t0"), held] = 0.0
        return found

    def impact_columns(self, gap: int | None, number: int) -> Array:
        """Return derivatives of the times of `impacts`, shape (k, m)."""
        rows = self.by_parameters.impacts
        if len(rows) < number and _slower(self.trajectory):
            speed = SLOWEST * _fastest(self.trajectory)
            rows = self.by_parameters.impacts_down_to(speed, limit=_most_impacts(number))
        return np.asarray(_of_gap(rows, gap)["dt"])


class DifferencedMotion(Motion):
    """A run with derivatives by central differences of runs."""

    def __init__(
        self, moved: Moved, trajectory: Any, pairs: Sequence[tuple[Motion, Motion]], steps: Array
    ) -> None:
        super().__init__(moved, trajectory)
        self.pairs, self.steps = pairs, steps

    @property
    def width(self) -> int:
        """Number of parameters."""
        return len(self.pairs)

    def differences(self, of: Callable[[Motion], Array]) -> Array:
        """Return derivatives of a quantity of a run, with the parameters last."""
        columns = [of(up) - of(down) for down, up in self.pairs]
        return np.stack(columns, -1) / self.steps

    def columns(self, t: Array) -> Array:
        """Return derivatives of positions and velocities, shape (2, n, m, k)."""
        return np.moveaxis(self.differences(lambda run: run.states(t)), -1, -2)

    def impact_columns(self, gap: int | None, number: int) -> Array:
        """Return derivatives of the times of `impacts`, shape (k, m); NaN for lost impacts."""
        times = [[run.impacts(gap, number) for run in pair] for pair in self.pairs]
        found = np.full((len(self.impacts(gap, number)), len(times)), np.nan)
        for j, (down, up) in enumerate(times):
            k = min(len(down), len(up), len(found))
            found[:k, j] = (up[:k] - down[:k]) / self.steps[j]
        return found


def _states_of(trajectory: Any, t: Array) -> Array:
    found = np.asarray(trajectory(t))
    return found[:, None] if found.ndim == 2 else np.moveaxis(found, -1, 1)


def _fastest(trajectory: Any) -> float:
    rows = trajectory.impacts
    return float(np.max(np.abs(rows["speed_before"]))) if len(rows) else 0.0


def _slower(trajectory: Any) -> bool:
    """Whether there may be slower impacts than those of ``impacts``."""
    return bool(len(trajectory.zeno_times)) and _fastest(trajectory) > 0.0


def _most_impacts(number: int) -> int:
    return 2 * number + 20


def _of_gap(rows: Any, gap: int | None) -> Any:
    if gap is not None:
        return rows[rows["gap"] == gap]
    # rows of one impact of several gaps have one time
    return rows[np.unique(rows["t"], return_index=True)[1]]


def _impact_times(trajectory: Any, gap: int | None, number: int) -> Array:
    rows = trajectory.impacts
    if len(rows) < number and _slower(trajectory):
        speed = SLOWEST * _fastest(trajectory)
        rows = trajectory.impacts_down_to(speed, limit=_most_impacts(number))
    return np.array(_of_gap(rows, gap)["t"])


# Measured quantities.


@dataclasses.dataclass(frozen=True)
class _StateEntry:
    """A coordinate or a velocity."""

    row: int
    index: int

    def predict(self, motion: Any, t: Array, sides: Any) -> Prediction:
        """Return samples of the component."""
        at, columns = motion.states(t), motion.columns(t)
        return Prediction(at[self.row, self.index], columns[self.row, self.index].T)


@dataclasses.dataclass(frozen=True)
class _Function:
    """A function of time and state, of the system at the trial values too."""

    of: Callable[[Any, float, Array, Array], float]

    def predict(self, motion: Any, t: Array, sides: Any) -> Prediction:
        """Return samples, differenced along the derivatives of the state."""
        (q, v), (dq, dv) = motion.states(t), motion.columns(t)
        system = motion.moved[0]

        def value(of: Any, positions: Array, velocities: Array) -> Array:
            rows = zip(t, positions.T, velocities.T, strict=True)
            return np.array([self.of(of, float(time), x, y) for time, x, y in rows])

        columns = np.empty((len(t), motion.width))
        for j, (h, down, up) in enumerate(sides):
            there = value(up, q + h * dq[:, j], v + h * dv[:, j])
            here = value(down, q - h * dq[:, j], v - h * dv[:, j])
            columns[:, j] = (there - here) / (2.0 * h)
        return Prediction(value(system, q, v), columns)


@dataclasses.dataclass(frozen=True)
class _Reaction:
    """The contact force of a gap, by differences of runs."""

    gap: int

    def at(self, motion: Motion, t: Array) -> Array:
        """Return samples of the force."""
        later = np.maximum(t, motion.start)
        return np.asarray(motion.trajectory.resample(later).reactions[:, self.gap])

    def predict(self, motion: Any, t: Array, sides: Any) -> Prediction:
        """Return samples of the force; its derivatives are differences of runs."""
        assert isinstance(motion, DifferencedMotion)
        return Prediction(self.at(motion, t), motion.differences(lambda run: self.at(run, t)))


class _MassReaction(_Reaction):
    """The contact force of one mass at rest on its wall, of unit mass; 0 in flight."""

    def at(self, motion: Motion, t: Array) -> Array:
        """Return samples of the force."""
        later = np.maximum(t, motion.start)
        (x, v), system = np.asarray(motion.trajectory(later)), motion.moved[0]
        w, wdot, bend = np.zeros((3, len(t)))
        if (wall := motion.trajectory._wall) is not None:
            w, wdot, bend = map(np.asarray, wall(later))
        found = np.zeros(len(t))
        for k in np.flatnonzero((x == 0.0) & (v == 0.0)):
            found[k] = bend[k] - system.force(float(later[k]), float(w[k]), float(wdot[k]))
        return found


def _measured_quantity(of: Any, system: Any, n: int) -> Any:
    """Read what a `Record` measures."""
    if isinstance(system, ImpactSystem):
        return _quantity_of_mass(of)
    names, gaps = system.coordinate_names(n), system.gap_names
    if callable(of):
        return _Function(lambda _, t, q, v: float(of(t, q, v)))
    known: dict[str, Any] = {name: _StateEntry(0, i) for i, name in enumerate(names)}
    known |= {f"{name}dot": _StateEntry(1, i) for i, name in enumerate(names)}
    for i, name in enumerate(gaps):
        known.setdefault(name, _Function(_GapValue(i)))
        known[f"reaction.{name}"] = _Reaction(i)
    if len(gaps) == 1:
        known["reaction"] = _Reaction(0)
    return _known(of, known)


def _quantity_of_mass(of: Any) -> Any:
    if callable(of):
        return _Function(lambda _, t, q, v: float(of(t, float(q[0]), float(v[0]))))
    position = _StateEntry(0, 0)
    known = {"x": position, "xdot": _StateEntry(1, 0), "wall": position}
    return _known(of, {**known, "reaction": _MassReaction(0)})


def _known(of: str, known: dict[str, Any]) -> Any:
    if of not in known:
        close = closest(of, known)
        hint = f"; did you mean {close!r}?" if close else ""
        raise ValueError(f"of must be one of {', '.join(known)} or a function, got {of!r}{hint}")
    return known[of]


@dataclasses.dataclass(frozen=True)
class _GapValue:
    """The width of a gap."""

    index: int

    def __call__(self, system: Any, t: float, q: Array, v: Array) -> float:
        return float(system.at(t, q, v).gaps[self.index])


def _gap_number(name: str | None, system: Any) -> int | None:
    if name is None:
        return None
    names = ("wall",) if isinstance(system, ImpactSystem) else system.gap_names
    if name not in names:
        raise ValueError(f"gap must be one of {', '.join(names)}, got {name!r}")
    return int(names.index(name))


# Runs of one experiment.

BIAS = "bias"


class ExperimentRun:
    """The run of an experiment as a function of its parameters.

    Parameters
    ----------
    system : ImpactSystem or MechanicalSystem
        The system as given.
    experiment : Experiment
        Data and initial state.
    names : sequence of str
        Names of the parameters of this experiment.
    method : SwitchedRK
        Tolerances.
    """

    def __init__(
        self, system: Any, experiment: Experiment, names: Sequence[str], method: SwitchedRK
    ) -> None:
        self.experiment, self.method = experiment, method
        self.names = tuple(names)
        known = _bias_names(experiment.data)
        self.biases = [(j, known[name]) for j, name in enumerate(names) if name in known]
        moving = [j for j, name in enumerate(names) if name not in known]
        self.moving = np.array(moving, int)
        span = (experiment.t0, experiment.end)
        chosen = tuple(names[j] for j in moving)
        self.run = run_of(system, span, experiment.y0, chosen)
        n = len(self.run.state[0]) if isinstance(system, MechanicalSystem) else 1
        self.quantities: list[Any] = [
            _measured_quantity(it.of, system, n)
            if isinstance(it, Record)
            else _gap_number(it.gap, system)
            for it in experiment.data
        ]
        self.reason = ""
        if any(isinstance(it, _Reaction) for it in self.quantities):
            self.reason = "contact forces have no derivatives by zivi.sensitivity"
        self.differenced = bool(self.reason)

    def given(self) -> Array:
        """Return the values of the parameters of the system and the initial state as given."""
        values = np.zeros(len(self.names))
        for j, name in zip(self.moving, self._moving_names(), strict=True):
            values[j] = self._given(name)
        return values

    def _moving_names(self) -> tuple[str, ...]:
        return tuple(self.names[j] for j in self.moving)

    def _given(self, name: str) -> float:
        if name == "t0":
            return self.experiment.t0
        run = self.run
        if isinstance(run.system, MechanicalSystem):
            place = self._moving_names().index(name)
            return float(run.columns[place].value)
        starts = {"x0": run.state[0], "xdot0": run.state[1]}
        return float(starts[name]) if name in starts else parameter(run.system, name)

    def motion(self, p: Array, end: float) -> Any:
        """Run with derivatives.

        Raises
        ------
        NoRunError
            If there is no run up to `end` with these values.
        """
        values = p[self.moving]
        moved = self._moved(values, end)
        if not len(values):
            return DifferencedMotion(moved, self._simulated(moved).trajectory, [], np.zeros(0))
        if not self.differenced:
            found = self._smooth(moved)
            if found is not None:
                return found
        return self._by_differences(values, moved, end)

    def _moved(self, values: Array, end: float) -> Moved:
        try:
            system, (start, _), state = self.run.at(values)
        except OUTSIDE as error:
            raise NoRunError(str(error)) from None
        if not start < end:
            raise NoRunError(f"t0 = {start:.6g} s is not before the last time")
        return system, (start, end), state

    def _smooth(self, moved: Moved) -> SmoothMotion | None:
        """Run with exact derivatives; None where there are none."""
        system, span, state = moved
        try:
            found = sensitivity(
                system, span, state, self._moving_names(), self.method, progress=False
            )
        except NotImplementedError as error:
            self.differenced, self.reason = True, str(error).partition(":")[0]
            return None
        except OUTSIDE:  # of a neighbour in a difference, or of the run itself, which will tell
            return None
        if not found.trajectory.success:
            raise NoRunError(found.trajectory.message)
        if np.isnan(found.final).any():
            self.reason = self.reason or "derivatives do not exist through some impacts"
            return None
        return SmoothMotion(moved, found)

    def _simulated(self, moved: Moved) -> Motion:
        system, span, state = moved
        try:
            run = simulate(system, span, state, self.method, progress=False)
        except OUTSIDE as error:
            raise NoRunError(str(error)) from None
        if not run.success:
            raise NoRunError(run.message)
        return Motion(moved, run)

    def _by_differences(self, values: Array, moved: Moved, end: float) -> DifferencedMotion:
        middle = self._simulated(moved)
        steps, pairs = np.empty(len(values)), []
        for j, value in enumerate(values):
            h = STEP * (abs(value) or 1.0)
            ends = []
            for side in (-1.0, 1.0):
                other = values.copy()
                other[j] += side * h
                try:
                    ends.append(self._simulated(self._moved(other, end)))
                except NoRunError:  # a bound of the model: a difference to one side
                    ends.append(middle)
            if ends[0] is middle and ends[1] is middle:
                raise NoRunError(f"no run on either side of {self.names[self.moving[j]]}")
            pairs.append((ends[0], ends[1]))
            steps[j] = h * sum(it is not middle for it in ends)
        return DifferencedMotion(moved, middle.trajectory, pairs, steps)

    def predict_record(self, number: int, p: Array, motion: Any, t: Array) -> Prediction:
        """Predict samples of a `Record` at times."""
        quantity = self.quantities[number]
        sides = self._sides(p[self.moving]) if isinstance(quantity, _Function) else ()
        found = quantity.predict(motion, t, sides)
        return self._with_bias(number, p, found)

    def predict_bounces(self, number: int, p: Array, motion: Any, count: int) -> Prediction:
        """Predict times of impacts, at least `count` where there are so many."""
        gap = self.quantities[number]
        times, columns = motion.impacts(gap, count), motion.impact_columns(gap, count)
        k = min(len(times), len(columns))
        return self._with_bias(number, p, Prediction(times[:k], columns[:k]))

    def _with_bias(self, number: int, p: Array, found: Prediction) -> Prediction:
        columns = np.zeros((len(found.value), len(self.names)))
        columns[:, self.moving] = found.jacobian
        value = found.value
        for j, numbers in self.biases:
            if number in numbers:
                value = value + p[j]
                columns[:, j] = 1.0
        return Prediction(value, columns)

    def _sides(self, values: Array) -> list[tuple[float, Any, Any]]:
        """Return steps of the parameters, and the systems at both ends."""
        found = []
        for j, value in enumerate(values):
            h = NEAR * (abs(value) or 1.0)
            ends = []
            for side in (-h, h):
                other = values.copy()
                other[j] += side
                try:
                    ends.append(self.run.at(other)[0])
                except OUTSIDE:
                    ends.append(self.run.at(values)[0])
            found.append((h, *ends))
        return found


def _bias_names(data: Sequence[Data]) -> dict[str, tuple[int, ...]]:
    """Return the names of sensor biases, and the numbers of their data sets."""
    known = {f"{BIAS}[{k}]": (k,) for k in range(len(data))}
    return {BIAS: tuple(range(len(data))), **known}
