"""Instructions of each tick of the tracker by callgrind: the same on every run of one build."""

from __future__ import annotations

import dataclasses
import re
import subprocess
import tempfile
from pathlib import Path

import instructions

CASES = {
    "loop": "the paper's loop, branch s >= 0",
    "nearest": "the paper's loop, nearest branch",
    "wide": "random, wide",
    "near": "random, near the contact and the reference",
    "crossing": "random, fast crossing of the wall",
    "hard": "those of 600,000 random ones that iterate most",
}
FUNCTION = "*::one_tick"


@dataclasses.dataclass(frozen=True)
class Count:
    """Instructions of the ticks of one case."""

    ticks: int
    mean: float
    most: int


def _count(program: Path, case: str, ticks: int) -> Count:
    with tempfile.TemporaryDirectory() as folder:
        # a dump after every tick holds its own count
        options = (
            "--tool=callgrind",
            "--collect-atstart=no",
            f"--toggle-collect={FUNCTION}",
            f"--dump-after={FUNCTION}",
            f"--callgrind-out-file={folder}/ticks",
        )
        command = ("valgrind", *options, program, case, str(ticks))
        subprocess.run(command, capture_output=True, check=True)
        dumps = [file.read_text() for file in Path(folder).glob("ticks.*")]
    found = [int(total) for dump in dumps for total in re.findall(r"^totals: (\d+)", dump, re.M)]
    if len(found) != ticks:
        raise RuntimeError(f"{len(found)} counts of {ticks} ticks")
    return Count(ticks, sum(found) / ticks, max(found))


def measure(ticks: int) -> dict[str, Count] | str:
    """Count every case, or say why not."""
    reason = instructions.missing()
    if reason is not None:
        return reason
    program = instructions.example("zivi-core", "tick_cost")
    return {case: _count(program, case, ticks) for case in CASES}
