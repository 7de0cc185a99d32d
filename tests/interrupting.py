"""Ctrl-C while a call is at work, work that is counted, and waiting: no test measures seconds."""

import contextlib
import faulthandler
import gc
import importlib.util
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest

HANGS = 300
"""Seconds after which what has not ended is taken to hang."""


def wait_for(condition):
    """Wait for what another thread or process does."""
    end = time.monotonic() + HANGS
    while not condition():
        assert time.monotonic() < end, "it hangs"
        time.sleep(0.005)


def in_own_process(package, program):
    """Run a program of the tests in a process of its own: a package with threads forbids forks."""
    if importlib.util.find_spec(package) is None:
        pytest.skip(f"{package} is not installed")
    done = subprocess.run(
        [sys.executable, "-c", program],
        cwd=Path(__file__).parent,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr[-3000:]


@contextlib.contextmanager
def ctrl_c(when=lambda: True, *, by="timer", answers=3):
    """Press Ctrl-C in a call that is at work: one that answers signals at one place.

    Signals come all the time, of a timer or of a "thread", which needs the interpreter for each.
    They are answered once and elsewhere by what looks for them when it has ended.
    """
    places, ended = [], threading.Event()
    main, number = threading.main_thread().ident, signal.SIGALRM

    def answer(_, frame):
        if ended.is_set() or not when():
            return
        place = frame.f_code, frame.f_lasti
        places[:] = [*(it for it in places if it == place), place]
        if len(places) == answers:
            ended.set()
            raise KeyboardInterrupt

    def send():
        while not ended.wait(1e-3):
            signal.pthread_kill(main, number)

    faulthandler.dump_traceback_later(HANGS, exit=True)
    before = signal.signal(number, answer)
    sender = threading.Thread(target=send)
    try:
        if by == "thread":
            sender.start()
        else:
            signal.setitimer(signal.ITIMER_REAL, 1e-3, 1e-3)
        yield
    finally:
        ended.set()
        signal.setitimer(signal.ITIMER_REAL, 0)
        if by == "thread":
            sender.join()
        signal.signal(number, before)
        faulthandler.cancel_dump_traceback_later()


@contextlib.contextmanager
def collector_off():
    """Turn the collector off: what its callbacks raise is lost, and Hypothesis has one."""
    gc.disable()
    try:
        yield
    finally:
        gc.enable()


def calls_in(work):
    """Count the functions that `work` calls, of Python and of C."""
    count = 0

    def note(_, event, __):
        nonlocal count
        count += event in ("call", "c_call")

    before = sys.getprofile()
    sys.setprofile(note)
    try:
        work()
    finally:
        sys.setprofile(before)
    return count
