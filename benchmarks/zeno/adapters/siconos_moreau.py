"""Siconos: Moreau and Jean's time stepping, theta = 1/2 (https://github.com/siconos/siconos).

For constant mass matrices, forces that are linear in position and velocity, gaps that are linear
and do not move, Coulomb's friction at them. The part of the force that depends on time is that of
the middle of a step.
"""

import random

from ..problem import Motion

NAME = "Siconos, Moreau-Jean"
LEVELS = (1e-2, 1e-3, 1e-4)


def missing():
    """Say what is missing."""
    try:
        import siconos.kernel  # noqa: F401
    except ImportError as error:
        return str(error)
    return None


def same(f, problem, places):
    """Whether a function has one value everywhere."""
    values = [f(*place) for place in places]
    return all(str(value) == str(values[0]) for value in values)


def places(problem):
    """Draw times and states."""
    rng = random.Random(1)
    draw = lambda: [rng.uniform(-1, 1) for _ in range(problem.n)]  # noqa: E731
    return [(rng.uniform(0, 3), draw(), draw()) for _ in range(4)]


def linear(problem):
    """Give K, C with force = f(t) - K q - C v, or None."""
    count, zero = range(problem.n), [0.0] * problem.n
    unit = [[float(i == j) for j in count] for i in count]
    at_rest = problem.force(0.3, zero, zero)
    by_q = [[x - at_rest[i] for i, x in enumerate(problem.force(0.3, u, zero))] for u in unit]
    by_v = [[x - at_rest[i] for i, x in enumerate(problem.force(0.3, zero, u))] for u in unit]
    for t, q, v in places(problem):
        load, value = problem.force(t, zero, zero), problem.force(t, q, v)
        for i in count:
            guess = load[i] + sum(by_q[j][i] * q[j] + by_v[j][i] * v[j] for j in count)
            if abs(guess - value[i]) > 1e-9 * (1 + abs(value[i])):
                return None
    return tuple([[-rows[j][i] for j in count] for i in count] for rows in (by_q, by_v))


def refuses(problem):
    """Take what is linear but for its gaps and friction."""
    if problem.is_orbit:
        return "no orbits"
    if problem.joints:
        return "no friction without a gap in this adapter"
    at = places(problem)
    if not same(problem.mass, problem, at):
        return "the mass matrix varies"
    if not same(problem.part("gradient"), problem, at):
        return "the gaps are curved"
    if any(abs(x) > 0 for place in at for x in problem.part("rate")(*place)):
        return "the walls move"
    return None if linear(problem) else "the force is not linear in the state"


def run(problem, level):
    """Step through the motion."""
    import numpy as np
    import siconos.kernel as sk

    zero = [0.0] * problem.n
    k, c = (np.array(part) for part in linear(problem))
    mass = np.array(problem.mass(0.0, zero, zero))
    load = np.array(problem.force(problem.t0 + level / 2, zero, zero))
    body = sk.LagrangianLinearTIDS(np.array(problem.q0), np.array(problem.v0), mass, k, c)
    body.setFExtPtr(load)
    model = sk.NonSmoothDynamicalSystem(problem.t0, problem.end + 1)
    model.insertDynamicalSystem(body)
    rubs = any("mu" in gap for gap in problem.gaps)
    gradient = problem.part("gradient")(0.0, zero, zero)
    value = problem.part("value")(0.0, zero, zero)
    for i, gap in enumerate(problem.gaps):
        rows, offset = [gradient[i]], [value[i]]
        law = sk.NewtonImpactNSL(problem.e[i])
        if rubs:
            rows.append([problem.number(x) for x in gap["tangent"]])
            offset.append(0.0)
            law = sk.NewtonImpactFrictionNSL(problem.e[i], 0.0, problem.number(gap["mu"]), 2)
        relation = sk.LagrangianLinearTIR(np.array(rows), np.array(offset))
        model.link(sk.Interaction(law, relation), body)
    stepping = sk.TimeStepping(model, sk.TimeDiscretisation(problem.t0, level))
    stepping.insertIntegrator(sk.MoreauJeanOSI(0.5))
    stepping.insertNonSmoothProblem(sk.FrictionContact(2) if rubs else sk.LCP())
    problem.calls, states, done = 0, [], 0
    for t in problem.times:
        for i in range(done, round((t - problem.t0) / level)):
            load = np.array(problem.force(problem.t0 + (i + 0.5) * level, zero, zero))
            body.setFExtPtr(load)
            stepping.computeOneStep()
            stepping.nextStep()
        done = max(done, round((t - problem.t0) / level))
        states.append((body.q().tolist(), body.velocity().tolist()))
    return Motion(states, None, problem.calls, done)
