"""Linear systems of one coordinate beside masses under a linear force."""

import itertools

import numpy as np
import pytest

import zivi


def one_mass(rng, walls=False):
    """A mass above a wall under a linear force, and the same from matrices of one coordinate."""
    stiffness, damping = rng.uniform(-0.3, 4), rng.choice([0, rng.uniform(0, 0.5)])
    gravity, amplitude = rng.uniform(-0.5, 2), rng.uniform(0, 2)
    omega, phase, e = rng.uniform(0.5, 3), rng.uniform(0, 6), rng.choice([0, rng.uniform(0, 0.95)])
    # binary fractions, so that both starts are the same
    height = rng.integers(1, 16) / 64 if walls else 0.0
    wall = zivi.HarmonicWall(height, rng.uniform(0.5, 3)) if walls else None
    force = zivi.LinearForce(
        stiffness=stiffness,
        damping=damping,
        gravity=gravity,
        amplitude=amplitude,
        omega=omega,
        phase=phase,
    )
    gap = zivi.LinearGap([1.0], motion=wall)
    load = [[-gravity], zivi.Harmonic([amplitude], omega, phase)]
    linear = zivi.LinearSystem(1.0, damping, stiffness, excitation=load, gaps=[gap], e=e)
    return zivi.ImpactSystem(force, e=e, wall=wall), linear, height


@pytest.mark.parametrize("walls", [False, True])
def test_one_coordinate_is_the_mass(walls):
    """Impacts, Zeno points, lift-offs and the motion: bit for bit above a wall at rest."""
    rng, impacts, zeno = np.random.default_rng(11), 0, 0
    for case in range(200):
        mass, linear, height = one_mass(rng, walls)
        start, rate = rng.integers(32, 64) / 64, rng.uniform(-1, 1)
        options = {"t_eval": np.linspace(0, 30, 7)} if case % 3 == 0 else {}
        one = zivi.simulate(mass, (0, 30), (start, rate), **options)
        same = zivi.simulate(linear, (0, 30), ([start + height], [rate]), **options)
        impacts, zeno = impacts + len(one.impacts), zeno + len(one.zeno_times)
        assert same.status == one.status
        zeno_times, lifted = np.ravel(same.zeno_times), np.ravel(same.liftoff_times)
        # the lift-off under two waves has no closed form
        end = min([*one.liftoff_times, np.inf]) if walls else np.inf
        till, same_till = (it.impacts for it in (one, same))
        if walls:
            till, same_till = (it.resolved_impacts for it in (one, same))
            # rounding grows from impact to impact
            count = min(8, np.sum(till["t"] < end))
            till, same_till = till[:count], same_till[:count]
        # the wave of a moving wall is rounded on another way
        atol = 1e-13 if walls else 0.0
        for name in ["t"] if walls else ["t", "speed_before", "speed_after"]:
            np.testing.assert_allclose(till[name], same_till[name], rtol=0, atol=atol)
        assert len(one.liftoff_times) == len(lifted)
        if not walls:
            np.testing.assert_array_equal(one.zeno_times, zeno_times)
            np.testing.assert_array_equal(one.liftoff_times, lifted)
            assert (one.x[-1], one.xdot[-1]) == (same.q[-1, 0], same.qdot[-1, 0])
    assert impacts > 1000
    assert zeno > 50


@pytest.mark.parametrize("kind", ["offset", "waves", "walls"])
def test_times_of_samples_change_no_bit(kind):
    """Impacts and the end: no gap is set to what rounding left of the coordinates."""
    rng, impacts = np.random.default_rng(13), 0
    for _ in range(40):
        start = rng.integers(32, 64) / 64
        if kind == "walls":
            _, linear, height = one_mass(rng, True)
            start += height
        else:
            omega, amplitude = rng.uniform(0.5, 3), rng.uniform(1, 4)
            loads = [[rng.uniform(-0.5, 0.5)], zivi.Harmonic([amplitude], omega)]
            loads += [zivi.Harmonic([0.3 * amplitude], 2.7 * omega)] if kind == "waves" else []
            gaps, e = [zivi.LinearGap([1.3], 0.1)], rng.uniform(0.2, 0.95)
            k, c = rng.uniform(0, 6), rng.uniform(0, 0.4)
            linear = zivi.LinearSystem(1.0, c, k, excitation=loads, gaps=gaps, e=e)
        asked = [{}, {"t_eval": np.linspace(0, 20, 101)}, {"t_eval": [20], "dense_output": False}]
        first, *others = (zivi.simulate(linear, (0, 20), ([start], [0.2]), **it) for it in asked)
        impacts += len(first.resolved_impacts)
        for sol in others:
            assert np.array_equal(sol.resolved_impacts, first.resolved_impacts)
            assert (sol.q[-1], sol.qdot[-1]) == (first.q[-1], first.qdot[-1])
    assert impacts > 400


def test_two_stops_of_one_coordinate_are_those_of_a_mass_between_its_impacts():
    """From an impact to the next one on the same stop, and mirrored all the way."""
    rng, alone, both = np.random.default_rng(12), 0, 0
    for _ in range(40):
        k, c, e = rng.uniform(0, 6), rng.uniform(0, 0.4), rng.uniform(0.2, 0.95)
        amplitude, omega = rng.uniform(1, 4), rng.uniform(0.5, 3)
        push, width = rng.uniform(-0.5, 0.5), rng.uniform(0.1, 0.6)
        low, high = zivi.LinearGap([1.0], 0.0), zivi.LinearGap([-1.0], width)

        def system(gaps, sign, k=k, c=c, e=e, a=amplitude, w=omega, push=push):
            load = [[sign * push], zivi.Harmonic([sign * a], w)]
            return zivi.LinearSystem(1.0, c, k, excitation=load, gaps=gaps, e=e)

        sol = zivi.simulate(system([low, high], 1), (0, 20), ([0.3 * width], [0.2]))
        turned = [zivi.LinearGap([-1.0], 0.0), zivi.LinearGap([1.0], width)]
        mirror = zivi.simulate(system(turned, -1), (0, 20), ([-0.3 * width], [-0.2]))
        for name in ["t", "gap", "speed_before", "speed_after"]:
            np.testing.assert_array_equal(sol.impacts[name], mirror.impacts[name])
        hits = sol.resolved_impacts
        force = zivi.LinearForce(
            stiffness=k, damping=c, gravity=-push, amplitude=amplitude, omega=omega
        )
        mass = zivi.ImpactSystem(force, e=e)
        for one, two in itertools.pairwise(hits):
            both += one["gap"] != two["gap"]
            if one["gap"] == two["gap"] == 0 and alone < 60:
                alone += 1
                run = zivi.simulate(mass, (one["t"], two["t"] + 1e-9), (0.0, one["speed_after"]))
                first = run.impacts["t"][0] if len(run.impacts) else np.nan
                assert abs(first - two["t"]) <= 4e-15 * max(1.0, two["t"])
    assert alone > 30
    assert both > 100
