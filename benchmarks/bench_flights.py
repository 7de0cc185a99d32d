"""Flights under linear forces beside loops by hand (`benchmarks/results/flights.md`)."""

from __future__ import annotations

import math
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

import bench_ball
import cball
import flights_loop
import timing
import zivi
from methods_problems import Problem
from report import cpu, table
from scipy_events import Script

PAGE = Path(__file__).resolve().parent / "results" / "flights.md"
ROUNDS = 9
PERIODS = 20_000
OSCILLATOR = zivi.ImpactSystem(
    zivi.LinearForce(stiffness=1.0, damping=0.1, gravity=-1.0, amplitude=0.6, omega=0.9), e=0.8
)
TABLES = {
    "table, A 14 m/s^2, omega 30 /s, e .85: chaotic": (14.0, 30.0, 0.85),
    "table, A 29.43 m/s^2, omega 10 /s, e .5: Zeno points and lift-offs": (29.43, 10.0, 0.5),
    "table, A 100 m/s^2, omega 1000 /s, e .9: long flights": (100.0, 1000.0, 0.9),
}
METHODS = {
    "power series": zivi.SwitchedRK(max_steps=10**9, max_impacts=10**9),
    "pair, rtol 1e-6": zivi.SwitchedRK(
        rtol=1e-6, atol=1e-6, flights="rk", max_steps=10**9, max_impacts=10**9
    ),
    "pair, rtol 1e-10": zivi.SwitchedRK(
        rtol=1e-10, atol=1e-10, flights="rk", max_steps=10**9, max_impacts=10**9
    ),
    "pair, rtol 1e-13": zivi.SwitchedRK(
        rtol=1e-13, atol=1e-13, flights="rk", max_steps=10**9, max_impacts=10**9
    ),
}
SPEED = 0.67187569
"""Of the oscillator after its impacts (m/s), once it has settled: `zivi.periodic_orbit`."""


def shaken(amplitude: float, omega: float, e: float) -> zivi.ImpactSystem:
    """Make a ball on a shaken table, in the table's frame."""
    force = zivi.LinearForce(gravity=9.81, amplitude=amplitude, omega=omega)
    return zivi.ImpactSystem(force, e=e)


def omega(system: zivi.ImpactSystem) -> float:
    """Give the frequency of the excitation (1/s)."""
    force = system.force
    assert isinstance(force, zivi.LinearForce)
    return force.omega


def best(run: Callable[[], object], rounds: int = ROUNDS) -> float:
    """Give the least time of the processor (s)."""
    took = []
    for _ in range(rounds):
        begun = time.process_time()
        run()
        took.append(time.process_time() - begun)
    return min(took)


def ours(system: zivi.ImpactSystem, method: zivi.SwitchedRK, periods: int) -> float:
    """Time a period of a run that keeps its impacts alone (ns)."""
    span = (0.0, periods * math.tau / omega(system))

    def run() -> Any:
        return zivi.simulate(system, span, (1.0, 0.0), method, t_eval=[], dense_output=False)

    assert run().success
    return best(run) / periods * 1e9


def by_hand() -> list[tuple[str, float]]:
    """Time the loops by hand, which must settle on the same orbit."""
    force, e = OSCILLATOR.force, OSCILLATOR.e
    assert isinstance(force, zivi.LinearForce)
    t1 = PERIODS * math.tau / force.omega
    found = []
    with tempfile.TemporaryDirectory() as directory:
        loops = {
            f"closed form in C, {name}": flights_loop.in_c(force, e, Path(directory), flags)
            for name, flags in cball.FLAGS.items()
        }
        loops["closed form in Python, numba"] = flights_loop.in_numba(force, e)
        for name, loop in loops.items():
            if loop is None:
                continue
            impacts, speed = loop(t1)
            np.testing.assert_allclose(speed, SPEED, atol=1e-8)
            np.testing.assert_allclose(impacts, PERIODS, atol=2)
            found.append((name, best(lambda loop=loop: loop(t1)) / PERIODS * 1e9))
    return found


def scipy(periods: int = 20) -> float:
    """Time SciPy's DOP853, restarted at events, as a careful script (ns a period)."""
    force = OSCILLATOR.force
    assert isinstance(force, zivi.LinearForce)
    span = (0.0, periods * math.tau / force.omega)
    problem = Problem("", "", False, force, OSCILLATOR.e, span, (1.0, 0.0), (0.0, 0.0), None)
    return best(lambda: Script(problem, 1e-6).run(), 3) / periods * 1e9


