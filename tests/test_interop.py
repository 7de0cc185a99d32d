"""python-control runs zivi's plants and controllers, and finds what zivi's own loop finds."""

import contextlib
import importlib.util
import io
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import zivi
from control_loops import Foreign
from zivi.interop import controller_block, force_block, impact_plant, state_vector

pytestmark = pytest.mark.filterwarnings("ignore:a landing may never rest")

ROOT = Path(__file__).parents[1]
H = 1e-3
GRAVITY = -9.81
HAVE_CONTROL = importlib.util.find_spec("control") is not None
with_control = pytest.mark.skipif(not HAVE_CONTROL, reason="python-control is not installed")


def tracker(kind=zivi.TwistingTracker, **settings):
    made = kind(30, 17, h=H, kappa=0.5, **settings)
    made.reset(3, 3)
    return made


def responses(
    controller, force=GRAVITY, force_ref=-19.81, method=None, t_end=2.0, start=(6, 5), t0=0.0
):
    """The same loop in python-control and in zivi: (x, xdot, u) and the run."""
    import control as ct

    system = zivi.ImpactSystem(force, kappa=0.5)
    blocks = [
        impact_plant(system, H, method=method),
        controller_block(controller),
        force_block(force, H),
    ]
    outputs, given = ["x", "xdot", "u"], {}
    reference = ("x_ref", "xdot_ref")
    if hasattr(controller, "x_ref"):
        given = {"force_ref": force_ref}
        blocks.append(force_block(force_ref, H, inputs=reference, output="force_ref"))
        outputs += reference
    loop = ct.interconnect(blocks, inputs=[], outputs=outputs)
    times = t0 + np.arange(round(t_end / H) + 1) * H
    found = ct.input_output_response(loop, times, 0, [*start, *state_vector(controller)])
    run = zivi.simulate_closed_loop(
        system, controller, (t0, t0 + t_end), start, method=method, **given
    )
    return dict(zip(outputs, found.outputs, strict=True)), run


@with_control
@pytest.mark.parametrize(
    "controller",
    [
        tracker(),
        tracker(branch="nearest"),
        tracker(e_ref=0.4),
        tracker(u_limits=(-40, 30)),
        tracker(zivi.ExplicitTwisting),
    ],
    ids=["positive", "nearest", "another wall", "limited", "explicit"],
)
def test_a_constant_force_gives_the_same_loop_to_the_last_bit(controller):
    before = controller.state
    found, run = responses(controller)
    for name, values in found.items():
        np.testing.assert_array_equal(values[:-1], getattr(run, name)[:-1], err_msg=name)
    assert found["x"][-1] == run.x[-1]
    assert controller.state == before
    assert len(run.resolved_impacts) > 3


@with_control
def test_the_regulator():
    regulator = zivi.TwistingRegulator(3, 2, h=H, kappa=0.5)
    found, run = responses(regulator, force=0.0, start=(1, 0))
    for name in ("x", "xdot", "u"):
        np.testing.assert_array_equal(found[name][:-1], getattr(run, name)[:-1])
    still = run.t > 1.8
    assert not np.any(found["x"][still])
    assert not np.any(found["xdot"][still])


@pytest.mark.slow
@with_control
@pytest.mark.parametrize("branch", ["positive", "nearest"])
def test_the_papers_loop(branch):
    # from sample to sample only the physical state is kept, not (s, v): equal to rounding
    found, run = responses(tracker(branch=branch), method=zivi.ThetaGamma(H))
    np.testing.assert_allclose(found["x"], run.x, atol=1e-12)
    np.testing.assert_allclose(found["xdot"], run.xdot, atol=1e-9)


@with_control
@pytest.mark.parametrize("method", [None, zivi.SwitchedRK(rtol=1e-10, atol=1e-13)])
def test_a_force_of_time_and_state(method):
    force = zivi.LinearForce(gravity=9.81, damping=0.1, amplitude=2.0, omega=7.0)
    # until shortly before rest, where the last digits are amplified
    found, run = responses(tracker(), force=force, method=method, t_end=1.0, t0=0.3)
    np.testing.assert_allclose(found["x"], run.x, atol=1e-9)
    np.testing.assert_allclose(found["xdot"], run.xdot, atol=1e-9)


@with_control
def test_a_ball_falls_to_rest_in_python_control():
    import control as ct

    system = zivi.ImpactSystem(GRAVITY, e=0.5)
    plant = impact_plant(system, 0.01)
    times = np.arange(201) * 0.01
    found = ct.input_output_response(plant, times, 0, [1, 0])
    exact = zivi.simulate(system, (0, 2), (1, 0))(times)
    np.testing.assert_allclose(found.states, exact, atol=1e-9)
    assert not np.any(found.states[:, times > 1.3546])


@with_control
def test_a_wall_that_moves_depends_on_the_time():
    import control as ct

    system = zivi.ImpactSystem(GRAVITY, e=0.5, wall=zivi.HarmonicWall(0.05, 9.0))
    times = np.arange(101) * 0.01
    found = ct.input_output_response(impact_plant(system, 0.01), times, 0, [1, 0])
    exact = zivi.simulate(system, (0, 1), (1, 0), method=zivi.SwitchedRK(rtol=1e-11, atol=1e-13))
    np.testing.assert_allclose(found.states, exact(times), atol=1e-8)


