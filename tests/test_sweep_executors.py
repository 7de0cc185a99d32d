"""Studies on threads, processes and a cluster: the same stores, and workers that die."""

import concurrent.futures
import hashlib
import multiprocessing
import subprocess
import sys
import threading
from concurrent.futures.process import BrokenProcessPool
from pathlib import Path

import numpy as np
import pytest

import sweep_functions as functions
import zivi
from inside import study_drive, study_pools

pytestmark = pytest.mark.slow

pytest.importorskip("zarr", reason="the extra 'study' is not installed")
pytest.importorskip("pyarrow", reason="the extra 'study' is not installed")

MANY = {"x": np.arange(100.0), "y": np.linspace(0, 1, 100)}


def files(folder):
    """Every file of a store with a digest of its bytes."""
    return {
        str(file.relative_to(folder)): hashlib.sha256(file.read_bytes()).hexdigest()
        for file in Path(folder).rglob("*")
        if file.is_file()
    }


@pytest.fixture(scope="module")
def reference(tmp_path_factory):
    """The store of 10,000 points that this thread computes."""
    folder = tmp_path_factory.mktemp("reference") / "study.zarr"
    study = zivi.sweep(functions.cheap, MANY, seed=8, out=folder)
    assert len(study.status) == 10_000
    assert study.complete
    assert len(study.failed) == 5
    return files(folder)


@pytest.fixture(scope="module")
def client():
    distributed = pytest.importorskip("distributed", reason="the extra 'dask' is not installed")
    with (
        distributed.LocalCluster(
            n_workers=3, threads_per_worker=1, processes=True, dashboard_address=":0"
        ) as cluster,
        distributed.Client(cluster) as client,
    ):
        yield client


@pytest.mark.parametrize("kind", ["threads", "processes"])
def test_10000_points_give_the_same_store(kind, reference, tmp_path):
    zivi.sweep(functions.cheap, MANY, seed=8, out=tmp_path / "a", executor=kind, workers=2)
    assert files(tmp_path / "a") == reference


@pytest.mark.xdist_group("cluster")
@pytest.mark.parametrize("form", ["client", "executor"])
def test_10000_points_on_a_cluster_give_the_same_store(form, client, reference, tmp_path):
    executor = client if form == "client" else client.get_executor()
    zivi.sweep(functions.cheap, MANY, seed=8, out=tmp_path / "a", executor=executor)
    assert files(tmp_path / "a") == reference


class Backwards(concurrent.futures.Executor):
    """Computes what it was handed last first."""

    def __init__(self):
        self._todo = []

    def submit(self, function, *arguments):
        future = concurrent.futures.Future()
        self._todo.append((future, function, arguments))
        if len(self._todo) == 10:
            for waiting, work, given in reversed(self._todo):
                waiting.set_result(work(*given))
        return future


def test_chunks_of_failures_are_the_same_whenever_they_are_computed(tmp_path):
    """Also before any point has told what the points give."""

    def half(x):
        if x < 50:
            raise ValueError(x)
        return {"pair": [x, -x]}, {"t": [x]}

    stores = []
    for name, executor in (("a", None), ("b", Backwards())):
        out = tmp_path / name
        points = {"x": range(100)}
        study = zivi.sweep(half, points, out=out, chunk=10, executor=executor, in_flight=10)
        assert study.status.tolist() == [2] * 50 + [1] * 50
        stores.append(files(out))
    assert stores[0] == stores[1]
    kept = zivi.sweep(half, {"x": range(100)}, chunk=10)
    assert np.array_equal(kept.pair, study.pair, equal_nan=True)


def test_an_executor_of_the_user_is_left_open(tmp_path):
    with concurrent.futures.ThreadPoolExecutor(2) as executor:
        study = zivi.sweep(functions.product, MANY, executor=executor)
        assert executor.submit(int).result() == 0
    assert np.array_equal(study.value, np.outer(*MANY.values()))


class Counting(concurrent.futures.ThreadPoolExecutor):
    """Remembers how many tasks were in flight at most."""

    def __init__(self):
        super().__init__(2)
        self.running = self.most = self.tasks = 0

    def submit(self, *what):
        self.tasks += 1
        self.running += 1
        self.most = max(self.most, self.running)
        future = super().submit(*what)
        future.add_done_callback(self._end)
        return future

    def _end(self, _):
        self.running -= 1


@pytest.mark.parametrize(("wanted", "expected"), [(None, 4), (3, 3)])
def test_few_tasks_are_in_flight(wanted, expected):
    with Counting() as executor:
        zivi.sweep(functions.product, MANY, executor=executor, in_flight=wanted)
    assert 8 <= executor.tasks <= 100
    assert 2 <= executor.most <= expected


def test_a_chunk_of_slow_points_is_shared(monkeypatch):
    monkeypatch.setattr(study_pools, "SLICE", -1.0)

    with Counting() as executor:
        study = zivi.sweep(lambda x: x, {"x": range(40)}, executor=executor, chunk=40)
    assert executor.tasks > 5
    assert executor.most > 1
    assert study.value.values.tolist() == list(range(40))


