"""The tracker's landing: exact rest in the sampled loop at every e; its horizon and its shift."""

import copy
import pickle

import numpy as np
import pytest

import zivi

pytestmark = pytest.mark.filterwarnings("ignore:a landing may never rest")

F, H = -9.81, 1e-3


def starts(n, seed=1):
    rng = np.random.default_rng(seed)
    return np.column_stack([rng.uniform(0, 2, n), rng.uniform(-4, 4, n)])


def tracker(e=0.5, mu1=30, mu2=17, h=H, **settings):
    return zivi.TwistingTracker(mu1, mu2, h=h, e=e, **settings)


def accelerations(mu1, mu2, e):
    """D and U."""
    return 2 * (mu1 - mu2) / (1 + e), 2 * e * (mu1 + mu2) / (1 + e)


def share_at_rest(it, n, t_end, *, true=F, y_ref0=(0, 0), **given):
    batch = zivi.simulate_closed_loop_batch(
        zivi.ImpactSystem(true, e=it.e), it, (0, t_end), starts(n),
        y_ref0=y_ref0, force_ref=F, force_model=F, **given,
    )  # fmt: skip
    at_rest = (batch.x == 0) & (batch.xdot == 0) & (batch.rest_time <= batch.t - it.h)
    return np.count_nonzero(at_rest) / n


@pytest.mark.parametrize("e", [0.05, 0.3, 0.45, 0.5, 0.7, 0.8, 0.95])
def test_every_start_ends_in_exact_rest(e):
    drop = (9.81 / 2) * ((1 - e) / (1 + e)) ** 2  # at rest after 1 s
    for branch in ("positive", "nearest"):
        assert share_at_rest(tracker(e, branch=branch), 20, 4.0) == 1
        assert share_at_rest(tracker(e, branch=branch), 20, 4.0, y_ref0=(drop, 0)) == 1


def test_the_papers_law_does_not():
    for e in (0.5, 0.8):
        assert share_at_rest(tracker(e, landing=False), 20, 4.0) == 0


@pytest.mark.parametrize("gains", [(60, 34), (20, 10), (30, 28), (30, 3)])
def test_so_with_other_gains_and_periods(gains):
    for h, e in ((1e-2, 0.1), (1e-2, 0.9), (1e-3, 0.5), (1e-3, 0.95)):
        assert share_at_rest(tracker(e, *gains, h=h), 8, 9.0) == 1


@pytest.mark.parametrize("e", [0.3, 0.8, 0.95])
def test_with_delay_the_horizon_is_one_period_more(e):
    for delay in (1, 5):
        assert share_at_rest(tracker(e, ahead=1 + delay), 8, 6.0, delay=delay) == 1
    if e > 0.5:
        assert share_at_rest(tracker(e), 8, 6.0, delay=5) == 0
        assert share_at_rest(tracker(e, landing=False), 8, 6.0, delay=5) == 0


def test_unknown_forces_and_coarse_sensors_do_not_end_it():
    for e in (0.3, 0.8):
        down, up = accelerations(30, 17, e)
        for missing in (0.7 * min(down, up), -0.7 * min(down, up)):
            assert share_at_rest(tracker(e), 6, 12.0, true=F + missing) == 1
        assert share_at_rest(tracker(e), 6, 6.0, quantization=(1e-3, 1e-2)) == 1
    # an e that is not the plant's, where U and D still hold e^2 D/U < 1
    plant = zivi.ImpactSystem(F, e=0.5)
    with pytest.warns(zivi.ModelWarning):
        run = zivi.simulate_closed_loop(plant, tracker(0.3), (0, 4), (1, 0), force_ref=F)
    assert run.rest_time is not None


def test_noise_does_not_lift_the_mass():
    run = zivi.simulate_closed_loop(
        zivi.ImpactSystem(F, e=0.8), tracker(0.8), (0, 4), (1, 0),
        y_ref0=(0, 0), force_ref=F, noise=(1e-3, 0.1), seed=1,
    )  # fmt: skip
    assert run.rest_time < 3
    assert (run.x[-1], run.xdot[-1], len(run.liftoff_times)) == (0, 0, 0)


