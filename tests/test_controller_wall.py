"""Controllers that take the plant's e, and those that believe in another one."""

import copy
import pickle
import warnings

import numpy as np
import pytest

import zivi

PLANT = zivi.ImpactSystem(-9.81, e=0.7)
KINDS = {
    "regulator": zivi.TwistingRegulator,
    "tracker": zivi.TwistingTracker,
    "explicit": zivi.ExplicitTwisting,
}


def run_of(controller, plant=PLANT, **more):
    given = {} if isinstance(controller, zivi.TwistingRegulator) else {"force_ref": -15.0}
    return zivi.simulate_closed_loop(plant, controller, (0, 1), (1, 0), **given | more)


@pytest.mark.parametrize("name", KINDS)
def test_a_controller_without_e_takes_the_plants(name):
    kind = KINDS[name]
    bare = kind(30, 17, h=1e-2)
    if name != "regulator":
        bare.reset(0.5, 1.0)
    known = kind(30, 17, h=1e-2, e=0.7)
    if name != "regulator":
        known.reset(0.5, 1.0)
    for controller in (bare, copy.copy(bare), pickle.loads(pickle.dumps(bare))):
        run, same = run_of(controller), run_of(known)
        np.testing.assert_array_equal(run.u, same.u)
        np.testing.assert_allclose(run.x_ref, same.x_ref, rtol=1e-14)
        assert run.config["controller"]["kappa"] == PLANT.kappa
    # the controller that was given is as it was: another plant, another e
    softer = run_of(bare, zivi.ImpactSystem(-9.81, e=0.2))
    assert softer.config["controller"]["kappa"] == pytest.approx(0.8 / 1.2)
    assert "kappa" not in repr(bare)


@pytest.mark.parametrize("name", KINDS)
def test_alone_it_cannot_tick(name):
    bare = KINDS[name](30, 17, h=1e-2)
    with pytest.raises(ValueError, match="e of the controller is not set"):
        bare.step(1.0, 0.0, -9.81)
    with pytest.raises(ValueError, match="e of the controller is not set"):
        _ = bare.e


def test_gains_are_checked_once_the_plant_is_known():
    zivi.TwistingTracker(30, 17, h=1e-3, bound=6.0)
    with pytest.raises(ValueError, match="bound"):
        run_of(zivi.TwistingTracker(30, 17, h=1e-3, bound=6.0), zivi.ImpactSystem(-9.81, e=0.1))


def test_another_e_than_the_plants_is_told():
    controller = zivi.TwistingTracker(30, 17, h=1e-2, e=0.5)
    with pytest.warns(zivi.ModelWarning, match=r"believes in e = 0.5, the plant has e = 0.7"):
        run_of(controller)
    with pytest.warns(zivi.ModelWarning, match=r"e = 0.5"):
        zivi.simulate_closed_loop_batch(PLANT, controller, (0, 1), (1, 0), force_ref=-15.0)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        # the same number by way of kappa
        run_of(zivi.TwistingTracker(30, 17, h=1e-2, kappa=0.3 / 1.7))


def test_a_batch_gives_each_controller_its_plants_e():
    plants = [zivi.ImpactSystem(-9.81, e=e) for e in (0.2, 0.5, 0.8)]
    bare = zivi.TwistingTracker(30, 17, h=1e-2)
    batch = zivi.simulate_closed_loop_batch(
        plants, bare, (0, 1), (1, 0), y_ref0=(0.5, 0), force_ref=-15.0
    )
    for i, plant in enumerate(plants):
        assert run_of(bare, plant, y_ref0=(0.5, 0)).x[-1] == batch.x[i]
