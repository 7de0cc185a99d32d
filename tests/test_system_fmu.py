"""FMUs of mechanical systems without a controller: the motion of `simulate`, in any importer."""

import importlib.util
import itertools

import numpy as np
import pytest

import zivi
from fmu_unit import Archive, Unit, simulated_elsewhere
from mechanical_arms import two_links

pytestmark = pytest.mark.xdist_group("fmu")

BOTH = pytest.mark.parametrize("fmi", [2, 3])
START = ([0.7, 0.6], [0.1, -0.2])
CLOSE = zivi.SwitchedRK(rtol=1e-11, atol=1e-13)


def arm(**joint):
    """Two links that hang, with a plate on the second, above a floor; a limit of the first."""
    upper = zivi.mechanics.Body(
        "upper", axis=[0, 1, 0.1], mass=1.0, com=[0.01, 0, -0.5], inertia=0.02, damping=0.4
    )
    fore = zivi.mechanics.Body(
        "fore", "upper", position=[0, 0.1, -1], axis=[0, 1, 0], mass=0.7, com=[0, 0, -0.4],
        inertia=[0.01, 0.02, 0.01], damping=0.2, **joint,
    )  # fmt: skip
    plate = zivi.mechanics.Body(
        "plate", "fore", "fixed", position=[0, 0.02, -0.7], mass=0.1, com=[0.03, 0, 0], inertia=1e-3
    )
    tip = zivi.mechanics.PlaneGap(
        "fore", point=[0, 0, -0.8], offset=-1.2, radius=0.05, name="floor"
    )
    limit = zivi.mechanics.JointLimit("upper", upper=0.9)
    return zivi.Tree([upper, fore, plate], gaps=[tip, limit], e=0.5)


def unit_of(tmp_path, fmi, system, start=START, **asked):
    (path,) = zivi.export_fmu(tmp_path, system, fmi, y0=start, **asked)
    return Unit(Archive(path, tmp_path / f"unpacked{fmi}"))


def rows_at(unit, times, names):
    """Rows of what is read before each step from time to time."""
    rows = []
    for t, end in itertools.pairwise(times):
        rows.append([unit.get(name) for name in names])
        assert unit.step(t, end - t) == 0, unit.told
    return np.array([*rows, [unit.get(name) for name in names]])


@BOTH
def test_a_tree_that_bounces_and_rests_moves_as_simulate_moves_it(tmp_path, fmi):
    system = arm(stiffness=2.0, spring=0.2, armature=0.01)
    unit = unit_of(tmp_path, fmi, system)
    # no compiled code is beside the binary
    assert [it.suffix for it in (tmp_path / f"unpacked{fmi}" / "resources").iterdir()] == [".bin"]
    unit.start(**{"plate.mass": 0.3, "gravity.z": -9.0, "q0_fore": 0.5})
    plant = system.replace(**{"plate.mass": 0.3, "gravity.z": -9.0})
    # steps of all lengths, some of which end in the middle of an accumulation
    times = np.concatenate([[0.0], np.cumsum(np.random.default_rng(3).uniform(1e-3, 0.06, 150))])
    run = zivi.simulate(plant, (0, times[-1]), ([0.7, 0.5], START[1]), CLOSE, t_eval=times)
    names = ("q_upper", "q_fore", "qdot_upper", "qdot_fore", "gap_floor", "force_floor")
    rows = rows_at(unit, times, (*names, "contact_floor", "time"))
    assert np.abs(rows[:, :2] - run.q).max() < 1e-8
    assert np.abs(rows[:, 2:4] - run.qdot).max() < 1e-6
    assert np.abs(rows[:, 4] - run.gaps[:, 0]).max() < 1e-8
    assert len(run.resolved_impacts) > 5
    closed = run.contacts[:, 0]
    assert 0 < closed.sum() < len(closed)
    assert np.array_equal(rows[:, 6], closed)
    assert np.abs(rows[:, 5] - run.reactions[:, 0])[closed].max() < 1e-5
    assert np.allclose(rows[:, 7], times, rtol=1e-15, atol=0)
    unit.free()


