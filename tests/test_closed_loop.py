"""What the controller of a sampled loop is told, and what becomes of its control."""

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

import control_loops
import zivi
from control_loops import PAPER, PLANT, Scripted, assert_equal_runs, follow, loop
from control_oracle import EPS

pytestmark = pytest.mark.filterwarnings("ignore:a landing may never rest")


@settings(max_examples=25)
@given(
    kind=st.sampled_from([zivi.TwistingTracker, zivi.ExplicitTwisting, zivi.TwistingRegulator]),
    change=st.floats(0.05, 0.45),
    noise=st.sampled_from([(0.0, 0.0), (1e-3, 1e-2)]),
    delay=st.integers(0, 3),
    paper=st.booleans(),
    seed=st.integers(0, 1000),
)
def test_nothing_of_the_future_is_known(kind, change, noise, delay, paper, seed):
    """A change of every force at a time, and another end: the controls before it are the same."""
    h = 5e-3

    def run(end, jump):
        def force(base):
            return lambda t, x, xdot: base - 0.3 * xdot + (jump if t >= change else 0.0)

        options = {"noise": noise, "seed": seed, "delay": delay}
        if paper:
            options["method"] = zivi.ThetaGamma(h)
        system = zivi.ImpactSystem(force(-9.81) if paper else -9.81, kappa=0.5)
        controller = kind(**PAPER | {"h": h}, depth=1.0)
        return loop(
            controller,
            system=system,
            t_span=(0, end),
            y0=(0.3, 0),
            force_model=force(-9.0),
            **({} if kind is zivi.TwistingRegulator else {"force_ref": force(-19.0)}),
            **options,
        )

    one, other = run(0.5, 0.0), run(0.8, 4.0)
    before = int(np.searchsorted(one.t, change))  # ticks before the change
    assert before > 5
    assert_equal_runs(one, other, before)
    if kind is not zivi.TwistingRegulator:  # and a change is noticed
        assert not np.array_equal(one.u[before:], other.u[before : len(one.u)])


def test_the_controller_is_told_the_model_at_what_it_measures():
    """Not the true force, and not the true state."""
    asked = []

    def model(t, x, xdot):
        asked.append((t, x, xdot))
        return -9.0 + 0.1 * x

    controller = Scripted([1.0, -2.0, 0.5], 0.05)
    run = loop(controller, force_model=model, noise=(0.01, 0.02), seed=3, t_span=(0, 0.5))
    t, x, xdot = np.transpose(asked)
    np.testing.assert_array_equal(t, run.t[:-1])
    seen = np.array(controller.seen)
    np.testing.assert_array_equal(seen[:, 0], x)
    np.testing.assert_array_equal(seen[:, 1], xdot)
    np.testing.assert_array_equal(seen[:, 2], -9.0 + 0.1 * x)
    noise_x, noise_xdot = x - run.x[:-1], xdot - run.xdot[:-1]
    assert np.all(noise_x != 0)
    assert 0.2 < np.std(noise_x) / 0.01 < 3
    assert 0.2 < np.std(noise_xdot) / 0.02 < 3
    # the plant knows nothing of it
    other = loop(Scripted([1.0, -2.0, 0.5], 0.05), force_model=0.0, t_span=(0, 0.5))
    np.testing.assert_array_equal(run.x, other.x)


def test_the_true_force_acts_on_the_plant_only():
    told = loop(force_model=-9.81)
    wrong = loop(system=zivi.ImpactSystem(-8.0, kappa=0.5), force_model=-9.81)
    assert told.u[0] == wrong.u[0]
    np.testing.assert_array_equal(told.x_ref, wrong.x_ref)
    assert np.all(told.x[1:] != wrong.x[1:])
    # by default the model is the true force, and the reference's that of the model
    system = zivi.ImpactSystem(-8.0, kappa=0.5)
    plain = zivi.simulate_closed_loop(
        system, zivi.TwistingTracker(**PAPER), (0, 1), (6, 5), y_ref0=(3, 3)
    )
    stated = zivi.simulate_closed_loop(
        system,
        zivi.TwistingTracker(**PAPER),
        (0, 1),
        (6, 5),
        y_ref0=(3, 3),
        force_model=-8.0,
        force_ref=-8.0,
    )
    assert_equal_runs(plain, stated)


