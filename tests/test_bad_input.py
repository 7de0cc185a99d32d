"""Bad input: an error that names the argument, before anything is computed; never a hang."""

import math
from operator import attrgetter

import numpy as np
import pytest
from hypothesis import assume, given, settings, strategies as st

import zivi

BALL = zivi.ImpactSystem(-9.81, e=0.5)
METHOD = zivi.ThetaGamma(h=0.1)
NAN, INF = math.nan, math.inf


def simulate(system=BALL, t_span=(0, 1), y0=(1, 0), method=METHOD, **more):
    return zivi.simulate(system, t_span, y0, method=method, **more)


VALUES = {
    "h": (zivi.ThetaGamma, "h", [0, -1, NAN, INF]),
    "h of the explicit scheme": (zivi.ExplicitEuler, "h", [0, -1e-300, NAN, INF]),
    "theta": (lambda v: zivi.ThetaGamma(h=0.1, theta=v), "theta", [0, -0.1, 1.0000001, NAN]),
    "gamma": (lambda v: zivi.ThetaGamma(h=0.1, gamma=v), "gamma", [0, -0.1, 1.0000001, NAN]),
    "solver": (lambda v: zivi.ThetaGamma(h=0.1, solver=v), "solver", ["Exact", "", None, 3]),
    "e": (lambda v: zivi.ImpactSystem(1, e=v), "e", [-0.1, 1.0000001, NAN, INF]),
    "kappa": (lambda v: zivi.ImpactSystem(1, kappa=v), "kappa", [-0.1, 1.1, NAN, INF]),
    "force": (lambda v: zivi.ImpactSystem(v, e=0.5), "force", [NAN, INF, -INF]),
    "end": (lambda v: simulate(t_span=(0, v)), "t_span", [0, -1, NAN, INF, -INF]),
    "start": (lambda v: simulate(t_span=(v, 1)), "t_span", [1, 2, NAN, INF, -INF]),
    "x0": (lambda v: simulate(y0=(v, 0)), "x0", [-1, NAN, INF]),
    "xdot0": (lambda v: simulate(y0=(1, v)), "xdot0", [NAN, INF, -INF]),
    "t_eval": (
        lambda v: simulate(t_eval=v),
        "t_eval",
        [[0, 2], [-1e-9, 0], [1, 0], [NAN], [[0, 1]], 0.5],
    ),
    "too many steps": (lambda v: simulate(method=zivi.ThetaGamma(h=v)), "h", [1e-12, 1e-300]),
    "no restitution": (lambda v: simulate(zivi.ImpactSystem(1, e=v)), "e", [0]),
    "kappa 1": (lambda v: simulate(zivi.ImpactSystem(1, kappa=v)), "e", [1]),
    "time asked": (lambda v: simulate()(v), "t", [-0.1, 1.1, NAN, [0, 2]]),
    "lift x": (lambda v: zivi.lift(v, 0, e=0.5), "x", [-1, NAN, INF, [1, -1]]),
    "lift shapes": (lambda v: zivi.lift(v, [1, 2], e=0.5), "x and xdot", [[1, 2, 3]]),
    "project shapes": (lambda v: zivi.project(v, [1, 2], e=0.5), "s and v", [[1, 2, 3]]),
    "branch": (lambda v: zivi.lift(1, 1, e=0.5, branch=v), "branch", ["up", None, 1]),
    "coefficient": (lambda v: zivi.LinearForce(stiffness=v), "stiffness", [NAN, INF]),
}
TYPES = {
    "h": (zivi.ThetaGamma, "h", ["a", None, 1j, [0.1], np.array([0.1])]),
    "theta": (lambda v: zivi.ThetaGamma(h=0.1, theta=v), "theta", ["a", None, 1j]),
    "e": (lambda v: zivi.ImpactSystem(1, e=v), "e", ["a", 1j, [0.5]]),
    "force": (lambda v: zivi.ImpactSystem(v, e=0.5), "force", ["x", None, [1], 1j, {}]),
    "coefficient": (lambda v: zivi.LinearForce(omega=v), "omega", ["x", None, 1j, [1]]),
    "t_span": (lambda v: simulate(t_span=v), "t_span", [(0,), (0, 1, 2), 1, None, "ab", (0, 1j)]),
    "y0": (lambda v: simulate(y0=v), "y0", [(1,), (1, 2, 3), 1, None, "ab", (None, 1), (1, 1j)]),
    "system": (lambda v: simulate(v), "system", [3, None, -9.81, zivi.ImpactSystem]),
    "method": (lambda v: simulate(method=v), "method", ["RK45", None, 0.1]),
}


