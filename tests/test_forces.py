"""One law, five ways to give it; what a force does wrong reaches the caller."""

import ctypes
import functools
import math
import subprocess
import sys
import textwrap
import traceback

import numpy as np
import pytest
import scipy

import zivi
from zivi.base.functions import reads_time

K, C, G, A, W = 3.0, 0.2, 9.81, 14.0, 6.0
LINEAR = zivi.LinearForce(stiffness=K, damping=C, gravity=G, amplitude=A, omega=W)
DOUBLE = ctypes.c_double
PLAIN = ctypes.CFUNCTYPE(DOUBLE, DOUBLE, DOUBLE, DOUBLE)
WITH_DATA = ctypes.CFUNCTYPE(DOUBLE, DOUBLE, DOUBLE, DOUBLE, ctypes.c_void_p)
METHOD = zivi.ThetaGamma(h=0.01)


def law(t, x, xdot):
    return -K * x - C * xdot - G + A * math.cos(W * t)


def law_with_data(t, x, xdot, data):
    stiffness = ctypes.cast(data, ctypes.POINTER(DOUBLE))[0]
    return -stiffness * x - C * xdot - G + A * math.cos(W * t)


def numba_cfunc():
    numba = pytest.importorskip("numba")
    return numba.cfunc("float64(float64, float64, float64)")(law)


def low_level_with_data():
    data = ctypes.cast(ctypes.pointer(DOUBLE(K)), ctypes.c_void_p)
    return scipy.LowLevelCallable(WITH_DATA(law_with_data), data)


FORMS = {
    "callable": lambda: law,
    "object": lambda: LINEAR.__call__,
    "ctypes": lambda: PLAIN(law),
    "LowLevelCallable": lambda: scipy.LowLevelCallable(PLAIN(law)),
    "LowLevelCallable with data": low_level_with_data,
    "numba": numba_cfunc,
    "LowLevelCallable of numba": lambda: scipy.LowLevelCallable(numba_cfunc().ctypes),
}


def run(force, method=METHOD, t1=5.0):
    return zivi.simulate(zivi.ImpactSystem(force, e=0.6), (0, t1), (1, 0), method=method)


def test_the_wave_is_off_by_less_than_a_unit_in_the_last_place():
    mpmath = pytest.importorskip("mpmath")
    wave = zivi.LinearForce(amplitude=1.0, omega=1.0)
    rng = np.random.default_rng(7)
    near = rng.integers(-(10**6), 10**6, 2000) * np.pi / 2
    far = rng.choice([-1, 1], 2000) * 10.0 ** rng.uniform(-9, 12, 2000)
    with mpmath.workdps(60):
        for t in [*near.tolist(), *far.tolist(), *rng.uniform(-9, 9, 4000).tolist()]:
            exact = mpmath.cos(t)
            assert abs(wave(t, 0.0, 0.0) - exact) < np.spacing(abs(float(exact))), t


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("method", [METHOD, zivi.ExplicitEuler(h=0.001)], ids=repr)
def test_the_same_law_gives_the_same_run(form, method):
    """Apart from the order of its sums: each step's force agrees to its tolerance, 1e-12.

    Impacts multiply an error in the time of contact: 1e-10 is left of that.
    """
    reference, sol = run(LINEAR, method, 3.0), run(FORMS[form](), method, 3.0)
    assert sol.success, sol.message
    assert sol.nfev > sol.n_steps / 2
    np.testing.assert_allclose(sol.transformed.s, reference.transformed.s, atol=1e-10)
    np.testing.assert_allclose(sol.transformed.v, reference.transformed.v, atol=1e-10)
    assert len(sol.resolved_impacts) == len(reference.resolved_impacts)


class Law:
    def __call__(self, t, x, xdot):
        return law(t, x, xdot)

    def bound(self, t, x, xdot):
        return law(t, x, xdot)

    @classmethod
    def of_class(cls, t, x, xdot):
        return law(t, x, xdot)


