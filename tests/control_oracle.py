"""Controllers and plant written out a second time, in NumPy: nothing of zivi is used.

The steps are those of the controllers' documentation, all signs at the end of the period:

    regulator   v+ = v + h (ls (F - mu1) - mu2 lv) / R                s+ = s + h R v+
    tracker     v+ = v + h (ls^2 C + ls (1 - ls^2) F / R)             s+ = s + h R v+
                C = A - mu1 les - mu2 lev      A = lsr Fr / Rr        u = R ls C - ls^2 F
    reference   vr+ = vr + h A                                        sr+ = sr + h Rr vr+

Solutions are found by going through all sign patterns (a sign is -1, 1, or free where its argument
vanishes), the roots of a pattern by `numpy.roots`.
"""

import dataclasses
import math

import numpy as np

EPS = np.finfo(float).eps


def sgn(value):
    return float(np.sign(value))


def lifted(x, xdot, kappa):
    return x, xdot / (1 - kappa * sgn(xdot))


def projected(s, v, kappa):
    if s == 0:
        return 0.0, (1 - kappa) * abs(v)
    return abs(s), (1 - kappa * sgn(s) * sgn(v)) * v * sgn(s)


def off_the_signs(signs, rows, scales):
    """How far `signs` are from the set-valued signs of `rows`: the natural map, row by row."""
    rows = np.asarray(rows) / np.asarray(scales)
    signs = np.asarray(signs)
    return np.abs(np.maximum(signs - 1, np.minimum(signs + 1, -rows)))


