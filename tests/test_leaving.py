"""The interpreter ends cleanly while runs go on in daemon threads."""

import os
import re
import subprocess
import sys
import textwrap
from pathlib import Path

import pytest

import zivi
from interrupting import HANGS

RUNS = {
    "a Python force": """
        system = zivi.ImpactSystem(lambda t, x, xdot: -9.81 + 1e-3 * x, e=0.5)
        run = lambda: zivi.simulate(system, (0, 1), (1, 0), zivi.ThetaGamma(h=1e-7))
    """,
    "a number": """
        system = zivi.ImpactSystem(-9.81, e=0.5)
        run = lambda: zivi.simulate(system, (0, 1), (1, 0), zivi.ThetaGamma(h=1e-8))
    """,
    "many short runs": """
        system = zivi.ImpactSystem(lambda t, x, xdot: -9.81, e=0.5)
        run = lambda: zivi.simulate(system, (0, 2), (1, 0))
    """,
    "a batch": """
        system = zivi.ImpactSystem(-9.81, e=0.5)
        starts = [[1 + k, 0] for k in range(100)]
        run = lambda: zivi.simulate_batch(system, (0, 1), starts, method=zivi.ThetaGamma(h=1e-6))
    """,
    "mechanics": """
        import numpy as np
        force, gaps = lambda t, q, v: -9.81 * q, [zivi.LinearGap([1.0, 0.0])]
        system = zivi.MechanicalSystem(mass=np.eye(2), force=force, e=0.5, gaps=gaps)
        run = lambda: zivi.simulate(system, (0, 1e4), ([1.0, 0.0], [0.0, 1.0]))
    """,
    "a loop": """
        tracker = zivi.TwistingTracker(17, 10, h=1e-6, e=0.5)
        system = zivi.ImpactSystem(lambda t, x, xdot: -9.81, e=0.5)
        run = lambda: zivi.simulate_closed_loop(system, tracker, (0, 5), (1, 0))
    """,
    "a problem": """
        import numpy as np
        f = lambda z: np.sin(z) + 1e-3 * z + np.arange(200.0)
        run = lambda: zivi.solve_vi(f, -np.ones(200), np.ones(200), np.zeros(200))
    """,
    "sensitivities": """
        force = lambda t, x, xdot: -9.81 - 0.1 * xdot
        system = zivi.ImpactSystem(force, e=0.5)
        run = lambda: zivi.sensitivity(system, (0, 3), (1, 0), wrt=["x0", "e"])
    """,
}
PROGRAM = """
import threading, time
import zivi
failed, begun = [], []
def work(setup, started):
    own = dict(zivi=zivi)
    exec(setup, own)
    started.set()
    while True:
        try:
            own["run"]()
        except Exception as error:  # noqa
            failed.append(error)
            raise
for setup in {setups!r}:
    begun.append(threading.Event())
    threading.Thread(target=work, args=(setup, begun[-1]), daemon=True).start()
for it in begun:
    it.wait()
for _ in range({turns}):
    time.sleep(0)
assert not failed, failed
"""


@pytest.mark.slow
@pytest.mark.parametrize("turns", [0, 10])
@pytest.mark.parametrize("part", [0, 1])
def test_daemon_threads_do_not_abort_the_exit(part, turns):
    setups = [textwrap.dedent(RUNS[name]) for name in [*RUNS][part::2]]
    program = PROGRAM.format(setups=setups, turns=turns)
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=False, timeout=HANGS
    )
    assert (done.returncode, done.stderr) == (0, "")


def told(program):
    return subprocess.run(
        [sys.executable, "-c", textwrap.dedent(program)],
        capture_output=True,
        text=True,
        check=True,
        timeout=HANGS,
    ).stdout


@pytest.mark.slow
def test_the_thread_that_ends_the_interpreter_may_still_run():
    # functions registered before the import are called after the runs were stopped
    program = """
        import atexit
        def last():
            import zivi
            system = zivi.ImpactSystem(lambda t, x, xdot: -9.81, e=0.5)
            print("at rest:", zivi.simulate(system, (0, 3), (1, 0)).rest_time is not None)
        atexit.register(last)
        import zivi
    """
    assert told(program) == "at rest: True\n"


@pytest.mark.slow
def test_a_force_that_does_not_return_is_not_waited_for_for_ever():
    program = """
        import os, threading, zivi, zivi._zivi
        called, returned = threading.Event(), threading.Event()
        def force(t, x, xdot):
            called.set()
            threading.Event().wait()
            returned.set()
            return -9.81
        system = zivi.ImpactSystem(force, e=0.5)
        go = lambda: zivi.simulate(system, (0, 1), (1, 0))
        threading.Thread(target=go, daemon=True).start()
        called.wait()
        print(zivi._zivi.stop_runs(0.2), returned.is_set(), flush=True)
        os._exit(0)
    """
    assert told(program) == "False False\n"


@pytest.mark.slow
@pytest.mark.skipif(not hasattr(os, "fork"), reason="no fork")
def test_a_fork_does_not_wait_for_the_runs_of_threads_that_it_has_not():
    program = """
        import os, threading, warnings, zivi
        warnings.simplefilter("ignore")
        called, forked = threading.Event(), threading.Event()
        def force(t, x, xdot):
            called.set()
            forked.wait()
            return -9.81
        system = zivi.ImpactSystem(force, e=0.5)
        thread = threading.Thread(target=lambda: zivi.simulate(system, (0, 1), (1, 0)), daemon=True)
        thread.start()
        called.wait()
        child = os.fork()
        if child == 0:
            # at once or never: nobody ends the runs that are not there
            raise SystemExit(0 if zivi._zivi.stop_runs(0.0) else 3)
        forked.set()
        print(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]))
    """
    assert told(program) == "0\n"


@pytest.mark.slow
@pytest.mark.skipif(not hasattr(os, "fork"), reason="no fork")
def test_a_fork_opens_the_locks_that_other_threads_hold():
    """Nobody would: neither a child that compiles a model nor one that listens to a force ended."""
    program = """
        import os, threading, warnings
        from zivi.base import machine_code
        warnings.simplefilter("ignore")
        held, forked = threading.Event(), threading.Event()
        def hold():
            with machine_code._hook_lock, machine_code._build_lock:
                held.set()
                forked.wait()
        thread = threading.Thread(target=hold, daemon=True)
        thread.start()
        held.wait()
        child = os.fork()
        if child == 0:
            locks = [machine_code._hook_lock._lock, machine_code._build_lock._lock]
            os._exit(0 if all(lock.acquire(blocking=False) for lock in locks) else 3)
        forked.set()
        print(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]))
    """
    assert told(program) == "0\n"


def test_every_lock_of_the_package_survives_a_fork():
    sources = Path(zivi.__file__).parent.rglob("*.py")
    raw = [it.name for it in sources if re.search(r"threading\.R?Lock\(", it.read_text("utf-8"))]
    assert raw == ["machine_code.py"]


def test_runs_in_a_run_and_none_at_all():
    outer = zivi.ImpactSystem(lambda t, x, xdot: inner(), e=0.5)

    def inner():
        return zivi.simulate(zivi.ImpactSystem(-9.81, e=0.5), (0, 0.1), (1, 0)).xdot[-1] - 8.8

    assert zivi.simulate(outer, (0, 0.1), (1, 0)).success
    program = "import zivi; print(zivi._zivi.stop_runs(0.0), zivi._zivi.forget_runs())"
    assert told(program) == "True None\n"
