"""A run in a batch is the run alone, to the last bit; failures, threads, memory, Ctrl-C."""

import ctypes
import dataclasses
import json
import re
import signal
import subprocess
import sys
import textwrap
import time
from pathlib import Path

import numpy as np
import pytest
import scipy

import zivi
from inside import base_extras
from interrupting import ctrl_c

BALL = zivi.ImpactSystem(-9.81, kappa=0.41)
LINEAR = zivi.LinearForce(stiffness=1.0, damping=0.1, gravity=3.0, amplitude=4.0, omega=5.0)
PLAIN = ctypes.CFUNCTYPE(*[ctypes.c_double] * 4)
EULER = zivi.ThetaGamma(1e-3)
METHODS = [
    EULER,
    zivi.ThetaGamma(2e-3, theta=0.5, gamma=0.8),
    zivi.ThetaGamma(5e-3, solver="newton"),
    zivi.ExplicitEuler(1e-3),
    zivi.MoreauJean(1e-3),
    zivi.SwitchedRK(),
]
SAVES = ["final", "statistics", "events", 7]


def low_level():
    """`fma(t, x, x') = t x + x'`, compiled, from the C library."""
    fma = ctypes.CDLL(None).fma
    return PLAIN(("fma", ctypes.CDLL(None))) if fma else None


def numba_cfunc():
    numba = pytest.importorskip("numba")
    return numba.cfunc("float64(float64, float64, float64)")(lambda t, x, xdot: -9.81 - 2.0 * x)


FORCES = {
    "number": lambda: -9.81,
    "linear": lambda: LINEAR,
    "ctypes": low_level,
    "LowLevelCallable": lambda: scipy.LowLevelCallable(low_level()),
    "numba": numba_cfunc,
}


def starts(n, seed=0):
    draw = np.random.default_rng(seed)
    states = np.column_stack([draw.uniform(0.0, 1.0, n), draw.uniform(-3.0, 3.0, n)])
    states[::7] = 0.0
    states[1::7, 0] = 0.0
    return states


def bits(batch):
    arrays = (getattr(batch, field.name) for field in dataclasses.fields(batch))
    return [array.tobytes() for array in arrays if isinstance(array, np.ndarray)]


def same(found, expected):
    np.testing.assert_array_equal(found, np.nan if expected is None else expected)


def assert_is(batch, i, sol, save):
    """The entry of a batch is what the run alone gives."""
    for name in ("t", "x", "xdot"):
        same(getattr(batch, name)[i], getattr(sol, name)[-1])
    same(batch.rest_time[i], sol.rest_time)
    assert batch.status[i] == sol.status
    assert batch.nfev[i] == sol.nfev
    assert batch.n_impacts[i] == len(sol.impacts)
    assert batch.n_zeno[i] == len(sol.zeno_times)
    assert batch.n_liftoffs[i] == len(sol.liftoff_times)
    if len(sol.impacts):
        assert batch.first_impact[i] == sol.impacts["t"][0]
        assert batch.last_impact[i] == sol.impacts["t"][-1]
        assert batch.hardest_impact[i] == -sol.impacts["xdot_before"].min()
    else:
        same(batch.first_impact[i], None)
    if save == "statistics":
        assert batch.x_max[i] == sol.x.max()
        assert batch.speed_max[i] == np.abs(sol.xdot).max()
    if save == "events":
        np.testing.assert_array_equal(batch.events[i]["impacts"], sol.impacts)
        np.testing.assert_array_equal(batch.events[i]["zeno_times"], sol.zeno_times)
        np.testing.assert_array_equal(batch.events[i]["liftoff_times"], sol.liftoff_times)
    if isinstance(save, int):
        kept = len(sol.t[::save])
        np.testing.assert_array_equal(batch.sample_t[:kept], sol.t[::save])
        np.testing.assert_array_equal(batch.sample_x[i, :kept], sol.x[::save])
        np.testing.assert_array_equal(batch.sample_xdot[i, :kept], sol.xdot[::save])
        assert np.isnan(batch.sample_x[i, kept:]).all()


def check(systems, states, method, save, t1=1.503):
    batch = zivi.simulate_batch(systems, (0, t1), states, method=method, save=save, threads=2)
    assert len(batch) == len(states)
    for i, state in enumerate(states):
        system = systems[i] if isinstance(systems, list) else systems
        sol = zivi.simulate(system, (0, t1), state, method=method, dense_output=False)
        assert_is(batch, i, sol, save)


