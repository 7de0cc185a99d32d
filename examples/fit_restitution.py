r"""A fit of the restitution to a film of a bouncing ball.

A camera of 120 pictures a second sees the height of a ball with 2 mm of noise. The unknowns are the
height of the drop, the restitution, the drag and gravity. `scipy.optimize.least_squares` gets the
positions and their derivatives from one run each, through all impacts, the Zeno point and rest. The
film is made here, from impact to impact in closed form. In brackets: what the film was made with;
deviations from 60 films.

Run as ``python examples/fit_restitution.py [out.png]``.
"""

import math
import sys

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import OptimizeResult, brentq, least_squares

import zivi

NAMES = ("x0", "e", "damping", "gravity")
TRUTH = np.array([0.8, 0.72, 0.15, 9.81])
GUESS = np.array([1.0, 0.6, 0.05, 9.5])
NOISE = 2e-3
TIMES = np.arange(1, 361) / 120.0


def heights(t: NDArray[np.float64]) -> NDArray[np.float64]:
    """Heights of the true ball, from arc to arc: gravity and linear drag have a closed form."""
    x0, e, c, g = TRUTH
    found = np.zeros_like(t)
    start, x, v = 0.0, x0, 0.0

    def at(tau: float | NDArray[np.float64]) -> tuple[float, float]:
        fade = -np.expm1(-c * tau)
        return x + (v + g / c) * fade / c - g * tau / c, v - (v + g / c) * fade

    while start < t[-1] and (x > 0 or v > 1e-9):
        top = math.log1p(c * v / g) / c if v > 0 else 0.0
        length = brentq(lambda tau: at(tau)[0], top + 1e-15, top + 2.0, xtol=1e-15)
        during = (t >= start) & (t < start + length)
        found[during] = at(t[during] - start)[0]
        x, v, start = 0.0, -e * at(length)[1], start + length
    return found


def model() -> zivi.interop.RunFunction:
    """Give the positions as a function of the four unknowns, with derivatives."""
    ball = zivi.ImpactSystem(zivi.LinearForce(gravity=9.5, damping=0.05), e=0.6)
    return zivi.interop.run_function(ball, (0, 3.1), (1, 0), NAMES, "positions", times=TIMES)


def fit(film: NDArray[np.float64], run: zivi.interop.RunFunction) -> OptimizeResult:
    """Fit the unknowns to a film; residuals are in units of the noise."""
    return least_squares(
        lambda p: (run.fun(p) - film) / NOISE,
        GUESS,
        jac=lambda p: run.jac(p) / NOISE,
        x_scale="jac",
    )


def deviations(result: OptimizeResult) -> NDArray[np.float64]:
    """Give the standard deviations of the unknowns, from the derivatives at the fit."""
    return np.sqrt(np.diag(np.linalg.inv(result.jac.T @ result.jac)))


def films(number: int, seed: int = 1) -> NDArray[np.float64]:
    """Make films with noise."""
    noise = np.random.default_rng(seed).standard_normal((number, len(TIMES)))
    return heights(TIMES) + NOISE * noise


def main(path: str | None) -> None:
    """Fit, print beside what is expected, and draw if a path is given."""
    run = model()
    result = fit(films(1)[0], run)
    spread = np.std([fit(film, run).x for film in films(60, 2)], axis=0)
    for name, value, own, true, seen in zip(
        NAMES, result.x, deviations(result), TRUTH, spread, strict=True
    ):
        print(f"{name:8} {value:8.5f} ({true:.2f}), deviation {own:.1e} ({seen:.1e})")
    print(f"{result.nfev} evaluations of the model")
    if path is not None:
        draw(path, films(1)[0], run, result)


def draw(
    path: str, film: NDArray[np.float64], run: zivi.interop.RunFunction, result: OptimizeResult
) -> None:
    """Draw the film, the guess, the fit, and what is left."""
    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(2, 1, layout="constrained", figsize=(8.0, 4.8), sharex=True)
    axes[0].plot(TIMES, film, ".", ms=3, color="0.6", label="film")
    axes[0].plot(TIMES, run.fun(GUESS), color=zivi.plot.ORANGE, lw=0.8, label="guess")
    axes[0].plot(TIMES, run.fun(result.x), color=zivi.plot.BLUE, lw=1.0, label="fit")
    axes[0].set(ylabel="height (m)")
    axes[0].legend()
    axes[1].plot(TIMES, 1e3 * (film - run.fun(result.x)), ".", ms=3, color=zivi.plot.BLUE)
    axes[1].set(xlabel="time (s)", ylabel="film less fit (mm)")
    figure.savefig(path, dpi=150)


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else None)
