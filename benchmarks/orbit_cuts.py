"""Whether an orbit found from a run depends on where the run ends.

``python benchmarks/orbit_cuts.py [systems] [seed]``. Of random masses over a shaken table and of
random mechanisms those count whose states, once a period of a long plain run, repeat after m of
them, m from 1 to `MOST`. Runs of each end at `CUTS` times, one of them between two impacts, and
each is given to `periodic_orbit`. Right is an
orbit

* that is a motion (``success``), repeats after m periods, and rests where the long run does;
* whose plain simulation over its period returns to its start, and passes a state of the long run.
"""

from __future__ import annotations

import dataclasses
import sys
import time
from collections.abc import Iterable
from typing import Any

import numpy as np

import zivi

SETTLED, MOST, LOOKED, CUTS = 400, 32, 70, 4
PRECISE = zivi.SwitchedRK(rtol=1e-11, atol=1e-13)
SAME, NEAR = 1e-8, 1e-5
"""How well states repeat, and how near the orbit comes to them, relative to the largest."""

System = zivi.ImpactSystem | zivi.LinearSystem


def draw_mass(rng: np.random.Generator) -> tuple[System, float, Any]:
    """Draw a ball on a shaken table, some with a spring and a damper, its period and a state."""
    springs = rng.random() < 0.3
    force = zivi.LinearForce(
        gravity=1.0,
        amplitude=rng.uniform(1.1, 5.0),
        omega=rng.uniform(0.4, 3.0),
        phase=rng.uniform(-np.pi, np.pi),
        stiffness=rng.uniform(0.0, 0.3) if springs else 0.0,
        damping=rng.uniform(0.0, 0.1) if springs else 0.0,
    )
    system = zivi.ImpactSystem(force, e=rng.choice([0.0, rng.uniform(0.05, 0.85)], p=[0.05, 0.95]))
    return system, 2.0 * np.pi / force.omega, (rng.uniform(0.0, 2.0), rng.uniform(-1.0, 1.0))


def draw_mechanism(rng: np.random.Generator) -> tuple[System, float, Any]:
    """Draw one or two masses on soft springs, which a load throws from one or two stops."""
    n, omega = int(rng.integers(1, 3)), rng.uniform(0.6, 1.6)
    soft = 0.1 if rng.random() < 0.6 else 1.0
    k, c = soft * rng.uniform(0.05, 0.3), soft * rng.uniform(0.02, 0.08)
    load, normal = np.eye(n)[-1] * rng.uniform(1.2, 4.5), np.eye(n)[0]
    weight = -np.ones(n)
    stiff, damp = np.diag([k] * n), np.diag([c] * n)
    if n == 2:
        bond = np.array([[1.0, -1.0], [-1.0, 1.0]])
        stiff = stiff + rng.uniform(1.0, 4.0) * bond
        damp = damp + rng.uniform(0.05, 0.4) * bond
    gaps = [zivi.LinearGap(normal, 0.0, name="floor")]
    if rng.random() < 0.3:
        gaps.append(zivi.LinearGap(-normal, rng.uniform(1.0, 6.0), name="top"))
    system = zivi.LinearSystem(
        np.diag(rng.uniform(0.5, 1.0, n)),
        damp,
        stiff,
        excitation=[weight, zivi.Harmonic(load, omega)],
        gaps=gaps,
        e=rng.uniform(0.05, 0.8, len(gaps)),
    )
    return system, 2.0 * np.pi / omega, (rng.uniform(0.1, 1.0, n), np.zeros(n))


def states_of(run: Any, times: np.ndarray) -> np.ndarray:
    """Give states as rows."""
    at = run(times)
    return at.T if at.ndim == 2 else np.concatenate(at, axis=1)


def last_of(run: Any) -> Any:
    """Give the last state of a run, as a start of another."""
    mass = isinstance(run, zivi.Trajectory)
    return (run.x[-1], run.xdot[-1]) if mass else (run.q[-1], run.qdot[-1])


@dataclasses.dataclass(frozen=True)
class Truth:
    """What a long plain run settled on."""

    system: System
    period: float
    start: Any
    t0: float
    run: Any
    multiple: int
    rests: bool


