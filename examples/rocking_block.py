r"""A slender block rocks about its two lower edges and comes to rest in finite time (Housner 1963).

Tilted by theta about one edge, a block of half-diagonal R and slenderness alpha (the angle between
its diagonal and the vertical) turns back, if both angles are small, under

    theta'' = -p^2 sgn(theta) (alpha - |theta|),        p^2 = 3 g/(4 R)

When it is upright the other edge hits the floor. The angular momentum about that edge is conserved,
which leaves of the rate

    e = 1 - 3/2 sin^2(alpha)

and theta passes through zero to the other side. The distance from upright, ``x = |theta|``, is
therefore a mass above a wall with restitution e, pulled towards it by ``-p^2 (alpha - x)``, and the
transformed position s, which changes its sign at every impact, is theta itself.

Between two impacts ``x'^2 - p^2 (alpha - x)^2`` is constant. With ``phi_n = x/alpha`` at the n-th
apex, a quarter period takes ``acosh(1/(1 - phi_n))/p`` and an impact leaves

    1 - (1 - phi_n)^2 = e^(2n) (1 - (1 - phi_0)^2)

so released from phi_0 it rests at ``Q_0 + 2 Q_1 + 2 Q_2 + ...``, Q_n the quarter periods. For
alpha = 0.2, p = 1, phi_0 = 1/2: e = 0.9407957, and it rests from 31.902716 s. Tilted beyond alpha
it falls.

Real blocks deviate: they bounce and slide, and lose more than e says.

Run as ``python examples/rocking_block.py [out.png]``.
"""

import math
import sys

import numpy as np

import zivi

ALPHA, P = 0.2, 1.0
T_END = 60.0
METHOD = zivi.SwitchedRK(rtol=1e-11, atol=1e-13)


def restitution(alpha: float) -> float:
    """Share of the rate that the change of edges leaves."""
    return 1 - 1.5 * math.sin(alpha) ** 2


def quarter(phi: float) -> float:
    """Time from the apex phi = x/alpha to the upright position (s)."""
    return math.acosh(1 / (1 - phi)) / P


def rest_time(phi: float, e: float = restitution(ALPHA)) -> float:
    """Time of rest after the release at phi, by the series (s)."""
    total, n = quarter(phi), 1
    energy = 1 - (1 - phi) ** 2
    while (left := e ** (2 * n) * energy) > 1e-32:
        # 1 - sqrt(1 - left), and acosh(1/sqrt(1 - left)) = atanh(sqrt(left)), without cancellation
        total += 2 * math.atanh(math.sqrt(left)) / P
        n += 1
    return total


def rock(phi: float, speed: float = 0.0, alpha: float = ALPHA) -> zivi.Trajectory:
    """Release the block at ``phi alpha`` with a rate (rad/s) and watch for its fall."""

    def overturns(t: float, x: float, xdot: float) -> float:
        return x - alpha

    overturns.terminal, overturns.direction = True, 1  # type: ignore[attr-defined]
    force = zivi.LinearForce(stiffness=-(P**2), gravity=P**2 * alpha)
    system = zivi.ImpactSystem(force, e=restitution(alpha))
    times = np.linspace(0, T_END, 3001)
    return zivi.simulate(system, (0, T_END), (phi * alpha, speed), METHOD, times, events=overturns)


def main(path: str | None) -> None:
    """Measure, print beside what is expected, and draw if a path is given."""
    e = restitution(ALPHA)
    print(f"e = {e:.7f}")
    for phi in (0.1, 0.5, 0.9):
        sol = rock(phi)
        print(
            f"released at {phi} alpha: at rest from {sol.rest_time:.8f} s ({rest_time(phi):.8f}), "
            f"{len(sol.impacts)} impacts and {sol.nfev} evaluations of the force"
        )
    apex = 1 - math.sqrt(1 - e**2 * 0.75)
    x, _ = rock(0.5)(quarter(0.5) + quarter(apex))
    print(f"apex after the first impact: {x / ALPHA:.9f} alpha ({apex:.9f})")
    for factor in (0.999, 1.001):
        fallen = rock(0.0, factor * P * ALPHA).t_events[0]
        print(f"pushed with {factor} p alpha: {'falls over' if len(fallen) else 'stays'}")
    if path is not None:
        draw(path)


def draw(path: str) -> None:
    """Draw the angle over time, and the time of rest over the slenderness."""
    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt

    plt.style.use("zivi.plot.figures")
    figure, (left, right) = plt.subplots(
        1, 2, layout="constrained", figsize=(9.6, 3.4), width_ratios=(2, 1)
    )
    sol = rock(0.5)
    left.plot(sol.t, sol.transformed.s, color=zivi.plot.BLUE)
    left.axvline(sol.rest_time, color="0.5", ls=":", lw=1)
    left.text(sol.rest_time + 0.3, 0.05, f"at rest from\n{sol.rest_time:.6f} s", fontsize="small")
    left.set(xlabel="time $t$ (s)", ylabel=r"angle $\theta = s$ (rad)", xlim=(0, 40))
    left.set_title(r"$\alpha = 0.2$, released at $\alpha/2$", fontsize="medium")

    alphas = np.linspace(0.15, 0.5, 15)
    found = [rock(0.5, alpha=alpha).rest_time for alpha in alphas]
    series = [rest_time(0.5, restitution(alpha)) for alpha in alphas]
    right.plot(alphas, series, color="0.6", label="series")
    right.plot(alphas, found, ".", color=zivi.plot.ORANGE, label="run")
    right.set(xlabel=r"slenderness $\alpha$ (rad)", ylabel="rest from (s)")
    right.legend()
    figure.savefig(path, dpi=160)


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else None)
