"""Studies in a folder that get more points: only the new ones are computed."""

import contextlib
import os
import shutil

import numpy as np
import pytest

import sweep_functions as functions
import zivi
from inside import FolderStore
from test_sweep_executors import files

pytestmark = pytest.mark.slow

pytest.importorskip("zarr", reason="the extra 'study' is not installed")
pytest.importorskip("pyarrow", reason="the extra 'study' is not installed")

POINTS = {"x": np.arange(8.0), "y": np.linspace(0, 1, 6)}
CALLS = []


def noted(x, y):
    """Numbers, an array, events and a few failures; notes the points."""
    CALLS.append((x, y))
    return functions.cheap(x, y, np.random.default_rng([int(8 * x), int(8 * y)]))


def bits(a):
    """What a function can tell apart: signs of zeros, strings, kinds of numbers."""
    CALLS.append(a)
    return len(a) if isinstance(a, str) else np.copysign(abs(a) + 1.0, a)


@pytest.fixture(autouse=True)
def calls():
    CALLS.clear()
    return CALLS


SMALLER = {
    "a value at the end": {"x": POINTS["x"][:7], "y": POINTS["y"]},
    "values in the middle": {"x": POINTS["x"][[0, 1, 4, 7]], "y": POINTS["y"]},
    "several parameters": {"x": POINTS["x"][1:], "y": POINTS["y"][::2]},
    "another order": {"x": POINTS["x"][::-1], "y": POINTS["y"][[3, 0, 5, 4, 2, 1]]},
    "one point": {"x": POINTS["x"][7:], "y": POINTS["y"][:1]},
}


@pytest.mark.parametrize("chunk", [None, 5])
@pytest.mark.parametrize("smaller", SMALLER.values(), ids=SMALLER)
def test_the_extended_study_is_the_whole_one_byte_by_byte(smaller, chunk, tmp_path, calls):
    with contextlib.suppress(RuntimeError):  # the only point fails
        zivi.sweep(noted, smaller, out=tmp_path / "a", chunk=chunk)
    first = set(calls)
    calls.clear()
    study = zivi.sweep(noted, POINTS, out=tmp_path / "a", chunk=chunk)
    assert len(calls) == 48 - len(first)
    assert not first & set(calls)
    zivi.sweep(noted, POINTS, out=tmp_path / "b", chunk=chunk)
    assert files(tmp_path / "a") == files(tmp_path / "b")
    assert os.listdir(tmp_path) in (["a", "b"], ["b", "a"])
    calls.clear()
    again = zivi.sweep(noted, POINTS, out=tmp_path / "a")
    assert not calls
    assert again.dataset.load().identical(study.dataset.load())


@pytest.mark.parametrize(
    ("there", "more", "new"),
    [
        ([1, 2], [0.5, 1.0, 2.0], [0.5]),
        ([1.0, 2.0], [2, 1, 3], [3]),
        ([np.nan, 0.0], [-0.0, 0.0, 1.0, np.nan], [-0.0, 1.0]),
        (["a", "bc"], ["long", "bc", "a"], ["long"]),
        ([1.0, 1.0, 2.0], [2.0, 1.0, 3.0, 1.0, 1.0], [3.0, 1.0]),
    ],
)
@pytest.mark.parametrize("design", [zivi.grid, zivi.points])
def test_values_are_known_by_their_bits(there, more, new, design, tmp_path, calls):
    zivi.sweep(bits, design(a=there), out=tmp_path / "a")
    calls.clear()
    study = zivi.sweep(bits, design(a=more), out=tmp_path / "a")
    assert list(map(str, calls)) == list(map(str, new))
    value = study.value.values.copy()
    assert np.array_equal(value, zivi.sweep(bits, design(a=more)).value, equal_nan=True)


def test_points_of_a_list_are_known_by_all_parameters(tmp_path, calls):
    there = {"x": [1.0, 1.0, 2.0, 1.0], "y": [1.0, 2.0, 1.0, 1.0]}
    more = {"x": [2.0, 1.0, 1.0, 2.0, 1.0], "y": [1.0, 1.0, 2.0, 2.0, 1.0]}
    zivi.sweep(noted, zivi.points(**there), out=tmp_path / "a")
    calls.clear()
    zivi.sweep(noted, zivi.points(**more), out=tmp_path / "a")
    assert calls == [(2.0, 2.0)]
    zivi.sweep(noted, zivi.points(**more), out=tmp_path / "b")
    assert files(tmp_path / "a") == files(tmp_path / "b")


