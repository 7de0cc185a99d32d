r"""Gains for coming to rest, computed, with noise, a delay and an unknown force.

A mass falls from up to 1 m onto a wall with ``e = 0.7``. It shall rest there within 2 s, with
velocities measured to 1 cm/s, controls that act three periods late and an unknown force of up to 1
m/s^2. The design gives the gains, the period and the range of the control; 60 random loops check
the promise. In brackets: the conditions of the design, computed again from its gains; what was
promised.

Run as ``python examples/design_gains.py [out.png]``.
"""

import sys

import numpy as np

import zivi

E, TIME, BOUND, DELAY, GRAVITY = 0.7, 2.0, 1.0, 3, -9.81
NOISE = (1e-5, 0.01)
LOOPS = 60


def design() -> zivi.GainDesign:
    """Compute gains and period; five deviations of the noise are the dead zone."""
    return zivi.design_tracker(TIME, e=E, bound=BOUND, delay=DELAY, quiet=5 * NOISE[1])


def accelerations(gains: zivi.GainDesign) -> tuple[float, float, float]:
    """Net accelerations U and D of the law, and the largest unknown force under which it rests."""
    rising = 2 * E * (gains.mu1 + gains.mu2) / (1 + E)
    falling = 2 * (gains.mu1 - gains.mu2) / (1 + E)
    return rising, falling, (min(rising, falling) - E**2 * falling) / (1 + E**2)


def loops(gains: zivi.GainDesign) -> list[zivi.ClosedLoop]:
    """Run loops from random starts under random constant forces."""
    rng = np.random.default_rng(1)
    found = []
    for seed in range(LOOPS):
        force = rng.uniform(-BOUND, BOUND)
        found.append(
            zivi.simulate_closed_loop(
                zivi.ImpactSystem(GRAVITY + force, e=E),
                gains.controller(),
                (0, TIME + 0.5),
                (rng.uniform(0.2, 1.0), 0.0),
                y_ref0=(0, 0),
                force_model=GRAVITY,
                noise=NOISE,
                seed=seed,
                delay=DELAY,
                progress=False,
            )
        )
    return found


def main(path: str | None) -> None:
    """Design, check, print beside what is expected, and draw if a path is given."""
    gains = design()
    rising, falling, bound = accelerations(gains)
    print(f"gains {gains.mu1:.2f} and {gains.mu2:.2f}, a period of {gains.h:.2e} s")
    print(
        f"accelerations {gains.rising:.6f} ({rising:.6f}) and {gains.falling:.6f} ({falling:.6f})"
    )
    print(f"rests under unknown forces up to {bound:.3f} m/s^2, asked {BOUND}")
    runs = loops(gains)
    times = [run.rest_time for run in runs if run.rest_time is not None]
    print(
        f"{len(times)} of {LOOPS} rest, the last after {max(times):.3f} s"
        f" ({gains.settling_time:.3f})"
    )
    low, high = min(run.u.min() for run in runs), max(run.u.max() for run in runs)
    print(f"control from {low:.2f} to {high:.2f} m/s^2 ({gains.u_min:.2f} to {gains.u_max:.2f})")
    if path is not None:
        draw(path, gains, runs)


def draw(path: str, gains: zivi.GainDesign, runs: list[zivi.ClosedLoop]) -> None:
    """Draw all positions, and the control of one loop."""
    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt

    plt.style.use("zivi.plot.figures")
    figure, axes = plt.subplots(2, 1, layout="constrained", figsize=(8.0, 5.0), sharex=True)
    for run in runs:
        axes[0].plot(run.t, run.x, color=zivi.plot.BLUE, lw=0.4)
    axes[0].axvline(gains.settling_time, color="0.5", lw=0.8)
    axes[0].set(ylabel="position (m)")
    axes[1].step(runs[0].t, runs[0].u, where="post", color=zivi.plot.BLUE, lw=0.6)
    for limit in (gains.u_min, gains.u_max):
        axes[1].axhline(limit, color="0.5", lw=0.8)
    axes[1].set(xlabel="time (s)", ylabel="control (m/s$^2$)")
    figure.suptitle("Coming to rest with noise and a delay (grey: computed bounds)")
    figure.savefig(path, dpi=150)


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else None)
