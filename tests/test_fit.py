"""`zivi.fit`: parameters from samples and bounce times, with uncertainty."""

import math
import pickle
import signal
import subprocess
import sys
import textwrap

import numpy as np
import pytest
import scipy.optimize

import zivi
from inside import SPURIOUS, align, geometric_indices

BALL = zivi.ImpactSystem(zivi.LinearForce(gravity=9.81, damping=0.0), e=0.6)
FALL = math.sqrt(2.0 / 9.81)


def bounce_times(e, number, height=1.0, gravity=9.81):
    """Times of the impacts of a dropped ball without drag, in closed form."""
    fall = math.sqrt(2.0 * height / gravity)
    return fall + np.concatenate([[0.0], np.cumsum(2.0 * fall * e ** np.arange(1.0, number))])


def heights(t, e, height=1.0, gravity=9.81):
    """Heights of the same ball."""
    impacts = bounce_times(e, 60, height, gravity)
    speeds = math.sqrt(2.0 * gravity * height) * e ** np.arange(1.0, 61.0)
    k = np.searchsorted(impacts, t, side="right") - 1
    since = t - impacts[k]
    flight = speeds[k] * since - gravity * since**2 / 2
    return np.where(k < 0, height - gravity * np.asarray(t) ** 2 / 2, np.maximum(flight, 0.0))


def brute_alignment(measured, predicted, sigma, missed, spurious):
    """Least cost over all alignments, by recursion."""

    def least(i, j):
        if i == len(measured):
            return missed**2 * sum(it < measured[-1] for it in predicted[j:])
        options = [spurious**2 + least(i + 1, j)]
        if j < len(predicted):
            apart = ((predicted[j] - measured[i]) / sigma) ** 2
            options += [apart + least(i + 1, j + 1), missed**2 + least(i, j + 1)]
        return min(options)

    return least(0, 0)


@pytest.mark.parametrize("seed", range(20))
def test_alignment_has_the_least_cost_of_all(seed):
    rng = np.random.default_rng(seed)
    predicted = np.cumsum(rng.uniform(0.2, 1.0, 6))
    measured = np.sort(np.append(predicted[rng.random(6) < 0.7], rng.uniform(0, 3, 2)))
    measured = measured + 0.02 * rng.standard_normal(len(measured))
    measured.sort()
    found = align(measured, predicted, np.full(len(measured), 0.05), 2.0, 3.0)
    kept = found.index != SPURIOUS
    apart = (predicted[found.index[kept]] - measured[kept]) / 0.05
    cost = np.sum(apart**2) + 4.0 * found.missed + 9.0 * found.spurious
    assert cost == pytest.approx(brute_alignment(measured, predicted, 0.05, 2.0, 3.0), rel=1e-9)
    assert np.all(np.diff(found.index[kept]) > 0)


def test_intervals_alone_tell_missed_and_spurious_bounces():
    times = bounce_times(0.78, 12)
    seen = np.sort(np.append(np.delete(times, [3, 7]), 1.9))
    best = geometric_indices(seen, np.full(len(seen), 1e-3), 3.0, 3)[0]
    np.testing.assert_array_equal(best, [0, 1, 2, SPURIOUS, 4, 5, 6, 8, 9, 10, 11])


def test_bounces_give_the_closed_form_restitution_and_its_deviation():
    rng = np.random.default_rng(0)
    times = bounce_times(0.78, 8) + 1e-3 * rng.standard_normal(8)
    fit = zivi.fit(BALL, zivi.Bounces(times, sigma=1e-3), "e", y0=(1, 0), starts=4)

    def misfit(e):
        return (bounce_times(e[0], 8) - times) / 1e-3

    other = scipy.optimize.least_squares(misfit, [0.7], xtol=1e-14, ftol=1e-14, gtol=1e-14)
    assert fit.values["e"] == pytest.approx(other.x[0], abs=1e-7)
    std = 1.0 / np.linalg.norm(other.jac)
    assert fit.std["e"] == pytest.approx(std, rel=1e-3)
    assert (fit.found, fit.starts, fit.success) == (4, 4, True)
    low, high = fit.interval(0.95)["e"]
    assert high - low == pytest.approx(2 * 1.959964 * std, rel=1e-3)
    np.testing.assert_allclose(fit.residuals, -1e-3 * other.fun, atol=1e-9)


