"""What a run under a force in Python takes beside the calls of the force alone.

    python benchmarks/python_force.py [rounds]

The calls of the run, with their arguments in their order, are made again in two ways: (a) by a loop
in Python, where CPython runs the body of a function without a call in C, and (b) from C, by `map`,
with numbers made for each call, as any compiled solver has to. The loop itself is subtracted from
(a). Two spans of one motion split the time of a run into a part of each evaluation and a fixed one;
a span in which there is one step only shows the fixed part. Without dense output; time of the
processor, the least of all rounds.
"""

from __future__ import annotations

import math
import sys
import time
from array import array
from collections import deque
from collections.abc import Callable, Iterable
from itertools import repeat
from typing import Any

import numpy as np

import zivi

SPANS = (1e-9, 1.0, 100.0)
"""One step, a short run, a long one (s)."""
METHOD = zivi.SwitchedRK(rtol=1e-6, atol=1e-6)
E = 0.9
BARE = 2000
"""Calls of the force alone in a row."""


def constant(t: float, x: float, v: float) -> float:
    """Return a number: a force cannot do less."""
    return -9.81


def drag(t: float, x: float, v: float) -> float:
    """Return weight and quadratic drag."""
    return -9.81 - 0.1 * v * abs(v)


def shaken(t: float, x: float, v: float) -> float:
    """Return weight, damping and the force of a shaken frame."""
    return -9.81 - 0.1 * v - 12.0 * math.cos(7.0 * t)


def constant_y(t: float, y: Any) -> float:
    """Return a number."""
    return -9.81


def drag_y(t: float, y: Any) -> float:
    """Return weight and quadratic drag."""
    v = y[1]
    return -9.81 - 0.1 * v * abs(v)


def shaken_y(t: float, y: Any) -> float:
    """Return weight, damping and the force of a shaken frame."""
    return -9.81 - 0.1 * y[1] - 12.0 * math.cos(7.0 * t)


FORCES: dict[str, tuple[Callable[..., float], ...]] = {
    "f(t, x, v)": (constant, drag, shaken),
    "f(t, y)": (constant_y, drag_y, shaken_y),
}


def run(force: Callable[..., float], span: float) -> zivi.Trajectory:
    """Simulate."""
    system = zivi.ImpactSystem(force, e=E)
    return zivi.simulate(system, (0.0, span), (1.0, 0.0), METHOD, dense_output=False)


class Case:
    """A force and a span: what is timed, by its name, and the least times of a call so far (s)."""

    def __init__(self, force: Callable[..., float], of_y: bool, span: float) -> None:
        calls: list[tuple[float, float, float]] = []

        def seen(t: float, x: float, v: float) -> float:
            calls.append((t, x, v))
            return float(force(t, np.array([x, v])) if of_y else force(t, x, v))

        run(seen, span)
        calls = (calls * (1 + BARE // len(calls)))[:BARE]
        t, x, v = (array("d", column) for column in zip(*calls, strict=True))
        y = np.array([1.0, 0.0])
        system, self.span = zivi.ImpactSystem(force, e=E), span
        self.nfev = run(force, span).nfev

        def whole() -> None:
            zivi.simulate(system, (0.0, span), (1.0, 0.0), METHOD, dense_output=False)

        def loop() -> None:
            for a, b, c in calls:
                force(a, b, c)

        def loop_of_y() -> None:
            for a, _b, _c in calls:
                force(a, y)

        def loop_alone() -> None:
            for _a, _b, _c in calls:
                pass

        def mapped() -> None:
            arguments: tuple[Iterable[Any], ...] = (t, repeat(y)) if of_y else (t, x, v)
            deque(map(force, *arguments), maxlen=0)

        self.timed: dict[str, tuple[Callable[[], None], int, int]] = {
            "run": (whole, max(1, BARE // self.nfev), 1),
            "loop": (loop_of_y if of_y else loop, 1, BARE),
            "loop alone": (loop_alone, 1, BARE),
            "map": (mapped, 1, BARE),
        }
        self.least = dict.fromkeys(self.timed, math.inf)

    def time(self) -> None:
        """Call everything once more."""
        for name, (call, times, calls) in self.timed.items():
            began = time.process_time()
            for _ in range(times):
                call()
            took = (time.process_time() - began) / (times * calls)
            self.least[name] = min(took, self.least[name])

    @property
    def bare(self) -> tuple[float, float]:
        """A call of the force alone, (a) in Python and (b) from C (s)."""
        least = self.least
        return least["loop"] - least["loop alone"], least["map"]


def main(rounds: int) -> None:
    """Print the table."""
    cases = {
        (kind, force.__name__): [Case(force, kind == "f(t, y)", span) for span in SPANS]
        for kind, forces in FORCES.items()
        for force in forces
    }
    for _ in range(rounds):
        for group in cases.values():
            for case in group:
                case.time()
    print("force, span (s): evaluations, run (us), call a and b (ns), run/(evaluations x a), x b")
    for (kind, name), group in cases.items():
        for case in group:
            took, n, (a, b) = case.least["run"], case.nfev, case.bare
            print(
                f"{kind} {name}, {case.span:g}: {n}, {1e6 * took:.2f}, {1e9 * a:.0f} and "
                f"{1e9 * b:.0f}, {took / n / a:.2f}, {took / n / b:.2f}"
            )
        _, short, long = group
        part = (long.least["run"] - short.least["run"]) / (long.nfev - short.nfev)
        fixed, (a, b) = short.least["run"] - part * short.nfev, long.bare
        print(
            f"    an evaluation {1e9 * part:.0f} ns, {part / a:.2f} a, {part / b:.2f} b; "
            f"fixed {1e6 * fixed:.2f} us"
        )


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 40)