@pytest.mark.parametrize("save", SAVES)
@pytest.mark.parametrize("method", METHODS, ids=repr)
def test_a_run_in_a_batch_is_the_run_alone(method, save):
    if isinstance(save, int) and isinstance(method, zivi.SwitchedRK):
        pytest.skip("no regular samples")
    systems = [
        zivi.ImpactSystem([-9.81, 0.0, -1.0, LINEAR][i % 4], e=0.1 + 0.04 * i) for i in range(20)
    ]
    check(systems, starts(20), method, save)


@pytest.mark.parametrize("method", METHODS, ids=repr)
def test_states_at_given_times_are_those_of_the_runs_alone(method):
    # the last one overflows, and ends before the last times
    systems = [zivi.ImpactSystem([-9.81, 0.0, LINEAR][i % 3], e=0.1 + 0.1 * i) for i in range(8)]
    systems.append(zivi.ImpactSystem(zivi.LinearForce(stiffness=-1e6), e=0.5))
    states, span = starts(9), (0, 1.503)
    times = np.sort(np.append(np.random.default_rng(1).uniform(*span, 40), [*span, 0.5]))
    batch = zivi.simulate_batch(systems, span, states, method=method, t_eval=times, threads=2)
    ends = zivi.simulate_batch(systems, span, states, method=method, threads=2)
    assert batch.sample_x.shape == batch.sample_xdot.shape == (9, 43)
    same(batch.sample_t, times)
    for i, (system, state) in enumerate(zip(systems, states, strict=True)):
        sol = zivi.simulate(system, span, state, method=method, t_eval=times)
        n = len(sol.t)
        assert batch.sample_x[i, :n].tobytes() == sol.x.tobytes()
        assert batch.sample_xdot[i, :n].tobytes() == sol.xdot.tobytes()
        assert np.isnan(batch.sample_x[i, n:]).all()
    assert ends.status[-1] != 0
    assert np.isnan(batch.sample_x[-1]).any()
    # what else is known of the runs is not changed by what is kept of them
    for field in dataclasses.fields(batch):
        found, expected = getattr(batch, field.name), getattr(ends, field.name)
        if isinstance(expected, np.ndarray) and field.name != "nfev":
            assert found.tobytes() == expected.tobytes(), field.name


def test_no_times_and_times_that_no_run_reaches():
    for method in METHODS:
        none = run(method=method, t_eval=[])
        assert none.sample_x.shape == (1, 0)
        assert none.to_xarray().sample_x.shape == (1, 0)
        system = zivi.ImpactSystem(zivi.LinearForce(stiffness=-1e6), e=0.5)
        lost = run(systems=system, method=method, t_span=(0, 9), t_eval=[8.0, 9.0])
        assert np.isnan(lost.sample_x).all()
        assert lost.sample_x.shape == (1, 2)


@pytest.mark.parametrize("method", [EULER, zivi.SwitchedRK()], ids=repr)
def test_more_states_than_memory_are_refused_beforehand(method):
    times = np.linspace(0, 1, 10**6)
    with pytest.raises(MemoryError, match="y0 has 10000000 runs, t_eval 1000000 samples of each"):
        run(y0=np.ones((10**7, 2)), method=method, t_eval=times)


@pytest.mark.parametrize("save", SAVES)
def test_many_different_balls(save):
    draw = np.random.default_rng(3)
    systems = [
        zivi.ImpactSystem(-g, e=e)
        for g, e in zip(draw.uniform(0.0, 20.0, 150), draw.uniform(0.05, 1.0, 150), strict=True)
    ]
    check(systems, starts(150, 4), EULER, save)


@pytest.mark.parametrize("method", METHODS, ids=repr)
@pytest.mark.parametrize("form", FORCES)
def test_every_kind_of_force_that_needs_no_interpreter(form, method):
    check(zivi.ImpactSystem(FORCES[form](), e=0.6), starts(5), method, "final", 0.5)


@pytest.mark.parametrize("method", [EULER, zivi.MoreauJean(1e-3), zivi.SwitchedRK()], ids=repr)
def test_moving_walls(method):
    systems = [
        zivi.ImpactSystem(-9.81, e=0.5, wall=zivi.HarmonicWall(amplitude=0.01, omega=w))
        for w in (20.0, 31.0, 47.0)
    ]
    states = np.array([[0.3, 0.0], [0.2, 0.5], [0.1, -0.2]])
    check(systems, states, method, "events")


