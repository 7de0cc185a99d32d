"""The result of a fit: values, covariance, intervals, profiles and bootstraps."""

from __future__ import annotations

import dataclasses
import functools
import pickle
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from zivi.base.check import Array, count, integer
from zivi.base.extras import import_attribute, needed
from zivi.base.status import NamedStatus
from zivi.base.table import Field, ResultTable, Tabulated
from zivi.estimation.data import Bounces, Data
from zivi.estimation.runs import NoRunError
from zivi.estimation.search import FitProblem, Optimum, Place

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# Covariance at the optimum, directions that the data do not determine, parameters at bounds.


SINGULAR = 1e8
"""Condition of the scaled Jacobian from which on a direction is undetermined."""
SINGULAR_DIFFERENCED = 1e6
"""The same for a Jacobian of differences."""
PART = 0.1
"""Parameters with this part of the largest entry belong to an undetermined direction."""
NEAR = 0.05
"""Distance from a bound, in standard deviations, below which a parameter is at it."""


@dataclasses.dataclass(frozen=True)
class Uncertainty:
    """Covariance and determinacy from the Jacobian at the optimum.

    Parameters
    ----------
    covariance : ndarray
        Shape (m, m); infinite variances of undetermined parameters, NaN of those at a bound.
    undetermined : tuple of tuple of int
        Groups of parameters that are not determined separately.
    at_bound : dict of int to float
        Parameters at a bound, and the bound.
    """

    covariance: Array
    undetermined: tuple[tuple[int, ...], ...]
    at_bound: dict[int, float]


def estimate(
    p: Array,
    r: Array,
    jacobian: Array,
    bounds: tuple[Array, Array],
    weights: Array | None,
    differenced: bool,
) -> Uncertainty:
    """Return the covariance of least squares.

    Parameters
    ----------
    p : ndarray
        Optimum, shape (m,).
    r, jacobian : ndarray
        Residuals in standard deviations, shape (n,), and their derivatives, (n, m).
    bounds : (ndarray, ndarray)
        Bounds of the parameters.
    weights : ndarray or None
        Derivatives of a robust loss by the squared residuals; None for least squares.
    differenced : bool
        Whether the derivatives are differences.

    Returns
    -------
    Uncertainty

    Notes
    -----
    With a robust loss the covariance is the sandwich estimate of Huber (1967).
    """
    w = np.ones(len(r)) if weights is None else weights
    root = jacobian * np.sqrt(w)[:, None]
    at_bound = _at_bounds(p, jacobian.T @ (w * r), root, bounds)
    free = np.array([j not in at_bound for j in range(len(p))])
    covariance = np.full((len(p), len(p)), np.nan)
    groups: list[tuple[int, ...]] = []
    if np.any(free):
        limit = SINGULAR_DIFFERENCED if differenced else SINGULAR
        inverse, among = _inverse(root[:, free], limit)
        numbers = np.flatnonzero(free)
        groups = [tuple(int(numbers[j]) for j in group) for group in among]
        if weights is not None:
            rows = jacobian[:, free] * (w * r)[:, None]
            finite = np.where(np.isfinite(inverse), inverse, 0.0)
            robust = finite @ (rows.T @ rows) @ finite
            inverse = np.where(np.isfinite(inverse), robust, inverse)
        covariance[np.ix_(free, free)] = inverse
    return Uncertainty(covariance, tuple(groups), at_bound)


def _at_bounds(p: Array, gradient: Array, root: Array, bounds: tuple[Array, Array]) -> Any:
    """Return the parameters that a bound holds, and the bound."""
    sizes = np.linalg.norm(root, axis=0)
    found = {}
    for j, value in enumerate(p):
        near = NEAR / sizes[j] if sizes[j] > 0.0 else 0.0
        near = max(near, 1e-6 * max(1.0, abs(value)))
        for bound, outward in ((bounds[0][j], 1.0), (bounds[1][j], -1.0)):
            if abs(value - bound) <= near and outward * gradient[j] > 0.0:
                found[j] = float(bound)
    return found


