"""Trees of bodies against clouds of points, energies in SymPy, and differences."""

import functools
import pickle

import numpy as np
import pytest

import zivi
from inside import files_commands as commands
from zivi.mechanics import BallGap, Body, JointLimit, PlaneGap

TIGHT = zivi.SwitchedRK(rtol=1e-12, atol=1e-13)


def turn(axis, angle):
    """Rodrigues' rotation, of complex angles too."""
    a = np.asarray(axis, float) / np.linalg.norm(axis)
    k = np.array([[0, -a[2], a[1]], [a[2], 0, -a[0]], [-a[1], a[0], 0]])
    return np.eye(3) + np.sin(angle) * k + (1 - np.cos(angle)) * k @ k


class Cloud:
    """Bodies as six points of mass each, whose places are functions of the coordinates."""

    def __init__(self, bodies, gravity=(0, 0, -9.81)):
        self.bodies, self.gravity = bodies, np.asarray(gravity)
        self.coordinates = [body for body in bodies if body.kind != "fixed"]

    def frames(self, q):
        found = {None: (np.eye(3), np.zeros(3))}
        values = {body.name: q[i] for i, body in enumerate(self.coordinates)}
        for body in self.bodies:
            rotation, origin = found[body.parent]
            origin = origin + rotation @ body.position
            rotation = rotation @ body.rotation
            moved = values.get(body.name, body.reference) - body.reference
            if body.kind == "slide":
                origin = origin + rotation @ body.axis / np.linalg.norm(body.axis) * moved
            elif body.kind == "hinge":
                at = origin + rotation @ body.anchor
                rotation = rotation @ turn(body.axis, moved)
                origin = at - rotation @ body.anchor
            found[body.name] = rotation, origin
        return found

    def points(self, body):
        """Masses and places in the body's frame that have its inertia."""
        radii, axes = np.linalg.eigh(np.trace(body.inertia) / 2 * np.eye(3) - body.inertia)
        arms = [
            s * np.sqrt(3 * r / body.mass) * a
            for r, a in zip(radii, axes.T, strict=False)
            for s in (-1, 1)
        ]
        return [(body.mass / 6, body.com + arm) for arm in arms]

    def place(self, q, body, point):
        rotation, origin = self.frames(q)[body]
        return origin + rotation @ point

    def derivatives(self, place, q, w):
        """Jacobian, and what the acceleration is without ``q''``, of a place."""
        n = len(q)
        step = 1e-30j * np.eye(n)
        jac = np.array([place(q + it).imag / 1e-30 for it in step]).T

        def rate(s):
            return place(q + s * w + 1e-30j * w).imag / 1e-30

        h = 2e-3
        odd = [rate(k * h) - rate(-k * h) for k in (1, 2, 3)]
        return jac, (45 * odd[0] - 9 * odd[1] + odd[2]) / (60 * h)

    def at(self, q, w):
        mass = np.diag([body.armature for body in self.coordinates])
        force = np.array(
            [
                body.torque - body.stiffness * (q[i] - body.spring) - body.damping * w[i]
                for i, body in enumerate(self.coordinates)
            ]
        )
        for body in self.bodies:
            for m, point in self.points(body) if body.mass else []:
                place = functools.partial(self.place, body=body.name, point=point)
                jac, bias = self.derivatives(place, q, w)
                mass = mass + m * jac.T @ jac
                force = force + m * jac.T @ (self.gravity - bias)
        return mass, force


