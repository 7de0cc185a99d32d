"""Export of models, mechanical systems and closed loops as FMUs."""

from __future__ import annotations

import hashlib
import html
import io
import os
import platform
import zipfile
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

import zivi._zivi as _zivi
from zivi.base.check import Array, identifier, integer
from zivi.base.machine_code import shared_library
from zivi.control.gap_tracker import GapTracker, check_gap_tracker
from zivi.control.loop_arguments import sampling_period
from zivi.control.mechanical_loop import check_gap_reference, times_ahead
from zivi.control.mechanical_reference import MechanicalReference, reference_of
from zivi.control.model_based import check_believes
from zivi.interop.fmu.description import (
    FMU,
    IDENTIFIER,
    MODELS,
    Kind,
    Role,
    Variable,
    description,
)
from zivi.simulation.mechanical_run import state_of
from zivi.simulation.run import pair
from zivi.system.mass import ImpactSystem
from zivi.system.mechanism import MechanicalSystem, check_rigid
from zivi.system.start import check_start
from zivi.system.symbolic_system import SymbolicInputs, SymbolicSystem
from zivi.system.tree import Tree

# Writing FMUs: a description, the prebuilt binaries and a page, in a reproducible archive.

VERSIONS = (2, 3)
"""Versions of FMI."""

PLATFORMS = {
    "x86_64-linux": ("linux64", ".so"),
    "aarch64-linux": (None, ".so"),
    "x86_64-darwin": ("darwin64", ".dylib"),
    "aarch64-darwin": (None, ".dylib"),
    "x86_64-windows": ("win64", ".dll"),
}
"""Platform as FMI 3 names it; its name in FMI 2, ending of its binaries."""

EPOCH = (1980, 1, 1, 0, 0, 0)
"""Date of every file in an archive: two exports are equal to the last byte."""


def write_archive(
    out: str | os.PathLike[str],
    model: FMU,
    fmi: int,
    binaries: dict[str, bytes],
    beside: dict[str, bytes] | None = None,
) -> Path:
    """Write the FMU of a model, with additional files, into a folder."""
    folder = Path(out)
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"{model.name}{fmi}.fmu"
    _replace_file(path, _archive(model, fmi, binaries, beside or {}))
    return path


def chosen_versions(fmi: int | Iterable[int] | None) -> list[int]:
    """Read the requested versions of FMI, by default all."""
    if fmi is None:
        return list(VERSIONS)
    given = list(fmi) if isinstance(fmi, Iterable) and not isinstance(fmi, str) else [fmi]
    versions = [integer("fmi", version) for version in given]
    for version in versions:
        if version not in VERSIONS:
            raise ValueError(f"fmi must be 2 or 3, got {version!r}")
    return list(dict.fromkeys(versions))


def binaries_of(kind: str) -> dict[str, bytes]:
    """Read the binaries of a kind that this installation has, by platform."""
    folder = Path(__file__).parents[2] / "_native" / kind
    found = {}
    for name, (_, ending) in PLATFORMS.items():
        path = folder / f"{name}{ending}"
        if path.exists():
            found[name] = path.read_bytes()
    if not found:
        raise FileNotFoundError(
            f"no binary for an FMU in {folder}: this installation was built without it. In the "
            "source tree, python tools/native.py builds it (make test and pip install do that too)"
        )
    return found


def _archive(model: FMU, fmi: int, binaries: dict[str, bytes], beside: dict[str, bytes]) -> bytes:
    files = {
        **beside,
        "modelDescription.xml": description(model, fmi),
        "documentation/index.html": _html_page(model).encode(),
    }
    for target, binary in binaries.items():
        old, ending = PLATFORMS[target]
        name = target if fmi == 3 else old
        if name is not None:
            files[f"binaries/{name}/{IDENTIFIER}{ending}"] = binary
    if not any(name.startswith("binaries/") for name in files):
        have = ", ".join(binaries)
        raise ValueError(f"fmi must be 3: FMI 2 does not define a name for {have}, got {fmi}")
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED, compresslevel=9) as archive:
        for name in sorted(files):
            entry = zipfile.ZipInfo(name, EPOCH)
            entry.compress_type = zipfile.ZIP_DEFLATED
            entry.create_system = 3  # the same on every machine
            entry.external_attr = 0o644 << 16
            archive.writestr(entry, files[name])
    return out.getvalue()