@with_control
def test_an_input_acts_as_a_force():
    import control as ct

    plant = impact_plant(zivi.ImpactSystem(GRAVITY, e=0.5), 0.01)
    times = np.arange(51) * 0.01
    found = ct.input_output_response(plant, times, np.full(51, 12.81), [0, 0])
    np.testing.assert_allclose(found.states[0], 1.5 * times**2, atol=1e-14)


@with_control
def test_a_refused_sample_holds_the_control():
    block = controller_block(tracker())
    start = state_vector(tracker())
    first = block.dynamics(0.0, start, [6.0, 5.0, GRAVITY, -19.81])
    held = block.output(H, first, [-1.0, 0.0, GRAVITY, -19.81])
    with pytest.warns(zivi.ModelWarning, match=r"'controller' rejected a sample at t = 0\.0"):
        second = block.dynamics(H, first, [-1.0, 0.0, GRAVITY, -19.81])
    status = block.find_state("status")
    assert held[0] == first[block.find_state("held")] == -33.5
    assert zivi.TickStatus(int(second[status])) is zivi.TickStatus.REFUSED
    np.testing.assert_array_equal(np.delete(second, status), np.delete(first, status))
    # and goes on
    third = block.dynamics(2 * H, second, [-0.05, 0.0, GRAVITY, -19.81])
    assert zivi.TickStatus(int(third[status])) is zivi.TickStatus.CLAMPED


@with_control
def test_outputs_have_no_memory():
    # python-control calls them several times a sample, in any order
    block = controller_block(tracker())
    start = state_vector(tracker())
    sample = [6.0, 5.0, GRAVITY, -19.81]
    once = block.output(0.0, start, sample)
    block.output(0.0, start, [0.0, -3.0, 0.0, 0.0])
    block.dynamics(0.0, start, [1.0, -3.0, 0.0, 0.0])
    np.testing.assert_array_equal(block.output(0.0, start, sample), once)


@with_control
def test_a_state_that_is_none_is_refused():
    block = controller_block(tracker())
    with pytest.raises(ValueError, match=r"zivi\.interop\.state_vector"):
        block.output(0.0, np.zeros(11), np.zeros(4))


@with_control
def test_motion_that_fails_is_an_error():
    plant = impact_plant(zivi.ImpactSystem(lambda t, x, xdot: 1.0 / (0.05 - t), e=0.5), 0.1)
    with pytest.raises(RuntimeError, match="cannot move on from t = 0 s"):
        plant.dynamics(0.0, [1.0, 0.0], [float("nan")])


@pytest.mark.parametrize("controller", [None, 3.0, zivi.TwistingTracker, object()])
def test_only_controllers_are_controllers(controller):
    with pytest.raises(TypeError, match="controller must be one of zivi's"):
        state_vector(controller)


@with_control
def test_bad_arguments_are_named():
    system = zivi.ImpactSystem(GRAVITY, e=0.5)
    with pytest.raises(TypeError, match="system must be"):
        impact_plant(3.0, H)
    for h in (0.0, -1.0, float("inf"), float("nan")):
        with pytest.raises(ValueError, match="h must be > 0 and finite"):
            impact_plant(system, h)
    with pytest.raises(ValueError, match=r"method\.h must be"):
        impact_plant(system, H, method=zivi.ThetaGamma(2 * H))
    with pytest.raises(TypeError, match="force must be a number or callable"):
        force_block("heavy", H)


def test_without_the_library_an_error_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "control", None)
    with pytest.raises(ImportError, match=r"pip install 'zivi\[control\]'"):
        force_block(1.0, H)


def test_importing_the_blocks_does_not_import_the_library():
    program = "import sys, zivi.interop; assert 'control' not in sys.modules"
    subprocess.run([sys.executable, "-c", program], check=True)


