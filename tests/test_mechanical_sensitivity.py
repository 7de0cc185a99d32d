"""Derivatives of mechanical systems: references of 12 digits, the scalar ones, identities."""

from __future__ import annotations

import json
import pickle
from pathlib import Path

import numpy as np
import pytest

import zivi

pytest.importorskip("sympy")
CASES = json.loads((Path(__file__).parent / "data/mechanical_gradients.json").read_text("ascii"))


def system_of(case):
    return zivi.symbolic.system(
        case["q"],
        T=case["T"],
        V=case["V"],
        Q=case["Q"],
        gaps=case["gaps"],
        parameters={name: float(value) for name, value in case["parameters"].items()},
        e=[float(e) for e in case["e"]],
    )


def start_of(case):
    return tuple([float(value) for value in case[name]] for name in ("q0", "qdot0"))


def quantities(s):
    """The state at the end, Zeno times, lift-off times: a row of derivatives each."""
    return np.concatenate([s.final[0], s.final[1], s.zeno_times, s.liftoff_times])


def error(case, tol, **options):
    names = tuple(case["derivatives"])
    method = zivi.SwitchedRK(rtol=tol, atol=tol, **options)
    s = zivi.sensitivity(system_of(case), (0, float(case["t"])), start_of(case), names, method)
    assert s.status is zivi.OrbitStatus.COMPLETED
    wanted = np.array([[float(v) for v in case["derivatives"][name]] for name in names]).T
    return np.max(np.abs(quantities(s) - wanted) / (1 + np.abs(wanted)))


@pytest.mark.parametrize("name", list(CASES))
@pytest.mark.parametrize("tol", [1e-8, 1e-10])
def test_references(name, tol):
    assert error(CASES[name], tol) <= 1.5 * tol


@pytest.mark.parametrize("name", list(CASES))
def test_references_at_order_five(name):
    # measured from 1e-7 to 1e-10: 16.5 to 18.8 tolerances for the pendulum, 0.8 for the others
    bound = 20 if name == "double_pendulum" else 1.2
    assert error(CASES[name], 1e-8, order=5) <= bound * 1e-8


FORCE = zivi.LinearForce(stiffness=1.3, damping=0.1, gravity=2.0, amplitude=2.6, omega=1.1)


def one_coordinate(force=FORCE, e=0.6):
    push = lambda t, q, w: [force(t, q[0], w[0])]  # noqa: E731
    gap = zivi.LinearGap([1.0], name="wall")
    return zivi.MechanicalSystem(mass=1.0, force=push, gaps=[gap], e=e, coordinates=["x"])


def test_one_coordinate_is_the_scalar_motion():
    method = zivi.SwitchedRK(rtol=1e-12, atol=1e-12)
    scalar = zivi.sensitivity(
        zivi.ImpactSystem(FORCE, e=0.6), (0, 14), (1, 0), ("x0", "xdot0", "t0", "e"), method
    )
    names = ("q0", "qdot0", "t0", "e")
    s = zivi.sensitivity(one_coordinate(), (0, 14), ([1.0], [0.0]), names, method)
    assert len(s.zeno_times) >= 2
    assert len(s.liftoff_times) >= 2
    for mine, wanted in (
        (s.final[:, 0], scalar.final),
        (s.zeno_times, scalar.zeno_times),
        (s.liftoff_times, scalar.liftoff_times),
        (s.resolved_impacts["dt"][:6], scalar.resolved_impacts["dt"][:6]),
        (s.resolved_impacts["du"][:6], scalar.resolved_impacts["du"][:6]),
    ):
        assert np.max(np.abs(mine - wanted) / (1 + np.abs(wanted))) < 1e-11


