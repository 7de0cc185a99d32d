"""Every name of the interface of orbits, branches and curves: arguments, attributes, kinds."""

import math

import matplotlib as mpl
import numpy as np
import pytest

import zivi
from orbit_systems import chain2, listed, numbers, rest2, shaker, sym2, vdp2
from zivi import OrbitStatus

mpl.use("Agg")

pytestmark = pytest.mark.xdist_group("orbits_interface")

TURN = 2 * math.pi


def masses(system, functions=False):
    """Give the system, or the same as a system of functions."""
    if not functions:
        return system
    load = system.excitation[0]
    M, C, K = system.M, system.C, system.K

    def force(t, q, v):
        p = np.asarray(load.amplitude) * math.cos(load.omega * t + load.phase)
        return p - C @ v - K @ q

    return zivi.MechanicalSystem(mass=M, force=force, gaps=system.gaps, e=system.e)


@pytest.fixture(
    scope="module", params=["linear", pytest.param("functions", marks=pytest.mark.slow)]
)
def orbit(request):
    """Two masses, one impact a period, as both kinds of system."""
    system = masses(chain2(w=1.4), request.param == "functions")
    period = None if request.param == "linear" else TURN / 1.4
    return zivi.periodic_orbit(system, (["I stop"], [3.0]), period=period)


@pytest.fixture(scope="module")
def branch():
    start = zivi.periodic_orbit(chain2(w=1.4), (["I stop"], [3.0]))
    return zivi.continue_orbit(start, "omega", (1.18, 1.6), step=0.05, through=True)


def assert_orbit(o):
    """Everything that an orbit tells is there, and agrees with its simulation."""
    n, k = o.trajectory.q.shape[1], len(o.word)
    assert all(isinstance(letter, str) for letter in o.word)
    assert o.segments.dtype.names == ("t0", "t1", "contacts")
    assert o.segments.shape == (k,)
    assert o.segments["contacts"].shape == (k, len(o.system.gap_names))
    assert o.impacts.dtype.names == ("t", "gap", "u", "impulse")
    assert np.all(o.impacts["impulse"] > 0.0)
    assert o.contacts.dtype.names == ("t0", "t1", "gap")
    assert np.all(o.contacts["t1"] > o.contacts["t0"])
    assert len(o.zeno_times) == sum(letter[0] == "Z" for letter in o.word)
    assert len(o.liftoff_times) == sum(letter[0] == "L" for letter in o.word)
    assert o.period > 0.0
    assert isinstance(o.multiple, int)
    assert isinstance(o.stable, bool)
    assert o.stable == bool(np.all(np.abs(o.multipliers) < 1.0))
    assert o.admissible is True
    assert o.success is True
    assert o.depth > 0.0
    assert 0.0 <= o.residual < 1e-10
    assert o.status is OrbitStatus.COMPLETED
    assert o.message
    run = o.trajectory
    assert isinstance(run, zivi.MechanicalTrajectory)
    length = o.multiple * o.period
    assert run.t[-1] - run.t[0] == pytest.approx(length, rel=1e-14)
    assert np.max(np.abs(run.q[-1] - run.q[0])) < 1e-7
    t = float(run.t[0])
    M = o.monodromy(t)
    assert M.shape == (2 * n, 2 * n)
    eigenvalues = np.linalg.eigvals(M)
    for value in o.multipliers:
        assert np.min(np.abs(eigenvalues - value)) < 1e-6


def test_an_orbit_tells_all(orbit):
    assert_orbit(orbit)
    assert orbit.word == ("I stop",)
    assert len(orbit.multipliers) == 4
    moved = "F" if isinstance(orbit.system, zivi.LinearSystem) else "e"
    slope = orbit.derivative(moved)
    assert slope.shape == (1,)
    # by a difference of other orbits
    h = 1e-5
    sides = []
    for sign in (1, -1):
        given = {"e": 0.8 + sign * h} if moved == "e" else {"F": 1.0 + sign * h}
        system = masses(chain2(w=1.4, **given), moved == "e")
        sides.append(zivi.periodic_orbit(system, orbit, period=TURN / 1.4).impacts["t"][0])
    assert slope[0] == pytest.approx((sides[0] - sides[1]) / (2 * h), rel=1e-5)


