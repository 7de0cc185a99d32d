"""Writes the figures, the data behind each, and the tables."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import TYPE_CHECKING

from zivi.closed_loop import ClosedLoop
from zivi.methods import ThetaGamma
from zivi.paper import (
    ball,
    chattering,
    linearisation,
    regulator,
    report,
    rest,
    robustness,
    tracker,
)
from zivi.paper.checks import Check, save
from zivi.paper.closed_loops import regulate
from zivi.trajectory import Trajectory

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["Reproduction", "write"]


@dataclasses.dataclass(frozen=True)
class Reproduction:
    """What `write` found.

    Parameters
    ----------
    checks : list of Check
        Every checked number.
    rates : list of linearisation.Rate
        How often the linearisations of section V.A fail; this and what follows is measured, not
        checked.
    chattering : list of chattering.Chattering
        Explicit beside implicit signs in the controller.
    robustness : list of robustness.Robustness
        The tracker under disturbances.
    rests : list of rest.Rest
        For which restitutions the tracker comes to exact rest.
    """

    checks: list[Check]
    rates: list[linearisation.Rate]
    chattering: list[chattering.Chattering]
    robustness: list[robustness.Robustness]
    rests: list[rest.Rest]

    @property
    def ok(self) -> bool:
        """Whether every checked number agrees."""
        return all(check.ok for check in self.checks)


def write(out: Path | str) -> Reproduction:
    """Write the paper's figures and numbers.

    Parameters
    ----------
    out : path
        Folder, made if needed: a PNG for each figure, a CSV with the data behind it, and a CSV
        for each table (``checks``, ``linearisation``, ``chattering``, ``robustness``, ``rest``).

    Returns
    -------
    Reproduction
        The checked numbers and what was measured.

    Examples
    --------
    >>> import tempfile
    >>> from zivi.paper import write
    >>> write(tempfile.mkdtemp()).ok
    True
    """
    folder = Path(out)
    folder.mkdir(parents=True, exist_ok=True)
    checks = _ball(folder) + _regulator(folder) + _tracker(folder)
    _chattering(folder)
    found = Reproduction(
        checks=checks,
        rates=linearisation.measure(),
        chattering=chattering.measure(),
        robustness=robustness.measure(),
        rests=rest.measure(),
    )
    save(found.checks, folder / "checks.csv")
    linearisation.save(found.rates, folder / "linearisation.csv")
    report.save(found.chattering, folder / "chattering.csv")
    report.save(found.robustness, folder / "robustness.csv")
    report.save(found.rests, folder / "rest.csv")
    return found


def _ball(folder: Path) -> list[Check]:
    sol = ball.run(ThetaGamma(ball.H))
    for name, (figure, quantities) in ball.figures(sol).items():
        _save_figure(figure, folder / f"{name}.png")
        _save_data(sol, quantities, folder / f"{name}.csv")
    figure, runs = ball.explicit_and_implicit()
    _save_figure(figure, folder / "explicit_and_implicit.png")
    for name, run in runs.items():
        _save_data(run, ["x", "xdot", "s", "v"], folder / f"explicit_and_implicit_{name}.csv")
    return ball.checks(sol)


def _regulator(folder: Path) -> list[Check]:
    run = regulate()
    _save_figure(regulator.figure(run), folder / "fig5_regulator.png")
    _save_loop(run, folder / "fig5_regulator.csv")
    return regulator.checks()


def _tracker(folder: Path) -> list[Check]:
    runs = tracker.runs()
    run = next(iter(runs.values()))
    for name, figure in tracker.figures(run).items():
        _save_figure(figure, folder / f"{name}.png")
        _save_loop(run, folder / f"{name}.csv")
    _save_figure(tracker.sampled_and_paper(runs), folder / "tracking_loops.png")
    for name, run in runs.items():
        _save_loop(run, folder / f"tracking_loops_{name}.csv")
    return tracker.checks(runs)


def _chattering(folder: Path) -> None:
    figure, runs = chattering.figure()
    _save_figure(figure, folder / "chattering.png")
    for name, run in runs.items():
        _save_loop(run, folder / f"chattering_{name}.csv")


def _save_figure(figure: Figure, path: Path) -> None:
    import matplotlib.pyplot as plt

    figure.savefig(path, dpi=200)
    plt.close(figure)


def _save_data(sol: Trajectory, quantities: list[str], path: Path) -> None:
    sol.to_xarray()[quantities].to_dataframe().to_csv(path)


def _save_loop(run: ClosedLoop, path: Path) -> None:
    """Write all samples; of a loop without a reference those columns are missing."""
    data = run.to_xarray()
    signs = data["signs"].to_dataset("sign")
    sampled = data[["x", "xdot", "x_ref", "xdot_ref", "u"]].merge(signs)
    sampled.to_dataframe().dropna(axis="columns", how="all").to_csv(path)
