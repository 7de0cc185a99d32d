"""Friction in two directions against closed forms and references of twenty digits."""

import pickle

import numpy as np
import pytest

import zivi

TOLERANCES = (1e-6, 1e-9, 1e-12)

PUCKS = {
    (1.0, 5.0): (0.18381245344769392881, -0.047277891745236113821, 0.076860232335870140061),
    (2.0, 3.0): (0.36459955309786171659, -0.041916978675524696713, 0.12185551090712578599),
    (3.0, 3.3): (0.81190298848357824044, 0.020488534543265714162, 0.11309818155020316219),
}
"""Stops of ``W' = a e_x - b W/|W|`` from 1 m/s at 2.2 rad: time and place, in closed form."""

BALLS = [
    {
        "mu": 0.25, "e": 0.5, "al": 0.35, "h": 0.3, "T": 3.0,
        "v": [-2.0, 3.0, 0.5, 4.0, -6.0, 3.0],
        "impacts": [(0.3151283985351112814, "slip"), (0.57599888762152250885, "stick")],
        "zeno": 0.8368693767079337363, "stop": None,
        "xy": [5.5206386855510520871, 6.1336027134525827647],
        "vxy": [5.4367731952956665762, 1.9142857142857142857],
    },
    {
        "mu": 0.08, "e": 0.7, "al": 0.1, "h": 0.2, "T": 4.0,
        "v": [1.0, 2.0, 0.0, 10.0, 5.0, 1.0],
        "impacts": [(0.2024338069940044581, "slip"), (0.48584113678561069943, "slip")],
        "zeno": 1.1471249062993585959, "stop": 1.6771829851717349276,
        "xy": [9.7670672152998395617, 4.3082738172927214036],
        "vxy": [3.7981880494439547832, 0.85714285714285714286],
    },
    {
        "mu": 0.6, "e": 0.6, "al": 0.3, "h": 0.1, "T": 2.0,
        "v": [0.3, 0.5, 0.0, 1.0, 1.0, 0.0],
        "impacts": [(0.14608388535498873557, "stick"), (0.32138454778097521826, "stick")],
        "zeno": 0.5843355414199549423, "stop": None,
        "xy": [4.7172596589706664523, 0.62921677707099774711],
        "vxy": [4.4129331819253446168, 0.3],
    },
]  # fmt: skip
"""Homogeneous balls thrown on a slope: flights, impacts and slip in closed form, 60 digits."""

CHAINS = [
    {
        "D": [[2.5, -0.7, 0.4], [-0.7, 2.0, 0.3], [0.4, 0.3, 1.4]],
        "an": 9.0, "at": [2.0, -1.0], "e": 0.6, "mu": 0.35, "u": 0.4, "w": [-1.5, 3.0],
        "t": 0.22222222222222222222,
        "s": [-0.31223877952685160196, 0.64249463994755427326],
        "end": [-1.3949692936630617844, 2.7840314428834437952],
    },
    {
        "D": [[1, 0, 0], [0, 3.5, 0], [0, 0, 3.5]],
        "an": 9.0, "at": [3.0, 0.0], "e": 0.5, "mu": 0.4, "u": 1.0, "w": [-3.0, 6.0],
        "t": 0.44444444444444444444,
        "s": [-0.82456842927090724028, 2.0823913133643697381],
        "end": [-0.36378788020062350774, 2.0155936115737753988],
    },
]  # fmt: skip
"""Zeno points in contact space, with constant mobilities and free accelerations: 60 digits."""


def turned(angle, tangents):
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, s], [-s, c]]) @ np.asarray(tangents, dtype=float)


def adaptive(tol):
    return zivi.SwitchedRK(rtol=tol, atol=tol)


def puck(a, b, angle=0.0, force=None):
    """A mass of 1 on a plane that presses with 1, pulled by `a` along x; friction takes `b`."""
    tangents = turned(angle, [[1, 0, 0], [0, 1, 0]])
    floor = zivi.LinearGap([0, 0, 1], tangent=tangents, mu=b, name="floor")
    force = [a, 0, -1] if force is None else force
    return zivi.MechanicalSystem(mass=np.eye(3), force=force, gaps=[floor])


