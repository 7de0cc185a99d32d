"""Mechanical systems in FMUs, alone or with a controller: their numbers, code and variables."""

from __future__ import annotations

import hashlib
import os
import platform
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from zivi.base.check import Array
from zivi.base.machine_code import shared_library
from zivi.interop.fmu.archive import PLATFORMS, binaries_of, write_archive
from zivi.interop.fmu.table import Kind, Model, Role, Variable
from zivi.interop.fmu.tree import tree_numbers
from zivi.system.symbolic.inputs import SymbolicInputs
from zivi.system.symbolic.system import SymbolicSystem
from zivi.system.tree.system import Tree

__all__ = [
    "VERSION",
    "Exported",
    "Rows",
    "binary_here",
    "optional",
    "part_numbers",
    "system_numbers",
    "told",
    "variables_of",
    "write_systems",
]

VERSION = 3.0
"""Of the numbers."""
MOST = 512
"""Variables of the largest unit."""

Exported = SymbolicSystem | Tree
"""Systems that an FMU takes."""


def told(name: str, system: Any) -> Exported:
    """Refuse systems that an FMU cannot have."""
    if not isinstance(system, SymbolicSystem | Tree):
        raise TypeError(
            f"{name} must be a zivi.symbolic.system or a zivi.Tree: an FMU runs without "
            f"Python; got {type(system).__name__}"
        )
    return system


def binary_here() -> tuple[str, bytes]:
    """Give this kind of machine as FMI 3 names it, and the binary for it."""
    binaries = binaries_of("fmu_loops")
    system = platform.system().lower()
    kind = platform.machine().lower()
    here = f"{ {'amd64': 'x86_64', 'arm64': 'aarch64'}.get(kind, kind) }-{system}"
    if here not in binaries:
        raise FileNotFoundError(
            f"no binary for mechanical systems on {here}: there is {', '.join(binaries)}"
        )
    return here, binaries[here]


def write_systems(
    out: str | os.PathLike[str],
    kind: str,
    systems: dict[str, Exported],
    numbers: Iterable[float],
    model: Model,
    versions: Sequence[int],
    binary: tuple[str, bytes],
) -> list[Path]:
    """Write the FMUs of systems, plant and model, with their numbers and code."""
    source = _source(kind, systems)
    content = np.array(list(numbers), dtype="<f8").tobytes()
    digest = hashlib.sha256(source.encode() + b"\0" + content).hexdigest()[:32]
    token = f"zivi-{kind}-{digest}"
    if len(model.variables) > MOST:
        raise ValueError(
            f"an FMU of a {kind} has at most {MOST} variables, {len(model.variables)} here"
        )
    here, code = binary
    _, ending = PLATFORMS[here]
    beside = {f"resources/{token}.bin": content}
    if source:
        beside[f"resources/{token}{ending}"] = shared_library(source)
    model = model.with_token(token)
    return [write_archive(out, model, it, {here: code}, beside) for it in versions]


def _source(kind: str, systems: dict[str, Exported]) -> str:
    """Write systems, and how controls act on them, as functions of one C source."""
    functions = []
    for name, system in systems.items():
        if system._channels:
            raise ValueError(f"an FMU of a {kind} has no friction, the {name} has")
        if isinstance(system, Tree):
            continue
        functions.append(_named(system.source, name))
        if isinstance(inputs := system._symbolic_inputs, SymbolicInputs) and inputs.sources:
            functions.append(_named(inputs.sources["c"], f"{name}_inputs"))
    return "\n".join(functions)


def _named(source: str, name: str) -> str:
    return source.replace("int model(", f"int {name}(")


def system_numbers(system: Exported, q: Array, qdot: Array) -> Iterator[float]:
    """Give the numbers of a system alone, in the order in which the binary reads them."""
    yield from (VERSION, len(q), system.m, 0, 0, *q, *qdot)
    yield from (float(it) for it in system.e)
    yield from optional(())
    yield from _parameters(system)


