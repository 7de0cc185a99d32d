"""Exact rest at e = 0.8, with noise and a delay: without and with the contact-establishing law.

A mass falls from 1 m onto a wall that gives back 0.8 of its speed, and the tracker shall hold it
there. Positions are measured to 0.1 mm, velocities to 1 cm/s, and what is computed acts three
periods later. The paper's law plans to end each period on the wall and chatters without end, up
to 0.7 mm high; the contact-establishing law with the delay (`ahead=4`) rests exactly from 1.009 s,
and its control is constant from then on, noise or not.

Run as ``python examples/exact_rest.py [out.png]``.
"""

import sys
from typing import Any

import numpy as np

import zivi

E, H, DELAY, NOISE, T_END = 0.8, 1e-3, 3, (1e-4, 1e-2), 4.0
LAWS: dict[str, dict[str, Any]] = {
    "the paper's law": {"landing": False},
    "contact-establishing law": {"landing": True, "ahead": 1 + DELAY},
}


def run(law: str, seed: int = 1) -> zivi.ClosedLoop:
    """Let the mass fall under one of the laws."""
    return zivi.simulate_closed_loop(
        zivi.ImpactSystem(-9.81, e=E),
        zivi.TwistingTracker(30, 17, h=H, e=E, **LAWS[law]),
        (0.0, T_END),
        (1.0, 0.0),
        y_ref0=(0.0, 0.0),
        noise=NOISE,
        seed=seed,
        delay=DELAY,
        progress=False,
    )


def variation(sol: zivi.ClosedLoop, since: float = T_END / 2) -> float:
    """Give the total variation of the control a second, from a time on (m/s^3)."""
    late = sol.u[sol.t >= since]
    return float(np.abs(np.diff(late)).sum() / (T_END - since))


def main(path: str | None) -> None:
    """Measure, print, and draw if a path is given."""
    runs = {law: run(law) for law in LAWS}
    for law, sol in runs.items():
        rest = "no rest" if sol.rest_time is None else f"at rest from {sol.rest_time:.3f} s"
        late = sol.t > T_END / 2
        print(
            f"{law:16}: {rest}, then x up to {sol.x[late].max():.1e} m, "
            f"sum |du| {variation(sol):.0f} a second"
        )
    if path is not None:
        draw(path, runs)


def draw(path: str, runs: dict[str, zivi.ClosedLoop]) -> None:
    """Draw positions and controls."""
    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt

    plt.style.use("zivi.plot.figures")
    figure, axes = plt.subplots(2, 2, layout="constrained", figsize=(9.0, 4.8), sharex=True)
    for (above, below), (law, sol) in zip(axes.T, runs.items(), strict=True):
        above.plot(sol.t, sol.x, color=zivi.plot.BLUE, lw=0.8)
        above.set(title=law, ylabel="$x$ (m), linear below 0.1 mm")
        above.set_yscale("symlog", linthresh=1e-4)
        above.set_ylim(0, 2)
        zivi.plot.control(sol, below, lw=0.6)
        below.set_ylim(-80, 80)
    figure.savefig(path, dpi=150)


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else None)
