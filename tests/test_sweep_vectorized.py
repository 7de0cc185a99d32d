"""Studies of functions that take many points at a time."""

import os

import numpy as np
import pytest
import xarray as xr

import sweep_functions as functions
import zivi
from inside import child, generators, seeds, study_pools
from interrupting import calls_in

pytest.importorskip("zarr", reason="the extra 'study' is not installed")
pytest.importorskip("pyarrow", reason="the extra 'study' is not installed")

GRID = {"x": np.arange(9.0), "y": np.linspace(0, 1, 11)}


@pytest.fixture(params=["memory", "folder"])
def out(request, tmp_path):
    return None if request.param == "memory" else tmp_path / "study.zarr"


def sweep(function, points, **how):
    return zivi.sweep(function, points, vectorized=True, **how)


# points and results


def test_arrays_go_in_and_out(out):
    seen = []

    def product(x, y):
        seen.append((x.shape, x.dtype, y.shape))
        return x * y

    study = sweep(product, GRID, out=out)
    assert np.array_equal(study.value, np.outer(*GRID.values()))
    assert sum(shape[0] for shape, _, _ in seen) == 99
    assert all(own == (own[0],) == other and kind == np.float64 for own, kind, other in seen)


def test_kinds_of_parameters(out):
    def kinds(n, on, name):
        assert (n.dtype.kind, on.dtype.kind, name.dtype.kind) == ("i", "b", "U")
        return {"n": n + 0.5 * on, "width": np.char.str_len(name)}

    points = zivi.points(n=[1, 2], on=[True, False], name=["newton", "é"])
    renamed = lambda n, on, name: {f"{key}_": it for key, it in kinds(n, on, name).items()}  # noqa: E731
    study = sweep(renamed, points, out=out)
    assert study.n_.values.tolist() == [1.5, 2.0]
    assert study.width_.values.tolist() == [6.0, 1.0]


@pytest.mark.parametrize("chunk", [None, 1, 7, 1000])
def test_the_study_is_that_of_one_point_after_the_other(chunk, out):
    """Values, arrays, draws, events and failures."""

    def each(x, y, seed):
        one = functions.cheap_many(np.array([x]), np.array([y]), np.array([seed], np.uint64))
        values, events = one
        if values.pop("message")[0]:
            raise ValueError("nothing here")
        del events["point"]
        return {name: rows[0] for name, rows in values.items()}, events

    ours = sweep(functions.cheap_many, GRID, seed=3, chunk=chunk, out=out)
    theirs = zivi.sweep(each, GRID, seed=3)
    ours.dataset.load()
    assert ours.failed.index.tolist() == theirs.failed.index.tolist() == [77]
    assert ours.failed.message[77] == "nothing here"
    for name in ("area", "pair", "luck", "n_events", "status"):
        xr.testing.assert_identical(ours[name], theirs[name])
    assert ours.events.equals(theirs.events)


def test_a_function_may_write_to_what_it_gets(out):
    def spoil(x):
        x *= 2.0
        if np.any(x == 6.0):
            raise ValueError
        return x

    study = sweep(spoil, {"x": np.arange(8.0)}, out=out)
    assert study.failed.index.tolist() == [3]
    assert np.array_equal(study.value[[0, 1, 2, 4, 5]], [0.0, 2.0, 4.0, 8.0, 10.0])
    assert study.x.values.tolist() == list(range(8))


# seeds


@pytest.mark.parametrize("seed", [0, 1, 2**32 - 1, 2**32, 2**63 - 1])
def test_seeds_are_those_of_numpy(seed):
    points = np.array([0, 1, 2, 1023, 10**9 - 1])
    sources = np.random.SeedSequence(seed).spawn(3)
    known = [int(it.generate_state(1, np.uint64)[0]) for it in sources]
    known += [int(child(seed, it).generate_state(1, np.uint64)[0]) for it in (1023, 10**9 - 1)]
    assert seeds(seed, points).tolist() == known
    draws = [it.random() for it in generators(seed, points[:3])]
    assert draws == [np.random.default_rng(it).random() for it in sources]


