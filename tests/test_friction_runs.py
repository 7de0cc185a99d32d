"""Runs with dry friction against closed forms, and what their results have."""

import math
import pickle

import numpy as np
import pytest

import zivi
from friction_problems import REFERENCES, Families, mechanism

G = 9.81
TIGHT = zivi.SwitchedRK(rtol=1e-9, atol=1e-9)


@pytest.fixture(scope="module")
def belt():
    """A mass that sticks to a belt, and slips."""
    rubbing = zivi.DryFriction(limit=0.8, static=1.2, velocity=0.2, name="belt")
    system = zivi.MechanicalSystem(mass=1.0, force=lambda t, q, qdot: -q, friction=[rubbing])
    return zivi.simulate(system, (0, 30), ([0.0], [0.2]), TIGHT)


@pytest.fixture(scope="module")
def block():
    """A block that bounces on a slope, slides and sticks."""
    floor = zivi.LinearGap([0, 1], name="floor", tangent=[1, 0], mu=0.35)
    force = [G * math.sin(0.3), -G * math.cos(0.3)]
    system = zivi.MechanicalSystem(mass=np.eye(2), force=force, gaps=[floor], e=0.5)
    return zivi.simulate(system, (0, 4), ([0.0, 0.4], [1.0, 0.0]), TIGHT)


def test_a_belt_sticks_exactly_and_slips_as_by_hand(belt):
    """The slip is x - 0.8 = 0.4 cos s + 0.2 sin s; it ends after 2 pi - 2 atan 2."""
    slip = 2 * math.pi - 2 * math.atan(2)
    starts = [0.0, 6 + slip, 10 + 2 * slip, 14 + 3 * slip]
    assert belt.stick["t_start"] == pytest.approx(starts, abs=1e-7)
    assert belt.stick["t_end"] == pytest.approx([6.0, 10 + slip, 14 + 2 * slip, 30.0], abs=1e-7)
    assert belt.transitions["before"].tolist() == [2, 0, -1, 0, -1, 0, -1]
    assert belt.transitions["after"].tolist() == [0, -1, 0, -1, 0, -1, 0]
    sticks = belt.modes[:, 0] == 0
    assert np.all(belt.slips[sticks] == 0.0)
    assert np.all(belt.qdot[sticks] == pytest.approx(0.2, abs=1e-15))
    assert np.abs(belt.friction_forces[sticks] - belt.q[sticks]).max() < 1e-12
    assert np.all(belt.friction_forces[~sticks] == 0.8)


def test_the_energy_that_is_lost_is_dissipated(belt):
    """The belt brings in what it pulls with: f v, over the run."""
    energy = (belt.qdot[:, 0] ** 2 + belt.q[:, 0] ** 2) / 2
    fine = belt.resample(n=3001)
    force = fine.friction_forces[:, 0]
    work = 0.2 * np.sum((force[1:] + force[:-1]) / 2 * np.diff(fine.t))
    lost = energy[0] + work - energy[-1]
    assert belt.dissipated[-1] == pytest.approx(lost, abs=1e-2)  # forces jump between samples
    slipped = 0.8 * -belt.slip_distances[-1, 0]
    assert belt.dissipated[-1] == pytest.approx(slipped, abs=1e-8)


@pytest.mark.parametrize(("limit", "e"), [(2.0, 0.6), (5.0, 0.8), (0.5, 0.3)])
def test_a_mass_in_a_guide_bounces_with_another_ratio(limit, e):
    """Up with g + L, down with g - L: the ratio is e sqrt((g - L)/(g + L))."""
    ratio = e * math.sqrt((G - limit) / (G + limit))
    u = e * math.sqrt(2 * (G - limit))
    flight = u * (1 / (G + limit) + 1 / math.sqrt(G**2 - limit**2))
    zeno = math.sqrt(2 / (G - limit)) + flight / (1 - ratio)
    ball = zivi.ImpactSystem(-G, e=e, friction=zivi.DryFriction(limit=limit))
    sol = zivi.simulate(ball, (0, 3), (1, 0), TIGHT)
    assert isinstance(sol, zivi.MechanicalTrajectory)
    assert sol.zeno["t"] == pytest.approx([zeno], abs=1e-12)
    assert len(sol.resolved_impacts) <= 12
    assert np.all(sol.q[-1] == 0.0)
    assert np.all(sol.qdot[-1] == 0.0)


