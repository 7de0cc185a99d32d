"""Dry friction of trees: closed forms, the equations put back, other coordinates, refusals."""

import pickle

import numpy as np
import pytest

import motion_oracle
import zivi
from test_tree import Cloud, turn
from zivi.mechanics import BallGap, Body, JointLimit, PlaneGap

TIGHT = zivi.SwitchedRK(rtol=1e-12, atol=1e-13)
G = 9.81


def test_a_pendulum_with_friction_stops_after_the_coulomb_decrements():
    # J q'' = -k q - L Sign(q'): each half turn takes 2 L/k off the amplitude
    stiffness, inertia, limit, start = 2.0, 0.3, 0.17, 1.0
    wheel = Body("wheel", axis=[0, 1, 0], inertia=inertia, mass=1.0, stiffness=stiffness)
    tree = zivi.Tree([wheel], friction=[zivi.DryFriction("wheel", limit=limit)])
    assert tree.channel_names == ("wheel",)
    assert tree.parameters["wheel.friction"] == limit
    sol = zivi.simulate(tree, (0, 30), ([start], [0.0]), method=TIGHT)
    turns = int(np.ceil((start - limit / stiffness) / (2 * limit / stiffness)))
    last = (-1) ** turns * (start - turns * 2 * limit / stiffness)
    assert abs(last) <= limit / stiffness
    assert sol.q[-1, 0] == pytest.approx(last, abs=1e-11)
    assert sol.slips[-1, 0] == 0.0
    stop = turns * np.pi * np.sqrt(inertia / stiffness)
    assert sol.transitions["t"][-1] == pytest.approx(stop, abs=1e-10)
    lost = stiffness * (start**2 - last**2) / 2
    assert sol.dissipated[-1] == pytest.approx(lost, abs=1e-10)


def capsule(mu, gaps=(-0.4, 0.4), **more):
    """A capsule that lies along x, with three coordinates, on a floor."""
    return zivi.Tree(
        [
            Body("x", kind="slide", axis=[1, 0, 0]),
            Body("z", "x", kind="slide", axis=[0, 0, 1]),
            Body("rod", "z", axis=[0, 1, 0], mass=1.3, inertia=0.1, coordinate="pitch"),
        ],
        gaps=[
            PlaneGap("rod", [x, 0, 0], radius=0.05, mu=mu, name=f"end{i}")
            for i, x in enumerate(gaps)
        ],
        **more,
    )


@pytest.mark.parametrize("mu", [0.1, 0.35])
@pytest.mark.parametrize("speed", [1.0, -2.0])
def test_a_sliding_capsule_stops_after_v_squared_over_two_mu_g(mu, speed):
    tree = capsule(mu)
    sol = zivi.simulate(tree, (0, 4 / (mu * G)), ([0, 0.05, 0], [speed, 0, 0]), method=TIGHT)
    assert sol.q[-1, 0] == pytest.approx(np.sign(speed) * speed**2 / (2 * mu * G), abs=1e-9)
    assert sol.transitions["t"][-1] == pytest.approx(abs(speed) / (mu * G), abs=1e-9)
    assert not sol.slips[-1].any()
    np.testing.assert_allclose(sol.q[-1, 1:], [0.05, 0.0], rtol=0, atol=1e-13)


def test_a_ball_that_slides_rolls_after_two_sevenths_of_its_speed():
    # of a solid ball: v = 5/7 v0, at t = 2 v0/(7 mu g); then it rolls, its slip is 0
    mass, radius, mu, speed = 2.0, 0.1, 0.2, 1.4
    ball = [
        Body("x", kind="slide", axis=[1, 0, 0]),
        Body("z", "x", kind="slide", axis=[0, 0, 1]),
        Body("ball", "z", axis=[0, 1, 0], mass=mass, inertia=0.4 * mass * radius**2),
    ]
    tree = zivi.Tree(ball, gaps=[PlaneGap("ball", radius=radius, mu=mu, name="floor")])
    sol = zivi.simulate(tree, (0, 1), ([0, radius, 0], [speed, 0, 0]), method=TIGHT)
    assert sol.transitions["t"][-1] == pytest.approx(2 * speed / (7 * mu * G), abs=1e-10)
    assert sol.qdot[-1, 0] == pytest.approx(5 * speed / 7, abs=1e-10)
    assert sol.qdot[-1, 2] * radius == pytest.approx(5 * speed / 7, abs=1e-10)
    assert sol.slips[-1, 0] == 0.0
    assert sol.friction_forces[-1, 0] == pytest.approx(0.0, abs=1e-12)


