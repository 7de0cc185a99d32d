r"""A leg of two closed halves under a trunk jumps on a floor.

Two thighs with springs hang from the trunk, which slides on a vertical rail, and two shanks meet
at the foot: ``Connect`` closes the chain of five bodies. The impact of the foot is plastic; the
springs then push the leg off the floor. While the motion is symmetric the leg has two coordinates,
the height ``z`` of the trunk and the angle ``theta`` of the thighs to the vertical, with

    T = 1/2 M z'^2 + B(theta) z' theta' + 1/2 A(theta) theta'^2,      foot  z - L(theta) >= 0

The numbers in brackets are from these equations, by DOP853 of SciPy with events.

Run as ``python examples/mechanics_leg.py [out.png]``.
"""

import sys

import numpy as np
from scipy.integrate import solve_ivp

import zivi
from zivi.mechanics import Body, Connect, PlaneGap

THIGH, SHANK, G = 0.25, 0.35, 9.81
TRUNK, THIGH_MASS, SHANK_MASS, STIFFNESS, REST = 3.0, 0.4, 0.3, 25.0, 0.55
HEIGHT, T = 0.62, 0.75


def shank_angle(theta: complex) -> complex:
    """Return the angle of the shanks to the vertical."""
    return np.arcsin(THIGH / SHANK * np.sin(theta))


def leg() -> zivi.Tree:
    """Return trunk, thighs and shanks; the hinges turn about the y axis."""

    def bar(
        name: str, parent: str, mass: float, length: float, place: float, **more: float
    ) -> Body:
        return Body(
            name,
            parent,
            axis=[0, 1, 0],
            position=[0, 0, -place],
            mass=mass,
            com=[0, 0, -length / 2],
            inertia=mass * length**2 / 12,
            **more,
        )

    bodies = [Body("trunk", kind="slide", axis=[0, 0, 1], mass=TRUNK)]
    for side, sign in (("left", 1), ("right", -1)):
        springs = {"stiffness": STIFFNESS, "spring": sign * REST}
        bodies += [
            bar(f"{side}.thigh", "trunk", THIGH_MASS, THIGH, 0.0, **springs),
            bar(f"{side}.shank", f"{side}.thigh", SHANK_MASS, SHANK, THIGH),
        ]
    foot = [0, 0, -SHANK]
    pin = Connect("left.shank", "right.shank", point=foot, other_point=foot)
    floor = PlaneGap("left.shank", point=foot, name="foot")
    return zivi.Tree(bodies, constraints=[pin], gaps=[floor], gravity=[0, 0, -G], e=0.0)


def jump() -> zivi.MechanicalTrajectory:
    """Let the leg fall with springs at rest."""
    knee = -REST - float(shank_angle(REST))
    start = [HEIGHT, REST, knee, -REST, -knee], np.zeros(5)
    return zivi.simulate(leg(), (0, T), start, zivi.SwitchedRK(rtol=1e-10, atol=1e-10))


def length(theta: complex) -> complex:
    """Return the depth of the foot below the hips."""
    return THIGH * np.cos(theta) + SHANK * np.cos(shank_angle(theta))


def coefficients(theta: complex) -> np.ndarray:
    """Return ``A``, ``B``, the potential energy but for that of ``z``, and ``L``."""
    s, c, psi = np.sin(theta), np.cos(theta), shank_angle(theta)
    turn = THIGH * c / (SHANK * np.cos(psi))
    # depths of the centres of mass and their slopes
    thigh, middle = THIGH * c / 2, THIGH * c + SHANK * np.cos(psi) / 2
    d_thigh, d_middle = -THIGH * s / 2, -THIGH * s - SHANK * np.sin(psi) * turn / 2
    of_thigh = THIGH_MASS * THIGH**2 / 3
    of_shank = SHANK_MASS * ((THIGH * c / 2) ** 2 + d_middle**2 + (SHANK * turn) ** 2 / 12)
    lift = -2 * (THIGH_MASS * d_thigh + SHANK_MASS * d_middle)
    weight = -2 * G * (THIGH_MASS * thigh + SHANK_MASS * middle)
    stored = STIFFNESS * (theta - REST) ** 2
    return np.array([2 * (of_thigh + of_shank), lift, weight + stored, length(theta)])