def test_a_larger_sample_of_sobol_has_the_smaller_one(tmp_path, calls):
    for n in (16, 64):
        calls.clear()
        design = zivi.sample("sobol", n, {"x": (0, 6), "y": (0, 1)}, seed=3)
        zivi.sweep(noted, design, out=tmp_path / "a")
    assert len(calls) == 48


@pytest.mark.parametrize(
    ("there", "more", "lost"),
    [
        ([1.0, 2.0], [1.0, 3.0, 4.0], "1 of the 2 in the folder are not among these"),
        ([1.0, 1.0], [1.0, 2.0, 3.0], "1 of the 2 in the folder"),
        ([0.0], [-0.0, 1.0], "1 of the 1 in the folder"),
        ([True, False], [0, 1, 2], "2 of the 2 in the folder"),
        (["1"], [1, 2], "1 of the 1 in the folder"),
        ([2**53 + 1, 2], [2.0**53, 2.0, 1.0], "2 of the 2 in the folder"),
    ],
)
def test_points_that_are_not_all_there_are_another_study(there, more, lost, tmp_path):
    zivi.sweep(bits, {"a": there}, out=tmp_path / "a")
    before = files(tmp_path / "a")
    with pytest.raises(ValueError, match=f"has another study: .*points can be added, but {lost}"):
        zivi.sweep(bits, {"a": more}, out=tmp_path / "a")
    assert files(tmp_path / "a") == before


@pytest.mark.parametrize("name", ["x", "y"])
def test_seeds_stay_those_of_the_points(name, tmp_path):
    """A seed depends on the number of a point, which only the first parameter leaves as it is."""
    call = {"function": functions.cheap, "seed": 4, "out": tmp_path / "a"}
    zivi.sweep(points=POINTS | {name: POINTS[name][:4]}, **call)
    before = files(tmp_path / "a")
    if name == "y":
        with pytest.raises(
            ValueError, match="has an argument seed or rng, which depend on the number"
        ):
            zivi.sweep(points=POINTS, **call)
        assert files(tmp_path / "a") == before
    else:
        with pytest.raises(ValueError, match="has an argument seed or rng"):
            zivi.sweep(points=POINTS | {"x": POINTS["x"][::-1]}, **call)
        zivi.sweep(points=POINTS, **call)
        zivi.sweep(points=POINTS, **call | {"out": tmp_path / "b"})
        assert files(tmp_path / "a") == files(tmp_path / "b")


@pytest.mark.parametrize("at", [0, 3])
@pytest.mark.parametrize("error", [OSError(28, "No space left"), KeyboardInterrupt()])
def test_a_stop_while_the_folder_is_written_again_loses_nothing(
    at, error, tmp_path, monkeypatch, calls
):
    smaller = SMALLER["values in the middle"]
    zivi.sweep(noted, smaller, out=tmp_path / "a", chunk=5)
    before, save, saved = files(tmp_path / "a"), FolderStore.save, []

    def full(self, chunk, block):
        saved.append(chunk)
        if len(saved) > at:
            raise error
        save(self, chunk, block)

    monkeypatch.setattr(FolderStore, "save", full)
    with pytest.raises(type(error)):
        zivi.sweep(noted, POINTS, out=tmp_path / "a", chunk=5)
    monkeypatch.undo()
    assert files(tmp_path / "a") == before
    assert os.listdir(tmp_path) == ["a"]
    calls.clear()
    assert zivi.sweep(noted, POINTS, out=tmp_path / "a").complete
    assert len(calls) == 24