def _replace_file(path: Path, contents: bytes) -> None:
    beside = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        beside.write_bytes(contents)
        os.replace(beside, path)
    finally:
        beside.unlink(missing_ok=True)


def _html_page(model: FMU) -> str:
    rows = "\n".join(
        "<tr>"
        + "".join(
            f"<td>{html.escape(cell)}</td>"
            for cell in (it.name, it.role, it.unit or "", f"{it.start:g}", it.description)
        )
        + "</tr>"
        for it in model.variables
    )
    length = "The communication step must be a multiple of h."
    if model.any_step:
        length = "A communication step that is not a multiple of h is made of equal shorter steps."
    if model.key == "mechanism":
        length = "A communication step may have any length."
    return f"""<!DOCTYPE html>
<html lang="en"><head><meta charset="utf-8"><title>{model.name}</title></head><body>
<h1>{model.name}</h1>
<p>{html.escape(model.description)}. Made by zivi {_zivi.__version__}, Apache-2.0.</p>
<p>{length} Inputs are held over a step.</p>
{FEEDTHROUGH if model.feedthrough and model.key in CONTROLLERS else ""}
<table><tr><th>Name</th><th>Role</th><th>Unit</th><th>Start</th><th></th></tr>
{rows}
</table></body></html>
"""


CONTROLLERS = ("regulator", "tracker", "observer")
FEEDTHROUGH = """<p>The control answers the inputs that were set since the last step. An importer
that sets the measurement, reads u and then makes a step closes the loop without delay; one that
makes a step and then reads u gets the control of the last period: a delay of one period, for which
"ahead" should be 2.</p>"""


# Trees of bodies as numbers that the binary of a loop reads.

KINDS = ("lower", "upper", "plane", "balls")
"""Kinds of gaps by their numbers."""


def tree_numbers(tree: Tree) -> Iterator[float]:
    """Return joints, gaps, and each number of the tree as a polynomial in the parameters."""
    structure = tree._structure
    for parent, kind in structure.joints():
        yield from (parent, kind == "slide")
    for side in structure.sides:
        yield from (KINDS.index(side.kind), *side.joints)
    values = {name: Polynomial({(i,): 1.0}) for i, name in enumerate(tree.parameters)}
    numbers = structure.numbers(values)
    yield len(numbers)
    for number in numbers:
        terms = number.terms if isinstance(number, Polynomial) else {(): float(number)}
        terms = {of: factor for of, factor in terms.items() if factor != 0.0}
        yield len(terms)
        for of, factor in terms.items():
            yield from (factor, len(of), *of)


class Polynomial:
    """A polynomial: factors of products of parameters, told by their sorted numbers."""

    def __init__(self, terms: dict[tuple[int, ...], float]) -> None:
        self.terms = terms

    def __add__(self, other: Any) -> Any:
        more = _terms(other)
        if more is None:
            return NotImplemented
        terms = dict(self.terms)
        for of, factor in more.items():
            terms[of] = terms.get(of, 0.0) + factor
        return Polynomial(terms)

    def __mul__(self, other: Any) -> Any:
        factors = _terms(other)
        if factors is None:
            return NotImplemented
        terms: dict[tuple[int, ...], float] = {}
        for one, first in self.terms.items():
            for two, second in factors.items():
                of = tuple(sorted(one + two))
                terms[of] = terms.get(of, 0.0) + first * second
        return Polynomial(terms)

    def __neg__(self) -> Polynomial:
        return Polynomial({of: -factor for of, factor in self.terms.items()})

    def __sub__(self, other: Any) -> Any:
        return NotImplemented if _terms(other) is None else self + (-1.0) * other

    def __rsub__(self, other: Any) -> Any:
        return -self + other

    __radd__, __rmul__ = __add__, __mul__


