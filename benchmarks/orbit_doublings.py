"""Orbits from random starts within 1 % of period doublings: least periods, and doublings found.

``python benchmarks/orbit_doublings.py [starts] [seed]``. A ball on a table, its acceleration being
``-g + F cos(w t + phase)``, has the orbit with one impact in n periods, which doubles at

    F^2 = (g n pi (1 - e)/(1 + e))^2 + (2 g (1 + e^2)/(1 + e)^2)^2

in any units. Half of the starts are beside that orbit, half anywhere; some runs rest, or settle on
another orbit. Of those on the orbit, or on the doubled one, the branch is followed.
"""

from __future__ import annotations

import collections
import math
import sys

import numpy as np

import zivi

DONE = zivi.OrbitStatus.COMPLETED
CLOSE = 1e-9


def repeats(orbit: zivi.PeriodicOrbit) -> bool:
    """Whether the impacts of an orbit repeat after a part of its period."""
    k, length = len(orbit.impacts), orbit.multiple * orbit.period
    t, v = orbit.impacts["t"], orbit.impacts["xdot_before"]
    for parts in range(2, k + 1):
        if k % parts or orbit.multiple % parts:
            continue
        times = t.reshape(parts, -1) - length / parts * np.arange(parts)[:, None]
        apart = max(np.ptp(times, axis=0).max() / length, np.ptp(v.reshape(parts, -1)) / max(-v))
        if apart < 1e-5:
            return True
    return False


def draw(rng: np.random.Generator, beside: bool):
    """Draw a table near its doubling, the amplitude of that, and a start."""
    e = 0.0 if rng.random() < 0.1 else rng.uniform(0.1, 0.85)
    g, w, phase = 10 ** rng.uniform(-1, 2), 10 ** rng.uniform(-1, 2), rng.uniform(0, 2 * math.pi)
    n = int(rng.integers(1, 3))
    cos = g * n * math.pi * (1 - e) / (1 + e)
    doubling = math.hypot(cos, 2 * g * (1 + e * e) / (1 + e) ** 2)
    amplitude = doubling * (1 + rng.choice([-1, 1]) * 10 ** rng.uniform(-7, -2))
    force = zivi.LinearForce(gravity=g, amplitude=amplitude, omega=w, phase=phase)
    # F cos(w t + phase) = F sin(w t + phase + pi/2), F cos of that angle is that above
    t = (math.acos(min(1.0, cos / amplitude)) - phase - math.pi / 2) % (2 * math.pi) / w
    u = 2 * math.pi * n * g / w * e / (1 + e)
    speed = 2 * math.pi * n * g / w / (1 + e)
    if beside:
        off = 0.05 * rng.normal(size=2)
        start = (t + abs(off[0]) / w, (1e-12 * speed / w, (u + 0.05 * speed * abs(off[1]))))
    else:
        start = (t, (rng.uniform(0, 1) * speed**2 / g, rng.uniform(-1, 1) * speed))
    return zivi.ImpactSystem(force, e=e), doubling, n, start


def sweep(starts: int, seed: int = 1) -> collections.Counter[str]:
    """Count what is found from random starts."""
    rng, counts = np.random.default_rng(seed), collections.Counter()
    for i in range(starts):
        system, doubling, n, start = draw(rng, i % 2 == 0)
        orbit = zivi.periodic_orbit(system, start)
        told = f"{orbit.kind} {orbit.status.name}"
        if orbit.kind != "impacting" or orbit.status is not DONE:
            counts[told] += 1
            continue
        counts["unreduced"] += repeats(orbit)
        single = len(orbit.impacts) == 1 and orbit.multiple == n
        double = len(orbit.impacts) == 2 and orbit.multiple == 2 * n
        counts["single" if single else "double" if double else "another orbit"] += 1
        if single or double:
            span = (0.96 * doubling, 1.04 * doubling)
            branch = zivi.continue_orbit(orbit, "amplitude", span, step=0.1)
            values = [event.value for event in branch.of_kind("period_doubling")]
            hit = any(abs(value / doubling - 1) < CLOSE for value in values)
            counts["doubling found" if hit else "doubling missed"] += 1
            counts["branch with a repeated orbit"] += any(repeats(it) for it in branch.orbits)
            if not hit:
                print("missed:", system, start, orbit, branch, branch.message)
    return counts


if __name__ == "__main__":
    given = [int(it) for it in sys.argv[1:]]
    for told, count in sorted(sweep(*(given or [500])).items()):
        print(f"{told:32s} {count}")
