"""Dry friction as users tell it: what is refused, what is assembled, what results have."""

import numpy as np
import pytest

import zivi
from inside import check_start

FLOOR = {"normal": [0.0, 1.0], "name": "floor"}


def floor(**friction):
    return zivi.LinearGap(**FLOOR, **friction)


def block(*gaps, **more):
    """A mass of 2 in the plane."""
    return zivi.MechanicalSystem(mass=2 * np.eye(2), force=[1.0, -19.62], gaps=gaps, **more)


def curved(**friction):
    """A particle over the parabola y = x^2/2."""
    return zivi.Gap(
        lambda t, q: q[1] - q[0] ** 2 / 2,
        lambda t, q: [-q[0], 1.0],
        lambda t, q, qdot: -(qdot[0] ** 2),
        name="bowl",
        tangent=lambda t, q: [1.0, q[0]],
        mu=0.3,
        **friction,
    )


WRONG = {
    "mu of gap 'floor' must be given": {"tangent": [1, 0]},
    "mu of gap 'floor' needs a tangent": {"mu": 0.3},
    "mu_static of gap 'floor' needs a tangent": {"mu_static": 0.3},
    "belt of gap 'floor' needs a tangent": {"belt": 1.0},
    "e_t of gap 'floor' needs a tangent": {"e_t": 0.5},
    "mu of gap 'floor' must be >= 0": {"tangent": [1, 0], "mu": -0.1},
    "mu of gap 'floor' must be finite": {"tangent": [1, 0], "mu": np.nan},
    "mu_static of gap 'floor' must be at least mu": {
        "tangent": [1, 0],
        "mu": 0.5,
        "mu_static": 0.3,
    },
    "must be at least mu, got 0.3 < 0.4": {
        "tangent": [1, 0],
        "mu": lambda speed: 0.4 / (1 + speed),
        "mu_static": 0.3,
    },
    r"e_t of gap 'floor' must be in \[0, 1\]": {"tangent": [1, 0], "mu": 0.5, "e_t": 1.5},
    "tangent of gap 'floor' must be one vector": {"tangent": np.eye(2), "mu": 0.5},
    "tangent of gap 'floor' must not be zero": {"tangent": [0, 0], "mu": 0.5},
    "belt of gap 'floor' must be finite": {"tangent": [1, 0], "mu": 0.5, "belt": np.inf},
}


@pytest.mark.parametrize(("message", "given"), WRONG.items(), ids=range(len(WRONG)))
def test_what_cannot_be_is_refused_by_its_name_and_gap(message, given):
    with pytest.raises(ValueError, match=message):
        floor(**given)


def test_a_belt_that_is_none_is_refused():
    with pytest.raises(TypeError, match=r"belt of gap .floor. must be a number, a zivi\.Harmonic"):
        floor(tangent=[1, 0], mu=0.3, belt=lambda t: t)


WRONG_JOINTS = {
    "limit of friction 'guide' must be given": {},
    "limit of friction 'guide' must be >= 0": {"limit": -1.0},
    "static of friction 'guide' must be at least limit": {"limit": 1.0, "static": 0.5},
    "direction of friction 'guide' must not be zero": {"limit": 1.0, "direction": [0.0]},
    "velocity of friction 'guide' must be finite": {"limit": 1.0, "velocity": np.nan},
    "limit of friction 'guide' must be one number": {"limit": [1.0, 2.0]},
}


@pytest.mark.parametrize(("message", "given"), WRONG_JOINTS.items(), ids=range(len(WRONG_JOINTS)))
def test_a_joint_that_cannot_be_is_refused(message, given):
    with pytest.raises(ValueError, match=message):
        zivi.DryFriction(**given, name="guide")


