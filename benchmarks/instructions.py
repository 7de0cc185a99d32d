"""Instructions of one step, counted by callgrind: the same on every run of one build."""

from __future__ import annotations

import re
import shutil
import subprocess
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent

CASES = {
    "flight": "free flight, pressed to the wall (nearly every step)",
    "crossing": "free flight across the wall (an impact within the step)",
    "wall": "the step ends on the wall",
    "apex": "the step ends at the apex",
    "stop": "the step comes to rest",
    "rest": "at rest",
    "selection": "pulled off the wall, f > 0: all solutions compared",
    "residual": "the residual of a step",
    "recorded": "a whole step of a run in flight: solved, checked, recorded",
}

FEW, MANY = 2_000, 12_000


def missing() -> str | None:
    """Say which of the tools is not there."""
    for tool in ("valgrind", "cargo"):
        if shutil.which(tool) is None:
            return f"{tool} is not installed"
    return None


def example(package: str, name: str) -> Path:
    """Build an example of one of the crates and return its program."""
    build = ("cargo", "build", "--locked", "--quiet", "--release", "--package", package)
    subprocess.run([*build, "--example", name], cwd=ROOT, check=True)
    metadata = subprocess.run(
        ["cargo", "metadata", "--locked", "--no-deps", "--format-version", "1"],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=True,
    )
    target = re.search(r'"target_directory":"([^"]+)"', metadata.stdout)
    assert target is not None
    return Path(target[1]) / "release" / "examples" / name


def refs(program: Path, *arguments: str) -> int:
    """Count the instructions of a program."""
    command = ("valgrind", "--tool=callgrind", "--callgrind-out-file=/dev/null")
    run = subprocess.run(
        [*command, program, *arguments], capture_output=True, text=True, check=True
    )
    found = re.search(r"I\s+refs:\s+([\d,]+)", run.stderr)
    if found is None:
        raise RuntimeError(f"callgrind reported no count:\n{run.stderr}")
    return int(found[1].replace(",", ""))


def count() -> dict[str, float] | str:
    """Instructions of each case of `CASES`, or the reason why they were not counted.

    Two runs of different length are subtracted, then the cost of an empty call.
    """
    reason = missing()
    if reason is not None:
        return reason
    program = example("zivi", "step_cost")

    def one(case: str) -> float:
        few, many = (refs(program, case, str(number)) for number in (FEW, MANY))
        return (many - few) / (MANY - FEW)

    call = one("nothing")
    # a run has no call around each of its steps
    return {case: one(case) - (0.0 if case == "recorded" else call) for case in CASES}