def test_orthogonal_gaps_are_scalar_motions():
    """A mass in a corner, its coordinates apart: two masses above walls."""
    e, method = [0.5, 0.3], zivi.SwitchedRK(rtol=1e-11, atol=1e-11)
    box = zivi.MechanicalSystem(
        mass=np.diag([2.0, 2.0]),
        force=lambda t, q, w: [2 * (-1.5 - 0.2 * w[0]), 2 * (-9.81 + 3 * np.cos(t) - 0.1 * w[1])],
        gaps=[zivi.LinearGap([1, 0], name="wall"), zivi.LinearGap([0, 1], name="floor")],
        e=e,
        coordinates=["x", "y"],
    )
    s = zivi.sensitivity(
        box, (0, 2.9), ([0.4, 0.3], [0.2, 0.0]), ("q0", "qdot0", "e.wall", "e.floor"), method
    )
    for i, force in enumerate(
        (
            zivi.LinearForce(damping=0.2, gravity=1.5),
            zivi.LinearForce(damping=0.1, gravity=9.81, amplitude=3.0, omega=1.0),
        )
    ):
        start = ((0.4, 0.2), (0.3, 0.0))[i]
        alone = zivi.sensitivity(
            zivi.ImpactSystem(force, e=e[i]), (0, 2.9), start, ("x0", "xdot0", "e"), method
        )
        own = [i, 2 + i, 4 + i]
        times = s.trajectory.zeno["gap"] == i
        assert np.allclose(s.final[:, i, own], alone.final, rtol=1e-9, atol=1e-9)
        assert np.allclose(s.zeno_times[times][:, own], alone.zeno_times, rtol=1e-9, atol=1e-9)
        others = [column for column in range(6) if column not in own]
        assert np.max(np.abs(s.final[:, i, others])) < 1e-9


def bumps(**parameters):
    return system_of(CASES["bumps"]).replace(**parameters)


def test_impacts_shrink_the_volume_of_states():
    """Of a conservative system with a constant mass: det of the monodromy is e^(2 k)."""
    for t, e in ((0.37, 0.3), (0.55, 0.7)):
        method = zivi.SwitchedRK(rtol=1e-12, atol=1e-12)
        system, start = bumps().replace(e=e), start_of(CASES["bumps"])
        s = zivi.sensitivity(system, (0, t), start, method=method)
        k = len(s.resolved_impacts)
        assert k >= 2
        assert not len(s.zeno_times)
        assert np.linalg.det(s.monodromy) == pytest.approx(e ** (2 * k), rel=1e-9)


def test_a_shift_of_the_start():
    """Moving the start is moving the state along the motion, backwards."""
    case = CASES["wedge"]
    names = ("q0", "qdot0", "t0")
    s = zivi.sensitivity(
        system_of(case), (0, 0.9), start_of(case), names, zivi.SwitchedRK(rtol=1e-11, atol=1e-11)
    )
    here = system_of(case).at(0.0, *start_of(case))
    flow = np.concatenate([start_of(case)[1], np.linalg.solve(here.mass, here.force)])
    for part in (s.final[0], s.final[1], s.zeno_times):
        assert np.allclose(part[:, 4], -part[:, :4] @ flow, rtol=1e-9, atol=1e-10)


def test_contact_keeps_tangential_derivatives_and_ends_normal_ones():
    case = CASES["bumps"]
    s = zivi.sensitivity(bumps(), (0, 0.6), start_of(case), ("q0", "qdot0", "k"))
    assert s.trajectory.contacts[-1, 0]
    q, w = s.trajectory.q[-1], s.trajectory.qdot[-1]
    here, moved = bumps().at(0.6, q, w), bumps(k=2.0 + 1e-6).at(0.6, q, w)
    by_k = np.array([0, 0, 0, 0, (moved.gaps[0] - here.gaps[0]) / 1e-6])
    assert np.allclose(here.gradients[0] @ s.final[0], -by_k, atol=1e-6)
    assert np.max(np.abs(s.final[0])) > 0.1


def test_the_derivatives_between():
    case = CASES["bumps"]
    s = zivi.sensitivity(bumps(), (0, 1.6), start_of(case), ("q0", "h"))
    # in flight, in the skipped impacts, in contact, after the lift-off, unordered
    times = np.array([1.5, 0.2, 0.391, 0.7, 1.0, 0.0, 1.6])
    found = s(times)
    assert found.shape == (2, 2, 3, 7)
    assert np.array_equal(found[..., 6], s.final)
    assert np.array_equal(found[0, :, :2, 5], np.eye(2))
    assert not found[1, ..., 5].any()
    for k, t in enumerate(times[:5]):
        ends = zivi.sensitivity(bumps(), (0, t), start_of(case), ("q0", "h")).final
        assert np.allclose(found[..., k], ends, rtol=1e-5, atol=1e-5)
    assert s(0.2).shape == (2, 2, 3)
    with pytest.raises(ValueError, match="t must lie within the run"):
        s(1.7)


