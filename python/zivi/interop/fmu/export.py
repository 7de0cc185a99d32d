"""FMUs of zivi's own models, and of mechanical systems without a controller."""

from __future__ import annotations

import os
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from zivi.base.check import identifier
from zivi.interop.fmu.archive import binaries_of, chosen_versions, write_archive
from zivi.interop.fmu.mechanism import binary_here, system_numbers, variables_of, write_systems
from zivi.interop.fmu.table import MODELS
from zivi.simulation.mechanical_run import state_of
from zivi.system.mass import ImpactSystem
from zivi.system.mechanism import MechanicalSystem
from zivi.system.start import check_start
from zivi.system.symbolic.system import SymbolicSystem
from zivi.system.tree.system import Tree

__all__ = ["export_fmu"]


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
        The folder into which they are written; it is made if it is not there. Files of the same
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
        If `out` is not a path, or an argument not of the types above; for `y0` and `name` beside
        one of zivi's own models.
    FileNotFoundError
        If this installation was built without the binaries; the message says how to build them.
    OSError
        If a file cannot be written.

    See Also
    --------
    zivi.fmu.export_loop : a mechanical system with its controller.
    zivi.simulate_closed_loop : the same loop in Python.

    Notes
    -----
    The steps of zivi's own models are those of the Python package, bit by bit. In co-simulation a
    value that an importer reads after a step and hands on is a step old; ``docs/fmus.md`` says
    which order closes a loop without delay. Two exports by one version are the same, byte by byte.

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
        return _mechanism(out, model, fmi, y0, "MechanicalSystem" if name is None else name)
    models = [MODELS[key] for key in _chosen_models(model)]
    if y0 is not None or name is not None:
        given = "y0" if name is None else "name"
        raise TypeError(f"{given} is for a mechanical system, not for zivi's own models")
    folder = Path(out)
    versions = chosen_versions(fmi)
    binaries = binaries_of("fmu")
    return [write_archive(folder, it, version, binaries) for it in models for version in versions]


def _mechanism(
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
            f"an FMU has no {type(model).__name__}: model must be a zivi.Tree, a "
            f"zivi.symbolic.system or one of {', '.join(MODELS)}; the mass takes its numbers as "
            "parameters, a mechanical system with its controller is zivi.fmu.export_loop"
        )
    if not isinstance(model, str | Iterable):
        raise TypeError(f"model must be a name or several, got {model!r}")
    names = [model] if isinstance(model, str) else list(model)
    for name in names:
        if not (isinstance(name, str) and name in MODELS):
            raise ValueError(f"model must be one of {', '.join(MODELS)}, got {name!r}")
    return list(dict.fromkeys(names))