@pytest.mark.parametrize("save", SAVES)
@pytest.mark.parametrize("method", [EULER, zivi.MoreauJean(2e-3)], ids=repr)
def test_the_number_of_threads_changes_nothing(method, save):
    def of(threads):
        return zivi.simulate_batch(
            BALL, (0, 1), starts(200), method=method, save=save, threads=threads
        )

    one = of(1)
    for threads in (2, 5):
        assert bits(of(threads)) == bits(one)
    assert bits(of(None)) == bits(one)


def test_one_state_for_many_systems_and_one_system_for_many_states():
    systems = [zivi.ImpactSystem(-9.81, e=e) for e in (0.2, 0.5, 0.8)]
    several = zivi.simulate_batch(systems, (0, 6), (1, 0), method=EULER)
    assert len(several) == 3
    assert (np.diff(several.rest_time) > 0).all()
    same_ball = zivi.simulate_batch(systems[1], (0, 6), [(1, 0)] * 2, method=EULER)
    assert (same_ball.rest_time == several.rest_time[1]).all()
    assert len(zivi.simulate_batch(BALL, (0, 1), np.empty((0, 2)), method=EULER)) == 0


def test_runs_that_fail_do_not_disturb_the_others():
    """In one chunk with others: an absurd force, and one that is not a number."""
    wild = [zivi.ImpactSystem(-1e308, e=0.5), zivi.ImpactSystem(1e308, e=0.5)]
    systems = [BALL] * 20 + wild + [BALL] * 20
    states = starts(42) + np.array([0.1, 0.0])
    method = zivi.ThetaGamma(0.5)
    batch = zivi.simulate_batch(systems, (0, 400), states, method=method, save=3)
    assert batch.status[21] == zivi.Status.STATE_NOT_FINITE
    assert batch.success.sum() >= 40
    assert batch.t[21] < 400
    assert np.isnan(batch.sample_x[21, -1])
    for i in range(42):
        alone = zivi.simulate(systems[i], (0, 400), states[i], method=method)
        assert_is(batch, i, alone, 3)


@pytest.mark.parametrize(
    "method", [zivi.SwitchedRK(), zivi.ThetaGamma(1e-2), zivi.MoreauJean(1e-2)], ids=repr
)
def test_events_and_samples_at_times_are_those_of_single_runs(method):
    times, states = np.linspace(0.0, 2.0, 23), [(1.0, 0.0), (0.3, 2.0), (0.0, 0.0)]
    batch = zivi.simulate_batch(BALL, (0, 2), states, method=method, t_eval=times, save="events")
    for i, state in enumerate(states):
        sol = zivi.simulate(BALL, (0, 2), state, method=method, t_eval=times)
        np.testing.assert_array_equal(batch.sample_x[i], sol.x)
        np.testing.assert_array_equal(batch.sample_xdot[i], sol.xdot)
        for name, table in batch.events[i].items():
            np.testing.assert_array_equal(table, getattr(sol, name))
    assert batch.config["save"] == "events"
    assert len(batch.events[0]["impacts"]) == batch.n_impacts[0] > 2


def run(**changes):
    given = {"systems": BALL, "t_span": (0, 1), "y0": (1, 0), "method": EULER} | changes
    return zivi.simulate_batch(given.pop("systems"), given.pop("t_span"), given.pop("y0"), **given)


