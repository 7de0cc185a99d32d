"""Many runs of mechanical systems at once, on threads."""

from __future__ import annotations

import dataclasses
import json
import threading
from collections.abc import Iterable, Sequence
from concurrent.futures import FIRST_COMPLETED, ThreadPoolExecutor, wait
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from zivi import _zivi
from zivi._check import Array, real_array
from zivi._extras import needed
from zivi._progress import ProgressBar
from zivi.mechanics.run import Asked, FixedOrSwitched, check_mechanical_method, run_mechanical
from zivi.mechanics.system import MechanicalSystem
from zivi.mechanics.trajectory import MechanicalTrajectory
from zivi.status import Status

if TYPE_CHECKING:
    import xarray

__all__ = ["MechanicalBatch", "mechanical_batch"]

SAVES = ("final", "events", "runs")
"""What can be kept of each run."""

NUMBERS = {
    "first_impact": "time of the first impact, NaN without one",
    "last_impact": "time of the last impact, NaN without one",
    "n_impacts": "number of impacts that were resolved",
    "n_zeno": "number of accumulations",
    "n_liftoffs": "number of lift-offs",
    "n_corners": "number of corners",
    "n_flags": "number of flags",
    "status": "how the run ended, a zivi.Status",
    "nfev": "evaluations of the system",
}


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class MechanicalBatch:
    """Results of a batch of mechanical systems: an entry for each of N runs.

    Attributes
    ----------
    t : ndarray
        Time at the end of each run, shape (N,).
    q, qdot : ndarray
        Coordinates and velocities there, shape (N, n).
    gaps : ndarray
        Gaps there, shape (N, m).
    contacts : ndarray of bool
        Which gaps are closed there, shape (N, m).
    first_impact, last_impact : ndarray
        Times of the first and the last impact, NaN without one.
    n_impacts, n_zeno, n_liftoffs, n_corners, n_flags : ndarray of int
        Numbers of impacts that were resolved, accumulations, lift-offs, corners and flags.
    status : ndarray of uint8
        How each run ended, the numbers of `Status`.
    nfev : ndarray of int
        Evaluations of the system.
    events : list of dict or None
        With ``save="events"``: the tables ``impacts``, ``zeno``, ``liftoffs``, ``openings``,
        ``corners`` and ``flags`` of each run.
    runs : list of MechanicalTrajectory or None
        With ``save="runs"``: the runs themselves.
    config : dict
        Settings of the batch, as plain values.
    """

    t: Array
    q: Array
    qdot: Array
    gaps: Array
    contacts: NDArray[np.bool_]
    first_impact: Array
    last_impact: Array
    n_impacts: NDArray[np.int64]
    n_zeno: NDArray[np.int64]
    n_liftoffs: NDArray[np.int64]
    n_corners: NDArray[np.int64]
    n_flags: NDArray[np.int64]
    status: NDArray[np.uint8]
    nfev: NDArray[np.int64]
    events: list[dict[str, Any]] | None
    runs: list[MechanicalTrajectory] | None
    config: dict[str, Any]

    def __len__(self) -> int:
        return len(self.status)

    @property
    def success(self) -> NDArray[np.bool_]:
        """Which runs reached the end of the span."""
        return np.equal(self.status, Status.COMPLETED)

    def __repr__(self) -> str:
        return f"<MechanicalBatch of {len(self)} runs: {int(np.sum(self.success))} completed>"

    def to_xarray(self) -> xarray.Dataset:
        """Convert to a labelled dataset over ``run``, ``coordinate`` and ``gap``."""
        needed("xarray", "labelled datasets")
        import xarray

        ends = {
            "t": (("run",), "time of the end"),
            "q": (("run", "coordinate"), "coordinates at the end"),
            "qdot": (("run", "coordinate"), "velocities at the end"),
            "gaps": (("run", "gap"), "gaps at the end"),
            "contacts": (("run", "gap"), "which gaps are closed at the end"),
        }
        told = ends | {name: (("run",), meaning) for name, meaning in NUMBERS.items()}
        return xarray.Dataset(
            {
                name: (dims, getattr(self, name), {"long_name": meaning})
                for name, (dims, meaning) in told.items()
            },
            coords={
                "run": np.arange(len(self)),
                "coordinate": ("coordinate", np.array(self.config["coordinates"], dtype=object)),
                "gap": ("gap", np.array(self.config["gaps"], dtype=object)),
            },
            attrs={
                "title": "Batch of runs of mechanical systems with impacts",
                "source": f"zivi {_zivi.__version__}",
                "config": json.dumps(self.config),
            },
        )


