"""Random motions with friction and impacts against an oracle in extended precision.

``tests/data/friction_oracle.json`` is of ``benchmarks/friction_families.py``, which has the large
campaigns.
"""

import json
from pathlib import Path

import pytest

import friction_draws as draws

STORED = json.loads((Path(__file__).parent / "data" / "friction_oracle.json").read_text())
TOL = 1e-9


def motions(family):
    for line, truth in STORED:
        it = draws.Draw.read(line)
        if it.family == family:
            yield it, truth


@pytest.mark.slow
@pytest.mark.parametrize("family", draws.SYSTEMS)
def test_the_motion_is_that_of_the_oracle(family):
    """The events, the state at the end, the work of friction, the energy."""
    for it, truth in motions(family):
        verdict = draws.compare(it, draws.simulate(it, TOL), truth, TOL)
        assert verdict.status == "COMPLETED", it
        assert (verdict.missing, verdict.invented) == ([], []), it
        for name in ("state", "times", "dissipated", "energy"):
            assert not getattr(verdict, name) > 20, (name, it)
