r"""The orbits of a ball on a table and of an oscillator at a wall, followed over a parameter.

In the frame of the table ``x'' = -1 + Gamma sin t``, ``x >= 0``, ``e = 1/2``. The orbit with one
impact in a period folds at ``Gamma = pi (1 - e)/(1 + e)`` and doubles at

    Gamma^2 = (pi (1 - e)/(1 + e))^2 + (2 (1 + e^2)/(1 + e)^2)^2,

a cascade follows. Beside all that the ball may come to rest once a period, through a Zeno point:
that orbit exists from ``Gamma = 1`` to 1.5973488311951537, where the impacts no longer accumulate
in time.

The oscillator ``x'' = -x - 2 z x' + 1 + F cos(w t)`` (Shaw and Holmes) has orbits in closed form,
``F^2 = D (a u^2 + b u + 1)`` with the speed u after the impact: a grazing at ``u = 0``, a fold at
``u = -b/(2 a)``. A run settles on the orbit without impacts; where it grazes, the other begins.

At last a design: which restitution, and which height of fall, let a ball on a spring come to rest
after 3 s at the least impact speed? The derivatives of the Zeno time go to SciPy's SLSQP.

Run as ``python examples/gallery_orbits.py [out.png]``.
"""

import functools
import math
import sys

import numpy as np

import zivi

E = 0.5
SPAN = (1.0, 1.75)
FORCES = (0.05, 0.6)
LONGEST = 32
"""Periods of the last doubled orbit."""


def table(excitation: float) -> zivi.ImpactSystem:
    """Ball in the frame of the table."""
    force = zivi.LinearForce(gravity=1.0, amplitude=excitation, phase=-math.pi / 2)
    return zivi.ImpactSystem(force, e=E)


@functools.cache
def cascade() -> list[zivi.Branch]:
    """Follow the branch with one impact a period, and those that double one after the other."""
    orbit = zivi.periodic_orbit(table(1.3), [(0.6, 2.1)])
    branches = [zivi.continue_orbit(orbit, "amplitude", SPAN)]
    while branches[-1].orbits[0].multiple < LONGEST:
        last = branches[-1]
        orbit = last.switch(last.of_kind("period_doubling")[0])
        branches.append(zivi.continue_orbit(orbit, "amplitude", SPAN, max_points=60))
    return branches


@functools.cache
def resting() -> zivi.Branch:
    """Follow the orbit that rests once a period."""
    orbit = zivi.periodic_orbit(table(1.3), (0.0, (0.0, 0.0)))
    return zivi.continue_orbit(orbit, "amplitude", (0.9, 1.75))


def oscillator(amplitude: float, z: float = 0.02, w: float = 1.2) -> zivi.ImpactSystem:
    """Oscillator whose equilibrium is one metre off the wall."""
    force = zivi.LinearForce(
        stiffness=1.0, damping=2 * z, gravity=-1.0, amplitude=amplitude, omega=w
    )
    return zivi.ImpactSystem(force, e=0.7)


def closed(z: float = 0.02, w: float = 1.2, e: float = 0.7) -> tuple[float, float, float]:
    """``D``, ``a`` and ``b`` of ``F^2 = D (a u^2 + b u + 1)``."""
    period, fast = 2 * math.pi / w, math.sqrt(1 - z * z)
    c, s = math.cos(fast * period), math.sin(fast * period) / fast
    flow = math.exp(-z * period) * np.array([[c + z * s, s], [-s, c - z * s]])
    r = np.linalg.solve(np.eye(2) - flow, [-flow[0, 1], -(flow[1, 1] + 1 / e)])
    d = (1 - w * w) ** 2 + (2 * z * w) ** 2
    return d, float(r[0] ** 2 + (r[1] / w) ** 2), float(-2 * r[0])


@functools.cache
def grazing() -> tuple[zivi.Branch, zivi.Branch]:
    """Follow the smooth orbit that a run settles on, and that with an impact from its grazing."""
    run = zivi.simulate(oscillator(0.3), (0, 1500), (0.2, 0.0), zivi.SwitchedRK(rtol=1e-8))
    smooth = zivi.continue_orbit(zivi.periodic_orbit(oscillator(0.3), run), "amplitude", FORCES)
    orbit = smooth.switch(smooth.of_kind("interior_impact")[0])
    return smooth, zivi.continue_orbit(orbit, "amplitude", FORCES)


