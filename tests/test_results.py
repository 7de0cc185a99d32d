"""One vocabulary: what every result can be turned into, and what every run calls its events."""

import pickle

import numpy as np
import pytest

import zivi
from inside import Tabulated
from test_pickles import BALL, DROP, MAKE, TRACKER

xarray = pytest.importorskip("xarray")
pytest.importorskip("pandas")
pytest.importorskip("h5netcdf", reason="the extra 'files' is not installed")

RESULTS = sorted(
    [
        "Basins",
        "Batch",
        "Branch",
        "ClosedLoop",
        "ClosedLoopBatch",
        "Diagram",
        "EventCurve",
        "Fit",
        "Lyapunov",
        "MechanicalBatch",
        "MechanicalBranch",
        "MechanicalClosedLoop",
        "MechanicalLoopBatch",
        "MechanicalOrbit",
        "MechanicalSensitivity",
        "MechanicalTrajectory",
        "Observed",
        "PeriodicOrbit",
        "Sensitivity",
        "Trajectory",
    ]
)


class Idle:
    """A controller that lets the mass fall."""

    h = 0.1

    def step(self, t, q, qdot):
        return [0.0]


RUNS = {
    "Trajectory": lambda **more: zivi.simulate(BALL, (0, 3), (1, 0), **more),
    "fixed steps": lambda **more: zivi.simulate(
        BALL, (0, 3), (1, 0), zivi.ThetaGamma(1e-2), **more
    ),
    "ClosedLoop": lambda **more: zivi.simulate_closed_loop(
        BALL, zivi.TwistingRegulator(30, 25, h=0.1, e=0.5), (0, 3), (1, 0), **more
    ),
    "MechanicalTrajectory": lambda **more: zivi.simulate(DROP, (0, 3), ([1.0], [0.0]), **more),
    "MechanicalClosedLoop": lambda **more: zivi.simulate_closed_loop(
        DROP, Idle(), (0, 3), ([1.0], [0.0]), **more
    ),
}
COMMON = [
    "t",
    "impacts",
    "resolved_impacts",
    "zeno",
    "liftoffs",
    "zeno_times",
    "liftoff_times",
    "rest_time",
    "t_events",
    "y_events",
    "q_events",
    "qdot_events",
    "status",
    "success",
    "message",
    "nfev",
    "config",
    "slowest",
]
CALLED = ["resample", "to_pandas", "to_xarray", "plot", "impacts_down_to"]


def test_no_class_of_results_is_left_out():
    def those_of(kind):
        return {kind}.union(*map(those_of, kind.__subclasses__()))

    bases = {"AnyOrbit", "MassRun", "BatchRuns", "OrbitsAlong", "SampledRun", "Tabulated"}
    bases |= {"UpdatedBatch"}
    here = {it.__name__ for it in those_of(Tabulated) if it.__module__.startswith("zivi")}
    assert sorted(here - bases) == RESULTS


@pytest.mark.parametrize("name", RESULTS)
def test_every_result_is_a_dataset_a_table_a_file_and_a_page(name, tmp_path):
    result = MAKE[name]()
    assert isinstance(result, Tabulated)
    data = result.to_xarray()
    assert zivi.__version__ in data.attrs["source"]
    assert data.attrs["title"]
    assert all(data[it].attrs["long_name"] for it in data.data_vars)
    table = result.to_pandas()
    assert len(table.columns)
    assert len(table) == data.sizes[table.index.name]
    assert "<table>" in result._repr_html_()
    assert type(result).__name__ in repr(result)
    assert repr(pickle.loads(pickle.dumps(result))) == repr(result)
    zivi.files.save(result, tmp_path / "it.nc")
    with xarray.open_dataset(tmp_path / "it.nc", engine="h5netcdf") as opened:
        assert set(data.variables) <= set(opened.variables)
        for it in data.variables:
            np.testing.assert_array_equal(opened[it].values, data[it].values)
    if name in ("Trajectory", "ClosedLoop", "MechanicalTrajectory", "MechanicalClosedLoop"):
        assert repr(zivi.files.load(tmp_path / "it.nc")) == repr(result)
    else:
        with pytest.raises(zivi.files.ResultError, match=f"holds a {name}"):
            zivi.files.load(tmp_path / "it.nc")
    zivi.files.save(result, tmp_path / "it.csv")
    first = (tmp_path / "it.csv").read_text().partition("\n")[0].split(",")
    assert first == [table.index.name, *table.columns]


def test_what_is_saved_has_a_suffix_that_is_known(tmp_path):
    run = RUNS["Trajectory"]()
    with pytest.raises(ValueError, match=r"\.nc.*\.csv.*it\.xlsx'"):
        zivi.files.save(run, tmp_path / "it.xlsx")
    with pytest.raises(TypeError, match="result of zivi with to_xarray, got dict"):
        zivi.files.save({}, tmp_path / "it.nc")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("name", RUNS)
