"""Curves of events in two parameters, against closed forms and references."""

import numpy as np
import pytest

import zivi
from example_scripts import example
from orbit_systems import REFERENCES, chain2, shaker
from oscillator import Oscillator
from zivi import LinearGap


def table(amplitude, e=0.5):
    force = zivi.LinearForce(gravity=1.0, amplitude=amplitude, phase=-np.pi / 2)
    return zivi.ImpactSystem(force, e=e)


@pytest.fixture(scope="module")
def bounces():
    return zivi.continue_orbit(zivi.periodic_orbit(table(1.3), [(0.6, 2.1)]), "amplitude", (1, 1.6))


def test_the_fold_of_the_table_is_its_closed_form(bounces):
    fold = bounces.of_kind("fold")[0]
    curve = zivi.continue_curve(fold, ("amplitude", "e"), ((0, 3), (0.05, 1.0)), step=0.05)
    amplitude, e = curve.values.T
    assert np.max(np.abs(amplitude - np.pi * (1 - e) / (1 + e))) < 1e-11
    assert e.min() == pytest.approx(0.05)
    assert e.max() == pytest.approx(1.0)
    assert curve.status is zivi.OrbitStatus.RANGE_END


def test_the_doubling_of_the_table_is_its_closed_form(bounces):
    doubling = bounces.of_kind("period_doubling")[0]
    curve = zivi.continue_curve(doubling, ("amplitude", "e"), ((0, 4), (0.1, 0.95)), step=0.05)
    amplitude, e = curve.values.T
    fold = np.pi * (1 - e) / (1 + e)
    exact = np.sqrt(fold**2 + (2 * (1 + e**2) / (1 + e) ** 2) ** 2)
    assert np.max(np.abs(amplitude - exact)) < 1e-11
    outside = np.count_nonzero(~curve.admissible)
    told = f", {outside} of {len(curve)} points where the orbit is inadmissible" if outside else ""
    assert repr(curve).endswith(f"nothing else{told}; range_end>") or curve.points
    assert told[2:] in curve.message
    orbit = curve.orbits(3)
    assert np.min(np.abs(orbit.multipliers + 1.0)) < 1e-8


@pytest.mark.slow
def test_orbits_that_only_graze_are_motions():
    """The linear motion of a chart's curve of grazings touches its stop, and is below it."""
    chart = example("mechanics_chart")
    event = chart.over_force().of_kind("grazing")[0]
    curve = zivi.continue_curve(event, chart.NAMES, chart.SPANS, step=0.03)
    assert curve.admissible.all()
    assert all(curve.orbits(k).admissible for k in range(len(curve)))


def test_a_grazing_curve_passes_the_resonance():
    omega = 0.8
    edge = np.sqrt((1 - omega**2) ** 2 + (0.1 * omega) ** 2)
    system = zivi.LinearSystem(
        1.0,
        0.1,
        1.0,
        excitation=zivi.Harmonic([0.8 * edge], omega),
        gaps=[LinearGap([-1.0], 1.0, name="stop")],
        e=0.8,
    )
    orbit = zivi.periodic_orbit(system, (["P"], [[0.0, 0.0, 0.0]]))
    assert orbit.kind == "flight"
    branch = zivi.continue_orbit(orbit, "F", (0.5 * edge, 1.2 * edge), step=0.1)
    assert branch.words == ["P", "I stop"]
    event = branch.of_kind("interior_impact")[0]
    spans = ((0.7, 2.0), (0.01, 8.0))
    curve = zivi.continue_curve(event, ("omega", "F"), spans, step=0.05)
    w, force = curve.values.T
    exact = np.sqrt((1 - w**2) ** 2 + (0.1 * w) ** 2)
    assert np.max(np.abs(force - exact)) < 1e-11
    assert w.min() < 1.0 < w.max()
    assert np.max(np.abs(zivi.grazing_curve(system, "stop", w)[:, 1] - exact)) < 1e-12
    with pytest.raises(ValueError, match="gap"):
        zivi.response_amplitude(system, "other", w)
    slider = system.replace(friction=[zivi.DryFriction([1.0], limit=0.3)])
    for function in (zivi.response_amplitude, zivi.grazing_curve):
        with pytest.raises(ValueError, match="not linear in the load"):
            function(slider, "stop", w)


@pytest.fixture(scope="module")
def single():
    orbit = zivi.periodic_orbit(chain2(w=1.4), (["I stop"], [3.0]))
    return zivi.continue_orbit(orbit, "omega", (1.18, 1.6), step=0.05)


