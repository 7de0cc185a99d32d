"""Two mechanical systems with Siconos, run by the interpreter that has it; prints JSON.

Usage: python3 siconos_mechanics.py PROBLEM STEP

Moreau and Jean's time stepping with theta = 1/2, Newton's impact law, and its solver of linear
complementarity problems, as in its own examples. Needs nothing of zivi.
"""

import json
import sys
import time

import numpy as np
import siconos.kernel as sk

from mechanics_problems import PROBLEMS, TRUTH


def run(given, end, step):
    """Simulate to an end; gives the state and the seconds."""
    q, v = (np.array(part) for part in given["start"])
    mass, damping = (np.array(given[name]) for name in ("mass", "damping"))
    system = sk.LagrangianLinearTIDS(q, v, mass, np.zeros_like(mass), damping)
    system.setFExtPtr(np.array(given["force"]))
    model = sk.NonSmoothDynamicalSystem(0.0, end)
    model.insertDynamicalSystem(system)
    for normal, offset, e in zip(given["normals"], given["offsets"], given["e"]):  # noqa: B905
        relation = sk.LagrangianLinearTIR(np.array([normal]), np.array([offset]))
        model.link(sk.Interaction(sk.NewtonImpactNSL(e), relation), system)
    simulation = sk.TimeStepping(model, sk.TimeDiscretisation(0.0, step))
    simulation.insertIntegrator(sk.MoreauJeanOSI(0.5))
    simulation.insertNonSmoothProblem(sk.LCP())
    steps = round(end / step)
    begun = time.process_time()
    for _ in range(steps):
        simulation.computeOneStep()
        simulation.nextStep()
    took = time.process_time() - begun
    return [*system.q(), *system.velocity()], took, steps


def main():
    """Run one problem to each of its times."""
    name, step = sys.argv[1], float(sys.argv[2])
    rows = []
    for end, exact in TRUTH[name].items():
        state, took, steps = run(PROBLEMS[name], end, step)
        error = float(np.abs(np.array(state) - exact).max())
        rows.append({"end": end, "error": error, "seconds": took, "steps": steps})
    print("FIGURES " + json.dumps(rows))


if __name__ == "__main__":
    main()