@pytest.mark.parametrize(
    "force",
    [-G, zivi.LinearForce(gravity=G), lambda t, y: -G, lambda t, x, xdot: -G],
    ids=["number", "linear", "of y", "of x"],
)
def test_every_force_of_a_mass_takes_friction(force):
    ball = zivi.ImpactSystem(force, e=0.5, friction=zivi.DryFriction(limit=1.0))
    sol = zivi.simulate(pickled(ball) if not callable(force) else ball, (0, 0.4), (1, 0))
    assert sol.q[-1] == pytest.approx([1 - (G - 1) * 0.4**2 / 2], abs=1e-12)


def pickled(value):
    return pickle.loads(pickle.dumps(value))


@pytest.mark.parametrize("number", range(len(REFERENCES["impacts_exact"])))
def test_impacts_are_those_of_exact_arithmetic(number):
    case = REFERENCES["impacts_exact"][number]
    (a, b, d), after = ([ratio(it) for it in case[name]] for name in ("D", "after"))
    mu, e, e_t, gain = (ratio(case[name]) for name in ("mu", "e", "e_t", "energy_change"))
    gap = zivi.LinearGap([1, 0], tangent=[0, 1], mu=mu, e_t=e_t)
    mass = np.linalg.inv([[a, b], [b, d]])
    system = zivi.MechanicalSystem(mass=mass, force=[0.0, 0.0], gaps=[gap], e=e)
    before = [ratio(it) for it in case["before"]]
    sol = zivi.simulate(system, (0, 0.01), ([0, 0], before))
    (row,) = sol.resolved_impacts
    found = [row["impulse"], row["tangential_impulse"], row["speed_after"], row["slip_after"]]
    assert found == pytest.approx([*(ratio(it) for it in case["P"]), *after], abs=1e-15)
    assert [row["speed_before"], row["slip_before"]] == before
    assert row["sticks"] == (case["sigma"] == 0)
    gains = sol.flags[sol.flags["kind"] == "energy_gain"]
    assert len(gains) == (gain > 1e-15)
    assert gains["size"] == pytest.approx([gain] * len(gains), abs=1e-14)


def ratio(text):
    top, _, bottom = text.partition("/")
    return float(top) / float(bottom or 1)


def jolted(law, e=1.0, mu=0.7):
    """A rod at 45 degrees: D = [[5/2, -3/2], [-3/2, 5/2]], hit with (-1, 3/5)."""
    gap = zivi.LinearGap([1, 0], tangent=[0, 1], mu=mu)
    mass = np.linalg.inv([[2.5, -1.5], [-1.5, 2.5]])
    system = zivi.MechanicalSystem(mass=mass, force=[0, 0], gaps=[gap], e=e, impact_law=law)
    return zivi.simulate(system, (0, 0.01), ([0, 0], [-1, 0.6])).resolved_impacts[0]


def test_poissons_law_gives_back_the_impulse_of_compression():
    """Compressed in stick by (0.4, 0); another 0.4 in stick."""
    row = jolted("poisson")
    found = [row[it] for it in ("impulse", "tangential_impulse", "speed_after", "slip_after")]
    assert found == pytest.approx([0.8, 0.24, 0.64, 0.0], abs=1e-15)


def test_stronges_law_gives_back_the_work_of_compression():
    """Slip up to P = 0.6/3.25, then stick with a tangential impulse of 0.6 of the normal one."""
    slipped = 0.6 / 3.25
    left = 1 - 3.55 * slipped
    work = (1 + left) / 2 * slipped + left**2 / 3.2
    back = math.sqrt(2 * work / 1.6)
    row = jolted("stronge")
    assert row["impulse"] == pytest.approx(0.4 + back, abs=1e-14)
    assert row["speed_after"] == pytest.approx(1.6 * back, abs=1e-14)
    assert row["slip_after"] == pytest.approx(0.0, abs=1e-15)


@pytest.mark.parametrize("law", ["poisson", "stronge"])
def test_other_laws_never_gain_energy(law):
    rng = np.random.default_rng(5)
    for _ in range(60):
        root = rng.normal(size=(2, 2))
        mass = root @ root.T + 0.1 * np.eye(2)
        mu, e, before = rng.uniform(0, 1), rng.uniform(0, 1), [-1.0, rng.normal()]
        gap = zivi.LinearGap([1, 0], tangent=[0, 1], mu=mu)
        system = zivi.MechanicalSystem(mass=mass, force=[0, 0], gaps=[gap], e=e, impact_law=law)
        sol = zivi.simulate(system, (0, 1e-3), ([0, 0], before))
        if not len(sol.resolved_impacts):
            continue  # jammed at the start
        row = sol.resolved_impacts[0]
        after = np.array([row["speed_after"], row["slip_after"]])
        energy = [v @ mass @ v for v in (np.array(before), after)]
        assert energy[1] <= energy[0] * (1 + 1e-12)
        assert abs(row["tangential_impulse"]) <= mu * row["impulse"] * (1 + 1e-12)
        assert row["speed_after"] >= -1e-14


