"""Every kind of result, drawn: runs, loops, mechanisms, friction, orbits, diagrams, basins.

Each panel is one call of `zivi.plot`, which is its title.

Run as ``python examples/every_plot.py out.png`` (extra `plot`).
"""

import math
import sys
from typing import Any

import numpy as np

import zivi

BALL = zivi.ImpactSystem(-9.81, e=0.5)
PLANT = zivi.ImpactSystem(-9.81, e=1 / 3)
TABLE = zivi.ImpactSystem(zivi.LinearForce(gravity=1.0, amplitude=1.3, phase=-math.pi / 2), e=0.5)
OSCILLATOR = zivi.ImpactSystem(
    zivi.LinearForce(stiffness=1.0, damping=0.1, amplitude=1.0, omega=2.8), e=0.8
)
BOX = zivi.MechanicalSystem(
    mass=np.eye(2),
    force=[2.0, -9.81],
    gaps=[
        zivi.LinearGap([0, 1], name="floor", tangent=[1, 0], mu=0.3),
        zivi.LinearGap([-1, 0], 0.3, name="wall"),
    ],
    e=[0.5, 0.3],
    coordinates=["x", "y"],
)


def runs() -> list[tuple[str, Any, dict[str, Any]]]:
    """Simulate what is drawn first: functions of `zivi.plot`, their arguments."""
    ball = zivi.simulate(BALL, (0, 2), (1, 0))
    steps = zivi.simulate(BALL, (0, 2), (1, 0), zivi.ThetaGamma(1e-2))
    tracker = zivi.TwistingTracker(30, 17, h=1e-3, e=1 / 3)
    loop = zivi.simulate_closed_loop(
        PLANT, tracker, (0, 2), (6, 5), y_ref0=(3, 3), force_ref=-19.81
    )
    box = zivi.simulate(BOX, (0, 2), ([0.0, 0.5], [0.5, 0.0]))
    section = zivi.simulate(OSCILLATOR, (0, 2000), (0.5, 0))
    return [
        ("position", ball, {}),
        ("velocity", ball, {}),
        ("lifted", ball, {}),
        ("signs", steps, {}),
        ("phase_plane", ball, {"coordinates": "physical"}),
        ("impacts", section, {}),
        ("position", loop, {}),
        ("control", loop, {}),
        ("signs", loop, {}),
        ("coordinates", box, {}),
        ("gaps", box, {}),
        ("reactions", box, {}),
        ("slips", box, {}),
        ("modes", box, {}),
        ("configuration", box, {}),
        ("poincare", section, {"period": 2 * math.pi / 2.8, "section": "impacts", "skip": 20}),
    ]


def orbits() -> list[tuple[str, Any, dict[str, Any]]]:
    """Compute what is drawn then: orbits, diagrams, basins."""
    orbit = zivi.periodic_orbit(TABLE, [(0.6, 2.1)])
    branch = zivi.continue_orbit(orbit, "amplitude", (1.0, 1.7))
    doubling = branch.of_kind("period_doubling")[0]
    double = zivi.continue_orbit(branch.switch(doubling), "amplitude", (1.5, 1.7), max_points=40)
    spans = (1.0, 2.0), (0.3, 0.8)
    events = (doubling, branch.of_kind("fold")[0])
    curves = [zivi.continue_curve(it, ("amplitude", "e"), spans) for it in events]
    diagram = zivi.bifurcation_diagram(
        TABLE, "amplitude", np.linspace(0.9, 1.7, 90), starts=[(0, 0), (0.3, 1.9)]
    )
    cells = zivi.basins(TABLE, np.linspace(0, 2, 80), np.linspace(-2, 3, 80), transient=60)
    return [
        ("branch", double, {}),
        ("multipliers", branch, {}),
        ("chart", curves, {}),
        ("diagram", diagram, {"branches": [branch, double]}),
        ("basins", cells, {}),
    ]


def main(out: str) -> None:
    """Draw all panels."""
    import matplotlib.pyplot as plt

    panels = [*runs(), *orbits()]
    plt.style.use("zivi.plot.figures")
    figure, axes = plt.subplots(7, 3, figsize=(13, 23), layout="constrained")
    for ax, (name, result, settings) in zip(axes.ravel(), panels, strict=True):
        getattr(zivi.plot, name)(result, ax=ax, **settings)
        ax.set_title(f"plot.{name}", fontsize="medium")
    figure.savefig(out, dpi=72)


if __name__ == "__main__":
    main(sys.argv[1])
