"""The shared library for programs in C and C++: the numbers of the package."""

from __future__ import annotations

import ctypes as c
import os
import runpy
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import zivi
from c_header import Header

ROOT = Path(__file__).resolve().parent.parent
HEADER = Header(ROOT / "include" / "zivi_host.h")
FORCE = c.CFUNCTYPE(c.c_int32, c.c_void_p, *[c.c_double] * 3, c.POINTER(c.c_double))
MAP = c.CFUNCTYPE(c.c_int32, c.c_void_p, c.c_size_t, c.POINTER(c.c_double), c.POINTER(c.c_double))
EVALUATION = c.CFUNCTYPE(c.c_int32, c.c_void_p, c.c_double, *[c.POINTER(c.c_double)] * 3)
DOUBLES = c.POINTER(c.c_double)

pytestmark = [
    pytest.mark.slow,
    pytest.mark.xdist_group("host-library"),
    pytest.mark.skipif(not sys.platform.startswith("linux"), reason="options of gcc on Linux"),
]


class System(c.Structure):
    """``zivi_system``."""

    _fields_ = [
        ("size", c.c_uint32),
        ("reserved", c.c_uint32),
        ("e", c.c_double),
        ("kappa", c.c_double),
        ("force", c.c_double),
        ("function", FORCE),
        ("user", c.c_void_p),
    ]


class Impact(c.Structure):
    """``zivi_impact``."""

    _fields_ = [("t", c.c_double), ("xdot_before", c.c_double), ("xdot_after", c.c_double)]


class Method(c.Structure):
    """``zivi_method``."""

    _fields_ = [
        ("size", c.c_uint32),
        ("reserved", c.c_uint32),
        ("h", c.c_double),
        ("rtol", c.c_double),
        ("atol", c.c_double),
        ("max_step", c.c_double),
        ("t_eval", DOUBLES),
        ("n_eval", c.c_size_t),
    ]


class Mechanics(c.Structure):
    """``zivi_mechanics``."""

    _fields_ = [
        ("size", c.c_uint32),
        ("reserved", c.c_uint32),
        ("n", c.c_size_t),
        ("m", c.c_size_t),
        ("e", DOUBLES),
        ("function", EVALUATION),
        ("user", c.c_void_p),
    ]


class Problem(c.Structure):
    """``zivi_vi_problem``."""

    _fields_ = [
        ("size", c.c_uint32),
        ("reserved", c.c_uint32),
        ("n", c.c_size_t),
        ("lower", DOUBLES),
        ("upper", DOUBLES),
        ("map", MAP),
        ("jacobian", MAP),
        ("user", c.c_void_p),
        ("tol", c.c_double),
    ]


