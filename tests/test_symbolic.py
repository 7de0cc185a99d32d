"""Systems derived from energies: against formulas by hand, differences, and each other."""

import itertools
import os
import pickle
import subprocess
import sys
import threading
from pathlib import Path

import numpy as np
import pytest
import sympy

import zivi
from inside import (
    _check_curvatures,
    _check_gradients,
    _check_rates,
    _Look,
    base_machine_code as native,
)
from mechanical_models import MODELS, MULTI, NDOF, compiled, model, multi_case, ndof_case

pytestmark = pytest.mark.xdist_group("mechanical models")

PENDULUM = {
    "q": "phi",
    "T": "m*l**2*phidot**2/2",
    "V": "-m*g*l*cos(phi)",
    "gaps": ["l*sin(phi) + d"],
    "parameters": {"m": 2.0, "l": 0.5, "g": 9.81, "d": 0.1},
    "e": 0.6,
}


@pytest.fixture(scope="module")
def pendulum():
    return zivi.symbolic.system(**PENDULUM)


CASES = [(ndof_case, name) for name in NDOF] + [(multi_case, name) for name in MULTI]


@pytest.mark.parametrize(("case", "name"), CASES, ids=lambda it: getattr(it, "__name__", it))
def test_derivatives_of_the_gaps_against_differences(case, name):
    system, (t0, end), (q0, w0) = case(name)
    q, w = np.array(q0) + 0.05, np.array(w0) - 0.3
    built = system.model(len(q))
    look = _Look(built)
    t = t0 + 0.3 * (end - t0)
    here = look(t, q, w)
    _check_gradients(system, look, t, q, here)
    _check_rates(system, look, (t, end), q, here)
    _check_curvatures(system, look, (t, end), q)


def test_the_double_pendulum_against_its_formulas():
    par = {key: NDOF["dpend"]["par"][key] for key in ("m1", "m2", "l1", "l2", "G", "cd", "d")}
    m1, m2, l1, l2, G, cd, d = par.values()
    a, b, u, v = 0.7, -0.4, 1.3, 0.8
    here = model("dpend", par, 0.5).at(0.0, [a, b], [u, v])
    c = m2 * l1 * l2 * np.cos(a - b)
    assert here.mass == pytest.approx(np.array([[(m1 + m2) * l1**2, c], [c, m2 * l2**2]]))
    s = m2 * l1 * l2 * np.sin(a - b)
    force = [
        -s * v**2 - (m1 + m2) * G * l1 * np.sin(a) - cd * u,
        s * u**2 - m2 * G * l2 * np.sin(b) - cd * v,
    ]
    assert here.force == pytest.approx(np.array(force), rel=1e-14)
    assert here.gaps == pytest.approx([l1 * np.sin(a) + l2 * np.sin(b) + d])
    assert here.gradients[0] == pytest.approx([l1 * np.cos(a), l2 * np.cos(b)])
    assert here.curvatures == pytest.approx([-l1 * np.sin(a) * u**2 - l2 * np.sin(b) * v**2])


def test_the_force_keeps_the_energy():
    # d/dt (T + V) = 0 with M qdd = F: without damping, by differences along the motion
    par = NDOF["dpend"]["par"] | {"cd": 0.0}
    names = ("m1", "m2", "l1", "l2", "G", "cd", "d")
    system = model("dpend", {key: par[key] for key in names}, 0.5)

    def energy(q, w):
        here = system.at(0.0, q, w)
        m1, m2, l1, l2, G = (par[key] for key in names[:5])
        height = -(m1 + m2) * G * l1 * np.cos(q[0]) - m2 * G * l2 * np.cos(q[1])
        return w @ here.mass @ w / 2 + height

    q, w = np.array([0.7, -0.4]), np.array([1.3, 0.8])
    here = system.at(0.0, q, w)
    a = np.linalg.solve(here.mass, here.force)
    h = 1e-5
    change = energy(q + h * w, w + h * a) - energy(q - h * w, w - h * a)
    assert abs(change / (2 * h)) < 1e-8


def test_moving_frames_and_explicit_time():
    # a mass on a slide that is shaken: T = m (x' + W'(t))^2/2 gives F = -m W''
    system = zivi.symbolic.system(
        "x",
        T="m*(xdot + A*om*cos(om*t))**2/2",
        gaps=["x - B*t**2"],
        parameters={"m": 2.0, "A": 0.3, "om": 5.0, "B": 0.7},
        e=0.5,
    )
    here = system.at(0.4, [1.0], [0.5])
    assert here.force == pytest.approx([2.0 * 0.3 * 25 * np.sin(2.0)])
    assert here.rates == pytest.approx([-2 * 0.7 * 0.4])
    assert here.curvatures == pytest.approx([-2 * 0.7])