def spatial():
    """A tree with a branch, a body that is fixed to another, and tilted frames."""
    tilted = turn([1, 2, 3], 0.7)
    inertia = tilted @ np.diag([0.2, 0.3, 0.15]) @ tilted.T
    return [
        Body("cart", kind="slide", axis=[1, 0.2, 0], mass=2.0, reference=0.3, damping=0.1),
        Body(
            "arm",
            "cart",
            position=[0.1, 0.2, 0.3],
            rotation=tilted,
            axis=[1, -1, 2],
            anchor=[0.2, 0.0, -0.1],
            mass=1.5,
            com=[0.3, 0.1, -0.2],
            inertia=inertia,
            stiffness=3.0,
            spring=0.2,
            damping=0.4,
            armature=0.05,
            torque=0.7,
        ),
        Body("tool", "arm", "fixed", [0.4, 0, 0], turn([0, 1, 0], 0.5), mass=0.5, com=[0, 0, 0.1]),
        Body(
            "rod", "tool", "slide", [0, 0.1, 0.2], axis=[0, 0, 2], mass=0.7, inertia=[0.1, 0.1, 0]
        ),
        Body("wheel", "cart", axis=[0, 1, 0], mass=0.9, com=[0.1, 0, 0], inertia=0.05),
        Body("post", None, "fixed", [1.0, 2.0, 3.0], mass=5.0),
    ]


GAPS = [
    JointLimit("rod", -2.0, 3.0),
    PlaneGap("rod", [0.1, 0, 0.4], [1, 2, -2], -9.0, 0.1, name="wall"),
    PlaneGap("tool", [0.1, 0, 0], offset=-7.0, name="corner"),
    BallGap("wheel", [0.2, 0, 0], "rod", [0, 0.3, 0], 0.1, name="balls"),
    BallGap("post", [0.1, 0, 0], "arm", [0, 0.3, 0], 0.1, name="post"),
]


def states(n, count=4):
    rng = np.random.default_rng(1)
    return rng.normal(size=(count, 2, n))


def gaps_of(cloud):
    """The same gaps of places of the cloud."""
    n = np.array([1, 2, -2]) / 3

    def beside(q, *points):
        s = cloud.place(q, *points[:2]) - cloud.place(q, *points[2:])
        return np.array([np.sqrt(s @ s) - 0.1])

    return [
        lambda q: q[2:3] + 2.0,
        lambda q: 3.0 - q[2:3],
        lambda q: np.array([n @ cloud.place(q, "rod", [0.1, 0, 0.4]) + 8.9]),
        lambda q: cloud.place(q, "tool", [0.1, 0, 0])[2:] + 7.0,
        lambda q: beside(q, "wheel", [0.2, 0, 0], "rod", [0, 0.3, 0]),
        lambda q: beside(q, "post", [0.1, 0, 0], "arm", [0, 0.3, 0]),
    ]


def test_a_tree_is_the_cloud_of_its_points():
    bodies = spatial()
    cloud, tree = Cloud(bodies), zivi.Tree(bodies, gaps=GAPS)
    assert tree.coordinate_names(4) == ("cart", "arm", "rod", "wheel")
    assert tree.gap_names == ("rod.lower", "rod.upper", "wall", "corner", "balls", "post")
    for q, w in states(4):
        here = tree.at(0.0, q, w)
        mass, force = cloud.at(q, w)
        np.testing.assert_allclose(here.mass, mass, rtol=0, atol=2e-14)
        np.testing.assert_allclose(here.force, force, rtol=0, atol=2e-10)
        for i, gap in enumerate(gaps_of(cloud)):
            gradient, curvature = cloud.derivatives(gap, q, w)
            np.testing.assert_allclose(here.gaps[i], gap(q)[0], rtol=0, atol=2e-14)
            np.testing.assert_allclose(here.gradients[i], gradient[0], rtol=0, atol=2e-14)
            np.testing.assert_allclose(here.curvatures[i], curvature[0], rtol=0, atol=2e-10)


def arm():
    """Two links in the plane, the tip above a table, with a limit of the elbow."""
    link = {"axis": [0, 1, 0], "damping": 0.05, "com": [0.3, 0, 0]}
    return zivi.Tree(
        [
            Body("upper", mass=1.2, inertia=0.04, coordinate="a", **link),
            Body("fore", "upper", position=[0.6, 0, 0], mass=0.8, inertia=0.03, armature=0.01,
                 coordinate="b", stiffness=0.5, spring=0.1, torque=0.2, **link),
        ],
        gaps=[
            PlaneGap("fore", [0.5, 0, 0], offset=-0.9, radius=0.05, name="table"),
            JointLimit("b", lower=-1.0),
        ],
        e=[0.6, 0.4],
    )  # fmt: skip


