"""A run that is continued from where it was cut has the lists of the whole: of drawn systems.

``python -m continued_runs 500`` in ``tests`` looks at as many.
"""

import sys
import warnings

import numpy as np

import zivi

METHOD = zivi.SwitchedRK(rtol=1e-9, atol=1e-9)
LISTS = ("zeno", "liftoffs", "openings")


def drawn(seed):
    """Give a system, its start, a span and a time within it."""
    rng = np.random.default_rng([5, seed])
    n, m = int(rng.integers(1, 4)), int(rng.integers(1, 3))
    mass, stiffness = (a @ a.T for a in rng.normal(size=(2, n, n)))
    mass += n * np.eye(n)
    stiffness *= rng.choice([0.0, 0.5, 3.0])
    damping, normals = 0.1 * rng.random(), rng.normal(size=(m, n))
    press = -(normals.T @ np.ones(m)) * rng.uniform(1, 8)
    shake, omega = rng.normal(size=n) * rng.choice([0, 5, 15]), rng.uniform(1, 6)
    is_rough = n > 1 and rng.random() < 0.5

    def friction():
        return {"tangent": rng.normal(size=n), "mu": rng.uniform(0.05, 0.8)} if is_rough else {}

    def force(t, q, w):
        return press + shake * np.cos(omega * t) - stiffness @ q - damping * w

    system = zivi.MechanicalSystem(
        mass=mass,
        force=force,
        gaps=[zivi.LinearGap(row, rng.uniform(0, 0.5), **friction()) for row in normals],
        e=float(rng.choice([0.0, rng.uniform(0.1, 0.8)])),
    )
    start = (np.zeros(n), rng.normal(size=n) * 0.5)
    return system, start, (0.0, 4.0), rng.uniform(0.8, 3.6)


def differences(seed):
    """Give what the lists of a continued run have otherwise than those of the whole, or nothing."""
    system, start, (t0, t1), cut = drawn(seed)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        whole = zivi.simulate(system, (t0, t1), start, METHOD)
        if not whole.success:
            return None
        first = zivi.simulate(system, (t0, cut), start, METHOD)
        then = zivi.simulate(system, (cut, t1), (first.q[-1], first.qdot[-1]), METHOD)
    # how many gaps come to rest on the way into a corner is decided by the tolerance
    ends = whole.corners["t"]
    found = []
    for name in LISTS:
        rows = [
            [
                (float(row["t"]), int(row["gap"]))
                for run in runs
                for row in getattr(run, name)
                if not len(ends) or np.abs(ends - row["t"]).min() > 1e-3
            ]
            for runs in ((whole,), (first, then))
        ]
        if [gap for _, gap in rows[0]] != [gap for _, gap in rows[1]] or any(
            abs(a - b) > 1e-5 for (a, _), (b, _) in zip(*rows, strict=True)
        ):
            found.append((name, *rows))
    return found


if __name__ == "__main__":
    for seed in range(int(sys.argv[1])):
        for name, whole, parts in differences(seed) or []:
            print(f"{seed}: {name}: {whole} whole, {parts} in two parts")