def test_systems_refuse_what_does_not_fit():
    guide = zivi.DryFriction([1, 0], limit=1.0, name="floor")
    with pytest.raises(ValueError, match="names of gaps and friction must differ, got 'floor'"):
        block(floor(), friction=[guide])
    with pytest.raises(ValueError, match="direction of 'guide' must be for as many coordinates"):
        block(floor(), friction=[zivi.DryFriction([1, 0, 0], limit=1.0, name="guide")])
    with pytest.raises(TypeError, match=r"friction\[0\] must be a zivi.DryFriction"):
        block(floor(), friction=[0.3])
    with pytest.raises(ValueError, match="impact_law must be one of 'newton', 'poisson'"):
        block(floor(), impact_law="hertz")
    with pytest.raises(ValueError, match="paradox must be one of 'stop', 'impact'"):
        block(floor(), paradox="go")
    many = [
        zivi.LinearGap([0, 1], offset=i, tangent=[1, 0], mu=0.1, name=f"g{i}") for i in range(129)
    ]
    with pytest.raises(ValueError, match="at most 256 together"):
        block(*many)


def test_a_linear_system_refuses_a_gap_with_friction():
    with pytest.raises(NotImplementedError, match=r"gaps\[0\] must be without friction; use"):
        zivi.LinearSystem(np.eye(2), None, np.eye(2), gaps=[floor(tangent=[1, 0], mu=0.3)])


def checked(system, q=(0.3, 0.4), qdot=(1.0, 0.2), t=0.2):
    model = system.model(len(q))
    check_start(system, model, (t, t + 1.0), np.array(q), np.array(qdot))


def test_a_curvature_that_is_not_the_derivative_is_refused():
    checked(block(curved(tangent_curvature=lambda t, q, qdot: qdot[0] * qdot[1])))
    wrong = curved(tangent_curvature=lambda t, q, qdot: 2 * qdot[0] * qdot[1])
    with pytest.raises(ValueError, match="tangent_curvature of gap 'bowl' is not the derivative"):
        checked(block(wrong))
    guide = zivi.DryFriction(lambda t, q: [1.0, q[0]], limit=1.0, curvature=0.0, name="guide")
    with pytest.raises(ValueError, match="curvature of friction 'guide' is not the derivative"):
        checked(block(friction=[guide]))


def test_functions_are_checked_at_the_start():
    along = zivi.Gap(lambda t, q: q[1], [0, 1], tangent=lambda t, q: [0, 1], mu=0.3, name="floor")
    with pytest.raises(ValueError, match="tangent of gap 'floor' must not be along its gradient"):
        checked(block(along))
    less = zivi.DryFriction([1, 0], limit=lambda t, q, qdot: 1 / (1 + abs(qdot[0])), static=0.7)
    with pytest.raises(ValueError, match="static of friction 'friction0' must be at least"):
        checked(block(friction=[less]))
    negative = zivi.DryFriction([1, 0], limit=lambda t, q, qdot: -1.0)
    with pytest.raises(ValueError, match="limit of friction 'friction0' must be >= 0, got -1"):
        checked(block(friction=[negative]))
    lost = zivi.DryFriction([1, 0], limit=lambda t, q, qdot: np.nan)
    with pytest.raises(ValueError, match="limit of friction 'friction0' must be finite"):
        checked(block(friction=[lost]))


def test_the_parts_stand_in_their_places():
    """Gaps with friction first, in their order, then joints; beta is minus the belt's speed."""
    belt = zivi.HarmonicWall(0.1, 3.0, phase=0.4)
    wall = zivi.LinearGap([-1, 0], 0.8, name="wall")
    guide = zivi.DryFriction(
        lambda t, q: [q[0], 1.0],
        limit=lambda t, q, qdot: 1 + qdot[0] ** 2,
        static=9.0,
        velocity=lambda t, q: t * q[1],
    )
    rubbing = floor(tangent=[1, 0], mu=lambda speed: 0.4 / (1 + speed), mu_static=0.5, belt=belt)
    system = block(wall, rubbing, friction=[guide])
    t, q, qdot = 0.7, np.array([0.3, 0.4]), np.array([1.0, -0.2])
    here = system.at(t, q, qdot)
    _, speed, acceleration = belt(t)
    assert system.channel_names == ("floor", "friction0")
    assert here.tangents.tolist() == [[1, 0], [0.3, 1.0]]
    assert here.slip_rates == pytest.approx([-speed, -t * q[1]], abs=1e-15)
    k = qdot[0] ** 2 - (q[1] + t * qdot[1])
    assert here.slip_curvatures == pytest.approx([-acceleration, k], abs=1e-9)
    slip = abs(qdot[0] - speed)
    assert here.limits == pytest.approx([0.4 / (1 + slip), 1 + qdot[0] ** 2])
    assert here.static_limits.tolist() == [0.5, 9.0]
    plain = block(wall, zivi.LinearGap(**FLOOR)).at(t, q, qdot)
    for name in ("mass", "force", "gaps", "gradients", "curvatures", "rates"):
        assert np.array_equal(getattr(here, name), getattr(plain, name))


