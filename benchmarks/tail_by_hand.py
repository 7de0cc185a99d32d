"""Evaluations through a Zeno point, beside DOP853 with its tail added by hand.

    python benchmarks/tail_by_hand.py

The script of a careful user: SciPy's DOP853 with a terminal event at the wall, which stops at
the first impact slower than the root of the tolerance and adds the rest of the accumulation by
its geometric series, ``2 u/(g (1 - e))``. Counts and errors are the same in every run.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

from scipy.integrate import solve_ivp

import zivi

PAGE = Path(__file__).with_name("results") / "tail_by_hand.md"
TOLERANCES = (1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8, 1e-9, 1e-10)
FORCES: dict[str, Callable[[float, float, float], float]] = {
    "drag, -g - 0.1 x'": lambda t, x, xdot: -9.81 - 0.1 * xdot,
    "spring, -g - 2 x - 0.3 x'": lambda t, x, xdot: -9.81 - 2.0 * x - 0.3 * xdot,
}
SPANS = {0.5: 4.0, 0.9: 12.0}
BEFORE = {
    ("drag", 0.5): (236, 238, 242, 274, 278, 282, 322, 324),
    ("drag", 0.9): (362, 424, 516, 640, 762, 884, 1007, 1172),
    ("spring", 0.5): (236, 238, 275, 281, 314, 340, 367, 411),
    ("spring", 0.9): (479, 571, 695, 849, 1003, 1177, 1349, 1571),
}
"""Evaluations of zivi when each impact was stepped onto (version 0.2.0), to each tolerance."""

HEAD = """# Evaluations beside DOP853 with its tail added by hand

Written by `python benchmarks/tail_by_hand.py`; do not edit. A ball from 1 m, its force in Python,
up to rest and on to {spans}. SciPy's DOP853 with a terminal event stops at the
first impact slower than the root of the tolerance and adds the rest as a geometric series. Errors
are those of the Zeno time (s). "Before": version 0.2.0, which repeated the step onto each impact
and looked at the force while the mass rested. The ratio is that to the cheapest run of the script
whose error is no larger.

"""


class Run(NamedTuple):
    """What a run costs, and its error."""

    nfev: int
    error: float


def by_hand(force: Any, e: float, span: float, tolerance: float) -> tuple[int, float]:
    """Give evaluations and Zeno time of the script."""
    nfev = 0

    def slopes(t: float, y: Any) -> list[float]:
        nonlocal nfev
        nfev += 1
        return [y[1], force(t, *y)]

    def wall(_: float, y: Any) -> float:
        return float(y[0])

    wall.terminal, wall.direction = True, -1  # type: ignore[attr-defined]
    t, x, xdot = 0.0, 1.0, 0.0
    while True:
        options = {"rtol": tolerance, "atol": tolerance}
        run = solve_ivp(slopes, (t, span), (x, xdot), "DOP853", events=wall, **options)
        if run.status != 1:
            raise RuntimeError("no accumulation")
        t, x, xdot = run.t[-1], 0.0, -e * run.y_events[0][0][1]
        if xdot < math.sqrt(tolerance):
            return nfev + 1, t - 2.0 * xdot / (force(t, 0.0, 0.0) * (1.0 - e))


def ours(force: Any, e: float, span: float, tolerance: float) -> tuple[int, float]:
    """Give the same of zivi, which runs on to the end of the span."""
    run = zivi.simulate(
        zivi.ImpactSystem(force, e=e),
        (0, span),
        (1, 0),
        zivi.SwitchedRK(rtol=tolerance, atol=tolerance),
        samples="steps",
        dense_output=False,
    )
    return run.nfev, float(run.zeno["t"][0])


def table(name: str, e: float) -> str:
    """Compare one force and one restitution."""
    force, span = FORCES[name], SPANS[e]
    method = zivi.SwitchedRK(rtol=1e-13, atol=1e-15)
    exact = float(
        zivi.simulate(zivi.ImpactSystem(force, e=e), (0, span), (1, 0), method).zeno["t"][0]
    )

    def all_of(
        program: Callable[..., tuple[int, float]], tolerances: tuple[float, ...]
    ) -> list[Run]:
        found = (program(force, e, span, it) for it in tolerances)
        return [Run(nfev, abs(t - exact)) for nfev, t in found]

    finer = (*TOLERANCES, 1e-11, 1e-12, 1e-13)
    script, mine = all_of(by_hand, finer), all_of(ours, TOLERANCES)
    text = f"## {name}, e = {e}\n\n"
    text += "| tolerance | before | zivi | error | by hand | error | ratio at equal error |\n"
    text += "| --- | ---: | ---: | ---: | ---: | ---: | ---: |\n"
    before = BEFORE[name.partition(",")[0], e]
    for tolerance, then, run, other in zip(TOLERANCES, before, mine, script, strict=False):
        equal = min((it.nfev for it in script if it.error <= run.error), default=None)
        ratio = "" if equal is None else f"{run.nfev / equal:.2f}"
        text += f"| {tolerance:g} | {then} | {run.nfev} | {run.error:.1e} "
        text += f"| {other.nfev} | {other.error:.1e} | {ratio} |\n"
    return text + "\n"


def write() -> None:
    """Write the page."""
    spans = " and ".join(f"{span:g} s (e = {e})" for e, span in SPANS.items())
    tables = [table(name, e) for name in FORCES for e in SPANS]
    PAGE.write_text(HEAD.format(spans=spans) + "".join(tables).rstrip() + "\n")
    print(PAGE.read_text())


if __name__ == "__main__":
    write()
