"""Writing FMUs: a description, the prebuilt binaries and a page, in a reproducible archive."""

from __future__ import annotations

import html
import io
import os
import zipfile
from collections.abc import Iterable
from pathlib import Path

import zivi._zivi as _zivi
from zivi.base.check import integer
from zivi.interop.fmu.description import IDENTIFIER, description
from zivi.interop.fmu.table import MODELS, Model
from zivi.system.mass import ImpactSystem
from zivi.system.mechanism import MechanicalSystem

__all__ = ["PLATFORMS", "binaries_of", "chosen_versions", "export_fmu", "write_archive"]

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


def export_fmu(
    out: str | os.PathLike[str],
    model: str | Iterable[str] | None = None,
    fmi: int | Iterable[int] | None = None,
) -> list[Path]:
    """Write FMUs for co-simulation: native code, no compiler and no Python where they run.

    Parameters
    ----------
    out : path
        The folder into which they are written; it is made if it is not there. Files of the same
        names are replaced.
    model : str or sequence of str, optional
        Any of ``"mass"`` (a mass with impacts), ``"regulator"``, ``"tracker"`` (the controllers),
        ``"loop"`` (a mass with its tracker, without any delay) and ``"observer"``; by default all.
    fmi : {2, 3} or sequence of int, optional
        Version of FMI, by default both.

    Returns
    -------
    list of pathlib.Path
        The files, such as ``ImpactingMass2.fmu`` for FMI 2.0.

    Raises
    ------
    ValueError
        For a model or a version that does not exist.
    TypeError
        If `out` is not a path, or `model` or `fmi` not of the types above.
    FileNotFoundError
        If this installation was built without the binaries; the message says how to build them.
    OSError
        If a file cannot be written.

    See Also
    --------
    zivi.simulate_closed_loop : the same loop in Python.

    Notes
    -----
    The steps are those of the Python package, bit by bit. In co-simulation a value that an importer
    reads after a step and hands on is a step old; ``docs/fmus.md`` says which order closes a loop
    without delay. Two exports by one version are the same, byte by byte.

    Examples
    --------
    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     [path.name for path in zivi.export_fmu(folder, "mass")]
    ['ImpactingMass2.fmu', 'ImpactingMass3.fmu']
    """
    folder = Path(out)
    models = [MODELS[key] for key in _chosen_models(model)]
    versions = chosen_versions(fmi)
    binaries = binaries_of("fmu")
    return [write_archive(folder, it, version, binaries) for it in models for version in versions]


def write_archive(
    out: str | os.PathLike[str],
    model: Model,
    fmi: int,
    binaries: dict[str, bytes],
    beside: dict[str, bytes] | None = None,
) -> Path:
    """Write the FMU of a model, with other files beside the binaries, into a folder."""
    folder = Path(out)
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"{model.name}{fmi}.fmu"
    _write_whole(path, _archive(model, fmi, binaries, beside or {}))
    return path


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
            f"an FMU has zivi's own models only, and no {type(model).__name__}: model must be one "
            f"of {', '.join(MODELS)}; the mass takes its numbers as parameters, a mechanical "
            "system with its controller is zivi.fmu.export_loop"
        )
    if not isinstance(model, str | Iterable):
        raise TypeError(f"model must be a name or several, got {model!r}")
    names = [model] if isinstance(model, str) else list(model)
    for name in names:
        if not (isinstance(name, str) and name in MODELS):
            raise ValueError(f"model must be one of {', '.join(MODELS)}, got {name!r}")
    return list(dict.fromkeys(names))


def chosen_versions(fmi: int | Iterable[int] | None) -> list[int]:
    """Read the versions of FMI that are asked for, by default all."""
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
    for platform, (_, ending) in PLATFORMS.items():
        path = folder / f"{platform}{ending}"
        if path.exists():
            found[platform] = path.read_bytes()
    if not found:
        raise FileNotFoundError(
            f"no binary for an FMU in {folder}: this installation was built without it. In the "
            "source tree, python tools/native.py builds it (make test and pip install do that too)"
        )
    return found


def _archive(model: Model, fmi: int, binaries: dict[str, bytes], beside: dict[str, bytes]) -> bytes:
    files = {
        **beside,
        "modelDescription.xml": description(model, fmi),
        "documentation/index.html": _page(model).encode(),
    }
    for platform, binary in binaries.items():
        old, ending = PLATFORMS[platform]
        name = platform if fmi == 3 else old
        if name is not None:
            files[f"binaries/{name}/{IDENTIFIER}{ending}"] = binary
    if not any(name.startswith("binaries/") for name in files):
        have = ", ".join(binaries)
        raise ValueError(f"fmi must be 3 here: FMI 2 has no name for {have}, got {fmi}")
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED, compresslevel=9) as archive:
        for name in sorted(files):
            entry = zipfile.ZipInfo(name, EPOCH)
            entry.compress_type = zipfile.ZIP_DEFLATED
            entry.create_system = 3  # the same on every machine
            entry.external_attr = 0o644 << 16
            archive.writestr(entry, files[name])
    return out.getvalue()


def _write_whole(path: Path, contents: bytes) -> None:
    beside = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        beside.write_bytes(contents)
        os.replace(beside, path)
    finally:
        beside.unlink(missing_ok=True)


def _page(model: Model) -> str:
    rows = "\n".join(
        "<tr>"
        + "".join(
            f"<td>{html.escape(cell)}</td>"
            for cell in (it.name, it.role, it.unit or "", f"{it.start:g}", it.description)
        )
        + "</tr>"
        for it in model.variables
    )
    length = (
        "A communication step that is not a multiple of h is made of equal shorter steps."
        if model.any_step
        else "The communication step must be a multiple of h."
    )
    return f"""<!DOCTYPE html>
<html lang="en"><head><meta charset="utf-8"><title>{model.name}</title></head><body>
<h1>{model.name}</h1>
<p>{html.escape(model.description)}. Made by zivi {_zivi.__version__}, Apache-2.0.</p>
<p>{length} Inputs are held over a step.</p>
{FEEDTHROUGH if model.feedthrough and model.key != "loop" else ""}
<table><tr><th>Name</th><th>Role</th><th>Unit</th><th>Start</th><th></th></tr>
{rows}
</table></body></html>
"""


FEEDTHROUGH = """<p>The control answers the inputs that were set since the last step. An importer
that sets the measurement, reads u and then makes a step closes the loop without delay; one that
makes a step and then reads u gets the control of the last period: a delay of one period, for which
"ahead" should be 2.</p>"""