@BOTH
def test_one_long_step_passes_impacts_accumulations_and_rest(tmp_path, fmi):
    ball = zivi.mechanics.Body("z", kind="slide", axis=[0, 0, 1], mass=2.0)
    tree = zivi.Tree([ball], gaps=[zivi.mechanics.PlaneGap("z", name="floor")], e=0.5)
    unit = unit_of(tmp_path, fmi, tree, ([0.3], [0.0]), name="Ball").start()
    # the sum of the geometric series
    zeno = np.sqrt(2 * 0.3 / 9.81) * (1 + 2 * 0.5 / (1 - 0.5))
    assert unit.step(0.0, zeno + 0.5) == 0
    assert [unit.get(it) for it in ("q_z", "qdot_z", "gap_floor")] == [0.0, 0.0, 0.0]
    assert unit.get("contact_floor") == 1
    assert unit.get("force_floor") == pytest.approx(2 * 9.81, rel=1e-14)
    # pulled off, then in free flight
    unit.set(u_z=2 * 11.81)
    assert unit.step(zeno + 0.5, 0.25) == 0
    assert unit.get("q_z") == pytest.approx(0.5 * 2.0 * 0.25**2, rel=1e-12)
    assert unit.get("contact_floor") == unit.get("force_floor") == 0
    unit.set(u_z=0.0)
    assert unit.step(zeno + 0.75, 0.02) == 0
    assert unit.get("qdot_z") == pytest.approx(0.5 - 9.81 * 0.02, rel=1e-12)
    unit.free()


@BOTH
def test_a_bar_rests_on_three_feet(tmp_path, fmi):
    lift = zivi.mechanics.Body("z", kind="slide", axis=[0, 0, 1], mass=1.0)
    bar = zivi.mechanics.Body("bar", "z", axis=[0, 1, 0], mass=2.0, inertia=0.3, damping=0.01)
    places = {"left": -1.0, "middle": 0.5, "right": 1.0}
    feet = [zivi.mechanics.PlaneGap("bar", point=[x, 0, 0], name=it) for it, x in places.items()]
    start = ([1.0, 0.1], [0.0, 0.0])
    unit = unit_of(tmp_path, fmi, zivi.Tree([lift, bar], gaps=feet, e=0.5), start).start()
    assert unit.step(0.0, 4.0) == 0, unit.told
    state = [unit.get(it) for it in ("q_z", "q_bar", "qdot_z", "qdot_bar")]
    assert state == pytest.approx([0.0] * 4, abs=1e-30)
    # of those that balance the weight the least, none of which is negative
    forces = [unit.get(f"force_{it}") for it in places]
    balance = np.array([np.ones(3), list(places.values())])
    least = np.linalg.pinv(balance) @ [3 * 9.81, 0.0]
    assert least.min() > 0.0
    assert forces == pytest.approx(least, rel=1e-12)
    unit.free()


def test_a_symbolic_system_is_compiled_into_the_archive(tmp_path):
    system, start = two_links(), ([0.5, -1.2], [0.1, -0.1])
    unit = unit_of(tmp_path, 3, system, start).start(m1=1.2)
    times = np.linspace(0, 1, 26)
    run = zivi.simulate(system.replace(m1=1.2), (0, 1), start, CLOSE, t_eval=times)
    rows = rows_at(unit, times, ("q_a", "q_b"))
    assert np.abs(rows - run.q).max() < 1e-8
    unit.free()


@BOTH
def test_a_state_that_is_set_or_stored_goes_on(tmp_path, fmi):
    unit = unit_of(tmp_path, fmi, arm()).start()
    names = ("q_upper", "qdot_fore", "force_floor", "contact_floor")
    times = np.arange(60) * 0.02
    rows_at(unit, times[:30], names)
    state = unit.state()
    stored = unit.stored(state)
    first = rows_at(unit, times[29:], names)
    assert unit.restore(state) == 0
    assert np.array_equal(rows_at(unit, times[29:], names), first)
    other = Unit(unit.archive)
    status, again = other.unstored(stored)
    assert status == 0
    assert other.restore(again) == 0
    assert np.array_equal(rows_at(other, times[29:], names), first)
    for it, held in ((unit, state), (other, again)):
        it.free_state(held)
        it.free()