def mechanical_batch(
    systems: MechanicalSystem | Sequence[MechanicalSystem],
    span: tuple[float, float],
    y0: Any,
    method: Any,
    save: Any,
    threads: int,
    progress: bool | None,
) -> MechanicalBatch:
    """Run many mechanical systems; see `zivi.simulate_batch`."""
    if save not in SAVES:
        names = ", ".join(repr(name) for name in SAVES)
        raise ValueError(f"save must be one of {names} for mechanical systems, got {save!r}")
    several = _systems(systems)
    check_mechanical_method(method)
    q, qdot = _states(y0, len(several))
    several = several * len(q) if len(several) == 1 else several
    starts = zip(several, q, qdot, strict=True)
    with ProgressBar(progress) as bar:
        runs = _computed(
            [
                (system, Asked(span, a, b, None, np.empty(0), [], save == "runs"))
                for system, a, b in starts
            ],
            method,
            threads,
            bar.report,
        )
    config = runs[0].config | {"n_runs": len(runs), "save": save}
    return _batch(runs, save, config)


def _computed(
    tasks: list[tuple[MechanicalSystem, Asked]],
    method: FixedOrSwitched,
    threads: int,
    report: Any,
) -> list[MechanicalTrajectory]:
    """Compute all runs in their order; the first exception ends the rest."""
    stopped = threading.Event()

    def go_on(*_: int) -> None:
        if stopped.is_set():
            raise KeyboardInterrupt

    def one(task: tuple[MechanicalSystem, Asked]) -> MechanicalTrajectory:
        sol, error = run_mechanical(task[0], method, task[1], go_on)
        if error is not None:
            raise error
        return sol

    with ThreadPoolExecutor(threads) as pool:
        futures = [pool.submit(one, task) for task in tasks]
        left = set(futures)
        try:
            while left:
                done, left = wait(left, timeout=0.2, return_when=FIRST_COMPLETED)
                for future in done:
                    future.result()
                if report is not None:
                    report(len(tasks) - len(left), len(tasks))
        except BaseException:
            stopped.set()  # those under way end at their next report
            pool.shutdown(wait=False, cancel_futures=True)
            raise
    return [future.result() for future in futures]


def _systems(systems: Any) -> list[MechanicalSystem]:
    several = [systems] if isinstance(systems, MechanicalSystem) else list(systems)
    for i, system in enumerate(several):
        if not isinstance(system, MechanicalSystem):
            raise TypeError(f"systems must be zivi.MechanicalSystem (number {i}), got {system!r}")
        if system.gap_names != several[0].gap_names:
            raise ValueError(f"systems must have the same gaps, number {i} has {system.gap_names}")
    return several


def _states(y0: Any, n_systems: int) -> tuple[Array, Array]:
    """Read ``(q0, qdot0)``, each of shape (n,) or (N, n)."""
    given = tuple(y0) if isinstance(y0, Iterable) else ()
    if len(given) != 2:
        raise TypeError(f"y0 must be (q0, qdot0), arrays of shape (N, n) or (n,), got {y0!r}")
    states = [
        np.atleast_2d(real_array(name, value)).astype(np.float64)
        for name, value in zip(("q0", "qdot0"), given, strict=True)
    ]
    count = max(n_systems, *(len(state) for state in states))
    for name, state in zip(("q0", "qdot0"), states, strict=True):
        if state.ndim != 2 or len(state) not in (1, count) or n_systems not in (1, count):
            raise ValueError(
                f"{name} must have a row for each of {count} runs, got shape {state.shape}"
            )
        if not np.all(np.isfinite(state)):
            raise ValueError(f"{name} must be finite")
    q, qdot = states
    if q.shape[1] != qdot.shape[1]:
        raise ValueError(f"qdot0 must have {q.shape[1]} columns as q0, got {qdot.shape[1]}")
    shape = (count, q.shape[1])
    return np.broadcast_to(q, shape).copy(), np.broadcast_to(qdot, shape).copy()


def _batch(runs: list[MechanicalTrajectory], save: str, config: dict[str, Any]) -> MechanicalBatch:
    def last(name: str) -> Any:
        return np.array([getattr(run, name)[-1] for run in runs])

    def impact(k: int) -> Array:
        return np.array([run.impacts["t"][k] if len(run.impacts) else np.nan for run in runs])

    def count(name: str) -> NDArray[np.int64]:
        return np.array([len(getattr(run, name)) for run in runs])

    tables = ("impacts", "zeno", "liftoffs", "openings", "corners", "flags")
    return MechanicalBatch(
        t=last("t"),
        q=last("q"),
        qdot=last("qdot"),
        gaps=last("gaps"),
        contacts=last("contacts"),
        first_impact=impact(0),
        last_impact=impact(-1),
        n_impacts=np.array([len(np.unique(run.impacts["group"])) for run in runs]),
        n_zeno=count("zeno"),
        n_liftoffs=count("liftoffs"),
        n_corners=count("corners"),
        n_flags=count("flags"),
        status=np.array([run.status for run in runs], dtype=np.uint8),
        nfev=np.array([run.nfev for run in runs]),
        events=[{name: getattr(run, name) for name in tables} for run in runs]
        if save == "events"
        else None,
        runs=runs if save == "runs" else None,
        config=config,
    )
