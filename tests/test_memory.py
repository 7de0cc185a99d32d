"""Where memory ends: an error before anything is computed, or a run that keeps what it has."""

import os
import shutil
import subprocess
import sys
import textwrap
from pathlib import Path

import pytest

if not sys.platform.startswith("linux"):
    pytest.skip("limits the address space of a process", allow_module_level=True)

LIMITED = """
    import os, resource
    import numpy as np
    import zivi

    ball = zivi.ImpactSystem(-9.81, e=0.5)

    def limit(megabytes):
        with open("/proc/self/statm") as sizes:
            used = int(sizes.read().split()[0]) * resource.getpagesize()
        most = used + megabytes * 2**20
        resource.setrlimit(resource.RLIMIT_AS, (most, most))
"""


def limited(program):
    """What a program prints whose memory is limited; it must not die."""
    done = subprocess.run(
        [sys.executable, "-c", textwrap.dedent(LIMITED) + textwrap.dedent(program)],
        capture_output=True,
        text=True,
        timeout=60,
    )
    assert done.returncode == 0, done.stderr[-2000:]
    return done.stdout


REFUSED = """
    limit(1000)
    try:
        {call}
    except MemoryError as error:
        print(error)
"""


@pytest.mark.parametrize("method", ["ThetaGamma", "MoreauJean", "ExplicitEuler"])
def test_a_batch_that_cannot_be_kept(method):
    states = "np.ones((10**4, 2))"
    call = f"zivi.simulate_batch(ball, (0, 1), {states}, method=zivi.{method}(1e-5), save=1)"
    told = limited(REFUSED.format(call=call))
    assert "10000 runs" in told
    assert "100001 samples" in told
    assert " 32.0" in told
    for argument in ("y0", "save", "h"):
        assert argument in told.split()


def test_a_batch_of_closed_loops_that_cannot_be_kept():
    call = """zivi.simulate_closed_loop_batch(
            ball, zivi.TwistingTracker(30, 17, h=1e-4, e=0.5), (0, 1), np.ones((10**4, 2)), save=1
        )"""
    told = limited(REFUSED.format(call=call))
    assert "10000 runs" in told
    assert "10001 samples" in told


def test_the_record_of_one_run_that_does_not_fit():
    call = "zivi.simulate(ball, (0, 1), (1, 0), zivi.ThetaGamma(1e-8))"
    assert "the record of 100000000 steps does not fit" in limited(REFUSED.format(call=call))


@pytest.mark.parametrize(
    ("call", "told"),
    [
        ("zivi.solve_vi(lambda x: x - 1, *np.zeros((3, 300_000)))", "300000 unknowns"),
        ("zivi.solve_ncp(lambda x: x - 1, np.zeros(100_000))", "100000 unknowns"),
        ("zivi.simulate(ball, (0, 1), (1, 0))(np.linspace(0, 1, 5 * 10**7))", "50000000 numbers"),
    ],
)
def test_what_a_user_asks_for_and_does_not_fit_is_a_memory_error(call, told):
    message = limited(REFUSED.format(call=call))
    assert told in message
    assert ("sparse" in message) == ("unknowns" in told)


