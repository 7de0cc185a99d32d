"""Derivatives of runs through compliant gaps: a closed form, and Richardson differences."""

import numpy as np
import pytest

import zivi

G = 9.81
TIGHT = zivi.SwitchedRK(rtol=1e-11, atol=1e-12)


def drop_exactly(mp, h, k, c, m, g, t):
    """Height and speed of a ball in its flight after the first contact, and the switch times."""
    touch = mp.sqrt(2 * h / g)
    delta, v = c / (2 * m), -g * touch
    w, rest = mp.sqrt(k / m - delta**2), -m * g / k
    a, b = -rest, (v - delta * rest) / w

    def at(s):
        decay, cos, sin = mp.exp(-delta * s), mp.cos(w * s), mp.sin(w * s)
        y = rest + decay * (a * cos + b * sin)
        return y, decay * ((b * w - delta * a) * cos - (a * w + delta * b) * sin)

    bracket = mp.mpf("0.02"), mp.mpf("0.035")
    s = mp.findroot(lambda s: k * at(s)[0] + c * at(s)[1], bracket, solver="anderson")
    y, v = at(s)
    s_left = t - touch - s
    return y + v * s_left - g * s_left**2 / 2, v - g * s_left, touch, touch + s


def test_a_drop_on_a_spring_and_damper_in_closed_form():
    mp = pytest.importorskip("mpmath")
    values = {"y0": 1.0, "k": 1e4, "c": 20.0, "m": 1.0, "g": G}

    def build(m, g):
        floor = zivi.LinearGap([1.0], contact=zivi.SpringDamper(1e4, 20.0), name="floor")
        return zivi.MechanicalSystem(mass=m, force=[-m * g], gaps=[floor])

    ball = zivi.ParametricSystem(build, {"m": 1.0, "g": G})
    wrt = ("q0[0]", "floor.k", "floor.c", "m", "g")
    s = zivi.sensitivity(ball, (0, 0.9), ([1.0], [0.0]), wrt, TIGHT)
    assert s.status is zivi.OrbitStatus.COMPLETED
    with mp.workdps(50):
        for j, name in enumerate(values):

            def exact(value, which, name=name):
                return drop_exactly(mp, *(values | {name: value}).values(), mp.mpf("0.9"))[which]

            slopes = [mp.diff(lambda x, i=i: exact(x, i), values[name]) for i in range(4)]
            found = [*s.final[:, 0, j], s.touchdown_times[0, j], s.liftoff_times[0, j]]
            for one, other in zip(found, slopes, strict=True):
                assert one == pytest.approx(float(other), rel=1e-8, abs=1e-11)


# Skewed coordinates: a floor and a wall, with and without friction, beside differences of runs.

SKEW = np.array([[1.0, 0.6], [-0.4, 1.3]])
LAWS = {
    "spring": (zivi.SpringDamper(4e3, 12.0), ("floor.k", "floor.c")),
    "hertz": (zivi.Hertz(2e5, 1.5), ("floor.k", "floor.p")),
    "hunt": (zivi.HuntCrossley(3e5, 1.6, 0.25), ("floor.k", "floor.p", "floor.alpha")),
    "function": (lambda depth, rate: 4e3 * depth + 2e4 * depth**2 + 6 * rate, ()),
}


def skewed(law, mu, mass, slope):
    normal = np.array([np.sin(slope), np.cos(slope)])
    tangent = np.array([np.cos(slope), -np.sin(slope)])
    rubs = {} if mu == 0 else {"tangent": tangent @ SKEW, "mu": mu}
    floor = zivi.LinearGap(normal @ SKEW, contact=law, name="floor", **rubs)
    wall = zivi.LinearGap(np.array([-1.0, 0.2]) @ SKEW, 0.9, name="wall")
    return zivi.MechanicalSystem(
        mass=mass * SKEW.T @ SKEW, force=mass * SKEW.T @ [0.5, -G], gaps=[floor, wall], e=[0, 0.7]
    )


def moved(law, field, by):
    values = {f: getattr(law, f) for f in law.__dataclass_fields__}
    return type(law)(**(values | {field: values[field] * (1 + by)}))


def differences(run, step):
    """Differences of fourth order from runs at both sides."""
    one, two = ((run(k * step) - run(-k * step)) / (2 * k * step) for k in (1, 2))
    return (4 * one - two) / 3


