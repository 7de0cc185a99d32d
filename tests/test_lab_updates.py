"""Changes that reach the page's kernel at once: none is lost. Without a browser."""

import contextlib
import json
import re
import time
import urllib.error
import urllib.parse
import urllib.request

import pytest

from lab_server import serving

for module in ("marimo", "plotly", "uvicorn"):
    pytest.importorskip(module, reason=f"the lab needs {module} (zivi[lab])")
websockets = pytest.importorskip("websockets.sync.client")

pytestmark = [pytest.mark.slow, pytest.mark.xdist_group("lab")]
WAIT = 60.0
SLIDER = r"object-id='([^']+)'[^>]*><marimo-slider ([^>]*)>"


class Kernel:
    """The page as its program in the browser sees it."""

    def __init__(self, url, socket, token):
        self.url, self.socket, self.token = url, socket, token

    def output(self, pattern):
        """Wait for the output of a cell in which a text is found, and give it."""
        while True:
            said = json.loads(self.socket.recv(timeout=WAIT))
            output = said["op"] == "cell-op" and said["data"].get("output")
            if output and re.search(pattern, str(output["data"])):
                return str(output["data"])

    def move(self, values):
        """Send new values of controls in one request."""
        moved = {"objectIds": list(values), "values": list(values.values())}
        headers = {
            "Content-Type": "application/json",
            "Marimo-Session-Id": "s_1",
            "Marimo-Server-Token": self.token,
        }
        asked = urllib.request.Request(
            f"{self.url}api/kernel/set_ui_element_value", json.dumps(moved).encode(), headers
        )
        with urllib.request.urlopen(asked, timeout=WAIT) as answer:
            assert json.loads(answer.read())["success"]


@pytest.fixture
def kernel():
    with serving() as (_, url), contextlib.ExitStack() as stack:
        page = loaded(url)
        token = re.search(r'"serverToken": "([^"]+)"', page)[1]
        parts = urllib.parse.urlsplit(url)
        socket = websockets.connect(
            f"ws://{parts.netloc}{parts.path}ws?session_id=s_1", origin=f"http://{parts.netloc}"
        )
        yield Kernel(url, stack.enter_context(socket), token)


def loaded(url):
    end = time.monotonic() + WAIT
    while True:
        try:
            with urllib.request.urlopen(url, timeout=WAIT) as answer:
                return answer.read().decode()
        except urllib.error.URLError:
            assert time.monotonic() < end
            time.sleep(0.1)


def test_two_sliders_that_move_at_once_both_count(kernel):
    sliders = dict(reversed(found) for found in re.findall(SLIDER, kernel.output("marimo-slider")))
    restitution = next(it for label, it in sliders.items() if "e, restitution" in label)
    gravity = next(it for label, it in sliders.items() if "gravity" in label)
    kernel.output("Python for")
    kernel.move({restitution: 0.6, gravity: 5.0})
    shown = re.sub("<[^>]*>", "", kernel.output("Python for"))
    assert "ImpactSystem(force, e=0.6)" in shown
    assert "LinearForce(gravity=5.0," in shown