def test_a_press_below_the_unknown_force_lets_the_mass_hover():
    found = {}
    for press in (0.0, 2.0):
        it = tracker(press=press)
        run = zivi.simulate_closed_loop(
            zivi.ImpactSystem(F + 1.5, e=0.5), it, (0, 4), (1, 0),
            y_ref0=(0, 0), force_ref=F, force_model=F,
        )  # fmt: skip
        late = run.t > 3
        found[press] = (run.rest_time is not None, np.abs(np.diff(run.u[late])).sum())
    assert found[2.0] == (True, 0.0)
    assert not found[0.0][0]
    assert found[0.0][1] > 1000


def test_every_landing_tick_presses_at_least_as_hard_as_it_says():
    """u + F <= -min(U, D, press), and the law of its documentation, whatever is measured."""
    rng = np.random.default_rng(3)
    seen = set()
    for _ in range(3000):
        e, mu1 = rng.uniform(0.02, 0.97), 10 ** rng.uniform(0.7, 2.2)
        mu2, h, ahead = mu1 * rng.uniform(0.1, 0.9), 10 ** rng.uniform(-4, -2), rng.integers(1, 5)
        down, up = accelerations(mu1, mu2, e)
        press = rng.choice([None, rng.uniform(0, 50)])
        it = tracker(e, mu1, mu2, h=h, press=press, ahead=int(ahead))
        force = rng.uniform(-15, 3)
        x = rng.choice([0.0, rng.exponential(0.1)])
        xdot = rng.choice([0.0, rng.normal(0, ahead * h * up)])
        u = it.step(x, xdot, force, -1.0)
        least = min(up, down, down if press is None else press)
        assert u + force <= -least + 1e-12 * (abs(force) + down + up)
        if x == xdot == 0:
            g = down if press is None else press
        elif up >= down:
            g = min(max(xdot / (ahead * h), down), up)
        else:
            g = up if xdot >= ahead * h * up else down
        assert u == pytest.approx(-force - g, rel=1e-12, abs=1e-12 * (down + up))
        seen.add((x == xdot == 0, up >= down, g in (up, down)))
        signs = it.signs
        assert signs[0] == signs[4] == 1
        assert abs(signs[5]) <= 1
    assert len(seen) >= 5


@pytest.mark.parametrize("branch", ["positive", "nearest"])
def test_until_the_reference_rests_the_control_is_the_papers(branch):
    """To the last bit; and from its lift-off on again."""
    given = {"y_ref0": (3, 3), "force_ref": -19.81}
    plant = zivi.ImpactSystem(F, e=0.5)
    runs = [
        zivi.simulate_closed_loop(
            plant, tracker(branch=branch, landing=landing), (0, 3), (6, 5), **given
        )
        for landing in (True, False)
    ]
    first = np.flatnonzero((runs[0].x_ref == 0) & (runs[0].xdot_ref == 0))[0]
    assert 1000 < first < 2500
    np.testing.assert_array_equal(runs[0].u[:first], runs[1].u[:first])
    assert np.any(runs[0].u[first:] != runs[1].u[first:])
    one, other = tracker(branch=branch), tracker(branch=branch, landing=False)
    one.step(0.0, 0.0, F, F)
    other.step(0.0, 0.0, F, F)
    assert one.u == F * -1 - one.press != other.u
    # the reference leaves its rest in the period of this tick
    assert one.step(0.0, 0.0, F, 2.0) == other.step(0.0, 0.0, F, 2.0)


def test_the_shift_removes_the_bias_of_the_position():
    """h^2 |F_r|/2 = 4.9e-6 m in free flight, with the force known, and nothing with the shift."""
    given = {"y_ref0": (3, 10), "force_ref": F}
    plant = zivi.ImpactSystem(F, kappa=0.5)
    for shift, error in ((False, 9.81 * H**2 / 2), (True, 0.0)):
        it = zivi.TwistingTracker(30, 17, h=H, kappa=0.5, shift=shift)
        run = zivi.simulate_closed_loop(plant, it, (0, 0.9), (3, 10), **given)
        late = run.t > 0.3
        np.testing.assert_allclose(np.abs(run.error[late]), error, atol=1e-12)


