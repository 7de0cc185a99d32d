"""FMUs of closed loops of mechanical systems: the native loop, in any importer."""

import ctypes as c
import importlib.util

import numpy as np
import pytest

import zivi
from fmu_unit import Archive, Unit, simulated_elsewhere
from mechanical_arms import START, tapping, tracker, turning_mass, two_links

pytestmark = pytest.mark.xdist_group("fmu")

H = 1e-3
BESIDE = (START + np.array([0.03, -0.02]), np.array([0.1, -0.1]))
BOTH = pytest.mark.parametrize("fmi", [2, 3])


def unit_of(tmp_path, fmi, system=None, controller=None, start=BESIDE, end=1.5, **asked):
    """An instance of a loop that was exported and unpacked, not initialised."""
    plant = two_links() if system is None else system
    own = tracker() if controller is None else controller
    asked = {"reference": tapping()} | asked
    (path,) = zivi.fmu.export_loop(tmp_path, plant, own, (0, end), start, fmi=fmi, **asked)
    return Unit(Archive(path, tmp_path / f"unpacked{fmi}"))


def native(system=None, controller=None, start=BESIDE, end=1.5, **asked):
    plant = two_links() if system is None else system
    own = tracker() if controller is None else controller
    asked = {"reference": tapping(), "method": zivi.RKPeriod()} | asked
    return zivi.simulate_closed_loop(plant, own, (0, end), start, **asked)


def stepped(unit, count, names):
    """Rows of what is read before each of so many steps."""
    rows = []
    for k in range(count):
        rows.append([unit.get(name) for name in names])
        assert unit.step(k * H, H) == 0, unit.told
    return np.array(rows)


@BOTH
def test_a_loop_that_bounces_rests_and_presses_is_the_native_one(tmp_path, fmi):
    run, unit = native(), unit_of(tmp_path, fmi).start()
    names = ("q_a", "q_b", "qdot_a", "qdot_b", "u_ta", "u_tb", "gap_floor", "force_floor")
    rows = stepped(unit, 1500, names)
    for column, expected, tolerance in (
        (rows[:, 0:2], run.q, 1e-10),
        (rows[:, 2:4], run.qdot, 1e-8),
        (rows[:, 4:6], run.u, 1e-5),
        (rows[:, 6:7], run.gaps, 1e-10),
    ):
        assert np.abs(column - expected[:1500]).max() < tolerance
    assert unit.get("contact_floor") == unit.get("held_floor") == 1
    assert rows[-1, 7] == pytest.approx(10.0, abs=1e-3)
    assert unit.get("status") == 0
    unit.free()


@pytest.mark.parametrize(
    "settings",
    [
        {"delay": 2},
        {"u_limits": [(-14.0, 14.0), (-5.0, 5.0)]},
        {"horizon": 3.0, "shift": True},
        {"latch": (1e-4, 1e-2), "learn_offset": True},
    ],
    ids=["delay", "limits", "horizon", "latch"],
)
@pytest.mark.filterwarnings("ignore:.*were saturated:zivi.ModelWarning")
def test_settings_and_a_wrong_model_are_those_of_the_controller(tmp_path, settings):
    ctl = tracker(two_links().replace(m2=0.9), **settings)
    run = native(controller=ctl, reference="rest", delay=settings.get("delay", 0), end=0.9)
    unit = unit_of(tmp_path, 3, controller=ctl, reference="rest", end=0.9).start()
    rows = stepped(unit, 900, ("q_a", "q_b", "contact_floor", "status"))
    assert np.abs(rows[:, :2] - run.q[:900]).max() < 1e-8
    assert np.array_equal(rows[-1, 2:], [1.0, run.tick_status[899]])
    counts = unit.get("n_refused"), unit.get("n_saturated")
    assert counts == (run.n_refused, run.n_saturated)
    assert counts[1] > 0 or "u_limits" not in settings
    unit.free()