@pytest.fixture(scope="module")
def prefix(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Build the library, neither optimised nor for a debugger: it takes a third of the time.

    Where the extension was built in many units (`.ci/run`), from what that has compiled.
    """
    target = Path(os.environ.get("CARGO_TARGET_DIR", ROOT / "target")).resolve()
    command = "cargo rustc --locked --quiet --package zivi-host --lib --crate-type cdylib"
    plain, built = os.environ | {"CARGO_PROFILE_DEV_DEBUG": "0"}, "debug"
    if os.environ.get("CARGO_PROFILE_RELEASE_LTO") == "false":
        newer = runpy.run_path(str(ROOT / "tools" / "native.py"))["minor_version_of_cargo"]() >= 89
        command, built = f"{command} --release{' --features avx512' * newer}", "release"
        # what is compiled here alone
        for crate in ("zivi-host", "zivi-c"):
            command += f" --config profile.release.package.{crate}.opt-level=0"
    subprocess.run([*command.split(), "--target-dir", target], check=True, cwd=ROOT, env=plain)
    folder = tmp_path_factory.mktemp("host")
    shutil.copyfile(target / built / "libzivi_host.so", folder / "libzivi.so")
    return folder


@pytest.fixture(scope="module")
def library(prefix: Path) -> c.CDLL:
    return known(c.CDLL(str(prefix / "libzivi.so")))


def known(found: c.CDLL) -> c.CDLL:
    """Tell ctypes what the functions of the library take and give."""
    for name in ("zivi_last_error", "zivi_status_message", "zivi_vi_message"):
        getattr(found, name).restype = c.c_char_p
    found.zivi_run_rest_time.restype = c.c_double
    found.zivi_run_impacts.restype = c.POINTER(Impact)
    for name in ("zivi_run_column", "zivi_mechanical_column"):
        getattr(found, name).restype = DOUBLES
    for name in ("zivi_run_samples", "zivi_mechanical_samples"):
        getattr(found, name).restype = c.c_size_t
    found.zivi_simulate.argtypes = [c.c_void_p, c.c_void_p, *[c.c_double] * 4, c.c_void_p]
    found.zivi_simulate_mechanical.argtypes = [c.c_void_p] * 2 + [c.c_double] * 2 + [c.c_void_p] * 3
    return found


def system(**members: object) -> System:
    return System(size=c.sizeof(System), **members)


def simulate(library: c.CDLL, it: System, method: Method | None, end: float, start: tuple):
    """Give the code, the columns t, x, xdot and the time of rest."""
    run = c.c_void_p()
    how = None if method is None else c.byref(method)
    code = library.zivi_simulate(c.byref(it), how, 0.0, end, *start, c.byref(run))
    if code < 0:
        assert run.value is None
        return code, None, library.zivi_last_error().decode()
    n = library.zivi_run_samples(run)
    columns = [np.array(library.zivi_run_column(run, k)[:n]) for k in range(3)]
    rest = library.zivi_run_rest_time(run)
    assert not library.zivi_run_column(run, 5)
    library.zivi_run_free(run)
    return code, columns, rest


def test_the_examples(prefix: Path) -> None:
    strict = ["-Wall", "-Wextra", "-Wpedantic", "-Werror", f"-I{ROOT / 'include'}"]
    link = [f"-L{prefix}", "-lzivi", "-lm", f"-Wl,-rpath,{prefix}"]
    for compiler, source in (
        (["cc", "-std=c99"], "complementarity.c"),
        (["c++", "-std=c++17"], "ball.cpp"),
    ):
        if shutil.which(compiler[0]) is None:
            pytest.skip(f"no {compiler[0]}")
        program = prefix / source.partition(".")[0]
        path = ROOT / "examples" / "host" / source
        subprocess.run([*compiler, *strict, path, *link, "-o", program], check=True)
        told = subprocess.run([program], capture_output=True, text=True, check=False)
        assert told.returncode == 0, told.stdout + told.stderr


def test_the_header_and_the_library_agree(prefix: Path) -> None:
    listed = subprocess.run(
        ["nm", "-D", "--defined-only", prefix / "libzivi.so"],
        capture_output=True,
        text=True,
        check=True,
    )
    symbols = {line.split()[-1] for line in listed.stdout.splitlines() if " T zivi" in line}
    target = Header(ROOT / "include" / "zivi.h")
    assert symbols == HEADER.functions | target.functions


def test_runs_have_the_bits_of_the_package(library: c.CDLL) -> None:
    ball = zivi.ImpactSystem(-9.81, e=0.5)
    code, columns, rest = simulate(library, system(e=0.5, force=-9.81), None, 4.0, (1.0, 0.0))
    run = zivi.simulate(ball, (0, 4), (1, 0))
    assert code == 0
    assert rest == run.rest_time
    times = np.linspace(0.0, 3.0, 50)
    given = (c.c_double * 50)(*times)
    method = Method(c.sizeof(Method), rtol=1e-9, t_eval=c.cast(given, DOUBLES), n_eval=50)
    code, columns, _ = simulate(library, system(e=0.5, force=-9.81), method, 3.0, (1.0, 0.0))
    run = zivi.simulate(ball, (0, 3), (1, 0), method=zivi.SwitchedRK(rtol=1e-9), t_eval=times)
    for found, name in zip(columns, ("t", "x", "xdot"), strict=True):
        assert np.array_equal(found, getattr(run, name)), name

    def swing(_user, t, x, xdot, force):
        force[0] = -9.81 - 20.0 * x - 0.1 * xdot
        return 0

    method = Method(c.sizeof(Method), h=1e-3)
    it = system(kappa=0.41, function=FORCE(swing))
    code, columns, _ = simulate(library, it, method, 0.5, (1.0, 6.0))
    spring = zivi.ImpactSystem(lambda t, x, xdot: -9.81 - 20.0 * x - 0.1 * xdot, kappa=0.41)
    run = zivi.simulate(spring, (0, 0.5), (1, 6), method=zivi.ThetaGamma(1e-3))
    for found, name in zip(columns, ("t", "x", "xdot"), strict=True):
        assert np.array_equal(found, getattr(run, name)), name


@pytest.mark.parametrize("rtol", [1e-3, 1e-12])
def test_impacts_under_a_constant_force_are_exact_whatever_the_tolerances(library, rtol):
    e, run, count = 0.7, c.c_void_p(), c.c_size_t()
    first = np.sqrt(2.0 / 9.81)  # falls from 1 m
    ball, method = system(e=e, force=-9.81), Method(c.sizeof(Method), rtol=rtol, atol=rtol)
    code = library.zivi_simulate(c.byref(ball), c.byref(method), 0.0, 1.2, 1.0, 0.0, c.byref(run))
    assert code == 0
    impacts = library.zivi_run_impacts(run, c.byref(count))
    found = np.array([impacts[i].t for i in range(count.value)])
    library.zivi_run_free(run)
    exact = first * np.array([1.0, 1.0 + 2.0 * e])
    assert found.shape == exact.shape
    assert np.abs(found - exact).max() <= 4.0 * np.finfo(float).eps


def test_what_is_refused_is_told(library: c.CDLL) -> None:
    refused = {
        "e must lie in [0, 1], got 1.5": (system(e=1.5), None, (1.0, 0.0)),
        "e must lie in [0, 1], got NaN": (system(e=float("nan")), None, (1.0, 0.0)),
        "size is not": (System(size=8), None, (1.0, 0.0)),
        "rtol must be": (system(e=0.5), Method(c.sizeof(Method), rtol=2.0), (1.0, 0.0)),
        "t_eval must be NULL": (
            system(e=0.5),
            Method(c.sizeof(Method), h=1e-3, t_eval=(c.c_double * 1)(0.5), n_eval=1),
            (1.0, 0.0),
        ),
    }
    for words, (it, method, start) in refused.items():
        code, _, told = simulate(library, it, method, 4.0, start)
        assert code < 0
        assert words in told
    run = c.c_void_p()
    assert library.zivi_simulate(None, None, 0.0, 1.0, 1.0, 0.0, c.byref(run)) == -1
    library.zivi_run_free(None)
    assert library.zivi_run_samples(None) == 0
    assert np.isnan(library.zivi_run_rest_time(None))


def test_a_force_that_fails_keeps_what_was_computed(library: c.CDLL) -> None:
    def failing(_user, t, _x, _xdot, force):
        force[0] = -1.0
        return 1 if t > 0.5 else 0

    method = Method(c.sizeof(Method), h=1e-2)
    it = system(e=0.5, function=FORCE(failing))
    code, columns, _ = simulate(library, it, method, 4.0, (1.0, 0.0))
    assert code == int(zivi.Status.RAISED)
    assert 0.4 < columns[0][-1] <= 0.5
    assert b"exception" in library.zivi_status_message(code)


def test_variational_inequalities(library: c.CDLL) -> None:
    def murty(_user, n, z, f):
        for i in range(n):
            f[i] = z[i] - 1.0 + 2.0 * sum(z[j] for j in range(i + 1, n))
        return 0

    n = 6
    lower = (c.c_double * n)()
    z, report = (c.c_double * n)(*[0.5] * n), HEADER.structures["zivi_vi_report"]()
    problem = Problem(c.sizeof(Problem), n=n, lower=c.cast(lower, DOUBLES), map=MAP(murty))
    assert library.zivi_solve_vi(c.byref(problem), z, c.byref(report)) in (0, 1)
    # the solution of Murty's problem: one at the last component, zero before
    assert np.allclose(z[:], [0.0] * (n - 1) + [1.0], atol=1e-9)
    assert report.residual < 1e-9
    matrix = np.eye(n) + 2.0 * np.triu(np.ones((n, n)), 1)
    q = -np.ones(n)
    z = (c.c_double * n)()
    entries, constant = (c.c_double * n**2)(*matrix.ravel()), (c.c_double * n)(*q)
    code = library.zivi_solve_avi(c.byref(problem), entries, constant, z, None)
    assert code in (0, 1)
    expected = zivi.solve_avi(matrix, q, 0.0, np.inf, np.zeros(n)).x
    assert np.array_equal(z[:], expected)
    entries[3] = float("nan")
    assert library.zivi_solve_avi(c.byref(problem), entries, constant, z, None) == -50
    assert library.zivi_last_error() == b"matrix[3] must be finite, got NaN"
    problem.map = MAP(lambda *_: 1)
    assert library.zivi_vi_message(library.zivi_solve_vi(c.byref(problem), z, None)).startswith(
        b"the evaluation of F"
    )
    problem.n = 0
    assert library.zivi_solve_vi(c.byref(problem), z, None) == -50


def test_a_mechanical_system(library: c.CDLL) -> None:
    """Two coordinates above one wall: the second moves freely, the first bounces to rest."""

    def evaluate(_user, _t, q, _w, out):
        for k, value in enumerate([2.0, 0.0, 0.0, 1.0, -19.62, 0.5, q[0], 1.0, 0.0, 0.0, 0.0]):
            out[k] = value
        return 0

    e = (c.c_double * 1)(0.5)
    it = Mechanics(
        c.sizeof(Mechanics), n=2, m=1, e=c.cast(e, DOUBLES), function=EVALUATION(evaluate)
    )
    q, w, run = (c.c_double * 2)(1.0, 0.0), (c.c_double * 2)(0.0, 0.0), c.c_void_p()
    method = Method(c.sizeof(Method), rtol=1e-10)
    code = library.zivi_simulate_mechanical(
        c.byref(it), c.byref(method), 0.0, 3.0, q, w, c.byref(run)
    )
    assert code == 0, library.zivi_last_error()
    n = library.zivi_mechanical_samples(run)
    t = np.array(library.zivi_mechanical_column(run, 0)[:n])
    x = np.array(library.zivi_mechanical_column(run, 1)[: 3 * n]).reshape(n, 3)
    force = np.array(library.zivi_mechanical_column(run, 3)[:n])
    assert t[-1] == 3.0
    assert x[-1, 2] == 0.0  # the gap, closed
    assert x[-1, 1] == pytest.approx(0.25 * 9.0, abs=1e-8)
    assert force[-1] == pytest.approx(19.62)
    zeno = 3.0 * np.sqrt(2.0 / 9.81)
    first = t[np.nonzero(x[:, 2] == 0.0)[0]]
    assert np.min(np.abs(first - zeno)) < 1e-8
    library.zivi_mechanical_free(run)
    it.n = 0
    assert library.zivi_simulate_mechanical(c.byref(it), None, 0.0, 3.0, q, w, c.byref(run)) < 0


SHORT_OF_MEMORY = """
import ctypes as c, sys
import numpy as np
from test_host_library import DOUBLES, EVALUATION, MAP, Mechanics, Method, Problem, known, system
import zivi

lib, N, n = known(c.CDLL(sys.argv[1])), 1 << 14, 100
MEMORY, KEPT = -52, int(zivi.Status.OUT_OF_MEMORY)
D = lambda values: values.ctypes.data_as(DOUBLES)
times, e, one = np.linspace(0, 1, N), np.array([0.5]), np.array([1.0])
zeros, matrix, point = np.zeros(n), np.eye(n), np.zeros(n)

def evaluate(_user, _t, q, _w, out):
    for k, value in enumerate([1.0, -9.81, q[0], 1.0, 0.0, 0.0]):
        out[k] = value
    return 0

def shifted(_user, n, z, f):
    for i in range(n):
        f[i] = z[i] - 1.0
    return 0

def run(e=0.5, height=1.0, end=1.0, **how):
    it, how, handle = system(e=e, force=-9.81), Method(c.sizeof(Method), **how), c.c_void_p()
    code = lib.zivi_simulate(c.byref(it), c.byref(how), 0.0, end, height, 0.0, c.byref(handle))
    assert (handle.value is None) == (code < 0)
    lib.zivi_run_free(handle)
    return code

def moved():
    it = Mechanics(c.sizeof(Mechanics), n=1, m=1, e=D(e), function=model)
    how, handle = Method(c.sizeof(Method), t_eval=D(times), n_eval=N), c.c_void_p()
    code = lib.zivi_simulate_mechanical(
        c.byref(it), c.byref(how), 0.0, 1.0, D(one), D(zeros), c.byref(handle)
    )
    assert (handle.value is None) == (code < 0)
    lib.zivi_mechanical_free(handle)
    return code

def solved(affine):
    problem = Problem(c.sizeof(Problem), n=n, lower=D(zeros), map=function)
    point[:] = 0.0
    if affine:
        return lib.zivi_solve_avi(c.byref(problem), D(matrix), D(-np.ones(n)), D(point), None)
    return lib.zivi_solve_vi(c.byref(problem), D(point), None)

model, function = EVALUATION(evaluate), MAP(shifted)
malloc = c.CDLL(None)
malloc.fail_request.argtypes = [c.c_size_t, c.c_long]
CALLS = {
    "steps": lambda: run(h=1 / N),
    "samples": lambda: run(t_eval=D(times), n_eval=N),
    "impacts": lambda: run(e=1.0, height=1e-9, end=0.2),
    "mechanics": moved,
    "VI": lambda: solved(False),
    "affine VI": lambda: solved(True),
}
for name, call in CALLS.items():
    assert call() in (0, 1), name
    for k in range(1, 60):
        malloc.fail_request(1 << 15, k)
        code, left = call(), malloc.requests_left()
        malloc.fail_request(0, 0)
        if left > 0:  # there are no more
            assert k > 1 and code in (0, 1), (name, code)
            break
        assert code in (0, 1, MEMORY, KEPT), (name, k, code, lib.zivi_last_error())
        assert (b"memory" in lib.zivi_last_error()) or code != MEMORY
        print(name, k, code, flush=True)
"""


def test_every_large_allocation_may_fail(prefix: Path, tmp_path: Path) -> None:
    """A code, and a run where it is not below 0; the caller's program goes on."""
    failing = tmp_path / "failing.so"
    source = Path(__file__).parent / "c" / "failing_malloc.c"
    subprocess.run(["cc", "-O1", "-shared", "-fPIC", "-o", failing, source], check=True)
    done = subprocess.run(
        [sys.executable, "-c", SHORT_OF_MEMORY, prefix / "libzivi.so"],
        capture_output=True,
        text=True,
        check=False,
        cwd=Path(__file__).parent,
        env=os.environ | {"LD_PRELOAD": str(failing)},
    )
    assert done.returncode == 0, done.stdout[-200:] + done.stderr[-2000:]
    told = [line.rsplit(None, 2) for line in done.stdout.splitlines()]
    failed = {name for name, _, code in told if code == "-52"}
    assert failed == {"steps", "samples", "impacts", "VI", "affine VI"}
    kept = {name for name, _, code in told if code == str(int(zivi.Status.OUT_OF_MEMORY))}
    assert kept == {"samples", "impacts", "mechanics"}