def test_the_reference_is_asked_where_it_is():
    asked = []

    def force_ref(t, x, xdot):
        asked.append((t, x, xdot))
        return -19.81

    run = loop(force_ref=force_ref)
    expected = np.column_stack([run.t, run.x_ref, run.xdot_ref])[:-1]
    np.testing.assert_array_equal(np.array(asked), expected)
    assert_equal_runs(run, loop())


@pytest.mark.parametrize("delay", [0, 1, 3])
def test_a_delay_shifts_the_control(delay):
    controls = np.arange(1.0, 11.0)
    run = loop(Scripted(controls), delay=delay, t_span=(0, 1), y0=(100, 0))
    np.testing.assert_array_equal(run.u[:10], [0.0] * delay + controls.tolist()[: 10 - delay])
    assert run.u[10] == run.u[9]
    # the plant moves under the control that is recorded
    (x, _), _ = follow(run.u[:10], 0.1, 100, 0, e=PLANT.e, f=-9.81)
    np.testing.assert_allclose(run.x, x, rtol=1e-13)
    assert loop(Scripted(controls), delay=np.int64(2), t_span=(0, 1)).config["delay"] == 2


def test_noise_is_reproducible_and_recorded():
    noisy = {"noise": (1e-3, 1e-2)}
    run = loop(**noisy)
    again = loop(**noisy, seed=run.config["seed"])
    assert_equal_runs(run, again)
    assert not np.array_equal(run.u, loop(**noisy).u)
    seeded = loop(**noisy, seed=5)
    assert seeded.config["seed"] == 5
    assert loop(**noisy, seed=np.int64(5)).config["seed"] == 5
    assert_equal_runs(seeded, loop(**noisy, seed=np.int64(5)))
    # a longer run begins alike, and the two channels are independent
    assert_equal_runs(seeded, loop(**noisy, seed=5, t_span=(0, 2)), until=1000)
    position, both = Scripted([0.0]), Scripted([0.0])
    loop(position, noise=(1e-3, 0), seed=5)
    loop(both, noise=(1e-3, 1e-2), seed=5)
    np.testing.assert_array_equal(np.array(position.seen)[:, 0], np.array(both.seen)[:, 0])
    for wrong, error in ((-1, ValueError), ("a", TypeError), (1.5, TypeError), ([1], TypeError)):
        with pytest.raises(error, match="seed"):
            loop(seed=wrong)


def test_noise_has_the_deviations_that_were_asked_for():
    """20000 samples: the standard deviation is known to 0.5 %, five of that are allowed."""
    controller = Scripted([0.0], 1e-3)
    run = loop(controller, noise=(2.0, 0.5), seed=1, t_span=(0, 20))
    seen = np.array(controller.seen)
    added = seen[:, :2] - np.column_stack([run.x, run.xdot])[:-1]
    np.testing.assert_allclose(added.std(axis=0), [2.0, 0.5], rtol=0.025)
    np.testing.assert_allclose(added.mean(axis=0), 0, atol=5 * 2.0 / np.sqrt(20000))
    assert abs(np.corrcoef(added.T)[0, 1]) < 0.04
    assert abs(np.corrcoef(added[1:, 0], added[:-1, 0])[0, 1]) < 0.04


def test_quantisation_rounds_what_is_measured():
    controller = Scripted([3.0, -1.0], 0.01)
    run = loop(controller, quantization=(0.25, 0.5), t_span=(0, 1))
    seen = np.array(controller.seen)[:, :2]
    true = np.column_stack([run.x, run.xdot])[:-1]
    for column, step in ((0, 0.25), (1, 0.5)):
        np.testing.assert_array_equal(seen[:, column] % step, 0)
        assert np.abs(seen[:, column] - true[:, column]).max() <= step / 2 * (1 + 1e-12)
    assert len(np.unique(seen[:, 0])) > 3
    # only one of them
    one = Scripted([3.0, -1.0], 0.01)
    loop(one, quantization=(0, 0.5), t_span=(0, 1))
    np.testing.assert_array_equal(np.array(one.seen)[:, 0], true[:, 0])