def impact_map() -> tuple[float, float]:
    """Time an impact of `zivi.impact_map`, one thread: of an orbit, and with Jacobian (ns)."""
    step = zivi.impact_map(OSCILLATOR)
    phases, speeds = np.linspace(0.0, 6.0, PERIODS), np.linspace(0.1, 2.0, PERIODS)
    orbit = best(lambda: step.orbit(1.0, 1.0, 1, skip=PERIODS - 1, threads=1))
    tangent = best(lambda: step(phases, speeds, threads=1))
    return orbit / PERIODS * 1e9, tangent / PERIODS * 1e9


def flights() -> str:
    """Write the table of the oscillator."""
    rows = [(f"zivi, {name}", ours(OSCILLATOR, it, PERIODS)) for name, it in METHODS.items()]
    first, (orbit, tangent) = rows[0][1], impact_map()
    rows += [
        ("zivi.impact_map, an impact", orbit),
        ("zivi.impact_map with its Jacobian, an impact", tangent),
        *by_hand(),
        ("SciPy DOP853 with events, rtol 1e-6", scipy()),
    ]
    body = [(name, f"{ns:.0f}", f"{ns / first:.2f}") for name, ns in rows]
    return table(("the oscillator", "ns a period", "to power series"), body)


def tables() -> str:
    """Write the table of the shaken balls."""
    rows = []
    for name, (amplitude, frequency, e) in TABLES.items():
        system = shaken(amplitude, frequency, e)
        times = [ours(system, it, 2000) for it in METHODS.values()]
        ratios = ", ".join(f"{it / times[0]:.0f}" for it in times[1:])
        rows.append((name, *(f"{it:.0f}" for it in times), ratios))
    return table(("ns a period", *METHODS, "ratios"), rows)


def implicit() -> str:
    """Write the table of the methods of fixed steps under a number and under linear forces."""
    kinds: dict[str, Any] = {
        "a number": -9.81,
        "gravity, spring, damper": zivi.LinearForce(stiffness=4.0, damping=0.5, gravity=9.81),
        "gravity, spring, damper, excitation": zivi.LinearForce(
            stiffness=4.0, damping=0.5, gravity=9.81, amplitude=1.0, omega=5.0
        ),
    }
    h = 2.4 / bench_ball.STEPS
    methods = {"ThetaGamma": zivi.ThetaGamma(h=h), "MoreauJean": zivi.MoreauJean(h=h)}
    rows = []
    for name, force in kinds.items():
        system = zivi.ImpactSystem(force, kappa=cball.KAPPA)
        contenders = {
            key: (
                lambda system=system, it=it: zivi.simulate(system, (0, 2.4), cball.START, it),
                timing.nothing,
            )
            for key, it in methods.items()
        }
        times = timing.medians(timing.interleaved(contenders, 5), bench_ball.STEPS)
        rows.append((name, *(f"{times[key]:.1f}" for key in methods)))
    return table(("ns a step, force", *methods), rows)


TEXT = """# Flights under linear forces

Written by `make bench`; do not edit. One run on a shared machine: {cpu}. Times are of the
processor, the least of {rounds} rounds; what a run keeps are its impacts (`t_eval=[]`,
`dense_output=False`).

The oscillator x'' = -x - .1 x' + 1 + .6 cos .9 t, e = .8, has one impact a period. The loops by
hand (`benchmarks/flights_loop.c`, `flights_loop.py`) know its closed form and look for the next
impact in steps of a twentieth of a period, then by Newton's method: they know no rest, no
accumulation and no two roots within a step. `SwitchedRK` does. Both are exact to rounding here.

{flights}

Balls on shaken tables. The accumulations of the second are followed to `rtol` (1e-6 for the power
series).

{tables}

How far the power series are from exact is measured by `python benchmarks/flights.py` beside an
oracle in quadruple precision.

## Fixed steps

A step of `ThetaGamma` under a number is a closed form and costs little more than its record
([beside C](ball.md)). A linear force of the state makes the step implicit in it: what that
adds, with all that is recorded, over {steps} steps of the paper's ball:

{implicit}
"""


def write() -> str:
    """Measure, and write the page."""
    page = TEXT.format(
        cpu=cpu(),
        rounds=ROUNDS,
        steps=f"{bench_ball.STEPS:,}",
        flights=flights(),
        tables=tables(),
        implicit=implicit(),
    )
    PAGE.write_text(page)
    return page


if __name__ == "__main__":
    print(write())