def part_numbers(system: Exported, q: Array) -> Iterator[float]:
    """Give those of a plant, or of what a controller believes in."""
    yield from (float(it) for it in system.e)
    inputs = None if isinstance(system, Tree) else system._symbolic_inputs
    compiled = isinstance(inputs, SymbolicInputs) and bool(inputs.sources)
    matrix = system.control_inputs(q).matrix
    if not compiled and callable(matrix):
        raise TypeError("inputs of a system in an FMU must be numbers or expressions")
    yield from optional(None if compiled else np.ravel(np.asarray(matrix)))
    yield from _parameters(system)


def _parameters(system: Exported) -> Iterator[float]:
    yield len(system.parameters)
    yield from system.parameters.values()
    yield isinstance(system, Tree)
    if isinstance(system, Tree):
        yield from tree_numbers(system)


def optional(values: Any) -> Iterator[float]:
    """Give numbers that may be missing."""
    if values is None:
        yield 0.0
    else:
        yield 1.0
        yield from values


class Rows:
    """Variables of a model, in the order of the binary."""

    def __init__(self) -> None:
        self.all = [Variable("time", "real", "time", 0.0, "s", "time")]

    def add(
        self, prefix: str, names: Iterable[str], kind: Kind, role: Role, text: str
    ) -> list[str]:
        """Append one variable for each name: what they are called."""
        new = [Variable(f"{prefix}{it}", kind, role, 0.0, None, text.format(it)) for it in names]
        self.all.extend(new)
        return [it.name for it in new]

    def add_motion(self, coordinates: Sequence[str], gaps: Sequence[str]) -> list[str]:
        """Append coordinates, velocities, gaps, contacts, contact forces: what these are called."""
        self.add("q_", coordinates, "real", "output", "coordinate {}")
        self.add("qdot_", coordinates, "real", "output", "velocity of {}")
        self.add("gap_", gaps, "real", "output", "gap {}")
        self.add("contact_", gaps, "boolean", "output", "whether gap {} is closed")
        return self.add("force_", gaps, "real", "output", "contact force of {}")

    def add_parameters(
        self, coordinates: Sequence[str], start: tuple[Array, Array], systems: dict[str, Exported]
    ) -> tuple[str, ...]:
        """Append the start, and the parameters of systems by prefix: what all are called."""
        rows: list[tuple[str, float, str]] = []
        for prefix, values in zip(("q0_", "qdot0_"), start, strict=True):
            rows += [
                (f"{prefix}{it}", value, f"{prefix[:-1]} of {it} at the start")
                for it, value in zip(coordinates, values.tolist(), strict=True)
            ]
        for prefix, system in systems.items():
            of = f" of the {prefix.rstrip('_')}" if prefix else ""
            rows += [
                (f"{prefix}{it}", value, f"parameter {it}{of}")
                for it, value in system.parameters.items()
            ]
        self.all += [Variable(it, "real", "parameter", value, None, of) for it, value, of in rows]
        return tuple(it for it, _, _ in rows)

    def model(
        self,
        key: str,
        name: str,
        text: str,
        forces: tuple[list[str], list[str]],
        parameters: tuple[str, ...],
    ) -> Model:
        """Describe the unit: contact forces depend on what pushes, outputs on all parameters."""
        of_contacts, pushed = forces
        outputs = [it.name for it in self.all if it.role == "output"]
        return Model(
            key,
            name,
            "",
            text,
            tuple(self.all),
            dict.fromkeys(of_contacts, tuple(pushed)),
            dict.fromkeys(outputs, parameters),
        )


def variables_of(system: Exported, name: str, start: tuple[Array, Array]) -> Model:
    """Describe the unit of a system alone."""
    coordinates, gaps = system.coordinate_names(len(start[0])), system.gap_names
    rows = Rows()
    pushed = rows.add("u_", coordinates, "real", "input", "generalised force on {}")
    forces = rows.add_motion(coordinates, gaps), pushed
    parameters = rows.add_parameters(coordinates, start, {"": system})
    text = "A mechanical system with impacts"
    return rows.model("mechanism", name, text, forces, parameters)
