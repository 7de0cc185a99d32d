"""Files of the command line in detail: tables, pictures by their data, keys, dimensions."""

import tomllib

import numpy as np
import pytest
import xarray

import zivi
from inside import (
    _zivi,
    files_file_keys as file_keys,
    files_kinds as kinds,
    files_results as results,
    files_summary as summary,
)
from zivi import files
from zivi.mechanics import Body, PlaneGap

pytest.importorskip("h5netcdf")
pytest.importorskip("zarr")

BALL = "t_span = [0, 3]\ny0 = [1, 0]\n[system]\nforce = -9.81\ne = 0.5\n"


def cells(table):
    return list(zip(*(column.cells for column in table.columns), strict=True))


def refuses_most(kind, size):
    if size > 1.0:
        raise ValueError(f"{size} is too much")
    return {"a": len(kind) * size}


@pytest.fixture(scope="module")
def ball():
    return zivi.simulate(zivi.ImpactSystem(-9.81, e=0.5), (0, 3), (1, 0))


def test_a_summary_lists_the_first_failures_and_counts_all():
    sizes = np.arange(0.0, 30.0)
    study = zivi.sweep(refuses_most, {"kind": ["x"], "size": sizes})
    rows = [(str(name), str(value)) for name, value in cells(summary.study_table(study))]
    assert ("failed", "28") in rows
    told = [row for row in rows if row[0].startswith("point ")]
    assert told == [
        (f"point {n}", f"ValueError: {float(n)} is too much") for n in range(2, 2 + summary.SHOWN)
    ]


def test_titles_say_what_it_is(ball):
    assert summary.run_table(ball).title == "Trajectory"
    law = zivi.TwistingRegulator(3, 2, h=1e-2, kappa=0.5)
    loop = zivi.simulate_closed_loop(zivi.ImpactSystem(0.0, kappa=0.5), law, (0, 0.1), (1, 0))
    assert summary.run_table(loop).title == "Closed loop"
    assert summary.experiments_table().show_lines


def test_pictures_of_studies_have_the_numbers_of_the_study():
    plt = pytest.importorskip("matplotlib.pyplot")
    from inside import files_picture

    def named(kind, size):
        return {"a": size * len(kind)}

    grid = zivi.sweep(named, {"kind": ["x", "yy"], "size": [1.0, 2.0, 3.0]})
    listed = zivi.sweep(named, zivi.points(size=[1.0, 2.0], kind=["yy", "x"]))
    figure, ax = plt.subplots()
    files_picture._map(grid, "a", ax)
    (mesh,) = ax.collections
    np.testing.assert_array_equal(mesh.get_array().ravel(), [1.0, 2.0, 3.0, 2.0, 4.0, 6.0])
    assert mesh.colorbar.mappable is mesh
    assert len(figure.axes) == 2
    plt.close(figure)
    figure, ax = plt.subplots()
    files_picture._draw_lines(grid, "a", ax)
    assert [list(line.get_ydata()) for line in ax.lines] == [[1.0, 2.0, 3.0], [2.0, 4.0, 6.0]]
    assert all(list(line.get_xdata()) == [1.0, 2.0, 3.0] for line in ax.lines)
    assert [text.get_text() for text in ax.get_legend().texts] == ["kind = x", "kind = yy"]
    assert (ax.get_xlabel(), ax.get_ylabel()) == ("size", "a")
    plt.close(figure)
    figure, ax = plt.subplots()
    files_picture._draw_points(listed, "a", ax)
    (dots,) = ax.collections
    np.testing.assert_array_equal(dots.get_offsets(), [[1.0, 2.0], [2.0, 2.0]])
    # names by their order in the alphabet
    np.testing.assert_array_equal(dots.get_array(), [1, 0])
    plt.close(figure)


def test_keys_of_settings_have_the_bounds_of_the_core():
    settings = {it.name: it for it in _zivi.METHODS["SwitchedRK"].settings}
    rtol, longest = (file_keys._setting(settings[name]) for name in ("rtol", "max_step"))
    assert (rtol.kind.above, rtol.kind.least) == (settings["rtol"].above, settings["rtol"].least)
    assert longest.kind.infinite
    law = {it.name: file_keys._setting(it).kind for it in _zivi.IMPACT_LAWS["SpeedDependentImpact"]}
    # infinite bounds are none
    assert (law["k"].above, law["k"].below) == (None, 1.0)
    assert (law["v0"].above, law["v0"].below) == (0.0, None)
    assert [key.name for key in file_keys._e_or_kappa("_ref", "0.5")] == ["e_ref", "kappa_ref"]
    assert file_keys._tagged(file_keys.SIMULATE, "method") is file_keys.OBJECTS["method"][1]
    with pytest.raises(TypeError, match="t_span does not have variants"):
        file_keys._tagged(file_keys.SIMULATE, "t_span")


