"""A gantry with two axes that finds a place by running against a stop, and picks something up.

Its carriage falls against the stop like a ball, through the Zeno point of its bounces, and is
pressed against it with 20 N: now it is where the stop is, whatever the sensor says. Then the hoist
goes down and up again, and the carriage leaves. The gap before the stop has a tracker; the hoist,
at right angles to it, a position law.

Run as ``python examples/gantry.py [out.png]``.
"""

import sys

import numpy as np

import zivi

FORCE, LEAVE, END = 20.0, 2.0, 2.5
DEPTH = 0.4


def gantry(rail: float = 12.0) -> zivi.MechanicalSystem:
    """Give it: a carriage with a hoist of 3 kg; a motor on each axis."""
    return zivi.MechanicalSystem(
        mass=np.diag([rail, 3.0]),
        force=[0.0, -3.0 * 9.81],
        gaps=[zivi.LinearGap([-1, 0], offset=1.0, name="stop")],
        e=0.4,
        coordinates=["x", "z"],
        inputs={"drive": [1, 0], "hoist": [0, 1]},
    )


def approach() -> zivi.Trajectory:
    """Give the motion of the gap: it falls shut with 6 m/s^2, and opens with 2 m/s^2."""
    force = lambda t, x, xdot: -6.0 if t < LEAVE else 2.0  # noqa: E731
    plant = zivi.ImpactSystem(force, e=0.4)
    return zivi.simulate(plant, (0, END), (0.5, 0), tstops=[LEAVE])


def lowered(t: float) -> np.ndarray:
    """Give carriage, which its gap decides, and hoist, with their derivatives."""
    phase = np.clip((t - 1.1) / 0.8, 0.0, 1.0)
    rate = 0.8 if 0.0 < phase < 1.0 else np.inf
    down = 0.5 * (1 - np.cos(2 * np.pi * phase))
    speed = np.pi / rate * np.sin(2 * np.pi * phase)
    pull = 2 * (np.pi / rate) ** 2 * np.cos(2 * np.pi * phase)
    return np.array([[1.0, -DEPTH * down], [0.0, -DEPTH * speed], [0.0, -DEPTH * pull]])


def pick(believed: zivi.MechanicalSystem | None = None) -> zivi.MechanicalClosedLoop:
    """Run it, with a sensor of 20 um and 2 mm/s."""
    controller = zivi.GapTracker(
        gantry() if believed is None else believed,
        h=1e-3,
        gains={"stop": (20, 11)},
        force={"stop": FORCE},
        horizon=3,
        u_limits=[(-400, 400), (-200, 200)],
    )
    return zivi.simulate_closed_loop(
        gantry(),
        controller,
        (0, END),
        ([0.48, 0.0], [0.0, 0.0]),
        reference={"stop": approach(), "posture": lowered},
        noise=(2e-5, 2e-3),
        seed=1,
        method=zivi.RKPeriod(),
    )


def main(path: str | None) -> None:
    """Print the numbers, and draw if a path is given."""
    run = pick()
    held = (run.t > 1.05) & (run.t < LEAVE - 0.01)
    pressed = run.reactions[held, 0]
    print(f"at the stop from {run.zeno.t[-1]:.3f} s, x = {run.q[held, 0].max():.9f} m")
    print(f"pressed with {pressed.min():.2f} to {pressed.max():.2f} N of {FORCE}")
    print(f"the hoist is down {-run.q[:, 1].min():.4f} m of {DEPTH}")
    print(f"leaves at {run.liftoffs.t[-1]:.3f} s")
    if path is None:
        return
    import matplotlib.pyplot as plt

    plt.style.use("zivi.plot.figures")
    figure, axes = plt.subplots(3, 1, sharex=True, figsize=(7, 6), layout="constrained")
    axes[0].plot(run.t, run.q, label=["carriage", "hoist"])
    axes[0].set_ylabel("place (m)")
    axes[0].legend()
    axes[1].plot(run.t, run.reactions[:, 0])
    axes[1].set_ylabel("force on the stop (N)")
    axes[2].plot(run.t, run.u, label=run.control_names)
    axes[2].set_ylabel("force of a motor (N)")
    axes[2].set_xlabel("time (s)")
    axes[2].legend()
    figure.suptitle("A gantry finds a stop, presses it with 20 N and picks something up")
    figure.savefig(path, dpi=120)


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else None)