def test_a_corner_has_no_derivatives_until_it_determines_the_state():
    case = CASES["wedge"]
    s = zivi.sensitivity(system_of(case), (0, 2.5), start_of(case), ("q0", "a1", "e"))
    corner = s.trajectory.corners["t"]
    assert len(corner) == 1
    assert s.lost_at == pytest.approx(corner[0])
    assert s.status is zivi.OrbitStatus.NOT_DIFFERENTIABLE
    assert not s.success
    assert np.isfinite(s.zeno_times[:3]).all()
    assert np.max(np.abs(s.final)) < 1e-12  # at rest in the corner, which does not move


def test_impacts_of_coupled_gaps_at_once_have_no_derivatives():
    bar = zivi.symbolic.system(
        "y a",
        T="m*ydot**2/2 + m*l**2*adot**2/6",
        V="m*g*y",
        gaps={"left": "y - l*sin(a)", "right": "y + l*sin(a)"},
        parameters={"m": 1.0, "l": 0.5, "g": 9.81},
        e=0.5,
    )
    s = zivi.sensitivity(bar, (0, 0.7), ([0.5, 0.0], [0.0, 0.0]), ("q0", "m"))
    assert s.status is zivi.OrbitStatus.NOT_DIFFERENTIABLE
    assert s.lost_at == s.resolved_impacts["t"][0]
    assert np.isnan(s.final).all()
    assert np.isnan(s.resolved_impacts["dt"]).all()
    tilted = zivi.sensitivity(bar, (0, 0.35), ([0.5, 0.05], [0.0, 0.0]), ("q0", "m"))
    assert tilted.status is zivi.OrbitStatus.COMPLETED
    assert np.isfinite(tilted.final).all()


def test_an_angle_that_opens_a_contact_by_its_sign_has_no_derivative():
    """Orthogonal planes: turned one way an impact on one opens the other, the other way not."""
    case = CASES["wedge"] | {"e": ["0.3", "0.7"]}
    quarter = np.pi / 4
    wedge = system_of(case).replace(a1=quarter, a2=np.pi / 2 - quarter)
    s = zivi.sensitivity(wedge, (0, 1.9), ([0.3, 1.2], [0.2, 0.0]), ("q0", "e[1]", "a1"))
    assert len(s.zeno_times) == 1
    assert s.status is zivi.OrbitStatus.NOT_DIFFERENTIABLE
    assert np.isnan(s.final[:, :, 3]).all()
    assert np.isfinite(s.final[:, :, :3]).all()


@pytest.mark.parametrize("depth", [1e-2, 1e-4])
def test_the_radius_of_a_grazing(depth):
    """``x'' = 1 - x`` from ``2 + d`` reaches the wall by the depth d."""
    oscillator = one_coordinate(zivi.LinearForce(stiffness=1.0, gravity=-1.0), e=0.5)
    start = ([2 + depth], [0.0])
    method = zivi.SwitchedRK(rtol=1e-12, atol=1e-12)
    s = zivi.sensitivity(oscillator, (0, 4), start, ("q0",), method)
    assert s.radius[0] == pytest.approx(depth, rel=max(2 * depth, 1e-3))
    assert s.nearest is not None
    assert s.nearest.kind == "impact"
    near = zivi.sensitivity(oscillator, (0, 4), ([2 - depth], [0.0]), ("q0",), method)
    assert near.nearest is not None
    assert near.nearest.kind == "minimum"
    assert near.radius[0] == pytest.approx(depth, rel=max(2 * depth, 1e-3))


def test_grazing_is_flagged_and_chains_are_not():
    oscillator = one_coordinate(zivi.LinearForce(stiffness=1.0, gravity=-1.0), e=0.5)
    s = zivi.sensitivity(oscillator, (0, 4), ([2 + 1e-9], [0.0]), ("q0",))
    assert s.status is zivi.OrbitStatus.GRAZING


def test_a_dataset_with_names():
    pytest.importorskip("xarray")
    case = CASES["bumps"]
    data = zivi.sensitivity(bumps(), (0, 1.6), start_of(case), ("q0", "e", "h")).to_xarray()
    assert list(data.wrt.values) == ["q0.x", "q0.y", "e", "h"]
    assert data.q.sel(coordinate="y", wrt="h").shape == ()
    assert data.zeno_time.sel(wrt="e").shape == (data.sizes["zeno"],)
    assert set(data.impact_gap.values) == {"gap0"}


