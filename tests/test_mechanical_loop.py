"""Closed loops of mechanical systems: inputs, sampling, what users' controllers may do, results."""

import pickle
import re

import numpy as np
import pytest
import sympy

import zivi
import zivi.files
from mechanical_arms import START, follow, tracker, two_links

FLOOR = zivi.LinearGap([1.0], name="floor")


def ball(**more):
    return zivi.MechanicalSystem(mass=2.0, force=[-19.62], gaps=[FLOOR], e=0.5, **more)


class Constant:
    h = 1e-2

    def __init__(self, *u):
        self.u = np.array(u)

    def step(self, t, q, qdot):
        return self.u


@pytest.mark.parametrize("method", [None, zivi.RKPeriod()])
def test_held_controls_move_a_system_as_constant_forces_do(method):
    arm, torque = two_links(), np.array([3.0, 1.0])
    run = zivi.simulate_closed_loop(arm, Constant(*torque), (0, 1), (START, [0, 0]), method=method)

    def force(t, q, qdot):
        return arm.at(t, q, qdot).force + torque

    floor = zivi.Gap(
        value=lambda t, q: arm.at(t, q, 0 * q).gaps[0],
        gradient=lambda t, q: arm.at(t, q, 0 * q).gradients[0],
        curvature=lambda t, q, w: arm.at(t, q, w).curvatures[0],
        name="floor",
    )
    same = zivi.MechanicalSystem(
        mass=lambda t, q: arm.at(t, q, 0 * q).mass, force=force, gaps=[floor], e=0.6
    )
    exact = zivi.simulate(
        same, (0, 1), (START, [0, 0]), zivi.SwitchedRK(rtol=1e-9, atol=1e-12), t_eval=run.t
    )
    assert len(run.resolved_impacts) == len(exact.resolved_impacts) > 0
    np.testing.assert_allclose(run.q, exact.q, atol=1e-6 if method else 1e-8)


@pytest.mark.parametrize(
    "inputs",
    [
        [[0.0, 2.0], [1.0, 0.5]],
        {"first": [0.0, 1.0], "second": [2.0, 0.5]},
        lambda q: np.array([[0.0, 2.0], [1.0, 0.5]]),
    ],
)
def test_inputs_may_be_a_matrix_columns_by_name_or_a_function(inputs):
    system = zivi.MechanicalSystem(mass=np.diag([1.0, 2.0]), force=[0, 0], inputs=inputs)
    run = zivi.simulate_closed_loop(system, Constant(3.0, 4.0), (0, 1), ([0, 0], [0, 0]))
    np.testing.assert_allclose(run.q[-1], [0.5 * 8.0, 0.5 * 5.0 / 2.0], rtol=1e-12)
    assert run.control_names == (("first", "second") if isinstance(inputs, dict) else ("u0", "u1"))


def test_symbolic_inputs_may_depend_on_coordinates_and_parameters():
    cart = zivi.symbolic.system(
        "x phi",
        T="xdot**2/2 + phidot**2/2",
        gaps={"wall": "x + 5"},
        parameters={"r": 0.5},
        e=0.5,
        inputs={"rope": ["cos(phi)", "r"]},
    )
    q = np.array([0.1, 0.7])
    assert cart.control_inputs(q).at(q).tolist() == [[np.cos(0.7)], [0.5]]
    other = pickle.loads(pickle.dumps(cart.replace(r=2.0)))
    assert other.control_inputs(q).at(q)[1, 0] == 2.0
    run = zivi.simulate_closed_loop(other, Constant(1.0), (0, 0.5), (q, [0, 0]))
    assert run.qdot[-1, 1] == pytest.approx(1.0, rel=1e-10)
    for wrong in ({"u": [1]}, {"u": ["xdot", 1]}, ["x"], [["x", 1], [0]], []):
        with pytest.raises((ValueError, TypeError), match="inputs"):
            zivi.symbolic.system("x phi", T="xdot**2 + phidot**2", inputs=wrong)


@pytest.mark.parametrize(
    "inputs",
    [
        np.array([[1.0, 0.5], [0.0, 2.0]]),
        sympy.Matrix([[1, 0.5], [0, 2]]),
        [["cos(0)", "r"], [0, "4*r"]],
        lambda q: [[1.0, 0.5], [0.0, 2.0]],
    ],
)
def test_symbolic_inputs_may_be_a_matrix_or_a_function(inputs):
    asked = {"T": "xdot**2/2 + ydot**2/2", "parameters": {"r": 0.5}, "inputs": inputs}
    system = zivi.symbolic.system("x y", **asked).replace(r=0.5)
    run = zivi.simulate_closed_loop(system, Constant(3.0, 4.0), (0, 1), ([0, 0], [0, 0]))
    np.testing.assert_allclose(run.q[-1], [0.5 * 5.0, 0.5 * 8.0], rtol=1e-12)
    assert run.control_names == ("u0", "u1")


def test_a_loop_warns_of_a_controller_that_predicts_over_another_delay():
    ctl = zivi.GapTracker(ball(), h=1e-2, gains={"floor": (30, 17)}, delay=2)
    with pytest.warns(zivi.ModelWarning, match="delay = 2, the loop has delay = 3") as seen:
        zivi.simulate_closed_loop(ball(), ctl, (0, 0.1), ([0.1], [0]), delay=3)
    assert seen[0].filename == __file__
    zivi.simulate_closed_loop(ball(), ctl, (0, 0.1), ([0.1], [0]), delay=2)


