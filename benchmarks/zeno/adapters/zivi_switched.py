"""zivi: `SwitchedRK`, which jumps through accumulations."""

from ..problem import Motion

NAME = "zivi SwitchedRK"
LEVELS = (1e-5, 1e-8, 1e-12)


def missing():
    """Say what is missing."""
    try:
        import zivi  # noqa: F401
    except ImportError as error:
        return str(error)
    return None


def refuses(problem):
    """Take everything."""
    return None


def system(problem):
    """Write the problem as a system of the library."""
    import zivi

    still = problem.v0

    def of_q(formula):
        f = problem.compile(formula)
        return lambda t, q: f(t, q, still)

    gaps = []
    for gap in problem.gaps:
        rubs = {}
        if "mu" in gap:
            rubs = {
                "tangent": of_q(gap["tangent"]),
                "tangent_velocity": of_q(gap["tangent_rate"]),
                "tangent_curvature": problem.compile(gap["tangent_curvature"]),
                "mu": problem.number(gap["mu"]),
            }
        gaps.append(
            zivi.Gap(
                of_q(gap["value"]),
                of_q(gap["gradient"]),
                problem.compile(gap["curvature"]),
                of_q(gap["rate"]),
                **rubs,
            )
        )
    joints = [
        zivi.DryFriction(
            [problem.number(x) for x in joint["direction"]],
            limit=problem.compile(joint["limit"]),
            static=problem.number(joint["static"]),
            velocity=-problem.number(joint["rate"]),
        )
        for joint in problem.joints
    ]
    mass = problem.compile(problem.given["mass"])
    return zivi.MechanicalSystem(
        mass=lambda t, q: mass(t, q, still),
        force=problem.force,
        gaps=gaps,
        e=problem.e or 0.0,
        friction=joints,
    )


def orbit(problem, tol):
    """Find the orbit near the start."""
    import zivi

    period, start = float(problem.truth["orbit"]["period"]), problem.t0
    mass = zivi.ImpactSystem(lambda t, x, v: problem.force(t, [x], [v])[0], e=problem.e[0])
    guess = zivi.simulate(mass, (start, start + 60 * period), (0, problem.v0[0]))
    method = zivi.SwitchedRK(rtol=tol, atol=tol)
    found = zivi.periodic_orbit(mass, guess, period=period, method=method)
    early = 0.1  # of the first impact before the start, which is a guess
    times = start - early + (found.impacts["t"] - start + early) % period
    order = times.argsort()
    return [*times[order].tolist(), *found.impacts["xdot_after"][order].tolist()]


def run(problem, level):
    """Follow the motion with this tolerance."""
    import zivi

    problem.calls = 0
    if problem.is_orbit:
        return Motion([], [], problem.calls, 0, orbit(problem, level))
    method = zivi.SwitchedRK(rtol=level, atol=level / 10)
    sol = zivi.simulate(
        system(problem), (problem.t0, problem.end), (problem.q0, problem.v0), method
    )
    states = []
    for t in problem.times:
        q, v = sol(t)
        states.append((q.tolist(), v.tolist()) if t <= sol.t[-1] else None)
    return Motion(states, [float(t) for t in sol.zeno["t"]], problem.calls, sol.n_steps)
