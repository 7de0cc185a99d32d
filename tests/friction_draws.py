"""Random systems with dry friction and impacts, and what to compare their runs with.

The numbers of a family are those that ``benchmarks/friction_oracle`` reads, in its order.
"""

import dataclasses
import math

import numpy as np

import zivi
from test_friction_references import told

G = 9.81


@dataclasses.dataclass
class Draw:
    """The numbers of a motion: of its family, its end and its start."""

    family: str
    numbers: list
    end: float
    q: list
    v: list

    def line(self):
        words = [self.family, len(self.numbers), *self.numbers, self.end, *self.q, *self.v]
        return " ".join(map(str, words))

    @classmethod
    def read(cls, line):
        family, count, *rest = line.split()
        rest, count = [float(it) for it in rest], int(count)
        half = (len(rest) - count - 1) // 2
        start = rest[count + 1 :]
        return cls(family, rest[:count], rest[count], start[:half], start[half:])


def draw(family, rng):
    """Draw a motion of a family."""
    return Draw(family, *DRAWS[family](rng.uniform, rng.random))


def static(u, mu):
    """Give a static coefficient: that of slip, or more."""
    return mu * max(1.0, u(0.6, 1.6))


def some(chance, r, u, *between):
    return u(*between) if r() < chance else 0.0


def draw_feeder(u, r):
    mu = u(0.1, 0.7)
    numbers = [u(-0.2, 0.35), mu, some(0.9, r, u, 0, 0.75), u(0.01, 0.12), u(5, 15), u(0.2, 1.3)]
    return (
        [*numbers, static(u, mu), some(0.4, r, u, 0, 2)],
        2.0,
        [0.0, u(0, 0.2)],
        [u(-1, 1), u(-1, 1)],
    )


def draw_disc(u, r):
    mu, shakes = u(0.05, 0.8), r() < 0.5
    wave = [u(0.01, 0.08), u(5, 14)] if shakes else [0.0, 0.0]
    numbers = [
        mu,
        u(0, 0.8),
        some(0.5, r, u, 0, 0.6),
        u(0.05, 0.2),
        *wave,
        u(-0.3, 0.3),
        static(u, mu),
    ]
    start = [0.0, numbers[3] + u(0.02, 0.5), 0.0], [u(-2, 2), u(-1, 1), u(-30, 30)]
    return numbers, 2.0, *start


def draw_rod2(u, r):
    mu, shakes = u(0.05, 0.9), r() < 0.5
    wave = [u(0.005, 0.05), u(5, 14)] if shakes else [0.0, 0.0]
    angle = u(-0.6, 0.6)
    start = [0.0, math.sin(abs(angle)) + u(0.01, 0.3), angle], [u(-1, 1), u(-0.5, 0.5), u(-1, 1)]
    return [mu, some(0.8, r, u, 0, 0.6), 0.0, *wave, static(u, mu)], 1.5, *start


def draw_belt2(u, r):
    limits = [u(0.3, 1), u(0.3, 1)]
    springs = [u(0.5, 2), u(0.5, 2), u(0.2, 2)]
    more = [static(u, limits[0]), static(u, limits[1]), some(0.7, r, u, 0, 3)]
    start = [u(-1, 1), u(-1, 1)], [u(-1, 1), u(-1, 1)]
    return [*springs, u(0.05, 0.8), *limits, *more], 10.0, *start


def draw_beltstop(u, r):
    limit = u(0.2, 1)
    numbers = [
        u(0.3, 2),
        u(0.1, 0.9),
        limit,
        static(u, limit),
        u(0.2, 1),
        u(0, 0.9),
        u(0, 1.5),
        u(0.5, 3),
    ]
    return numbers, 10.0, [u(-1, 0.1)], [u(-1, 1)]


def draw_rock(u, r):
    b, h, mu, angle = u(0.3, 0.7), u(0.8, 1.6), u(0.1, 0.7), u(-0.2, 0.2)
    numbers = [
        b,
        h,
        mu,
        some(0.6, r, u, 0.05, 0.5),
        0.0,
        some(0.8, r, u, 0.02, 0.3),
        u(3, 7),
        static(u, mu),
    ]
    height = b * math.sin(abs(angle)) + h * math.cos(angle) + u(0.001, 0.05)
    return numbers, 2.0, [0.0, height, angle], [u(-0.5, 0.5), u(-0.2, 0.2), u(-0.5, 0.5)]


