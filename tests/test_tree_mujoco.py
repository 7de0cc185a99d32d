"""Trees that are read from MJCF and URDF, against MuJoCo; the rest is refused by name."""

import itertools
import pickle

import numpy as np
import pytest

import zivi
import zivi.interop.mujoco
from tree_models import ARM, BALLS, HOPPER, URDF, random_mjcf
from zivi.mechanics import PlaneGap

mujoco = pytest.importorskip("mujoco")


class Reference:
    """What MuJoCo says of a model without contacts and limits."""

    def __init__(self, text, ctrl=None):
        self.m = mujoco.MjModel.from_xml_string(text)
        flags = mujoco.mjtDisableBit
        self.m.opt.disableflags |= int(flags.mjDSBL_CONSTRAINT | flags.mjDSBL_CONTACT)
        self.d = mujoco.MjData(self.m)
        self.ctrl = np.zeros(self.m.nu) if ctrl is None else np.asarray(ctrl)

    def at(self, q, w):
        m, d = self.m, self.d
        d.qpos[:], d.qvel[:], d.ctrl[:] = q, w, self.ctrl
        mujoco.mj_forward(m, d)
        mass = np.zeros((m.nv, m.nv))
        mujoco.mj_fullM(m, d, mass)
        return mass, d.qfrc_passive - d.qfrc_bias + d.qfrc_actuator

    def point(self, geom, local=(0, 0, 0)):
        """Place, Jacobian, velocity and acceleration without ``q''`` of a point of a geom."""
        m, d = self.m, self.d
        index = m.geom(geom).id
        at = d.geom_xpos[index] + d.geom_xmat[index].reshape(3, 3) @ np.asarray(local, float)
        jac, dot = np.zeros((3, m.nv)), np.zeros((3, m.nv))
        body = int(m.geom_bodyid[index])
        mujoco.mj_jac(m, d, jac, None, at, body)
        mujoco.mj_jacDot(m, d, dot, None, at, body)
        return at, jac, jac @ d.qvel, dot @ d.qvel

    def above(self, geom, plane, radius, local=(0, 0, 0)):
        at, jac, _, acceleration = self.point(geom, local)
        index = self.m.geom(plane).id
        n = self.d.geom_xmat[index].reshape(3, 3)[:, 2]
        gap = n @ (at - self.d.geom_xpos[index]) - radius
        return gap, n @ jac, n @ acceleration

    def beside(self, one, other, radius):
        (a, ja, va, ca), (b, jb, vb, cb) = self.point(one), self.point(other)
        length = np.linalg.norm(a - b)
        u, rate = (a - b) / length, va - vb
        swing = (rate @ rate - (u @ rate) ** 2) / length
        return length - radius, u @ (ja - jb), u @ (ca - cb) + swing


def states(model, count=5, seed=0):
    rng = np.random.default_rng(seed)
    return [(rng.normal(size=model.nq), 2 * rng.normal(size=model.nv)) for _ in range(count)]


def close(found, exact, tolerance=1e-13):
    scale = max(1.0, float(np.max(np.abs(exact), initial=0.0)))
    assert np.max(np.abs(found - exact), initial=0.0) <= tolerance * scale


def check(tree, reference, gaps):
    """Compare with MuJoCo; `gaps` gives the tuple of each gap behind the limits of joints."""
    for q, w in states(reference.m):
        here = tree.at(0.0, q, w)
        mass, force = reference.at(q, w)
        close(here.mass, mass)
        close(here.force, force)
        exact = gaps(reference)
        skip = len(here.gaps) - len(exact)
        for i, (gap, gradient, curvature) in enumerate(exact, skip):
            close(here.gaps[i], gap)
            close(here.gradients[i], gradient)
            close(here.curvatures[i], curvature)


@pytest.mark.parametrize("seed", range(20))
def test_random_trees_are_those_of_mujoco(seed):
    text, joints, geoms = random_mjcf(seed)
    reference = Reference(text)
    moving = [it for it in geoms if reference.m.body_weldid[reference.m.geom(it).bodyid[0]] != 0]
    weld = {it: int(reference.m.body_weldid[reference.m.geom(it).bodyid[0]]) for it in moving}
    pairs = [(it, "plane") for it in moving]
    pairs += [(a, b) for a, b in itertools.pairwise(moving) if weld[a] != weld[b]]
    ctrl = np.linspace(-1, 1, reference.m.nu)
    reference.ctrl = ctrl
    tree = zivi.Tree.from_mjcf(text, gaps=pairs, ctrl=ctrl)
    assert [*tree.coordinate_names(len(joints))] == joints
    radius = {it: float(reference.m.geom(it).size[0]) for it in geoms}

    def gaps(ref):
        planes = [ref.above(it, "plane", radius[it]) for it, other in pairs if other == "plane"]
        balls = [(a, b) for a, b in pairs if b != "plane"]
        return planes + [ref.beside(a, b, radius[a] + radius[b]) for a, b in balls]

    check(tree, reference, gaps)


