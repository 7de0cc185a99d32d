"""The list of mutations: every entry applies to the code as it is, and the check can fail."""

import dataclasses
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]


@pytest.fixture(scope="module")
def entries():
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(ROOT / "tools" / "mutants")
        import entries

        yield entries
    del sys.modules["entries"]


def test_every_entry_applies(entries):
    mutants = entries.read()
    assert len(mutants) > 30
    assert entries.faults(ROOT, mutants) == []


@pytest.mark.parametrize(
    ("changed", "fault"),
    [
        ({"find": "no such text"}, "0 times"),
        ({"find": "e"}, "not once"),
        ({"file": "crates/none.rs"}, "there is no"),
        ({"tests": ()}, "needs either"),
        ({"equivalent": "also a reason"}, "needs either"),
        ({"tests": ("zivi lib there_is_no_such_test",)}, "there is no test"),
        ({"tests": ("tests/test_ball.py::test_nothing",)}, "there is no test"),
        ({"tests": ("cargo test",)}, "neither"),
    ],
)
def test_an_entry_that_does_not_apply_is_told(entries, changed, fault):
    first = entries.read()[0]
    (told,) = entries.faults(ROOT, [dataclasses.replace(first, **changed)])
    assert told.startswith(f"{first.name}: ")
    assert fault in told


def test_an_entry_that_changes_nothing_or_is_there_twice_is_told(entries):
    first = entries.read()[0]
    same = dataclasses.replace(first, replace=first.find)
    assert "changes nothing" in entries.faults(ROOT, [same])[0]
    assert "used twice" in entries.faults(ROOT, [first, first])[0]
