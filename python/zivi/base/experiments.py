"""The register of experiments: functions of numbers that studies can name."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeAlias

Experiment: TypeAlias = Callable[..., dict[str, float]]

EXPERIMENTS: dict[str, Experiment] = {}
"""All experiments by their names."""


def experiment(name: str) -> Experiment:
    """Find an experiment by its name."""
    if name not in EXPERIMENTS:
        known = ", ".join(sorted(EXPERIMENTS))
        raise ValueError(f"unknown experiment {name!r}; the experiments are {known}")
    return EXPERIMENTS[name]


def registered(**units: str) -> Callable[[Experiment], Experiment]:
    """Enter a function among the experiments, with the units of its parameters and results."""

    def register(function: Experiment) -> Experiment:
        function.units = units  # type: ignore[attr-defined]
        known = {**EXPERIMENTS, function.__name__: function}
        EXPERIMENTS.clear()
        EXPERIMENTS.update(sorted(known.items()))
        return function

    return register