def test_a_longer_horizon_is_quieter_and_as_exact_at_rest():
    """With noise: a fraction of the control's variation at about the same error."""
    found = {}
    for horizon, shift in ((1, False), (3, True), (5, True)):
        run = zivi.simulate_closed_loop(
            zivi.ImpactSystem(F, e=0.5), tracker(horizon=horizon, shift=shift), (0, 3), (1.1, 0),
            y_ref0=(1, 0), force_ref=F, noise=(1e-4, 1e-2), seed=5,
        )  # fmt: skip
        moving = (run.t > 0.7) & (run.t < 1.3)
        rms = np.sqrt(np.mean(run.error[moving] ** 2))
        found[horizon] = rms, np.abs(np.diff(run.u[moving])).sum()
        assert run.rest_time < 2
    assert found[3][1] < 0.6 * found[1][1]
    assert found[5][1] < 0.35 * found[1][1]
    assert max(rms for rms, _ in found.values()) < 2e-4


def test_a_horizon_of_one_period_is_none():
    for branch in ("positive", "nearest"):
        runs = [
            zivi.simulate_closed_loop(
                zivi.ImpactSystem(F, e=0.5), it, (0, 1), (6, 5), y_ref0=(3, 3), force_ref=-19.81
            )
            for it in (tracker(branch=branch), tracker(branch=branch, horizon=1.0))
        ]
        np.testing.assert_array_equal(runs[0].u, runs[1].u)


def test_settings_survive_copies_and_pickles():
    it = tracker(press=20.0, ahead=3, horizon=2.5, shift=True)
    assert (it.landing, it.press, it.ahead, it.horizon, it.shift) == (True, 20, 3, 2.5, True)
    it.step(0.2, 0.1, F, F)
    for twin in (it.copy(), copy.deepcopy(it), pickle.loads(pickle.dumps(it))):
        assert (twin.settings, twin.state) == (it.settings, it.state)
        assert twin.step(0.1, 0.05, F, F) == it.copy().step(0.1, 0.05, F, F)
    assert zivi.TwistingTracker(**it.settings).settings == it.settings
    assert tracker().press == pytest.approx(accelerations(30, 17, 0.5)[0])
    assert tracker(landing=False).press is None


@pytest.mark.parametrize(
    ("settings", "error", "message"),
    [
        ({"press": 4.0, "bound": 5.0}, ValueError, "press must be at least the bound .* 5.0 m/s^2"),
        ({"press": -1.0}, ValueError, "press must be at least the bound .* 0.0 m/s^2, got -1.0"),
        ({"press": np.inf}, ValueError, "press must be a finite acceleration"),
        ({"press": 1.0, "landing": False}, ValueError, "must be None with landing=False"),
        ({"ahead": 0}, ValueError, "ahead must be >= 1"),
        ({"ahead": 2, "landing": False}, ValueError, "must be 1 with landing=False, got 2"),
        ({"landing": 1}, TypeError, "landing must be True or False, got 1"),
        ({"horizon": 0.5}, ValueError, "horizon must be a finite number of periods >= 1, got 0.5"),
        ({"horizon": np.inf}, ValueError, "horizon must be a finite number of periods >= 1"),
        ({"shift": 1}, TypeError, "shift must be True or False, got 1"),
    ],
)
def test_bad_settings_are_named(settings, error, message):
    with pytest.raises(error, match=message.replace("^", r"\^")):
        tracker(**settings)


@pytest.mark.parametrize("gains", [(30, 17), (30, 3)])  # U > D, and U < D
def test_the_dead_zone_takes_the_velocitys_errors_for_nothing(gains):
    e, quiet, ahead = 0.3, 0.05, 3
    D, U = accelerations(*gains, e)
    it = tracker(e, *gains, quiet=quiet, ahead=ahead, press=25.0)
    N = ahead * H
    assert it.quiet == quiet
    for x in (0.0, 0.9 * N * quiet, 1.1 * N * quiet, 1.0):
        for xdot in np.concatenate(
            [np.linspace(-0.2, 0.2, 81), quiet + N * U * np.array([0.99, 1.01])]
        ):
            it.reset(0, 0)
            share = (xdot - quiet) / N
            g = U if share >= U else max(share, D)
            if abs(xdot) <= quiet and x <= N * quiet:
                g = 25.0
            assert -F - it.step(x, xdot, F, F) == pytest.approx(g, rel=1e-12)
    regulator = zivi.TwistingRegulator(30, 17, h=H, e=e, quiet=quiet, ahead=ahead)
    for xdot in np.linspace(-0.2, 0.6, 81):
        g = np.clip((xdot - quiet) / N, 13 - F, 47 - F)
        assert -F - regulator.step(0.5, xdot, F) == pytest.approx(g, rel=1e-12)


