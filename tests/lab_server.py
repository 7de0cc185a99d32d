"""The lab's server as a process of its own, for the tests."""

import contextlib
import re
import signal
import subprocess
import sys

PROGRAM = "from zivi.cli import app; app()"
COMMAND = [sys.executable, "-c", PROGRAM, "lab", "--no-browser"]


@contextlib.contextmanager
def serving(program=PROGRAM, options=()):
    """Serve on a free port; give the process and the address."""
    command = [sys.executable, "-c", program, *COMMAND[3:], "--port", "0", *options]
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as process:
        try:
            line = process.stdout.readline()
            found = re.search(r"http://[\w.-]+:\d+/[\w-]{22}/", line)
            assert found, line + (process.stderr.read() if process.poll() is not None else "")
            yield process, found[0]
        finally:
            process.send_signal(signal.SIGINT)
            try:
                process.wait(20)
            finally:
                process.kill()