@pytest.mark.parametrize("mu", [0.0, 0.3])
@pytest.mark.parametrize("kind", list(LAWS))
def test_skewed_coordinates_beside_differences_of_runs(kind, mu):
    law, names = LAWS[kind]
    numbers = {"mass": 1.3, "slope": 0.1}
    base = np.linalg.solve(SKEW, [0.0, 0.4]), np.linalg.solve(SKEW, [1.2, -0.3])
    span = (0.0, 0.8)

    def final(law=law, mu=mu, start=base, **more):
        sol = zivi.simulate(skewed(law, mu, **(numbers | more)), span, start, TIGHT)
        assert sol.success
        return np.concatenate([sol.q[-1], sol.qdot[-1]])

    system = zivi.ParametricSystem(lambda mass, slope: skewed(law, mu, mass, slope), numbers)
    wrt = ("q0", "qdot0", *names, "mass", "slope", *(("floor.mu",) if mu else ()))
    s = zivi.sensitivity(system, span, base, wrt, TIGHT)
    assert s.status is zivi.OrbitStatus.COMPLETED
    assert len(s.trajectory.touchdowns) >= 1
    assert len(s.trajectory.impacts) + len(s.trajectory.stick) >= 1
    found = dict(zip(s.wrt, s.final.reshape(4, -1).T, strict=True))

    def start(part, i, h):
        state = [base[0].copy(), base[1].copy()]
        state[part][i] += h
        return tuple(state)

    h = 2e-4
    wanted = {
        **{f"q0.q{i}": differences(lambda h, i=i: final(start=start(0, i, h)), h) for i in (0, 1)},
        **{
            f"qdot0.q{i}": differences(lambda h, i=i: final(start=start(1, i, h)), h)
            for i in (0, 1)
        },
        "mass": differences(lambda h: final(mass=1.3 + h), h),
        "slope": differences(lambda h: final(slope=0.1 + h), h),
    }
    for name in names:
        field = name.partition(".")[2]
        size = getattr(law, field)
        slope = differences(lambda h, field=field: final(law=moved(law, field, h)), 1e-4) / size
        wanted[name] = slope
    if mu:
        wanted["floor.mu"] = differences(lambda h: final(mu=mu + h), h)
    assert set(found) == set(wanted)
    for name, slopes in wanted.items():
        scale = 1 + np.abs(slopes).max()
        assert np.abs(found[name] - slopes).max() < 1e-7 * scale, name


# Other ways to it.


def test_two_pads_that_are_hit_at_once():
    """A flat body: each pad is hit at its own time, whatever the derivative."""

    def body(tilt=0.0):
        pads = [
            zivi.LinearGap([1.0, x], tilt * x, contact=zivi.SpringDamper(3e3, 25.0), name=name)
            for name, x in (("left", -0.5), ("right", 0.5))
        ]
        return zivi.MechanicalSystem(mass=np.diag([1.0, 0.2]), force=[-G, 0.0], gaps=pads)

    span, start = (0.0, 0.5), ([0.4, 0.0], [0.0, 0.0])
    s = zivi.sensitivity(body(), span, start, ("q0", "qdot0"), TIGHT)
    assert s.status is zivi.OrbitStatus.COMPLETED
    assert len(s.trajectory.touchdowns) == 2

    def final(h):
        sol = zivi.simulate(body(), span, ([0.4, h], [0.0, 0.0]), TIGHT)
        return np.concatenate([sol.q[-1], sol.qdot[-1]])

    # the run is symmetric in the tilt but for a kink of second order
    wanted = (final(1e-6) - final(-1e-6)) / 2e-6
    assert np.allclose(s.final[:, :, 1].reshape(4), wanted, rtol=1e-4, atol=1e-4)


def test_parameters_of_a_build_move_the_laws():
    def build(k, c):
        floor = zivi.LinearGap([1.0], contact=zivi.SpringDamper(k, 2 * c), name="floor")
        return zivi.MechanicalSystem(mass=1.0, force=[-G], gaps=[floor])

    run = (0, 0.9), ([1.0], [0.0])
    system = zivi.ParametricSystem(build, {"k": 1e4, "c": 10.0})
    s = zivi.sensitivity(system, *run, ("k", "c"), TIGHT)
    own = zivi.sensitivity(build(1e4, 10.0), *run, ("floor.k", "floor.c"), TIGHT)
    assert np.allclose(s.final, own.final * [1, 2], rtol=1e-9)

    def other(k):
        floor = zivi.LinearGap([1.0], contact=lambda depth, rate: k * depth, name="floor")
        return zivi.MechanicalSystem(mass=1.0, force=[-G], gaps=[floor])

    with pytest.raises(ValueError, match="'k' must not change the kind of a contact law"):
        zivi.sensitivity(zivi.ParametricSystem(other, {"k": 1e4}), *run, ("k",))