def draw_corner(u, r):
    radius = u(0.1, 0.3)
    restitution = [some(0.8, r, u, 0, 0.7), some(0.8, r, u, 0, 0.7)]
    push = [u(-8, 1), some(0.6, r, u, 0, 6), u(2, 9), u(-0.6, 0.6), some(0.5, r, u, 0, 1)]
    start = [radius + u(0.01, 0.5), radius + u(0.01, 0.5), 0.0], [u(-1, 1), u(-1, 1), u(-20, 20)]
    return [u(0.05, 0.8), u(0.05, 0.8), *restitution, radius, *push], 2.0, *start


def draw_servo(u, r):
    limit = u(0.2, 2)
    drive = [u(20, 80), u(0, 1), u(10, 60), u(0.5, 4), u(0.2, 0.8), u(1, 5)]
    numbers = [*drive, limit, static(u, limit), u(0.05, 0.5), some(0.8, r, u, 0, 0.8), u(0.3, 2)]
    return numbers, 3.0, [u(-0.3, 0), u(-0.3, 0)], [u(-1, 1), u(-1, 1)]


def draw_guide(u, r):
    limit = u(0.1, 4)
    shakes = r() < 0.5
    numbers = [some(0.7, r, u, 0.05, 0.5), limit, static(u, limit), u(0, 0.85)]
    numbers += [u(1, 12), u(2, 9)] if shakes else [0.0, 0.0]
    return [*numbers, 0.0], 3.0, [u(0.1, 1), u(-0.5, 0.5)], [u(-1, 1), u(-1, 1)]


def draw_stack(u, r):
    mus, shakes = [u(0.05, 0.8), u(0.05, 0.8)], r() < 0.6
    restitution = [some(0.8, r, u, 0, 0.6), some(0.8, r, u, 0, 0.6)]
    wave = [u(0.005, 0.06), u(5, 14), u(0, 0.1), u(3, 12)] if shakes else [0.0] * 4
    height = 0.2
    numbers = [
        u(0.3, 2),
        *mus,
        *restitution,
        *wave,
        static(u, mus[0]),
        static(u, mus[1]),
        height,
        u(0.5, 4),
    ]
    low = u(0.005, 0.2)
    start = (
        [0.0, low, 0.0, low + height + u(0.005, 0.2)],
        [u(-2, 2), u(-0.5, 0.5), u(-2, 2), u(-0.5, 0.5)],
    )
    return numbers, 1.5, *start


def draw_arm(u, r):
    mu, limit, depth = u(0.05, 0.5), u(0.1, 3), u(1.0, 1.7)
    turns = [u(2, 20), u(1, 8)] if r() < 0.6 else [0.0, 0.0]
    numbers = [
        u(0.3, 1.5),
        mu,
        some(0.8, r, u, 0, 0.7),
        static(u, mu),
        limit,
        static(u, limit),
        u(0, 4),
        *turns,
        depth,
    ]
    first = u(-1.2, 1.2)
    reach = (depth - math.cos(first)) - 0.02
    bound = math.acos(min(max(reach, -0.9), 0.999))
    second = (bound + u(0.05, 0.8)) * (1 if r() < 0.5 else -1)
    return numbers, 2.0, [first, second], [u(-1, 1), u(-1, 1)]


def sine(amplitude, omega):
    return zivi.HarmonicWall(amplitude, omega, -math.pi / 2) if amplitude else None


def joint(limit, most, direction=1.0, **more):
    return zivi.DryFriction(direction, limit=limit, static=most, **more)


def feeder(a):
    slope, mu, e, amplitude, omega, beta, mu_static, fall = a
    push = [G * math.sin(slope), -G * math.cos(slope)]
    surface = zivi.LinearGap(
        [0, 1],
        motion=sine(amplitude * math.sin(beta), omega),
        tangent=[1, 0],
        mu=(lambda w: mu / (1 + fall * w)) if fall else mu,
        mu_static=mu_static,
        belt=sine(amplitude * math.cos(beta), omega),
    )
    return zivi.MechanicalSystem(mass=np.eye(2), force=push, gaps=[surface], e=e)


def disc(a):
    mu, e, e_t, radius, amplitude, omega, slope, mu_static = a
    plane = zivi.LinearGap(
        [0, 1, 0],
        offset=-radius,
        motion=sine(amplitude, omega),
        tangent=[1, 0, radius],
        mu=mu,
        mu_static=mu_static,
        e_t=e_t,
    )
    push = [G * math.sin(slope), -G * math.cos(slope), 0]
    return zivi.MechanicalSystem(mass=np.diag([1, 1, radius**2 / 2]), force=push, gaps=[plane], e=e)


