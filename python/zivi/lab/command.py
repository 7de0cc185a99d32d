"""The command ``zivi lab``."""

from __future__ import annotations

import secrets
from typing import Annotated

import typer

from zivi.base.extras import have

NEEDED = ("marimo", "plotly", "uvicorn")
PORT = 2718
WRONG = 2
"""Exit code where nothing could be started."""


def lab(
    port: Annotated[int, typer.Option(min=0, max=65535, help="Port; 0 takes a free one.")] = PORT,
    host: Annotated[
        str,
        typer.Option(
            help="IPv4 address or name of this machine under which others can reach the page; "
            "0.0.0.0 for all."
        ),
    ] = "127.0.0.1",
    browser: Annotated[
        bool, typer.Option("--browser/--no-browser", help="Open the page in the browser.")
    ] = True,
) -> None:
    """Serve the interactive page: ball, regulator, tracker and belt.

    Without --host only this machine can reach it, and only with the printed address, which contains
    a new token at each start. Exit code 2 if it cannot be served; Ctrl-C ends it.
    """
    missing = [module for module in NEEDED if not have(module)]
    if missing:
        raise _error_exit(f"the page needs {', '.join(missing)}: pip install 'zivi[lab]'")
    from zivi.lab.server import LOOPBACK, address, listen, serve

    try:
        listener = listen(port, host)
    except OSError as error:
        why = str(error.strerror).partition(" (while ")[0]
        where = f"port {port}" if host in LOOPBACK else f"port {port} of host {host}"
        said = f"{where} cannot be used ({why}); --port 0 takes a free one"
        raise _error_exit(said) from None
    token = secrets.token_urlsafe(16)
    typer.echo(f"zivi lab: {address(listener, token, host)} (Ctrl-C ends it)")
    serve(listener, token, browser=browser, host=host)


def _error_exit(message: str) -> typer.Exit:
    typer.echo(f"zivi: {message}", err=True)
    return typer.Exit(WRONG)