@pytest.mark.parametrize("seed", range(5))
def test_missed_and_spurious_bounces_are_found(seed):
    rng = np.random.default_rng(seed)
    times = bounce_times(0.78, 12) + 1e-3 * rng.standard_normal(12)
    lost = rng.choice(12, 2, replace=False)
    seen = np.sort(np.append(np.delete(times, lost), rng.uniform(0, times[-1])))
    ball = BALL.replace(damping=0.2)
    names = ("e", "damping")
    whole = zivi.fit(ball, zivi.Bounces(times, sigma=1e-3), names, y0=(1, 0), starts=1)
    fit = zivi.fit(ball, zivi.Bounces(seen, sigma=1e-3), names, y0=(1, 0), starts=2)
    assert np.all(np.abs(fit.x - whole.x) < 3 * whole.deviations)
    assert np.count_nonzero(fit.matches[0] == SPURIOUS) <= 1
    assert "missed" in str(fit)


def test_a_film_gives_four_parameters_from_a_bad_start():
    t = np.linspace(0.02, 3.0, 80)
    rng = np.random.default_rng(2)
    film = zivi.Record(t, heights(t, 0.7, 0.8) + 2e-3 * rng.standard_normal(80), 2e-3)
    far = BALL.replace(e=0.95, damping=1.2, gravity=17.0)
    bounds = {"x0": (0.2, 2.5), "e": (0.1, 0.97), "damping": (0, 1.5), "gravity": (4, 20)}
    fit = zivi.fit(far, film, tuple(bounds), y0=(2.2, 0), bounds=bounds, starts=1)
    truth = np.array([0.8, 0.7, 0.0, 9.81])
    free = np.isfinite(fit.deviations)
    assert np.all(np.abs(fit.x - truth)[free] < 4 * fit.deviations[free])
    assert 2 * fit.cost / fit.degrees_of_freedom == pytest.approx(1.0, abs=0.5)


def test_a_parameter_at_its_bound_is_said():
    t = np.linspace(0.02, 2.0, 60)
    film = zivi.Record(t, heights(t, 0.7), 2e-3)
    ball = BALL.replace(damping=0.5)
    fit = zivi.fit(ball, film, ("e", "damping"), y0=(1, 0), bounds={"damping": (0.1, 2)}, starts=1)
    assert fit.at_bound == {"damping": 0.1}
    assert math.isnan(fit.std["damping"])
    assert "damping is at its bound 0.1" in str(fit)


def test_directions_that_data_do_not_determine_are_named():
    t = np.linspace(0.01, 0.4, 30)  # before the first impact
    film = zivi.Record(t, heights(t, 0.7), 1e-3)
    fit = zivi.fit(BALL, film, ("e", "gravity"), y0=(1, 0), starts=1)
    assert fit.undetermined == (("e",),)
    assert fit.std["e"] == math.inf
    assert fit.values["gravity"] == pytest.approx(9.81, abs=1e-6)
    assert "e is not determined by these data" in fit.notes

    def spring(m, k):
        return zivi.LinearSystem([[m]], None, [[k]], coordinates=["x"])

    system = zivi.ParametricSystem(spring, {"m": 1.0, "k": 3.0})
    data = zivi.Record(t * 10, np.cos(2 * t * 10), 1e-3)
    both = zivi.fit(system, data, ("m", "k"), y0=([1.0], [0.0]), starts=1)
    assert "m and k are not determined separately by these data" in both.notes
    assert both.values["k"] / both.values["m"] == pytest.approx(4.0, rel=1e-4)


def test_unknown_deviations_are_estimated_and_widen_by_student():
    t = np.linspace(0.02, 2.0, 40)
    rng = np.random.default_rng(5)
    noise = 3e-3 * rng.standard_normal(40)
    fits = [
        zivi.fit(BALL, zivi.Record(t, heights(t, 0.7) + noise, sigma), "e", y0=(1, 0), starts=1)
        for sigma in (3e-3, None)
    ]
    assert fits[0].values["e"] == pytest.approx(fits[1].values["e"], abs=1e-6)
    scale = math.sqrt(2 * fits[0].cost / 39)
    assert fits[1].sigmas[0][0] == pytest.approx(3e-3 * scale, rel=1e-3)
    assert fits[1].std["e"] == pytest.approx(scale * fits[0].std["e"], rel=1e-3)
    width = np.ptp(fits[1].interval(0.95)["e"]) / fits[1].std["e"]
    assert width == pytest.approx(2 * 2.022691, rel=1e-3)  # Student, 39 degrees of freedom