def test_a_slope_holds_up_to_the_static_coefficient():
    angle = np.arctan(0.5)
    normal = [-np.sin(angle), 0, np.cos(angle)]
    box = [
        Body("x", kind="slide", axis=[1, 0, 0]),
        Body("box", "x", kind="slide", axis=[0, 0, 1], mass=1.0, coordinate="z"),
    ]

    def run(**more):
        gap = PlaneGap("box", normal=normal, name="slope", **more)
        tree = zivi.Tree(box, gaps=[gap])
        return zivi.simulate(tree, (0, 1), ([0, 0], [0, 0]), method=TIGHT)

    np.testing.assert_allclose(run(mu=0.3, mu_static=0.5 + 1e-9).q[-1], 0, rtol=0, atol=1e-15)
    slid = run(mu=0.3, mu_static=0.5 - 1e-9)
    gone = G * (np.sin(angle) - 0.3 * np.cos(angle)) / 2
    assert np.linalg.norm(slid.q[-1]) == pytest.approx(gone, abs=1e-10)


def hopper(mu):
    """Torso, thigh, shin and foot in a plane, with springs that hold the leg."""
    spring = {"axis": [0, 1, 0], "stiffness": 60.0, "damping": 3.0}
    return [
        Body("x", kind="slide", axis=[1, 0, 0]),
        Body("z", "x", kind="slide", axis=[0, 0, 1]),
        Body("torso", "z", axis=[0, 1, 0], mass=4.0, com=[0, 0, 0.1], inertia=0.08,
             coordinate="pitch"),
        Body("thigh", "torso", position=[0, 0, -0.1], mass=1.5, com=[0, 0, -0.2], inertia=0.02,
             coordinate="hip", spring=-0.5, **spring),
        Body("shin", "thigh", position=[0, 0, -0.4], mass=1.0, com=[0, 0, -0.2], inertia=0.015,
             coordinate="knee", spring=1.0, **spring),
        Body("foot", "shin", position=[0, 0, -0.4], mass=0.6, com=[0.05, 0, 0], inertia=0.003,
             coordinate="ankle", spring=-0.5, **spring),
    ], [
        PlaneGap("foot", [x, 0, -0.05], radius=0.03, mu=mu, name=name)
        for name, x in (("heel", -0.08), ("toe", 0.18))
    ]  # fmt: skip


def test_a_hopper_that_is_dropped_sticks_without_slip():
    bodies, gaps = hopper(2.0)
    tree = zivi.Tree(bodies, gaps=gaps)
    q = np.array([0.0, 1.0, 0.0, -0.5, 1.0, -0.5])
    q[1] -= tree.at(0.0, q, 0 * q).gaps.min() - 0.05
    sol = zivi.simulate(tree, (0, 0.6), (q, np.zeros(6)))
    assert sol.success
    touched = sol.modes != 2
    assert touched[-1].all()
    assert np.all(sol.slips[sol.modes == 0] == 0.0)
    assert sol.modes[-1].tolist() == [0, 0]
    assert sol.slips[-1].tolist() == [0.0, 0.0]
    # after the foot is flat it stays where it is
    flat = sol.t > sol.transitions["t"][-1]
    place = [Cloud(bodies).place(it, "foot", [0.05, 0, -0.05])[0] for it in sol.q[flat]]
    assert np.ptp(place) < 1e-9


# Random trees in the plane, in worlds that are turned.


