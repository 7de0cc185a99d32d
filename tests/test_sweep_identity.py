"""What makes a study another one: everything that its function is given, by content."""

import ctypes
import dataclasses
import enum
import functools
import os
import re
import subprocess
import sys
import threading
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import xarray as xr

import sweep_functions as functions
import zivi
from inside import UndigestibleError, digest, function_name, function_state, source_digest

pytest.importorskip("zarr", reason="the extra 'study' is not installed")
pytest.importorskip("pyarrow", reason="the extra 'study' is not installed")


class Colour(enum.Enum):
    RED = 1
    BLUE = 2


@dataclasses.dataclass
class Push:
    strength: float

    def __call__(self, t, x, xdot):
        return -self.strength

    def at(self, x):
        return self.strength * x


class Slotted:
    __slots__ = ("value",)

    def __init__(self, value):
        self.value = value


class Listed(list):
    def __init__(self, items, name):
        super().__init__(items)
        self.name = name


def table(cell):
    frame = pd.DataFrame({"a": np.arange(1000.0), "b": ["x", "y"] * 500})
    frame.loc[500, "a"] = cell
    return frame


def labelled(cell):
    return xr.DataArray(table(cell)["a"].to_numpy(), dims="t", name="load", attrs={"units": "N"})


def closure(value):
    def force(t, x, xdot):
        return value

    return force


def constant_force(value, t, x, xdot):
    return value


def cyclic(value):
    found = [value]
    found.append(found)
    return found


def structured(value):
    found = np.empty(2, np.dtype([("k", "i1"), ("v", "f8")], align=True))
    found["k"], found["v"] = 1, value
    return found


TWO = [lambda t, x, xdot: -1.0, lambda t, x, xdot: -2.0]  # on one line

# what makes a value from a number
MADE = {
    "a table": table,
    "a column": lambda n: table(n)["a"],
    "an index": lambda n: pd.MultiIndex.from_tuples([(1, "a"), (n, "b")]),
    "categories": lambda n: pd.Series(["a", "b"]).astype(pd.CategoricalDtype(["a", "b", str(n)])),
    "times": lambda n: pd.date_range("2020", periods=3, tz="UTC") + pd.Timedelta(n, "s"),
    "a labelled array": labelled,
    "labels": lambda n: labelled(0).assign_coords(t=np.arange(1000) + n),
    "a data set": lambda n: labelled(n).to_dataset(),
    "objects in an array": lambda n: np.array([None, {"a": n}], object),
    "a structured array": structured,
    "a scalar": np.float32,
    "a long scalar": np.longdouble,
    "keys": lambda n: {n: "a"},
    "a set": lambda n: {"a", "b", str(n)},
    "a path": lambda n: Path("a") / str(n),
    "a pattern": lambda n: re.compile(f"a{n}"),
    "a member": lambda n: Colour(n),
    "a member as key": lambda n: {Colour(n): 1},
    "an object": Push,
    "an object with slots": Slotted,
    "a list with more": lambda n: Listed([1], n),
    "a cycle": cyclic,
    "a generator of numbers": np.random.default_rng,
    "a closure": closure,
    "a default": lambda n: lambda t, x, xdot, value=n: value,
    "a method": lambda n: Push(n).at,
    "a method of C": lambda n: [n].count,
    "a part": lambda n: functools.partial(constant_force, n),
    "a part of a closure": lambda n: functools.partial(closure(n), 0.0),
    "a cached function": lambda n: functools.cache(closure(n)),
    "a force": lambda n: zivi.ImpactSystem(closure(n), e=0.5),
    "two on a line": lambda n: zivi.ImpactSystem(TWO[n - 1], e=0.5),
    "a wall": lambda n: zivi.ImpactSystem(-1, e=0.5, wall=zivi.HarmonicWall(0.1, n)),
    "a controller": lambda n: zivi.TwistingTracker(2 + n, 2, h=1e-3, e=0.5),
    "a ufunc": lambda n: (np.sin, np.cos)[n - 1],
    "a class": lambda n: (Push, Slotted)[n - 1],
    "a function": lambda n: (constant_force, closure)[n - 1],
}


@pytest.mark.parametrize("kind", MADE)
def test_a_digest_is_that_of_the_content(kind):
    make = MADE[kind]
    assert digest(make(1)) == digest(make(1))
    assert digest(make(1)) != digest(make(2))


@pytest.mark.parametrize("kind", MADE)
def test_digests_tell_kinds_apart(kind):
    others = {digest(make(1)) for name, make in MADE.items() if name != kind}
    assert digest(MADE[kind](1)) not in others


def test_a_digest_is_the_same_in_another_process():
    program = (
        "import test_sweep_identity as t\n"
        "print({kind: t.digest(make(1)) for kind, make in t.MADE.items()})"
    )
    environment = os.environ | {"PYTHONHASHSEED": "1", "PYTHONPATH": os.pathsep.join(sys.path)}
    command = [sys.executable, "-c", program]
    done = subprocess.run(command, capture_output=True, text=True, check=True, env=environment)
    assert eval(done.stdout) == {kind: digest(make(1)) for kind, make in MADE.items()}


