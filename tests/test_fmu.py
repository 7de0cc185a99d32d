"""FMUs: what the standard asks for, and the bits of the Python package."""

from __future__ import annotations

import ctypes as c
import importlib.util
import itertools
import json
import subprocess
import sys
import zipfile
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import zivi
from fmu_unit import Archive, Unit
from inside import MODELS

DATA = Path(__file__).parent / "data" / "fmi"
H = 1e-3

pytestmark = pytest.mark.xdist_group("fmu")


@pytest.fixture(scope="module")
def exported(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("fmus")
    zivi.export_fmu(folder)
    return folder


@pytest.fixture(scope="module")
def archives(exported: Path, tmp_path_factory: pytest.TempPathFactory) -> dict:
    found = {}
    for (key, model), fmi in itertools.product(MODELS.items(), (2, 3)):
        folder = tmp_path_factory.mktemp(f"{key}{fmi}")
        found[key, fmi] = Archive(exported / f"{model.name}{fmi}.fmu", folder)
    return found


@pytest.mark.slow
@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="a compiler and valgrind")
def test_every_call_and_every_mistake_of_an_importer() -> None:
    root = Path(__file__).resolve().parent.parent
    command = ["sh", root / "tools" / "fmu-test.sh", root / "python" / "zivi" / "_native", "quick"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode == 77:
        pytest.skip(done.stdout)
    assert done.returncode == 0, done.stdout + done.stderr


BOTH = pytest.mark.parametrize("fmi", [2, 3])
EACH = pytest.mark.parametrize(("key", "fmi"), list(itertools.product(MODELS, (2, 3))))


@pytest.mark.slow
@pytest.mark.skipif(importlib.util.find_spec("fmpy") is None, reason="no fmpy")
def test_an_importer_validates_and_simulates_them_without_zivi(exported: Path) -> None:
    script = Path(__file__).parent / "fmu_alone.py"
    done = subprocess.run(
        [sys.executable, "-P", script, exported], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    told = json.loads(done.stdout.splitlines()[-1])
    assert set(told["problems"]) == {
        f"{model.name}{fmi}.fmu" for model in MODELS.values() for fmi in (2, 3)
    }
    assert not any(told["problems"].values()), told["problems"]
    for name in ("ImpactingMass", "TwistingLoop"):
        assert told["runs"][f"{name}2.fmu"] == told["runs"][f"{name}3.fmu"]
    rows = told["runs"]["ImpactingMass3.fmu"]
    t, x, xdot = np.array([[float.fromhex(v) for v in row] for row in rows]).T
    ball = zivi.ImpactSystem(-9.81, e=0.41843971631205673)
    run = zivi.simulate(ball, (0, 3), (1, 6), method=zivi.ThetaGamma(H))
    assert np.array_equal(x, run.x)
    assert np.array_equal(xdot, run.xdot)
    assert t[np.nonzero((x == 0.0) & (xdot == 0.0))[0][0]] == pytest.approx(2.444, abs=1e-9)
    loop = native_loop(3.0)
    x = np.array([float.fromhex(row[1]) for row in told["runs"]["TwistingLoop3.fmu"]])
    assert np.array_equal(x, loop.x)


def native_loop(end: float, delay: int = 0) -> zivi.ClosedLoop:
    """Give the loop of the same scheme in the package, with a whole number of periods."""
    plant = zivi.ImpactSystem(-9.81, e=0.5)
    tracker = zivi.TwistingTracker(30, 17, h=H, e=0.5)
    return zivi.simulate_closed_loop(
        plant,
        tracker,
        (0, end),
        (6, 5),
        y_ref0=(3, 3),
        force_ref=-19.81,
        delay=delay,
        method=zivi.ThetaGamma(H),
    )


@EACH
def test_starts_are_what_the_description_says(archives: dict, key: str, fmi: int) -> None:
    unit = Unit(archives[key, fmi])
    kinds = ["Real", "Integer", "Boolean"] if fmi == 2 else ["Float64", "Int32", "Boolean"]
    variables = unit.archive.variables
    assert list(variables) == [it.name for it in MODELS[key].variables]
    assert [reference for _, reference, _ in variables.values()] == list(range(len(variables)))
    for name, (kind, reference, attributes) in variables.items():
        if "start" in attributes:
            text = attributes["start"]
            start = text == "true" if kind == "Boolean" else float(text)
            assert unit.get(name) == start, name
        for other in kinds:
            assert unit.try_get(other, reference) == (0 if other == kind else 3), (name, other)
    for reference in (len(variables), 40, 1000, 2**32 - 1):
        assert [unit.try_get(kind, reference) for kind in kinds] == [3, 3, 3]
    assert all("no variable of this type" in words for _, words in unit.told)
    unit.free()


@EACH
def test_what_may_not_be_set_is_refused(archives: dict, key: str, fmi: int) -> None:
    unit = Unit(archives[key, fmi]).start()
    for name, (_, _, attributes) in unit.archive.variables.items():
        before = unit.get(name)
        allowed = attributes["causality"] == "input"
        assert unit.set(**{name: 0.25}) == (0 if allowed else 3), name
        if not allowed:
            assert unit.get(name) == before or attributes["causality"] == "output"
    assert unit.initialise() == 3  # not now
    assert unit.call("Terminate") == 0
    assert unit.step(0.0, H) == 3
    assert unit.call("Reset") == 0
    assert unit.step(0.0, H) == 3
    assert unit.initialise() == 0
    assert unit.told
    unit.free()


@BOTH
@pytest.mark.parametrize(
    ("key", "setting", "words"),
    [
        ("mass", {"e": 1.5}, "e must be in (0, 1]"),
        ("mass", {"e": 0.0}, "e must be"),
        ("mass", {"x0": -1.0}, "x must be"),
        ("mass", {"h": float("nan")}, "h must be"),
        ("regulator", {"mu2": 31.0}, "mu2 must be"),
        ("regulator", {"ahead": 0}, "ahead"),
        ("tracker", {"x_ref0": -1.0}, "x_ref must be"),
        ("tracker", {"horizon": 0.5}, "horizon must be"),
        ("loop", {"bound": 12.0}, "mu2"),
        ("loop", {"u_min": 1.0, "u_max": 0.5}, "u_max must be"),
    ],
    ids=lambda it: it if isinstance(it, str) else "-".join(it) if isinstance(it, dict) else None,
)
def test_bad_parameters_are_told(archives: dict, fmi: int, key: str, setting: dict, words: str):
    unit = Unit(archives[key, fmi])
    assert unit.set(**setting) == 0
    assert unit.initialise() == 3
    assert unit.told[-1][0] == 3
    assert words in unit.told[-1][1]
    unit.free()


@BOTH
def test_communication_steps_that_are_no_multiple(archives: dict, fmi: int) -> None:
    for key in ("regulator", "tracker", "loop"):
        unit = Unit(archives[key, fmi]).start()
        assert unit.step(0.0, 1.5 * H) == 3
        assert "multiple of h" in unit.told[-1][1]
        for length in (0.0, -H, float("nan"), float("inf")):
            assert unit.step(0.0, length) == 3
        assert unit.get("time") == 0.0
        assert unit.step(0.0, 3 * H) == 0
        assert unit.get("time") == 3 * H
        unit.free()
    # a mass makes equal steps that fit: three in 2.5 h
    unit = Unit(archives["mass", fmi]).start(x0=1.0, xdot0=6.0)
    assert unit.step(0.0, 2.5e-3) == 0
    ball = zivi.ImpactSystem(-9.81, e=0.5)
    run = zivi.simulate(ball, (0, 2.5e-3), (1, 6), method=zivi.ThetaGamma(2.5e-3 / 3))
    assert unit.get("x") == run.x[-1]
    unit.free()


@BOTH
def test_a_force_lifts_the_mass_off(archives: dict, fmi: int) -> None:
    unit = Unit(archives["mass", fmi]).start(x0=1.0, xdot0=6.0, e=0.41843971631205673)
    for k in range(3000):
        unit.step(k * H, H)
    assert unit.get("at_rest") == 1
    unit.set(u=12.0)
    for k in range(3000, 4000):
        unit.step(k * H, H)
    # x = (12 - 9.81)/2 after a second, less h/2 of velocity by the implicit steps
    assert unit.get("x") == pytest.approx(1.095, abs=2e-3)
    assert unit.get("at_rest") == 0
    unit.free()


def through(unit: Unit, steps: range) -> list[tuple[float, ...]]:
    """Step and read everything that can be read."""
    rows = []
    inputs = [
        name
        for name, (_, _, it) in unit.archive.variables.items()
        if it["causality"] == "input" and name in ("x", "xdot", "u", "disturbance")
    ]
    for k in steps:
        assert unit.set(**{name: 0.3 + 0.2 * np.sin(0.05 * k) for name in inputs}) == 0
        before = tuple(map(unit.get, unit.archive.variables))
        assert unit.step(k * H, H) in (0, 1)
        rows.append((before, *map(unit.get, unit.archive.variables)))
    return rows


@EACH
def test_a_state_that_is_set_or_stored_goes_on(archives: dict, key: str, fmi: int) -> None:
    unit = Unit(archives[key, fmi]).start()
    fresh = Unit(archives[key, fmi]).start()
    first = through(unit, range(150))
    state = unit.state()
    rest = through(unit, range(150, 300))
    assert unit.restore(state) == 0
    assert through(unit, range(150, 300)) == rest
    data = unit.stored(state)
    other = Unit(archives[key, fmi])
    status, copy = other.unstored(data)
    assert status == 0
    assert other.restore(copy) == 0
    assert through(other, range(150, 300)) == rest
    assert other.unstored(data[:-1])[0] == 3
    assert other.unstored(bytes([9]) + data[1:])[0] == 3
    assert unit.call("Reset") == 0
    assert unit.initialise() == 0
    assert through(unit, range(150)) == through(fresh, range(150)) == first
    for it, kept in ((unit, state), (other, copy)):
        assert it.free_state(kept) == 0
        assert kept.value is None
        assert it.free_state(kept) == 0  # NULL
        it.free()
    fresh.free()


@BOTH
def test_many_instances_and_none(archives: dict, fmi: int) -> None:
    archive = archives["tracker", fmi]
    units = [Unit(archive).start(mu2=17.0 - 0.1 * k) for k in range(100)]
    rows = [[] for _ in units]
    for k in range(5):
        for row, unit in zip(rows, units, strict=True):
            row.extend(through(unit, range(k, k + 1)))
    alone = Unit(archive).start(mu2=17.0 - 0.1 * 63)
    assert through(alone, range(5)) == rows[63]
    assert rows[63] != rows[64]
    for unit in [*units, alone]:
        unit.free()
    prefix = f"fmi{fmi}"
    getattr(archive.library, f"{prefix}FreeInstance")(None)
    for name in ("Reset", "Terminate", "DoStep", "EnterInitializationMode"):
        assert getattr(archive.library, f"{prefix}{name}")(None) == 3


@BOTH
def test_arrays_that_are_null_misaligned_or_short(archives: dict, fmi: int) -> None:
    unit = Unit(archives["mass", fmi])
    names = ("Real", "Integer", "Boolean") if fmi == 2 else ("Float64", "Int32", "Boolean")
    references = (c.c_uint32 * 2)(0, 1)
    places = (c.c_double * 4)()
    odd = c.c_void_p(c.addressof(places) + 1)
    for name, access in itertools.product(names, ("Get", "Set")):
        wrong = [(references, None), (None, places), (None, None), (c.c_void_p(1), places)]
        wrong += [(references, odd)] if name not in ("Boolean",) or fmi == 2 else []
        for first, second in wrong:
            room = (c.c_size_t(1),) if fmi == 3 else ()
            status = unit.call(f"{access}{name}", first, c.c_size_t(1), second, *room)
            assert (status, unit.told[-1][1]) == (3, "an array is NULL or not aligned")
        room = (c.c_size_t(0),) if fmi == 3 else ()
        assert unit.call(f"{access}{name}", None, c.c_size_t(0), None, *room) == 0
        if fmi == 3:
            status = unit.call(f"{access}{name}", references, c.c_size_t(2), places, c.c_size_t(1))
            assert (status, unit.told[-1][1]) == (3, "there are less values than references")
    s = "S" if fmi == 3 else "s"
    for place in (None, c.c_void_p(1)):
        for name in (f"GetFMU{s}tate", f"SetFMU{s}tate"):
            assert unit.call(name, place) == 3
        assert unit.call(f"SerializedFMU{s}tateSize", None, place) == 3
    # any byte of C is a truth value
    if fmi == 3:
        boolean = next(it for it in archives["tracker", 3].variables.values() if it[0] == "Boolean")
        other = Unit(archives["tracker", 3])
        given, back = c.c_uint8(7), c.c_uint8(9)
        place = (c.c_uint32 * 1)(boolean[1])
        one = c.c_size_t(1)
        if other.call("SetBoolean", place, one, c.byref(given), one) == 0:
            assert other.call("GetBoolean", place, one, c.byref(back), one) == 0
            assert back.value == 1


@BOTH
def test_a_step_from_another_time_than_the_one_reached_is_refused(archives: dict, fmi: int) -> None:
    unit = Unit(archives["mass", fmi]).start(h=H)
    reached = 0.0
    for _ in range(3):
        for wrong in (reached + H, reached - H, reached + 1e-4 * H, np.nan, np.inf, -np.inf):
            assert unit.step(wrong, H) == 3
            assert unit.told[-1][1] == "the communication point must be the time that was reached"
            assert unit.get("time") == reached
        assert unit.step(np.nextafter(reached, 1.0), H) == 0
        reached = unit.get("time")
    state = unit.state()
    assert unit.step(3 * H, H) == 0
    assert unit.restore(state) == 0
    assert unit.step(4 * H, H) == 3
    assert unit.step(3 * H, H) == 0
    assert unit.free_state(state) == 0


@BOTH
def test_a_token_of_another_version_is_refused(archives: dict, fmi: int) -> None:
    archive = archives["mass", fmi]
    token, archive.token = archive.token, b"zivi-impacting-mass-0"
    try:
        with pytest.raises(AssertionError):
            Unit(archive)
    finally:
        archive.token = token


def two_units(archives: dict, fmi: int, read_first: bool, steps: int) -> np.ndarray:
    """Close the loop of two FMUs: read the control before the step, or after it."""
    mass = Unit(archives["mass", fmi]).start(x0=6.0, xdot0=5.0)
    start = {"x_ref0": 3.0, "xdot_ref0": 3.0, "force_ref": -19.81}
    tracker = Unit(archives["tracker", fmi]).start(**start)
    rows, u = [], 0.0
    for k in range(steps):
        x, xdot = mass.get("x"), mass.get("xdot")
        tracker.set(x=x, xdot=xdot)
        if read_first:
            u = tracker.get("u")
        rows.append((x, xdot, u))
        mass.set(u=u)
        assert mass.step(k * H, H) == tracker.step(k * H, H) == 0
        if not read_first:
            u = tracker.get("u")
    mass.free()
    tracker.free()
    return np.array(rows).T


@pytest.mark.filterwarnings("ignore:a landing may never rest")
@BOTH
@pytest.mark.parametrize("read_first", [True, False])
def test_the_order_of_an_importer_decides_on_the_delay(
    archives: dict, fmi: int, read_first: bool
) -> None:
    found = two_units(archives, fmi, read_first, 2000)
    loop = native_loop(2.0, delay=0 if read_first else 1)
    for row, name in zip(found, ("x", "xdot", "u"), strict=True):
        assert np.array_equal(row, getattr(loop, name)[:2000]), name


@BOTH
def test_the_loop_in_one_unit_is_the_native_one(archives: dict, fmi: int) -> None:
    start = {"x0": 6.0, "xdot0": 5.0, "x_ref0": 3.0, "xdot_ref0": 3.0, "force_ref": -19.81}
    unit = Unit(archives["loop", fmi]).start(**start)
    names = ("x", "xdot", "x_ref", "xdot_ref", "u")
    rows = []
    for k in range(2000):
        rows.append([unit.get(name) for name in names])
        assert unit.step(k * H, H) == 0
    loop = native_loop(2.0)
    for row, name in zip(np.array(rows).T, names, strict=True):
        assert np.array_equal(row, getattr(loop, name)[:2000]), name
    unit.free()


@BOTH
def test_the_observer_has_the_bits_of_python(archives: dict, fmi: int) -> None:
    unit = Unit(archives["observer", fmi]).start(dmax=8.0, q_d=1e-4)
    twin = zivi.ImpactObserver(0.5, H, q_d=1e-4, dmax=8.0)
    run = native_loop(1.0)
    u = 0.0
    for k, (x, xdot) in enumerate(zip(run.x.tolist(), run.xdot.tolist(), strict=True)):
        unit.set(x=x, xdot=xdot, u=u)
        expected = twin.step(x, xdot, -9.81, u)
        assert [unit.get(name) for name in ("x_est", "xdot_est", "d_est")] == list(expected)
        assert unit.step(k * H, H) == 0
        u = float(run.u[k])
    unit.free()


@BOTH
def test_the_observer_learns_the_restitution(archives: dict, fmi: int) -> None:
    given = {"learn_e": True, "q_e": 1e-6, "se": 0.05, "e": 0.45}
    unit = Unit(archives["observer", fmi]).start(**given)
    twin = zivi.ImpactObserver(h=H, **given)
    times = np.arange(0, 1.5, H)
    run = zivi.simulate(zivi.ImpactSystem(-9.81, e=0.5), (0, 1.5), (1, 0), t_eval=times)
    for k, (x, xdot) in enumerate(zip(run.x.tolist(), run.xdot.tolist(), strict=True)):
        unit.set(x=x, xdot=xdot, u=0.0)
        twin.step(x, xdot, -9.81, 0.0)
        assert [unit.get(name) for name in ("e_est", "e_std")] == [twin.e_est, twin.e_std]
        assert unit.step(k * H, H) == 0
    assert unit.get("e_est") == pytest.approx(0.5, abs=1e-3)
    assert unit.get("e_std") < 1e-2
    unit.free()
    assert Unit(archives["observer", fmi]).start(e=0.3).get("e_est") == 0.3


@BOTH
@pytest.mark.parametrize("key", ["regulator", "tracker", "loop"])
def test_the_dead_zone_has_the_bits_of_python(archives: dict, key: str, fmi: int) -> None:
    gains = {"mu1": 30.0, "mu2": 17.0, "h": H, "e": 0.5, "quiet": 0.05}
    unit = Unit(archives[key, fmi]).start(**gains, **({"x0": 0.3} if key == "loop" else {}))
    if key == "loop":
        plant, tracker = zivi.ImpactSystem(-9.81, e=0.5), zivi.TwistingTracker(**gains)
        run = zivi.simulate_closed_loop(
            plant, tracker, (0, 1), (0.3, 0), force_ref=-9.81, method=zivi.ThetaGamma(H)
        )
        for k in range(999):
            assert unit.get("u") == run.u[k]
            assert unit.step(k * H, H) == 0
        unit.free()
        return
    kind = zivi.TwistingRegulator if key == "regulator" else zivi.TwistingTracker
    twin = kind(**gains)
    loud = kind(**(gains | {"quiet": 0.0}))
    rng = np.random.default_rng(4)
    heard = 0
    for k in range(200):
        x, xdot = abs(rng.normal(0, 1e-4)), rng.normal(0, 0.05)
        unit.set(x=x, xdot=xdot, force=-9.81)
        u = unit.get("u")
        assert u == twin.step(x, xdot, -9.81)
        heard += u != loud.step(x, xdot, -9.81)
        assert unit.step(k * H, H) == 0
    assert heard > 50
    unit.free()


@BOTH
def test_a_refused_sample_is_a_warning(archives: dict, fmi: int) -> None:
    unit = Unit(archives["tracker", fmi]).start(x_ref0=1.0)
    unit.set(x=1.0)
    u = unit.get("u")
    assert unit.step(0.0, H) == 0
    reference = unit.get("x_ref")
    unit.set(x=float("nan"))
    assert unit.step(H, H) == 1
    assert unit.get("u") == u
    assert unit.get("x_ref") == reference
    assert unit.get("status") < 0
    assert unit.told[-1] == (1, "x must be finite and at most depth behind the wall")
    unit.free()


def test_exports_are_the_same_byte_by_byte(exported: Path, tmp_path: Path) -> None:
    for path in zivi.export_fmu(tmp_path):
        assert path.read_bytes() == (exported / path.name).read_bytes()
        with zipfile.ZipFile(path) as archive:
            assert archive.testzip() is None
            assert {it.date_time[0] for it in archive.infolist()} == {1980}


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="nm of binutils")
def test_the_functions_of_both_standards_and_no_others(archives: dict) -> None:
    (binary,) = {Path(it.library._name) for it in [archives["mass", 3]]}
    listed = subprocess.run(
        ["nm", "-D", "--defined-only", binary], capture_output=True, text=True, check=True
    ).stdout
    found = {line.split()[-1] for line in listed.splitlines()}
    assert found == set((DATA / "functions.txt").read_text().split())
    needed = subprocess.run(
        ["nm", "-D", "--undefined-only", binary], capture_output=True, text=True, check=True
    ).stdout
    names = {line.split()[-1].split("@")[0] for line in needed.splitlines() if " U " in line}
    memory = {"memcpy", "memmove", "memset", "memcmp", "bcmp", "strlen", "calloc", "free"}
    assert names <= memory


def test_what_is_asked_for_is_checked(tmp_path: Path) -> None:
    assert [it.name for it in zivi.export_fmu(tmp_path / "new", ["loop", "loop"], 3)] == [
        "TwistingLoop3.fmu"
    ]
    with pytest.raises(ValueError, match="model must be one of mass, regulator, tracker"):
        zivi.export_fmu(tmp_path, "ball")
    with pytest.raises(ValueError, match="fmi must be 2 or 3, got 1"):
        zivi.export_fmu(tmp_path, "mass", 1)
    with pytest.raises(TypeError, match="fmi"):
        zivi.export_fmu(tmp_path, "mass", "2")
    with pytest.raises(TypeError, match="model"):
        zivi.export_fmu(tmp_path, 3)


def test_without_the_binaries_it_says_how_to_build_them(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(
        "zivi.interop.fmu.export.__file__",
        str(tmp_path / "zivi" / "interop" / "fmu" / "archive.py"),
    )
    with pytest.raises(FileNotFoundError, match=r"tools/native\.py"):
        zivi.export_fmu(tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_the_command_line(tmp_path: Path) -> None:
    from zivi.cli import app

    told = CliRunner().invoke(app, ["fmu", "--out", str(tmp_path), "--model", "mass", "--fmi", "2"])
    assert told.exit_code == 0, told.output
    assert [it.name for it in tmp_path.iterdir()] == ["ImpactingMass2.fmu"]
    told = CliRunner().invoke(app, ["fmu", "--out", str(tmp_path), "--model", "ball"])
    assert told.exit_code == 2


def test_a_system_of_the_user_is_refused_by_its_name(tmp_path):
    linear = zivi.LinearSystem(1.0, None, 1.0)
    for system in (zivi.ImpactSystem(-9.81, e=0.5), linear):
        with pytest.raises(TypeError, match=f"model must be a .*got {type(system).__name__}"):
            zivi.export_fmu(tmp_path, system)
    assert not list(tmp_path.iterdir())


def test_a_controller_of_the_user_is_refused_with_the_reason(tmp_path):
    tracker = zivi.TwistingTracker(30, 17, h=1e-3, e=0.5)
    with pytest.raises(TypeError, match=r"runs without Python.*got a controller, TwistingTracker"):
        zivi.export_fmu(tmp_path, tracker)

    class Mine:
        h = 1e-3

        def step(self, x, xdot, force):
            return -force

    for given in (Mine, Mine()):
        with pytest.raises(TypeError, match=r"runs without Python.*got a controller, Mine$"):
            zivi.export_fmu(tmp_path, given)