@dataclasses.dataclass(frozen=True)
class Tracking:
    """One tick of the tracker: where plant and reference start, and what acts on them."""

    h: float
    kappa: float
    kappa_ref: float
    mu1: float
    mu2: float
    z: tuple[float, float]
    z_ref: tuple[float, float]
    f: float
    f_ref: float

    def r(self, ls, lv):
        return 1 - self.kappa * ls * lv

    def reference(self, lsr, lvr):
        """`(sr+, vr+, A)` for these signs."""
        rr = 1 - self.kappa_ref * lsr * lvr
        a = lsr * self.f_ref / rr
        v = self.z_ref[1] + self.h * a
        return self.z_ref[0] + self.h * rr * v, v, a

    def plant(self, ls, lv, les, lev, a):
        """`(s+, v+, u)` for these signs."""
        r, c = self.r(ls, lv), a - self.mu1 * les - self.mu2 * lev
        v = self.z[1] + self.h * (ls * ls * c + ls * (1 - ls * ls) * self.f / r)
        return self.z[0] + self.h * r * v, v, r * ls * c - ls * ls * self.f

    def ends(self, signs):
        """`s+, v+, sr+, vr+, u` for all six signs."""
        ls, lv, lsr, lvr, les, lev = signs
        sr, vr, a = self.reference(lsr, lvr)
        s, v, u = self.plant(ls, lv, les, lev, a)
        return s, v, sr, vr, u

    def residuals(self, signs):
        """The natural map of the six signs; each row relative to the sizes of its terms."""
        s, v, sr, vr, _ = self.ends(signs)
        a = abs(self.f_ref) / (1 - self.kappa_ref)
        push = self.h * (a + self.mu1 + self.mu2 + abs(self.f) / (1 - self.kappa))
        fast = (1 + self.kappa) * (abs(self.z[1]) + push)
        fast_ref = (1 + self.kappa_ref) * (abs(self.z_ref[1]) + self.h * a)
        size_v, size_s = abs(self.z[1]) + push, abs(self.z[0]) + self.h * fast
        size_vr = abs(self.z_ref[1]) + self.h * a
        size_sr = abs(self.z_ref[0]) + self.h * fast_ref
        rows = [s, v, sr, vr, s - sr, v - vr]
        scales = [size_s, size_v, size_sr, size_vr, size_s + size_sr, size_v + size_vr]
        return off_the_signs(signs, rows, np.maximum(scales, 1e-300))

    def solutions(self, target, lvr):
        """All `(place, s+, v+, u)` of the plant for a known `(sr+, vr+, A)`, for `s != 0`.

        Off the wall `lv` is free where `v+ = 0`: then it is that of the reference.
        """
        return [
            *self._off_the_wall(1.0, target, lvr),
            *self._off_the_wall(-1.0, target, lvr),
            *self._on_the_wall(target),
        ]

    def selected(self, target, lvr):
        """The solution of the selection rule: same side, other side, wall nearest to `vr+`."""
        side = 1.0 if self.z[0] >= 0 else -1.0
        found = self.solutions(target, lvr)
        for place in (side, -side):
            there = [solution for solution in found if solution[0] == place]
            if there:
                return there[0]
        return min(found, key=lambda solution: abs(solution[2] - target[1]))

    def _off_the_wall(self, g, target, lvr):
        """`ls = g`: then `v+ = v + h C`, and `lv` matters only through `R v+`."""
        (s, v), h, (sr, vr, a) = self.z, self.h, target

        def travel(y):  # R y for ls = g
            return y * self.r(g, sgn(y))

        def needed(aim):  # y with s + h R y = aim
            y = (aim - s) / h
            return y / self.r(g, sgn(y))

        for les in (-1.0, 1.0, None):
            for lev in (-1.0, 1.0, None):
                if les is None and lev is None:
                    continue  # both errors zero at once: not for random data
                if les is None:
                    y, position = needed(sr), sr
                    les_found = (a - self.mu2 * lev - (y - v) / h) / self.mu1
                    fits = abs(les_found) <= 1 and lev * (y - vr) >= 0
                    c = (y - v) / h
                elif lev is None:
                    y = vr
                    lev_found = (a - self.mu1 * les - (y - v) / h) / self.mu2
                    position = s + h * travel(y)
                    fits = abs(lev_found) <= 1 and les * (position - sr) >= 0
                    c = (y - v) / h
                else:
                    c = a - self.mu1 * les - self.mu2 * lev
                    y = v + h * c
                    position = s + h * travel(y)
                    fits = les * (position - sr) >= 0 and lev * (y - vr) >= 0
                if fits and g * position >= 0:
                    u = self.r(g, sgn(y) if y else lvr) * g * c - self.f
                    yield g, position, y, u

    def _on_the_wall(self, target):
        """`s+ = 0`: `R v+ = -s/h`, hence `lv = -sgn s`; one equation for `ls`."""
        (s, v), h, (sr, vr, a) = self.z, self.h, target
        lv, travel, les = -sgn(s), -s / h, -sgn(sr)
        for lev in (-1.0, 1.0, None):
            if lev is None:
                # v+ = vr+: ls from R, lev from the velocity
                if vr == 0:
                    continue
                ls = (1 - travel / vr) / (self.kappa * lv)
                if not 0 < abs(ls) <= 1:
                    continue
                r = self.r(ls, lv)
                c = ((vr - v) / h - ls * (1 - ls * ls) * self.f / r) / (ls * ls)
                if abs((a - self.mu1 * les - c) / self.mu2) <= 1:
                    yield 0.0, 0.0, vr, r * ls * c - ls * ls * self.f
                continue
            c = a - self.mu1 * les - self.mu2 * lev
            # travel = R v + h (R ls^2 C + ls (1 - ls^2) F),  R = 1 - k ls
            k = self.kappa * lv
            cubic = [-h * (k * c + self.f), h * c, h * self.f - k * v, v - travel]
            for root in np.roots(cubic):
                ls = root.real
                if abs(root.imag) > 1e-9 * max(1, abs(root)) or abs(ls) > 1:
                    continue
                r = self.r(ls, lv)
                if lev * (travel / r - vr) >= 0:
                    yield 0.0, 0.0, travel / r, r * ls * c - ls * ls * self.f


@dataclasses.dataclass(frozen=True)
class Regulation:
    """One tick of the regulator."""

    h: float
    kappa: float
    mu1: float
    mu2: float
    z: tuple[float, float]
    f: float

    def ends(self, ls, lv):
        r = 1 - self.kappa * ls * lv
        v = self.z[1] + self.h * (ls * (self.f - self.mu1) - self.mu2 * lv) / r
        return self.z[0] + self.h * r * v, v, -self.mu1 - self.mu2 * ls * lv

    def residuals(self, signs):
        s, v, _ = self.ends(*signs)
        push = self.h * (self.mu1 + self.mu2 + abs(self.f)) / (1 - self.kappa)
        size_v = abs(self.z[1]) + push
        size_s = abs(self.z[0]) + self.h * (1 + self.kappa) * size_v
        return off_the_signs(signs, [s, v], [size_s, size_v])

    def solutions(self):
        """All `(ls, lv)`, for `s != 0`; in `travel = R v+` every pattern is linear."""
        (s, v), h = self.z, self.h
        for g in (-1.0, 1.0):
            for lv in (-1.0, 1.0, None):
                if lv is None:  # v+ = 0: R v + h (g (F - mu1) - mu2 lv) = 0
                    lv = (v + h * g * (self.f - self.mu1)) / (self.kappa * g * v + h * self.mu2)
                    if abs(lv) <= 1 and g * s >= 0:
                        yield g, lv
                    continue
                end, speed, _ = self.ends(g, lv)
                if lv * speed >= 0 and g * end >= 0:
                    yield g, lv
        lv, travel = -sgn(s), -s / h
        slope = -self.kappa * lv * v + h * (self.f - self.mu1)
        ls = (travel - v + h * self.mu2 * lv) / slope
        if abs(ls) <= 1:
            yield ls, lv


