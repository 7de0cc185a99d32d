"""First-order states as velocities of coordinates of mass 1, against other solvers."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm
from scipy.optimize import brentq

import zivi

pytest.importorskip("sympy")

TIGHT = zivi.SwitchedRK(rtol=1e-12, atol=1e-13)
MOTOR = {"J": 0.01, "c": 0.002, "k": 0.1, "U": 6.0, "R": 2.0, "L": 0.05}


def motor(e=0.5, **more):
    return zivi.symbolic.system(
        "th",
        T="J*thdot**2/2",
        Q={"th": "k*i - c*thdot", "i": "(U - R*i - k*thdot)/L"},
        states=["i"],
        gaps={"stop": "1 - th"},
        parameters=MOTOR,
        e=e,
        **more,
    )


def impacts_of_the_motor(e, count):
    """Times of impact and currents, by the exponential of the matrix and roots of the gap."""
    J, c, k, U, R, L = MOTOR.values()
    A = np.array([[0, 1, 0, 0], [0, -c / J, k / J, 0], [0, -k / L, -R / L, U / L], [0] * 4])
    y, t, found = np.array([0.0, 0.0, 0.0, 1.0]), 0.0, []
    for _ in range(count):
        step = 1e-3 if not found else 1e-4
        far = next(n * step for n in range(1, 10**6) if (expm(A * n * step) @ y)[0] > 1)
        at = brentq(lambda s, y=y: (expm(A * s) @ y)[0] - 1, far - step, far, xtol=1e-16)
        t, y = t + at, expm(A * at) @ y
        y[:2] = 1.0, -e * y[1]
        found.append((t, y[2]))
    return np.array(found)


def test_a_motor_with_inductance_against_a_stop():
    sol = zivi.simulate(motor(), (0, 2), ([0, 0], [0, 0]), method=TIGHT)
    known = impacts_of_the_motor(0.5, 5)
    np.testing.assert_allclose(sol.impacts["t"][:5], known[:, 0], rtol=0, atol=2e-11)
    # the current is continuous through impacts and the accumulation
    np.testing.assert_allclose(
        [sol(t)[1][1] for t in sol.impacts["t"][:5]], known[:, 1], rtol=0, atol=1e-10
    )
    assert sol.zeno["t"][0] == pytest.approx(0.76721176, abs=1e-8)
    assert sol.qdot[-1, 1] == pytest.approx(MOTOR["U"] / MOTOR["R"], abs=1e-10)
    assert sol.reactions[-1, 0] == pytest.approx(MOTOR["k"] * 3, abs=1e-10)


@pytest.mark.parametrize(("tol", "error"), [(1e-6, 1e-7), (1e-9, 1e-10), (1e-11, 1e-11)])
def test_impacts_follow_the_tolerance(tol, error):
    method = zivi.SwitchedRK(rtol=tol, atol=tol / 10)
    sol = zivi.simulate(motor(), (0, 0.7), ([0, 0], [0, 0]), method=method)
    known = impacts_of_the_motor(0.5, 3)[:, 0]
    np.testing.assert_allclose(sol.impacts["t"][:3], known, rtol=0, atol=error)


def test_friction_of_lugre_is_that_of_radau():
    p = {"m": 1.0, "k": 2.0, "v0": 0.1, "s0": 1e3, "s1": 30.0, "s2": 0.4}
    p |= {"Fc": 1.0, "Fs": 1.5, "vs": 0.01}
    rate = "(xdot - s0*abs(xdot)*z/(Fc + (Fs - Fc)*exp(-(xdot/vs)**2)))"
    push = f"k*(v0*t - x) - s0*z - s1*{rate} - s2*xdot"
    block = zivi.symbolic.system(
        "x", T="m*xdot**2/2", Q={"x": push, "z": rate}, states=["z"], parameters=p
    )

    def right(t, y):
        x, v, z = y
        held = p["Fc"] + (p["Fs"] - p["Fc"]) * np.exp(-((v / p["vs"]) ** 2))
        zdot = v - p["s0"] * abs(v) * z / held
        force = p["k"] * (p["v0"] * t - x) - p["s0"] * z - p["s1"] * zdot - p["s2"] * v
        return [v, force / p["m"], zdot]

    known = solve_ivp(right, (0, 9), [0, 0, 0], method="Radau", rtol=1e-10, atol=1e-13).y[:, -1]
    method = zivi.SwitchedRK(rtol=1e-9, atol=1e-11)
    sol = zivi.simulate(block, (0, 9), ([0, 0], [0, 0]), method=method)
    assert abs(known[1]) > 0.05  # it has broken loose
    np.testing.assert_allclose([sol.q[-1, 0], *sol.qdot[-1]], known, rtol=0, atol=5e-9)


def test_a_relay_slides_at_zero():
    # z' = cos(t)/2 - 1 until z = 1 + sin(t)/2 - t = 0
    relay = zivi.symbolic.system(
        "a", T="adot**2/2", Q={"z": "cos(t)/2"}, states=["z"], friction={"relay": ("z", 1.0)}
    )
    sol = zivi.simulate(relay, (0, 3), ([0, 0], [0, 1]), method=TIGHT)
    assert sol.transitions["t"][-1] == pytest.approx(1.498701133517848, abs=1e-12)
    assert sol.qdot[-1, 1] == 0.0
    # the same by hand, dry friction on the row of the state
    by_hand = zivi.MechanicalSystem(
        mass=1.0, force=lambda t, q, qdot: [np.cos(t) / 2], friction=[zivi.DryFriction(limit=1.0)]
    )
    again = zivi.simulate(by_hand, (0, 3), ([0], [1]), method=TIGHT)
    assert again.transitions["t"][-1] == pytest.approx(1.498701133517848, abs=1e-12)


def test_states_may_be_symbols_and_the_rates_a_list():
    import sympy

    th, thdot, i, U = sympy.symbols("th thdot i U")
    system = zivi.symbolic.system(
        [th], T=thdot**2 / 2, Q=[i - thdot, U - i], states=[i], parameters={U: 2.0}
    )
    assert system.coordinate_names(2) == ("th", "i_integral")
    here = system.at(0.0, [0.1, 0.0], [0.5, 1.5])
    np.testing.assert_array_equal(here.mass, np.eye(2))
    np.testing.assert_array_equal(here.force, [1.0, 0.5])
    names = zivi.symbolic.system("x y", qdot="u v", T="u**2 + v**2", Q={"z": "u"}, states=["z"])
    np.testing.assert_array_equal(names.at(0, [0, 0, 0], [3, 4, 5]).force, [0, 0, 3])


def test_a_state_without_a_rate_is_named():
    with pytest.raises(
        ValueError, match="Q must have the rate of each state; that of 'i' is missing"
    ):
        zivi.symbolic.system("x", T="xdot**2/2", Q={"x": "i"}, states=["i"])
    with pytest.raises(ValueError, match="must depend only on time and coordinates"):
        zivi.symbolic.system("x", T="xdot**2/2", Q={"i": "1"}, states=["i"], gaps={"stop": "x - i"})