def test_a_jammed_rod_goes_on_by_an_impact_without_a_collision():
    """It sticks: P_T/P_N = D_nn/|D_nt|, and takes what the sliding had."""
    rod = mechanism(Families().rod(1.6, 0), paradox="impact")
    start = [0, math.sin(1.0), 1.0], [-2, 0, 0]
    sol = zivi.simulate(rod, (0, 0.1), start)
    assert sol.success, sol.message
    assert sol.flags["kind"].tolist() == ["impact_without_collision"]
    s, c = math.sin(1.0), math.cos(1.0)
    mobility = np.array([[1 + 3 * c * c, -3 * s * c], [-3 * s * c, 1 + 3 * s * s]])
    impulse = np.linalg.solve(mobility, [0, 2])
    (row,) = sol.resolved_impacts
    assert [row["impulse"], row["tangential_impulse"]] == pytest.approx(impulse, abs=1e-12)
    assert sol.modes[1, 0] == 0


@pytest.mark.parametrize("steps", [1e-2, 1e-3])
def test_moreau_jean_is_a_second_opinion_of_first_order(block, steps):
    floor = zivi.LinearGap([0, 1], name="floor", tangent=[1, 0], mu=0.35)
    force = [G * math.sin(0.3), -G * math.cos(0.3)]
    system = zivi.MechanicalSystem(mass=np.eye(2), force=force, gaps=[floor], e=0.5)
    sol = zivi.simulate(system, (0, 4), ([0, 0.4], [1, 0]), zivi.MoreauJean(h=steps))
    assert sol.success, sol.message
    assert sol.q[-1] == pytest.approx(block.q[-1], abs=0.1 * steps)
    assert sol.modes[-1, 0] == 0
    assert np.abs(sol.slips[sol.t > 2.7]).max() < 1e-14
    assert sol.stick["t_start"][-1] == pytest.approx(block.stick["t_start"][-1], abs=3 * steps)
    assert sol.friction_forces[-1] == pytest.approx(block.friction_forces[-1], abs=1e-9)
    again = sol.resample(sol.t)
    for name in ("slips", "modes", "friction_forces", "dissipated"):
        assert np.array_equal(getattr(again, name), getattr(sol, name))


@pytest.mark.parametrize("method", [zivi.MoreauJean(h=1e-3), zivi.ThetaGamma(h=1e-3)])
def test_methods_of_first_order_stick_to_a_belt(belt, method, tmp_path):
    rubbing = zivi.DryFriction(limit=0.8, static=0.8, velocity=0.2, name="belt")
    system = zivi.MechanicalSystem(mass=1.0, force=lambda t, q, qdot: -q, friction=[rubbing])
    exact = zivi.simulate(system, (0, 10), ([0.0], [0.2]), TIGHT)
    sol = zivi.simulate(system, (0, 10), ([0.0], [0.2]), method)
    assert sol.q[-1] == pytest.approx(exact.q[-1], abs=1e-3)
    assert sol.stick["t_end"][0] == pytest.approx(4.0, abs=2e-3)
    assert np.abs(sol.slips[sol.modes[:, 0] == 0]).max() < 1e-13
    pytest.importorskip("h5netcdf")
    zivi.files.save(sol, tmp_path / "belt.nc")
    again = zivi.files.load(tmp_path / "belt.nc")
    assert np.array_equal(again.resample(n=30).slips, sol.resample(n=30).slips)


def test_a_box_on_two_feet_stands_until_its_forces_are_used_up():
    """With 0.3 and 0.5 the pull loads the front foot: 3.924 + 0.16 t = 2 t."""
    for mu, time in ((0.3, 0.3 * G / 2), (0.5, 3.924 / 1.84)):
        problem = Families().rock(0.5, 0.4, 0.3, 0)
        problem.mu[1] = problem.mu_static[1] = mu
        plain = problem.numbers

        def pulled(t, q, w, plain=plain):
            mass, force, *rest = plain(t, q, w)
            return mass, [2 * t, *force[1:]], *rest

        problem.numbers = pulled
        sol = zivi.simulate(mechanism(problem), (0, 2.5), ([0, 0.4, 0], [0, 0, 0]), TIGHT)
        assert sol.success, sol.message
        assert sol.stick["t_end"] == pytest.approx([time, time], abs=1e-12)
        assert "undetermined_forces" in sol.flags["kind"]
        still = sol.t < time
        assert np.abs(sol.qdot[still]).max() < 1e-50


