"""Folders of studies whose files are shards: few, read in part, saved as the run goes on."""

import concurrent.futures
import contextlib
import dataclasses
import errno
import os
import random
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

import sweep_functions as functions
import zivi
from inside import Chunks, FolderStore, study_drive, study_head, study_store
from interrupting import calls_in, wait_for
from test_sweep_executors import files

zarr = pytest.importorskip("zarr", reason="the extra 'study' is not installed")
pytest.importorskip("pyarrow", reason="the extra 'study' is not installed")

GRID = {"x": np.arange(5.0, 9.0), "y": np.linspace(0, 1, 111)}


def in_small_shards(monkeypatch):
    """Shards of 128 points, which are decoded in parts of 32."""
    monkeypatch.setattr(study_store, "SHARD", 128)
    monkeypatch.setattr(study_store, "INNER", 4)
    monkeypatch.setattr(study_head, "SHARD", 128)
    monkeypatch.setattr(study_store, "ROOM", 128 * 128)


@pytest.fixture
def small(monkeypatch):
    in_small_shards(monkeypatch)


MANY = {"function": functions.cheap_many, "points": GRID, "vectorized": True, "seed": 1}


@pytest.fixture(scope="module")
def complete(tmp_path_factory):
    """A folder in which nothing is missing."""
    out = tmp_path_factory.mktemp("complete") / "a"
    with pytest.MonkeyPatch.context() as patched:
        in_small_shards(patched)
        zivi.sweep(**MANY, out=out)
    return out


def tree(folder):
    return [file for file in Path(folder).rglob("*") if file.is_file()]


class Jumbled(concurrent.futures.ThreadPoolExecutor):
    """Computes tasks in an order of its own."""

    def submit(self, function, *given):
        def late():
            time.sleep(random.uniform(0, 5e-3))
            return function(*given)

        return super().submit(late)


# how many, how large


@pytest.mark.parametrize(
    "shape",
    [
        (1,),
        (7,),
        (16, 5),
        (5, 100),
        (3, 2, 7),
        (40, 40),
        (2, 1, 300),
        (129,),
        (17, 3, 5, 2),
        (2000,),
    ],
)
@pytest.mark.parametrize("size", [0, 300, 3000, 10**6])
def test_shards_are_runs_of_points_and_have_whole_parts(shape, size, small):
    layout = Chunks(shape, sharded=True, size=size)
    numbers, seen = np.arange(np.prod(shape)).reshape(shape), []
    pairs = list(zip(layout.chunk, layout.inner, strict=True))
    assert all(own % part == 0 for own, part in pairs)
    for chunk in range(len(layout)):
        span = layout.span(chunk)
        assert numbers[layout.slices(chunk)].ravel().tolist() == list(span)
        assert set(layout.chunk_of(np.arange(span.start, span.stop)).tolist()) == {chunk}
        assert len(span) * max(size, 128) <= max(128 * 128, size)
        seen += span
    assert sorted(seen) == numbers.ravel().tolist()


@pytest.mark.parametrize(
    ("shape", "size", "shards"),
    [
        ((10**6,), 112, 1),
        ((1000, 1000), 112, 1),
        ((10**6,), 368, 2),
        ((10**8,), 112, 48),
        ((10**9,), 112, 477),
        ((1000, 1000, 1000), 112, 500),
    ],
)
def test_numbers_of_shards(shape, size, shards):
    layout = Chunks(shape, sharded=True, size=size)
    assert len(layout) == shards
    assert layout.room * size <= 2**28