ENTRIES = """
    N = 1 << 14
    times, many = np.linspace(0, 1, N), np.ones((N, 2))
    elastic = zivi.ImpactSystem(-9.81, e=1.0)
    steps = zivi.SwitchedRK(max_steps=10**9)
    gaps = [zivi.LinearGap([1.0])]
    mech = zivi.MechanicalSystem(mass=1.0, force=[-9.81], gaps=gaps, e=0.5)
    bouncing = zivi.MechanicalSystem(mass=1.0, force=[-9.81], gaps=gaps, e=1.0)
    rubbing = zivi.MechanicalSystem(
        mass=1.0, force=[-9.81], gaps=gaps, e=0.5, friction=[zivi.DryFriction(limit=1.0)]
    )
    linear = zivi.LinearSystem([[1.0]], [[0.1]], [[1.0]], gaps=[zivi.LinearGap([1.0], -0.5)], e=0.5)
    start = [1.0], [0.0]
    sol, moved = zivi.simulate(ball, (0, 1), (1, 0)), zivi.simulate(mech, (0, 1), start)
    slow = zivi.simulate(zivi.ImpactSystem(-9.81, e=0.9999), (0, 1e4), (1, 0))
    derived = zivi.sensitivity(ball, (0, 1), (1, 0))
    import scipy.sparse
    laplace = scipy.sparse.diags_array([-1, 2.5, -1], offsets=[-1, 0, 1], shape=(N, N)).tocsc()
    ring, quadrant = (laplace.indptr, laplace.indices), np.repeat([[0], [np.inf], [1]], N, axis=1)
    n = 100
    tracker = zivi.TwistingTracker(30, 17, h=1 / N, e=0.5)
    coarse = zivi.TwistingTracker(30, 17, h=1e-2, e=0.5)
    loop = zivi.simulate_closed_loop(ball, coarse, (0, 1), (0.2, 0), y_ref0=(0.2, 0))

    def read(sol):
        sol.x, sol.transformed.s, sol.residual, sol.impacts

    def ticked():
        run = zivi.simulate_closed_loop(ball, tracker, (0, 1), (0.2, 0), y_ref0=(0.2, 0))
        run.signs

    CALLS = {
        "samples": lambda: read(zivi.simulate(ball, (0, 1), (1, 0), t_eval=times)),
        "impacts": lambda: read(zivi.simulate(elastic, (0, 0.1), (1e-9, 0), steps)),
        "fixed steps": lambda: read(zivi.simulate(ball, (0, 1), (1, 0), zivi.ThetaGamma(1 / N))),
        "moreau": lambda: read(zivi.simulate(elastic, (0, 1), (1, 0), zivi.MoreauJean(1 / N))),
        "call": lambda: sol(times),
        "lifted": lambda: sol._path.lifted(times),
        "resample": lambda: sol.resample(times),
        "skipped": lambda: slow.impacts_down_to(1e-300, limit=10**4),
        "mechanical samples": lambda: zivi.simulate(mech, (0, 1), start, t_eval=times),
        "mechanical call": lambda: moved(times),
        "mechanical resample": lambda: moved.resample(times),
        "mechanical impacts": lambda: zivi.simulate(
            bouncing, (0, 0.05), ([1e-9], [0.0]), steps
        )._path.numbers(),
        "friction": lambda: zivi.simulate(rubbing, (0, 1), start, t_eval=times),
        "linear": lambda: zivi.simulate(linear, (0, 1), start, t_eval=times),
        "batch": lambda: zivi.simulate_batch(ball, (0, 1e-3), many, method=zivi.ThetaGamma(1e-3)),
        "batch of events": lambda: zivi.simulate_batch(ball, (0, 1e-3), many, save="events"),
        "batch of samples": lambda: zivi.simulate_batch(
            ball, (0, 1), many[:16], method=zivi.ThetaGamma(1e-3), save=1
        ),
        "sensitivity": lambda: derived(times),
        "table": lambda: zivi.Table(times, np.sin(times))(times),
        "box VI": lambda: zivi.solve_vi(lambda x: x - 1, *np.zeros((3, n))),
        "NCP": lambda: zivi.solve_ncp(lambda x: x - 1, np.zeros(n), jac=lambda x: np.eye(n)),
        "ordering": lambda: zivi._zivi.minimum_degree(*ring),
        "sparse VI": lambda: zivi.solve_vi(
            lambda x: laplace @ x - 1, *quadrant, jac=lambda x: laplace
        ),
        "LCP": lambda: zivi.solve_lcp(np.eye(n), -np.ones(n)),
        "loop": ticked,
        "loop, call": lambda: loop(times),
        "loops": lambda: zivi.simulate_closed_loop_batch(
            ball, coarse, (0, 1), many[:200], save=1
        ),
        "observer": lambda: zivi.ImpactObserver(0.5, 1 / N).observe(times, times),
    }
    import ctypes, warnings
    warnings.simplefilter("ignore")
    malloc = ctypes.CDLL(None)
    malloc.fail_request.argtypes = [ctypes.c_size_t, ctypes.c_long]
    for name, call in CALLS.items():
        call()  # what is made once
        for k in range(1, 60):
            print(name, k, flush=True)
            malloc.fail_request(LARGE, k)
            try:
                call()
            except MemoryError as error:
                assert "memory" in (said := str(error)) or "allocate" in said or not said, error
            left = malloc.requests_left()
            malloc.fail_request(LARGE, 0)
            if left > 0:  # there are no more
                assert k > 1, name
                break
"""


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("cc") is None, reason="needs a C compiler")
def test_every_large_allocation_may_fail(tmp_path):
    """One after the other in every entry: a MemoryError or a run that keeps what it has."""
    library = tmp_path / "failing.so"
    source = Path(__file__).parent / "c" / "failing_malloc.c"
    subprocess.run(["cc", "-O1", "-shared", "-fPIC", "-o", library, source], check=True)
    program = textwrap.dedent(LIMITED) + f"LARGE = {1 << 16}\n" + textwrap.dedent(ENTRIES)
    done = subprocess.run(
        [sys.executable, "-c", program],
        capture_output=True,
        text=True,
        env=os.environ | {"LD_PRELOAD": str(library)},
    )
    assert done.returncode == 0, done.stdout[-60:] + done.stderr[-2000:]


