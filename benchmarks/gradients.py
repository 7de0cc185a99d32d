"""Error of a gradient over its work: sensitivities, differences, autodiff through events.

Two problems with derivatives of high precision (``tests/data/orbit_references.json``): the Zeno
time of a nonlinear spring by six parameters (S6), and the end state of a sticking oscillator,
behind two Zeno points and two lift-offs, by six (S5). Work is the number of evaluations of the
force and of its Jacobian (each of these counts as one), which is the same on every machine.

    python benchmarks/gradients.py [--peer]

``--peer`` adds reverse-mode autodiff of diffrax through its event, restarted by hand after each of
six impacts of a ball, if diffrax can be imported: there the derivative is known in closed form.
"""

from __future__ import annotations

import math
import sys
from pathlib import Path

import numpy as np

import zivi

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

import orbit_data

TOLERANCES = (1e-4, 1e-6, 1e-8, 1e-10, 1e-12)
STEPS = (1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 1e-7)


class Problem:
    """A reference, and the quantity of it that is differentiated."""

    def __init__(self, name: str, label: str) -> None:
        self.it = orbit_data.references()[name]
        self.name, self.label = name, label
        self.rows = [i for i, it in enumerate(self.it["labels"]) if it == label]
        self.columns = list(self.it["d"])
        self.exact = np.array([float(self.it["d"][q][self.rows[-1]]) for q in self.columns])
        self.span = float(self.it["t0"]), float(self.it["t_end"])
        self.start = {"x0": float(self.it["x0"]), "v0": float(self.it["v0"])}

    def run(self, tol: float, **moved: float) -> tuple[float, int]:
        """Give the quantity of a plain run, and its evaluations."""
        start = {k: moved.pop(k, v) for k, v in self.start.items()}
        system, _ = orbit_data.system_of(self.it["parameters"], **moved)
        y0 = (start["x0"], start["v0"])
        # as the sensitivities
        method = zivi.SwitchedRK(tol, tol, flights="rk")
        sol = zivi.simulate(system, self.span, y0, method, dense_output=False)
        value = sol.zeno_times[-1] if self.label == "zeno" else sol.xdot[-1]
        return float(value), sol.nfev

    def sensitivity(self, tol: float) -> tuple[np.ndarray, int]:
        """Give the gradient by `zivi.sensitivity`, and its evaluations."""
        system, names = orbit_data.system_of(self.it["parameters"])
        s = zivi.sensitivity(
            system,
            self.span,
            tuple(self.start.values()),
            [names[q] for q in self.columns],
            zivi.SwitchedRK(tol, tol),
            dense_output=False,
        )
        row = s.zeno_times[-1] if self.label == "zeno" else s.final[1]
        return row, s.trajectory.nfev + s.n_slopes

    def differences(self, h: float, tol: float) -> tuple[np.ndarray, int]:
        """Give the gradient by central differences, and its evaluations."""
        rows, work = [], 0
        for q in self.columns:
            given = self.start | {k: orbit_data.number(v) for k, v in self.it["parameters"].items()}
            ends = [self.run(tol, **{q: given[q] + side * h}) for side in (1, -1)]
            rows.append((ends[0][0] - ends[1][0]) / (2 * h))
            work += ends[0][1] + ends[1][1]
        return np.array(rows), work

    def error(self, gradient: np.ndarray) -> float:
        """Give the largest relative error of an entry."""
        size = np.where(self.exact == 0.0, 1.0, np.abs(self.exact))
        return float(np.max(np.abs(gradient - self.exact) / size))


def truncated(u: float, e: float = 0.9) -> tuple[float, int]:
    """Error of the derivative of a ball's Zeno time by e that stops at the speed u, and impacts."""
    speed, k = math.sqrt(2 * 9.81), 0
    first = speed / 9.81
    total, by_e = first, 0.0
    while speed * e ** (k + 1) > u:
        k += 1
        total += 2 * first * e**k
        by_e += 2 * first * k * e ** (k - 1)
    exact = 2 * first / (1 - e) ** 2
    return abs(by_e / exact - 1), k