def _inverse(root: Array, limit: float) -> tuple[Array, list[list[int]]]:
    """Return the inverse of the normal matrix, and the groups of undetermined columns."""
    sizes = np.linalg.norm(root, axis=0)
    scale = np.where(sizes > 0.0, sizes, 1.0)
    _, s, vt = np.linalg.svd(root / scale, full_matrices=True)
    s = np.concatenate([s, np.zeros(len(vt) - len(s))])
    poor = s * limit <= max(s[0], 1e-300)
    inverse = (vt[~poor].T / s[~poor] ** 2) @ vt[~poor] / np.outer(scale, scale)
    groups: list[list[int]] = [[int(j)] for j in np.flatnonzero(sizes == 0.0)]
    for row in vt[poor]:
        row = np.where(sizes > 0.0, np.abs(row), 0.0)
        if np.max(row) > 1e-6:
            group = [int(j) for j in np.flatnonzero(row > PART * np.max(row))]
            if group not in groups:
                groups.append(group)
    for j in {j for group in groups for j in group}:
        inverse[j, j] = np.inf
    return inverse, groups


def quantile(level: float, freedom: float | None) -> float:
    """Return the half-width of a two-sided interval, in standard deviations.

    Normal distribution; Student's distribution with degrees of freedom for an estimated variance.
    """
    special = needed("scipy.special", "fits")
    above = 0.5 + 0.5 * level
    return float(special.ndtri(above) if freedom is None else special.stdtrit(freedom, above))


# Profiles of the likelihood and bootstraps of residuals, from the optimum of a fit.


LONGEST = 4
"""Steps of a profile, as multiples of those that a linear model needs."""


@dataclasses.dataclass
class FitState:
    """State of a fit from which it continues at its optimum.

    Parameters
    ----------
    problem : FitProblem
        Data, runs, and standard deviations.
    optimum : Optimum
        The parameters and the alignment of bounces.
    """

    problem: FitProblem
    optimum: Optimum

    def all_data(self) -> list[Data]:
        """Return the data sets of all experiments."""
        return list(self.problem.data.values())


def profile_of(
    state: FitState, j: int, step: float, reach: float, points: int
) -> tuple[Array, Array, Array]:
    """Walk from the optimum to both sides until the rise of the sum of squares reaches a level.

    Returns
    -------
    values, delta, others : ndarray
        Values of the parameter, rises, and all parameters, in increasing order.
    """
    problem, best = state.problem, state.optimum
    free = np.arange(len(best.p)) != j
    bounds = (problem.unknowns.lower[j], problem.unknowns.upper[j])
    base = _squares(problem, best, free=np.zeros(len(free), bool), p=best.p)[0]
    rows = [(float(best.p[j]), 0.0, best.p)]
    for side in (-1.0, 1.0):
        p = best.p
        for k in range(1, LONGEST * points + 1):
            value = float(np.clip(best.p[j] + side * k * step, *bounds))
            p = np.where(free, p, value)
            try:
                squares, p = _squares(problem, best, free=free, p=p)
            except NoRunError:
                break
            rows.append((value, squares - base, p))
            if squares - base > reach**2 or value in bounds:
                break
    rows.sort(key=lambda row: row[0])
    values, delta, others = zip(*rows, strict=True)
    return np.array(values), np.array(delta), np.array(others)


def _squares(problem: FitProblem, best: Optimum, *, free: Array, p: Array) -> tuple[float, Array]:
    """Return twice the least cost over the free parameters and its location."""
    whole = problem.window(1.0)
    found = problem.least_squares(p, whole, best.alignments, 100, 1e-10, free=free)
    return 2.0 * float(found.cost), found.x


