"""The lock of a store: one run writes at a time."""

from __future__ import annotations

import os
from pathlib import Path

__all__ = ["locked"]


def locked(file: Path) -> int | None:
    """Keep others from writing, also after this process is killed, where the system can."""
    try:
        import fcntl
    except ImportError:
        return None
    file.parent.mkdir(exist_ok=True)
    descriptor = os.open(file, os.O_RDWR | os.O_CREAT, 0o666)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        # a run that extended the study has just put another file in this place
        if not (file.exists() and os.path.samestat(os.fstat(descriptor), file.stat())):
            raise BlockingIOError
    except BlockingIOError:
        os.close(descriptor)
        raise RuntimeError(f"another run writes to {file.parent.parent} at this moment") from None
    except OSError:  # a file system without locks
        os.close(descriptor)
        return None
    return descriptor
