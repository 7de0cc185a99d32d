"""Random flights and runs under linear forces, and what to compare them with."""

import dataclasses
import math
from functools import partial

import numpy as np

import zivi

COLUMNS = ("k", "c", "g", "A", "w", "phi", "t0", "x0", "v0", "T")
"""Of a row: force, wave, time of the start, state there, and for how long it is followed."""

FAMILIES = {
    "ordinary": 0.7,
    "repelled": 0.05,
    "late": 0.05,
    "damped 1e3": 0.02,
    "damped 1e4": 0.02,
    "damped 1e5": 0.02,
    "damped 1e6": 0.02,
    "fast": 0.02,
    "slow": 0.1,
}
"""Kinds of flights and their share of all."""


def forces(rng, n, name):
    """Numbers of the forces of `n` flights, by rows."""
    pick = partial(np.select, default=0.0)
    kind, damping, wave = rng.integers(0, 3, n), rng.integers(0, 4, n), rng.integers(0, 5, n)
    k = pick([kind == 1, kind == 2], [rng.uniform(0.1, 20, n), rng.uniform(-2, 0, n)])
    c = pick(
        [damping == 1, damping == 2, damping == 3],
        [rng.uniform(0, 2, n), rng.uniform(-0.3, 0, n), 2 * np.sqrt(np.abs(k))],
    )
    g = np.where(rng.random(n) < 0.1, 0.0, rng.uniform(-1, 10, n))
    amplitude = np.where(wave == 0, 0.0, rng.uniform(0, 15, n))
    w = np.where((wave == 1) & (k > 0), np.sqrt(np.abs(k)), rng.uniform(0.5, 12, n))
    if name == "repelled":
        k = rng.uniform(-20, 0, n)
    elif name.startswith("damped"):
        c = float(name.split()[1]) * rng.uniform(0.5, 1.5, n)
    elif name == "fast":
        w = 10 ** rng.uniform(2, 4, n)
        amplitude = rng.uniform(0, 0.02, n) * w**2
    elif name == "slow":
        w *= 10 ** rng.uniform(-6, 0, n)
    return k, c, g, amplitude, w, rng.uniform(-3, 3, n)


def draw(name, n, seed):
    """Rows of one family."""
    rng = np.random.default_rng(seed)
    k, c, g, amplitude, w, phi = forces(rng, n, name)
    x0, v0 = rng.uniform(0, 2, n), rng.uniform(-3, 3, n)
    t0, length = np.zeros(n), 10.0
    if name.startswith("damped"):
        # some fall within a few times 1/c, some slide
        length = 1e3 / float(name.split()[1])
        x0 *= np.where(rng.random(n) < 0.5, np.abs(v0) / c, 0.2 * length * np.abs(g) / c)
    elif name == "fast":
        x0, length = x0 * 0.02, 0.3
    elif name == "late":
        t0 = rng.uniform(0, 1e6, n)
    start = rng.random(n)
    on_wall = (start < 0.35) | (x0 == 0.0)
    x0[on_wall], v0[on_wall] = 0.0, np.abs(v0[on_wall])
    push = amplitude * np.cos(w * t0 + phi) - g
    # without a wave or a damper the mass would come back to touch the wall, no more
    v0[(start < 0.05) & (push > 0.1) & (amplitude > 0)] = 0.0
    return np.column_stack([k, c, g, amplitude, w, phi, t0, x0, v0, np.full(n, length)])


def system_of(row, e=0.0):
    k, c, g, amplitude, w, phi = row[:6]
    force = zivi.LinearForce(
        stiffness=k, damping=c, gravity=g, amplitude=amplitude, omega=w, phase=phi
    )
    return zivi.ImpactSystem(force, e=e)


