"""Aiming at the next impact: a racket, a hammer, a pusher that gives a body a wanted speed."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

import zivi._zivi as _zivi
from zivi.base.check import Array, real
from zivi.control.component import TickStatus, delay_of
from zivi.control.model_based import ModelBased, believed, numbers
from zivi.control.u_limits import pairs
from zivi.system.gap_coordinates import GapKinetics
from zivi.system.mechanism import MechanicalSystem

__all__ = ["Striker"]

FINAL = 4.0
"""Periods before an impact in which the plan is played and not made anew."""
LEARNT = 0.7
"""How much of what an impact showed is taken over."""
LEAST = 0.1
"""The same of late impacts under noise, each of which shows little."""
JUMP = 1e-3
"""A change of the speed of a body beyond this part of the wanted one is an impact."""
MEAN = 50
"""Samples of a noisy speed in flight that are averaged, what gravity does between them known."""
DEVIATIONS = 10.0
"""So many deviations of the measured speed are no impact."""


class Striker(ModelBased):
    r"""Strikes a body so that it flies as high as requested, or a wall with the requested speed.

    The next contact is known from the flight of the body: its time, at the place :math:`z^*`, and
    the speed :math:`v^-` with which the body comes. To leave with :math:`V = \sqrt{2 G H}` it must
    meet a racket that moves with

    .. math::

        w^* = v^- + (V - v^-)/\gamma, \qquad \gamma = (1 + e)\,(M^{-1} N^T)_{body}/D

    The way there is that of least effort, cubic in time. Which acceleration the gap needs is found
    as by `GapTracker`; the gap alone would not know the height. What the model lacks in masses
    and restitution is one number, :math:`\gamma`, and is learnt from each impact.

    Parameters
    ----------
    system : MechanicalSystem
        What the plant is believed to be.
    gap : str
        The gap between racket and body, or before a wall. Of the body's coordinate it has the
        gradient 1.
    body : str, optional
        The coordinate of the body that is struck, which no control moves; none for a wall.
    apex : callable or float, optional
        Height H of flight `k` above `place` (m), ``apex(k)``; asked until the impact.
    speed : callable or float, optional
        For a wall, in place of `apex`: the speed of blow `k` (m/s), ``speed(k)``.
    interval : float
        For a wall: time between two blows (s).
    place : float
        Where the racket meets the body (m).
    h : float
        Sampling period, > 0 (s).
    learn : bool
        Whether :math:`\gamma` is learnt.
    u_limits : sequence of (float, float), optional
        Range of each control.
    posture : float
        Damping of what moves beside the gap (1/s).
    delay : int
        Periods from a measurement to the moment when its control acts, 0 to 64.

    Raises
    ------
    ValueError, TypeError
        For a setting out of range, a name that is none of the system, not exactly one of `apex` and
        `speed`.

    Examples
    --------
    >>> racket = zivi.MechanicalSystem(
    ...     mass=np.diag([0.2, 1.0]), force=[-0.2 * 9.81, -9.81],
    ...     gaps=[zivi.LinearGap([1, -1], name="racket")], e=0.6,
    ...     coordinates=["ball", "paddle"], inputs=[[0.0], [1.0]],
    ... )
    >>> ctl = zivi.Striker(racket, gap="racket", body="ball", apex=0.5)
    >>> run = zivi.simulate_closed_loop(racket, ctl, (0, 6), ([0.4, 0.0], [0, 0]))
    >>> float(run.q[run.t > 4, 0].max().round(4))
    0.5
    """

    def __init__(
        self,
        system: MechanicalSystem,
        *,
        gap: str,
        body: str | None = None,
        apex: Callable[[int], float] | float | None = None,
        speed: Callable[[int], float] | float | None = None,
        interval: float = 0.5,
        place: float = 0.0,
        h: float = 1e-3,
        learn: bool = True,
        u_limits: Sequence[Sequence[float]] | None = None,
        posture: float = 20.0,
        delay: int = 0,
    ) -> None:
        if gap not in believed(system).gap_names:
            raise ValueError(f"gap must be one of {system.gap_names}, got {gap!r}")
        if (apex is None) == (speed is None) or (body is None) != (apex is None):
            raise ValueError("either body and apex must be given, or speed, for a wall")
        self._gap, self._body = system.gap_names.index(gap), -1
        settings: dict[str, Any] = {
            "gap": gap,
            "body": body,
            "apex": apex,
            "speed": speed,
            "interval": real("interval", interval),
            "place": real("place", place),
            "h": real("h", h),
            "learn": bool(learn),
            "u_limits": u_limits,
            "posture": real("posture", posture),
            "delay": delay_of(delay),
        }
        for name in ("h", "interval"):
            if not settings[name] > 0.0:
                raise ValueError(f"{name} must be > 0, got {settings[name]}")
        super().__init__(system, settings)
        self._noise = 0.0

    @property
    def strokes(self) -> int:
        """How many impacts were seen."""
        return self._k

    @property
    def gamma(self) -> float:
        """Change of the body's speed by an impact, as a part of the closing speed; NaN before."""
        return self._gamma

    def reset(self) -> None:
        """Forget all that was measured and learnt."""
        super().reset()
        self._k, self._gamma, self._plan = 0, math.nan, (0.0, 0.0)
        self._last: tuple[float, ...] | None = None
        self._flight: tuple[int, float] = (0, 0.0)
        self._strike_at: float | None = None

    @property
    def state(self) -> tuple[Any, ...]:
        """All that changes from tick to tick; assigning it restores what it was of exactly."""
        own = (self._k, self._gamma, self._plan, self._last, self._flight, self._strike_at)
        return (*own, *numbers([self._u]), numbers(self._queue), int(self._status))

    @state.setter
    def state(self, state: tuple[Any, ...]) -> None:
        self._k, self._gamma, self._plan, self._last, *rest = state
        self._flight, self._strike_at, u, queue, status = rest
        self._u = None if u is None else np.array(u)
        self._queue, self._status = [np.array(it) for it in queue], TickStatus(status)

    def __setstate__(self, state: dict[str, Any]) -> None:
        Striker.__init__(self, state["system"], **state["settings"])
        self._noise, self.state = state["noise"], state["state"]

    def sensed(self, noise: Sequence[float], steps: Sequence[float]) -> None:
        """Take note of the sensor: deviations and steps of coordinates and of velocities."""
        self._noise = DEVIATIONS * float(noise[1]) + 2.0 * float(steps[1])

    def step(self, t: float, q: ArrayLike, qdot: ArrayLike) -> Array:
        """Give the controls for the period that starts now.

        Parameters
        ----------
        t : float
            Time (s).
        q, qdot : array_like
            Measured coordinates and velocities, shape (n,).

        Returns
        -------
        ndarray
            The controls, shape (r,). Where a measurement is not finite they are the last ones, and
            the status is ``REFUSED``.
        """
        there = self._outlook(t, q, qdot, np.zeros(self.system.m, dtype=bool))
        if there is None:
            return self._hold_controls()
        t, at, speed, kinetics, matrix = there
        gap, rate = float(kinetics.here.gaps[self._gap]), float(kinetics.gdot[self._gap])
        pull = self._pull(kinetics)
        x, v = (0.0, 0.0) if self._body < 0 else (float(at[self._body]), float(speed[self._body]))
        self._look(t, gap, rate, v, pull, kinetics)
        w = v - rate
        if self._noise > 0.0 and self._body >= 0:
            v = self._averaged(v, pull)
            rate = v - w
        a = self._aim(t, x, v, -pull, x - gap, w)
        self._last = (gap, rate, v, pull - a, pull)
        here, one = kinetics.here, slice(self._gap, self._gap + 1)
        u, limited, _ = _zivi.controls(
            here.mass,
            here.force,
            here.gradients[one],
            here.curvatures[one],
            matrix,
            np.array([pull - a]),
            -self._settings["posture"] * speed,
            pairs(self._settings["u_limits"]),
        )
        if limited:
            self._status |= TickStatus.SATURATED
        return self._sent(u)

    def _look_at(self, q: Array) -> None:
        """Find the body among the coordinates."""
        names, body = self.system.coordinate_names(len(q)), self._settings["body"]
        if body is not None and body not in names:
            raise ValueError(f"body must be one of the coordinates {names}, got {body!r}")
        self._body = -1 if body is None else names.index(body)
        there = self.system.at(0.0, q, 0.0 * q)
        if body is not None and abs(there.gradients[self._gap, self._body] - 1.0) > 1e-9:
            raise ValueError(f"gap {self._settings['gap']!r} must grow as {body!r} does")

    def _pull(self, kinetics: GapKinetics) -> float:
        """Give the acceleration of the body in flight; 0 of a wall."""
        if self._body < 0:
            return 0.0
        return float(np.linalg.solve(kinetics.here.mass, kinetics.here.force)[self._body])

    def _look(
        self, t: float, gap: float, rate: float, v: float, pull: float, kinetics: GapKinetics
    ) -> None:
        """Notice an impact since the last sample, and learn from it."""
        i = self._gap
        if math.isnan(self._gamma):
            share = 1.0 if self._body < 0 else kinetics.mobility[self._body, i] / kinetics.D[i, i]
            self._gamma = float((1.0 + self.system.e[i]) * share)
        if self._last is None:
            return
        g0, rate0, v0, relative, before = self._last
        jump = (rate - rate0 - self.h * relative) if self._body < 0 else v - v0 - self.h * before
        if jump <= max(JUMP * max(1.0, abs(rate0)), self._noise):
            return
        closing = math.sqrt(max(rate0 * rate0 - 2.0 * relative * max(g0, 0.0), 0.0))
        if self._settings["learn"] and closing > 10.0 * self.h * abs(relative) and rate0 < 0.0:
            part = LEARNT if self._noise == 0.0 else max(LEARNT / (1 + self._k), LEAST)
            self._gamma += part * (jump / closing - self._gamma)
        self._k += 1
        self._strike_at, self._flight = None, (0, 0.0)

    def _averaged(self, v: float, pull: float) -> float:
        """Give the speed of the body from all its samples in this flight."""
        n, before = self._flight
        expected = before + self.h * pull if n else v
        n = min(n + 1, MEAN)
        self._flight = (n, expected + (v - expected) / n)
        return self._flight[1]

    def _aim(self, t: float, x: float, v: float, G: float, z: float, w: float) -> float:
        """Give the acceleration of the racket, at z with the speed w."""
        h = self.h
        if self._body < 0:
            if self._strike_at is None:
                self._strike_at = t + float(self._settings["interval"])
            goal, left = 0.0, self._strike_at - t
            meeting = _positive_setting("speed", self._settings["speed"], self._k)
        else:
            goal = float(self._settings["place"])
            energy = v * v + 2.0 * G * (x - goal)
            if G <= 0.0 or energy < 0.0:
                self._plan = (0.0, 0.0)
                return -100.0 * (z - goal) - 20.0 * w  # out of reach: wait
            coming = -math.sqrt(energy)
            left = (v - coming) / G
            leaving = math.sqrt(
                2.0 * G * _positive_setting("apex", self._settings["apex"], self._k)
            )
            meeting = coming + (leaving - coming) / self._gamma
        if left < FINAL * h:
            self._plan = (self._plan[0] + h * self._plan[1], self._plan[1])
            return self._plan[0]
        a0 = (6.0 * (goal - z) - 2.0 * left * (2.0 * w + meeting)) / left**2
        j = (6.0 * left * (w + meeting) - 12.0 * (goal - z)) / left**3
        self._plan = (a0 + 0.5 * h * j, j)
        return self._plan[0]


def _positive_setting(name: str, given: Any, k: int) -> float:
    value = real(f"{name}({k})", given(k)) if callable(given) else real(name, given)
    if not (math.isfinite(value) and value > 0.0):
        raise ValueError(f"{name} must be finite and > 0, got {value} for stroke {k}")
    return value
