"""The juggler of gymnasium: its checker, its motion, a controller that holds the height."""

import copy
import pickle

import numpy as np
import pytest

import zivi

gymnasium = pytest.importorskip("gymnasium")


@pytest.mark.filterwarnings("ignore::UserWarning", "ignore::DeprecationWarning")
def test_the_checker_of_gymnasium_finds_nothing():
    from gymnasium.utils.env_checker import check_env

    check_env(zivi.interop.juggler(), skip_render_check=True)


def test_the_motion_is_that_of_a_closed_loop():
    """The same controls in zivi's own loop, and the dense output of the switched method."""
    rng = np.random.default_rng(3)
    controls = rng.uniform(-5, 5, 200)
    env = zivi.interop.juggler(e=0.6, h=0.02, height=0.5, u_max=5.0, steps=200)
    observed, _ = env.reset(options={"y0": (0.4, 0.3)})
    states, count = [observed], 0
    for u in controls:
        observed, reward, terminated, truncated, info = env.step(np.array([u / 5.0]))
        states.append(observed)
        count += info["impacts"]
        assert reward <= 0
        assert info["u"] == pytest.approx(u)
        assert info["saturated"] == (abs(u / 5.0) > 1.0)
        assert not terminated
    assert truncated

    class Given:
        h, k = 0.02, -1

        def step(self, x, xdot, force):
            self.k += 1
            return controls[self.k]

    plant = zivi.ImpactSystem(-9.81, e=0.6)
    run = zivi.simulate_closed_loop(plant, Given(), (0, 4), (0.4, 0.3))
    speed = np.sqrt(2 * 9.81 * 0.5)
    wanted = np.column_stack([run.x / 0.5, run.xdot / speed])
    np.testing.assert_allclose(np.array(states), wanted, rtol=2e-6, atol=1e-6)
    assert count == len(run.resolved_impacts)


def test_a_simple_controller_holds_the_height():
    """Energy: accelerate along the velocity while there is too little of it."""
    env = zivi.interop.juggler()

    def mean(policy):
        observed, _ = env.reset(seed=5)
        rewards, truncated = [], False
        while not truncated:
            observed, reward, _, truncated, _ = env.step([policy(*observed)])
            rewards.append(reward)
        return np.mean(rewards[250:])

    lazy = mean(lambda x, v: 0.0)
    good = mean(lambda x, v: np.clip(20 * (1 - v * v - x) * np.sign(v), -1, 1))
    assert lazy < -0.9  # it lies on the wall
    assert good > -0.35


def test_bad_input():
    for name, value in (("h", 0.0), ("height", -1.0), ("u_max", np.nan), ("steps", 0), ("e", 2)):
        with pytest.raises(ValueError, match=name):
            zivi.interop.juggler(**{name: value})
    with pytest.raises(ValueError, match="y0"):
        zivi.interop.juggler().reset(options={"y0": (-1.0, 0.0)})


def test_an_action_that_is_none_is_refused():
    env = zivi.interop.juggler()
    env.reset(seed=1)
    before = env.unwrapped._state
    for action in ([np.nan], [np.inf], [0.1, 0.2], []):
        with pytest.raises(ValueError, match="action must be one finite number"):
            env.step(np.array(action, np.float32))
    assert env.unwrapped._state == before
    assert np.all(np.isfinite(env.step(np.float32(0.1))[0]))


def test_it_pickles_with_its_state_and_its_draws():
    env = zivi.interop.juggler(e=0.6, h=0.03, height=0.4, u_max=4.0, steps=50)
    env.reset(seed=3)
    env.step([0.7])
    for twin in (pickle.loads(pickle.dumps(env)), copy.deepcopy(env)):
        assert twin is not env
        for action in (0.2, -0.4):
            state = env.unwrapped._state, env.unwrapped._k
            found, wanted = twin.step([action]), env.step([action])
            np.testing.assert_array_equal(found[0], wanted[0])
            assert found[1:] == wanted[1:]
            env.unwrapped._state, env.unwrapped._k = state
            twin.unwrapped._state, twin.unwrapped._k = state
    again = pickle.loads(pickle.dumps(env))
    np.testing.assert_array_equal(again.reset()[0], env.reset()[0])