def near(points, w, force, tolerance):
    return min(max(abs(it.values - [w, force])) for it in points) < tolerance


@pytest.mark.slow
@pytest.mark.xdist_group("event_curves")
def test_a_pair_turns_through_its_resonances(single):
    event = single.of_kind("neimark_sacker")[0]
    spans = ((1.25, 1.6), (0.5, 3.0))
    curve = zivi.continue_curve(event, ("omega", "F"), spans, step=0.05)
    known = REFERENCES["NS_1_2"]
    two = curve.of_kind("resonance_1_2")
    assert near(two, float(known["w"]), float(known["F"]), 1e-9)
    assert near(curve.of_kind("resonance_1_3"), 1.50509723238, 2.08626604436, 1e-9)
    # kappa goes through -1, where theta would turn back
    assert curve.kappa.min() < -1.0
    for i in range(0, len(curve), 5):
        if abs(curve.kappa[i]) < 0.99:
            multipliers = curve.orbits(i).multipliers
            assert np.min(np.abs(np.abs(multipliers) - 1.0)) < 1e-8


@pytest.mark.slow
@pytest.mark.xdist_group("event_curves")
def test_points_of_turning_pairs_and_doublings_are_those_of_the_reference(single):
    kinds = {"NS_w1.5": "neimark_sacker", "NS_w1.45": "neimark_sacker"}
    kinds |= {"PD_w1.2": "period_doubling"}
    for name, kind in kinds.items():
        w, force = (float(REFERENCES[name][k]) if k == "F" else 0.0 for k in ("w", "F"))
        w = float(REFERENCES[name]["params"]["w"])
        span = sorted((1.4 if kind == "neimark_sacker" else 1.21, w))
        event = single.of_kind(kind)[0]
        low, high = min(span[0], event.value), max(span[1], event.value)
        curve = (
            zivi.continue_curve(
                event,
                ("omega", "F"),
                ((low - 0.1 * (w > event.value), high), (0.4, 3.0)),
                step=0.05,
            )
            if w > event.value
            else zivi.continue_curve(
                event, ("omega", "F"), ((w, high + 0.1), (0.4, 3.0)), step=0.05
            )
        )
        ends = [row for row in curve.values if abs(row[0] - w) < 1e-12]
        assert ends
        assert min(abs(row[1] - force) for row in ends) < 1e-9


@pytest.mark.slow
@pytest.mark.xdist_group("event_curves")
def test_a_doubling_curve_passes_a_grazing(single):
    event = single.of_kind("period_doubling")[0]
    spans = ((1.0, 1.3), (0.45, 1.2))
    curve = zivi.continue_curve(event, ("omega", "F"), spans, step=0.05)
    known = REFERENCES["PD_grazing"]
    assert near(curve.of_kind("grazing"), float(known["w"]), float(known["F"]), 1e-9)
    assert not curve.admissible.all()
    assert curve.residual.max() < 1e-10


@pytest.mark.slow
@pytest.mark.xdist_group("event_curves")
def test_folds_and_grazings_touch_at_resonant_grazings():
    starts = [
        zivi.periodic_orbit(chain2(w=1.1, F=0.45), (["I stop"], [t])) for t in (0.5, 2.0, 3.6, 5.1)
    ]
    orbit = next(it for it in starts if it.success)
    branch = zivi.continue_orbit(orbit, "F", (0.3, 0.6), step=0.05)
    names, spans = ("omega", "F"), ((0.75, 1.4), (0.05, 0.9))
    folds = zivi.continue_curve(branch.of_kind("fold")[0], names, spans, step=0.05)
    edge = zivi.continue_curve(branch.of_kind("grazing")[0], names, spans, step=0.05)
    touch = [float(it) for it in REFERENCES["degenerate_grazing"]["points_w_F"][1]]
    assert near(folds.of_kind("grazing"), *touch, 1e-9)
    assert near(edge.of_kind("resonant_grazing"), *touch, 1e-9)
    w, force = edge.values.T
    exact = zivi.grazing_curve(chain2(), "stop", w)[:, 1]
    assert np.max(np.abs(force - exact)) < 1e-11
    # the fold of one impact a period, in closed form
    assert branch.of_kind("fold")[0].value == pytest.approx(0.38049430325950496, abs=1e-11)


