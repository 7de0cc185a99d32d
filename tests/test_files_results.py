"""Results on disk: nothing is lost, nothing half-written or damaged is taken for whole."""

import dataclasses
import json
import os
import shutil
import subprocess
import sys
import textwrap
from pathlib import Path

import numpy as np
import pytest
import xarray

import zivi
from inside import check_suffix, files_results as results, open_result, read_curve
from zivi.files import ResultError, load, save

pytest.importorskip("h5netcdf")

pytestmark = pytest.mark.filterwarnings("ignore:a landing may never rest")


def ball(method=zivi.ThetaGamma(h=1e-2), **kwargs):  # noqa: B008 frozen
    system = kwargs.pop("system", zivi.ImpactSystem(-9.81, e=0.5))
    return zivi.simulate(system, (0, 3), (1, 0), method=method, **kwargs)


def interrupted():
    calls = 0

    def force(t, x, xdot):
        nonlocal calls
        calls += 1
        if calls > 40:
            raise KeyboardInterrupt
        return -9.81

    with pytest.raises(KeyboardInterrupt) as caught:
        ball(system=zivi.ImpactSystem(force, e=0.5))
    return caught.value.trajectory


def loop(**kwargs):
    plant = zivi.ImpactSystem(-9.81, kappa=0.5)
    tracker = zivi.TwistingTracker(30, 17, h=1e-3, kappa=0.5)
    kwargs = {"y_ref0": (3, 3), "force_ref": -19.81} | kwargs
    return zivi.simulate_closed_loop(plant, tracker, (0, 2), (6, 5), **kwargs)


def regulated():
    law = zivi.TwistingRegulator(3, 2, h=1e-2, kappa=0.5, u_limits=(-1, 4))
    return zivi.simulate_closed_loop(zivi.ImpactSystem(0.0, kappa=0.5), law, (0, 1), (1, 0))


TABLE = zivi.HarmonicWall(0.01, 60.0)
LIFT = zivi.MovingWall(lambda t: 0.5 * t, lambda t: 0.5, lambda t: 0.0)
RUNS = {
    "steps": ball,
    "switched": lambda: ball(zivi.SwitchedRK()),
    "plain switched": lambda: ball(zivi.SwitchedRK(), dense_output=False),
    "times": lambda: ball(t_eval=[0.0, 0.5, 0.5, 2.0]),
    "other baseline": lambda: ball(zivi.MoreauJean(h=1e-2)),
    "solver": lambda: ball(zivi.ThetaGamma(h=1e-2, solver="outer", linearisations=1)),
    "no impacts": lambda: zivi.simulate(zivi.ImpactSystem(0.0, e=0.5), (0, 1), (1, 0)),
    "budget": lambda: ball(zivi.SwitchedRK(max_steps=2)),
    "table": lambda: ball(system=zivi.ImpactSystem(-9.81, e=0.5, wall=TABLE)),
    "lift": lambda: ball(system=zivi.ImpactSystem(-9.81, e=0.5, wall=LIFT)),
    "events": lambda: ball(events=[lambda t, x, xdot: xdot, lambda t, x, xdot: x - 9.0]),
    "interrupted": interrupted,
    "loop": loop,
    "noisy loop": lambda: loop(noise=(1e-3, 1e-2), delay=2),
    "regulator": regulated,
}


def assert_same(found, expected):
    for field in dataclasses.fields(expected):
        if field.name.startswith("_"):
            continue
        one, other = getattr(found, field.name), getattr(expected, field.name)
        assert type(one) is type(other), field.name
        if field.name == "transformed":
            assert_same(one, other)
            continue
        if isinstance(other, np.ndarray):
            assert one.dtype == other.dtype
            assert one.shape == other.shape
            assert one.tobytes() == other.tobytes(), field.name
        elif isinstance(other, list):
            assert len(one) == len(other)
            for here, there in zip(one, other, strict=True):
                np.testing.assert_array_equal(here, there)
        elif isinstance(other, dict):
            assert json.dumps(one) == json.dumps(other)
        else:
            assert one == other, field.name


