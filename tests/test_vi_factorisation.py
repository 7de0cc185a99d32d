"""Sparse factors: their memory, their threads, limits and signals while they are made."""

import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import scipy.sparse as sp

import zivi
from example_scripts import example
from inside import Factoriser, ReleaseEvent, in_thread, vi_sparse_search as search
from interrupting import HANGS, ctrl_c, wait_for

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
    def threads():
        return sum(it.name == "zivi-factorisation" for it in threading.enumerate())

    M = large.laplacian(100)
    factors = Factoriser(lambda: None).factors_of(M)
    assert factors is not None
    assert threads() == 1
    del factors
    wait_for(lambda: not threads())

    def over():
        raise TimeoutError

    gate = threading.Event()
    with pytest.raises(TimeoutError):
        Factoriser(over).factors_of(M)
    with pytest.raises(TimeoutError):
        in_thread(gate.wait, over, ReleaseEvent())
    gate.set()
    wait_for(lambda: not threads())


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
    code, told, errors = finished(code)
    assert (code, told) == (0, "left alone\n")
    assert not errors or "is still under way" in errors  # where the machine is busy


def fills_in(n, entries):
    """Return a random matrix whose factors are nearly full: seconds, for few entries."""
    rng = np.random.default_rng(0)
    A = sp.random_array((n, n), density=entries / n, rng=rng, format="csr")
    return sp.csr_array(A + 2 * entries * sp.eye_array(n))


def test_few_entries_can_take_long_and_are_interrupted_as_well():
    M = fills_in(5000, 2.9)
    assert M.nnz < 20_000
    looks = []

    def over():
        looks.append(0)
        if len(looks) == 4:
            raise TimeoutError

    factoriser = Factoriser(over)
    factoriser.see_pattern(M)
    with pytest.raises(TimeoutError):
        factoriser.factors_of(M)
    assert factoriser.fill == 0  # it was still at work


@pytest.fixture
def endless(monkeypatch):
    """Factorisations that do not end before the test; the clock passes any limit in the first."""

    class Endless:
        began, ends = threading.Event(), threading.Event()

        def starts_now(self):
            monkeypatch.setattr(sp.linalg, "splu", self)

        def __call__(self, *_, **__):
            monkeypatch.setattr(search.time, "perf_counter", lambda: np.inf)
            self.began.set()
            self.ends.wait(HANGS)
            raise RuntimeError

    held = Endless()
    monkeypatch.setattr(search, "time", SimpleNamespace(perf_counter=time.perf_counter))
    yield held
    held.ends.set()


def test_the_best_point_is_kept_when_the_time_ends_within_a_factorisation(endless):
    """A body under its weight over an obstacle, in three dimensions."""
    n = 14
    one, unit = large.second_differences(n), sp.eye_array(n)
    M = sp.kron(sp.kron(one, unit), unit) + sp.kron(sp.kron(unit, one), unit)
    M = sp.csr_array(M + sp.kron(sp.kron(unit, unit), one))
    q = np.full(n**3, -0.05)
    upper = 0.02 * (1 + np.arange(n**3) % 7)
    whole = zivi.solve_avi(M, q, 0.0, upper)
    assert whole.success
    assert whole.n_factorisations > 4
    seen = []

    def watch(it):
        seen.append(it.residual)
        if len(seen) == 3:
            endless.starts_now()

    start = zivi.natural_residual(np.zeros(n**3), q, 0.0, upper)
    res = zivi.solve_avi(M, q, 0.0, upper, time_limit=1e6, callback=watch)
    assert endless.began.is_set()
    assert res.status is zivi.VIStatus.TIME_LIMIT
    assert res.n_factorisations >= res.n_iter == len(seen) == 3
    assert res.residual == min([start, *seen])
    assert res.residual == zivi.natural_residual(res.x, M @ res.x + q, 0.0, upper)
    assert np.all((res.x >= 0) & (res.x <= upper))


INTERRUPTED = """
import signal, threading
import numpy as np, scipy.sparse as sp, scipy.sparse.linalg
import zivi

def endless(*_, **__):
    print("at work", flush=True)
    threading.Event().wait()

signal.signal(signal.SIGINT, signal.default_int_handler)  # a background shell ignores it
scipy.sparse.linalg.splu = endless
M = sp.diags_array([-1.0, 2.0, -1.0], offsets=[-1, 0, 1], shape=(5000, 5000), format="csr")
try:
    zivi.solve_lcp(M, -np.ones(5000))
except KeyboardInterrupt:
    print("interrupted", flush=True)
"""


