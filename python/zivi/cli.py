"""The command line: ``zivi paper``."""

from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from zivi import _zivi

app = typer.Typer(
    help="Mechanical systems with impacts, straight through the Zeno point.",
    no_args_is_help=True,
    add_completion=False,
)


def _version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"zivi {_zivi.__version__}")
        raise typer.Exit


@app.callback()
def main(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Print the version.")
    ] = False,
) -> None:
    """Mechanical systems with impacts, straight through the Zeno point."""


@app.command()
def paper(
    out: Annotated[Path, typer.Option(help="Folder for the figures, their data and the table.")],
) -> None:
    """Write the figures and the numbers of the paper; exit 1 if a number is off."""
    import matplotlib as mpl

    mpl.use("Agg")
    from zivi.paper import chattering, checks, linearisation, rest, robustness, write

    console = Console()
    with console.status("computing"):
        found = write(out)
    console.print(linearisation.table(found.rates))
    console.print(chattering.table(found.chattering))
    console.print(robustness.table(found.robustness))
    console.print(rest.table(found.rests))
    console.print(checks.table(found.checks))
    console.print(f"Figures, the data behind them and all tables (CSV): {out}")
    if not found.ok:
        console.print("[bold red]A number is off.[/]")
        raise typer.Exit(1)