def test_a_mass_with_friction_is_for_runs_and_batches_only():
    friction = zivi.DryFriction(limit=1.0)
    ball = zivi.ImpactSystem(-9.81, e=0.5, friction=friction)
    assert "friction=DryFriction(direction=1.0, limit=1.0)" in repr(ball)
    with pytest.raises(NotImplementedError, match="do not support the friction of a"):
        zivi.sensitivity(ball, (0, 1), (1, 0))
    with pytest.raises(NotImplementedError, match="diagrams and basins do not support"):
        zivi.bifurcation_diagram(ball, "force", [-9.81], period=1.0)
    with pytest.raises(NotImplementedError, match=r"zivi\.simulate and zivi\.simulate_batch"):
        zivi.simulate_closed_loop_batch(
            ball, zivi.TwistingRegulator(30, 17, h=1e-3, e=0.5), (0, 1), [(1, 0)]
        )
    rubbing = block(floor(tangent=[1, 0], mu=0.3))
    with pytest.raises(ValueError, match="gap 'floor' must be without friction for ThetaGamma"):
        zivi.simulate(rubbing, (0, 1), ([0, 1], [1, 0]), method=zivi.ThetaGamma(h=1e-3))
    with pytest.raises(ValueError, match=r"wall must be None \(at rest\) for a mass with friction"):
        zivi.ImpactSystem(-9.81, e=0.5, wall=zivi.HarmonicWall(0.1, 1.0), friction=friction)
    with pytest.raises(TypeError, match=r"friction must be a zivi\.DryFriction"):
        zivi.ImpactSystem(-9.81, e=0.5, friction=0.3)


@pytest.mark.parametrize("seed", range(6))
def test_newtons_law_has_a_solution_in_a_corner_that_is_not_too_rough(seed):
    """Both gaps bounce and slip away, so both frictions are at their limits: `mu mu < 1`."""
    rng = np.random.default_rng(seed)
    e, (vx, vy) = rng.uniform(0.1, 0.9), rng.uniform(0.5, 3.0, 2)
    for product in (0.7, 0.99, 1.01, 3.0):
        floor_mu = rng.uniform(0.3, 3.0)
        mu = floor_mu, product / floor_mu
        gaps = [
            zivi.LinearGap([0, 1], tangent=[1, 0], mu=mu[0], name="floor"),
            zivi.LinearGap([1, 0], tangent=[0, 1], mu=mu[1], name="wall"),
        ]
        corner = zivi.MechanicalSystem(mass=np.eye(2), force=[0, -1], gaps=gaps, e=e)
        sol = zivi.simulate(corner, (0, 0.1), ([0, 0], [-vx, -vy]))
        if product > 1:
            assert sol.status is zivi.Status.INCONSISTENT_IMPACT
            assert "impact_law='poisson'" in sol.message
            continue
        assert sol.success
        # P_floor - mu_wall P_wall = (1 + e) vy,  P_wall - mu_floor P_floor = (1 + e) vx
        equations = np.array([[1.0, -mu[1]], [-mu[0], 1.0]])
        impulses = np.linalg.solve(equations, (1 + e) * np.array([vy, vx]))
        np.testing.assert_allclose(sol.impacts["impulse"][:2], impulses, rtol=1e-12)
        np.testing.assert_allclose(sol.impacts["speed_after"][:2], [e * vy, e * vx], rtol=1e-12)


