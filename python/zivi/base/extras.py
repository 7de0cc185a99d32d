"""Libraries that only a part of zivi needs, imported when they are."""

from __future__ import annotations

import importlib
from typing import Any

__all__ = ["have", "late", "needed"]

EXTRAS = {
    "matplotlib": "plot",
    "xarray": "xarray",
    "pandas": "xarray",
    "rich": "cli",
    "typer": "cli",
    "h5netcdf": "files",
    "zarr": "study",
    "pyarrow": "study",
    "scipy": "study",
    "dask": "dask",
    "distributed": "dask",
    "control": "control",
    "jax": "jax",
    "sympy": "symbolic",
    "mujoco": "mujoco",
    "gymnasium": "gym",
    "marimo": "lab",
    "plotly": "lab",
    "uvicorn": "lab",
}
"""The extra of the package that brings a library."""
NAMES = {"control": "python-control"}
"""What a library is called where that is not its module's name."""


def needed(module: str, purpose: str) -> Any:
    """Import a library of an extra; an ImportError says in one line how to get it."""
    try:
        return importlib.import_module(module)
    except ImportError as error:
        library = module.partition(".")[0]
        raise ImportError(
            f"{purpose} need {NAMES.get(library, library)}: "
            f"pip install 'zivi[{EXTRAS[library]}]' ({error})",
            name=library,
        ) from error


def have(module: str) -> bool:
    """Whether a library can be imported."""
    try:
        importlib.import_module(module)
    except ImportError:
        return False
    return True


def late(module: str, name: str) -> Any:
    """Give what a result calls of a module above its own, which is imported by that call."""
    return getattr(importlib.import_module(module), name)
