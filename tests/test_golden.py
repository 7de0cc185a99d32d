"""Golden traces: results stay as they are, to the last bit, while the code is rebuilt.

A correction that is meant to change results makes the file anew (see ``golden.trace``) and says so
in CHANGELOG.md.
"""

import numpy as np
import pytest

import zivi
from golden.cases import GROUPS
from golden.trace import libm, read, trace

MADE_WITH, TRACES = read()

needs_libm = pytest.mark.skipif(
    libm() != MADE_WITH,
    reason="the C library's functions differ in their last bits from those of the traces",
)


@needs_libm
@pytest.mark.filterwarnings("ignore:a landing may never rest")
@pytest.mark.parametrize("group", GROUPS)
def test_every_bit_is_as_it_was(group):
    changed = [
        f"{name}: {TRACES.get(name)} -> {now}"
        for name, run in GROUPS[group]()
        if (now := trace(run())) != TRACES.get(name)
    ]
    assert not changed, f"{len(changed)} changed, first: " + "; ".join(changed[:5])


def test_every_trace_has_its_run():
    names = [name for group in GROUPS.values() for name, _ in group()]
    assert len(names) == len(set(names)) > 1000
    assert set(names) == set(TRACES)


def test_one_bit_changes_a_trace():
    ball = zivi.ImpactSystem(-9.81, e=0.5)
    sol = zivi.simulate(ball, (0, 1), (1, 0))
    before = trace(sol)
    sol.xdot[2] = np.nextafter(sol.xdot[2], np.inf)
    assert trace(sol) != before