def thrown(angle=2.2, speed=1.0):
    return np.zeros(3), np.array([speed * np.cos(angle), speed * np.sin(angle), 0.0])


def ball(mu, e, al=0.0, angle=0.0, skew=None):
    """A homogeneous ball on a slope, in its centre and the angles that it has turned."""
    r, m, g = 0.2, 1.3, 9.81
    inertia = 0.4 * m * r * r
    skew = np.eye(6) if skew is None else skew
    tangents = turned(angle, [[1, 0, 0, 0, -r, 0], [0, 1, 0, r, 0, 0]])
    floor = zivi.LinearGap(skew[2], tangent=tangents @ skew, mu=mu, name="floor")
    mass = skew.T @ np.diag([m] * 3 + [inertia] * 3) @ skew
    force = skew.T @ [m * g * np.sin(al), 0, -m * g * np.cos(al), 0, 0, 0]
    return zivi.MechanicalSystem(mass=mass, force=force, gaps=[floor], e=e)


def first(rows, after):
    return float(rows["t"][rows["after"] == after][0])


@pytest.mark.parametrize("tol", TOLERANCES)
@pytest.mark.parametrize("case", PUCKS, ids=str)
def test_a_puck_on_a_slope_stops_as_the_closed_form_says(case, tol):
    stop, x, y = PUCKS[case]
    for angle in (0.0, 0.8):
        sol = zivi.simulate(puck(*case, angle), (0, 1), thrown(), adaptive(tol))
        assert first(sol.transitions, 0) == pytest.approx(stop, abs=2 * tol + 1e-14)
        assert sol.q[-1, :2] == pytest.approx([x, y], abs=2 * tol)
        # at rest there is no slip at all
        rests = sol.t > first(sol.transitions, 0)
        assert not sol.slips[rests].any()
        assert np.abs(sol.qdot[rests]).max() < 1e-30
        assert (sol.modes[rests] == 0).all()
        assert (sol.modes[0] == 1).all()


def test_directions_and_forces_of_the_slip():
    sol = zivi.simulate(puck(1.0, 5.0, 0.3), (0, 0.3), thrown(), t_eval=[0, 0.1, 0.25])
    assert sol.channel_names == ("floor[0]", "floor[1]")
    assert np.hypot(*sol.slip_directions.T) == pytest.approx([1, 1, 0], abs=1e-14)
    assert sol.slip_directions[0] == pytest.approx([np.cos(1.9), np.sin(1.9)], abs=1e-14)
    along = (sol.friction_forces * sol.slip_directions).sum(axis=1)
    assert along == pytest.approx([-5, -5, 0], abs=1e-12)
    # what holds it is the drive
    assert np.hypot(*sol.friction_forces[2]) == pytest.approx(1, abs=1e-12)


@pytest.mark.parametrize("tol", TOLERANCES)
@pytest.mark.parametrize("case", BALLS, ids=lambda case: f"mu={case['mu']}")
def test_a_ball_bounces_slides_and_rolls(case, tol):
    skew = np.linalg.qr(np.random.default_rng(3).normal(size=(6, 6)))[0] * np.linspace(1, 2, 6)
    for angle, basis in ((0.0, np.eye(6)), (0.9, np.eye(6)), (2.5, skew)):
        system = ball(case["mu"], case["e"], case["al"], angle, basis)
        q, v = (np.linalg.solve(basis, it) for it in ([0, 0, case["h"], 0, 0, 0], case["v"]))
        sol = zivi.simulate(system, (0, case["T"]), (q, v), adaptive(tol))
        assert sol.success
        for (t, kind), row in zip(case["impacts"], sol.impacts, strict=False):
            assert row["t"] == pytest.approx(t, abs=1e-13)
            assert row["sticks"] == (kind == "stick")
        assert sol.zeno["t"] == pytest.approx([case["zeno"]], abs=1e-13)
        allowed = 20 * tol + 1e-13
        assert (basis @ sol.q[-1])[:2] == pytest.approx(case["xy"], abs=allowed)
        assert (basis @ sol.qdot[-1])[:2] == pytest.approx(case["vxy"], abs=allowed)
        if case["stop"] is not None:
            assert first(sol.transitions, 0) == pytest.approx(case["stop"], abs=2 * tol + 1e-13)
        assert not sol.slips[-1].any()