def rod2(a):
    mu, e, e_t, amplitude, omega, mu_static = a

    def end(side):
        return zivi.Gap(
            lambda t, q: q[1] + side * math.sin(q[2]) - amplitude * math.sin(omega * t),
            lambda t, q: [0, 1, side * math.cos(q[2])],
            lambda t, q, v: (
                -side * math.sin(q[2]) * v[2] ** 2 + amplitude * omega**2 * math.sin(omega * t)
            ),
            lambda t, q: -amplitude * omega * math.cos(omega * t),
            tangent=lambda t, q: [1, 0, -side * math.sin(q[2])],
            tangent_curvature=lambda t, q, v: -side * math.cos(q[2]) * v[2] ** 2,
            mu=mu,
            mu_static=mu_static,
            e_t=e_t,
        )

    ends = [end(-1), end(1)]
    return zivi.MechanicalSystem(mass=np.diag([1, 1, 1 / 3]), force=[0, -G, 0], gaps=ends, e=e)


def belt2(a):
    k1, k2, k12, speed, *limits, static1, static2, fall = a

    def rubbing(c, most):
        falling = lambda t, q, v: limits[c] / (1 + fall * abs(v[c] - speed))  # noqa: E731
        row = [1 - c, c]
        return joint(falling if fall else limits[c], most, row, velocity=speed)

    def force(t, q, v):
        stretch = k12 * (q[0] - q[1])
        return [-k1 * q[0] - stretch, -k2 * q[1] + stretch]

    both = [rubbing(0, static1), rubbing(1, static2)]
    return zivi.MechanicalSystem(mass=np.eye(2), force=force, friction=both)


def beltstop(a):
    k, speed, limit, most, d, e, amplitude, omega = a
    return zivi.MechanicalSystem(
        mass=1.0,
        force=lambda t, q, v: -k * q + amplitude * math.cos(omega * t),
        gaps=[zivi.LinearGap([-1], offset=d)],
        e=e,
        friction=[joint(limit, most, velocity=speed)],
    )


def rock(a):
    b, h, mu, e, e_t, amplitude, omega, mu_static = a

    def foot(side):
        x = lambda q: side * b * math.cos(q[2]) + h * math.sin(q[2])  # noqa: E731
        y = lambda q: side * b * math.sin(q[2]) - h * math.cos(q[2])  # noqa: E731
        return zivi.Gap(
            lambda t, q: q[1] + y(q),
            lambda t, q: [0, 1, x(q)],
            lambda t, q, v: -y(q) * v[2] ** 2,
            tangent=lambda t, q: [1, 0, -y(q)],
            tangent_velocity=lambda t, q: -amplitude * omega * math.cos(omega * t),
            tangent_curvature=lambda t, q, v: (
                -x(q) * v[2] ** 2 + amplitude * omega**2 * math.sin(omega * t)
            ),
            mu=mu,
            mu_static=mu_static,
            e_t=e_t,
        )

    mass = np.diag([1, 1, (b**2 + h**2) / 3])
    return zivi.MechanicalSystem(mass=mass, force=[0, -G, 0], gaps=[foot(-1), foot(1)], e=e)


def corner(a):
    mu_floor, mu_wall, e_floor, e_wall, r, push, wave, omega, torque, turn = a
    gaps = [
        zivi.LinearGap([0, 1, 0], offset=-r, tangent=[1, 0, r], mu=mu_floor),
        zivi.LinearGap([1, 0, 0], offset=-r, tangent=[0, 1, -r], mu=mu_wall),
    ]

    def force(t, q, v):
        return [push + wave * math.cos(omega * t), -G, torque + turn * math.sin(omega * t)]

    mass = np.diag([1, 1, r**2 / 2])
    return zivi.MechanicalSystem(mass=mass, force=force, gaps=gaps, e=[e_floor, e_wall])