def _terms(value: Any) -> dict[tuple[int, ...], float] | None:
    """Return the terms of a polynomial or number; None for other values."""
    if isinstance(value, Polynomial):
        return value.terms
    return {(): float(value)} if isinstance(value, int | float) else None


# Mechanical systems in FMUs, alone or with a controller: their numbers, code and variables.

VERSION = 3.0
"""Of the numbers."""
MOST = 512
"""Variables of the largest unit."""

Exported = SymbolicSystem | Tree
"""Systems that an FMU takes."""


def told(name: str, system: Any) -> Exported:
    """Reject systems that an FMU cannot have."""
    if not isinstance(system, SymbolicSystem | Tree):
        raise TypeError(
            f"{name} must be a zivi.symbolic.system or a zivi.Tree: an FMU runs without "
            f"Python; got {type(system).__name__}"
        )
    return system


def binary_here() -> tuple[str, bytes]:
    """Return this kind of machine as FMI 3 names it, and the binary for it."""
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
    model: FMU,
    versions: Sequence[int],
    binary: tuple[str, bytes],
) -> list[Path]:
    """Write the FMUs of systems, plant and model, with their numbers and code."""
    source = _systems_source(kind, systems)
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


def _systems_source(kind: str, systems: dict[str, Exported]) -> str:
    """Write systems, and how controls act on them, as functions of one C source."""
    functions = []
    for name, system in systems.items():
        check_rigid(system, "FMUs")
        if system._channels:
            raise ValueError(
                f"FMUs of a {kind} do not support friction; the {name} has dry friction"
            )
        if isinstance(system, Tree):
            continue
        functions.append(_named_source(system.source, name))
        if isinstance(inputs := system._symbolic_inputs, SymbolicInputs) and inputs.sources:
            functions.append(_named_source(inputs.sources["c"], f"{name}_inputs"))
    return "\n".join(functions)


def _named_source(source: str, name: str) -> str:
    return source.replace("int model(", f"int {name}(")


def system_numbers(system: Exported, q: Array, qdot: Array) -> Iterator[float]:
    """Return the numbers of a system without controller, in the order of the binary."""
    yield from (VERSION, len(q), system.m, 0, 0, *q, *qdot)
    yield from (float(it) for it in system.e)
    yield from optional(())
    yield from _parameter_numbers(system)


def part_numbers(system: Exported, q: Array) -> Iterator[float]:
    """Return the numbers of a plant or of the model of a controller."""
    yield from (float(it) for it in system.e)
    inputs = None if isinstance(system, Tree) else system._symbolic_inputs
    compiled = isinstance(inputs, SymbolicInputs) and bool(inputs.sources)
    matrix = system.control_inputs(q).matrix
    if not compiled and callable(matrix):
        raise TypeError("inputs of a system in an FMU must be numbers or expressions")
    yield from optional(None if compiled else np.ravel(np.asarray(matrix)))
    yield from _parameter_numbers(system)


def _parameter_numbers(system: Exported) -> Iterator[float]:
    yield len(system.parameters)
    yield from system.parameters.values()
    yield isinstance(system, Tree)
    if isinstance(system, Tree):
        yield from tree_numbers(system)


def optional(values: Any) -> Iterator[float]:
    """Return optional numbers."""
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
    ) -> FMU:
        """Describe the unit: contact forces depend on the inputs, outputs on all parameters."""
        of_contacts, pushed = forces
        outputs = [it.name for it in self.all if it.role == "output"]
        return FMU(
            key,
            name,
            "",
            text,
            tuple(self.all),
            dict.fromkeys(of_contacts, tuple(pushed)),
            dict.fromkeys(outputs, parameters),
        )


def variables_of(system: Exported, name: str, start: tuple[Array, Array]) -> FMU:
    """Describe the unit of a system alone."""
    coordinates, gaps = system.coordinate_names(len(start[0])), system.gap_names
    rows = Rows()
    pushed = rows.add("u_", coordinates, "real", "input", "generalised force on {}")
    forces = rows.add_motion(coordinates, gaps), pushed
    parameters = rows.add_parameters(coordinates, start, {"": system})
    text = "A mechanical system with impacts"
    return rows.model("mechanism", name, text, forces, parameters)


