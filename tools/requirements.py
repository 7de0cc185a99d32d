"""The packages that extras of zivi ask for, a line each, for ``pip install --requirement``.

    python tools/requirements.py cli xarray

They can be fetched while the extension is compiled.
"""

import re
import sys
import tomllib
from collections.abc import Iterable
from pathlib import Path

PROJECT = tomllib.loads((Path(__file__).parents[1] / "pyproject.toml").read_text())["project"]
OWN = re.compile(r"zivi\[([\w,]+)\]")


def requirements(extras: Iterable[str]) -> list[str]:
    """Give the dependencies and those of the extras, each once."""
    found = list(PROJECT["dependencies"])
    for extra in extras:
        for line in PROJECT["optional-dependencies"][extra]:
            own = OWN.fullmatch(line)
            found += requirements(own[1].split(",")) if own else [line]
    return list(dict.fromkeys(found))


if __name__ == "__main__":
    print("\n".join(requirements(sys.argv[1:])))
