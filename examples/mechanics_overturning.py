r"""A block on a floor that shakes with one full sine: whether it rocks, and whether it overturns.

The floor accelerates by ``a_p sin(omega_p t)`` for one period; in its frame a force ``-m a(t)``
acts on the block. Its feet stick and have no restitution: an impact then leaves Housner's
``1 - 3/2 sin^2 alpha`` of the rate, which is nowhere given. Over ``omega_p/p`` and
``a_p/(g tan alpha)``, with ``p^2 = 3 g/(4 R)``, the chart shows where the block

* stands still: below ``a_p = g tan alpha``,
* rocks and survives,
* overturns after an impact, over its other foot,
* overturns without an impact.

For a slender block the last region begins where, with ``beta = a_p/(g tan alpha)``,

    omega_p/p = sqrt(beta^2 - 1) - beta exp(-(2 pi - asin(1/beta)) p/omega_p)

In brackets: Housner's equation for the angle, by SciPy. After Makris and Roussos (2000), and Zhang
and Makris (2001).

Run as ``python examples/mechanics_overturning.py [out.png]``.
"""

import functools
import math
import sys
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

import zivi

G, B, H = 9.81, 0.4, 1.6
FREQUENCIES = np.linspace(0.2, 8.0, 40)
ACCELERATIONS = np.linspace(0.2, 14.0, 36)
STANDS, SURVIVES, AFTER_IMPACT, WITHOUT_IMPACT = range(4)
FEET = ["left", "right"]

BLOCK = zivi.symbolic.system(
    "x y th",
    T="(xdot**2 + ydot**2)/2 + (b**2 + h**2)*thdot**2/6",
    V="g*y",
    Q={"x": "-a*sin(omega*min(t, 2*pi/omega))"},
    gaps={
        "left": "y - b*sin(th) - h*cos(th)",
        "right": "y + b*sin(th) - h*cos(th)",
        "top left": "y - b*sin(th) + h*cos(th)",
        "top right": "y + b*sin(th) + h*cos(th)",
    },
    slips={
        "left": "xdot + (h*cos(th) + b*sin(th))*thdot",
        "right": "xdot + (h*cos(th) - b*sin(th))*thdot",
    },
    mu={"left": 20, "right": 20},
    parameters={"b": B, "h": H, "g": G, "a": 1.0, "omega": 1.0},
)


def scales(b: float = B, h: float = H) -> tuple[float, float]:
    """Slenderness alpha and frequency p of a block."""
    return math.atan2(b, h), math.sqrt(0.75 * G / math.hypot(b, h))


def block(ratio: float, beta: float, b: float = B, h: float = H) -> zivi.MechanicalSystem:
    """Give the block on a floor that shakes with ``ratio p`` and ``beta g tan alpha``."""
    _, p = scales(b, h)
    return BLOCK.replace(b=b, h=h, a=beta * G * b / h, omega=ratio * p)


def run(ratio: float, beta: float, free: float = 8.0, **more: Any) -> zivi.MechanicalTrajectory:
    """Shake the block, and follow it for ``free/p`` after that."""
    end = (2 * math.pi / ratio + free) / scales()[1]
    return zivi.simulate(block(ratio, beta), (0, end), ([0, H, 0], [0, 0, 0]), **more)


def outcomes(
    ratios: Any, betas: Any, b: float = B, h: float = H, free: float = 7.0, **more: Any
) -> np.ndarray:
    """Tell what becomes of the block in each of many earthquakes."""
    alpha, p = scales(b, h)
    systems = [block(*pair, b, h) for pair in zip(ratios, betas, strict=True)]
    end = (2 * math.pi / np.min(ratios) + free) / p
    batch = zivi.simulate_batch(systems, (0, end), ([0, h, 0], [0, 0, 0]), save="events", **more)
    return np.array(
        [
            outcome(events, abs(tilt) > alpha)
            for events, tilt in zip(batch.events, batch.q[:, 2], strict=True)
        ]
    )


def outcome(events: dict[str, Any], falls: bool) -> int:
    """Tell what happened from the impacts: of the right foot, or of the top before it."""
    if not falls:
        return SURVIVES if len(events["liftoffs"]) else STANDS
    hit = events["impacts"]["gap"]
    on_its_side = np.flatnonzero(hit >= len(FEET))
    upright = hit[: on_its_side[0]] if len(on_its_side) else hit
    return AFTER_IMPACT if FEET.index("right") in upright else WITHOUT_IMPACT


@functools.cache
def chart(rows: int = 1, columns: int = 1) -> np.ndarray:
    """Tell what becomes of it over every so many accelerations (rows) and frequencies (columns)."""
    betas = ACCELERATIONS[::rows]
    found = [outcomes(np.full(len(betas), it), betas) for it in FREQUENCIES[::columns]]
    return np.column_stack(found)


def least(
    reached: int, ratios: Any, low: Any, high: Any, halvings: int = 8, **more: Any
) -> np.ndarray:
    """Bisect for the accelerations from which the outcome is `reached` or worse."""
    low, high = np.array(low, dtype=float), np.array(high, dtype=float)
    for _ in range(halvings):
        middle = (low + high) / 2
        worse = outcomes(ratios, middle, **more) >= reached
        low, high = np.where(worse, low, middle), np.where(worse, middle, high)
    return high