@pytest.mark.parametrize("kind", ["tracker", "regulator"])
def test_a_mass_at_rest_has_a_constant_control(kind):
    rng = np.random.default_rng(5)
    measured = np.column_stack([np.abs(rng.normal(0, 1e-4, 50_000)), rng.normal(0, 0.1, 50_000)])
    changes = []
    for quiet in (0.0, 0.5):
        it = (
            tracker(quiet=quiet)
            if kind == "tracker"
            else zivi.TwistingRegulator(30, 17, h=H, e=0.5, quiet=quiet)
        )
        more = (F, F) if kind == "tracker" else (F,)
        u = [it.step(x, xdot, *more) for x, xdot in measured.tolist()]
        changes.append(np.count_nonzero(np.diff(u)))
    assert changes[0] > 1000
    assert changes[1] == 0


@pytest.mark.slow
@pytest.mark.parametrize("settings", [{"ahead": 6, "quiet": 0.5}, {"ahead": 15}])
def test_late_controls_rest_near_e_one_under_noise(settings):
    """With ahead = 1 + d alone none does: its brake swings over."""
    n, e = 6, 0.98
    given = {"delay": 5, "noise": (0.0, 0.1), "seed": range(n)}
    it = tracker(e, ahead=6)
    with pytest.warns(
        zivi.ModelWarning, match=r"quiet .5 deviations of the velocity., or ahead=15"
    ):
        assert share_at_rest(it, n, 12.0, **given) < 0.5
    assert share_at_rest(tracker(e, **settings), n, 25.0, **given) == 1


def test_what_may_never_rest_is_told():
    plant, span = zivi.ImpactSystem(F, e=0.95), (0, 0.05)

    def run(it, **settings):
        return zivi.simulate_closed_loop(plant, it, span, (1, 0), **settings)

    late = {"delay": 3}
    with pytest.warns(zivi.ModelWarning, match=r"ahead = 1, but 1 . delay = 4"):
        run(tracker(0.95), **late)
    with pytest.warns(zivi.ModelWarning, match=r"ahead = 3, but 1 . delay = 4"):
        run(zivi.TwistingRegulator(30, 17, h=H, e=0.95, ahead=3), **late)
    noise = {"noise": (0.0, 0.1), "seed": 1, **late}
    with pytest.warns(zivi.ModelWarning, match=r"e = 0.95: give it quiet .*, or ahead=10"):
        run(tracker(0.95, ahead=9), **noise)  # 4^4/3^3 = 9.48
    # errors: no warning
    run(tracker(0.95, ahead=4), **late)
    run(tracker(0.95, landing=False), **late)
    run(tracker(0.95, ahead=10), **noise)
    run(tracker(0.95, ahead=4, quiet=0.5), **noise)
    run(tracker(0.95, ahead=4), **noise, observer=zivi.ImpactObserver(0.95, H, noise=(1e-6, 0.1)))
    run(tracker(0.95, ahead=4), noise=(1e-4, 0.0), seed=1, **late)
    assert run(tracker(0.95), noise=(0.0, 0.1), seed=1).success


def test_a_bad_dead_zone_is_refused():
    for quiet in (-1e-3, np.nan, np.inf):
        with pytest.raises(ValueError, match="quiet must be"):
            tracker(quiet=quiet)
    with pytest.raises(ValueError, match="must be 0 with landing=False"):
        tracker(quiet=0.1, landing=False)
    with pytest.raises(TypeError, match="quiet"):
        tracker(quiet="little")
    again = pickle.loads(pickle.dumps(tracker(quiet=0.1)))
    assert again.quiet == copy.copy(again).quiet == 0.1
