"""Studies from files: ``zivi sweep``."""

from __future__ import annotations

import dataclasses
import inspect
import math
from pathlib import Path
from typing import Any

import numpy as np

from zivi.files.file_keys import SWEEP
from zivi.files.kinds import Mistakes, dotted, suggestion
from zivi.files.runs import read_file, spaced
from zivi.study import EXPERIMENTS, Design, Study, grid, points, sample, sweep

MAX_POINTS = 10_000_000
"""Most points of a study from a file."""
EXECUTORS = {"serial": None, "threads": "threads", "processes": "processes"}


@dataclasses.dataclass(frozen=True)
class PreparedSweep:
    """A study whose file was read.

    Parameters
    ----------
    experiment : str
        What is computed.
    design : Design
        Where.
    options : dict
        Further arguments of `zivi.sweep`.
    mistakes : Mistakes
        Of the file.
    """

    experiment: str
    design: Design
    options: dict[str, Any]
    mistakes: Mistakes

    def run(self, out: Path, **options: Any) -> Study:
        """Run it; raise a `FileError` for a fault that only the whole reveals."""
        keys = {name: name for name in ("workers", "seed", "chunk", "fixed", "executor")}
        with self.mistakes.naming(keys):
            return sweep(self.experiment, self.design, out=out, **self.options, **options)


def experiment_parameters(experiment: str) -> dict[str, inspect.Parameter]:
    """Return the parameters of an experiment."""
    return dict(inspect.signature(EXPERIMENTS[experiment]).parameters)


def prepare_sweep(path: Path) -> PreparedSweep:
    """Read a file of ``zivi sweep``."""
    content = read_file(path, SWEEP, "sweep")
    values, mistakes = content.values, content.mistakes
    known = experiment_parameters(values["experiment"])
    fixed = values.get("fixed", {})
    _check_parameter_names(values["parameters"], fixed, known, mistakes)
    mistakes.stop()
    kind = values.get("design", {"kind": "grid"})
    make = _read_sample if kind["kind"] == "sample" else _read_list
    design = make(values["parameters"], kind, known, mistakes)
    options: dict[str, Any] = {
        name: values[name] for name in ("workers", "seed", "chunk") if name in values
    }
    options |= {
        "executor": EXECUTORS[values.get("executor", "serial")],
        "fixed": {name: _as_integers(fixed[name], known[name], dotted("fixed", name), mistakes)
                  for name in fixed},
    }  # fmt: skip
    mistakes.stop()
    if options["executor"] is None and "workers" in options:
        mistakes.add("workers", 'goes with executor = "threads" or "processes"')
        mistakes.stop()
    return PreparedSweep(values["experiment"], design, options, mistakes)


def _check_parameter_names(
    given: dict[str, Any],
    fixed: dict[str, Any],
    known: dict[str, inspect.Parameter],
    mistakes: Mistakes,
) -> None:
    for table, names in (("parameters", given), ("fixed", fixed)):
        for name in names:
            if name not in known:
                text = f"is not a parameter of the experiment{suggestion(name, known)}"
                mistakes.add(dotted(table, name), text)
    for name in set(given) & set(fixed):
        mistakes.add(dotted("fixed", name), "is among the parameters, too")
    if not given:
        mistakes.add("parameters", f"must have one at least{suggestion('', known)}")
    for name, parameter in known.items():
        if parameter.default is parameter.empty and name not in {*given, *fixed}:
            mistakes.add(f"parameters.{name}", "is missing and does not have a default")


def _read_list(
    given: dict[str, Any],
    kind: dict[str, Any],
    known: dict[str, inspect.Parameter],
    mistakes: Mistakes,
) -> Design:
    """Make a grid or a list of points."""
    columns = {}
    for name, value in given.items():
        key = dotted("parameters", name)
        column = _range(value, key, mistakes) if isinstance(value, dict) else np.array(value)
        columns[name] = _as_integers(column, known[name], key, mistakes)
    mistakes.stop()
    _check_count({name: len(column) for name, column in columns.items()}, kind["kind"], mistakes)
    return grid(**columns) if kind["kind"] == "grid" else points(**columns)


def _check_count(lengths: dict[str, int], kind: str, mistakes: Mistakes) -> None:
    number = math.prod(lengths.values())
    if kind == "grid" and number > MAX_POINTS:
        mistakes.add("parameters", f"must give at most {MAX_POINTS} points, they give {number}")
    if kind == "list" and len(set(lengths.values())) > 1:
        told = ", ".join(f"{name} {length}" for name, length in lengths.items())
        mistakes.add("parameters", f"must be of one length in a list of points, got {told}")
    mistakes.stop()


def _range(value: dict[str, Any], key: str, mistakes: Mistakes) -> np.ndarray:
    if "num" not in value:
        mistakes.add(f"{key}.num", "is missing: number of values")
    if not _ends(value, key, mistakes) or "num" not in value:
        return np.zeros(1)
    return spaced(value, log=value.get("log", False))


def _ends(value: dict[str, Any], key: str, mistakes: Mistakes) -> bool:
    """Check the ends of a range; return whether they are usable."""
    missing = [end for end in ("start", "stop") if end not in value]
    for end in missing:
        mistakes.add(f"{key}.{end}", "is missing: a finite number")
    wrong = [
        end
        for end in ("start", "stop")
        if value.get("log") and end not in missing and not value[end] > 0.0
    ]
    for end in wrong:
        mistakes.add(f"{key}.{end}", f"must be > 0 with log = true, got {value[end]}")
    return not (missing or wrong)


def _read_sample(
    given: dict[str, Any],
    kind: dict[str, Any],
    known: dict[str, inspect.Parameter],
    mistakes: Mistakes,
) -> Design:
    """Draw points."""
    for name, value in given.items():
        key = dotted("parameters", name)
        if not isinstance(value, dict):
            text = "must be a table with start and stop, the bounds of a sample"
            mistakes.add(key, f"{text}, got a list")
        else:
            _check_sample_range(value, key, mistakes)
        if known[name].annotation in ("int", int):
            mistakes.add(key, "takes whole numbers, and a sample draws others")
    mistakes.stop()
    bounds = {name: (value["start"], value["stop"]) for name, value in given.items()}
    logs = [name for name, value in given.items() if value.get("log")]
    settings: dict[str, Any] = {"sampler": "sobol", "seed": 0} | kind
    with mistakes.naming({name: f"parameters.{name}" for name in given}, "design"):
        return sample(settings["sampler"], settings["n"], bounds, log=logs, seed=settings["seed"])


def _check_sample_range(value: dict[str, Any], key: str, mistakes: Mistakes) -> None:
    if "num" in value:
        mistakes.add(f"{key}.num", "is not allowed in a sample: design.n is the number of points")
    if _ends(value, key, mistakes) and not value["start"] < value["stop"]:
        mistakes.add(f"{key}.stop", f"must be > start in a sample, got {value['stop']}")


def _as_integers(values: Any, parameter: inspect.Parameter, key: str, mistakes: Mistakes) -> Any:
    """Convert values to integers for an integer parameter."""
    if parameter.annotation not in ("int", int):
        return values
    if not np.all(np.equal(np.mod(values, 1), 0)):
        mistakes.add(key, f"must hold whole numbers, got {values}")
        return values
    return int(values) if np.ndim(values) == 0 else np.asarray(values).astype(np.int64)
