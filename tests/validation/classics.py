"""Formulas of the literature, and of the tests of other programs."""

import math

import numpy as np

import zivi

from .rows import SOURCES, TIGHT, Row, link, series


def bouncing_mass() -> Row:
    """The state that Drake expects of a ball with e = 1."""
    g, t = 9.81, SOURCES["drake"]["t"]
    drop = math.sqrt(2 / g)
    phases, rest = divmod(t, drop)
    down = phases % 2 == 0
    v = -g * rest + (0 if down else g * drop)
    x = 1 - g * rest**2 / 2 if down else g * drop * rest - g * rest**2 / 2
    sol = zivi.simulate(zivi.ImpactSystem(-g, e=1), (0, t), (1, 0), TIGHT)
    return series(link("drake"), "numbers of the state at 10 s, e = 1", (x, v), sol(t), 5e-14)


def rod() -> Row:
    """What the impact of one end of a rod leaves, by the formula of the authors."""
    rng = np.random.default_rng(SOURCES["rod"]["seed"])
    theirs, ours = [], []
    for _ in range(SOURCES["rod"]["draws"]):
        length, r, angle = rng.uniform(0.5, 2), rng.uniform(0.2, 1), rng.uniform(0.2, 1.3)
        c, s = math.cos(angle), math.sin(angle)
        y, turn = rng.uniform(-3, -0.1), rng.uniform(0, 3)  # the left end goes down
        below = length**2 * c**2 + 4 * r**2
        up = -length * turn * r**2 * c + 2 * y * r**2
        around = -length * y * c + length**2 * turn * c**2 / 2
        theirs.append([y - 4 * up / below, turn - 4 * around / below])
        end = zivi.Gap(
            lambda t, q, size=length: q[0] - size / 2 * math.sin(q[1]),
            lambda t, q, size=length: [1, -size / 2 * math.cos(q[1])],
        )
        system = zivi.MechanicalSystem(
            mass=np.diag([1, r**2]), force=np.zeros(2), gaps=[end], e=1.0
        )
        start = ([length / 2 * s, angle], [y, turn])
        ours.append(zivi.simulate(system, (0, 1e-6), start).qdot[-1])
    return series(link("rod"), "velocities after impacts of a rod", theirs, ours, 2e-14)


def grazing() -> Row:
    """Where the orbit of an impact oscillator touches the stop: A^2 = (1 - w^2)^2 + (0.1 w)^2."""
    theirs, ours = [], []
    for w in SOURCES["coco"]["omega"][:2]:
        amplitude = math.hypot(1 - w * w, 0.1 * w)
        # the distance to the stop, 1 - x
        force = zivi.LinearForce(
            stiffness=1, damping=0.1, gravity=-1, amplitude=1.05 * amplitude, omega=w
        )
        orbit = zivi.periodic_orbit(zivi.ImpactSystem(force, e=0.8), (0, (0.5, 0)))
        span = (0.9 * amplitude, 1.1 * amplitude)
        (event,) = zivi.continue_orbit(orbit, "amplitude", span, step=0.05).of_kind("grazing")
        theirs.append(amplitude)
        ours.append(event.value)
    return series(link("coco"), "amplitudes where an orbit grazes", theirs, ours, 2e-12)


def table() -> Row:
    """Where orbits with one impact in n periods of a table begin, and where they double."""
    theirs, ours = [], []
    for e, n in ((0.3, 1), (0.7, 1), (0.7, 2), (0.9, 1)):
        fold = n * math.pi * (1 - e) / (1 + e)
        doubling = math.hypot(fold, 2 * (1 + e * e) / (1 + e) ** 2)
        amplitude = 0.7 * fold + 0.3 * doubling
        force = zivi.LinearForce(gravity=1, amplitude=amplitude, phase=-math.pi / 2)
        start = (math.acos(fold / amplitude), (1e-12, 2 * math.pi * n * e / (1 + e)))
        orbit = zivi.periodic_orbit(zivi.ImpactSystem(force, e=e), start)
        branch = zivi.continue_orbit(orbit, "amplitude", (0.99 * fold, 1.02 * doubling), step=0.1)
        theirs += [fold, doubling]
        ours += [branch.of_kind(kind)[0].value for kind in ("fold", "period_doubling")]
    source = "Luck and Mehta, Phys. Rev. E 48, 3988 (1993)"
    what = "accelerations of a table (in g) at folds and period doublings"
    return series(source, what, theirs, ours, 4e-12)


