"""Branches of orbits of mechanical systems, against references of another formulation."""

import numpy as np
import pytest

import zivi
from orbit_systems import REFERENCES, chain2, listed, numbers, rest2, sym2


@pytest.fixture(scope="module")
def chart():
    orbit = zivi.periodic_orbit(chain2(), (["I stop"] * 4, listed("two_dof_four_impacts", "t")))
    return zivi.continue_orbit(orbit, "omega", (0.9, 1.6))


@pytest.mark.slow
@pytest.mark.xdist_group("mechanical_branches")
def test_a_branch_goes_through_grazings_by_itself(chart):
    assert chart.status is zivi.OrbitStatus.RANGE_END
    assert chart.words[-4:] == ["4I stop", "3I stop", "2I stop", "I stop"]
    grazings = [event.value for event in chart.of_kind("grazing")][-3:]
    known = [float(REFERENCES[f"graze_{k + 1}_to_{k}"]["value"]) for k in (3, 2, 1)]
    assert np.max(np.abs(np.subtract(grazings, known))) < 1e-11
    # an arc begins without a step of Newton's iteration
    assert all(arc.orbits[0].iterations == 0 for arc in chart.arcs[-3:])
    assert all(orbit.residual < 1e-11 for orbit in chart.orbits)
    assert chart.of_kind("grazing")[-1].gap == "stop"


@pytest.mark.slow
@pytest.mark.xdist_group("mechanical_branches")
def test_doublings_and_turning_pairs_are_those_of_the_reference(chart):
    known = REFERENCES["branch_in_w"]["events"]
    kinds = {"PD": "period_doubling", "NS": "neimark_sacker"}
    for name, value in known.items():
        values = [event.value for event in chart.of_kind(kinds[name[:2]])]
        assert min(abs(it - float(value)) for it in values) < 1e-9
    nine = REFERENCES["branch_in_w"]["events_9_digits"]
    for text in (nine["words_3"], nine["words_2"]):
        words = text.replace("fold", "fold ").split()
        for kind, value in zip(words[::2], words[1::2], strict=True):
            own = chart.of_kind(kinds.get(kind, kind))
            assert min(abs(event.value - float(value)) for event in own) < 2e-9
    for event in chart.of_kind("neimark_sacker"):
        pair = event.orbit.multipliers[np.imag(event.orbit.multipliers) > 0]
        near = pair[np.argmin(np.abs(np.abs(pair) - 1.0))]
        assert abs(abs(near) - 1.0) < 1e-9
        assert event.kappa == pytest.approx(near.real, abs=1e-9)


@pytest.mark.slow
@pytest.mark.xdist_group("mechanical_branches")
def test_runs_have_the_words_of_the_branch(chart):
    assert chart.admissible.all()
    for orbit in chart.orbits[::7]:
        if orbit.depth < 1e-6:
            continue  # an impact that grazes is there by rounding
        run = orbit.trajectory
        assert len(run.resolved_impacts) == len(orbit.word)
        end = np.append(run.q[-1] - run.q[0], run.qdot[-1] - run.qdot[0])
        growth = max(1.0, float(np.max(np.abs(orbit.multipliers))))
        assert np.max(np.abs(end)) < 1e-10 * growth


@pytest.mark.slow
@pytest.mark.xdist_group("mechanical_branches")
def test_multipliers_of_the_period_lose_a_doubling_beside_a_grazing(chart):
    # beside it another multiplier is infinite; det J(pi) is not
    event = min(chart.of_kind("period_doubling"), key=lambda it: abs(it.value - 0.920468670))
    assert event.value == pytest.approx(0.920468670, abs=2e-9)
    assert np.min(np.abs(event.orbit.multipliers + 1.0)) < 1e-7


@pytest.mark.slow
@pytest.mark.xdist_group("mechanical_branches")
def test_doubled_orbits_are_found_and_followed(chart):
    doubling = chart.of_kind("period_doubling")[-1]
    twice = chart.switch(doubling)
    assert twice.success
    assert twice.multiple == 2
    assert twice.word == ("I stop", "I stop")
    again = zivi.periodic_orbit(twice.system, twice)
    assert np.max(np.abs(again.impacts["t"] - twice.impacts["t"])) < 1e-10
    more = zivi.continue_orbit(twice, "omega", (1.3, 1.6), max_points=12)
    assert len(more) > 4
    assert all(orbit.multiple == 2 for orbit in more.orbits)
    with_labels = pytest.importorskip("xarray") and chart.to_xarray()
    assert list(with_labels.arc.values) == sorted(with_labels.arc.values)


