r"""A percussive drill: a hammer that strikes a bit, once in a period.

The hammer is driven by ``F cos(omega t)`` on a spring; the bit rests on the rock, a spring and a
damper that take up the blows. With one impact a period the impulse P has a closed form: the motion
is the sum of the forced response and the periodic response to the impulses,

    F^2 R^2 = (d + P h0)^2 + (P c/omega)^2,

with R the amplitude of the gap for a load of 1, h0 and c sums over the modes of the free motion.
The branch over the frequency tells where the drill strikes once, how hard, and where that is
stable; the power that it gives to the rock is largest in between.

Run as ``python examples/mechanics_drill.py [out.png]``.
"""

import sys

import numpy as np

import zivi

M, C, K = np.diag([1.0, 0.4]), np.diag([0.1, 0.9]), np.diag([1.0, 4.0])
NORMAL, D, E, F = np.array([-1.0, 1.0]), 0.2, 0.6, 0.5
SPAN = (1.35, 2.4)


def drill(omega: float) -> zivi.LinearSystem:
    """Give hammer and bit."""
    return zivi.LinearSystem(
        M,
        C,
        K,
        excitation=zivi.Harmonic([F, 0.0], omega),
        gaps=[zivi.LinearGap(NORMAL, D, name="bit")],
        e=E,
        coordinates=["hammer", "bit"],
    )


def impulse(omega: float) -> float:
    """Give the impulse of one impact a period, the larger one, by the closed form."""
    R = abs(NORMAL @ np.linalg.solve(K - omega**2 * M + 1j * omega * C, [F, 0.0]))
    whole = np.block([[np.zeros((2, 2)), np.eye(2)], [-np.linalg.solve(M, np.hstack([K, C]))]])
    rates, modes = np.linalg.eig(whole)
    push = np.linalg.solve(modes, np.append([0.0, 0.0], np.linalg.solve(M, NORMAL)))
    growth = np.exp(2 * np.pi / omega * rates)
    felt = (NORMAL @ modes[:2]) * push * growth / (1 - growth)
    h0, rate = felt.sum().real, (rates * felt).sum().real
    c = rate + NORMAL @ np.linalg.solve(M, NORMAL) / (1 + E)
    # (h0^2 + c^2/omega^2) P^2 + 2 d h0 P + d^2 - R^2 = 0
    square = h0**2 + (c / omega) ** 2
    return float((-D * h0 + np.sqrt((D * h0) ** 2 - square * (D**2 - R**2))) / square)


def strokes() -> zivi.MechanicalBranch:
    """Follow the orbit with one impact a period over the frequency."""
    system = drill(1.6)
    period = 2 * np.pi / 1.6
    run = zivi.simulate(system, (0, 100 * period), ([0.0, 0.0], [0.0, 0.0]))
    orbit = zivi.periodic_orbit(system, run)
    return zivi.continue_orbit(orbit, "omega", SPAN, step=0.02)


def power(orbit: zivi.MechanicalOrbit) -> float:
    """Give what the damper of the rock takes up, on average."""
    states, after = orbit.trajectory, (np.arange(400) + 0.5) / 400 * orbit.period
    start = states.t[0]  # of the period; the speed jumps at the blow, between two samples
    t = start + (orbit.impacts["t"][0] - start + after) % orbit.period
    speeds = np.array([states(it)[1, 1] for it in t])
    return float(C[1, 1] * np.mean(speeds**2))


def main(path: str = "drill.png") -> None:
    """Compare with the closed form and draw."""
    branch = strokes()
    single = next(arc for arc in branch.arcs if len(arc.word) == 1)
    for k in (len(single) // 4, len(single) // 2, 3 * len(single) // 4):
        omega, own = single.values[k], single.orbits[k].impacts["impulse"][0]
        print(f"impulse {own:.9f} ({impulse(omega):.9f}) at omega {omega:.3f}")
    print(f"words {branch.words}, {branch}")

    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    plt.style.use("zivi.plot.figures")
    fig, (left, right) = plt.subplots(1, 2, figsize=(9.0, 3.8), layout="constrained")
    zivi.plot.branch(branch, "u", ax=left)
    left.set(
        title="Speed of the gap after the blow",
        xlabel=r"frequency $\omega$ (1)",
        ylabel="speed of the gap after the impact (1)",
    )
    stable = [orbit.stable for orbit in single.orbits]
    given = np.array([power(orbit) for orbit in single.orbits])
    right.plot(single.values, np.where(stable, given, np.nan), label="stable")
    right.plot(single.values, given, ":", color="0.5", zorder=0, label="one blow a period")
    right.set(title="Power into the rock", xlabel=r"frequency $\omega$ (1)", ylabel="power (1)")
    right.legend()
    fig.savefig(path, dpi=150)


if __name__ == "__main__":
    main(*sys.argv[1:])
