"""Random loops of arms: landings in corners, positions only with everything wrong at once."""

import numpy as np
import pytest

import zivi
from mechanical_arms import bouncing_error, positions_only
from random_arms import closed_since, land


@pytest.mark.slow
@pytest.mark.parametrize(
    ("seed", "wrong", "within"), [(0, 1, 1.0), (1, 1, 1.0), (2, 1, 1.0), (159, 0, 2.0)]
)
def test_random_arms_land_on_all_planes(seed, wrong, within):
    run = land(seed, wrong)
    assert closed_since(run) < within
    np.testing.assert_array_equal(run.gaps[-1], 0.0)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(3))
def test_measured_angles_are_enough_with_everything_wrong_at_once(seed):
    run = positions_only(seed)
    assert run.contacts[-1, 0]
    assert run.gaps[-1, 0] == 0.0
    assert bouncing_error(run) < 1e-4
    assert np.all(abs(run.reactions[-100:] - 10.0) < 3.0)
    assert not np.any(run.tick_status[-100:] & zivi.TickStatus.LATCH_LOST)