def test_parameters_and_disturbances_are_those_of_the_importer(tmp_path):
    arm = two_links()
    rest = {"floor": "rest", "posture": START}
    run = native(arm.replace(m1=1.2), reference=rest, end=0.6, disturbance=[0.5, -0.2])
    unit = unit_of(tmp_path, 2, reference=rest, start=(START, np.zeros(2)))
    unit.start(q0_a=0.53, q0_b=-1.22, qdot0_a=0.1, qdot0_b=-0.1, plant_m1=1.2)
    unit.set(disturbance_a=0.5, disturbance_b=-0.2)
    rows = stepped(unit, 600, ("q_a", "q_b"))
    assert np.abs(rows - run.q[:600]).max() < 1e-9
    assert unit.set(plant_m1=1.0) == 3  # not now
    unit.free()


def test_controls_that_act_through_the_configuration(tmp_path):
    arm = turning_mass(floor="y", wall="2 - x")
    ctl = zivi.GapTracker(arm, h=H, gains={"floor": (40, 22), "wall": (40, 22)})
    start = ([1.8, 0.1], [0.0, 0.0])
    run = native(arm, ctl, start, end=0.6, reference="rest")
    unit = unit_of(tmp_path, 3, arm, ctl, start, end=0.6, reference="rest").start()
    rows = stepped(unit, 600, ("q_x", "q_y", "contact_floor", "contact_wall", "u_along"))
    assert np.abs(rows[:, :2] - run.q[:600]).max() < 1e-10
    assert np.array_equal(rows[-1, 2:4], [1.0, 1.0])
    assert rows[-1, 4] == pytest.approx(run.u[599, 0], abs=1e-6)
    unit.free()


ARM = ([0.7, 0.6], [0.1, -0.2])


def tree_arm(**joint):
    """Two links that hang, with a plate on the second, above a floor; a limit of the first."""
    bodies = [
        zivi.mechanics.Body(
            "upper", axis=[0, 1, 0.1], mass=1.0, com=[0.01, 0, -0.5], inertia=0.02, damping=0.1
        ),
        zivi.mechanics.Body(
            "fore", "upper", position=[0, 0.1, -1], axis=[0, 1, 0], mass=0.7, com=[0, 0, -0.4],
            inertia=[0.01, 0.02, 0.01], **joint,
        ),
        zivi.mechanics.Body(
            "plate", "fore", "fixed", position=[0, 0.02, -0.7], mass=0.1, com=[0.03, 0, 0],
            inertia=1e-3,
        ),
    ]  # fmt: skip
    tip = zivi.mechanics.PlaneGap(
        "fore", point=[0, 0, -0.8], offset=-1.2, radius=0.05, name="floor"
    )
    limit = zivi.mechanics.JointLimit("upper", upper=0.9)
    return zivi.Tree(bodies, gaps=[tip, limit], e=0.5)


def tree_tracker(arm):
    gains = dict.fromkeys(arm.gap_names, (30, 17))
    return zivi.GapTracker(arm, h=H, gains=gains)


@BOTH
def test_a_tree_of_bodies_goes_into_the_archive_as_numbers(tmp_path, fmi):
    arm = tree_arm(stiffness=2.0, spring=0.2, armature=0.01)
    ctl = tree_tracker(arm)
    plant = arm.replace(**{"plate.mass": 0.3, "gravity.z": -9.0})
    run = native(plant, ctl, ARM, 0.7, reference="rest")
    unit = unit_of(tmp_path, fmi, arm, ctl, ARM, 0.7, reference="rest")
    # no compiled code is beside the binary
    assert [it.suffix for it in (tmp_path / f"unpacked{fmi}" / "resources").iterdir()] == [".bin"]
    unit.start(**{"plant_plate.mass": 0.3, "plant_gravity.z": -9.0})
    names = ("q_upper", "q_fore", "qdot_upper", "qdot_fore", "gap_floor", "contact_floor")
    rows = stepped(unit, 700, names)
    assert np.abs(rows[:, :2] - run.q[:700]).max() < 1e-10
    assert np.abs(rows[:, 2:4] - run.qdot[:700]).max() < 1e-8
    assert np.abs(rows[:, 4] - run.gaps[:700, 0]).max() < 1e-10
    assert len(run.impacts) > 3
    assert np.array_equal(rows[:, 5], run.contacts[:700, 0])
    unit.free()


