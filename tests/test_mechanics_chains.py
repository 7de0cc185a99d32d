"""Random chains and stacks of bodies: every run is solved, and obeys the law of impact."""

from random import Random

import numpy as np
import pytest

import zivi
from chains import Chain, Followed


def check(chain: Chain):
    """Give the run, after a look at its impacts and its energy."""
    sol = chain.simulate()
    assert sol.success, (sol.message, chain)
    rows = sol.resolved_impacts
    expected = -chain.e[rows["gap"]] * rows["speed_before"]
    size = 1e-12 * (1 + np.abs(rows["speed_before"]))
    assert (rows["impulse"] >= 0).all()
    assert (rows["speed_after"] >= expected - size).all()
    hit = rows["impulse"] > 0
    assert (np.abs(rows["speed_after"] - expected)[hit] <= size[hit]).all()
    work = rows["impulse"] * (rows["speed_before"] + rows["speed_after"]) / 2
    if len(rows):
        assert np.bincount(rows["group"], work).max() <= 1e-12
    energy = chain.energy(sol.q, sol.qdot)
    assert (np.diff(energy) <= 1e-6 * (1 + np.abs(energy).max())).all()
    assert sol.gaps.min() >= -1e-14
    assert np.abs(sol.q @ chain.normals.T + chain.offsets - sol.gaps).max() < 1e-6
    return sol


def test_random_chains():
    """5000 of them: benchmarks/random_chains.py."""
    random = Random(7)
    impacts = sum(len(check(Chain.random(random)).impacts) for _ in range(30))
    assert impacts > 300


def test_bodies_that_a_force_pulls_off_a_wall():
    """Plastic: hit again and again before they have left, until the speeds are zero."""
    gaps = [zivi.LinearGap([-1, 1]), zivi.LinearGap([0, -1], 1)]
    system = zivi.MechanicalSystem(mass=np.diag([1, 2]), force=[-0.5, -0.5], e=0, gaps=gaps)
    sol = zivi.simulate(system, (0, 2), ([0.5, 0.5], [1, 1]))
    assert sol.success
    # from rest at the wall, by the constant forces
    last = sol.resolved_impacts["t"][-1]
    t = 2 - last
    assert sol.q[-1] == pytest.approx([1 - 0.25 * t * t, 1 - 0.125 * t * t], abs=1e-5)


@pytest.mark.parametrize("rtol", [1e-4, 1e-6, 1e-8])
def test_bodies_that_a_force_pulls_off_a_wall_after_a_corner(rtol):
    """Impacts of both gaps in turn end at the wall without speeds, and nothing presses there."""
    mass, force, gaps = np.array([1.0, 2]), np.full(2, -0.5), np.array([[-1.0, 1], [0, -1]])
    start = np.full(2, 0.5), np.ones(2)
    chain = Chain(mass, force, gaps, np.array([0.0, 1.0]), np.full(2, 0.05), start)
    sol = chain.simulate(rtol=rtol)
    exact = Followed(chain, slow=0.0)
    exact.until(chain.end, 44)
    assert abs(exact.v).max() < 1e-12
    assert sol.corners["t"] == pytest.approx([exact.t], abs=1e-13)
    t = chain.end - exact.t
    assert sol.q[-1] == pytest.approx([1 - 0.25 * t * t, 1 - 0.125 * t * t], abs=1e-13)
    assert sol.qdot[-1] == pytest.approx([-0.5 * t, -0.25 * t], abs=1e-13)


def test_gaps_that_another_one_still_strikes_do_not_close_alone():
    """Three bodies on an elastic floor come to rest by a pattern of seven impacts, all at once."""
    random = Random(4)
    chain = [Chain.random(random) for _ in range(24)][-1]
    sol = check(chain)
    first = sol.corners[0]
    assert list(np.flatnonzero(first["gaps"])) == [0, 1, 4]
    # times that are left shrink by one ratio from cycle to cycle
    rows = sol.resolved_impacts
    left = first["t"] - rows["t"][rows["gap"] == 4]
    left = left[(left > 1e-6) & (left < 1e-4)]
    assert len(left) > 10
    assert np.ptp(left[1:] / left[:-1]) < 1e-3


