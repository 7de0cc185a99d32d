"""Studies that are stopped, killed, damaged or mistaken for others, and go on."""

import concurrent.futures
import importlib
import json
import os
import shutil
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np
import psutil
import pytest
import xarray as xr

import sweep_functions as functions
import zivi
from inside import Driver, FolderStore, Pool, compute_points as compute, study_pools as pools
from interrupting import HANGS, collector_off, wait_for
from test_sweep_executors import files

pytestmark = pytest.mark.slow

pytest.importorskip("zarr", reason="the extra 'study' is not installed")
pytest.importorskip("pyarrow", reason="the extra 'study' is not installed")

POINTS = {"x": np.arange(8.0), "y": np.linspace(0, 1, 16)}

KILLED = """
import sys
sys.path.insert(0, {tests!r})
import zivi, sweep_functions as functions
if __name__ == "__main__":
    zivi.sweep(functions.noted, {{"x": range(400)}}, out={out!r}, executor={executor!r},
               workers={workers}, chunk=8, fixed={{"log": {log!r}, "pause": 0.005}})
"""


def start(out, log, executor):
    workers = None if executor is None else 2
    tests = str(Path(__file__).parent)
    program = KILLED.format(
        tests=tests, out=str(out), log=str(log), executor=executor, workers=workers
    )
    return subprocess.Popen([sys.executable, "-c", program], start_new_session=True)


@pytest.mark.skipif(os.name != "posix", reason="sends SIGKILL")
@pytest.mark.parametrize("executor", [None, "processes"])
def test_a_run_that_is_killed_goes_on(executor, tmp_path):
    out, log, hold = tmp_path / "a.zarr", tmp_path / "log", tmp_path / "log.hold"
    hold.touch()
    with start(out, log, executor) as process:
        try:
            wait_for(lambda: len(functions.lines(log)) > 120)
            workers = psutil.Process(process.pid).children(recursive=True)
        finally:
            process.kill()
    assert process.returncode == -signal.SIGKILL
    _, alive = psutil.wait_procs(workers, HANGS)
    assert not alive  # they notice that their parent is gone
    hold.unlink()
    before = functions.lines(log)
    found = zivi.open_study(out)
    done = np.count_nonzero(found.status == 1)
    assert 0 < done <= len(before) < 400
    assert np.array_equal(found.value[found.status == 1], 2.0 * found.x[found.status == 1])
    # the same call, on another executor
    call = {"points": {"x": range(400)}, "fixed": {"log": str(log), "pause": 0.005}}
    study = zivi.sweep(functions.noted, out=out, **call, executor="threads", workers=16)
    assert study.value.values.tolist() == [2.0 * x for x in range(400)]
    after = functions.lines(log)
    assert len(after) == len(before) + 400 - done
    assert len(set(after)) == 400
    # one task of eight points was in flight, or four
    assert len(after) - 400 <= 8 * (1 if executor is None else 4)
    if not executor:
        whole = tmp_path / "b.zarr"
        zivi.sweep(functions.noted, out=whole, **call, chunk=8, executor="threads", workers=16)
        assert files(out) == files(whole)


PRESSED = []


def slow(x):
    """Press Ctrl-C at point 20, once."""
    if x == 20 and not PRESSED:
        PRESSED.append(threading.Timer(0.1, os.kill, (os.getpid(), signal.SIGINT)))
        PRESSED[0].start()
        time.sleep(0.3)
    return x


@pytest.mark.parametrize("executor", [None, "threads"])
def test_ctrl_c_keeps_what_is_done(executor, tmp_path):
    PRESSED.clear()
    call = {"function": slow, "points": {"x": range(100)}, "out": tmp_path / "a", "chunk": 50}
    with collector_off(), pytest.raises(KeyboardInterrupt) as stop:
        zivi.sweep(**call, executor=executor, workers=2 if executor else None)
    study = stop.value.study
    assert study.status[:20].all()
    if executor is None:
        assert study.status.tolist() == [1] * 20 + [0] * 80
    assert "this exception's attribute 'study' and in" in stop.value.__notes__[-1]
    assert np.array_equal(study.value[:20], np.arange(20.0))
    PRESSED[0].join()
    assert zivi.sweep(**call).value.values.tolist() == list(range(100))