CALLED = {
    "object": Law(),
    "bound method": Law().bound,
    "class method": Law.of_class,
    "partial": functools.partial(lambda _, t, x, xdot: law(t, x, xdot), None),
    "in C": functools.lru_cache(law),
    "f(t, y)": lambda t, y: law(t, y[0], y[1]),
}


@pytest.mark.parametrize("kind", CALLED)
def test_whatever_can_be_called_is_called_with_the_same_numbers(kind):
    sol, plain = run(CALLED[kind], zivi.SwitchedRK()), run(law, zivi.SwitchedRK())
    np.testing.assert_array_equal(sol.x, plain.x)
    assert sol.nfev == plain.nfev


def test_an_interpreter_that_does_not_tell_how_it_calls_gives_the_same_run():
    program = """
        import ctypes, math
        if {hidden}:
            ctypes.pythonapi = None
        import zivi
        for force in (
            lambda t, x, xdot: -9.81 + 14.0 * math.cos(6.0 * t),
            lambda t, y: -9.81 + 14.0 * math.cos(6.0 * t) - y[1],
        ):
            sol = zivi.simulate(zivi.ImpactSystem(force, e=0.6), (0, 5), (1, 0))
            print(sol.nfev, sol.x[-1].hex())
        try:
            zivi.simulate(zivi.ImpactSystem(lambda t, x, xdot: 1 / 0, e=0.6), (0, 5), (1, 0))
        except ZeroDivisionError:
            print("raised")
    """

    def told(hidden):
        text = textwrap.dedent(program).format(hidden=hidden)
        done = subprocess.run(
            [sys.executable, "-c", text], capture_output=True, text=True, check=True
        )
        return done.stdout

    assert told(hidden=True) == told(hidden=False)
    assert told(hidden=True).endswith("raised\n")


def test_a_number_is_a_constant_force():
    number = run(-9.81)
    for force in (lambda t, x, xdot: -9.81, zivi.LinearForce(gravity=9.81), np.float64(-9.81)):
        sol = run(force)
        np.testing.assert_array_equal(sol.transformed.s, number.transformed.s)
        np.testing.assert_array_equal(sol.transformed.v, number.transformed.v)
        assert sol.rest_time == number.rest_time


def test_integers_and_numpy_scalars_are_returned_as_well():
    plain = run(-9.0)
    for value in (-9, np.float64(-9), np.float32(-9), np.int64(-9), np.array(-9.0)):
        np.testing.assert_array_equal(
            run(lambda t, x, xdot, value=value: value).transformed.s, plain.transformed.s
        )


@pytest.mark.parametrize(
    "force",
    [
        ctypes.CFUNCTYPE(DOUBLE, DOUBLE, DOUBLE)(lambda t, x: 0.0),
        ctypes.CFUNCTYPE(ctypes.c_float, DOUBLE, DOUBLE, DOUBLE)(law),
        ctypes.CFUNCTYPE(None, DOUBLE, DOUBLE, DOUBLE)(lambda t, x, v: None),
        scipy.LowLevelCallable(ctypes.CFUNCTYPE(DOUBLE, DOUBLE)(lambda t: 0.0)),
        scipy.LowLevelCallable(
            ctypes.CFUNCTYPE(DOUBLE, DOUBLE, DOUBLE, DOUBLE, DOUBLE)(lambda t, x, v, w: 0.0)
        ),
    ],
)
def test_another_signature_is_refused(force):
    with pytest.raises(TypeError, match=r"signature .*double"):
        zivi.ImpactSystem(force, e=0.5)


def test_a_numba_function_of_another_signature_is_refused():
    numba = pytest.importorskip("numba")
    force = numba.cfunc("float64(float64, float64)")(lambda t, x: -x)
    with pytest.raises(TypeError, match="signature"):
        zivi.ImpactSystem(force, e=0.5)


