r"""The orbits of a pair of gears: in contact, rattling, and where one ends.

Seen from the mean rotation, the first wheel hangs on a shaft of stiffness k and is driven by
``F cos(omega t)``, the second one is braked by a load L; between their teeth there is a backlash.
In contact both move as one, and the teeth press with ``L + Re(Z F e^(i omega t))``,

    Z = (-J2 omega^2 + i c2 omega) / (k - (J1 + J2) omega^2 + i (c1 + c2) omega),

so that the orbit in contact ends at ``F = L/|Z|``. The branch of that orbit finds its end by the
force of the contact, and goes on: the teeth part, hit and come to rest again in every period, with
larger forces they hit the back of the gap on the way, where the branch is unstable for a while.
Both events have curves over the frequency; that of the end follows the formula, above the
resonance. Runs over the force settle on the branch where it is stable.

Run as ``python examples/mechanics_gear_orbits.py [out.png]``.
"""

import sys

import numpy as np

import zivi

J, C, K, L, BACKLASH, E = np.array([1.0, 1.5]), np.array([0.2, 0.3]), 4.0, 0.5, 0.2, 0.5
OMEGA = 2.0
SPANS = ((0.05, 1.6), (0.9, 3.0))


def gears(force: float, omega: float = OMEGA) -> zivi.LinearSystem:
    """Give both wheels."""
    loads: list[np.ndarray | zivi.Harmonic] = [
        np.array([0.0, -L]),
        zivi.Harmonic([force, 0.0], omega),
    ]
    return zivi.LinearSystem(
        np.diag(J),
        np.diag(C),
        np.diag([K, 0.0]),
        excitation=loads,
        gaps=[
            zivi.LinearGap([-1.0, 1.0], 0.0, name="front"),
            zivi.LinearGap([1.0, -1.0], BACKLASH, name="back"),
        ],
        e=E,
    )


def silent(omega: np.ndarray | float) -> np.ndarray | float:
    """Give the largest force at which the teeth never part."""
    Z = (-J[1] * omega**2 + 1j * C[1] * omega) / (K - J.sum() * omega**2 + 1j * C.sum() * omega)
    return L / np.abs(Z)


def settled(force: float, periods: int = 150) -> zivi.MechanicalOrbit:
    """Let the gears go at rest in contact, and find what they settle on."""
    system, at = gears(force), -L / K
    end = periods * 2 * np.pi / OMEGA
    run = zivi.simulate(system, (0, end), ([at, at], [0.0, 0.0]))
    return zivi.periodic_orbit(system, run)


def branch_of(least: float = 0.15, most: float = 1.55) -> zivi.MechanicalBranch:
    """Follow the orbit in contact, and beyond its end."""
    return zivi.continue_orbit(settled(0.3), "F", (least, most), step=0.1)


def rattling(values: np.ndarray) -> zivi.Diagram:
    """Let the gears settle at each force: speeds after impacts on the front of the teeth."""
    at = -L / K
    starts = np.array([[at, at], [0.1, 0.0]])
    return zivi.bifurcation_diagram(
        gears(1.0), "F", values, starts=starts, gap="front", transient=60, keep=12
    )


def fastest(orbit: zivi.MechanicalOrbit) -> float:
    """Give the speed after the fastest impact on the front of the teeth."""
    return max(orbit.impacts["u"][orbit.impacts["gap"] == 0], default=0.0)


def main(path: str = "gear_orbits.png") -> None:
    """Compare with the formula and draw."""
    branch = branch_of()
    print(" | ".join(branch.words))
    event = branch.of_kind("contact_ends")[0]
    print(f"the contact ends at F = {event.value:.9f} ({silent(OMEGA):.9f})")
    touch = branch.of_kind("interior_impact")[0]
    print(f"the back of the teeth is hit from F = {touch.value:.9f} on")
    ends, hits = (
        zivi.continue_curve(it, ("F", "omega"), SPANS, step=0.1, max_points=80)
        for it in (event, touch)
    )
    force, omega = ends.values.T
    least = int(np.argmin(force))
    print(f"lowest F {force[least]:.9f} ({silent(omega[least]):.9f}), omega {omega[least]:.3f}")
    print(f"over omega {omega.min():.2f} .. {omega.max():.2f}")

    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    plt.style.use("zivi.plot.figures")
    fig, (left, right) = plt.subplots(1, 2, figsize=(10.0, 4.0), layout="constrained")
    zivi.plot.diagram(rattling(np.linspace(0.16, 1.54, 47)), ax=left, ms=2.5)
    # dashed where the orbit is unstable
    for arc, colour in zip(branch.arcs, ("black", zivi.plot.BLUE, zivi.plot.ORANGE), strict=True):
        speeds = np.array([fastest(it) for it in arc.orbits])
        stable = np.array([it.stable for it in arc.orbits])
        name = "in contact" if arc.word == ("P",) else " ".join(arc.word)
        left.plot(arc.values, speeds, "--", lw=0.9, color=colour)
        left.plot(arc.values, np.where(stable, speeds, np.nan), color=colour, label=name)
    left.legend(loc="upper left", bbox_to_anchor=(1, 1))
    left.set(xlabel="load amplitude $F$ (1)", ylabel="speed (1)")
    left.set_title("Speeds after impacts of the front")
    zivi.plot.chart([ends, hits], ax=right)
    right.set(xlabel="load amplitude $F$ (1)", ylabel=r"frequency $\omega$ (1)")
    right.set_title("Contact ends, the back is hit")
    fig.savefig(path, dpi=150)


if __name__ == "__main__":
    main(*sys.argv[1:])
