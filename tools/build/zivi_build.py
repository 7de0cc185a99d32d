"""The build backend: maturin, the C library, and one readable line where Rust is missing."""

import os
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

# otherwise a compiler is downloaded, or a long traceback shown where that fails
os.environ.setdefault("MATURIN_NO_INSTALL_RUST", "1")

import maturin

MISSING = (
    "zivi: cargo is missing, which builds the extension. Install Rust >= 1.88 with rustup "
    "(https://rustup.rs), or a wheel for this machine."
)

get_requires_for_build_editable = maturin.get_requires_for_build_editable
get_requires_for_build_sdist = maturin.get_requires_for_build_sdist
get_requires_for_build_wheel = maturin.get_requires_for_build_wheel
build_sdist = maturin.build_sdist


def build_wheel(*arguments: Any, **settings: Any) -> str:
    """Build a wheel (PEP 517)."""
    _need_cargo()
    _native()
    return maturin.build_wheel(*arguments, **settings)


def build_editable(*arguments: Any, **settings: Any) -> str:
    """Build a wheel that points here (PEP 660)."""
    _need_cargo()
    _native()
    return maturin.build_editable(*arguments, **settings)


def prepare_metadata_for_build_wheel(*arguments: Any, **settings: Any) -> str:
    """Write the metadata of a wheel (PEP 517)."""
    _need_cargo()
    return maturin.prepare_metadata_for_build_wheel(*arguments, **settings)


prepare_metadata_for_build_editable = prepare_metadata_for_build_wheel


def _need_cargo() -> None:
    if shutil.which("cargo") is None:
        sys.exit(MISSING)


def _native() -> None:
    """Build what is beside the extension, or of it what `ZIVI_NATIVE` names; all works without.

    With the name `none` nothing is built.
    """
    script = Path(__file__).resolve().parent.parent / "native.py"
    names = os.environ.get("ZIVI_NATIVE", "").split()
    if names == ["none"]:
        return
    if subprocess.run([sys.executable, script, *names], check=False).returncode != 0:
        print("zivi: no C library and no FMU binaries here: see above", file=sys.stderr)
