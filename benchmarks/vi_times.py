"""Time and work over the published problems beside Siconos, on the same callbacks."""

from __future__ import annotations

import dataclasses
import statistics
import time
from collections.abc import Callable
from typing import Any

import numpy as np

import zivi
from vi_counts import PEERS, PROBLEMS, Problem, listed, residual
from vi_peer import Peer
from zivi import _zivi

SOLVED = 1e-7
BURST = 5
"""Solves in one turn: the first wakes the process up, and the median is taken."""

LCPS = (
    "murty8",
    "murty16",
    "fathi8",
    "fathi16",
    "cycle3",
    "ahn64",
    "geigerkanzow64",
    "pathmanual4",
    "rps6",
    "battle4",
    "transmcp",
)
PIVOTAL = ("LCP_LEMKE", "LCP_AVI_CAOFERRIS")


@dataclasses.dataclass(frozen=True)
class Ratios:
    """zivi's over Siconos' on the starts that both solve: of one start, and of all together."""

    starts: int
    time: dict[str, float]
    """Quantiles over the starts, and ``total``."""
    nfev: float
    njev: float
    callbacks: float
    """Share of zivi's time that is spent in F and its Jacobian."""


@dataclasses.dataclass(frozen=True)
class Pivots:
    """Pivots of one linear complementarity problem by solver; None where it was not solved."""

    n: int
    zivi: int
    siconos: dict[str, int | None]
    time: dict[str, float | None]
    """Time of zivi over that of each solver."""


@dataclasses.dataclass(frozen=True)
class _Pair:
    ratio: float
    seconds: tuple[float, float]
    nfev: tuple[int, int]
    njev: tuple[int, int]
    callbacks: float
    """Seconds of zivi's time."""


def _median_seconds(run: Callable[[], Any], repeat: int = BURST) -> float:
    seconds = []
    for _ in range(repeat):
        begin = time.perf_counter()
        run()
        seconds.append(time.perf_counter() - begin)
    return statistics.median(seconds)


def _interleaved(
    run: Callable[[], Any],
    peer: Peer,
    solver: str,
    problem: Problem,
    start: np.ndarray,
    rounds: int,
) -> tuple[float, tuple[float, float]] | None:
    """Return the ratio of the times in one round, and both times; medians over the rounds."""
    ours, theirs = [], []
    for _ in range(rounds):
        ours.append(_median_seconds(run))
        answer = peer.ask(solver, problem.name, start, BURST)
        if answer is None:
            return None
        theirs.append(statistics.median(answer["seconds"]))
    ratio = statistics.median(a / b for a, b in zip(ours, theirs, strict=True))
    return ratio, (statistics.median(ours), statistics.median(theirs))


def _pair(
    peer: Peer, solver: str, problem: Problem, start: np.ndarray, rounds: int
) -> _Pair | None:
    """Time one start with both; None unless both solve it."""

    def run() -> zivi.VIResult:
        return zivi.solve_vi(problem.F, problem.lower, problem.upper, start, jac=problem.jac)

    own, answer = run(), peer.ask(solver, problem.name, start)
    if answer is None or residual(problem, np.array(answer["x"])) > SOLVED:
        return None
    if residual(problem, own.x) > SOLVED:
        return None
    timed = _interleaved(run, peer, solver, problem, start, rounds)
    if timed is None:
        return None
    one_f = _median_seconds(lambda: problem.F(own.x), 25)
    one_j = _median_seconds(lambda: problem.jac(own.x), 25)
    return _Pair(
        *timed,
        nfev=(own.nfev, answer["nfev"]),
        njev=(own.njev, answer["njev"]),
        callbacks=own.nfev * one_f + own.njev * one_j,
    )


def ratios(peer: Peer, rounds: int) -> dict[str, Ratios]:
    """Compare over all published starts."""
    result = {}
    with np.errstate(all="ignore"):
        for solver in PEERS:
            found = [_pair(peer, solver, problem, start, rounds) for problem, start in listed()]
            pairs = [pair for pair in found if pair is not None]
            result[solver] = _summed_up(pairs)
    return result


def _summed_up(pairs: list[_Pair]) -> Ratios:
    each = [pair.ratio for pair in pairs]

    def total(values: str) -> tuple[float, float]:
        ours, theirs = zip(*(getattr(pair, values) for pair in pairs), strict=True)
        return sum(ours), sum(theirs)

    seconds, nfev, njev = total("seconds"), total("nfev"), total("njev")
    quantiles = {f"{100 * q:g} %": float(np.quantile(each, q)) for q in (0.1, 0.5, 0.9)}
    return Ratios(
        starts=len(pairs),
        time=quantiles | {"total": seconds[0] / seconds[1]},
        nfev=nfev[0] / nfev[1],
        njev=njev[0] / njev[1],
        callbacks=sum(pair.callbacks for pair in pairs) / seconds[0],
    )


def pivots(peer: Peer, rounds: int) -> dict[str, Pivots]:
    """Compare pivots on the linear complementarity problems, from zero."""
    return {it.name: _pivots(peer, it, rounds) for it in PROBLEMS if it.name in LCPS}


def _pivots(peer: Peer, problem: Problem, rounds: int) -> Pivots:
    zero = np.zeros(problem.n)
    matrix, constant = problem.jac(zero), problem.F(zero)

    def run() -> dict[str, Any]:
        # without the checks of the public function, which take longer than the smallest solves
        return _zivi.solve_avi(matrix, constant, problem.lower, problem.upper, zero, {"tol": 1e-9})

    theirs: dict[str, int | None] = dict.fromkeys(PIVOTAL)
    times: dict[str, float | None] = dict.fromkeys(PIVOTAL)
    for solver in PIVOTAL:
        answer = peer.ask(solver, problem.name, zero)
        if answer is None or residual(problem, np.array(answer["x"])) > SOLVED:
            continue
        theirs[solver] = answer["iterations"]
        timed = _interleaved(run, peer, solver, problem, zero, rounds)
        times[solver] = None if timed is None else timed[0]
    return Pivots(problem.n, run()["n_pivots"], theirs, times)


def lost_by(peer: Peer, solves: int) -> float | None:
    """Return the bytes that VI_BOX_AVI_LSA's process grows by with each solve."""
    # the first answer lets the process grow by what it needs once
    for repeat in (solves // 10, solves):
        answer = peer.ask("VI_BOX_AVI_LSA", "sic2", np.zeros(2), repeat)
    return None if answer is None else answer["grew"] / solves