def servo(a):
    k, c, kp, kd, amplitude, omega, limit, most, d, e, load = a

    def force(t, q, v):
        twist = k * (q[0] - q[1]) + c * (v[0] - v[1])
        late = q[0] - amplitude * math.sin(omega * t)
        rate = v[0] - amplitude * omega * math.cos(omega * t)
        return [-twist - kp * late - kd * rate, twist]

    stop = zivi.LinearGap([0, -1], offset=d)
    brake = joint(limit, most, [1, 0])
    return zivi.MechanicalSystem(
        mass=np.diag([1, load]), force=force, gaps=[stop], e=e, friction=[brake]
    )


def guide(a):
    inertia, limit, most, e, amplitude, omega, damping = a

    def force(t, q, v):
        push = amplitude * math.sin(omega * t)
        return [-G - damping * v[0] + push, -4 * q[1] - damping * v[1]]

    rubbing = joint(limit, most, [0, 1] if inertia else [1, 0])
    floor = zivi.LinearGap([1, 0])
    mass = [[1, inertia], [inertia, 1]]
    return zivi.MechanicalSystem(mass=mass, force=force, gaps=[floor], e=e, friction=[rubbing])


def stack(a):
    m2, mu1, mu2, e1, e2, amplitude, omega, side, turn, static1, static2, height, down = a
    floor = zivi.LinearGap(
        [0, 1, 0, 0],
        motion=sine(amplitude, omega),
        tangent=[1, 0, 0, 0],
        mu=mu1,
        mu_static=static1,
        belt=sine(side, turn),
    )
    upper = zivi.LinearGap(
        [0, -1, 0, 1], offset=-height, tangent=[-1, 0, 1, 0], mu=mu2, mu_static=static2
    )
    mass, force = np.diag([1, 1, m2, m2]), [0, -G, 0, -m2 * G - down]
    return zivi.MechanicalSystem(mass=mass, force=force, gaps=[floor, upper], e=[e1, e2])


def arm(a):
    m2, mu, e, mu_static, limit, most, k, amplitude, omega, depth = a

    def mass(t, q):
        coupling = m2 * math.cos(q[0] - q[1])
        return [[1 + m2, coupling], [coupling, m2]]

    def force(t, q, v):
        swing = m2 * math.sin(q[0] - q[1])
        turn = amplitude * math.sin(omega * t)
        return [
            -swing * v[1] ** 2 - (1 + m2) * G * math.sin(q[0]) - k * q[0] + turn,
            swing * v[0] ** 2 - m2 * G * math.sin(q[1]) - k * q[1],
        ]

    tip = zivi.Gap(
        lambda t, q: depth - math.cos(q[0]) - math.cos(q[1]),
        lambda t, q: [math.sin(q[0]), math.sin(q[1])],
        lambda t, q, v: math.cos(q[0]) * v[0] ** 2 + math.cos(q[1]) * v[1] ** 2,
        tangent=lambda t, q: [math.cos(q[0]), math.cos(q[1])],
        tangent_curvature=lambda t, q, v: -math.sin(q[0]) * v[0] ** 2 - math.sin(q[1]) * v[1] ** 2,
        mu=mu,
        mu_static=mu_static,
    )
    shoulder = joint(limit, most, [1, 0])
    return zivi.MechanicalSystem(mass=mass, force=force, gaps=[tip], e=e, friction=[shoulder])


SYSTEMS = {
    it.__name__: it
    for it in (feeder, disc, rod2, belt2, beltstop, rock, corner, servo, guide, stack, arm)
}
DRAWS = {name: globals()[f"draw_{name}"] for name in SYSTEMS}


def simulate(it, tol, order=8):
    """Run a motion with the library."""
    method = zivi.SwitchedRK(order=order, rtol=tol, atol=tol, max_steps=20_000)
    return zivi.simulate(SYSTEMS[it.family](it.numbers), (0, it.end), (it.q, it.v), method)


@dataclasses.dataclass
class Verdict:
    """How a run compares with the oracle's, errors in tolerances."""

    status: str
    state: float = math.nan
    times: float = 0.0
    dissipated: float = math.nan
    energy: float = math.nan
    missing: list = dataclasses.field(default_factory=list)
    invented: list = dataclasses.field(default_factory=list)
    skipped: int = 0


def compare(it, sol, truth, tol):
    """Compare a run with the oracle's answer."""
    verdict = Verdict(sol.status.name)
    if not sol.success or truth["status"] != "ok":
        return verdict
    end = np.array([*sol.q[-1], *sol.qdot[-1]])
    verdict.state = float(np.abs(end - truth["end"]).max() / tol)
    if not truth["undetermined"]:
        # else an impact does work that is of the friction or of the normal impulses
        verdict.dissipated = float(abs(sol.dissipated[-1] - truth["friction"]) / tol)
    verdict.energy = balance(it, sol, truth) / tol
    match_events(verdict, sol, truth, tol)
    return verdict


