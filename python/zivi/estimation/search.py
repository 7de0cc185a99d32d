"""Least squares over growing windows of the data, with alignment of impacts."""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from zivi.base.check import Array
from zivi.base.extras import needed
from zivi.estimation.data import Bounces, Data
from zivi.estimation.runs import ExperimentRun, NoRunError, Unknowns

# Alignment of measured times of impacts with predicted ones, some missed and some spurious.


SPURIOUS = -1
"""Index of a measured time that is no impact."""
Indices = NDArray[np.int64]


@dataclasses.dataclass(frozen=True, eq=False)
class Alignment:
    """Which predicted impact belongs to each measured time.

    Parameters
    ----------
    index : ndarray
        Number of the predicted impact, `SPURIOUS` for none.
    missed : int
        Predicted impacts before the last measured time that were not measured.
    """

    index: Indices
    missed: int

    @property
    def spurious(self) -> int:
        """Number of spurious times."""
        return int(np.count_nonzero(self.index == SPURIOUS))


def align(
    measured: Array, predicted: Array, sigma: Array, missed: float, spurious: float
) -> Alignment:
    """Align two increasing sequences at the least sum of squares, by dynamic programming.

    Parameters
    ----------
    measured, predicted : ndarray
        Times of n and m impacts (s).
    sigma : ndarray
        Standard deviations of the measured times, shape (n,) (s).
    missed, spurious : float
        Costs of a predicted time without a measured one, and of a measured time without a
        predicted one, in standard deviations. Predicted times after the last measured one cost
        nothing.

    Returns
    -------
    Alignment
        Indices into `predicted`.
    """
    n, m = len(measured), len(predicted)
    skip, alone = missed**2, spurious**2
    steps = skip * np.arange(m + 1)
    cost = np.empty((n + 1, m + 1))
    cost[0] = steps
    for i in range(n):
        apart = ((predicted - measured[i]) / sigma[i]) ** 2
        best = cost[i] + alone
        best[1:] = np.minimum(best[1:], cost[i, :-1] + apart)
        # a missed one is a step along the row: the running minimum of what is left without them
        cost[i + 1] = np.minimum.accumulate(best - steps) + steps
    late = int(np.searchsorted(predicted, measured[-1])) if n else 0
    rest = skip * np.maximum(late - np.arange(m + 1), 0)
    j = int(np.argmin(cost[n] + rest))
    index = np.full(n, SPURIOUS)
    i = n
    while i > 0:
        if j > 0 and cost[i, j] >= cost[i, j - 1] + skip - 1e-9 * (1.0 + cost[i, j]):
            j -= 1
            continue
        apart_j = ((predicted[j - 1] - measured[i - 1]) / sigma[i - 1]) ** 2 if j > 0 else np.inf
        if j > 0 and cost[i - 1, j - 1] + apart_j <= cost[i - 1, j] + alone:
            index[i - 1] = j - 1
            j -= 1
        i -= 1
    return counted_missed(index, late)


def counted_missed(index: Indices, late: int) -> Alignment:
    """Return an alignment with its missed impacts, of `late` before the last measured time."""
    used = index[index != SPURIOUS]
    due = max(late, int(used[-1]) + 1 if len(used) else 0)
    return Alignment(index, due - len(used))


LONGEST = 12
"""Measured times whose indices are enumerated."""
RATIOS = np.concatenate([np.linspace(0.05, 0.85, 25), np.linspace(0.87, 0.995, 10)])
FINE = np.linspace(-0.035, 0.035, 15)
"""Ratios around the best of `RATIOS`."""
ROUGH = 0.01
"""Misfit of a geometric sequence that drag and gravity cause, of the median interval."""


