"""Orbits in detail: where they begin, what they tell, and what happens where nothing is found."""

import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest

import zivi
from inside import (
    Frame,
    _power,
    chatter_exponent,
    crossed,
    flow_of,
    located,
    orbits_mechanical_curve as mechanical_curve,
    orbits_switch as switch,
    parsed,
)


@pytest.fixture(scope="module")
def resting():
    force = zivi.LinearForce(gravity=1, amplitude=1.3, phase=-np.pi / 2)
    orbit = zivi.periodic_orbit(zivi.ImpactSystem(force, e=0.3), (0, (0, 0)))
    assert orbit.kind != "impacting"
    return orbit


def test_a_branch_of_resting_orbits_lifts_off_where_the_force_turns(resting):
    # f = -1 + F cos(t - pi/2) = 0
    branch = zivi.continue_orbit(resting, "amplitude", (1.2, 1.4), step=0.1)
    assert len(branch) > 3
    for value, orbit in zip(branch.values, branch.orbits, strict=True):
        assert orbit.liftoff_time == pytest.approx(np.arcsin(1 / value), abs=1e-11)
        assert orbit.margin > 0.1
        alone = zivi.periodic_orbit(orbit.system, (0, (0, 0)))
        assert orbit.zeno_time == pytest.approx(alone.zeno_time, abs=1e-9)


def test_an_orbit_that_touches_the_wall_says_so(monkeypatch):
    status = zivi.OrbitStatus
    force = zivi.LinearForce(gravity=1, amplitude=1.52, phase=-np.pi / 2)
    orbit = zivi.periodic_orbit(zivi.ImpactSystem(force, e=0.5), (0, (2, 2)))
    event = SimpleNamespace(orbit=orbit, kind="grazing")
    for depth, said in ((0.0, status.COMPLETED), (1e-3, status.LEFT_ADMISSIBLE)):
        left = dataclasses.replace(orbit, status=status.LEFT_ADMISSIBLE, depth=depth)
        monkeypatch.setattr(switch, "solve_word", lambda *_, it=left: it)
        told = switch._cross_event(None, event)
        assert told.status is said
        assert (told.message == "It grazes.") == (said is status.COMPLETED)


def test_where_no_impacting_orbit_is_found_the_last_one_is_given(resting, monkeypatch):
    tried = []

    def none(frame, *_):
        tried.append(frame.system)
        return SimpleNamespace(kind="resting", success=True, number=len(tried))

    monkeypatch.setattr(switch, "solve_word", none)
    event = zivi.BranchEvent("end_of_rest", 1.5, resting)
    found = switch._leave_rest(SimpleNamespace(values=[1.3, 1.4], name="amplitude"), event)
    assert found.number == len(tried) == len(switch.BEYOND_REST)


def test_a_transient_is_shorter_than_the_span():
    force = zivi.LinearForce(gravity=1, amplitude=1.52, phase=-np.pi / 2)
    system = zivi.ImpactSystem(force, e=0.5)
    with pytest.raises(ValueError, match="transient must be >= 0 and shorter than t_span, got 15"):
        zivi.lyapunov_exponents(system, (10, 20), (0, 1), transient=15.0)


def test_a_run_of_a_mechanism_that_ends_has_no_exponents():
    def force(t, q, qdot):
        return [np.nan if t > 0.5 else -9.81]

    system = zivi.MechanicalSystem(mass=[[1.0]], force=force, gaps=[zivi.LinearGap([1.0])], e=0.5)
    found = zivi.lyapunov_exponents(system, (0, 9), ([1.0], [0.0]), transient=4.0, piece=1.0)
    assert np.isnan(found.exponents).all()
    assert found.status is zivi.OrbitStatus.RUN_ENDED


def test_a_crossing_is_found_in_few_corrections():
    calls = []

    def correct(z, normal):
        calls.append(z)
        return SimpleNamespace(z=z, tangent=normal)

    one, other = (
        SimpleNamespace(z=np.array([x, 0.0]), tangent=np.array([1.0, 0.0])) for x in (-1.0, 2.0)
    )
    path = SimpleNamespace(correct=correct)
    found = located(path, one, other, lambda point: np.expm1(point.z[0] - 0.3))
    assert found.z[0] == pytest.approx(0.3, abs=1e-13)
    assert len(calls) <= 15


def test_a_jump_of_a_test_function_is_found_to_a_part_of_the_scale():
    """Halves of a chord of 0.003, until one is below 1e-12: log2(3e9) = 31.5."""
    calls = []

    def correct(z, normal):
        calls.append(z)
        return SimpleNamespace(z=z, tangent=normal)

    one, other = (
        SimpleNamespace(z=np.array([x, 0.0]), tangent=np.array([1.0, 0.0])) for x in (-1e-3, 2e-3)
    )
    curve = SimpleNamespace(correct=correct)
    found = located(curve, one, other, lambda point: 1.0 if point.z[0] > 3e-4 else -1.0)
    assert found.z[0] == pytest.approx(3e-4, abs=1e-12)
    assert len(calls) == 32


def test_axes_are_told_where_they_are_not_those_of_one_mass():
    force = zivi.LinearForce(gravity=1, amplitude=1.52, phase=-np.pi / 2)
    found = zivi.basins(zivi.ImpactSystem(force, e=0.5), [0.0, 1.0], [0.0, 1.0])
    assert "axes" not in found._table().attrs