def test_the_end_of_rest_is_followed_over_the_restitution():
    run = zivi.simulate(table(1.45), (0, 200), (0, 0.1))
    orbit = zivi.periodic_orbit(table(1.45), run)
    branch = zivi.continue_orbit(orbit, "amplitude", (1.3, 1.7))
    event = branch.of_kind("end_of_rest")[0]
    curve = zivi.continue_curve(event, ("amplitude", "e"), ((1, 3), (0.1, 0.9)), step=0.05)
    assert curve.values[:, 1] == pytest.approx(np.arange(1, 10) / 10, abs=1e-12)
    ends = {round(float(e), 9): float(value) for value, e in curve.values}
    for e, value in REFERENCES["end_of_rest"]["points"].items():
        assert ends[float(e)] == pytest.approx(float(value.split()[0]), abs=1e-10)
    # on one side it rests in every period, on the other it does not
    for e in (0.7, 0.8, 0.9):
        for part, rests in ((1 - 1e-3, True), (1 + 1e-3, False)):
            shaken = zivi.LinearForce(gravity=1, amplitude=part * ends[e], phase=-np.pi / 2)
            system = zivi.ImpactSystem(shaken, e=e)
            run = zivi.simulate(system, (0, 60 * np.pi), (0, 0), dense_output=False)
            assert (len(run.liftoff_times) >= 29) == rests, (e, part)


def ends_of_rest(system, span, over):
    n = len(system.M)
    run = zivi.simulate(system, (0, 300), (np.full(n, 2.0), np.zeros(n)))
    branch = zivi.continue_orbit(zivi.periodic_orbit(system, run), "road.amplitude", span, step=0.1)
    event = branch.of_kind("end_of_rest")[0]
    names, spans = ("road.amplitude", "e"), ((1.0, 3.0), over)
    return zivi.continue_curve(event, names, spans, step=0.1)


@pytest.mark.slow
def test_the_end_of_rest_of_a_mechanism_is_that_of_one_mass():
    curve = ends_of_rest(shaker(1.45), (1.4, 1.8), (0.3, 0.6))
    assert curve.status is zivi.OrbitStatus.RANGE_END
    found = {round(float(e), 9): float(value) for value, e in curve.values}
    known = {
        float(e): float(it.split()[0]) for e, it in REFERENCES["end_of_rest"]["points"].items()
    }
    for e in (0.3, 0.5, 0.6):
        assert abs(found[e] - known[e]) < 2e-11
    # the orbits rest as long as the end is near: the multipliers of one mass are zeros
    assert not np.any(curve.orbits(0).multipliers)
    assert curve.admissible.all()
    assert curve.residual.max() < 1e-10


@pytest.mark.slow
def test_the_end_of_rest_of_two_masses_is_followed():
    """On one side a run rests in every period, on the other it does not."""
    system = shaker(1.5, k=0.2, mm=0.05, c=0.1)
    curve = ends_of_rest(system, (1.45, 2.2), (0.48, 0.5))
    assert len(curve) >= 3
    for i in (0, len(curve) - 1):
        amplitude, e = curve.values[i]
        for part, rests in ((1 - 1e-4, True), (1 + 1e-4, False)):
            own = shaker(part * amplitude, e, k=0.2, mm=0.05, c=0.1)
            # from the flight of the orbit before the end
            orbit = curve.orbits(i)
            s = next(k for k, it in enumerate(orbit._word) if it.kind == "Z")
            t0, t1 = orbit.segments[["t0", "t1"]][s]
            tau = 0.5 * (t0 + t1)
            z = orbit._frame.flow.path((), t0, orbit._starts[s, 1:], np.array([tau]))[0]
            state = (z[:2], z[2:])
            run = zivi.simulate(own, (tau, tau + 20 * np.pi), state, dense_output=False)
            late = run.liftoffs[run.liftoffs["t"] > tau + 4 * np.pi]
            assert (len(late) >= 7) == rests, (e, part)
    assert np.count_nonzero(curve.orbits(0).multipliers) == 2