def test_names_and_arguments():
    case = CASES["bumps"]
    run = lambda *wrt: zivi.sensitivity(bumps(), (0, 0.2), start_of(case), wrt)  # noqa: E731
    assert run("qdot0[1]", "e[0]", "q0.x").wrt == ("qdot0.y", "e.gap0", "q0.x")
    assert zivi.sensitivity(bumps(), (0, 0.2), start_of(case)).final.shape == (2, 2, 4)
    with pytest.raises(
        ValueError, match=r"unknown parameter 'z'; the parameters are q0, qdot0, q0\.x, .*, k"
    ):
        run("z")
    with pytest.raises(ValueError, match="one or more different names"):
        run("q0", "q0.x")
    with pytest.raises(TypeError, match="SwitchedRK"):
        zivi.sensitivity(
            bumps(),
            (0, 1),
            start_of(case),
            method=zivi.MoreauJean(h=0.1),  # type: ignore[arg-type]
        )
    with pytest.raises(TypeError, match=r"y0 must be \(q0, qdot0\)"):
        zivi.sensitivity(bumps(), (0, 1), 3.0)


def test_a_run_that_ends_early_keeps_its_derivatives():
    s = zivi.sensitivity(
        bumps(), (0, 1.6), start_of(CASES["bumps"]), ("q0",), zivi.SwitchedRK(max_steps=12)
    )
    assert s.status is zivi.OrbitStatus.RUN_ENDED
    assert s.trajectory.status is zivi.Status.STEP_BUDGET
    assert np.isfinite(s.final).all()


def test_what_the_force_raises_carries_the_run():
    def push(t, q, w):
        if t > 0.5:
            raise RuntimeError("gone")
        return [-9.81]

    drop = zivi.MechanicalSystem(mass=1.0, force=push, gaps=[zivi.LinearGap([1])], e=0.5)
    with pytest.raises(RuntimeError, match="gone") as caught:
        zivi.sensitivity(drop, (0, 2), ([1.0], [0.0]))
    assert caught.value.trajectory.t[-1] <= 0.5  # type: ignore[attr-defined]


def test_a_symbolic_system_keeps_its_derivatives_in_a_pickle():
    again = pickle.loads(pickle.dumps(bumps(h=0.2)))
    start = start_of(CASES["bumps"])
    one, two = (zivi.sensitivity(it, (0, 0.5), start, ("h",)) for it in (bumps(h=0.2), again))
    assert np.array_equal(one.final, two.final)


def bumps_by_hand(h, k, m):
    road = zivi.Gap(
        lambda t, q: q[1] - h * np.sin(k * q[0]),
        lambda t, q: np.array([-h * k * np.cos(k * q[0]), 1.0]),
        lambda t, q, w: h * k**2 * np.sin(k * q[0]) * w[0] ** 2,
        name="road",
    )
    return zivi.MechanicalSystem(
        mass=m * np.eye(2), force=[0.0, -9.81 * m], gaps=[road], e=0.3, coordinates=["x", "y"]
    )


def test_differences_are_what_sympy_derives():
    start, names = start_of(CASES["bumps"]), ("q0", "qdot0", "e", "h", "k", "m")
    by_hand = zivi.ParametricSystem(bumps_by_hand, {"h": 0.25, "k": 2.0, "m": 1.0})
    method = zivi.SwitchedRK(rtol=1e-9, atol=1e-9)
    one, two = (zivi.sensitivity(it, (0, 0.6), start, names, method) for it in (bumps(), by_hand))
    assert len(one.zeno_times) == 1
    for wanted, found in ((one.final, two.final), (one.zeno_times, two.zeno_times)):
        assert np.max(np.abs(wanted - found)) < 1e-9
    assert two.trajectory.config["parameters"] == by_hand.parameters


