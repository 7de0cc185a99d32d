"""Mechanical runs, derivatives, the solver and the controllers stay as they are, to the last bit.

A correction that is meant to change results makes the file anew (see ``golden.solvers``).
"""

import pytest

from golden.solvers import GROUPS, read, trace
from golden.trace import libm

MADE_WITH, TRACES = read()


@pytest.mark.skipif(
    libm() != MADE_WITH,
    reason="the C library's functions differ in their last bits from those of the traces",
)
@pytest.mark.parametrize("group", GROUPS)
def test_every_bit_is_as_it_was(group):
    changed = [
        name for name, run in GROUPS[group]() if trace(run()) != TRACES.get(f"{group} {name}")
    ]
    assert not changed, f"{len(changed)} changed, first: " + "; ".join(changed[:5])


def test_every_trace_has_its_run():
    names = [f"{group} {name}" for group, runs in GROUPS.items() for name, _ in runs()]
    assert len(names) == len(set(names)) > 700
    assert set(names) == set(TRACES)