def test_coordinates_as_functions_symbols_and_names(pendulum):
    from sympy.physics.mechanics import dynamicsymbols

    m, length, g, d = sympy.symbols("m l g d", positive=True)
    phi = dynamicsymbols("phi")
    rate = phi.diff()
    values = {m: 2.0, length: 0.5, g: 9.81, d: 0.1}
    by_function = zivi.symbolic.system(
        [phi],
        T=m * length**2 * rate**2 / 2,
        V=-m * g * length * sympy.cos(phi),
        gaps=[length * sympy.sin(phi) + d],
        parameters=values,
        e=0.6,
    )
    angle, omega = sympy.symbols("phi omega")
    by_symbol = zivi.symbolic.system(
        [angle],
        qdot=[omega],
        T=m * length**2 * omega**2 / 2,
        V=-m * g * length * sympy.cos(angle),
        gaps={"wall": length * sympy.sin(angle) + d},
        parameters=values,
        e=0.6,
    )
    assert by_symbol.gap_names == ("wall",)
    row = [
        system.model(1).evaluate(0.0, np.array([0.3]), np.array([0.7]))
        for system in (pendulum, by_function, by_symbol)
    ]
    assert np.array_equal(row[0], row[1])
    assert np.array_equal(row[0], row[2])


def test_numba_and_c_agree(pendulum):
    pytest.importorskip("numba")
    other = zivi.symbolic.system(**PENDULUM, compiler="numba")
    state = 0.0, np.array([0.3]), np.array([0.7])
    rows = [system.model(1).evaluate(*state) for system in (pendulum, other)]
    assert rows[0] == pytest.approx(rows[1], rel=1e-15)


def test_parameters_change_without_compiling(pendulum, monkeypatch):
    monkeypatch.setattr(native, "_compile", None)  # whoever compiles fails
    other = pendulum.replace(l=1.0, e=0.1)
    assert (other.parameters["l"], pendulum.parameters["l"]) == (1.0, 0.5)
    assert (other.e.tolist(), pendulum.e.tolist()) == ([0.1], [0.6])
    assert other.at(0, [0.0], [0.0]).mass == pytest.approx(2.0)
    other.parameters["m"] = 3.0
    assert other.at(0, [0.0], [0.0]).mass == pytest.approx(3.0)
    copy = pickle.loads(pickle.dumps(other))
    assert dict(copy.parameters) == dict(other.parameters)
    assert copy.at(0, [0.2], [0.1]).force == other.at(0, [0.2], [0.1]).force
    assert repr(copy) == repr(other)


@pytest.mark.parametrize(
    ("name", "value", "error"),
    [("mass", 1.0, KeyError), ("m", np.nan, ValueError), ("m", "1", TypeError)],
)
def test_bad_parameters(pendulum, name, value, error):
    with pytest.raises(error, match=name):
        pendulum.parameters[name] = value
    with pytest.raises(error, match=name):
        pendulum.replace(**{name: value})


@pytest.mark.parametrize(
    ("change", "told"),
    [
        ({"parameters": {"m": 1.0, "l": 0.5, "g": 9.81}}, "has d, which is no"),
        ({"T": "m*phidot**3"}, "quadratic"),
        ({"V": "m*g*cos(phi"}, "V must be an expression"),
        ({"gaps": {"wall": "d +* phi"}}, "gap 'wall' must be an expression"),
        ({"gaps": ["phi + phidot", "d*l*m*g"]}, "got velocities"),
        ({"Q": [0, 0]}, "each of the 1 coordinates"),
        ({"Q": {"x": 1}}, "has unknown coordinate x"),
        ({"q": "phi phi"}, "phi"),
        ({"q": "t"}, "t: a name"),
        ({"qdot": ["a", "b"]}, "qdot must have 1"),
        ({"e": 1.5}, r"e\[0\] must be in \[0, 1\]"),
        ({"compiler": "fortran"}, "compiler must be one of"),
        ({"V": "zeta(phi)*m*g*l*d"}, "unknown function zeta"),
        ({"V": sympy.zeta(sympy.Symbol("phi"))}, "compiled form"),
    ],
)
def test_what_is_wrong_is_named(change, told):
    with pytest.raises(ValueError, match=told):
        zivi.symbolic.system(**PENDULUM | change)


def test_without_any_compiler(monkeypatch):
    monkeypatch.setattr(native, "c_compiler", lambda: None)
    monkeypatch.setattr(native, "have", lambda name: False)
    with pytest.raises(RuntimeError, match="a C compiler or numba"):
        zivi.symbolic.system(**PENDULUM)


