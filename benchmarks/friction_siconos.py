"""Systems with dry friction in Siconos, run by the interpreter that has it; prints JSON.

Usage: python3 friction_siconos.py PROBLEM STEP

Moreau and Jean's time stepping with theta = 1/2, Newton's impact law with Coulomb friction, its
solver of planar frictional contact, as in its own examples. Needs nothing of zivi.
"""

import json
import sys
import time

import numpy as np
import siconos.kernel as sk

from friction_numbers import PROBLEMS


def run(given, step):
    """Simulate to the end; gives the state, the seconds and the steps."""
    q, v = (np.array(part) for part in given["start"])
    mass, stiffness = (np.array(given[name]) for name in ("mass", "stiffness"))
    system = sk.LagrangianLinearTIDS(q, v, mass, stiffness, np.zeros_like(mass))
    system.setFExtPtr(np.array(given["force"]))
    model = sk.NonSmoothDynamicalSystem(0.0, given["end"])
    model.insertDynamicalSystem(system)
    names = ("normals", "tangents", "offsets", "e", "mu")
    for normal, tangent, offset, e, mu in zip(*(given[name] for name in names)):  # noqa: B905
        relation = sk.LagrangianLinearTIR(np.array([normal, tangent]), np.array([offset, 0.0]))
        law = sk.NewtonImpactFrictionNSL(e, 0.0, mu, 2)
        model.link(sk.Interaction(law, relation), system)
    took, steps = stepped(model, 2, step, given["end"])
    return [*system.q(), *system.velocity()], took, steps


def stepped(model, size, step, end):
    """Run a model with as many rows of a contact as `size`; gives the seconds and the steps."""
    simulation = sk.TimeStepping(model, sk.TimeDiscretisation(0.0, step))
    simulation.insertIntegrator(sk.MoreauJeanOSI(0.5))
    problem = sk.FrictionContact(size)
    problem.numericsSolverOptions().dparam[0] = 1e-12
    simulation.insertNonSmoothProblem(problem)
    steps = round(end / step)
    begun = time.process_time()
    for _ in range(steps):
        simulation.computeOneStep()
        simulation.nextStep()
    return time.process_time() - begun, steps


def main():
    """Run one problem with one step."""
    given = PROBLEMS[sys.argv[1]]
    state, took, steps = run(given, float(sys.argv[2]))
    errors = np.abs(np.array(state) - given["truth"])
    print("FIGURES " + json.dumps({"error": errors.max(), "seconds": took, "work": steps}))


if __name__ == "__main__":
    main()