def test_parameters_of_a_system_that_is_built():
    system = zivi.ParametricSystem(bumps_by_hand, {"h": 0.25, "k": 2.0, "m": 1.0})
    assert system.replace(h=0.3).parameters == {"h": 0.3, "k": 2.0, "m": 1.0}
    assert system.at(0.0, [0.0, 1.0], [0.0, 0.0]).mass[0, 0] == 1.0
    with pytest.raises(KeyError, match="unknown parameter 'g'; the parameters are h, k, m"):
        system.replace(g=1.0)
    with pytest.raises(TypeError, match=r"build must return a zivi\.MechanicalSystem"):
        zivi.ParametricSystem(lambda h: h, {"h": 1.0})  # type: ignore[arg-type, return-value]
    bouncing = zivi.ParametricSystem(
        lambda c: zivi.MechanicalSystem(mass=1, force=[-1], gaps=[zivi.LinearGap([1])], e=c),
        {"c": 0.5},
    )
    found = zivi.sensitivity(bouncing, (0, 2), ([1.0], [0.0]), ("c", "e"))
    assert np.allclose(found.final[..., 0], found.final[..., 1], rtol=1e-9)
    renamed = zivi.ParametricSystem(
        lambda c: zivi.MechanicalSystem(
            mass=1, force=[-1], gaps=[zivi.LinearGap([1], name=f"{c:.9f}")]
        ),
        {"c": 0.5},
    )
    with pytest.raises(ValueError, match="'c' must not change the names of gaps"):
        zivi.sensitivity(renamed, (0, 1), ([1.0], [0.0]), ("c",))


def test_a_break_of_the_force_that_is_declared():
    """Gravity doubles at t = 0.2: the impact is that of two parabolas."""
    push = lambda t, q, w: [-9.81 if t < 0.2 else -19.62]  # noqa: E731
    drop = zivi.MechanicalSystem(mass=1.0, force=push, gaps=[zivi.LinearGap([1])], e=0.5)
    method = zivi.SwitchedRK(rtol=1e-11, atol=1e-11)
    s = zivi.sensitivity(drop, (0, 0.6), ([1.0], [0.0]), ("q0",), method, tstops=[0.2])
    speed = -s.trajectory.resolved_impacts["speed_before"][0]
    assert s.resolved_impacts["dt"][0, 0] == pytest.approx(1 / speed, rel=1e-9)


def test_a_parameter_e_of_a_builder_is_what_replace_sets():
    def falling(e):  # here an acceleration
        return zivi.MechanicalSystem(mass=1.0, force=[-e], gaps=[zivi.LinearGap([1])], e=0.5)

    system = zivi.ParametricSystem(falling, {"e": 9.81})
    s = zivi.sensitivity(system, (0, 0.9), ([1.0], [0.0]), wrt=("e",))

    def after(g):
        t1 = np.sqrt(2 / g)
        return 0.5 * g * t1 * (0.9 - t1) - g * (0.9 - t1) ** 2 / 2

    slope = (after(9.81 + 1e-4) - after(9.81 - 1e-4)) / 2e-4
    assert abs(s.final[0, 0, 0] - slope) < 1e-8


@pytest.mark.parametrize("slope", [0.0, 0.2])
def test_zeno_times_of_impacts_that_lose_ever_less_follow_differences(slope):
    """The restitution tends to 1: flights that are left are summed, as are their derivatives."""
    skew = np.array([[1.0, 0.6], [-0.4, 1.3]])
    method = zivi.SwitchedRK(rtol=1e-10, atol=1e-3)
    values = {"g": 9.81, "slope": slope, "m": 1.3}

    def build(g, slope, m):
        law = zivi.Restitution(lambda v: 1 / (1 + 0.3 * v**0.6), limit=1.0)
        floor = zivi.LinearGap(np.array([np.sin(slope), np.cos(slope)]) @ skew, name="floor")
        force = m * skew.T @ [0.5, -g]
        return zivi.MechanicalSystem(mass=m * skew.T @ skew, force=force, gaps=[floor], e=law)

    base = np.linalg.solve(skew, [0.0, 0.4]), np.linalg.solve(skew, [1.2, -0.3])
    wrt = ("q0[0]", "qdot0[1]", *values)
    s = zivi.sensitivity(zivi.ParametricSystem(build, values), (0, 5), base, wrt, method)
    assert s.zeno_times.shape == (1, 5)
    assert len(s.trajectory.zeno) == 1

    def zeno(j, h):
        moved, (q, w) = dict(values), (base[0].copy(), base[1].copy())
        if j == 0:
            q[0] += h
        elif j == 1:
            w[1] += h
        else:
            moved[wrt[j]] += h
        return zivi.simulate(build(**moved), (0, 5), (q, w), method).zeno["t"][0]

    for j in range(5):
        one, two = ((zeno(j, k * 2e-4) - zeno(j, -k * 2e-4)) / (4e-4 * k) for k in (1, 2))
        assert s.zeno_times[0, j] == pytest.approx((4 * one - two) / 3, rel=1e-7, abs=1e-8)