def test_a_controller_may_believe_in_a_tree_where_the_plant_is_compiled(tmp_path):
    plant = zivi.symbolic.system(
        "z", T="zdot**2/2", V="9.81*z", gaps={"floor": "z"}, e=0.5, inputs={"u0": [1]}
    )
    ball = zivi.mechanics.Body("z", kind="slide", axis=[0, 0, 1], mass=1.1)
    believed = zivi.Tree([ball], gaps=[zivi.mechanics.PlaneGap("z", name="floor")], e=0.5)
    ctl, start = zivi.GapTracker(believed, h=H, gains={"floor": (30, 17)}), ([0.3], [0.0])
    run = native(plant, ctl, start, 0.5, reference="rest")
    unit = unit_of(tmp_path, 2, plant, ctl, start, 0.5, reference="rest").start()
    rows = stepped(unit, 500, ("q_z", "contact_floor"))
    assert np.abs(rows[:, 0] - run.q[:500, 0]).max() < 1e-10
    assert rows[-1, 1] == run.contacts[499, 0] == 1
    unit.free()


def test_a_tree_that_is_none_is_refused(tmp_path):
    arm = tree_arm()
    unit = unit_of(tmp_path, 2, arm, tree_tracker(arm), ARM, 0.1, reference="rest")
    archive = unit.archive
    unit.free()
    (path,) = (tmp_path / "unpacked2" / "resources").iterdir()
    numbers = np.frombuffer(path.read_bytes(), "<f8")
    # every number once out of range, and the file cut at every tenth: refused or run, never a fault
    callbacks = type(unit.callbacks)(unit.logger, None, None, None, None)

    def instance(content, k):
        token = f"zivi-loop-{k}"
        path.with_name(f"{token}.bin").write_bytes(content)
        make = archive.library.fmi2Instantiate
        arguments = (b"x", 1, token.encode(), path.parent.as_uri().encode(), c.byref(callbacks))
        return make(*arguments, 0, 0)

    cut = [instance(numbers[:k].tobytes(), f"cut{k}") for k in range(0, len(numbers), 10)]
    assert cut == [None] * len(cut)
    first = int(np.flatnonzero(numbers == len(arm.parameters))[0]) + len(arm.parameters) + 1
    assert numbers[first] == 1.0  # here the tree begins: joints, gaps, polynomials
    parents = numbers[first + 1 :].copy()
    assert parents[:4].tolist() == [-1, 0, 0, 0]
    for k, value in ((1, 5.0), (1, -2.0), (3, 1.0), (3, np.nan), (5, 9.0), (6, 2.0), (11, 1e9)):
        wrong = numbers.copy()
        wrong[first + k] = value
        assert instance(wrong.tobytes(), f"wrong{k}-{value}".replace(".", "")) is None, (k, value)


@BOTH
def test_a_state_that_is_set_or_stored_goes_on(tmp_path, fmi):
    unit = unit_of(tmp_path, fmi, controller=tracker(delay=3), reference="rest").start()
    names = ("q_a", "qdot_b", "u_ta", "force_floor", "held_floor")
    stepped(unit, 250, names)
    state = unit.state()
    stored = unit.stored(state)

    def on():
        rows = []
        for k in range(250, 700):
            assert unit.step(k * H, H) == 0
            rows.append([unit.get(name) for name in names])
        return np.array(rows)

    first = on()
    assert unit.restore(state) == 0
    assert np.array_equal(on(), first)
    other = Unit(unit.archive)
    status, again = other.unstored(stored)
    assert status == 0
    assert other.restore(again) == 0
    assert other.step(0.25, H) == 0
    assert other.get("q_a") == first[0, 0]
    unit.free_state(state)
    other.free_state(again)
    other.free()
    unit.free()


def test_what_is_wrong_is_told(tmp_path):
    unit = unit_of(tmp_path, 3)
    unit.set(q0_a=-2.0)
    assert unit.initialise() == 3
    assert "no gap below 0" in unit.told[-1][1]
    unit.call("Reset")
    unit.start()
    assert unit.step(0.0, 1.5e-3) == 3
    assert "multiple of h" in unit.told[-1][1]
    assert unit.step(0.0, H) == 0
    unit.set(disturbance_a=1e300)
    assert unit.step(H, H) == 3
    assert unit.get("q_a") == pytest.approx(0.53, abs=1e-2)  # where it was
    unit.free()