# Closed loops of mechanical systems as FMUs: a binary with data and compiled systems.


def export_loop(
    out: str | os.PathLike[str],
    system: SymbolicSystem | Tree,
    controller: GapTracker,
    t_span: Sequence[float],
    y0: Any,
    *,
    reference: Any = None,
    name: str = "MechanicalLoop",
    fmi: int | Iterable[int] | None = None,
) -> list[Path]:
    """Write an FMU of a mechanism with its `GapTracker`: no Python where it runs.

    A period is one of `simulate_closed_loop` with ``method=zivi.RKPeriod()`` and the ``delay`` of
    the controller. Inputs are disturbances, a generalised force on each coordinate; outputs are
    coordinates, velocities, gaps, contacts, contact forces, contacts that are held, controls, bits
    of `TickStatus`, and how many updates of past periods were rejected (``n_refused``) and
    saturated (``n_saturated``). Parameters are the initial state and the parameters of the plant
    (``plant_...``) and of the controller's model (``model_...``).

    Parameters
    ----------
    out : path
        The folder into which it is written.
    system : SymbolicSystem or Tree
        The plant without friction: of `zivi.symbolic.system`, for which the export needs a C
        compiler, or a `zivi.Tree`.
    controller : GapTracker
        The controller, without `tasks` and with constant forces; it is reset.
    t_span : (float, float)
        Interval of the reference (s); afterwards it is constant.
    y0 : (array_like, array_like)
        Coordinates and velocities at the start, shape (n,) each.
    reference : MechanicalTrajectory, str or dict, optional
        As for `simulate_closed_loop`; without one all gaps come to rest.
    name : str
        Of the model: a letter, then letters, digits and underscores.
    fmi : {2, 3} or sequence of int, optional
        Version of FMI, by default both.

    Returns
    -------
    list of pathlib.Path
        The files, such as ``MechanicalLoop2.fmu``. They run on this kind of machine.

    Raises
    ------
    ValueError, TypeError
        For a system, a controller or an argument of another kind or out of range.
    FileNotFoundError
        If this installation was built without the binary; the message names the build command.

    See Also
    --------
    export_fmu : the models of one mass, and a mechanical system alone.

    Examples
    --------
    >>> import tempfile
    >>> ball = zivi.symbolic.system(
    ...     "y", T="ydot**2/2", V="9.81*y", gaps={"floor": "y"}, e=0.5, inputs={"f": [1]}
    ... )
    >>> ctl = zivi.GapTracker(ball, h=1e-3, gains={"floor": (30, 17)})
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     files = zivi.fmu.export_loop(folder, ball, ctl, (0, 1), ([0.3], [0.0]), fmi=3)
    ...     [path.name for path in files]
    ['MechanicalLoop3.fmu']
    """
    plant = told("system", system)
    believed = told("controller's system", getattr(controller, "system", None))
    check_gap_tracker(controller)
    if controller.tasks:
        raise ValueError(f"tasks must not be set in an FMU of a loop, got {controller.tasks}")
    identifier("name", name)
    versions, binary = chosen_versions(fmi), binary_here()
    span, h = pair("t_span", t_span, "(t0, t1)"), sampling_period(controller)
    q, qdot = state_of(y0, system._n)
    model = system.model(len(q))
    check_start(system, model, span, q, qdot)
    check_believes("controller", controller.system, system, q)
    times = times_ahead(_zivi.grid_times(*span, h, 1), h, controller.delay, reference)
    given = reference_of(reference, times, system.gap_names, q, controller.tasks)
    sampled = times, system.gap_names, controller.tasks
    check_gap_reference(controller, given, model, (q, qdot), sampled)
    numbers = _loop_numbers((plant, believed), controller, q, qdot, given)
    loop = _describe_loop(plant, believed, name, (q, qdot))
    systems = {"plant": plant, "model": believed}
    return write_systems(out, "loop", systems, numbers, loop, versions, binary)