def random_tree(seed):
    """A tree that moves in a plane of any direction, with friction of gaps and joints."""
    rng = np.random.default_rng(seed)
    world = turn(rng.normal(size=3), rng.uniform(0, 3))
    tilt = turn([0, 1, 0], rng.uniform(-0.4, 0.4))
    bodies = [Body("world", kind="fixed", rotation=world)]
    floats = rng.random() < 0.6
    if floats:
        across = rng.uniform(-1, 1)
        bodies += [
            Body("x", "world", "slide", axis=[1, 0, across], mass=rng.uniform(0, 0.2)),
            Body("z", "x", "slide", axis=[-across, 0, 1.5], mass=0.1),
        ]
    count = int(rng.integers(1, 4)) if floats else int(rng.integers(2, 4))
    for i in range(count):
        parent = bodies[-1].name if rng.random() < 0.7 or i == 0 else f"link{rng.integers(i)}"
        slides = i > 0 and rng.random() < 0.25
        across = rng.normal(size=2)
        bodies.append(
            Body(
                f"link{i}",
                parent,
                "slide" if slides else "hinge",
                position=[*rng.uniform(-0.4, 0.4, 2), 0] @ turn([1, 0, 0], -np.pi / 2),
                rotation=turn([0, 1, 0], rng.uniform(-3, 3)),
                axis=[across[0], 0, across[1]] if slides else [0, rng.choice([-1.0, 2.0]), 0],
                anchor=[*rng.uniform(-0.1, 0.1, 3)],
                mass=rng.uniform(0.3, 2),
                com=rng.uniform(-0.2, 0.2, 3),
                inertia=rng.uniform(0.05, 0.3, 3) + 0.1,
                stiffness=rng.uniform(0, 9),
                damping=rng.uniform(0, 0.3) if rng.random() < 0.5 else 0.0,
                reference=rng.normal(),
            )
        )
    normals = [world @ tilt @ n for n in ([0, 0, 1], [np.sin(1.2), 0, np.cos(1.2)])]
    gaps = [
        PlaneGap(
            f"link{rng.integers(0 if floats else 1, count)}",
            rng.uniform(-0.5, 0.5, 3),
            normals[int(rng.random() < 0.3)],
            radius=rng.uniform(0, 0.1),
            mu=(mu := rng.uniform(0.1, 0.9)),
            mu_static=mu * rng.uniform(1, 1.5) if rng.random() < 0.4 else None,
            name=f"foot{k}",
        )
        for k in range(int(rng.integers(1, 4 if floats else 2)))
    ]
    joints = [
        zivi.DryFriction(body.joint, limit=rng.uniform(0.05, 0.6))
        for body in bodies[-count:]
        if rng.random() < 0.3
    ]
    q = [body.reference + rng.normal(scale=0.3) for body in bodies if body.moves]
    w = [rng.normal(scale=0.7) for body in bodies if body.moves]
    more = {"gravity": world @ tilt @ [0, 0, -G], "e": rng.uniform(0, 0.5), "friction": joints}
    more["impact_law"] = str(rng.choice(["newton", "poisson"]))
    tree = zivi.Tree(bodies, gaps=gaps, **more)
    # planes a little below the points
    below = tree.at(0.0, q, w).gaps - rng.uniform(0.02, 0.3, len(gaps))
    for gap, gap_below in zip(gaps, below, strict=True):
        object.__setattr__(gap, "offset", float(gap_below))
    return bodies, gaps, zivi.Tree(bodies, gaps=gaps, paradox="impact", **more), (q, w)


def slip_of(cloud, gap, q, w):
    """Direction and curvature of the slip from places alone: the ball turns under its point."""
    n, (rotation, _) = np.asarray(gap.normal), cloud.frames(np.asarray(q))[gap.body]
    under = gap.point - gap.radius * rotation.T @ n
    jac, bias = cloud.derivatives(lambda it: cloud.place(it, gap.body, under), q, w)
    return jac, bias


