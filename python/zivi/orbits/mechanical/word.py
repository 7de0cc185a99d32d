"""Words: what happens along a periodic motion, one letter an event.

========  ===================================================
letter    event that ends a segment
========  ===================================================
``I``     an impact of a gap
``S``     a plastic impact (e = 0), which closes the gap
``Z``     the first impact of an accumulation, which closes it
``L``     a contact ends, its force vanishes
``P``     a section: nothing happens
========  ===================================================
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

__all__ = ["LETTERS", "MOST_LETTERS", "Segment", "Word", "named", "parsed", "shortened"]

LETTERS = "ISZLP"
MOST_LETTERS = 64


@dataclasses.dataclass(frozen=True)
class Segment:
    """A flight, with some gaps closed, and the event that ends it."""

    contacts: tuple[int, ...]
    """The gaps that are closed."""
    kind: str
    gap: int
    """That of the event; -1 for a section."""
    after: tuple[int, ...]
    """The gaps that are closed after the event."""

    @property
    def kept(self) -> tuple[int, ...]:
        """The contacts that the event leaves closed."""
        return tuple(gap for gap in self.contacts if gap in self.after and gap != self.gap)


Word = tuple[Segment, ...]


def named(word: Word, gaps: Sequence[str]) -> tuple[str, ...]:
    """Give the letters with the names of the gaps."""
    return tuple(it.kind if it.gap < 0 else f"{it.kind} {gaps[it.gap]}" for it in word)


def shortened(letters: Sequence[str]) -> str:
    """Give letters in short: what repeats is counted."""
    parts: list[tuple[str, int]] = []
    for letter in letters:
        if parts and parts[-1][0] == letter:
            parts[-1] = (letter, parts[-1][1] + 1)
        else:
            parts.append((letter, 1))
    return " ".join(letter if count == 1 else f"{count}{letter}" for letter, count in parts)


def parsed(letters: Sequence[str], gaps: Sequence[str]) -> Word:
    """Read letters such as ``"I stop"``; a gap that lifts off before it closes begins closed.

    Raises
    ------
    ValueError
        For a letter or a gap that there is not, or an order that contradicts itself.
    """
    if not 1 <= len(letters) <= MOST_LETTERS:
        raise ValueError(f"start: a word has from 1 to {MOST_LETTERS} letters, got {len(letters)}")
    events = [_event(str(letter), list(gaps)) for letter in letters]
    first: dict[int, str] = {}
    for kind, gap in events:
        if kind in "SZL":
            first.setdefault(gap, kind)
    closed = [gap for gap, kind in first.items() if kind == "L"]
    return of_events(events, closed)


def of_events(events: Sequence[tuple[str, int]], closed: Sequence[int]) -> Word:
    """Make a word of its events, from the contacts with which it begins."""
    contacts, word = tuple(sorted(closed)), []
    for kind, gap in events:
        after = contacts
        if kind in "SZ":
            after = tuple(sorted({*contacts, gap}))
        elif kind == "L":
            after = tuple(it for it in contacts if it != gap)
        if (kind in "ISZ") == (gap in contacts) and kind != "P":
            state = "closed" if gap in contacts else "open"
            raise ValueError(f"start: the word has {kind} at gap {gap}, which is {state} there")
        word.append(Segment(contacts, kind, gap, after))
        contacts = after
    if contacts != tuple(sorted(closed)):
        raise ValueError("start: the word ends with other contacts than it begins with")
    return tuple(word)


def _event(letter: str, gaps: list[str]) -> tuple[str, int]:
    kind, _, name = letter.strip().partition(" ")
    if kind not in LETTERS or len(kind) != 1:
        raise ValueError(f"start: a letter is one of I, S, Z, L, P, got {letter!r}")
    if kind == "P":
        return kind, -1
    if name in gaps:
        return kind, gaps.index(name)
    if not name and len(gaps) == 1:
        return kind, 0
    raise ValueError(f"start: {letter!r} needs one of the gaps {', '.join(gaps)}")