def test_lengths_of_tangents_count():
    # rows c R T with mu/c are rows T with mu; of unequal lengths each has its own friction
    stop, x, y = PUCKS[1.0, 5.0]
    floor = zivi.LinearGap([0, 0, 1], tangent=2 * turned(0.7, np.eye(3)[:2]), mu=2.5)
    sol = zivi.simulate(puck(1.0, 5.0).replace(gaps=[floor]), (0, 1), thrown(), adaptive(1e-9))
    assert first(sol.transitions, 0) == pytest.approx(stop, abs=2e-9)
    assert sol.q[-1, :2] == pytest.approx([x, y], abs=2e-9)
    oblong = zivi.LinearGap([0, 0, 1], tangent=[[1, 0, 0], [0, 2, 0]], mu=0.5)
    for angle, deceleration in ((0.0, 0.5), (np.pi / 2, 1.0)):
        system = puck(0.0, 0.5).replace(gaps=[oblong])
        sol = zivi.simulate(system, (0, 3), thrown(angle), adaptive(1e-9))
        assert first(sol.transitions, 0) == pytest.approx(1 / deceleration, abs=1e-8)


def test_a_sliding_ball_rolls_after_the_time_of_the_closed_form():
    start = np.zeros(6), np.array([1.0, -0.5, 0.0, 3.0, 4.0, 7.0])
    sol = zivi.simulate(ball(0.3, 0.0, angle=0.4), (0, 1), start)
    # v + omega x r is 0.2 - 0.5 ...; the slip falls by 7/2 mu g, and 2/7 of it are lost
    slip = np.array([1.0 - 0.2 * 4.0, -0.5 + 0.2 * 3.0])
    assert first(sol.transitions, 0) == pytest.approx(
        np.hypot(*slip) / (3.5 * 0.3 * 9.81), abs=1e-15
    )
    assert sol.qdot[-1, :2] == pytest.approx([1.0, -0.5] - 2 / 7 * slip, abs=1e-14)


@pytest.mark.parametrize("tol", TOLERANCES)
def test_a_slip_that_begins_turns_at_once(tol):
    # W' = A(t) - W/|W| from rest; collocation with 40 digits
    def force(t, q, qdot):
        return np.array([1.6 * np.sin(t), 0.7 * np.sin(2 * t + 0.3), -1.0])

    sol = zivi.simulate(puck(0, 1.0, 1.1, force), (0, 1), (np.zeros(3),) * 2, adaptive(tol))
    assert first(sol.transitions, 1) == pytest.approx(0.48372372944571997615, abs=2 * tol)
    place, slip = (
        [0.021675373463037480794, 0.01209302333040752882],
        [
            0.1219056541956948512,
            0.055590235432397640177,
        ],
    )
    assert sol.q[-1, :2] == pytest.approx(place, abs=tol)
    assert sol.qdot[-1, :2] == pytest.approx(slip, abs=tol)
    sticks = sol.t < first(sol.transitions, 1)
    assert not sol.slips[sticks].any()
    assert sol.nfev < 3000