@pytest.mark.parametrize("count", [3, 7, 20])
def test_many_rough_contacts_are_decided(count):
    """Independent boxes, pulled with more or less than friction holds, at rest or falling."""
    push, pull = np.eye(2 * count)[1::2], np.eye(2 * count)[::2]
    gaps = [
        zivi.LinearGap(n, tangent=b, mu=0.3, name=str(k))
        for k, (n, b) in enumerate(zip(push, pull, strict=True))
    ]
    pulls = 9.81 * 0.3 * np.where(np.arange(count) % 2, 1.5, 0.5)
    force = np.column_stack([pulls, np.full(count, -9.81)]).ravel()
    boxes = zivi.MechanicalSystem(mass=np.eye(2 * count), force=force, gaps=gaps, e=0.5)
    still = [0] * (2 * count)
    sol = zivi.simulate(boxes, (0, 0.6), ([0, 0] * count, still))
    assert sol.success, sol.message
    exact = np.where(np.arange(count) % 2, 9.81 * 0.15 * 0.6, 0.0)
    assert sol.qdot[-1, ::2] == pytest.approx(exact, abs=1e-9)
    # with 1 m/s onto the floor: friction takes 1.5 mu at most of what the pull has given
    fell = zivi.simulate(boxes, (0, 0.1), ([0, 0] * count, [0.3, -1.0] * count))
    assert fell.success, fell.message
    assert fell.impacts["impulse"][:count] == pytest.approx(1.5)
    assert np.all(fell.impacts["slip_after"][:count] == 0.0)


def hostile(seed):
    """A run under forces that jump, remember, or are noise, with random friction."""
    rng = np.random.default_rng(seed)
    n, kind = int(rng.integers(2, 4)), seed % 4
    root, small = rng.normal(size=(n, n)), 10.0 ** rng.integers(-18, 1)
    constant, jumps = 2 * rng.normal(size=n), 2 * rng.normal(size=(2, n, n))
    memory = np.ones(n)

    def force(t, q, qdot):
        if kind == 0:
            return constant + jumps[0] @ np.sign(qdot)
        if kind == 1:
            return constant + jumps[0] @ np.sign(qdot - small) + jumps[1] @ np.sign(q)
        if kind == 2:
            memory[qdot > small], memory[qdot < -small] = -1, 1
            return constant + jumps[0] @ memory
        return constant + jumps[0] @ rng.normal(size=n)

    gaps = [
        zivi.LinearGap(normal, tangent=tangent, mu=rng.uniform(0, 2), name=f"gap{k}")
        for k, (normal, tangent) in enumerate(rng.normal(size=(rng.integers(0, 3), 2, n)))
    ]
    joints = [
        zivi.DryFriction(
            limit=rng.uniform(0.1, 2),
            direction=direction,
            velocity=rng.choice([0, small, 1]),
            name=f"joint{k}",
        )
        for k, direction in enumerate(rng.normal(size=(rng.integers(1, 4), n)))
    ]
    system = zivi.MechanicalSystem(
        mass=root @ root.T + 0.2 * np.eye(n), force=force, gaps=gaps, friction=joints, e=0.3
    )
    start, speeds = rng.choice([0, 1.0, 1e6]), rng.normal(size=n) * rng.choice([0, small, 1])
    method = zivi.SwitchedRK(max_steps=150)
    return zivi.simulate(system, (start, start + 1), (np.zeros(n), speeds), method)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")
def test_hostile_forces_end_in_no_fault_of_the_method():
    ends = {hostile(seed).status.name for seed in range(60)}
    assert {"COMPLETED", "STEP_BUDGET", "STEP_SIZE_TOO_SMALL"} <= ends
    assert not ends & {"INTERNAL", "MODE_CHATTER"}