def energies():
    pytest.importorskip("sympy")
    height = "-(0.6*sin(a) + 0.3*sin(a + b))"
    kinetic = "0.04*adot**2/2 + 0.03*(adot + bdot)**2/2 + 0.01*bdot**2/2"
    kinetic += "+ 1.2*0.09*adot**2/2 + 0.8*(0.36*adot**2 + 0.09*(adot + bdot)**2"
    kinetic += " + 0.36*adot*(adot + bdot)*cos(b))/2"
    return zivi.symbolic.system(
        "a b",
        T=kinetic,
        V=f"-1.2*9.81*0.3*sin(a) + 0.8*9.81*({height}) + 0.25*(b - 0.1)**2 - 0.2*b",
        Q=["-0.05*adot", "-0.05*bdot"],
        gaps={"table": "-(0.6*sin(a) + 0.5*sin(a + b)) + 0.9 - 0.05", "b.lower": "b + 1"},
        e=[0.6, 0.4],
    )


def test_two_links_are_those_of_their_energies():
    tree, exact = arm(), energies()
    for q, w in states(2, 20):
        here, there = tree.at(0.0, q, w), exact.at(0.0, q, w)
        for name in ("mass", "force", "gaps", "gradients", "curvatures", "rates"):
            np.testing.assert_allclose(
                getattr(here, name), getattr(there, name), rtol=0, atol=2e-14, err_msg=name
            )
    start = [0.2, 0.3], [0.0, 0.0]
    sol, known = (zivi.simulate(it, (0, 3), start, method=TIGHT) for it in (tree, exact))
    assert len(sol.impacts) == len(known.impacts) > 10
    assert set(sol.impacts["gap"]) == {0, 1}
    np.testing.assert_allclose(sol.impacts["t"], known.impacts["t"], rtol=0, atol=1e-13)
    np.testing.assert_allclose(sol.zeno["t"], known.zeno["t"], rtol=0, atol=1e-13)
    np.testing.assert_allclose(sol.q[-1], known.q[-1], rtol=0, atol=1e-12)


def test_the_numbers_move_with_the_parameters():
    tree = zivi.Tree(spatial(), gaps=GAPS)
    values, structure = dict(tree.parameters), tree._structure
    directions = structure.directions(values)
    for row, name in zip(directions, values, strict=True):
        up, down = (structure.numbers(values | {name: values[name] + h}) for h in (0.5, -0.5))
        far = [structure.numbers(values | {name: values[name] + h}) for h in (1.0, -1.0)]
        # exact for the polynomials of second degree that they are
        exact = (8 * (up - down) - (far[0] - far[1])) / 6
        np.testing.assert_allclose(row, exact, rtol=0, atol=1e-13, err_msg=name)


def test_a_derivative_needs_no_others():
    tree = zivi.Tree(spatial(), gaps=GAPS)
    values, structure, start = dict(tree.parameters), tree._structure, (np.full(tree._n, 0.2),) * 2
    names = list(values)[3::7]
    every = structure.directions(values)
    assert np.array_equal(structure.directions(values, names), every[3::7])
    few, one = (zivi.sensitivity(tree, (0, 0.1), start, wrt=it) for it in (names, names[1:2]))
    np.testing.assert_allclose(one.final[..., 0], few.final[..., 1], rtol=0, atol=1e-9)


