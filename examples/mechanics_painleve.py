r"""A rod that slides on its tip, and Painleve's paradox.

The tip of a uniform rod of length 2 touches the floor at the angle ``th``. While it slides to the
left, ``g'' = K lambda + b`` with ``K = 1 + 3 c^2 - 3 mu s c``, ``b = s th'^2 - g``: with ``K < 0``
and ``b < 0`` no force keeps the tip out of the floor. In brackets: the least coefficient of
friction with which that happens, 4/3, the first angle, where ``K = 0``, and the impulses of the
impact without a collision that stops the tip, ``D P = (0, -w)``.

Run as ``python examples/mechanics_painleve.py [out.png]``.
"""

import math
import sys

import numpy as np

import zivi

ROD = {
    paradox: zivi.symbolic.system(
        "x y th",
        T="(xdot**2 + ydot**2)/2 + thdot**2/6",
        V="g*y",
        gaps={"tip": "y - sin(th)"},
        slips={"tip": "xdot + sin(th)*thdot"},
        mu={"tip": "mu"},
        parameters={"g": 9.81, "mu": 1.6},
        paradox=paradox,
    )
    for paradox in ("stop", "impact")
}


def slide(mu: float, th: float, end: float, paradox: str = "stop") -> zivi.MechanicalTrajectory:
    """Let the tip slide to the left with 2 m/s."""
    start = [0, math.sin(th), th], [-2, 0, 0]
    method = zivi.SwitchedRK(rtol=1e-9, atol=1e-9)
    return zivi.simulate(ROD[paradox].replace(mu=mu), (0, end), start, method)


def jams(mu: float, th: float) -> bool:
    """Whether there is no force at the start."""
    return slide(mu, th, 1e-6).status is zivi.Status.INCONSISTENT_CONTACT


def bisect(jammed: float, free: float, test) -> float:
    """Find the border between two values."""
    while abs(free - jammed) > 1e-9:
        middle = (jammed + free) / 2
        jammed, free = (middle, free) if test(middle) else (jammed, middle)
    return jammed


def main(path: str | None) -> None:
    """Measure, print beside what is expected, and draw if a path is given."""
    sol = slide(1.6, 1.0, 0.4, "impact")
    (row,) = sol.resolved_impacts
    s, c = math.sin(1.0), math.cos(1.0)
    mobility = [[1 + 3 * c * c, -3 * s * c], [-3 * s * c, 1 + 3 * s * s]]
    normal, tangential = np.linalg.solve(mobility, [0, 2])
    # K = 0 with tan(th): tan^2 - 3 mu tan + 4 = 0
    first = math.atan((3 * 1.6 - math.sqrt(9 * 1.6**2 - 16)) / 2)
    print(slide(1.6, 1.0, 0.4).message)
    print(f"from mu = {bisect(1.6, 1.0, lambda mu: jams(mu, math.atan(2))):.7f} ({4 / 3:.7f})")
    print(f"with 1.6 from {bisect(1.0, 0.5, lambda th: jams(1.6, th)):.7f} rad ({first:.7f})")
    print(f"pressed by {row['impulse']:.7f} Ns ({normal:.7f})")
    print(f"held by {row['tangential_impulse']:.7f} Ns ({tangential:.7f})")
    if path is not None:
        draw(path)


def draw(path: str) -> None:
    """Draw where the rod jams, and how it goes on by an impact."""
    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt

    plt.style.use("zivi.plot.figures")
    figure, axes = plt.subplots(1, 2, layout="constrained", figsize=(9.6, 3.4))
    mus, angles = np.linspace(1.0, 2.0, 21), np.linspace(0.5, 1.4, 21)
    image = [[jams(mu, th) for mu in mus] for th in angles]
    axes[0].pcolormesh(mus, angles, image, cmap="Blues", vmax=2)
    axes[0].plot(4 / 3 / np.tan(angles) + np.tan(angles) / 3, angles)
    axes[0].set(xlabel=r"$\mu$", ylabel="angle (rad)", xlim=(1, 2))
    for mu in (0.3, 1.2, 1.6):
        sol = slide(mu, 1.0, 0.4, "impact").resample(n=401)
        axes[1].plot(sol.t, sol.slips[:, 0], label=rf"$\mu = {mu}$")
    axes[1].set(xlabel="time $t$ (s)", ylabel="slip speed of the tip (m/s)")
    axes[1].legend()
    figure.suptitle("A sliding rod: where the paradox exists, and runs at an angle inside of it")
    figure.savefig(path, dpi=160)


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else None)
