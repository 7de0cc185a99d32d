"""Motions under linear forces, event by event and in closed form: nothing of zivi is used.

Between events ``x'' = -k x - c x' - g + A cos(w t + phase)`` is a sum of exponentials, or, for
times so short that the sum cancels, a Taylor series. The next impact is approached from the left by
steps that cannot pass a root: if ``|x''| <= M`` then ``x`` is at least ``x + x' s - M s^2 / 2``.
A chain of impacts is closed by the expansion of its end in the speed, whose third order is left
out, where that is below rounding. The mass leaves rest where ``A cos(w t + phase)`` exceeds ``g``.
"""

import bisect
import cmath
import dataclasses
import math

TERMS = 16
SLOW = 1e-5
"""Speed below which a chain of impacts is closed, unless another is asked for."""


@dataclasses.dataclass(frozen=True)
class Linear:
    """The force and the coefficient of restitution."""

    stiffness: float = 0.0
    damping: float = 0.0
    gravity: float = 0.0
    amplitude: float = 0.0
    omega: float = 1.0
    phase: float = 0.0
    e: float = 0.5

    def at_wall(self, t):
        return self.amplitude * math.cos(self.omega * t + self.phase) - self.gravity

    def growth_at_wall(self, t):
        return -self.amplitude * self.omega * math.sin(self.omega * t + self.phase)

    @property
    def fastest(self):
        return max(self.omega, math.sqrt(self.stiffness), self.damping)


class Flight:
    """The motion from ``(t, x, v)`` as if there were no wall."""

    def __init__(self, f, t, x, v):
        self.t, self.x, self.v = t, x, v
        k, c, g, w = f.stiffness, f.damping, f.gravity, f.omega
        # x = d + r tau - b tau^2 + sum of powers exp(rate tau), in real parts
        angle = cmath.exp(1j * (w * t + f.phase))
        self.short = 0.25 / f.fastest
        self.d = self.r = self.b = 0.0
        self.sum = []
        if f.amplitude:
            self.sum.append((f.amplitude * angle / (k - w * w + 1j * c * w), 1j * w))
        if k:
            self.d = -g / k
        elif c:
            self.r = -g / c
        else:
            self.b = 0.5 * g
        x0 = x - self.d - sum(p.real for p, _ in self.sum)
        v0 = v - self.r - sum((p * rate).real for p, rate in self.sum)
        if k or c:
            root = cmath.sqrt(0.25 * c * c - k)
            one, two = -0.5 * c + root, -0.5 * c - root
            first = (v0 - two * x0) / (one - two)
            self.sum += [(first, one), (x0 - first, two)]
        else:
            self.d, self.r = x0, v0
        # with no growth in time, bounds of the derivatives two and four
        self.bound = 2 * abs(self.b) + sum(abs(p) * abs(rate) ** 2 for p, rate in self.sum)
        self.taylor = self._taylor(f, angle)

    def _taylor(self, f, angle):
        derivatives = [self.x, self.v]
        forcing = f.amplitude * angle
        for n in range(TERMS - 2):
            excitation = forcing.real - (f.gravity if n == 0 else 0.0)
            derivatives.append(
                -f.stiffness * derivatives[n] - f.damping * derivatives[n + 1] + excitation
            )
            forcing *= 1j * f.omega
        return [value / math.factorial(n) for n, value in enumerate(derivatives)][::-1]

    def after(self, tau):
        """Position and velocity."""
        if tau < self.short:
            x = v = 0.0
            for a in self.taylor:
                v = v * tau + x
                x = x * tau + a
            return x, v
        x = self.d + (self.r - self.b * tau) * tau
        v = self.r - 2 * self.b * tau
        for p, rate in self.sum:
            q = p * cmath.exp(rate * tau)
            x += q.real
            v += (rate * q).real
        return x, v

    def impact(self, longest, safe):
        """Time until the wall is met, and the velocity there; None if not within `longest`.

        There is no root in ``(0, safe]``.
        """
        tau, bound = safe, self.bound
        while tau < longest:
            x, v = self.after(tau)
            if x <= 0.0:  # by rounding
                return tau, v
            step = (v + math.sqrt(v * v + 2 * bound * x)) / bound
            if v < 0.0:  # the same without cancellation
                step = 2 * x / (math.sqrt(v * v + 2 * bound * x) - v)
            if step <= 2e-16 * tau:
                return tau, v
            tau += step
        return None