def by_housner(ratio: float, alpha: float = scales()[0]) -> float:
    """Give the acceleration from which Housner's block overturns without an impact.

    In units of ``1/p``: ``theta'' = -sin(alpha - theta) + beta tan(alpha) sin(ratio t)
    cos(alpha - theta)`` from the time at which it lifts off. At the end of the pulse the energy
    just suffices for ``theta = alpha``.
    """

    def left_over(beta: float) -> float:
        def field(t: float, y: Any) -> list[float]:
            push = beta * math.tan(alpha) * math.sin(ratio * t)
            return [y[1], push * math.cos(alpha - y[0]) - math.sin(alpha - y[0])]

        span = math.asin(1 / beta) / ratio, 2 * math.pi / ratio
        angle, rate = solve_ivp(field, span, (0, 0), "DOP853", rtol=1e-12, atol=1e-14).y[:, -1]
        return rate - 2 * math.sin((alpha - angle) / 2)

    above = slender(ratio) - 1
    return brentq(left_over, 1 + above / 2, 1 + 1.2 * above, xtol=1e-12)


def slender(ratio: float) -> float:
    """Give the same of a slender block."""

    def balance(beta: float) -> float:
        pulse = (2 * math.pi - math.asin(1 / beta)) / ratio
        return math.sqrt(beta**2 - 1) - beta * math.exp(-pulse) - ratio

    return brentq(balance, 1, 10 + ratio**2, xtol=1e-13)


def main(path: str | None) -> None:
    """Measure, print beside what is expected, and draw if a path is given."""
    alpha, _ = scales()
    method = zivi.SwitchedRK(rtol=1e-10, atol=1e-10)
    sol = run(4.0, 3.0, method=method)
    first = sol.resolved_impacts["t"][sol.resolved_impacts["gap"] == FEET.index("right")][0]
    before, after = (sol(first + dt)[1, -1] for dt in (-1e-9, 1e-9))
    print(repr(sol))
    print(
        f"an impact keeps {after / before:.6f} of the rate ({1 - 1.5 * math.sin(alpha) ** 2:.6f})"
    )
    rocks = least(SURVIVES, [4.0], [0.5], [1.5], 30, method=method)[0] * G * B / H
    print(f"rocks from {rocks:.6f} m/s2 ({G * math.tan(alpha):.6f})")
    for ratio in (2.0, 5.0):
        ends = [0.9 * slender(ratio)], [1.1 * slender(ratio)]
        found = least(WITHOUT_IMPACT, [ratio], *ends, 28, free=24, method=method)[0]
        print(
            f"at {ratio:.0f} p overturns without an impact from {found:.7f} g tan alpha "
            f"({by_housner(ratio):.7f}); slender: {slender(ratio):.4f}"
        )
    if path is not None:
        draw(path)


def draw(path: str) -> None:
    """Draw the chart with its boundaries, and the angle of one run of each kind."""
    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt
    from matplotlib.colors import ListedColormap

    names = [
        "stands",
        "rocks, survives",
        "overturns after an impact",
        "overturns without an impact",
    ]
    colours = ["#f2f2f2", "#cfe3f1", "#f6c9a0", "#e08a7b"]
    plt.style.use("zivi.plot.figures")
    figure, axes = plt.subplots(1, 2, layout="constrained", figsize=(9.6, 4.2), width_ratios=(3, 2))
    found = chart()
    dx, dy = (np.diff(it)[0] / 2 for it in (FREQUENCIES, ACCELERATIONS))
    box = FREQUENCIES[0] - dx, FREQUENCIES[-1] + dx, ACCELERATIONS[0] - dy, ACCELERATIONS[-1] + dy
    axes[0].imshow(
        found,
        cmap=ListedColormap(colours),
        vmin=0,
        vmax=3,
        origin="lower",
        extent=box,
        aspect="auto",
    )
    for worst, color in ((AFTER_IMPACT, "#a85a12"), (WITHOUT_IMPACT, "#8c1d18")):
        columns = [k for k in range(2, len(FREQUENCIES), 4) if found[-1, k] >= worst]
        rows = np.argmax(found[:, columns] >= worst, axis=0)
        ends, ratios = (ACCELERATIONS[rows - 1], ACCELERATIONS[rows]), FREQUENCIES[columns]
        axes[0].plot(ratios, least(worst, ratios, *ends), ".", color=color)
    fine = np.linspace(0.1, 7.7, 200)
    axes[0].plot(fine, [slender(it) for it in fine], "k--", lw=0.8, label="slender block")
    axes[0].axhline(1, color="0.3", lw=0.8)
    for name, colour in zip(names, colours, strict=True):
        axes[0].plot([], [], "s", color=colour, mec="0.5", label=name)
    axes[0].set(xlabel=r"$\omega_p/p$", ylabel=r"$a_p/(g\,\tan\alpha)$", xlim=box[:2], ylim=box[2:])
    axes[0].legend(loc="lower left", bbox_to_anchor=(0, 1), ncols=2)

    alpha, p = scales()
    for beta, kind in ((2.8, SURVIVES), (5.0, AFTER_IMPACT), (7.4, WITHOUT_IMPACT)):
        sol = run(5.0, beta).resample(n=2001)
        axes[1].plot(p * sol.t, sol.q[:, 2] / alpha, label=f"{beta}: {names[kind]}")
    axes[1].axhline(0, color="0.7", lw=0.6)
    axes[1].set(xlabel="$p\\,t$", ylabel=r"$\theta/\alpha$", ylim=(-2, 2))
    axes[1].set_title(r"$\omega_p = 5 p$, over $a_p/(g\,\tan\alpha)$", fontsize="medium")
    axes[1].legend(loc="lower left", bbox_to_anchor=(0, 1.08))
    figure.savefig(path, dpi=160)


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else None)
