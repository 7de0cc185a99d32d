"""Write what this version stores: ``cd tests && python -m stored.make VERSION``.

``VERSION.zip`` then holds a pickle of each object of `objects`, what was asked of it, each study of
`studies` half done, and a file of each kind of result.
"""

from __future__ import annotations

import json
import pickle
import sys
import tempfile
import zipfile
from pathlib import Path

import numpy as np

import zivi
from stored.objects import CASES
from stored.studies import STUDIES, half

SAVED = ("Trajectory", "Trajectory_steps", "ClosedLoop", "MechanicalTrajectory")
"""Objects that `zivi.files.save` writes."""


def plain(value: object) -> object:
    return value.tolist() if isinstance(value, np.ndarray | np.generic) else value


def main(version: str) -> None:
    """Write the archive."""
    archive = Path(__file__).parent / f"{version}.zip"
    told = {}
    with (
        tempfile.TemporaryDirectory() as folder,
        zipfile.ZipFile(archive, "w", zipfile.ZIP_DEFLATED) as whole,
    ):
        for name, (make, ask) in CASES.items():
            value = make()
            told[name] = plain(ask(value))
            whole.writestr(f"pickles/{name}.pickle", pickle.dumps(value))
            if name in SAVED:
                file = Path(folder, "results", f"{name}.nc")
                file.parent.mkdir(exist_ok=True)
                zivi.files.save(value, file)
        for name in STUDIES:
            half(name, Path(folder, "studies", name))
        for file in sorted(Path(folder).rglob("*")):
            if file.is_file():
                whole.write(file, file.relative_to(folder))
        whole.writestr("told.json", json.dumps(told, default=plain, indent=1))


if __name__ == "__main__":
    main(sys.argv[1])
