"""Aiming at the next impact: a racket, a hammer, a pusher that gives a body a wanted speed."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

import zivi._zivi as _zivi
from zivi.base.check import Array, finite, not_negative, real, real_array, switch
from zivi.control.component import TickStatus, delay_of
from zivi.control.model_based import ModelBased, Outlook, believed, numbers
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
PUSHES = 50, 500
"""Samples of an unknown acceleration that are averaged, without noise and with it.

Under a delay d that nobody told it is the change of the control over d periods that is learnt, which
the next controls compensate: a loop with the gain 1/50, stable for 1/50 < 2 sin(pi/(4 d + 6)), which
all d up to 64 are.
"""
MEAN = 50
"""Samples of a noisy speed in flight that are averaged, what gravity does between them known."""
DEVIATIONS = 10.0
"""So many deviations of the measured speed are no impact."""


class Sight(NamedTuple):
    """What is seen of a body and of what strikes it.

    Parameters
    ----------
    t : float
        Time (s).
    gap, rate : float
        The gap between them and its rate.
    x, v, pull : float
        Place, speed and acceleration of the body, 0 of a wall.
    relative : float
        Acceleration of the gap from here on.
    """

    t: float
    gap: float
    rate: float
    x: float
    v: float
    pull: float
    relative: float = 0.0

    @property
    def w(self) -> float:
        """Speed of what strikes."""
        return self.v - self.rate


class Striker(ModelBased):
    r"""Strikes a body so that it flies as high as requested, or a wall with the requested speed.

    The next contact is known from the flight of the body: its time, at the place :math:`z^*`, and
    the speed :math:`v^-` with which the body comes. To leave with :math:`V = \sqrt{2 G H}` it must
    meet a racket that moves with

    .. math::

        w^* = v^- + (V - v^-)/\gamma, \qquad \gamma = (1 + e)\,(M^{-1} N^T)_{body}/W

    The way there is that of least effort, cubic in time. Which acceleration the gap needs is found
    as by `GapTracker`; the gap alone would not know the height. What the model lacks in masses
    and restitution is one number, :math:`\gamma`, learnt from each impact; what it lacks in forces
    on the racket is learnt from its acceleration.

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
        Whether :math:`\gamma` and the unknown acceleration of the racket are learnt.
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
            "interval": finite("interval", interval),
            "place": finite("place", place),
            "h": finite("h", h),
            "learn": switch("learn", learn),
            "u_limits": u_limits,
            "posture": not_negative("posture", posture),
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

    @property
    def push(self) -> float:
        """Acceleration of the racket that the model does not know (m/s^2)."""
        return self._push[1]

    def reset(self) -> None:
        """Forget all that was measured and learnt."""
        super().reset()
        self._k, self._gamma, self._plan = 0, math.nan, (0.0, 0.0)
        self._last: Sight | None = None
        self._flight: tuple[int, float] = (0, 0.0)
        self._strike_at: float | None = None
        self._seen: Sight | None = None
        self._acting: tuple[float, ...] = ()
        self._push: tuple[int, float] = (0, 0.0)
        self._impacts = 0

    @property
    def state(self) -> tuple[Any, ...]:
        """All that changes from tick to tick; assigning it restores what it was of exactly."""
        own = (self._k, self._gamma, self._plan, self._last, self._flight, self._strike_at)
        learnt = (self._seen, self._acting, self._push, self._impacts)
        return (*own, learnt, numbers([self._u]), numbers(self._queue), int(self._status))

    @state.setter
    def state(self, state: tuple[Any, ...]) -> None:
        try:
            k, gamma, plan, last, flight, strike_at, learnt, (u,), queue, status = state
            seen, acting, push, impacts = learnt
            sent = [None if it is None else real_array("state", it) for it in (u, *queue)]
            told = TickStatus(status)
        except (TypeError, ValueError) as error:
            raise ValueError(f"state must be what a Striker gave: {error}") from None
        self._k, self._gamma, self._plan, self._last, self._flight = k, gamma, plan, last, flight
        self._strike_at, self._seen, self._acting = strike_at, seen, acting
        self._push, self._impacts, self._status = push, impacts, told
        self._u, self._queue = sent[0], [it for it in sent[1:] if it is not None]

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
        with np.errstate(over="ignore", invalid="ignore"):  # `_sent` refuses what is not finite
            return self._ticked(t, q, qdot)

    def _ticked(self, t: float, q: ArrayLike, qdot: ArrayLike) -> Array:
        there = self._outlook(t, q, qdot, np.zeros(self.system.m, dtype=bool))
        if there is None:
            return self._hold_controls()
        here, one = there.kinetics.here, slice(self._gap, self._gap + 1)
        now = self._sight(there)
        self._learn(self._sight(self._measured(t, q, qdot)) if self.delay else now, there.kinetics)
        if self._jump(self._last, now) > 0.0:
            self._k += 1
            self._strike_at, self._flight = None, (0, 0.0)
        if self._noise > 0.0 and self._body >= 0:
            v = self._averaged(now)
            now = now._replace(v=v, rate=v - now.w)
            if not self.delay:
                self._seen = now
        late = self.delay * self.h  # over which the prediction knows nothing of the push
        w = now.w + self.push * late
        place = now.x - now.gap + 0.5 * self.push * late**2
        a = self._aim(now.t, now.x, now.v, -now.pull, place, w)
        u, limited, _ = _zivi.controls(
            here.mass,
            here.force,
            here.gradients[one],
            here.curvatures[one],
            there.matrix,
            np.array([now.pull - a + self.push]),
            -self._settings["posture"] * there.qdot,
            pairs(self._settings["u_limits"]),
        )
        if limited:
            self._status |= TickStatus.SATURATED
        sent = math.nan if limited else a - self.push
        self._acting = (*self._acting, sent)[-1 - self.delay :]
        self._last = now._replace(relative=now.pull - a)
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

    def _sight(self, there: Outlook) -> Sight:
        """Look at the body and at the racket."""
        i, (t, q, qdot, kinetics, _) = self._gap, there
        gap, rate = float(kinetics.here.gaps[i]), float(kinetics.gdot[i])
        if self._body < 0:
            return Sight(t, gap, rate, 0.0, 0.0, 0.0)
        pull = float(np.linalg.solve(kinetics.here.mass, kinetics.here.force)[self._body])
        return Sight(t, gap, rate, float(q[self._body]), float(qdot[self._body]), pull)

    def _jump(self, last: Sight | None, now: Sight) -> float:
        """Give the change of a speed by an impact since the last sample; 0 without one."""
        if last is None:
            return 0.0
        h = now.t - last.t
        if self._body < 0:
            jump = now.rate - last.rate - h * last.relative
        else:
            jump = now.v - last.v - h * last.pull
        return jump if jump > max(JUMP * max(1.0, abs(last.rate)), self._noise) else 0.0

    def _learn(self, now: Sight, kinetics: GapKinetics) -> None:
        """Learn from an impact since the last measurement, or from the racket's acceleration."""
        if math.isnan(self._gamma):
            i, wall = self._gap, self._body < 0
            share = 1.0 if wall else kinetics.mobility[self._body, i] / kinetics.D[i, i]
            self._gamma = float((1.0 + self.system.e[i]) * share)
        last, self._seen = self._seen, now
        acting = self._acting[0] if len(self._acting) > self.delay else math.nan
        if last is None or not self._settings["learn"] or not math.isfinite(acting):
            return
        relative = now.pull - acting - self.push
        jump = self._jump(last._replace(relative=relative), now)
        if jump == 0.0:
            n, push = self._push
            n = min(n + 1, PUSHES[self._noise > 0.0])
            unasked = (now.w - last.w) / (now.t - last.t) - acting
            self._push = (n, push + (unasked - push) / n)
            return
        closing = math.sqrt(max(last.rate**2 - 2.0 * relative * max(last.gap, 0.0), 0.0))
        if closing > 10.0 * self.h * abs(relative) and last.rate < 0.0:
            part = LEARNT if self._noise == 0.0 else max(LEARNT / (1 + self._impacts), LEAST)
            self._gamma += part * (jump / closing - self._gamma)
        self._impacts += 1

    def _averaged(self, now: Sight) -> float:
        """Give the speed of the body from all its samples in this flight."""
        n, before = self._flight
        expected = before + self.h * now.pull if n else now.v
        n = min(n + 1, MEAN)
        self._flight = (n, expected + (now.v - expected) / n)
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