def test_curves_are_drawn_labelled_and_checked(bounces):
    matplotlib = pytest.importorskip("matplotlib")
    matplotlib.use("Agg")
    fold = bounces.of_kind("fold")[0]
    curve = zivi.continue_curve(fold, ("amplitude", "e"), ((0.5, 1.5), (0.4, 0.6)), step=0.1)
    assert zivi.plot.chart([curve], words=True).get_xlabel() == "amplitude"
    assert zivi.plot.curve(curve).get_ylabel() == "e"
    pytest.importorskip("xarray")
    assert curve.to_xarray().attrs["kind"] == "fold"
    with pytest.raises(ValueError, match="two different"):
        zivi.continue_curve(fold, ("e", "e"), ((0, 1), (0, 1)))
    with pytest.raises(ValueError, match="spans"):
        zivi.continue_curve(fold, ("amplitude", "e"), ((0, 0.5), (0, 1)))
    with pytest.raises(ValueError, match="parameter"):
        zivi.continue_curve(fold, ("amplitude", "mass"), ((0, 2), (0, 1)))
    with pytest.raises(TypeError, match="event"):
        zivi.continue_curve(3, ("amplitude", "e"), ((0, 2), (0, 1)))


@pytest.mark.slow
def test_the_end_of_a_contact_is_followed():
    """In a linear system it hangs on the load over the distance of the stop alone."""
    chain = chain2(w=0.7, e=0.0)
    orbit = zivi.periodic_orbit(chain, zivi.simulate(chain, (0, 900), ([0, 0], [0, 0])))
    branch = zivi.continue_orbit(orbit, "omega", (0.66, 0.72))
    (end,) = branch.of_kind("contact_ends")
    # of a computation with 25 digits
    assert abs(end.value - 0.67438862860363725134) < 1e-12
    # after the plastic impact the stop presses on one side of it, on the other it would pull
    for part, impacts in ((1.003, 1), (0.997, 2)):
        system = chain2(w=part * end.value, e=0.0)
        period = 2 * np.pi / (part * end.value)
        run = zivi.simulate(system, (0, 100 * period), ([0, 0], [0, 0]))
        assert np.count_nonzero(run.resolved_impacts["t"] > 99 * period) == impacts
    curve = zivi.continue_curve(end, ("F", "stop.offset"), ((0.7, 1.4), (0.25, 0.4)), step=0.1)
    ratio = curve.values[:, 0] / curve.values[:, 1]
    assert np.max(np.abs(ratio - 1 / 0.3)) < 1e-11
    assert curve.admissible.all()
    assert len(curve) >= 5


