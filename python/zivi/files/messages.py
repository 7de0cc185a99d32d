"""What the commands say, to whoever still listens."""

from __future__ import annotations

import contextlib
import json
import os
import sys
from typing import Any

import typer
from rich.console import Console
from rich.table import Table

__all__ = ["say", "show_record", "show_table", "warn"]


def say(text: str, *, end: str = "\n") -> None:
    """Print on standard output; a reader that has left (a closed pipe) is no error.

    Parameters
    ----------
    text : str
        What is said.
    end : str
        What follows it.

    Raises
    ------
    OSError
        If standard output cannot be written for another reason.
    """
    try:
        typer.echo(text + end, nl=False)
    except OSError as error:
        # what Python still holds back must go somewhere when it ends
        with contextlib.suppress(OSError, ValueError, AttributeError):
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        if not isinstance(error, BrokenPipeError):
            reason = error.strerror or str(error)
            raise OSError(f"standard output cannot be written: {reason}") from error


def show_table(table: Table) -> None:
    """Print a table as `say` does."""
    console = Console()
    with console.capture() as drawn:
        console.print(table)
    say(drawn.get(), end="")


def show_record(record: dict[str, Any]) -> None:
    """Print plain values as one line of JSON."""
    say(json.dumps(record, allow_nan=False, ensure_ascii=False))


def warn(text: str) -> None:
    """Print one line on standard error, if there is any."""
    with contextlib.suppress(OSError):
        typer.echo(text, err=True)