def test_outliers_need_a_robust_loss():
    t = np.linspace(0.02, 2.0, 60)
    rng = np.random.default_rng(6)
    values = heights(t, 0.7) + 2e-3 * rng.standard_normal(60)
    values[[7, 23, 41]] += 0.4
    data = zivi.Record(t, values, 2e-3)
    robust = zivi.fit(BALL, data, ("e", "x0"), y0=(0.9, 0), loss="soft_l1", starts=1)
    assert robust.values["e"] == pytest.approx(0.7, abs=4 * robust.std["e"])
    assert robust.values["x0"] == pytest.approx(1.0, abs=4 * robust.std["x0"])
    plain = zivi.fit(BALL, data, ("e", "x0"), y0=(0.9, 0), starts=1)
    assert abs(plain.values["x0"] - 1) > 3 * abs(robust.values["x0"] - 1)


def test_a_loss_with_local_minima_of_its_own_is_approached_by_a_convex_one():
    t = np.linspace(0.05, 3.0, 80)
    values = heights(t, 0.78) + 2e-3 * np.random.default_rng(1).standard_normal(80)
    values[::9] += 0.3
    data = zivi.Record(t, values, 2e-3)
    fit = zivi.fit(BALL, data, ("e", "x0"), y0=(1, 0), loss="arctan", starts=2)
    assert fit.values["e"] == pytest.approx(0.78, abs=5e-4)
    assert fit.found == 2


def test_a_prior_is_a_measurement():
    times = bounce_times(0.78, 6)
    data = zivi.Bounces(times, sigma=1e-3)
    free = zivi.fit(BALL, data, "e", y0=(1, 0), starts=1)
    std = free.std["e"]
    held = zivi.fit(BALL, data, "e", y0=(1, 0), prior={"e": (0.78 + 2 * std, std)}, starts=1)
    assert held.values["e"] == pytest.approx(0.78 + std, abs=0.02 * std)
    assert held.std["e"] == pytest.approx(std / math.sqrt(2), rel=2e-2)


def test_clock_bias_and_initial_state_are_parameters():
    t = np.linspace(0.3, 2.5, 70)
    values = heights(t - 0.2, 0.7, 0.8) + 0.05
    data = zivi.Record(t, values, 1e-3)
    names = ("e", "x0", "t0", "bias")
    fit = zivi.fit(BALL, data, names, y0=(1.0, 0), t0=0.1, starts=1)
    assert np.allclose(fit.x, [0.7, 0.8, 0.2, 0.05], atol=1e-5)
    clock = zivi.Bounces(bounce_times(0.7, 8) + 0.03, sigma=1e-3)
    fit = zivi.fit(BALL, clock, ("e", "bias"), y0=(1.0, 0), starts=1)
    assert np.allclose(fit.x, [0.7, 0.03], atol=1e-6)


def test_experiments_share_parameters_and_have_their_own():
    low, high = (zivi.Bounces(bounce_times(0.7, 8, h), sigma=1e-3) for h in (0.5, 1.5))
    runs = [zivi.Experiment(low, y0=(0.6, 0)), zivi.Experiment(high, y0=(1.3, 0))]
    fit = zivi.fit(BALL, runs, ("e",), own=("x0",), starts=1)
    assert fit.names == ("e", "x0@0", "x0@1")
    assert np.allclose(fit.x, [0.7, 0.5, 1.5], atol=1e-6)
    assert len(fit.trajectories) == len(fit.residuals) == 2


def test_bounces_of_two_experiments_are_matched_together():
    clicks = zivi.Bounces(bounce_times(0.78, 12), sigma=1e-3)
    runs = [zivi.Experiment(clicks, y0=(height, 0)) for height in (1.0, 1.1)]
    ball, prior = BALL.replace(damping=0.05), {"e": (0.8, 0.1)}
    fit = zivi.fit(ball, runs, ("e", "damping"), own="x0", prior=prior, starts=1)
    assert np.allclose(fit.x, [0.78, 0.0, 1.0, 1.0], atol=1e-4)
    assert fit.missed == 0