def test_equal_blocks_on_a_belt_stay_equal():
    problem = Families().belt2(1, 1, 1.2, 0.3, 1, 1, 1.3, 1.3)
    sol = zivi.simulate(mechanism(problem), (0, 25), ([0, 0], [0.3, 0.3]), TIGHT)
    assert np.all(sol.q[:, 0] == sol.q[:, 1])
    assert len(sol.stick) > 4


PARADOX = [(mu, th) for mu in (0.5, 1.2, 1.4, 1.6, 2.0) for th in np.linspace(0.2, 1.4, 7)]


@pytest.mark.parametrize(("speed", "turn"), [(-2, 0), (-2, -4), (2, 0), (2, -4)])
def test_a_sliding_rod_goes_on_exactly_where_it_can(speed, turn):
    """K = 1 + 3 c^2 -+ 3 mu s c and b decide: one motion, none, or several."""
    for mu, th in PARADOX:
        s, c = math.sin(th), math.cos(th)
        slip = speed + s * turn
        k = 1 + 3 * c**2 + math.copysign(3 * mu * s * c, slip)
        b = -G + s * turn**2
        expected = "COMPLETED"
        if k < 0:
            expected = "INCONSISTENT_CONTACT" if b < 0 else "INDETERMINATE_CONTACT"
        rod = mechanism(Families().rod(mu, 0))
        sol = zivi.simulate(rod, (0, 0.1), ([0, s, th], [speed, c * turn, turn]))
        assert sol.status.name == expected, (mu, th)
        assert sol.n_steps < 1000
        if k < 0:
            assert "'gap0' slides with" in sol.message
            assert f"K = {k:.6g}, b = {b:.6g}" in sol.message
            assert ("paradox='impact'" in sol.message) == (b < 0)
            assert "zivi.MoreauJean chooses one motion" in sol.message


def test_methods_of_fixed_steps_have_newtons_impact_law_only():
    floor = zivi.LinearGap([0, 1], tangent=[1, 0], mu=0.3)
    system = zivi.MechanicalSystem(
        mass=np.eye(2), force=[0, -G], gaps=[floor], e=0.5, impact_law="poisson"
    )
    with pytest.raises(ValueError, match="impact_law must be 'newton' for MoreauJean, got 'poiss"):
        zivi.simulate(system, (0, 1), ([0, 1], [1, 0]), zivi.MoreauJean(h=1e-2))


def test_no_friction_is_no_friction_to_the_bit():
    """A tangent with mu = 0 changes nothing."""

    def run(**friction):
        floor = zivi.LinearGap([0, 1], name="floor", **friction)
        wall = zivi.LinearGap([-1, 0.1], 0.8, name="wall", **friction)
        force = lambda t, q, qdot: [2 - 0.1 * qdot[0], -G]  # noqa: E731
        system = zivi.MechanicalSystem(mass=np.eye(2), force=force, gaps=[floor, wall], e=0.5)
        return zivi.simulate(system, (0, 3), ([0.0, 0.5], [0.5, 0.0]))

    plain = run()
    smooth = run(tangent=[1, 0.1], mu=0.0)
    for name in ("t", "q", "qdot", "reactions"):
        assert np.array_equal(getattr(plain, name), getattr(smooth, name))
    assert plain.impacts.dtype == smooth.impacts.dtype
    assert plain.slips.shape == plain.modes.shape == (len(plain.t), 0)
    assert not len(plain.transitions)
    assert not len(plain.stick)
    assert not plain.dissipated.any()


def test_samples_between_are_those_of_the_run(block):
    again = block.resample(block.t)
    for name in ("slips", "modes", "dissipated", "slip_distances"):
        assert getattr(again, name) == pytest.approx(getattr(block, name), abs=1e-12)
    closed = block.contacts[:, 0]
    sample = np.flatnonzero(closed)[1:-1]
    assert again.friction_forces[sample] == pytest.approx(block.friction_forces[sample], abs=1e-9)
    assert again.reactions[sample] == pytest.approx(block.reactions[sample], abs=1e-9)


