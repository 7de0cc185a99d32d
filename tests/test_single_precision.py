"""The C library in single precision beside that in doubles, in loops with a plant in doubles."""

from __future__ import annotations

import ctypes
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import zivi
from c_header import Header
from test_c_library import LIBRARY, LINUX, PREFIX, ROOT

SINGLE = LIBRARY.with_name("libzivi_f32.a")
SOURCES = ROOT / "tests" / "c"

pytestmark = [
    pytest.mark.xdist_group("c-library"),
    pytest.mark.skipif(sys.platform == "win32", reason="a compiler with the options of gcc"),
]


def members(name: str) -> list[str]:
    """Give the members of a structure of ``plant.h``, which are all doubles."""
    body = re.search(rf"typedef struct {{([^}}]*)}} {name};", (SOURCES / "plant.h").read_text())
    assert body is not None
    code = re.sub(r"/\*.*?\*/", "", body[1], flags=re.S)
    return [it.strip() for row in re.findall(r"double ([^;]*);", code) for it in row.split(",")]


def as_single(path: Path) -> str:
    """Give a C source for the library in single precision."""
    return subprocess.run(
        ["sed", "-f", ROOT / "tools" / "c" / "single.sed", path],
        capture_output=True,
        text=True,
        check=True,
    ).stdout


@pytest.fixture(scope="module")
def loops(tmp_path_factory: pytest.TempPathFactory) -> ctypes.CDLL:
    """Give the loops of ``tests/c/loops.c`` in both precisions, linked into one library."""
    folder = tmp_path_factory.mktemp("single")
    (folder / "loops_f32.c").write_text(as_single(SOURCES / "loops.c"))
    command = ["cc", "-std=c99", "-O2", "-fPIC", "-shared"]
    sources = [
        f"-I{PREFIX / 'include'}",
        f"-I{SOURCES}",
        SOURCES / "loops.c",
        folder / "loops_f32.c",
    ]
    subprocess.run(
        [*command, *sources, LIBRARY, SINGLE, "-lm", "-o", folder / "loops.so"], check=True
    )
    return ctypes.CDLL(str(folder / "loops.so"))


def ran(loops: ctypes.CDLL, call: str, **given: float) -> list[dict[str, float]]:
    """Run a loop in doubles and in single precision."""
    names = members({"track": "tracked_loop", "observe": "observed_loop"}[call])
    found = []
    for prefix in ("zivi_", "zivi_f32_"):
        numbers = np.array([given.get(name, 0.0) for name in names])
        getattr(loops, prefix + call)(ctypes.c_void_p(numbers.ctypes.data))
        found.append(dict(zip(names, numbers.tolist(), strict=True)))
    return found


def test_loops_that_rest_exactly_in_doubles_do_in_single_precision(loops: ctypes.CDLL) -> None:
    rng, late = np.random.default_rng(1), []
    while len(late) < 1000:
        h, mu1 = 10 ** rng.uniform(-4, -2), rng.uniform(15, 80)
        double, single = ran(
            loops,
            "track",
            mu1=mu1,
            mu2=mu1 * rng.uniform(0.3, 0.8),
            e=rng.uniform(0.1, 0.95),
            horizon=1.0,
            force=-9.81,
            force_ref=-rng.uniform(5, 15),
            h=h,
            x=rng.uniform(0, 2),
            xdot=rng.uniform(-3, 3),
            x_ref=rng.uniform(0.01, 1),
            xdot_ref=rng.uniform(-2, 2),
            periods=float(int(5 / h)),
        )
        assert double["code"] >= 0
        if not 0 <= double["rest"] < 4:
            continue
        assert single["rest"] >= 0, (double, single)
        assert single["u"] == pytest.approx(double["u"], abs=1e-6 * mu1)
        late.append(abs(single["rest"] - double["rest"]))
    assert np.median(late) < 3e-4
    assert max(late) < 0.4