@pytest.mark.parametrize("case", CHAINS, ids=["coupled", "ball"])
def test_impacts_accumulate_while_the_slip_turns(case):
    mobility = np.array(case["D"], dtype=float)
    mass = np.linalg.inv(mobility)
    floor = zivi.LinearGap([1, 0, 0], tangent=np.eye(3)[1:], mu=case["mu"])
    system = zivi.MechanicalSystem(
        mass=0.5 * (mass + mass.T), force=mass @ [-case["an"], *case["at"]], gaps=[floor],
        e=case["e"],
    )  # fmt: skip
    start = np.zeros(3), np.array([case["u"], *case["w"]])
    for tol in TOLERANCES:
        sol = zivi.simulate(system, (0, case["t"] + 1e-4), start, adaptive(tol))
        assert sol.zeno["t"] == pytest.approx([case["t"]], abs=1e-13)
        q, v = sol(case["t"])
        assert q[1:] == pytest.approx(case["s"], abs=20 * tol + 1e-13)
        assert v[1:] == pytest.approx(case["end"], abs=20 * tol + 1e-13)
        assert sol.nfev < 700


@pytest.mark.parametrize("case", PUCKS, ids=str)
def test_a_run_that_ends_near_a_stop_takes_no_more_steps(case):
    stop, x, y = PUCKS[case]
    for tol in TOLERANCES:
        beyond = zivi.simulate(puck(*case), (0, 1), thrown(), adaptive(tol))
        for late in (-1e-7, -1e-9, 0.0, 1e-9, 1e-7):
            sol = zivi.simulate(puck(*case), (0, stop + late), thrown(), adaptive(tol))
            assert sol.n_steps + sol.n_rejected <= beyond.n_steps + beyond.n_rejected + 8
            if late >= 0:
                assert sol.q[-1, :2] == pytest.approx([x, y], abs=2 * tol)


@pytest.mark.parametrize("case", PUCKS, ids=str)
def test_stops_keep_the_order_of_the_method(case):
    # errors fall like a power of the evaluations: with a step across the stop they would not
    stop, x, y = PUCKS[case]
    found = []
    for tol in (1e-6, 1e-12):
        sol = zivi.simulate(puck(*case), (0, 1), thrown(), adaptive(tol))
        error = np.abs([first(sol.transitions, 0) - stop, *(sol.q[-1, :2] - [x, y])]).max()
        found.append((error, sol.nfev))
    (coarse, few), (fine, many) = found
    assert np.log(coarse / fine) / np.log(many / few) > 7.0


def test_steps_of_one_length_keep_the_order_through_a_stop():
    stop, x, y = PUCKS[3.0, 3.3]
    errors = []
    for h in (0.08, 0.04, 0.02, 0.01):
        fixed = zivi.SwitchedRK(rtol=0.9, atol=1e3, max_step=h, first_step=h)
        sol = zivi.simulate(puck(3.0, 3.3), (0, 1), thrown(), fixed)
        errors.append(np.abs([first(sol.transitions, 0) - stop, *(sol.q[-1, :2] - [x, y])]).max())
    assert (np.log2(np.divide(errors[:-1], errors[1:])) > 7.5).all()
    assert errors[-1] < 1e-13


@pytest.mark.parametrize("case", PUCKS, ids=str)
def test_limits_of_slip_cost_no_evaluations_besides_the_stages(case):
    # twelve stages a step; the normal force and its regularity are those at the stages
    for tol in TOLERANCES:
        sol = zivi.simulate(puck(*case), (0, 1), thrown(), adaptive(tol))
        assert sol.nfev < 16 * (sol.n_steps + sol.n_rejected) + 40


