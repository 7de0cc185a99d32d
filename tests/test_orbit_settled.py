"""What many runs settle on, exponents, and how a resting mass lifts off."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import numpy as np
import pytest

import zivi
from inside import (
    PRECISE,
    Attractor,
    MassFlow,
    Settled,
    _chain,
    chatter_exponent,
    orbits_attractor as attractor,
    orbits_cells as cells,
    orbits_lyapunov as lyapunov,
    resting_orbit,
)
from orbit_tables import THREE, TURN, equations, frame, table
from zivi.simulation.methods import SwitchedRK


def settled(rows: Any, **other: Any) -> Settled:
    values: dict[str, Any] = {"zeno_times": np.empty(0), "liftoff_times": np.empty(0)}
    values |= {"rests": False, "end": np.zeros(2), "success": True}
    return Settled(np.array(rows, float).reshape(-1, 2), **(values | other))


def classed(it: Settled, keep: int = 8) -> Attractor:
    return attractor.classify(table(), it, TURN, keep)


def test_kinds_of_what_runs_settle_on():
    assert classed(settled([], success=False)).kind == "failed"
    assert classed(settled([])).kind == "flight"
    assert classed(settled([])).multiple == 1
    rest_ = classed(settled([(1, 2)], rests=True))
    assert (rest_.kind, rest_.multiple, rest_.impacts.shape) == ("rest", 0, (0, 2))
    times = TURN * np.arange(8)
    for speeds, m in (([3.0], 1), ([3.0, 2.0], 2), ([3.0, 2.0, 5.0, 1.0], 4)):
        rows = np.column_stack([times + 0.5, np.tile(speeds, 8)[:8]])
        found = classed(settled(rows))
        assert (found.kind, found.multiple) == ("impacting", m)
        np.testing.assert_allclose(found.impacts[:, 0], 0.5 / TURN)
        assert sorted(found.impacts[:, 1]) == sorted(speeds)
    irregular = classed(settled(np.column_stack([times, np.arange(8.0) ** 2])))
    assert (irregular.kind, irregular.multiple, len(irregular.impacts)) == ("irregular", 0, 0)
    # a motion must be seen twice
    three = np.column_stack([times + 0.5, np.tile([3.0, 2.0, 5.0], 8)[:8]])
    assert classed(settled(three)).multiple == 3
    assert classed(settled(three[:5]), 5).kind == "irregular"
    # two impacts in a period, in the order of their phases
    two = np.column_stack([np.sort(np.concatenate([times + 5.0, times + 6.5])), [2.0, 3.0] * 8])
    found = classed(settled(two))
    np.testing.assert_allclose(found.impacts[:, 0], [(6.5 - TURN) / TURN, 5.0 / TURN])
    off = settled(np.column_stack([times + 0.5 + 3e-5 * TURN * np.arange(8) ** 2, 0 * times + 3]))
    assert classed(off).kind == "irregular"
    assert attractor.classify(table(), off, TURN, 8, 1e-2).kind == "impacting"


def test_motions_that_rest_again_and_again():
    rows = [(0.5, 2.0), (1.0, 1.0), (0.5 + TURN, 2.0), (7.5, 1.0)]
    lifts = np.array([0.2, 0.2 + TURN])
    found = classed(settled(rows, zeno_times=np.array([1.5, 8.0]), liftoff_times=lifts))
    assert (found.kind, found.multiple) == ("resting", 1)
    np.testing.assert_allclose(found.impacts, [[0.5 / TURN, 2.0]])
    # lift-offs two periods apart; after the last no impact was seen
    lifts = np.array([0.2, 0.2 + 2 * TURN])
    found = classed(settled(rows, zeno_times=np.array([8.0]), liftoff_times=lifts))
    assert found.multiple == 2
    np.testing.assert_allclose(found.impacts, [[0.5 / TURN, 2.0]])
    # three rests in two periods: the motion begins at the smallest phase, whichever comes first
    rows = [(1.5, 1.0), (4.0, 2.0), (1.5 + TURN, 3.0)]
    rows += [(t + 2 * TURN, u) for t, u in rows]
    lifts = np.array([1.0, 3.0, 1.3 + TURN])
    lifts = np.append(lifts, lifts + 2 * TURN)
    for late in (0.0, 2.0, 4.0):
        seen = [it for it in rows if it[0] > late]
        own = settled(seen, zeno_times=lifts - 0.1, liftoff_times=lifts[lifts > late])
        found = classed(own, 4)
        assert (found.kind, found.multiple) == ("resting", 2)
        np.testing.assert_allclose(found.impacts, [[1.5 / TURN, 1.0]])
    # nothing lifts it off in the eight periods that were noted
    assert classed(settled(rows, rests=True, liftoff_times=np.array([0.2, 0.3]))).kind == "rest"


@pytest.mark.parametrize("keep", [3, 5])
def test_fewer_periods_than_a_resting_motion_takes_twice(keep):
    system, period, state = THREE
    kinds = []
    for transient in (100, 101, 102):
        (it,) = attractor.settle([system], np.array([state]), [period], transient, keep, PRECISE)
        kinds.append(attractor.classify(system, it, period, keep))
    assert [(it.kind, it.multiple) for it in kinds] == [("resting", 3)] * 3
    assert all(it.is_same(kinds[0], 1e-9) for it in kinds)
    # a run that left the rest for another motion
    (it,) = attractor.settle([system], np.array([state]), [period], 100, 8, PRECISE)
    early = dataclasses.replace(
        it, zeno_times=it.zeno_times[:1], liftoff_times=it.liftoff_times[:1]
    )
    assert attractor.classify(system, early, period, 8).kind != "resting"


def test_which_motions_are_the_same():
    rows = np.array([[0.1, 2.0], [0.6, 1.0]])
    one = Attractor("impacting", 2, rows)
    for other, same in (
        (Attractor("impacting", 2, rows + np.array([[1e-4, 0], [0, 0]])), True),
        (Attractor("impacting", 2, rows + np.array([[0, 1.9e-3], [0, 0]])), True),
        (Attractor("impacting", 2, rows + np.array([[0, 2.1e-3], [0, 0]])), False),
        (Attractor("impacting", 2, rows + np.array([[2e-3, 0], [0, 0]])), False),
        (Attractor("impacting", 1, rows), False),
        (Attractor("resting", 2, rows), False),
        (Attractor("impacting", 2, rows[:1]), False),
        (Attractor("impacting", 2, rows + np.array([[1.0, 0], [0, 0]])), True),
        (Attractor("impacting", 2, rows[::-1]), True),
    ):
        assert one.is_same(other, 1e-3) is same
        assert other.is_same(one, 1e-3) is same
    edge = Attractor("impacting", 1, np.array([[0.9999, 1.0]]))
    assert edge.is_same(Attractor("impacting", 1, np.array([[0.0001, 1.0]])), 1e-3)
    none = Attractor("rest", 0, np.empty((0, 2)))
    assert none.is_same(Attractor("rest", 0, np.empty((0, 2))), 1e-3)
    wild = Attractor("irregular", 0, rows)
    assert wild.is_same(Attractor("irregular", 0, rows + 0.3), 1e-3)
    still = Attractor("impacting", 1, np.array([[0.2, 0.0]]))
    assert still.is_same(Attractor("impacting", 1, np.array([[0.2, 0.0005]])), 1e-3)
    # rows between times: the later end belongs
    np.testing.assert_array_equal(attractor.between(rows, 0.1, 0.6), rows[1:])


def test_states_that_merge():
    states = np.array([[1.0, 2.0], [3.0, 4.0], [1.0 + 1e-9, 2.0], [math.nan] * 2, [math.nan] * 2])
    now, which = cells._merged(states, SwitchedRK(rtol=1e-6, atol=1e-9))
    assert which[0] == which[2] != which[1]
    assert which[3] == which[4]
    assert len(now) == 3
    for i, k in enumerate(which):
        np.testing.assert_allclose(now[k], states[i], rtol=1e-8)
    # apart by more than the tolerance, relative to the largest; each component with its own
    apart = np.array([[1.0, 0.0], [1.00001, 0.0], [100.0, 1e-3]])
    assert len(set(cells._merged(apart, SwitchedRK(rtol=1e-9, atol=1e-12))[1])) == 3
    assert len(set(cells._merged(apart, SwitchedRK(rtol=1e-6, atol=1e-12))[1])) == 2
    loose = SwitchedRK(rtol=1e-14, atol=(1e-3, 1e-12))
    assert len(set(cells._merged(apart, loose)[1])) == 2


def test_shares_and_borders_of_basins():
    kinds = [Attractor("rest", 0, np.empty((0, 2))), Attractor("impacting", 2, np.ones((1, 2)))]
    label = np.array([[0, 0, 0, 1], [0, 0, 0, 1], [0, 0, 0, 0]])
    grazing = np.zeros((3, 4), dtype=bool)
    grazing[2, 0] = True
    found = zivi.Basins(np.arange(4.0), np.arange(3.0), label, kinds, grazing)
    border = np.array([[0, 0, 1, 1], [0, 0, 1, 1], [1, 0, 0, 1]], bool)
    np.testing.assert_array_equal(found.border, border)
    np.testing.assert_array_equal(found.grazing, grazing)
    np.testing.assert_allclose(found.shares, [10 / 12, 2 / 12])
    assert repr(found) == "<Basins of 12 cells: rest x0: 83.3%, impacting x2: 16.7%, 1 cells graze>"
    outside = dataclasses.replace(found, label=label - (label == 0))
    assert repr(outside).endswith("1 cells graze, 10 cells with a negative gap>")
    data = found.to_xarray()
    assert data.label.dims == data.border.dims == data.grazing.dims == ("xdot0", "x0")
    np.testing.assert_array_equal(data.label, label)
    np.testing.assert_array_equal(data.border, border)
    assert list(data.kind.values) == ["rest", "impacting"]
    assert list(data.multiple.values) == [0, 2]
    np.testing.assert_array_equal(data.x0, np.arange(4.0))
    np.testing.assert_array_equal(data.xdot0, np.arange(3.0))
    assert data.attrs["title"] == "Basins of attraction"
    assert data.attrs["source"] == f"zivi {zivi.__version__}"
    assert zivi.Basins(
        np.zeros(1), np.zeros(1), label[:1, :1], [*kinds, kinds[0]], grazing[:1, :1]
    ).shares.tolist() == [1, 0, 0]


def test_diagrams_as_datasets():
    kinds = [Attractor("rest", 0, np.empty((0, 2))), Attractor("impacting", 1, np.ones((1, 2)))]
    values = np.array([1.0, 2.0])
    for section, names in (("impacts", ("phase", "u")), ("strobe", ("x", "xdot"))):
        found = zivi.Diagram(
            "amplitude", section, values[[1, 1]], np.array([0.1, 0.2]), np.array([3.0, 4.0]),
            np.array([1, 1]), values, np.array([0, 1]), kinds,
        )  # fmt: skip
        data = found.to_xarray()
        np.testing.assert_array_equal(data[names[0]], [0.1, 0.2])
        np.testing.assert_array_equal(data[names[1]], [3.0, 4.0])
        np.testing.assert_array_equal(data.amplitude, [2.0, 2.0])
        np.testing.assert_array_equal(data.run_of_point, [1, 1])
        np.testing.assert_array_equal(data.run_value, values)
        np.testing.assert_array_equal(data.start, [0, 1])
        assert list(data.kind.values) == ["rest", "impacting"]
        assert list(data.multiple.values) == [0, 1]
        assert data.amplitude.dims == data[names[0]].dims == data.run_of_point.dims == ("point",)
        assert data.run_value.dims == data.kind.dims == data.start.dims == ("run",)
        assert data.attrs["title"] == "Bifurcation diagram"
        assert data.attrs["source"] == f"zivi {zivi.__version__}"
        np.testing.assert_array_equal(found.resting, [True, False])
        assert repr(found) == "<Diagram over amplitude: 2 runs, 1 at rest, 2 points>"
        assert found.message == "Every run settled on a periodic motion, or rests."


def test_a_diagram_counts_the_runs_without_a_periodic_motion():
    kinds = ["failed", "impacting", "irregular", "irregular"]
    found = zivi.Diagram(
        "a", "impacts", *np.zeros((3, 1)), np.zeros(1, int), np.zeros(4), np.zeros(4, int),
        [Attractor(kind, 0, np.empty((0, 2))) for kind in kinds],
    )  # fmt: skip
    told = "3 of 4 runs without a periodic motion (2 irregular, 1 failed)"
    assert repr(found) == f"<Diagram over a: 4 runs, 0 at rest, 1 points, {told}>"
    assert told in found._repr_html_()
    assert found.message.startswith(f"{told}; ")


def test_exponents_tell_what_became_of_the_run():
    table = zivi.LinearForce(gravity=1.0, amplitude=1.3, phase=-math.pi / 2)
    found = zivi.lyapunov_exponents(zivi.ImpactSystem(table, e=0.5), (0, 90), (0.1, 2.0), 30)
    values = ", ".join(f"{it:.6g}" for it in found.exponents)
    told = f"over {found.duration:.6g} s, {found.n_impacts} impacts"
    assert repr(found) == f"<Lyapunov {values} 1/s {told}: completed>"
    assert found.message == "The exponents are means over the run."
    rests = zivi.lyapunov_exponents(zivi.ImpactSystem(-9.81, e=0.5), (0, 9), (0.1, 2.0))
    assert "2 of 2 exponents are minus infinity: rests>" in repr(rests)
    assert rests.message.endswith(" 2 of 2 exponents are minus infinity.")

    def ends(t, x, xdot):
        return math.nan if t > 3 else -9.81

    early = zivi.lyapunov_exponents(zivi.ImpactSystem(ends, e=0.9), (0, 9), (0.1, 2.0))
    assert repr(early).endswith("2 of 2 exponents are not known: run_ended>")
    assert early.trajectory.message in early.message
    assert "2 of 2 exponents are not known" in early._repr_html_()


def test_means_of_exponents():
    # a constant map diag(2, 1/4) each 0.5 s: ln 2/.5 and -ln 4/.5
    maps, times = [np.diag([2.0, 0.25])] * 60, 0.5 * np.arange(61)
    np.testing.assert_allclose(
        lyapunov._means(maps, times), [2 * math.log(2), -2 * math.log(4)], rtol=1e-12
    )
    np.testing.assert_allclose(
        lyapunov._means([np.diag([0.25, 2.0])] * 60, times + 7), [2 * math.log(2), -2 * math.log(4)]
    )
    # rotations: the mean of both
    angle = 1.0
    turn = 0.5 * np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])
    np.testing.assert_allclose(lyapunov._means([turn] * 60, times), [-2 * math.log(2)] * 2)


# rest


def test_when_a_resting_mass_lifts_off():
    # -1 + F sin t > 0 from arcsin(1/F) on, also where it is so for a short time
    for amplitude in (1.3, 1.5, 1 + 1e-9):
        orbit = resting_orbit(table(amplitude), PRECISE, TURN)
        assert orbit.liftoff_time == pytest.approx(math.asin(1 / amplitude), abs=1e-7)
        later = resting_orbit(table(amplitude), PRECISE, TURN, 6.0)
        assert later.liftoff_time == pytest.approx(orbit.liftoff_time, abs=1e-9)
    assert resting_orbit(table(0.9), PRECISE, TURN).status is zivi.OrbitStatus.RESTS
    up = zivi.ImpactSystem(zivi.LinearForce(gravity=-1.0, amplitude=0.1), e=0.5)
    assert resting_orbit(up, PRECISE, TURN).message == "The mass never stays at rest."


def test_the_force_on_a_mass_at_rest():
    def pull(system, t):
        flow, still = MassFlow(system, PRECISE), np.zeros(2)
        (force,) = flow.reactions((0,), np.array([t]), still[None])[0]
        one = flow.reaction((0,), 0, t, still)
        assert one.value == force
        # by differences of another order
        h = 1e-4
        ends = flow.reactions((0,), np.array([t + h, t - h]), np.zeros((2, 2)))[:, 0]
        assert one.by_t == pytest.approx((ends[0] - ends[1]) / (2 * h), abs=1e-6)
        return -force

    assert pull(table(), 0.7) == pytest.approx(-1 + 1.3 * math.sin(0.7))
    wall = zivi.HarmonicWall(0.1, 2.0, 0.3)
    moving = zivi.ImpactSystem(
        zivi.LinearForce(stiffness=3, damping=0.5, gravity=1), e=0.5, wall=wall
    )
    w, wdot, wddot = (float(it) for it in wall(0.7))
    assert pull(moving, 0.7) == pytest.approx(-3 * w - 0.5 * wdot - 1 - wddot)
    slopes = MassFlow(moving, PRECISE).reaction((0,), 0, 0.7, np.zeros(2)).by_z
    np.testing.assert_allclose(slopes, [3, 0.5], rtol=1e-9)
    assert pull(zivi.ImpactSystem(-9.81, e=0.5), 0.7) == -9.81
    for force in (lambda t, x, v: t + x + v - 2, lambda t, y: t + y[0] + y[1] - 2):
        assert pull(zivi.ImpactSystem(force, e=0.5), 0.5) == -1.5


def test_exponents_at_the_end_of_a_rest():
    for e, lam, mu, beta in (
        (0.5, 0.660442, 1.989600, 0.603031),
        (0.3, 0.488144, 3.247151, 0.608896),
    ):
        assert chatter_exponent(e) == pytest.approx(beta, abs=1e-6)
        assert math.log(1 / lam) / math.log(mu) == pytest.approx(beta, abs=2e-6)
    # lam at any e by bisection of its equation, with the printed mu
    for e in (0.05, 0.7, 0.95):
        low, high = 0.0, 1.0
        for _ in range(80):
            lam = 0.5 * (low + high)
            low, high = (lam, high) if lam**3 + 2 * lam**2 < e * (1 + 2 * lam) else (low, lam)
        tau = 1 - lam
        top = (0.5 - 2 * tau / 3) * (1 - tau) + 2 * (tau / 2 - tau**2 / 3)
        mu = e * top / ((1 - tau) ** 3 * (0.5 - tau / 3))
        assert chatter_exponent(e) == pytest.approx(math.log(1 / lam) / math.log(mu))


def test_chains_of_impacts():
    def chain(speeds):
        rows = np.column_stack([np.arange(len(speeds)) + 0.1, speeds])
        terms = equations(table(), frame(), rows)
        object.__setattr__(terms, "rates", -np.array(speeds))
        return _chain(terms)

    assert chain([3.0, 2.0, 1.0, 0.5]) == 0
    assert chain([1.0, 0.5, 3.0, 2.0]) == 2  # in any turn
    assert chain([3.0, 2.0, 1.0]) is None
    assert chain([3.0, 2.0, 2.5, 1.0]) is None
    assert chain([3.0, 2.0, 1.0, 0.5, 0.7]) == 0


def test_exponents_of_a_flight_are_those_of_equal_parts(monkeypatch):
    rows = []
    flown = lyapunov.fly
    monkeypatch.setattr(lyapunov, "fly", lambda *a, **k: rows.append(a[1]) or flown(*a, **k))
    force = zivi.LinearForce(stiffness=1.0, damping=0.2, gravity=-3.0, amplitude=0.3, omega=0.7)
    found = zivi.lyapunov_exponents(
        zivi.ImpactSystem(force, e=0.5), (5.0, 105.0), (3.0, 0.1), transient=20.0
    )
    (parts,) = rows
    np.testing.assert_allclose(parts[:, 0], np.linspace(25, 105, 201)[:-1])
    np.testing.assert_allclose(parts[:, 3], np.linspace(25, 105, 201)[1:])
    np.testing.assert_allclose(parts[:, 1:3], found.trajectory(parts[:, 0]).T, atol=1e-12)
    np.testing.assert_allclose(found.exponents, [-0.1, -0.1], atol=1e-3)
    assert (found.duration, found.n_impacts) == (80.0, 0)
    assert found.exponents.sum() == pytest.approx(-0.2, rel=1e-6)
    # a single impact after the transient makes no map either
    once = zivi.lyapunov_exponents(table(), (0, 9.0), (0.1, 2.0), transient=4.0)
    assert once.n_impacts == 0