def test_spheres_capsules_boxes_and_welded_planes_are_gaps():
    pairs = [("ball", "slope"), ("slope", "rod"), ("box", "slope"), ("end", "other")]
    pairs += [("post", "ball")]
    tree = zivi.Tree.from_mjcf(BALLS, gaps=["b", *pairs])
    names = ["b.lower", "b.upper", "ball-slope", "slope-rod.0", "slope-rod.1"]
    names += [f"box-slope.{k}" for k in range(8)] + ["end-other", "post-ball"]
    assert [*tree.gap_names] == names
    corners = [(x, y, z) for x in (-0.1, 0.1) for y in (-0.2, 0.2) for z in (-0.3, 0.3)]

    def gaps(ref):
        rod = [ref.above("rod", "slope", 0.1, (0, 0, z)) for z in (-0.3, 0.3)]
        box = [ref.above("box", "slope", 0.0, it) for it in corners]
        balls = [ref.beside("end", "other", 0.4), ref.beside("post", "ball", 0.3)]
        return [ref.above("ball", "slope", 0.2), *rod, *box, *balls]

    check(tree, Reference(BALLS), gaps)
    here = tree.at(0.0, [0.0, 0.0, 0.3, 0.0], np.zeros(4))
    np.testing.assert_allclose(here.gaps[:2], [0.3 + np.pi / 2, np.pi / 3 - 0.3], atol=1e-15)
    np.testing.assert_array_equal(here.gradients[:2], [[0, 0, 1, 0], [0, 0, -1, 0]])


SPACE = """<mujoco><option gravity="1 2 -9"/><worldbody>
  <geom name="slope" type="plane" size="1 1 .1" pos="0 0 -1" euler="20 10 0"/>
  <body name="free" pos="1 2 3" euler="10 20 30"><freejoint name="f"/>
    <geom name="stone" type="box" size=".1 .2 .3" mass="2" pos=".1 0 .1" friction=".4 0 0"/>
    <geom name="rod" type="capsule" size=".1 .3" mass="1" euler="30 0 20" friction=".4 0 0"/>
    <body name="arm" pos=".3 0 0" euler="0 50 0"><joint name="h" axis="1 1 0" pos="0 .1 0"/>
      <geom size=".1" mass="1" pos="0 .2 .3"/>
      <body name="end" pos="0 0 .5"><joint name="b" type="ball" pos="-.1 0 .2"/>
        <geom name="tip" size=".15" mass="1" pos=".2 0 .1" friction=".5 0 0"/>
  </body></body></body></worldbody></mujoco>"""


@pytest.mark.parametrize("seed", range(3))
def test_free_and_ball_joints_are_those_of_mujoco(seed):
    pairs = [(name, "slope") for name in ("stone", "rod", "tip")]
    tree, reference = zivi.Tree.from_mjcf(SPACE, gaps=pairs), Reference(SPACE)
    assert (tree.nq, tree.m, len(tree.channel_names)) == (reference.m.nq, 11, 22)
    rng = np.random.default_rng(seed)
    pos, vel = rng.normal(size=reference.m.nq), rng.normal(size=reference.m.nv)
    for at in (3, 8):
        pos[at : at + 4] /= np.linalg.norm(pos[at : at + 4])
    q, w = tree.state(pos, vel)
    here = tree.at(0.0, q, w)
    mass, force = reference.at(pos, vel)
    # qvel = J q', J' q' by a difference
    jacobian = np.array([tree.qvel(q, unit) for unit in np.eye(len(w))]).T
    close(here.mass, jacobian.T @ mass @ jacobian)
    acceleration, h = np.linalg.solve(here.mass, here.force), 1e-4
    ahead, behind = (tree.qvel(q + s * h * w, w) for s in (1, -1))
    turning = (ahead - behind) / (2 * h)
    close(jacobian @ acceleration + turning, np.linalg.solve(mass, force), 1e-6)
    corners = [(x, y, z) for x in (-0.1, 0.1) for y in (-0.2, 0.2) for z in (-0.3, 0.3)]
    balls = [("stone", 0.0, corner) for corner in corners]
    balls += [("rod", 0.1, (0, 0, z)) for z in (-0.3, 0.3)] + [("tip", 0.15, (0, 0, 0))]
    normal = reference.d.geom_xmat[0].reshape(3, 3)[:, 2]
    for i, (geom, radius, local) in enumerate(balls):
        gap, gradient, _ = reference.above(geom, "slope", radius, local)
        close(here.gaps[i], gap)
        close(here.gradients[i] @ w, gradient @ vel)
        at, _, _, _ = reference.point(geom, local)
        jac = np.zeros((3, reference.m.nv))
        body = int(reference.m.geom_bodyid[reference.m.geom(geom).id])
        mujoco.mj_jac(reference.m, reference.d, jac, None, at - radius * normal, body)
        slip = jac @ vel - normal * (normal @ jac @ vel)
        close(np.linalg.norm(here.tangents[2 * i : 2 * i + 2] @ w), np.linalg.norm(slip))