def test_the_owner_of_a_compiled_force_is_kept_alive():
    """The system holds on to the code: running after the last other reference is gone works."""
    import gc

    system = zivi.ImpactSystem(PLAIN(lambda t, x, xdot: -9.81), e=0.6)
    data = zivi.ImpactSystem(low_level_with_data(), e=0.6)
    gc.collect()
    sol = zivi.simulate(system, (0, 5), (1, 0), method=METHOD)
    np.testing.assert_array_equal(sol.transformed.s, run(-9.81).transformed.s)
    assert zivi.simulate(data, (0, 1), (1, 0), method=METHOD).success


class CustomError(Exception):
    pass


def failing_at(t_fail, error=CustomError):
    def failing(t, x, xdot):
        if t > t_fail:
            raise error("no more")
        return -9.81

    return failing


def test_an_exception_reaches_the_caller_with_its_traceback_and_the_run_so_far():
    whole = run(-9.81)
    with pytest.raises(CustomError, match="no more") as caught:
        run(failing_at(2.0))
    frames = traceback.extract_tb(caught.value.__traceback__)
    assert frames[-1].name == "failing"
    sol = caught.value.trajectory
    assert sol.status == zivi.Status.RAISED
    assert not sol.success
    assert sol.t[-1] == pytest.approx(2.0, abs=0.011)
    np.testing.assert_array_equal(sol.transformed.s, whole.transformed.s[: len(sol.transformed.s)])
    assert len(sol.resolved_impacts) == np.count_nonzero(whole.resolved_impacts["t"] <= sol.t[-1])
    assert any("2" in note for note in caught.value.__notes__)


@pytest.mark.parametrize("error", [ZeroDivisionError, StopIteration, SystemExit, KeyboardInterrupt])
def test_every_exception_passes_through(error):
    with pytest.raises(error) as caught:
        run(failing_at(-1.0, error))
    assert caught.value.trajectory.n_steps == 0


def test_an_exception_in_the_first_step_leaves_the_initial_state():
    with pytest.raises(CustomError) as caught:
        run(failing_at(-1.0))
    assert caught.value.trajectory.x.tolist() == [1.0]


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("wrap", [lambda f: f, PLAIN, lambda f: scipy.LowLevelCallable(PLAIN(f))])
def test_a_force_that_is_not_finite_ends_the_run(bad, wrap):
    whole = run(-9.81)
    sol = run(wrap(lambda t, x, xdot: bad if t > 1.005 else -9.81))
    assert sol.status == zivi.Status.FORCE_NOT_FINITE
    assert not sol.success
    assert "NaN or infinity" in sol.message
    assert sol.t[-1] == pytest.approx(1.0)
    np.testing.assert_array_equal(sol.transformed.s, whole.transformed.s[: len(sol.transformed.s)])
    assert sol.rest_time is None


def test_a_force_that_is_not_finite_from_the_start():
    sol = run(lambda t, x, xdot: math.nan)
    assert sol.status == zivi.Status.FORCE_NOT_FINITE
    assert (sol.t.tolist(), sol.x.tolist()) == ([0.0], [1.0])


@pytest.mark.parametrize("value", ["1", None, [1.0], 1j, np.array([1.0, 2.0])], ids=repr)
def test_another_return_type_is_named(value):
    with pytest.raises(TypeError, match=r"force\(t, x, xdot\) must return a float") as caught:
        run(lambda t, x, xdot: value)
    assert caught.value.trajectory.n_steps == 0


def test_a_callable_of_another_signature_is_refused():
    with pytest.raises(TypeError, match=r"must be a function of \(t, x, xdot\)"):
        run(lambda t: -9.81)