def test_deviations_that_are_too_small_are_said_and_do_not_make_bounces_spurious():
    times = bounce_times(0.78, 8) + 1e-3 * np.random.default_rng(0).standard_normal(8)
    known = zivi.fit(BALL, zivi.Bounces(times, 1e-3), "e", y0=(1, 0), starts=1)
    fit = zivi.fit(BALL, zivi.Bounces(times, 3e-5), "e", y0=(1, 0), starts=1)
    assert abs(fit.values["e"] - known.values["e"]) < 4 * known.std["e"]
    assert np.count_nonzero(fit.matches[0] == SPURIOUS) <= 4
    assert any("times the given sigma" in note for note in fit.notes)
    assert not any("given sigma" in note for note in known.notes)
    held = zivi.fit(
        BALL, zivi.Bounces(times, 1e-3), "e", y0=(1, 0), bounds={"e": (0, 0.7)}, starts=1
    )
    assert held.at_bound == {"e": 0.7}


def test_the_force_of_a_mass_on_its_wall_and_its_distance_are_fitted():
    table = zivi.HarmonicWall(amplitude=0.009, omega=20.0, phase=0.0)
    ball = zivi.ImpactSystem(zivi.LinearForce(gravity=9.0), e=0.3, wall=table)
    t = np.linspace(1.0, 3.0, 40)
    data = zivi.Record(t, 9.81 - 0.01 * 20.0**2 * np.cos(20.0 * t), 1e-2, of="reaction")
    fit = zivi.fit(ball, data, ("gravity", "wall.amplitude"), y0=(0.1, 0), starts=1)
    assert np.allclose(fit.x, [9.81, 0.01], atol=1e-6)
    t = np.linspace(0.05, 2.0, 40)
    data = zivi.Record(t, heights(t, 0.78), 1e-3, of="wall")
    fit = zivi.fit(BALL, data, "e", y0=(1, 0), starts=1)
    assert fit.values["e"] == pytest.approx(0.78, abs=1e-6)


def drop(floor):
    gap = zivi.LinearGap([1.0], -floor, name="floor")
    return zivi.MechanicalSystem(mass=1.0, force=[-9.81], gaps=[gap], e=0.55, coordinates=["x"])


@pytest.mark.parametrize("of", ["x", "floor", lambda t, q, qdot: 2 * q[0] + t])
def test_quantities_of_mechanisms(of):
    t = np.linspace(0.01, 1.2, 40)
    x = 0.1 + heights(t, 0.6)
    known = {"x": x, "floor": x - 0.1}
    data = zivi.Record(t, known[of] if isinstance(of, str) else 2 * x + t, 1e-3, of=of)
    system = zivi.ParametricSystem(drop, {"floor": 0.05})
    fit = zivi.fit(system, data, ("e", "floor", "q0[0]"), y0=([1.08], [0.0]), starts=1)
    assert fit.values["e"] == pytest.approx(0.6, abs=1e-5)
    assert fit.values["q0[0]"] - fit.values["floor"] == pytest.approx(1.0, abs=1e-5)
    # a gap does not tell where the floor is
    assert fit.undetermined == ((("floor", "q0[0]"),) if of == "floor" else ())


def test_velocities_are_fitted():
    t = np.linspace(0.02, 1.2, 40)
    speeds = (heights(t + 1e-6, 0.6) - heights(t - 1e-6, 0.6)) / 2e-6
    data = zivi.Record(t, speeds, 1e-2, of="xdot")
    system = zivi.ParametricSystem(drop, {"floor": 0.0})
    fit = zivi.fit(system, data, ("e", "qdot0.x"), y0=([1.0], [0.01]), starts=1)
    assert np.allclose(fit.x, [0.6, 0.0], atol=1e-5)