def test_a_cache_that_was_cut_short_or_cannot_be_written(tmp_path, monkeypatch, pendulum):
    monkeypatch.setenv("ZIVI_CACHE", str(tmp_path))
    first = native._by_c(pendulum.source)
    library = next(it for it in tmp_path.iterdir() if it.suffix != ".sha256")
    assert first.address
    # another process finds a library that is not one
    library.unlink()
    library.write_bytes(b"\x7fELF")
    code = "import sys; from zivi.base.machine_code import _by_c\n"
    code += "print(_by_c(sys.stdin.read()).function is not None)"
    done = subprocess.run(
        [sys.executable, "-c", code],
        input=pendulum.source,
        capture_output=True,
        text=True,
        check=True,
        env=os.environ | {"ZIVI_CACHE": str(tmp_path)},
    )
    assert done.stdout.strip() == "True"
    assert library.stat().st_size > 1000


def test_the_source_is_the_same_in_every_process():
    code = (
        "from mechanical_models import compiled;"
        "print(compiled('dpend', tuple('m1 m2 l1 l2 G cd d'.split())).source)"
    )
    sources = {
        subprocess.run(
            [sys.executable, "-c", code],
            capture_output=True,
            text=True,
            check=True,
            env=os.environ | {"PYTHONHASHSEED": seed},
            cwd=Path(__file__).parent,
        ).stdout
        for seed in ("1", "2")
    }
    assert len(sources) == 1


def test_threads_compile_once(monkeypatch):
    made = []
    monkeypatch.setattr(native, "_by_c", lambda source: made.append(source) or object())
    sources = {"c": "int once;", "numba": ""}
    threads = [threading.Thread(target=native.compile_model, args=(sources, "c")) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(made) == 1
    native._known.pop(("c", "int once;"))


def test_all_models_of_the_references_are_there():
    kinds = {case["problem"] for case in NDOF.values()}
    kinds |= {case["spec"]["model"] for case in MULTI.values()}
    assert kinds <= set(MODELS)
    assert compiled.cache_info().currsize <= len(MODELS)
    assert len(list(itertools.chain(NDOF, MULTI))) == 23


def test_a_run_tells_the_parameters_that_it_had():
    """The configuration is made when it is asked for, which may be after a change."""
    pendulum = zivi.symbolic.system(
        "a", T="l**2*adot**2/2", V="g*l*(1 - cos(a))", parameters={"l": 0.5, "g": 9.81}
    )
    sol = zivi.simulate(pendulum, (0, 0.1), ([0.3], [0.0]))
    pendulum.parameters["l"] = 2.0
    later = zivi.simulate(pendulum, (0, 0.1), ([0.3], [0.0]))
    assert (sol.config["parameters"]["l"], later.config["parameters"]["l"]) == (0.5, 2.0)
    assert "'l': 0.5" in sol.config["system"]
    assert "'l': 2.0" in later.config["system"]
    # the same compiled model with other numbers: a longer pendulum is slower
    assert abs(later.qdot[-1, 0]) < 0.5 * abs(sol.qdot[-1, 0])
    sol.config["parameters"]["l"] = 3.0
    assert zivi.simulate(pendulum, (0, 0.1), ([0.3], [0.0])).config["parameters"]["l"] == 2.0


def test_a_second_start_is_checked_again():
    """The checks of derivatives are once a system, those of the state are not."""
    ball = zivi.symbolic.system("x", T="xdot**2/2", V="9.81*x", gaps={"floor": "x**2"}, e=0.5)
    assert zivi.simulate(ball, (0, 0.1), ([1.0], [0.0])).success
    with pytest.raises(ValueError, match="gradient of gap 'floor' must not be zero"):
        zivi.simulate(ball, (0, 0.1), ([0.0], [0.0]))
    with pytest.raises(ValueError, match="q0 must be finite"):
        zivi.simulate(ball, (0, 0.1), ([np.nan], [0.0]))
    wall = zivi.symbolic.system("x", T="xdot**2/2", V="9.81*x", gaps={"floor": "x - 1"}, e=0.5)
    assert zivi.simulate(wall, (0, 0.1), ([2.0], [0.0])).success
    with pytest.raises(ValueError, match=r"gap 'floor' must be >= 0 at the start, got -0\.5"):
        zivi.simulate(wall, (0, 0.1), ([0.5], [0.0]))
    with pytest.raises(ValueError, match="force must be finite"):
        zivi.simulate(_infinite(), (0, 0.1), ([0.0], [0.0]))


def _infinite():
    system = zivi.symbolic.system("x", T="xdot**2/2", V="log(x)", gaps={"floor": "x + 1"}, e=0.5)
    assert zivi.simulate(system, (0, 0.01), ([1.0], [0.0])).success
    return system
