"""Server of the page; a token restricts the access."""

from __future__ import annotations

import contextlib
import hmac
import ipaddress
import os
import socket
import sys
import threading
import time
import webbrowser
from collections.abc import Awaitable, Callable, MutableMapping
from pathlib import Path
from typing import Any, NoReturn, TypeAlias
from urllib.parse import parse_qs

import marimo
import uvicorn

# Who may see the page: a browser that was given the address with its token.
#
# By default the page is served to this machine only, with ``--host`` to others as well. Any page
# that is open in a browser can send requests to this machine. A request must therefore have this
# server's own name in ``Host`` (against DNS rebinding), must not come from another origin
# (``Origin``), and must contain the token as the first part of its path.

Message: TypeAlias = MutableMapping[str, Any]
Receive: TypeAlias = Callable[[], Awaitable[Message]]
Send: TypeAlias = Callable[[Message], Awaitable[None]]
App: TypeAlias = Callable[[Message, Receive, Send], Awaitable[None]]

LOOPBACK = ("127.0.0.1", "localhost")
"""Names of this machine for itself."""
MOST_SESSIONS = 16
"""Pages that are open at a time; each has a thread that computes."""
SESSION_PATHS = ("ws", "sse")
"""What a page asks for when it opens a session."""
REFUSED = b"zivi lab: open the address that the command has printed\n"
FULL = b"zivi lab: too many pages are open; close some and wait a minute\n"
# the page of marimo has scripts and styles in its text, and makes code of texts; nothing may come
# from another server or go to one
POLICY = (
    b"default-src 'self'; script-src 'self' 'unsafe-inline' 'unsafe-eval' blob:; "
    b"style-src 'self' 'unsafe-inline'; img-src 'self' data: blob:; font-src 'self' data:; "
    b"worker-src 'self' blob:; frame-src 'self' blob: data:; object-src 'none'; "
    b"base-uri 'self'; form-action 'self'; frame-ancestors 'none'"
)
SAFE = (
    (b"content-security-policy", POLICY),
    (b"referrer-policy", b"no-referrer"),  # the address holds the token
    (b"x-frame-options", b"DENY"),
    (b"x-content-type-options", b"nosniff"),
    (b"cross-origin-resource-policy", b"same-origin"),
)


class RequestGate:
    """Rejects requests with 403, as an ASGI application before another one.

    Parameters
    ----------
    app : callable
        The application, mounted at ``/TOKEN``.
    port : int
        Port of the server.
    names : tuple of str
        Accepted host names and addresses of the server.
    any_address : bool
        Whether every numerical address is one of them, for a server that listens on all of its
        machine: an attacker can only point a name at it.
    token : str
        First part of every path.
    lasting : float
        Time (s) for which the application keeps a session whose page was closed.
    """

    def __init__(
        self,
        app: App,
        *,
        port: int,
        token: str,
        lasting: float,
        names: tuple[str, ...] = LOOPBACK,
        any_address: bool = False,
    ) -> None:
        self._app, self._token, self._lasting = app, token, lasting
        self._port, self._any_address = port, any_address
        self._names = {name.lower() for name in names}
        self._open: dict[str, int] = {}
        self._closed: dict[str, float] = {}

    async def __call__(self, scope: Message, receive: Receive, send: Send) -> None:
        """Answer one request."""
        if scope["type"] == "lifespan":
            await self._app(scope, receive, send)
        elif not self._may_enter(scope):
            await _refuse(scope, send, REFUSED)
        elif scope["path"].rpartition("/")[2] in SESSION_PATHS:
            await self._in_session(scope, receive, send)
        else:
            await self._app(scope, receive, _guarded(send))

    def _may_enter(self, scope: Message) -> bool:
        hosts, origins = _header_values(scope, b"host"), _header_values(scope, b"origin")
        token = scope["path"].split("/", 2)[1] if scope["path"].startswith("/") else ""
        return (
            len(hosts) == 1
            and self._is_ours(hosts[0])
            and all(origin == b"http://" + hosts[0] for origin in origins)
            and hmac.compare_digest(token.encode(), self._token.encode())
        )

    def _is_ours(self, host: bytes) -> bool:
        name, colon, port = host.decode("latin-1").lower().rpartition(":")
        if not colon and self._port == 80:
            name, port = port, "80"
        if port != str(self._port):
            return False
        return name in self._names or (self._any_address and _is_address(name))

    async def _in_session(self, scope: Message, receive: Receive, send: Send) -> None:
        asked = parse_qs(scope.get("query_string", b"").decode("latin-1"))
        session = asked.get("session_id", [""])[0]
        now = time.monotonic()
        self._closed = {it: end for it, end in self._closed.items() if end + self._lasting > now}
        known = self._open.keys() | self._closed.keys()
        if session not in known and len(known) >= MOST_SESSIONS:
            await _refuse(scope, send, FULL)
            return
        self._open[session] = self._open.get(session, 0) + 1
        try:
            await self._app(scope, receive, _guarded(send))
        finally:
            self._open[session] -= 1
            if not self._open[session]:
                del self._open[session]
                self._closed[session] = time.monotonic()