@pytest.mark.parametrize("seed", range(8))
def test_slip_is_the_velocity_of_the_point_of_contact(seed):
    bodies, gaps, tree, (q, w) = random_tree(seed)
    here, cloud = tree.at(0.0, q, w), Cloud(bodies)
    for i, gap in enumerate(gaps):
        jac, bias = slip_of(cloud, gap, np.array(q), np.array(w))
        n = np.asarray(gap.normal)
        sideways = jac - np.outer(n, n @ jac)
        size = np.linalg.norm(here.tangents[i])
        assert np.linalg.norm(sideways) == pytest.approx(size, abs=1e-12)
        t = sideways @ here.tangents[i] / size**2
        np.testing.assert_allclose(t @ jac, here.tangents[i], rtol=0, atol=1e-12)
        assert t @ bias == pytest.approx(here.slip_curvatures[i], abs=1e-9)
        assert here.limits[i] == gap.mu
        assert here.static_limits[i] == (gap.mu_static or gap.mu)


@pytest.mark.parametrize("seed", range(50))
def test_runs_of_random_trees_obey_the_laws(seed):
    bodies, _, tree, (q, w) = random_tree(seed)
    cloud, tol = Cloud(bodies), 1e-9
    gravity, mass = np.asarray(tree._gravity), [body.mass for body in bodies]

    def energy(q, w):
        places = [cloud.place(q, body.name, body.com) for body in bodies]
        springs = [
            body.stiffness * (x - body.spring) ** 2 / 2
            for body, x in zip((it for it in bodies if it.moves), q, strict=True)
        ]
        return w @ tree.at(0.0, q, w).mass @ w / 2 - mass @ (places @ gravity) + sum(springs)

    sol = zivi.simulate(tree, (0, 1.0), (q, w), method=TIGHT)
    assert sol.success, sol.message
    kept = all(body.damping == 0.0 for body in bodies)
    found = motion_oracle.check(
        tree, sol, np.random.default_rng(seed), tol, energy if kept else None, (q, w)
    )
    assert found.faults == []


def test_random_trees_slip_stick_and_strike():
    """What the runs above have in them."""
    seen = np.zeros(3, int)
    impacts = 0
    for seed in range(0, 50, 5):
        _, _, tree, start = random_tree(seed)
        sol = zivi.simulate(tree, (0, 1.0), start)
        seen += [np.sum(sol.modes == 0), np.sum(np.abs(sol.modes) == 1), len(sol.transitions)]
        impacts += len(sol.impacts)
    assert seen.min() > 20
    assert impacts > 20


# Numbers, pickles, files, batches.


def test_numbers_of_friction_are_parameters():
    tree = zivi.Tree(
        [Body("x", kind="slide", axis=[1, 0, 0]), Body("z", "x", "slide", mass=1.0)],
        gaps=[PlaneGap("z", mu=0.2, mu_static=0.3, name="floor")],
        friction=[zivi.DryFriction("x", limit=0.1, static=0.2)],
        paradox="impact",
    )
    names = ["floor.mu", "floor.mu_static", "x.friction", "x.friction_static"]
    assert [tree.parameters[name] for name in names] == [0.2, 0.3, 0.1, 0.2]
    assert repr(tree) == (
        "Tree(joints=(x, z), gaps=(floor), e=(0), friction=(floor, x), paradox='impact')"
    )
    here = tree.replace(**{"floor.mu": 0.1, "x.friction_static": 0.5}).at(0, [0, 0], [0, 0])
    assert here.limits.tolist() == [0.1, 0.1]
    assert here.static_limits.tolist() == [0.3, 0.5]
    np.testing.assert_array_equal(here.tangents, [[1, 0], [1, 0]])
    with pytest.raises(ValueError, match="must be >= 0"):
        tree.parameters["floor.mu"] = -0.1
    copy = pickle.loads(pickle.dumps(tree))
    assert repr(copy) == repr(tree)
    assert dict(copy.parameters) == dict(tree.parameters)
    with pytest.raises(NotImplementedError, match="derivatives with friction need paradox='stop'"):
        zivi.sensitivity(tree, (0, 1), ([0, 0], [1, 0]), wrt=["floor.mu"])