def test_keys_below_a_variant_are_listed_with_it():
    """However deep: in a table, in one that may be a value, in lists, under the user's names."""
    word = kinds.Choice(("x", "y"))

    def key(name, kind=word):
        return file_keys.Key(name, kind, "one")

    inner = file_keys.KeyTable((key("deep"),))
    box = (
        key("plain", inner),
        key("either", kinds.Either(word, inner)),
        key("each", kinds.Each(inner, "tables")),
        key("open", file_keys.Open(inner, "names")),
    )
    shape = file_keys.Tagged("kind", {"box": (key("all"), *box), "ball": (key("all"), key("r"))})
    listed = [(row.path, row.variant) for row in file_keys.flatten_keys((key("shape", shape),))]
    below = ["plain", "plain.deep", "either", "either.deep", "each", "each.deep"]
    below += ["open", "open.NAME", "open.NAME.deep"]
    assert listed == [
        *[(name, "") for name in ("shape", "shape.kind", "shape.all")],
        *[(f"shape.{name}", "box") for name in below],
        ("shape.r", "ball"),
    ]
    # the tag is required, or has a default that is written as in a file
    for default, told in ((None, None), ("ball", '"ball"')):
        either = file_keys.Tagged("kind", {"box": (), "ball": ()}, default=default)
        _, tag = file_keys.flatten_keys((key("shape", either),))
        assert (tag.path, tag.key.default) == ("shape.kind", told)


def test_another_suffix_is_refused_with_those_that_are_known(tmp_path):
    known = [it for it in (*results.NETCDF, results.TABLE) if it]
    with pytest.raises(ValueError, match="must end in one of " + ", ".join(known)):
        results.check_suffix("out", tmp_path / "run.doc")


def test_what_only_the_run_refuses_names_its_key(tmp_path):
    (tmp_path / "ball.toml").write_text(BALL.replace("t_span = [0, 3]", "t_span = [3, 0]"))
    with pytest.raises(files.FileError, match="toml: t_span must run forward"):
        files.prepare_simulate(tmp_path / "ball.toml").run()


def test_laws_of_mechanical_systems_are_refused_by_their_key(tmp_path):
    (tmp_path / "rod.toml").write_text(
        "t_span = [0, 1]\ny0 = [[1.0], [0.0]]\n[system]\nq = ['y']\nT = 'ydot**2/2'\n"
        "V = '9.81*y'\ngaps = { floor = 'y' }\n"
        "e = [{ law = 'SpeedDependentImpact', e0 = 0.8, v0 = 1.0, k = 0.2, e_max = 0.5 }]\n"
    )
    with pytest.raises(files.FileError, match=r"system\.e\[0\]\.e_max must be"):
        files.prepare_simulate(tmp_path / "rod.toml").run()


def test_curves_are_whole_numbers_and_labelled_times(tmp_path, ball):
    free = zivi.simulate(zivi.ImpactSystem(0.0, e=0.5), (0, 1), (1, 0))
    for run in (ball, free):
        results.save(run, tmp_path / "run.nc", overwrite=True)
        with xarray.open_dataset(tmp_path / "run.nc") as dataset:
            assert dataset["curve_impact"].dtype == np.int64
            for name in dataset.variables:
                if str(name).startswith("curve_"):
                    assert dataset[name].attrs["long_name"], name


def test_events_and_steps_of_mechanical_runs_come_back(tmp_path):
    system = zivi.LinearSystem(
        np.eye(2), None, np.diag([1.0, 4.0]), gaps=[zivi.LinearGap([0.0, 1.0])], e=0.5
    )
    events = [lambda t, q, qdot: q[0] - 0.3, lambda t, q, qdot: q[0] + 9.0]
    run = zivi.simulate(system, (0, 3), ([1.0, 1.0], [0.0, 0.0]), events=events)
    assert len(run.t_events[0]) > 0
    results.save(run, tmp_path / "run.nc")
    found = results.load(tmp_path / "run.nc")
    for one, other in ((found.q_events, run.q_events), (found.qdot_events, run.qdot_events)):
        for here, there in zip(one, other, strict=True):
            np.testing.assert_array_equal(here, there)
    times = np.linspace(0.0, 3.0, 50)
    np.testing.assert_array_equal(found(times)[0], run(times)[0])
    fixed = zivi.simulate(system, (0, 1), ([1.0, 1.0], [0.0, 0.0]), method=zivi.MoreauJean(h=1e-2))
    results.save(fixed, tmp_path / "steps.nc")
    again = results.load(tmp_path / "steps.nc")
    np.testing.assert_array_equal(again(times / 3.0)[1], fixed(times / 3.0)[1])
    with xarray.open_dataset(tmp_path / "steps.nc") as dataset:
        assert dataset["step_q"].dims == ("step", "coordinate")
        steps = {str(name): dataset[name] for name in dataset.variables if "step_" in str(name)}
        assert len(steps) > 3
        for name, values in steps.items():
            assert set(values.dims) <= {"step", "coordinate", "gap"}, name
    with xarray.open_dataset(tmp_path / "run.nc") as dataset:
        assert dataset["event_qdot"].dims == ("event", "coordinate")


def test_a_tree_is_written_with_its_gaps_and_laws():
    bob = Body("bob", axis=[0, 1, 0], mass=2.0, com=[0, 0, -1], inertia=0.01)
    gaps = [
        PlaneGap("bob", [0, 0, -1], offset=-0.8),
        PlaneGap("bob", [0, 0, -1], offset=-0.9, name="low"),
    ]
    law = zivi.system.impact_law.SpeedDependentImpact(0.5, 1.0, 0.2)
    tree = zivi.Tree([bob], gaps=gaps, e=[law, 0.25])
    told = tomllib.loads(files.tree_text(tree, (0, 2), ([1.5], [0.0])))["system"]
    assert told["e"][1] == 0.25
    assert told["e"][0]["law"] == "SpeedDependentImpact"
    assert [gap["offset"] for gap in told["gaps"]] == [-0.8, -0.9]
    assert [gap["kind"] for gap in told["gaps"]] == ["plane", "plane"]