def drawn(number, seed=1):
    """Give the chain of that number of benchmarks/random_chains.py."""
    random = Random(seed)
    for _ in range(number):
        Chain.random(random)
    return Chain.random(random)


# elastic gaps come to rest with the others, although they still have 1e-8 m/s, a little more (2105,
# 3695): left alone they would bounce 1e9 times a second; impacts of five bodies at one instant end
# in their limit, after which the forces pull one of them away (3054)
@pytest.mark.parametrize("number", [2105, 3695, 3054])
def test_all_gaps_of_an_accumulation_come_to_rest_at_once(number):
    chain = drawn(number)
    sol = check(chain)
    exact = Followed(chain, slow=1e-7)
    assert exact.until(chain.end)
    assert sol.q[-1] == pytest.approx(exact.q, abs=1e-6)
    assert sol.qdot[-1] == pytest.approx(exact.v, abs=1e-6)


def test_an_elastic_gap_that_is_hit_seldom_comes_to_rest_with_the_others():
    """Six bodies on an elastic floor: the last 42 impacts were of other gaps."""
    chain = drawn(127, seed=2)
    sol = check(chain)
    assert len(sol.corners) == 1
    assert sol.corners["gaps"].all()
    exact = Followed(chain, slow=0.0)
    exact.until(chain.end, 4000)
    # what is left
    assert exact.g.max() < 1e-10
    assert abs(exact.rate).max() < 1e-3
    assert sol.corners["t"] == pytest.approx([exact.t], abs=5e-5)
    assert sol.q[-1] == pytest.approx(np.zeros(6), abs=1e-9)


def test_a_stack_comes_to_rest_with_all_its_gaps():
    """Two are elastic: the speeds of all three fall by a thirtieth a period, down to rounding."""
    chain = drawn(4401)
    sol = check(chain)
    exact = Followed(chain, slow=0.0)
    exact.until(chain.end, 4000)
    assert abs(exact.rate).max() < 1e-12
    assert sol.corners["t"] == pytest.approx([exact.t], abs=1e-9)
    # from there on its weight keeps it on the floor
    assert sol.q[-1] == pytest.approx(exact.q, abs=1e-9)
    assert sol.qdot[-1] == pytest.approx(np.zeros(3), abs=1e-9)


def test_two_gaps_that_come_to_rest_one_after_the_other_are_no_corner():
    """They have one ratio, and are hit in turn almost to the end of the first."""
    chain = drawn(3198)
    sol = check(chain)
    assert len(sol.corners) == 0
    # alone under constant forces, each with its geometric series of times
    rows, e = sol.resolved_impacts, chain.e[0]
    t = {gap: rows["t"][(rows["gap"] == gap) & (rows["t"] < 0.38)][-4:] for gap in (3, 5)}
    ends = {gap: t[gap][-1] + (t[gap][-1] - t[gap][-2]) * e / (1 - e) for gap in t}
    assert ends[5] - ends[3] > 0.01
    zeno = sol.zeno
    found = {gap: zeno["t"][zeno["gap"] == gap][0] for gap in t}
    assert found == pytest.approx(ends, abs=1e-6)


@pytest.mark.parametrize("number", [98, 109])
def test_gaps_below_rounding_are_closed_when_another_one_is_hit(number):
    """A squeezed body hits both neighbours in turn, with gaps of 1e-9, 1e-18, 1e-35."""
    random = Random(1)
    chain = [Chain.random(random) for _ in range(number + 1)][-1]
    sol = check(chain)
    ends = [Followed(chain, near=near) for near in (1e-15, 1e-13, 0.0)]
    assert all(run.until(chain.end) for run in ends)
    found = np.concatenate([sol.q[-1], sol.qdot[-1]])
    far = [abs(found - np.concatenate([run.q, run.v])).max() for run in ends]
    assert max(far[:2]) < 1e-12
    # which numbers of double precision cannot know
    assert far[2] > 0.1
