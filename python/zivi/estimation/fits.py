"""Estimate parameters of a system with impacts from data."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from zivi.base.check import Array, count, integer
from zivi.base.extras import ProgressBar
from zivi.base.habits import hinted
from zivi.estimation.data import Bounces, Data, Experiment, as_experiments
from zivi.estimation.result import Fit, FitState, FitStatus, Uncertainty, estimate
from zivi.estimation.runs import ExperimentRun, NoRunError, Unknowns, read_unknowns
from zivi.estimation.search import LOSSES, FitProblem, Optimum, fit_all, from_data, grow, match_most
from zivi.simulation.methods import SwitchedRK
from zivi.system.mass import check_system
from zivi.system.mechanism import MechanicalSystem

METHOD = SwitchedRK(rtol=1e-9, atol=1e-11)
SAME = 1e-3
"""Starts with this relative excess of the cost found the optimum."""
NOTHING = 1e-6
"""The same, absolute: costs of data without noise."""
RESCALED = 5
"""Estimates of unknown standard deviations."""
LARGE = 2.0
"""Root mean square of residuals in standard deviations from which on a note says so."""
FEW = 4
"""Alignments from the data alone that the later starts try."""


@hinted("fit")
def fit(
    system: Any,
    data: Data | Experiment | Sequence[Data] | Sequence[Experiment],
    params: Sequence[str] | str,
    *,
    y0: Any = None,
    t0: float = 0.0,
    bounds: Mapping[str, Any] | None = None,
    starts: int = 8,
    seed: int = 0,
    loss: str = "linear",
    prior: Mapping[str, tuple[float, float]] | None = None,
    own: Sequence[str] | str = (),
    method: SwitchedRK = METHOD,
    progress: bool | None = None,
) -> Fit:
    """Estimate parameters of a system from measurements, by least squares over growing windows.

    The residual of a run with impacts is smooth only while the sequence of impacts stays. Each
    start fits nine growing parts of the record, each from the values of the last one. Times of
    bounces are aligned with predicted ones, some missed and some spurious. A note says if residuals
    are more than twice their given standard deviations.

    Parameters
    ----------
    system : ImpactSystem or MechanicalSystem
        The system. Its parameters are the first start.
    data : Bounces, Record, Experiment or a list of them
        Measurements; a list of `Bounces` and `Record` belongs to one run, each `Experiment` is a
        run of its own.
    params : sequence of str
        Names of the parameters to estimate: those of `zivi.sensitivity` (``"e"``, ``"damping"``,
        ``"x0"``, ``"q0[1]"``); ``"t0"``, the time of the initial state by the clock of the data
        (s); ``"bias"``, what a sensor adds to the measured quantity (``"bias[1]"`` of the second
        data set).
    y0 : (float, float) or (array_like, array_like)
        Initial state, as for `zivi.simulate`. Not for a list of `Experiment`.
    t0 : float
        Time of the initial state (s). Default 0.
    bounds : dict of str to (float, float), optional
        Bounds by name; None for a missing one. Default for ``"e"``: (0, 1).
    starts : int
        Number of starts: the system as given, then points of a Sobol sequence in the bounds
        (without bounds, from a quarter of the given value to 4 times this value). Default 8.
    seed : int
        Seed of the sequence.
    loss : {"linear", "soft_l1", "huber", "cauchy", "arctan"}
        Loss of `scipy.optimize.least_squares` for residuals in standard deviations: all but the
        first reduce the weight of outliers.
    prior : dict of str to (float, float), optional
        Means and standard deviations of parameters that are known beforehand.
    own : sequence of str, optional
        Parameters of which each experiment has its own value, in addition to `params`.
    method : SwitchedRK
        Tolerances of the runs.
    progress : bool, optional
        Show a progress bar once the fit lasts longer than a second; by default on a terminal only.

    Returns
    -------
    Fit
        Values, deviations, intervals, residuals, and how many starts found them.

    Raises
    ------
    ValueError, TypeError
        If an argument is out of its range, or no start has a run.
    KeyboardInterrupt
        With the best of what was computed as its attribute ``fit``.

    See Also
    --------
    zivi.sensitivity : derivatives of one run.
    zivi.interop.run_function : runs for optimisers of your own.

    Notes
    -----
    Built on `scipy.optimize.least_squares` (trust region, bounds). Values without a run, such as an
    early end, shorten the step. Where `zivi.sensitivity` has no derivatives, they are central
    differences of runs, and `Fit.notes` says so. The covariance is the inverse of the normal
    matrix (Bates and Watts 1988, sec. 2.3).

    Examples
    --------
    >>> ball = zivi.ImpactSystem(zivi.LinearForce(gravity=9.81, damping=0.1), e=0.6)
    >>> times = zivi.simulate(ball.replace(e=0.8, damping=0.05), (0, 3), (1, 0)).impacts["t"]
    >>> fit = zivi.fit(ball, zivi.Bounces(times[:8], sigma=1e-3), ("e", "damping"), y0=(1, 0),
    ...     starts=2)
    >>> round(fit.values["e"], 4), round(fit.values["damping"], 3), fit.found
    (0.8, 0.05, 2)
    """
    if not isinstance(system, MechanicalSystem):
        check_system(system)
    if loss not in LOSSES:
        raise ValueError(f"loss must be one of {', '.join(LOSSES)}, got {loss!r}")
    if not isinstance(method, SwitchedRK):
        raise TypeError(f"method must be a zivi.SwitchedRK, got {method!r}")
    number = count("starts", starts, least=1)
    experiments = as_experiments(data, y0, t0)
    unknowns = read_unknowns(system, experiments, params, own, bounds, prior)
    runs = [
        ExperimentRun(system, it, names, method)
        for it, names in zip(experiments, unknowns.local, strict=True)
    ]
    problem = FitProblem(unknowns, runs, loss, seed)
    first = unknowns.starts(_given(unknowns, runs), number, integer("seed", seed))
    return _searched(problem, first, progress)


def _given(unknowns: Unknowns, runs: Sequence[ExperimentRun]) -> Array:
    """Return the parameters as given; what experiments share is that of the first."""
    values = np.zeros(len(unknowns))
    for run, places in reversed(list(zip(runs, unknowns.places, strict=True))):
        values[places] = run.given()
    return values


def _searched(problem: FitProblem, first: Array, progress: bool | None) -> Fit:
    """Fit from all starts, and polish the best; what was computed survives an interruption."""
    alone = from_data(problem)
    ends: list[Optimum | None] = []
    try:
        with ProgressBar(progress, "fit") as bar:
            for k, p in enumerate(first):
                ends.append(_from_start(problem, p, alone if k == 0 else alone[:FEW]))
                if bar.report is not None:
                    bar.report(k + 1, len(first))
        best = _best(ends)
        if best is None:
            raise ValueError(f"no start has a run up to the end of the data: {problem.message}")
        best = _finished(problem, best)
        if problem.dismisses(best.alignments):
            best = match_most(problem, first[0], alone[:FEW]) or best
    except KeyboardInterrupt as error:
        best = _best(ends) or problem.latest
        if best is not None:
            with_fit(error, _fit_of(problem, best, ends, FitStatus.INTERRUPTED))
        raise
    status = FitStatus.CONVERGED if best.converged else FitStatus.NOT_CONVERGED
    return _fit_of(problem, best, ends, status)


def with_fit(error: BaseException, found: Fit) -> None:
    """Attach what was computed to the exception that ended a fit."""
    error.add_note(
        "zivi: the fit was interrupted; the best of what was computed is this exception's "
        "attribute 'fit'."
    )
    error.fit = found  # type: ignore[attr-defined]


def _from_start(problem: FitProblem, p: Array, alone: Sequence[Any]) -> Optimum | None:
    try:
        return grow(problem, p, alone)
    except NoRunError as error:
        problem.message = str(error)
        return None


def _best(ends: Sequence[Optimum | None]) -> Optimum | None:
    return min((it for it in ends if it is not None), key=lambda it: it.cost, default=None)


def _finished(problem: FitProblem, best: Optimum) -> Optimum:
    """Minimise to the end, with standard deviations that are estimated where none are given."""
    best = fit_all(problem, best)
    unknown = [place for place, it in problem.data.items() if it.sigma is None]
    for _ in range(RESCALED if unknown else 0):
        if _rescaled(problem, best, unknown) < 0.01:
            break
        best = fit_all(problem, best)
    return best


def _rescaled(problem: FitProblem, best: Optimum, unknown: Sequence[Any]) -> float:
    """Estimate unknown standard deviations from the residuals; return the largest change."""
    whole = problem.window(1.0)
    motions = problem.motions(best.p, whole)
    rows = {
        place: problem.of_data(place, best.p, motions[place.experiment], whole, best.alignments)[0]
        for place in problem.data
    }
    total = sum(len(r) for r in rows.values())
    lost = total / max(total - len(best.p), 1)
    change = 0.0
    for place in unknown:
        r = rows[place]
        if not len(r):
            continue
        square = float(np.mean(r**2))
        if problem.loss != "linear":
            square = float(1.4826 * np.median(np.abs(r))) ** 2
        factor = max(np.sqrt(square * lost), 1e-9)
        problem.sigma[place] = problem.sigma[place] * factor
        change = max(change, abs(np.log(factor)))
    return change


def _fit_of(
    problem: FitProblem, best: Optimum, ends: Sequence[Optimum | None], status: FitStatus
) -> Fit:
    whole = problem.window(1.0)
    bouncing = any(isinstance(it, Bounces) for it in problem.data.values())
    motions = problem.motions(best.p, whole)
    alignments = problem.aligned(best.p, motions, whole) if bouncing else {}
    if any(not np.array_equal(it.index, alignments[k].index) for k, it in best.alignments.items()):
        alignments = best.alignments  # a tie
    best = best._replace(alignments=alignments)
    r, jacobian = problem.residuals(best.p, motions, whole, best.alignments)
    weights = None if problem.loss == "linear" else LOSSES[problem.loss][1](r**2)
    differenced = any(run.reason for run in problem.runs)
    bounds = (problem.unknowns.lower, problem.unknowns.upper)
    spread = estimate(best.p, r, jacobian, bounds, weights, differenced)
    names = problem.unknowns.names
    costs = np.array([np.inf if it is None else it.cost for it in ends])
    least = np.min(costs, initial=np.inf)
    values = [np.full(len(names), np.nan) if it is None else it.p for it in ends]
    return Fit(
        names=names,
        x=best.p,
        covariance=spread.covariance,
        cost=problem.cost_of(r) + problem.penalties(alignments),
        found=int(np.count_nonzero(costs <= least * (1.0 + SAME) + NOTHING)) if len(costs) else 0,
        starts=len(ends),
        start_values=np.array(values).reshape(-1, len(names)),
        start_costs=costs,
        undetermined=tuple(tuple(names[j] for j in group) for group in spread.undetermined),
        at_bound={names[j]: bound for j, bound in spread.at_bound.items()},
        notes=tuple(_notes(problem, best, spread, motions)),
        matches=tuple(it.index for it in alignments.values()),
        missed=sum(it.missed for it in alignments.values()),
        degrees_of_freedom=max(len(r) - len(names), 1),
        sigmas=tuple(problem.sigma.values()),
        differenced=differenced,
        trajectories=tuple(it.trajectory for it in motions),
        status=status,
        evaluations=problem.evaluations,
        _residuals=tuple(_unscaled(problem, best, motions)),
        _scaled=any(it.sigma is None for it in problem.data.values()),
        _bounds=bounds,
        _state=FitState(problem, best),
    )


def _unscaled(problem: FitProblem, best: Optimum, motions: Sequence[Any]) -> list[Array]:
    """Return measured minus predicted values of each data set in its unit."""
    whole = problem.window(1.0)
    found = []
    for place, it in problem.data.items():
        motion = motions[place.experiment]
        r, _ = problem.of_data(place, best.p, motion, whole, best.alignments)
        kept = problem.kept(place, whole, best.alignments)
        full = np.full(len(it.t), np.nan)
        full[kept] = -r * problem.sigma[place][kept]
        found.append(full)
    return found


def _notes(
    problem: FitProblem, best: Optimum, spread: Uncertainty, motions: Sequence[Any]
) -> list[str]:
    """Say what limits the estimates."""
    names = problem.unknowns.names
    notes = []
    for group in spread.undetermined:
        told = " and ".join(
            filter(None, [", ".join(names[j] for j in group[:-1]), names[group[-1]]])
        )
        apart = "are not determined separately" if len(group) > 1 else "is not determined"
        notes.append(f"{told} {apart} by these data")
    notes += [f"{names[j]} is at its bound {bound:.6g}" for j, bound in spread.at_bound.items()]
    missed = sum(it.missed for it in best.alignments.values())
    spurious = sum(it.spurious for it in best.alignments.values())
    if missed or spurious:
        notes.append(f"alignment of bounces: {missed} missed, {spurious} spurious")
    notes += _size_notes(problem, best, motions)
    for reason in dict.fromkeys(run.reason for run in problem.runs if run.reason):
        notes.append(f"derivatives are differences of runs: {reason}")
    return notes + _sequence_notes(problem, spread, motions)


def _size_notes(problem: FitProblem, best: Optimum, motions: Sequence[Any]) -> list[str]:
    """Say which residuals are larger than their given standard deviations."""
    whole, notes = problem.window(1.0), []
    for place, it in problem.data.items():
        if it.sigma is None or problem.loss != "linear":
            continue
        motion = motions[place.experiment]
        r, _ = problem.of_data(place, best.p, motion, whole, best.alignments)
        size = float(np.sqrt(np.mean(r**2))) if len(r) else 0.0
        if size > LARGE:
            notes.append(
                f"residuals of {it!r} are {size:.3g} times the given sigma: sigma is too small, "
                "or the model is incomplete"
            )
    return notes


def _sequence_notes(problem: FitProblem, spread: Uncertainty, motions: Sequence[Any]) -> list[str]:
    """Say where the sequence of impacts changes within two standard deviations."""
    deviations = np.sqrt(np.diag(spread.covariance))
    notes = {}
    for motion, run, places in zip(motions, problem.runs, problem.unknowns.places, strict=True):
        columns = getattr(motion, "by_parameters", None)
        if columns is None:
            continue
        for j, radius, limit in zip(
            places[run.moving], columns.radius, columns.limits, strict=True
        ):
            if limit is None or limit.kind in ("end", "rest") or not np.isfinite(deviations[j]):
                continue
            if radius < 2.0 * deviations[j]:
                name = problem.unknowns.names[j]
                notes[name] = (
                    f"the sequence of impacts changes within the interval of {name} "
                    f"({limit.kind} near t = {limit.t:.4g} s): compare with profile({name!r})"
                )
    return list(notes.values())