def accelerations(y: np.ndarray, stands: bool) -> tuple[np.ndarray, float]:
    """Return ``z''``, ``theta''`` and the force of the floor."""
    a, b, _, _ = coefficients(y[1])
    da, db, dv, dl = coefficients(y[1] + 1e-30j).imag / 1e-30
    mass = TRUNK + 2 * (THIGH_MASS + SHANK_MASS)
    rate, step = y[3], 1e-5
    bend = (coefficients(y[1] + step + 1e-30j) - coefficients(y[1] - step + 1e-30j)).imag[3]
    bend /= 2 * step * 1e-30
    matrix = np.array([[mass, b, -1.0], [b, a, dl], [1.0, -dl, 0.0]])
    right = np.array([-mass * G - db * rate**2, -da * rate**2 / 2 - dv, bend * rate**2])
    if not stands:
        return np.linalg.solve(matrix[:2, :2], right[:2]), 0.0
    found = np.linalg.solve(matrix, right)
    return found[:2], float(found[2])


def reference() -> tuple[float, float, float]:
    """Return when the foot lands and lifts off, and how high the trunk rises, by SciPy."""

    def fly(start: np.ndarray, t: float, stands: bool, event: str) -> tuple[float, np.ndarray]:
        def slopes(_: float, y: np.ndarray) -> np.ndarray:
            return np.array([*y[2:], *accelerations(y, stands)[0]])

        @zivi.event(terminal=True, direction=-1)
        def ends(t: float, y: np.ndarray) -> float:
            force = accelerations(y, stands)[1]
            return {"land": float(y[0] - length(y[1])), "lift": force, "top": y[2]}[event]

        settings = {"method": "DOP853", "rtol": 1e-12, "atol": 1e-13}
        sol = solve_ivp(slopes, (t, t + 5), start, events=ends, **settings)
        return float(sol.t[-1]), sol.y[:, -1]

    landed, y = fly(np.array([HEIGHT, REST, 0.0, 0.0]), 0.0, False, "land")
    # the plastic impact: the momentum along what the foot leaves free stays
    a, b, _, _ = coefficients(y[1])
    dl = coefficients(y[1] + 1e-30j).imag[3] / 1e-30
    mass = TRUNK + 2 * (THIGH_MASS + SHANK_MASS)
    momentum = dl * (mass * y[2] + b * y[3]) + b * y[2] + a * y[3]
    rate = momentum / (mass * dl**2 + 2 * b * dl + a)
    left, y = fly(np.array([*y[:2], dl * rate, rate]), landed, True, "lift")
    _, y = fly(y, left, False, "top")
    return landed, left, float(y[0])


def main(path: str | None) -> None:
    """Let the leg jump, print beside what is expected, and draw if a path is given."""
    sol = jump()
    print(repr(sol))
    landed, left, top = reference()
    print(f"the foot lands after {sol.impacts['t'][0]:.9f} s ({landed:.9f})")
    lifted = sol.liftoffs["t"][0]
    print(f"and lifts off after {lifted:.9f} s ({left:.9f})")
    heights = sol.resample(np.linspace(lifted, sol.t[-1], 20001)).q[:, 0]
    print(f"the trunk rises to {heights.max():.6f} m ({top:.6f})")
    print(f"the halves stay mirror images: {np.abs(sol.q[:, 1] + sol.q[:, 3]).max() < 1e-9}")
    if path is not None:
        draw(path, sol)


def draw(path: str, sol: zivi.MechanicalTrajectory) -> None:
    """Draw the leg at some times, trunk and foot over time, and the force of the floor."""
    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt

    plt.style.use("zivi.plot.figures")
    sizes = {"width_ratios": [2, 1, 1]}
    figure, axes = plt.subplots(1, 3, layout="constrained", figsize=(11, 3), gridspec_kw=sizes)
    for k, t in enumerate(np.linspace(0, T, 7)):
        z, theta = sol(t)[0][:2]
        knee = np.array([THIGH * np.sin(theta), z - THIGH * np.cos(theta)])
        foot = z - float(length(theta).real)
        x = 0.5 * k
        axes[0].plot(
            [x, x - knee[0], x, x + knee[0], x], [z, knee[1], foot, knee[1], z], "o-", ms=3
        )
    axes[0].axhline(0, color="0.5", lw=0.8)
    axes[0].set(xlabel="leg at seven times", ylabel="$z$ (m)", aspect="equal", xticks=[])
    fine = sol.resample(n=1201)
    axes[1].plot(fine.t, fine.q[:, 0], label="trunk")
    axes[1].plot(fine.t, fine.gaps[:, 0], label="foot")
    axes[1].set(xlabel="time $t$ (s)", ylabel="height (m)")
    axes[1].legend(fontsize=8)
    axes[2].plot(fine.t, fine.reactions[:, 0])
    axes[2].set(xlabel="time $t$ (s)", ylabel="force of the floor (N)")
    figure.suptitle("A leg of two closed halves: fall, jump and touchdown")
    figure.savefig(path, dpi=160)


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else None)