def test_two_impacts_at_once_are_followed():
    """Of two oscillators that do not know of each other: each alone hits at the same time."""

    def both(w=1.2, offset=0.3):
        stops = [LinearGap([-1, 0], 0.3, name="a"), LinearGap([0, -1], offset, name="b")]
        load = zivi.Harmonic([1.0, 1.0], w)
        matrices = np.eye(2), 0.2 * np.eye(2), np.diag([1.0, 1.3])
        return zivi.LinearSystem(*matrices, excitation=load, gaps=stops, e=0.6)

    def alone(stiffness, offset, w):
        # x = offset - q
        force = zivi.LinearForce(
            stiffness=stiffness,
            damping=0.2,
            gravity=-stiffness * offset,
            amplitude=1.0,
            omega=w,
            phase=np.pi,
        )
        return zivi.ImpactSystem(force, e=0.6)

    run = zivi.simulate(both(), (0, 500), ([0, 0], [0, 0]))
    branch = zivi.continue_orbit(zivi.periodic_orbit(both(), run), "b.offset", (0.2, 1.2))
    (event,) = branch.of_kind("simultaneous")
    curve = zivi.continue_curve(event, ("b.offset", "omega"), ((0, 1.2), (1.0, 1.5)), step=0.1)
    assert len(curve) >= 5
    assert curve.admissible.all()
    for i in (0, len(curve) // 2, len(curve) - 1):
        offset, w = curve.values[i]
        impacts = curve.orbits(i).impacts
        times = []
        for gap, (stiffness, distance) in enumerate(((1.0, 0.3), (1.3, offset))):
            (guess,) = impacts[impacts["gap"] == gap]
            one = zivi.periodic_orbit(alone(stiffness, distance, w), [(guess["t"], guess["u"])])
            times.append(one.impacts["t"][0])
        turn = (times[0] - times[1]) * w / (2 * np.pi)
        assert abs(turn - round(turn)) < 1e-10


@pytest.mark.slow
def test_a_curve_of_folds_has_a_cusp():
    run = zivi.simulate(chain2(w=1.0), (0, 600), ([0, 0], [0, 0]))
    branch = zivi.continue_orbit(zivi.periodic_orbit(chain2(w=1.0), run), "omega", (0.93, 1.0))
    fold = next(it for it in branch.of_kind("fold") if len(it.orbit.word) == 2)
    curve = zivi.continue_curve(fold, ("omega", "F"), ((0.9, 1.0), (0.55, 1.1)), step=0.02)
    (cusp,) = curve.of_kind("cusp")
    # both of its sides leave it on one side: a smooth curve would go on
    k = int(np.argmin(np.abs(curve.values - cusp.values).sum(axis=1)))
    before, after = curve.values[k - 2] - cusp.values, curve.values[k + 2] - cusp.values
    assert before @ after > 0.9 * np.linalg.norm(before) * np.linalg.norm(after)
    # and its orbit is one of the fold
    assert np.min(np.abs(cusp.orbit.multipliers - 1.0)) < 1e-6


def test_the_grazings_of_an_oscillator_of_one_mass_are_those_of_its_closed_form():
    oscillator = Oscillator(0.05, 0.9, 0.8)
    t, amplitude = oscillator.orbit(0.3)
    orbit = zivi.periodic_orbit(oscillator.system(amplitude), [(t, 0.3)], 1)
    grazes = np.sqrt(oscillator.quadratic[0])
    branch = zivi.continue_orbit(orbit, "amplitude", (0.3 * grazes, 1.5 * amplitude))
    (event,) = branch.of_kind("grazing")
    curve = zivi.continue_curve(event, ("omega", "amplitude"), ((0.8, 1.3), (0.01, 2.0)), step=0.1)
    assert curve.status is zivi.OrbitStatus.RANGE_END
    w, force = curve.values.T
    exact = [np.sqrt(Oscillator(0.05, each, 0.8).quadratic[0]) for each in w]
    assert np.max(np.abs(force - exact)) < 1e-10
    assert w.min() < 0.85
    assert curve.orbits(0).word == ("I wall",)


def test_doublings_of_a_nonlinear_mass_are_those_of_its_simulations():
    def force(t, x, v, a, k):
        return -1 - k * x**3 - 0.1 * v + a * np.sin(t)

    def slopes(t, x, v, a, k):
        return a * np.cos(t), -3 * k * x * x, -0.1, np.sin(t), -(x**3)

    hardening = zivi.ParametricForce(force, {"a": 1.9, "k": 0.02}, slopes)
    system = zivi.ImpactSystem(hardening, e=0.6)
    # beside its two impacts: it is unstable, and runs end near any of several
    orbit = zivi.periodic_orbit(system, [(4.644, 1.578), (5.772, 0.802)], period=2 * np.pi)
    branch = zivi.continue_orbit(orbit, "a", (0.8, 4.0))
    (event,) = branch.of_kind("period_doubling")
    curve = zivi.continue_curve(
        event, ("a", "k"), ((0.5, 5), (0.015, 0.03)), step=0.3, max_points=6
    )
    for i in (0, len(curve) - 1):
        a, k = curve.values[i]
        own = zivi.ImpactSystem(hardening.replace(a=a, k=k), e=0.6)
        start = curve.orbits(i)
        middle, z = start._middle()
        s = zivi.sensitivity(own, (middle, middle + 2 * np.pi), tuple(z), dense_output=False)
        assert np.min(np.abs(np.linalg.eigvals(s.final) + 1.0)) < 1e-6
        end = [s.trajectory.x[-1], s.trajectory.xdot[-1]]
        np.testing.assert_allclose(end, z, atol=1e-7)


def test_the_width_of_a_cycle_is_where_it_grazes():
    """That of van der Pol's cycle, 2.00862 where mu is 1; it grazes a wall that is as far away."""

    def force(t, x, v, c, mu):
        return mu * (1 - (x - c) ** 2) * v - (x - c)

    def slopes(t, x, v, c, mu):
        y = x - c
        return 0.0, -2 * mu * y * v - 1, mu * (1 - y * y), 2 * mu * y * v + 1, (1 - y * y) * v

    cycle = zivi.ParametricForce(force, {"c": 1.9, "mu": 0.5}, slopes)
    orbit = zivi.periodic_orbit(zivi.ImpactSystem(cycle, e=0.7), (0.0, (1.0, 0.0)))
    (event,) = zivi.continue_orbit(orbit, "c", (1.89, 2.1)).of_kind("grazing")
    curve = zivi.continue_curve(event, ("c", "mu"), ((1.9, 2.1), (0.45, 1.0)), step=0.2)
    end = curve.values[np.argmax(curve.values[:, 1])]
    assert end == pytest.approx([2.008619861, 1.0], abs=1e-6)