def match_events(verdict, sol, truth, tol):
    """Match both lists; what a jump through an accumulation skips may be missing.

    Of the members of a nest before a corner both list as many as they like.
    """
    tails = list(tails_of(sol, truth))
    nests = [(start, end) for start, end in tails if any(abs(sol.corners["t"] - end) < 1e-6)]
    skipped = lambda t, parts: any(start <= t <= end for start, end in parts)  # noqa: E731
    true = [(t, kind, who) for kind, t, who in truth["events"]]
    for event in told(sol):
        same = [it for it in true if it[1:] == event[1:] and abs(it[0] - event[0]) < 1e5 * tol]
        if same:
            near = min(same, key=lambda it: abs(it[0] - event[0]))
            true.remove(near)
            verdict.times = max(verdict.times, abs(near[0] - event[0]) / tol)
        elif not skipped(event[0], nests) and not of_a_tail(event, truth, tails):
            verdict.invented.append(event)
    for event in true:
        if skipped(event[0], tails):
            verdict.skipped += 1
        else:
            verdict.missing.append(event)
    if list(sol.modes[-1]) != truth["modes"]:
        verdict.invented.append((sol.t[-1], f"modes {list(sol.modes[-1])}", truth["modes"]))


def of_a_tail(event, truth, tails):
    """Whether a transition is one of infinitely many: how many of them are listed is open."""
    t, kind, who = event
    around = [tail for tail in tails if tail[0] <= t <= tail[1]]
    alike = [it[1] for it in truth["events"] if (it[0], it[2]) == (kind, who)]
    return any(sum(start <= it <= end for it in alike) > 2 for start, end in around)


def tails_of(sol, truth):
    """Give the parts of accumulations that the run has jumped over, and of corners."""
    made = sol.resolved_impacts["t"]
    ends = [t for kind, t, who in truth["events"] if kind == "zeno"]
    for end in [*ends, *sol.corners["t"]]:
        before = made[made < end - 1e-12]
        yield (before.max() if before.size else 0.0) - 1e-12, end + 1e-7


def balance(it, sol, truth):
    """Give what is missing of the energy, NaN where the surroundings do work.

    The loss of impacts along the normals is the oracle's: lists leave out those of corners.
    """
    energy = ENERGIES.get(it.family)
    if energy is None or any(x != 0 for x in WAVES[it.family](it.numbers)):
        return math.nan
    if truth["undetermined"]:
        return math.nan
    first, last = (energy(it.numbers, sol.q[k], sol.qdot[k]) for k in (0, -1))
    return float(abs(first - last - sol.dissipated[-1] - truth["normal"]))


def energy_of(mass, potential):
    def energy(a, q, v):
        return v @ np.array(mass(a)) @ v / 2 + potential(a, q)

    return energy


ENERGIES = {
    "disc": energy_of(
        lambda a: np.diag([1, 1, a[3] ** 2 / 2]),
        lambda a, q: G * (q[1] * math.cos(a[6]) - q[0] * math.sin(a[6])),
    ),
    "rod2": energy_of(lambda a: np.diag([1, 1, 1 / 3]), lambda a, q: G * q[1]),
    "rock": energy_of(
        lambda a: np.diag([1, 1, (a[0] ** 2 + a[1] ** 2) / 3]), lambda a, q: G * q[1]
    ),
    "corner": energy_of(
        lambda a: np.diag([1, 1, a[4] ** 2 / 2]), lambda a, q: G * q[1] - a[5] * q[0] - a[8] * q[2]
    ),
    "guide": energy_of(lambda a: [[1, a[0]], [a[0], 1]], lambda a, q: G * q[0] + 2 * q[1] ** 2),
    "stack": energy_of(
        lambda a: np.diag([1, 1, a[0], a[0]]), lambda a, q: G * (q[1] + a[0] * q[3]) + a[12] * q[3]
    ),
}
WAVES = {
    "disc": lambda a: [a[4]],
    "rod2": lambda a: [a[3]],
    "rock": lambda a: [a[5]],
    "corner": lambda a: [a[6], a[9]],
    "guide": lambda a: [a[4]],
    "stack": lambda a: [a[5], a[7]],
}