def cases(table):
    return [
        pytest.param(call, name, value, id=f"{label}={value!r}")
        for label, (call, name, values) in table.items()
        for value in values
    ]


@pytest.mark.parametrize(("call", "name", "value"), cases(VALUES))
def test_a_value_out_of_range_is_named(call, name, value):
    with pytest.raises(ValueError, match=rf"(?<![\w.]){name}(?!\w)"):
        call(value)


@pytest.mark.parametrize(("call", "name", "value"), cases(TYPES))
def test_a_wrong_type_is_named(call, name, value):
    with pytest.raises(TypeError, match=rf"(?<![\w.]){name}(?!\w)"):
        call(value)


@pytest.mark.parametrize(
    "arguments", [{}, {"e": 0.5, "kappa": 1 / 3}, {"e": None, "kappa": None}], ids=str
)
def test_exactly_one_coefficient_is_wanted(arguments):
    for call in (
        lambda: zivi.ImpactSystem(-9.81, **arguments),
        lambda: zivi.lift(1, 1, **arguments),
        lambda: zivi.project(1, 1, **arguments),
    ):
        with pytest.raises(ValueError, match="exactly one of e and kappa"):
            call()


@pytest.mark.parametrize(
    "call",
    [
        lambda: zivi.ThetaGamma(h=0.1, beta=1),
        lambda: zivi.ThetaGamma(),
        lambda: zivi.ExplicitEuler(h=0.1, theta=1),
        lambda: zivi.LinearForce(k=1),
        lambda: zivi.ImpactSystem(-9.81, e=0.5, mass=1),
        lambda: zivi.ImpactSystem(-9.81, 0.5),
        lambda: zivi.simulate(BALL, (0, 1), (1, 0), METHOD, rtol=1e-3),
        lambda: zivi.lift(1, 1, e=0.5, side=1),
        lambda: zivi.project(1, 1, 0.5),
    ],
)
def test_unknown_and_missing_arguments_raise(call):
    with pytest.raises(TypeError):
        call()


def test_settings_are_frozen():
    for thing, name in ((METHOD, "h"), (zivi.LinearForce(), "gravity"), (BALL, "e")):
        with pytest.raises(AttributeError):
            setattr(thing, name, 0.3)


def test_numbers_of_all_kinds_are_taken():
    """Lists, arrays and NumPy scalars where numbers are asked for; h longer than the span."""
    plain = simulate(t_span=(0, 1), y0=(1, 0))
    other = simulate(
        zivi.ImpactSystem(np.float64(-9.81), e=np.float64(0.5)),
        np.array([0, 1]),
        [np.float32(1), 0],
        zivi.ThetaGamma(h=np.float64(0.1), theta=1),
    )
    np.testing.assert_array_equal(plain.transformed.s, other.transformed.s)
    assert simulate(method=zivi.ThetaGamma(h=5)).t.tolist() == [0.0, 1.0]
    assert simulate(t_eval=[]).t.size == 0


EXTREME = st.sampled_from([0.0, -0.0, 5e-324, 1e-300, 1e-100, 1.0, 1e100, 1e300])
SIGNED = st.builds(lambda x, sign: sign * x, EXTREME, st.sampled_from([-1.0, 1.0]))
COLUMNS = (
    "t",
    "x",
    "xdot",
    "transformed.s",
    "transformed.v",
    "transformed.lambda_s",
    "transformed.lambda_v",
)


@settings(deadline=None, max_examples=400, derandomize=True)
@given(
    f=SIGNED,
    x0=EXTREME,
    xdot0=SIGNED,
    h=st.sampled_from([5e-324, 1e-300, 1e-3, 1e50, 1e100, 1e300]),
    steps=st.sampled_from([0.5, 1, 3.3, 100]),
    e=st.sampled_from([1e-3, 0.5, 1 - 1e-16, 1.0]),
    weight=st.sampled_from([1e-300, 0.5, 1.0]),
    kind=st.sampled_from(["number", "spring", "callable"]),
)
def test_extreme_numbers_get_an_answer(f, x0, xdot0, h, steps, e, weight, kind):
    """Whatever the outcome: finite samples that end where the status says."""
    forces = {
        "number": f,
        "spring": zivi.LinearForce(stiffness=abs(f), damping=abs(f), gravity=1.0),
        "callable": lambda t, x, xdot: f + x,
    }
    method = zivi.ThetaGamma(h=h, theta=weight, gamma=weight)
    assume(h * steps > 0)
    sol = simulate(zivi.ImpactSystem(forces[kind], e=e), (0, h * steps), (x0, xdot0), method)
    for name in COLUMNS:
        assert np.all(np.isfinite(attrgetter(name)(sol))), name
    assert sol.status in set(zivi.Status) - {zivi.Status.RAISED}
    assert sol.success == (sol.t[-1] == h * steps)
    assert np.all(sol.x >= 0)
    assert np.all(np.diff(sol.t) > 0)
    assert len({len(attrgetter(name)(sol)) for name in COLUMNS}) == 1