def test_seeds_do_not_depend_on_the_chunks():
    def drawn(x, seed, rng):
        assert seed.dtype == np.uint64
        return {"seed": seed % 2**32, "draw": np.array([it.random() for it in rng])}

    study = zivi.sweep(functions.both_seeds, {"x": range(40)}, seed=2)
    for chunk in (None, 1, 7):
        many = sweep(drawn, {"x": range(40)}, seed=2, chunk=chunk)
        for name in ("seed", "draw"):
            assert np.array_equal(many[name], study[name])


# failures


def test_a_call_that_raises_loses_only_the_points_that_make_it_raise(out):
    study = sweep(functions.picky, {"x": range(200)}, out=out)
    bad = np.arange(200) % 10 == 3
    assert np.array_equal(study.status == 2, bad)
    assert study.failed.message.tolist() == [f"ValueError: bad: {x}" for x in range(3, 200, 10)]
    assert np.array_equal(study.half, np.where(bad, np.nan, np.arange(200) / 2), equal_nan=True)


def test_one_bad_point_costs_few_calls(tmp_path):
    calls = []

    def one(x):
        calls.append(len(x))
        if np.any(x == 700):
            raise ValueError
        return x

    assert sweep(one, {"x": range(1000)}, chunk=1000).failed.index.tolist() == [700]
    # one call for all, two for each halving
    assert len(calls) <= 1 + 2 * 10
    assert sum(calls) <= 3 * 1000


def test_a_list_gives_each_point_what_a_plain_function_gives(out):
    def several(e):
        found = []
        for it in e:
            if it == 0.9:
                found.append(ValueError("not that one"))
                continue
            ball = zivi.ImpactSystem(-9.81, e=it)
            sol = zivi.simulate(ball, (0, 3), (1, 0))
            found.append((sol, sol.impacts))
        return found

    def one(e):
        return several([e])[0]

    ours = sweep(several, {"e": [0.3, 0.9, 0.5]}, out=out)
    theirs = zivi.sweep(one, {"e": [0.3, 0.5]})
    assert ours.failed.message.tolist() == ["ValueError: not that one"]
    for name in theirs.data_vars:
        if name not in ("message", "status"):
            assert np.array_equal(ours[name][[0, 2]], theirs[name]), name
    assert ours.rest_time.attrs["units"] == "s"
    assert np.array_equal(ours.events["t"], theirs.events["t"])


@pytest.mark.parametrize(
    ("function", "text"),
    [
        (lambda x: 1.0, r"must have one row for each of 1 points, got an array of shape \(\)"),
        (lambda x: {"a": x[1:]}, r"a must have one row for each of 1 points, .* shape \(0,\)"),
        (lambda x: {"a": ["b"] * len(x)}, "a must be an array of real numbers, got list"),
        (lambda x: [1.0, 2.0], "a list must have one entry for each point, got 2 for 1"),
        (lambda x: {"message": [""] * len(x)}, "returned no values"),
        (lambda x: {"a": x, "message": "b"}, "message must have one text for each of 1 points"),
        (lambda x: {"x": x}, "the result 'x' has the name of a parameter"),
        (lambda x: (x, x, x), r"a tuple must be \(values, events\)"),
        (lambda x: (x, [None] * 9), "events must be a list with those of each of 1 points"),
        (lambda x: (x, {"t": x}), "must have a column 'point' of whole numbers"),
        (lambda x: (x, {"t": x, "point": [1]}), "'point' of events must be >= 0 and < 1"),
        (lambda x: (x, {"t": x, "point": [0, 0]}), "must be columns of one length"),
    ],
)
def test_what_cannot_be_understood_is_told(function, text):
    with pytest.raises(RuntimeError, match=f"all 3 points failed, one of them: .*{text}"):
        sweep(function, {"x": [1.0, 2.0, 3.0]})


