"""Where a reference of others differs, and what shows which of the two is right."""

import math

import numpy as np

import zivi

from .rows import SOURCES, TIGHT, Row, columns, link
from .siconos import stiff_oscillator
from .woodpecker import HM, R0, RM


def block_energy() -> Row:
    """The block gains energy at its first impact."""
    at, (mass, inertia) = SOURCES["siconos_block"], (1.0, 1.25 / 12)
    before, after = (
        mass * y**2 / 2 + inertia * turn**2 / 2 + 9.81 * mass * height
        for _, height, _, y, turn in (at["before"], at["after"])
    )
    what = "energy before and after an impact with e = 0.9 (J)"
    said = f"{before:.4g}, {after:.3g}"
    return Row(link("siconos_block"), what, said, "it cannot grow", after - before, 1e7)


def oscillator_at_rest() -> Row:
    """The mass rests on the floor; the reference drifts off it."""
    t, x, _ = SOURCES["siconos_oscillator"]["at_the_end"]
    sol = stiff_oscillator()
    ours = float(sol(t)[0])
    assert sol.rest_time < t
    said = f"{x:.3g}"
    return Row(link("siconos_oscillator"), "position at rest", said, f"{ours:g}", x - ours, 1e-11)


def example_fmu() -> list[Row]:
    """Heights of the FMU's ball in fixed steps, and when it rests."""
    t, x = columns("fmu")
    sol = zivi.simulate(zivi.ImpactSystem(-9.81, e=0.7), (0, 3), (1, 0), TIGHT)
    apart = float(np.abs(sol(t)[0] - x).max())
    first = math.sqrt(2 / 9.81)
    exact = first * (1 + 2 * 0.7 / (1 - 0.7))
    rest = SOURCES["fmu"]["at_rest_from"]
    assert abs(sol.rest_time - exact) < 1e-12
    heights = f"{len(t)} heights, steps of 1e-3 (m)"
    return [
        Row(link("fmu"), heights, f"{x[1]:.6g}, ...", f"{sol(t)[0][1]:.6g}, ...", apart, 3e-2),
        Row(link("fmu"), "time of rest (s)", f"{rest:g}", f"{exact:.6g}", rest - exact, 6e-2),
    ]


def woodpecker_start() -> Row:
    """The published start of the woodpecker is inside of the sleeve's edge."""
    _, _, sleeve, *_ = columns("siconos_woodpecker")
    gap = RM - R0 + HM * sleeve[0]
    what = "gap of the sleeve's edge at the start (m)"
    return Row(link("siconos_woodpecker"), what, f"{gap:.2g}", "at least 0", -gap, 1e-6)


def rows() -> list[Row]:
    """List them."""
    return [block_energy(), oscillator_at_rest(), *example_fmu(), woodpecker_start()]
