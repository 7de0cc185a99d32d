"""Stores that came from elsewhere, were altered, or were stopped at any write."""

import contextlib
import copy
import dataclasses
import errno
import json
import os
import pickle
import shutil
import threading
import warnings
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

import sweep_functions as functions
import zivi
from inside import read_head
from interrupting import calls_in
from test_sweep_executors import files

zarr = pytest.importorskip("zarr", reason="the extra 'study' is not installed")
pytest.importorskip("pyarrow", reason="the extra 'study' is not installed")

POINTS = {"x": np.arange(8.0), "y": [0.0, 1.0]}
CALL = {"function": functions.cheap, "points": POINTS, "seed": 1, "chunk": 4}


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    folder = tmp_path_factory.mktemp("written") / "a"
    zivi.sweep(out=folder, **CALL)
    return folder


@pytest.fixture
def store(written, tmp_path):
    return Path(shutil.copytree(written, tmp_path / "a"))


def altered(store, change):
    """Change the head of a store."""
    head = json.loads((store / "zarr.json").read_text())
    change(head)
    (store / "zarr.json").write_text(json.dumps(head))


def nodes(head):
    return head["consolidated_metadata"]["metadata"]


# arrays that zivi did not write


class Attack:
    """What runs code when it is unpickled."""

    def __init__(self, file):
        self.file = file

    def __reduce__(self):
        return (Path.touch, (self.file,))


def old_format(head):
    nodes(head)["area"] = {
        "zarr_format": 2,
        "shape": [8, 2],
        "chunks": [2, 2],
        "dtype": "|O",
        "compressor": None,
        "filters": [{"id": "pickle", "protocol": 5}],
        "order": "C",
        "fill_value": None,
        "attributes": {"_ARRAY_DIMENSIONS": ["x", "y"]},
        "dimension_separator": "/",
    }


def foreign_codec(head):
    nodes(head)["area"]["codecs"][1] = {"name": "numcodecs.pickle", "configuration": {}}


def another_array(head):
    nodes(head)["more"] = copy.deepcopy(nodes(head)["area"])


def inner_codec(head):
    codecs = nodes(head)["area"]["codecs"]
    setting = {"chunk_shape": [2, 2], "codecs": codecs, "index_codecs": codecs[:1]}
    nodes(head)["area"]["codecs"] = [{"name": "sharding_indexed", "configuration": setting}]


def node(key, value):
    def change(head):
        nodes(head)["area"][key] = value

    return change


@pytest.mark.parametrize(
    "change",
    [
        old_format,
        foreign_codec,
        another_array,
        inner_codec,
        node("data_type", "float32"),
        node("data_type", {"name": "null_terminated_bytes", "configuration": {"length_bytes": 4}}),
        node("shape", [8, 3]),
        node("fill_value", 0.0),
        node("storage_transformers", [{"name": "x"}]),
        node("attributes", {"scale_factor": 2.0}),
        node("extra", 1),
        lambda head: head.update(zarr_format=2),
        lambda head: nodes(head).pop("events"),
        lambda head: head.pop("consolidated_metadata"),
    ],
)
def test_arrays_that_zivi_does_not_write_are_refused_before_they_are_decoded(
    change, store, tmp_path, monkeypatch
):
    mark = tmp_path / "mark"
    for file in (store / "area").rglob("0"):
        if file.is_file():
            file.write_bytes(pickle.dumps(Attack(mark)))
    altered(store, change)
    decoded = []
    for codec in (zarr.codecs.BytesCodec, zarr.codecs.ZstdCodec, zarr.codecs.Crc32cCodec):
        monkeypatch.setattr(codec, "decode", lambda *_: decoded.append(1))
    for call in (zivi.open_study, lambda store: zivi.sweep(out=store, **CALL)):
        with pytest.raises(OSError, match=r"zarr\.json is damaged, or partly written by"):
            call(store)
    assert not decoded
    assert not mark.exists()


def test_metadata_beside_the_head_are_not_read_and_are_mended(store):
    whole, expected = zivi.open_study(store).dataset.load(), files(store)
    (store / "area" / ".zarray").write_text('{"zarr_format": 2, "filters": [{"id": "pickle"}]}')
    (store / "pair" / "zarr.json").write_text('{"zarr_format": 3, "codecs": [{"name": "pickle"}]}')
    (store / "x" / "zarr.json").unlink()
    xr.testing.assert_identical(zivi.open_study(store).dataset.load(), whole)
    with pytest.warns(UserWarning, match=r"(x|pair)/zarr.json is missing or altered"):
        xr.testing.assert_identical(zivi.open_study(store, verify=True).dataset, whole)
    zivi.sweep(out=store, **CALL)
    (store / "area" / ".zarray").unlink()
    assert files(store) == expected