@pytest.mark.parametrize(
    ("changes", "kind", "message"),
    [
        ({"systems": 3}, TypeError, "systems must be zivi.ImpactSystem, got int (number 0)"),
        ({"systems": [BALL, "x"]}, TypeError, "got str (number 1)"),
        ({"systems": []}, ValueError, "systems must hold at least one"),
        (
            {"systems": [BALL, zivi.ImpactSystem(lambda t, x, v: 0.0, e=0.5)]},
            ValueError,
            "system 1",
        ),
        ({"systems": zivi.ImpactSystem(lambda t, x, v: 0.0, e=0.5)}, ValueError, "zivi.sweep"),
        ({"t_span": (0, np.inf)}, ValueError, "t_span"),
        ({"t_span": (1, 0)}, ValueError, "t_span"),
        ({"t_span": 3}, (TypeError, ValueError), "t_span"),
        ({"y0": [[1, 0, 0]]}, ValueError, "y0 must have shape (n, 2) or (2,)"),
        ({"y0": [(1, 0)] * 3, "systems": [BALL] * 2}, ValueError, "for each of the 2 systems"),
        ({"y0": [(1, 0), (1, 0), (-1, 0)]}, ValueError, "run 2 of the batch: x0 must be"),
        ({"y0": [(1, 0), (1, np.nan)]}, ValueError, "run 1 of the batch"),
        ({"y0": "up"}, (TypeError, ValueError), "y0"),
        ({"method": "RK45"}, TypeError, "method must be one of zivi's methods"),
        ({"save": "all"}, ValueError, "save must be one of 'final'"),
        ({"save": 0}, ValueError, "save must be a number of samples >= 1"),
        ({"save": 2.5}, TypeError, "save"),
        ({"save": 2, "method": zivi.SwitchedRK()}, ValueError, "needs a method of fixed steps"),
        ({"t_eval": [0.1], "save": 2}, ValueError, "save='final' or 'events' only, got save=2"),
        ({"t_eval": [0.1], "save": "statistics"}, ValueError, "got save='statistics'"),
        (
            {"t_eval": [0.2, 0.1]},
            ValueError,
            "t_eval must be increasing and within t_span",
        ),
        (
            {"t_eval": [0.2, 1.1]},
            ValueError,
            "t_eval must be increasing and within t_span",
        ),
        ({"t_eval": [[0.2]]}, ValueError, "t_eval must be one-dimensional"),
        ({"t_eval": [0.2, 0.2], "method": zivi.SwitchedRK()}, ValueError, "t_eval must be"),
        ({"threads": 0}, ValueError, "threads must be from 1"),
        ({"threads": 10**6}, ValueError, "threads must be from 1"),
        ({"threads": 1.5}, TypeError, "threads"),
    ],
)
def test_bad_input_is_named(changes, kind, message):
    with pytest.raises(kind, match=re.escape(message)):
        run(**changes)


def test_progress_shows_only_when_it_lasts(capfd, monkeypatch):
    run(progress=True)
    assert capfd.readouterr().err == ""
    monkeypatch.setattr(base_extras, "DELAY", 0.0)
    states = np.tile((1.0, 0.0), (3000, 1))
    run(y0=states, t_span=(0, 4), progress=True, method=zivi.MoreauJean(1e-3))
    assert "simulate" in capfd.readouterr().err


@pytest.mark.parametrize("save", ["final", "statistics", 10])
def test_to_xarray_round_trip(save, tmp_path):
    xarray = pytest.importorskip("xarray")
    pytest.importorskip("h5netcdf")
    batch = run(y0=starts(9), save=save)
    path = tmp_path / "batch.nc"
    batch.to_xarray().to_netcdf(path, engine="h5netcdf")
    with xarray.open_dataset(path, engine="h5netcdf") as read:
        for name in read.data_vars:
            same(read[name].values, getattr(batch, str(name)))
            assert read[name].attrs["units"]
        assert ("x_max" in read) == (save == "statistics")
        assert ("sample_x" in read) == (save == 10)
        if save == 10:
            same(read["time"].values, batch.sample_t)
        config = json.loads(read.attrs["config"])
    assert config["save"] == save
    assert config["n_systems"] == 1
    assert config["systems"][0]["kappa"] == 0.41


def test_events_of_many_runs_take_no_time():
    def took(n):
        begun = time.process_time()  # a busy machine does not count
        batch = run(y0=np.tile((0.1, 0.0), (n, 1)), method=zivi.ThetaGamma(1e-2), save="events")
        assert len(batch.events) == n
        return time.process_time() - begun

    # eight times the runs: sixty-four times the time if each looked through the events of all
    few, many = min(took(2_500) for _ in range(3)), min(took(20_000) for _ in range(3))
    assert many < 32 * few, (few, many)


MEMORY = """
    import numpy as np
    import zivi

    def run(n, steps):
        states = np.column_stack([np.linspace(0.5, 1.0, n), np.zeros(n)])
        method = zivi.ThetaGamma(1e-3)
        ball = zivi.ImpactSystem(-9.81, kappa=0.41)
        zivi.simulate_batch(ball, (0, 1e-3 * steps), states, method=method, threads=2)

    def peak():
        # not ru_maxrss, which a process inherits from the one that starts it
        lines = open("/proc/self/status").read().splitlines()
        return next(int(line.split()[1]) for line in lines if line.startswith("VmHWM"))

    run(100, 100)
    before = peak()
    run({n}, {steps})
    print(peak() - before)
"""


@pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")
def test_memory_does_not_grow_with_the_steps():
    """A state of every step would be 16 GB."""
    program = textwrap.dedent(MEMORY).format(n=100_000, steps=10_000)
    out = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert out.returncode == 0, out.stderr
    assert int(out.stdout) * 1024 < 1500 * 100_000