def test_controls_springs_and_references_of_a_hopper():
    ctrl = [3.0, 0.1]
    tree = zivi.Tree.from_mjcf(HOPPER, gaps=[("foot", "floor")], ctrl=ctrl)
    check(tree, Reference(HOPPER, ctrl), lambda ref: [ref.above("foot", "floor", 0.05)])
    assert zivi.Tree.from_mjcf(HOPPER).gap_names == ("piston.lower", "piston.upper")
    assert tree.parameters["leg.mass"] == pytest.approx(0.9, abs=1e-15)
    with pytest.raises(ValueError, match="ctrl must be 2 finite numbers"):
        zivi.Tree.from_mjcf(HOPPER, ctrl=[1.0])


def test_urdf_keeps_its_links(tmp_path):
    path = tmp_path / "two.urdf"
    path.write_text(URDF)
    point = PlaneGap("tool", [0.1, 0.2, 0.3], offset=-1.0, name="tip")
    for given in (path, URDF):
        tree = zivi.Tree.from_urdf(given, gaps=["first", point])
    check(tree, Reference(URDF), lambda ref: [])
    assert tree.gap_names == ("first.lower", "first.upper", "tip")
    assert tree.parameters["tool.mass"] == 0.4
    assert tree.parameters["first.damping"] == 0.2


def test_a_mesh_is_its_vertices():
    text = """<mujoco><asset><mesh name="wedge"
      vertex="0 0 0  .2 0 0  0 .3 0  0 0 .4  .2 0 .4"/></asset><worldbody>
      <geom name="floor" type="plane" size="1 1 .1" condim="1"/>
      <body name="w" pos="0 0 1"><joint name="z" type="slide"/><joint name="turn" axis="1 1 0"/>
      <geom name="stone" type="mesh" mesh="wedge" condim="1" mass="2"/></body>
      </worldbody></mujoco>"""
    tree, reference = zivi.Tree.from_mjcf(text, gaps=[("stone", "floor")]), Reference(text)
    mesh = reference.m.mesh_vert[: reference.m.mesh_vertnum[0]].astype(float)
    assert len(tree.gap_names) == 5
    corners = np.unique(mesh, axis=0)
    check(tree, reference, lambda ref: [ref.above("stone", "floor", 0.0, it) for it in corners])


def model(inside="", joint='<joint name="j" axis="0 1 0"/>', geom="", more="", option=""):
    return f"""<mujoco>{option}<worldbody><geom name="floor" type="plane" size="1 1 .1" {geom}/>
    <body name="b"><!-- -->{joint}
    <geom name="g" type="sphere" size=".1" pos=".5 0 0" mass="1" {geom}/>{inside}
    <site name="s"/></body></worldbody>{more}</mujoco>"""


