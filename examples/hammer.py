"""A hammer that strikes a wall with a specified speed, blow by blow.

Each blow is aimed: arrive in time, at the wall, with the speed that this blow shall have. The way
there takes the least effort; the last four periods are played from the plan.

Run as ``python examples/hammer.py [out.png]``.
"""

import sys

import numpy as np

import zivi

SPEEDS = [1.0, 0.5, 2.0, 1.5, 0.25, 3.0]
INTERVAL, MASS = 0.3, 2.0


def hammer(e: float = 0.3) -> zivi.MechanicalSystem:
    """Give a mass of 2 kg before a wall."""
    gap = zivi.LinearGap([1], name="wall")
    return zivi.MechanicalSystem(
        mass=MASS, force=[0.0], gaps=[gap], e=e, inputs=[[1.0]], coordinates=["head"]
    )


def strike(delay: int = 0) -> zivi.MechanicalClosedLoop:
    """Run it; it believes in another restitution, which does not matter to the next blow."""
    controller = zivi.Striker(
        hammer(e=0.5),
        gap="wall",
        speed=lambda k: SPEEDS[k % len(SPEEDS)],
        interval=INTERVAL,
        delay=delay,
    )
    end = INTERVAL * len(SPEEDS) + 0.1
    return zivi.simulate_closed_loop(
        hammer(), controller, (0, end), ([0.1], [0.0]), delay=delay, method=zivi.RKPeriod()
    )


def main(path: str | None) -> None:
    """Print the numbers, and draw if a path is given."""
    run = strike()
    blows = run.resolved_impacts
    for blow, wanted in zip(blows, SPEEDS, strict=True):
        speed = -blow["speed_before"]
        print(f"blow at {blow['t']:.4f} s with {speed:.6f} m/s of {wanted}")
    print(f"largest force of the drive: {np.abs(run.u).max():.0f} N")
    if path is None:
        return
    import matplotlib.pyplot as plt

    plt.style.use("zivi.plot.figures")
    figure, axes = plt.subplots(2, 1, sharex=True, figsize=(7, 5), layout="constrained")
    axes[0].plot(run.t, 1e3 * run.gaps[:, 0])
    axes[0].set_ylabel("gap (mm)")
    axes[1].plot(run.t, run.qdot[:, 0])
    axes[1].plot(blows["t"], blows["speed_before"], "o", label="blows")
    axes[1].plot(blows["t"], [-it for it in SPEEDS], "x", label="specified")
    axes[1].set_ylabel("speed (m/s)")
    axes[1].set_xlabel("time (s)")
    axes[1].legend()
    figure.suptitle("A hammer: the gap, and the speed of each blow")
    figure.savefig(path, dpi=120)


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else None)