def test_a_contact_force_and_a_belt_are_fitted_by_differences():
    def press(load):
        gap = zivi.LinearGap([1.0], name="floor")
        return zivi.MechanicalSystem(mass=2.0, force=[-load], gaps=[gap], e=0.0)

    t = np.linspace(0.0, 1.0, 12)
    data = zivi.Record(t, np.full(12, 7.0), 1e-2, of="reaction")
    system = zivi.ParametricSystem(press, {"load": 5.0})
    fit = zivi.fit(system, data, "load", y0=([0.0], [0.0]), starts=1)
    assert fit.values["load"] == pytest.approx(7.0, abs=1e-6)
    assert fit.differenced
    assert "differences" in str(fit)

    def belt(k, slip, static, v):
        rub = zivi.DryFriction(limit=slip, static=static, velocity=v, name="belt")
        return zivi.MechanicalSystem(
            mass=1.0, force=lambda t, q, u: -k * q, friction=[rub], coordinates=["x"]
        )

    truth = {"k": 1.0, "slip": 0.8, "static": 1.2, "v": 0.2}
    system = zivi.ParametricSystem(belt, truth)
    t = np.linspace(0.2, 24.0, 90)
    x = zivi.simulate(system, (0, 24), ([0.0], [0.2]))(t)[0][:, 0]
    near = system.replace(k=1.1, slip=0.75)
    fit = zivi.fit(near, zivi.Record(t, x, 1e-2), ("k", "slip"), y0=([0.0], [0.2]), starts=1)
    assert np.allclose(fit.x, [1.0, 0.8], atol=1e-5)


def test_values_outside_of_the_model_do_not_end_a_fit():
    def limited(t, x, v, c):
        if c > 1.0:
            raise ValueError("c must be at most 1")
        return -9.81 - c * v

    system = zivi.ImpactSystem(zivi.ParametricForce(limited, {"c": 0.4}), e=0.6)
    t = np.linspace(0.02, 1.5, 40)
    fit = zivi.fit(system, zivi.Record(t, heights(t, 0.7), 1e-3), ("e", "c"), y0=(1, 0), starts=4)
    assert fit.values["e"] == pytest.approx(0.7, abs=1e-4)
    assert np.any(np.isfinite(fit.start_costs))
    with pytest.raises(ValueError, match=r"no start has a run.*c must be at most 1"):
        zivi.fit(
            system.replace(c=2.0), zivi.Record(t, heights(t, 0.7), 1e-3), "e", y0=(1, 0), starts=2
        )


def test_profile_and_bootstrap_agree_with_the_covariance():
    rng = np.random.default_rng(7)
    times = bounce_times(0.78, 10) + 1e-3 * rng.standard_normal(10)
    fit = zivi.fit(BALL, zivi.Bounces(times, 1e-3), ("e", "x0"), y0=(1, 0), starts=1)
    profile = fit.profile("e")
    np.testing.assert_allclose(profile.interval(0.95), fit.interval(0.95)["e"], atol=2e-5)
    assert np.all(np.diff(profile.values) > 0)
    boot = fit.bootstrap(60, seed=1)
    scale = math.sqrt(2 * fit.cost / fit.degrees_of_freedom)
    assert boot.std["e"] == pytest.approx(scale * fit.std["e"], rel=0.35)
    low, high = boot.interval(0.9)["e"]
    assert low < fit.values["e"] < high
    with pytest.raises(ValueError, match="name must be one of e, x0"):
        fit.profile("f")
    with pytest.raises(ValueError, match="level"):
        fit.interval(95)


def test_a_fit_is_stored_and_shown():
    times = bounce_times(0.78, 8)
    fit = zivi.fit(BALL, zivi.Bounces(times, 1e-3), ("e", "damping"), y0=(1, 0), starts=2)
    again = pickle.loads(pickle.dumps(fit))
    assert again.values == fit.values
    assert again.profile("e").interval(0.9) == fit.profile("e").interval(0.9)
    assert "2 of 2 starts" in str(fit)
    assert "e" in fit._repr_html_()
    pytest.importorskip("matplotlib").use("Agg")
    figure = fit.plot()
    assert len(figure.axes) == 2
    assert len(fit.profile("e").plot().lines) == 3


def test_the_same_seed_gives_the_same_fit():
    data = zivi.Bounces(bounce_times(0.7, 6), 1e-3)
    one, other = (zivi.fit(BALL, data, "e", y0=(1, 0), starts=3, seed=4) for _ in range(2))
    np.testing.assert_array_equal(one.start_costs, other.start_costs)
    assert one.cost == other.cost