def test_derivatives_of_a_run_are_its_differences():
    tree, start = arm(), ([0.2, 0.3], [0.0, 0.1])
    wrt = ["q0", "qdot0", "upper.mass", "fore.com.x", "fore.position.x", "fore.inertia.yy"]
    wrt += ["b.stiffness", "b.damping", "b.armature", "a.torque", "gravity.z", "table.offset"]
    wrt += ["b.lower", "table.radius"]
    found = zivi.sensitivity(tree, (0, 0.9), start, wrt=wrt, method=TIGHT)
    assert len(found.trajectory.impacts) > 2

    def end(system, q, w):
        sol = zivi.simulate(system, (0, 0.9), (q, w), method=TIGHT)
        return np.array([sol.q[-1], sol.qdot[-1]])

    def moved(h, k):
        q, w = np.array(start)
        if k < 2:
            q = q + h * np.eye(2)[k]
        elif k < 4:
            w = w + h * np.eye(2)[k - 2]
        else:
            name = wrt[k - 2]
            return end(tree.replace(**{name: tree.parameters[name] + h}), q, w)
        return end(tree, q, w)

    for k in range(4 + len(wrt) - 2):
        h = 2e-4 if k < 4 else 2e-4 * (abs(tree.parameters[wrt[k - 2]]) or 1.0)
        difference = (8 * (moved(h, k) - moved(-h, k)) - moved(2 * h, k) + moved(-2 * h, k)) / 12
        exact = found.final[:, :, k]
        scale = 1 + np.max(np.abs(exact))
        np.testing.assert_allclose(difference / h / scale, exact / scale, rtol=0, atol=1e-7)


def test_batches_and_pickles_are_the_same_to_the_bit():
    tree = arm()
    tree.parameters["fore.mass"] = 0.9
    copy = pickle.loads(pickle.dumps(tree))
    assert dict(copy.parameters) == dict(tree.parameters)
    systems = [tree.replace(**{"fore.mass": mass}) for mass in np.linspace(0.5, 1.5, 8)]
    start = [0.2, 0.3], [0.0, 0.0]
    single = [zivi.simulate(it, (0, 2), start).q[-1] for it in [*systems, tree, copy]]
    assert single[8].tobytes() == single[9].tobytes()
    for threads in (1, 4):
        batch = zivi.simulate_batch([*systems, copy], (0, 2), start, threads=threads)
        assert [*map(np.ndarray.tobytes, batch.q)] == [*map(np.ndarray.tobytes, single[:9])]


def test_a_change_of_a_parameter_holds_for_later_runs():
    tree = arm()
    before = tree.at(0.0, [0, 0], [0, 0]).force
    tree.parameters["gravity.z"] = 0.0
    after = tree.at(0.0, [0, 0], [0, 0]).force
    np.testing.assert_allclose(before - after, [9.81 * (1.2 * 0.3 + 0.8 * 0.9), 9.81 * 0.24])
    with pytest.raises(
        KeyError, match=r"unknown parameter 'hand.mass'; the parameters are gravity.x"
    ):
        tree.parameters["hand.mass"] = 1.0
    with pytest.raises(ValueError, match="must be >= 0"):
        tree.replace(**{"fore.mass": -1.0})
    with pytest.raises(TypeError, match="not removed"):
        del tree.parameters["fore.mass"]
    assert repr(tree) == "Tree(joints=(a, b), gaps=(table, b.lower), e=(0.6, 0.4))"


BAD = {
    "kind of body 'a' must be one of": lambda: Body("a", kind="screw"),
    "axis of body 'a' must not be zero": lambda: Body("a", axis=[0, 0, 0]),
    "com of body 'a' must be three": lambda: Body("a", com=[1, 2]),
    "rotation of body 'a' must be a rotation": lambda: Body("a", rotation=-np.eye(3)),
    "inertia of body 'a' must be a number": lambda: Body("a", inertia=[[1, 2], [3, 4]]),
    "inertia of body 'a' must not be negative": lambda: Body("a", inertia=-1.0),
    "mass of body 'a' must be >= 0": lambda: Body("a", mass=-1.0),
    "damping of body 'a' must be finite": lambda: Body("a", damping=np.nan),
    "needs lower or upper": lambda: JointLimit("a"),
    "must be below upper": lambda: JointLimit("a", 2.0, 1.0),
    "normal of the gap of body 'a' must not be zero": lambda: PlaneGap("a", normal=[0, 0, 0]),
    "radius of the gap of body 'a' must be >= 0": lambda: PlaneGap("a", radius=-1.0),
    "radius of the gap of body 'a' must be > 0": lambda: BallGap("a"),
    "other of the gap of body 'a' must be another": lambda: BallGap("a", other="a", radius=1.0),
    "'a' twice": lambda: zivi.Tree([Body("a", mass=1), Body("a", mass=1)]),
    "parent of body 'a' must be a body before it": lambda: zivi.Tree([Body("a", "b", mass=1)]),
    "bodies must have from 1": lambda: zivi.Tree([Body("a", kind="fixed")]),
    "along coordinate 'a': give its body": lambda: zivi.Tree([Body("a", mass=1)]),
    r"eigenvalue 0 along coordinate 'ball\..*an inertia": lambda: zivi.Tree(
        [Body("ball", kind="free", mass=1)]
    ),
    r"gaps\[0\] names 'b'": lambda: zivi.Tree(
        [Body("a", kind="slide", mass=1)], gaps=[JointLimit("b", 0.0)]
    ),
    "never move to each other": lambda: zivi.Tree(
        [Body("a", kind="slide", mass=1), Body("b", "a", "fixed")],
        gaps=[BallGap("a", [0, 0, 0], "b", [1, 0, 0], 0.1)],
    ),
    "q0 must have 2 entries": lambda: arm().at(0.0, [0.0], [0.0]),
}


