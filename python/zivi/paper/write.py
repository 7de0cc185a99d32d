"""``zivi paper``: the figures, their data, and the tables, stage by stage."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Collection, Iterable, Iterator
from pathlib import Path

from matplotlib import style
from rich.console import Console, RenderableType
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

from zivi.paper import ball, chattering, linearisation, regulator, report, rest, robustness, tracker
from zivi.paper.closed_loops import regulate
from zivi.paper.report import Check, PaperFigure, save_checks
from zivi.simulation.methods import ThetaGamma

# Writes the figures, their data, and the tables, stage by stage.


@dataclasses.dataclass
class Reproduction:
    """Results of `write`; lists of skipped stages are empty.

    Parameters
    ----------
    checks : list of Check
        Every checked number.
    rates : list of linearisation.Rate
        Failure rates of the linearisations of section V.A; this and the following are measured, not
        checked.
    chattering : list of chattering.Chattering
        Explicit and implicit signs in the controller.
    robustness : list of robustness.Robustness
        The tracker under disturbances.
    rests : list of rest.Rest
        For which restitutions the tracker comes to exact rest.
    """

    checks: list[Check] = dataclasses.field(default_factory=list)
    rates: list[linearisation.Rate] = dataclasses.field(default_factory=list)
    chattering: list[chattering.Chattering] = dataclasses.field(default_factory=list)
    robustness: list[robustness.Robustness] = dataclasses.field(default_factory=list)
    rests: list[rest.Rest] = dataclasses.field(default_factory=list)

    @property
    def agreeing(self) -> int:
        """How many of the checked numbers agree."""
        return sum(check.ok for check in self.checks)

    @property
    def ok(self) -> bool:
        """Whether every checked number agrees."""
        return self.agreeing == len(self.checks)


def write(
    out: Path | str,
    only: Collection[str] | None = None,
    report: Callable[[str, int, int], None] | None = None,
) -> Reproduction:
    """Write the paper's figures and numbers.

    Parameters
    ----------
    out : path
        Folder, created if needed: a PNG and a CSV of the data for each figure, and a CSV for each
        table (``checks``, ``linearisation``, ``chattering``, ``robustness``, ``rest``). A CSV of
        data begins with ``#`` lines that describe the computation.
    only : collection of str, optional
        The stages to run, of `STAGES`; by default all.
    report : callable, optional
        Called before each stage and at the end with its name, the number of completed stages and
        their total.

    Returns
    -------
    Reproduction
        The checked and the measured numbers.

    Raises
    ------
    ValueError
        For a stage that does not exist; nothing is computed.

    Examples
    --------
    >>> import tempfile
    >>> from zivi.paper import write
    >>> write(tempfile.mkdtemp(), only=["regulator"]).ok
    True
    """
    unknown = sorted(set(only or ()) - set(STAGES))
    if unknown:
        raise ValueError(f"only must name stages ({', '.join(STAGES)}), got {unknown[0]!r}")
    chosen = [name for name in STAGES if only is None or name in only]
    folder = Path(out)
    folder.mkdir(parents=True, exist_ok=True)
    found = Reproduction()
    for done, name in enumerate(chosen):
        if report is not None:
            report(name, done, len(chosen))
        with style.context("zivi.plot.figures"):
            STAGES[name](folder, found)
    if report is not None:
        report("", len(chosen), len(chosen))
    if found.checks:
        save_checks(found.checks, folder / "checks.csv")
    return found


def _write_ball(folder: Path, found: Reproduction) -> None:
    sol = ball.simulate_ball(ThetaGamma(ball.H))
    _save_all(ball.draw_ball(sol), folder)
    ball.explicit_and_implicit().save(folder)
    found.checks += ball.check_ball(sol)


def _write_regulator(folder: Path, found: Reproduction) -> None:
    _save_all(regulator.draw_regulator(regulate()), folder)
    found.checks += regulator.check_regulator()


def _write_tracker(folder: Path, found: Reproduction) -> None:
    runs = tracker.runs()
    _save_all(tracker.draw_tracker(next(iter(runs.values()))), folder)
    tracker.sampled_and_paper(runs).save(folder)
    found.checks += tracker.check_tracker(runs)


def _write_linearisation(folder: Path, found: Reproduction) -> None:
    found.rates = linearisation.measure_failures()
    linearisation.save_rates(found.rates, folder / "linearisation.csv")


def _write_chattering(folder: Path, found: Reproduction) -> None:
    chattering.draw_chattering().save(folder)
    found.chattering = chattering.measure_chattering()
    report.save_rows(found.chattering, folder / "chattering.csv")


def _write_robustness(folder: Path, found: Reproduction) -> None:
    found.robustness = robustness.measure_robustness()
    report.save_rows(found.robustness, folder / "robustness.csv")


def _write_rest(folder: Path, found: Reproduction) -> None:
    found.rests = rest.measure_rest()
    report.save_rows(found.rests, folder / "rest.csv")


STAGES: dict[str, Callable[[Path, Reproduction], None]] = {
    "ball": _write_ball,
    "regulator": _write_regulator,
    "tracker": _write_tracker,
    "linearisation": _write_linearisation,
    "chattering": _write_chattering,
    "robustness": _write_robustness,
    "rest": _write_rest,
}
"""What can be run on its own: the first three are the paper's figures and checked numbers."""


def _save_all(pictures: Iterable[PaperFigure], folder: Path) -> None:
    for picture in pictures:
        picture.save(folder)


# ``zivi paper``: progress over the stages, tables, and a last line.


def check_stages(only: Collection[str] | None) -> None:
    """Raise ValueError for a stage that does not exist."""
    for name in only or ():
        if name not in STAGES:
            raise ValueError(f"zivi: --only must be one of {', '.join(STAGES)}, got {name!r}")


def reproduce(out: Path, only: Collection[str] | None, *, quiet: bool) -> bool:
    """Write everything, or the stages `only`; return whether all checked numbers agree."""
    console = Console(stderr=True)
    columns = TextColumn("{task.description:13}"), BarColumn(), MofNCompleteColumn()
    # on a terminal only, and gone when it is done
    shown = not quiet and console.is_terminal
    with Progress(
        *columns, TimeElapsedColumn(), console=console, transient=True, disable=not shown
    ) as bar:
        task = bar.add_task("", total=None)
        found = write(
            out,
            only or None,
            lambda stage, done, of: bar.update(task, description=stage, completed=done, total=of),
        )
    console = Console()
    if not quiet:
        for table in _result_tables(found):
            console.print(table)
        console.print(f"Figures, the data behind them and all tables (CSV): {out}", soft_wrap=True)
    if found.checks:
        style = "" if found.ok else "bold red"
        console.print(f"{found.agreeing} of {len(found.checks)} agree", style=style)
    elif not quiet:
        console.print("Measured, nothing to check")
    return found.ok


def _result_tables(found: Reproduction) -> Iterator[RenderableType]:
    if found.rates:
        yield linearisation.failure_tables(found.rates)
    if found.chattering:
        yield chattering.chattering_table(found.chattering)
    if found.robustness:
        yield robustness.robustness_table(found.robustness)
    if found.rests:
        yield rest.rest_table(found.rests)
    if found.checks:
        yield report.checks_table(found.checks)
