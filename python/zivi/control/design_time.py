r"""How long a sampled landing takes at most, for any unknown force within its bound.

The mass falls with ``D``, an unknown force of at most ``M`` added or not, and rises against as
much of the brake ``U`` as the sampled, late control has. One flight after the other is taken at
its longest and at its fastest end:

.. math::

    w \le v_s = N h U\,(+ 2 q): \quad T \le \frac{w \left( 1/(m-M) + 1/\sqrt{(m-M)(D-M)}
    \right)}{1 - r}, \qquad r = e \sqrt{\frac{D+M}{m-M}}, \qquad m = \min(U, D)

below the speed ``v_s`` under which the brake is not taken in full.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from zivi.base.check import Array

__all__ = ["Landing", "Settled", "settled"]

FLIGHTS = 100_000
"""Flights after which a landing counts as endless."""
NEAR = 1.1
"""Part of its last cycle's speed to which a mass that does not rest exactly has to come."""


@dataclasses.dataclass(frozen=True)
class Landing:
    """What lands: where, from where, how it is sampled.

    Parameters
    ----------
    e : float
        Coefficient of restitution.
    force, bound : float
        The known force, and M (m/s^2).
    start : (float, float)
        Distance from the wall (m) and velocity (m/s).
    delay : int
        Periods from a measurement to the moment when its control acts.
    quiet : float
        Bound of the errors of the measured velocity, the dead zone of the landing (m/s).
    """

    e: float
    force: float
    bound: float
    start: tuple[float, float]
    delay: int
    quiet: float

    def released(self, h: Array) -> tuple[Array, Array, Array]:
        """Give the highest place, the least and the largest velocity when the first control acts.

        Until then only the known and the unknown force act.
        """
        (x, v), time = self.start, self.delay * h
        low, high = self.force - self.bound, self.force + self.bound
        slowest, fastest = v + low * time, v + high * time
        top = x + max(v, 0.0) * time + 0.5 * max(high, 0.0) * time**2
        # the lowest place on the way: may it have met the wall?
        turn = np.clip(-v / low, 0.0, time) if low > 0.0 else time
        meets = (self.delay > 0) & (x + v * turn + 0.5 * low * turn**2 <= 0.0)
        speed = abs(v) + max(abs(low), abs(high)) * time
        rebound = self.e * speed + max(high, 0.0) * time
        return (
            np.where(meets, np.maximum(top, rebound * time), top),
            np.where(meets, np.minimum(slowest, -speed), slowest),
            np.where(meets, np.maximum(fastest, rebound), fastest),
        )


@dataclasses.dataclass(frozen=True)
class Settled:
    """How a landing ends.

    Parameters
    ----------
    time : ndarray
        Until the mass rests, or stays below `height` (s); infinite where it does neither.
    height : ndarray
        0 where it rests, else how far from the wall it still gets (m).
    """

    time: Array
    height: Array


class _Flights:
    """Flights of the landings with these accelerations, one entry for each."""

    def __init__(self, it: Landing, braking: Array, falling: Array, h: Array) -> None:
        self.late = (1 + it.delay) * h
        self.U, self.D, self.M = braking, falling, it.bound
        self.slow, self.fast = falling - it.bound, falling + it.bound
        self.brake, self.weaker = braking - it.bound, np.minimum(braking, falling) - it.bound
        self.stops = self.late * braking + 2.0 * it.quiet
        self.strong = braking > falling
        # a brake below D that comes late or ends late holds a falling mass up
        self.held = np.where(self.strong, 0.0, self.late * (falling - braking) / self.slow)
        self.e = it.e

    def rise(self, w: Array, late: Array) -> tuple[Array, Array]:
        """Give the longest time and the largest height of a rise with ``w``.

        The brake comes late; it is taken in full down to ``v_s``, then with `D` at least.
        """
        strong, slow, brake = self.strong, self.slow, self.brake
        first = np.maximum(w - slow * late, np.minimum(w, self.stops))
        last = np.minimum(first, self.stops)
        time = (w - first + last) / slow + (first - last) / brake
        height = (w * w - first * first + last * last) / (2.0 * slow)
        height += (first * first - last * last) / (2.0 * brake)
        return np.where(strong, time, w / brake), np.where(strong, height, w * w / (2.0 * brake))

    def flight(self, w: Array) -> tuple[Array, Array, Array]:
        """Give the time, the height and the speed after its impact of a flight with ``w``."""
        time, height = self.rise(w, self.late)
        time = time + np.sqrt(2.0 * height / self.slow) + self.held
        return time, height, self.e * np.sqrt(2.0 * self.fast * height)

    def tail(self, w: Array) -> Array:
        """Give the time of all flights from ``w <= v_s`` on."""
        ratio = self.e * np.sqrt(self.fast / self.slow)
        below_d = 2.0 * w / self.slow / (1.0 - np.where(self.strong, ratio, 0.0))
        growth = self.e * np.sqrt(self.fast / self.brake)
        below_u = 2.0 * w / self.brake / (1.0 - growth) + self.late
        return np.where(self.strong, below_d, below_u)