def test_altered_heads_are_opened_or_give_the_documented_errors(store):
    """Each edit is one value of the head, or of the texts in it, that becomes another."""
    source, opened = np.random.default_rng(3), 0
    plain = json.loads((store / "zarr.json").read_text())
    for key in ("config", "labels", "schema", "parameters"):
        plain["attributes"][key] = json.loads(plain["attributes"][key])
    others = [None, True, -1, 0, 3, 1e300, 10**9, 10**40, "x", "", [], {}, ["x"], {"x": 1}, "e" * 9]
    for _ in range(120):
        head = copy.deepcopy(plain)
        part, key = head, str(source.choice(list(head), p=[0.7, 0.05, 0.2, 0.05]))
        while isinstance(part[key], dict | list) and part[key] and source.random() < 0.9:
            part = part[key]
            key = list(part)[source.integers(len(part))] if isinstance(part, dict) else 0
        if source.random() < 0.2 and isinstance(part, dict):
            del part[key]
        else:
            part[key] = others[source.integers(len(others))]
        for name in ("config", "labels", "schema", "parameters"):
            attrs = head.get("attributes")
            if isinstance(attrs, dict) and isinstance(attrs.get(name), dict | list):
                attrs[name] = json.dumps(attrs[name])
        (store / "zarr.json").write_text(json.dumps(head))
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # damage that is told
            try:
                study = zivi.open_study(store)
            except (ValueError, OSError) as error:
                assert str(store) in str(error)  # noqa: PT017 which of them is open
            else:
                study.dataset.load()
                opened += 1
    assert 10 < opened < 80


# points that are not there or are others


def vanish(file):
    file.unlink()


