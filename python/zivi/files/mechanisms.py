"""Mechanical systems from files: those of ``zivi simulate``, MJCF and URDF."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, TypeAlias

from zivi.files.runs import plant_of
from zivi.files.validation import FileError
from zivi.system.symbolic.system import SymbolicSystem
from zivi.system.tree.system import Tree

__all__ = ["mechanism_of"]

Start: TypeAlias = tuple[Any, Any]
READERS = {".xml": Tree.from_mjcf, ".mjcf": Tree.from_mjcf, ".urdf": Tree.from_urdf}
"""What reads a file of a model, by its ending."""


def mechanism_of(
    path: Path,
    *,
    gaps: Sequence[str] = (),
    e: Sequence[float] = (),
    q0: Sequence[float] = (),
    friction: str = "refuse",
) -> tuple[Tree | SymbolicSystem, Start]:
    """Read a tree of bodies, or a system with energies, and where it starts.

    Parameters
    ----------
    path : Path
        A TOML file of ``zivi simulate``, or MJCF (.xml) or URDF (.urdf) as MuJoCo reads it.
    gaps : sequence of str
        Of MJCF and URDF: joints with limits, and pairs of geoms such as ``"ball,floor"``; none for
        the limits of all joints.
    e : sequence of float
        Of these, too: a restitution for all gaps or one for each; none for 0.
    q0 : sequence of float
        Of these, too: the coordinates at the start; none for 0.
    friction : {"refuse", "ignore"}
        Of these, too: what happens to pairs with friction.

    Returns
    -------
    (Tree or SymbolicSystem, (q0, qdot0))
        The system, and its start.
    """
    reader = READERS.get(path.suffix.lower())
    if reader is None:
        given = {"--gap": gaps, "--e": e, "--q0": q0}
        for option in (name for name, value in given.items() if len(value)):
            raise FileError(f"{option} is for MJCF and URDF: {path} has it as a key")
        values, plant, _ = plant_of(path)
        if not isinstance(plant, Tree | SymbolicSystem):
            raise FileError(f"{path}: is a mass: --model mass has its numbers as parameters")
        return plant, values["y0"]
    if not path.is_file():
        raise FileError(f"{path}: is no file")
    pairs = [tuple(gap.split(",")) if "," in gap else gap for gap in gaps]
    laws: Any = e[0] if len(e) == 1 else list(e) or 0.0
    tree = reader(path, gaps=pairs or None, e=laws, friction=friction)
    zeros = [0.0] * (tree._n or 0)
    return tree, (list(q0) or zeros, zeros)
