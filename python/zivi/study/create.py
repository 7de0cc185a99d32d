"""Makes the folder of a new study."""

from __future__ import annotations

import os
import shutil
import uuid
from pathlib import Path
from typing import Any

from zivi.base.extras import needed
from zivi.study.design import Design
from zivi.study.encode import Encoder
from zivi.study.form import EVENTS, GROUP, KINDS
from zivi.study.head import Head, write_json
from zivi.study.replacement import write_bytes
from zivi.study.store import Labels

__all__ = ["create", "head_of", "write_empty"]


def create(path: Path, design: Design, identity: dict[str, Any], labels: Labels) -> bool:
    """Make an empty store, as a whole or not at all; tell whether it is ours.

    It is not if another run has made one at the same time.
    """
    needed("zarr", "studies in a folder")
    path.parent.mkdir(parents=True, exist_ok=True)
    draft = path.with_name(f".{path.name}.{uuid.uuid4().hex[:8]}")
    head = head_of(design, identity, labels)
    try:
        write_empty(draft, head, design)
        os.replace(draft, path)
    except BaseException as error:
        shutil.rmtree(draft, ignore_errors=True)
        if isinstance(error, OSError) and path.is_dir() and any(path.iterdir()):
            return False
        raise
    return True


def head_of(design: Design, identity: dict[str, Any], labels: Labels) -> Head:
    """Make the head of a store without results."""
    kinds = {name: KINDS[column.dtype.kind] for name, column in design.values.items()}
    return Head.new(identity, labels, kinds)


def write_empty(folder: Path, head: Head, design: Design) -> None:
    """Write the head, the metadata of all arrays and the parameters."""
    write_json(folder / EVENTS / "zarr.json", GROUP)
    for name, document in head.documents().items():
        write_json(folder / name / "zarr.json", document)
    head.write(folder)
    encoder = Encoder(head.documents())
    for name, column in design.values.items():
        for key, data in encoder.encoded(name, slice(None), column):
            write_bytes(folder, folder / key, data)