def test_a_resting_orbit_doubles_and_ends_by_its_reaction():
    run = zivi.simulate(rest2(), (0, 200), ([2, 2], [0, 0]))
    orbit = zivi.periodic_orbit(rest2(), run)
    branch = zivi.continue_orbit(orbit, "road.amplitude", (1.2, 1.7), step=0.1, through=False)
    doubling, end = branch.events
    assert doubling.kind == "period_doubling"
    assert abs(doubling.value - float(REFERENCES["rest_PD"]["A"])) < 1e-9
    assert end.kind == "contact_ends"
    assert branch.status is zivi.OrbitStatus.LEFT_ADMISSIBLE
    assert all(np.count_nonzero(orbit.multipliers) == 2 for orbit in branch.orbits)
    # a simulation from the lift-off keeps the contact before the end, and loses it beyond
    for amplitude, lifts in ((end.value - 1e-5, 1), (end.value + 1e-5, 2)):
        system = rest2(A=amplitude)
        near = zivi.periodic_orbit(system, end.orbit)
        s = next(k for k, it in enumerate(near._word) if it.kind == "L")
        flight = near.segments[1 - s]
        t = float(flight["t0"]) + 1e-3
        state = near._frame.flow.path(
            (), float(flight["t0"]), near._starts[1 - s, 1:], np.array([t])
        )
        begin = (state[0, :2], state[0, 2:])
        seen = zivi.simulate(system, (t, t + 2 * np.pi), begin, zivi.SwitchedRK(1e-12, 1e-13))
        assert len(seen.liftoffs) == lifts


@pytest.mark.parametrize(("name", "parameter"), [("pitchfork_F", "F"), ("pitchfork_w", "omega")])
def test_a_pitchfork_is_the_doubling_of_a_half(name, parameter):
    given, value = numbers(name), float(REFERENCES[name]["value"])
    start = {"F": 4.0, "w": 2.2} | given
    start["F" if parameter == "F" else "w"] = 3.1 if parameter == "F" else 2.6
    system = sym2(**start)
    run = zivi.simulate(system, (0, 400), ([0, 0], [0, 0.1]))
    orbit = zivi.periodic_orbit(system, run, symmetry=-np.eye(2))
    span = (value - 0.4, value + 0.4)
    branch = zivi.continue_orbit(orbit, parameter, span, step=0.1)
    pitchfork = branch.of_kind("pitchfork")[0]
    assert abs(pitchfork.value - value) < 1e-11
    beside = branch.switch(pitchfork)
    assert beside.success
    assert not beside.symmetric
    assert beside.multiple == 1


def test_a_branch_that_is_not_to_go_through_ends_at_the_grazing():
    orbit = zivi.periodic_orbit(chain2(), (["I stop"] * 4, listed("two_dof_four_impacts", "t")))
    branch = zivi.continue_orbit(orbit, "omega", (0.899, 1.6), through=False)
    assert branch.words == ["4I stop"]
    assert branch.status is zivi.OrbitStatus.LEFT_ADMISSIBLE
    event = branch.of_kind("grazing")[-1]
    three = branch.switch(event)
    assert len(three.word) == 3
    with pytest.raises(ValueError, match="omega"):
        zivi.continue_orbit(orbit, "mass", (0.0, 1.0))


def test_an_isola_is_closed():
    # orbits with 5 and 6 impacts in a period, beside all others
    start = (["I stop"] * 5, [3.9764, 4.6246, 5.0162, 5.3398, 5.6573])
    orbit = zivi.periodic_orbit(chain2(w=0.895), start)
    isola = zivi.continue_orbit(orbit, "omega", (0.5, 1.6))
    assert isola.status is zivi.OrbitStatus.CLOSED
    assert len(isola) <= 250
    assert isola.words == ["5I stop", "6I stop", "5I stop"]
    grazings = [it.value for it in isola.events if it.kind in ("grazing", "interior_impact")]
    assert grazings == pytest.approx([0.8998836794, 0.8862775219, 0.8998836794], abs=1e-9)
    # it ends with the orbit at which it left the word that it began with
    there, again = isola.arcs[0].orbits[-1], isola.arcs[-1].orbits[-1]
    assert np.max(np.abs(there.impacts["t"] - again.impacts["t"])) < 1e-8
    low, high = isola.values.min(), isola.values.max()
    assert low < 0.8862 < 0.8998 < high