@pytest.mark.slow
@pytest.mark.xdist_group("clock")
def test_a_million_points_are_few_files_that_open_at_once(tmp_path):
    names = [f"r{k}" for k in range(14)]

    def many(e, h):
        return {name: e + k * h for k, name in enumerate(names)}

    points = {"e": np.linspace(0, 1, 1000), "h": np.linspace(0, 1, 1000)}
    zivi.sweep(many, points, vectorized=True, out=tmp_path / "a")
    assert len(tree(tmp_path / "a")) < 100
    assert calls_in(lambda: zivi.open_study(tmp_path / "a")) < 50_000
    study = zivi.open_study(tmp_path / "a")
    assert float(study.r13[999, 500]) == points["e"][999] + 13 * points["h"][500]
    assert study.complete
    array = zarr.open_array(tmp_path / "a" / "r0", mode="r")
    assert array.shards == (1048, 1000)
    assert array.chunks == (131, 1000)


# the same bytes


@pytest.fixture(scope="module")
def client():
    distributed = pytest.importorskip("distributed", reason="the extra 'dask' is not installed")
    with (
        distributed.LocalCluster(
            n_workers=2, threads_per_worker=1, processes=True, dashboard_address=":0"
        ) as cluster,
        distributed.Client(cluster) as client,
    ):
        yield client


@pytest.mark.slow
def test_who_computes_does_not_change_a_byte(client, small, tmp_path):
    def run(name, **how):
        out = tmp_path / name
        zivi.sweep(functions.cheap_many, GRID, vectorized=True, seed=8, out=out, **how)
        return files(out)

    expected = run("inline")
    assert len([file for file in expected if file.startswith("area/c")]) == 16
    assert run("threads", executor="threads", workers=3) == expected
    assert run("processes", executor="processes", workers=2) == expected
    assert run("dask", executor=client) == expected


def halves(x, y):
    """Fail, until the results turn out to be large; then give some that are."""
    if x < 7:
        raise ValueError(f"{x:g}, {y:g}")
    return {"large": np.full(40, x * y)}, {"t": [y]}


def test_chunks_are_cut_anew_when_it_shows_how_large_the_results_are(small, tmp_path):
    expected = None
    for name, how in {"a": {}, "b": {"executor": Jumbled(8), "in_flight": 16}}.items():
        study = zivi.sweep(halves, GRID, out=tmp_path / name, **how)
        assert np.count_nonzero(study.status == 2) == 2 * 111
        assert np.array_equal(study.large[2:, :, 39], np.outer(GRID["x"][2:], GRID["y"]))
        assert study.failed.message[3] == f"ValueError: 5, {GRID['y'][3]:g}"
        assert len(study.events) == 2 * 111
        own = files(tmp_path / name)
        expected = expected or own
        assert own == expected
    with np.errstate(all="raise"):
        zivi.open_study(tmp_path / "a", verify=True)
    # 40 numbers and the events: 576 bytes, 16 points of at most 128 * 128
    assert zarr.open_array(tmp_path / "a" / "status", mode="r").shards == (1, 16)


def test_chunks_are_cut_anew_when_a_run_goes_on_with_what_only_failed(small, tmp_path):
    mark = tmp_path / "mark"

    def later(x):
        if not mark.exists():
            raise ValueError("not yet")
        return np.full(40, x)

    call = {"function": later, "points": {"x": range(300)}, "out": tmp_path / "a"}
    with pytest.raises(RuntimeError, match="all 300 points failed"):
        zivi.sweep(**call)
    mark.touch()
    study = zivi.sweep(**call, retry_failed=True)
    assert np.array_equal(study.value[:, 0], np.arange(300))
    zivi.sweep(**call | {"out": tmp_path / "b"})
    whole, found = files(tmp_path / "b"), files(tmp_path / "a")
    assert {it: own for it, own in found.items() if not it.startswith("message/c")} == whole


# stopped anywhere