def _loop_numbers(
    systems: tuple[Exported, Exported],
    controller: GapTracker,
    q: Array,
    qdot: Array,
    given: MechanicalReference | None,
) -> Iterator[float]:
    """Return all numbers in the order of the binary."""
    settings, (plant, model) = controller.settings, systems
    n, m, r = len(q), plant.m, plant.control_inputs(q).r
    yield from (VERSION, n, m, r, 1, settings["delay"], settings["h"])
    yield from (*settings["posture"], settings["learn_offset"])
    yield from optional(settings["latch"])
    limits = settings["u_limits"]
    yield from optional(None if limits is None else limits.ravel())
    deviations, steps = controller._law.noise
    yield from (*deviations, *steps)
    for i, name in enumerate(plant.gap_names):
        force = settings["force"].get(name, np.nan)
        if callable(force):
            raise TypeError(f"force[{name!r}] must be a number in an FMU, not a function")
        yield from (
            *settings["gains"][name],
            float(model.e[i]),
            settings["horizon"],
            settings["shift"],
            force,
        )
    yield from (*q, *qdot)
    for system in systems:
        yield from part_numbers(system, q)
    yield 0 if given is None else len(given.q)
    if given is not None:
        for rows in (given.q, given.qdot, given.qddot, given.gaps, given.gap_rates):
            yield from rows.ravel()
        for rows in (given.accelerations, given.sides, given.contacts.astype(np.float64)):
            yield from rows.ravel()


def _describe_loop(
    plant: Exported,
    believed: Exported,
    name: str,
    start: tuple[Array, Array],
) -> FMU:
    """Describe the variables, in the order of the binary."""
    coordinates, gaps = plant.coordinate_names(len(start[0])), plant.gap_names
    controls = plant.control_inputs(start[0]).names
    rows = Rows()
    pushed = rows.add("disturbance_", coordinates, "real", "input", "generalised force on {}")
    forces = rows.add_motion(coordinates, gaps), pushed
    rows.add("held_", gaps, "boolean", "output", "whether the controller holds the contact {}")
    rows.add("u_", controls, "real", "output", "control {}")
    rows.add("status", ("",), "integer", "output", "bits of TickStatus")
    rows.add("n_refused", ("",), "integer", "output", "control updates so far that were rejected")
    rows.add("n_saturated", ("",), "integer", "output", "those whose control was cut")
    systems = {"plant_": plant, "model_": believed}
    parameters = rows.add_parameters(coordinates, start, systems)
    text = "A mechanical system with its tracker of gaps"
    return rows.model("loop", name, text, forces, parameters)


# FMUs of zivi's own models and of mechanical systems without a controller.


