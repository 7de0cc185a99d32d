"""Methods that must fail where those of the library do not: otherwise a test could not tell them.

Shooting once a period, multipliers as test functions, the angle of a turning pair as unknown, an
accumulation whose ratio does not move with the restitution.
"""

import dataclasses

import numpy as np
import pytest

import zivi
from inside import Line, Turning, evaluate, run
from orbit_systems import REFERENCES, chain2, listed, rest2

pytestmark = [pytest.mark.slow, pytest.mark.xdist_group("orbit_controls")]


@pytest.fixture(scope="module")
def chart():
    given = (["I stop"] * 4, listed("two_dof_four_impacts", "t"))
    orbit = zivi.periodic_orbit(chain2(), given)
    return orbit, zivi.continue_orbit(orbit, "omega", (0.89, 0.96))


class Strobe:
    """Pseudo-arclength continuation of the state once a period."""

    def __init__(self, phase):
        self.phase = phase

    def look(self, z):
        """Give what must vanish, and its derivatives by state and frequency."""
        w = float(z[4])
        out = []
        for other in (w, w + 1e-7):
            period = 2 * np.pi / other
            t = self.phase * period
            state = (z[:2], z[2:4])
            method = zivi.SwitchedRK(rtol=1e-10, atol=1e-11)
            s = zivi.sensitivity(chain2(w=other), (t, t + period), state, method=method)
            end = np.append(s.trajectory.q[-1], s.trajectory.qdot[-1])
            out.append((end - z[:4], s.final.reshape(4, 4) - np.eye(4), len(s.trajectory.impacts)))
        (off, by_z, count), (other, _, _) = out
        return off, np.column_stack([by_z, (other - off) / 1e-7]), count

    def correct(self, guess, normal):
        z = guess.copy()
        for _ in range(8):
            off, by, count = self.look(z)
            if not np.all(np.isfinite(by)):
                return None
            if np.max(np.abs(off)) < 1e-8:
                return z, by, count
            z = z - np.linalg.solve(np.vstack([by, normal]), np.append(off, normal @ (z - guess)))
            if not np.all(np.isfinite(z)) or np.max(np.abs(z - guess)) > 0.2:
                return None
        return None

    def follow(self, z, sign, most=60):
        """Follow in one direction; steps are halved down to a ten-thousandth of the first."""
        step, counts, tangent = 0.01, [], np.array([0.0, 0, 0, 0, sign])
        while len(counts) < most and step > 1e-6 and 0.89 < z[4] < 0.96:
            found = self.correct(z + step * tangent, tangent)
            if found is None:
                step *= 0.5
                continue
            new = np.linalg.svd(found[1])[2][-1]
            tangent, z = new * np.sign(new @ tangent), found[0]
            counts.append(found[2])
            step = min(1.3 * step, 0.02)
        return counts


def test_shooting_once_a_period_does_not_pass_the_grazings(chart):
    orbit, branch = chart
    assert branch.words[:3] == [f"{k}I stop" for k in (4, 3, 2)] or len(branch.words) >= 3
    assert {len(arc.word) for arc in branch.arcs} >= {4, 3, 2}
    t = float(orbit.impacts["t"][0]) - 0.4 * (orbit.period - np.ptp(orbit.impacts["t"]))
    run_of = orbit.trajectory
    begin = float(run_of.t[0])
    q, qdot = run_of(begin + (t - begin) % orbit.period)
    state = np.concatenate([q, qdot, [0.9]])
    shooting = Strobe(t / orbit.period % 1.0)
    off, _, count = shooting.look(state)
    assert np.max(np.abs(off)) < 1e-6
    assert count == 4
    seen = {it for sign in (1.0, -1.0) for it in shooting.follow(state, sign)}
    assert 4 in seen
    assert not seen >= {4, 3, 2}


def test_multipliers_miss_a_doubling_beside_a_grazing(chart):
    """At a grazing one of them is infinite: the sign of their product there is rounding."""
    _, branch = chart
    missed = 0
    for arc in branch.arcs:
        regular, products = [], []
        for orbit in arc.orbits:
            regular.append(np.linalg.slogdet(evaluate(orbit._frame, orbit._y).matrix(-1.0))[0])
            with np.errstate(all="ignore"):
                products.append(np.sign(np.prod(orbit.multipliers + 1.0).real))
        for end in (0, -1):
            if np.max(np.abs(arc.orbits[end].multipliers)) > 1e6:
                doubles = np.array(regular) * regular[end] < 0.0
                told = np.array(products) * products[end] < 0.0
                missed += np.count_nonzero(doubles & ~told)
    assert missed >= 1
    # of J(pi) every one is found, by a multiplier -1 of the orbit there
    doublings = branch.of_kind("period_doubling")
    assert len(doublings) >= 3
    assert all(np.min(np.abs(it.orbit.multipliers + 1.0)) < 1e-6 for it in doublings)