@pytest.mark.slow
@pytest.mark.parametrize("dead", [False, True])
@pytest.mark.parametrize("function", [functions.cheap_many, halves])
def test_a_run_whose_write_fails_goes_on(function, dead, small, tmp_path, monkeypatch):
    """A full disk at one write; with `dead`, nothing is written afterwards, as of a killed run."""
    call = {
        "function": function,
        "points": {"x": [5.0, 7.0], "y": np.linspace(0, 1, 20)},
        "seed": 1,
        "vectorized": function is not halves,
    }
    monkeypatch.setattr(study_drive, "LONG", 0.0)  # save whatever there is at once
    monkeypatch.setattr(study_drive, "SAVING", 0.0)
    monkeypatch.setattr(study_drive, "FIRST", 15)
    monkeypatch.setattr(study_drive, "SHARES", 2)
    zivi.sweep(out=tmp_path / "whole", **call)
    expected, out = files(tmp_path / "whole"), tmp_path / "a"
    replace, left = os.replace, [0]

    def full(source, target):
        left[0] -= 1
        if left[0] < 0 if dead else left[0] == -1:
            raise OSError(errno.ENOSPC, "No space left on device")
        replace(source, target)

    for number in (9, 25, 42) if dead else (9, 30):
        left[0] = number
        with monkeypatch.context() as patched, contextlib.suppress(OSError):
            patched.setattr(os, "replace", full)
            zivi.sweep(out=out, **call)
        assert left[0] < 0
        assert not list(tmp_path.glob(".*"))
        if out.exists():
            assert not list(tmp_path.rglob("*.partial"))
            zivi.sweep(out=out, **call)
            assert files(out) == expected
            shutil.rmtree(out)


KILLED = """
import sys
sys.path.insert(0, {tests!r})
import zivi, sweep_functions as functions
if __name__ == "__main__":
    zivi.sweep(functions.many_noted, {{"x": range(4000)}}, vectorized=True, out={out!r},
               executor={executor!r}, workers={workers}, fixed={{"log": {log!r}, "pause": 1e-3}})
"""


@pytest.mark.slow
@pytest.mark.skipif(os.name != "posix", reason="sends SIGKILL")
@pytest.mark.parametrize("executor", [None, "processes"])
def test_a_run_that_is_killed_keeps_what_it_saved_as_it_went(executor, tmp_path):
    out, log = tmp_path / "a", tmp_path / "log"
    program = KILLED.format(
        tests=str(Path(__file__).parent),
        out=str(out),
        log=str(log),
        executor=executor,
        workers=None if executor is None else 2,
    )
    with subprocess.Popen([sys.executable, "-c", program], start_new_session=True) as process:
        wait_for(lambda: sum(map(int, functions.lines(log))) >= 3000)
        process.kill()
    assert process.returncode == -signal.SIGKILL
    found = zivi.open_study(out, verify=True)
    done = int(np.count_nonzero(found.status == 1))
    # all but the tasks of the last second or two
    assert 1000 < done < 4000
    assert np.array_equal(found.value[found.status == 1], 2.0 * found.x[found.status == 1])
    call = {"points": {"x": range(4000)}, "vectorized": True}
    before = sum(map(int, functions.lines(log)))
    study = zivi.sweep(
        functions.many_noted, out=out, **call, fixed={"log": str(log), "pause": 1e-3},
        executor="threads", workers=8,
    )  # fmt: skip
    assert np.array_equal(study.value, 2.0 * np.arange(4000))
    after = sum(map(int, functions.lines(log)))
    assert after - before <= 4000 - done + (1000 if executor else 0)
    zivi.sweep(
        functions.many_noted, out=tmp_path / "b", **call, fixed={"log": str(log), "pause": 1e-3},
        executor="threads", workers=8,
    )  # fmt: skip
    assert files(out) == files(tmp_path / "b")


# damage