def geometric_indices(
    measured: Array, sigma: Array, penalty: float, number: int, *, most: int = 3
) -> list[Indices]:
    """Return likely indices of the first measured times, without a model of the motion.

    Times of a body that bounces to rest are nearly ``a - b r**k``, with the coefficient of
    restitution r: a missed impact shows as the sum of two intervals. All sets of at most `most`
    missed and one spurious time are compared by the misfit of this sequence.

    Parameters
    ----------
    measured, sigma : ndarray
        Times and their standard deviations (s).
    penalty : float
        Cost of a missed or a spurious time, in standard deviations.
    number : int
        At most so many candidates.
    most : int
        Largest number of missed impacts.

    Returns
    -------
    list of ndarray
        Indices of the first measured times from 0, the likeliest first.
    """
    n = min(len(measured), LONGEST)
    if n < 4:
        return []
    t = measured[:n]
    rough = np.hypot(sigma[:n], ROUGH * float(np.median(np.diff(t))))
    found: list[tuple[float, Indices]] = []
    for alone in range(-1, n):
        kept = np.arange(n) != alone
        candidates = _increasing(int(kept.sum()), most)
        extra = penalty**2 * (candidates[:, -1] + 1 - kept.sum() + (alone >= 0))
        misfits, ratios = _misfits(t[kept], rough[kept], candidates, RATIOS)
        few = np.argsort(misfits + extra)[: 5 * number]
        for k in few:
            near = np.clip(ratios[k] + FINE, 1e-3, 0.999)
            least = _misfits(t[kept], rough[kept], candidates[k : k + 1], near)[0][0]
            index = np.full(n, SPURIOUS)
            index[kept] = candidates[k]
            found.append((float(least + extra[k]), index))
    found.sort(key=lambda it: it[0])
    return [index for _, index in found[:number]]


def _increasing(n: int, most: int) -> Indices:
    """Return all sequences 0 < k1 < ... of `n` indices that leave out at most `most`."""
    rows = []
    for left_out in range(most + 1):
        for where in itertools.combinations_with_replacement(range(1, n), left_out):
            steps = np.zeros(n, int)
            np.add.at(steps, list(where), 1)
            rows.append(np.arange(n) + np.cumsum(steps))
    return np.array(rows)


def _misfits(t: Array, sigma: Array, index: Indices, ratios: Array) -> tuple[Array, Array]:
    """Return the least sums of squares of ``a - b r**k`` over ratios and the best ratios."""
    w = 1.0 / sigma**2
    w /= w.sum()
    centred = t - w @ t
    values = np.empty((len(ratios), len(index)))
    for i, r in enumerate(ratios):
        power = r**index
        power -= (power @ w)[:, None]
        square, product = (power**2) @ w, power @ (w * centred)
        values[i] = (centred**2) @ w - product**2 / (square + 1e-300)
    best = np.argmin(values, axis=0)
    least = np.maximum(values[best, np.arange(len(index))], 0.0) * np.sum(1.0 / sigma**2)
    return least, ratios[best]


# Least squares over growing windows of the data, with alignment of bounces.


WINDOWS = np.geomspace(0.12, 1.0, 9)
"""Parts of the record that a start fits one after the other."""
EVALUATIONS = 15
"""Evaluations of a window before the last."""
LAST = 60
"""Evaluations of the last window."""
BEYOND = 0.5
"""Part of its length that a run goes on after the last measured bounce."""
REALIGNED = 8
"""Alignments of a window."""
UNEXPLAINED = 2.0
"""Mean square of residuals from which on a window is fitted from other values too."""
REACHES = (0.3, 0.3, 1.0, 0.3, 1.0, 0.1, 0.3, 1.0, 0.1, 0.3, 1.0, 1.0)
"""How far these values lie, as parts of the way to a random point of the bounds."""
CANDIDATES = 6
"""Sets of missed and spurious bounces that are tried from the data alone."""
MOST_SUGGESTED = 20
"""Alignments from the data alone of all data sets together."""
CONVEX = {"cauchy": "soft_l1", "arctan": "soft_l1"}
"""Losses without local minima of their own, for all windows before the last fit."""
WIDER = 4.0 ** np.arange(1, 7)
"""Factors of standard deviations that are too small to explain most bounces."""


LOSSES: dict[str, tuple[Callable[[Array], Array], Callable[[Array], Array]]] = {
    "linear": (lambda z: z, np.ones_like),
    "soft_l1": (lambda z: 2.0 * (np.sqrt(1.0 + z) - 1.0), lambda z: (1.0 + z) ** -0.5),
    "huber": (
        lambda z: np.where(z <= 1.0, z, 2.0 * np.sqrt(z) - 1.0),
        lambda z: np.maximum(z, 1.0) ** -0.5,
    ),
    "cauchy": (np.log1p, lambda z: 1.0 / (1.0 + z)),
    "arctan": (np.arctan, lambda z: 1.0 / (1.0 + z**2)),
}
"""Loss functions of squared residuals, and their derivatives."""