def test_vectorized_is_true_or_false():
    with pytest.raises(TypeError, match="vectorized must be True or False, got 1"):
        zivi.sweep(functions.product, GRID, vectorized=1)


def test_a_vectorized_study_is_another_one(tmp_path):
    sweep(functions.product, GRID, out=tmp_path / "a")
    with pytest.raises(ValueError, match="whether the function takes many points at a time: True"):
        zivi.sweep(functions.product, GRID, out=tmp_path / "a")


# what zivi computes


def test_a_batch_gives_what_runs_give(out):
    ratios, heights = np.linspace(0.2, 0.8, 7), np.array([0.5, 1.0])

    def batch(e, h):
        balls = [zivi.ImpactSystem(-9.81, e=it) for it in e]
        found = zivi.simulate_batch(
            balls, (0, 3), np.column_stack([h, 0 * h]), save="events", threads=1
        )
        return found, [own["impacts"] for own in found.events]

    def run(e, h):
        sol = zivi.simulate(zivi.ImpactSystem(-9.81, e=e), (0, 3), (h, 0))
        return sol, sol.impacts

    points = {"e": ratios, "h": heights}
    ours, theirs = sweep(batch, points, out=out), zivi.sweep(run, points)
    for name in ("t", "x", "xdot", "rest_time", "n_impacts", "n_zeno", "run_status", "n_events"):
        assert np.array_equal(ours[name], theirs[name], equal_nan=True), name
    assert ours.events.equals(theirs.events)
    assert ours.rest_time.attrs["units"] == "s"
    # closed form
    speed = np.sqrt(2 * 9.81 * heights)
    rest = speed / 9.81 * (1 + 2 * ratios[:, None] / (1 - ratios[:, None]))
    rest[rest > 3] = np.nan
    assert np.allclose(ours.rest_time, rest, rtol=1e-9, equal_nan=True)


def test_closed_loops(out):
    plant = zivi.ImpactSystem(-9.81, e=0.5)
    how = {"y_ref0": (0.2, 0.0), "noise": (1e-4, 0.0)}

    def loops(mu1, seed):
        trackers = [zivi.TwistingTracker(it, 17, h=1e-2, e=0.5) for it in mu1]
        return zivi.simulate_closed_loop_batch(
            plant, trackers, (0, 0.1), (0.2, 0), seed=seed, threads=1, **how
        )

    def loop(mu1, seed):
        tracker = zivi.TwistingTracker(mu1, 17, h=1e-2, e=0.5)
        return zivi.simulate_closed_loop(plant, tracker, (0, 0.1), (0.2, 0), seed=seed, **how)

    points = {"mu1": [29.0, 30.0, 31.0]}
    ours = sweep(loops, points, out=out, seed=4)
    theirs = zivi.sweep(loop, points, seed=4)
    for name in ("x", "xdot", "x_ref", "n_refused", "run_status"):
        assert np.array_equal(ours[name], theirs[name]), name
    assert len(set(ours.x.values.tolist())) == 3
    assert ours.u_max.attrs["units"] == "m/s^2"


def test_mechanical_systems(out):
    drop = zivi.symbolic.system(
        "y", T="m*ydot**2/2", V="m*g*y", gaps=["y"], parameters={"m": 1.0, "g": 9.81}, e=0.5
    )

    def batch(g):
        systems = [drop.replace(g=float(it)) for it in g]
        return zivi.simulate_batch(systems, (0, 1), ([1.0], [0.0]))

    def run(g):
        return zivi.simulate(drop.replace(g=g), (0, 1), ([1.0], [0.0]))

    points = {"g": [1.6, 3.7, 9.81]}
    ours, theirs = sweep(batch, points, out=out), zivi.sweep(run, points)
    for name in ("t", "q", "qdot", "gaps", "contacts", "n_impacts", "run_status"):
        assert np.array_equal(ours[name], theirs[name]), name
    assert ours.q.shape == (3, 1)


