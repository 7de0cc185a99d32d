"""Sparse factors: their memory, their threads, limits and signals while they are made."""

import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np
import pytest
import scipy.sparse as sp

import zivi
from example_scripts import example
from zivi.vi.factorisation import in_thread

large = example("large_vi")

MEMORY = """
import threading
from pathlib import Path
import numpy as np
import scipy.sparse as sp
from zivi.vi.factorisation import Factoriser

def resident():
    for thread in threading.enumerate():
        if thread.name == "zivi-factorisation":
            thread.join()
    return int(Path("/proc/self/statm").read_text().split()[1]) * 4096

second = sp.diags_array([-1.0, 2.0, -1.0], offsets=[-1, 0, 1], shape=(100, 100))
M = (sp.kron(second, sp.eye_array(100)) + sp.kron(sp.eye_array(100), second)).tocsr()
assert M.nnz > 20_000  # made in a thread
factoriser = Factoriser(lambda: None)
factoriser.see_pattern(M)
b = np.ones(10_000)
for count in (2, 12):
    before = resident()
    for _ in range(count):
        x = factoriser.factors_of(M).solve(b)
        assert abs(M @ x - b).max() < 1e-11
assert factoriser.count == 14
print((resident() - before) / (12 * factoriser.fill))
"""


def finished(code, **environment):
    """Return the exit code and the outputs of a process of its own."""
    environment = os.environ | environment
    run = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=False, env=environment
    )
    return run.returncode, run.stdout, run.stderr


@pytest.mark.skipif(not Path("/proc/self/statm").exists(), reason="reads the memory of Linux")
def test_the_memory_of_factors_is_given_back():
    """SuperLU frees what it took only in the thread that took it.

    With one arena, and large blocks given back at once, the size of a process is what it holds.
    """
    code, factors, errors = finished(
        MEMORY, MALLOC_ARENA_MAX="1", MALLOC_MMAP_THRESHOLD_="65536", MALLOC_TRIM_THRESHOLD_="65536"
    )
    assert (code, errors) == (0, "")
    assert float(factors) < 1  # of twelve


def test_the_thread_of_factors_ends_with_them():
    from zivi.vi.factorisation import Factoriser

    def threads():
        return sum(it.name == "zivi-factorisation" for it in threading.enumerate())

    def ended():
        since = time.perf_counter()
        while threads() and time.perf_counter() - since < 10:
            time.sleep(0.01)
        return not threads()

    M = large.laplacian(100)
    factors = Factoriser(lambda: None).factors_of(M)
    assert factors is not None
    assert threads() == 1
    del factors
    assert ended()

    def over():
        raise TimeoutError

    with pytest.raises(TimeoutError):
        Factoriser(over).factors_of(M)
    with pytest.raises(TimeoutError):
        in_thread(lambda: time.sleep(0.2), over, threading.Event())
    assert ended()


def test_an_interpreter_with_factors_ends_well():
    code = (
        "import scipy.sparse as sp\n"
        "from zivi.vi.factorisation import Factoriser\n"
        "kept = Factoriser(lambda: None).factors_of(sp.eye_array(30_000, format='csc'))\n"
        "print(kept is not None)\n"
    )
    assert finished(code) == (0, "True\n", "")


def test_an_interpreter_ends_well_while_a_matrix_is_factorised():
    """The thread that a limit left alone needs the interpreter until it has ended."""
    code = (
        "import scipy.sparse as sp\n"
        "from zivi.vi.factorisation import Factoriser\n"
        "n = 250\n"
        "one = sp.diags_array([-1.0, 2.0, -1.0], offsets=[-1, 0, 1], shape=(n, n))\n"
        "M = sp.kron(one, sp.eye_array(n)) + sp.kron(sp.eye_array(n), one)\n"
        "looks = iter(range(2))\n"
        "def over():\n"
        "    if next(looks):\n"
        "        raise TimeoutError\n"
        "try:\n"
        "    Factoriser(over).factors_of(M)\n"
        "except TimeoutError:\n"
        "    print('left alone')\n"
    )
    assert finished(code) == (0, "left alone\n", "")


@pytest.mark.slow
@pytest.mark.skipif(not hasattr(signal, "setitimer"), reason="needs an interval timer")
@pytest.mark.parametrize("how", ["signal", "limit"])
def test_a_long_factorisation_is_left_alone(how):
    """Of a random pattern, which fills in: it is still at work when the call has ended."""
    rng = np.random.default_rng(0)
    n = 12_000
    A = sp.random_array((n, n), density=8 / n, rng=rng, format="csr")
    M, q = A @ A.T + sp.eye_array(n), rng.normal(size=n)

    def at_work():
        return {it for it in threading.enumerate() if it.name == "zivi-factorisation"}

    def interrupt(*_):
        raise KeyboardInterrupt

    earlier = at_work()
    if how == "limit":
        assert zivi.solve_lcp(M, q, time_limit=1.0).status is zivi.VIStatus.TIME_LIMIT
        assert len(at_work() - earlier) == 1
        return
    before = signal.signal(signal.SIGALRM, interrupt)
    signal.setitimer(signal.ITIMER_REAL, 1.0)
    try:
        with pytest.raises(KeyboardInterrupt):
            zivi.solve_lcp(M, q)
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)
    assert len(at_work() - earlier) == 1
