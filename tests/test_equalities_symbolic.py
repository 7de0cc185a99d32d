"""Equality rows as formulas: a slider-crank, Andrews' squeezer, motion from tables."""

import pickle

import numpy as np
import pytest

import zivi

# Andrews' squeezer mechanism: E. Hairer, G. Wanner, Solving ODEs II, section VII.7
NUMBERS = {
    **{"m1": 0.04325, "m2": 0.00365, "m3": 0.02373, "m4": 0.00706, "m5": 0.07050, "m6": 0.00706},
    **{"m7": 0.05498, "i1": 2.194e-6, "i2": 4.410e-7, "i3": 5.255e-6, "i4": 5.667e-7},
    **{"i5": 1.169e-5, "i6": 5.667e-7, "i7": 1.912e-5, "xa": -0.06934, "ya": -0.00227},
    **{"xb": -0.03635, "yb": 0.03273, "xc": 0.014, "yc": 0.072, "c0": 4530.0, "d": 0.028},
    **{"da": 0.0115, "e": 0.02, "ea": 0.01421, "rr": 0.007, "ra": 0.00092, "l0": 0.07785},
    **{"ss": 0.035, "sa": 0.01874, "sb": 0.01043, "sc": 0.018, "sd": 0.02, "ta": 0.02308},
    **{"tb": 0.00916, "u": 0.04, "ua": 0.01228, "ub": 0.00449, "zf": 0.02, "zt": 0.04},
    **{"fa": 0.01421, "mom": 0.033},
}
MASS = {
    (0, 0): "m1*ra**2 + m2*(rr**2 - 2*da*rr*cos(th) + da**2) + i1 + i2",
    (0, 1): "m2*(da**2 - da*rr*cos(th)) + i2",
    (1, 1): "m2*da**2 + i2",
    (2, 2): "m3*(sa**2 + sb**2) + i3",
    (3, 3): "m4*(e - ea)**2 + i4",
    (3, 4): "m4*((e - ea)**2 + zt*(e - ea)*sin(ph)) + i4",
    (4, 4): "m4*(zt**2 + 2*zt*(e - ea)*sin(ph) + (e - ea)**2) + m5*(ta**2 + tb**2) + i4 + i5",
    (5, 5): "m6*(zf - fa)**2 + i6",
    (5, 6): "m6*((zf - fa)**2 - u*(zf - fa)*sin(om)) + i6",
    (6, 6): "m6*((zf - fa)**2 - 2*u*(zf - fa)*sin(om) + u**2) + m7*(ua**2 + ub**2) + i6 + i7",
}
COORDINATES = ["be", "th", "ga", "ph", "de", "om", "ep"]
FIRST, SECOND = "rr*cos(be) - d*cos(be + th)", "rr*sin(be) - d*sin(be + th)"
ROWS = {
    "x3": f"{FIRST} - ss*sin(ga) - xb",
    "y3": f"{SECOND} + ss*cos(ga) - yb",
    "x4": f"{FIRST} - e*sin(ph + de) - zt*cos(de) - xa",
    "y4": f"{SECOND} + e*cos(ph + de) - zt*sin(de) - ya",
    "x6": f"{FIRST} - zf*cos(om + ep) - u*sin(ep) - xa",
    "y6": f"{SECOND} - zf*sin(om + ep) + u*cos(ep) - ya",
}
START = [
    *(-0.0617138900142764496358948458001, 0.0, 0.455279819163070380255912382449),
    *(0.222668390165885884674473185609, 0.487364979543842550225598953530),
    *(-0.222668390165885884674473185609, 1.23054744454982119249735015568),
]
END = [  # at t = 0.03, as published
    *(15.81077119629904, -15.75637105984298, 0.04082224013073101, -0.5347301163226948),
    *(0.5244099658805303, 0.5347301163226948, 1.048080741042263),
]


def squeezer():
    kinetic = " + ".join(
        f"{'' if i == j else '2*'}({entry})*{COORDINATES[i]}dot*{COORDINATES[j]}dot/2"
        for (i, j), entry in MASS.items()
    )
    x, y = "(sd*cos(ga) + sc*sin(ga) + xb - xc)", "(sd*sin(ga) - sc*cos(ga) + yb - yc)"
    return zivi.symbolic.system(
        COORDINATES,
        T=kinetic,
        V=f"c0*(sqrt({x}**2 + {y}**2) - l0)**2/2",
        Q={"be": "mom"},
        equalities=ROWS,
        parameters=NUMBERS,
    )


