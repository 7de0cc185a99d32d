r"""A wagon between two bumpers, rigid and after Hertz.

A wagon of 2 kg runs against an elastic bumper, force ``k d^1.5``. In brackets: how deep it comes,
``(5 m v^2/(4 k))^(2/5)``, the largest force, and how long the contact lasts,
``2 (d/v) sqrt(pi) G(7/5)/G(9/10)`` with the gamma function G. A bumper after Hunt and Crossley
throws it back with a speed u that does not depend on k: ``a v - ln(1 + a v) = -a u - ln(1 - a u)``.
The stiffer the bumpers, the nearer is the motion to that with rigid ones.

Run as ``python examples/mechanics_bumper.py [out.png]``.
"""

import math
import sys

import numpy as np

import zivi

MASS, SPEED, STIFFNESS = 2.0, 1.5, 1e5
METHOD = zivi.SwitchedRK(rtol=1e-11, atol=1e-11)


def wagon(law: zivi.Hertz | zivi.HuntCrossley | None) -> zivi.MechanicalTrajectory:
    """Run between walls at 0 and 1 m, rigid and elastic without a law."""
    walls = [
        zivi.LinearGap([-1.0], 1.0, name="right", contact=law),
        zivi.LinearGap([1.0], name="left", contact=law),
    ]
    e = 1.0 if law is None else 0.0
    system = zivi.MechanicalSystem(mass=MASS, force=[0.0], gaps=walls, e=e, coordinates=["x"])
    return zivi.simulate(system, (0, 3), ([0.5], [SPEED]), METHOD)


def rebound(av: float) -> float:
    """Solve for the restitution u/v of Hunt and Crossley by bisection."""
    low, high = 0.0, min(1.0, 1.0 / av)
    left = av - math.log1p(av)
    while high - low > 1e-12:
        e = (low + high) / 2
        low, high = (e, high) if -av * e - math.log1p(-av * e) < left else (low, e)
    return low


def main(path: str | None) -> None:
    """Measure, print beside what is expected, and draw if a path is given."""
    sol = wagon(zivi.Hertz(STIFFNESS))
    print(repr(sol))
    depth = (5 * MASS * SPEED**2 / (4 * STIFFNESS)) ** 0.4
    first = sol.resample(np.linspace(sol.touchdowns["t"][0], sol.liftoffs["t"][0], 2001))
    print(f"depth {-first.gaps[:, 0].min():.7f} m ({depth:.7f})")
    print(f"force {first.reactions[:, 0].max():.4f} N ({STIFFNESS * depth**1.5:.4f})")
    lasts = 2 * depth / SPEED * math.sqrt(math.pi) * math.gamma(1.4) / math.gamma(0.9)
    print(f"contact {sol.liftoffs['t'][0] - sol.touchdowns['t'][0]:.9f} s ({lasts:.9f})")
    damped = wagon(zivi.HuntCrossley(STIFFNESS, alpha=0.5))
    after = -damped(damped.liftoffs["t"][0])[1, 0] / SPEED
    print(f"Hunt and Crossley: restitution {after:.8f} ({rebound(0.5 * SPEED):.8f})")
    if path is not None:
        draw(path, first)


def draw(path: str, first: zivi.MechanicalTrajectory) -> None:
    """Draw the motion between bumpers of several stiffnesses, and the force of a contact."""
    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt

    plt.style.use("zivi.plot.figures")
    figure, axes = plt.subplots(1, 2, layout="constrained", figsize=(9.0, 3.2), width_ratios=(2, 1))
    laws = {"rigid": None} | {f"$k = 10^{k}$": zivi.Hertz(10.0**k) for k in (5, 4, 3)}
    for (name, law), style in zip(laws.items(), ("k", "C0--", "C1-.", "C2:"), strict=True):
        sol = wagon(law).resample(np.linspace(0, 3, 1201))
        axes[0].plot(sol.t, sol.q[:, 0], style, label=name, lw=1.2)
    axes[0].set(xlabel="time $t$ (s)", ylabel="position $x$ (m)", ylim=(-0.25, 1.6))
    axes[0].legend(title="bumpers (N/m$^{1.5}$)", ncols=4, fontsize=8, loc="upper left")
    axes[1].plot(1e3 * (first.t - first.t[0]), first.reactions[:, 0], "C0")
    axes[1].set(xlabel="time since touchdown (ms)", ylabel="contact force (N)", ylim=(0, None))
    axes[1].set_title("$k = 10^5$", fontsize=9)
    figure.savefig(path, dpi=160)


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else None)
