"""References that a loop is given: exact, on the right branch, for as long as it runs."""

import pickle

import numpy as np
import pytest

import zivi

H, F, E = 1e-3, -9.81, 0.5
PLANT = zivi.ImpactSystem(F, e=E)
BALL = zivi.ImpactSystem(-19.81, e=E)


def tracker(**more):
    return zivi.TwistingTracker(30, 17, **{"h": H, "e": E, "branch": "nearest"} | more)


def loop(reference, t_span=(0, 4), y0=(1.2, 0), **more):
    controller = more.pop("controller", None) or tracker()
    return zivi.simulate_closed_loop(PLANT, controller, t_span, y0, reference=reference, **more)


def swinging(t):
    return 1 + 0.3 * np.sin(3 * t), 0.9 * np.cos(3 * t)


def test_a_smooth_reference_is_exact_after_twenty_seconds():
    run = loop(swinging, (0, 20))
    x, xdot = swinging(run.t)
    np.testing.assert_array_equal([run.x_ref, run.xdot_ref], [x, xdot])
    assert np.abs(run.error[2000:]).max() < 1e-6
    known = loop(lambda t: (*swinging(t), -2.7 * np.sin(3 * t)), (0, 20))
    assert np.abs(known.error[2000:]).max() < 5e-6
    times = np.linspace(0, 20, 777)
    np.testing.assert_array_equal(run.reference(times), swinging(times))


@pytest.mark.parametrize("branch", ["positive", "nearest"])
@pytest.mark.parametrize("form", ["run", "function", "samples"])
def test_a_bouncing_reference_is_followed_to_rest(branch, form):
    ball = zivi.simulate(BALL, (0, 4), (1, 0))
    forms = {"run": ball, "function": ball.__call__, "samples": ball(H * np.arange(4001))}
    run = loop(forms[form], (0, 4), (1, 0.5), controller=tracker(branch=branch))
    np.testing.assert_array_equal([run.x_ref, run.xdot_ref], ball(run.t))
    caught = (run.t > 1.2) & (run.t < 4)
    assert np.abs(run.error[caught]).max() < 1e-4
    assert run.rest_time is not None
    assert np.all(run.x[run.t > 2] == 0)


def test_the_branch_is_that_of_the_run():
    """What the tick is told, against the impacts of the reference."""
    ball = zivi.simulate(BALL, (0, 1), (1, 0))
    seen = []

    class Listening:
        h, x_ref, xdot_ref = H, np.nan, np.nan

        def step(self, x, xdot, force):
            raise AssertionError

        def step_to(self, x, xdot, force, now, following, acceleration):
            seen.append((*now, *following, acceleration))
            return 0.0

    impacts = ball.impacts_down_to(1e-9)["t"]
    for reference in (ball, ball.__call__):
        seen.clear()
        loop(reference, (0, 1), controller=Listening())
        told = np.array(seen, dtype=float)
        for column, shift in ((2, 0), (5, 1)):
            times = H * (np.arange(len(told)) + shift)
            wanted = (-1.0) ** np.searchsorted(impacts, times, side="right")
            # a function tells no impacts: near its Zeno point a flight is shorter than a period
            clear = ball(times)[0] > 1e-4
            assert np.mean((told[:, column] == wanted)[clear]) == 1.0
        np.testing.assert_array_equal(told[:, :2].T, ball(H * np.arange(len(told))))
        if reference is ball:
            flying = told[:, 0] > 1e-3
            np.testing.assert_allclose(told[flying, 6], -19.81, rtol=1e-6)
        else:
            assert np.all(np.isnan(told[:, 6]))


def test_a_resting_reference_lands_exactly():
    for e in (0.3, 0.8):
        plant, lands = zivi.ImpactSystem(F, e=e), zivi.TwistingTracker(30, 17, h=H, e=e)
        runs = [
            zivi.simulate_closed_loop(plant, lands, (0, 3), (1, 0), **reference)
            for reference in ({"reference": lambda t: (0, 0)}, {"y_ref0": (0, 0), "force_ref": F})
        ]
        # the same law as with the reference inside
        assert runs[0].rest_time == pytest.approx(runs[1].rest_time, abs=1e-9)


def test_a_periodic_orbit_is_held_for_as_long_as_it_runs():
    """A ball that loses nothing: a flight a second, in closed form."""
    g = 10.0

    def orbit(t):
        tau = t % 1.0
        return max(0.0, 0.5 * g * tau * (1 - tau)), 0.5 * g * (1 - 2 * tau), -g

    plant = zivi.ImpactSystem(F, e=1.0)
    controller = zivi.TwistingTracker(30, 17, h=H, e=1.0, branch="nearest")
    run = zivi.simulate_closed_loop(plant, controller, (0.25, 30.25), (0.9, 2.5), reference=orbit)
    late = run.t > 28
    assert np.abs(run.error[late]).max() < 5e-3
    away = late & (np.abs((run.t + 0.5) % 1.0 - 0.5) > 0.05)
    assert np.abs(run.error[away]).max() < 1e-4
    assert len(run.resolved_impacts) >= 30