@pytest.mark.parametrize("vectorized", [False, True])
@pytest.mark.parametrize(
    ("executor", "kind", "raised"),
    [
        (None, "Ctrl-C", KeyboardInterrupt),
        (None, "Stop", functions.Stop),
        ("threads", "Stop", functions.Stop),
        ("processes", "Stop", BaseException),
        pytest.param(
            "cluster", "Ctrl-C", KeyboardInterrupt, marks=pytest.mark.xdist_group("cluster")
        ),
    ],
)
def test_an_exception_that_is_no_error_ends_every_executor_alike(
    executor, kind, raised, vectorized, tmp_path, request
):
    """What the task computed before is kept, and nothing is computed again."""
    if executor == "cluster":
        executor = request.getfixturevalue("client")
    log = tmp_path / "log"
    with pytest.raises(raised) as stop:
        zivi.sweep(
            functions.stopping_many if vectorized else functions.stopping,
            {"x": range(100)},
            out=tmp_path / "a",
            vectorized=vectorized,
            chunk=10 if vectorized else 50,
            executor=executor,
            workers=1 if isinstance(executor, str) else None,
            in_flight=1,
            fixed={"kind": kind, "log": str(log)},
        )
    assert ("enough at 20" in str(stop.value)) == (kind == "Stop")
    assert stop.value.study.status.tolist() == [1] * 20 + [0] * 80
    assert stop.value.study.value[:20].values.tolist() == [2.0 * x for x in range(20)]
    assert len(functions.lines(log)) == (3 if vectorized else 21)


def test_threads_that_are_at_work_when_a_point_ends_the_study_keep_what_they_have():
    began, raised = threading.Event(), threading.Event()

    def first(x):
        if x == 0:
            assert began.wait(60)
            raised.set()
            raise KeyboardInterrupt
        began.set()
        assert raised.wait(60)
        return x

    with pytest.raises(KeyboardInterrupt) as stop:
        zivi.sweep(first, {"x": range(200)}, executor="threads", workers=2, chunk=100)
    assert stop.value.study.status[:100].tolist() == [0] * 100
    assert stop.value.study.status[100] == 1


def test_a_function_that_cannot_be_sent():
    with pytest.raises(TypeError, match="define the function at the top level of a module"):
        zivi.sweep(lambda x: x, {"x": [1]}, executor="processes", workers=1)


def test_a_worker_that_is_killed_loses_only_what_was_in_flight(tmp_path):
    log, mark = tmp_path / "log", tmp_path / "mark"
    study = zivi.sweep(
        functions.deadly_once,
        {"x": range(200)},
        out=tmp_path / "a",
        executor="processes",
        workers=2,
        chunk=5,
        in_flight=3,
        fixed={"mark": str(mark), "log": str(log)},
    )
    assert mark.exists()
    assert study.value.values.tolist() == list(range(200))
    calls = functions.lines(log)
    # three tasks of five points were in flight
    assert len(set(calls)) == 200
    assert len(calls) - 200 <= 15


@pytest.mark.parametrize(("chunk", "where"), [(1, 37), (50, 37), (50, 0), (1, 0)])
def test_a_point_that_kills_its_worker_fails_alone(chunk, where):
    study = zivi.sweep(
        functions.deadly,
        {"x": range(50)},
        executor="processes",
        workers=2,
        chunk=chunk,
        fixed={"where": where},
    )
    assert study.failed.to_dict("index") == {
        where: {"x": where, "message": "the worker died while it computed this point (2 times)"}
    }
    assert np.count_nonzero(study.status == 1) == 49


def test_points_that_all_kill_their_workers_are_an_error(monkeypatch):
    monkeypatch.setattr(study_drive, "BREAKS", 3)
    with pytest.raises(RuntimeError, match="workers died 4 times in a row") as e:
        zivi.sweep(functions.deadly, {"x": [37] * 64}, executor="processes", workers=2)
    assert e.value.study.status.max() == 2


def test_workers_that_never_live_are_an_error(tmp_path):
    program = tmp_path / "unguarded.py"
    program.write_text(
        "import zivi\n"
        "def f(x):\n"
        "    return x\n"
        "print(zivi.sweep(f, {'x': [1.0, 2.0]}, executor='processes', workers=1))\n"
    )
    done = subprocess.run(
        [sys.executable, program], capture_output=True, text=True, timeout=60, check=False
    )
    assert done.returncode == 1
    assert "is the script guarded by if __name__ == '__main__'" in done.stderr


def test_an_executor_of_the_user_that_breaks(tmp_path):
    call = {"function": functions.deadly, "out": tmp_path / "a", "chunk": 1}
    points = zivi.points(x=range(40))
    # not by fork: other tests of this process load packages with threads, which warn
    spawn = multiprocessing.get_context("spawn")
    with (
        concurrent.futures.ProcessPoolExecutor(1, spawn) as executor,
        pytest.raises(
            concurrent.futures.BrokenExecutor, match="make the same call with a new executor"
        ) as e,
    ):
        zivi.sweep(**call, points=points, executor=executor)
    assert not isinstance(e.value, BrokenProcessPool)
    status = e.value.study.status
    assert status[:35].all()
    assert status[37] == 0
    assert "in this exception's attribute 'study' and in" in e.value.__notes__[0]


@pytest.mark.xdist_group("cluster")
def test_a_dask_worker_that_is_killed(client, tmp_path):
    log, mark = tmp_path / "log", tmp_path / "mark"
    study = zivi.sweep(
        functions.deadly_once,
        {"x": range(200)},
        out=tmp_path / "a",
        executor=client,
        chunk=5,
        fixed={"mark": str(mark), "log": str(log)},
    )
    assert mark.exists()
    assert study.value.values.tolist() == list(range(200))
    calls = functions.lines(log)
    assert len(set(calls)) == 200
    # six tasks of five points were in flight
    assert len(calls) - 200 <= 30


@pytest.mark.xdist_group("cluster")
def test_a_point_that_kills_dask_workers_fails_alone(client):
    # so that Dask gives up at once
    client.run_on_scheduler(lambda dask_scheduler: setattr(dask_scheduler, "allowed_failures", 0))
    study = zivi.sweep(
        functions.deadly, {"x": range(8)}, executor=client, chunk=2, fixed={"where": 5}
    )
    assert study.failed.index.tolist() == [5]
    assert np.count_nonzero(study.status == 1) == 7