@pytest.mark.parametrize("load", [0.0, 0.3])
def test_a_grazing_curve_begins_where_the_load_holds_the_gap(load):
    """``x'' + .1 x' + x = load + F cos t`` swings by 10 F about the load, the stop is at 1."""
    system = zivi.LinearSystem(
        1.0,
        0.1,
        1.0,
        excitation=[np.array([load]), zivi.Harmonic([0.8], 1.0)],
        gaps=[zivi.LinearGap([-1.0], 1.0, name="stop")],
        e=0.8,
    )
    found = zivi.grazing_curve(system, "stop", [1.0])
    assert found[0] == pytest.approx([1.0, (1.0 - load) / 10.0], rel=1e-12)


def test_a_rest_after_a_plastic_impact_ends_smoothly():
    """Its duration goes with the first power, after an accumulation with that of ``e``."""
    flow = SimpleNamespace(e=np.array([0.3]))
    short = SimpleNamespace(segment=1, gap=0)

    def power(kind):
        word = [SimpleNamespace(kind=kind), SimpleNamespace(kind="L")]
        return _power(
            SimpleNamespace(terms=SimpleNamespace(frame=SimpleNamespace(word=word, flow=flow))),
            short,
        )

    assert power("S") == 1.0
    assert power("Z") == pytest.approx(1.0 / chatter_exponent(0.3))


def test_points_between_two_are_named_on_the_way(monkeypatch):
    one = SimpleNamespace(z=np.array([2.0, 0.0]), tests={"fold": 1.0, "cusp": 1.0, "pole": 1.0})
    other = SimpleNamespace(z=np.array([1.5, 1.0]), tests={"fold": -1.0, "cusp": -2.0, "pole": 3.0})
    parts = iter([0.7, 0.2])

    def between(path, low, high, test):
        return SimpleNamespace(
            z=low.z + next(parts) * (high.z - low.z), tests={"fold": 0.0, "cusp": 0.0}
        )

    monkeypatch.setattr(mechanical_curve, "located", between)
    found = mechanical_curve.Line.named(SimpleNamespace(), one, other)
    assert [it.kind for it in found] == ["cusp", "fold"]


def test_an_event_is_looked_for_fifty_times_at_most():
    """Where a test function jumps, and the points are too far apart for the digits of a part."""
    tried = []

    def correct(guess, normal):
        tried.append(guess)
        return SimpleNamespace(z=guess, tangent=np.array([1.0]))

    ends = [SimpleNamespace(z=np.array([z]), tangent=np.array([1.0])) for z in (0.0, 1e12)]
    path = SimpleNamespace(correct=correct)
    found = located(path, *ends, lambda it: 1.0 if it.z[0] < 3e11 else -1.0)
    assert found is not None
    assert len(tried) == 50


@pytest.mark.parametrize(("apart", "gap"), [(0.05, 1), (0.005, -1)])
def test_impacts_at_one_time_are_told_by_what_is_nearer(apart, gap, monkeypatch):
    """A gap that is .1 of its 10 away, or a flight that lasts a part of the period."""
    low = SimpleNamespace(kind="simultaneous", value=0.1, size=10.0, segment=0, gap=1)
    monkeypatch.setattr(mechanical_curve, "Margins", lambda terms: SimpleNamespace(lows=[low]))
    word = [SimpleNamespace(gap=0), SimpleNamespace(gap=1)]
    x = np.array([[0.0, 0.0, 2.0], [2.0, 0.0, 2.0 + 4.0 * apart]])
    terms = SimpleNamespace(x=x, length=4.0, frame=SimpleNamespace(word=word))
    margin = mechanical_curve.critical_of("simultaneous", terms, 0.0)
    assert (margin.kind, margin.segment, margin.gap) == ("simultaneous", int(gap < 0), gap)


def test_a_branch_of_a_mechanism_says_what_it_is():
    pytest.importorskip("xarray")
    system = zivi.LinearSystem(
        1.0,
        0.1,
        1.0,
        excitation=zivi.Harmonic([0.2], 0.8),
        gaps=[zivi.LinearGap([-1.0], 1.0, name="stop")],
        e=0.8,
    )
    orbit = zivi.periodic_orbit(system, (["P"], [[0.0, 0.0, 0.0]]))
    branch = zivi.continue_orbit(orbit, "F", (0.1, 0.25), step=0.2)
    data = branch.to_xarray()
    assert data.attrs["title"] == "Branch of periodic orbits"
    assert data.attrs["words"] == ["P"]
    np.testing.assert_array_equal(data.F, branch.values)


def test_a_free_motion_without_its_impact_is_cut_where_the_gap_was_least():
    """At the top of the coordinate that moves the gap most: ``g = 1 + x/5 - y``."""
    system = zivi.LinearSystem(
        np.eye(2), np.zeros((2, 2)), np.eye(2), gaps=[zivi.LinearGap([0.2, -1.0], 1.0, name="stop")]
    )
    method = zivi.SwitchedRK()
    word = parsed(["I stop"], ["stop"])
    frame = Frame(system, flow_of(system, method), word, method, 6.0, free=True)
    x = np.array([[2.0, 0.1, 0.2, 0.3, 0.4, 8.0]])
    flights = SimpleNamespace(z=np.array([[0.0, 1.0, 0.5, 0.0]]))
    terms = SimpleNamespace(frame=frame, x=x, length=6.0, segments=SimpleNamespace(flights=flights))
    new, y = crossed(terms, SimpleNamespace(kind="grazing", segment=0))
    assert [(it.kind, it.gap) for it in new.word] == [("P", -1)]
    assert new.section == 1
    assert y.tolist() == [6.0, 0.1, 0.2, 0.3, 0.4, 6.0]