def test_a_folder_without_the_files_or_another_token_is_refused(tmp_path):
    unit = unit_of(tmp_path, 2)
    archive, folder = unit.archive, next((tmp_path / "unpacked2").glob("resources"))
    unit.free()
    words = []
    logger = unit.logger
    for token, uri in (
        (archive.token + b"0", folder.as_uri()),
        (b"../" + archive.token, folder.as_uri()),
        (b"zivi-loop-none", (tmp_path / "nothing").as_uri()),
    ):
        callbacks = type(unit.callbacks)(logger, None, None, None, None)
        make = archive.library.fmi2Instantiate
        words.append(make(b"x", 1, token, uri.encode(), c.byref(callbacks), 0, 0))
    assert words == [None] * 3


def test_an_export_is_the_same_byte_by_byte(tmp_path):
    both = [
        zivi.fmu.export_loop(tmp_path / it, two_links(), tracker(), (0, 1), BESIDE, name="Arm")
        for it in ("one", "other")
    ]
    assert [it.name for it in both[0]] == ["Arm2.fmu", "Arm3.fmu"]
    for one, other in zip(*both, strict=True):
        assert one.read_bytes() == other.read_bytes()


BALL = zivi.MechanicalSystem(
    mass=1.0, force=[-9.81], gaps=[zivi.LinearGap([1])], e=0.5, inputs=[[1.0]]
)


RUBBING = zivi.symbolic.system(
    "a b",
    T="(adot**2 + bdot**2)/2",
    V="9.81*a",
    gaps={"floor": "a"},
    e=0.6,
    friction={"pads": ("adot", "2.0")},
    inputs={"ta": [1, 0], "tb": [0, 1]},
)


def believing(system):
    return zivi.GapTracker(system, h=H, gains={"floor": (40, 22)})


@pytest.mark.parametrize(
    ("asked", "error", "words"),
    [
        ({"system": BALL}, TypeError, r"system must be a zivi\.symbolic\.system or a zivi\.Tree"),
        ({"controller": 5}, TypeError, r"controller's system must be a zivi\.symbolic\.system"),
        ({"controller": tracker(force={"floor": lambda t: 5.0})}, TypeError, "must be a number"),
        ({"controller": tracker(tasks={"x": "cos(a)"})}, ValueError, "tasks must not be set"),
        ({"system": RUBBING}, ValueError, "do not support friction; the plant has"),
        ({"controller": believing(RUBBING)}, ValueError, "do not support friction; the model has"),
        ({"name": "a b"}, ValueError, "name must be a letter"),
        ({"fmi": 4}, ValueError, "fmi must be 2 or 3"),
        ({"y0": ([-2.0, 0.0], [0, 0])}, ValueError, "gap 'floor' must be >= 0 at the start"),
        ({"reference": "fly"}, ValueError, "must be 'rest' or a run"),
    ],
)
def test_what_is_asked_for_is_checked(tmp_path, asked, error, words):
    asked = {"system": two_links(), "controller": tracker(), "y0": BESIDE} | asked
    parts = [asked.pop(name) for name in ("system", "controller", "y0")]
    with pytest.raises(error, match=words):
        zivi.fmu.export_loop(tmp_path, *parts[:2], (0, 1), parts[2], **asked)
    assert not list(tmp_path.iterdir())


@pytest.mark.skipif(importlib.util.find_spec("fmpy") is None, reason="no fmpy")
def test_an_importer_validates_and_simulates_it_without_zivi(tmp_path):
    zivi.fmu.export_loop(
        tmp_path, two_links(), tracker(), (0, 1.2), BESIDE, reference=tapping(), name="Arm"
    )
    run = native(end=1.2)
    for problems, a, force in simulated_elsewhere(tmp_path, 1.2, 1e-3, ("q_a", "force_floor")):
        assert not problems
        assert a == pytest.approx(run.q[-1, 0], abs=1e-9)
        assert force == pytest.approx(10.0, abs=1e-3)
