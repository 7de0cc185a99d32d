"""The way into a corner, after the last impact that is computed."""

import pickle

import numpy as np
import pytest

import zivi
from mechanical_models import multi_case

pytestmark = pytest.mark.xdist_group("mechanical models")


@pytest.mark.parametrize("name", ["wedge_obtuse", "rock_tall", "dpend"])
def test_the_arcs_of_all_gaps_are_drawn(name):
    system, span, start = multi_case(name)
    method = zivi.SwitchedRK(rtol=1e-6, atol=1e-6)
    sol = zivi.simulate(system, span, start, method)
    # the same arcs, computed
    fine = zivi.simulate(system, span, start, zivi.SwitchedRK(rtol=1e-12, atol=1e-13))
    (corner,) = sol.corners
    jump = sol.resolved_impacts["t"][sol.resolved_impacts["t"] < corner["t"]][-1]
    t = np.linspace(jump, fine.corners["t"][0], 500)[1:-1]
    drawn, computed = sol.resample(t), fine.resample(t)
    height = computed.gaps[:, corner["gaps"]].max()
    assert np.abs(drawn.gaps - computed.gaps).max() < 2e-3 * height
    assert np.abs(drawn.q - computed.q).max() < 2e-3 * height
    assert np.mean(drawn.contacts == computed.contacts) > 0.98
    speeds = np.abs(computed.gap_rates[:, corner["gaps"]]).max()
    far = np.abs(drawn.gap_rates - computed.gap_rates).max(axis=1)
    assert np.quantile(far, 0.9) < 5e-3 * speeds
    assert np.array_equal(pickle.loads(pickle.dumps(sol))(t), sol(t))

    # samples alone and events see the same motion
    index = np.flatnonzero(corner["gaps"])[0]
    rest = sol(corner["t"])[0]
    normal = np.linalg.lstsq(drawn.q - rest, drawn.gaps[:, index])[0]

    def above(_t, q, _qdot):
        return normal @ (q - rest) - 0.2 * height

    times = t[:: len(t) // 20]
    sampled = zivi.simulate(
        system, span, start, method, t_eval=times, dense_output=False, events=above
    )
    assert sampled.q == pytest.approx(sol(times)[0], abs=1e-12)
    found = sampled.t_events[0][sampled.t_events[0] > jump]
    crossings = np.flatnonzero(np.diff(np.sign(drawn.gaps[:, index] - 0.2 * height)))
    assert len(found) >= len(crossings) > 0


@pytest.mark.parametrize("spacing", [1e-6, 1e-9])
def test_elastic_impacts_end_in_no_corner(spacing):
    """However short they follow each other: nothing is lost, so nothing comes to rest."""
    n, unit = 5, np.eye(5)
    gaps = [zivi.LinearGap(unit[i + 1] - unit[i], spacing) for i in range(n - 1)]
    cradle = zivi.MechanicalSystem(mass=unit, force=lambda t, q, v: -9.81 * q, e=1, gaps=gaps)
    sol = zivi.simulate(cradle, (0, 6), ([-0.3, 0, 0, 0, 0], np.zeros(n)))
    assert sol.success
    assert (len(sol.corners), len(sol.liftoffs), len(sol.zeno), len(sol.flags)) == (0, 0, 0, 0)
    # swings of one ball after the other, each passed on by four impacts
    assert len(sol.resolved_impacts) == 4 * 6
    energy = 0.5 * (sol.qdot**2).sum(axis=1) + 0.5 * 9.81 * (sol.q**2).sum(axis=1)
    assert energy == pytest.approx(energy[0], rel=1e-6)
