"""Where memory ends: an error before anything is computed, or a run that keeps what it has."""

import subprocess
import sys
import textwrap

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
