"""The C library: as its users meet it, and bit by bit against the Python package."""

from __future__ import annotations

import ctypes
import os
import platform
import re
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import numpy as np
import pytest

import zivi
from c_header import Header

ROOT = Path(__file__).resolve().parent.parent
PREFIX = ROOT / "python" / "zivi" / "_native"
LIBRARY = PREFIX / "lib" / "libzivi.a"
HEADER = Header(ROOT / "include" / "zivi.h")
LINUX = sys.platform.startswith("linux")

pytestmark = [
    pytest.mark.xdist_group("c-library"),
    pytest.mark.skipif(sys.platform == "win32", reason="a compiler with the options of gcc"),
]


@pytest.fixture(scope="module")
def compiled(tmp_path_factory: pytest.TempPathFactory) -> ctypes.CDLL:
    """Give the loops of ``tests/c/ticks.c``, linked with the static library."""
    assert LIBRARY.exists(), "python tools/native.py (make does it) builds the C library"
    path = tmp_path_factory.mktemp("c") / "ticks.so"
    source = ROOT / "tests" / "c" / "ticks.c"
    command = ["cc", "-std=c99", "-O2", "-fPIC", "-shared", f"-I{PREFIX / 'include'}", source]
    whole = [LIBRARY]
    if LINUX:
        whole = ["-Wl,--whole-archive", LIBRARY, "-Wl,--no-whole-archive"]
    subprocess.run([*command, *whole, "-o", path], check=True)
    library = ctypes.CDLL(str(path))
    library.zivi_message.restype = ctypes.c_char_p
    library.zivi_version.restype = ctypes.c_char_p
    library.fall.argtypes = [ctypes.c_void_p, ctypes.c_double, ctypes.c_void_p, ctypes.c_size_t]
    loops = ("track_rows", "regulate_rows", "observe_rows", "track_periods", "regulate_periods")
    for name in loops:
        getattr(library, name).argtypes = [ctypes.c_void_p] * 3 + [ctypes.c_size_t]
    return library


def initialised(library: ctypes.CDLL, kind: str, **settings: float) -> ctypes.Structure:
    """Give a structure of this kind with these settings."""
    config = HEADER.structures[f"zivi_{kind}_config"]()
    assert getattr(library, f"zivi_{kind}_defaults")(ctypes.byref(config)) == 0
    for name, value in settings.items():
        setattr(config, name, value)
    it = HEADER.structures[f"zivi_{kind}"]()
    code = getattr(library, f"zivi_{kind}_init")(ctypes.byref(it), ctypes.byref(config))
    assert code == 0, library.zivi_message(code)
    return it


def rows(function: ctypes._CFuncPtr, it: ctypes.Structure, draws: np.ndarray, width: int):
    """Put draws through one of the loops."""
    given, out = np.ascontiguousarray(draws), np.empty((len(draws), width))
    function(ctypes.addressof(it), given.ctypes.data, out.ctypes.data, len(draws))
    return out


def same(a: np.ndarray, b: np.ndarray) -> bool:
    """Whether two arrays have the same bits."""
    return np.array_equal(np.asarray(a).view(np.int64), np.asarray(b).view(np.int64))


@pytest.mark.slow
def test_as_its_users_meet_it() -> None:
    done = subprocess.run(
        ["sh", ROOT / "tools" / "c-test.sh", PREFIX], capture_output=True, text=True, check=False
    )
    print(done.stdout)
    assert done.returncode == 0, done.stdout + done.stderr


@pytest.mark.slow
@pytest.mark.skipif(not LINUX, reason="nm of binutils")
def test_a_function_that_can_panic_does_not_link() -> None:
    target = Path(os.environ.get("CARGO_TARGET_DIR", ROOT / "target")).resolve()
    command = "cargo rustc --locked --quiet --profile bare --package zivi-c --crate-type staticlib"
    features = ["--features", "target,canary", "--target-dir", str(target)]
    subprocess.run([*command.split(), *features], check=True, cwd=ROOT)
    # of the archive of rustc itself: nm tells of the compiler's routines too, with warnings
    archive = target / "bare" / "libzivi_c.a"
    found = subprocess.run(["nm", archive], capture_output=True, text=True, check=False).stdout
    assert " U zivi_panic_is_reachable" in found
    assert " T zivi_canary" in found
    ours = subprocess.run(["nm", LIBRARY], capture_output=True, text=True, check=True).stdout
    assert " T zivi_tracker_step" in ours
    assert "panic" not in ours


