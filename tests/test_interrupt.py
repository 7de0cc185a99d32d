"""Ctrl-C stops a long run within a second and hands over what was computed."""

import os
import textwrap

import pytest

from interrupting import stops_within_a_second

pytestmark = [pytest.mark.slow, pytest.mark.xdist_group("interrupt")]

if os.name != "posix":
    pytest.skip("sends SIGINT to a process", allow_module_level=True)

PROGRAM = """
    import signal, sys, time
    import zivi

    signal.signal(signal.SIGINT, signal.default_int_handler)  # a background shell ignores it
    {setup}
    # some ten seconds of work
    system = zivi.ImpactSystem(force, e=0.5)
    print("started", flush=True)
    try:
        zivi.simulate(system, (0, 1), (1, 0), method=zivi.{method})
    except KeyboardInterrupt as stop:
        sol = stop.trajectory
        assert sol.status == zivi.Status.RAISED and not sol.success
        assert len(sol.t) == len(sol.s) == sol.n_steps + 1
        assert abs(sol.x[0] - 1) < 1e-12 and sol.t[-1] < 1
        print("stopped after", sol.n_steps, "steps", flush=True)
    else:
        print("the run ended before it was interrupted", flush=True)
"""
FORCES = {
    "number": "force = -9.81",
    "linear": "force = zivi.LinearForce(gravity=9.81, stiffness=2.0, damping=0.1)",
    "compiled": """
    import ctypes
    D = ctypes.c_double
    force = ctypes.CFUNCTYPE(D, D, D, D)(("fma", ctypes.CDLL(None)))  # t x + xdot""",
    "callable": "force = lambda t, x, xdot: -9.81",
    "slow callable": "force = lambda t, x, xdot: time.sleep(0.02) or -9.81",
}
STEPS = {"number": 2e8, "linear": 1e8, "compiled": 1e8, "callable": 2e7, "slow callable": 1000}


@pytest.mark.parametrize("name", FORCES)
def test_interrupt_stops_within_a_second(name):
    method = f"ThetaGamma(h={1 / STEPS[name]!r})"
    program = textwrap.dedent(PROGRAM).format(setup=textwrap.dedent(FORCES[name]), method=method)
    assert stops_within_a_second(program) > 0
