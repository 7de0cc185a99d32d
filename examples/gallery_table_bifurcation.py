r"""Bifurcation diagram of a ball on a vibrating table, and where its periods double.

In the frame of the table ``x'' = -g + a omega^2 sin(omega t)``, ``x >= 0``. Every run of a batch
has its own excitation ``G = a omega^2/g`` and starts beside the orbit that hits once a period, at
the phase ``cos(phi) = pi (1 - e)/((1 + e) G)``; the phases of its last impacts are drawn over G.

Just above the point where the period doubles the impacts alternate between two phases whose
difference grows like a square root. So its square, fitted by a polynomial and extended to zero,
gives the point from the diagram's own data: 1.526824 for `e = 0.5` and 1.070836 for `e = 0.8`. It
is expected at

    G^2 = (pi (1 - e)/(1 + e))^2 + (2 (1 + e^2)/(1 + e)^2)^2

Run as ``python examples/gallery_table_bifurcation.py [out.png]``.
"""

import functools
import math
import sys

import numpy as np

import zivi

GRAVITY, OMEGA = 9.81, 2 * math.pi
PERIOD = 2 * math.pi / OMEGA
SINE = -math.pi / 2
"""Phase with which a cosine is a sine."""
RANGES = {0.5: (1.2, 1.9), 0.8: (0.95, 1.3)}
"""Restitution, and the excitations of its diagram."""
VALUES, PERIODS, KEPT = 450, 1000, 100
"""Excitations of a diagram, length of a run, and how much of its end is drawn, in periods."""
METHOD = zivi.SwitchedRK(rtol=1e-9)
SPLIT, FITTED = 0.02, 12
"""Impacts differ by so much (rad) when the period has doubled; values that are extended to zero,
from the second on: nearest to the point the runs are slow to settle."""


def orbit(excitation: float, e: float) -> tuple[float, float]:
    """Phase (rad) and relative speed (m/s) after an impact of the orbit of one period."""
    phase = math.acos(math.pi * (1 - e) / ((1 + e) * excitation))
    return phase, GRAVITY * PERIOD * e / (1 + e)


def expected(e: float) -> float:
    """Excitation at which the period of that orbit doubles."""
    return math.hypot(math.pi * (1 - e) / (1 + e), 2 * (1 + e**2) / (1 + e) ** 2)


def seen_from_table(excitation: float, phase: float) -> zivi.LinearForce:
    """Gravity and excitation, on a clock that starts at this phase (rad) of the table."""
    return zivi.LinearForce(
        gravity=GRAVITY, amplitude=excitation * GRAVITY, omega=OMEGA, phase=SINE + phase
    )


@functools.cache
def diagram(e: float) -> tuple[np.ndarray, list[np.ndarray]]:
    """Excitations, and the phases (rad, in order) of the last impacts for each of them."""
    excitations = np.linspace(*RANGES[e], VALUES)
    starts = [orbit(excitation, e) for excitation in excitations]
    systems = [
        zivi.ImpactSystem(seen_from_table(excitation, phase), e=e)
        for excitation, (phase, _) in zip(excitations, starts, strict=True)
    ]
    speeds = np.array([(0.0, 1.001 * speed) for _, speed in starts])
    span = (0, PERIODS * PERIOD)
    batch = zivi.simulate_batch(systems, span, speeds, method=METHOD, save="events")
    phases = []
    for (phase, _), run in zip(starts, batch.events, strict=True):
        times = run["impacts"]["t"]
        phases.append(phase + OMEGA * times[times > (PERIODS - KEPT) * PERIOD])
    return excitations, phases


def wrapped(phases: np.ndarray) -> np.ndarray:
    """Phases from -pi to pi."""
    return phases - 2 * math.pi * np.round(phases / (2 * math.pi))


def doubling(e: float) -> float:
    """Excitation at which the period doubles, from the diagram alone."""
    excitations, phases = diagram(e)
    splits = np.array([np.ptp(wrapped(run[-2:])) for run in phases])
    first = int(np.argmax(splits > SPLIT)) + 1
    fitted = slice(first, first + FITTED)
    middle = excitations[fitted].mean()
    # the excitation over the squares: its value at zero is sought
    curve = np.polynomial.Polynomial.fit(splits[fitted] ** 2, excitations[fitted] - middle, 4)
    return float(middle + curve(0.0))


def main(path: str | None = None) -> None:
    """Print the points beside those expected, and draw if a path is given."""
    for e in RANGES:
        found, point = doubling(e), expected(e)
        print(f"e = {e}: the period doubles at {found:.6f}, expected {point:.6f}", end=", ")
        print(f"deviation {found - point:.1e}")
    if path is not None:
        draw(path)


def draw(path: str) -> None:
    """Draw the phases of the impacts over the excitation, for each restitution."""
    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt

    plt.style.use("zivi.plot.figures")
    figure, axes = plt.subplots(1, len(RANGES), layout="constrained", figsize=(11, 4.4))
    for ax, e in zip(axes, RANGES, strict=True):
        excitations, phases = diagram(e)
        over = np.repeat(excitations, [len(run) for run in phases])
        marks = {"ms": 1.4, "mew": 0, "alpha": 0.6, "color": zivi.plot.BLUE, "rasterized": True}
        ax.plot(over, wrapped(np.concatenate(phases)), ".", **marks)
        curve = [orbit(excitation, e)[0] for excitation in excitations]
        ax.plot(excitations, curve, color=zivi.plot.ORANGE, ls="--", lw=0.9, zorder=0)
        ax.axvline(doubling(e), color="0.4", ls=":", lw=1)
        ax.annotate(
            f"{doubling(e):.6f}\nexpected {expected(e):.6f}",
            (doubling(e), 0.97),
            (-6, 0),
            xycoords=("data", "axes fraction"),
            textcoords="offset points",
            ha="right",
            va="top",
            fontsize="small",
        )
        ax.set(xlabel=r"excitation $\Gamma = a \omega^2/g$", xlim=RANGES[e])
        ax.set_title(f"$e = {e}$; dashed: one impact a period", fontsize="medium")
    axes[0].set_ylabel("phase of the impacts (rad)")
    figure.savefig(path, dpi=160)


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else None)