class Place(NamedTuple):
    """A data set: number of the experiment, number within it."""

    experiment: int
    number: int


Alignments = dict[Place, Alignment]


@dataclasses.dataclass
class Window:
    """A part of all data: how many rows of each set, and the end of each run (s)."""

    rows: dict[Place, int]
    ends: list[float]
    anchor: Array | None = None
    """Values that hold what a part of the data does not determine."""


class Optimum(NamedTuple):
    """Values of the parameters at the end of a least squares."""

    p: Array
    cost: float
    alignments: Alignments
    converged: bool


class FitProblem:
    """All data and runs of a fit.

    Parameters
    ----------
    unknowns : Unknowns
        The parameters.
    runs : list of ExperimentRun
        A run for each experiment.
    loss : str
        Loss function of `scipy.optimize.least_squares`.
    seed : int
        Seed of the values that leave local minima.
    """

    def __init__(
        self, unknowns: Unknowns, runs: Sequence[ExperimentRun], loss: str, seed: int = 0
    ) -> None:
        self.generator = np.random.default_rng(seed)
        self.unknowns, self.runs, self.loss = unknowns, list(runs), loss
        self.wanted_loss = loss
        self.data: dict[Place, Data] = {
            Place(k, i): it
            for k, run in enumerate(self.runs)
            for i, it in enumerate(run.experiment.data)
        }
        self.sigma = {place: it.typical() for place, it in self.data.items()}
        self.measured = {
            place: it.times if isinstance(it, Bounces) else it.values
            for place, it in self.data.items()
        }
        self.evaluations = 0
        self.message = ""
        self.latest: Optimum | None = None

    def window(self, part: float) -> Window:
        """Return the first part of the record, at least one row more than parameters."""
        least = -(-(len(self.unknowns) + 1) // len(self.data))
        rows, ends = {}, []
        for k, run in enumerate(self.runs):
            experiment = run.experiment
            end = experiment.t0 + part * (experiment.end - experiment.t0)
            last = experiment.t0
            for i, it in enumerate(experiment.data):
                wanted = int(np.searchsorted(it.t, end, side="right"))
                n = min(max(wanted, least), len(it.t))
                rows[Place(k, i)] = n
                beyond = BEYOND if isinstance(it, Bounces) else 0.0
                t = float(it.t[n - 1])
                last = max(last, t + beyond * (t - experiment.t0))
            ends.append(last)
        return Window(rows, ends)

    def motions(self, p: Array, window: Window) -> list[Any]:
        """Run all experiments; a NoRunError where one fails."""
        self.evaluations += 1
        places = zip(self.runs, self.unknowns.places, window.ends, strict=True)
        return [run.motion(p[place], end) for run, place, end in places]

    def aligned(
        self, p: Array, motions: Sequence[Any], window: Window, wider: float = 1.0
    ) -> Alignments:
        """Align all bounces of a window, with standard deviations that many times wider."""
        found = {}
        for place, it in self.data.items():
            if isinstance(it, Bounces):
                n = window.rows[place]
                times = self._predicted(place, p, motions, n)
                sigma = wider * self.sigma[place][:n]
                found[place] = align(it.times[:n], times, sigma, it.missed, it.spurious)
        return found

    def _predicted(self, place: Place, p: Array, motions: Sequence[Any], n: int) -> Array:
        k, i = place
        own = p[self.unknowns.places[k]]
        run, motion = self.runs[k], motions[k]
        shift = sum(own[j] for j, numbers in run.biases if i in numbers)
        times: Array = motion.impacts(run.quantities[i], n + 8) + shift
        return times

    def residuals(
        self, p: Array, motions: Sequence[Any], window: Window, alignments: Alignments
    ) -> tuple[Array, Array]:
        """Return residuals in standard deviations, and their derivatives."""
        parts, columns = [], []
        for place in self.data:
            r, own = self.of_data(place, p, motions[place.experiment], window, alignments)
            wide = np.zeros((len(r), len(self.unknowns)))
            wide[:, self.unknowns.places[place.experiment]] = own
            parts.append(r)
            columns.append(wide)
        for j, mean, sigma in self.unknowns.priors:
            row = np.zeros((1, len(self.unknowns)))
            row[0, j] = 1.0 / sigma
            parts.append(np.array([(p[j] - mean) / sigma]))
            columns.append(row)
        if window.anchor is not None:
            parts.append((p - window.anchor) / self.unknowns.sizes(window.anchor))
            columns.append(np.diag(1.0 / self.unknowns.sizes(window.anchor)))
        r, jacobian = np.concatenate(parts), np.concatenate(columns)
        if not (np.isfinite(r).all() and np.isfinite(jacobian).all()):
            raise NoRunError("a residual or a derivative is not finite")
        return r, jacobian

    def of_data(
        self, place: Place, p: Array, motion: Any, window: Window, alignments: Alignments
    ) -> tuple[Array, Array]:
        """Return the residuals of a data set, and their derivatives by its parameters."""
        k, i = place
        run, own = self.runs[k], p[self.unknowns.places[k]]
        kept = self.kept(place, window, alignments)
        if isinstance(it := self.data[place], Bounces):
            rows = alignments[place].index[kept]
            wanted = int(rows.max()) + 1 if len(kept) else 0
            found = run.predict_bounces(i, own, motion, wanted)
            if len(found.value) < wanted:
                raise NoRunError(f"the run has {len(found.value)} impacts, {wanted} were measured")
        else:
            rows = np.arange(len(kept))
            found = run.predict_record(i, own, motion, it.t[kept])
        weight = 1.0 / self.sigma[place][kept]
        r = (found.value[rows] - self.measured[place][kept]) * weight
        return r, found.jacobian[rows] * weight[:, None]

    def kept(self, place: Place, window: Window, alignments: Alignments) -> Any:
        """Return the rows of a data set that have residuals: neither missing nor spurious."""
        n = window.rows[place]
        if place in alignments:
            return np.flatnonzero(alignments[place].index[:n] != SPURIOUS)
        return np.flatnonzero(np.isfinite(self.measured[place][:n]))

    def misfit(self, found: Optimum, window: Window) -> float:
        """Return the mean square of the residuals of a window."""
        return 2.0 * found.cost / max(sum(window.rows.values()) - len(found.p), 1)

    def widths(self) -> list[float]:
        """Return factors of the standard deviations of bounces, from half an interval down."""
        wide = 1.0
        for place, it in self.data.items():
            if isinstance(it, Bounces) and len(it.times) > 1:
                interval = float(np.median(np.diff(it.times)))
                wide = max(wide, 0.5 * interval / float(np.median(self.sigma[place])))
        return [float(it) for it in wide ** np.array([1.0, 0.75, 0.5, 0.25])]

    def explains(self, found: Optimum) -> bool:
        """Whether residuals are as small as the given deviations let expect."""
        if not found.alignments or any(it.sigma is None for it in self.data.values()):
            return False
        n = sum(len(it.t) for it in self.data.values())
        squares = 2.0 * (found.cost - self.penalties(found.alignments))
        lost = sum(it.missed + it.spurious for it in found.alignments.values())
        return bool(squares < n + 4.0 * np.sqrt(2.0 * n) and lost <= n / 3.0)

    def dismisses(self, alignments: Alignments) -> bool:
        """Whether more than half of the times of a data set would be spurious."""
        return any(2 * it.spurious > len(it.index) for it in alignments.values())

    def penalties(self, alignments: Alignments) -> float:
        """Return the cost of missed and spurious bounces."""
        total = 0.0
        for place, found in alignments.items():
            it: Any = self.data[place]
            total += 0.5 * (found.missed * it.missed**2 + found.spurious * it.spurious**2)
        return total

    def least_squares(
        self,
        p: Array,
        window: Window,
        alignments: Alignments,
        most: int,
        tolerance: float,
        free: Any = slice(None),
    ) -> Any:
        """Minimise the residuals of a window over some parameters, with a fixed alignment.

        Raises
        ------
        NoRunError
            If there is no run at `p`.
        """
        optimize = needed("scipy.optimize", "fits")
        kept: dict[bytes, tuple[Array, Array]] = {}

        def evaluated(x: Array) -> tuple[Array, Array]:
            key = x.tobytes()
            if key not in kept:
                whole = p.copy()
                whole[free] = x
                found = self.residuals(whole, self.motions(whole, window), window, alignments)
                if len(kept) > 1:
                    kept.pop(next(iter(kept)))
                kept[key] = found[0], found[1][:, free]
            return kept[key]

        first = evaluated(p[free])[0]
        if self.latest is None:
            self.latest = Optimum(p, np.inf, alignments, False)

        def fun(x: Array) -> Array:
            try:
                return evaluated(x)[0]
            except NoRunError as error:  # the step is rejected, and a shorter one tried
                self.message = str(error)
                return np.full(len(first), np.inf)

        if not len(p[free]):
            return optimize.OptimizeResult(x=p, cost=self.cost_of(first), status=1)
        found = optimize.least_squares(
            fun,
            p[free],
            jac=lambda x: evaluated(x)[1],
            bounds=(self.unknowns.lower[free], self.unknowns.upper[free]),
            x_scale="jac",
            loss=self.loss,
            max_nfev=most,
            ftol=tolerance,
            xtol=tolerance,
            gtol=tolerance,
        )
        whole = p.copy()
        whole[free] = found.x
        found.x = whole
        return found

    def cost_of(self, r: Array) -> float:
        """Return the cost of residuals in standard deviations."""
        return 0.5 * float(np.sum(LOSSES[self.loss][0](r**2)))


def solve(
    problem: FitProblem,
    p: Array,
    window: Window,
    alignments: Alignments | None = None,
    *,
    most: int = EVALUATIONS,
    tolerance: float = 1e-8,
    wider: Sequence[float] = (),
    fixed: bool = False,
) -> Optimum:
    """Minimise over a window; alignments are kept for a whole least squares, and then redone.

    Parameters
    ----------
    problem : FitProblem
        The problem.
    p : ndarray
        Initial values.
    window : Window
        The data.
    alignments : dict, optional
        The first alignment; by default that of the run at `p`.
    most : int
        Evaluations of each least squares.
    tolerance : float
        Tolerance of the last one.
    wider : sequence of float
        Factors of the standard deviations of the first alignments.
    fixed : bool
        Keep the first alignments.

    Raises
    ------
    NoRunError
        If there is no run at `p`.
    """
    bouncing = not fixed and any(isinstance(it, Bounces) for it in problem.data.values())
    factors = [*wider, *[1.0] * REALIGNED] if bouncing else [1.0]
    p = problem.unknowns.clipped(p)
    if alignments is None:
        alignments = problem.aligned(p, problem.motions(p, window), window, factors[0])
    found, best = None, None
    for k, _ in enumerate(factors):
        found = problem.least_squares(p, window, alignments, most, tolerance)
        p = found.x
        cost = float(found.cost) + problem.penalties(alignments)
        at = Optimum(p, cost, alignments, found.status > 0)
        best = at if best is None or at.cost < best.cost or factors[k] > 1.0 else best
        if not bouncing or k + 1 == len(factors):
            break
        motions = problem.motions(p, window)
        again = problem.aligned(p, motions, window, factors[k + 1])
        if factors[k] == factors[k + 1] == 1.0 and _same_alignments(again, alignments):
            break
        alignments = again
    assert best is not None
    return best


def _same_alignments(one: Alignments, other: Alignments) -> bool:
    return all(
        np.array_equal(one[place].index, other[place].index) and one[place].missed == it.missed
        for place, it in other.items()
    )


def grow(problem: FitProblem, p: Array, alone: Sequence[Alignments] = ()) -> Optimum:
    """Fit growing windows from initial values, each from the values of the last one.

    Parameters
    ----------
    problem : FitProblem
        The problem.
    p : ndarray
        Initial values.
    alone : sequence of dict
        Alignments from the data alone, tried as well.

    Raises
    ------
    NoRunError
        If no window has a run.
    """
    found: list[Optimum] = []
    for first in (*alone, None):
        problem.loss = CONVEX.get(problem.wanted_loss, problem.wanted_loss)
        try:
            grown = _grown(problem, p, first)
            if problem.loss != problem.wanted_loss:
                problem.loss = problem.wanted_loss
                whole = problem.window(1.0)
                grown = solve(problem, grown.p, whole, grown.alignments, most=LAST)
            found.append(grown)
        except NoRunError as error:
            problem.message = str(error)
            continue
        finally:
            problem.loss = problem.wanted_loss
        if problem.explains(found[-1]):
            break
    if not found:
        raise NoRunError(problem.message)
    return min(found, key=lambda it: it.cost)


def _grown(problem: FitProblem, p: Array, first: Alignments | None) -> Optimum:
    last, anchor, tries = None, problem.unknowns.clipped(p), len(REACHES)
    bouncing = any(isinstance(it, Bounces) for it in problem.data.values())
    for part in WINDOWS:
        window = problem.window(part)
        window.anchor = anchor if part < 1.0 else None
        if last is not None and window.rows == last.rows and part < 1.0:
            continue
        whole = part == 1.0
        alignments = None
        if first is not None:
            alignments = {
                place: counted_missed(it.index[: window.rows[place]], 0)
                for place, it in first.items()
            }
            if any(len(it.index) < window.rows[place] for place, it in alignments.items()):
                alignments = None
        wider = problem.widths() if first is None else ()
        most, fixed = LAST if whole else EVALUATIONS, alignments is not None and not whole
        try:
            found = solve(problem, p, window, alignments, most=most, wider=wider, fixed=fixed)
        except NoRunError:
            if whole:
                raise
            continue
        if tries and not bouncing and problem.misfit(found, window) > UNEXPLAINED:
            found, tries = _moved_on(problem, found, window, tries)
        problem.latest = found
        p, last = found.p, window
    return found


def _moved_on(
    problem: FitProblem, found: Optimum, window: Window, tries: int
) -> tuple[Optimum, int]:
    """Leave a local minimum: fit a window again from values near and far, a few times."""
    low, high = problem.unknowns.box(found.p)
    for reach in REACHES[len(REACHES) - tries :]:
        tries -= 1
        p = problem.generator.uniform(low, high)
        p = problem.unknowns.clipped(found.p + reach * (p - found.p))
        try:
            other = solve(problem, p, window)
        except NoRunError:
            continue
        found = min(found, other, key=lambda it: it.cost)
        if problem.misfit(found, window) <= UNEXPLAINED:
            break
    return found, tries


def from_data(problem: FitProblem) -> list[Alignments]:
    """Return alignments that the sets of bounces suggest without a run.

    The likeliest of each set together, the second likeliest, and so on; then one set at a time.
    """
    options = {
        place: _suggested(it, problem.sigma[place])
        for place, it in problem.data.items()
        if isinstance(it, Bounces)
    }
    if not options:
        return []
    ranks = range(max(map(len, options.values())))
    found = [{place: rows[min(k, len(rows) - 1)] for place, rows in options.items()} for k in ranks]
    if len(options) > 1:
        for k in ranks[1:]:
            found += [found[0] | {it: rows[k]} for it, rows in options.items() if k < len(rows)]
    return found[:MOST_SUGGESTED]


def _suggested(data: Bounces, sigma: Array) -> list[Alignment]:
    penalty = min(data.missed, data.spurious)
    rows = geometric_indices(data.times, sigma, penalty, CANDIDATES)
    # the first impacts may be missed too, which intervals do not show
    rows = [
        *rows[: CANDIDATES // 2],
        np.arange(len(data.times)),
        *rows[CANDIDATES // 2 :],
        *(shifted_indices(row, k) for k in (1, 2) for row in rows[:3]),
    ]
    return [counted_missed(index, 0) for index in rows]


def shifted_indices(index: Any, by: int) -> Any:
    """Return indices of impacts that are all shifted_indices."""
    return np.where(index == SPURIOUS, SPURIOUS, index + by)


def fit_all(problem: FitProblem, start: Optimum) -> Optimum:
    """Minimise over all data to the accuracy of the runs."""
    whole = problem.window(1.0)
    return solve(problem, start.p, whole, start.alignments, most=200, tolerance=1e-10)


def match_most(problem: FitProblem, p: Array, alone: Sequence[Alignments]) -> Optimum | None:
    """Fit bounces of which the given standard deviations explain less than half.

    They are matched as if these deviations were larger, and then fitted with the given ones.
    Return None where no deviation helps.
    """
    given = dict(problem.sigma)
    bouncing = [place for place, it in problem.data.items() if isinstance(it, Bounces)]
    found = None
    try:
        for factor in WIDER:
            problem.sigma.update({place: factor * given[place] for place in bouncing})
            found = grow(problem, p, alone)
            if not problem.dismisses(found.alignments):
                break
        else:
            return None
    except NoRunError:
        return None
    finally:
        problem.sigma.update(given)
    whole = problem.window(1.0)
    end = problem.least_squares(found.p, whole, found.alignments, 200, 1e-10)
    cost = float(end.cost) + problem.penalties(found.alignments)
    return Optimum(end.x, cost, found.alignments, end.status > 0)