def peer() -> None:
    """Print what diffrax gives for the times of the impacts of a ball."""
    import diffrax
    import equinox
    import jax
    import jax.numpy as jnp
    import optimistix

    jax.config.update("jax_enable_x64", True)

    def flight(t0, y, tol):
        root = optimistix.Newton(rtol=tol, atol=tol)
        event = diffrax.Event(lambda t, y, args, **_: y[0], root, direction=False)
        sol = diffrax.diffeqsolve(
            diffrax.ODETerm(lambda t, y, args: jnp.stack([y[1], -9.81 - 0.3 * y[1]])),
            diffrax.Dopri8(),
            t0,
            t0 + 10.0,
            None,
            y,
            stepsize_controller=diffrax.PIDController(rtol=tol, atol=tol),
            event=event,
            max_steps=512,
        )
        return sol.ts[-1], sol.ys[-1]

    @equinox.filter_jit
    def last_impact(p, tol):
        t, y = jnp.asarray(0.0), jnp.stack([p[0], 0.0 * p[0]])
        for _ in range(6):
            t, y = flight(t, y, tol)
            y = jnp.stack([1e-14, -p[1] * y[1]])
        return t

    drag = zivi.ImpactSystem(zivi.LinearForce(gravity=9.81, damping=0.3), e=0.8)
    s = zivi.sensitivity(drag, (0, 9), (1, 0), ("x0", "e"), zivi.SwitchedRK(1e-13, 1e-14))
    exact = s.impacts["dt"][5]
    print("time of the sixth impact of a ball with drag, derivatives by height and e:", exact)
    for tol in (1e-6, 1e-10):
        p = jnp.array([1.0, 0.8])
        value = float(last_impact(p, tol))
        gradient = np.asarray(jax.grad(lambda p, tol=tol: last_impact(p, tol))(p))
        own = zivi.sensitivity(drag, (0, 9), (1, 0), ("x0", "e"), zivi.SwitchedRK(tol, tol))
        ours = np.max(np.abs(own.impacts["dt"][5] / exact - 1))
        off = abs(value - s.impacts["t"][5])
        print(
            f"  tol {tol:g}: diffrax value off {off:.1e}, gradient off "
            f"{np.max(np.abs(gradient / exact - 1)):.1e}; zivi gradient off {ours:.1e}"
        )


def main() -> None:
    """Print the tables."""
    for problem in (Problem("S6_cubic", "zeno"), Problem("S5_osc_stick", "v(T)")):
        print(f"{problem.name}, derivatives of {problem.label} by {', '.join(problem.columns)}")
        _, plain = problem.run(1e-10)
        for tol in TOLERANCES:
            gradient, work = problem.sensitivity(tol)
            told = f"error {problem.error(gradient):.1e}, {work} evaluations"
            print(f"  sensitivity tol {tol:g}: {told} ({work / plain:.1f} plain runs at 1e-10)")
        for h in STEPS:
            gradient, work = problem.differences(h, 1e-11)
            told = f"error {problem.error(gradient):.1e}, {work} evaluations"
            print(f"  differences h {h:g}: {told} ({work / plain:.1f} plain runs at 1e-10)")
    print("a ball, e = 0.9: derivative of the Zeno time by e, where a run stops at a speed")
    for u in (1e-2, 1e-3, 1e-5, 1e-7):
        error, impacts = truncated(u)
        print(f"  {u:g} m/s: error {error:.1e} after {impacts} impacts")
    ball = zivi.ImpactSystem(-9.81, e=0.9)
    s = zivi.sensitivity(ball, (0, 30), (1, 0), ("e",), zivi.SwitchedRK(1e-11, 1e-11))
    exact = 2 * math.sqrt(2 / 9.81) / (1 - 0.9) ** 2
    print(f"  zivi: error {abs(s.zeno_times[0, 0] / exact - 1):.1e} after {len(s.impacts)} impacts")
    if "--peer" in sys.argv:
        peer()


if __name__ == "__main__":
    main()
