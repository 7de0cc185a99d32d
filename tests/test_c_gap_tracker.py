"""The tracker of gaps as a C source: its controls are those of Python, in both precisions."""

import ctypes as c
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import zivi
from inside import reference_of
from mechanical_arms import START, tapping, tracker, turning_mass, two_links
from zivi import native

pytestmark = [
    pytest.mark.xdist_group("c-library"),
    pytest.mark.skipif(sys.platform == "win32", reason="a compiler with the options of gcc"),
]

H = 1e-3
BESIDE = (START + np.array([0.03, -0.02]), np.array([0.1, -0.1]))


class Compiled:
    """A source that was compiled with the library, as a controller of a closed loop."""

    def __init__(self, ctl, folder: Path, *, single: bool = False) -> None:
        self.h, (self.n, self.m) = ctl.h, (len(ctl.system.coordinate_names(0)), ctl.system.m)
        self.kind, self.code = (np.float32 if single else np.float64), 0
        (source := folder / "arm.c").write_text(
            native.gap_tracker_source(ctl, "arm", single=single), encoding="ascii"
        )
        prefix, library = native.prefix(), folder / "arm.so"
        archive = prefix / "lib" / ("libzivi_f32.a" if single else "libzivi.a")
        command = ["cc", "-std=c99", "-O2", "-Wall", "-Wextra", "-Werror", "-ffp-contract=off"]
        command += ["-fsingle-precision-constant"] if single else []
        command += ["-fPIC", "-shared", f"-I{prefix / 'include'}", source, archive, "-lm"]
        subprocess.run([*command, "-o", library], check=True)
        self.library = c.CDLL(str(library))
        number = c.c_float if single else c.c_double
        self.library.arm_step.argtypes = [c.c_void_p, number, *5 * [c.c_void_p]]
        self.object = c.create_string_buffer(self.library.arm_size())
        self.reset()

    def reset(self) -> None:
        assert self.library.arm_init(self.object) == 0

    def _sample(self, it):
        parts = (it.q, it.qdot, it.qddot, it.gaps, it.gap_rates, it.accelerations, it.sides)
        return np.concatenate([np.ravel(part) for part in (*parts, it.contacts)]).astype(self.kind)

    def _step(self, t, q, qdot, ends):
        u = np.zeros(self.n, self.kind)
        rows = [np.asarray(it, self.kind) for it in (q, qdot)]
        places = [it.ctypes.data for it in rows] + [
            None if it is None else it.ctypes.data for it in ends
        ]
        self.code = self.library.arm_step(self.object, t, *places, u.ctypes.data)
        return u.astype(np.float64)

    def step(self, t, q, qdot):
        return self._step(t, q, qdot, (None, None))

    def step_to(self, t, q, qdot, now, after):
        ends = self._sample(now), self._sample(after)
        return self._step(t, q, qdot, ends)

    @property
    def status(self):
        return max(self.code, 0)


def loop(ctl, system=None, start=BESIDE, end=1.5, **asked):
    asked = {"method": zivi.RKPeriod()} | asked
    return zivi.simulate_closed_loop(system or two_links(), ctl, (0, end), start, **asked)


@pytest.mark.parametrize(
    "settings",
    [{}, {"horizon": 3.0, "shift": True}, {"posture": (100.0, 15.0), "force": {}}],
    ids=["plain", "horizon", "landing's force"],
)
def test_its_controls_are_those_of_python_along_a_loop(tmp_path, settings):
    ctl = tracker(**settings)
    run = loop(ctl, reference=tapping())
    given = reference_of(tapping(), run.t, two_links().gap_names, START)
    target = Compiled(ctl, tmp_path)
    u = np.array(
        [
            target.step_to(t, run.q[k], run.qdot[k], given.sample(k), given.sample(k + 1))
            for k, t in enumerate(run.t[:-1].tolist())
        ]
    )
    assert run.latched[-1].all()
    # close to impacts the tracker divides rounding by the period
    assert np.abs(u - run.u[:-1]).max() < 1e-8 * np.abs(run.u).max()


def test_it_lands_presses_and_loses_contact_as_in_python(tmp_path):
    own = tracker(two_links().replace(m2=1.0), force={"floor": 0.4})
    runs = [loop(it, reference=None) for it in (Compiled(own, tmp_path), own)]
    assert np.abs(runs[0].q - runs[1].q).max() < 1e-9
    assert zivi.TickStatus.LATCH_LOST & runs[1].tick_status.max()
    assert np.array_equal(runs[0].tick_status, runs[1].tick_status)