def resampled(state: FitState, n: int, generator: np.random.Generator) -> Array:
    """Return estimates from data with resampled residuals, shape (n, m) or fewer rows."""
    problem, best = state.problem, state.optimum
    whole = problem.window(1.0)
    motions = problem.motions(best.p, whole)
    pool, predicted = {}, {}
    for place in problem.data:
        r, _ = problem.of_data(place, best.p, motions[place.experiment], whole, best.alignments)
        pool[place] = r - np.mean(r)
        predicted[place] = problem.measured[place].copy()
        predicted[place][problem.kept(place, whole, best.alignments)] += (
            r * problem.sigma[place][problem.kept(place, whole, best.alignments)]
        )
    rows = sum(len(r) for r in pool.values())
    wider = np.sqrt(rows / max(rows - len(best.p), 1))
    original, samples = dict(problem.measured), []
    try:
        for _ in range(n):
            for place, r in pool.items():
                problem.measured[place] = _resampled_data(
                    problem, place, predicted[place], wider * r, best, generator
                )
            try:
                found = problem.least_squares(best.p, whole, best.alignments, 100, 1e-8)
            except NoRunError:
                continue
            samples.append(found.x)
    finally:
        problem.measured.update(original)
    return np.array(samples).reshape(-1, len(best.p))


def _resampled_data(
    problem: FitProblem,
    place: Place,
    predicted: Array,
    pool: Array,
    best: Optimum,
    generator: np.random.Generator,
) -> Array:
    kept = problem.kept(place, problem.window(1.0), best.alignments)
    drawn = predicted.copy()
    drawn[kept] += problem.sigma[place][kept] * generator.choice(pool, len(kept))
    return drawn


# The result of a fit: values, deviations, intervals, profiles and bootstraps.


class FitStatus(NamedStatus):
    """How a fit ended.

    Examples
    --------
    >>> zivi.FitStatus.CONVERGED
    <FitStatus.CONVERGED: 0>
    """

    CONVERGED = 0
    """The least squares of the best start converged."""
    NOT_CONVERGED = 1
    """The best start used all its evaluations."""
    INTERRUPTED = 2
    """The fit was interrupted: the result is the best of what was computed."""


def check_level(level: float) -> float:
    """Check a level of confidence."""
    if not (isinstance(level, int | float) and 0.0 < level < 1.0):
        raise ValueError(f"level must be between 0 and 1, got {level!r}")
    return float(level)


FIELDS: dict[str, Field] = {
    "value": ("parameter", "", "estimate"),
    "deviation": ("parameter", "", "standard deviation"),
    "lower": ("parameter", "", "lower end of the 95 % interval"),
    "upper": ("parameter", "", "upper end of the 95 % interval"),
    "covariances": (("parameter", "other"), "", "covariances of the estimates"),
}
COORDS: dict[str, Field] = {
    "parameter": ("parameter", "", "name of the parameter"),
    "other": ("other", "", "name of the other parameter"),
}
"""Dimensions, unit and meaning of what is in the dataset."""