@pytest.mark.parametrize("name", RUNS)
def test_round_trip(name, tmp_path):
    run = RUNS[name]()
    save(run, tmp_path / "run.nc")
    found = load(tmp_path / "run.nc")
    assert_same(found, run)
    assert repr(found) == repr(run)
    assert found.success == run.success
    assert os.listdir(tmp_path) == ["run.nc"]
    # the dataset of a user is that of `to_xarray`, with its units, and more
    with xarray.open_dataset(tmp_path / "run.nc") as dataset:
        expected = run.to_xarray()
        for variable in expected.variables:
            assert dataset[variable].identical(expected[variable].drop_vars([
                coordinate for coordinate in expected[variable].coords if coordinate != variable
                and coordinate not in dataset[variable].coords]))  # fmt: skip
        for attribute, value in expected.attrs.items():
            np.testing.assert_equal(dataset.attrs[attribute], value)


def cut():
    def high(t, x, xdot):
        return xdot - 1.0

    high.terminal = 2
    return ball(events=high)


CALLED = {name: RUNS[name] for name in ("steps", "switched", "times", "table", "events", "budget")}
CALLED |= {"other baseline": RUNS["other baseline"], "interrupted": interrupted, "cut": cut}
CALLED["other times"] = lambda: ball(zivi.MoreauJean(h=1e-2), t_eval=[0.0, 0.7, 1.9])
CALLED["near elastic"] = lambda: ball(
    zivi.SwitchedRK(), system=zivi.ImpactSystem(zivi.LinearForce(gravity=9.81, damping=0.2), e=0.9)
)


@pytest.mark.parametrize("name", CALLED)
def test_what_is_known_between_the_samples_comes_back_to_the_last_bit(name, tmp_path):
    run = CALLED[name]()
    save(run, tmp_path / "run.nc")
    # also after another round
    save(load(tmp_path / "run.nc"), tmp_path / "again.nc")
    found = load(tmp_path / "again.nc")
    assert found._path.span == run._path.span
    times = np.linspace(*run._path.span, 377)
    assert found(times).tobytes() == run(times).tobytes()
    np.testing.assert_array_equal(found._path.lifted(times), run._path.lifted(times))
    np.testing.assert_array_equal(found.fixed(), run.fixed())
    for speed in (1e-6, 1e-2, 1.0):
        known = found.impacts_down_to(speed, limit=500)
        assert known.tobytes() == run.impacts_down_to(speed, limit=500).tobytes()


def test_extrapolated_impacts_are_kept_also_without_dense_output(tmp_path):
    run = RUNS["plain switched"]()
    save(run, tmp_path / "run.nc")
    found = load(tmp_path / "run.nc")
    assert len(found.resolved_impacts) == 3
    assert len(found.impacts_down_to(1e-6)) == 23  # 4.43 m/s e^22 = 1.06e-6 before
    with pytest.raises(ValueError, match="needs a run with dense_output=True"):
        found(0.5)


def test_what_is_not_kept_is_refused(tmp_path):
    save(RUNS["lift"](), tmp_path / "lift.nc")
    with pytest.raises(ValueError, match="functions of the wall are not kept"):
        load(tmp_path / "lift.nc").fixed()


def rewritten(file, change):
    """Write a file anew, and seal it, with a dataset that was changed."""
    dataset = open_result(file)
    dataset = change(dataset) or dataset
    dataset.to_netcdf(file, engine="h5netcdf")
    results._seal(file)
    return file


@pytest.fixture(scope="module")
def stored(tmp_path_factory):
    file = tmp_path_factory.mktemp("stored") / "run.nc"
    save(RUNS["switched"](), file)
    return file


@pytest.mark.parametrize("name", ["switched", "times"])
def test_files_of_older_versions_say_what_they_lack(name, tmp_path):
    def as_it_was(dataset):
        dataset.attrs["path"] = ""
        return dataset.drop_vars([it for it in dataset.variables if it.startswith(("mot", "path"))])

    save(RUNS[name](), tmp_path / "run.nc")
    found = load(rewritten(tmp_path / "run.nc", as_it_was))
    for ask in (lambda: found(0.5), lambda: found.impacts_down_to(1e-6)):
        with pytest.raises(ValueError, match="written by an older version of zivi"):
            ask()
    save(found, tmp_path / "again.nc")
    with pytest.raises(ValueError, match="written by an older version of zivi"):
        load(tmp_path / "again.nc")(0.5)