def test_andrews_squeezer_reaches_its_published_place():
    system = squeezer()
    start = zivi.consistent(system, START)
    assert np.abs(start[0] - START).max() < 1e-14
    method = zivi.SwitchedRK(rtol=1e-9, atol=1e-9)
    sol = zivi.simulate(system, (0, 0.03), start, method)
    assert sol.status is zivi.Status.COMPLETED
    assert np.abs(sol.q[-1] - END).max() < 3e-9
    values = [system.at(0.0, q, w).equalities for q, w in zip(sol.q, sol.qdot, strict=True)]
    assert np.abs(values).max() <= 1e-14
    assert sol.constraint_forces.shape[1] == 6


CRANK = {
    "T": "m*xdot**2/2 + J*thdot**2/2 + J*phdot**2/2",
    "parameters": {"m": 1.0, "J": 0.1, "r": 1.0, "l": 2.5},
}
PINS = {"along": "r*cos(th) + l*cos(ph) - x", "across": "r*sin(th) + l*sin(ph)"}


def crank(drive, **more):
    parameters = CRANK["parameters"] | more
    return zivi.symbolic.system(
        "th ph x", T=CRANK["T"], parameters=parameters, equalities=PINS | {"drive": drive}
    )


def test_a_formula_prescribes_the_crank():
    system = crank("th - omega*t", omega=3.0)
    assert system.equality_names == ("along", "across", "drive")
    q, qdot = zivi.consistent(system, [0.0, 0.0, 3.5])
    for tol in (1e-6, 1e-12):
        sol = zivi.simulate(system, (0, 10), (q, qdot), zivi.SwitchedRK(rtol=tol, atol=tol))
        assert np.abs(sol.q[-1, 1:] - [0.40629933532052935, 2.4507255973128107]).max() < 1e-14
    # M q'' = G^T mu in closed form: the forces in the rod, and the torque of the drive
    th, k = 3.0 * sol.t, 1.0 / 2.5
    ph = -np.arcsin(k * np.sin(th))
    rate = -3.0 * k * np.cos(th) / np.cos(ph)
    bend = (9.0 * k * np.sin(th) + np.sin(ph) * rate**2) / np.cos(ph)
    pull = 9.0 * np.cos(th) + 2.5 * (np.cos(ph) * rate**2 + np.sin(ph) * bend)
    side = (0.1 * bend / 2.5 + np.sin(ph) * pull) / np.cos(ph)
    torque = np.sin(th) * pull - np.cos(th) * side
    exact = np.column_stack([pull, side, torque])
    assert np.abs(sol.constraint_forces - exact).max() < 1e-11 * np.abs(exact).max()
    faster = system.replace(omega=2.0)
    q, qdot = zivi.consistent(faster, [0.0, 0.0, 3.5])
    assert abs(zivi.simulate(faster, (0, 1), (q, qdot)).q[-1, 0] - 2.0) < 1e-14
    copied = pickle.loads(pickle.dumps(system))
    assert copied.equality_names == system.equality_names
    start = zivi.consistent(copied, [0.0, 0.0, 3.5])
    assert abs(zivi.simulate(copied, (0, 1), start).q[-1, 0] - 3.0) < 1e-14


@pytest.mark.parametrize("kind", ["table", "harmonic"])
def test_a_table_or_a_harmonic_motion_prescribes_the_crank(kind):
    t = np.linspace(0.0, 2.0, 21)
    motion = (
        zivi.Table(t, np.sin(2.0 * t), "cubic")
        if kind == "table"
        else zivi.HarmonicWall(amplitude=1.0, omega=2.0, phase=-np.pi / 2)
    )
    system = crank(("th", motion))
    q, qdot = zivi.consistent(system, [0.0, 0.0, 3.5])
    sol = zivi.simulate(system, (0, 2), (q, qdot))
    wanted = [motion._at(time)[0] for time in sol.t]
    assert np.abs(sol.q[:, 0] - wanted).max() <= 1e-14
    rates = [motion._at(time)[1] for time in sol.t[:-1]]  # beyond its end a table does not move
    assert np.abs(sol.qdot[:-1, 0] - rates).max() <= 1e-13


def test_rows_that_are_no_rows_are_named():
    with pytest.raises(ValueError, match="equality 'drive' must depend on coordinates"):
        crank("thdot - 3")
    with pytest.raises(ValueError, match="equality 'drive' must depend on coordinates"):
        crank("2*t")
    with pytest.raises(ValueError, match="equality 'drive' has psi, which is not a coordinate"):
        crank("psi - 3*t")
    with pytest.raises(TypeError, match=r"equalities\['drive'\] must be an expression"):
        crank(("th", 3.0))
    with pytest.raises(ValueError, match=r"must be a zivi\.Table of kind 'cubic'"):
        crank(("th", zivi.Table([0.0, 1.0], [0.0, 1.0], "linear")))
    with pytest.raises(TypeError, match="equalities must be a dict"):
        zivi.symbolic.system("x", T="xdot**2/2", equalities=["x"])
