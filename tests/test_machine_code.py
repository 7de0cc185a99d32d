"""The cache of compiled models: damage is compiled again, what others could write is not used."""

import os
import sys
import warnings
from pathlib import Path

import pytest

from inside import base_machine_code as native

sys.path.append(str(Path(__file__).parents[1] / "benchmarks"))
import damaged_cache

pytestmark = [
    pytest.mark.skipif(os.name != "posix", reason="owners and modes of files"),
    pytest.mark.skipif(native.c_compiler() is None, reason="no C compiler"),
]


@pytest.fixture
def cache(tmp_path, monkeypatch):
    monkeypatch.setenv("ZIVI_CACHE", str(tmp_path / "cache"))
    monkeypatch.setattr(native, "_refused", set())
    monkeypatch.setattr(native, "_own_folder", [])
    yield tmp_path / "cache"
    for folder in native._own_folder:
        folder.cleanup()


def test_damage_never_ends_a_process():
    assert damaged_cache.damaged(30, 7) == {0: 30}


def test_a_library_is_written_once_and_sealed(cache, monkeypatch):
    assert damaged_cache.apart(damaged_cache.used) == 0
    library, seal = sorted(cache.iterdir())
    assert seal.name == f"{library.name}.sha256"
    assert seal.read_bytes() == native._sealed(library.name, library.read_bytes())
    assert [cache.stat().st_mode & 0o777, seal.stat().st_mode & 0o777] == [0o700, 0o600]
    # the next process does not compile
    monkeypatch.setattr(native, "_compile", None)
    assert damaged_cache.apart(damaged_cache.used) == 0


@pytest.mark.parametrize(
    "change", ["no seal", "another model", "a folder", "a link", "a pipe", "open"]
)
def test_what_is_not_as_it_was_written_is_compiled_again(cache, change, tmp_path):
    damaged_cache.used()
    library, seal = sorted(cache.iterdir())
    content = library.read_bytes()
    if change == "no seal":
        seal.unlink()
    elif change == "another model":  # with its seal, under this name
        other = native._by_c(damaged_cache.SOURCE.replace("3.0", "4.0"))
        assert other.address
        moved, its_seal = sorted(set(cache.iterdir()) - {library, seal})
        os.replace(moved, library)
        os.replace(its_seal, seal)
    elif change == "open":
        library.chmod(0o722)
    else:
        library.unlink()
        (tmp_path / "elsewhere").write_bytes(content)
        {
            "a folder": lambda: library.mkdir(),
            "a link": lambda: library.symlink_to(tmp_path / "elsewhere"),
            "a pipe": lambda: os.mkfifo(library),
        }[change]()
    assert damaged_cache.apart(damaged_cache.used) == 0
    if change != "a folder":  # in whose place no file can be put
        assert library.is_file()
        assert not library.is_symlink()
        assert library.stat().st_mode & 0o777 == 0o700
        assert seal.read_bytes() == native._sealed(library.name, library.read_bytes())


@pytest.mark.parametrize("kind", ["for all", "for a group", "foreign", "in an open one"])
def test_a_folder_that_others_can_write_is_not_used(cache, kind, monkeypatch):
    damaged_cache.used()
    before = {it.name: it.stat().st_mtime_ns for it in cache.iterdir()}
    if kind == "foreign":
        if os.geteuid() == 0:
            os.chown(cache, 12345, -1)
        else:
            monkeypatch.setattr(os, "geteuid", lambda: 12345)
        told = "it belongs to another user"
    elif kind == "in an open one":
        cache.parent.chmod(0o777)
        told = f"others may write into {cache.parent}"
    else:
        cache.chmod(0o707 if kind == "for all" else 0o770)
        told = "others may write into it"
    loaded = []
    monkeypatch.setattr(
        native, "_loaded", lambda library, of=native._loaded: loaded.append(library) or of(library)
    )
    with pytest.warns(RuntimeWarning, match=f"not kept in {cache}: {told}"):
        assert damaged_cache.used() == 0
    assert not [it for it in loaded if it.is_relative_to(cache)]
    assert {it.name: it.stat().st_mtime_ns for it in cache.iterdir()} == before
    # it is said once
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert damaged_cache.used() == 0


def test_a_planted_library_of_another_user_is_not_loaded(cache):
    if os.geteuid() != 0:
        pytest.skip("only root can give files away")
    damaged_cache.used()
    for file in cache.iterdir():
        os.chown(file, 12345, -1)
    with pytest.raises(OSError, match="may belong to another user"):
        native._loaded(sorted(cache.iterdir())[0])
    assert damaged_cache.used() == 0
    assert {it.stat().st_uid for it in cache.iterdir()} == {0}


def test_a_library_without_its_function(cache):
    with pytest.raises(RuntimeError, match="does not contain the function model"):
        native._by_c("int other(void) { return 0; }\n")
