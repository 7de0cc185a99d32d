"""Studies: points, results, seeds, failures, events, in memory and in a folder."""

import json
import subprocess
import sys

import numpy as np
import pytest
import xarray as xr
from scipy.stats import qmc

import sweep_functions as functions
import zivi
from inside import Chunks, base_extras

pytest.importorskip("zarr", reason="the extra 'study' is not installed")
pytest.importorskip("pyarrow", reason="the extra 'study' is not installed")

GRID = {"x": np.arange(6.0), "y": [0.5, 1.5, 2.5]}


@pytest.fixture(params=["memory", "folder"])
def out(request, tmp_path):
    return None if request.param == "memory" else tmp_path / "study.zarr"


# points


def test_a_dict_is_a_grid(out):
    study = zivi.sweep(functions.product, GRID, out=out, units={"x": "m", "value": "m^2"})
    assert dict(study.sizes) == {"x": 6, "y": 3}
    assert study.value.dims == ("x", "y")
    assert np.array_equal(study.value, np.outer(*GRID.values()))
    assert float(study.value.sel(x=4, y=1.5)) == 6.0
    assert study.x.attrs["units"] == "m"
    assert study.value.attrs["units"] == "m^2"
    assert study.complete
    assert study.attrs["source"] == f"zivi {zivi.__version__}"
    assert json.loads(study.attrs["parameters"]) == ["x", "y"]
    assert json.loads(study.attrs["config"])["function"] == "sweep_functions.product"


def test_listed_points(out):
    rows = [{"x": 1.0, "y": 2.0}, {"y": 3.0, "x": 4.0}]
    study = zivi.sweep(functions.product, rows, out=out)
    same = zivi.sweep(functions.product, zivi.points(x=[1.0, 4.0], y=[2.0, 3.0]))
    assert study.value.dims == ("point",)
    assert study.value.values.tolist() == [2.0, 12.0]
    assert set(study.coords) == {"x", "y"}
    xr.testing.assert_identical(study.dataset.load(), same.dataset)


@pytest.mark.parametrize("sampler", ["sobol", "lhs", "halton"])
def test_sampled_points_are_those_of_scipy(sampler):
    bounds = {"x": (1.0, 3.0), "y": (1e-4, 1.0)}
    study = zivi.sweep(functions.product, zivi.sample(sampler, 16, bounds, log=["y"], seed=5))
    engine = {"sobol": qmc.Sobol, "lhs": qmc.LatinHypercube, "halton": qmc.Halton}[sampler]
    unit = engine(2, seed=5).random(16)
    assert np.array_equal(study.x, 1.0 + 2.0 * unit[:, 0])
    assert np.allclose(study.y, 1e-4 ** (1.0 - unit[:, 1]), rtol=1e-12)
    assert np.array_equal(study.value, study.x * study.y)


def test_an_engine_of_the_user():
    drawn = zivi.sample(qmc.Sobol(1, seed=1), 8, {"x": (0.0, 1.0)})
    assert np.array_equal(drawn.values["x"], qmc.Sobol(1, seed=1).random(8)[:, 0])


def test_parameters_keep_their_kinds(out):
    def kinds(n, on, name):
        return {"good": type(n) is int and type(on) is bool and type(name) is str}

    points = {"n": [1, 2], "on": [True, False], "name": ["newton", "é"]}
    study = zivi.sweep(kinds, points, out=out)
    assert np.all(study.good == 1.0)
    assert float(study.good.sel(n=2, on=True, name="é")) == 1.0