@pytest.mark.parametrize("seed", range(4))
def test_energy_is_kept_or_dissipated(seed):
    rng = np.random.default_rng([19, seed])
    root = rng.normal(size=(4, 4))
    mass = root @ root.T + np.eye(4)
    rows = rng.normal(size=(3, 4))
    stiff = np.diag(rng.uniform(1, 3, 4))
    floor = zivi.LinearGap(rows[0], 0.3, tangent=rows[1:], mu=rng.uniform(0.05, 0.3))
    pull = -3.0 * rows[0]
    system = zivi.MechanicalSystem(
        mass=mass, force=lambda t, q, qdot: pull - stiff @ q, gaps=[floor], e=0.3
    )
    start = np.zeros(4), rng.normal(size=4)
    tol = 1e-10
    sol = zivi.simulate(system, (0, 4), start, adaptive(tol))
    assert sol.success, sol.message
    kinetic = 0.5 * np.einsum("ki,ij,kj->k", sol.qdot, mass, sol.qdot)
    energy = kinetic + 0.5 * (sol.q**2 @ np.diag(stiff)) - sol.q @ pull
    lost = sum(
        -0.5 * row["impulse"] * (row["speed_before"] + row["speed_after"]) for row in sol.impacts
    )
    balance = energy[0] - energy[-1] - sol.dissipated[-1]
    if len(sol.zeno) == 0:
        assert balance == pytest.approx(lost, abs=1e3 * tol)
    assert len(sol.transitions) > 1
    assert balance > -1e3 * tol
    # the equation of motion with the forces that the run tells
    times = np.linspace(0.01, 3.99, 200)
    again = sol.resample(times)
    h = 1e-5
    for t, force, tangential in zip(times, again.reactions, again.friction_forces, strict=True):
        near = np.abs(np.concatenate([sol.impacts["t"], sol.transitions["t"], sol.zeno["t"]]) - t)
        if near.min() < 1e-3:
            continue
        (_, before), (_, after) = sol(t - h), sol(t + h)
        q, _ = sol(t)
        left = mass @ (after - before) / (2 * h) - (pull - stiff @ q)
        left -= rows.T @ [force[0], *tangential]
        assert np.abs(left).max() < 1e-4


def test_two_balls_move_as_each_alone():
    # one system of both: what they do does not depend on each other
    cases = [BALLS[0], BALLS[1]]
    each = [ball(case["mu"], case["e"], case["al"]) for case in cases]
    parts = [it.at(0.0, np.zeros(6), np.zeros(6)) for it in each]
    mass, force = np.zeros((12, 12)), np.concatenate([part.force for part in parts])
    gaps = []
    for i, (part, case) in enumerate(zip(parts, cases, strict=True)):
        own = slice(6 * i, 6 * i + 6)
        mass[own, own] = part.mass
        rows = np.zeros((3, 12))
        rows[:, own] = [part.gradients[0], *part.tangents]
        gaps.append(zivi.LinearGap(rows[0], tangent=rows[1:], mu=case["mu"], name=f"floor{i}"))
    both = zivi.MechanicalSystem(mass=mass, force=force, gaps=gaps, e=[it["e"] for it in cases])
    q = np.concatenate([[0, 0, case["h"], 0, 0, 0] for case in cases])
    v = np.concatenate([case["v"] for case in cases])
    sol = zivi.simulate(both, (0, 3.0), (q, v), adaptive(1e-9))
    assert sol.success, sol.message
    assert sol.zeno["t"] == pytest.approx([case["zeno"] for case in cases], abs=1e-9)
    assert sol.q[-1, :2] == pytest.approx(cases[0]["xy"], abs=2e-8)
    assert first(sol.transitions[sol.transitions["channel"] == 2], 0) == pytest.approx(
        BALLS[1]["stop"], abs=1e-8
    )