@pytest.mark.parametrize(
    "bad", [(1e-9,), (1e-9, 1e-9, 1e-9), (0, 1e-9), (1e-9, np.nan), None, "ab"]
)
def test_absolute_tolerances_are_one_number_or_two(bad):
    with pytest.raises((ValueError, TypeError), match="atol must be"):
        zivi.SwitchedRK(atol=bad)
    assert zivi.SwitchedRK(atol=[1e-9, 1e-7]).atol == (1e-9, 1e-7)


def test_the_normal_of_a_gap_is_named():
    with pytest.raises((TypeError, ValueError), match="normal"):
        zivi.LinearGap([1.0, "a"])


def two_coordinates(**parts):
    given = {"mass": np.eye(2), "force": [0.0, -9.81], "gaps": [zivi.LinearGap([0, 1.0])]}
    return zivi.MechanicalSystem(**{**given, "e": 0.5, **parts})


WRONG_ARGUMENTS = {
    r"value of gap 'floor' must be a function of \(t, q\), got a lambda\(q\)": lambda: zivi.Gap(
        lambda q: q[1], [0, 1.0], name="floor"
    ),
    r"gradient of gap must be a function of \(t, q\), got a lambda\(t, q, qdot\)": lambda: zivi.Gap(
        lambda t, q: q[1], lambda t, q, qdot: [0, 1.0]
    ),
    r"mass must be a function of \(t, q\), got a lambda\(q\)": lambda: two_coordinates(
        mass=lambda q: np.eye(2)
    ),
    r"force must be a function of \(t, q, qdot\), got a lambda\(t, y\)": lambda: two_coordinates(
        force=lambda t, y: y
    ),
    r"force must be a function of \(t, q, qdot, u\), got a lambda\(t, q, qdot\)": (
        lambda: two_coordinates(force=lambda t, q, qdot: q, inputs=zivi.Table([0, 1], [0, 1]))
    ),
    r"events\[1\] must be a function of \(t, q, qdot\), got a lambda\(t, y\)": (
        lambda: zivi.simulate(
            two_coordinates(),
            (0, 1),
            ([0, 1], [0, 0]),
            events=[lambda *state: 1.0, lambda t, y: 1.0],
        )
    ),
    r"velocity must be a function of \(t\), got a lambda\(\)": lambda: zivi.MovingWall(
        lambda t: 1.0, lambda: 0.0, lambda t: 0.0
    ),
    r"mu of gap must be a function of \(speed\), got a lambda\(\)": lambda: zivi.Gap(
        lambda t, q: q[1], [0, 1.0], tangent=[1, 0], mu=lambda: 0.3
    ),
    r"limit of friction must be a function of \(t, q, qdot\), got a lambda\(t\)": (
        lambda: zivi.DryFriction(limit=lambda t: 1.0)
    ),
    r"f must be a function of \(t, x, xdot, k, b\), got a lambda\(t, x, xdot, k\)": (
        lambda: zivi.ParametricForce(lambda t, x, xdot, k: 1.0, {"k": 1.0, "b": 2.0})
    ),
    r"jacobian must be a function of \(t, x, xdot, k\), got a lambda\(t\)": (
        lambda: zivi.ParametricForce(lambda t, x, xdot, k: 1.0, {"k": 1.0}, jacobian=lambda t: 0.0)
    ),
}


@pytest.mark.parametrize("message", WRONG_ARGUMENTS)
def test_functions_of_other_arguments_are_refused_before_anything_calls_them(message):
    with pytest.raises(TypeError, match=message):
        WRONG_ARGUMENTS[message]()


def test_functions_with_more_arguments_that_have_defaults_are_taken():
    def force(t, q, qdot, k=2.0, *, b=1.0):
        return -k * q - b * qdot

    for one in (force, lambda *state: -state[1], np.vectorize(lambda t, q, qdot: -q)):
        assert two_coordinates(force=one).gap_names == ("gap0",)