def test_the_plant_of_these_loops_moves_as_that_of_the_library(loops: ctypes.CDLL) -> None:
    law = {"mu1": 30.0, "mu2": 17.0, "h": 1e-3, "e": 0.5}
    start = {"x": 1.2, "x_ref": 1.0, "force": -9.81, "force_ref": -7.0}
    double, _ = ran(loops, "track", **law, **start, horizon=1.0, periods=4000.0)
    run = zivi.simulate_closed_loop(
        zivi.ImpactSystem(-9.81, e=0.5),
        zivi.TwistingTracker(30, 17, h=1e-3, e=0.5),
        (0, 4),
        (1.2, 0),
        y_ref0=(1.0, 0),
        force_ref=-7.0,
    )
    moves = np.flatnonzero((run.x != 0) | (run.xdot != 0) | (run.x_ref != 0) | (run.xdot_ref != 0))
    assert run.t[moves[-1] + 1] == pytest.approx(double["rest"], abs=1.1e-3)


@pytest.mark.parametrize(
    ("rate", "horizon", "least", "most"),
    # by what factor the variation of u grows, as the page says
    [
        (1e3, 1.0, 0.9, 1.1),
        (1e4, 1.0, 2.0, 16.0),
        (1e4, 3.0, 1.1, 3.0),
        (1e4, 10.0, 1.0, 1.4),
        (1e5, 1.0, 150.0, 400.0),
        (1e5, 30.0, 2.0, 22.0),
    ],
)
def test_what_single_precision_costs_in_quietness(
    loops: ctypes.CDLL, rate: float, horizon: float, least: float, most: float
) -> None:
    for e in (0.3, 0.5, 0.8):
        start = {"x": 1.2, "x_ref": 1.0, "force": -9.81, "force_ref": -9.81}
        law = {"mu1": 40.0, "mu2": 22.0, "e": e, "horizon": horizon, "h": 1 / rate}
        double, single = ran(loops, "track", **law, **start, periods=rate, **{"from": 0.3})
        assert least <= single["variation"] / double["variation"] <= most, e
        assert single["error"] == pytest.approx(double["error"], rel=0.1)


@pytest.mark.parametrize("h", [1e-2, 1e-3, 1e-4])
@pytest.mark.parametrize("sigma", [1e-3, 1e-5])
def test_the_observer_is_as_good(loops: ctypes.CDLL, h: float, sigma: float) -> None:
    fall = {"e": 0.8, "force": -9.81, "unknown": 1.0, "x": 1.0}
    double, single = ran(loops, "observe", **fall, h=h, sigma=sigma, periods=3 / h)
    for name in ("of_xdot", "of_d", "refused"):
        assert single[name] == pytest.approx(double[name], rel=0.02), name
    assert double["of_d"] < 0.3


def test_its_header_is_that_of_doubles_and_its_names_are_its_own() -> None:
    path = ROOT / "include" / "zivi_f32.h"
    assert path.read_text() == as_single(ROOT / "include" / "zivi.h")
    assert "double" not in path.read_text()
    listed = subprocess.run(["nm", "-g", SINGLE], capture_output=True, text=True, check=True)
    symbols = {line.split()[-1].lstrip("_") for line in listed.stdout.splitlines() if " T " in line}
    assert symbols == Header(path).functions
    assert all(name.startswith("zivi_f32_") for name in symbols)


@pytest.mark.skipif(not LINUX, reason="nm of binutils")
def test_no_arithmetic_of_doubles_is_left(tmp_path: Path) -> None:
    subprocess.run(["ar", "x", SINGLE], cwd=tmp_path, check=True)
    (one,) = tmp_path.iterdir()
    done = subprocess.run(["objdump", "-d", one], capture_output=True, text=True, check=True)
    assert "mulss" in done.stdout
    assert not re.search(r"\s(add|sub|mul|div|sqrt|ucomi|cvtss2)sd\s", done.stdout)


def test_both_headers_go_into_one_program(tmp_path: Path) -> None:
    source = tmp_path / "both.c"
    source.write_text(
        '#include "zivi.h"\n#include "zivi_f32.h"\n'
        "int main(void) { return sizeof(zivi_tracker) <= sizeof(zivi_f32_tracker); }\n"
    )
    strict = ["-std=c99", "-Wall", "-Wextra", "-Wpedantic", "-Werror"]
    command = ["cc", *strict, f"-I{ROOT / 'include'}", source, "-o", tmp_path / "both"]
    subprocess.run(command, check=True)
    assert subprocess.run([tmp_path / "both"], check=False).returncode == 0
