"""Flights by power series against an oracle in quadruple precision (`flights_oracle.c`).

    python benchmarks/flights.py first [flights] [seed]   first impacts of random flights
    python benchmarks/flights.py touch [flights] [seed]   flights that nearly touch the wall
    python benchmarks/flights.py pair [runs] [seed]       whole runs beside the embedded pair
    python benchmarks/flights.py area [impacts] [seed]    det J of the impact map
    python benchmarks/flights.py near                     Zeno times at e = 0.9999
    python benchmarks/flights.py write                    tests/data/flights.json, for the tests

The first two need a C compiler with libquadmath (gcc).
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from random import Random
from typing import Any

import numpy as np
from numpy.typing import NDArray

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

import flight_draws

DATA = Path(__file__).parents[1] / "tests" / "data" / "flights.json"


def oracle(flights: NDArray[np.float64], depths: Any = np.nan) -> NDArray[np.float64]:
    """Ask the oracle for its rows; inputs and outputs are described there."""
    source = Path(__file__).with_name("flights_oracle.c")
    rows = np.column_stack([flights, np.broadcast_to(depths, len(flights))])
    with tempfile.TemporaryDirectory() as folder:
        program = Path(folder) / "oracle"
        compile_ = ["cc", "-O2", "-std=gnu99", str(source), "-o", str(program)]
        subprocess.run([*compile_, "-lquadmath", "-lm"], check=True)
        answer = subprocess.run(
            [program], input=rows.tobytes(), stdout=subprocess.PIPE, check=True
        ).stdout
    return np.frombuffer(answer).reshape(len(flights), 7)


def first(n: int = 100_000, seed: int = 1) -> None:
    """Count missed and invented impacts, and tell errors of the times, family by family."""
    every = []
    for name, share in flight_draws.FAMILIES.items():
        flights = flight_draws.draw(name, max(1, round(share * n)), seed)
        rows = flights, flight_draws.first_impacts(flights), oracle(flights)
        every.append(rows)
        print(f"{name:12} {flight_draws.compare(*rows)}", flush=True)
    print(f"{'all':12} {flight_draws.compare(*map(np.concatenate, zip(*every, strict=True)))}")


def touch(n: int = 9000, seed: int = 1) -> None:
    """Tell the depths up to which it is not agreed upon what is an impact."""
    flights, depths = flight_draws.draw_touches(n, seed)
    truth = oracle(flights, depths)
    missed, invented, error = flight_draws.compare_touches(flights, truth)
    print(f"{(truth[:, 0] >= 0).sum()} flights")
    print(f"missed {len(missed)}, the deepest {max(missed, default=0):.2g} of the scale")
    print(f"invented {len(invented)}, the clearest {max(invented, default=0):.2g} of the scale")
    print(f"|v| dt/scale: 99 % {np.quantile(error, 0.99):.2g}, most {error.max():.2g}")


def pair(n: int = 500, seed: int = 1) -> None:
    """Compare whole runs with those of the embedded pair at rtol 1e-12."""
    random, worst, apart = Random(seed), 0.0, 0
    for number in range(n):
        case = flight_draws.run(random)
        distance, alike = flight_draws.beside_the_pair(case)
        worst = max(worst, distance)
        apart += not alike
        if distance > 1e-9 or not alike:
            print(f"{number}: {distance:.2g}, alike {alike}: {case}", flush=True)
    print(f"{n} runs: largest distance {worst:.2g}, {apart} with other events")


def area(n: int = 100_000, seed: int = 1) -> None:
    """Check ``det J = e^2 (u/u') exp(-c T)``."""
    error = flight_draws.errors_of_areas(n, seed)
    print(f"{len(error)} impacts: 99 % {np.quantile(error, 0.99):.2g}, most {error.max():.2g}")


def near() -> None:
    """Tell errors of a Zeno time near elastic impacts, in ``rtol T``."""
    for flights, order in (("series", 8), ("rk", 8), ("rk", 5)):
        for rtol in (1e-6, 1e-7, 1e-8, 1e-9, 1e-10, 1e-11, 1e-12):
            error, impacts = flight_draws.near_elastic(flights, rtol, order)
            told = f"{error:.2g} T, {error / rtol:.2g} rtol T, {impacts} impacts"
            print(f"{flights} {order} {rtol:g}: {told}", flush=True)


def write() -> None:
    """Store some flights of each family and some that nearly touch, with the oracle's answers."""
    stored: dict[str, Any] = {"first": [], "touch": []}
    for k, name in enumerate(flight_draws.FAMILIES):
        flights = flight_draws.draw(name, 300 if name == "ordinary" else 30, 100 + k)
        stored["first"] += [[*a, *b[:4]] for a, b in zip(flights, oracle(flights), strict=True)]
    flights, depths = flight_draws.draw_touches(150, 200)
    truth = oracle(flights, depths)
    keep = truth[:, 0] >= 0
    stored["touch"] = [[*a, *b] for a, b in zip(flights[keep], truth[keep], strict=True)]
    lines = ["{"]
    for key, rows in stored.items():
        body = ",\n".join(json.dumps([float(number) for number in row]) for row in rows)
        lines.append(f'"{key}": [\n{body}\n]' + ("," if key == "first" else ""))
    DATA.write_text("\n".join([*lines, "}\n"]))
    print(f"{DATA}: {len(stored['first'])} and {len(stored['touch'])} flights")


COMMANDS: dict[str, Callable[..., None]] = {
    it.__name__: it for it in (first, touch, pair, area, near, write)
}

if __name__ == "__main__":
    COMMANDS[sys.argv[1]](*map(int, sys.argv[2:]))
