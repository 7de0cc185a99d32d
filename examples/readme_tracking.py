"""The picture of the README's controllers, and one of docs/implicit_signs.md.

Left, a mass follows a reference into its Zeno point (the paper's problem); middle and right, what
the control does on a reference that bounces without end, with implicit and with explicit signs.

Run as ``python examples/readme_tracking.py out.png``; with a second name the comparison of explicit
and implicit signs over forty periods is written too.
"""

import sys
from pathlib import Path

import matplotlib as mpl

import zivi
from zivi.paper import chattering
from zivi.plot import BLUE, ORANGE

sys.path.insert(0, str(Path(__file__).parent))
import periodic_reference


def tracked() -> zivi.ClosedLoop:
    """Track the paper's reference in the sampled loop."""
    plant = zivi.ImpactSystem(-9.81, kappa=0.5)
    tracker = zivi.TwistingTracker(30, 17, h=1e-3, kappa=0.5)
    return zivi.simulate_closed_loop(
        plant, tracker, (0, 1.6), (6, 5), y_ref0=(3, 3), force_ref=-19.81
    )


def main(path: str, comparison: str | None = None) -> None:
    """Draw the positions, and the control of both."""
    mpl.use("Agg")
    import matplotlib.pyplot as plt

    plt.style.use("zivi.plot.figures")
    figure, (left, middle, right) = plt.subplots(
        1, 3, figsize=(10.2, 3.1), layout="constrained", gridspec_kw={"wspace": 0.06}
    )
    run = tracked()
    zivi.plot.position(run, left).set_title("tracking into rest", fontsize="medium")
    left.annotate(
        f"both rest from {run.rest_time:.2f} s,\n$u$ = {run.u[-1]:.2f} m/s$^2$, constant",
        (run.rest_time, 0.0),
        (0.66, 2.6),
        arrowprops={"arrowstyle": "->", "color": "0.3"},
        fontsize="small",
    )
    implicit = periodic_reference.run("positive", periods=20)
    explicit = periodic_reference.run("explicit", periods=20)
    looks = ((middle, implicit, "implicit", BLUE), (right, explicit, "explicit", ORANGE))
    for ax, bouncing, signs, color in looks:
        zivi.plot.control(bouncing, ax, color=color, lw=0.8)
        ax.set_title(f"endless bouncing: {signs} signs", fontsize="medium")
        ax.set(xlim=(8.0, 9.0), ylim=(-90, 90))
    right.set_ylabel("")
    figure.savefig(path, dpi=160)
    if comparison is not None:
        figure = chattering.draw_chattering().figure
        figure.savefig(comparison, dpi=160)


if __name__ == "__main__":
    main(*sys.argv[1:3])