def test_all_starts_lead_to_the_orbit(orbit):
    system, period = orbit.system, TURN / 1.4
    run = orbit.trajectory
    t, state = float(run.t[0]), (run.q[0], run.qdot[0])
    phase = float(orbit.impacts["t"][0])
    row = np.append(phase, run(t + (phase - t) % period + 1e-10).ravel())
    later = np.append(row[0] + period, row[1:])
    twice = (["I stop"] * 2, [row, later])
    others = [
        zivi.periodic_orbit(system, run, period=period),
        zivi.periodic_orbit(system, (t, state), 1, period=period),
        zivi.periodic_orbit(system, orbit, multiple=1, period=period, symmetry=None),
        zivi.periodic_orbit(system, (("I stop",), [phase]), period=period),
        zivi.periodic_orbit(system, (["I stop"], [row]), multiple=1, period=period),
        # reduced to its least period
        zivi.periodic_orbit(system, twice, multiple=2, period=period),
        zivi.periodic_orbit(system, orbit, multiple=3, period=period),
    ]
    if period_known := isinstance(system, zivi.LinearSystem):
        others.append(zivi.periodic_orbit(system, (t, state)))
    assert period_known == (len(others) == 8)
    for other in others:
        assert other.status is OrbitStatus.COMPLETED
        assert other.word == ("I stop",)
        assert other.multiple == 1
        assert abs(other.impacts["t"][0] - phase) < 1e-9


def test_words_of_contacts_and_accumulations_tell_all():
    rests = zivi.periodic_orbit(rest2(), zivi.simulate(rest2(), (0, 250), ([2, 2], [0, 0])))
    assert_orbit(rests)
    assert rests.word == ("L road", "Z road")
    begin, end, gap = rests.contacts[0]
    assert (begin, gap) == (rests.zeno_times[0], 0)
    assert end == pytest.approx(rests.liftoff_times[0] + TURN)
    # rows of a word: the states after its events
    rows = np.column_stack([rests.segments["t1"], np.roll(rests._starts[:, 1:], -1, axis=0)])
    again = zivi.periodic_orbit(rest2(), (rests.word, rows))
    assert again.success
    assert abs(again.zeno_times[0] - rests.zeno_times[0]) < 1e-10
    plastic = chain2(w=0.7, e=0.0)
    held = zivi.periodic_orbit(plastic, zivi.simulate(plastic, (0, 400), ([0, 0], [0, 0])))
    assert_orbit(held)
    assert held.word == ("S stop", "L stop")
    # chains are written in short, and an event sequence has at most 64 symbols
    assert "'L road Z road'" in repr(rests)
    many = (["I stop"] * 65, np.linspace(0.0, 5.0, 65))
    with pytest.raises(ValueError, match="1 to 64 event symbols"):
        zivi.periodic_orbit(chain2(), many)


@pytest.mark.slow
def test_a_period_may_be_free_and_a_symmetry_a_function():
    system = vdp2(**numbers("autonomous"))
    run = zivi.simulate(system, (0, 200), ([0.5, 0.5], [0, 0]))
    free = zivi.periodic_orbit(system, run, period="free")
    assert free.status is OrbitStatus.COMPLETED
    assert len(free.multipliers) == 3
    # the derivative of the period comes last
    assert free.derivative("e").shape == (len(free.word) + 1,)
    given = numbers("pitchfork_F") | {"F": 3.0}
    both = sym2(**given)
    run = zivi.simulate(both, (0, 400), ([0, 0], [0, 0.1]))
    by_matrix = zivi.periodic_orbit(both, run, symmetry=-np.eye(2))
    by_function = zivi.periodic_orbit(both, run, symmetry=lambda z: -np.asarray(z))
    for half in (by_matrix, by_function):
        assert half.symmetric
        assert_orbit(half)
    assert np.array_equal(by_matrix.impacts, by_function.impacts)


