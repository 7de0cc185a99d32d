"""Profiles of the likelihood and bootstraps of residuals, from the optimum of a fit."""

from __future__ import annotations

import dataclasses

import numpy as np

from zivi.base.check import Array
from zivi.estimation.data import Data
from zivi.estimation.runs import NoRunError
from zivi.estimation.search import FitProblem, Optimum, Place

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
