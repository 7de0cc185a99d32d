"""Methods are made of the list of the core: each can be constructed, run, stored and read about."""

import dataclasses
import inspect
import json
import math
import pickle
import runpy
from pathlib import Path

import numpy as np
import pytest

import zivi
from inside import METHODS as KEYS, FixedSteps, _zivi, argument_text, class_of
from zivi.simulation.methods import METHODS

ROOT = Path(__file__).parents[1]
BALL = zivi.ImpactSystem(-9.81, e=0.5)
DROP = zivi.MechanicalSystem(mass=1.0, force=[-9.81], gaps=[zivi.LinearGap([1])], e=0.5)

each = pytest.mark.parametrize("name", METHODS)


def made(name):
    """A method with what it must be given."""
    given = {it.name: 0.01 for it in _zivi.METHODS[name].settings if it.required}
    return METHODS[name](**given)


@each
def test_every_method_of_the_core_is_a_class_of_its_settings(name):
    kind, entry = METHODS[name], _zivi.METHODS[name]
    assert getattr(zivi, name) is getattr(zivi.methods, name) is kind
    assert name in dir(zivi)
    assert [it.name for it in dataclasses.fields(kind)] == [it.name for it in entry.settings]
    for it, parameter in zip(
        entry.settings, inspect.signature(kind).parameters.values(), strict=True
    ):
        assert parameter.default == (inspect.Parameter.empty if it.required else it.default)
    method = made(name)
    assert repr(method).startswith(f"{name}(")
    assert eval(repr(method), {name: kind, "inf": math.inf}) == method
    with pytest.raises(dataclasses.FrozenInstanceError):
        setattr(method, entry.settings[0].name, 0.5)


@each
def test_every_method_runs_batches_and_files_have_it(name, tmp_path):
    method = made(name)
    sol = zivi.simulate(BALL, (0, 1), (1, 0), method)
    batch = zivi.simulate_batch(BALL, (0, 1), [[1, 0]], method=method)
    assert sol.success
    assert batch.x[0] == sol.x[-1]
    dataset = sol.to_xarray()
    assert json.loads(dataset.attrs["config"])["method"]["name"] == name
    zivi.files.save(sol, tmp_path / "run.nc")
    np.testing.assert_array_equal(zivi.files.load(tmp_path / "run.nc").x, sol.x)
    assert [it.name for it in KEYS[name]] == [it.name for it in _zivi.METHODS[name].settings]


@each
def test_every_method_travels(name):
    method = made(name)
    for protocol in (2, pickle.HIGHEST_PROTOCOL):
        other = pickle.loads(pickle.dumps(method, protocol))
        assert type(other) is type(method)
        assert other == method
        assert zivi.simulate(BALL, (0, 0.5), (1, 0), other).success


@each
def test_every_method_is_documented(name):
    text = inspect.getdoc(METHODS[name])
    names = set()
    for line in text.partition("Parameters\n")[2].partition("Raises\n")[0].splitlines():
        if " : " in line and not line.startswith(" "):
            names |= {it.strip() for it in line.partition(" : ")[0].split(",")}
    assert names == {it.name for it in _zivi.METHODS[name].settings}
    page = (ROOT / "docs" / "api_simulation.md").read_text(encoding="utf-8")
    assert f"\n{name}\n" in page


@each
def test_mechanical_systems_take_the_methods_that_say_so(name):
    if _zivi.METHODS[name].takes_mechanism:
        assert zivi.simulate(DROP, (0, 1), ([1.0], [0.0]), made(name)).success
        return
    with pytest.raises(ValueError, match=rf"{name} supports a zivi.ImpactSystem only"):
        zivi.simulate(DROP, (0, 1), ([1.0], [0.0]), made(name))


@each
def test_a_class_in_the_place_of_a_method_is_named_with_its_call(name):
    call = f"zivi.{name}({'h=1e-3' if _zivi.METHODS[name].fixed_steps else ''})"
    assert argument_text(METHODS[name]) == f"the class zivi.{name}: call it, {call}"
    assert argument_text(name.lower()).endswith(f"the object is meant, {call}")


@each
def test_a_method_without_prose_has_the_words_of_the_core(name):
    entry = _zivi.METHODS[name]
    kind = class_of(entry)
    text = inspect.getdoc(kind)
    assert text.startswith(entry.meaning[0].upper() + entry.meaning[1:] + ".\n\n")
    for it in entry.settings:
        assert f"\n{it.name} : " in text
        assert it.range in text
    assert issubclass(kind, FixedSteps) == entry.fixed_steps
    assert kind.__module__ == "zivi"
    assert dataclasses.astuple(kind(**vars_of(made(name)))) == dataclasses.astuple(made(name))


def vars_of(method):
    return {it.name: getattr(method, it.name) for it in dataclasses.fields(method)}


def test_the_binding_refuses_what_no_method_has():
    with pytest.raises(ValueError, match=r'SwitchedRK, .*, got "Euler"'):
        _zivi.Method("Euler", h=0.1)  # type: ignore[call-overload]
    with pytest.raises(TypeError, match='ExplicitEuler has no setting "theta"'):
        _zivi.Method("ExplicitEuler", h=0.1, theta=1.0)
    with pytest.raises(ValueError, match="h must be given, a finite step size > 0"):
        _zivi.Method("MoreauJean", theta=1.0)
    with pytest.raises(ValueError, match=r"theta must be a number from 0 to 1, got 1.5"):
        _zivi.Method("MoreauJean", h=0.1, theta=1.5)
    with pytest.raises(ValueError, match="order must be 5 or 8, got -3"):
        _zivi.Method("SwitchedRK", order=-3)


def test_the_stubs_are_those_of_the_methods():
    tool = runpy.run_path(str(ROOT / "tools" / "stubs.py"))
    for path, text in tool["texts"]().items():
        assert path.read_text(encoding="utf-8") == text, f"{path.name}: run python tools/stubs.py"