def test_symbolic_systems_and_functions_have_two_slip_speeds():
    parameters = {"m": 1.3, "r": 0.2, "g": 9.81, "mu": 0.08}
    system = zivi.symbolic.system(
        "x y z ax ay az",
        T="m*(xdot**2 + ydot**2 + zdot**2)/2 + m*r**2*(axdot**2 + aydot**2 + azdot**2)/5",
        V="m*g*(cos(0.1)*z - sin(0.1)*x)",
        gaps={"floor": "z"},
        slips={"floor": ["xdot - r*aydot", "ydot + r*axdot"]},
        mu={"floor": "mu"},
        parameters=parameters,
        e=0.7,
    )
    case = BALLS[1]
    start = [0, 0, case["h"], 0, 0, 0], case["v"]
    sol = zivi.simulate(system, (0, case["T"]), start)
    assert sol.q[-1, :2] == pytest.approx(case["xy"], abs=1e-6)
    # the same with a tangent that is a function
    tangents = turned(0.0, [[1, 0, 0, 0, -0.2, 0], [0, 1, 0, 0.2, 0, 0]])
    floor = zivi.Gap(
        lambda t, q: q[2], [0, 0, 1, 0, 0, 0], 0.0, tangent=lambda t, q: tangents, mu=0.08
    )
    other = ball(0.08, 0.7, 0.1).replace(gaps=[floor])
    again = zivi.simulate(other, (0, case["T"]), start)
    assert again.q[-1, :2] == pytest.approx(sol.q[-1, :2], abs=1e-9)
    assert len(other.channel_names) == 2


def test_runs_are_stored_and_sampled():
    case = BALLS[1]
    start = [0, 0, case["h"], 0, 0, 0], case["v"]
    sol = zivi.simulate(ball(0.08, 0.7, 0.1), (0, 2), start)
    again = pickle.loads(pickle.dumps(sol))
    times = np.linspace(0, 2, 50)
    assert np.array_equal(again(times), sol(times))
    assert np.array_equal(again.slip_directions, sol.slip_directions)
    sampled = sol.resample(times)
    sizes = np.hypot(*sampled.slip_directions.T)
    assert ((sizes == 0) | (np.abs(sizes - 1) < 1e-12)).all()


WRONG = {
    "tangent of gap 'floor' must be one vector": {"tangent": np.eye(2)[:, :2]},
    "mu of gap 'floor' must be one number for all directions": {"mu": [0.3, 0.4]},
    "mu of gap 'floor' must be a number": {"mu": lambda speed: 0.3},
    "e_t of gap 'floor' is not supported with two tangents": {"e_t": 0.5},
    "contact of gap 'floor' is not supported with two tangents": {
        "contact": zivi.SpringDamper(1e4)
    },
    "belt of gap 'floor' must be a pair": {"belt": 0.2},
}


@pytest.mark.parametrize(("message", "given"), WRONG.items(), ids=range(len(WRONG)))
def test_what_is_not_supported_is_named(message, given):
    arguments = {"tangent": np.eye(3)[:2], "mu": 0.3} | given
    normal = [0, 0, 1] if np.shape(arguments["tangent"])[1] == 3 else [0, 1]
    with pytest.raises(ValueError, match=message):
        zivi.LinearGap(normal, name="floor", **arguments)


def test_other_methods_and_laws_are_refused_before_they_run():
    system = puck(1.0, 0.5)
    start = thrown()
    with pytest.raises(NotImplementedError, match="two tangents"):
        zivi.simulate(system, (0, 1), start, zivi.ThetaGamma(1e-3))
    for name, value in (("impact_law", "poisson"), ("paradox", "impact")):
        with pytest.raises(ValueError, match=f"{name} must be .* with two tangents"):
            system.replace(**{name: value})
    message = "derivatives cannot be used with gap 'floor', which has two tangents"
    with pytest.raises(NotImplementedError, match=message):
        zivi.sensitivity(system, (0, 1), start)
    flat = zivi.LinearGap([0, 0, 1], tangent=[[1, 0, 0], [1, 0, 1]], mu=0.3, name="floor")
    with pytest.raises(ValueError, match="independent of each other"):
        zivi.simulate(system.replace(gaps=[flat]), (0, 1), start)