def draws_of(kind: str, n: int, rng: np.random.Generator) -> np.ndarray:
    """Draw rows x, xdot, x_ref, xdot_ref, force, force_ref."""
    force = -np.abs(rng.normal(9.81, 3.0, (n, 2)))
    if kind == "wide":
        position = np.abs(rng.normal(0.0, 3.0, (n, 2)))
        velocity = rng.normal(0.0, 5.0, (n, 2))
    elif kind == "near":
        position = np.abs(rng.normal(0.0, 1e-4, (n, 2))) * rng.integers(0, 2, (n, 2))
        velocity = rng.normal(0.0, 1e-2, (n, 2))
    else:  # the wall is crossed within the period
        position = np.abs(rng.normal(0.0, 1e-3, (n, 2)))
        velocity = -np.abs(rng.normal(0.0, 4.0, (n, 2)))
    return np.column_stack([position[:, 0], velocity[:, 0], position[:, 1], velocity[:, 1], force])


VARIANTS = {
    "plain": ({}, {"landing": True}),
    "nearest": ({"branch": 1}, {"branch": "nearest", "landing": True}),
    "paper": ({"tick": 1}, {"landing": False}),
    "quiet": (
        {"horizon": 3.0, "shift": 1, "press": 15.0, "ahead": 2},
        {"horizon": 3.0, "shift": True, "press": 15.0, "ahead": 2, "landing": True},
    ),
    "dead zone": ({"quiet": 0.02}, {"quiet": 0.02, "landing": True}),
}


@pytest.mark.parametrize("kind", ["wide", "near", "fast"])
@pytest.mark.parametrize("variant", VARIANTS)
def test_the_tracker_has_the_bits_of_python(compiled: ctypes.CDLL, kind: str, variant: str) -> None:
    n = 8_500  # 1e5 in all
    draws = draws_of(kind, n, np.random.default_rng([7, len(kind), len(variant)]))
    draws[::9, 2:4] = 0.0  # the reference rests: the landing
    members, arguments = VARIANTS[variant]
    settings = {"mu1": 30.0, "mu2": 17.0, "h": 1e-3, "kappa": 0.41}
    it = initialised(compiled, "tracker", e_ref=0.5, **members, **settings)
    twin = zivi.TwistingTracker(**settings, e_ref=0.5, **arguments)
    expected = np.empty((n, 3))
    for row, (x, xdot, x_ref, xdot_ref, force, force_ref) in zip(
        expected, draws.tolist(), strict=True
    ):
        twin.reset(x_ref, xdot_ref)
        row[0] = twin.step(x, xdot, force, force_ref)
        row[1:] = twin.x_ref, twin.xdot_ref
    found = rows(compiled.track_rows, it, draws, 5)
    assert same(found[:, :3], expected)
    assert np.all(found[:, 3] == 0)
    assert found[:, 4].max() <= 64
    if kind == "fast":
        assert found[:, 4].max() > 3  # the cubic was met


@pytest.mark.parametrize(
    ("tick", "landing", "quiet"), [(0, True, 0.0), (0, True, 1e-3), (1, False, 0.0)]
)
def test_the_regulator_has_the_bits_of_python(
    compiled: ctypes.CDLL, tick: int, landing: bool, quiet: float
) -> None:
    settings = {"mu1": 3.0, "mu2": 2.0, "h": 1e-3, "e": 0.5, "quiet": quiet}
    it = initialised(compiled, "regulator", tick=tick, u_min=-4.5, u_max=-0.5, **settings)
    twin = zivi.TwistingRegulator(**settings, landing=landing, u_limits=(-4.5, -0.5))
    rng = np.random.default_rng(3)
    draws = np.concatenate(
        [draws_of(kind, 1000, rng)[:, [0, 1, 4]] for kind in ("wide", "near", "fast")]
    )
    draws[::17, 0] = -1e-9
    draws[::19, 1] = np.inf
    found = rows(compiled.regulate_rows, it, draws, 2)
    refused = 0
    for (x, xdot, force), (u, code) in zip(draws.tolist(), found.tolist(), strict=True):
        try:
            expected = twin.step(x, xdot, force)
            assert code == int(twin.status)
        except ValueError:
            refused += 1
            assert code == HEADER.constants["ZIVI_E_XDOT"]
            expected = twin.u or -0.5  # none was sent: 0, which the limits cut
        assert u == expected
    assert refused == 158


