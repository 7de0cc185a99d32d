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

__all__ = ["create"]


def create(path: Path, design: Design, identity: dict[str, Any], labels: Labels) -> bool:
    """Make an empty store, as a whole or not at all; tell whether it is ours.

    It is not if another run has made one at the same time.
    """
    needed("zarr", "studies in a folder")
    path.parent.mkdir(parents=True, exist_ok=True)
    draft = path.with_name(f".{path.name}.{uuid.uuid4().hex[:8]}")
    kinds = {name: KINDS[column.dtype.kind] for name, column in design.values.items()}
    head = Head.new(identity, labels, kinds)
    try:
        write_json(draft / EVENTS / "zarr.json", GROUP)
        for name, document in head.documents().items():
            write_json(draft / name / "zarr.json", document)
        head.write(draft)
        encoder = Encoder(head.documents())
        for name, column in design.values.items():
            for key, data in encoder.encoded(name, slice(None), column):
                write_bytes(draft, draft / key, data)
        os.replace(draft, path)
    except BaseException as error:
        shutil.rmtree(draft, ignore_errors=True)
        if isinstance(error, OSError) and path.is_dir() and any(path.iterdir()):
            return False
        raise
    return True
