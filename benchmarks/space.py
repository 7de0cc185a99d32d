"""Friction in two directions beside Siconos and MuJoCo (`benchmarks/results/space.md`).

Usage: python benchmarks/space.py. Siconos and MuJoCo are run by interpreters that have them; one
that is missing is left out, and the page says so.
"""

from __future__ import annotations

import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

import zivi
from friction import PEERS, Row, interpreter, row, sections, theirs
from report import cpu
from space_numbers import MASS, PROBLEMS, G, R
from zivi.mechanics import Ball, Body, Contact, Plane

PAGE = Path(__file__).resolve().parent / "results" / "space.md"
TOLERANCES = (1e-3, 1e-6, 1e-9, 1e-12)
STEPS = ("1e-2", "1e-3", "1e-4")
MUJOCO = (("2e-3", "1"), ("5e-4", "1"), ("1e-4", "1"), ("1e-4", "100"))


def system(given: Mapping[str, Any]) -> tuple[zivi.MechanicalSystem, Any]:
    """Return a ball as a free body, a puck as a mass, with the start."""
    pull = G * np.array([np.sin(given["slope"]), 0.0, -np.cos(given["slope"])])
    if not given["turns"]:
        gap = zivi.LinearGap([0, 0, 1], tangent=[[1, 0, 0], [0, 1, 0]], mu=given["mu"])
        mass = MASS * np.eye(3)
        puck = zivi.MechanicalSystem(mass=mass, force=MASS * pull, gaps=gap, e=given["e"])
        return puck, ([0.0, 0.0, given["height"]], given["v"])
    ball = zivi.Tree(
        [Body("ball", kind="free", mass=MASS, inertia=0.4 * MASS * R * R)],
        contacts=[Contact("ball", "slope", mu=given["mu"], e=given["e"])],
        shapes={"ball": Ball(R), "slope": Plane()},
        gravity=pull,
    )
    place = [0.0, 0.0, R + given["height"], 1.0, 0.0, 0.0, 0.0]
    return ball, (place, [*given["v"], *given["omega"]])


def ours(given: Mapping[str, Any]) -> list[Row]:
    """Run zivi's methods."""
    model, start = system(given)
    rows = []
    chosen: list[tuple[str, float, Any]] = [
        ("SwitchedRK, order 8", tol, zivi.SwitchedRK(rtol=tol, atol=tol)) for tol in TOLERANCES
    ]
    if not given["turns"]:  # steps of first order take no rotations
        chosen += [("zivi's MoreauJean", float(h), zivi.MoreauJean(h=float(h))) for h in STEPS]
    for name, setting, method in chosen:
        begun = time.process_time()
        sol = zivi.simulate(model, (0, given["end"]), start, method, dense_output=False)
        took = time.process_time() - begun
        if not sol.success:
            raise RuntimeError(f"{name}, {setting:g}: {sol.message}")
        error = np.abs([*sol.q[-1, :2], *sol.qdot[-1, :2]] - np.array(given["truth"])).max()
        work = sol.n_steps if isinstance(method, zivi.MoreauJean) else sol.nfev
        rows.append(row(name, f"{setting:g}", {"seconds": took, "work": work, "error": error}))
    return rows


def measure() -> tuple[dict[str, list[Row]], list[str]]:
    """Run everything: the rows of each problem, and who is missing."""
    found = {name: interpreter(module) for name, module in PEERS.items()}
    rows = {}
    for problem, given in PROBLEMS.items():
        rows[problem] = ours(given)
        if (siconos := found["Siconos"]) is not None:
            for h in STEPS:
                run = theirs(siconos, "space_peers.py", "siconos", problem, h)
                rows[problem].append(row("Siconos, MoreauJeanOSI", f"{float(h):g}", run))
        if (mujoco := found["MuJoCo"]) is not None and problem != "thrown":
            for h, ratio in MUJOCO:
                run = theirs(mujoco, "space_peers.py", "mujoco", problem, h, ratio)
                name = "MuJoCo" if ratio == "1" else f"MuJoCo, impratio {ratio}"
                rows[problem].append(row(name, f"{float(h):g}", run))
    return rows, [name for name, python in found.items() if python is None]


HEAD = """# Friction in two directions beside Siconos and MuJoCo

Written by `python benchmarks/space.py`; do not edit. One run on a shared machine: {cpu}. Times
are of the processor, of one run each; steps, evaluations and errors are the same in every run.

{problems}

The error is the largest of the place along the slope (m) and of its rates (m/s) at the end. The
solutions are closed forms; that of the ball that is thrown has 20 digits. zivi simulates a free
body of a tree, and a mass for the puck. Siconos takes steps by Moreau's and Jean's scheme
(`MoreauJeanOSI(0.5)`, `NewtonImpactFrictionNSL`, `FrictionContact(3)`); as a ball has equal moments
of inertia, its equations are linear there. MuJoCo has the elliptic cone and its own defaults; its
contacts are soft and have no coefficient of restitution: it takes part in three problems.
"""


def page() -> str:
    """Measure, and write the page."""
    rows, missing = measure()
    problems = "\n".join(f"- {name}: {given['what']}" for name, given in PROBLEMS.items())
    parts = [HEAD.format(cpu=cpu(), problems=problems)]
    return "\n".join([*parts, *sections(PROBLEMS, rows, missing)]).rstrip() + "\n"


if __name__ == "__main__":
    text = page()
    PAGE.write_text(text)
    print(text)
