"""Orders of the methods: error over the mean step for a shaken ball with drag.

The force is ``-g - c x' + A cos(omega t)`` with ``e = 0.5``; the state is compared at 1.5 s, in
flight after one impact. The truth is the power series of the linear force (errors of 2e-14), which
shares no step and no interpolation with the Runge-Kutta pairs. In brackets: the order of theory.

Run as ``python examples/orders.py [out.png]``.
"""

import sys
from typing import Any

import numpy as np

import zivi

G, C, A, OMEGA, E, END = 9.81, 0.3, 5.0, 60.0, 0.5, 1.5
START = (5.0, 0.0)
FORCE = zivi.LinearForce(gravity=G, damping=C, amplitude=A, omega=OMEGA)
LINEAR = zivi.ImpactSystem(FORCE, e=E)


def end_of(method: Any) -> tuple[float, float, float]:
    """Return the position and velocity at the end, and the mean step (s)."""
    sol = zivi.simulate(LINEAR, (0, END), START, method, t_eval=[END])
    return float(sol.x[0]), float(sol.xdot[0]), END / sol.n_steps


def family(kind: str) -> list[Any]:
    """Return the methods of a kind, from coarse to fine."""
    if kind.startswith("SwitchedRK"):
        order = int(kind[-1])
        tolerances = 10.0 ** -np.arange(3.0, 12.0 if order == 8 else 11.0)
        return [
            zivi.SwitchedRK(rtol=it, atol=it / 1000, order=order, flights="rk") for it in tolerances
        ]
    made = {"ThetaGamma": zivi.ThetaGamma, "MoreauJean": zivi.MoreauJean}[kind]
    return [made(h) for h in 10.0 ** -np.arange(2.0, 5.1, 0.5)]


def errors(kind: str) -> tuple[np.ndarray, np.ndarray]:
    """Return the mean steps (s) and the errors, the larger of those in x (m) and x' (m/s)."""
    x, xdot, _ = end_of(zivi.SwitchedRK())
    found = [end_of(method) for method in family(kind)]
    steps = np.array([it[2] for it in found])
    return steps, np.array([max(abs(it[0] - x), abs(it[1] - xdot)) for it in found])


KINDS = {"SwitchedRK, order 8": 8, "SwitchedRK, order 5": 5, "ThetaGamma": 1, "MoreauJean": 1}
"""Methods and the orders that theory gives."""


def main(path: str | None) -> None:
    """Print the orders beside what is expected, and draw if a path is given."""
    for kind, order in KINDS.items():
        steps, wrong = errors(kind)
        fine = slice(3 if order > 1 else 0, None)  # the largest steps are not asymptotic
        slope = np.polyfit(np.log(steps[fine]), np.log(wrong[fine]), 1)[0]
        print(f"{kind:20}: order {slope:.1f} ({order})")
    if path is not None:
        draw(path)


def draw(path: str) -> None:
    """Draw the errors over the steps."""
    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt

    plt.style.use("zivi.plot.figures")
    figure, ax = plt.subplots(layout="constrained", figsize=(7.2, 4.2))
    for (kind, order), marker in zip(KINDS.items(), "osv^", strict=True):
        ax.loglog(*errors(kind), marker, ls="-", ms=4, label=f"{kind} ({order})")
    ax.set(xlabel="mean step (s)", ylabel="error at 1.5 s, in m and m/s")
    ax.set_title("A shaken ball with drag after one impact; order of theory in brackets")
    ax.legend(loc="upper left", bbox_to_anchor=(1, 1))
    figure.savefig(path, dpi=150)


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else None)
