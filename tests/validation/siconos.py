"""The references of the Siconos tutorials: event-driven runs with LSODAR, and time stepping."""

import numpy as np

import zivi

from .rows import SOURCES, TIGHT, Row, columns, link, series


def ball() -> list[Row]:
    """A ball on a floor: positions and the times of impacts."""
    system = zivi.ImpactSystem(-9.81, e=0.9)
    sol = zivi.simulate(system, (0, 8.6), (1, 0), TIGHT)
    t, x = columns("siconos_ball")
    times = np.array(SOURCES["siconos_ball"]["impacts"])
    hits = sol.impacts_down_to(1e-6)["t"][: len(times)]
    hit = zivi.simulate(system, (0, 8.6), (0, -1), TIGHT)
    t_hit, x_hit = columns("siconos_initial")
    dead = zivi.simulate(zivi.ImpactSystem(-9.81, e=0), (0, 8.6), (1, 0), TIGHT)
    t_dead, x_dead = columns("siconos_resting")
    what = "positions of a ball, e = 0.9"
    return [
        series(link("siconos_ball"), what, x, sol(t)[0], 5e-13),
        series(link("siconos_ball"), "times of its impacts (s)", times, hits, 1e-11),
        series(link("siconos_initial"), f"{what}, through rest", x_hit, hit(t_hit)[0], 3e-11),
        series(link("siconos_resting"), "positions, e = 0", x_dead, dead(t_dead)[0], 5e-15),
    ]


def two_contacts() -> Row:
    """A ball between floor and ceiling."""
    gaps = [zivi.LinearGap([1], 0), zivi.LinearGap([-1], 1.5)]
    system = zivi.MechanicalSystem(mass=1.0, force=-10.0, gaps=gaps, e=0.8)
    t, x = columns("siconos_two_contacts")
    sol = zivi.simulate(system, (0, 10.1), (1.0, 10.0), TIGHT)
    what = "positions between floor and ceiling"
    return series(link("siconos_two_contacts"), what, x, sol(t)[0][:, 0], 2e-11)


def stiff_oscillator() -> zivi.simulation.Trajectory:
    """Run a mass at a stiff spring that hits a floor."""
    force = zivi.LinearForce(stiffness=1e5, gravity=9.81)
    return zivi.simulate(zivi.ImpactSystem(force, e=0.9), (0, 8.6), (1, 0), TIGHT)


def oscillator() -> Row:
    """Its positions, 50 impacts and more."""
    t, x = columns("siconos_oscillator")
    ours = stiff_oscillator()(t)[0]
    return series(link("siconos_oscillator"), "positions of a stiff oscillator", x, ours, 5e-13)


def time_stepping() -> Row:
    """Moreau and Jean's scheme with the same step."""
    t, x, _ = columns("siconos_moreau")
    h = 0.005
    system = zivi.ImpactSystem(-9.81, e=0.9)
    sol = zivi.simulate(system, (0, 10), (1, 0), zivi.MoreauJean(h))
    ours = sol.x[(t / h).round().astype(int)]
    return series(link("siconos_moreau"), "positions, `MoreauJean(0.005)`", x, ours, 1e-14)


def beads() -> Row:
    """Ten beads in contact fall on a floor, e = 1."""
    n, radius = 10, 0.005
    t, *q = columns("siconos_beads")
    unit = np.eye(n)
    gaps = [zivi.LinearGap(unit[0], -radius)]
    gaps += [zivi.LinearGap(unit[j] - unit[j - 1], -2 * radius) for j in range(1, n)]
    system = zivi.MechanicalSystem(mass=unit, force=np.full(n, -9.81), gaps=gaps, e=1.0)
    start = 0.055 + 0.01 * np.arange(n)
    sol = zivi.simulate(system, (0, 0.5), (start, np.zeros(n)), TIGHT)
    what = "heights of ten beads in contact, e = 1"
    return series(link("siconos_beads"), what, np.transpose(q), sol(t)[0], 3e-14)


def friction_oscillator() -> Row:
    """A mass at a spring with dry friction, by the midpoint rule."""
    t, x, _ = columns("siconos_friction")
    h = 0.01
    joint = zivi.DryFriction(limit=1.0)
    system = zivi.MechanicalSystem(mass=1.0, force=lambda t, q, v: -q, friction=[joint])
    sol = zivi.simulate(system, (0, 25.01), (12.0, 6.0), zivi.MoreauJean(h))
    ours = sol.q[(t / h).round().astype(int), 0]
    what = "positions with dry friction, `MoreauJean(0.01)`"
    return series(link("siconos_friction"), what, x, ours, 5e-13)


def rocking_block() -> Row:
    """When a block that falls tilted hits the floor first."""
    at = SOURCES["siconos_block"]
    corner = zivi.Gap(
        lambda t, q: q[0] - 0.1 * np.sin(q[1]) - 0.05 * np.cos(q[1]),
        lambda t, q: [1, -0.1 * np.cos(q[1]) + 0.05 * np.sin(q[1])],
    )
    mass = np.diag([1, 1.25 / 12])
    system = zivi.MechanicalSystem(mass=mass, force=[-9.81, 0.0], gaps=[corner], e=0.9)
    start = ([0.5580127018922193, np.pi / 3], [0.0, 0.0])
    sol = zivi.simulate(system, (0, 0.35), start, TIGHT)
    what = "first impact of a tilted block (s)"
    return series(link("siconos_block"), what, at["first_impact"], sol.impacts["t"][0], 4e-12)


def rows() -> list[Row]:
    """Compare with all of them."""
    return [
        *ball(),
        two_contacts(),
        oscillator(),
        beads(),
        rocking_block(),
        time_stepping(),
        friction_oscillator(),
    ]
