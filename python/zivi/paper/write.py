"""``zivi paper``: the figures, the data behind each, and the tables, stage by stage."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Collection, Iterable, Iterator
from pathlib import Path
from typing import Any

from rich.console import Console, RenderableType
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

from zivi.paper import ball, chattering, linearisation, regulator, report, rest, robustness, tracker
from zivi.paper.closed_loops import regulate
from zivi.paper.report import Check, Picture, save_checks
from zivi.simulation.methods import ThetaGamma

__all__ = [
    "STAGES",
    "Reproduction",
    "check",
    "run",
    "write",
]

# Writes the figures, the data behind each, and the tables, stage by stage.


@dataclasses.dataclass
class Reproduction:
    """What `write` found; lists of stages that were left out are empty.

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
        Folder, made if needed: a PNG for each figure, a CSV with the data behind it, and a CSV
        for each table (``checks``, ``linearisation``, ``chattering``, ``robustness``, ``rest``).
        A CSV of data begins with ``#`` lines that say what was computed.
    only : collection of str, optional
        The stages to run, of `STAGES`; by default all.
    report : callable, optional
        Called before each stage and at the end with its name, the number of stages done, and of
        stages in all.

    Returns
    -------
    Reproduction
        The checked numbers and what was measured.

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
        STAGES[name](folder, found)
    if report is not None:
        report("", len(chosen), len(chosen))
    if found.checks:
        save_checks(found.checks, folder / "checks.csv")
    return found


def _ball(folder: Path, found: Reproduction) -> None:
    sol = ball.run(ThetaGamma(ball.H))
    _save_all(ball.figures(sol), folder)
    ball.explicit_and_implicit().save(folder)
    found.checks += ball.checks(sol)


def _regulator(folder: Path, found: Reproduction) -> None:
    _save_all(regulator.figures(regulate()), folder)
    found.checks += regulator.checks()


def _tracker(folder: Path, found: Reproduction) -> None:
    runs = tracker.runs()
    _save_all(tracker.figures(next(iter(runs.values()))), folder)
    tracker.sampled_and_paper(runs).save(folder)
    found.checks += tracker.checks(runs)


def _linearisation(folder: Path, found: Reproduction) -> None:
    found.rates = linearisation.measure()
    linearisation.save(found.rates, folder / "linearisation.csv")


def _chattering(folder: Path, found: Reproduction) -> None:
    chattering.figure().save(folder)
    found.chattering = chattering.measure()
    _save_rows(found.chattering, folder / "chattering.csv")


def _robustness(folder: Path, found: Reproduction) -> None:
    found.robustness = robustness.measure()
    _save_rows(found.robustness, folder / "robustness.csv")


def _rest(folder: Path, found: Reproduction) -> None:
    found.rests = rest.measure()
    _save_rows(found.rests, folder / "rest.csv")


STAGES: dict[str, Callable[[Path, Reproduction], None]] = {
    "ball": _ball,
    "regulator": _regulator,
    "tracker": _tracker,
    "linearisation": _linearisation,
    "chattering": _chattering,
    "robustness": _robustness,
    "rest": _rest,
}
"""What can be run on its own: the first three are the paper's figures and checked numbers."""


def _save_all(pictures: Iterable[Picture], folder: Path) -> None:
    for picture in pictures:
        picture.save(folder)


def _save_rows(rows: list[Any], path: Path) -> None:
    report.save(rows, path)


# ``zivi paper``: progress over the stages, tables, and a last line.


def check(only: Collection[str] | None) -> None:
    """Raise ValueError for a stage that does not exist."""
    for name in only or ():
        if name not in STAGES:
            raise ValueError(f"zivi: --only must be one of {', '.join(STAGES)}, got {name!r}")


def run(out: Path, only: Collection[str] | None, *, quiet: bool) -> bool:
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
        for table in _tables(found):
            console.print(table)
        console.print(f"Figures, the data behind them and all tables (CSV): {out}", soft_wrap=True)
    if found.checks:
        style = "" if found.ok else "bold red"
        console.print(f"{found.agreeing} of {len(found.checks)} agree", style=style)
    elif not quiet:
        console.print("Measured, nothing to check")
    return found.ok


def _tables(found: Reproduction) -> Iterator[RenderableType]:
    if found.rates:
        yield linearisation.table(found.rates)
    if found.chattering:
        yield chattering.table(found.chattering)
    if found.robustness:
        yield robustness.table(found.robustness)
    if found.rests:
        yield rest.table(found.rests)
    if found.checks:
        yield report.checks_table(found.checks)
