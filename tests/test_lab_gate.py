"""Other pages in the browser, other names and the wrong token get 403 from a running server."""

import asyncio
import contextlib
import http.client
import json
import socket
import urllib.parse

import pytest

from inside import MOST_SESSIONS, RequestGate
from lab_server import PROGRAM, serving

TOKEN = "abcdefghijklmnopqrstuv"
FEW = f"import zivi.lab.server as server; server.MOST_SESSIONS = 2; {PROGRAM}"


class TestServer:
    @pytest.fixture(scope="class")
    @staticmethod
    def address():
        for module in ("marimo", "plotly", "uvicorn"):
            pytest.importorskip(module)
        with serving(FEW) as (_, url):
            yield urllib.parse.urlsplit(url)

    @staticmethod
    def get(address, path=None, **headers):
        server = http.client.HTTPConnection(address.netloc, timeout=30)
        given = {name.replace("_", "-"): value for name, value in headers.items()}
        with contextlib.closing(server):
            server.request(given.pop("method", "GET"), path or address.path, headers=given)
            answer = server.getresponse()
            return answer.status, dict(answer.getheaders()), answer.read()

    @staticmethod
    def connect(address, path=None, session="s_1", host=None, origin=None):
        """Open a session as the page does; give it, or the status of the refusal."""
        client = pytest.importorskip("websockets.sync.client")
        exceptions = pytest.importorskip("websockets.exceptions")
        host = host or address.netloc
        try:
            return client.connect(
                f"ws://{host}{path or address.path}ws?session_id={session}",
                sock=socket.create_connection((address.hostname, address.port)),
                origin=origin or f"http://{host}",
                open_timeout=30,
                close_timeout=1,
            )
        except exceptions.InvalidStatus as refused:
            return refused.response.status_code

    def test_the_address_that_was_printed_opens_the_page(self, address):
        status, headers, page = self.get(address)
        assert status == 200
        assert b"zivi lab" in page
        assert headers["referrer-policy"] == "no-referrer"
        policy = headers["content-security-policy"]
        assert "default-src 'self'" in policy
        assert "object-src 'none'" in policy
        assert "http" not in policy
        own = f"http://{address.netloc}"
        status, headers, _ = self.get(address, Origin=own)
        assert status == 200
        assert not [name for name in headers if name.lower().startswith("access-control")]
        port = address.port
        assert self.get(address, Host=f"localhost:{port}")[0] == 200
        assert (
            self.get(address, Host=f"localhost:{port}", Origin=f"http://localhost:{port}")[0] == 200
        )

    def test_strangers_get_403(self, address):
        token = address.path.strip("/")
        wrong = [
            {"Origin": "http://evil.example"},
            {"Origin": "null"},
            {"Origin": f"http://127.0.0.1:{address.port + 1}"},
            {"Origin": f"https://{address.netloc}"},
            {"Origin": f"http://localhost:{address.port}"},
            {"Host": "evil.example"},
            {"Host": f"evil.example:{address.port}"},
            {"Host": "127.0.0.1"},
            {
                "Host": f"evil.example:{address.port}",
                "Origin": f"http://evil.example:{address.port}",
            },
            {"method": "OPTIONS", "Origin": "http://evil.example"},
            {"method": "POST", "Origin": "http://evil.example"},
            {"path": "/"},
            {"path": "/ws"},
            {"path": "/health"},
            {"path": f"/{token[:-1]}/"},
            {"path": f"/{token}x/"},
            {"path": f"//{token}/"},
            {"path": f"/x/../{token}/"},
            {"path": f"/?token={token}"},
        ]
        for given in wrong:
            status, headers, text = self.get(address, **given)
            assert status == 403, given
            assert not [name for name in headers if name.lower().startswith("access-control")]
            assert b"zivi/lab" not in text

    def test_strangers_cannot_open_sessions(self, address):
        assert self.connect(address, origin="http://evil.example") == 403
        assert self.connect(address, host=f"evil.example:{address.port}") == 403
        assert self.connect(address, path="/") == 403
        assert self.connect(address, path="/x/") == 403

    def test_sessions_are_few(self, address):
        first, second = (self.connect(address, session=f"s_{k}") for k in (1, 2))
        with first, second:
            assert json.loads(first.recv(timeout=30))["op"]
            assert self.connect(address, session="s_3") == 403
        # what they have chosen is still kept
        assert self.connect(address, session="s_3") == 403
        status, _, text = self.get(address, path=f"{address.path}sse?session_id=s_4")
        assert status == 403
        assert b"too many pages are open" in text


@pytest.mark.parametrize(
    ("host", "everywhere", "enters"),
    [
        ("desk:2718", False, True),
        ("DESK:2718", False, True),
        ("desk:2719", False, False),
        ("desk", False, False),
        ("desk:2718", True, True),
        ("192.168.1.5:2718", True, True),
        ("192.168.1.5:2718", False, False),
        ("evil.example:2718", True, False),
        ("192.168.1.5.evil.example:2718", True, False),
        ("[::1]:2718", True, False),
    ],
)
def test_by_which_names_a_server_for_others_is_asked(host, everywhere, enters):
    async def page(scope, receive, send):
        await send({"type": "http.response.start", "status": 200, "headers": []})

    said = []

    async def send(message):
        said.append(message)

    gate = RequestGate(
        page, port=2718, token=TOKEN, lasting=60.0, names=("desk",), any_address=everywhere
    )
    scope = {"type": "http", "path": f"/{TOKEN}/", "headers": [(b"host", host.encode())]}
    asyncio.run(gate(scope, None, send))
    assert said[0]["status"] == (200 if enters else 403)
    scope["path"] = "/"
    said.clear()
    asyncio.run(gate(scope, None, send))
    assert said[0]["status"] == 403


def test_a_session_that_has_ended_makes_room(monkeypatch):
    clock = [0.0]
    monkeypatch.setattr("zivi.lab.server.time.monotonic", lambda: clock[0])
    leave, entered, said = asyncio.Event(), [], []

    async def page(scope, receive, send):
        entered.append(scope["query_string"])
        await leave.wait()

    gate = RequestGate(page, port=80, token=TOKEN, lasting=60.0)

    async def send(message):
        said.append(message)

    def opened(number):
        headers = [(b"host", b"127.0.0.1")]
        query = f"session_id=s_{number}".encode()
        scope = {"type": "websocket", "path": f"/{TOKEN}/ws", "headers": headers}
        return asyncio.ensure_future(gate(scope | {"query_string": query}, None, send))

    async def story():
        many = [opened(number) for number in range(MOST_SESSIONS)]
        await asyncio.sleep(0)
        await opened(MOST_SESSIONS)
        assert said == [{"type": "websocket.close", "code": 1008}]
        again = opened(0)  # one that is known
        await asyncio.sleep(0)
        assert len(entered) == MOST_SESSIONS + 1
        leave.set()
        await asyncio.gather(again, *many)
        await opened(MOST_SESSIONS)
        assert len(said) == 2
        clock[0] = 61.0
        await opened(MOST_SESSIONS)
        assert len(said) == 2
        assert len(entered) == MOST_SESSIONS + 2

    asyncio.run(story())