def flip(file):
    data = bytearray(file.read_bytes())
    data[len(data) // 2] ^= 1
    file.write_bytes(data)


def other_values(file):
    array = zarr.open_array(file.parents[1], mode="r+")
    array[:] = np.asarray(array[:])[::-1]


@pytest.mark.parametrize("verify", [False, True])
@pytest.mark.parametrize("harm", [vanish, flip, other_values])
def test_the_values_of_parameters_are_protected_and_mended(harm, verify, store):
    whole, expected = zivi.open_study(store), files(store)
    whole.dataset.load()
    harm(store / "x" / "c" / "0")
    with pytest.warns(UserWarning, match=r"x/c/0 is (missing|damaged)|not those of the study"):
        study = zivi.open_study(store, verify=verify)
    assert np.isnan(study.x).all()
    assert np.array_equal(study.area, whole.area, equal_nan=True)
    mended = zivi.sweep(out=store, **CALL)
    xr.testing.assert_identical(mended.dataset.load(), whole.dataset)
    assert files(store) == expected


def test_names_that_are_lost_are_empty(tmp_path):
    points = zivi.points(name=np.array(["a", "bc"], "U9"), n=[1, 2])
    zivi.sweep(lambda name, n: n, points, out=tmp_path / "a")
    assert zivi.open_study(tmp_path / "a").name.values.tolist() == ["a", "bc"]
    (tmp_path / "a" / "name" / "c" / "0").unlink()
    with pytest.warns(UserWarning, match="name/c/0 is missing"):
        study = zivi.open_study(tmp_path / "a")
    assert study.name.values.tolist() == ["", ""]
    assert study.n.values.tolist() == [1, 2]


# messages and events that are not there


@pytest.mark.parametrize("verify", [False, True])
@pytest.mark.parametrize("name", ["message/c/3/0", "events/00000000.parquet", "events"])
def test_files_of_messages_and_events_are_missed(name, verify, tmp_path):
    def call():
        return zivi.sweep(failing, {"x": range(16)}, out=tmp_path / "a", chunk=4)

    def failing(x):
        return 1 // (x - 13), {"t": [1.0]}

    whole = call().dataset.load()
    expected, lost = files(tmp_path / "a"), tmp_path / "a" / name.replace("/c/3/0", "/c/3")
    shutil.rmtree(lost) if lost.is_dir() else lost.unlink()
    with pytest.warns(UserWarning, match=name.replace("/c/3/0", "/c/3")):
        zivi.open_study(tmp_path / "a", verify=verify)
    xr.testing.assert_identical(call().dataset.load(), whole)
    assert files(tmp_path / "a") == expected


def test_events_that_vanish_after_opening_are_missed(store):
    study = zivi.open_study(store)
    (store / "events" / "00000001.parquet").unlink()
    with pytest.warns(UserWarning, match=r"00000001\.parquet is damaged: FileNotFoundError"):
        assert 4 not in study.events["point"].to_pylist()


def test_an_opened_study_can_be_pickled(store):
    study = zivi.open_study(store)
    copied = pickle.loads(pickle.dumps(study))
    xr.testing.assert_identical(copied.dataset.load(), study.dataset.load())
    assert copied.events.equals(study.events)
    assert copied.path == study.path


# sizes


@pytest.mark.parametrize("chunk", [None, 1])
@pytest.mark.parametrize("shards", [False, True])
def test_what_is_not_there_takes_no_time_however_many_points_a_store_claims(
    chunk, shards, tmp_path
):
    zivi.sweep(functions.noted, {"x": [1.0]}, out=tmp_path / "a", fixed={"log": os.devnull})
    head = read_head(tmp_path / "a")
    claimed = head.identity | {"shape": [10**9], "chunk": chunk, "shards": shards}
    told = head.attributes | {"config": json.dumps(claimed)}
    dataclasses.replace(head, identity=claimed, attributes=told).write(tmp_path / "a")
    (tmp_path / "a" / "x" / "c" / "0").unlink()

    def opened():
        with (
            pytest.raises(OSError, match="too many for the memory"),
            pytest.warns(UserWarning, match="is damaged"),
        ):
            zivi.open_study(tmp_path / "a")

    assert calls_in(opened) < 100_000


def test_a_study_of_too_many_points_is_refused(tmp_path):
    million = np.arange(1e6)
    for out in (None, tmp_path / "a"):
        with pytest.raises(ValueError, match=r"at most 1e\+09 points, got 1\.00e\+12"):
            zivi.sweep(functions.product, {"x": million, "y": million}, out=out)
    assert not list(tmp_path.iterdir())


def test_the_largest_study_can_be_interrupted(tmp_path):
    def pressed(x, y):
        if y == 1:
            raise KeyboardInterrupt
        return x

    points = {"x": np.arange(1e5), "y": np.arange(1e4)}
    with pytest.raises(KeyboardInterrupt) as stop:
        zivi.sweep(pressed, points, out=tmp_path / "a")
    assert "1 of 1000000000 points are known" in stop.value.__notes__[-1]
    assert float(stop.value.study.value[0, 0]) == 0.0


# writes that fail


@pytest.mark.parametrize("dead", [False, True])
def test_a_run_whose_write_fails_goes_on_whichever_write_it_is(dead, tmp_path, monkeypatch):
    """A full disk at one write; with `dead`, nothing is written afterwards, as of a killed run."""
    call = CALL | {"points": {"x": [6.0, 7.0], "y": [0.0, 1.0]}, "chunk": 2}
    zivi.sweep(out=tmp_path / "whole", **call)
    expected, out = files(tmp_path / "whole"), tmp_path / "a"
    replace, path_replace = os.replace, Path.replace
    left = [0]

    def fails():
        left[0] -= 1
        return left[0] < 0 if dead else left[0] == -1

    def full(source, target):
        if fails():
            raise OSError(errno.ENOSPC, "No space left on device")
        replace(source, target)

    def full_path(source, target):
        if fails():
            raise OSError(errno.ENOSPC, "No space left on device")
        return path_replace(source, target)

    for number in range(0, 200, 1 if dead else 5):
        left[0] = number
        with monkeypatch.context() as patched, contextlib.suppress(OSError):
            patched.setattr(os, "replace", full)
            patched.setattr(Path, "replace", full_path)
            zivi.sweep(out=out, **call)
        if left[0] >= 0:
            break
        assert not list(tmp_path.glob(".*"))
        if not out.exists():  # nothing is there, or all that was made room for
            continue
        assert not list(tmp_path.rglob("*.partial"))
        zivi.sweep(out=out, **call)
        assert files(out) == expected
        shutil.rmtree(out)
    assert number > 20


def test_a_store_that_version_0_1_0_left_without_room_for_results_goes_on(store):
    expected = files(store)

    def unfinished(head):
        for name in ("area", "pair", "luck", "n_events"):
            del nodes(head)[name]

    altered(store, unfinished)
    for file in store.rglob("*"):
        if file.is_file() and file.name != "zarr.json" and file.parts[-3] not in ("x", "y"):
            file.unlink()
    assert not zivi.open_study(store).status.any()
    zivi.sweep(out=store, **CALL)
    assert files(store) == expected


def test_runs_that_start_together_leave_one_store(tmp_path):
    """The slower ones are refused in words, or go on with what the first one made."""
    out, said = tmp_path / "a", []
    together = threading.Barrier(4)

    def run():
        together.wait()
        try:
            zivi.sweep(functions.both_seeds, {"x": range(40)}, out=out, chunk=1)
        except RuntimeError as error:
            said.append(str(error))

    threads = [threading.Thread(target=run) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert all("another run writes to" in text for text in said)
    assert [entry.name for entry in tmp_path.iterdir()] == ["a"]
    assert zivi.open_study(out, verify=True).complete
