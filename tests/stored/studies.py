"""A study that fixed objects of many kinds tell, stopped half way."""

from __future__ import annotations

from concurrent.futures import Executor, Future
from pathlib import Path
from typing import Any

import numpy as np

import zivi
from stored import functions, objects

REST_TIME: dict[str, Any] = {
    "function": functions.rest_time,
    "points": {"e": [0.3, 0.5, 0.7], "x0": [0.5, 1.0, 1.5, 2.0]},
    "fixed": {
        "system": objects.BALL,
        "method": zivi.SwitchedRK(rtol=1e-7),
        "start": (1.0, 0.0),
        "t_span": (0, 20),
    },
    "units": {"x0": "m"},
    "chunk": 1,
}

APEX: dict[str, Any] = {
    "function": functions.apex,
    "points": {"k": [0, 1, 2, 3]},
    "fixed": {
        "oscillator": zivi.LinearForce(stiffness=2.0, amplitude=0.3, omega=1.5),
        "mechanism": objects.DROP,
        "controller": objects.TRACKER,
        "grid": np.linspace(0, 1, 4),
    },
    "chunk": 1,
}

STUDIES = {"rest_time": REST_TIME, "apex": APEX}


class Interrupted(Executor):
    """Computes some tasks and is interrupted then."""

    def __init__(self, tasks: int) -> None:
        self.left = tasks

    def submit(self, function: Any, /, *arguments: Any, **named: Any) -> Future[Any]:
        """Compute one task at once."""
        if self.left == 0:
            raise KeyboardInterrupt
        self.left -= 1
        done: Future[Any] = Future()
        done.set_result(function(*arguments, **named))
        return done


def half(name: str, folder: Path) -> None:
    """Write a half of a study into a folder."""
    study = STUDIES[name]
    points = int(np.prod([len(values) for values in study["points"].values()]))
    try:
        zivi.sweep(**study, out=folder, executor=Interrupted(points // 2))
    except KeyboardInterrupt:
        return
    raise RuntimeError("the study was not interrupted")
