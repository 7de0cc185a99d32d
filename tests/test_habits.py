"""Names that users of SciPy, python-control, MuJoCo and MATLAB try: each is answered by a hint."""

import inspect
import json
import operator
import pickle
import re

import numpy as np
import pytest

import zivi
import zivi.plot
from zivi.base.habits import ARGUMENTS, ATTRIBUTES, MODULE, PLOT

BALL = zivi.ImpactSystem(-9.81, e=0.5)
FLOOR = zivi.LinearGap([1.0])
MASS = zivi.MechanicalSystem(mass=np.eye(1), force=[-9.81], gaps=[FLOOR], e=0.5)
SPAN, START = (0, 0.1), (1, 0)

CALLS = {
    "ImpactSystem": (zivi.ImpactSystem, (-9.81,)),
    "LinearForce": (zivi.LinearForce, ()),
    "HarmonicWall": (zivi.HarmonicWall, (0.01,)),
    "MechanicalSystem": (zivi.MechanicalSystem, ()),
    "LinearGap": (zivi.LinearGap, ()),
    "method": (zivi.SwitchedRK, ()),
    "simulate": (zivi.simulate, (BALL, SPAN, START)),
    "simulate_closed_loop": (zivi.simulate_closed_loop, (BALL, None, SPAN, START)),
    "simulate_batch": (zivi.simulate_batch, (BALL, SPAN, [START])),
    "controller": (zivi.TwistingTracker, (30, 17)),
    "solve_vi": (zivi.solve_vi, (lambda x: x,)),
    "sensitivity": (zivi.sensitivity, (BALL, SPAN, START)),
    "periodic_orbit": (zivi.periodic_orbit, (BALL,)),
    "continue_orbit": (zivi.continue_orbit, (None, "amplitude", (0, 1))),
    "sweep": (zivi.sweep, (len, {"x": [1]})),
    "Gap": (zivi.Gap, (len,)),
    "DryFriction": (zivi.DryFriction, ()),
    "LinearSystem": (zivi.LinearSystem, ([[1.0]], [[0.0]], [[1.0]])),
    "Harmonic": (zivi.Harmonic, ([1.0], 2.0)),
    "Table": (zivi.Table, ([0, 1], [0, 1])),
    "Level": (zivi.Level, ()),
    "event": (zivi.event, ()),
    "symbolic": (zivi.symbolic.system, ("a",)),
    "design": (zivi.design_tracker, (1.0,)),
    "observer": (zivi.ImpactObserver, (0.5, 1e-3)),
    "animate": (zivi.plot.animate, ()),
    "settled": (zivi.bifurcation_diagram, (BALL, "amplitude", [1.0])),
}
ALIKE = {
    "method": [zivi.ThetaGamma, zivi.MoreauJean, zivi.ExplicitEuler],
    "controller": [zivi.TwistingRegulator, zivi.ExplicitTwisting],
    "solve_vi": [zivi.solve_avi, zivi.solve_ncp, zivi.solve_lcp],
    "simulate_batch": [zivi.simulate_closed_loop_batch],
    "design": [zivi.design_regulator],
    "settled": [zivi.basins, zivi.lyapunov_exponents],
}
RESULTS = {
    "run": zivi.simulate(BALL, SPAN, START),
    "mechanical run": zivi.simulate(MASS, SPAN, ([1.0], [0.0])),
    "loop": zivi.simulate_closed_loop(
        BALL, zivi.TwistingTracker(30, 17, h=1e-2, e=0.5), SPAN, START
    ),
    "VI result": zivi.solve_lcp([[1.0]], [-1.0]),
    "controller": zivi.TwistingTracker(30, 17, h=1e-2, e=0.5),
}


def test_there_are_sixty_and_more():
    of_calls = sum(map(len, ARGUMENTS.values()))
    assert of_calls + sum(map(len, ATTRIBUTES.values())) + len(MODULE) + len(PLOT) >= 300
    assert set(CALLS) == set(ARGUMENTS)
    assert set(RESULTS) == set(ATTRIBUTES)


@pytest.mark.parametrize("owner", CALLS)
def test_arguments_of_others_are_answered(owner):
    function, args = CALLS[owner]
    for name, hint in ARGUMENTS[owner].items():
        for called in (function, *ALIKE.get(owner, [])):
            if name in inspect.signature(called).parameters:
                assert called is not function or owner == "method"
                continue
            with pytest.raises(TypeError, match=rf"'{name}': ") as told:
                called(*(args if called is function else ()), **{name: 1.0})
            if called is function:
                assert hint in str(told.value) or "it belongs" in str(told.value)


@pytest.mark.parametrize("kind", RESULTS)
def test_attributes_of_others_are_answered(kind):
    result = RESULTS[kind]
    for name, hint in ATTRIBUTES[kind].items():
        with pytest.raises(AttributeError) as told:
            getattr(result, name)
        assert str(told.value).endswith(hint), name
        assert not hasattr(result, name)
    with pytest.raises(AttributeError, match=r"has no attribute 'nothing'$"):
        result.nothing  # noqa: B018
    assert pickle.loads(pickle.dumps(result)).status == result.status


