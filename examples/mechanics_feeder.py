r"""A vibratory feeder: a trough that shakes carries parts along.

The trough moves by ``A sin(omega t)`` along a line at the angle ``BETA``. As long as
``a sin(BETA) < g`` with ``a = A omega^2`` parts stay on it, stick, and slide forward a little each
period; above they hop. In brackets: the slide by hand. It begins where the force of stick reaches
its limit, ``sin(s) = mu g/c`` with ``c = a (cos(BETA) + mu sin(BETA))``, and its speed is
``(c (cos(s) - cos(p)) - mu g (p - s))/omega`` at the phase ``p``.

Run as ``python examples/mechanics_feeder.py [out.png]``.
"""

import math
import sys

import numpy as np

import zivi

G, MU, BETA, OMEGA = 9.81, 0.4, 0.5, 2 * math.pi * 10
PERIOD = 2 * math.pi / OMEGA


PART = zivi.symbolic.system(
    "x y",
    T="(xdot**2 + ydot**2)/2",
    V="g*y",
    gaps={"trough": "y - A*sin(beta)*sin(omega*t)"},
    slips={"trough": "xdot - A*cos(beta)*omega*cos(omega*t)"},
    mu={"trough": "mu"},
    parameters={"A": 1.0, "beta": BETA, "omega": OMEGA, "mu": MU, "g": G},
    e=0.2,
)


def run(a: float, periods: int) -> zivi.MechanicalTrajectory:
    """Put a part at rest on a trough that shakes with the acceleration a."""
    speed = a / OMEGA
    start = [0, 0], [speed * math.cos(BETA), speed * math.sin(BETA)]
    method = zivi.SwitchedRK(rtol=1e-9, atol=1e-11)
    return zivi.simulate(PART.replace(A=a / OMEGA**2), (0, periods * PERIOD), start, method)


def by_hand(a: float) -> tuple[float, float]:
    """Give how long a slide lasts, and the mean speed."""
    c = a * (math.cos(BETA) + MU * math.sin(BETA))
    begin = math.asin(MU * G / c)
    low, high = math.pi - begin, 2 * math.pi + begin
    while high - low > 1e-12:
        p = (low + high) / 2
        slides = c * (math.cos(begin) - math.cos(p)) > MU * G * (p - begin)
        low, high = (p, high) if slides else (low, p)
    arc = low - begin
    way = c * math.cos(begin) * arc - c * (math.sin(low) - math.sin(begin)) - MU * G * arc**2 / 2
    return arc / OMEGA, way / OMEGA**2 / PERIOD


def main(path: str | None) -> None:
    """Measure, print beside what is expected, and draw if a path is given."""
    sol = run(5.0, 10)
    slide, speed = by_hand(5.0)
    found = sol.stick["t_start"][-1] - sol.stick["t_end"][-2]
    mean = (sol(9 * PERIOD)[0, 0] - sol(8 * PERIOD)[0, 0]) / PERIOD
    print(repr(sol))
    print(f"slides for {found:.8f} s a period ({slide:.8f})")
    print(f"and moves with {mean:.8f} m/s ({speed:.8f})")
    if path is not None:
        draw(path, sol)


def draw(path: str, sol: zivi.MechanicalTrajectory) -> None:
    """Draw the part on the trough, and its mean speed over the excitation."""
    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt

    plt.style.use("zivi.plot.figures")
    figure, axes = plt.subplots(1, 3, layout="constrained", figsize=(10.4, 3.2))
    fine = sol.resample(n=1001)
    axes[0].plot(fine.t, 1e3 * fine.q[:, 0])
    axes[0].set(xlabel="time $t$ (s)", ylabel="position (mm)")
    zivi.plot.modes(sol, axes[1])
    excitations = np.linspace(3, 40, 38)
    ends = [run(a, 40)(PERIOD * np.array([10, 40]))[0, :, 0] for a in excitations]
    axes[2].plot(excitations / G, np.diff(ends)[:, 0] / (30 * PERIOD), ".-", ms=3)
    axes[2].axvline(1 / math.sin(BETA), color="0.6", lw=0.8)
    axes[2].set(xlabel=r"$A\omega^2/g$", ylabel="mean speed (m/s)")
    figure.suptitle("A vibratory feeder: motion, stick and slip, mean speed")
    figure.savefig(path, dpi=160)


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else None)