def first_impacts(flights):
    """Time and velocity of the first impact of each flight, NaN where there is none."""
    found = np.full((len(flights), 2), np.nan)
    groups = {}
    for i, row in enumerate(flights):
        groups.setdefault((row[6], row[9]), []).append(i)
    for (start, length), members in groups.items():
        rows = flights[members]
        batch = zivi.simulate_batch(
            [system_of(row) for row in rows],
            (start, start + length),
            rows[:, 7:9],
            method=zivi.SwitchedRK(flights="series"),
            save="events",
        )
        for i, events in zip(members, batch.events, strict=True):
            if len(events["impacts"]):
                impact = events["impacts"][0]
                found[i] = impact["t"], impact["xdot_before"]
    return found


@dataclasses.dataclass
class Comparison:
    """Flights beside their oracle."""

    flights: int
    impacts: int
    unknown: int
    """Of which the oracle does not know."""
    missed: int
    invented: int
    errors: np.ndarray
    """Of the times, relative to the duration of the flights, as far as the clock does not round."""
    speeds: np.ndarray

    def __str__(self):
        part = [np.quantile(self.errors, q) if len(self.errors) else 0 for q in (0.5, 0.99, 1)]
        return (
            f"{self.flights} flights, {self.impacts} impacts, missed {self.missed}, invented "
            f"{self.invented}, oracle without an answer {self.unknown}; dt/tau median "
            f"{part[0]:.2g}, 99 % {part[1]:.2g}, most {part[2]:.2g}; "
            f"dv/v 99 % {np.quantile(self.speeds, 0.99) if len(self.speeds) else 0:.2g}"
        )


def compare(flights, ours, truth):
    """Impacts `ours` beside the answers of the oracle."""
    known = truth[:, 0] >= 0
    seen, there = ~np.isnan(ours[:, 0]), truth[:, 0] == 1
    # an impact at the end of the time is on either side of it
    end = flights[:, 9]
    last = np.where(seen, ours[:, 0] - flights[:, 6], truth[:, 1]) > end * (1 - 1e-9)
    both = known & seen & there
    tau = truth[both, 1]
    clock = 2.3e-16 * np.abs(flights[both, 6])
    error = np.abs((ours[both, 0] - flights[both, 6] - tau) - truth[both, 2])
    speed = np.abs(ours[both, 1] / truth[both, 3] - 1)
    # another impact than the first is one that was missed or invented
    other = error > 1e-6 * tau + clock
    late = other & (ours[both, 0] - flights[both, 6] > tau)
    return Comparison(
        flights=len(flights),
        impacts=int(there.sum()),
        unknown=int((~known).sum()),
        missed=int((known & there & ~seen & ~last).sum() + late.sum()),
        invented=int((known & ~there & seen & ~last).sum() + (other & ~late).sum()),
        errors=(np.maximum(error - clock, 0.0) / tau)[~other],
        speeds=speed[~other & (flights[both, 6] == 0)],
    )


def draw_touches(n, seed):
    """Flights above the wall whose first minimum shall have a depth, and these depths."""
    rng = np.random.default_rng(seed)
    flights = draw("ordinary", n, seed)
    flights[:, 7] = rng.uniform(0.5, 4, n)
    flights[:, 8] = rng.uniform(-3, 1, n)
    # something has to turn the mass back
    flights[:, 2] = rng.uniform(-2, 1, n)
    flights[:, 3] = np.where(flights[:, 0] > 0, flights[:, 3], rng.uniform(5, 15, n))
    return flights, rng.choice([-1.0, 1.0], n) * 10 ** rng.uniform(-17, -3, n)


def compare_touches(flights, truth):
    """Depths that were missed, heights of invented impacts, errors ``|v| dt`` by the scale."""
    missed, invented, errors = [], [], []
    for row, (found, tau, rest, speed, x0, when, depth) in zip(flights, truth, strict=True):
        if found < 0:
            continue
        scale = x0 + abs(row[8]) + abs(row[2])
        end = when + 1e-2 * min(when, 0.1)
        method = zivi.SwitchedRK(flights="series")
        sol = zivi.simulate(system_of(row), (0, end), (x0, row[8]), method, dense_output=False)
        seen = len(sol.impacts) > 0
        if seen and found:
            errors.append(abs(speed) * abs((sol.impacts["t"][0] - tau) - rest) / scale)
        elif found:
            missed.append(depth)
        elif seen:
            invented.append(-depth)
    return missed, invented, np.array(errors)