@dataclasses.dataclass
class Story:
    """What happened, in order."""

    impacts: list = dataclasses.field(default_factory=list)
    """Time, speed before and after each impact, down to `slow`."""
    zeno: list = dataclasses.field(default_factory=list)
    lift: list = dataclasses.field(default_factory=list)
    at_rest: bool = False
    starts: list = dataclasses.field(default_factory=list)
    motions: list = dataclasses.field(default_factory=list)

    def add(self, t, motion):
        self.starts.append(t)
        self.motions.append(motion)

    def state(self, t):
        """Position and velocity; None within a part of a chain that was closed."""
        motion = self.motions[bisect.bisect_right(self.starts, t) - 1]
        if isinstance(motion, Flight):
            return motion.after(t - motion.t)
        return motion


def simulate(f, span, start, slow=SLOW):
    """Follow the motion from ``start = (x, v)``."""
    story = Story()
    (t, end), (x, v) = span, start
    if x == 0.0 and v < 0.0:
        story.impacts.append((t, -v, -f.e * v))
        v = -f.e * v
        if v == 0.0 and f.at_wall(t) < 0.0:
            story.zeno.append(t)
    while t < end:
        if x == 0.0 and v == 0.0 and f.at_wall(t) < 0.0:
            story.add(t, (0.0, 0.0))
            t = _lift(f, t)
            if t >= end:
                story.at_rest = True
                break
            story.lift.append(t)
            story.at_rest = False
            flight = Flight(f, t, 0.0, 0.0)
            safe = 4 * f.growth_at_wall(t) / _bound_of(flight, 4)
        else:
            flight = Flight(f, t, x, v)
            if x > 0.0:
                safe = 0.0
            elif v > 0.0:
                safe = 2 * v / flight.bound
            else:
                safe = 3 * f.at_wall(t) / _bound_of(flight, 3)
        story.add(t, flight)
        # just below what is free of roots, where the steps can start
        found = flight.impact(end - t, 0.99 * safe)
        if found is None:
            break
        tau, before = found
        t, x, v = t + tau, 0.0, -f.e * before
        story.impacts.append((t, -before, v))
        pull = -f.at_wall(t)
        if v == 0.0 and pull > 0.0:
            story.zeno.append(t)
        elif v < slow and pull > 0.0 and f.e < 1.0:
            rest = t + _until_rest(f, t, v)
            if v * f.fastest < 1e-3 * pull * (1 - f.e) and f.at_wall(rest) < 0.0:
                story.add(t, None)
                story.zeno.append(rest)
                story.at_rest = rest < end
                t, v = rest, 0.0
    return story


def _bound_of(flight, n):
    """Bound of derivative `n` of three or more."""
    return sum(abs(p) * abs(rate) ** n for p, rate in flight.sum)


def _until_rest(f, t, u):
    """The rest of a chain after an impact with speed `u`, to second order in `u`."""
    g, a, c, e = -f.at_wall(t), f.growth_at_wall(t), -f.damping, f.e
    first = 2 / (g * (1 - e))
    b = (c - a / g) * 2 / (3 * g)
    flight = 4 * a / (3 * g**3) + 2 * c / (3 * g**2)
    second = flight + first * e * b + (2 * e / g) * (2 * a / (g**2 * (1 - e)))
    return first * u + second / (1 - e * e) * u * u


def _lift(f, t):
    """The first time from `t` at which the force begins to pull outward."""
    if f.amplitude <= f.gravity:
        return math.inf
    # cos(angle) = g/A with a rising cosine: angle = -acos(g/A) + 2 pi n
    angle = -math.acos(f.gravity / f.amplitude) - f.phase
    turns = math.ceil((f.omega * t - angle) / (2 * math.pi))
    return (angle + 2 * math.pi * turns) / f.omega
