"""The woodpecker toy of Glocker and Pfeiffer, with dry friction at three contacts."""

import warnings

import numpy as np
from scipy.optimize import brentq

import zivi

from .rows import SOURCES, Row, columns, link, series

WEIGHT, SPRING = 9.81, 0.0056
MS, MM, JS, JM, LM, LG = 0.0045, 0.0003, 7e-7, 5e-9, 0.01, 0.015
HS, LS, R0, RM, HM = 0.02, 0.0201, 0.0025, 0.0031, 0.0058
PUBLISHED = SOURCES["leine"]["start"]
"""Start of the limit cycle, as it is printed."""


def toy(outward: float = 0.0) -> zivi.MechanicalSystem:
    """Give the toy: height, sleeve, bird; the pole as much thinner as is said."""
    couple = [[MS + MM, MS * LM, MS * LG]]
    couple += [[MS * LM, JM + MS * LM**2, MS * LM * LG], [MS * LG, MS * LM * LG, JS + MS * LG**2]]

    def force(t, q, v):
        twist = SPRING * (q[1] - q[2])
        weight = MS * WEIGHT
        return [-(MS + MM) * WEIGHT, -twist - weight * LM, twist - weight * LG]

    beak, edge = LM + LG - LS - R0, RM - R0 + outward
    along, rim = [1, LM, LG - LS], [1, RM, 0]
    gaps = [
        zivi.LinearGap([0, 0, -HS], beak, tangent=along, mu=0.3),
        zivi.LinearGap([0, HM, 0], edge, tangent=rim, mu=0.3),
        zivi.LinearGap([0, -HM, 0], edge, tangent=rim, mu=0.3),
    ]
    return zivi.MechanicalSystem(mass=couple, force=force, gaps=gaps, e=[0.5, 0, 0])


def time_stepping() -> Row:
    """Moreau and Jean's scheme from the published start: the sleeve jams, sticks, slips, leaves.

    That start is 8.8e-7 m inside of the sleeve's edge: the edge is moved by as much, and the sleeve
    reaches the other one only after the last row.
    """
    h = 2e-5
    t, *published = columns("siconos_woodpecker")
    q, v = np.transpose(published[:3]), np.transpose(published[3:])
    steps = (t / h).round().astype(int)
    start = (q[0], [v[0, 0], 0.0, v[0, 2]])
    moved = -HM * q[0, 1] - (RM - R0) - 1e-16  # so the contact is closed, whatever the rounding
    with warnings.catch_warnings():
        # the scheme warns of coefficients of restitution that differ
        warnings.simplefilter("ignore", RuntimeWarning)
        sol = zivi.simulate(toy(moved), (0, t[-1]), start, zivi.MoreauJean(h))
    what = "coordinates of the woodpecker toy, friction, `MoreauJean(2e-5)`"
    return series(link("siconos_woodpecker"), what, q, sol.q[steps], 3e-14)


def limit_cycle() -> list[Row]:
    """The start of the limit cycle, found by following the motion."""
    jammed = (R0 - RM) / HM * (1 - 1e-15)
    start = ([0, jammed, PUBLISHED["bird"]], [PUBLISHED["speed"], 0, PUBLISHED["turn"]])
    method = zivi.SwitchedRK(rtol=1e-9, atol=1e-10)
    sol = zivi.simulate(toy(), (0, 1.2), start, method)
    t = np.linspace(1.0, 1.2, 401)
    bird = sol(t)[0][:, 2] - PUBLISHED["bird"]
    (k,) = np.flatnonzero((bird[:-1] > 0) & (bird[1:] <= 0))[-1:]
    at = brentq(lambda t: sol(t)[0][2] - PUBLISHED["bird"], t[k], t[k + 1], xtol=1e-14)
    _, v = sol(at)
    where = f"Leine, van Campen, Glocker, J. Vib. Control 9, 25 (2003), as in {link('leine')}"
    cycle = "limit cycle of the woodpecker toy"
    return [
        series(where, f"{cycle}: speed (m/s)", PUBLISHED["speed"], v[0], 2e-3),
        series(where, f"{cycle}: rate of the bird (1/s)", PUBLISHED["turn"], v[2], 2e-3),
    ]


def rows() -> list[Row]:
    """Compare with all of them."""
    return [time_stepping(), *limit_cycle()]