@pytest.fixture(scope="module")
def example():
    pytest.importorskip("control")
    path = ROOT / "examples" / "python_control.py"
    spec = importlib.util.spec_from_file_location("python_control", path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def run_of_example(example, tmp_path_factory):
    """What the example prints, its picture, and its responses by the lag: all is run once."""
    response, found = example.response, []

    def kept_response(*given):
        found.append(response(*given))
        return found[-1]

    path = tmp_path_factory.mktemp("interop") / "out.png"
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(example, "response", kept_response)
        with contextlib.redirect_stdout(io.StringIO()) as printed:
            example.main(str(path))
    # the first two have no lag
    return printed.getvalue(), path, dict(zip(example.LAGS, found[2:], strict=True))


@pytest.mark.slow
@pytest.mark.xdist_group("python_control")
def test_the_example(run_of_example):
    printed, path, _ = run_of_example
    assert printed.count("differs by 0 at most") == 2
    assert path.stat().st_size > 1000


@pytest.mark.slow
@pytest.mark.xdist_group("python_control")
def test_a_short_lag_is_no_lag(example, run_of_example):
    # c2d's zero-order hold acts a period late: a vanishing lag is the delay of a period
    late = zivi.simulate_closed_loop(
        example.PLANT, example.tracker(), (0, 2), (6, 5), force_ref=-19.81, delay=1
    )
    found = example.response(example.lag(1e-5))
    assert example.difference(found, late) < 1e-9
    longer = [example.times_of(run_of_example[2][tau])[0] for tau in (1e-3, 1e-2)]
    assert longer[0] < longer[1]


@with_control
def test_a_controller_of_the_user_is_a_block():
    import control

    class Own:
        h = H

        def __init__(self):
            self.ticks = 0

        def step(self, x, xdot, force):
            self.ticks += 1
            return 50.0 * (0.5 - x) - 10.0 * xdot - force + 1e-3 * self.ticks

    own, n = Own(), 400
    plant = zivi.ImpactSystem(GRAVITY, e=0.5)
    parts = [impact_plant(plant, H), controller_block(own)]
    loop = control.interconnect(parts, inputs=["force"], outputs=["x", "xdot", "u"])
    t = np.arange(n) * H
    expected = zivi.simulate_closed_loop(plant, Own(), (0, (n - 1) * H), (1, -3))
    for _ in range(2):  # from the start again
        found = control.input_output_response(loop, t, np.full(n, GRAVITY), [1, -3])
        np.testing.assert_array_equal(found.outputs[0], expected.x)
        np.testing.assert_array_equal(found.outputs[1], expected.xdot)
        np.testing.assert_array_equal(found.outputs[2][:-1], expected.u[:-1])
    assert own.ticks == 0

    class Greedy(Own):
        def step(self, x, xdot, force, mass, area):
            return 0.0

    with pytest.raises(TypeError, match="that of Greedy takes"):
        controller_block(Greedy())


class Leading:
    """A PD controller whose reference swings on its own, under a force that it adds up."""

    h, x_ref, xdot_ref = H, 0.5, 0.0

    def step(self, x, xdot, force, force_ref, t):
        u = 400.0 * (self.x_ref - x) - 30.0 * (xdot - self.xdot_ref) - force
        self.x_ref, self.xdot_ref = 0.5 + 0.1 * np.sin(3 * (t + H)), 0.3 * np.cos(3 * (t + H))
        return u + 0.01 * force_ref


@with_control
@pytest.mark.parametrize("kind", [Foreign, Leading])
def test_a_controller_of_the_user_with_a_reference_is_a_block(kind):
    """A tracker of ours behind an interface of its own, and one that is told the time."""
    import control

    made = (lambda: Foreign(tracker())) if kind is Foreign else Leading
    plant = zivi.ImpactSystem(GRAVITY, kappa=0.5)
    blocks = [
        impact_plant(plant, H),
        controller_block(made()),
        force_block(GRAVITY, H),
        force_block(
            lambda t, x, xdot: -19.81 + np.cos(x),
            H,
            inputs=("x_ref", "xdot_ref"),
            output="force_ref",
        ),
    ]
    outputs = ["x", "xdot", "u", "x_ref", "xdot_ref"]
    loop = control.interconnect(blocks, inputs=[], outputs=outputs)
    t = np.arange(1001) * H
    found = control.input_output_response(loop, t, 0, X0=[6, 5])
    run = zivi.simulate_closed_loop(
        plant, made(), (0, 1), (6, 5), force_ref=lambda t, x, xdot: -19.81 + np.cos(x)
    )
    for name, values in zip(outputs, found.outputs, strict=True):
        np.testing.assert_array_equal(values[:-1], getattr(run, name)[:-1], err_msg=name)
    assert len(run.resolved_impacts) > 0 or kind is Leading


@with_control
def test_a_controller_of_the_user_takes_its_reference_from_a_signal():
    import control

    class Follows:
        h = H

        def step(self, x, xdot, force, xdot_ref, x_ref):
            return -force + 100 * (x_ref - x) + 20 * (xdot_ref - xdot)

    block = controller_block(Follows())
    assert block.input_labels == ["x", "xdot", "force", "x_ref", "xdot_ref"]
    assert block.output_labels == ["u"]
    plant = zivi.ImpactSystem(GRAVITY, kappa=0.5)
    loop = control.interconnect(
        [impact_plant(plant, H), block, force_block(GRAVITY, H)],
        inputs=["x_ref", "xdot_ref"],
        outputs=["x", "xdot", "u"],
    )
    t = np.arange(2001) * H
    reference = np.array([0.5 + 0.2 * np.sin(2 * t), 0.4 * np.cos(2 * t)])
    found = control.input_output_response(loop, t, reference, X0=[1, 0])
    run = zivi.simulate_closed_loop(plant, Follows(), (0, 2), (1, 0), reference=reference)
    np.testing.assert_array_equal(found.outputs[0], run.x)
    np.testing.assert_array_equal(found.outputs[2][:-1], run.u[:-1])
