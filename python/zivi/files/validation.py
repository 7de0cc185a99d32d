"""What is wrong with a file, told with the file, the key and what is allowed."""

from __future__ import annotations

import contextlib
import json
import re
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

from zivi.base.habits import closest

__all__ = ["FileError", "Mistakes", "got_value", "joined", "suggestion"]

BARE = re.compile(r"[A-Za-z0-9_-]+")
"""Keys that TOML takes without quotes."""
LONGEST = 60
"""Characters of a wrong value that are shown."""


MEANT = dict.fromkeys(("restitution", "coefficient_of_restitution", "cor", "epsilon", "eps"), "e")
MEANT |= dict.fromkeys(("dt", "step", "step_size", "timestep"), "h")
MEANT |= dict.fromkeys(("frequency", "freq", "w"), "omega")
MEANT |= dict.fromkeys(("time", "span", "t_end", "duration"), "t_span")
MEANT |= dict.fromkeys(("start", "initial", "x0", "state"), "y0")
MEANT |= {"g": "gravity", "k": "stiffness", "c": "damping", "a": "amplitude", "tol": "rtol"}
"""Keys by names that other tools have for them."""


class FileError(ValueError):
    """A file that cannot be used; the text names it and everything that is wrong with it."""


class Mistakes:
    """Collects what is wrong with one file.

    Parameters
    ----------
    file : Path
        The file.
    """

    def __init__(self, file: Path) -> None:
        self.file = file
        self.found: list[str] = []

    def add(self, key: str, text: str) -> None:
        """Note that something is wrong with a key."""
        self.found.append(f"{self.file}: {key} {text}" if key else f"{self.file}: {text}")

    def stop(self) -> None:
        """Raise if anything was noted."""
        if self.found:
            raise FileError("\n".join(self.found))

    @contextlib.contextmanager
    def naming(self, keys: Mapping[str, str], otherwise: str = "") -> Iterator[None]:
        """Turn an error about an argument into one about its key.

        Parameters
        ----------
        keys : dict
            The key of each argument that the library may name.
        otherwise : str
            The key of an error that names none of them.
        """
        try:
            yield
        except FileError:
            raise
        except (ValueError, TypeError) as error:
            argument, rest = _argument(str(error))
            if argument in keys:
                self.add(keys[argument], rest)
            else:
                self.add(f"{otherwise}:" if otherwise else "", str(error))
            raise FileError("\n".join(self.found)) from error


def _argument(message: str) -> tuple[str, str]:
    """Split an error into the argument it names, ``mu2`` or ``bounds['e']``, and the rest."""
    found = re.match(r"(\w+)(?:\[['\"]?(\w+)['\"]?\])? (.*)", message, re.DOTALL)
    return (found[2] or found[1], found[3]) if found else ("", message)


def joined(path: str, name: str) -> str:
    """Append a name to the path of a table."""
    shown = name if BARE.fullmatch(name) else json.dumps(name)
    return f"{path}.{shown}" if path else shown


def got_value(value: Any) -> str:
    """Show a wrong value in a few characters."""
    text = repr(value)
    return f"got {text if len(text) <= LONGEST else text[: LONGEST - 3] + '...'}"


def suggestion(name: str, known: Iterable[str]) -> str:
    """Say which name was probably meant, and all that there are."""
    names = list(known)
    known_as = MEANT.get(name.lower())
    close = known_as if known_as in names else closest(name, names, 0.5)
    meant = f"; did you mean {close!r}?" if close else ";"
    return f"{meant} allowed: {', '.join(names) if names else 'nothing'}"
