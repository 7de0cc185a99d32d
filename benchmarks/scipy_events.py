"""A bouncing mass with SciPy: `solve_ivp` from impact to impact, as a competent user's script.

Also what becomes of the script when one of its precautions is left out.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from methods_problems import Problem

CAP = 0.02
"""Longest flight without watching the wall (s)."""
GUARD = 1e-9
"""Speed after an impact below which the mass is said to rest (m/s)."""

Field = Callable[[float, Any], Any]


@dataclasses.dataclass(frozen=True)
class Motion:
    """How a run ended and what it took."""

    t: float
    x: float
    xdot: float
    rest: float | None
    impacts: int
    nfev: int
    steps: int


def floor(t: float, y: Any) -> float:
    """Give the distance from the wall: the event."""
    return float(y[0])


floor.terminal = True  # type: ignore[attr-defined]
floor.direction = -1.0  # type: ignore[attr-defined]


def field(problem: Problem) -> Field:
    """Write the right-hand side as a user's function of plain Python."""
    k, c, g, a, omega, phase = dataclasses.astuple(problem.force)[:6]
    cos = math.cos

    def rhs(t: float, y: Any) -> tuple[float, float]:
        x, xdot = y.tolist()  # floats are quicker than NumPy's scalars
        return xdot, -k * x - c * xdot - g + a * cos(omega * t + phase)

    return rhs


def compiled_field(problem: Problem) -> Field | None:
    """Write the same compiled by numba, where it is installed."""
    try:
        import numba
    except ImportError:
        return None
    k, c, g, a, omega, phase = dataclasses.astuple(problem.force)[:6]

    @numba.njit("float64[:](float64, float64[:])")
    def rhs(t: float, y: Any) -> Any:
        return np.array([y[1], -k * y[0] - c * y[1] - g + a * math.cos(omega * t + phase)])

    compiled: Field = rhs
    return compiled


class Script:
    """The script: fly to the next impact, reverse, rest when it is slow, look for the lift-off."""

    def __init__(
        self,
        problem: Problem,
        tol: float,
        rhs: Field | None = None,
        *,
        guard: float = GUARD,
        cap: float = CAP,
        dense: bool = False,
    ) -> None:
        self.problem = problem
        self.settings = {"method": "DOP853", "rtol": tol, "atol": tol, "dense_output": dense}
        self.rhs = rhs or field(problem)
        self.force = problem.python_force()
        self.slowest = max(tol, guard)
        self.cap = cap
        self.nfev = self.steps = self.impacts = 0

    def pull(self, t: float) -> float:
        """Evaluate the force on the mass at rest."""
        self.nfev += 1
        return self.force(t, 0.0, 0.0)

    def leg(self, t: float, y: Any, until: float, **event: Any) -> Any:
        """Integrate and count."""
        sol = solve_ivp(self.rhs, (t, until), y, **self.settings, **event)
        self.nfev += sol.nfev
        self.steps += len(sol.t) - 1
        return sol

    def lift_off(self, t: float) -> float | None:
        """Find the next time at which the force pulls outward."""
        end = self.problem.span[1]
        while t < end:
            ahead = min(t + self.problem.pace, end)
            if self.pull(ahead) > 0.0:
                return float(brentq(self.pull, t, ahead, xtol=1e-15, rtol=1e-15))
            t = ahead
        return None

    def flight(self, t: float, y: Any, pull: float) -> tuple[float, Any, bool]:
        """Fly to the next impact or the end."""
        end = self.problem.span[1]
        if y[0] == 0.0:
            # the mass is on the wall: fly half of the next arc before watching for the wall
            half = y[1] / -pull if pull < 0.0 else self.cap
            ahead = min(t + min(half, self.cap), end)
            sol = self.leg(t, y, ahead)
            t, y = ahead, sol.y[:, -1]
        if t < end:
            sol = self.leg(t, y, end, events=floor)
            t, y = sol.t[-1], sol.y[:, -1]
            return float(t), y, sol.status == 1
        return t, y, False

    def run(self) -> Motion:
        """Follow the motion to the end of its span."""
        (t, end), y = self.problem.span, np.array(self.problem.state)
        rest = None
        while t < end:
            pull = self.pull(t) if y[0] == 0.0 else 0.0
            if y[0] == 0.0 and y[1] < self.slowest and pull < 0.0:
                lifts = self.lift_off(t)
                y = np.zeros(2)
                if lifts is None:
                    rest, t = t, end
                    break
                t = lifts
                pull = 0.0
            t, y, landed = self.flight(t, y, pull)
            if landed:
                self.impacts += 1
                y = np.array([0.0, -self.problem.e * y[1]])
        return Motion(t, float(y[0]), float(y[1]), rest, self.impacts, self.nfev, self.steps)


def follow(problem: Problem, tol: float, rhs: Field | None = None, **settings: Any) -> Motion:
    """Follow the motion with relative and absolute tolerance `tol`."""
    return Script(problem, tol, rhs, **settings).run()


@dataclasses.dataclass(frozen=True)
class Fate:
    """What became of a script that left something out."""

    events: int
    standing: int
    """Restarts in a row, at the end, that did not advance the time."""
    t: float
    x: float
    finished: bool


def careless(
    problem: Problem,
    tol: float,
    *,
    terminal: bool = True,
    direction: float = -1.0,
    put_on_wall: bool = True,
    most: int = 300,
) -> Fate:
    """Restart at every event without a guard, at most `most` times."""

    def event(t: float, y: Any) -> float:
        return float(y[0])

    event.terminal, event.direction = terminal, direction  # type: ignore[attr-defined]
    rhs, (t, end), y = field(problem), problem.span, np.array(problem.state)
    events = standing = 0
    while t < end and events < most:
        sol = solve_ivp(rhs, (t, end), y, "DOP853", events=event, rtol=tol, atol=tol)
        standing = standing + 1 if sol.t[-1] == t else 0
        t, y = float(sol.t[-1]), sol.y[:, -1]
        if sol.status != 1:
            events += len(sol.t_events[0])
            break
        events += 1
        y = np.array([0.0 if put_on_wall else y[0], -problem.e * y[1]])
    return Fate(events, standing, t, float(y[0]), t >= end)