def settled(
    it: Landing, braking: Array, falling: Array, h: Array, within: float = math.inf
) -> Settled:
    """Bound the time of a landing; times beyond `within` may be given as infinite.

    Parameters
    ----------
    it : Landing
        What lands.
    braking, falling : ndarray
        U and D (m/s^2).
    h : ndarray
        Sampling period (s).
    within : float
        The longest time that is of interest (s).
    """
    with np.errstate(all="ignore"):
        return _settled(it, braking, falling, np.asarray(h), within)


def _settled(it: Landing, braking: Array, falling: Array, h: Array, within: float) -> Settled:
    e, M = it.e, it.bound
    shrinks = (falling > M) & (braking > M) & (e * e * (falling + M) < braking - M)
    rests = shrinks & (e * e * (falling + M) < np.minimum(braking, falling) - M)
    U, D = np.where(shrinks, braking, M + 2.0), np.where(shrinks, falling, M + 1.0)
    flights = _Flights(it, U, D, h)
    time, w = _first_impact(it, flights, h)
    until = np.where(rests, flights.stops, np.maximum(flights.stops, NEAR * _cycle(flights)))
    for _ in range(FLIGHTS):
        on = (w > until) & (time <= within) & shrinks
        if not on.any():
            break
        longer, _, after = flights.flight(w)
        time, w = np.where(on, time + longer, time), np.where(on, after, w)
    time = np.where(rests, time + flights.tail(np.where(rests, w, 0.0)), time) + h
    height = np.where(rests, 0.0, flights.flight(until)[1])
    return Settled(np.where(shrinks & (time <= within), time, np.inf), height)


def _first_impact(it: Landing, flights: _Flights, h: Array) -> tuple[Array, Array]:
    """Give the time of the first impact and the speed after it."""
    x, slowest, fastest = it.released(h)
    up, down = np.maximum(fastest, 0.0), np.maximum(-fastest, 0.0)
    late = flights.late if it.delay else 0.0 * flights.late
    rising, height = flights.rise(up, late)
    top = x + height
    # with the least pull from the slowest, with the largest from the fastest
    falling = 2.0 * top / np.maximum(down + np.sqrt(down * down + 2.0 * flights.slow * top), TINY)
    hit = np.maximum(
        np.sqrt(2.0 * flights.fast * top),
        np.sqrt(np.maximum(-slowest, 0.0) ** 2 + 2.0 * flights.fast * x),
    )
    return it.delay * h + rising + falling + flights.held, it.e * hit


TINY = 1e-300


def _cycle(flights: _Flights) -> Array:
    r"""Give the speed at which the bounces of a mass that does not rest no longer shrink.

    :math:`w^2 = 2 e^2 (D + M) X(w)` with the height of a late brake,

    .. math::

        X = \frac{w^2 - v_1^2 + v_s^2}{2 (D - M)} + \frac{v_1^2 - v_s^2}{2 (U - M)},
        \qquad v_1 = w - (D - M) \tau
    """
    p, q, tau = flights.slow, flights.brake, flights.late
    c = flights.e**2 * flights.fast
    # a w^2 - 2 b w - rest = 0
    a = 1.0 - c / q
    b = c * tau * (1.0 - p / q)
    rest = c * ((p * tau) ** 2 - flights.stops**2) * (1.0 / q - 1.0 / p)
    inside = np.maximum(b * b + a * rest, 0.0)
    return (b + np.sqrt(inside)) / a