@pytest.mark.parametrize(
    ("change", "match"),
    [
        (lambda it: it["motion"].__setitem__(0, 8.0), "format 8, this zivi reads"),
        (lambda it: it["motion"].__setitem__(slice(None), 9.0), "format 9"),
        (lambda it: it.isel(motion_number=slice(0, -1)), "the stored motion is damaged"),
        (lambda it: it.isel(motion_number=slice(0, 0)), "the stored motion is damaged"),
        (
            lambda it: it.attrs.update(format=8),
            r"newer version of zivi .format 8; this version reads 7",
        ),
        (lambda it: it.attrs.update(format="four"), "is not a run of zivi"),
        (lambda it: it.attrs.update(path="Bow"), "lacks 'Bow'"),
        (lambda it: it.attrs.update(config="{"), "is not a run of zivi"),
        (lambda it: it.attrs.update(config="[" * 10**5), "is not a run of zivi"),
        (lambda it: it.attrs.update(config="[]"), "is not a run of zivi"),
        (lambda it: it.attrs.update(status=99), "is not a run of zivi"),
        (lambda it: it.attrs.update(nfev="many"), "is not a run of zivi"),
        (lambda it: it.attrs.update(rest_time="late"), "is not a run of zivi"),
        (lambda it: it.attrs.pop("message") and None, "lacks 'message'"),
    ],
)
def test_damaged_contents(change, match, stored, tmp_path):
    refused(rewritten(Path(shutil.copy(stored, tmp_path)), change), match)


def test_files_that_do_not_tell_their_format_are_read(tmp_path):
    run = RUNS["switched"]()
    save(run, tmp_path / "run.nc")
    rewritten(tmp_path / "run.nc", lambda it: it.attrs.pop("format") and None)
    assert_same(load(tmp_path / "run.nc"), run)


def test_no_numbers_make_a_motion_that_fails():
    """A motion of any numbers is refused with a ValueError, or can be asked for anything."""
    whole = RUNS["switched"]()._path.numbers()
    draw = np.random.default_rng(2)
    values = [0.0, 1.0, -1.0, 2.0, 8.0, 9.0, 0.5, 1e9, 1e300, np.inf, -np.inf, np.nan]
    times, made = np.linspace(-1, 4, 21), 0
    for number in range(3000):
        numbers = whole[: draw.integers(len(whole)) if number % 10 == 0 else len(whole)].copy()
        for _ in range(draw.integers(1, 4)):
            if len(numbers):
                numbers[draw.integers(min(len(numbers), 80))] = draw.choice(values)
        try:
            motion = zivi._zivi.MotionPath.restored(numbers)
        except ValueError:
            continue
        made += 1
        motion.physical(times), motion.lifted(times), motion.skipped_impacts(1e-3, 50)
        assert isinstance(motion.tails, list)
    assert made > 100


def test_what_is_drawn_is_what_the_run_draws(tmp_path):
    for name in ("switched", "steps", "loop"):
        run = RUNS[name]()
        save(run, tmp_path / f"{name}.nc")
        found = read_curve(open_result(tmp_path / f"{name}.nc"))
        for draw in (zivi.plot.position, zivi.plot.velocity):
            lines = [draw(it).lines[0].get_xydata() for it in (found, run)]
            np.testing.assert_array_equal(*lines)


def test_nothing_is_overwritten(tmp_path):
    file = tmp_path / "run.nc"
    save(ball(), file)
    before = file.read_bytes()
    with pytest.raises(
        FileExistsError, match=r"run\.nc is there already; overwrite=True replaces it"
    ):
        save(loop(), file)
    assert file.read_bytes() == before
    save(loop(), file, overwrite=True)
    assert isinstance(load(file), zivi.ClosedLoop)


def test_a_failed_write_leaves_the_old_file(tmp_path, monkeypatch):
    file = tmp_path / "run.nc"
    save(ball(), file)
    before = file.read_bytes()

    def full(self, path, **kwargs):
        path.write_bytes(b"half")
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(xarray.Dataset, "to_netcdf", full)
    with pytest.raises(OSError, match="No space"):
        save(loop(), file, overwrite=True)
    assert file.read_bytes() == before
    assert os.listdir(tmp_path) == ["run.nc"]