TENDON = '<tendon><fixed name="t" {}><joint joint="j" coef="1"/></fixed></tendon>'
REFUSED = {
    "damping of free and ball joints: joint 'j'; set": model(
        joint='<joint name="j" type="ball" damping="1"/>'
    ),
    "armature of free and ball joints: joint 'j'": model(
        joint='<joint name="j" type="free" armature=".1"/>'
    ),
    "springs of free and ball joints: joint 'j'": model(
        joint='<joint name="j" type="ball" stiffness="1"/>'
    ),
    "friction in free and ball joints .*'j'": model(
        joint='<joint name="j" type="ball" frictionloss="1"/>'
    ),
    "limits of ball joints: joint 'j'": model(
        joint='<joint name="j" type="ball" range="0 1" limited="true"/>'
    ),
    "actuators at free and ball joints: joint 'j'": model(
        joint='<joint name="j" type="ball"/>', more='<actuator><motor joint="j"/></actuator>'
    ),
    "friction in tendons": model(more=TENDON.format('frictionloss=".1"')),
    "limits of tendons": model(more=TENDON.format('limited="true" range="0 1"')),
    "tendons: tendon 't'": model(more=TENDON.format("")),
    "activations of actuators": model(
        more='<actuator><general joint="j" dyntype="integrator"/></actuator>'
    ),
    "mocap bodies .*'moc'": model(more='<worldbody><body name="moc" mocap="true"/></worldbody>'),
    "gravcomp.*body 'k'": model(
        inside='<body name="k" gravcomp="1"><geom size=".1" mass="1"/></body>'
    ),
    "springs that are not linear": model(joint='<joint name="j" stiffness="1 2 3"/>'),
    "dampers that are not linear": model(joint='<joint name="j" damping="1 2 3"/>'),
    "fluids": model(option='<option density="1.2"/>'),
    "actuatorfrcrange.*'j'": model(
        joint='<joint name="j" actuatorfrcrange="-1 1"/>',
        more='<actuator><motor joint="j"/></actuator>',
    ),
    "springs that are off": model(option='<option><flag spring="disable"/></option>'),
    "dampers that are off": model(option='<option><flag damper="disable"/></option>'),
    "actuators that are off": model(option='<option><flag actuation="disable"/></option>'),
    "controls without their range": model(option='<option><flag clampctrl="disable"/></option>'),
    "groups of actuators that are off": model(option='<option actuatorgroupdisable="1"/>'),
    "only actuators at joints: actuator 'a'": model(
        more='<actuator><motor name="a" site="s" gear="0 0 1 0 0 0"/></actuator>'
    ),
    "gains and biases .*'a'": model(
        more='<actuator><general name="a" joint="j" gaintype="affine" gainprm="1 1 0"/></actuator>'
    ),
    "forcerange.*'a'": model(
        more='<actuator><position name="a" joint="j" kp="3" forcerange="-1 1"/></actuator>'
    ),
    "inertia of actuators.*'a'": model(
        more='<actuator><motor name="a" joint="j" armature=".1"/></actuator>'
    ),
    "damping of actuators.*'a'": model(
        more='<actuator><motor name="a" joint="j" damping=".1"/></actuator>'
    ),
}


REFUSED["models without joints"] = (
    "<mujoco><worldbody><body><geom size='1'/></body></worldbody></mujoco>"
)


@pytest.mark.parametrize("words", sorted(REFUSED))
def test_what_a_tree_has_not_is_refused_by_name(words):
    with pytest.raises(NotImplementedError, match=words):
        zivi.Tree.from_mjcf(REFUSED[words])


SMOOTH = 'condim="1"'
PAIRS = {
    "friction of pairs is not supported: 'g-ball'": (
        model(more='<worldbody><geom name="ball" size=".1" pos="2 0 0"/></worldbody>'),
        ("g", "ball"),
    ),
    "rolling friction is not supported: 'g-floor'": (model(geom='condim="6"'), ("g", "floor")),
    "surface velocities in pairs are not supported: 'g-floor'; set": (
        model(geom='condim="1" surfacevel="1 0 0"'),
        ("g", "floor"),
    ),
    "adhesion of geoms": (model(geom='condim="1" adhesion=".1"'), ("g", "floor")),
    "gaps of a cylinder": (
        model(inside='<geom name="c" type="cylinder" size=".1 .1" condim="1"/>', geom=SMOOTH),
        ("c", "floor"),
    ),
    "gaps of a ellipsoid": (
        model(inside='<geom name="c" type="ellipsoid" size=".1 .1 .2" condim="1"/>', geom=SMOOTH),
        ("c", "floor"),
    ),
    "gaps between box and sphere": (
        model(
            geom=SMOOTH,
            more='<worldbody><geom name="c" type="box" size=".1 .1 .2" condim="1"/></worldbody>',
        ),
        ("c", "g"),
    ),
}


@pytest.mark.parametrize("words", sorted(PAIRS))
def test_pairs_that_are_no_gaps_are_refused_by_name(words):
    text, pair = PAIRS[words]
    with pytest.raises(NotImplementedError, match=words):
        zivi.Tree.from_mjcf(text, gaps=[pair])


def test_friction_is_left_out_if_asked_for():
    tree = zivi.Tree.from_mjcf(model(), gaps=[("g", "floor")], friction="ignore")
    assert tree.gap_names == ("g-floor",)
    with pytest.raises(ValueError, match="friction must be"):
        zivi.Tree.from_mjcf(model(), friction="none")


