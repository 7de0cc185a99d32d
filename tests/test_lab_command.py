"""The command serves the page on loopback only, or says in one line why not."""

import socket
import subprocess
import sys
import time
import urllib.error
import urllib.parse
import urllib.request

import pytest
from typer.testing import CliRunner

from lab_server import COMMAND, serving
from zivi.cli import app

pytestmark = [pytest.mark.slow, pytest.mark.xdist_group("lab")]

run = CliRunner().invoke


@pytest.mark.parametrize("modules", [["plotly"], ["marimo", "uvicorn"]])
def test_missing_extras_are_named_in_one_line(modules, monkeypatch):
    for module in modules:
        monkeypatch.setitem(sys.modules, module, None)
    result = run(app, ["lab", "--no-browser", "--port", "0"])
    assert result.exit_code == 2
    named = ", ".join(modules)
    assert result.stderr == f"zivi: the page needs {named}: pip install 'zivi[lab]'\n"


def test_help_names_the_options():
    text = run(app, ["lab", "--help"]).stdout
    assert "--port" in text
    assert "--no-browser" in text
    assert "--host" in text


def test_a_host_that_is_not_of_this_machine_is_one_line():
    pytest.importorskip("marimo")
    result = run(app, ["lab", "--no-browser", "--host", "192.0.2.1"])
    assert result.exit_code == 2
    assert result.stderr.startswith("zivi: port 2718 of host 192.0.2.1 cannot be used (")
    assert result.stderr.count("\n") == 1


@pytest.mark.parametrize("port", ["-1", "65536", "x"])
def test_a_port_out_of_range_is_refused(port):
    assert run(app, ["lab", "--no-browser", "--port", port]).exit_code == 2


class TestServer:
    @pytest.fixture(autouse=True)
    def extra(self):
        for module in ("marimo", "plotly", "uvicorn"):
            pytest.importorskip(module)

    def test_a_port_in_use_is_one_line(self):
        with socket.create_server(("127.0.0.1", 0)) as taken:
            port = str(taken.getsockname()[1])
            command = [*COMMAND, "--port", port]
            done = subprocess.run(command, capture_output=True, text=True, timeout=60)
        assert done.returncode == 2
        assert done.stdout == ""
        assert done.stderr.startswith(f"zivi: port {port} cannot be used (")
        assert done.stderr.endswith("; --port 0 takes a free one\n")
        assert done.stderr.count("\n") == 1

    def test_the_page_is_served_on_loopback_only_and_ends_with_ctrl_c(self):
        psutil = pytest.importorskip("psutil")
        with serving() as (process, url):
            page = _page(url).decode()
            of_process = psutil.Process(process.pid).net_connections("inet")
            listening = {c.laddr.ip for c in of_process if c.status == psutil.CONN_LISTEN}
            assert listening == {"127.0.0.1"}
        assert process.stderr.closed
        assert process.returncode in (0, 130, -2)
        assert "zivi lab" in page
        # the code cannot be edited
        assert '"mode": "read"' in page
        assert "import marimo" not in page

    def test_with_a_host_others_can_reach_it_but_not_without_the_token(self):
        with serving(options=("--host", "0.0.0.0")) as (_, url):
            assert f"//{socket.gethostname()}:" in url
            port = urllib.parse.urlsplit(url).port
            token = urllib.parse.urlsplit(url).path
            assert b"zivi lab" in _page(f"http://127.0.0.2:{port}{token}")
            with pytest.raises(urllib.error.HTTPError, match="403"):
                _page(f"http://127.0.0.2:{port}/")


def _page(url):
    end = time.monotonic() + 30
    while True:
        try:
            with urllib.request.urlopen(url, timeout=10) as answer:
                return answer.read()
        except urllib.error.HTTPError:
            raise
        except urllib.error.URLError:
            if time.monotonic() > end:
                raise
            time.sleep(0.1)