@pytest.mark.parametrize("place", ["submit", "_collect", "_take", "_learn", "_put", "_save"])
@pytest.mark.parametrize("executor", [None, "threads"])
def test_ctrl_c_loses_nothing_that_was_computed(executor, place, monkeypatch, tmp_path):
    """It comes once where results are on their way, the second time each of these is passed."""
    calls, asked = [], []
    pool = pools.Inline if executor is None else concurrent.futures.ThreadPoolExecutor
    owner = pool if place == "submit" else Driver
    work = getattr(owner, place)

    def pressed(self, *arguments, **named):
        found = work(self, *arguments, **named)
        if place == "submit":
            if arguments[0] is not compute:
                return found  # zarr has an executor, too
            concurrent.futures.wait([found])  # it is computed
        asked.append(place)
        if len(asked) == 2:
            signal.raise_signal(signal.SIGINT)
        return found

    def point(x):
        calls.append(x)
        return x

    monkeypatch.setattr(owner, place, pressed)
    before = signal.getsignal(signal.SIGINT)
    how = {"points": {"x": range(200)}, "out": tmp_path / "a", "chunk": 20}
    workers = None if executor is None else 1
    with collector_off(), pytest.raises(KeyboardInterrupt) as stop:
        zivi.sweep(point, **how, executor=executor, workers=workers)
    assert signal.getsignal(signal.SIGINT) is before
    done = np.flatnonzero(stop.value.study.status)
    assert 0 < len(done) < 200
    assert done.tolist() == sorted(calls)


def test_ctrl_c_stops_threads_after_the_points_that_they_are_at(monkeypatch):
    later, told, stop_pool = [], threading.Event(), Pool.stop
    monkeypatch.setattr(Pool, "stop", lambda self: (stop_pool(self), told.set()))

    def slow(x):
        if x == 20:
            time.sleep(0.3)
            os.kill(os.getpid(), signal.SIGINT)
        if x >= 20:
            later.append(x)
            assert told.wait(HANGS)
        return x

    # two tasks of 100 points, which are looked at anew every two seconds
    with collector_off(), pytest.raises(KeyboardInterrupt) as stop:
        zivi.sweep(slow, {"x": range(200)}, executor="threads", workers=2, chunk=100)
    assert stop.value.study.status[:20].all()
    assert len(later) <= 2


def test_an_error_of_the_store_keeps_what_is_done(tmp_path, monkeypatch):
    save = FolderStore.save

    def full(self, chunk, block):
        if chunk == 3:
            raise OSError(28, "No space left on device")
        save(self, chunk, block)

    monkeypatch.setattr(FolderStore, "save", full)
    with pytest.raises(OSError, match="No space left") as error:
        zivi.sweep(functions.product, POINTS, out=tmp_path / "a", chunk=16)
    assert np.count_nonzero(error.value.study.status) == 48
    monkeypatch.undo()
    assert zivi.sweep(functions.product, POINTS, out=tmp_path / "a").complete


# the same study or another


def test_nothing_is_computed_twice(tmp_path):
    call = {"points": {"x": range(20)}, "fixed": {"log": str(tmp_path / "log")}}
    for _ in range(3):
        zivi.sweep(functions.noted, out=tmp_path / "a", **call)
    assert len(functions.lines(tmp_path / "log")) == 20


@pytest.mark.parametrize(
    ("change", "difference"),
    [
        ({"function": functions.noted}, "the function: 'sweep_functions.product' there"),
        ({"points": {"x": np.arange(7.0), "y": POINTS["y"]}}, r"the number of points: \[8, 16\]"),
        ({"points": {"x": np.arange(8.0) + 1, "y": POINTS["y"]}}, "the values of the parameters"),
        (
            {"points": zivi.points(x=[1.0], y=[1.0])},
            "the kind of design: 'grid' there, 'list' here",
        ),
        ({"points": {"y": POINTS["y"], "x": POINTS["x"]}}, r"the parameters: \['x', 'y'\] there"),
        ({"seed": 2}, "the seed: 1 there, 2 here"),
        ({"chunk": 3}, "the points of a chunk: None there, 3 here"),
    ],
)
def test_another_study_in_the_same_folder_is_refused(change, difference, tmp_path):
    call = {"function": functions.product, "points": POINTS, "seed": 1, "out": tmp_path / "a"}
    zivi.sweep(**call)
    before = files(tmp_path / "a")
    changed = call | change
    if changed["function"] is functions.noted:
        changed |= {"points": {"x": [1.0]}, "fixed": {"log": str(tmp_path / "log")}}
    for resume in (None, True):
        with pytest.raises(ValueError, match=difference):
            zivi.sweep(**changed, resume=resume)
    assert files(tmp_path / "a") == before


