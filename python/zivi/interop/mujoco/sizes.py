"""What MuJoCo would make of a file, before it reads it: it cannot be interrupted."""

from __future__ import annotations

import math
import os
import re

__all__ = ["check_sizes", "read_text"]

ELEMENTS = 100_000
"""Elements of a model, with all copies of those that are repeated."""
LARGEST = 50_000_000
"""Characters of all files of a model."""
LIMITS: dict[tuple[str, ...], int] = {
    ("nrow", "ncol"): 10_000_000,
    ("width", "height"): 100_000_000,
    ("gridsize",): 1_000_000,
    ("dim",): 1_000_000,
}
"""Attributes whose product is a size, and the largest."""
SIZE = 10_000
"""Largest number in an element ``size``, of data for each body, joint or the like."""

TAG = re.compile(r"""<(/?)([A-Za-z_][\w.-]*+)((?:[^<>"']++|"[^"]*+"|'[^']*+')*+)>""")
ATTRIBUTE = re.compile(r"""([\w-]++)\s*+=\s*+(?:"([^"]*+)"|'([^']*+)')""")


def read_text(path: str) -> str:
    """Read a file of a model; a ValueError says why it is none."""
    try:
        with open(path, encoding="utf-8-sig") as file:
            return file.read(LARGEST + 1)
    except UnicodeDecodeError as error:
        raise ValueError(
            f"{path} must be a text in UTF-8, got the byte {error.object[error.start]:#04x}; save "
            "it in UTF-8"
        ) from None


def check_sizes(text: str, folder: str) -> None:
    """Raise a ValueError for a model, with the files that it includes, that is too large."""
    _count(text, folder, 1, [LARGEST, ELEMENTS], ())


def _count(text: str, folder: str, copies: int, left: list[int], files: tuple[str, ...]) -> None:
    """Take what a text holds, so many times, from the characters and elements that are left."""
    left[0] -= len(text)
    if left[0] < 0:
        raise ValueError(f"a model must have at most {LARGEST // 10**6} MB of text")
    inside: list[int] = [copies]
    for end, tag, rest in TAG.findall(_without_comments(text)):
        if end:
            if tag == "replicate" and len(inside) > 1:
                inside.pop()
            continue
        given = {name: one or other for name, one, other in ATTRIBUTE.findall(rest)}
        times = math.prod(map(_whole, given.get("count", "").split()))
        left[1] -= inside[-1] * times
        if left[1] < 0:
            raise ValueError(
                f"a model must have at most {ELEMENTS} elements with all copies, got more at "
                f"<{tag}>; lower its count"
            )
        _check(tag, given)
        file = os.path.join(folder, given.get("file", ""))
        if tag in ("include", "model") and os.path.isfile(file):
            if file in files:
                raise ValueError(f"{file} must not include itself")
            _count(read_text(file), folder, inside[-1], left, (*files, file))
        if tag == "replicate" and not rest.endswith("/"):
            inside.append(inside[-1] * times)


def _without_comments(text: str) -> str:
    parts, at = [], 0
    while (start := text.find("<!--", at)) >= 0:
        parts.append(text[at:start])
        end = text.find("-->", start + 4)
        at = len(text) if end < 0 else end + 3
    return "".join([*parts, text[at:]])


def _check(tag: str, given: dict[str, str]) -> None:
    limits = {(name,): SIZE for name in given} if tag == "size" else LIMITS
    for names, limit in limits.items():
        sizes = [_whole(it) for name in names for it in given.get(name, "").split()]
        if sizes and math.prod(sizes) > limit:
            told = " x ".join(names)
            raise ValueError(f"<{tag}> must have {told} <= {limit}, got {math.prod(sizes)}")


def _whole(text: str) -> int:
    """Return a whole number > 0 that a text has; 1 for any other text, which MuJoCo refuses."""
    return max(1, int(text)) if text.isdecimal() and len(text) < 20 else 1
