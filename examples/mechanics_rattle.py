r"""An impact pair and a gear that rattles: two gaps that face each other.

**The impact pair.** A mass is free between two walls at the distance L that move together as ``A
sin(omega t)``. In the motion that hits each wall once a period it crosses with the velocity v in
half a period. At an impact with phase p, ``-v = (1 + e) A omega cos p - e v``, and half a period
later the wall is on the other side, so

    v = -(1 + e)/(1 - e) A omega cos p,        L + 2 A sin p = pi v/omega

two equations for v and p (Bapat, Popplewell and McLachlan 1983 treat the general case). The run
starts elsewhere and settles there.

**The gear.** Two wheels with backlash, one driven with a torque that fluctuates, one braked:
their teeth hit, bounce to rest, stay together and part again as the torque changes its sign. In
brackets: a computation with 26 digits.

Run as ``python examples/mechanics_rattle.py [out.png]``.
"""

import math
import sys

import numpy as np

import zivi

A, OMEGA, L, E = 0.1, 4.0, 0.5, 0.5
SILENT = (0.20051144388740, 1.39916166160840)
PARTED = (0.56936857523645, 1.61654183216906)


def pair() -> zivi.MechanicalSystem:
    """Give a mass between two walls that move together."""
    left = zivi.HarmonicWall(A, OMEGA, phase=-math.pi / 2)  # A sin(omega t)
    right = zivi.HarmonicWall(-A, OMEGA, phase=-math.pi / 2)
    return zivi.MechanicalSystem(
        mass=1.0,
        force=[0.0],
        gaps=[
            zivi.LinearGap([1], motion=left, name="left"),
            zivi.LinearGap([-1], L, motion=right, name="right"),
        ],
        e=E,
        coordinates=["x"],
    )


def settled() -> tuple[float, float]:
    """Give speed and phase of the periodic motion with two impacts, by its two equations."""
    gain = math.pi * (1 + E) / (1 - E)
    # L + 2 A sin p + gain A cos p = 0
    size, turn = math.hypot(2 * A, gain * A), math.atan2(2, gain)
    phase = turn + math.acos(-L / size)
    return (1 + E) / (1 - E) * A * OMEGA * -math.cos(phase), phase


def rattle(end: float = 80.0) -> zivi.MechanicalTrajectory:
    """Let the mass go in the middle."""
    method = zivi.SwitchedRK(rtol=1e-10, atol=1e-12)
    return zivi.simulate(pair(), (0, end), ([0.2], [0.5]), method)


def gear() -> zivi.MechanicalSystem:
    """Derive and compile the two wheels."""
    return zivi.symbolic.system(
        "a b",
        T="J1*adot**2/2 + J2*bdot**2/2",
        Q=["T0 + T1*sin(om*t) - c1*adot", "-TL - c2*bdot"],
        gaps={"front": "bl/2 + a - b", "back": "bl/2 - a + b"},
        parameters={"J1": 1.0, "J2": 1.5, "bl": 0.05, "T0": 0.5, "T1": 3.0, "om": 6.0}
        | {"c1": 0.1, "c2": 0.3, "TL": 0.4},
        e=0.3,
    )


def drive() -> zivi.MechanicalTrajectory:
    """Drive the wheels for 4 s."""
    method = zivi.SwitchedRK(rtol=1e-10, atol=1e-10)
    return zivi.simulate(gear(), (0, 4), ([0.0, 0.0], [0.2, 0.0]), method)


def main(path: str | None) -> None:
    """Measure, print beside what is expected, and draw if a path is given."""
    sol = rattle()
    print(repr(sol))
    speed, phase = settled()
    last = sol.impacts[sol.impacts["gap"] == 1][-1]
    velocity = sol(float(last["t"]))[1, 0]
    print(f"the pair settles to the speed {abs(velocity):.7f} m/s ({speed:.7f})")
    found = (OMEGA * last["t"]) % (2 * math.pi)
    print(f"and hits the right wall at the phase {found:.7f} ({phase % (2 * math.pi):.7f})")
    wheels = drive()
    print(repr(wheels))
    for k in range(2):
        print(f"the teeth stay together from {wheels.zeno['t'][k]:.9f} s ({SILENT[k]:.9f})")
        print(f"until {wheels.liftoffs['t'][k]:.9f} s ({PARTED[k]:.9f})")
    if path is not None:
        draw(path, sol, wheels)


def draw(path: str, mass: zivi.MechanicalTrajectory, wheels: zivi.MechanicalTrajectory) -> None:
    """Draw the mass between its walls, and the backlash of the wheels."""
    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt

    plt.style.use("zivi.plot.figures")
    figure, (left, right) = plt.subplots(1, 2, layout="constrained", figsize=(9.6, 3.4))
    t = np.linspace(0, 12, 1200)
    wall = A * np.sin(OMEGA * t)
    left.plot(t, mass(t)[0, :, 0], color=zivi.plot.BLUE)
    left.plot(t, wall, color="0.5")
    left.plot(t, L + wall, color="0.5")
    left.set(xlabel="time $t$ (s)", ylabel="position (m)", title="impact pair")
    zivi.plot.gaps(wheels, right)
    right.set(xlabel="time $t$ (s)", ylabel="gaps of the teeth (rad)", title="gear rattle")
    figure.savefig(path, dpi=160)


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else None)