def test_other_fixed_arguments_are_another_study(tmp_path):
    call = {"function": functions.product, "points": {"x": [1.0]}, "out": tmp_path / "a"}
    zivi.sweep(**call, fixed={"y": np.nan})
    zivi.sweep(**call, fixed={"y": np.nan})
    with pytest.raises(ValueError, match=r"the fixed arguments: {'y': nan} there, {'y': 2.0} here"):
        zivi.sweep(**call, fixed={"y": 2.0})


def test_a_function_that_was_edited(tmp_path, monkeypatch):
    (tmp_path / "edited.py").write_text("def f(x):\n    return x\n")
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr(sys, "dont_write_bytecode", True)
    edited = importlib.import_module("edited")
    zivi.sweep(edited.f, {"x": [1.0]}, out=tmp_path / "a")
    (tmp_path / "edited.py").write_text("def f(x):\n    return x + 1\n")
    edited = importlib.reload(edited)
    with pytest.raises(ValueError, match=r"the text of the function: .*; resume=True goes on"):
        zivi.sweep(edited.f, {"x": [1.0]}, out=tmp_path / "a")
    assert zivi.sweep(edited.f, {"x": [1.0]}, out=tmp_path / "a", resume=True).value == 1.0


def test_resume_says_what_must_be_there(tmp_path):
    call = {"function": functions.product, "points": POINTS, "out": tmp_path / "a"}
    with pytest.raises(FileNotFoundError, match=r"resume=True, but .* does not contain a study"):
        zivi.sweep(**call, resume=True)
    zivi.sweep(**call, resume=False)
    with pytest.raises(FileExistsError, match="resume is False"):
        zivi.sweep(**call, resume=False)


def test_two_runs_do_not_write_to_one_folder(tmp_path):
    zivi.sweep(functions.product, POINTS, out=tmp_path / "a")
    store = FolderStore(tmp_path / "a", write=True)
    with pytest.raises(RuntimeError, match="another run writes to"):
        zivi.sweep(functions.product, POINTS, out=tmp_path / "a")
    store.close()
    zivi.sweep(functions.product, POINTS, out=tmp_path / "a")


def test_the_drawn_seed_is_that_of_the_store(tmp_path):
    first = zivi.sweep(functions.both_seeds, {"x": range(3)}, out=tmp_path / "a")
    again = zivi.sweep(functions.both_seeds, {"x": range(3)}, out=tmp_path / "a")
    assert first.attrs["seed"] == again.attrs["seed"]


# damage


@pytest.fixture(scope="module")
def complete(tmp_path_factory):
    """A folder in which nothing is missing."""
    out = tmp_path_factory.mktemp("complete") / "a"
    zivi.sweep(functions.cheap, POINTS, seed=1, out=out, chunk=16)
    return out


@pytest.fixture
def store(complete, tmp_path):
    """A copy to be damaged."""
    return Path(shutil.copytree(complete, tmp_path / "a"))


