r"""A puck slides on a slope: its path turns into the line of fall, and it stops.

With the acceleration ``a`` along the line of fall and the friction ``b > a``, the speed ``v`` and
its angle ``phi`` to the line of fall obey

    v' = a cos(phi) - b,      v phi' = -a sin(phi)

so that ``b v + a v cos(phi)`` falls uniformly, and ``v sin(phi)`` is proportional to ``u^p`` with
``u = tan(phi/2)``, ``p = b/a``. The numbers in brackets are these closed forms: when and where the
puck stops. The angle ends at zero like a power of the time that is left, here 0.5, 1 and 4.

Run as ``python examples/mechanics_puck.py [out.png]``.
"""

import sys

import numpy as np

import zivi

FALL, SPEED, ANGLE = 2.0, 3.0, 2.2
FRICTIONS = {6.0: "b = 3 a", 4.0: "b = 2 a", 2.5: "b = 1.25 a"}


def slide(friction: float) -> zivi.MechanicalTrajectory:
    """Push the puck upwards and across; the weight on the slope is 1 N."""
    slope = zivi.LinearGap([0, 0, 1], tangent=[[1, 0, 0], [0, 1, 0]], mu=friction, name="slope")
    puck = zivi.MechanicalSystem(
        mass=np.eye(3), force=[FALL, 0.0, -1.0], gaps=[slope], coordinates=["x", "y", "z"]
    )
    start = np.zeros(3), [SPEED * np.cos(ANGLE), SPEED * np.sin(ANGLE), 0.0]
    return zivi.simulate(puck, (0, 8), start, zivi.SwitchedRK(rtol=1e-11, atol=1e-11))


def stop(friction: float) -> tuple[float, float, float]:
    """Return when (s) and where (m) the puck stops."""
    a, b, p, u = FALL, friction, friction / FALL, np.tan(ANGLE / 2)
    t = SPEED * (b + a * np.cos(ANGLE)) / (b * b - a * a)
    c = (SPEED * np.sin(ANGLE) * u**-p) ** 2
    x = c / (4 * a) * (u ** (2 * p - 2) / (2 * p - 2) - u ** (2 * p + 2) / (2 * p + 2))
    y = c / (2 * a) * (u ** (2 * p - 1) / (2 * p - 1) + u ** (2 * p + 1) / (2 * p + 1))
    return float(t), float(x), float(y)


def main(path: str | None) -> None:
    """Let the pucks slide, print beside what is expected, and draw if a path is given."""
    runs = {friction: slide(friction) for friction in FRICTIONS}
    for friction, sol in runs.items():
        t, x, y = stop(friction)
        print(repr(sol))
        stopped = sol.transitions["t"][sol.transitions["after"] == 0][0]
        print(f"{FRICTIONS[friction]}: stops after {stopped:.10f} s ({t:.10f})")
        print(f"{-sol.q[-1, 0]:.10f} m ({-x:.10f}) up the slope")
        print(f"{sol.q[-1, 1]:.10f} m ({y:.10f}) across")
        print(f"slip at rest: {np.abs(sol.slips[-1]).max()} m/s")
    if path is not None:
        draw(path, runs)


def draw(path: str, runs: dict[float, zivi.MechanicalTrajectory]) -> None:
    """Draw the paths, the speeds, and the angles over the time that is left."""
    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt

    plt.style.use("zivi.plot.figures")
    figure, axes = plt.subplots(1, 3, layout="constrained", figsize=(10.4, 3.4))
    for friction, sol in runs.items():
        end = stop(friction)[0]
        left = np.geomspace(end, 1e-6, 400)
        fine = sol.resample(np.sort(end - left))
        name = FRICTIONS[friction]
        axes[0].plot(fine.q[:, 1], -fine.q[:, 0], label=name)
        axes[1].plot(fine.t, np.hypot(*fine.qdot[:, :2].T))
        angle = np.degrees(np.arctan2(fine.qdot[:, 1], fine.qdot[:, 0]))
        axes[2].loglog(end - fine.t, angle)
    axes[0].set(xlabel="across (m)", ylabel="up the slope (m)", ylim=(-0.3, None))
    axes[0].legend(fontsize=8, loc="lower center")
    axes[1].set(xlabel="time $t$ (s)", ylabel="slip speed (m/s)")
    axes[2].set(
        xlabel="time that is left (s)",
        ylabel="angle to the line of fall (degrees)",
        ylim=(1e-4, 300),
    )
    figure.suptitle("Pucks on a slope: paths, speeds, and angles to the line of fall")
    figure.savefig(path, dpi=160)


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else None)
