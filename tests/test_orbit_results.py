"""What orbits, branches, diagrams and exponents tell of themselves: shapes, statuses, messages."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

import zivi
from inside import (
    PRECISE,
    Path,
    orbits_along as along,
    orbits_attractor as attractor,
    orbits_follow as follow,
    resting_orbit,
)

TURN = 2 * math.pi
STATUS = zivi.OrbitStatus
U = TURN / 3


def table(amplitude: float = 1.3, e: float = 0.5) -> zivi.ImpactSystem:
    force = zivi.LinearForce(gravity=1.0, amplitude=amplitude, phase=-math.pi / 2)
    return zivi.ImpactSystem(force, e=e)


def impacting(amplitude: float = 1.3) -> zivi.PeriodicOrbit:
    return zivi.periodic_orbit(table(amplitude), [(0.6, 2.1)])


def resting() -> zivi.PeriodicOrbit:
    return zivi.periodic_orbit(table(), (0.0, (0.5, 0.0)))


def test_what_an_impacting_orbit_tells():
    orbit = impacting()
    t = math.acos(math.pi / 3 / 1.3)
    assert (orbit.kind, orbit.period, orbit.multiple) == ("impacting", TURN, 1)
    np.testing.assert_allclose(list(orbit.impacts[0]), [t, U, -2 * U, U], rtol=1e-9)
    assert orbit.success
    assert orbit.admissible
    assert orbit.message == "The orbit was found, and a simulation follows it."
    assert orbit.residual < 1e-11
    assert 1 <= orbit.iterations <= 6
    assert (orbit.margin, orbit.zeno_time, orbit.liftoff_time) == (None, None, None)
    told = ", ".join(f"{it:.4g}" for it in orbit.multipliers)
    assert repr(orbit) == (
        f"<PeriodicOrbit impacting, 1 impact in 1 period, multipliers {told}: completed>"
    )
    data = orbit.to_xarray()
    for name, value in (("t", t), ("u", U), ("xdot_before", -2 * U)):
        np.testing.assert_allclose(data[name], [value], rtol=1e-9)
        assert data[name].dims == ("impact",)
    np.testing.assert_array_equal(data.multiplier_real, orbit.multipliers.real)
    np.testing.assert_array_equal(data.multiplier_imag, orbit.multipliers.imag)
    assert data.multiplier_real.dims == data.multiplier_imag.dims == ("multiplier",)
    assert data.attrs == {
        "title": "Periodic orbit", "source": f"zivi {zivi.__version__}",
        "kind": "impacting", "period": TURN, "multiple": 1, "status": "COMPLETED",
    }  # fmt: skip
    run = orbit.trajectory
    assert (run.t[0], run.t[-1]) == (orbit.impacts["t"][0], orbit.impacts["t"][0] + TURN)
    assert (run.x[0], run.xdot[0]) == (0.0, orbit.impacts["u"][0])


@pytest.mark.parametrize("t0", [None, 2.0, 5.0, 30.0])
def test_the_return_map_from_any_time_in_flight(t0):
    orbit = impacting()
    t, h = 2.0 if t0 is None else t0, 1e-6
    matrix = orbit.monodromy(t0)
    np.testing.assert_allclose(np.trace(matrix), orbit.multipliers.sum().real, rtol=1e-8)
    if t0 is None:
        t = orbit.impacts["t"][0] + 0.5 * TURN
        np.testing.assert_allclose(matrix, orbit.monodromy(t), rtol=1e-8)
    start = orbit.trajectory(orbit.impacts["t"][0] + (t - orbit.impacts["t"][0]) % TURN)
    columns = []
    for step in ((h, 0.0), (0.0, h)):
        ends = []
        for side in (1, -1):
            run = zivi.simulate(table(), (t, t + TURN), start + side * np.array(step), PRECISE)
            ends.append(np.array([run.x[-1], run.xdot[-1]]))
        columns.append((ends[0] - ends[1]) / (2 * h))
    np.testing.assert_allclose(matrix, np.array(columns).T, rtol=1e-5, atol=1e-6)


def test_what_a_resting_orbit_tells():
    orbit = resting()
    lift = math.asin(1 / 1.3)
    assert orbit.liftoff_time == pytest.approx(lift, abs=1e-12)
    assert orbit.margin == pytest.approx(lift + TURN - orbit.zeno_time)
    assert orbit.stable
    assert (orbit.residual < 1e-11, orbit.iterations, orbit.depth) == (True, 0, math.inf)
    assert orbit.message == "The motion rests and lifts off again at the same phase."
    assert orbit.trajectory.t[0] == orbit.liftoff_time
    assert (orbit.trajectory.x[0], orbit.trajectory.xdot[0]) == (0.0, 0.0)
    np.testing.assert_allclose(orbit.monodromy(), 0, atol=1e-12)
    np.testing.assert_array_equal(orbit.impacts["u"], orbit.impacts["xdot_after"])
    np.testing.assert_allclose(orbit.impacts["u"], -0.5 * orbit.impacts["xdot_before"], rtol=1e-9)
    assert lift < orbit.impacts["t"][0] < orbit.zeno_time


def test_motions_that_do_not_rest_again():
    never = resting_orbit(table(0.9), PRECISE, TURN)
    assert (never.status, never.admissible, never.success) == (STATUS.RESTS, True, False)
    assert never.message == "The mass rests and never lifts off."
    assert (never.residual, never.stable) == (0.0, True)
    up = zivi.ImpactSystem(zivi.LinearForce(gravity=-1.0, amplitude=0.5), e=0.5)
    none = resting_orbit(up, PRECISE, TURN)
    assert none.status is STATUS.NOT_CONVERGED
    assert none.message == "The mass never stays at rest."
    assert np.isnan(none.multipliers).all()
    assert (none.residual, none.admissible) == (math.inf, False)
    far = resting_orbit(table(2.5), PRECISE, TURN, 0.0, 1)
    assert far.status is STATUS.NOT_CONVERGED
    assert far.message == "The motion after the lift-off does not rest again within 1 periods."
    with pytest.raises(ValueError, match="no orbit was found: The motion after"):
        _ = far.trajectory
    with pytest.raises(ValueError, match="no orbit was found: The motion after"):
        far.derivative("amplitude")


def test_what_a_branch_tells():
    branch = zivi.continue_orbit(impacting(), "amplitude", (1.0, 1.6))
    fold, doubling = branch.events
    assert len(branch) == len(branch.orbits) == len(branch.values)
    assert branch.of_kind("fold") == [fold]
    assert branch.of_kind("nothing") == []
    assert repr(branch) == (
        f"<Branch of {len(branch)} orbits over amplitude: fold at {fold.value:.9g}, "
        f"period_doubling at {doubling.value:.9g}; range_end>"
    )
    assert branch.message == "The branch was followed to the ends of the range."
    assert branch.multipliers.shape == (len(branch), 2)
    np.testing.assert_array_equal(branch.stable, [it.stable for it in branch.orbits])
    np.testing.assert_array_equal(branch.admissible, [it.admissible for it in branch.orbits])
    assert branch.admissible.all()
    assert branch.switch(fold) is fold.orbit
    # from one end of the range, round the fold, to the other
    assert branch.values[0] == branch.values[-1] == pytest.approx(1.6, rel=1e-12)
    assert not branch.stable[0]
    data = branch.to_xarray()
    np.testing.assert_array_equal(data.amplitude, branch.values)
    np.testing.assert_allclose(data.u, U, rtol=1e-9)
    np.testing.assert_array_equal(data.t, [it.impacts["t"][0] for it in branch.orbits])
    np.testing.assert_array_equal(data.stable, branch.stable)
    np.testing.assert_array_equal(data.admissible, branch.admissible)
    np.testing.assert_array_equal(data.multiplier_real, branch.multipliers.real)
    np.testing.assert_array_equal(data.multiplier_imag, branch.multipliers.imag)
    assert data.multiplier_real.dims == data.multiplier_imag.dims == ("point", "multiplier")
    assert data.u.dims == data.t.dims == data.stable.dims == data.amplitude.dims == ("point",)
    assert data.attrs == {
        "title": "Branch of periodic orbits",
        "source": f"zivi {zivi.__version__}",
        "status": "RANGE_END",
        "events": ["fold", "period_doubling"],
        "event_values": [fold.value, doubling.value],
    }
    middle = branch.orbits[len(branch) // 2]
    assert middle.message == "A point of a branch."
    assert middle.residual < 1e-10


def test_a_branch_counts_the_orbits_that_failed():
    branch = zivi.continue_orbit(impacting(), "amplitude", (1.0, 1.6))
    one, two, *rest = branch.orbits
    failed = dataclasses.replace(one, status=STATUS.LEFT_ADMISSIBLE)
    unknown = dataclasses.replace(two, multipliers=np.full(2, np.nan))
    n, found = len(branch), dataclasses.replace(branch, orbits=[failed, unknown, *rest])
    told = f"1 of {n} orbits with a status (1 left_admissible), 1 of {n} orbits without multipliers"
    assert repr(found).endswith(f", {told}; range_end>")
    assert told in found._repr_html_()
    assert along.failed_text(found.orbits) == told
    assert along.with_failed("It ended.", told) == f"It ended. {told}."
    assert along.with_failed("It ended.", along.failed_text(branch.orbits)) == "It ended."


def test_the_message_of_every_branch_counts_them(monkeypatch):
    """Of one mass, at rest or not, and of a mechanism."""
    monkeypatch.setattr(follow, "failed_text", lambda orbits: f"some of {len(orbits)} failed")
    system = zivi.LinearSystem(
        *(1.0, 0.1, 1.0),
        excitation=zivi.Harmonic([0.1], 0.8),
        gaps=[zivi.LinearGap([-1.0], 1.0)],
        e=0.5,
    )
    flight = zivi.periodic_orbit(system, (["P"], [[0.0, 0.0, 0.0]]))
    branch = zivi.continue_orbit(flight, "omega", (0.7, 0.9), step=0.2)
    assert branch.message.endswith(f" Some of {len(branch)} failed.")
    for orbit in (impacting(), resting()):
        branch = zivi.continue_orbit(orbit, "amplitude", (1.2, 1.4))
        assert branch.message.endswith(f" Some of {len(branch)} failed.")


def test_branches_of_flights_and_of_few_points():
    force = zivi.LinearForce(stiffness=1.0, damping=0.1, gravity=-2.0, amplitude=0.3, omega=0.7)
    orbit = zivi.periodic_orbit(zivi.ImpactSystem(force, e=0.5), (0.0, (2.5, 0.0)))
    branch = zivi.continue_orbit(orbit, "amplitude", (0.2, 0.4))
    assert repr(branch) == f"<Branch of {len(branch)} orbits over amplitude: no events; range_end>"
    data = branch.to_xarray()
    assert np.isnan(data.t).all()
    assert np.isnan(data.u).all()
    assert branch.status is STATUS.RANGE_END
    few = zivi.continue_orbit(impacting(), "amplitude", (1.1, 1.6), max_points=4)
    assert few.status is STATUS.MAX_POINTS
    assert len(few) <= 4
    assert few.message == "The branch has max_points points."
    span = (1.2, 1.5)
    short, long = (
        len(zivi.continue_orbit(impacting(), "amplitude", span, step=it)) for it in (0.01, 0.1)
    )
    assert short > 2 * long
    # the value may be an end of the range
    one = zivi.continue_orbit(impacting(), "amplitude", (1.3, 1.4))
    assert one.values.min() == 1.3
    assert one.values.max() == pytest.approx(1.4, rel=1e-12)


def test_what_cannot_be_continued():
    orbit = impacting()
    for span in ((1.4, 1.5), (1.0, 1.2), (1.3, 1.3)):
        with pytest.raises(ValueError, match=r"span must contain amplitude = 1\.3"):
            zivi.continue_orbit(orbit, "amplitude", span)
    for step in (0.0, 1.0, -0.1):
        with pytest.raises(ValueError, match=r"step must be in \(0, 1\)"):
            zivi.continue_orbit(orbit, "amplitude", (1.2, 1.4), step=step)
    with pytest.raises(ValueError, match="max_points must be >= 2, got 1"):
        zivi.continue_orbit(orbit, "amplitude", (1.2, 1.4), max_points=1)
    assert len(zivi.continue_orbit(orbit, "amplitude", (1.2, 1.4), max_points=2)) >= 1
    lost = zivi.periodic_orbit(table(0.9), [(0.6, 2.1)])
    with pytest.raises(ValueError, match="orbit was not found: Newton's iteration did not"):
        zivi.continue_orbit(lost, "amplitude", (0.8, 1.0))
    for bad, match in (
        ({"multiple": 0}, "multiple must be >= 1, got 0"),
        ({"max_iter": 0}, "max_iter must be >= 1, got 0"),
    ):
        with pytest.raises(ValueError, match=match):
            zivi.periodic_orbit(table(), [(0.6, 2.1)], **bad)
    with pytest.raises(TypeError, match="SwitchedRK"):
        zivi.periodic_orbit(table(), [(0.6, 2.1)], method=zivi.ThetaGamma(0.1))
    short = zivi.periodic_orbit(table(), [(0.9, 2.5)], max_iter=1)
    assert short.status is STATUS.NOT_CONVERGED
    assert "did not converge in 1 steps: the residual is" in short.message


def test_a_resting_branch_between_the_ends_of_a_range():
    branch = zivi.continue_orbit(resting(), "amplitude", (1.2, 1.4), step=0.25)
    np.testing.assert_allclose(branch.values[[0, -1]], [1.2, 1.4])
    assert np.all(np.diff(branch.values) > 0)
    assert 1.3 in branch.values
    assert len(branch) <= 7
    assert branch.status is STATUS.RANGE_END
    assert branch.events == []
    assert branch.n_flights <= 120
    margins = [it.margin for it in branch.orbits]
    assert sorted(margins, reverse=True) == margins
    few = zivi.continue_orbit(resting(), "amplitude", (1.2, 1.4), step=0.01, max_points=4)
    assert few.status is STATUS.MAX_POINTS
    assert len(few) == 4


def test_runs_that_are_batches_and_runs_one_by_one_settle_on_the_same():
    states = np.array([[0.3, 1.9], [0.5, 0.0]])
    method = zivi.SwitchedRK(rtol=1e-8, atol=1e-10)
    for transient in (0, 60):
        together = attractor.settle([table()] * 2, states, [TURN] * 2, transient, 8, method)
        for state, found in zip(states, together, strict=True):
            alone = attractor.settle_one(table(), tuple(state), TURN, transient, 8, method)
            np.testing.assert_allclose(found.impacts, alone.impacts, atol=1e-7)
            np.testing.assert_allclose(found.zeno_times, alone.zeno_times, atol=1e-7)
            np.testing.assert_allclose(found.liftoff_times, alone.liftoff_times, atol=1e-7)
            np.testing.assert_allclose(found.end, alone.end, atol=1e-6)
            assert (found.rests, found.success) == (alone.rests, alone.success)
            if transient:
                run = zivi.simulate(table(), (0, 68 * TURN), state, method)
                last = run.resolved_impacts["t"] - 60 * TURN
                np.testing.assert_allclose(found.impacts[:, 0], last[last > 0], atol=1e-5)


def test_runs_that_fail_are_told():
    short = zivi.SwitchedRK(max_steps=5, flights="rk")
    for transient in (0, 20):
        alone = attractor.settle_one(table(), (0.3, 1.9), TURN, transient, 8, short)
        assert not alone.success
        (batch,) = attractor.settle([table()], np.array([[0.3, 1.9]]), [TURN], transient, 8, short)
        assert not batch.success
        assert attractor.classify(table(), alone, TURN, 8).kind == "failed"


def test_exponents_tell_how_they_were_found():
    found = zivi.lyapunov_exponents(table(), (0, 300), (0.1, 2.0), transient=100)
    assert found.status is STATUS.COMPLETED
    assert found.success
    times = found.trajectory.impacts["t"]
    counted = times[times >= 100]
    assert found.n_impacts == len(counted) - 1
    assert found.duration == counted[-1] - counted[0]
    # without damping their sum is known
    u = found.trajectory.impacts["xdot_after"][times >= 100]
    total = (2 * found.n_impacts * math.log(0.5) + math.log(u[0] / u[-1])) / found.duration
    assert found.exponents.sum() == pytest.approx(total, rel=1e-9)
    rests = zivi.lyapunov_exponents(table(), (0, 100), (0.5, 0.0))
    assert (rests.status, rests.success) == (STATUS.RESTS, False)
    assert rests.exponents.tolist() == [-math.inf, -math.inf]
    assert (rests.duration, rests.n_impacts) == (0.0, len(rests.trajectory.impacts))
    ended = zivi.lyapunov_exponents(
        table(), (0, 100), (0.1, 2.0), method=zivi.SwitchedRK(max_steps=5, flights="rk")
    )
    assert ended.status is STATUS.RUN_ENDED
    assert np.isnan(ended.exponents).all()
    assert (ended.duration, ended.n_impacts) == (0.0, 0)
    for bad in (-1.0, 100.0):
        with pytest.raises(ValueError, match="transient must be >= 0 and shorter"):
            zivi.lyapunov_exponents(table(), (0, 100), (0.1, 2.0), bad)
    # a rest before the transient is over does not count
    late = zivi.lyapunov_exponents(table(1.5), (0, 400), (0.1, 2.0), transient=300)
    assert late.success


def test_basins_with_known_orbits():
    known = [resting(), impacting()]
    found = zivi.basins(
        table(), np.linspace(0, 2, 4), np.linspace(-2, 2, 3), known, transient=150, keep=8
    )
    assert [it.kind for it in found.attractors[:2]] == ["resting", "impacting"]
    assert found.label.shape == (3, 4)
    assert set(found.label.ravel()) == {0, 1}
    assert len(found.attractors) == 2
    for i, v in enumerate(found.v0s):
        for j, x in enumerate(found.x0s):
            run = zivi.simulate(table(), (0, 150 * TURN), (x, v))
            rests = len(run.zeno_times) > 0 and run.zeno_times[-1] > 140 * TURN
            assert found.label[i, j] == (0 if rests else 1)
    with pytest.raises(TypeError, match=r"attractors must be zivi\.PeriodicOrbit"):
        zivi.basins(table(), [0.0], [1.0], [1.0])
    for bad in (([], [0.0]), ([-1.0], [0.0]), ([0.0], [])):
        with pytest.raises(ValueError, match="x0s and v0s must hold numbers"):
            zivi.basins(table(), *bad)
    for settings in ({"transient": -1}, {"keep": 1}):
        with pytest.raises(ValueError, match="transient must be >= 0 and keep >= 2"):
            zivi.basins(table(), [0.0], [0.0], **settings)
    with pytest.raises(ValueError, match="tolerance must be > 0"):
        zivi.basins(table(), [0.0], [0.0], tolerance=0.0)


def test_diagrams_of_impacts_and_of_states():
    settings = {"starts": (0.3, 1.9), "transient": 150, "keep": 5}
    values = [1.3, 1.6]
    impacts = zivi.bifurcation_diagram(table(), "amplitude", values, **settings)
    assert (impacts.name, impacts.section) == ("amplitude", "impacts")
    phase = math.acos(math.pi / 3 / 1.3) / TURN
    own = impacts.run == 0
    np.testing.assert_allclose(impacts.first[own], phase, atol=1e-6)
    np.testing.assert_allclose(impacts.second[own], U, atol=1e-6)
    assert own.sum() == 5
    np.testing.assert_array_equal(impacts.value, np.array(values)[impacts.run])
    np.testing.assert_array_equal(impacts.run_value, values)
    np.testing.assert_array_equal(impacts.run_start, [0, 0])
    assert [it.multiple for it in impacts.attractors] == [1, 2]
    strobe = zivi.bifurcation_diagram(table(), "amplitude", values, "strobe", **settings)
    assert len(strobe.first) == 10
    state = impacting().trajectory(TURN)
    np.testing.assert_allclose(strobe.first[:5], state[0], atol=1e-6)
    np.testing.assert_allclose(strobe.second[:5], state[1], atol=1e-6)
    assert [it.multiple for it in strobe.attractors] == [1, 2]
    for bad, match in (
        ({"values": []}, "values must be finite numbers"),
        ({"values": [math.nan]}, "values must be finite numbers"),
        ({"section": "all"}, "section must be 'impacts' or 'strobe', got 'all'"),
        ({"keep": 1}, "transient must be >= 0 and keep >= 2, got 150 and 1"),
        ({"transient": -1}, "transient must be >= 0"),
        ({"starts": "lead"}, "starts must be states or 'follow', got 'lead'"),
        ({"starts": [1.0, 2.0, 3.0]}, r"rows \(x0, xdot0\), got shape \(1, 3\)"),
    ):
        with pytest.raises(ValueError, match=match):
            zivi.bifurcation_diagram(table(), "amplitude", **({"values": [1.3]} | settings | bad))


@pytest.mark.parametrize("multiple", [1, 2, 4])
def test_steps_are_shorter_for_orbits_of_many_periods(multiple):
    # the doublings come closer, 4.67 times each: so do the first points of a branch
    amplitude = {1: 1.3, 2: 1.6, 4: 1.69}[multiple]
    run = zivi.simulate(table(amplitude), (0, 2400), (0.1, 2.0))
    orbit = zivi.periodic_orbit(table(amplitude), run)
    assert orbit.multiple == multiple
    branch = zivi.continue_orbit(orbit, "amplitude", (1.25, 1.75), step=0.03, max_points=4)
    path = Path(orbit._frame, "amplitude", orbit._y, 0.5)
    pairs = zip(branch.orbits, branch.values, strict=True)
    z = [path.scaled(it._y, value) for it, value in pairs]
    first = int(np.flatnonzero(branch.values == amplitude)[0])
    beside = np.linalg.norm(z[first] - z[first + (1 if first == 0 else -1)])
    assert beside == pytest.approx(0.03 / 3 ** math.log2(multiple), rel=0.02)


def test_a_doubled_orbit_is_followed_away_from_its_beginning_only():
    branch = zivi.continue_orbit(impacting(1.5), "amplitude", (1.4, 1.6))
    doubled = branch.switch(branch.of_kind("period_doubling")[0])
    value = doubled.system.force.amplitude
    # half the difference of the speeds grows like the root of the distance
    away = zivi.continue_orbit(doubled, "amplitude", (1.4, 1.58))
    assert away.values[0] == value
    assert np.all(np.diff(away.values) > 0)
    apart = [abs(np.diff(it.impacts["u"])[0]) for it in away.orbits]
    assert np.all(np.diff(apart) > 0)
    doubling = math.hypot(math.pi / 3, 10 / 9)
    ratio = np.array(apart[1:]) ** 2 / (away.values[1:] - doubling)
    assert ratio.max() < 1.5 * ratio.min()
    assert away.events == []
    # the method travels with the orbit
    assert doubled._frame.method is branch.orbits[0]._frame.method
    assert doubled._frame.free is False


def test_a_diagram_over_e_stays_within_its_range():
    mass = table()
    stop = zivi.LinearGap([1.0], name="stop")
    linear = zivi.LinearSystem(1.0, 0.1, 1.0, excitation=zivi.Harmonic([1.0], 1.0), gaps=[stop])
    for system in (mass, linear):
        with pytest.raises(ValueError, match=r"e must lie in \[0, 1\], got 1\.2"):
            zivi.bifurcation_diagram(system, "e", [0.5, 1.2], transient=1, keep=2)
