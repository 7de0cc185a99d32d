"""Where the parts of zivi for other languages are: the C library and its header."""

from __future__ import annotations

from pathlib import Path

from zivi.interop.c_controller import gap_tracker_source

__all__ = ["gap_tracker_source", "prefix"]


def prefix() -> Path:
    """Give the folder with ``include/zivi.h`` and ``lib/libzivi.a``, laid out like ``/usr/local``.

    In it are ``lib/pkgconfig`` and ``lib/cmake`` too.

    Returns
    -------
    pathlib.Path
        A folder of the installed package.

    Raises
    ------
    FileNotFoundError
        If this installation was built without them; the message says how to build them.

    Examples
    --------
    >>> from zivi import native
    >>> (native.prefix() / "include" / "zivi.h").exists()
    True
    """
    folder = Path(__file__).parent / "_native"
    if not (folder / "include" / "zivi.h").exists():
        raise FileNotFoundError(
            f"no C library in {folder}: this installation was built without it. In the source "
            "tree, python tools/native.py builds it (make does that too)"
        )
    return folder