def test_a_rough_floor_and_smooth_and_planar_walls_share_a_body():
    # a ball thrown into a corner; to 1e-11 the motion does not depend on the tolerance
    floor = ball(0.2, 0.4).gaps[0]
    walls = [
        zivi.LinearGap([-1, 0, 0, 0, 0, 0], 0.3, name="smooth"),
        zivi.LinearGap(
            [0, -1, 0, 0, 0, 0], 0.4, tangent=[0, 0, 1, 0.2, 0, 0], mu=0.1, name="rough"
        ),
    ]
    system = ball(0.2, 0.4).replace(gaps=[floor, *walls], e=[0.4, 0.5, 0.5])
    start = [0, 0, 0.1, 0, 0, 0], [1.0, 1.5, 0.0, 3.0, 2.0, 5.0]
    runs = [zivi.simulate(system, (0, 2), start, adaptive(tol)) for tol in (1e-8, 1e-11)]
    assert all(run.success for run in runs)
    assert runs[0].q[-1] == pytest.approx(runs[1].q[-1], abs=1e-6)
    assert set(runs[1].impacts["gap"].tolist()) == {0, 1, 2}


def test_a_belt_moves_in_two_directions():
    floor = zivi.LinearGap([0, 0, 1], tangent=np.eye(3)[:2], mu=0.5, belt=(0.3, -0.4))
    system = zivi.MechanicalSystem(mass=np.eye(3), force=[0, 0, -9.81], gaps=[floor])
    sol = zivi.simulate(system, (0, 1), (np.zeros(3), np.zeros(3)))
    # the slip has a constant direction: 0.5 m/s are taken at mu g
    assert first(sol.transitions, 0) == pytest.approx(0.5 / (0.5 * 9.81), abs=1e-14)
    assert sol.qdot[-1] == pytest.approx([0.3, -0.4, 0], abs=1e-14)
    assert not sol.slips[-1].any()


FOOT = np.array([0.2, 0.1, -0.3])
INERTIA = np.array([0.02, 0.05, 0.06])


def on_a_foot(inertia=INERTIA, mu=1.0):
    """A body of 5 kg on one foot, at rest but for a slip."""
    tree = zivi.Tree(
        [zivi.mechanics.Body("trunk", kind="free", mass=5.0, inertia=list(inertia))],
        shapes={
            "foot": zivi.mechanics.Ball(0.02, center=(0.2, 0.1, -0.3), body="trunk"),
            "floor": zivi.mechanics.Plane((0, 0, 1)),
        },
        contacts=[zivi.mechanics.Contact("foot", "floor", mu=mu, e=0.0)],
    )
    start = [0, 0, 0.32, 1, 0, 0, 0], [0.003, -0.027, 0, 0, 0, 0]
    return zivi.simulate(tree, (0, 0.01), start)


def cross_with(a):
    """Return the matrix of ``a x``."""
    return np.cross(a, np.eye(3)).T


def test_a_slip_that_turns_into_painleves_paradox_ends_at_its_border():
    """``K = n W (n - mu h)``, ``W = 1/m - r x I^-1 r x``, falls to zero as `h` turns."""
    sol = on_a_foot()
    assert sol.status is zivi.Status.PAINLEVE_SINGULAR
    k = []
    for slip, (w, *axis) in zip(sol.slips[:-1], sol.pose("trunk")[1], strict=False):
        turn = np.eye(3) + 2 * (w * np.eye(3) + cross_with(axis)) @ cross_with(axis)
        across = cross_with(turn @ FOOT - [0, 0, 0.02])
        row = np.eye(3)[2] / 5.0 - across[2] @ turn @ np.diag(1 / INERTIA) @ turn.T @ across
        k.append(row[2] - row[:2] @ slip / np.hypot(*slip))
    k = np.array(k)
    assert k[0] > 2.9
    assert (k > 0).all()
    assert 0 < k[-1] < 1e-5
    assert (np.diff(sol.reactions[:-1, 0]) > 0).all()
    assert sol.reactions[-2, 0] > 1e6
    # the message has K along the slip, and no remedy that this model does not take
    assert "'foot-floor' slides with 0.0025942" in sol.message
    assert abs(float(sol.message.split("K = ")[1].split(",")[0])) < 1e-4
    for remedy in ("MoreauJean", "paradox="):
        assert remedy not in sol.message
    # with more inertia there is no paradox
    assert on_a_foot(10 * INERTIA).success