@pytest.mark.slow
@pytest.mark.skipif(not hasattr(signal, "setitimer"), reason="sends signals to itself")
@pytest.mark.parametrize(
    ("force", "e", "method"),
    [
        (-9.81, 1.0, zivi.ThetaGamma(1e-4)),
        (zivi.LinearForce(gravity=9.81, stiffness=1), 0.9, zivi.MoreauJean(1e-4)),
        (-9.81, 1.0, zivi.SwitchedRK()),
    ],
)
def test_ctrl_c_stops_a_batch(force, e, method):
    """Of hours."""
    system, states = zivi.ImpactSystem(force, e=e), np.tile((1.0, 0.0), (20_000, 1))
    with ctrl_c(by="thread"), pytest.raises(KeyboardInterrupt):
        zivi.simulate_batch(system, (0, 1000), states, method=method, threads=2)


def test_the_page():
    """docs/batch.md: its example, and the numbers it tells."""
    page = (Path(__file__).parents[1] / "docs" / "batch.md").read_text()
    program, _, mechanical = re.findall(r"```python\n(.*?)```", page, re.DOTALL)
    names = {"np": np, "zivi": zivi}
    exec(mechanical, names)
    assert names["falls"].success.all()
    assert names["falls"].sample_q.shape == (50, 301, 1)
    assert (names["falls"].n_zeno > 0).all()
    names = {}
    exec(program, names)
    (told,) = re.findall(r"print\(batch\)  # (.*)", program)
    assert repr(names["batch"]) == told
    e, w, g = names["e"], names["speed"], 9.81
    u = np.sqrt(w**2 + 2 * g)
    exact = (w + u) / g + 2 * e / (1 - e) * u / g
    assert np.abs(names["rest_time"] - exact).max() < 1e-12
    arguments = names["ball"], (0, 12), names["starts"]
    steps = zivi.simulate_batch(*arguments, method=EULER, parameters={"e": e.ravel()})
    early = exact.ravel() - steps.rest_time
    assert 0.34 < early.max() < 0.36
    assert e.ravel()[early.argmax()] == 0.8


@pytest.mark.parametrize(
    ("save", "size"), [("final", 105), ("statistics", 121), (10, 105 + 16 * 101)]
)
def test_bytes_of_a_run(save, size):
    batch = run(y0=starts(10), save=save)
    arrays = [getattr(batch, field.name) for field in dataclasses.fields(batch)]
    arrays = [it for it in arrays if isinstance(it, np.ndarray) and it is not batch.sample_t]
    assert sum(it.nbytes for it in arrays) == 10 * size


def test_the_default_method_is_that_of_simulate():
    ball = zivi.ImpactSystem(-9.81, e=0.5)
    batch = zivi.simulate_batch(ball, (0, 3), [(1, 0), (0.5, 1)])
    for i, start in enumerate([(1, 0), (0.5, 1)]):
        sol = zivi.simulate(ball, (0, 3), start)
        assert (batch.rest_time[i], batch.x[i]) == (sol.rest_time, sol.x[-1])
    assert batch.config["method"]["name"] == "SwitchedRK"


@pytest.mark.parametrize("save", ["final", "statistics", 3])
def test_flights_and_rest_by_moreau_and_jean_have_the_bits_of_the_runs_alone(save):
    """At rest the sign of a velocity of zero changes with each step: so it does in a batch."""
    method, span = zivi.MoreauJean(1e-3), (0.0, 3.0005)
    states = np.array([[0.1, 0.0], [0.2, 1.0], [0.0, 2.0], [0.0, 0.0], [4.0, 0.0], [0.1, -1.0]])
    system = zivi.ImpactSystem(-9.81, e=0.5)
    for steps in (0.0, 1e-3, 2e-3):
        until = (span[0], span[1] + steps)
        batch = zivi.simulate_batch(system, until, states, method=method, save=save)
        for i, state in enumerate(states):
            sol = zivi.simulate(system, until, state, method)
            for name in ("x", "xdot"):
                found, expected = getattr(batch, name), getattr(sol, name)
                assert found[i].tobytes() == expected[-1].tobytes(), (steps, i, name)
                if save == 3:
                    saved = getattr(batch, f"sample_{name}")
                    assert saved[i].tobytes() == expected[::3].tobytes()
            if save == "statistics":
                assert batch.x_max[i] == np.abs(sol.x).max()
                assert batch.speed_max[i] == np.abs(sol.xdot).max()
            assert sol.rest_time is None or batch.rest_time[i] == sol.rest_time
    assert np.isfinite(batch.rest_time[[0, 1, 2, 3, 5]]).all()