def housner() -> Row:
    """Impacts of a slender block that rocks freely: sums of acosh(1/(1 - phi_n))/p."""
    alpha, phi, p, count = 0.2, 0.5, 1.0, 20
    e = 1 - 1.5 * math.sin(alpha) ** 2
    energies = (1 - (1 - phi) ** 2) * e ** (2 * np.arange(count + 1))
    quarters = np.arctanh(np.sqrt(energies)) / p
    times = quarters[0] + 2 * np.append(0, np.cumsum(quarters[1:count]))
    force = zivi.LinearForce(stiffness=-(p**2), gravity=p**2 * alpha)
    sol = zivi.simulate(zivi.ImpactSystem(force, e=e), (0, 40), (alpha * phi, 0), TIGHT)
    source = "Housner, Bull. Seismol. Soc. Am. 53, 403 (1963)"
    return series(source, "impacts of a rocking block (s)", times, sol.impacts["t"][:count], 1e-12)


def den_hartog() -> Row:
    """Amplitude of a forced oscillator with dry friction that does not stick."""
    beta, limit = 1.4, 0.3
    system = zivi.MechanicalSystem(
        mass=1.0,
        force=lambda t, q, v: -q[0] + math.cos(beta * t),
        friction=[zivi.DryFriction(limit=limit)],
    )
    method = zivi.SwitchedRK(rtol=1e-11, atol=1e-12)
    sol = zivi.simulate(system, (0, 160 * math.pi / beta), (0.0, 0.0), method)
    ours = float(np.abs(sol(sol.transitions["t"][-1])[0]).max())
    u = math.sin(math.pi / beta) / (beta * (1 + math.cos(math.pi / beta)))
    theirs = math.sqrt(1 / (1 - beta**2) ** 2 - (limit * u) ** 2)
    source = "Den Hartog, Trans. ASME 53, APM-107 (1931)"
    return series(source, "amplitude with dry friction, no stick", theirs, ours, 2e-11)


def painleve() -> Row:
    """The least friction at which a sliding rod may have no motion."""
    angle = math.atan(2)
    c, s = math.cos(angle), math.sin(angle)

    def goes_on(mu: float) -> bool:
        tip = zivi.Gap(
            lambda t, q: q[1] - math.sin(q[2]),
            lambda t, q: [0, 1, -math.cos(q[2])],
            tangent=lambda t, q: [1, 0, math.sin(q[2])],
            mu=mu,
        )
        mass = np.diag([1, 1, 1 / 3])
        system = zivi.MechanicalSystem(mass=mass, force=[0, -9.81, 0], gaps=[tip], e=0.0)
        sol = zivi.simulate(system, (0, 1e-9), ([c, s, angle], [-2.0, 0.0, 0.0]))
        return sol.status == zivi.Status.COMPLETED

    low, high = 1.0, 2.0
    while high - low > 1e-8:
        middle = (low + high) / 2
        low, high = (middle, high) if goes_on(middle) else (low, middle)
    source = "Génot and Brogliato, Eur. J. Mech. A 18, 653 (1999)"
    return series(source, "least friction of Painlevé's paradox of a rod", 4 / 3, low, 3e-8)


def rows() -> list[Row]:
    """Compare with all of them."""
    first = [bouncing_mass(), rod(), grazing(), table()]
    return [*first, housner(), den_hartog(), painleve()]
