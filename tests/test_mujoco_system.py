"""Systems that MuJoCo computes: beside trees, and for what trees have not."""

import pickle

import numpy as np
import pytest

import zivi
from tree_models import ARM, BALLS, HOPPER

mujoco = pytest.importorskip("mujoco")
from zivi.interop.mujoco import scalar_joints, system, tree  # noqa: E402

GAPS = {
    ARM: ["elbow", ("tip", "table")],
    HOPPER: ["piston", ("foot", "floor")],
    BALLS: ["b", ("ball", "slope"), ("rod", "slope"), ("end", "other"), ("post", "ball")],
}
FIELDS = ("mass", "force", "gaps", "gradients", "curvatures", "rates")


def compiled(text):
    return mujoco.MjModel.from_xml_string(text)


@pytest.mark.parametrize("text", GAPS, ids=["arm", "hopper", "balls"])
def test_mujoco_and_a_tree_are_the_same_system(text):
    model = compiled(text)
    ctrl = np.linspace(0.2, 0.9, model.nu)
    pair = [make(model, GAPS[text], ctrl=ctrl) for make in (system, tree)]
    assert pair[0].gap_names == pair[1].gap_names
    rng = np.random.default_rng(0)
    for q, w in rng.normal(size=(5, 2, model.nv)):
        here, there = (it.at(0.0, q, w) for it in pair)
        for name in FIELDS:
            exact = getattr(there, name)
            scale = max(1.0, np.max(np.abs(exact), initial=0.0))
            error = np.max(np.abs(getattr(here, name) - exact), initial=0.0)
            assert error <= 1e-13 * scale, name


def test_runs_batches_and_pickles():
    model = compiled(ARM)
    flags = int(model.opt.disableflags)
    one, other = (make(model, GAPS[ARM], 0.5) for make in (system, tree))
    assert int(model.opt.disableflags) == flags
    start = [0.0, 0.5], [0.0, 0.0]
    sol, exact = (
        zivi.simulate(it, (0, 2), start, zivi.SwitchedRK(rtol=1e-10)) for it in (one, other)
    )
    assert len(sol.impacts) == len(exact.impacts) > 3
    np.testing.assert_allclose(sol.impacts["t"], exact.impacts["t"], rtol=0, atol=1e-12)
    copy = pickle.loads(pickle.dumps(one))
    starts = np.linspace([-0.2, 0.3], [0.2, 0.6], 24)
    for threads in (1, 8):
        batch = zivi.simulate_batch(copy, (0, 1), (starts, np.zeros((24, 2))), threads=threads)
        single = [zivi.simulate(one, (0, 1), (q, [0.0, 0.0])).q[-1] for q in starts[::8]]
        np.testing.assert_array_equal(batch.q[::8], single)
    assert repr(one).startswith("MujocoSystem(joints=(shoulder, elbow), gaps=(elbow.lower, ")


def test_what_a_tree_has_not_is_computed_by_mujoco():
    text = """<mujoco><option density="20" viscosity=".1"/><worldbody>
      <body name="b" gravcomp=".5"><joint name="j" axis="0 1 0" stiffness="1 2 3"/>
      <geom size=".1" pos=".5 0 0" mass="1" condim="1"/></body></worldbody>
      <tendon><fixed name="t" stiffness="3" springlength=".2"><joint joint="j" coef="2"/></fixed>
      </tendon></mujoco>"""
    model = compiled(text)
    with pytest.raises(NotImplementedError, match=r"use zivi.interop.mujoco.system"):
        tree(model)
    found, data = system(model), mujoco.MjData(model)
    for q, w in ((0.3, 0.5), (-1.2, 2.0)):
        data.qpos[:], data.qvel[:] = q, w
        mujoco.mj_forward(model, data)
        here = found.at(0.0, [q], [w])
        np.testing.assert_allclose(here.force / here.mass[0], data.qacc, rtol=1e-14)


REFUSED = {
    "free joints .*'j'": '<freejoint name="j"/>',
    "friction in joints .*'j'": '<joint name="j" frictionloss=".1"/>',
}


@pytest.mark.parametrize("words", sorted(REFUSED))
def test_what_no_system_has_is_refused_by_name(words):
    text = f"<mujoco><worldbody><body>{REFUSED[words]}<geom size='.1'/></body></worldbody></mujoco>"
    with pytest.raises(NotImplementedError, match=words):
        system(compiled(text))
    with pytest.raises(TypeError, match="model must be a mujoco"):
        system(text)


def test_free_and_ball_joints_become_slides_and_hinges():
    text = """<mujoco><worldbody><body name="a" pos="0 0 1"><freejoint name="f"/>
      <geom size=".1 .2 .3" type="box" mass="2"/><body name="b" pos=".4 0 0">
      <joint name="s" type="ball" pos="-.1 0 0"/><geom size=".1" mass="1"/></body></body>
      </worldbody></mujoco>"""
    spec = mujoco.MjSpec.from_string(text)
    found = tree(scalar_joints(spec).compile())
    names = [f"f.{k}" for k in ("x", "y", "z", "roll", "pitch", "yaw")]
    assert [*found.coordinate_names(9)] == names + [f"s.{k}" for k in ("roll", "pitch", "yaw")]
    assert spec.compile().njnt == 2
    model, data = compiled(text), None
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)  # at rest as it is drawn: the same mass and forces
    here, mass = found.at(0.0, np.zeros(9), np.zeros(9)), np.zeros((9, 9))
    mujoco.mj_fullM(model, data, mass)
    np.testing.assert_allclose(here.mass, mass, rtol=0, atol=1e-14)
    np.testing.assert_allclose(here.force, -data.qfrc_bias, rtol=0, atol=1e-13)


def test_joints_that_are_replaced_take_no_defaults_of_others():
    text = """<mujoco>
      <default><joint limited="true" range="-1 1" damping="2" armature=".3"/></default>
      <worldbody><body name="a">
      <joint name="f" type="free" limited="false" damping="{}" armature="0"/>
      <geom size=".1 .2 .3" type="box" mass="2"/><body name="b" pos=".4 0 0">
      <joint name="s" axis="0 1 0"/><geom size=".1" mass="1"/></body></body></worldbody></mujoco>"""
    model = scalar_joints(mujoco.MjSpec.from_string(text.format(0))).compile()
    assert model.jnt_limited.tolist() == [0] * 6 + [1]
    assert model.dof_damping.tolist() == [0] * 6 + [2]
    assert model.dof_armature.tolist() == [0] * 6 + [0.3]
    with pytest.raises(
        NotImplementedError, match="support damping of free and ball joints: joint 'f'"
    ):
        scalar_joints(mujoco.MjSpec.from_string(text.format(1)))
