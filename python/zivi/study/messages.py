"""What is told of an exception: one text, which any file and any terminal can take."""

from __future__ import annotations

import unicodedata

__all__ = ["LONGEST", "message_of", "writable"]

LONGEST = 1000
"""Characters of a message that are kept."""


def message_of(error: BaseException) -> str:
    """Tell an exception in one text, which any file and any terminal can take."""
    try:
        text = f"{type(error).__name__}: {error}"[:LONGEST]
    except Exception as other:  # of its own __str__
        text = f"{type(error).__name__}, whose text raises {type(other).__name__}"
    return writable(text)


def writable(text: str) -> str:
    """Escape what is no letter, half a pair of UTF-16 or a control character, and cut the text."""
    return "".join(map(_escaped, text[:LONGEST]))[:LONGEST]


def _escaped(letter: str) -> str:
    if letter in "\n\t" or unicodedata.category(letter) not in ("Cc", "Cs"):
        return letter
    return letter.encode("unicode_escape", "surrogatepass").decode("ascii")