def test_a_joint_and_a_gap_of_one_body_have_names():
    bodies = [Body("x", kind="slide", axis=[1, 0, 0]), Body("box", "x", "slide", mass=1.0)]
    rough = [zivi.DryFriction("box", limit=0.1), zivi.DryFriction("x", limit=0.1)]
    tree = zivi.Tree(bodies, gaps=[PlaneGap("box", mu=0.2)], friction=rough)
    assert tree.channel_names == ("box", "box.friction", "x")


def test_a_batch_is_its_runs():
    _, _, tree, start = random_tree(3)
    foot = tree.channel_names[0]
    several = [tree.replace(**{f"{foot}.mu": mu}) for mu in (0.0, 0.1)]
    batch = zivi.simulate_batch(several, (0, 0.5), start)
    single = [zivi.simulate(it, (0, 0.5), start) for it in several]
    assert [it.tobytes() for it in batch.q] == [it.q[-1].tobytes() for it in single]


def test_a_file_keeps_the_friction(tmp_path):
    bodies, gaps, tree, start = random_tree(0)
    tree = zivi.Tree(
        bodies,
        gaps=[*gaps, JointLimit("link0", -9.0)],
        friction=[zivi.DryFriction("link0", limit=0.2, static=0.3)],
        impact_law="poisson",
        paradox="impact",
    )
    path = tmp_path / "tree.toml"
    path.write_text(zivi.files.tree_text(tree, (0, 0.3), start))
    sol, again = zivi.simulate(tree, (0, 0.3), start), zivi.files.prepare_simulate(path).run()
    assert sol.channel_names == again.channel_names
    np.testing.assert_array_equal(sol.q, again.q)


SPACE = [
    Body("yaw", axis=[0, 0, 1], mass=1.0, inertia=0.1),
    Body("pitch", "yaw", axis=[0, 1, 0], mass=1.0, inertia=0.1, com=[1, 0, 0]),
    Body("rail", "pitch", "slide", axis=[0, 1, 1], mass=1.0),
]


def test_friction_of_a_body_in_space_has_two_directions():
    two = ("tip[0]", "tip[1]")
    tip = {"mu": 0.1, "name": "tip"}
    assert zivi.Tree(SPACE, gaps=[PlaneGap("pitch", [1, 0, 0], **tip)]).channel_names == two
    bodies = [Body("pitch", axis=[0, 1, 0], mass=1.0, inertia=0.1), SPACE[2]]
    assert zivi.Tree(bodies, gaps=[PlaneGap("rail", [1, 0, 0], **tip)]).channel_names == two
    tilted = PlaneGap("pitch", normal=[0, 1, 1], **tip)
    assert zivi.Tree(bodies[:1], gaps=[tilted]).channel_names == two
    # one where the motion is one in a plane, in a tree that has others
    tree = zivi.Tree([*SPACE, Body("cart", kind="slide", axis=[1, 0, 0], mass=1.0)],
                     gaps=[PlaneGap("cart", normal=[1, 0, 1], mu=0.1)])  # fmt: skip
    assert tree.channel_names == ("cart",)


def test_a_piston_on_a_plane_has_no_slip():
    piston = [Body("piston", kind="slide", mass=1.0)]
    tree = zivi.Tree(piston, gaps=[PlaneGap("piston", mu=0.4)])
    assert tree.channel_names == ()


BAD = {
    r"mu of the gap of body 'a' must be >= 0": lambda: PlaneGap("a", mu=-0.1),
    r"mu_static of the gap of body 'a' must be at least mu": lambda: PlaneGap(
        "a", mu=0.2, mu_static=0.1
    ),
    r"friction\[0\] names 'elbow': there are a": lambda: zivi.DryFriction("elbow", limit=1.0),
    r"friction\[0\] must name a joint of the tree": lambda: zivi.DryFriction([1.0], limit=1.0),
    r"limit of friction\[0\] must be a number": lambda: zivi.DryFriction(
        "a", limit=lambda t, q, qdot: 1.0
    ),
    r"velocity of friction\[0\] must be 0": lambda: zivi.DryFriction("a", limit=1.0, velocity=0.1),
    "each joint once, got 'a' twice": lambda: [zivi.DryFriction("a", limit=1.0)] * 2,
    "names of gaps and friction must differ": lambda: zivi.DryFriction("a", limit=1, name="g"),
}


