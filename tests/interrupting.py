"""A program that runs for long, and Ctrl-C."""

import signal
import subprocess
import sys
import time


def stops_within_a_second(program):
    """Give what the program counted; it must stop within a second of Ctrl-C."""
    times = []
    for _ in range(3):  # a busy machine may hold one of them up, not all
        counted, took = interrupted(program)
        if took < 1.0:
            return counted
        times.append(took)
    raise AssertionError(f"stopped after {times} s")


def interrupted(program):
    """Send SIGINT to `program` once it runs: what it counted, and how long it took to stop (s).

    The program prints "started", and "stopped after N" when it was interrupted.
    """
    with subprocess.Popen(
        [sys.executable, "-c", program],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    ) as process:
        try:
            line = process.stdout.readline()
            assert line == "started\n", line + process.stderr.read()
            time.sleep(0.4)
            process.send_signal(signal.SIGINT)
            sent = time.monotonic()
            output, errors = process.communicate(timeout=20)
            took = time.monotonic() - sent
        finally:
            process.kill()
    assert process.returncode == 0, errors
    assert output.startswith("stopped after"), output + errors
    return int(output.split()[2]), took
