"""The unknowns of a fit: names, bounds, prior knowledge, and what each experiment has of them."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from zivi.base.check import Array, finite, real_array
from zivi.base.extras import needed
from zivi.base.habits import closest
from zivi.derivatives.parameter_runs import run_of
from zivi.estimation.data import Experiment
from zivi.system.mechanism import MechanicalSystem

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