def test_runs_call_their_events_alike(name):
    run = RUNS[name]()
    assert all(hasattr(run, it) for it in COMMON)
    assert all(callable(getattr(run, it)) for it in CALLED)
    fields = ("t", "gap", "speed_before", "speed_after", "impulse", "group")
    assert run.impacts.dtype.names == fields
    assert run.zeno.dtype.names == ("t", "gap", "closed")
    assert run.liftoffs.dtype.names == ("t", "gap")
    assert not run.impacts["gap"].any()
    np.testing.assert_array_equal(run.impacts.group, np.arange(1, len(run.impacts) + 1))
    np.testing.assert_allclose(run.impacts["speed_after"], -0.5 * run.impacts["speed_before"])
    np.testing.assert_allclose(run.impacts["impulse"], -1.5 * run.impacts["speed_before"])
    np.testing.assert_array_equal(run.zeno["t"], run.zeno_times)
    np.testing.assert_array_equal(run.liftoffs["t"], run.liftoff_times)
    assert run.rest_time == pytest.approx(run.zeno["t"][-1])
    assert "that accumulate at" in repr(run)


@pytest.mark.parametrize("name", RUNS)
def test_runs_are_resampled_and_drawn_alike(name):
    pytest.importorskip("matplotlib")
    run = RUNS[name]()
    times = np.linspace(0.05, 2.95, 30)
    other = run.resample(times)
    assert type(other) is type(run)
    np.testing.assert_array_equal(other.t, times)
    state = np.array(
        [other.q[:, 0], other.qdot[:, 0]] if hasattr(run, "q") else [other.x, other.xdot]
    )
    np.testing.assert_array_equal(state, np.reshape(run(times), (2, 30)))
    assert list(run.to_pandas(n=4).index) == [0.0, 1.0, 2.0, 3.0]
    assert run.to_xarray(n=4).sizes["time"] == 4
    assert len(run.plot().axes) == 4


@pytest.mark.parametrize("name", ["Trajectory", "MechanicalTrajectory"])
def test_the_mass_is_the_smallest_mechanism(name):
    def high(t, q, qdot):
        return float(np.ravel(qdot)[0]) - 1.0

    run, mass = RUNS[name](events=high), RUNS["Trajectory"](events=high)
    for field in mass.impacts.dtype.names:
        np.testing.assert_allclose(run.impacts[field], mass.impacts[field], rtol=1e-9, atol=1e-12)
    for events in ("q_events", "qdot_events"):
        np.testing.assert_allclose(getattr(run, events)[0], getattr(mass, events)[0], rtol=1e-9)
    assert run.rest_time == pytest.approx(mass.rest_time, rel=1e-12)


def test_a_loop_between_samples_keeps_what_is_held():
    loop = RUNS["ClosedLoop"]()
    first, second = (
        loop.resample([0.05, 0.15, 0.55]),
        loop.resample(n=1001).resample([0.05, 0.15, 0.55]),
    )
    k = [0, 1, 5]
    for run in (first, second):
        np.testing.assert_array_equal(run.u, loop.u[k])
        np.testing.assert_array_equal(run.signs, loop.signs[k])


def test_mechanisms_that_move_do_not_rest():
    sliding = zivi.MechanicalSystem(
        mass=np.eye(2), force=[0.0, -9.81], gaps=[zivi.LinearGap([0, 1])], e=0.5
    )
    assert zivi.simulate(sliding, (0, 3), ([0, 1], [1, 0])).rest_time is None
    assert zivi.simulate(sliding, (0, 3), ([0, 1], [0, 0])).rest_time == pytest.approx(
        RUNS["Trajectory"]().rest_time, rel=1e-12
    )


BOUNCY = zivi.ImpactSystem(-9.81, e=0.9)
FALL = np.sqrt(2 / 9.81)
ZENO = FALL * 1.9 / 0.1


def exact_impacts(x0, end, part=1e-3):
    """The ball from x0: times, and speeds before impacts, down to a part of the first."""
    fall, v = np.sqrt(2 * x0 / 9.81), np.sqrt(2 * 9.81 * x0)
    n = np.arange(1 + int(np.floor(np.log(part) / np.log(0.9))))
    t = fall * (1 + 2 * 0.9 * (1 - 0.9**n) / 0.1)
    return t[t <= end], (v * 0.9**n)[t <= end]


