"""The command ``zivi lab``."""

from __future__ import annotations

import importlib
import secrets
from typing import Annotated

import typer

__all__ = ["lab"]

NEEDED = ("marimo", "plotly", "uvicorn")
PORT = 2718
WRONG = 2
"""Exit code where nothing could be started."""


def lab(
    port: Annotated[
        int, typer.Option(min=0, max=65535, help="Port on 127.0.0.1; 0 takes a free one.")
    ] = PORT,
    browser: Annotated[
        bool, typer.Option("--browser/--no-browser", help="Open the page in the browser.")
    ] = True,
) -> None:
    """Serve the interactive page: ball, regulator and tracker with sliders.

    Only this machine can reach it, and only with the address that is printed: it holds a token that
    is new every time. Exit code 2 if it cannot be served; Ctrl-C ends it.
    """
    for module in NEEDED:
        try:
            importlib.import_module(module)
        except ImportError:
            raise _failed(f"the page needs {module}: pip install 'zivi[lab]'") from None
    from zivi.lab.server import address, listen, serve

    try:
        listener = listen(port)
    except OSError as error:
        said = f"port {port} cannot be used ({error.strerror}); --port 0 takes a free one"
        raise _failed(said) from None
    token = secrets.token_urlsafe(16)
    typer.echo(f"zivi lab: {address(listener, token)} (Ctrl-C ends it)")
    serve(listener, token, browser=browser)


def _failed(message: str) -> typer.Exit:
    typer.echo(f"zivi: {message}", err=True)
    return typer.Exit(WRONG)