@pytest.mark.parametrize("shape", [(1,), (7,), (3, 5), (5, 3), (2, 1, 9), (4, 3, 2), (70, 70)])
@pytest.mark.parametrize("points", [None, 1, 2, 4, 7, 1000])
def test_chunks_are_runs_of_points_that_cover_all_once(shape, points):
    layout = Chunks(shape, points)
    numbers = np.arange(np.prod(shape)).reshape(shape)
    seen = []
    for chunk in range(len(layout)):
        span = list(layout.span(chunk))
        assert numbers[layout.slices(chunk)].ravel().tolist() == span
        assert len(span) <= (points or max(1, np.prod(shape) // 64 + 1))
        seen += span
    assert sorted(seen) == numbers.ravel().tolist()


# results


@pytest.mark.parametrize("value", [3, 2.5, True, None, np.float32(0.5), np.int8(-3)])
def test_numbers_become_floats(value):
    study = zivi.sweep(lambda x: value, {"x": [0]})
    expected = np.nan if value is None else float(value)
    assert np.array_equal(study.value, [expected], equal_nan=True)


def test_arrays_have_dimensions_of_their_own(out):
    def orbit(x):
        return {"orbit": [x, 2 * x, 3 * x], "table": np.full((2, 2), x)}

    study = zivi.sweep(orbit, {"x": [1.0, 2.0]}, out=out, dims={"orbit": ["hit"]})
    assert study.orbit.dims == ("x", "hit")
    assert study.table.dims == ("x", "table_0", "table_1")
    assert study.orbit.sel(x=2.0).values.tolist() == [2.0, 4.0, 6.0]


def bounce(e):
    ball = zivi.ImpactSystem(-9.81, e=e)
    return zivi.simulate(ball, (0, 3), (1, 0))


def test_a_trajectory_is_summarised(out):
    study = zivi.sweep(bounce, {"e": [0.5, 0.9]}, out=out)
    one = bounce(0.9)
    assert float(study.rest_time[0]) == bounce(0.5).rest_time
    assert np.isnan(study.rest_time[1])
    assert float(study.x[1]) == one.x[-1]
    assert float(study.xdot[1]) == one.xdot[-1]
    assert float(study.n_impacts[1]) == len(one.impacts)
    assert float(study.nfev[1]) == one.nfev
    assert study.run_status.values.tolist() == [0.0, 0.0]
    assert study.rest_time.attrs["units"] == "s"


def test_a_study_counts_the_runs_that_ended_early():
    def run(x0):
        def force(t, x, xdot):
            return float("nan") if x > 2 else -9.81

        return zivi.simulate(zivi.ImpactSystem(force, e=0.5), (0, 1), (x0, 0))

    study = zivi.sweep(run, {"x0": [1.0, 3.0, 4.0]})
    told = "2 of 3 with a run that failed (2 force_not_finite)"
    assert told in repr(study)
    assert told in study._repr_html_()


def test_a_closed_loop_is_summarised():
    def loop(mu1):
        plant = zivi.ImpactSystem(-9.81, kappa=0.5)
        tracker = zivi.TwistingTracker(mu1, 17, h=1e-3, kappa=0.5)
        start = {"y_ref0": (3, 3), "force_ref": -19.81}
        return zivi.simulate_closed_loop(plant, tracker, (0, 2), (6, 5), **start)

    study = zivi.sweep(loop, {"mu1": [30.0]})
    assert float(study.x[0]) == float(study.x_ref[0]) == 0.0
    assert float(study.u[0]) == 9.81 - 19.5  # pressed on the wall
    assert float(study.n_refused[0]) == 0.0
    assert study.u.attrs["units"] == "m/s^2"


def test_events_carry_the_number_of_their_point(out):
    def hits(e):
        sol = bounce(e)
        return sol, sol.impacts

    ratios = [0.3, 0.0, 0.6]
    study = zivi.sweep(hits, {"e": ratios}, out=out, chunk=1)
    table = study.events.to_pandas()
    fields = ["t", "gap", "speed_before", "speed_after", "impulse", "group"]
    assert list(table.columns) == ["point", *fields]
    for point, e in enumerate(ratios):
        ours = table[table.point == point]
        assert np.array_equal(ours.t, bounce(e).impacts["t"])
        assert int(study.n_events[point]) == len(ours)
    assert study.n_events.dtype.kind == "i"


def test_events_as_a_dict_and_points_without_any(out):
    def sometimes(x):
        return x, {"t": [x, x + 0.5], "n": [1, 2]} if x > 0 else None

    study = zivi.sweep(sometimes, {"x": [0.0, 1.0]}, out=out, chunk=1)
    assert study.events.to_pydict() == {"point": [1, 1], "t": [1.0, 1.5], "n": [1, 2]}
    assert zivi.sweep(lambda x: (x, None), {"x": [0.0]}).events.num_rows == 0
    assert zivi.sweep(functions.product, GRID).events is None


def test_a_folder_and_memory_give_the_same(tmp_path):
    points = {"x": np.arange(10.0), "y": np.linspace(0, 1, 11)}
    kept = zivi.sweep(functions.cheap, points, seed=1)
    written = zivi.sweep(functions.cheap, points, seed=1, out=tmp_path / "a.zarr")
    xr.testing.assert_identical(kept.dataset, written.dataset.load())
    assert kept.events.equals(written.events)
    again = zivi.open_study(tmp_path / "a.zarr", verify=True)
    xr.testing.assert_identical(again.dataset.load(), kept.dataset)
    assert again.failed.equals(kept.failed)
    plain = xr.open_zarr(tmp_path / "a.zarr", chunks=None).load()
    assert plain.equals(kept.dataset)


def test_what_a_study_says(tmp_path):
    study = zivi.sweep(functions.cheap, {"x": [6.0, 7.0], "y": [0.0, 1.0]}, out=tmp_path / "a")
    assert "3 of 4 points completed, 1 failed" in repr(study)
    completed, failed = zivi.StudyStatus.COMPLETED, zivi.StudyStatus.FAILED
    assert study.status.tolist() == [completed, completed, failed, completed] == [1, 1, 2, 1]
    assert str(tmp_path / "a") in repr(study)
    assert study["area"].equals(study.dataset["area"])
    with pytest.raises(AttributeError):
        _ = study.no_such_thing


# seeds


def test_each_point_has_its_own_child_of_the_seed(out):
    study = zivi.sweep(functions.both_seeds, {"x": range(5)}, seed=11, out=out)
    for point, source in enumerate(np.random.SeedSequence(11).spawn(5)):
        seed = int(source.generate_state(1, np.uint64)[0])
        assert float(study.seed[point]) == seed % 2**32
        assert float(study.draw[point]) == np.random.default_rng(source).random()
    assert study.attrs["seed"] == 11


def test_a_seed_that_is_drawn_is_told():
    first = zivi.sweep(functions.both_seeds, {"x": range(3)})
    again = zivi.sweep(functions.both_seeds, {"x": range(3)}, seed=first.attrs["seed"])
    other = zivi.sweep(functions.both_seeds, {"x": range(3)})
    assert np.array_equal(first.draw, again.draw)
    assert not np.array_equal(first.draw, other.draw)


def test_a_seed_that_is_a_parameter_is_the_parameter():
    study = zivi.sweep(lambda seed: seed, {"seed": [5, 6]}, seed=1)
    assert study.value.values.tolist() == [5.0, 6.0]


def test_the_order_does_not_matter_for_the_seed():
    whole = zivi.sweep(functions.both_seeds, {"x": range(40)}, seed=2, chunk=7)
    parts = zivi.sweep(functions.both_seeds, {"x": range(40)}, seed=2, chunk=1, executor="threads")
    assert np.array_equal(whole.draw, parts.draw)


# failures


def test_a_point_that_fails_does_not_stop_the_others(out):
    def inverse(x):
        return 1 // x

    study = zivi.sweep(inverse, {"x": [2, 0, 1]}, out=out)
    assert study.status.tolist() == [1, 2, 1]
    assert study.complete  # nothing is missing
    assert study.dataset.status.values.tolist() == [1, 2, 1]
    assert np.array_equal(study.value, [0.0, np.nan, 1.0], equal_nan=True)
    assert study.failed.to_dict("index") == {
        1: {"x": 0, "message": "ZeroDivisionError: integer division or modulo by zero"}
    }


@pytest.mark.parametrize(
    ("returned", "message"),
    [
        ({"a": 1.0, "b": 2.0}, "returned a, b; other points gave a"),
        ({"a": [1.0, 2.0]}, "returned a (2,); other points gave a"),
        (({"a": 1.0}, None), "either all points return (values, events) or none does"),
        ({"a": "text"}, "a must be a real number or an array of them, got str 'text'"),
        ({"a": 1j}, "a must be a real number or an array of them, got complex 1j"),
        ((1, 2, 3), "a tuple must be (values, events), got 3 things"),
    ],
)
@pytest.mark.parametrize("chunk", [1, 2])
def test_results_that_differ_are_failures(returned, message, chunk, out):
    study = zivi.sweep(lambda x: returned if x else {"a": 1.0}, {"x": [0, 1]}, chunk=chunk, out=out)
    assert study.status.tolist() == [1, 2]
    assert message in study.failed.message[1]


def test_events_that_differ_are_failures():
    def changing(x):
        return x, {"t": [1.0]} if x < 2 else {"t": [1]}

    for chunk in (1, 3):
        study = zivi.sweep(changing, {"x": range(3)}, chunk=chunk)
        assert study.status.tolist() == [1, 1, 2]
        assert study.failed.message[2].startswith("ValueError: events have")


def test_nothing_but_failures_is_an_error(out):
    with pytest.raises(RuntimeError, match="all 3 points failed, one of them: KeyError: 'a'") as e:
        zivi.sweep(lambda x: {}["a"], {"x": range(3)}, out=out)
    assert e.value.study.status.tolist() == [2, 2, 2]


def test_failed_points_are_tried_again_if_that_is_wanted(tmp_path):
    call = {
        "function": functions.flaky,
        "points": {"x": range(6)},
        "out": tmp_path / "a",
        "fixed": {"mark": str(tmp_path / "mark")},
    }
    assert zivi.sweep(**call).failed.index.tolist() == [3]
    (tmp_path / "mark").touch()
    assert zivi.sweep(**call).failed.index.tolist() == [3]
    study = zivi.sweep(**call, retry_failed=True)
    assert not len(study.failed)
    assert study.value.values.tolist() == list(range(6))
    assert set(study.message.values.tolist()) == {""}


def test_a_function_that_leaves_the_interpreter_is_a_failure():
    study = zivi.sweep(lambda x: sys.exit(1) if x else 0, {"x": [0, 1]})
    assert study.failed.message[1] == "SystemExit: 1"


# wrong arguments


@pytest.mark.parametrize(
    ("arguments", "error", "text"),
    [
        ({"function": 3}, TypeError, "function must be callable"),
        ({"function": "no such"}, ValueError, "the experiments are ball_rest_time, table_period"),
        ({"function": lambda z: z}, TypeError, "cannot be called with the parameters x, y"),
        ({"points": {}}, ValueError, "at least one parameter"),
        ({"points": []}, TypeError, "points must be"),
        ({"points": 3}, TypeError, "points must be"),
        ({"points": {"x": [], "y": [1]}}, ValueError, "x must be a sequence"),
        ({"points": {"x": 1.0, "y": [1]}}, ValueError, "x must be a sequence"),
        ({"points": {"x": [1, "a"], "y": [1]}}, TypeError, "x must hold numbers or strings"),
        ({"points": {"x": [None], "y": [1]}}, TypeError, "x must hold numbers or strings"),
        ({"points": {"x": [[1], [1, 2]], "y": [1]}}, TypeError, "x must hold numbers"),
        ({"points": {"x": [2**64 - 1], "y": [1]}}, ValueError, "x must fit into 64 bits"),
        ({"points": {"status": [1]}}, ValueError, "cannot be named 'status'"),
        ({"points": {"a b": [1]}}, ValueError, "must be a Python name, got 'a b'"),
        ({"points": [{"x": 1}, {"y": 1}]}, ValueError, r"points\[1\] has the parameters"),
        ({"fixed": {"x": 1}}, ValueError, "fixed has parameters of the study: x"),
        ({"seed": -1}, ValueError, "seed must be >= 0"),
        ({"seed": 1.5}, TypeError, "seed must be a whole number"),
        ({"chunk": 0}, ValueError, "chunk must be >= 1"),
        ({"in_flight": 0}, ValueError, "in_flight must be >= 1"),
        ({"executor": "cluster"}, TypeError, "executor must be None, 'threads'"),
        ({"workers": 0, "executor": "threads"}, ValueError, "workers must be >= 1"),
        ({"workers": 2}, ValueError, "workers goes with executor='threads'"),
        ({"resume": True}, ValueError, "resume=True needs a folder"),
        ({"resume": "yes"}, TypeError, "resume must be True, False or None"),
        ({"dims": {"value": "n"}}, TypeError, "must be a list of names"),
        ({"dims": {"value": ["n"]}}, ValueError, "names 1 dimensions"),
        ({"dims": {"value": 3}}, TypeError, "must be a list of names"),
        ({"dims": {"value": [3]}}, TypeError, "must be a list of names"),
        ({"dims": {"value": ["n", "n"]}}, ValueError, "names a dimension twice: n, n"),
        ({"dims": {"value": ["x"]}}, ValueError, "cannot name a dimension 'x'"),
        ({"dims": {"value": ["point"]}}, ValueError, "cannot name a dimension 'point'"),
        ({"dims": {"value": ["value"]}}, ValueError, "cannot name a dimension 'value'"),
        ({"units": {"x": 3}}, TypeError, "units must give strings by names, got 'x': 3"),
        ({"colour": "red"}, TypeError, "colour"),
    ],
)
def test_wrong_arguments(arguments, error, text):
    call = {"function": functions.product, "points": GRID} | arguments
    with pytest.raises(error, match=text):
        zivi.sweep(**call)


@pytest.mark.parametrize(
    ("arguments", "error", "text"),
    [
        (("dice", 3, {"x": (0, 1)}), ValueError, "sampler must be one of sobol"),
        ((3, 3, {"x": (0, 1)}), TypeError, "sampler must be one of sobol"),
        (("lhs", 0, {"x": (0, 1)}), ValueError, "n must be >= 1"),
        (("lhs", 3, {"x": (1, 0)}), ValueError, "low < high"),
        (("lhs", 3, {"x": 1}), TypeError, r"bounds\['x'\] must be two numbers"),
        (("lhs", 3, 5), TypeError, "bounds must be a dict of pairs"),
        (("lhs", 3, {}), ValueError, "bounds must have at least one parameter"),
        (("lhs", 3, {"x": (0, np.inf)}), ValueError, "must be finite"),
        ((qmc.LatinHypercube(2), 3, {"x": (0, 1)}), ValueError, "draws 2 numbers a point"),
    ],
)
def test_wrong_samples(arguments, error, text):
    with pytest.raises(error, match=text):
        zivi.sample(*arguments)


def test_wrong_logarithms():
    with pytest.raises(ValueError, match="must be > 0 for a logarithm"):
        zivi.sample("lhs", 3, {"x": (0, 1)}, log=["x"])
    with pytest.raises(ValueError, match="log names parameters without bounds: y"):
        zivi.sample("lhs", 3, {"x": (0, 1)}, log=["y"])
    with pytest.raises(TypeError, match="log must be a list of names, got 'x'"):
        zivi.sample("lhs", 3, {"x": (1, 2)}, log="x")
    with pytest.raises(ValueError, match="must have one length"):
        zivi.points(x=[1, 2], y=[1])


@pytest.mark.parametrize(
    ("result", "dims", "text"),
    [
        ({"a": [1, 2], "b": [1, 2, 3]}, {"a": ["n"], "b": ["n"]}, "length 2 in 'a', 3 in 'b'"),
        ({"a": [1, 2], "n": 1}, {"a": ["n"]}, "'n' of 'a' has the name of a result"),
        ({"a": [1, 2]}, {}, "'a_0' of 'a' has the name of a result or of a parameter"),
    ],
)
def test_dimensions_that_do_not_fit_end_a_study_at_its_first_point(result, dims, text, tmp_path):
    called = []

    def given(a_0):
        called.append(a_0)
        return result

    for number, out in enumerate((None, tmp_path / "a"), 1):
        with pytest.raises(ValueError, match=text):
            zivi.sweep(given, {"a_0": range(9)}, dims=dims, chunk=1, out=out)
        assert called == [0] * number


def test_a_result_cannot_have_the_name_of_a_parameter():
    with pytest.raises(RuntimeError, match="the result 'x' has the name of a parameter"):
        zivi.sweep(lambda x: {"x": x}, {"x": [1]})
    with pytest.raises(RuntimeError, match="cannot be named 'status'"):
        zivi.sweep(lambda x: {"status": x}, {"x": [1]})


# libraries


@pytest.mark.slow
@pytest.mark.parametrize("missing", ["zarr", "pyarrow"])
def test_a_missing_library_is_named_with_its_extra(missing, tmp_path):
    program = f"""
import sys
sys.modules[{missing!r}] = None
import zivi
def f(x):
    return x, {{"t": [1.0]}}
assert zivi.sweep(f, {{"x": [1.0, 2.0]}}).value.values.tolist() == [1.0, 2.0]
assert len(zivi.sweep(f, {{"x": [1.0, 2.0]}}).events) == 2
try:
    zivi.sweep(f, {{"x": [1.0]}}, out={str(tmp_path / "a")!r})
except ImportError as error:
    print(error)
"""
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert f"need {missing}: pip install 'zivi[study]'" in done.stdout, done.stderr


def test_the_bar_is_called_sweep(monkeypatch):
    import contextlib
    import io

    class Terminal(io.StringIO):
        def isatty(self):
            return True

    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setattr(base_extras, "DELAY", 0.0)
    with contextlib.redirect_stderr(Terminal()) as screen:
        zivi.sweep(functions.product, GRID, progress=True)
    assert "sweep" in screen.getvalue()


def test_masked_entries_are_refused():
    masked = np.ma.masked_array([1.0, 9e9, 3.0], mask=[False, True, False])
    told = r"must not have masked entries, got 1 of 3; use \.compressed\(\) or \.filled\(value\)"
    for points in ({"x": masked}, zivi.grid, zivi.points):
        with pytest.raises(ValueError, match=f"^x {told}"):
            zivi.sweep(lambda x: x, points if isinstance(points, dict) else points(x=masked))
    study = zivi.sweep(lambda x: masked if x else np.arange(3.0), {"x": [0, 1]})
    assert "the result must not have masked entries" in study.failed.message[1]
    study = zivi.sweep(lambda x: np.ma.masked_equal(x, 1), {"x": [0, 1]}, vectorized=True)
    assert "the result must not have masked entries" in study.failed.message[1]
    with pytest.raises(ValueError, match=f"^times {told}"):
        zivi.Table(masked, [1.0, 2.0, 3.0])
    assert zivi.sweep(lambda x: x, {"x": np.ma.masked_array([1.0, 2.0])}).complete


def test_a_name_that_no_file_can_have_is_refused(tmp_path):
    with pytest.raises(ValueError, match=r"parameter must have at most 200 bytes.*300: x"):
        zivi.sweep(lambda **_: 0.0, {"x" * 300: [1.0]}, out=tmp_path / "a")
    with pytest.raises(RuntimeError, match="name of a result must have at most 200 bytes"):
        zivi.sweep(lambda x: {"y" * 300: x}, {"x": [1.0]}, out=tmp_path / "a")
