"""Studies in detail: what names and digests are made of, and what becomes of broken workers."""

import concurrent.futures
import errno
import json
import sys
import threading
from collections import deque
from types import SimpleNamespace

import numpy as np
import pytest

import zivi
from inside import (
    SignalGate,
    study_digest as digest,
    study_drive as drive,
    study_folder as folder,
    study_head as head,
    study_result as result,
)


class Scaled:
    """A callable object without a name of its own."""

    def __init__(self, by):
        self.by, self.calls = by, 0

    def __call__(self, x):
        self.calls += 1
        return self.by * x


class Shifted:
    def __call__(self, x):
        return x + 1.0


def test_callable_objects_are_named_and_told_by_their_class():
    assert digest.function_name(Scaled(2.0)) == f"{__name__}.Scaled"
    assert digest.source_digest(Scaled(2.0)) == digest.source_digest(Scaled) is not None
    assert digest.source_digest(Scaled(2.0)) != digest.source_digest(Shifted())
    # what the call itself writes is no setting
    assert digest.kept_attributes(Scaled(2.0)) == {"calls"}
    assert digest.kept_attributes(Shifted()) == set()


def test_what_is_not_imported_has_its_files_all_the_same():
    assert digest._files("no_such_package_anywhere") == []
    assert "this" not in sys.modules
    assert [file.endswith("this.py") for file in digest._files("this")] == [True]


def test_what_cannot_be_told_again_is_named():
    with pytest.raises(TypeError, match="lock"):
        digest.plain("fixed", {"a": threading.Lock()}, faithful=True)
    nested = []
    for _ in range(100_000):
        nested = [nested]
    with pytest.raises(TypeError, match="nested too deeply"):
        digest.plain("fixed", nested, faithful=True)
    with pytest.raises(TypeError) as told:
        digest.plain("fixed", {"a": threading.Lock()}, faithful=True)
    assert "nested" not in str(told.value)


def test_tables_are_told_by_what_they_hold():
    xarray = pytest.importorskip("xarray")

    def token(values, **attrs):
        table = xarray.Dataset({"a": (("x", "y"), values)}, {"x": [1, 2, 3]}, attrs)
        return digest._Content().token({"table": table})

    values = np.arange(6.0).reshape(3, 2)
    assert token(values) == token(np.asfortranarray(values))
    assert token(values) != token(values + 1.0)
    assert token(values) != token(values, note="x")


def test_an_empty_file_is_not_there_and_one_of_a_byte_is(tmp_path):
    file = tmp_path / "chunk"
    assert not folder._is_there(file)
    file.write_bytes(b"")
    assert not folder._is_there(file)
    file.write_bytes(b"x")
    assert folder._is_there(file)


def test_readers_may_leave_the_consolidated_metadata_out():
    told = head._consolidated({"attributes": {}}, {"a": {}})["consolidated_metadata"]
    assert json.loads(json.dumps(told)) == {
        "kind": "inline",
        "must_understand": False,
        "metadata": {"a": {}},
    }


def test_events_need_a_library_that_is_named(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "pyarrow.parquet", None)
    with pytest.raises(ImportError, match="events in a folder need pyarrow"):
        zivi.sweep(lambda x: (x, {"t": [x]}), {"x": [1.0]}, out=tmp_path / "s.zarr")


@pytest.mark.filterwarnings("ignore:.* is damaged")
@pytest.mark.parametrize("most", [3, 4])
def test_a_damaged_study_is_read_up_to_a_size(tmp_path, monkeypatch, most):
    zivi.sweep(lambda x: 2.0 * x, zivi.points(x=[1.0, 2.0, 3.0, 4.0]), out=tmp_path / "s.zarr")
    (chunk,) = (tmp_path / "s.zarr" / "x" / "c").iterdir()
    chunk.write_bytes(chunk.read_bytes()[:-3])
    monkeypatch.setattr(result, "MOST_SALVAGED", most)
    if most < 4:
        with pytest.raises(OSError, match="its 4 points are too many"):
            zivi.open_study(tmp_path / "s.zarr")
        return
    study = zivi.open_study(tmp_path / "s.zarr")
    assert len(study.status) == 4


def test_workers_that_never_begin_are_given_up(monkeypatch):
    monkeypatch.setattr(drive, "START", 0.05)
    driver = drive.Driver.__new__(drive.Driver)
    never = SimpleNamespace(submit=lambda *_: concurrent.futures.Future())
    driver._pool, driver._job = SimpleNamespace(executor=never), None
    driver._gate = SignalGate()
    with pytest.raises(RuntimeError, match="the workers die before they compute"):
        driver._see_it_live()


@pytest.mark.parametrize(
    ("number", "ours", "raised"),
    [
        (errno.EBADF, True, concurrent.futures.BrokenExecutor),
        (errno.EBADF, False, OSError),
        (errno.ENOMEM, True, OSError),
    ],
)
def test_a_pool_that_breaks_while_a_worker_starts_is_broken(number, ours, raised):
    def submit(*_):
        raise OSError(number, "cannot start")

    driver = drive.Driver.__new__(drive.Driver)
    driver._pool = SimpleNamespace(executor=SimpleNamespace(submit=submit), ours=ours)
    with pytest.raises(raised, match="cannot start"):
        driver._send(print)


def test_a_task_that_meets_a_broken_pool_is_tried_alone():
    class Broken(drive.Driver):
        def __init__(self):
            self._running, self._in_flight, self._suspects = {}, 2, deque()
            self._tasks = ["first", None]

        def _next(self):
            return self._tasks.pop(0)

        def _submit(self, task):
            raise concurrent.futures.BrokenExecutor

        def _broken(self, dead):
            assert dead == []

    driver = Broken()
    assert not driver._hand_out()
    assert list(driver._suspects) == ["first"]