@pytest.mark.parametrize("words", sorted(BAD))
def test_bad_friction_is_named(words):
    with pytest.raises((ValueError, TypeError, NotImplementedError), match=words):
        zivi.Tree(
            [Body("a", kind="slide", mass=1.0)],
            gaps=[PlaneGap("a", name="g")],
            friction=BAD[words](),
        )


def test_names_of_joints_are_for_trees():
    named = zivi.DryFriction("x", limit=0.1)
    with pytest.raises(TypeError, match=r"names of joints are for a zivi\.Tree"):
        zivi.MechanicalSystem(mass=1.0, force=[0.0], coordinates=["x"], friction=[named])
    with pytest.raises(TypeError, match=r"names of joints are for a zivi\.Tree"):
        zivi.ImpactSystem(force=-1.0, e=0.5, friction=named)


def test_one_coordinate_has_no_direction_of_slip_besides_that_of_the_gap():
    bob = Body("bob", axis=[0, 1, 0], mass=1.0, com=[0, 0, -1], inertia=0.01)
    tree = zivi.Tree([bob], gaps=[PlaneGap("bob", [0, 0, -1], offset=-0.8, mu=0.1)])
    with pytest.raises(ValueError, match="set mu=0 where one coordinate moves the point"):
        zivi.simulate(tree, (0, 1), ([1.0], [0.0]))


def test_balls_beside_balls_have_two_directions_of_friction():
    bodies = [Body("yaw", axis=[0, 0, 1], mass=1.0, inertia=0.1),
              Body("rail", "yaw", "slide", axis=[0, 1, 1], mass=1.0)]  # fmt: skip
    gap = BallGap("rail", [1, 0, 0], radius=0.1, mu=0.2, name="balls")
    assert zivi.Tree(bodies, gaps=[gap]).channel_names == ("balls[0]", "balls[1]")
    with pytest.raises(ValueError, match="share of the gap of body 'rail' must be in"):
        BallGap("rail", radius=0.1, mu=0.2, share=1.5)


def test_coefficients_of_gaps_are_numbers():
    numbers = {"radius": 1, "mu": 1, "mu_static": 2}
    for gap in (PlaneGap("ball", **numbers), BallGap("ball", other="box", **numbers)):
        assert (gap.mu, gap.mu_static) == (1.0, 2.0)
        assert type(gap.mu) is type(gap.mu_static) is float


def test_another_restitution_does_not_go_with_a_compliant_gap():
    ball = Body("ball", kind="slide", axis=[0, 0, 1], mass=1.0)
    floor = PlaneGap("ball", name="mat", contact=zivi.SpringDamper(1e4, 20.0))
    tree = zivi.Tree([ball], gaps=[floor])
    with pytest.raises(ValueError, match=r"e of gap 'mat' must be 0, got 0\.5: the gap is compl"):
        tree.replace(e=0.5)
    assert tree.replace(e=0.0).m == 1


def test_gaps_and_friction_are_at_most_256_together():
    def chain(n):
        bodies = [Body(f"b{i}", kind="slide", axis=[1, 0, 0], mass=1.0) for i in range(n)]
        wall = PlaneGap("b0", normal=[1, 0, 0], name="wall")
        rubbing = [zivi.DryFriction(body.joint, limit=0.1) for body in bodies]
        return zivi.Tree(bodies, gaps=[wall], friction=rubbing)

    assert len(chain(255).channel_names) == 255
    with pytest.raises(ValueError, match="at most 256"):
        chain(256)
