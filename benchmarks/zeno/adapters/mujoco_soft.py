"""MuJoCo: contacts as stiff springs with the damper that gives e (https://mujoco.org).

Every coordinate is a body on a slide, every gap the limit of a fixed tendon: for constant diagonal
mass matrices and linear gaps that do not move. Level: the step h; a contact lasts
``0.95 sqrt(h)``, 30 to 200 steps, so its damper is resolved better as it becomes shorter.
"""

import math

from ..problem import Motion
from .siconos_moreau import places, same

NAME = "MuJoCo, soft contacts"
LEVELS = (1e-3, 1e-4, 2e-5)

MODEL = """<mujoco><option timestep="{h}" gravity="0 0 0" integrator="Euler" jacobian="dense">
<flag eulerdamp="disable"/></option><compiler inertiafromgeom="false" autolimits="false"/>
<worldbody>{bodies}</worldbody><tendon>{tendons}</tendon></mujoco>"""
BODY = """<body><inertial pos="0 0 0" mass="{m}" diaginertia="1 1 1"/>
<joint name="j{i}" type="slide" axis="1 0 0" frictionloss="0"/></body>"""
TENDON = """<fixed limited="true" range="{low} 1e6" solreflimit="-{k} -{b}"
solimplimit="0.9999 0.9999 0.001 0.5 2">{joints}</fixed>"""


def missing():
    """Say what is missing."""
    try:
        import mujoco  # noqa: F401
    except ImportError as error:
        return str(error)
    return None


def refuses(problem):
    """Take diagonal masses and linear gaps at rest, without friction."""
    if problem.is_orbit:
        return "no orbits"
    if problem.joints or any("mu" in gap for gap in problem.gaps):
        return "no friction in this adapter"
    at = places(problem)
    mass = problem.mass(*at[0])
    if not same(problem.mass, problem, at) or any(
        mass[i][j] != 0 for i in range(problem.n) for j in range(problem.n) if i != j
    ):
        return "the mass matrix varies or couples"
    if not same(problem.part("gradient"), problem, at):
        return "the gaps are curved"
    if any(abs(x) > 0 for place in at for x in problem.part("rate")(*place)):
        return "the walls move"
    return None


def damping_ratio(e):
    """Solve e = exp(-2 z acos(z)/sqrt(1 - z^2)) for z.

    A spring with a damper that cannot pull ends where its force vanishes, before it is slack.
    """

    def left(z):
        root = math.sqrt(abs(1 - z * z))
        turn = math.acos(z) if z < 1 else math.acosh(z)
        return math.exp(-2 * z * (turn / root if root else 1.0))

    low, high = 0.0, 100.0
    for _ in range(80):
        middle = (low + high) / 2
        low, high = (middle, high) if left(middle) > e else (low, middle)
    return low


def model(problem, h):
    """Write the model."""
    zero = [0.0] * problem.n
    mass = problem.mass(0.0, zero, zero)
    value, rows = (problem.part(key)(0.0, zero, zero) for key in ("value", "gradient"))
    k = (math.pi / (0.95 * math.sqrt(h))) ** 2
    bodies = "".join(BODY.format(m=mass[i][i], i=i) for i in range(problem.n))
    tendons = ""
    for e, offset, row in zip(problem.e, value, rows, strict=True):
        ratio = damping_ratio(e)
        joints = "".join(f'<joint joint="j{i}" coef="{x!r}"/>' for i, x in enumerate(row) if x != 0)
        b = 2 * ratio * math.sqrt(k)
        tendons += TENDON.format(low=-offset, k=k, b=b, joints=joints)
    return MODEL.format(h=h, bodies=bodies, tendons=tendons)


def run(problem, level):
    """Step through the motion."""
    import mujoco

    compiled = mujoco.MjModel.from_xml_string(model(problem, level))
    data = mujoco.MjData(compiled)
    data.qpos[:], data.qvel[:] = problem.q0, problem.v0
    problem.calls, states, done = 0, [], 0
    for t in problem.times:
        for i in range(done, round((t - problem.t0) / level)):
            now = problem.t0 + i * level
            data.qfrc_applied[:] = problem.force(now, data.qpos.tolist(), data.qvel.tolist())
            mujoco.mj_step(compiled, data)
        done = max(done, round((t - problem.t0) / level))
        states.append((data.qpos.tolist(), data.qvel.tolist()))
    return Motion(states, None, problem.calls, done)