def test_a_start_in_contact_kicks_fits_and_datasets(tmp_path):
    floor = zivi.LinearGap([1.0], contact=zivi.SpringDamper(1e3, 5.0), name="floor")
    ball = zivi.MechanicalSystem(mass=1.0, force=[-G], gaps=[floor])
    start = ([-0.01], [-1.0])
    wrt = ("q0", "qdot0", "floor.k")
    s = zivi.sensitivity(ball, (0, 1.5), start, wrt, TIGHT)

    def final(h=0.0, j=0, kicks=None):
        law = zivi.SpringDamper(1e3 + h * (j == 2), 5.0)
        gap = zivi.LinearGap([1.0], contact=law, name="floor")
        system = zivi.MechanicalSystem(mass=1.0, force=[-G], gaps=[gap])
        at = [-0.01 + h * (j == 0)], [-1.0 + h * (j == 1)]
        sol = zivi.simulate(system, (0, 1.5), at, TIGHT, kicks=kicks)
        return np.array([sol.q[-1], sol.qdot[-1]])

    kick = zivi.Kick(t=[0.9], dv=[0.3])
    kicked = zivi.sensitivity(ball, (0, 1.5), start, wrt, TIGHT, kicks=kick)
    for found, kicks in ((s, None), (kicked, kick)):
        for j, h in enumerate((1e-4, 1e-4, 1e-1)):
            wanted = differences(lambda h, j=j, kicks=kicks: final(h, j, kicks), h)
            assert np.allclose(found.final[:, :, j], wanted, rtol=1e-7, atol=1e-8)
    data = s.to_xarray()
    assert data.touchdown_time.shape == (len(s.trajectory.touchdowns), 3)
    times = np.linspace(0, 1.5, 40)
    record = zivi.Record(times, s.trajectory.resample(times).q[:, 0], sigma=1e-6, of="q0")
    soft = ball.replace(
        gaps=[zivi.LinearGap([1.0], contact=zivi.SpringDamper(1.1e3, 5.0), name="floor")]
    )
    fit = zivi.fit(soft, record, ("floor.k",), y0=start, starts=1)
    assert fit.x[0] == pytest.approx(1e3, rel=1e-5)


def test_a_law_with_friction_that_lets_go_below_zero_and_pushes_again():
    """The damper lets go below zero, and pushes again before the gap opens."""
    floor = zivi.LinearGap(
        [0.0, 1.0], contact=zivi.SpringDamper(1e3, 5.0), name="floor", tangent=[1.0, 0.0], mu=0.3
    )
    body = zivi.MechanicalSystem(mass=np.eye(2), force=[0.3, -G], gaps=[floor])
    start = np.array([0.0, -0.0147, 0.605, -0.947])

    def times(start):
        sol = zivi.simulate(body, (0, 0.7), (start[:2], start[2:]), TIGHT)
        assert len(sol.touchdowns) == 3
        return sol.touchdowns["t"]

    s = zivi.sensitivity(body, (0, 0.7), (start[:2], start[2:]), ("q0", "qdot0"), TIGHT)
    assert s.trajectory(s.trajectory.touchdowns["t"][2])[0, 1] < -1e-5
    for j, unit in enumerate(np.eye(4)):
        exact = differences(lambda h, unit=unit: times(start + h * unit), 1e-5)
        assert s.touchdown_times[:, j] == pytest.approx(exact, rel=1e-5, abs=1e-6)
    # friction begins with each contact that has a force
    begins = (s.trajectory.transitions["before"] == 2) & (s.trajectory.transitions["t"] > 0)
    begun = s.trajectory.transitions["t"][begins]
    from_contact = np.searchsorted(s.trajectory.touchdowns["t"], begun)
    assert np.array_equal(s.transition_times[begins], s.touchdown_times[from_contact])


def test_friction_begins_with_a_compliant_touchdown_as_differences_say():
    values = {"k": 4e3, "mu": 0.3, "lift": 12.0, "m": 1.3}

    def build(k, mu, lift, m):
        floor = zivi.LinearGap(
            [0.0, 1.0], tangent=[1.0, 0.0], mu=mu, name="floor", contact=zivi.SpringDamper(k, 12.0)
        )
        force = lambda t, q, w: [-0.2 * w[0], m * (lift * t**2 - G)]  # noqa: E731
        return zivi.MechanicalSystem(mass=m * np.eye(2), force=force, gaps=[floor])

    start = [0.0, 0.3], [2.0, 0.0]
    s = zivi.sensitivity(
        zivi.ParametricSystem(build, values), (0, 1.0), start, ("q0[1]", *values), TIGHT
    )
    assert list(s.trajectory.transitions["before"]) == [2, 2, 1]
    assert np.array_equal(s.transition_times[:2], s.touchdown_times)
    for j, name in enumerate(("q0[1]", *values)):

        def times(h, name=name):
            height = 0.3 * (1 + h) if name == "q0[1]" else 0.3
            moved = values if name == "q0[1]" else values | {name: values[name] * (1 + h)}
            sol = zivi.simulate(build(**moved), (0, 1.0), ([0.0, height], [2.0, 0.0]), TIGHT)
            return sol.transitions["t"]

        wanted = differences(times, 1e-5) / (0.3 if name == "q0[1]" else values[name])
        assert s.transition_times[:, j] == pytest.approx(wanted, rel=1e-6, abs=1e-8)