def cut(file):
    data = file.read_bytes()
    file.write_bytes(data[: len(data) // 2])


def flip(file):
    data = bytearray(file.read_bytes())
    data[len(data) // 2] ^= 0xFF
    file.write_bytes(data)


@pytest.mark.parametrize("harm", [cut, flip, Path.unlink, lambda file: file.write_bytes(b"")])
@pytest.mark.parametrize(
    "name",
    ["area/c/5/0", "pair/c/5/0/0", "n_events/c/5/0", "status/c/5/0", "events/00000005.parquet"],
)
def test_what_can_be_read_of_a_damaged_store_is_read_and_the_rest_computed(harm, name, store):
    expected, whole = files(store), zivi.open_study(store)
    whole.dataset.load()
    harm(store / name)
    vanished = harm is Path.unlink and name.startswith("status")
    if vanished:  # as if it had not been computed
        study = zivi.open_study(store, verify=True)
    else:
        with pytest.warns(UserWarning, match=f"is damaged: .*{name}"):
            study = zivi.open_study(store, verify=True)
    assert study.status.tolist() == [0 if point // 16 == 5 else 1 for point in range(128)] or (
        study.failed.equals(whole.failed)
    )
    good = study.dataset.drop_sel(x=5.0)
    xr.testing.assert_equal(good, whole.dataset.drop_sel(x=5.0))
    again = zivi.sweep(functions.cheap, POINTS, seed=1, out=store, chunk=16)
    xr.testing.assert_identical(again.dataset.load(), whole.dataset)
    assert files(store) == expected


def test_a_missing_file_is_noticed_without_reading_all(store):
    (store / "area/c/2/0").unlink()
    with pytest.warns(UserWarning, match="area/c/2/0 is missing"):
        study = zivi.open_study(store)
    assert np.count_nonzero(study.status == 0) == 16
    assert not study.complete
    assert "111 of 128 points completed, 1 failed, 16 missing" in repr(study)


def test_a_damaged_file_is_an_error_when_it_is_read(store):
    flip(store / "area/c/2/0")
    study = zivi.open_study(store)
    assert float(study.area[0, 0]) == 0.0
    with pytest.raises(Exception, match="checksum"):
        study.area.load()


def test_a_damaged_file_of_events_is_left_out_with_a_warning(store):
    cut(store / "events/00000002.parquet")
    study = zivi.open_study(store)
    with pytest.warns(UserWarning, match="00000002.parquet is damaged"):
        table = study.events
    assert set(table["point"].to_numpy() // 16) == {1, 4, 5, 7}


def test_a_store_whose_head_is_damaged(store):
    cut(store / "zarr.json")
    with pytest.raises(OSError, match=r"zarr\.json is damaged"):
        zivi.open_study(store)
    with pytest.raises(OSError, match=r"zarr\.json is damaged"):
        zivi.sweep(functions.cheap, POINTS, seed=1, out=store)


def test_things_that_are_no_study(tmp_path):
    with pytest.raises(FileNotFoundError, match="expected the folder of a study"):
        zivi.open_study(tmp_path / "nothing")
    with pytest.raises(ValueError, match=r"is not a study: zarr\.json is missing"):
        zivi.open_study(tmp_path)
    xr.Dataset({"a": ("x", [1.0])}).to_zarr(tmp_path / "b", zarr_format=3, consolidated=False)
    with pytest.raises(ValueError, match="a Zarr group, but not a study"):
        zivi.open_study(tmp_path / "b")
    (tmp_path / "c").mkdir()
    (tmp_path / "c" / "mine.txt").touch()
    with pytest.raises(ValueError, match="is not a study"):
        zivi.sweep(functions.product, POINTS, out=tmp_path / "c")
    (tmp_path / "d").mkdir()
    assert zivi.sweep(functions.product, POINTS, out=tmp_path / "d").complete


def test_the_head_tells_the_study(store):
    attrs = json.loads((store / "zarr.json").read_text())["attributes"]
    config = json.loads(attrs["config"])
    assert config["function"] == "sweep_functions.cheap"
    assert config["seed"] == attrs["seed"] == 1
    assert config["zivi"] == zivi.__version__


@pytest.mark.parametrize("name", ["area", "area/c", "events", "status/zarr.json", "pair/c/5"])
def test_a_link_within_a_study_is_refused(name, store, tmp_path):
    """What is behind it is not the study's: nothing of it is changed."""
    behind = tmp_path / "behind"
    (store / name).rename(behind)
    (store / name).symlink_to(behind)
    if (store / "area/c/5").exists():
        shutil.rmtree(store / "area/c/5")  # so that something is written
    before = files(behind) if behind.is_dir() else behind.read_bytes()
    with pytest.raises(OSError, match=f"{name} is a symbolic link"):
        zivi.sweep(functions.cheap, POINTS, seed=1, out=store, chunk=16)
    if name != "pair/c/5":
        with pytest.raises(OSError, match=f"{name} is a symbolic link"):
            zivi.open_study(store)
    assert before == (files(behind) if behind.is_dir() else behind.read_bytes())
    linked = tmp_path / "linked"
    linked.symlink_to(store)  # the folder itself may be one
    (store / name).unlink()
    behind.rename(store / name)
    assert zivi.sweep(functions.cheap, POINTS, seed=1, out=linked, chunk=16).status.all()