def test_tables_are_told_by_what_they_hold_and_not_by_how():
    whole = pd.DataFrame({"a": [1.0, 2.0], "b": [3.0, 4.0]})
    parted = pd.DataFrame({"a": [1.0, 2.0]})
    parted["b"] = [3.0, 4.0]
    assert digest(whole) == digest(parted)
    array = np.arange(6.0).reshape(2, 3)
    assert digest(array) == digest(np.asfortranarray(array))


def test_functions_are_told_by_text_and_by_what_they_hold():
    one, other = TWO
    assert source_digest(one) != source_digest(other)
    assert function_state(one) is None
    assert function_state(closure(1)) != function_state(closure(2))
    assert function_state(Push(1)) == function_state(Push(1)) != function_state(Push(2))
    assert function_state(Push(1).at) != function_state(Push(2).at)
    nested = [lambda: lambda: 1, lambda: lambda: 2]
    assert source_digest(nested[0]) != source_digest(nested[1])
    assert source_digest(nested[0]()) != source_digest(nested[1]())
    assert source_digest(nested[0]()) != source_digest(nested[0])
    made = [eval("lambda: 1"), eval("lambda: 2")]  # without a text
    assert source_digest(made[0]) != source_digest(made[1])


@pytest.mark.parametrize("kind", ["a table", "a labelled array", "a force", "a method", "keys"])
def test_changed_arguments_are_another_study(kind, tmp_path):
    call = {"function": lambda x, a: x, "points": {"x": [1.0]}, "out": tmp_path / "a"}
    for _ in range(2):
        zivi.sweep(**call, fixed={"a": MADE[kind](1)})
    for resume in (None, True):
        with pytest.raises(ValueError, match="has another study: the fixed arguments"):
            zivi.sweep(**call, fixed={"a": MADE[kind](2)}, resume=resume)


def functions_of(value):
    """Functions whose text is the same and that compute something else."""
    return {
        "a closure": lambda x: value * x,
        "a default": lambda x, factor=value: factor * x,
        "a method": Push(value).at,
        "a part": functools.partial(functions.product, y=value),
    }


@pytest.mark.parametrize("kind", functions_of(1))
def test_a_function_that_holds_something_else_is_another_study(kind, tmp_path):
    for _ in range(2):
        zivi.sweep(functions_of(1)[kind], {"x": [1.0]}, out=tmp_path / "a")
    for resume in (None, True):
        with pytest.raises(ValueError, match=r"has another study: (what the f|the f)unction"):
            zivi.sweep(functions_of(2)[kind], {"x": [1.0]}, out=tmp_path / "a", resume=resume)


def test_the_order_of_fixed_arguments_is_of_no_account(tmp_path):
    call = {"function": lambda x, a, b: x, "points": {"x": [1.0]}, "out": tmp_path / "a"}
    zivi.sweep(**call, fixed={"a": 1, "b": {"c": 2, "d": 3}})
    zivi.sweep(**call, fixed={"b": {"d": 3, "c": 2}, "a": 1})


@pytest.mark.parametrize(
    ("make", "text"),
    [
        (threading.Lock, "_thread.lock"),
        (lambda: (n for n in range(3)), "generator"),
        (lambda: ctypes.pointer(ctypes.c_double()), "ctypes objects containing pointers"),
        (lambda: zivi.ImpactSystem(ctypes.CFUNCTYPE(*[ctypes.c_double] * 4)(max), e=0.5), "CFunc"),
        (lambda: functools.reduce(lambda inner, _: [inner], range(10**4), []), "RecursionError"),
    ],
)
def test_what_has_no_content_to_compare_is_refused_where_it_matters(make, text, tmp_path):
    value = make()
    with pytest.raises(UndigestibleError, match=text):
        digest(value)
    called = []
    for call in (
        {"function": lambda x, a: called.append(x), "fixed": {"a": [value]}},
        {"function": lambda x: called.append((x, value))},
        {"function": functools.partial(print, value), "points": {"sep": ["a"]}},
    ):
        given = {"points": {"x": [1.0]}} | call
        with pytest.raises(TypeError, match=r"holds .*pass its ingredients"):
            zivi.sweep(**given, out=tmp_path / "a")
    assert not called
    assert not list(tmp_path.iterdir())
    # in memory there is nothing to go on with
    assert zivi.sweep(lambda x, a: x, {"x": [1.0]}, fixed={"a": value}).complete


def test_a_store_of_version_0_1_0_goes_on_if_the_user_insists(tmp_path):
    import json

    def scaled(x, factor=2.0):
        return factor * x

    call = {"function": scaled, "points": {"x": [1.0, 2.0]}, "out": tmp_path / "a"}
    zivi.sweep(**call)
    head = json.loads((tmp_path / "a" / "zarr.json").read_text())
    config = json.loads(head["attributes"]["config"])
    del config["held"]
    head["attributes"]["config"] = json.dumps(config)
    (tmp_path / "a" / "zarr.json").write_text(json.dumps(head))
    assert zivi.open_study(tmp_path / "a").value.values.tolist() == [2.0, 4.0]
    with pytest.raises(ValueError, match=r"holds \(digest\): None there, .*resume=True goes on"):
        zivi.sweep(**call)
    assert zivi.sweep(**call, resume=True).complete


def test_an_object_that_is_called_has_the_name_of_its_class():
    class Steps:
        def __call__(self, k):
            return k

    assert function_name(Steps()).endswith("Steps")
    assert function_name(test_an_object_that_is_called_has_the_name_of_its_class).endswith(
        "its_class"
    )
