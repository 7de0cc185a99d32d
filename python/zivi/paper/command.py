"""``zivi paper``: progress over the stages, tables, and a last line."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from pathlib import Path

from rich.console import Console, RenderableType
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

from zivi.paper import chattering, checks, linearisation, rest, robustness
from zivi.paper.write import STAGES, Reproduction, write

__all__ = ["check", "run"]


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
        yield checks.table(found.checks)
