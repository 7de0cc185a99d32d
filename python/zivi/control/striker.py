"""Aiming at the next impact: a racket, a hammer, a pusher that gives a body a wanted speed."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

import zivi._zivi as _zivi
from zivi.base.check import Array, finite, not_negative, positive, switch
from zivi.control.component import TickStatus, delay_of
from zivi.control.mechanical_reference import MechanicalReference
from zivi.control.model_based import ModelBased, believed
from zivi.control.u_limits import limits_of, pairs
from zivi.system.mechanism import MechanicalSystem

__all__ = ["Striker"]

LEARNT = 0.7
"""How much of what an impact showed is taken over."""
LEAST = 0.1
"""The same of late impacts under noise, each of which shows little."""
PUSHES = 50, 500
"""Samples of an unknown acceleration that are averaged, without noise and with it.

Under a delay d that nobody told it is the change of the control over d periods that is learnt,
which the next controls compensate: a loop with the gain 1/50. It is stable for
1/50 < 2 sin(pi/(4 d + 6)), for all d up to 64.
"""
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

    _law: _zivi.Striker

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
        self._gap = system.gap_names.index(gap)
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
        name, target = ("apex", apex) if speed is None else ("speed", speed)
        self._law = _zivi.Striker(
            gap=self._gap,
            e=float(system.e[self._gap]),
            of_wall=body is None,
            place=settings["place"],
            interval=settings["interval"],
            h=settings["h"],
            learns=settings["learn"],
            learning=(LEARNT, LEAST, PUSHES, MEAN),
            limits=pairs(limits_of(u_limits)),
            posture=settings["posture"],
            delay=settings["delay"],
            target=_target(name, target),
        )
        super().__init__(system, settings)

    @property
    def strokes(self) -> int:
        """How many impacts were seen."""
        return int(self._law.state[0])

    @property
    def gamma(self) -> float:
        """Change of the body's speed by an impact, as a part of the closing speed; NaN before."""
        return float(self._law.state[1])

    @property
    def push(self) -> float:
        """Acceleration of the racket that the model does not know (m/s^2)."""
        return float(self._law.state[6][2][1])

    @property
    def status(self) -> TickStatus:
        """What was done to the last sample and to the control."""
        return TickStatus(self._law.state[9])

    @property
    def state(self) -> tuple[Any, ...]:
        """All that changes from tick to tick; assigning it restores what it was of exactly."""
        return self._law.state

    @state.setter
    def state(self, state: tuple[Any, ...]) -> None:
        try:
            self._law.state = state
        except (TypeError, ValueError, OverflowError) as error:
            raise ValueError(f"state must be what a Striker gave: {error}") from None

    def __getstate__(self) -> dict[str, Any]:
        own = {"settings": self._settings, "system": self.system}
        return {**own, "state": self.state, "noise": self._law.noise}

    def __setstate__(self, state: dict[str, Any]) -> None:
        Striker.__init__(self, state["system"], **state["settings"])
        self._law.noise, self.state = state["noise"], state["state"]

    def sensed(self, noise: Sequence[float], steps: Sequence[float]) -> None:
        """Take note of the sensor: deviations and steps of coordinates and of velocities."""
        self._law.noise = DEVIATIONS * float(noise[1]) + 2.0 * float(steps[1])

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
        core, at, speed = self._measured(q, qdot)
        return self._law.step(core, finite("t", t), at, speed)

    def in_loop(self, n: int, reference: MechanicalReference | None) -> _zivi.StrikeLoop:
        """Give what a closed loop of `n` coordinates runs; it has no reference."""
        return _zivi.StrikeLoop(self._law, self._model(np.zeros(n))[1].core)

    def _look_at(self, q: Array) -> None:
        """Find the body among the coordinates."""
        names, body = self.system.coordinate_names(len(q)), self._settings["body"]
        if body is not None and body not in names:
            raise ValueError(f"body must be one of the coordinates {names}, got {body!r}")
        if body is None:
            return
        place = names.index(body)
        self._law.body = place
        there = self.system.at(0.0, q, 0.0 * q)
        if abs(there.gradients[self._gap, place] - 1.0) > 1e-9:
            raise ValueError(f"gap {self._settings['gap']!r} must grow as {body!r} does")


def _target(name: str, given: Any) -> Any:
    """Give heights or speeds as the extension takes them."""
    if callable(given):
        return lambda k: positive(f"{name}({k})", given(k))
    return positive(name, given)
