"""Measurements of a run: samples of a quantity, times of impacts, and experiments of several."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from zivi.base.check import Array, finite, real_array

Quantity: TypeAlias = "str | Callable[[float, Any, Any], float]"
"""What a `Record` measures."""
PENALTY = 3.0
"""Cost of a missed or spurious bounce, in standard deviations of a time."""


def set_fields(frozen: Any, *values: Any) -> None:
    """Set the fields of a frozen dataclass in their order."""
    for field, value in zip(dataclasses.fields(frozen), values, strict=True):
        object.__setattr__(frozen, field.name, value)


def _increasing_times(name: str, value: ArrayLike) -> Array:
    array = np.array(real_array(name, value), ndmin=1)
    if array.ndim != 1 or not len(array):
        raise ValueError(f"{name} must be one-dimensional and not empty, got shape {array.shape}")
    if not np.all(np.isfinite(array)):
        raise ValueError(f"{name} must be finite, got {array[~np.isfinite(array)][0]}")
    if np.any(np.diff(array) <= 0.0):
        at = int(np.argmax(np.diff(array) <= 0.0))
        raise ValueError(f"{name} must increase, got {array[at]:.6g} before {array[at + 1]:.6g}")
    array.flags.writeable = False
    return array


def _sigmas_of(sigma: ArrayLike | None, n: int) -> Array | None:
    if sigma is None:
        return None
    array = np.array(real_array("sigma", sigma))
    if array.ndim > 1 or (array.ndim == 1 and len(array) != n):
        raise ValueError(f"sigma must be a number or have {n} entries, got shape {array.shape}")
    if not np.all((array > 0.0) & np.isfinite(array)):
        raise ValueError(f"sigma must be positive and finite, got {np.min(array):.6g}")
    array = np.broadcast_to(array, (n,)).copy()
    array.flags.writeable = False
    return array


@dataclasses.dataclass(frozen=True, eq=False)
class Bounces:
    """Measured times of impacts, some of which may be missed or spurious.

    Parameters
    ----------
    times : array_like
        Times of impacts in increasing order (s).
    sigma : float or array_like, optional
        Standard deviation of a time, > 0 (s). By default it is estimated from the residuals of the
        fit, which starts at 1 % of the median interval.
    gap : str, optional
        Name of the gap whose impacts are heard; by default those of all gaps.
    missed, spurious : float
        Cost of an impact that was not measured and of a time that is no impact, >= 0, in standard
        deviations. Default 3. Impacts after the last time cost nothing.

    Raises
    ------
    ValueError, TypeError
        If an argument is out of its range.

    See Also
    --------
    Record : samples of a quantity.
    zivi.fit : estimates parameters from these data.

    Notes
    -----
    Times and impacts are matched by dynamic programming: in order, with a penalty for each missed
    impact and each spurious time.

    Examples
    --------
    >>> zivi.Bounces([0.452, 1.15, 1.70], sigma=1e-3)
    Bounces(3 times from 0.452 to 1.7 s)
    """

    times: Array
    sigma: Array | None = None
    gap: str | None = None
    missed: float = PENALTY
    spurious: float = PENALTY

    def __init__(
        self,
        times: ArrayLike,
        sigma: ArrayLike | None = None,
        *,
        gap: str | None = None,
        missed: float = PENALTY,
        spurious: float = PENALTY,
    ) -> None:
        t = _increasing_times("times", times)
        if not (gap is None or isinstance(gap, str)):
            raise TypeError(f"gap must be the name of a gap or None, got {gap!r}")
        for name, value in (("missed", missed), ("spurious", spurious)):
            if not finite(name, value) >= 0.0:
                raise ValueError(f"{name} must be >= 0, got {value}")
        set_fields(self, t, _sigmas_of(sigma, len(t)), gap, float(missed), float(spurious))

    def __repr__(self) -> str:
        n = len(self.times)
        return f"Bounces({n} times from {self.times[0]:.6g} to {self.times[-1]:.6g} s)"

    @property
    def t(self) -> Array:
        """Times of the rows (s)."""
        return self.times

    def typical(self) -> Array:
        """Return standard deviations for the first alignment."""
        if self.sigma is not None:
            return self.sigma
        gaps = np.diff(self.times) if len(self.times) > 1 else np.abs(self.times)
        return np.full(len(self.times), 0.01 * float(np.median(gaps)) or 1e-6)


@dataclasses.dataclass(frozen=True, eq=False)
class Record:
    """Measured samples of one quantity of a run.

    Parameters
    ----------
    t : array_like
        Times of the samples in increasing order (s).
    values : array_like
        Measured values, one for each time; NaN where a sample is missing.
    sigma : float or array_like, optional
        Standard deviation of a value, > 0, in the unit of `values`. By default it is estimated from
        the residuals of the fit, which starts from the differences of neighbouring samples.
    of : str or callable
        Measured quantity: a coordinate (``"x"`` for one mass), a velocity (``"xdot"``), a gap by
        its name, ``"reaction"`` (the contact force; ``"reaction.floor"`` of one of several gaps),
        or a function ``f(t, q, qdot) -> float`` of the state. For one mass `q` and `qdot` are
        numbers, ``"wall"`` is its gap, and the reaction is that of unit mass.

    Raises
    ------
    ValueError, TypeError
        If an argument is out of its range.

    See Also
    --------
    Bounces : times of impacts.
    zivi.fit : estimates parameters from these data.

    Notes
    -----
    A sample costs one evaluation of the dense output of the run; derivatives of residuals are those
    of `sensitivity`.

    Examples
    --------
    >>> zivi.Record([0.0, 0.1, 0.2], [1.0, 0.95, 0.80], sigma=2e-3, of="x")
    Record(3 samples of 'x' from 0 to 0.2 s)
    """

    t: Array
    values: Array
    sigma: Array | None = None
    of: Quantity = "x"

    def __init__(
        self,
        t: ArrayLike,
        values: ArrayLike,
        sigma: ArrayLike | None = None,
        of: Quantity = "x",
    ) -> None:
        times = _increasing_times("t", t)
        array = np.array(real_array("values", values), ndmin=1)
        if array.shape != times.shape:
            raise ValueError(f"values must have shape {times.shape} like t, got {array.shape}")
        if np.any(np.isinf(array)):
            raise ValueError("values must be finite or NaN, got an infinite one")
        if not np.any(np.isfinite(array)):
            raise ValueError("values must have a finite entry, got NaN only")
        if not (isinstance(of, str) or callable(of)):
            raise TypeError(f"of must be a name or a function f(t, q, qdot), got {of!r}")
        array.flags.writeable = False
        set_fields(self, times, array, _sigmas_of(sigma, len(times)), of)

    def __repr__(self) -> str:
        of = repr(self.of) if isinstance(self.of, str) else getattr(self.of, "__name__", "f")
        return f"Record({len(self.t)} samples of {of} from {self.t[0]:.6g} to {self.t[-1]:.6g} s)"

    def typical(self) -> Array:
        """Return standard deviations; where none is given, from third differences."""
        if self.sigma is not None:
            return self.sigma
        known = self.values[np.isfinite(self.values)]
        size = float(np.ptp(known)) or float(np.max(np.abs(known))) or 1.0
        noise = 0.0
        if len(known) >= 8:
            # of independent errors, third differences have 20 times the variance
            noise = float(np.median(np.abs(np.diff(known, 3)))) / (0.6745 * np.sqrt(20.0))
        return np.full(len(self.t), max(noise, 1e-6 * size))


Data: TypeAlias = Bounces | Record


@dataclasses.dataclass(frozen=True, eq=False)
class Experiment:
    """Measurements of one run, with the initial state of this run.

    Parameters
    ----------
    data : Bounces, Record or a sequence of them
        Measurements of the same run, by one clock.
    y0 : (float, float) or (array_like, array_like)
        Initial state, as for `zivi.simulate`.
    t0 : float
        Time of the initial state by the clock of the data (s). Default 0. Samples before `t0`
        are compared with the initial position: the body is held until then.

    Raises
    ------
    ValueError, TypeError
        If an argument is out of its range.

    See Also
    --------
    zivi.fit : accepts a list of experiments.

    Notes
    -----
    Each experiment costs a run and its sensitivities in each iteration of the fit.

    Examples
    --------
    >>> low = zivi.Experiment(zivi.Bounces([0.452, 1.15]), y0=(1.0, 0.0))
    >>> low.t0
    0.0
    """

    data: tuple[Data, ...]
    y0: Any
    t0: float = 0.0

    def __init__(self, data: Data | Sequence[Data], y0: Any, t0: float = 0.0) -> None:
        rows = (data,) if isinstance(data, Bounces | Record) else tuple(data)
        if not rows or not all(isinstance(it, Bounces | Record) for it in rows):
            raise TypeError(
                f"data must be a zivi.Bounces, a zivi.Record or a list of them, got {data!r}; "
                "times of impacts are zivi.Bounces(times)"
            )
        start = finite("t0", t0)
        last = max(it.t[-1] for it in rows)
        if not start < last:
            raise ValueError(f"t0 must be before the last time, {last:.6g} s, got {start:.6g}")
        set_fields(self, rows, y0, start)

    @property
    def end(self) -> float:
        """Last time of the data (s)."""
        return float(max(it.t[-1] for it in self.data))


def as_experiments(data: Any, y0: Any, t0: float) -> tuple[Experiment, ...]:
    """Read the argument `data` of `zivi.fit`."""
    if isinstance(data, Experiment):
        data = (data,)
    elif isinstance(data, Bounces | Record):
        data = [data]
    elif not isinstance(data, Sequence) or not data:
        raise TypeError(
            "data must be a zivi.Bounces, a zivi.Record, a zivi.Experiment or a list of them, "
            f"got {data!r}"
        )
    if all(isinstance(it, Experiment) for it in data):
        if y0 is not None:
            raise TypeError("y0 must be None where data are zivi.Experiment: each has its own y0")
        return tuple(data)
    if y0 is None:
        raise TypeError("y0 must be given, the initial state (x0, xdot0) or (q0, qdot0)")
    return (Experiment(data, y0, t0),)
