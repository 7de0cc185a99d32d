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
from zivi.interop.fmu.table import Model

__all__ = ["PLATFORMS", "binaries_of", "chosen_versions", "write_archive"]

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
