"""What `design_tracker` and `design_regulator` promise, against adversarial runs of an oracle.

Random restitutions, settling times, bounds, delays, known forces and starts; forces that push with
the velocity, against it, telegraphs, noise, sines and constants. The oracle (`landing_oracle.c`)
moves the mass exactly and knows of zivi nothing but the gains.

    python benchmarks/design_promises.py [runs] [seed]
"""

from __future__ import annotations

import math
import subprocess
import sys
import tempfile
from collections.abc import Iterable
from pathlib import Path

import numpy as np

import zivi

FORCES = ("up", "down", "drive", "friction", "periods", "telegraph", "sampled", "sine")
"""M, -M, M sgn x', -M sgn x', drawn each period, a telegraph, M sgn of the sample, a sine."""
DELAYS = (0, 1, 2, 5, 10)


def oracle(folder: str) -> Path:
    """Build the oracle."""
    source, program = Path(__file__).with_name("landing_oracle.c"), Path(folder) / "oracle"
    subprocess.run(["cc", "-O2", "-o", program, source, "-lm"], check=True)
    return program


def specification(draw: np.random.Generator) -> dict[str, object]:
    """Draw what is asked for."""
    return {
        "settling_time": float(math.exp(draw.uniform(math.log(0.5), math.log(6.0)))),
        "e": float(draw.uniform(0.1, 0.9)),
        "bound": float(draw.uniform(0.0, 3.0)),
        "delay": int(draw.choice(DELAYS)),
        "force": float(draw.uniform(-12.0, 3.0)),
        "start": (
            float(math.exp(draw.uniform(math.log(1e-3), math.log(2.0)))),
            float(draw.uniform(-3.0, 3.0)),
        ),
    }


def accelerations(design: zivi.GainDesign, force: float) -> tuple[float, float]:
    """Give U and D from the gains, by the equations of the laws."""
    both, rest, e = design.mu1 + design.mu2, design.mu1 - design.mu2, design.e
    if design.kind == "regulator":
        return both - force, rest - force
    return 2.0 * e * both / (1.0 + e), 2.0 * rest / (1.0 + e)


def line(design: zivi.GainDesign, asked: dict, force: int, seed: int, **other: float) -> str:
    """Give a run as the oracle reads it."""
    known, (x, v) = asked["force"], asked["start"]
    U, D = accelerations(design, known)
    M, late = other.get("bound", design.bound), 1 + design.delay
    end = other.get("end", 1.2 * design.settling_time + 50 * late * design.h)
    numbers = (U, D, late, design.h, design.delay, design.e, known, M, x, v, design.quiet)
    times = (design.settling_time, end)
    return " ".join([*map(repr, numbers), str(force), str(seed), *map(repr, times)])


def runs_of(program: Path, lines: Iterable[str]) -> np.ndarray:
    """Run them: time of rest, least and largest control, height after the promised time."""
    told = subprocess.run(
        [program], input="\n".join(lines), capture_output=True, check=True, text=True
    )
    return np.array([[float(it) for it in row.split()] for row in told.stdout.splitlines()])


def runs(number: int, seed: int, program: Path, **more: object) -> tuple[np.ndarray, list]:
    """Give what the oracle says of so many designs, and the designs."""
    draw = np.random.default_rng(seed)
    drawn = []
    for k in range(number):
        asked, kind = specification(draw) | more, ("tracker", "regulator")[k % 2]
        make = zivi.design_tracker if kind == "tracker" else zivi.design_regulator
        drawn.append((make(**asked), asked, k // 2 % len(FORCES)))
    found = runs_of(
        program, (line(it, asked, force, k) for k, (it, asked, force) in enumerate(drawn))
    )
    return found, drawn


def promised(number: int, seed: int, program: Path) -> tuple[np.ndarray, np.ndarray, list]:
    """Give times of rest as parts of the promised ones, whether u stays in its range, the runs."""
    found, drawn = runs(number, seed, program)
    range_of = np.array([(it.u_min, it.u_max) for it, _, _ in drawn])
    slack = 1e-12 * np.abs(range_of).max(axis=1)
    inside = (found[:, 1] >= range_of[:, 0] - slack) & (found[:, 2] <= range_of[:, 1] + slack)
    parts = found[:, 0] / [it.settling_time for it, _, _ in drawn]
    return parts, inside, drawn


def practical(number: int, seed: int, program: Path) -> np.ndarray:
    """Give heights after the promised time as parts of the promised ones, where no rest is."""
    found, drawn = runs(number, seed, program, rest="practical")
    rows = zip(found, drawn, strict=True)
    return np.array([row[3] / it.within for row, (it, _, _) in rows if it.rest == "practical"])


def sharp(number: int, seed: int, program: Path, beyond: float) -> int:
    """Count the masses that rest under M sgn x' of so many times the bound."""
    draw, lines = np.random.default_rng(seed), []
    while len(lines) < number:
        asked = specification(draw) | {"delay": 0}
        design = zivi.design_tracker(**asked)
        U, D = accelerations(design, asked["force"])
        if U > D:
            e2 = design.e**2
            more = {"bound": beyond * D * (1 - e2) / (1 + e2), "end": 50 * design.settling_time}
            lines.append(line(design, asked, FORCES.index("drive"), len(lines), **more))
    return int(np.count_nonzero(~np.isnan(runs_of(program, lines)[:, 0])))


def main(number: int = 2000, seed: int = 1) -> None:
    """Print how many runs keep the promises."""
    with tempfile.TemporaryDirectory() as folder:
        program = oracle(folder)
        parts, inside, drawn = promised(number, seed, program)
        kept = int(np.count_nonzero(parts <= 1.0))
        worst = int(np.nanargmax(np.where(np.isnan(parts), np.inf, parts)))
        print(f"{kept} of {number} rest in time, {int(inside.sum())} with u in its range")
        print(f"median {np.nanmedian(parts):.2f}, largest {parts[worst]:.3f} of what is promised")
        print("worst:", FORCES[drawn[worst][2]], drawn[worst][0].kind, drawn[worst][1])
        heights = practical(number // 4, seed, program)
        kept = int(np.count_nonzero(heights <= 1.0))
        print(
            f"practical: {kept} of {heights.size} as low as promised, largest {heights.max():.2f}"
        )
        for beyond in (0.9, 1.1):
            rest = sharp(100, seed, program, beyond)
            print(f"M sgn x', {beyond} of the bound: {rest} of 100 rest")


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
