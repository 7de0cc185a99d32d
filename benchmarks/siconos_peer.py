"""Siconos on the same ball, in the interpreter that has it (never required)."""

from __future__ import annotations

import dataclasses
import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np

import bench_ball
import cball
import timing

STEPS = 4000
H = 1e-3
TIMEOUT = 120.0
ROUNDS = 3

ROUTES = {
    "vi": "Siconos, box VI of each step (VI_BOX_AVI_LSA), F and its Jacobian in Python, warm start",
    "relay": "Siconos, kernel simulation (EulerMoreau, Relay), relation in Python",
}


@dataclasses.dataclass(frozen=True)
class Peer:
    """Figures of one route."""

    ns_per_step: float
    failures: int
    rest_time: float | None
    apart: float
    """Largest difference of s from the C loop."""


def interpreter() -> str | None:
    """Find a Python that imports siconos.numerics."""
    candidates = (sys.executable, shutil.which("python3"), "/usr/bin/python3")
    for python in dict.fromkeys(name for name in candidates if name):
        try:
            probe = subprocess.run(
                [python, "-c", "import siconos.numerics"], capture_output=True, timeout=TIMEOUT
            )
        except (OSError, subprocess.TimeoutExpired):
            continue
        if probe.returncode == 0:
            return python
    return None


def _once(python: str, route: str) -> dict[str, object] | str:
    script = Path(__file__).with_name("siconos_ball.py")
    # its dense algebra is 2 x 2: more threads than one only get in each other's way
    alone = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    try:
        run = subprocess.run(
            [python, script, route, str(STEPS)],
            capture_output=True,
            text=True,
            timeout=TIMEOUT,
            env=os.environ | alone,
        )
    except subprocess.TimeoutExpired:
        return f"did not end within {TIMEOUT:g} s"
    for line in run.stdout.splitlines():
        if line.startswith("FIGURES "):
            figures: dict[str, object] = json.loads(line.removeprefix("FIGURES "))
            return figures
    return f"ended with code {run.returncode}"


def measure(build: cball.CBall) -> dict[str, Peer | str]:
    """Run each route; the median of a few rounds, or what went wrong."""
    python = interpreter()
    if python is None:
        return dict.fromkeys(ROUTES, "not installed")
    exact = build.arrays(cball.problem(STEPS * H, H))["s"]
    peers: dict[str, Peer | str] = {}
    for route in ROUTES:
        rounds = [_once(python, route) for _ in range(ROUNDS)]
        wrong = next((it for it in rounds if isinstance(it, str)), None)
        if wrong is not None:
            peers[route] = wrong
            continue
        runs = [it for it in rounds if not isinstance(it, str)]
        last = runs[-1]
        s = np.array(last["s"])
        peers[route] = Peer(
            ns_per_step=float(np.median([it["ns_per_step"] for it in runs])),
            failures=int(str(last["failures"])),
            rest_time=last["rest_time"],  # type: ignore[arg-type]
            apart=float(np.max(np.abs(s - exact[: len(s)]))),
        )
    return peers


def zivi_beside() -> float:
    """Time zivi on the very run that Siconos does, in ns per step, call and all."""
    system = bench_ball.ball()
    run = {"zivi": (lambda: bench_ball.simulate(system, STEPS * H, STEPS), timing.nothing)}
    return timing.medians(timing.interleaved(run, 51), STEPS)["zivi"]