def run(random):
    """A whole run of any kind: system, start, time of the start."""
    force = zivi.LinearForce(
        stiffness=random.choice((0.0, random.uniform(0.1, 20), random.uniform(-2, 0))),
        damping=random.choice((0.0, random.uniform(0, 2), random.uniform(-0.3, 0))),
        gravity=random.uniform(-1, 10),
        amplitude=random.choice((0.0, random.uniform(0, 15))),
        omega=random.choice((random.uniform(0.5, 12), -2.0)),
        phase=random.uniform(-3, 3),
    )
    omega, phase = random.choice((force.omega, random.uniform(1, 20))), random.uniform(-3, 3)
    table = zivi.HarmonicWall(
        amplitude=random.uniform(0, 0.1), omega=omega, phase=phase, offset=random.uniform(-0.2, 0.2)
    )
    wall = random.choice((None, None, table))
    e = random.choice((0.0, 0.3, 0.6, 0.8, 0.95, 1.0))
    state = (random.choice((0.0, random.uniform(0, 2))), random.uniform(-3, 3))
    return zivi.ImpactSystem(force, e=e, wall=wall), state, random.choice((0.0, 123.4))


def beside_the_pair(case):
    """How far a run of two seconds is from that of the pair, and whether the events are alike."""
    system, state, t0 = case
    span = (t0, t0 + 2.0)
    ours, other = (
        zivi.simulate(system, span, state, zivi.SwitchedRK(1e-12, 1e-12, flights=flights))
        for flights in ("auto", "rk")
    )
    alike = ours.status == other.status and ours.nfev == 0 < other.nfev
    alike = alike and len(ours.liftoff_times) == len(other.liftoff_times)
    alike = alike and len(ours.zeno_times) == len(other.zeno_times)
    times = np.linspace(*span, 50)
    return np.abs(ours(times)[0] - other(times)[0]).max(), alike


OSCILLATOR = {"stiffness": 1.0, "damping": 0.1, "gravity": -1.0, "amplitude": 0.6, "omega": 0.9}


def errors_of_areas(n, seed):
    """Of ``det J = e^2 (u/u') exp(-c T)``, by the products of which the determinant consists."""
    e = 0.8
    step = zivi.impact_map(zivi.ImpactSystem(zivi.LinearForce(**OSCILLATOR), e=e))
    rng = np.random.default_rng(seed)
    phase, u = rng.uniform(0, 2 * math.pi, n), rng.uniform(0.05, 3, n)
    _, after, jacobian = step(phase, u)
    expected = e**2 * u / after * np.exp(-OSCILLATOR["damping"] * step.duration(phase, u))
    (a, b), (c, d) = np.moveaxis(jacobian, 0, -1)
    return np.abs(a * d - b * c - expected) / (np.abs(a * d) + np.abs(b * c))


REST = 1031.1633093359945
"""Of the ball from 1 m with e = 0.9999 and drag 0.01, the sum of the flight times of all arcs."""


def near_elastic(flights, rtol, order=8):
    """Error of that time, relative to it, and how many impacts were followed."""
    system = zivi.ImpactSystem(zivi.LinearForce(gravity=9.81, damping=0.01), e=0.9999)
    method = zivi.SwitchedRK(rtol, rtol / 1000, order=order, flights=flights)
    sol = zivi.simulate(system, (0, 2000), (1, 0), method, dense_output=False)
    return abs(sol.rest_time / REST - 1), len(sol.impacts)
