"""The settings that a result carries tell the same run again."""

import json

import numpy as np

import zivi

WALL = {"amplitude": 0.01, "omega": 31.0, "phase": 0.2, "offset": 0.0}
PLANT = zivi.ImpactSystem(
    zivi.LinearForce(gravity=9.81, damping=0.1), e=0.5, wall=zivi.HarmonicWall(**WALL)
)
STARTS = [[0.3, 0.0], [0.2, 0.5]]
LAW = {"mu1": 30.0, "mu2": 17.0, "h": 1e-2, "e": 0.5}


def without_name(told):
    return {key: value for key, value in told.items() if key != "name"}


def system_of(told):
    force, wall = without_name(told["force"]), without_name(told["wall"])
    return zivi.ImpactSystem(zivi.LinearForce(**force), e=told["e"], wall=zivi.HarmonicWall(**wall))


def plain(config):
    """The settings as they come out of a file."""
    return json.loads(json.dumps(config))


def test_of_a_batch():
    batch = zivi.simulate_batch(PLANT, (0, 1), STARTS, method=zivi.ThetaGamma(1e-3))
    told = plain(batch.config)
    again = zivi.simulate_batch(
        [system_of(system) for system in told["systems"]],
        told["t_span"],
        told["y0"],
        method=zivi.ThetaGamma(**without_name(told["method"])),
        save=told["save"],
    )
    assert (told["n_systems"], told["n_runs"]) == (1, 2)
    assert told["systems"][0]["wall"] == {"name": "HarmonicWall", **WALL}
    np.testing.assert_array_equal([again.x, again.xdot], [batch.x, batch.xdot])


def test_of_a_closed_loop():
    run = zivi.simulate_closed_loop(
        PLANT, zivi.TwistingTracker(**LAW), (0, 1), STARTS[0], y_ref0=(0.4, 0.0), force_ref=-9.81
    )
    told = plain(run.config)
    again = zivi.simulate_closed_loop(
        system_of(told),
        zivi.TwistingTracker(**LAW),
        told["t_span"],
        told["y0"],
        y_ref0=told["y_ref0"],
        force_ref=told["force_ref"],
    )
    np.testing.assert_array_equal([again.x, again.u], [run.x, run.u])


def test_of_a_batch_of_closed_loops():
    batch = zivi.simulate_closed_loop_batch(
        PLANT,
        zivi.TwistingTracker(**LAW),
        (0, 1),
        STARTS,
        y_ref0=(0.4, 0.0),
        force_ref=-9.81,
        save=10,
    )
    told = plain(batch.config)
    again = zivi.simulate_closed_loop_batch(
        [system_of(system) for system in told["systems"]],
        zivi.TwistingTracker(**LAW),
        told["t_span"],
        told["y0"],
        y_ref0=told["y_ref0"],
        force_ref=told["force_ref"],
        save=told["save"],
    )
    assert (told["n_systems"], told["n_controllers"], told["n_runs"]) == (1, 1, 2)
    np.testing.assert_array_equal(again.sample_x, batch.sample_x)
    np.testing.assert_array_equal(again.sample_u, batch.sample_u)


def test_many_states_are_told_up_to_the_first_hundred():
    states = np.column_stack([np.linspace(0.1, 1.0, 150), np.zeros(150)])
    config = zivi.simulate_batch(PLANT, (0, 0.1), states, method=zivi.ThetaGamma(1e-2)).config
    assert config["y0"] == states[:100].tolist()
    assert config["n_runs"] == 150
