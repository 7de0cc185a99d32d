"""An arm with two links whose tip taps a table like a ball, rests, presses it, and lifts off.

The reference is a run of the arm: its tip falls freely onto the table and comes to rest through
infinitely many impacts, the arm goes on swinging in contact, and at 1.6 s the tip is pulled up. The
controller follows it from beside, with the contact force that is asked for.

Run as ``python examples/arm_on_table.py [out.png]``.
"""

import sys

import numpy as np

import zivi

START = np.array([0.5, -1.2])
FORCE, LIFT, END = 10.0, 1.6, 2.0


def arm() -> zivi.symbolic.SymbolicSystem:
    """Give the arm: point masses at the elbow and at the tip, torques at both joints."""
    return zivi.symbolic.system(
        "a b",
        T="m1*l1**2*adot**2/2 + m2*(l1**2*adot**2 + l2**2*(adot + bdot)**2"
        " + 2*l1*l2*adot*(adot + bdot)*cos(b))/2",
        V="m1*g*l1*sin(a) + m2*g*(l1*sin(a) + l2*sin(a + b))",
        gaps={"table": "l1*sin(a) + l2*sin(a + b) + depth"},
        parameters={"m1": 1.0, "m2": 0.8, "l1": 0.5, "l2": 0.45, "g": 9.81, "depth": 0.3},
        e=0.6,
        inputs={"shoulder": [1, 0], "elbow": [0, 1]},
    )


def posture(t: float) -> np.ndarray:
    """Give what the arm does beside its tip: it swings."""
    s, c = np.sin(2 * t), np.cos(2 * t)
    return np.array([[0.4 + 0.2 * s, -1.2 - 0.2 * s], [0.4 * c, -0.4 * c], [-0.8 * s, 0.8 * s]])


def reference(system: zivi.MechanicalSystem) -> zivi.MechanicalTrajectory:
    """Give the motion that is to be followed."""
    return zivi.reference_run(
        system,
        (0, END),
        (START, np.zeros(2)),
        virtual={"table": lambda t: -9.81 if t < LIFT else 5.0},
        posture=posture,
        tstops=[LIFT],
    )


def follow(system: zivi.symbolic.SymbolicSystem, **believed: float) -> zivi.MechanicalClosedLoop:
    """Follow it, with a model whose parameters may be others."""
    controller = zivi.GapTracker(
        system.replace(**believed), h=1e-3, gains={"table": (40, 22)}, force={"table": FORCE}
    )
    return zivi.simulate_closed_loop(
        system,
        controller,
        (0, END),
        (START + np.array([0.03, -0.02]), np.array([0.1, -0.1])),
        reference=reference(system),
        method=zivi.RKPeriod(),
    )


def main(path: str | None) -> None:
    """Print the numbers, and draw if a path is given."""
    system = arm()
    run = follow(system)
    bouncing = (run.t > 0.4) & (run.t < 0.9)
    error = np.sqrt(np.mean(run.error_gaps[bouncing] ** 2))
    pressed = run.reactions[(run.t > 1.2) & (run.t < LIFT - 0.01), 0]
    print(f"{len(run.impacts)} impacts, at rest on the table from {run.zeno.t[-1]:.3f} s")
    print(f"error of the gap while it bounces: {error:.1e} m")
    print(f"contact force: {pressed.min():.4f} to {pressed.max():.4f} N of {FORCE}")
    print(f"lifts off at {run.liftoffs.t[0]:.3f} s")
    heavy = follow(system, m1=1.2, m2=0.96)
    held = heavy.reactions[(heavy.t > 1.2) & (heavy.t < LIFT - 0.01), 0]
    print(f"with masses that are 20 % too large: {held.min():.2f} to {held.max():.2f} N, at rest")
    if path is None:
        return
    import matplotlib.pyplot as plt

    plt.style.use("zivi.plot.figures")
    figure, axes = plt.subplots(3, 1, sharex=True, figsize=(7, 6), layout="constrained")
    axes[0].plot(run.t, 1e3 * run.gaps[:, 0])
    axes[0].set_ylabel("gap (mm)")
    axes[1].plot(run.t, run.reactions[:, 0])
    axes[1].set_ylabel("contact force (N)")
    axes[2].plot(run.t, run.u, label=run.control_names)
    axes[2].set_ylabel("torque (Nm)")
    axes[2].set_xlabel("time (s)")
    axes[2].legend()
    figure.suptitle("An arm taps a table, rests, presses with 10 N and lifts off")
    figure.savefig(path, dpi=120)


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else None)