def truth_of(system: System, period: float, y0: Any) -> Truth | None:
    """Run long, and look after how many periods the states repeat; None where they do not."""
    t0 = SETTLED * period
    before = zivi.simulate(system, (0.0, t0), y0, dense_output=False)
    if not before.success:
        return None
    start = last_of(before)
    run = zivi.simulate(system, (t0, t0 + (LOOKED + 1) * period), start)
    if not run.success or (run.rest_time is not None and not len(run.liftoffs)):
        return None
    states = states_of(run, t0 + period * np.arange(LOOKED + 1))
    size = np.max(np.abs(states)) + 1e-300
    apart = [np.max(np.abs(states[m:] - states[:-m])) / size for m in range(1, MOST + 1)]
    m = int(np.argmax(np.array(apart) < SAME)) + 1
    # some that nearly repeat earlier have not settled yet
    if apart[m - 1] >= SAME or any(it < NEAR for it in apart[: m - 1]):
        return None
    late = [rows["t"] > run.t[-1] - m * period for rows in (run.zeno, run.liftoffs)]
    touches = np.concatenate(late).any() or np.any(getattr(run, "contacts", [[0]])[-1])
    return Truth(system, period, start, t0, run, m, bool(touches))


def cuts_of(truth: Truth, rng: np.random.Generator) -> list[float]:
    """Give times at which runs end: at and between the ends of periods, and within impacts."""
    m, period = truth.multiple, truth.period
    ends = truth.t0 + period * (2 * m + 2 + rng.integers(0, m + 2, CUTS - 1).astype(float))
    ends[1:] += period * rng.random(CUTS - 2)
    hits = np.unique(truth.run.resolved_impacts["t"])
    hits = hits[hits > truth.t0 + (2 * m + 2) * period]
    if len(hits) > 1:
        # within a sequence of impacts
        i = int(rng.integers(len(hits) - 1))
        ends = np.append(ends, hits[i] + rng.uniform(0.1, 0.9) * (hits[i + 1] - hits[i]))
    return np.minimum(ends, truth.run.t[-1]).tolist()


def judged(truth: Truth, orbit: Any) -> str:
    """Say what is wrong with an orbit, "" if nothing is."""
    if not orbit.success:
        return orbit.status.name
    if orbit.multiple != truth.multiple:
        return f"multiple {orbit.multiple}"
    if (orbit.kind == "resting") != truth.rests:
        return orbit.kind
    own = orbit.trajectory
    t0, length = own.t[0], truth.multiple * truth.period
    # the middle of its longest flight, or rest
    marks = np.sort([t0, *own.resolved_impacts["t"], *own.liftoffs["t"], own.t[-1]])
    i = int(np.argmax(np.diff(marks)))
    middle = 0.5 * (marks[i] + marks[i + 1])
    state = own(middle)
    again = zivi.simulate(truth.system, (middle, middle + length), tuple(state), PRECISE)
    size = np.max(np.abs(states_of(truth.run, truth.run.t))) + 1e-6
    back = np.max(np.abs(states_of(again, again.t[-1:])[0] - np.ravel(state)) / size)
    # it is where the long run is, at one of as many shifts by a period
    began = middle + np.ceil((truth.t0 - middle) / truth.period) * truth.period
    settled = states_of(truth.run, began + truth.period * np.arange(truth.multiple))
    apart = np.min(np.max(np.abs(settled - np.ravel(state)) / size, axis=1))
    return (
        "" if max(back, apart) < NEAR else f"returns to {back:.1e}, another motion by {apart:.1e}"
    )


@dataclasses.dataclass
class Seen:
    """What was found."""

    systems: int = 0
    resting: int = 0
    long: int = 0
    """Systems with three and more periods."""
    cuts: int = 0
    wrong: list[tuple[int, int, float, str]] = dataclasses.field(default_factory=list)
    """Number of the system, its multiple, the end of the run in periods, what is wrong."""


def campaign(numbers: Iterable[int], seed: int = 1, draw: Any = draw_mass) -> Seen:
    """Judge the orbits of the systems of these numbers that repeat."""
    seen = Seen()
    for number in numbers:
        rng = np.random.default_rng((seed, number))
        drawn = draw(rng)
        truth = truth_of(*drawn)
        if truth is None:
            continue
        seen.systems += 1
        seen.resting += truth.rests
        seen.long += truth.multiple > 2
        for end in cuts_of(truth, rng):
            run = zivi.simulate(truth.system, (truth.t0, end), truth.start)
            try:
                wrong = judged(truth, zivi.periodic_orbit(truth.system, run))
            except ValueError as error:
                wrong = str(error)
            seen.cuts += 1
            if wrong:
                seen.wrong.append((number, truth.multiple, end / truth.period, wrong))
    return seen


if __name__ == "__main__":
    began = time.process_time()
    count, seed = (int(it) for it in (*sys.argv[1:], "150", "1")[:2])
    for draw in (draw_mass, draw_mechanism):
        seen = campaign(range(count), seed, draw)
        print(draw.__name__, dataclasses.replace(seen, wrong=[]), len(seen.wrong), "wrong")
        for row in seen.wrong:
            print("  ", *row)
    print(f"{time.process_time() - began:.0f} s of a processor")
