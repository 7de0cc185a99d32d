"""How far derivatives reach: random oscillators moved by parts of their radius.

Of random oscillators at a wall the radius of each derivative (by the initial state, e and the
amplitude) is taken; the run is repeated with the parameter moved by 0.3 and 0.8 of it to both
sides. Kept means: as many impacts, Zeno points and lift-offs as before. The radius is an estimate
of first order, so not all are.

    python benchmarks/sensitivity_radius.py [oscillators] [seed]
"""

from __future__ import annotations

import sys

import numpy as np

import zivi

NAMES = ("x0", "xdot0", "e", "amplitude")
PARTS = (0.3, 0.8)
METHOD = zivi.SwitchedRK(rtol=1e-9, atol=1e-11)


def draw(rng: np.random.Generator) -> tuple[zivi.LinearForce, float, tuple[float, float]]:
    """Draw an oscillator, its e, and where it starts."""
    force = zivi.LinearForce(
        stiffness=1.0,
        damping=rng.uniform(0.02, 0.3),
        gravity=rng.uniform(-1.0, 0.5),
        amplitude=rng.uniform(0.3, 2.0),
        omega=rng.uniform(0.6, 3.0),
        phase=rng.uniform(0.0, 2.0 * np.pi),
    )
    return force, rng.uniform(0.4, 0.9), (rng.uniform(0.2, 3.0), rng.uniform(-1.0, 1.0))


def counts(run: zivi.Trajectory) -> tuple[int, int, int]:
    """Count impacts, Zeno points and lift-offs.

    Impacts after which the mass rests are infinitely many: those before each Zeno point are left
    out from the first of its chain on, whose number depends on how it is followed.
    """
    impacts = run.impacts["t"][run.impacts["xdot_after"] > 1e-3]
    return len(impacts), len(run.zeno_times), len(run.liftoff_times)


def kept(rng: np.random.Generator) -> dict[float, list[bool]]:
    """Tell of one oscillator for each part which moves keep its events."""
    force, e, start = draw(rng)
    span = (0.0, 20.0)
    found: dict[float, list[bool]] = {part: [] for part in PARTS}
    s = zivi.sensitivity(zivi.ImpactSystem(force, e=e), span, start, NAMES, METHOD)
    given = {"x0": start[0], "xdot0": start[1], "e": e, "amplitude": force.amplitude}
    if not s.success:
        return found
    for name, radius in zip(NAMES, s.radius, strict=True):
        for part in PARTS:
            for side in (1.0, -1.0):
                moved = given | {name: given[name] + side * part * radius}
                if not np.isfinite(radius) or not 0.0 <= moved["e"] < 1.0 or moved["x0"] < 0.0:
                    continue
                other = zivi.LinearForce(**(vars(force) | {"amplitude": moved["amplitude"]}))
                run = zivi.simulate(
                    zivi.ImpactSystem(other, e=moved["e"]),
                    span,
                    (moved["x0"], moved["xdot0"]),
                    METHOD,
                    dense_output=False,
                )
                found[part].append(counts(run)[1:] == counts(s.trajectory)[1:])
                if not len(run.zeno_times):
                    same = len(run.impacts) == len(s.trajectory.impacts)
                    found[part][-1] = found[part][-1] and same
    return found


def sweep(oscillators: int, seed: int) -> dict[float, list[bool]]:
    """Collect what `kept` tells of so many oscillators."""
    rng = np.random.default_rng(seed)
    told: dict[float, list[bool]] = {part: [] for part in PARTS}
    for _ in range(oscillators):
        for part, values in kept(rng).items():
            told[part] += values
    return told


def main() -> None:
    """Print how many moves keep the events."""
    given = [int(it) for it in sys.argv[1:3]]
    oscillators, seed = (given + [60, 1][len(given) :])[:2]
    for part, values in sweep(oscillators, seed).items():
        share = np.mean(values)
        print(f"{part:g} of the radius: {sum(values)} of {len(values)} kept ({share:.1%})")


if __name__ == "__main__":
    main()