def test_controls_act_late_and_measurements_are_noisy_and_rounded():
    class Seen(Constant):
        def __init__(self):
            super().__init__(1.0)
            self.q = []

        def step(self, t, q, qdot):
            self.q.append(q[0])
            return [len(self.q)]

    seen = Seen()
    run = zivi.simulate_closed_loop(
        ball(),
        seen,
        (0, 0.1),
        ([1.0], [0]),
        delay=3,
        noise=(1e-3, 0),
        seed=4,
        quantization=(1e-4, 0),
    )
    assert run.u[:, 0].tolist() == [0, 0, 0, 1, 2, 3, 4, 5, 6, 7, 7]
    noise = 1e-3 * np.random.default_rng(np.random.SeedSequence(4)).standard_normal((11, 2, 1))
    wanted = 1e-4 * np.round((run.q[:10, 0] + noise[:10, 0, 0]) / 1e-4)
    assert seen.q == wanted.tolist()


def test_a_control_that_is_not_finite_is_rejected_and_the_last_one_held():
    class Strange(Constant):
        k = 0

        def step(self, t, q, qdot):
            self.k += 1
            return {2: [np.nan], 3: [np.inf], 4: [-np.inf]}.get(self.k, [float(self.k)])

    with pytest.warns(zivi.ModelWarning, match="3 of 6 control updates of Strange were rejected"):
        run = zivi.simulate_closed_loop(ball(), Strange(), (0, 0.06), ([1.0], [0]))
    assert run.u[:6, 0].tolist() == [1, 1, 1, 1, 5, 6]
    assert run.tick_status.tolist() == [0, 4, 4, 4, 0, 0, 0]
    assert run.n_refused == 3


@pytest.mark.parametrize(
    "value", [[5.0], [1.0, 2.0, 3.0], [[1.0, 2.0]], 5.0, None, "x", [None, 1.0, [2]]]
)
def test_another_number_of_controls_is_an_error_at_the_first_tick(value):
    """Two inputs; one mass raises as early."""
    two = zivi.MechanicalSystem(mass=np.eye(2), force=[0, -9.81], inputs=np.eye(2))
    calls = []

    class Wrong:
        h = 1e-2

        def step(self, *sample):
            calls.append(sample)
            return value

    message = re.escape(f"controller.step must return 2 controls (u0, u1), got {value!r}")
    with pytest.raises(TypeError, match=message):
        zivi.simulate_closed_loop(two, Wrong(), (0, 1), ([0, 1], [0, 0]))
    with pytest.raises(TypeError, match=message):
        zivi.simulate_closed_loop_batch(two, Wrong(), (0, 1), ([0, 1], [0, 0]), threads=1)
    assert len(calls) == 2


def test_an_exception_of_a_controller_keeps_the_part_that_was_computed():
    class Failing(Constant):
        def step(self, t, q, qdot):
            if t > 0.05:
                raise RuntimeError("enough")
            return self.u

    with pytest.raises(RuntimeError, match="enough") as raised:
        zivi.simulate_closed_loop(ball(), Failing(1.0), (0, 1), ([1.0], [0]))
    part = raised.value.trajectory
    assert part.t[-1] == pytest.approx(0.05)
    assert part.status is zivi.Status.RAISED


def test_disturbances_push_the_plant_only():
    pushed = [
        zivi.simulate_closed_loop(ball(), Constant(0.0), (0, 0.3), ([5.0], [0]), disturbance=it)
        for it in ([4.0], lambda t, q, qdot: np.array([4.0]))
    ]
    for run in pushed:
        assert run.q[-1, 0] == pytest.approx(5.0 + 0.5 * (2.0 - 9.81) * 0.09, rel=1e-12)


def test_loops_are_pickled_resampled_tabled_and_saved(tmp_path):
    run = follow(tracker(), end=1.2)
    twin = pickle.loads(pickle.dumps(run))
    assert np.array_equal(twin.u, run.u)
    assert np.array_equal(twin(0.5005), run(0.5005))
    fine = run.resample([0.5, 0.5005, 1.1])
    assert np.array_equal(fine.u[1], run.u[500])
    assert fine.reactions[2, 0] == pytest.approx(run.reactions[1100, 0], abs=1e-6)
    data = run.to_xarray()
    assert data.u.dims == ("time", "control")
    assert data.control.values.tolist() == ["ta", "tb"]
    assert "u_ta" in run.to_pandas().columns
    zivi.files.save(run, tmp_path / "run.nc")
    back = zivi.files.load(tmp_path / "run.nc")
    assert type(back) is type(run)
    for name in ("t", "q", "u", "error_gaps", "latched", "tick_status", "reactions"):
        assert np.array_equal(getattr(back, name), getattr(run, name)), name
    assert back.control_names == run.control_names
    assert "MechanicalClosedLoop GapTracker" in repr(back)
    assert run.plot().axes


def test_arguments_of_another_kind_are_refused_by_name():
    with pytest.raises(TypeError, match="y_ref0"):
        zivi.simulate_closed_loop(ball(), Constant(1.0), (0, 1), ([1.0], [0]), y_ref0=(1, 0))
    plant, regulator = zivi.ImpactSystem(-9.81, e=0.5), zivi.TwistingRegulator(30, 17, h=1e-3)
    with pytest.raises(TypeError, match="disturbance"):
        zivi.simulate_closed_loop(plant, regulator, (0, 1), (1, 0), disturbance=[1.0])
    with pytest.raises(TypeError, match="step_to"):
        zivi.simulate_closed_loop(ball(), Constant(1.0), (0, 1), ([1.0], [0]), reference="rest")
    with pytest.raises(TypeError, match="method"):
        zivi.simulate_closed_loop(
            ball(), Constant(1.0), (0, 1), ([1.0], [0]), method=zivi.MoreauJean(1e-3)
        )
