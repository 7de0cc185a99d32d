r"""A fit of the restitution to a video of a bouncing ball.

A camera of 120 frames per second measures the height of a ball with 2 mm of noise. The unknowns are
the height of the drop, the restitution, the drag and gravity. The video is made here, from impact
to impact in closed form. In brackets: true values; standard deviations over 30 videos.

Run as ``python examples/fit_restitution.py [out.png]``.
"""

import math
import sys
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

import zivi

TRUTH = {"x0": 0.8, "e": 0.72, "damping": 0.15, "gravity": 9.81}
BALL = zivi.ImpactSystem(zivi.LinearForce(gravity=9.5, damping=0.05), e=0.6)
NOISE = 2e-3
TIMES = np.arange(1, 361) / 120.0


def heights(t: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return heights of the true ball, from flight to flight, with linear drag."""
    x0, e, c, g = TRUTH.values()
    found = np.zeros_like(t)
    start, x, v = 0.0, x0, 0.0

    def at(tau: Any) -> tuple[Any, Any]:
        fade = -np.expm1(-c * tau)
        return x + (v + g / c) * fade / c - g * tau / c, v - (v + g / c) * fade

    while start < t[-1] and (x > 0 or v > 1e-9):
        top = math.log1p(c * v / g) / c if v > 0 else 0.0
        length = brentq(lambda tau: at(tau)[0], top + 1e-15, top + 2.0, xtol=1e-15)
        during = (t >= start) & (t < start + length)
        found[during] = at(t[during] - start)[0]
        x, v, start = 0.0, -e * at(length)[1], start + length
    return found


def video(seed: int) -> zivi.Record:
    """Make a video with noise."""
    noise = np.random.default_rng(seed).standard_normal(len(TIMES))
    return zivi.Record(TIMES, heights(TIMES) + NOISE * noise, sigma=NOISE)


def fit(record: zivi.Record, starts: int = 1) -> zivi.Fit:
    """Fit the unknowns to a video."""
    return zivi.fit(BALL, record, tuple(TRUTH), y0=(1.0, 0.0), starts=starts)


def main(path: str | None) -> None:
    """Fit, print the result with the true values, and draw if a path is given."""
    found = fit(video(1), starts=4)
    spread = np.std([fit(video(seed)).x for seed in range(2, 32)], axis=0)
    for (name, true), seen in zip(TRUTH.items(), spread, strict=True):
        value, own = found.values[name], found.std[name]
        print(f"{name:8} {value:8.5f} ({true:.2f}), deviation {own:.1e} ({seen:.1e})")
    print(f"found by {found.found} of {found.starts} starts")
    if path is not None:
        import matplotlib as mpl

        mpl.use("Agg")
        import matplotlib.pyplot as plt

        with plt.style.context("zivi.plot.figures"):
            figure = found.plot()
            figure.suptitle("Height of a ball in a video, and the fit")
            figure.axes[0].set_ylabel("height $x$ (m)")
            figure.savefig(path, dpi=150)


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else None)