def test_skipped_impacts_keep_the_cone(block):
    """Impulses of a sliding block are on the edge of the cone, those behind the jump as well."""
    fast = block.impacts_down_to(1e-6)
    assert len(fast) > len(block.resolved_impacts)
    assert fast["tangential_impulse"] == pytest.approx(-0.35 * fast["impulse"])
    assert not fast["sticks"].any()


def test_tables_files_and_pickles_keep_friction(block, belt, tmp_path):
    pytest.importorskip("xarray")
    pytest.importorskip("h5netcdf")
    for sol in (block, belt):
        path = tmp_path / f"{sol.channel_names[0]}.nc"
        zivi.files.save(sol, path)
        for again in (zivi.files.load(path), pickled(sol)):
            assert again.channel_names == sol.channel_names
            assert again.channel_gaps == sol.channel_gaps
            for name in ("slips", "friction_forces", "modes", "dissipated", "slip_distances"):
                assert np.array_equal(getattr(again, name), getattr(sol, name)), name
            for name in ("transitions", "stick", "impacts", "resolved_impacts", "flags"):
                there, here = getattr(again, name), getattr(sol, name)
                assert there.dtype == here.dtype, name
                for field in here.dtype.names:
                    np.testing.assert_array_equal(there[field], here[field])
            resampled = again.resample(n=50)
            assert np.array_equal(resampled.slips, sol.resample(n=50).slips)
        data, frame = sol.to_xarray(), sol.to_pandas()
        name = sol.channel_names[0]
        assert data.slips.sel(channel=name).values.tolist() == sol.slips[:, 0].tolist()
        assert frame[f"mode_{name}"].tolist() == sol.modes[:, 0].tolist()
        assert "stick" in sol._repr_html_()


def test_plots_show_stick_and_slip(block, belt):
    pytest.importorskip("matplotlib")
    for sol in (block, belt):
        ax = zivi.plot.modes(sol)
        (stick,) = [it for it in ax.collections if it.get_label() == "stick"]
        found = [path.get_extents().intervalx.tolist() for path in stick.get_paths()]
        rows = sol.stick
        assert found == pytest.approx(np.column_stack([rows["t_start"], rows["t_end"]]))
        assert len(sol.plot().axes) == 4
    smooth = zivi.MechanicalSystem(mass=1.0, force=[-G], gaps=[zivi.LinearGap([1])], e=0.5)
    with pytest.raises(ValueError, match="needs a run of a system with dry friction"):
        zivi.plot.modes(zivi.simulate(smooth, (0, 0.1), ([1], [0])))


def test_batches_keep_stick_and_transitions(block):
    floor = zivi.LinearGap([0, 1], name="floor", tangent=[1, 0], mu=0.35)
    force = [G * math.sin(0.3), -G * math.cos(0.3)]
    system = zivi.MechanicalSystem(mass=np.eye(2), force=force, gaps=[floor], e=0.5)
    starts = ([[0.0, 0.4], [0.0, 0.2]], [[1.0, 0.0], [0.5, 0.0]])
    batch = zivi.simulate_batch(system, (0, 4), starts, method=TIGHT, save="events")
    assert batch.events[0]["stick"].tolist() == block.stick.tolist()
    assert batch.events[0]["transitions"].tolist() == block.transitions.tolist()


def test_compiled_parts_run_as_those_of_the_interpreter():
    ctypes = pytest.importorskip("ctypes")
    from inside import c_compiler

    if c_compiler() is None:
        pytest.skip("needs a C compiler")
    signature = ctypes.CFUNCTYPE(None, ctypes.c_double, *[ctypes.POINTER(ctypes.c_double)] * 3)

    @signature
    def spring(t, q, w, out):
        out[0], out[1] = -q[0] - 0.1 * w[0], -G

    @signature
    def limit(t, q, w, out):
        out[0] = 0.3 / (1 + abs(w[0]))

    def system(force, limit):
        plane = zivi.HarmonicWall(0.05, 8.0)
        floor = zivi.LinearGap(
            [0, 1], motion=plane, tangent=[1, 0], mu=0.4, belt=zivi.HarmonicWall(0.1, 8.0)
        )
        guide = zivi.DryFriction([1, 0], limit=limit, name="guide")
        return zivi.MechanicalSystem(
            mass=np.eye(2), force=force, gaps=[floor], e=0.3, friction=[guide]
        )

    fast = system(spring, limit)
    slow = system(lambda t, q, w: [-q[0] - 0.1 * w[0], -G], lambda t, q, w: 0.3 / (1 + abs(w[0])))
    assert fast.model(2).spec.is_native
    assert not slow.model(2).spec.is_native
    start = ([0.3, 0.4], [0.5, 0.0])
    one, other = (zivi.simulate(it, (0, 2), start, TIGHT) for it in (fast, slow))
    assert one.success, one.message
    assert one.q[-1] == pytest.approx(other.q[-1], abs=1e-12)
    assert one.transitions["after"].tolist() == other.transitions["after"].tolist()


