"""Serve the page, on loopback or, where that is requested, to other machines."""

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

from zivi.lab.gate import LOOPBACK, Gate

__all__ = ["HOST", "address", "listen", "serve"]

HOST = LOOPBACK[0]
EVERYWHERE = "0.0.0.0"
"""The host that stands for all interfaces of the machine."""
PAGE = Path(__file__).with_name("page.py")
MATHJAX = "https://cdn.jsdelivr.net/npm/mathjax-full@3.2.2/es5/tex-mml-svg.min.js"
# marimo's plots look for this script and load it from the network where it is missing; the page has
# no formulas that need it
LASTING = 60
"""Seconds for which what a closed page has chosen is kept, so that a lost connection can return."""
# between the menu and the tabs, and from the sidebar to the edge, there is room for what is shown
STYLE = """<style>
#App > div { padding-inline: 1.2rem !important; }
@media (max-width: 767px) { #App > div { padding-inline: 0.4rem !important; padding-top: 2.4rem; } }
</style>"""
# plots stand in as many columns as the window has room for: the address tells the server
COLUMNS = """<script>
(() => {
  const fit = () => {
    const columns = innerWidth < 700 ? "1" : innerWidth < 1150 ? "2" : "3";
    const link = document.getElementById("zivi-link");
    const here = new URL(link ? link.href : location.href);
    const shown = new URL(location.href).searchParams.get("columns") || "3";
    if (shown === columns) return;
    here.searchParams.set("columns", columns);
    location.replace(here);
  };
  let waiting;
  addEventListener("resize", () => { clearTimeout(waiting); waiting = setTimeout(fit, 400); });
  fit();
})();
</script>"""
HEAD = f'<script type="text/plain" data-status="error" src="{MATHJAX}"></script>{STYLE}{COLUMNS}'


def listen(port: int, host: str = HOST) -> socket.socket:
    """Take a port of an interface, 0 for any that is free.

    Raises
    ------
    OSError
        If it is taken, or the host is none of this machine.
    """
    return socket.create_server((host, port))


def names(host: str) -> tuple[str, ...]:
    """Give the names by which a server on this host may be asked for, the best one first."""
    if host in LOOPBACK:
        return LOOPBACK
    return (socket.gethostname(), *LOOPBACK) if host == EVERYWHERE else (host,)


def address(listener: socket.socket, token: str, host: str = HOST) -> str:
    """Give the address of the page, with the token that opens it."""
    return f"http://{names(host)[0]}:{listener.getsockname()[1]}/{token}/"


def serve(listener: socket.socket, token: str, *, browser: bool, host: str = HOST) -> NoReturn:
    """Serve the page, an app whose code cannot be edited, until Ctrl-C; it ends the process."""
    app = marimo.create_asgi_app(quiet=True, html_head=HEAD, session_ttl=LASTING)
    page = app.with_app(path=f"/{token}", root=str(PAGE)).build()
    gate = Gate(
        page,
        port=listener.getsockname()[1],
        token=token,
        lasting=LASTING,
        names=names(host),
        any_address=host == EVERYWHERE,
    )
    config = uvicorn.Config(
        gate, log_level="warning", timeout_graceful_shutdown=1, proxy_headers=False
    )
    if browser:  # it waits for the answer of the server below
        url = address(listener, token, HOST if host == EVERYWHERE else host)
        threading.Thread(target=webbrowser.open, args=(url,), daemon=True).start()
    with contextlib.suppress(KeyboardInterrupt):
        uvicorn.Server(config).run(sockets=[listener])
    sys.stdout.flush()
    os._exit(0)  # the threads of open pages would wait for their browsers
