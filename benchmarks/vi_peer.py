"""Siconos' solvers for box VIs as a process to ask, never required."""

from __future__ import annotations

import json
import os
import select
import subprocess
from pathlib import Path
from typing import Any

import numpy as np

import siconos_peer

TESTS = Path(__file__).resolve().parent.parent / "tests"
TIMEOUT, PATIENCE = 5.0, 60.0
"""Longest that one solve, and one answer, may take (s); some of its searches never end."""


class Peer:
    """The process; begun anew after a solve without an end."""

    def __init__(self, python: str) -> None:
        self.python = python
        self.process: subprocess.Popen[str] | None = None

    def _started(self) -> subprocess.Popen[str]:
        script = Path(__file__).with_name("siconos_mcp.py")
        # the problems are small: more threads than one only get in each other's way
        alone = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
        return subprocess.Popen(
            [self.python, str(script), str(TESTS)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
            env=os.environ | alone,
        )

    def ask(
        self, solver: str, problem: str, start: np.ndarray, repeat: int = 1
    ) -> dict[str, Any] | None:
        """Return the answer, None if there is none in time."""
        if self.process is None:
            self.process = self._started()
        assert self.process.stdin is not None
        assert self.process.stdout is not None
        asked = {"solver": solver, "problem": problem, "start": list(start), "repeat": repeat}
        self.process.stdin.write(json.dumps(asked) + "\n")
        self.process.stdin.flush()
        wait = min(TIMEOUT * repeat, PATIENCE)
        ready, _, _ = select.select([self.process.stdout], [], [], wait)
        line = self.process.stdout.readline() if ready else ""
        if not line:
            self.close()
            return None
        answer: dict[str, Any] = json.loads(line)
        return None if "error" in answer else answer

    def close(self) -> None:
        """End the process."""
        if self.process is not None:
            self.process.kill()
            self.process.communicate()
            self.process = None


def find() -> Peer | None:
    """Return the process of a Python that has Siconos, if there is one."""
    python = siconos_peer.interpreter()
    return None if python is None else Peer(python)