def cut(file):
    data = file.read_bytes()
    file.write_bytes(data[: len(data) // 2])


def flip(file):
    data = bytearray(file.read_bytes())
    data[len(data) // 2] ^= 0xFF
    file.write_bytes(data)


@pytest.mark.parametrize("harm", [cut, flip, Path.unlink, lambda file: file.write_bytes(b"")])
@pytest.mark.parametrize("name", ["area/c/2/1", "pair/c/2/1/0", "status/c/2/1"])
def test_a_damaged_shard_is_told_and_computed_again(harm, name, small, complete, tmp_path):
    out = shutil.copytree(complete, tmp_path / "a")
    whole = zivi.open_study(out).dataset.load()
    expected = files(out)
    assert zarr.open_array(out / "area", mode="r").shards == (1, 32)
    harm(out / name)
    if harm is Path.unlink and name.startswith("status"):
        study = zivi.open_study(out, verify=True)
    else:
        with pytest.warns(UserWarning, match=f"is damaged: .*{name}"):
            study = zivi.open_study(out, verify=True)
    lost = range(2 * 111 + 32, 2 * 111 + 64)
    assert np.flatnonzero(study.status == 0).tolist() == list(lost)
    good = {"y": np.r_[0:32, 64:111]}
    xr.testing.assert_equal(study.dataset.isel(good), whole.isel(good))
    again = zivi.sweep(**MANY, out=out)
    xr.testing.assert_identical(again.dataset.load(), whole)
    assert files(out) == expected


def test_parameters_of_many_points_are_sharded_and_mended(small, tmp_path):
    points = zivi.points(x=np.arange(1000.0), y=np.linspace(0, 1, 1000))
    call = {"function": functions.product, "points": points, "vectorized": True}
    out = tmp_path / "a"
    whole = zivi.sweep(**call, out=out).dataset.load()
    expected = files(out)
    assert len(list((out / "x" / "c").iterdir())) == 8
    flip(out / "x" / "c" / "3")
    with pytest.warns(UserWarning, match="x/c is damaged"):
        assert np.isnan(zivi.open_study(out).x).all()
    (out / "y" / "c" / "7").unlink()
    with pytest.warns(UserWarning, match="y/c/7 is missing"):
        zivi.open_study(out)
    xr.testing.assert_identical(zivi.sweep(**call, out=out).dataset.load(), whole)
    assert files(out) == expected


# memory, and older folders


def test_the_coordinator_holds_few_chunks_at_a_time(small, monkeypatch):
    """Also if the tasks come back in another order, from many workers."""
    most = [0]
    load = FolderStore.load
    from inside import OPEN, Driver

    put = Driver._put

    def counting(self, chunk, piece):
        put(self, chunk, piece)
        most[0] = max(most[0], len(self._blocks))

    monkeypatch.setattr(Driver, "_put", counting)
    zivi.sweep(
        functions.product, {"x": range(100), "y": range(100)}, vectorized=True,
        executor=Jumbled(8), in_flight=16,
    )  # fmt: skip
    assert load is FolderStore.load
    assert 1 < most[0] <= OPEN + 1


def test_folders_without_shards_go_on_as_they_are(tmp_path, monkeypatch):
    from inside import study_run as run

    identity = run.identity

    def older(*given, **named):
        told = identity(*given, **named)
        return {key: it for key, it in told.items() if key not in ("shards", "vectorized")}

    stop = []

    def stopping(x):
        if x == 900 and not stop:
            stop.append(1)
            raise KeyboardInterrupt
        return 2.0 * x

    call = {"function": stopping, "points": {"x": range(1280)}, "out": tmp_path / "a"}
    monkeypatch.setattr(run, "identity", older)
    with pytest.raises(KeyboardInterrupt):
        zivi.sweep(**call)
    monkeypatch.undo()
    before = zivi.open_study(tmp_path / "a")
    assert np.count_nonzero(before.status) == 900
    assert np.array_equal(zivi.sweep(**call).value, 2.0 * np.arange(1280))
    # a 64th of the points in each file, none of which is a shard
    assert sorted(int(it.name) for it in (tmp_path / "a" / "value" / "c").iterdir()) == [*range(64)]
    assert zarr.open_array(tmp_path / "a" / "value", mode="r").shards is None
    assert (
        not zivi.open_study(tmp_path / "a", verify=True).dataset.attrs["config"].count('"shards"')
    )


def test_a_layout_is_a_value():
    layout = Chunks((10,), sharded=True)
    assert dataclasses.replace(layout, size=1) != layout == Chunks((10,), sharded=True)