def test_an_argument_that_is_needed_is_named_as_it_was_given():
    with pytest.raises(TypeError, match="unexpected keyword argument 'tspan': it is t_span"):
        zivi.simulate(BALL, tspan=SPAN, y0=START)


def test_functions_of_others_are_answered():
    for name, hint in MODULE.items():
        with pytest.raises(AttributeError) as told:
            getattr(zivi, name)
        assert str(told.value) == f"module 'zivi' has no attribute {name!r}: {hint}"


def test_plots_of_others_are_answered():
    for name, hint in PLOT.items():
        with pytest.raises(AttributeError) as told:
            getattr(zivi.plot, name)
        assert str(told.value) == f"module 'zivi.plot' has no attribute {name!r}: {hint}"
    with pytest.raises(AttributeError, match=r"has no attribute 'nothing'$"):
        zivi.plot.nothing  # noqa: B018


@pytest.mark.parametrize(
    ("kind", "states", "hint"),
    [
        ("run", "x, sol.xdot", "y"),
        ("mechanical run", "q, sol.qdot", "x"),
        ("loop", "x, sol.xdot", "e"),
    ],
)
def test_items_and_unpacking_are_answered(kind, states, hint):
    sol = RESULTS[kind]
    with pytest.raises(TypeError, match=r"object has no items: it is sol\.t$"):
        sol["t"]
    with pytest.raises(TypeError, match=re.escape(ATTRIBUTES[kind][hint])):
        sol[hint]
    with pytest.raises(TypeError, match=r"has no items$"):
        sol["nothing"]
    with pytest.raises(TypeError, match=r"sol\.t\[i\]"):
        sol[0]
    with pytest.raises(TypeError, match=re.escape(f"its arrays are sol.t, sol.{states}")):
        _t, _x = sol
    assert not np.iterable(sol)


@pytest.mark.parametrize(
    "status",
    [*zivi.Status, *zivi.StudyStatus, *zivi.VIStatus, *zivi.OrbitStatus],
    ids=lambda it: f"{type(it).__name__}.{it.name}",
)
def test_statuses_are_written_by_their_names_and_are_numbers(status):
    number = status.value
    assert f"{status}" == str(status) == "%s" % status == status.name  # noqa: UP031
    assert f"{status:>30}" == status.name.rjust(30)
    assert f"{status:3d}" == f"{number:3d}"
    assert f"{status:d}" == "%d" % status == json.dumps(status) == str(int(status))  # noqa: UP031
    assert status == number == np.uint8(status)
    assert pickle.loads(pickle.dumps(status)) is status
    assert np.asarray([status]).dtype == np.asarray([number]).dtype


def test_hints_name_what_exists():
    texts = [*MODULE.values(), *PLOT.values()]
    texts += [it for hints in (*ARGUMENTS.values(), *ATTRIBUTES.values()) for it in hints.values()]
    for text in texts:
        for name in re.findall(r"zivi\.((?:plot\.)?\w+)", text):
            assert operator.attrgetter(name)(zivi), text
    for owner, hints in ARGUMENTS.items():
        known = set(inspect.signature(CALLS[owner][0]).parameters)
        known |= {"rtol", "atol", "max_step", "h", "offset"} if owner == "method" else set()
        for text in hints.values():
            for name in re.findall(r"^(?:it is|they are) (\w+)(?=$|,| \()", text):
                assert name in known, (owner, text)
    for kind, hints in ATTRIBUTES.items():
        for text in hints.values():
            for name in re.findall(r"^(?:it is|they are|it is|.* (?:is|are)) (\w+)$", text):
                assert hasattr(RESULTS[kind], name), (kind, text)


def test_misspelt_arguments_are_answered_too():
    with pytest.raises(TypeError, match=r"'stifness': did you mean 'stiffness'\?"):
        zivi.LinearForce(stifness=1.0)
    with pytest.raises(TypeError, match=r"'maximum'$"):
        zivi.solve_vi(len, maximum=3)


def test_errors_of_other_places_are_left_alone():
    def force(t, x, xdot):
        nothing = {}
        return nothing(k=1)

    with pytest.raises(TypeError, match="'dict' object is not callable"):
        zivi.sensitivity(zivi.ImpactSystem(force, e=0.5), SPAN, START)
    with pytest.raises(TypeError, match="missing 1 required positional argument"):
        zivi.ImpactSystem(e=0.5)


def test_signatures_and_names_are_those_of_the_functions():
    assert list(inspect.signature(zivi.solve_lcp).parameters)[:2] == ["M", "q"]
    assert zivi.sweep.__name__ == "sweep"
    assert pickle.loads(pickle.dumps(zivi.solve_vi)) is zivi.solve_vi
