"""Two large pictures by brute force, and how long they took.

A bifurcation diagram of 10^7 periods of an impact oscillator, and the basins of a ball on a table
for 1000 x 1000 starts, both with the power series that linear forces have by default.

    python benchmarks/pictures.py [folder] [--small]

``--small`` makes a hundredth of each.
"""

from __future__ import annotations

import math
import sys
import time
from pathlib import Path

import numpy as np

import zivi


def diagram(small: bool) -> tuple[zivi.Diagram, str]:
    """Run the oscillator over its amplitude."""
    values, transient, keep = (200, 400, 100) if small else (2000, 4800, 200)
    force = zivi.LinearForce(stiffness=1.0, damping=0.1, gravity=-1.0, amplitude=0.6, omega=2.8)
    begun = time.perf_counter(), time.process_time()
    found = zivi.bifurcation_diagram(
        zivi.ImpactSystem(force, e=0.8),
        "amplitude",
        np.linspace(6.0, 12.0, values),
        transient=transient,
        keep=keep,
    )
    return found, told("diagram", values * (transient + keep), "periods", begun)


def basins(small: bool) -> tuple[zivi.Basins, str]:
    """Run the ball on a table from a grid of starts."""
    cells = 100 if small else 1000
    force = zivi.LinearForce(gravity=1.0, amplitude=1.3, phase=-math.pi / 2)
    begun = time.perf_counter(), time.process_time()
    found = zivi.basins(
        zivi.ImpactSystem(force, e=0.5), np.linspace(0, 6, cells), np.linspace(-4, 4, cells)
    )
    text = told("basins", cells * cells * 232, "periods of the starts", begun)
    return found, f"{text}; {found.grazing.sum()} cells decided by a grazing; {found!r}"


def told(what: str, periods: int, unit: str, begun: tuple[float, float]) -> str:
    """Say how long something took, on the clock and of the processors."""
    clock, cpu = time.perf_counter() - begun[0], time.process_time() - begun[1]
    each = f"{cpu / periods * 1e9:.0f} ns of a processor each"
    return f"{what}: {periods:.3g} {unit}, {clock:.1f} s, {cpu:.1f} s of processors, {each}"


def main() -> None:
    """Draw both and print the times."""
    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt

    small = "--small" in sys.argv
    names = [it for it in sys.argv[1:] if not it.startswith("--")]
    folder = Path(names[0] if names else ".")
    found, text = diagram(small)
    print(text, flush=True)
    figure, ax = plt.subplots(figsize=(7, 4), layout="constrained")
    ax.plot(found.value, found.second, ",", color="0.1", alpha=0.3)
    ax.set(xlabel="amplitude of the excitation", ylabel="speed after an impact (m/s)")
    figure.savefig(folder / "diagram_large.png", dpi=110)
    cells, text = basins(small)
    print(text, flush=True)
    figure, ax = plt.subplots(figsize=(7, 4.7), layout="constrained")
    zivi.plot.basins(cells, ax=ax)
    figure.savefig(folder / "basins_large.png", dpi=110)


if __name__ == "__main__":
    main()