@pytest.mark.parametrize("end", [3.0, 8.5, ZENO - 1e-4, 8.6, 20.0])
@pytest.mark.parametrize("x0", [1.0, 1.01, 1.05])
def test_impacts_mean_one_thing_whether_they_were_jumped_or_not(x0, end):
    t, speed = exact_impacts(x0, end)
    run = zivi.simulate(BOUNCY, (0, end), (x0, 0))
    np.testing.assert_allclose(run.impacts["t"], t, rtol=1e-11)
    np.testing.assert_allclose(-run.impacts["speed_before"], speed, rtol=1e-9)
    without = zivi.simulate(BOUNCY, (0, end), (x0, 0), dense_output=False)
    np.testing.assert_array_equal(without.impacts, run.impacts)
    for save in ("final", "events"):
        batch = zivi.simulate_batch(BOUNCY, (0, end), [[x0, 0]], save=save)
        assert batch.n_impacts[0] == len(t)
        assert batch.last_impact[0] == run.impacts["t"][-1]
        assert batch.n_resolved[0] == len(run.resolved_impacts)
    np.testing.assert_array_equal(batch.events[0]["impacts"], run.impacts)
    s = zivi.sensitivity(BOUNCY, (0, end), (x0, 0), ("x0",))
    np.testing.assert_allclose(s.impacts["t"], t, rtol=1e-9)
    # all times are proportional to sqrt(x0)
    np.testing.assert_allclose(s.impacts["dt"][:, 0], t / (2 * x0), rtol=1e-6)


@pytest.mark.parametrize("end", [8.5, 8.6])
def test_so_they_do_of_mechanisms(end):
    drop = zivi.MechanicalSystem(mass=2.0, force=[-19.62], gaps=[zivi.LinearGap([1])], e=0.9)
    t, speed = exact_impacts(1.0, end)
    run = zivi.simulate(drop, (0, end), ([1.0], [0.0]))
    np.testing.assert_allclose(run.impacts["t"], t, rtol=1e-11)
    np.testing.assert_allclose(run.impacts["impulse"], 2.0 * 1.9 * speed, rtol=1e-9)
    batch = zivi.simulate_batch(drop, (0, end), ([[1.0]], [[0.0]]))
    assert batch.n_impacts[0] == len(t)
    assert batch.last_impact[0] == run.impacts["t"][-1]
    s = zivi.sensitivity(drop, (0, end), ([1.0], [0.0]), ("q0",))
    np.testing.assert_allclose(s.impacts["dt"][:, 0], t / 2, rtol=1e-6)


def test_the_slowest_impacts_are_a_part_of_the_fastest():
    t, _ = exact_impacts(1.0, 20.0, 0.05)
    assert len(zivi.simulate(BOUNCY, (0, 20), (1, 0), slowest=0.05).impacts) == len(t)
    assert zivi.simulate_batch(BOUNCY, (0, 20), [[1, 0]], slowest=0.05).n_impacts[0] == len(t)
    calls = (
        lambda part: zivi.simulate(BALL, (0, 1), (1, 0), slowest=part),
        lambda part: zivi.simulate(DROP, (0, 1), ([1.0], [0.0]), slowest=part),
        lambda part: zivi.simulate_batch(BALL, (0, 1), [[1, 0]], slowest=part),
        lambda part: zivi.simulate_closed_loop(BALL, TRACKER, (0, 1), (1, 0), slowest=part),
    )
    for call in calls:
        for part in (0.0, -1.0, 1.5, np.nan):
            with pytest.raises(ValueError, match="slowest"):
                call(part)


def test_a_mass_on_others_takes_its_part_of_skipped_impacts():
    """Two masses in contact, the upper one bounces on the lower, which lies on the ground."""
    stack = zivi.MechanicalSystem(
        mass=np.diag([1.0, 3.0]),
        force=[-9.81, -29.43],
        gaps=[zivi.LinearGap([1, -1]), zivi.LinearGap([0, 1])],
        e=0.5,
    )
    run = zivi.simulate(stack, (0, 3), ([1.0, 0.0], [0.0, 0.0]))
    own = run.impacts[run.impacts["gap"] == 0]
    assert len(own) == 1 + int(np.log(1e-3) / np.log(0.5))
    np.testing.assert_allclose(own["impulse"], -1.5 * own["speed_before"], rtol=1e-9)
    # the ground gives the lower mass the same impulse
    ground = run.impacts[run.impacts["gap"] == 1]
    np.testing.assert_allclose(ground["impulse"], own["impulse"][-len(ground) :], rtol=1e-9)
    np.testing.assert_array_equal(ground["group"], own["group"][-len(ground) :])


def test_studies_and_solved_problems_are_shown_and_converted_as_all_results():
    study = zivi.sweep("ball_rest_time", {"e": [0.3, 0.5]}, progress=False)
    assert study.to_xarray() is study.dataset
    page = study._repr_html_()
    assert "zivi.Study" in page
    assert "<th style='text-align:left'>completed</th><td style='text-align:left'>2</td>" in page
    assert study.dataset._repr_html_()[:20] in page
    solved = zivi.solve_vi(lambda x: x - 1.0, np.zeros(2), np.full(2, 5.0), np.zeros(2))
    page = solved._repr_html_()
    assert f"{solved.status.name.lower()}: {solved.message}" in page
    assert "1, 1" in page


def test_runs_tell_their_end_in_the_same_rows():
    for name in ("Trajectory", "ClosedLoop", "MechanicalTrajectory", "MechanicalClosedLoop"):
        assert list(RUNS[name]()._facts())[:2] == ["status", "time"]