def test_what_is_wrong_is_told(tmp_path):
    unit = unit_of(tmp_path, 3, arm())
    unit.set(q0_upper=1.5)
    assert unit.initialise() == 3
    assert "no gap below 0" in unit.told[-1][1]
    unit.call("Reset")
    unit.start()
    for length in (0.0, -0.1, np.nan, np.inf):
        assert unit.step(0.0, length) == 3
        assert "communication step must be > 0" in unit.told[-1][1]
    unit.set(u_upper=np.nan)
    assert unit.step(0.0, 0.1) == 3
    assert unit.get("q_upper") == 0.7  # where it was
    unit.set(u_upper=0.0)
    assert unit.step(0.0, 0.1) == 0
    unit.free()


def test_an_export_is_the_same_byte_by_byte(tmp_path):
    both = [zivi.export_fmu(tmp_path / it, arm(), y0=START, name="Arm") for it in ("one", "other")]
    assert [it.name for it in both[0]] == ["Arm2.fmu", "Arm3.fmu"]
    for one, other in zip(*both, strict=True):
        assert one.read_bytes() == other.read_bytes()


RUBBING = zivi.symbolic.system(
    "a", T="adot**2/2", V="9.81*a", gaps={"floor": "a"}, e=0.6, friction={"pads": ("adot", "2.0")}
)


@pytest.mark.parametrize(
    ("asked", "error", "words"),
    [
        ({"y0": None}, TypeError, "y0 must be"),
        ({"y0": ([0.1], [0.0])}, ValueError, r"q0 must have shape \(2,\)"),
        ({"y0": ([1.5, 0.0], [0.0, 0.0])}, ValueError, "must be >= 0 at the start"),
        ({"name": "a b"}, ValueError, "name must be a letter"),
        ({"fmi": 4}, ValueError, "fmi must be 2 or 3"),
        ({"model": RUBBING, "y0": ([1.0], [0.0])}, ValueError, "mechanism do not support friction"),
        ({"model": "mass"}, TypeError, "y0 is for a mechanical system"),
        ({"model": "mass", "y0": None, "name": "A"}, TypeError, "name is for a mechanical system"),
    ],
)
def test_what_is_asked_for_is_checked(tmp_path, asked, error, words):
    with pytest.raises(error, match=words):
        zivi.export_fmu(tmp_path, **({"model": arm(), "y0": START} | asked))
    assert not list(tmp_path.iterdir())


@pytest.mark.skipif(importlib.util.find_spec("fmpy") is None, reason="no fmpy")
def test_an_importer_validates_and_simulates_it_without_zivi(tmp_path):
    zivi.export_fmu(tmp_path, arm(), y0=START, name="Arm")
    run = zivi.simulate(arm(), (0, 1.2), START, CLOSE)
    for problems, *q in simulated_elsewhere(tmp_path, 1.2, 1e-2, ("q_upper", "q_fore")):
        assert not problems
        assert q == pytest.approx(run.q[-1], abs=1e-7)


def test_a_step_that_is_too_long_is_refused(tmp_path):
    """A pendulum turns 1e15 times."""
    pendulum = zivi.symbolic.system("x", T="xdot**2/2", V="-cos(x)", gaps=["x + 9"])
    for fmi, system, start in ((2, pendulum, ([1.0], [0.0])), (3, arm(), START)):
        unit = unit_of(tmp_path, fmi, system, start).start()
        assert unit.step(0.0, 1e16) == 3
        assert "more than 1e5 steps" in unit.told[-1][1]
        assert unit.get("time") == 0.0
        assert unit.step(0.0, 1.0) == 0
        unit.free()