def test_two_coupled_gaps_and_inputs_that_turn(tmp_path):
    system = turning_mass(floor="y", slope="x + y/4 - 1/10")
    own = zivi.GapTracker(
        system,
        h=H,
        gains={"floor": (40, 22), "slope": (30, 17)},
        force={"floor": 12.0, "slope": 7.0},
        u_limits=[(-300, 300), (-300, 300)],
    )
    start = ([0.3, 0.15], [0.2, 0.0])
    runs = [loop(it, system, start, 0.8, reference="rest") for it in (Compiled(own, tmp_path), own)]
    assert runs[1].contacts[-1].all()
    assert np.abs(runs[0].q - runs[1].q).max() < 1e-7
    assert runs[0].reactions[-1] == pytest.approx([12.0, 7.0], abs=1e-6)


def test_limits_cut_each_control(tmp_path):
    target = Compiled(tracker(u_limits=[(-20, 20), (-7, 7)]), tmp_path)
    run = loop(target, reference="rest")
    assert np.all(np.abs(run.u) <= [20, 7])
    assert run.tick_status.max() & zivi.TickStatus.SATURATED
    assert run.contacts[-1].all()


def test_samples_that_no_control_answers_hold_the_last_one(tmp_path):
    target = Compiled(tracker(), tmp_path)
    first = target.step(0.0, START, np.zeros(2))
    for q, qdot in (([np.nan, 0.0], [0.0, 0.0]), (START, [np.inf, 0.0]), (START, [1e308, 1e308])):
        assert np.array_equal(target.step(1e-3, q, qdot), first)
        assert target.code < 0 or target.code & zivi.TickStatus.REFUSED
    assert np.array_equal(target.step(2e-3, START, np.zeros(2)), first)


def test_single_precision_rests_exactly_and_presses(tmp_path):
    own = tracker(latch=(1e-5, 1e-2), horizon=3.0)
    run = loop(Compiled(own, tmp_path, single=True), reference=tapping())
    exact = loop(own, reference=tapping())
    bounced = slice(400, 900)
    assert run.contacts[-200:].all()
    assert abs(run.reactions[-1, 0] - 10.0) < 1e-3
    assert np.abs(run.q - exact.q).max() < 2e-4
    rms = np.sqrt(np.mean(run.error_gaps[bounced] ** 2))
    assert rms < 3e-5


def of_plane(**more):
    system = zivi.symbolic.system(
        "x y",
        T="(xdot**2 + ydot**2)/2",
        V="9.81*y",
        gaps={"floor": "y"},
        e=0.6,
        **({"inputs": np.eye(2)} | more),
    )
    return zivi.GapTracker(system, h=H, gains={"floor": (40, 22)})


@pytest.mark.parametrize(
    ("make", "error", "words"),
    [
        (lambda: 5, TypeError, r"controller must be a zivi\.GapTracker"),
        (lambda: tracker(delay=2), ValueError, "delay must not be set in C, got 2"),
        (lambda: tracker(learn_offset=True), ValueError, "learn_offset must not be set in C"),
        (lambda: tracker(tasks={"x": "cos(a)"}), ValueError, "tasks must not be set in C"),
        (
            lambda: of_plane(inputs={"f": [1, 0]}),
            ValueError,
            "as many controls as coordinates in C, 2; it has 1 gaps and 1 controls",
        ),
        (lambda: of_plane(inputs=lambda q: np.eye(2)), TypeError, "numbers or expressions in C"),
        (
            lambda: of_plane(friction={"pads": ("xdot", "2.0")}),
            ValueError,
            "must not have friction in C",
        ),
        (
            lambda: zivi.GapTracker(
                zivi.MechanicalSystem(
                    mass=1.0, force=[-9.81], gaps=[zivi.LinearGap([1])], e=0.5, inputs=[[1.0]]
                ),
                h=H,
                gains={"gap0": (30, 17)},
            ),
            TypeError,
            r"zivi\.symbolic\.system, whose formulas are known",
        ),
    ],
)
def test_what_has_no_source_in_c_is_told(make, error, words):
    with pytest.raises(error, match=words):
        native.gap_tracker_source(make())


def test_names_are_checked():
    with pytest.raises(ValueError, match="name must be a letter"):
        native.gap_tracker_source(tracker(), "1 arm")


def test_the_module_is_found_where_zivi_is():
    program = "import zivi; assert callable(zivi.native.gap_tracker_source), zivi.native"
    subprocess.run([sys.executable, "-c", program], check=True)