@pytest.mark.parametrize("words", sorted(BAD))
def test_bad_input_is_named(words):
    with pytest.raises(ValueError, match=words):
        BAD[words]()


def test_other_things_than_bodies_are_refused():
    with pytest.raises(TypeError, match="bodies must be"):
        zivi.Tree(["a"])
    with pytest.raises(TypeError, match=r"gaps\[0\] must be a JointLimit"):
        zivi.Tree([Body("a", kind="slide", mass=1)], gaps=["floor"])
    with pytest.raises(TypeError, match="name of a body"):
        Body("")


def test_a_file_of_a_tree_gives_the_run_of_the_tree(tmp_path):
    tree = zivi.Tree(
        spatial(),
        gaps=GAPS,
        e=np.linspace(0.2, 0.5, len(zivi.Tree(spatial(), gaps=GAPS).gap_names)),
    )
    tree.parameters["gravity.z"] = -9.0
    n = len(tree._coordinates)
    start = np.linspace(0.1, 0.2, n), np.linspace(-0.1, 0.1, n)
    path = tmp_path / "tree.toml"
    path.write_text(zivi.files.tree_text(tree, (0, 0.5), start))
    sol, again = zivi.simulate(tree, (0, 0.5), start), zivi.files.prepare_simulate(path).run()
    assert np.array_equal(sol.q, again.q)
    assert again.gap_names == sol.gap_names
    with pytest.raises(ValueError, match="y0 must have two lists of"):
        zivi.files.tree_text(tree, (0, 0.5), ([0.0], [0.0]))


@pytest.mark.parametrize(
    ("line", "wrong", "told"),
    [
        ("mass = 1.2", "mass = -1.2", r"system.bodies\[0\].mass must be a finite number >= 0"),
        ('parent = "upper"', 'parent = "uper"', "system: .*uper"),
        ("com = [0.3, 0, 0]", "com = [0.3, 0]", r"system.bodies\[0\].com must be a list of three"),
        ('kind = "limit"', 'kind = "plane"', r"system.gaps\[1\]"),
        (
            '"fore.mass" = 1.0',
            '"four.mass" = 1.0',
            "system.parameters.four.mass is not",
        ),
        ('"fore.mass" = 1.0', '"fore.mass" = -1.0', "system.parameters.fore.mass: .* >= 0"),
        ("inertia = 0.04", "inertia = [1, 2]", r"system.bodies\[0\].inertia"),
        ("y0 = [[0.0, 0.5]", "y0 = [[0.0]", "y0"),
    ],
)
def test_what_is_wrong_in_a_file_of_a_tree_names_its_key(tmp_path, line, wrong, told):
    text = commands.example_file("tree").replace("# parameters", "parameters")
    assert line in text
    (tmp_path / "tree.toml").write_text(text.replace(line, wrong))
    with pytest.raises(zivi.files.FileError, match=told):
        zivi.files.prepare_simulate(tmp_path / "tree.toml").run()