@pytest.mark.parametrize("friction", [0.5, 5.0, 20.0])
@pytest.mark.parametrize("h", [0.1, 0.01, 0.0013])
def test_a_discontinuous_force_gets_an_answer_or_a_status(friction, h):
    """Coulomb friction jumps where the velocity passes zero: a step may have no solution."""

    calls = []

    def force(t, x, xdot):
        calls.append(t)
        return -9.81 - friction * np.sign(xdot)

    sol = run(force, zivi.ThetaGamma(h=h))
    assert len(calls) < 100 * (1 + 5.0 / h)
    assert sol.status in (zivi.Status.COMPLETED, zivi.Status.FORCE_NOT_CONVERGED)
    assert sol.success == (sol.t[-1] == 5.0)
    assert np.all(np.isfinite(sol.transformed.s))
    if friction < 9.81:
        assert sol.t[-1] > 0.1
        assert np.all(np.diff(0.5 * sol.xdot**2 + 9.81 * sol.x) < 1e-9)


def clocked(t, x, xdot):
    inner = [k * t for k in (0.0,)]
    return -G + inner[0]


def enclosed(t, x, xdot):
    return (lambda: -G + 0.0 * t)()


def evaluated(t, x, xdot):
    return eval("-9.81 + 0.0 * t")


def everything(*arguments):
    return -G + 0.0 * arguments[0]


def written(t, x, xdot):
    t = 2.0
    return -G * t


WITHOUT_TIME = [lambda t, x, xdot: -G - 0.1 * xdot, lambda t, y: -G - 0.1 * y[1]]
WITH_TIME = [law, clocked, enclosed, evaluated, everything, written, LINEAR.__call__, math.hypot]


def test_a_function_reads_the_time_unless_it_never_names_it():
    assert [reads_time(f) for f in WITHOUT_TIME] == [False, False]
    assert [reads_time(f) for f in WITH_TIME] == [True] * len(WITH_TIME)
    wrapped = functools.wraps(WITHOUT_TIME[0])(lambda *arguments: law(*arguments))
    assert reads_time(wrapped)
    assert reads_time(functools.partial(WITHOUT_TIME[0]))


@pytest.mark.parametrize("force", WITHOUT_TIME)
def test_rest_under_a_force_without_time_is_looked_at_once(force):
    def timed(t, x, xdot):
        return force(t, x, xdot) if force is WITHOUT_TIME[0] else force(t, (x, xdot))

    def counts(force):
        short, long = (
            zivi.simulate(zivi.ImpactSystem(force, e=0.5), (0, t1), (1, 0)).nfev for t1 in (2, 200)
        )
        return short, long

    short, long = counts(force)
    assert short == long
    assert counts(timed)[0] > short + 50


def test_a_force_may_keep_its_array():
    kept, seen = [], []

    def force(t, y):
        kept.append(y if len(kept) % 3 else y[:1])
        seen.append(y.tolist())
        y += 1.0  # of no consequence
        return -G - 0.1 * seen[-1][1]

    run = zivi.simulate(zivi.ImpactSystem(force, e=0.5), (0, 2), (1, 0))
    assert all(it[0] == 1.0 + at[0] for it, at in zip(kept, seen, strict=True))
    alone = zivi.simulate(zivi.ImpactSystem(WITHOUT_TIME[1], e=0.5), (0, 2), (1, 0))
    np.testing.assert_array_equal(run.x, alone.x)


def test_a_compiled_function_without_the_time_is_known_as_such():
    """Fewer evaluations, as of the same function in the interpreter, and the same motion."""
    numba = pytest.importorskip("numba")

    def plain(t, x, xdot):
        return -9.81 - 2.0 * x - 0.3 * xdot

    def timed(t, x, xdot):
        return -9.81 - 2.0 * x - 0.3 * xdot + 0.0 * t

    def of(force):
        return zivi.simulate(zivi.ImpactSystem(force, e=0.5), (0, 4), (1, 0), samples="steps")

    compiled, slower = of(numba.njit(plain)), of(numba.njit(timed))
    assert compiled.nfev == of(plain).nfev < slower.nfev == of(timed).nfev
    np.testing.assert_allclose(compiled.zeno_times, slower.zeno_times, rtol=1e-7)
    rate = zivi.ParametricForce(
        numba.njit(lambda t, x, xdot, k: -9.81 - k * x - 0.3 * xdot), {"k": 2.0}
    )
    assert of(rate).nfev == compiled.nfev
