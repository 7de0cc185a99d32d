"""Accumulations at restitutions near 1, where rounding and long chains decide."""

import pytest

import zivi

SLIGHT_DRAG = zivi.LinearForce(gravity=9.81, damping=0.01)
REST = 1031.1633093359945
"""Of the ball from 1 m with e = 0.9999, the sum of the flight times of all arcs."""


def drop(force, e, t_end, **settings):
    system = zivi.ImpactSystem(force, e=e)
    return zivi.simulate(
        system, (0, t_end), (1, 0), zivi.SwitchedRK(**settings, flights="rk"), dense_output=False
    )


@pytest.mark.parametrize("rtol", [1e-6, 1e-10])
def test_rounding_does_not_pass_for_convergence(rtol):
    """Rounding in neighbouring rows agrees by chance long before the expansion holds."""
    sol = drop(SLIGHT_DRAG, 0.9999, 2000, rtol=rtol, atol=rtol / 1000)
    assert abs(sol.rest_time - REST) < rtol * REST
    assert len(sol.impacts) < 60_000