RUNS = {
    "impacts": ("zivi.ImpactSystem(-9.81, e=1.0)", "max_steps=10**12, max_impacts=2**62"),
    "steps": ("zivi.ImpactSystem(zivi.LinearForce(stiffness=1.0), e=1.0)", "max_steps=10**12"),
}


@pytest.mark.parametrize(
    ("grows", "dense", "megabytes"),
    [("impacts", True, 36), ("impacts", True, 59), ("impacts", False, 40), ("steps", True, 40)],
)
def test_a_run_that_outgrows_its_memory_keeps_what_it_has(grows, dense, megabytes):
    system, settings = RUNS[grows]
    told = limited(f"""
        system, method = {system}, zivi.SwitchedRK({settings})
        limit({megabytes})
        sol = zivi.simulate(system, (0, 1e9), (1e-6, 0), method, dense_output={dense})
        assert not sol.success
        print(sol.status.name, len(sol.t), len(sol.impacts), sol.t[-1])
        assert "memory" in sol.message
        assert np.all(np.diff(sol.t) >= 0) and sol.t[-1] < 1e9
        end = np.array([sol.x[-1], sol.xdot[-1]])
        if {dense}:
            assert np.array_equal(sol(sol.t[-1]), end)
        fast = sol.impacts["xdot_after"]
        assert np.all(fast > 0) and np.all(np.diff(sol.impacts["t"]) > 0)
    """)
    name, samples, *_ = told.split()
    assert name == "OUT_OF_MEMORY"
    assert int(samples) > 10_000


@pytest.mark.parametrize(("method", "speed"), [("MoreauJean", 1.5), ("ThetaGamma", 1.0)])
def test_fixed_steps_whose_impacts_outgrow_the_memory(method, speed):
    told = limited(f"""
        # up to every second step is an impact: they take memory beside the record
        system, method = zivi.ImpactSystem(-1.0, e=1.0), zivi.{method}(1.0, theta=0.5)
        limit(72)
        sol = zivi.simulate(system, (0, 1e6), (0, {speed}), method)
        assert np.all(np.diff(sol.resolved_impacts["t"]) > 0)
        print(sol.status.name, len(sol.t), len(sol.resolved_impacts))
    """)
    name, samples, impacts = told.split()
    assert name == "OUT_OF_MEMORY"
    assert int(samples) > int(impacts) > 10_000


def test_a_batch_without_memory_for_some_of_its_runs_keeps_the_others():
    told = limited("""
        # a million impacts each, and hardly any
        systems = [zivi.ImpactSystem(-9.81, e=e) for e in (1.0, 0.5)]
        method = zivi.SwitchedRK(max_steps=10**12, max_impacts=2**62)
        limit(40)
        batch = zivi.simulate_batch(
            systems, (0, 1e9), [(1e-6, 0), (1, 0)], method=method, threads=1
        )
        print(*(zivi.Status(it).name for it in batch.status), batch.rest_time[1])
    """)
    first, second, rest = told.split()
    assert (first, second) == ("OUT_OF_MEMORY", "COMPLETED")
    assert float(rest) == pytest.approx(1.3545709, abs=1e-7)