def test_gaps_that_are_not_there_are_named():
    with pytest.raises(ValueError, match="names the geom 'roof'"):
        zivi.Tree.from_mjcf(ARM, gaps=[("tip", "roof")])
    with pytest.raises(ValueError, match="must be a joint, got 'knee'"):
        zivi.Tree.from_mjcf(ARM, gaps=["knee"])
    with pytest.raises(ValueError, match="'shoulder' is not limited"):
        zivi.Tree.from_mjcf(ARM, gaps=["shoulder"])
    with pytest.raises(TypeError, match="must be a joint, a pair"):
        zivi.Tree.from_mjcf(ARM, gaps=[3])
    with pytest.raises(FileNotFoundError, match="does not exist"):
        zivi.Tree.from_mjcf("nowhere.xml")


def test_callbacks_of_the_user_are_refused():
    compiled = mujoco.MjModel.from_xml_string(ARM)
    mujoco.set_mjcb_control(lambda m, d: None)
    try:
        with pytest.raises(NotImplementedError, match="callbacks of the user"):
            zivi.interop.mujoco.tree(compiled)
    finally:
        mujoco.set_mjcb_control(None)


def test_a_tree_that_was_read_needs_no_mujoco():
    tree = zivi.Tree.from_mjcf(ARM, gaps=["elbow", ("tip", "table")], e=0.5)
    copy = pickle.loads(pickle.dumps(tree))
    assert b"mujoco" not in pickle.dumps(tree)
    start = ([0.0, 0.5], [0.0, 0.0])
    runs = [zivi.simulate(it, (0, 2), start) for it in (tree, copy)]
    assert runs[0].status == 0
    assert runs[0].q.tobytes() == runs[1].q.tobytes()
    assert len(runs[0].impacts) > 3


HOSTILE = {
    "nrow x ncol <= 10000000, got 10000000000": model(
        more='<asset><hfield name="h" nrow="100000" ncol="100000" size="1 1 1 1"/></asset>'
    ),
    "width x height <= 100000000": model(
        more='<asset><texture name="t" type="2d" width="100000" height="100000"/></asset>'
    ),
    "more at <replicate>; lower its count": model(
        more="<worldbody>"
        + 3 * '<replicate count="100" offset="1 0 0">'
        + '<geom size="1"/>'
        + 3 * "</replicate>"
        + "</worldbody>"
    ),
    "more at <composite>": model(
        more='<worldbody><composite type="cable" count="100000000 1 1"/></worldbody>'
    ),
    "nuser_body <= 10000, got 100000000": model(more='<size nuser_body="100000000"/>'),
    "itself.xml must not include itself": '<mujoco><include file="itself.xml"/></mujoco>',
    "must be a text in UTF-8, got the byte 0xe9": "<mujoco model='\udce9'/>",
}


@pytest.mark.parametrize("words", sorted(HOSTILE))
def test_a_model_that_is_too_large_is_refused_before_mujoco_reads_it(words, tmp_path, monkeypatch):
    import mujoco

    monkeypatch.chdir(tmp_path)
    monkeypatch.delattr(mujoco, "MjSpec")
    for name, text in (
        ("itself.xml", HOSTILE[words]),
        ("including.xml", '<mujoco><!-- <a> --><include file="itself.xml"/></mujoco>'),
    ):
        with open(name, "w", errors="surrogateescape", encoding="utf-8") as file:
            file.write(text)
    for name in ("itself.xml", "including.xml"):
        with pytest.raises(ValueError, match=words):
            zivi.Tree.from_mjcf(name)


@pytest.mark.parametrize("count", ["1.5", "many", "9" * 30])
def test_a_number_of_copies_that_is_none_is_left_to_mujoco(count):
    text = model(inside=f'<replicate count="{count}" offset="1 0 0"><geom size="1"/></replicate>')
    with pytest.raises(ValueError, match="count"):
        zivi.Tree.from_mjcf(text)


def test_copies_within_bounds_and_what_is_commented_out_are_read():
    text = model(
        inside='<!-- <replicate count="100000000"> -- --><replicate count="3" offset="1 0 0">'
        '<geom size=".1" mass="2"/></replicate>'
    )
    assert zivi.Tree.from_mjcf(text).parameters["b.mass"] == Reference(text).m.body_mass[1]


def test_a_warning_of_mujoco_is_one_of_ours_and_leaves_no_file(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.warns(zivi.ModelWarning, match="from_mjcf: MuJoCo warns: XML contains a 'NaN'"):
        zivi.Tree.from_mjcf(model().replace('mass="1"', 'mass="nan"'))
    assert not list(tmp_path.iterdir())
