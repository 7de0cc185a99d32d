"""Gains that are computed, against runs of what they promise.

Random restitutions, settling times and bounds of the unknown force; of each design six runs: the
force at both ends of its bound, half of it, and three sines. Each must rest in time.

    python benchmarks/gain_synthesis.py [specifications] [seed]
"""

from __future__ import annotations

import math
import sys

import numpy as np

import zivi

F = -9.81


def specification(generator: np.random.Generator) -> dict[str, float]:
    """Draw what is asked for."""
    return {
        "e": float(generator.uniform(0.1, 0.9)),
        "settling_time": float(10.0 ** generator.uniform(math.log10(0.5), math.log10(6.0))),
        "bound": float(generator.uniform(0.0, 3.0)),
    }


def unknown(design: zivi.GainDesign, generator: np.random.Generator) -> list[object]:
    """Give true forces: the known one and an unknown one within its bound."""
    bound = design.bound
    sines = [
        zivi.LinearForce(
            gravity=-F,
            amplitude=bound,
            omega=float(10.0 ** generator.uniform(-0.5, 1.5) * 2.0 * math.pi),
            phase=float(generator.uniform(0.0, 2.0 * math.pi)),
        )
        for _ in range(3)
    ]
    return [F + bound, F - bound, F + 0.5 * bound, *sines]


def fractions(kind: str, specification: dict[str, float], generator: np.random.Generator) -> list:
    """Time of rest as a part of what was asked for, NaN where the mass does not rest."""
    make = zivi.design_tracker if kind == "tracker" else zivi.design_regulator
    design = make(**specification, force=F)
    asked = specification["settling_time"]
    more = {"y_ref0": (0.0, 0.0)} if kind == "tracker" else {}
    batch = zivi.simulate_closed_loop_batch(
        [zivi.ImpactSystem(force, e=design.e) for force in unknown(design, generator)],
        design.controller(),
        (0.0, 1.5 * asked),
        (1.0, 0.0),
        force_model=F,
        progress=False,
        **more,
    )
    return list(batch.rest_time / asked)


def measure(kind: str, number: int, seed: int) -> np.ndarray:
    """Run so many specifications."""
    generator = np.random.default_rng(seed)
    rows = [fractions(kind, specification(generator), generator) for _ in range(number)]
    return np.array(rows)


def main(number: int = 150, seed: int = 1) -> None:
    """Print how many runs rest in time."""
    for kind in ("tracker", "regulator"):
        found = measure(kind, number, seed)
        met = int(np.count_nonzero(found <= 1.0))
        print(
            f"{kind}: {met} of {found.size} rest in time; "
            f"median {np.nanmedian(found):.2f}, largest {np.nanmax(found):.2f} of what was asked"
        )


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