def reference_solution(z_ref, f_ref, h, kappa):
    """The end of the reference's step for ``f_ref < 0`` and ``s_r != 0``, where it is unique."""
    (s, v), found = z_ref, []
    for g in (-1.0, 1.0):
        for lv in (-1.0, 1.0):
            r = 1 - kappa * g * lv
            end = v + h * g * f_ref / r
            if lv * end > 0 and g * (s + h * r * end) > 0:
                found.append((s + h * r * end, end))
        if v != 0:
            r = -g * h * f_ref / v  # v+ = 0
            if 1 - kappa <= r <= 1 + kappa and g * s > 0:
                found.append((s, 0.0))
    lv, travel = -sgn(s), -s / h
    ls = (travel - v) / (h * f_ref - kappa * lv * v)
    if abs(ls) <= 1:
        found.append((0.0, travel / (1 - kappa * ls * lv)))
    return found


def settling_time(x0, xdot0, *, mu1, mu2, e, f=0.0):
    """When the regulated mass rests: free fall pieces under ``f - mu1 - mu2 sgn x'``."""
    up, down = mu1 - f + mu2, mu1 - f - mu2  # decelerations
    t, height = 0.0, x0
    fall = -xdot0
    if xdot0 > 0:
        t, height, fall = xdot0 / up, x0 + xdot0**2 / (2 * up), 0.0
    contact = math.sqrt(fall**2 + 2 * down * height)
    t += (contact - fall) / down
    ratio = e * math.sqrt(down / up)
    return t + e * contact * (1 / up + 1 / math.sqrt(up * down)) / (1 - ratio)


class Flights:
    """A ball event by event under accelerations that are held for given times."""

    def __init__(self, x, xdot, e):
        self.t, self.x, self.v, self.e = 0.0, x, xdot, e
        self.impacts, self.zeno_times, self.liftoff_times = [], [], []
        self.rest_since = 0.0 if x == 0 and xdot == 0 else None

    def hold(self, a, until):
        """Move on to `until` under the acceleration `a`."""
        if self.x == 0 and self.v < 0:
            self._bounce(self.v)
            if self.v == 0 and a <= 0:
                self._rest(self.t)
        while True:
            left = until - self.t
            if self.x == 0 and self.v == 0:
                if a <= 0:
                    self.t = until
                    if self.rest_since is None:
                        self.rest_since = until
                    return
                if self.rest_since is not None:
                    self.liftoff_times.append(self.t)
                    self.rest_since = None
            if self.x == 0 and a < 0 and self.e < 1 and self.v > 0:
                accumulation = 2 * self.v / (-a * (1 - self.e))
                # a tail of impacts that nobody can tell apart any more
                if accumulation <= min(left, 1e-12 * max(1.0, until)):
                    self._rest(self.t + accumulation)
                    continue
            dt = self._to_the_wall(a)
            if dt is None or dt > left:
                self.x = max(0.0, self.x + left * self.v + a * left * left / 2)
                self.v += a * left
                self.t = until
                return
            before = -abs(self.v) if self.x == 0 else -math.sqrt(self.v**2 - 2 * a * self.x)
            self.t += dt
            self._bounce(before)
            if self.v == 0 and a <= 0:
                self._rest(self.t)

    def _rest(self, t):
        self.t, self.x, self.v, self.rest_since = t, 0.0, 0.0, t
        self.zeno_times.append(t)

    def _bounce(self, before):
        self.x, self.v = 0.0, -self.e * before
        self.impacts.append((self.t, before, self.v))

    def _to_the_wall(self, a):
        """The least positive root of ``x + v t + a t^2/2``, or None."""
        if self.x == 0:
            return -2 * self.v / a if a < 0 < self.v else None
        if a == 0:
            return -self.x / self.v if self.v < 0 else None
        square = self.v**2 - 2 * a * self.x
        if square < 0 or (a > 0 and self.v >= 0):
            return None
        root = math.sqrt(square)
        # of the quadratic formula's two forms the one without cancellation
        return 2 * self.x / (root - self.v) if self.v < 0 else (self.v + root) / -a
