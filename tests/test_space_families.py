"""Random bodies with friction in two directions, put back into their equations of motion."""

import pytest

from space_families import FAMILIES, judged


@pytest.mark.parametrize("family", FAMILIES)
def test_runs_obey_the_equations_and_keep_the_balance_of_energy(family):
    """Campaigns have hundreds: `python tests/space_families.py 250`."""
    for seed in range(5):
        status, found = judged(family, seed)
        assert status == "COMPLETED", (family, seed)
        assert not found, (family, seed, found)


def test_a_foot_breaks_away_beside_two_that_slide():
    # from the start of the step the slips of those keep their directions: no steps without an end
    status, found = judged("tripod", 6)
    assert status == "COMPLETED"
    assert not found