def periods(n: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Draw lengths of periods and measured states, a third of them missing (NaN)."""
    x = np.abs(rng.normal(0.0, rng.choice([1e-4, 0.1, 3.0], n)))
    x[rng.random(n) < 0.3] = np.nan
    dt, xdot = 1e-3 * rng.uniform(0.05, 8.0, n), rng.normal(0.0, 3.0, n)
    return np.column_stack([dt, x, xdot]), np.isnan(x)


@pytest.mark.parametrize("variant", VARIANTS)
def test_other_periods_and_missing_samples_have_the_bits_of_python(
    compiled: ctypes.CDLL, variant: str
) -> None:
    n = 2000
    rng = np.random.default_rng([8, len(variant)])
    sampled, missing = periods(n, rng)
    force = -np.abs(rng.normal(9.81, 3.0, (n, 2)))
    given = np.abs(rng.normal(0.0, 1.0, (n, 6)))
    given[:, [1, 4]] = rng.normal(0.0, 3.0, (n, 2))
    given[:, [2, 5]] = rng.choice([-1.0, 1.0], (n, 2))
    given[::11, [0, 1, 3, 4]] = 0.0  # rests
    given[rng.random(n) < 0.5, 2] = 0.0  # its own reference
    members, arguments = VARIANTS[variant]
    settings = {"mu1": 30.0, "mu2": 17.0, "h": 1e-3, "kappa": 0.41}
    it = initialised(compiled, "tracker", **members, **settings)
    twin = zivi.TwistingTracker(**settings, **arguments)
    draws = np.column_stack([sampled, force, given])
    found = rows(compiled.track_periods, it, draws, 10)
    expected = np.zeros((n, 10))
    for row, draw, lost in zip(expected, draws.tolist(), missing, strict=True):
        dt, x, xdot, force_, drive, *way = draw
        sample = (None, None) if lost else (x, xdot)
        if way[2] == 0.0:
            row[0] = twin.step(*sample, force_, drive, dt=dt)
        else:
            row[0] = twin.step_to(*sample, force_, tuple(way[:3]), tuple(way[3:]), drive, dt=dt)
        row[1:3] = twin.x_ref, twin.xdot_ref
        row[4:] = twin.signs
    assert missing.sum() > 500
    assert same(found, expected)
    assert it.ticks == n
    assert it.h == 1e-3


@pytest.mark.parametrize("landing", [True, False])
def test_the_regulators_other_periods_have_the_bits_of_python(
    compiled: ctypes.CDLL, landing: bool
) -> None:
    rng = np.random.default_rng(9)
    sampled, missing = periods(3000, rng)
    settings = {"mu1": 3.0, "mu2": 2.0, "h": 1e-3, "e": 0.5}
    it = initialised(compiled, "regulator", tick=0 if landing else 1, **settings)
    twin = zivi.TwistingRegulator(**settings, landing=landing)
    draws = np.column_stack([sampled, rng.normal(0.0, 0.3, 3000)])
    found = rows(compiled.regulate_periods, it, draws, 4)
    expected = np.zeros_like(found)
    for row, (dt, x, xdot, force), lost in zip(expected, draws.tolist(), missing, strict=True):
        row[0] = twin.step(*((None, None) if lost else (x, xdot)), force, dt=dt)
        row[2:] = twin.signs
    assert missing.sum() > 500
    assert same(found, expected)
    # no time, no tick
    draws[0, 0] = 0.0
    before = it.ticks, it.u
    refused = rows(compiled.regulate_periods, it, draws[:1], 4)
    assert refused[0, 1] == HEADER.constants["ZIVI_E_DT"]
    assert (it.ticks, it.u) == before
    assert it.h == 1e-3


@pytest.mark.parametrize("position_only", [False, True])
def test_the_observer_has_the_bits_of_python(compiled: ctypes.CDLL, position_only: bool) -> None:
    settings = {"h": 1e-2, "q_d": 1e-4, "se": 0.02, "dmax": 8.0}
    noise = {"noise_x": 1e-3, "noise_xdot": 2e-2}
    it = initialised(compiled, "observer", e=0.6, position_only=position_only, **settings, **noise)
    deviations = 1e-3 if position_only else (1e-3, 2e-2)
    twin = zivi.ImpactObserver(0.6, noise=deviations, position_only=position_only, **settings)
    ball = zivi.ImpactSystem(-9.81 + 1.5, e=0.6)
    times = np.linspace(0.0, 6.0, 601)
    run = zivi.simulate(ball, (0, 6), (1, 2), t_eval=times)
    rng = np.random.default_rng(1)
    draws = np.zeros((len(times), 4))
    draws[:, 0] = run.x + 1e-3 * rng.normal(size=len(times))
    draws[:, 1] = run.xdot + 2e-2 * rng.normal(size=len(times))
    draws[:, 2] = -9.81
    draws[300:306, 0] += 1.0  # refused, and then taken
    found = rows(compiled.observe_rows, it, draws, 4)
    assert not found[:, 3].any()
    for row, (x, xdot, force, u) in zip(found.tolist(), draws.tolist(), strict=True):
        assert row[:3] == list(twin.step(x, None if position_only else xdot, force, u))
    assert it.refused > 3


@pytest.mark.parametrize("wall", [{"kappa": 0.41}, {"e": 0.3}])
def test_the_mass_has_the_bits_of_simulate(compiled: ctypes.CDLL, wall: dict[str, float]) -> None:
    run = zivi.simulate(
        zivi.ImpactSystem(-9.81, **wall), (0, 3), (1, 6), method=zivi.ThetaGamma(1e-3)
    )
    it = initialised(compiled, "mass", h=1e-3, **wall)
    compiled.zivi_mass_reset.argtypes = [ctypes.c_void_p, ctypes.c_double, ctypes.c_double]
    assert compiled.zivi_mass_reset(ctypes.addressof(it), 1.0, 6.0) == 0
    out = np.empty((3000, 4))
    compiled.fall(ctypes.addressof(it), -9.81, out.ctypes.data, len(out))
    rows = run.transformed.s, run.transformed.v, run.x, run.xdot
    for column, row in enumerate(rows):
        assert same(out[:, column].copy(), row[1:]), column
    assert it.x == it.xdot == 0.0


@pytest.mark.parametrize("delay", [0, 1, 5, 64])
def test_a_predictor_before_a_tracker_has_the_bits_of_python(
    compiled: ctypes.CDLL, delay: int
) -> None:
    """A mass that bounces, clamped and refused samples among them; controls that wait act later."""
    settings = {"mu1": 30.0, "mu2": 17.0, "h": 1e-3, "kappa": 0.41}
    ours = zivi.TwistingTracker(**settings, delay=delay)
    it = initialised(compiled, "tracker", **settings)
    before = initialised(compiled, "predictor", delay=delay, h=1e-3, kappa=0.41)
    number, u = ctypes.c_double, ctypes.c_double()
    it_ref, before_ref, u_ref = ctypes.byref(it), ctypes.byref(before), ctypes.byref(u)
    nothing, force_ref = number(float("nan")), number(-8.0)
    step = compiled.zivi_tracker_step_over
    assert compiled.zivi_tracker_reset(it_ref, number(0.3), number(0.2)) == 0
    ours.reset(0.3, 0.2)
    for _ in range(delay):  # the reference as far ahead
        assert step(it_ref, number(1e-3), nothing, nothing, number(0), force_ref, u_ref) == 0
    mass, waiting, rng = (0.4, 1.0), [0.0] * delay, np.random.default_rng(delay)
    for k in range(2500):
        noise = rng.normal(0.0, 1e-5)
        x, xdot = mass[0] + noise - (1.0 if k % 97 == 0 else 0.0), mass[1]
        try:
            expected = ours.step(x, xdot, -9.81, -8.0)
        except ValueError:
            expected = ours.u
        seen = compiled.zivi_predictor_step(before_ref, number(x), number(xdot), number(-9.81))
        assert seen == (HEADER.constants["ZIVI_E_X"] if k % 97 == 0 else int(x < 0))
        if seen >= 0:
            then = number(before.x), number(before.xdot)
            assert compiled.zivi_tracker_step(it_ref, *then, number(-9.81), force_ref, u_ref) == 0
        assert compiled.zivi_predictor_send(before_ref, u) == 0
        assert u.value == expected, k
        waiting.append(expected)
        run = zivi.simulate(zivi.ImpactSystem(-9.81 + waiting.pop(0), e=0.5), (0, 1e-3), mass)
        mass = float(run.x[-1]), float(run.xdot[-1])
    refused = initialised(compiled, "predictor", delay=delay, h=1e-3, kappa=0.41)
    assert compiled.zivi_predictor_reset(before_ref) == 0
    assert bytes(refused) == bytes(before)
    config = HEADER.structures["zivi_predictor_config"]()
    compiled.zivi_predictor_defaults(ctypes.byref(config))
    config.h, config.e, config.delay = 1e-3, 0.5, 65
    code = compiled.zivi_predictor_init(before_ref, ctypes.byref(config))
    assert code == HEADER.constants["ZIVI_E_DELAY"]


def test_the_header_and_the_library_agree(compiled: ctypes.CDLL) -> None:
    listed = subprocess.run(["nm", "-g", LIBRARY], capture_output=True, text=True, check=True)
    symbols = {line.split()[-1].lstrip("_") for line in listed.stdout.splitlines() if " T " in line}
    assert symbols == HEADER.functions
    for kind in ("mass", "regulator", "tracker", "observer", "predictor"):
        size = ctypes.sizeof(HEADER.structures[f"zivi_{kind}"])
        assert getattr(compiled, f"zivi_{kind}_size")() == size
    assert compiled.zivi_abi_version() == HEADER.constants["ZIVI_ABI_VERSION"]
    assert compiled.zivi_version().decode() == zivi.__version__
    cargo = tomllib.loads((ROOT / "Cargo.toml").read_text())
    assert cargo["workspace"]["package"]["version"] == zivi.__version__


def test_every_code_has_words_of_its_own(compiled: ctypes.CDLL) -> None:
    codes = {name: code for name, code in HEADER.constants.items() if name.startswith("ZIVI_E_")}
    words = {name: compiled.zivi_message(code).decode() for name, code in codes.items()}
    assert len(set(words.values())) == len(codes) == len(set(codes.values()))
    unknown = compiled.zivi_message(-1000)
    for name, said in words.items():
        assert said.encode() != unknown, name
        setting = name.removeprefix("ZIVI_E_").lower()
        if codes[name] <= -10 and setting not in ("setting", "u", "noise"):
            assert said.startswith(setting), name


@pytest.mark.skipif(
    shutil.which(os.environ.get("CBINDGEN", "cbindgen")) is None, reason="no cbindgen"
)
def test_the_header_is_what_cbindgen_makes(tmp_path: Path) -> None:
    subprocess.run(["sh", ROOT / "tools" / "header.sh", tmp_path], check=True)
    for path in tmp_path.iterdir():
        assert path.read_text() == (ROOT / "include" / path.name).read_text(), path.name


@pytest.mark.skipif(platform.machine() not in ("x86_64", "AMD64"), reason="of another machine")
def test_the_library_is_one_small_object() -> None:
    assert LIBRARY.stat().st_size < 80_000


def test_without_tools_the_microcontrollers_are_skipped_with_a_reason() -> None:
    done = subprocess.run(
        ["/bin/sh", ROOT / "tools" / "embedded.sh"],
        env={**os.environ, "ARM_GCC": "no-such-gcc"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 77
    assert "skipped: no no-such-gcc" in done.stdout


@pytest.mark.slow
def test_the_tutorial_runs_as_it_stands(tmp_path: Path) -> None:
    text = (ROOT / "docs" / "tutorial_target.md").read_text()
    (program,) = re.findall(r"```c\n(.*?)```", text, re.DOTALL)
    (tmp_path / "target.c").write_text(program)
    script = "".join(re.findall(r"```python\n(.*?)```", text, re.DOTALL))
    told = subprocess.run(
        [sys.executable, "-c", script], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert told.returncode == 0, told.stderr
    expected = re.findall(r"^\s*print\(.*\)  # (.*)$", text, re.MULTILINE)
    assert [line for line in told.stdout.splitlines() if line] == expected
