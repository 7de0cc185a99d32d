"""Any text of an exception is kept; a folder where a file should be is told, and made room for."""

import warnings
from pathlib import Path

import numpy as np
import pytest

import sweep_functions as functions
import zivi
from inside import LONGEST, message_of, write_below

pytest.importorskip("zarr", reason="the extra 'study' is not installed")
pytest.importorskip("pyarrow", reason="the extra 'study' is not installed")

TEXTS = {
    "half a pair": ("no file \udcff.csv", r"ValueError: no file \udcff.csv"),
    "both halves apart": ("\udc00\ud800", r"ValueError: \udc00\ud800"),
    "nothing": ("", "ValueError: "),
    "zeros": ("a\0b\0", r"ValueError: a\x00b\x00"),
    "a terminal's colours": ("\x1b[31mred\x9b", r"ValueError: \x1b[31mred\x9b"),
    "lines": ("one\n\ttwo\r", "ValueError: one\n\ttwo\\r"),
    "other letters": ("Größe 漢字 🎈", "ValueError: Größe 漢字 🎈"),
    "long": ("é" * 10**6, "ValueError: " + "é" * (LONGEST - 12)),
    "long and escaped": ("\udcff" * 10**5, ("ValueError: " + r"\udcff" * LONGEST)[:LONGEST]),
}


def failing(x, which):
    if x == 1:
        raise ValueError(TEXTS[which][0])
    return x


@pytest.mark.parametrize("which", TEXTS)
def test_any_text_of_an_exception_is_kept_and_the_study_goes_on(which, tmp_path):
    call = {"function": failing, "points": {"x": [0.0, 1.0, 2.0]}, "fixed": {"which": which}}
    for study in (
        zivi.sweep(**call),
        zivi.sweep(**call, out=tmp_path / "a"),
        zivi.sweep(**call, out=tmp_path / "a"),
        zivi.open_study(tmp_path / "a", verify=True),
    ):
        assert study.complete
        assert study.message.values.tolist() == ["", TEXTS[which][1], ""]
        assert len(study.failed) == 1


def test_exceptions_that_cannot_be_told():
    class SilentError(Exception):
        def __str__(self):
            raise RuntimeError

    class WrongTextError(Exception):
        def __str__(self):
            return 1

    assert message_of(SilentError()) == "SilentError, whose text raises RuntimeError"
    assert message_of(WrongTextError()) == "WrongTextError, whose text raises TypeError"


def call_in(folder):
    return {
        "function": functions.cheap,
        "points": zivi.grid(x=np.arange(8.0), y=np.linspace(0, 1, 5)),
        "chunk": 10,
        "seed": 3,
        "out": folder,
    }


FILES = [
    *(f"{name}/c/0/0" for name in ("area", "luck", "status", "n_events")),
    *("pair/c/2/0/0", "message/c/3/0", "x/c/0", "y/c/0", "events/00000001.parquet"),
    *("area/zarr.json", "status/zarr.json"),
]


@pytest.mark.parametrize("name", FILES)
@pytest.mark.parametrize("verify", [False, True])
def test_a_folder_in_the_place_of_a_file_is_told_and_mended(name, verify, tmp_path):
    first = zivi.sweep(**call_in(tmp_path / "a")).dataset.load()
    file = tmp_path / "a" / name
    assert file.is_file()
    file.unlink()
    file.mkdir()
    (file / "precious").write_text("kept")
    if verify or not name.endswith("zarr.json"):
        with pytest.warns(UserWarning, match=f"{file} is (missing|damaged)"):
            zivi.open_study(tmp_path / "a", verify=verify)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        again = zivi.sweep(**call_in(tmp_path / "a"))
    assert again.complete
    assert again.dataset.load().identical(first)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        zivi.open_study(tmp_path / "a", verify=True)
    # what was there is beside it
    (aside,) = file.parent.glob(f".{file.name}.*/precious")
    assert aside.read_text() == "kept"


def test_room_is_made_only_where_it_is_needed(tmp_path):
    file = tmp_path / "a" / "b" / "c"

    def write():
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text("new")

    (tmp_path / "a").write_text("a file where a folder should be")
    write_below(tmp_path, file, write)
    assert file.read_text() == "new"
    assert [it.read_text() for it in tmp_path.glob(".a.*")] == ["a file where a folder should be"]
    called = []

    def fail():
        called.append(1)
        raise OSError("the disk is full")

    with pytest.raises(OSError, match="the disk is full"):
        write_below(tmp_path, file, fail)
    assert called == [1]
    assert len(list(Path(tmp_path).iterdir())) == 2