class ByAngle(Turning):
    """A turning pair whose angle is the unknown instead of its cosine."""

    def at(self, terms, kappa, near=None):
        values = Turning.at(self, terms, np.cos(kappa))
        return dataclasses.replace(values, by_kappa=-np.sin(kappa) * values.by_kappa)

    def matrix(self, terms, kappa):
        return Turning.matrix(self, terms, np.cos(kappa))

    def renewed(self, terms, kappa):
        return ByAngle(*dataclasses.astuple(Turning.of(terms, np.cos(kappa))))


def test_the_angle_of_a_pair_turns_back_where_it_is_two_real_ones():
    orbit = zivi.periodic_orbit(chain2(w=1.4), (["I stop"], [3.0]))
    branch = zivi.continue_orbit(orbit, "omega", (1.3, 1.6), step=0.05)
    event = branch.of_kind("neimark_sacker")[0]
    known, ranges = REFERENCES["NS_1_2"], np.array([[1.25, 1.6], [0.5, 3.0]])
    two = np.array([float(known["w"]), float(known["F"])])
    orbit, least, found = event.orbit, [], []
    for by_angle in (False, True):
        names, widths = ("omega", "F"), np.ptp(ranges, axis=1)
        line = Line("neimark_sacker", orbit._frame, orbit._y, names, widths, event.kappa)
        start = event.kappa
        if by_angle:
            line.critical = ByAngle(line.critical.b, line.critical.c)
            start = float(np.arccos(event.kappa))
        begin = line.start(orbit._y, start)
        reached = []
        for sign in (1.0, -1.0):
            points, named, _ = run(line, begin, ranges, 0.05, 60, sign)
            reached += [np.cos(it.kappa) if by_angle else it.kappa for it in points]
            if not by_angle:
                found += [it.point.values for it in named if it.kind == "resonance_1_2"]
        least.append(min(reached))
    # the cosine goes on to two real multipliers, through the known point
    assert least[0] < -1.0
    assert min(np.max(np.abs(it - two)) for it in found) < 1e-9
    # the angle never gets there
    assert least[1] >= -1.0


def end_of_chain(orbit, e, ratio, count=10):
    """Follow impacts by exact flights, and extrapolate when they end with powers of a ratio."""
    flow = orbit._frame.flow
    s = next(k for k, it in enumerate(orbit._word) if it.kind == "Z")
    first = orbit.segments["t0"][s]
    t = float(orbit.segments["t1"][s])
    z = flow.path((), float(first), orbit._starts[s, 1:], np.array([t]))[0]
    times = []
    for k in range(count):
        z = flow.impact(0, (), t, z, e).z
        times.append(t)
        if k + 1 == count:
            break
        # the flight is nearly 2 u / a: Newton's iteration for the next time at the wall
        gap, rate = (it[0, 0] for it in flow.gaps(np.array([t]), z[None]))
        last = flow.path((), t, z, np.array([t + 1e-6]))
        pull = -(flow.gaps(np.array([t + 1e-6]), last)[1][0, 0] - rate) / 1e-6
        there = t + 2.0 * rate / pull
        for _ in range(12):
            state = flow.path((), t, z, np.array([there]))
            gap, slope = (it[0, 0] for it in flow.gaps(np.array([there]), state))
            there -= gap / slope
        z = flow.path((), t, z, np.array([there]))[0]
        t = there
    row = np.array(times)
    for power in range(1, 7):
        row = (row[1:] - ratio**power * row[:-1]) / (1.0 - ratio**power)
    return row[-1]


def test_an_accumulation_whose_ratio_does_not_move_has_another_derivative():
    system = rest2()
    orbit = zivi.periodic_orbit(system, zivi.simulate(system, (0, 200), ([2, 2], [0, 0])))
    e, h = 0.4, 1e-4
    s = next(k for k, it in enumerate(orbit._word) if it.kind == "Z")
    t0 = float(orbit.segments["t0"][s]) + 1e-6
    t1 = float(orbit.segments["t1"][s])
    flow = orbit._frame.flow
    z = flow.path((), float(orbit.segments["t0"][s]), orbit._starts[s, 1:], np.array([t0]))[0]
    span, method = (t0, t1 + 2.0), zivi.SwitchedRK(1e-12, 1e-13)
    seen = zivi.sensitivity(system, span, (z[:2], z[2:]), ("e",), method)
    exact = float(seen.zeno_times[0, 0])
    late = end_of_chain(orbit, e, e) - orbit.zeno_times[0]
    assert abs(late - 2 * np.pi * round(late / (2 * np.pi))) < 1e-8
    right = (end_of_chain(orbit, e + h, e + h) - end_of_chain(orbit, e - h, e - h)) / (2 * h)
    wrong = (end_of_chain(orbit, e + h, e) - end_of_chain(orbit, e - h, e)) / (2 * h)
    assert abs(right - exact) < 1e-5
    assert abs(wrong - exact) > 100 * abs(right - exact)
    # and so does the derivative of the orbit, which differences of orbits confirm
    moved = [zivi.periodic_orbit(rest2(e=e + part * 1e-5), orbit) for part in (1, -1)]
    slopes = (moved[0].segments["t1"] - moved[1].segments["t1"]) / 2e-5
    assert np.max(np.abs(orbit.derivative("e") - slopes)) < 1e-6
