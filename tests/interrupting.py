"""Ctrl-C while a call is at work, work that is counted, and waiting: no test measures seconds."""

import contextlib
import faulthandler
import gc
import signal
import sys
import threading
import time

HANGS = 300
"""Seconds after which what has not ended is taken to hang."""


def wait_for(condition):
    """Wait for what another thread or process does."""
    end = time.monotonic() + HANGS
    while not condition():
        assert time.monotonic() < end, "it hangs"
        time.sleep(0.005)


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