@pytest.mark.parametrize("kind", [zivi.TwistingTracker, zivi.ExplicitTwisting])
def test_refused_samples_hold_the_control_and_are_counted(kind):
    """Noise at the wall: half of the samples lie behind it, with depth 0 they are refused."""
    options = {"t_span": (0, 0.5), "y0": (0, 0), "y_ref0": (0, 0), "noise": (1e-4, 0), "seed": 1}
    with pytest.warns(zivi.ModelWarning, match="of 500 control .* were rejected") as told:
        run = loop(kind(**PAPER, depth=0.0), **options)
    assert told[0].filename == control_loops.__file__  # which calls simulate_closed_loop
    refused = (run.tick_status & zivi.TickStatus.REFUSED) != 0
    assert (run.n_refused, run.n_updates) == (np.count_nonzero(refused), 500)
    told = f"{run.n_refused} of 500 control updates rejected, 0 saturated"
    assert run.success
    assert run.message == f"The end of t_span was reached. {told}."
    assert f", {told}: completed>" in repr(run)
    assert 150 < run.n_refused < 350
    assert not refused[-1]
    k = np.flatnonzero(refused)
    assert run.u[0] == 0 or k[0] > 0
    k = k[k > 0]
    np.testing.assert_array_equal(run.u[k], run.u[k - 1])
    # the reference waits too
    np.testing.assert_array_equal(run.x_ref[k + 1], run.x_ref[k])
    clamped = loop(kind(**PAPER, depth=1.0), **options)
    assert clamped.n_refused == 0
    np.testing.assert_array_equal(clamped.tick_status == zivi.TickStatus.CLAMPED, refused)


@pytest.mark.filterwarnings("ignore:.*control updates:zivi.ModelWarning")
def test_what_is_refused_first_gives_no_control():
    run = loop(zivi.TwistingTracker(**PAPER, depth=0.0), noise=(1e300, 0), seed=4, t_span=(0, 0.1))
    first = np.flatnonzero((run.tick_status & zivi.TickStatus.REFUSED) == 0)[0]
    if first == 0:
        first = np.flatnonzero(run.tick_status & zivi.TickStatus.REFUSED)[0]
        assert run.u[first] == run.u[first - 1]
    else:
        np.testing.assert_array_equal(run.u[:first], 0)
    assert run.success


def test_saturation_is_marked():
    with pytest.warns(zivi.ModelWarning, match="control updates of TwistingTracker were saturated"):
        run = loop(zivi.TwistingTracker(**PAPER, u_limits=(-20.0, 15.0)), t_span=(0, 2))
    assert f"0 of 2000 control updates rejected, {run.n_saturated} saturated" in run.message
    cut = (run.tick_status & zivi.TickStatus.SATURATED) != 0
    assert np.count_nonzero(cut) == run.n_saturated > 200
    assert set(run.u[cut]) == {-20.0, 15.0}
    assert np.all((run.u[~cut] > -20) & (run.u[~cut] < 15))
    free = loop(t_span=(0, 2))
    assert free.u.min() < -20
    assert np.all(free.tick_status == 0)


@pytest.mark.filterwarnings("ignore:.*control updates:zivi.ModelWarning")
@settings(max_examples=30)
@given(
    mu1=st.floats(1, 60),
    ratio=st.floats(0.1, 0.9),
    f=st.floats(-15, 5),
    f_ref=st.floats(-30, 5),
    kappa=st.floats(0.05, 0.9),
    kappa_ref=st.floats(0.05, 0.9),
    branch=st.sampled_from(["positive", "nearest"]),
    noise=st.sampled_from([0.0, 0.1]),
)
def test_controls_of_a_run_are_bounded(mu1, ratio, f, f_ref, kappa, kappa_ref, branch, noise):
    """(1 + kappa)(mu1 + mu2 + |Fr|/(1 - kappa_r)) + |F|, whatever the loop does."""
    controller = zivi.TwistingTracker(
        mu1, ratio * mu1, h=5e-3, kappa=kappa, kappa_ref=kappa_ref, branch=branch
    )
    run = loop(
        controller,
        system=zivi.ImpactSystem(f, kappa=kappa),
        y0=(1, 2),
        y_ref0=(1, 3),
        force_ref=f_ref,
        noise=(noise, noise),
        seed=0,
    )
    bound = (1 + kappa) * (mu1 * (1 + ratio) + abs(f_ref) / (1 - kappa_ref)) + abs(f)
    assert np.abs(run.u).max() <= bound * (1 + 8 * EPS)
    assert np.all(np.abs(run.signs[:-1]) <= 1)
    assert run.success
