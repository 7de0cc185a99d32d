"""Dry friction beside Siconos and MuJoCo: error over work (`benchmarks/results/friction.md`).

Usage: python benchmarks/friction.py. Siconos and MuJoCo are run by interpreters that have them; one
that is missing is left out, and the page says so.
"""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
import time
import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

import zivi
from friction_numbers import PROBLEMS, STEPS
from report import cpu, table

PAGE = Path(__file__).resolve().parent / "results" / "friction.md"
TOLERANCES = (1e-3, 1e-6, 1e-9, 1e-12)
MUJOCO = (("2e-3", "1"), ("5e-4", "1"), ("1e-4", "1"), ("1e-4", "100"))
TIMEOUT = 300.0
PEERS = {"Siconos": "siconos.kernel", "MuJoCo": "mujoco"}

Row = tuple[str, str, str, str, str]


def system(given: Mapping[str, Any]) -> zivi.MechanicalSystem:
    """Give a problem by its energies and slip speeds, compiled."""
    n = range(len(given["force"]))
    q, w = [f"x{i}" for i in n], [f"x{i}dot" for i in n]

    def product(row: Any, names: list[str]) -> str:
        return " + ".join(f"{a!r}*{name}" for a, name in zip(row, names, strict=True))

    gaps = {f"g{k}": normal for k, normal in enumerate(given["normals"])}
    stiff = " + ".join(f"{q[i]}*({product(given['stiffness'][i], q)})/2" for i in n)
    offsets, tangents, mus = given["offsets"], given["tangents"], given["mu"]
    return zivi.symbolic.system(
        q,
        T=" + ".join(f"{w[i]}*({product(given['mass'][i], w)})/2" for i in n),
        V=f"{stiff} - ({product(given['force'], q)})",
        gaps={
            name: f"{product(normal, q)} + {offset!r}"
            for (name, normal), offset in zip(gaps.items(), offsets, strict=True)
        },
        slips={name: product(row, w) for name, row in zip(gaps, tangents, strict=True)},
        mu=dict(zip(gaps, mus, strict=True)),
        e=given["e"],
    )


def row(name: str, setting: str, found: Mapping[str, Any]) -> Row:
    """Give a line of the table."""
    ms, error = f"{1e3 * found['seconds']:.2f}", f"{found['error']:.1e}"
    return name, setting, str(found["work"]), ms, error


def ours(problem: str) -> list[Row]:
    """Run zivi's methods."""
    given = PROBLEMS[problem]
    model, rows = system(given), []
    chosen: list[tuple[str, float, Any]] = [
        ("SwitchedRK, order 8", tol, zivi.SwitchedRK(rtol=tol, atol=tol)) for tol in TOLERANCES
    ]
    chosen += [("zivi's MoreauJean", h, zivi.MoreauJean(h=h)) for h in STEPS[problem]]
    for name, setting, method in chosen:
        begun = time.process_time()
        with warnings.catch_warnings():  # that the e differ
            warnings.simplefilter("ignore", RuntimeWarning)
            sol = zivi.simulate(
                model, (0, given["end"]), given["start"], method, dense_output=False
            )
        took = time.process_time() - begun
        if not sol.success:
            raise RuntimeError(f"{problem}, {name}, {setting:g}: {sol.message}")
        error = np.abs(np.concatenate([sol.q[-1], sol.qdot[-1]]) - given["truth"]).max()
        work = sol.n_steps if isinstance(method, zivi.MoreauJean) else sol.nfev
        rows.append(row(name, f"{setting:g}", {"seconds": took, "work": work, "error": error}))
    return rows


def interpreter(module: str) -> str | None:
    """Find a Python that imports a module."""
    candidates = (sys.executable, shutil.which("python3"), "/usr/bin/python3")
    for python in dict.fromkeys(name for name in candidates if name):
        probe = subprocess.run([python, "-c", f"import {module}"], capture_output=True, check=False)
        if probe.returncode == 0:
            return python
    return None


def theirs(python: str, script: str, *arguments: str) -> dict[str, Any]:
    """Run another program once."""
    done = subprocess.run(
        [python, Path(__file__).with_name(script), *arguments],
        capture_output=True,
        text=True,
        timeout=TIMEOUT,
        check=True,
    )
    (line,) = (it for it in done.stdout.splitlines() if it.startswith("FIGURES "))
    found: dict[str, Any] = json.loads(line.removeprefix("FIGURES "))
    return found


def measure() -> tuple[dict[str, list[Row]], list[str], float | None]:
    """Run everything: the rows of each problem, who is missing, and how fast MuJoCo creeps."""
    found = {name: interpreter(module) for name, module in PEERS.items()}
    siconos, mujoco = found["Siconos"], found["MuJoCo"]
    rows, creeps = {}, None
    for problem in PROBLEMS:
        rows[problem] = ours(problem)
        if siconos is not None:
            for h in STEPS[problem]:
                run = theirs(siconos, "friction_siconos.py", problem, str(h))
                rows[problem].append(row("Siconos, MoreauJeanOSI", f"{h:g}", run))
        if mujoco is not None and problem == "slide":
            for h, ratio in MUJOCO:
                run = theirs(mujoco, "friction_mujoco.py", h, ratio)
                name = "MuJoCo" if ratio == "1" else f"MuJoCo, impratio {ratio}"
                rows[problem].append(row(name, f"{float(h):g}", run))
                creeps = run["creeps"] if creeps is None else creeps
    return rows, [name for name, python in found.items() if python is None], creeps


HEAD = """# Dry friction beside Siconos and MuJoCo

Written by `python benchmarks/friction.py`; do not edit. One run on a shared machine: {cpu}. Times
are of the processor, of one run each; steps, evaluations and errors are the same in every run.

{problems}

The error is the largest of all coordinates and velocities at the end; of MuJoCo, whose floor is
soft, along the slope. The block that slides is solved by hand, the others with 28 digits. zivi
integrates compiled systems (`zivi.symbolic`). Siconos takes steps by Moreau's and Jean's scheme
(`MoreauJeanOSI(0.5)`, `NewtonImpactFrictionNSL`, `FrictionContact(2)`), as its examples do. MuJoCo
has no coefficient of restitution: it takes part in one problem.

Where Siconos and `zivi.MoreauJean` have the same error, both solve the same steps: those of an
impact are wrong by the order of their length, times the accelerations, 1e4 in the woodpecker.
"""


def page() -> str:
    """Measure, and write the page."""
    rows, missing, creeps = measure()
    problems = "\n".join(f"- {name}: {given['what']}" for name, given in PROBLEMS.items())
    parts = [HEAD.format(cpu=cpu(), problems=problems)]
    if creeps is not None:
        parts.append(
            "The block rests at the end; in MuJoCo, with its step of 2e-3, it creeps with "
            f"{creeps:.1e} m/s.\n"
        )
    return "\n".join([*parts, *sections(PROBLEMS, rows, missing)]).rstrip() + "\n"


def sections(
    problems: Mapping[str, Mapping[str, Any]], rows: Mapping[str, list[Row]], missing: list[str]
) -> list[str]:
    """Give the table of each problem, and who is missing."""
    head = ("", "tolerance or step (s)", "evaluations or steps", "ms", "error")
    parts = []
    for problem, lines in rows.items():
        parts += [f"## {problem}, t = {problems[problem]['end']:g} s\n", table(head, lines), ""]
    return parts + [f"{name} was not found.\n" for name in missing]


if __name__ == "__main__":
    text = page()
    PAGE.write_text(text)
    print(text)
