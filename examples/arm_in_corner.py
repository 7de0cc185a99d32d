"""An arm with three links that comes to rest in a corner, on a floor and against a wall.

For the tip the floor and the wall are at right angles; for the arm, whose masses count, they are
not: an impact on one kicks the gap before the other. Two independent balls are no motion that this
arm can follow; a run of the arm is, through all its impacts. It is also brought there without a
reference, from anywhere near.

Run as ``python examples/arm_in_corner.py [out.png]``.
"""

import sys

import numpy as np

import zivi

LINKS, WIDTH, DEPTH, END = (0.5, 0.45, 0.3), 0.6, 0.3, 1.2
FORCES = {"floor": 10.0, "wall": 5.0}
FIRST = "l1**2*adot**2"
SECOND = f"({FIRST} + l2**2*(adot + bdot)**2 + 2*l1*l2*adot*(adot + bdot)*cos(b))"
THIRD = (
    f"({SECOND} + l3**2*(adot + bdot + cdot)**2"
    " + 2*l2*l3*(adot + bdot)*(adot + bdot + cdot)*cos(c)"
    " + 2*l1*l3*adot*(adot + bdot + cdot)*cos(b + c))"
)


def arm() -> zivi.symbolic.SymbolicSystem:
    """Give the arm: point masses at the ends of its links, torques at three joints."""
    l1, l2, l3 = LINKS
    x, y = "(l1*cos(a) + l2*cos(a + b))", "(l1*sin(a) + l2*sin(a + b))"
    tip = f"({x} + l3*cos(a + b + c))", f"({y} + l3*sin(a + b + c))"
    return zivi.symbolic.system(
        "a b c",
        T=f"m1*{FIRST}/2 + m2*{SECOND}/2 + m3*{THIRD}/2"
        " + i*(adot**2 + (adot + bdot)**2 + (adot + bdot + cdot)**2)/2",
        V=f"g*(m1*l1*sin(a) + m2*{y} + m3*{tip[1]})",
        gaps={"floor": f"{tip[1]} + depth", "wall": f"width - {tip[0]}"},
        parameters={"m1": 1.0, "m2": 0.8, "m3": 0.4, "i": 0.02, "g": 9.81}
        | {"l1": l1, "l2": l2, "l3": l3, "depth": DEPTH, "width": WIDTH},
        e=[0.6, 0.5],
        inputs={"first": [1, 0, 0], "second": [0, 1, 0], "third": [0, 0, 1]},
    )


def posture(direction: float, x: float, y: float) -> np.ndarray:
    """Give the angles with the tip at a place and the last link in a direction."""
    l1, l2, l3 = LINKS
    at = np.array([x - l3 * np.cos(direction), y - l3 * np.sin(direction)])
    b = -np.arccos((at @ at - l1**2 - l2**2) / (2 * l1 * l2))
    a = np.arctan2(at[1], at[0]) - np.arctan2(l2 * np.sin(b), l1 + l2 * np.cos(b))
    return np.array([a, b, direction - a - b])


def controller(system: zivi.symbolic.SymbolicSystem) -> zivi.GapTracker:
    """Give the controller: a tracker for each gap."""
    gains = {"floor": (40, 22), "wall": (40, 22)}
    return zivi.GapTracker(system, h=1e-3, gains=gains, force=FORCES)


def follow(direction: float = -0.6) -> zivi.MechanicalClosedLoop:
    """Follow a run of the arm into the corner, from beside it."""
    system, goal = arm(), posture(direction, WIDTH, -DEPTH)
    start = posture(direction, WIDTH - 0.08, -DEPTH + 0.15)
    reference = zivi.reference_run(
        system,
        (0, END),
        (start, np.zeros(3)),
        virtual={"floor": -9.81, "wall": -6.0},
        posture=goal,
    )
    beside = (start + np.array([0.03, -0.04, 0.02]), np.array([0.2, -0.3, 0.1]))
    return zivi.simulate_closed_loop(
        system,
        controller(system),
        (0, END),
        beside,
        reference=reference,
        method=zivi.RKPeriod(),
    )


def land(start: np.ndarray, direction: float = -0.6) -> zivi.MechanicalClosedLoop:
    """Bring it there from a posture, without a motion to follow."""
    system = arm()
    reference = {"floor": "rest", "wall": "rest", "posture": posture(direction, WIDTH, -DEPTH)}
    return zivi.simulate_closed_loop(
        system,
        controller(system),
        (0, 0.6),
        (start, np.zeros(3)),
        reference=reference,
        method=zivi.RKPeriod(),
    )


def at_rest_from(run: zivi.MechanicalClosedLoop) -> float:
    """Give the time from which both gaps stay closed."""
    return float(run.t[np.flatnonzero(~run.contacts.all(axis=1))[-1] + 1])


def main(path: str | None) -> None:
    """Print the numbers, and draw if a path is given."""
    goal = posture(-0.6, WIDTH, -DEPTH)
    split = zivi.mechanics.gap_coordinates(arm(), goal, np.zeros(3))
    print(f"kinetic cosine of floor and wall: {split.c[0, 1]:.3f}")
    run = follow()
    error = np.sqrt(np.mean(run.error_gaps[run.t > 0.3] ** 2, axis=0))
    print(f"{len(run.impacts)} impacts, both closed from {at_rest_from(run):.3f} s")
    print(f"errors of the gaps from 0.3 s on: {error[0]:.1e}, {error[1]:.1e} m")
    print("forces at the end:", run.reactions[-1].round(6), "N")
    landed = land(posture(-0.3, WIDTH - 0.2, -DEPTH + 0.1))
    print(f"without a reference, from 0.2 m beside: both closed from {at_rest_from(landed):.3f} s")
    if path is None:
        return
    import matplotlib.pyplot as plt

    plt.style.use("zivi.plot.figures")
    figure, axes = plt.subplots(2, 1, sharex=True, figsize=(7, 5), layout="constrained")
    axes[0].plot(run.t, 1e3 * run.gaps, label=run.gap_names)
    axes[0].set_ylabel("gap (mm)")
    axes[0].legend()
    axes[1].plot(run.t, run.reactions)
    axes[1].set_ylabel("contact force (N)")
    axes[1].set_xlabel("time (s)")
    figure.suptitle("An arm comes to rest in a corner and presses with 10 N and 5 N")
    figure.savefig(path, dpi=120)


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else None)