def export_fmu(
    out: str | os.PathLike[str],
    model: str | Iterable[str] | SymbolicSystem | Tree | None = None,
    fmi: int | Iterable[int] | None = None,
    *,
    y0: Any = None,
    name: str | None = None,
) -> list[Path]:
    """Write FMUs for co-simulation: native code, no compiler and no Python where they run.

    Parameters
    ----------
    out : path
        The output folder; it is created if necessary. Files of the same
        names are replaced.
    model : str, sequence of str, Tree or SymbolicSystem, optional
        Any of ``"mass"`` (a mass with impacts), ``"regulator"``, ``"tracker"`` (the controllers),
        ``"loop"`` (a mass with its tracker, without any delay) and ``"observer"``; by default all.
        Or a mechanical system without friction: a `zivi.Tree`, or one of `zivi.symbolic.system`,
        for which the export needs a C compiler. Inputs are generalised forces on the coordinates
        (``u_...``), outputs coordinates, velocities, gaps, contacts and contact forces; parameters
        are the start and those of the system. A step may have any length.
    fmi : {2, 3} or sequence of int, optional
        Version of FMI, by default both.
    y0 : (array_like, array_like), optional
        Coordinates and velocities of a mechanical system at the start, shape (n,) each.
    name : str, optional
        Of the unit of a mechanical system: a letter, then letters, digits and underscores; by
        default ``"MechanicalSystem"``.

    Returns
    -------
    list of pathlib.Path
        The files, such as ``ImpactingMass2.fmu`` for FMI 2.0.

    Raises
    ------
    ValueError
        For a model or a version that does not exist, and a start that is out of range.
    TypeError
        If `out` is not a path, or an argument not of the types above; for `y0` or `name` together
        with one of zivi's own models.
    FileNotFoundError
        If this installation was built without the binaries; the message names the build command.
    OSError
        If a file cannot be written.

    See Also
    --------
    zivi.fmu.export_loop : a mechanical system with its controller.
    zivi.simulate_closed_loop : the same loop in Python.

    Notes
    -----
    The steps of zivi's own models are those of the Python package, bit by bit. In co-simulation a
    value that an importer reads after a step and hands on is a step old; See ``docs/fmus.md`` for
    the order that closes a loop without delay. Two exports by one version are the same, byte by
    byte.

    References
    ----------
    Modelica Association, Functional Mock-up Interface Specification, versions 2.0 and 3.0.

    Examples
    --------
    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     [path.name for path in zivi.export_fmu(folder, "mass")]
    ['ImpactingMass2.fmu', 'ImpactingMass3.fmu']
    >>> rod = zivi.mechanics.Body("rod", mass=1.0, axis=[0, 1, 0], com=[0, 0, -1], inertia=0.1)
    >>> stop = zivi.mechanics.JointLimit("rod", lower=0.0)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     tree = zivi.Tree([rod], gaps=[stop], e=0.5)
    ...     [path.name for path in zivi.export_fmu(folder, tree, y0=([0.3], [0]), name="Rod")]
    ['Rod2.fmu', 'Rod3.fmu']
    """
    if not isinstance(out, str | os.PathLike):
        raise TypeError(
            f"out must be a path, got {type(out).__name__}; write zivi.export_fmu(folder, model)"
        )
    if isinstance(model, SymbolicSystem | Tree):
        return _export_mechanism(out, model, fmi, y0, "MechanicalSystem" if name is None else name)
    models = [MODELS[key] for key in _chosen_models(model)]
    if y0 is not None or name is not None:
        given = "y0" if name is None else "name"
        raise TypeError(f"{given} is for a mechanical system; zivi's own models do not have it")
    folder = Path(out)
    versions = chosen_versions(fmi)
    binaries = binaries_of("fmu")
    return [write_archive(folder, it, version, binaries) for it in models for version in versions]


def _export_mechanism(
    out: str | os.PathLike[str],
    system: SymbolicSystem | Tree,
    fmi: int | Iterable[int] | None,
    y0: Any,
    name: str,
) -> list[Path]:
    identifier("name", name)
    versions, binary = chosen_versions(fmi), binary_here()
    start = state_of(y0, system._n)
    check_start(system, system.model(len(start[0])), (0.0, 1.0), *start)
    model = variables_of(system, name, start)
    numbers = system_numbers(system, *start)
    return write_systems(out, "mechanism", {"plant": system}, numbers, model, versions, binary)


def _chosen_models(model: str | Iterable[str] | None) -> list[str]:
    if model is None:
        return list(MODELS)
    if callable(getattr(model, "step", None)):
        kind = model if isinstance(model, type) else type(model)
        raise TypeError(
            "an FMU runs without Python, so it has zivi's own models only: model must be one of "
            f"{', '.join(MODELS)}, got a controller, {kind.__name__}"
        )
    if isinstance(model, ImpactSystem | MechanicalSystem):
        raise TypeError(
            f"model must be a zivi.Tree, a zivi.symbolic.system or one of {', '.join(MODELS)}, got "
            f"{type(model).__name__}; the mass has its numbers as parameters, a mechanical system "
            "with its controller is exported by zivi.fmu.export_loop"
        )
    if not isinstance(model, str | Iterable):
        raise TypeError(f"model must be a name or several, got {model!r}")
    names = [model] if isinstance(model, str) else list(model)
    for name in names:
        if not (isinstance(name, str) and name in MODELS):
            raise ValueError(f"model must be one of {', '.join(MODELS)}, got {name!r}")
    return list(dict.fromkeys(names))