WRONG = [
    ({"params": ()}, "params must be one or more"),
    ({"params": ("e", "e")}, "params must be different"),
    ({"params": "mass"}, "mass"),
    ({"y0": None}, "y0 must be given"),
    ({"starts": 0}, "starts"),
    ({"loss": "huge"}, "loss must be one of linear"),
    ({"bounds": {"f": (0, 1)}}, "bounds must name parameters of the fit, got 'f'"),
    ({"bounds": {"e": (1, 0)}}, "must increase"),
    ({"bounds": {"e": 3}}, "bounds"),
    ({"prior": {"e": (0.5, 0.0)}}, "sigma > 0"),
    ({"data": [1.0, 2.0]}, "data must be"),
    ({"method": zivi.ThetaGamma(1e-3)}, "method must be a zivi.SwitchedRK"),
    ({"t0": 9.0}, "t0 must be before"),
]


@pytest.mark.parametrize(("change", "words"), WRONG)
def test_bad_arguments_are_named(change, words):
    given = {"data": zivi.Bounces([0.45, 1.0], 1e-3), "params": "e", "y0": (1, 0), "starts": 1}
    given |= change
    with pytest.raises((ValueError, TypeError), match=words):
        zivi.fit(BALL, given.pop("data"), given.pop("params"), **given)


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: zivi.Bounces([]), "times must be one-dimensional and not empty"),
        (lambda: zivi.Bounces([1.0, 0.5]), "times must increase, got 1 before 0.5"),
        (lambda: zivi.Bounces([1.0], sigma=0.0), "sigma must be positive"),
        (lambda: zivi.Bounces([1.0], missed=-1.0), "missed must be >= 0"),
        (lambda: zivi.Record([0, 1], [1.0]), r"values must have shape \(2,\)"),
        (lambda: zivi.Record([0, 1], [np.nan, np.nan]), "finite entry"),
        (lambda: zivi.Record([0, 1], [1, 2], of=3), "of must be a name"),
        (lambda: zivi.Record([0, 1], [1, 2], sigma=[1]), "sigma must be a number"),
        (lambda: zivi.Experiment([], y0=(1, 0)), "data must be"),
    ],
)
def test_bad_data_are_named(make, words):
    with pytest.raises((ValueError, TypeError), match=words):
        make()


def test_unknown_quantities_are_named():
    with pytest.raises(
        ValueError, match="of must be one of x, xdot, wall, reaction or a function, got 'y'"
    ):
        zivi.fit(BALL, zivi.Record([0.1, 0.2], [1, 1], of="y"), "e", y0=(1, 0))
    with pytest.raises(ValueError, match="gap must be one of wall"):
        zivi.fit(BALL, zivi.Bounces([0.1, 0.2], gap="floor"), "e", y0=(1, 0))


INTERRUPTED = """
    import numpy as np, scipy.optimize, scipy.stats.qmc, zivi
    builds = 0
    def build(k):
        global builds
        builds += 1
        if builds == 100:  # after the first runs
            print("ready", flush=True)
        def force(t, q, u):
            return -k * q
        rub = zivi.DryFriction(limit=0.8, static=1.2, velocity=0.2, name="belt")
        return zivi.MechanicalSystem(mass=1.0, force=force, friction=[rub], coordinates=["x"])
    system = zivi.ParametricSystem(build, {"k": 1.0})
    data = zivi.Record(np.linspace(1, 9, 20), np.zeros(20), 1e-3)
    try:
        zivi.fit(system, data, "k", y0=([0.0], [0.2]), bounds={"k": (0.1, 9)}, starts=4000)
    except KeyboardInterrupt as error:
        print("kept", error.fit.status, error.fit.starts)
"""


@pytest.mark.skipif(sys.platform == "win32", reason="SIGINT is sent as on Unix")
def test_an_interrupted_fit_keeps_what_was_computed():
    program = [sys.executable, "-c", textwrap.dedent(INTERRUPTED)]
    with subprocess.Popen(program, stdout=subprocess.PIPE, text=True) as run:
        assert run.stdout.readline() == "ready\n"
        run.send_signal(signal.SIGINT)
        told = run.stdout.read()
    assert told.startswith("kept INTERRUPTED")