def test_a_branch_tells_all(branch):
    assert branch.name == "omega"
    assert branch.status is OrbitStatus.RANGE_END
    assert len(branch) == len(branch.orbits) == len(branch.values)
    assert [arc.word for arc in branch.arcs] == [("I stop",)]
    for arc in branch.arcs:
        assert len(arc.orbits) == len(arc.values) == len(arc)
        assert all(it.word == arc.word for it in arc.orbits)
    for event in branch.events:
        assert event.kind in ("period_doubling", "neimark_sacker")
        assert event.orbit.word == ("I stop",)
        assert (event.gap, event.name) == (None, "omega")
        assert event in branch.of_kind(event.kind)
        there = branch.switch(event)
        assert there.success
        assert there.multiple == (2 if event.kind == "period_doubling" else 1)
    assert (branch.stable | True).shape == branch.admissible.shape == (len(branch),)
    assert branch.multipliers.shape == (len(branch), 4)
    pytest.importorskip("xarray")
    table = branch.to_xarray()
    assert table.attrs["status"] == "RANGE_END"
    assert list(table.attrs["events"]) == [event.kind for event in branch.events]
    assert np.array_equal(table.omega, branch.values)


def test_a_branch_that_does_not_go_through_ends_at_a_grazing():
    start = zivi.periodic_orbit(chain2(), (["I stop"] * 4, listed("two_dof_four_impacts", "t")))
    ends = zivi.continue_orbit(start, "omega", (0.899, 0.93), through=False)
    assert ends.status is OrbitStatus.LEFT_ADMISSIBLE
    grazing = ends.of_kind("grazing")[-1]
    assert grazing.gap == "stop"
    assert len(ends.switch(grazing).word) == 3


@pytest.mark.slow
def test_a_branch_retraces_itself_between_doublings(branch):
    """From twice the period to four times, and back to the other doubling of the same branch."""
    twice = branch.switch(branch.of_kind("period_doubling")[1])
    ends = zivi.continue_orbit(twice, "omega", (1.25, 1.6), step=0.05)
    first, last = ends.of_kind("period_doubling")
    four = ends.switch(first)
    assert four.multiple == 4
    back = zivi.continue_orbit(four, "omega", (1.25, 1.6), step=0.05)
    assert back.status is OrbitStatus.RETRACED
    assert back.message == "The branch came to where it begins, at a period doubling."
    assert abs(back.values[-1] - last.value) < 2e-3
    assert {len(it.word) for it in back.arcs} == {5, 6}


def coupled():
    """Each gap feels the impact of the other."""
    gaps = [
        zivi.LinearGap([-1, 0.2], 0.5, name="a"),
        zivi.LinearGap([0.2, -1], 0.5, name="b"),
    ]
    load = zivi.Harmonic([1.0, 0.6], 0.8)
    return zivi.LinearSystem(
        np.eye(2), 0.1 * np.eye(2), np.eye(2), excitation=load, gaps=gaps, e=0.6
    )


def test_a_branch_ends_where_coupled_gaps_are_hit_at_once():
    run = zivi.simulate(coupled(), (0, 800), ([0.1, 0], [0, 0]))
    ends = zivi.continue_orbit(zivi.periodic_orbit(coupled(), run), "b.offset", (0.3, 1.6))
    assert ends.status is OrbitStatus.SIMULTANEOUS
    event = ends.of_kind("simultaneous")[0]
    # one gap, the other, and the first again
    late = event.orbit.impacts["t"][-2:]
    assert list(event.orbit.impacts["gap"][[-2, -1, 0]]) == [0, 1, 0]
    assert abs(late[1] - late[0]) < 1e-11
    assert abs(event.orbit.impacts["t"][0] + event.orbit.period - late[1]) < 1e-11


def test_a_corner_in_an_orbit_has_no_derivatives():
    # a block on two feet falls flat in every period
    feet = [zivi.LinearGap([1, side], 0.0, name=f"foot{side}") for side in (0.5, -0.5)]
    block = zivi.LinearSystem(
        np.diag([1.0, 0.1]),
        None,
        np.zeros((2, 2)),
        excitation=[zivi.Harmonic([2.5, 0.0], 1.0), np.array([-1.0, 0.0])],
        gaps=feet,
        e=0.3,
    )
    run = zivi.simulate(block, (0, 60), ([0.2, 0.0], [0.0, 0.0]))
    orbit = zivi.periodic_orbit(block, run)
    assert orbit.status is OrbitStatus.NOT_DIFFERENTIABLE
    assert orbit.admissible is False


