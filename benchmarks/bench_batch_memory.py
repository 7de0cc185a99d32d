"""How much memory a batch takes, by what is saved; each figure from a process of its own."""

from __future__ import annotations

import dataclasses
import json
import subprocess
import sys
from pathlib import Path

import numpy as np

import cball
import zivi

H = 1e-3


@dataclasses.dataclass(frozen=True)
class Case:
    """A batch, and what it took."""

    runs: int
    steps: int
    save: str | int
    result: int = 0
    """Bytes of the arrays that are handed over."""
    peak: int = 0
    """Bytes that the process grew by, at most."""


CASES = (
    Case(100_000, 100, "final"),
    Case(100_000, 4000, "final"),
    Case(200_000, 4000, "final"),
    Case(100_000, 4000, "statistics"),
    Case(100_000, 4000, "events"),
    Case(100_000, 4000, 40),
)


def _size(batch: zivi.Batch) -> int:
    arrays = [getattr(batch, field.name) for field in dataclasses.fields(batch)]
    arrays += [array for run in batch.events or () for array in run.values()]
    return sum(array.nbytes for array in arrays if isinstance(array, np.ndarray))


def _run(case: Case) -> zivi.Batch:
    heights = np.linspace(0.5, 1.0, case.runs)
    return zivi.simulate_batch(
        zivi.ImpactSystem(cball.FORCE, kappa=cball.KAPPA),
        (0.0, case.steps * H),
        np.column_stack([heights, np.zeros(case.runs)]),
        method=zivi.ThetaGamma(H),
        save=case.save,
    )


def _peak() -> int:
    # not ru_maxrss, which a process inherits from the one that starts it
    for line in Path("/proc/self/status").read_text().splitlines():
        if line.startswith("VmHWM:"):
            return int(line.split()[1]) * 1024
    raise OSError("no VmHWM")


def one(case: Case) -> Case:
    """Run in this process, which should be fresh."""
    _size(_run(dataclasses.replace(case, runs=100)))
    before = _peak()
    batch = _run(case)
    return dataclasses.replace(case, peak=_peak() - before, result=_size(batch))


def measure(cases: tuple[Case, ...] = CASES) -> list[Case]:
    """Run each case in a process of its own."""
    found = []
    for case in cases:
        told = json.dumps(dataclasses.asdict(case))
        command = [sys.executable, str(Path(__file__).resolve()), told]
        out = subprocess.run(command, capture_output=True, text=True, check=True).stdout
        found.append(Case(**json.loads(out)))
    return found


if __name__ == "__main__":
    print(json.dumps(dataclasses.asdict(one(Case(**json.loads(sys.argv[1]))))))