@pytest.mark.skipif(os.name != "posix", reason="sends signals")
def test_ctrl_c_within_a_factorisation_and_again_at_the_end():
    """The call is left, and so is the process if that is asked for, too, whatever is at work."""
    with subprocess.Popen(
        [sys.executable, "-c", INTERRUPTED],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    ) as process:
        assert process.stdout.readline() == "at work\n"
        process.send_signal(signal.SIGINT)
        assert process.stdout.readline() == "interrupted\n"
        assert "Ctrl-C again ends the process at once" in process.stderr.readline()
        process.send_signal(signal.SIGINT)
        assert process.wait(HANGS) == 130


def kinds_of_matrices():
    """Yield matrices of one pattern each, a few with other values."""
    rng = np.random.default_rng(3)
    grid = sp.csr_array(large.laplacian(12))
    for shift in (0.0, 0.1, 3.0):
        yield "grid", grid + sp.diags_array(shift + rng.random(144)), "none"
    loose = sp.csr_array(sp.random_array((150, 150), density=0.03, rng=rng))
    for _ in range(3):
        values = sp.csr_array((rng.normal(size=loose.nnz), loose.indices, loose.indptr))
        yield "loose", values + 4 * sp.eye_array(150), "partial"
    arrow = sp.lil_array((200, 200))
    arrow[0], arrow[:, 1] = 1.0, 1.0
    arrow = sp.csr_array(arrow)
    for shift in (2.0, 5.0):
        yield "arrow", arrow + sp.diags_array(shift + rng.random(200)), "some"


def test_an_order_is_found_once_for_a_pattern(monkeypatch):
    """What NumPy's dense solver gives, in an order that is kept while the pattern is the same."""
    asked = []
    splu = sp.linalg.splu

    def told(A, **options):
        asked.append(options["permc_spec"])
        return splu(A, **options)

    monkeypatch.setattr(sp.linalg, "splu", told)
    rng = np.random.default_rng(4)
    factoriser, last = None, None
    for name, A, way in kinds_of_matrices():
        if name != last:
            factoriser = Factoriser(lambda: None)
            factoriser.see_pattern(A)
        asked.clear()
        b = rng.normal(size=A.shape[0])
        x = factoriser.factors_of(A).solve(b)
        np.testing.assert_allclose(x, np.linalg.solve(A.toarray(), b), rtol=1e-9, atol=1e-11)
        (spec,) = asked
        assert spec == ("COLAMD" if way == "partial" and name != last else "NATURAL")
        last = name
    # as many entries elsewhere, and other ones of the same columns, are other patterns
    factoriser, rights = Factoriser(lambda: None), np.ones(144)
    grid = sp.csc_array(large.laplacian(12))
    factoriser.see_pattern(grid)
    turned = sp.csc_array(grid[::-1][:, ::-1])
    moved = sp.csc_array(grid + 0.1 * sp.eye_array(144, k=30) + 0.1 * sp.eye_array(144, k=-30))
    for A in (grid, moved, grid, turned):
        x = factoriser.factors_of(A).solve(rights)
        np.testing.assert_allclose(A @ x, rights, atol=1e-12)
    once = factoriser.fill
    for _ in range(2):
        factoriser.factors_of(moved)
    assert factoriser.fill == once  # the kept order fills in as much


def test_a_singular_matrix_is_not_tried_twice():
    A = sp.lil_array((200, 200))
    A.setdiag(1.0)
    A[0], A[:, 1] = 1.0, 1.0
    A[5] = 0.0
    factoriser = Factoriser(lambda: None)
    factoriser.see_pattern(sp.csr_array(A))
    assert factoriser.solve(sp.csr_array(A), np.ones(200)) is None
    assert factoriser.count == 1
    A[5, 5] = 1.0
    (x,) = factoriser.solve(sp.csr_array(A), np.ones(200))
    np.testing.assert_allclose(A @ x, np.ones(200), atol=1e-12)


@pytest.mark.skipif(not hasattr(signal, "setitimer"), reason="needs an interval timer")
@pytest.mark.parametrize("how", ["signal", "limit"])
def test_a_long_factorisation_is_left_alone(how, endless):
    """It is still at work when the call has ended."""
    M, q = large.laplacian(100), -np.ones(100**2)

    def at_work():
        return {it for it in threading.enumerate() if it.name == "zivi-factorisation"}

    earlier = at_work()
    endless.starts_now()
    if how == "limit":
        assert zivi.solve_lcp(M, q, time_limit=1e6).status is zivi.VIStatus.TIME_LIMIT
    else:
        with ctrl_c(when=endless.began.is_set), pytest.raises(KeyboardInterrupt):
            zivi.solve_lcp(M, q)
    assert len(at_work() - earlier) == 1
