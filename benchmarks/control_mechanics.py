"""Control of mechanical systems: the tables of robustness, of coupled gaps and of aimed impacts.

python benchmarks/control_mechanics.py [table] [--runs 20]: arm, faults, follow, land, strike
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any

import numpy as np

import zivi
import zivi.mechanics

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
from mechanical_arms import START, bouncing_error, follow, tapping, tracker, two_links
from robust_arms import ROWS, posture_error, robust

H = 1e-3
LINKS = (
    "0.5*cos(a)",
    "0.5*sin(a)",
    "0.5*cos(a) + 0.45*cos(a + b)",
    "0.5*sin(a) + 0.45*sin(a + b)",
    "0.5*cos(a) + 0.45*cos(a + b) + 0.3*cos(a + b + c)",
    "0.5*sin(a) + 0.45*sin(a + b) + 0.3*sin(a + b + c)",
)


def three_links() -> zivi.symbolic.SymbolicSystem:
    """Give an arm whose tip is between a floor and a wall on the right."""
    import sympy

    a, b, c, da, db, dc = sympy.symbols("a b c adot bdot cdot")
    angles, rates = (a, b, c), (da, db, dc)
    at = [sympy.sympify(it) for it in LINKS]

    def speed(x: Any) -> Any:
        return sum(x.diff(q) * w for q, w in zip(angles, rates, strict=True))

    kinetic, height = sympy.Integer(0), sympy.Integer(0)
    for k, mass in enumerate((1.0, 0.8, 0.4)):
        x, y = at[2 * k], at[2 * k + 1]
        turn = sum(rates[: k + 1])
        kinetic += mass * (speed(x) ** 2 + speed(y) ** 2) / 2 + 0.02 * turn**2 / 2
        height += mass * y
    floor, wall = at[5] + sympy.Symbol("depth"), sympy.Symbol("width") - at[4]
    return zivi.symbolic.system(
        "a b c",
        T=sympy.expand(kinetic),
        V=9.81 * height,
        gaps={"floor": floor, "wall": wall},
        parameters={"depth": 0.3, "width": 0.6},
        e=[0.6, 0.5],
        inputs={"first": [1, 0, 0], "second": [0, 1, 0], "third": [0, 0, 1]},
    )


def posture(phi: float, x: float, y: float) -> np.ndarray:
    """Give the angles with the tip at a place and the last link in a direction."""
    at = np.array([x - 0.3 * np.cos(phi), y - 0.3 * np.sin(phi)])
    far = np.hypot(*at)
    b = -np.arccos((far**2 - 0.5**2 - 0.45**2) / (2 * 0.5 * 0.45))
    a = np.arctan2(at[1], at[0]) - np.arctan2(0.45 * np.sin(b), 0.5 + 0.45 * np.cos(b))
    return np.array([a, b, phi - a - b])


def arm(runs: int) -> None:
    """Run the two-link arm with one thing wrong at a time."""
    for name, (*_, gap, angle) in ROWS.items():
        run = robust(name)
        late, errors = run.reactions[-100:], (bouncing_error(run), posture_error(run))
        print(
            f"{name:28s} rms g {errors[0]:.1e} ({errors[0] / gap:.2f})  q {errors[1]:.1e} "
            f"({errors[1] / angle:.2f})  contact {bool(run.contacts[-1].all())}  "
            f"force {late.min():.4f} ... {late.max():.4f}"
        )
    believed = two_links()
    for noise, alpha, horizon in ((1e-6, 0.3, 1.0), (1e-5, 0.3, 3.0), (1e-4, 0.15, 5.0)):
        observer = zivi.JointObserver(believed, noise=noise, alpha=alpha)
        run = follow(tracker(horizon=horizon), noise=(noise, 0.0), seed=1, observer=observer)
        late, speed = run.reactions[-100:], np.abs(run.qdot_est - run.qdot)[400:1000]
        print(
            f"positions, noise {noise:g}  rms g {bouncing_error(run):.1e}  q' "
            f"median {np.median(speed):.1e}  force {late.min():.4f} ... {late.max():.4f}"
        )


def faults(runs: int) -> None:
    """Run the arm with everything wrong at once."""
    ends, errors = [], []
    for seed in range(runs):
        source = np.random.default_rng(seed)
        m1, m2 = np.array([1.0, 0.8]) * (1 + source.uniform(-0.15, 0.15, 2))
        e, friction = 0.6 + source.uniform(-0.05, 0.05), source.uniform(0, 0.5, 2)
        believed = two_links().replace(e=e, m1=m1, m2=m2)
        start = START + source.uniform(-0.1, 0.1, 2)

        def rubbing(t: float, q: Any, qdot: Any, friction: Any = friction) -> Any:
            return -friction * qdot

        run = zivi.simulate_closed_loop(
            two_links(),
            tracker(system=believed, horizon=3.0),
            (0, 1.5),
            (start, np.zeros(2)),
            reference=tapping(),
            noise=(1e-5, 1e-3),
            seed=seed,
            disturbance=rubbing,
            method=zivi.RKPeriod(),
        )
        ends.append(bool(run.contacts[-1].all()))
        errors.append(bouncing_error(run))
    print(f"faults: {sum(ends)} of {runs} in contact, rms g median {np.median(errors):.1e}", end="")
    print(f", worst {max(errors):.1e}")


def corner(runs: int, land: bool) -> None:
    """Run the three-link arm in a corner of floor and wall."""
    # with the obtuse corner the reference itself rests at 2.079 s, through 12 Zeno points
    system, end = three_links(), 2.6
    for phi in (0.0, -0.6, 0.6):
        goal = posture(phi, 0.6, -0.3)
        above = posture(phi, 0.52, -0.15)
        split = zivi.mechanics.gap_coordinates(system, goal, np.zeros(3))
        reference: Any = {"floor": "rest", "wall": "rest", "posture": goal}
        if not land:
            reference = zivi.reference_run(
                system,
                (0, end),
                (above, np.zeros(3)),
                virtual={"floor": -9.81, "wall": -6.0},
                posture=goal,
            )
        ctl = zivi.GapTracker(
            system,
            h=H,
            gains={"floor": (40, 22), "wall": (40, 22)},
            force={"floor": 10.0, "wall": 5.0},
        )
        ends, errors, times, forces = [], [], [], []
        for seed in range(runs):
            source = np.random.default_rng(seed)
            if land:
                tip = 0.6 - source.uniform(0.01, 0.25), -0.3 + source.uniform(0.01, 0.25)
                start = posture(phi + source.uniform(-0.2, 0.2), *tip)
                speed = source.uniform(-1, 1, 3)
            else:
                start = above + source.uniform(-0.05, 0.05, 3)
                speed = source.uniform(-0.4, 0.4, 3)
            run = zivi.simulate_closed_loop(
                system,
                ctl,
                (0, end),
                (start, speed),
                reference=reference,
                method=zivi.RKPeriod(),
            )
            ends.append(bool(run.contacts[-1].all()))
            errors.append(np.sqrt(np.mean(run.error_gaps[300:] ** 2, axis=0)))
            closed = run.contacts.all(axis=1)
            times.append(
                run.t[len(closed) - int(np.argmin(closed[::-1]))] if closed[-1] else np.nan
            )
            forces.append(np.abs(run.reactions[-50:] - [10.0, 5.0]).max())
        what = "land" if land else "follow"
        print(
            f"{what} phi {phi:+.1f} c {split.c[0, 1]:+.3f}: {sum(ends)} of {runs} closed, rms g "
            f"{np.median(errors, axis=0)}, time {np.median(times):.3f}/{np.max(times):.3f} s, "
            f"force off by {np.max(forces):.1e}"
        )


def strike(runs: int) -> None:
    """Run a ball on a racket: errors of the apex after 6 s."""
    rows: dict[str, dict[str, Any]] = {
        "exact": {},
        "h = 1e-2": {"h": 1e-2},
        "e wrong 0.1": {"off": 0.1, "learn": False},
        "the same, learnt": {"off": 0.1},
        "ball 20 % wrong": {"mass": 1.2, "learn": False},
        "the same, learnt ": {"mass": 1.2},
        "noise 1e-4, 1e-2": {"noise": (1e-4, 1e-2)},
        "delay 5": {"delay": 5, "learn": False},
        "the same, learnt as a push": {"delay": 5},
        "delay 5, predicted": {"delay": 5, "told": 5},
        "the same, e wrong, learnt": {"delay": 5, "told": 5, "off": 0.1},
        "2 m/s^2 on the paddle": {"disturbance": [0.0, 2.0], "learn": False},
        "the same, learnt  ": {"disturbance": [0.0, 2.0]},
    }
    for name, row in rows.items():
        found = [apex_error(seed, **row) for seed in range(runs)]
        print(f"{name:26s} median {np.median(found):.1e}, worst {np.max(found):.1e} m")


def apex_error(
    seed: int,
    h: float = H,
    off: float = 0.0,
    mass: float = 1.0,
    learn: bool = True,
    told: int = 0,
    **asked: Any,
) -> float:
    """Give the root mean square error of the apexes of one run."""
    source = np.random.default_rng(seed)
    e, ball = source.uniform(0.3, 0.9), np.exp(source.uniform(np.log(0.05), np.log(5.0)))
    height = source.uniform(0.3, 1.0)

    def juggled(ball: float, e: float) -> zivi.MechanicalSystem:
        return zivi.MechanicalSystem(
            mass=np.diag([ball, 1.0]),
            force=[-9.81 * ball, -9.81],
            gaps=[zivi.LinearGap([1, -1], name="racket")],
            e=e,
            coordinates=["ball", "paddle"],
            inputs=[[0.0], [1.0]],
        )

    believed = juggled(ball * mass, min(e + off, 0.99))
    ctl = zivi.Striker(
        believed, gap="racket", body="ball", apex=height, h=h, learn=learn, delay=told
    )
    start = ([source.uniform(0.2, 0.8), 0.0], [source.uniform(-1, 2), 0.0])
    run = zivi.simulate_closed_loop(
        juggled(ball, e), ctl, (0, 12), start, seed=seed, method=zivi.RKPeriod(), **asked
    )
    times = run.resolved_impacts["t"]
    states = np.array([run(t) for t in times[times > 6.0]])
    apexes = states[:, 0, 0] + states[:, 1, 0] ** 2 / (2 * 9.81)
    return float(np.sqrt(np.mean((apexes - height) ** 2)))


TABLES = {
    "arm": arm,
    "faults": faults,
    "follow": lambda runs: corner(runs, land=False),
    "land": lambda runs: corner(runs, land=True),
    "strike": strike,
}

if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("tables", nargs="*", default=list(TABLES))
    parser.add_argument("--runs", type=int, default=20)
    given = parser.parse_args()
    for table in given.tables or TABLES:
        TABLES[table](given.runs)
