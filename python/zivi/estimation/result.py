"""The result of a fit: values, deviations, intervals, profiles and bootstraps."""

from __future__ import annotations

import dataclasses
import functools
import pickle
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from zivi.base.check import Array, count, integer
from zivi.base.extras import late
from zivi.base.status import NamedStatus
from zivi.base.table import Field, ResultTable, Tabulated
from zivi.estimation.data import Bounces
from zivi.estimation.resampling import profile_of, resampled
from zivi.estimation.uncertainty import quantile

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


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
        draw = late("zivi.plot.estimates", "draw_fit")
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
        axes: Axes = late("zivi.plot.estimates", "draw_profile")(self, ax)
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
