"""Loops of an arm with one thing wrong, beside those of an independent prototype."""

import pytest

from mechanical_arms import bouncing_error
from robust_arms import ROWS, posture_error, robust


@pytest.mark.parametrize("name", ROWS)
def test_an_arm_follows_and_rests_as_well_as_a_prototype_did(name):
    run = robust(name)
    gap, posture = ROWS[name][2:]
    assert run.contacts[-1].all()
    assert run.gaps[-1, 0] == 0.0
    assert bouncing_error(run) < 1.5 * gap
    assert posture_error(run) < 1.5 * posture