def _is_address(name: str) -> bool:
    try:
        ipaddress.IPv4Address(name)
    except ValueError:
        return False
    return True


def _header_values(scope: Message, wanted: bytes) -> list[bytes]:
    return [value for name, value in scope["headers"] if name == wanted]


def _guarded(send: Send) -> Send:
    """Remove headers with which the application allows access from other origins."""

    async def guarded(message: Message) -> None:
        if message["type"] == "http.response.start":
            kept = [it for it in message["headers"] if not it[0].startswith(b"access-control-")]
            message = {**message, "headers": [*kept, *SAFE]}
        await send(message)

    return guarded


async def _refuse(scope: Message, send: Send, text: bytes) -> None:
    if scope["type"] == "websocket":  # before it is accepted: the server answers 403
        await send({"type": "websocket.close", "code": 1008})
        return
    headers = [(b"content-type", b"text/plain; charset=utf-8"), *SAFE]
    await send({"type": "http.response.start", "status": 403, "headers": headers})
    await send({"type": "http.response.body", "body": text})


# Serve the page, on loopback or, where that is requested, to other machines.

HOST = LOOPBACK[0]
EVERYWHERE = "0.0.0.0"
"""The host that stands for all interfaces of the machine."""
PAGE = Path(__file__).with_name("page.py")
MATHJAX = "https://cdn.jsdelivr.net/npm/mathjax-full@3.2.2/es5/tex-mml-svg.min.js"
# marimo's plots load this script from the network if it is missing; the page has no formulas that
# need it
LASTING = 60
"""Seconds for which what a closed page has chosen is kept, so that a lost connection can return."""
# the space between menu and tabs, and from the sidebar to the edge, is for the output
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
    """Bind a port of an interface; 0 for any free one.

    Raises
    ------
    OSError
        If it is taken, or the host is none of this machine.
    """
    return socket.create_server((host, port))


def names(host: str) -> tuple[str, ...]:
    """Return the accepted names of a server on this host, the preferred one first."""
    if host in LOOPBACK:
        return LOOPBACK
    return (socket.gethostname(), *LOOPBACK) if host == EVERYWHERE else (host,)


def address(listener: socket.socket, token: str, host: str = HOST) -> str:
    """Return the address of the page, with the token that opens it."""
    return f"http://{names(host)[0]}:{listener.getsockname()[1]}/{token}/"


def serve(listener: socket.socket, token: str, *, browser: bool, host: str = HOST) -> NoReturn:
    """Serve the page, an app whose code cannot be edited, until Ctrl-C; it ends the process."""
    app = marimo.create_asgi_app(quiet=True, html_head=HEAD, session_ttl=LASTING)
    page = app.with_app(path=f"/{token}", root=str(PAGE)).build()
    gate = RequestGate(
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
