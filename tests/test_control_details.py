"""Details of control that mistakes would change: thresholds, names in errors, what is held when."""

import numpy as np
import pytest

import zivi
from inside import ControlLaw
from mechanical_arms import PADDLE, START, follow, tapping, tracker, two_links


@pytest.mark.parametrize("exact", [True, False])
def test_a_tracker_has_the_least_gains_that_hold_an_unknown_force(exact):
    """The conditions as they are published, for gains beside the least ones."""
    bound, ratio = 1.7, np.geomspace(0.05, 8.0, 60)
    binding = set()
    for e in (0.1, 0.3, 0.5, 0.7, 0.9):
        law, R = ControlLaw("tracker", e, -9.81, None), 2.0 * e / (1.0 + e)
        for per, least in zip(ratio, law.least(ratio, bound, exact), strict=True):
            if not np.isfinite(least):
                continue

            def broken(U, per=per, e=e, law=law, R=R):
                mu1, mu2 = law.gains(U, per * U)
                rests = bound * (1 + e * e) < (min(U, per * U) if exact else U) - e * e * per * U
                holds = bound < per * U, bound / R < mu2, mu2 < mu1 - bound / R, rests
                return [k for k, it in enumerate(holds) if not it]

            assert not broken(least * 1.000001)
            assert broken(least * 0.999999)
            binding.update(broken(least * 0.999999))
    assert binding == ({1, 2, 3} if exact else {1, 2})


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: zivi.JointObserver(PADDLE, noise="a"), "^noise"),
        (lambda: zivi.JointObserver(PADDLE, alpha="a"), "^alpha"),
        (lambda: tracker().step(0.0, START, ["a", "b"]), "^qdot"),
        (lambda: follow(tracker(force={"floor": lambda t: "a"}), end=1.2), r"^force\['floor'\]"),
    ],
)
def test_errors_name_the_argument(call, message):
    with pytest.raises(TypeError, match=message):
        call()


def test_controls_at_a_sample_are_those_that_begin_there():
    run = follow(tracker(), end=0.1)
    again = run._resampled(run.t)
    assert np.array_equal(again.u, run.u)
    assert np.array_equal(again.error_gaps, run.error_gaps)
    between = run._resampled(run.t[:-1] + 0.5e-3)
    assert np.array_equal(between.u, run.u[:-1])


def test_a_run_of_a_gap_that_begins_after_the_loop_is_refused():
    drop = zivi.simulate(zivi.ImpactSystem(-9.81, e=0.6), (0.5e-3, 0.2), (0.12, 0))
    with pytest.raises(ValueError, match=r"reference\['floor'\] must be known"):
        follow(tracker(), end=0.1, reference={"floor": drop})


def test_contacts_that_are_not_lost_are_not_counted():
    found = zivi.simulate_closed_loop_batch(
        two_links(), tracker(), (0, 1.2), (START, np.zeros(2)), reference=tapping()
    )
    assert found.contacts.all()
    assert found.n_lost.tolist() == [0]


def test_a_force_that_is_too_small_loses_its_latch():
    """The table pushes the arm by more than is asked for; the status says so, and the count."""
    settings = {"force": {"floor": 2.0}, "latch": (1e-4, 1e-2)}
    run = zivi.simulate_closed_loop(
        two_links(),
        tracker(**settings),
        (0, 1.2),
        (START, np.zeros(2)),
        reference=tapping(),
        method=zivi.RKPeriod(),
        disturbance=lambda t, q, w: [4.0 * (t > 1.0), 0.0],
    )
    lost = (run.tick_status & zivi.TickStatus.LATCH_LOST) != 0
    assert lost.any()
    assert run.t[lost][0] > 1.0


def free_fall(h, end, **asked):
    """A loop of a mass that falls under a control of 0, a period long."""

    class Idle:
        def __init__(self):
            self.h = h

        def step(self, x, xdot, force, **told):
            return 0.0

        def step_to(self, x, xdot, force, **told):
            return 0.0

    plant = zivi.ImpactSystem(-9.81, e=0.5)
    return zivi.simulate_closed_loop(plant, Idle(), (0, end), (0.2, 0), **asked)


def test_impacts_after_the_event_that_ends_a_run_are_left_out():
    def passes(t, x, xdot):
        return t - 0.25

    passes.terminal = True
    whole, cut = free_fall(0.5, 0.5), free_fall(0.5, 0.5, events=passes)
    first = np.sqrt(2 * 0.2 / 9.81)  # then at twice that
    assert cut.impacts["t"].tolist() == pytest.approx([first])
    assert len(whole.impacts) == 2


def test_two_samples_of_a_reference_are_not_turned_over():
    tracker = zivi.TwistingTracker(30, 17, h=1e-2, e=0.5)
    plant = zivi.ImpactSystem(-9.81, e=0.5)
    # rows are x_r and xdot_r: -1 m/s is no position
    rows = np.array([[0.2, 0.19], [-1.0, -1.0]])
    run = zivi.simulate_closed_loop(plant, tracker, (0, 1e-2), (0.2, -1.0), reference=rows)
    assert run.x_ref.tolist() == [0.2, 0.19]
    with pytest.raises(TypeError, match=r"^reference must"):
        zivi.simulate_closed_loop(plant, tracker, (0, 1e-2), (0.2, 0), reference=[["a", "b"]] * 2)


def test_between_samples_a_reference_is_its_own_run():
    drop = zivi.simulate(zivi.ImpactSystem(-9.81, e=0.5), (0, 1.0), (0.3, 0))
    tracker = zivi.TwistingTracker(30, 17, h=1e-2, e=0.5)
    plant = zivi.ImpactSystem(-9.81, e=0.5)
    run = zivi.simulate_closed_loop(plant, tracker, (0, 0.2), (0.3, 0), reference=drop)
    times = np.array([0.003, 0.051, 0.1777])
    x, xdot = run._resampled(times).x_ref, run._resampled(times).xdot_ref
    np.testing.assert_allclose(x, 0.3 - 0.5 * 9.81 * times**2, rtol=1e-9)
    np.testing.assert_allclose(xdot, -9.81 * times, rtol=1e-9)


def test_an_observer_names_the_series_that_does_not_fit():
    times = np.arange(5) * 1e-3
    for name in ("force", "u"):
        observer = zivi.ImpactObserver(0.5, 1e-3, noise=1e-4, position_only=True)
        with pytest.raises(ValueError, match=rf"^{name} must be a number or have shape \(5,\)"):
            observer.observe(times, times, **{name: np.zeros(4)})


class Off:
    """No control, held for a period that has a whole accumulation in it."""

    h = 1.5

    def step(self, x, xdot, force):
        return 0.0


def test_a_loop_that_ends_within_an_accumulation_has_no_impacts_after_that():
    """The ball of ``e = 1/2`` falls through a height for the 14th time before its 14th impact."""

    def low(t, x, xdot):
        return x - 1e-9

    low.terminal, low.direction = 14, -1
    system = zivi.ImpactSystem(-9.81, e=0.5)
    run = zivi.simulate_closed_loop(system, Off(), (0, 3), (1, 0), events=low)
    assert run.status is zivi.Status.TERMINATED_BY_EVENT
    fall = np.sqrt(2 / 9.81)
    times = fall * (3 - 2 * 0.5 ** np.arange(14))
    assert run.t[-1] == pytest.approx(times[-1], abs=5e-6)
    assert run.t[-1] < times[-1]
    np.testing.assert_allclose(run.impacts_down_to(1e-9)["t"], times[:-1], rtol=1e-12)