def curve_of(event, names, spans, **settings):
    c = zivi.continue_curve(event, names, spans, **settings)
    assert c.kind == event.kind
    assert c.names == tuple(names)
    assert c.values.shape == (len(c), 2)
    assert c.kappa.shape == (len(c),)
    assert isinstance(c.status, OrbitStatus)
    orbit = c.orbits(len(c) // 2)
    assert orbit.multiple == event.orbit.multiple
    for point in c.points:
        assert isinstance(point.kind, str)
        assert point.values.shape == (2,)
        assert c.switch(point).word == point.orbit.word
    return c


SPANS = ((1.15, 1.6), (0.4, 3.0))


def test_curves_tell_all(branch):
    found = {}
    for kind in ("period_doubling", "neimark_sacker"):
        event = branch.of_kind(kind)[0]
        found[kind] = curve_of(event, ("omega", "F"), SPANS, step=0.1)
    turning = found["neimark_sacker"]
    assert np.all(np.isfinite(turning.kappa))
    assert turning.kappa[0] != turning.kappa[-1]
    assert np.all(np.isnan(found["period_doubling"].kappa))
    kinds = {point.kind for point in turning.points}
    assert {"resonance_1_2", "resonance_1_3"} <= kinds
    assert "grazing" in {point.kind for point in found["period_doubling"].points}
    # stable words of all kinds are drawn
    ax = zivi.plot.map(list(found.values()), words=True)
    assert ax.get_xlabel() == "omega"
    assert any("I stop" in text.get_text() for text in ax.texts)
    assert zivi.plot.map is zivi.plot.chart
    assert zivi.plot.curve(turning).get_ylabel() == "F"
    mpl.pyplot.close("all")


def test_branches_are_drawn(branch):
    for y in ("u", "q.q0", "amplitude"):
        ax = zivi.plot.branch(branch, y)
        assert ax.get_xlabel() == "omega"
        assert ax.lines
    mpl.pyplot.close("all")


def test_folds_and_grazings_have_curves_and_the_response_gives_the_first():
    start = zivi.periodic_orbit(chain2(w=1.1, F=0.45), (["I stop"], [3.6]))
    if not start.success:
        start = zivi.periodic_orbit(chain2(w=1.1, F=0.45), (["I stop"], [0.5]))
    branch = zivi.continue_orbit(start, "F", (0.3, 0.6), step=0.05)
    names, spans = ("omega", "F"), ((1.0, 1.2), (0.05, 0.9))
    (fold,), grazing = branch.of_kind("fold"), branch.of_kind("grazing")[0]
    assert len(curve_of(fold, names, spans, step=0.1)) > 3
    edge = curve_of(grazing, names, spans, step=0.1)
    omegas = np.linspace(0.5, 2.0, 7)
    amplitude = zivi.response_amplitude(chain2(), "stop", omegas)
    c = zivi.grazing_curve(chain2(), "stop", omegas)
    assert c.shape == (7, 2)
    assert np.allclose(c[:, 1] * amplitude, 0.3, rtol=1e-12)
    exact = zivi.grazing_curve(chain2(), "stop", edge.values[:, 0])[:, 1]
    assert np.max(np.abs(edge.values[:, 1] - exact)) < 1e-10


def test_interior_impacts_and_pitchforks_have_curves():
    rest = zivi.LinearSystem(
        1.0,
        0.1,
        1.0,
        excitation=zivi.Harmonic([0.3], 0.8),
        gaps=[zivi.LinearGap([-1.0], 1.0, name="stop")],
        e=0.8,
    )
    flight = zivi.periodic_orbit(rest, (["P"], [[0.0, 0.0, 0.0]]))
    assert flight.kind == "flight"
    (event,) = zivi.continue_orbit(flight, "F", (0.2, 0.5)).of_kind("interior_impact")
    assert event.gap == "stop"
    curve_of(event, ("omega", "F"), ((0.7, 1.2), (0.01, 2.0)), step=0.1)
    given = numbers("pitchfork_F") | {"F": 3.1}
    system = sym2(**given)
    run = zivi.simulate(system, (0, 400), ([0, 0], [0, 0.1]))
    half = zivi.periodic_orbit(system, run, symmetry=-np.eye(2))
    span = (2.0, 3.7)
    branch = zivi.continue_orbit(half, "F", span, step=0.1)
    event = branch.of_kind("pitchfork")[0]
    assert event.cubic is not None
    curve_of(event, ("F", "omega"), (span, (2.0, 2.4)), step=0.1, max_points=8)
    assert not branch.switch(event).symmetric


@pytest.mark.slow
def test_ends_of_contacts_and_of_rest_have_curves():
    chain = chain2(w=0.7, e=0.0)
    orbit = zivi.periodic_orbit(chain, zivi.simulate(chain, (0, 900), ([0, 0], [0, 0])))
    (end,) = zivi.continue_orbit(orbit, "omega", (0.66, 0.72)).of_kind("contact_ends")
    assert end.gap == "stop"
    curve_of(end, ("F", "stop.offset"), ((0.9, 1.1), (0.25, 0.4)), step=0.1)
    run = zivi.simulate(shaker(1.5), (0, 60), ([0.5], [0.0]))
    rests = zivi.continue_orbit(zivi.periodic_orbit(shaker(1.5), run), "road.amplitude", (1.5, 1.7))
    (end,) = rests.of_kind("end_of_rest")
    c = curve_of(end, ("road.amplitude", "e"), ((1.4, 1.8), (0.48, 0.52)), step=0.2)
    assert np.all(np.diff(c.values[:, 0]) < 0.0)


def test_two_impacts_at_once_have_curves():
    gaps = [zivi.LinearGap([-1, 0], 0.3, name="a"), zivi.LinearGap([0, -1], 0.3, name="b")]
    system = zivi.LinearSystem(
        np.eye(2),
        0.2 * np.eye(2),
        np.diag([1.0, 1.3]),
        excitation=zivi.Harmonic([1.0, 1.0], 1.2),
        gaps=gaps,
        e=0.6,
    )
    run = zivi.simulate(system, (0, 500), ([0, 0], [0, 0]))
    branch = zivi.continue_orbit(zivi.periodic_orbit(system, run), "b.offset", (0.2, 1.2))
    (event,) = branch.of_kind("simultaneous")
    assert event.gap in ("a", "b")
    curve_of(event, ("b.offset", "omega"), ((0, 1.2), (1.1, 1.3)), step=0.2)


def table(amplitude):
    force = zivi.LinearForce(gravity=1.0, amplitude=amplitude, phase=-math.pi / 2)
    return zivi.ImpactSystem(force, e=0.5)


def test_events_of_one_mass_have_curves():
    orbit = zivi.periodic_orbit(table(1.3), [(0.6, 2.1)])
    branch = zivi.continue_orbit(orbit, "amplitude", (1.0, 1.6))
    for event in branch.events:
        c = zivi.continue_curve(event, ("amplitude", "e"), ((0.5, 2.0), (0.45, 0.55)), step=0.1)
        assert (c.kind, c.status) == (event.kind, OrbitStatus.RANGE_END)
        assert len(c.orbits(0).word) == 1
    run = zivi.simulate(table(1.5), (0, 200), (0, 0.1))
    rests = zivi.continue_orbit(zivi.periodic_orbit(table(1.5), run), "amplitude", (1.45, 1.7))
    event = rests.of_kind("end_of_rest")[0]
    c = zivi.continue_curve(event, ("amplitude", "e"), ((1, 3), (0.45, 0.55)), step=0.5)
    assert c.kind == "end_of_rest"


def test_orbits_are_those_of_newtons_law():
    def system(**law):
        gaps = [zivi.LinearGap([-1, 0], 0.3, name="a"), zivi.LinearGap([0, -1], 0.3, name="b")]
        count = law.pop("count", 2)
        force = lambda t, q, v: -np.asarray(q) - 0.1 * np.asarray(v) + [np.cos(t), 0.0]  # noqa: E731
        return zivi.MechanicalSystem(mass=np.eye(2), force=force, gaps=gaps[:count], **law)

    word = (["I a"], [3.0])
    with pytest.raises(ValueError, match=r"^e must be numbers \(Newton's impact law\)"):
        zivi.periodic_orbit(system(e=zivi.SpeedDependentImpact(0.8, 1.0, 0.2)), word, period=TURN)
    for law in ("poisson", "stronge"):
        with pytest.raises(ValueError, match=r"^impact_law must be 'newton' for orbits"):
            zivi.periodic_orbit(system(e=0.5, impact_law=law), word, period=TURN)
    # of one gap all are Newton's
    times = [
        zivi.periodic_orbit(system(e=0.5, count=1, impact_law=law), word, period=TURN).impacts["t"]
        for law in ("newton", "poisson")
    ]
    assert times[0] == pytest.approx(times[1], abs=1e-12)
    assert len(times[0]) == 1