def design(wanted: float = 3.0) -> tuple[np.ndarray, float, int]:
    """Restitution and height of the gentlest fall that rests at `wanted`, its speed, the runs."""
    from scipy import optimize

    force = zivi.LinearForce(stiffness=1.0, damping=0.2, gravity=9.81)
    arguments = (zivi.ImpactSystem(force, e=0.5), (0.0, 60.0), (1.0, 0.0), ["e", "x0"])
    rest = zivi.interop.run_function(*arguments, "zeno_time")
    first = zivi.interop.run_function(*arguments, "impact_speed")

    def speed(p: np.ndarray) -> tuple[float, np.ndarray]:
        # before the impact: that after it over e
        value, by = first(p)
        return value / p[0], by / p[0] - np.array([value / p[0] ** 2, 0.0])

    late = {"type": "eq", "fun": lambda p: rest(p)[0] - wanted, "jac": lambda p: rest(p)[1]}
    found = optimize.minimize(
        speed,
        [0.6, 1.0],
        jac=True,
        constraints=[late],
        method="SLSQP",
        bounds=[(0.2, 0.8), (0.05, 5.0)],
        options={"ftol": 1e-12},
    )
    return found.x, float(found.fun), int(found.nfev)


def main(path: str | None = None) -> None:
    """Print what was found beside the closed forms, and draw if a path is given."""
    first, rests, (smooth, other) = cascade()[0], resting(), grazing()
    ratio = math.pi * (1 - E) / (1 + E)
    doubling = math.hypot(ratio, 2 * (1 + E**2) / (1 + E) ** 2)
    print(f"fold {first.of_kind('fold')[0].value:.12f}, closed form {ratio:.12f}")
    values = [branch.of_kind("period_doubling")[0].value for branch in cascade()]
    print(f"doublings {', '.join(f'{it:.10f}' for it in values)}; the first {doubling:.10f}")
    gaps = np.diff(values)
    print(f"ratios of their gaps {', '.join(f'{it:.2f}' for it in gaps[:-1] / gaps[1:])}")
    end = rests.of_kind("end_of_rest")[0].value
    print(f"rest once a period ends at {end:.12f}, found by {rests.n_flights} flights")
    d, a, b = closed()
    touch = smooth.of_kind("interior_impact")[0].value
    print(f"grazing {touch:.12f}, closed form {math.sqrt(d):.12f}")
    fold = math.sqrt(d * (1 - b * b / (4 * a)))
    print(f"its fold {other.of_kind('fold')[0].value:.12f}, closed form {fold:.12f}")
    p, speed, runs = design()
    print(f"rest at 3 s: e = {p[0]:.6f}, {p[1]:.6f} m high, {speed:.6f} m/s; {runs} evaluations")
    if path is not None:
        draw(path)


def draw(path: str) -> None:
    """Draw the cascade over brute force, the time at rest, the oscillator, the basins."""
    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt

    plt.style.use("zivi.plot.figures")
    figure, axes = plt.subplots(2, 2, layout="constrained", figsize=(10, 7.6))
    (one, two), (three, four) = axes
    diagram = zivi.bifurcation_diagram(
        table(1.3), "amplitude", np.linspace(*SPAN, 140), starts=(0.3, 1.9), transient=150, keep=40
    )
    zivi.plot.diagram(diagram, cascade()[:4], ax=one)
    one.set(title="Cascade over brute force", xlabel=r"$\Gamma$ (1)", ylim=(1.6, 2.5))
    zivi.plot.branch(resting(), "margin", ax=two)
    two.set(title="Rest once a period, and its end", xlabel=r"$\Gamma$ (1)")
    for branch in grazing():
        zivi.plot.branch(branch, ax=three)
    d, a, b = closed()
    u = np.linspace(0, 1.2, 50)
    force = np.sqrt(d * (a * u * u + b * u + 1))
    three.plot(force, u, ".", color=zivi.plot.ORANGE, ms=2, label="closed form")
    three.set(title="Oscillator: fold and grazing", xlabel="$F$ (1)", xlim=FORCES, ylim=(-0.1, 1.3))
    handles, names = three.get_legend_handles_labels()
    each = dict(zip(names, handles, strict=True))
    three.legend(list(each.values()), list(each), fontsize="small")
    known = [
        zivi.periodic_orbit(table(1.3), [(0.6, 2.1)]),
        zivi.periodic_orbit(table(1.3), (0.0, (0.0, 0.0))),
    ]
    x, v = np.linspace(0, 3, 45), np.linspace(-3, 3, 45)
    cells = zivi.basins(table(1.3), x, v, known, transient=60, keep=8)
    zivi.plot.basins(cells, ax=four)
    four.set(title=r"Basins at $\Gamma = 1.3$")
    figure.savefig(path, dpi=140)


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else None)
