"""The paper's ball with Siconos, run by the interpreter that has it; prints JSON.

Usage: python3 siconos_ball.py vi|relay STEPS

``vi``: its box-VI solver (VI_BOX_AVI_LSA) with F and its Jacobian as Python functions, warm
start. ``relay``: its kernel, EulerMoreau and Relay with the relation written in Python, the way
of its own example of this ball. Needs nothing of zivi.
"""

# ruff: noqa: N802 (the names of the methods are those of Siconos)

import json
import sys
import time

import numpy as np

KAPPA, GRAVITY, H = 0.41, 9.81, 1e-3
S0, V0 = 1.0, 6.0 / (1.0 - KAPPA)


def vi(steps):
    """Solve the box VI of every step; returns (seconds, failures, states)."""
    import siconos.numerics as sn

    state = [S0, V0]

    def compute(n, signs, F):
        ls, lv = signs[0], signs[1]
        r = 1.0 - KAPPA * ls * lv
        v = state[1] - H * ls * GRAVITY / r
        F[0] = -(state[0] + H * r * v)
        F[1] = -v

    def jacobian(n, signs, J):
        ls, lv = signs[0], signs[1]
        r = 1.0 - KAPPA * ls * lv
        gain = H * GRAVITY / (r * r)
        J[0, 0] = H * (KAPPA * lv * state[1] + H * GRAVITY)
        J[0, 1] = H * KAPPA * ls * state[1]
        J[1, 0] = gain
        J[1, 1] = gain * KAPPA * ls * ls

    problem = sn.VI(2, compute)
    problem.set_compute_nabla_F(jacobian)
    # named, because the problem keeps bare pointers to them
    lower, upper = np.array([-1.0, -1.0]), np.array([1.0, 1.0])
    problem.set_box_constraints(lower, upper)
    options = sn.SolverOptions(sn.SICONOS_VI_BOX_AVI_LSA)
    options.dparam[0] = 1e-12
    # the smallest step of the line search: by default 0, and then the search may never end
    options.dparam[2] = 1e-16
    signs, F = np.zeros(2), np.zeros(2)
    states = np.empty((steps + 1, 2))
    states[0] = state
    failures = 0
    start = time.perf_counter()
    for k in range(steps):
        # not the general driver: it calls a projection that a box from Python does not have
        failures += sn.vi_box_AVI_LSA(problem, signs, F, options) != 0
        compute(2, signs, F)
        state = [-F[0], -F[1]]
        states[k + 1] = state
    return time.perf_counter() - start, failures, states


def relay(steps):
    """Simulate with the kernel; returns (seconds, failures, states)."""
    import siconos.kernel as sk

    class Relation(sk.FirstOrderNonLinearR):
        """s' = v + g_s, v' = g_v; Siconos' multiplier of y is -sgn(y)."""

        def computeh(self, t, x, ls, z, y):
            y[:] = x

        def computeg(self, t, x, signs, z, g):
            ls, lv = signs[0], signs[1]
            r = 1.0 - KAPPA * ls * lv
            g[0] = -KAPPA * ls * lv * x[1]
            g[1] = GRAVITY * ls / r

        def computeJachx(self, t, x, signs, z, C):
            C[:] = np.eye(2)

        def computeJacglambda(self, t, x, signs, z, B):
            ls, lv = signs[0], signs[1]
            r = 1.0 - KAPPA * ls * lv
            B[0, 0] = -KAPPA * lv * x[1]
            B[0, 1] = -KAPPA * ls * x[1]
            B[1, 0] = GRAVITY / r**2
            B[1, 1] = GRAVITY * KAPPA * ls**2 / r**2

        def computeJacgx(self, t, x, signs, z, K):
            K[:] = 0.0
            K[0, 1] = -KAPPA * signs[0] * signs[1]

        def computeJachlambda(self, t, x, signs, z, D):
            D[:] = 0.0

    process = sk.FirstOrderLinearDS(np.array([S0, V0]), np.array([[0.0, 1.0], [0.0, 0.0]]))
    relation = Relation()
    relation.setCPtr(np.eye(2))
    interaction = sk.Interaction(sk.RelayNSL(2), relation)
    model = sk.NonSmoothDynamicalSystem(0.0, steps * H)
    model.insertDynamicalSystem(process)
    model.link(interaction, process)
    simulation = sk.TimeStepping(model, sk.TimeDiscretisation(0.0, H))
    simulation.insertIntegrator(sk.EulerMoreauOSI(1.0))
    simulation.insertNonSmoothProblem(sk.Relay())
    simulation.setComputeResiduY(True)
    simulation.setComputeResiduR(True)
    simulation.setNewtonMaxIteration(40)
    simulation.setNewtonTolerance(1e-12)
    states = np.empty((steps + 1, 2))
    states[0] = process.x()
    k, failures = 0, 0
    start = time.perf_counter()
    while simulation.hasNextEvent() and k < steps:
        simulation.advanceToEvent()
        k += 1
        states[k] = process.x()
        simulation.nextStep()
    return time.perf_counter() - start, failures, states[: k + 1]


def main():
    """Run one route and print its figures."""
    route, steps = {"vi": vi, "relay": relay}[sys.argv[1]], int(sys.argv[2])
    took, failures, states = route(steps)
    # the first step from which nothing moves any more, to within the solver's tolerance
    moving = np.flatnonzero(np.abs(states).max(axis=1) > 1e-9)
    rest = int(moving[-1]) + 1
    print(
        "FIGURES "
        + json.dumps(
            {
                "ns_per_step": took / (len(states) - 1) * 1e9,
                "failures": int(failures),
                "rest_time": rest * H if rest < len(states) else None,
                "s": states[:, 0].tolist(),
            }
        )
    )


if __name__ == "__main__":
    main()
