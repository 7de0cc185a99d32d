r"""The chart of a two-mass impact oscillator: where its orbits fold, double, turn and graze.

Two masses on springs, the second one driven by ``F sin(omega t)``, the first one before a stop.
One call follows the orbit with one impact a period over the frequency; its events are followed in
frequency and force, each by its own equations, and where two of them meet is found on the way:

* the orbit without impacts grazes where ``F = d/R``, R being its amplitude for a load of 1;
* folds touch that curve where the push of an impact is not felt a period later (``h0 = 0``);
* a pair of multipliers turns on the unit circle, up to -1, -1 (``1:2``), where doublings begin;
* a doubling curve reaches the edge of its word, where the impact grazes.

In brackets: computations with 30 digits, of impulses and modal sums, without a line of zivi.

Run as ``python examples/mechanics_chart.py [out.png]``.
"""

import sys

import numpy as np

import zivi

GAP, E = 0.3, 0.8
SPANS = ((0.75, 1.6), (0.05, 2.2))
NAMES = ("omega", "F")
THIRD = (1.50509723238, 2.08626604436)
HALF = (1.3054363557, 0.7195399822)
EDGE = (1.1558374211, 0.6022638913)
TOUCH = (1.27808291811, 0.69408336153)
FOLD = 0.38049430326


def oscillator(omega: float = 1.4, force: float = 1.0) -> zivi.LinearSystem:
    """Give both masses and the stop."""
    return zivi.LinearSystem(
        np.diag([1.0, 1.5]),
        [[0.1, -0.05], [-0.05, 0.1]],
        [[3.0, -2.0], [-2.0, 2.0]],
        excitation=zivi.Harmonic([0.0, force], omega, -np.pi / 2),
        gaps=[zivi.LinearGap([-1.0, 0.0], GAP, name="stop")],
        e=E,
    )


def over_frequency() -> zivi.MechanicalBranch:
    """Follow the orbit with one impact a period."""
    orbit = zivi.periodic_orbit(oscillator(), (["I stop"], [3.0]))
    return zivi.continue_orbit(orbit, "omega", (1.15, 1.6), step=0.05)


def over_force() -> zivi.MechanicalBranch:
    """Follow it over the force, beside a fold."""
    system = oscillator(1.1, 0.45)
    starts = [zivi.periodic_orbit(system, (["I stop"], [t])) for t in (0.5, 2.0, 3.6, 5.1)]
    orbit = next(it for it in starts if it.success)
    return zivi.continue_orbit(orbit, "F", (0.3, 0.6), step=0.05)


def curves() -> list[zivi.EventCurve]:
    """Follow the events of both."""
    one, other = over_frequency(), over_force()
    events = [
        other.of_kind("fold")[0],
        other.of_kind("grazing")[0],
        one.of_kind("period_doubling")[-1],
        one.of_kind("neimark_sacker")[0],
    ]
    events.append(one.of_kind("period_doubling")[0])
    return [zivi.continue_curve(event, NAMES, SPANS, step=0.03) for event in events]


def main(path: str = "chart.png") -> None:
    """Compare with the references and draw."""
    found = curves()
    points = [point for curve in found for point in curve.points]
    known = [("1:3", "resonance_1_3", THIRD), ("1:2", "resonance_1_2", HALF)]
    known += [("folds touch grazings", "resonant_grazing", TOUCH)]
    known += [("a doubling grazes", "grazing", EDGE)]
    for name, kind, (omega, force) in known:
        own = [it.values for it in points if it.kind == kind]
        w, f = min(own, key=lambda it: abs(it[0] - omega) + abs(it[1] - force))
        print(f"{name}: omega {w:.9f} ({omega:.9f})")
        print(f"{name}: F {f:.9f} ({force:.9f})")
    fold = over_force().of_kind("fold")[0].value
    print(f"fold at omega = 1.1: {fold:.9f} ({FOLD:.9f})")

    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    plt.style.use("zivi.plot.figures")
    fig, ax = plt.subplots(figsize=(7.0, 4.6), layout="constrained")
    zivi.plot.chart(found, ax=ax)
    ax.set(xlim=SPANS[0], ylim=SPANS[1], xlabel=r"frequency $\omega$ (1)")
    ax.set_ylabel("load amplitude $F$ (1)")
    fig.suptitle("Two masses and a stop: bifurcations in two parameters")
    fig.savefig(path, dpi=150)


if __name__ == "__main__":
    main(*sys.argv[1:])
