"""Ctrl-C stops a long run and hands over what was computed; other threads go on meanwhile."""

import ctypes
import signal

import pytest

import zivi
from interrupting import ctrl_c

pytestmark = [pytest.mark.slow]

if not hasattr(signal, "setitimer"):
    pytest.skip("sends signals to itself", allow_module_level=True)


def compiled():
    D = ctypes.c_double
    return ctypes.CFUNCTYPE(D, D, D, D)(("fma", ctypes.CDLL(None)))  # t x + xdot


FORCES = {
    "number": (lambda: -9.81, 2e8),
    "linear": (lambda: zivi.LinearForce(gravity=9.81, stiffness=2.0, damping=0.1), 1e8),
    "compiled": (compiled, 1e8),
    "callable": (lambda: lambda t, x, xdot: -9.81, 2e7),
}


@pytest.mark.parametrize("name", FORCES)
def test_ctrl_c_stops_a_run(name):
    """Another thread sends it: the interpreter is free while what is compiled computes."""
    force, steps = FORCES[name][0](), FORCES[name][1]
    system, method = zivi.ImpactSystem(force, e=0.5), zivi.ThetaGamma(h=1 / steps)
    with ctrl_c(by="thread", answers=25), pytest.raises(KeyboardInterrupt) as stop:
        zivi.simulate(system, (0, 1), (1, 0), method)
    sol = stop.value.trajectory
    assert sol.status == zivi.Status.RAISED
    assert not sol.success
    assert len(sol.t) == len(sol.transformed.s) == sol.n_steps + 1
    assert abs(sol.x[0] - 1) < 1e-12
    # some ten seconds of work
    assert 0 < sol.n_steps < steps / 3
