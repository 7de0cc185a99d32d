"""Batches of loops of mechanical systems are the loops one by one."""

import numpy as np
import pytest

import zivi
from mechanical_arms import START, tapping, tracker, two_links


def test_a_batch_is_its_loops_to_the_last_bit():
    arm, n = two_links(), 3
    masses = np.array([0.7, 0.8, 0.95])
    q0 = START + 0.02 * np.random.default_rng(1).standard_normal((n, 2))
    asked = {"reference": tapping(), "method": zivi.RKPeriod()}
    batch = zivi.simulate_closed_loop_batch(
        arm,
        tracker(horizon=3.0),
        (0, 0.4),
        (q0, np.zeros(2)),
        noise=(1e-5, 1e-3),
        seed=range(n),
        parameters={"m2": masses},
        threads=2,
        save="runs",
        **asked,
    )
    for i in range(n):
        run = zivi.simulate_closed_loop(
            arm.replace(m2=masses[i]),
            tracker(horizon=3.0),
            (0, 0.4),
            (q0[i], np.zeros(2)),
            noise=(1e-5, 1e-3),
            seed=i,
            **asked,
        )
        assert np.array_equal(batch.q[i], run.q[-1])
        assert np.array_equal(batch.runs[i].u, run.u)
        assert batch.n_impacts[i] == len(np.unique(run.impacts["group"]))
        assert batch.error_max[i] == np.abs(run.error_gaps).max(axis=0)
    assert len(batch) == n
    assert batch.success.all()
    assert batch.to_xarray().q.dims == ("run", "coordinate")


def test_what_differs_must_be_as_many():
    ball = zivi.MechanicalSystem(mass=1.0, force=[0.0], gaps=[zivi.LinearGap([1])], e=0.5)
    ctl = zivi.GapTracker(ball, h=1e-2, gains={"gap0": (30, 17)})
    starts = np.array([[[0.1], [0.0]], [[0.2], [0.0]]])
    batch = zivi.simulate_closed_loop_batch(ball, ctl, (0, 0.5), starts, reference="rest")
    assert batch.contacts.tolist() == [[True], [True]]
    with pytest.raises(ValueError, match="as many"):
        zivi.simulate_closed_loop_batch(ball, ctl, (0, 0.5), starts, seed=[1, 2, 3])
    with pytest.raises(KeyError, match="unknown parameter 'm'"):
        zivi.simulate_closed_loop_batch(ball, ctl, (0, 0.5), starts, parameters={"m": [1, 2]})
    plant, regulator = zivi.ImpactSystem(-9.81, e=0.5), zivi.TwistingRegulator(30, 17, h=1e-3)
    with pytest.raises(TypeError, match="parameters is for a zivi"):
        zivi.simulate_closed_loop_batch(plant, regulator, (0, 1), (1, 0), parameters=[1])


def test_seeds_is_the_former_name_of_seed():
    """The same word for one mass and for mechanisms; the former one warns."""
    ball = zivi.MechanicalSystem(mass=1.0, force=[-1.0], inputs=[[1.0]])
    plant = zivi.ImpactSystem(-1.0, e=0.5)

    class Noisy:
        h = 1e-2

        def step(self, *sample):
            return np.ravel(sample[-2])[0]

    for system, start in ((ball, ([1.0], [0.0])), (plant, (1, 0))):
        given = (system, Noisy(), (0, 0.1), start)
        noise = {"noise": (1e-3, 1e-3)}
        batch = zivi.simulate_closed_loop_batch(*given, seed=[5, 6], **noise)
        with pytest.warns(DeprecationWarning, match="use seed=") as told:
            former = zivi.simulate_closed_loop_batch(*given, seeds=[5, 6], **noise)
        assert told[0].filename == __file__
        np.testing.assert_array_equal(former.u_variation, batch.u_variation)
        assert batch.config["seed"] == former.config["seed"] == [5, 6]
        assert len(np.unique(batch.u_variation)) == 2