def test_orbits(out):
    def orbit(a):
        force = zivi.LinearForce(gravity=1.0, amplitude=a, phase=-np.pi / 2)
        return zivi.periodic_orbit(zivi.ImpactSystem(force, e=0.5), [(0.6, 2.1)])

    points = {"a": [1.25, 1.3]}
    ours = sweep(lambda a: [orbit(it) for it in a], points, out=out)
    theirs = zivi.sweep(orbit, points)
    known = orbit(1.3)
    assert float(ours.period[1]) == known.period
    assert np.array_equal(ours.multiplier_imag[1], known.multipliers.imag)
    assert ours.stable.values.tolist() == [1.0, 1.0]
    assert ours.orbit_status.values.tolist() == [0.0, 0.0]
    assert ours.depth.attrs["units"] == "m"
    for name in theirs.data_vars:
        assert ours[name].load().identical(theirs[name]), name


# stopped and gone on with


def test_nothing_is_computed_twice_and_interruptions_keep_what_is_done(tmp_path):
    pressed = []

    def stopping(x):
        if len(pressed) == 3:
            pressed.append(1)
            raise KeyboardInterrupt
        pressed.append(len(x))
        return 2.0 * x

    call = {"function": stopping, "points": {"x": range(640)}, "out": tmp_path / "a"}
    with pytest.raises(KeyboardInterrupt) as stop:
        sweep(**call)
    known = stop.value.study.status
    assert known.sum() == sum(pressed[:3]) > 0
    assert np.array_equal(sweep(**call).value, 2.0 * np.arange(640))
    assert sum(pressed) == 640 + 1


def test_failed_points_are_tried_again(tmp_path):
    mark = tmp_path / "mark"

    def flaky(x):
        if not mark.exists() and np.any(x == 3):
            raise RuntimeError("not yet")
        return x

    call = {"function": flaky, "points": {"x": range(6)}, "out": tmp_path / "a"}
    assert sweep(**call).failed.index.tolist() == [3]
    mark.touch()
    assert sweep(**call).failed.index.tolist() == [3]
    study = sweep(**call, retry_failed=True)
    assert study.value.values.tolist() == list(range(6))


def test_a_call_that_takes_too_long_hands_back_what_it_has(monkeypatch):
    """A bad point in a slow call: the good halves are kept, the rest is shared."""
    monkeypatch.setattr(study_pools, "SLICE", -1.0)

    def slow(x):
        if np.any(x == 37):
            raise ValueError
        return x

    study = sweep(slow, {"x": range(256)}, executor="threads", workers=2, chunk=128)
    assert study.failed.index.tolist() == [37]
    assert np.count_nonzero(study.status == 1) == 255


@pytest.mark.slow
@pytest.mark.skipif(os.name != "posix", reason="kills a process")
def test_a_point_that_kills_its_worker_fails_alone():
    study = zivi.sweep(
        functions.deadly_many,
        {"x": [1, 36, 37, 38]},
        vectorized=True,
        executor="processes",
        workers=2,
    )
    assert study.failed.index.tolist() == [2]
    assert "the worker died while it computed this point" in study.failed.message[2]


# what it costs


@pytest.mark.slow
def test_a_ball_costs_less_than_half_a_call_beside_the_batch(tmp_path):
    ball = zivi.ImpactSystem(-9.81, e=0.5)

    def balls(h):
        return zivi.simulate_batch(ball, (0, 3), np.column_stack([h, 0 * h]), threads=1)

    def calls(n):
        points = {"h": np.linspace(0.5, 1.5, n)}
        return calls_in(lambda: sweep(balls, points, out=tmp_path / str(n)))

    calls(10)
    few, many = calls(1_000), calls(51_000)
    assert many - few < 50_000 / 2