@pytest.mark.slow
def test_a_killed_write_leaves_no_file(tmp_path):
    program = textwrap.dedent("""
        import os, sys
        import zivi
        from zivi.files import results
        results._seal = lambda file: os._exit(9)
        results.save(zivi.simulate(zivi.ImpactSystem(-9.81, e=0.5), (0, 1), (1, 0)), sys.argv[1])
    """)
    file = tmp_path / "run.nc"
    ended = subprocess.run([sys.executable, "-c", program, str(file)], timeout=60, check=False)
    assert ended.returncode == 9
    assert not file.exists()
    assert all(name.startswith(".run.nc.") for name in os.listdir(tmp_path))


def refused(file, match):
    with pytest.raises(ResultError, match=match) as caught:
        load(file)
    assert str(caught.value).startswith(f"{file}: ")


def test_what_is_no_result(tmp_path):
    file = tmp_path / "run.nc"
    with pytest.raises(FileNotFoundError, match="does not exist"):
        load(file)
    for content in (b"", b"no netCDF", os.urandom(4096)):
        file.write_bytes(content)
        refused(file, "is not a netCDF file, or is damaged")
    xarray.Dataset({"x": ("t", np.arange(3.0))}).to_netcdf(file, engine="h5netcdf")
    refused(file, "lacks the end mark of zivi")


def test_cut_files(tmp_path):
    whole, cut = tmp_path / "whole.nc", tmp_path / "cut.nc"
    save(ball(), whole)
    content = whole.read_bytes()
    for part in np.linspace(0.0, 1.0, 30, endpoint=False):
        cut.write_bytes(content[: int(part * len(content))])
        refused(cut, "not a netCDF file|it was truncated")


def test_damaged_files(tmp_path):
    """A bit that is flipped anywhere is noticed, before anything else looks at the file."""
    file = tmp_path / "run.nc"
    save(ball(), file)
    content = bytearray(file.read_bytes())
    places = np.random.default_rng(1).integers(0, len(content), 150).tolist()
    for place in [*range(8), *places, len(content) - 80, len(content) - 1]:
        content[place] ^= 0x10
        file.write_bytes(content)
        content[place] ^= 0x10
        refused(file, "damaged|changed")
    file.write_bytes(content)
    assert load(file).success


def test_a_sealed_file_of_something_else(tmp_path):
    file = tmp_path / "run.nc"
    xarray.Dataset({"x": ("t", np.arange(3.0))}).to_netcdf(file, engine="h5netcdf")
    results._seal(file)
    refused(file, "lacks")


def test_an_edited_file(tmp_path):
    save(ball(), tmp_path / "run.nc")
    with xarray.open_dataset(tmp_path / "run.nc") as opened:
        dataset = opened.load()
    dataset["x"][3] += 1e-12
    dataset.to_netcdf(tmp_path / "edited.nc", engine="h5netcdf")
    refused(tmp_path / "edited.nc", "truncated, changed")


def test_without_the_library(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, results.ENGINE, None)
    with pytest.raises(ImportError, match=r"pip install 'zivi\[files\]'"):
        save(ball(), tmp_path / "run.nc")
    with pytest.raises(ImportError, match=r"pip install 'zivi\[files\]'"):
        load(tmp_path / "run.nc")


def test_a_file_of_another_kind_is_refused_with_the_kinds_that_are_known():
    with pytest.raises(ValueError, match=r"results must end in one of .*\.nc.*\.csv"):
        check_suffix("results", Path("run.txt"))


def test_no_folder_is_made_unasked(tmp_path):
    run = zivi.simulate(zivi.ImpactSystem(-9.81, e=0.5), (0, 1), (1, 0))
    for name in ("x.nc", "x.csv"):
        with pytest.raises(
            FileNotFoundError, match=r"folder .*deep.* does not exist; create it first"
        ):
            save(run, tmp_path / "deep" / name)
    assert not list(tmp_path.iterdir())


def test_a_table_is_not_called_damaged(tmp_path):
    run = zivi.simulate(zivi.ImpactSystem(-9.81, e=0.5), (0, 1), (1, 0))
    save(run, tmp_path / "x.csv")
    with pytest.raises(ResultError, match=r"is a table, for reading elsewhere; save .* \.nc"):
        load(tmp_path / "x.csv")