@dataclasses.dataclass(frozen=True, eq=False)
class _Forgotten:
    """Stands for a problem whose functions could not be stored."""

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__"):
            raise AttributeError(name)
        raise ValueError(
            "the functions of this system could not be stored with its fit: profiles and "
            "bootstraps need zivi.fit again"
        )


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class Fit(Tabulated):
    """Parameters estimated from data, with their uncertainty.

    Attributes
    ----------
    names : tuple of str
        Names of the parameters. A parameter that each of several experiments has on its own has
        the number of the experiment after ``@``, as in ``"x0@1"``.
    x : ndarray
        Estimates in the order of `names`, shape (m,).
    covariance : ndarray
        Covariances of the estimates, shape (m, m). The variance of a parameter that is not
        determined is infinite, of one at its bound NaN.
    cost : float
        Half the sum of squares of the residuals in standard deviations (of the robust loss), with
        priors and the costs of missed and spurious bounces.
    found : int
        Number of starts that ended within 0.1 % of this cost.
    starts : int
        Number of starts that were computed.
    start_values, start_costs : ndarray
        Parameters, shape (starts, m), and costs, shape (starts,), at the ends of all starts;
        infinite costs of starts without a run.
    undetermined : tuple of tuple of str
        Groups of parameters that the data do not determine (separately).
    at_bound : dict of str to float
        Parameters at a bound, and the bound.
    notes : tuple of str
        What to know about this fit, in sentences.
    matches : tuple of ndarray
        For each data set of `Bounces` the number of the impact of each time, -1 for spurious ones.
    missed : int
        Number of impacts that were not measured.
    degrees_of_freedom : int
        Number of residuals minus number of parameters.
    sigmas : tuple of ndarray
        Standard deviations of the data, given or estimated.
    differenced : bool
        Whether derivatives are differences of runs.
    trajectories : tuple
        The run of each experiment with the estimates.
    status : FitStatus
        How the fit ended.
    evaluations : int
        Number of evaluations of all runs with derivatives.
    """

    names: tuple[str, ...]
    x: Array
    covariance: Array
    cost: float
    found: int
    starts: int
    start_values: Array
    start_costs: Array
    undetermined: tuple[tuple[str, ...], ...]
    at_bound: dict[str, float]
    notes: tuple[str, ...]
    matches: tuple[NDArray[np.int64], ...]
    missed: int
    degrees_of_freedom: int
    sigmas: tuple[Array, ...]
    differenced: bool
    trajectories: tuple[Any, ...]
    status: FitStatus
    evaluations: int
    _residuals: tuple[Array, ...]
    _scaled: bool
    _bounds: tuple[Array, Array]
    _state: Any

    def __getstate__(self) -> dict[str, Any]:
        """Return what is stored: the problem too, where its functions can be."""
        try:
            pickle.dumps((self._state, self.trajectories))
        except (pickle.PicklingError, AttributeError, TypeError, ValueError):
            return self.__dict__ | {"_state": _Forgotten(), "trajectories": ()}
        return self.__dict__

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)

    @property
    def success(self) -> bool:
        """Whether the least squares of the best start converged."""
        return self.status is FitStatus.CONVERGED

    @property
    def message(self) -> str:
        """How the fit ended, in a sentence."""
        told = {
            FitStatus.CONVERGED: "The least squares converged",
            FitStatus.NOT_CONVERGED: "The least squares did not converge",
            FitStatus.INTERRUPTED: "The fit was interrupted",
        }[self.status]
        return f"{told}; {self.found} of {self.starts} starts found this optimum."

    @property
    def values(self) -> dict[str, float]:
        """Estimates by name."""
        return dict(zip(self.names, map(float, self.x), strict=True))

    @property
    def deviations(self) -> Array:
        """Standard deviations in the order of `names`, shape (m,)."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def std(self) -> dict[str, float]:
        """Standard deviations by name; infinite if not determined, NaN at a bound."""
        return dict(zip(self.names, map(float, self.deviations), strict=True))

    @property
    def trajectory(self) -> Any:
        """The run with the estimates; of several experiments that of the first."""
        return self.trajectories[0]

    @property
    def residuals(self) -> Any:
        """Measured minus predicted values in the unit of the data; a tuple for several data sets.

        NaN for missing samples and spurious bounces.
        """
        return self._residuals[0] if len(self._residuals) == 1 else self._residuals

    def interval(self, level: float = 0.95) -> dict[str, tuple[float, float]]:
        """Return intervals of confidence from the covariance, within the bounds.

        Parameters
        ----------
        level : float
            Level of confidence, between 0 and 1.

        Returns
        -------
        dict of str to (float, float)
            By Student's distribution where the standard deviations of the data were estimated.

        Raises
        ------
        ValueError
            If `level` is out of its range.

        See Also
        --------
        profile : intervals without the assumption that residuals are linear.
        """
        freedom = self.degrees_of_freedom if self._scaled else None
        width = quantile(check_level(level), freedom) * self.deviations
        low = np.maximum(self.x - width, self._bounds[0])
        high = np.minimum(self.x + width, self._bounds[1])
        return {
            name: (float(one), float(other))
            for name, one, other in zip(self.names, low, high, strict=True)
        }

    def profile(self, name: str, *, level: float = 0.99, points: int = 8) -> Profile:
        """Minimise over all other parameters along one of them.

        Parameters
        ----------
        name : str
            The parameter.
        level : float
            Level of confidence that the profile reaches on both sides.
        points : int
            Number of points on each side, at least 3.

        Returns
        -------
        Profile
            The profile of the likelihood, with its interval.

        Raises
        ------
        ValueError
            If the name is none of `names`, an argument is out of range, or the parameter is at a
            bound or not determined.
        """
        if name not in self.names:
            raise ValueError(f"name must be one of {', '.join(self.names)}, got {name!r}")
        if not np.isfinite(self.std[name]):
            why = "at its bound" if name in self.at_bound else "not determined by these data"
            raise ValueError(f"name must be a determined parameter, {name!r} is {why}")
        reach = quantile(check_level(level), self._freedom())
        number = count("points", points, least=3)
        j = self.names.index(name)
        step = float(self.deviations[j]) * reach / number
        values, delta, others = profile_of(self._state, j, step, reach, number)
        return Profile(name, self.names, values, delta, others, self._freedom())

    def bootstrap(self, n: int = 200, seed: int = 0) -> Bootstrap:
        """Fit again to data with resampled residuals.

        Parameters
        ----------
        n : int
            Number of samples, at least 2.
        seed : int
            Seed of the generator.

        Returns
        -------
        Bootstrap
            Estimates of all samples. Alignments of bounces are kept.
        """
        count("n", n, least=2)
        samples = resampled(self._state, n, np.random.default_rng(integer("seed", seed)))
        return Bootstrap(self.names, samples)

    def _freedom(self) -> int | None:
        return self.degrees_of_freedom if self._scaled else None

    def plot(self, figure: Figure | None = None) -> Figure:
        """Plot the data, the run with the estimates, and the residuals.

        Parameters
        ----------
        figure : matplotlib.figure.Figure, optional
            Where to draw; a new figure by default.

        Returns
        -------
        matplotlib.figure.Figure
            A column of two axes for each data set.
        """
        draw = import_attribute("zivi.plot.curves", "draw_fit")
        drawn: Figure = draw(self._drawn(), figure)
        return drawn

    def _drawn(self) -> list[dict[str, Any]]:
        """Return times, data, predictions and residuals of each data set."""
        rows = []
        for data, residual, sigma in zip(
            self._state.all_data(), self._residuals, self.sigmas, strict=True
        ):
            bouncing = isinstance(data, Bounces)
            measured = data.times if bouncing else data.values
            rows.append(
                {
                    "t": data.t,
                    "bounces": bouncing,
                    "label": "bounce" if bouncing else getattr(data.of, "__name__", data.of),
                    "measured": measured,
                    "predicted": measured - residual,
                    "residual": residual / sigma,
                }
            )
        return rows

    @functools.cached_property
    def _lines(self) -> Sequence[str]:
        """Rows of the table that `print` shows."""
        low_high = self.interval()
        width = max(9, *(len(name) for name in self.names))
        lines = [f"{'parameter':<{width}}  {'value':>13}  {'std':>9}  95 % interval"]
        for name, value in self.values.items():
            low, high = low_high[name]
            std = self.std[name]
            lines.append(f"{name:<{width}}  {value:>13.7g}  {std:>9.2g}  {low:.6g} to {high:.6g}")
        return lines

    def __str__(self) -> str:
        return "\n".join([self.message, *self._lines, *self.notes])

    def __repr__(self) -> str:
        names = ", ".join(self.names)
        told = self.status.name.lower()
        return f"<Fit of {names}: {told}, found by {self.found} of {self.starts} starts>"

    def _facts(self) -> Mapping[str, str]:
        told = {name: f"{value:.7g} ± {self.std[name]:.2g}" for name, value in self.values.items()}
        return {"": self.message, **told} | {f"{k + 1}": it for k, it in enumerate(self.notes)}

    def _table(self) -> ResultTable:
        """Declare the table of the parameters."""
        low_high = np.array(list(self.interval().values()))
        values = {
            "value": self.x,
            "deviation": self.deviations,
            "lower": low_high[:, 0],
            "upper": low_high[:, 1],
            "covariances": self.covariance,
            "parameter": list(self.names),
            "other": list(self.names),
        }
        attrs = {
            "status": self.status.name,
            "cost": self.cost,
            "found": self.found,
            "starts": self.starts,
            "notes": " | ".join(self.notes),
        }
        return ResultTable("Fit to data", FIELDS, COORDS, values, attrs, rows="parameter")


@dataclasses.dataclass(frozen=True, eq=False)
class Profile:
    """Likelihood along one parameter, with all others at their optimum.

    Attributes
    ----------
    name : str
        The parameter.
    names : tuple of str
        All parameters.
    values : ndarray
        Values of the parameter, shape (k,), in increasing order.
    delta : ndarray
        Rise of the sum of squares of the residuals in standard deviations, shape (k,).
    others : ndarray
        All parameters along the profile, shape (k, m).
    freedom : int or None
        Degrees of freedom where the standard deviations were estimated.
    """

    name: str
    names: tuple[str, ...]
    values: Array
    delta: Array
    others: Array
    freedom: int | None

    def interval(self, level: float = 0.95) -> tuple[float, float]:
        """Return the interval in which the rise is below its quantile.

        Parameters
        ----------
        level : float
            Level of confidence, between 0 and 1, at most that of the profile.

        Returns
        -------
        (float, float)
            Interpolated; an end of the profile where it does not reach the level.

        Raises
        ------
        ValueError
            If `level` is out of its range.
        """
        z = quantile(check_level(level), self.freedom)
        middle = int(np.argmin(self.delta))
        signed = np.sqrt(np.maximum(self.delta, 0.0))
        low, high = signed[: middle + 1][::-1], signed[middle:]
        left = np.interp(z, np.maximum.accumulate(low), self.values[: middle + 1][::-1])
        right = np.interp(z, np.maximum.accumulate(high), self.values[middle:])
        return float(left), float(right)

    def plot(self, ax: Axes | None = None) -> Axes:
        """Plot the square root of the rise, which is a wedge where residuals are linear.

        Parameters
        ----------
        ax : matplotlib.axes.Axes, optional
            Where to draw; new axes by default.

        Returns
        -------
        matplotlib.axes.Axes
        """
        axes: Axes = import_attribute("zivi.plot.curves", "draw_profile")(self, ax)
        return axes


@dataclasses.dataclass(frozen=True, eq=False)
class Bootstrap:
    """Estimates from data with resampled residuals.

    Attributes
    ----------
    names : tuple of str
        The parameters.
    samples : ndarray
        Estimates, shape (n, m); samples without a run are left out.
    """

    names: tuple[str, ...]
    samples: Array

    @property
    def std(self) -> dict[str, float]:
        """Standard deviations of the samples by name."""
        deviations = np.std(self.samples, axis=0, ddof=1)
        return dict(zip(self.names, map(float, deviations), strict=True))

    def interval(self, level: float = 0.95) -> dict[str, tuple[float, float]]:
        """Return quantiles of the samples.

        Parameters
        ----------
        level : float
            Level of confidence, between 0 and 1.

        Returns
        -------
        dict of str to (float, float)
            By name.

        Raises
        ------
        ValueError
            If `level` is out of its range.
        """
        tail = 0.5 - 0.5 * check_level(level)
        low, high = np.quantile(self.samples, [tail, 1.0 - tail], axis=0)
        return {
            name: (float(one), float(other))
            for name, one, other in zip(self.names, low, high, strict=True)
        }