@pytest.mark.parametrize("step", [1, 2])
def test_a_stop_between_two_renames_loses_nothing(step, tmp_path, monkeypatch, calls):
    """As a kill does, it leaves the old folder under another name, and maybe the new one, too."""
    smaller = SMALLER["values in the middle"]
    zivi.sweep(noted, smaller, out=tmp_path / "a", chunk=5)
    replace, moves = os.replace, []

    def killed(source, target):
        moves.append("a" in (os.path.basename(source), os.path.basename(target)))
        if sum(moves) <= step:
            replace(source, target)
        else:
            raise OSError("no more")

    monkeypatch.setattr(os, "replace", killed)
    monkeypatch.setattr(shutil, "rmtree", lambda *args, **options: None)
    if step == 1:
        with pytest.raises(OSError, match="no more"):
            zivi.sweep(noted, POINTS, out=tmp_path / "a", chunk=5)
    else:
        zivi.sweep(noted, POINTS, out=tmp_path / "a", chunk=5)
    monkeypatch.undo()
    assert (tmp_path / "a").exists() == (step == 2)
    assert (tmp_path / ".a.before").exists()
    calls.clear()
    assert zivi.sweep(noted, POINTS, out=tmp_path / "a").complete
    assert len(calls) == (24 if step == 1 else 0)
    assert not (tmp_path / ".a.before").exists()
    zivi.sweep(noted, POINTS, out=tmp_path / "b", chunk=5)
    assert files(tmp_path / "a") == files(tmp_path / "b")


def stopping(x, log):
    functions.logged(log, x)
    if x == 20 and len(functions.lines(log)) < 23:
        raise KeyboardInterrupt
    return x


def test_a_run_of_new_points_that_is_stopped_goes_on(tmp_path):
    call = {"function": stopping, "out": tmp_path / "a", "fixed": {"log": str(tmp_path / "log")}}
    zivi.sweep(points={"x": [30, 10]}, **call)
    with pytest.raises(KeyboardInterrupt) as stop:
        zivi.sweep(points={"x": range(40)}, **call)
    assert stop.value.study.status.tolist() == [1] * 20 + [0] * 10 + [1] + [0] * 9
    study = zivi.sweep(points={"x": range(40)}, **call)
    assert study.value.values.tolist() == list(range(40))
    assert len(functions.lines(tmp_path / "log")) == 41  # the stopped one twice


def test_what_was_damaged_or_failed(tmp_path, calls):
    smaller = SMALLER["a value at the end"] | {"x": POINTS["x"][1:]}
    zivi.sweep(noted, smaller, out=tmp_path / "a", chunk=6)
    (tmp_path / "a" / "area" / "c" / "2" / "0").unlink()
    calls.clear()
    zivi.sweep(noted, POINTS, out=tmp_path / "a", retry_failed=True)
    assert sorted(calls) == [
        *((x, y) for x in (0.0, 3.0) for y in POINTS["y"]),
        (7.0, 0.0),
    ]
    (tmp_path / "a" / "y" / "c" / "0").unlink()
    more = POINTS | {"x": np.arange(9.0)}
    with pytest.raises(OSError, match=r"cannot be extended: .*the same call with its own points"):
        zivi.sweep(noted, more, out=tmp_path / "a")
    zivi.sweep(noted, POINTS, out=tmp_path / "a")
    assert zivi.sweep(noted, more, out=tmp_path / "a").complete


def test_one_run_extends_at_a_time(tmp_path):
    zivi.sweep(functions.product, SMALLER["another order"], out=tmp_path / "a")
    store = FolderStore(tmp_path / "a", write=True)
    with pytest.raises(RuntimeError, match="another run writes to"):
        zivi.sweep(functions.product, POINTS | {"x": np.arange(9.0)}, out=tmp_path / "a")
    store.close()
    # and what is extended is locked until the end
    with pytest.raises(FileExistsError, match="resume is False"):
        zivi.sweep(functions.product, POINTS, out=tmp_path / "a", resume=False)

    def other(x):
        with pytest.raises(RuntimeError, match="another run writes to"):
            FolderStore(tmp_path / "c", write=True)
        return x

    zivi.sweep(other, {"x": [1.0]}, out=tmp_path / "c")
    zivi.sweep(other, {"x": [1.0, 2.0]}, out=tmp_path / "c")
    FolderStore(tmp_path / "c", write=True).close()


def test_a_link_to_a_folder_stays(tmp_path):
    zivi.sweep(functions.product, SMALLER["one point"], out=tmp_path / "a")
    (tmp_path / "link").symlink_to(tmp_path / "a")
    zivi.sweep(functions.product, POINTS, out=tmp_path / "link")
    assert (tmp_path / "link").is_symlink()
    assert zivi.open_study(tmp_path / "a").complete