def test_the_implicit_step_of_a_joint_in_closed_form():
    """1 N pushes against 1.5 N of friction: from 1 m/s it stops after 2 s, and sticks by 1 N."""
    h, push, limit = 1e-2, 1.0, 1.5
    rub = zivi.DryFriction(limit=limit)
    block = zivi.MechanicalSystem(mass=1.0, force=[push], friction=[rub])
    sol = zivi.simulate(block, (0, 3), ([0.5], [1.0]), zivi.ThetaGamma(h=h))
    steps = np.arange(len(sol.t))
    speed = np.maximum(1 - (limit - push) * h * steps, 0.0)
    assert sol.qdot[:, 0] == pytest.approx(speed, abs=1e-12)
    way = np.concatenate([[0.0], np.cumsum(h * speed[1:])])
    assert sol.q[:, 0] - 0.5 == pytest.approx(way, abs=1e-12)
    assert sol.slips[:, 0] == pytest.approx(speed, abs=1e-12)
    assert sol.slip_distances[:, 0] == pytest.approx(way, abs=1e-12)
    assert sol.dissipated == pytest.approx(limit * way, abs=1e-12)
    slides = (steps > 0) & (sol.t < 2 - h)
    assert sol.friction_forces[slides, 0] == pytest.approx(-limit, abs=1e-12)
    assert sol.friction_forces[sol.t > 2 + h, 0] == pytest.approx(-push, abs=1e-9)
    assert (sol.modes[slides, 0] == 1).all()
    assert (sol.modes[sol.t > 2 + h, 0] == 0).all()


def test_friction_of_a_joint_presses_a_contact_of_the_implicit_step():
    """Along (1, 0.3) it pushes the block that slides on the floor down."""
    limit, weight = 2.0, 9.81
    rub = zivi.DryFriction(direction=[1, 0.3], limit=limit)
    floor = zivi.LinearGap([0, 1])
    block = zivi.MechanicalSystem(
        mass=np.eye(2), force=[3.0, -weight], gaps=[floor], e=0.5, friction=[rub]
    )
    sol = zivi.simulate(block, (0, 1), ([0, 0], [1, 0]), zivi.ThetaGamma(h=1e-2))
    late = sol.t > 0.05
    assert sol.reactions[late, 0] == pytest.approx(weight + 0.3 * limit, abs=1e-9)
    assert sol.friction_forces[late, 0] == pytest.approx(-limit, abs=1e-12)
    assert sol.q[:, 1] == pytest.approx(0.0, abs=1e-12)
    assert sol.qdot[-1, 0] == pytest.approx(2.0, abs=1e-9)


def test_a_batch_of_masses_with_friction_runs_them_as_mechanical_systems():
    masses = [
        zivi.ImpactSystem(
            zivi.LinearForce(stiffness=10, amplitude=6, omega=3, gravity=1),
            e=0.5,
            friction=zivi.DryFriction(limit=limit),
        )
        for limit in (0.5, 1.5, 20.0)
    ]
    batch = zivi.simulate_batch(masses, (0, 3), (0.4, 0.1))
    assert isinstance(batch, zivi.simulation.MechanicalBatch)
    one = zivi.simulate_batch(masses[0], (0, 3), [(0.4, 0.1), (0.2, 0.0)], t_eval=[1.0, 2.0])
    for i, mass in enumerate(masses):
        sol = zivi.simulate(mass, (0, 3), (0.4, 0.1))
        assert (batch.q[i], batch.qdot[i]) == (sol.q[-1], sol.qdot[-1])
        assert batch.n_impacts[i] == len(sol.impacts)
    assert np.flatnonzero(batch.qdot[:, 0] == 0.0).tolist() == [2]  # which sticks
    sol = zivi.simulate(masses[0], (0, 3), (0.2, 0.0), t_eval=[1.0, 2.0])
    assert np.array_equal(one.sample_q[1], sol.q)
    with pytest.raises(TypeError, match=r"systems must all be zivi\.ImpactSystem with friction"):
        zivi.simulate_batch([masses[0], zivi.ImpactSystem(-9.81, e=0.5)], (0, 1), (1, 0))
