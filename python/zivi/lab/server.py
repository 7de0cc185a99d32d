"""Serve the page on loopback."""

from __future__ import annotations

import contextlib
import os
import socket
import sys
import threading
import webbrowser
from pathlib import Path
from typing import NoReturn

import marimo
import uvicorn

from zivi.lab.gate import Gate

__all__ = ["HOST", "address", "listen", "serve"]

HOST = "127.0.0.1"
PAGE = Path(__file__).with_name("page.py")
MATHJAX = "https://cdn.jsdelivr.net/npm/mathjax-full@3.2.2/es5/tex-mml-svg.min.js"
# marimo's plots look for this script and load it from the network where it is missing; the page has
# no formulas that need it
LASTING = 60
"""Seconds for which what a closed page has chosen is kept, so that a lost connection can return."""
HEAD = f'<script type="text/plain" data-status="error" src="{MATHJAX}"></script>'


def listen(port: int) -> socket.socket:
    """Take a port of the loopback interface, 0 for any that is free.

    Raises
    ------
    OSError
        If it is taken.
    """
    return socket.create_server((HOST, port))


def address(listener: socket.socket, token: str) -> str:
    """Give the address of the page, with the token that opens it."""
    return f"http://{HOST}:{listener.getsockname()[1]}/{token}/"


def serve(listener: socket.socket, token: str, *, browser: bool) -> NoReturn:
    """Serve the page, an app whose code cannot be edited, until Ctrl-C; it ends the process."""
    app = marimo.create_asgi_app(quiet=True, html_head=HEAD, session_ttl=LASTING)
    page = app.with_app(path=f"/{token}", root=str(PAGE)).build()
    gate = Gate(page, port=listener.getsockname()[1], token=token, lasting=LASTING)
    config = uvicorn.Config(
        gate, log_level="warning", timeout_graceful_shutdown=1, proxy_headers=False
    )
    if browser:  # it waits for the answer of the server below
        url = address(listener, token)
        threading.Thread(target=webbrowser.open, args=(url,), daemon=True).start()
    with contextlib.suppress(KeyboardInterrupt):
        uvicorn.Server(config).run(sockets=[listener])
    sys.stdout.flush()
    os._exit(0)  # the threads of open pages would wait for their browsers
