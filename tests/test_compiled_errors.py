"""What a compiled force raises reaches the caller, as what a Python function raises does."""

import ctypes
import gc
import sys
import threading

import numpy as np
import pytest

import zivi

D = ctypes.c_double
FORCE = ctypes.CFUNCTYPE(D, D, D, D)
METHODS = [
    zivi.ThetaGamma(1e-3),
    zivi.MoreauJean(1e-3),
    zivi.ExplicitEuler(1e-3),
    zivi.SwitchedRK(),
]


class BrokenError(Exception):
    pass


def of_ctypes(error=BrokenError, after=0.2):
    def force(t, x, xdot):
        if t > after:
            raise error("no value")
        return -9.81

    return FORCE(force)


def of_numba():
    numba = pytest.importorskip("numba")

    @numba.cfunc("float64(float64, float64, float64)")
    def force(t, x, xdot):
        if t > 0.2:
            raise ValueError("no value")
        return -9.81

    return force


@pytest.fixture(autouse=True)
def quiet(monkeypatch):
    """Nothing is reported beside the run, and the hook is what it was."""
    reported = []
    monkeypatch.setattr(sys, "unraisablehook", reported.append)
    before = sys.unraisablehook
    yield reported
    assert sys.unraisablehook is before
    assert not reported


@pytest.mark.parametrize("method", METHODS, ids=repr)
@pytest.mark.parametrize(("make", "error"), [(of_ctypes, BrokenError), (of_numba, ValueError)])
def test_it_reaches_the_caller_with_the_run_so_far(make, error, method):
    force = make()
    with pytest.raises(error, match="no value") as raised:
        zivi.simulate(zivi.ImpactSystem(force, e=0.5), (0, 1), (1, 0), method)
    sol = raised.value.trajectory
    assert sol.status is zivi.Status.RAISED
    assert not sol.success
    # the run ends where the force has no value any more, and is right up to there
    assert sol.t[-1] <= 0.2 + 1e-3
    np.testing.assert_allclose(sol.x, 1 - 9.81 / 2 * sol.t**2, atol=2e-3)


@pytest.mark.parametrize("error", [KeyboardInterrupt, SystemExit])
def test_what_is_no_exception_passes_through_as_well(error):
    with pytest.raises(error):
        zivi.simulate(zivi.ImpactSystem(of_ctypes(error), e=0.5), (0, 1), (1, 0))


def test_above_a_moving_wall():
    wall = zivi.HarmonicWall(0.01, 20.0)
    with pytest.raises(BrokenError):
        zivi.simulate(zivi.ImpactSystem(of_ctypes(), e=0.5, wall=wall), (0, 1), (1, 0))


@pytest.mark.parametrize("role", ["plant", "force_model", "force_ref"])
def test_of_a_closed_loop(role):
    plant = zivi.ImpactSystem(of_ctypes() if role == "plant" else -9.81, e=0.5)
    forces = {} if role == "plant" else {role: of_ctypes()}
    tracker = zivi.TwistingTracker(30, 17, h=1e-2, e=0.5)
    with pytest.raises(BrokenError) as raised:
        zivi.simulate_closed_loop(plant, tracker, (0, 1), (1, 0), y_ref0=(1, 0), **forces)
    run = raised.value.trajectory
    assert run.status is zivi.Status.RAISED
    assert 0.1 < run.t[-1] <= 0.22


def test_a_batch_warns_and_keeps_the_other_runs():
    systems = [zivi.ImpactSystem(force, e=0.5) for force in (of_ctypes(), -9.81, of_ctypes())]
    method = zivi.ThetaGamma(1e-3)
    with pytest.warns(RuntimeWarning, match=r"raised BrokenError\('no value'\); 2 runs"):
        batch = zivi.simulate_batch(systems, (0, 1), (1, 0), method=method, threads=2)
    assert [zivi.Status(it).name for it in batch.status] == [
        "FORCE_NOT_FINITE", "COMPLETED", "FORCE_NOT_FINITE"
    ]  # fmt: skip
    assert np.all(np.abs(batch.t - [0.2, 1.0, 0.2]) <= 2e-3)
    whole = zivi.simulate(systems[1], (0, 1), (1, 0), method=method)
    assert batch.x[1] == whole.x[-1]


def test_runs_in_several_threads_raise_what_is_theirs():
    found = {}

    def run(number):
        force = of_ctypes(after=0.1 * number) if number % 2 else FORCE(lambda t, x, xdot: -9.81)
        try:
            sol = zivi.simulate(
                zivi.ImpactSystem(force, e=0.5), (0, 1), (1, 0), zivi.ThetaGamma(1e-3)
            )
            found[number] = sol.t[-1]
        except BrokenError as error:
            found[number] = error.trajectory.t[-1]

    threads = [threading.Thread(target=run, args=(number,)) for number in range(6)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    for number, end in found.items():
        assert end == pytest.approx(0.1 * number if number % 2 else 1.0, abs=2e-3)


def test_what_another_thread_raises_does_not_end_a_run():
    def other():
        with pytest.raises(BrokenError):
            zivi.simulate(zivi.ImpactSystem(of_ctypes(after=0.1), e=0.5), (0, 1), (1, 0))

    def force(t, x, xdot):
        if t < 0.2:
            return -9.81
        thread = threading.Thread(target=other)
        thread.start()
        thread.join()
        return float("nan")

    sol = zivi.simulate(
        zivi.ImpactSystem(FORCE(force), e=0.5), (0, 1), (1, 0), zivi.ThetaGamma(1e-3)
    )
    assert sol.status is zivi.Status.FORCE_NOT_FINITE


def test_a_finaliser_that_raises_ends_no_run(quiet):
    class Litter:
        def __del__(self):
            raise RuntimeError("of a finaliser")

    def force(t, x, xdot):
        if 0.2 < t < 0.3:
            Litter()
            gc.collect(0)
        return -9.81

    sol = zivi.simulate(zivi.ImpactSystem(FORCE(force), e=0.5), (0, 1), (1, 0))
    assert sol.success
    assert quiet
    quiet.clear()


def test_nan_is_how_a_compiled_force_says_that_it_has_no_value():
    force = FORCE(lambda t, x, xdot: -9.81 if t < 0.2 else float("nan"))
    sol = zivi.simulate(zivi.ImpactSystem(force, e=0.5), (0, 1), (1, 0), zivi.ThetaGamma(1e-3))
    assert sol.status is zivi.Status.FORCE_NOT_FINITE
    assert sol.t[-1] == pytest.approx(0.2, abs=2e-3)
