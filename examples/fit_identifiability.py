r"""Parameters that data do not determine: drag and gravity of a falling ball.

The 95 % regions of both from videos of different length, 60 frames per second with 2 mm of noise.
Before the first impact a larger drag looks like a smaller gravity; the bounces separate them.
Where even that fails, `zivi.fit` names the parameters: mass and stiffness of an oscillator have
only a ratio.

Run as ``python examples/fit_identifiability.py [out.png]``.
"""

import sys

import numpy as np
from numpy.typing import NDArray

import zivi

BALL = zivi.ImpactSystem(zivi.LinearForce(gravity=9.81, damping=0.1), e=0.8)
NOISE, Y0 = 2e-3, (1.0, 0.0)
LENGTHS = (0.45, 0.7, 3.0)
"""Lengths of the videos (s); the first impact is at 0.456 s."""


def video(end: float) -> zivi.Record:
    """Make a video of the ball."""
    times = np.arange(1, int(60 * end) + 1) / 60.0
    noise = NOISE * np.random.default_rng(3).standard_normal(len(times))
    return zivi.Record(times, zivi.simulate(BALL, (0, 3), Y0)(times)[0] + noise, NOISE)


def oscillator(mass: float, stiffness: float) -> zivi.LinearSystem:
    """Build a free oscillator."""
    return zivi.LinearSystem([[mass]], None, [[stiffness]], coordinates=["x"])


def undetermined() -> zivi.Fit:
    """Fit mass and stiffness of an oscillator to its free vibration."""
    t = np.linspace(0.1, 4.0, 40)
    system = zivi.ParametricSystem(oscillator, {"mass": 1.0, "stiffness": 3.0})
    record = zivi.Record(t, np.cos(2 * t), sigma=1e-3)
    return zivi.fit(system, record, ("mass", "stiffness"), y0=([1.0], [0.0]), starts=1)


def region(found: zivi.Fit) -> NDArray[np.float64]:
    """Return the border of the 95 % region of two parameters, shape (2, k)."""
    turn = np.linspace(0.0, 2 * np.pi, 121)
    root = np.linalg.cholesky(5.991 * found.covariance)
    return found.x[:, None] + root @ np.array([np.cos(turn), np.sin(turn)])


def main(path: str | None) -> None:
    """Compare deviations, name what is not determined, and draw if a path is given."""
    names = ("damping", "gravity")
    fits = {end: zivi.fit(BALL, video(end), names, y0=Y0, starts=1) for end in LENGTHS}
    for end, found in fits.items():
        rho = found.covariance[0, 1] / np.prod(found.deviations)
        print(f"{end} s: drag +- {found.std['damping']:.4f}, correlation {rho:.3f}")
    print(undetermined().notes[0])
    if path is not None:
        draw(path, fits)


def draw(path: str, fits: dict[float, zivi.Fit]) -> None:
    """Draw the regions."""
    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt

    plt.style.use("zivi.plot.figures")
    figure, ax = plt.subplots(layout="constrained", figsize=(6.4, 3.6))
    colours = (zivi.plot.GREEN, zivi.plot.ORANGE, zivi.plot.BLUE)
    for (end, found), colour in zip(fits.items(), colours, strict=True):
        ax.plot(*region(found), color=colour, label=f"first {end} s")
    ax.plot(0.1, 9.81, "k+", ms=10, label="true")
    ax.set(xlabel="drag (1/s)", ylabel="gravity (m/s²)")
    ax.legend(frameon=False)
    figure.suptitle("95 % regions of drag and gravity, from videos of a ball")
    figure.savefig(path, dpi=150)


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else None)