def test_controllers_of_the_user_are_told_the_reference():
    told = []

    class Plain:
        h = H

        def step(self, x, xdot, force):
            return -force

    class Knows(Plain):
        def step(self, x, xdot, force, xdot_ref, x_ref):
            told.append((x_ref, xdot_ref))
            return -force + 100 * (x_ref - x) + 20 * (xdot_ref - xdot)

    run = loop(swinging, (0, 2), controller=Knows())
    np.testing.assert_array_equal(np.array(told).T, [run.x_ref[:-1], run.xdot_ref[:-1]])
    np.testing.assert_array_equal(run.x_ref, swinging_at(run.t)[0])
    assert abs(run.error[-1]) < 0.05
    assert run.config["controller"]["name"] == "Knows"
    # one that asks for nothing goes its own way
    free = loop(swinging, (0, 2), controller=Plain())
    np.testing.assert_array_equal(free.x_ref, run.x_ref)

    class Timed(Plain):
        def step(self, x, xdot, force, t):
            return 0.0

    with pytest.raises(TypeError, match=r"step_to.*Timed"):
        loop(swinging, (0, 2), controller=Timed())


def swinging_at(times):
    return np.array([swinging(float(t))[:2] for t in times]).T


def test_a_supervisor_changes_it_while_the_loop_runs():
    class Supervised:
        height = 1.0

        def __call__(self, t):
            if t > 1.0:
                self.height = 1.5
            return self.height, 0.0

    run = loop(Supervised(), (0, 4))
    assert abs(run.x[999] - 1.0) < 1e-3
    assert abs(run.x[-1] - 1.5) < 1e-6
    np.testing.assert_array_equal(np.unique(run.x_ref), [1.0, 1.5])


def test_a_batch_takes_the_same_references():
    ball = zivi.simulate(BALL, (0, 2), (1, 0))
    references = [ball, swinging, np.array([np.ones(2001), np.zeros(2001)])]
    batch = zivi.simulate_closed_loop_batch(
        PLANT, tracker(), (0, 2), (1.2, 0), reference=references
    )
    for i, reference in enumerate(references):
        run = loop(reference, (0, 2))
        assert batch.x[i] == run.x[-1]
        assert batch.x_ref[i] == run.x_ref[-1]
        assert batch.error_max[i] == np.abs(run.error).max()
    one = zivi.simulate_closed_loop_batch(PLANT, tracker(), (0, 2), [(1.2, 0)] * 2, reference=ball)
    assert one.x[0] == one.x[1] == batch.x[0]


def test_what_it_refuses():
    ball = zivi.simulate(BALL, (0, 1), (1, 0))
    for reference, error, text in (
        (ball, ValueError, "known over t_span"),
        (np.ones((2, 7)), ValueError, r"shape \(2, 4001\)"),
        (np.full((2, 4001), -1.0), ValueError, "x_r >= 0"),
        (lambda t: 1.0, TypeError, r"must give \(x_r, xdot_r\)"),
        (lambda t: (-1.0, 0.0), ValueError, "x_r >= 0"),
        (lambda t: (np.nan, 0.0), ValueError, "finite"),
    ):
        with pytest.raises(error, match=text):
            loop(reference)
    with pytest.raises(TypeError, match="y_ref0 must be None"):
        loop(swinging, y_ref0=(1, 0))
    with pytest.raises(TypeError, match="force_ref must be None"):
        loop(swinging, force_ref=-9.81)
    regulator = zivi.TwistingRegulator(30, 17, h=H, e=E)
    with pytest.raises(TypeError, match="step_to"):
        loop(swinging, controller=regulator)

    def breaks(t):
        if t > 0.5:
            raise RuntimeError("no reference any longer")
        return 1.0, 0.0

    with pytest.raises(RuntimeError, match="no reference any longer") as raised:
        loop(breaks)
    assert 0.45 < raised.value.trajectory.t[-1] <= 0.5


def test_the_plot_and_the_copy_of_such_a_run():
    pytest.importorskip("matplotlib").use("Agg")
    run = loop(lambda t: swinging(t), (0, 1))
    twin = pickle.loads(pickle.dumps(run))
    np.testing.assert_allclose(twin.reference(run.t), run.reference(run.t), rtol=1e-14)
    assert len(zivi.plot.phase_plane(run, coordinates="lifted").lines) == 2
