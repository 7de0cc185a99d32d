r"""Basins of attraction of a ball on a vibrating table: rest, one period, two periods.

In the frame of the table ``x'' = -g + a omega^2 sin(omega t)``, ``x >= 0``, with ``e = 0.8`` and
``G = a omega^2/g = 0.8``. The table never throws off a ball that rests (G < 1); but a ball that
bounces can go on without end, on the orbit that hits once in n periods T, which exists from
``G = n pi (1 - e)/(1 + e)`` (0.349, 0.698, 1.047 for n = 1, 2, 3) and is stable up to

    G^2 = (n pi (1 - e)/(1 + e))^2 + (2 (1 + e^2)/(1 + e)^2)^2

So there are three attractors. A grid of initial states at t = 0 goes into one batch, and each run
is told by its last state: at rest, or beside one of the states of the orbits at that time. Such an
orbit hits at the phase ``cos(phi) = n pi (1 - e)/((1 + e) G)``, leaves with ``u = n g T e/(1 + e)``
relative to the table, and flies on a parabola.

Shares of the states: rest 33.5 %, one impact a period 55.1 %, one in two periods 11.5 %. White
marks: the attractors themselves at t = 0.

Run as ``python examples/gallery_basins.py [out.png]``.
"""

import functools
import math
import sys

import numpy as np

import zivi

GRAVITY, OMEGA = 9.81, 2 * math.pi
PERIOD = 2 * math.pi / OMEGA
E, EXCITATION = 0.8, 0.8
SINE = -math.pi / 2
"""Phase with which a cosine is a sine."""
HEIGHTS, SPEEDS = (0.0, 6.0), (-12.0, 12.0)
"""Initial states: distance from the table (m) and relative velocity (m/s)."""
CELLS = 240
PERIODS = 60
METHOD = zivi.SwitchedRK(rtol=1e-6)
NAMES = "rest", "one impact a period", "one impact in two periods"
UNDECIDED = -1
NEAR = 0.05
"""Distance (m, m/s) of the last state from an orbit up to which the run is on it."""


def seen_from_table() -> zivi.ImpactSystem:
    """Ball in the frame of the table."""
    force = zivi.LinearForce(
        gravity=GRAVITY, amplitude=EXCITATION * GRAVITY, omega=OMEGA, phase=SINE
    )
    return zivi.ImpactSystem(force, e=E)


def orbit(n: int) -> np.ndarray:
    """States at ``t = 0, T, ..`` of the orbit that hits once in n periods, a row for each."""
    phase = math.acos(n * math.pi * (1 - E) / ((1 + E) * EXCITATION))
    speed, a = n * GRAVITY * PERIOD * E / (1 + E), EXCITATION * GRAVITY / OMEGA**2
    t = PERIOD * np.arange(1, n + 1) - phase / OMEGA  # since the impact
    launch = speed + a * OMEGA * math.cos(phase)
    x = a * math.sin(phase) + launch * t - GRAVITY * t**2 / 2  # the table is at 0
    return np.column_stack([x, launch - GRAVITY * t - a * OMEGA])


def attractors(states: np.ndarray) -> np.ndarray:
    """Tell the attractor of each initial state (rows), by its number in `NAMES`."""
    batch = zivi.simulate_batch(seen_from_table(), (0, PERIODS * PERIOD), states, method=METHOD)
    found = np.full(len(states), UNDECIDED)
    found[~np.isnan(batch.rest_time)] = 0
    last = np.column_stack([batch.x, batch.xdot])
    for n in (1, 2):
        for state in orbit(n):
            found[np.abs(last - state).max(axis=1) < NEAR] = n
    return found


def grid(cells: int = CELLS) -> np.ndarray:
    """Middles of the cells, row by row from the lowest velocity up."""
    x, xdot = (
        low + (high - low) * (np.arange(cells) + 0.5) / cells for low, high in (HEIGHTS, SPEEDS)
    )
    return np.stack(np.meshgrid(x, xdot), axis=-1).reshape(-1, 2)


@functools.cache
def basins() -> np.ndarray:
    """Attractors of the whole grid, row by row from the lowest velocity up."""
    return attractors(grid()).reshape(CELLS, CELLS)


def shares(found: np.ndarray) -> list[float]:
    """Shares of the attractors."""
    return [float(np.mean(found == number)) for number in range(len(NAMES))]


def main(path: str | None = None) -> None:
    """Print the shares of the basins, and draw if a path is given."""
    found = basins()
    for name, share in zip(NAMES, shares(found), strict=True):
        print(f"{name}: {100 * share:.1f} % of {CELLS} x {CELLS} initial states")
    print(f"undecided after {PERIODS} periods: {np.count_nonzero(found == UNDECIDED)}")
    if path is not None:
        draw(path)


def draw(path: str) -> None:
    """Draw the basins and the orbits' own states in them."""
    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt
    from matplotlib.colors import ListedColormap
    from matplotlib.patches import Patch

    colors = ["#F0E442", "#56B4E9", "#0B3C5D"]
    plt.style.use("zivi.plot.figures")
    figure, ax = plt.subplots(layout="constrained", figsize=(7.2, 6))
    extent = (*HEIGHTS, *SPEEDS)
    ax.imshow(
        np.ma.masked_less(basins(), 0),
        cmap=ListedColormap(colors),
        extent=extent,
        origin="lower",
        aspect="auto",
        interpolation="nearest",
        vmin=-0.5,
        vmax=len(NAMES) - 0.5,
    )
    for n, marker in ((1, "o"), (2, "s")):
        ax.plot(*orbit(n).T, marker, mec="k", mfc="w", ms=7, ls="none", clip_on=False, zorder=3)
    ax.plot(0, 0, "^", mec="k", mfc="w", ms=8, clip_on=False, zorder=3)
    labels = [
        f"{name}: {100 * share:.1f} %" for name, share in zip(NAMES, shares(basins()), strict=True)
    ]
    patches = [Patch(color=color, label=name) for color, name in zip(colors, labels, strict=True)]
    figure.legend(handles=patches, loc="outside upper center", ncols=3, fontsize="small")
    ax.set(xlabel="initial distance from the table (m)")
    ax.set(ylabel="initial velocity relative to it (m/s)", xlim=HEIGHTS, ylim=SPEEDS)
    figure.savefig(path, dpi=160)


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else None)
