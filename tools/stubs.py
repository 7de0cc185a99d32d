"""Writes what type checkers and editors know of the methods, by the list of the core.

    python tools/stubs.py            after a change of a method
    python tools/stubs.py --check    fails if a stub is not up to date

``python/zivi/simulation/methods.pyi`` is written whole, of ``python/zivi/_zivi.pyi`` the part
between its two marks.
"""

import inspect
import sys
import textwrap
from pathlib import Path

from zivi import _zivi
from zivi.simulation.method_settings import annotation
from zivi.simulation.methods import METHODS

PACKAGE = Path(__file__).parents[1] / "python" / "zivi"
CLASSES, BINDING = PACKAGE / "simulation" / "methods.pyi", PACKAGE / "_zivi.pyi"
BEGIN, END = "# methods, by tools/stubs.py", "# end of the methods"

HEAD = """\
# by tools/stubs.py, of the methods of the core
import dataclasses

from zivi.simulation.method_settings import FixedSteps, Method, Settings

"""


def classes() -> str:
    """Give the stub of the classes of all methods."""
    names = ["METHODS", *sorted(["FixedSteps", "Method", "Settings", *_zivi.METHODS])]
    listed = "".join(f'    "{name}",\n' for name in names)
    parts = [f"{HEAD}__all__ = [\n{listed}]\n\nMETHODS: dict[str, type[Settings]]\n"]
    for name, entry in _zivi.METHODS.items():
        base = "FixedSteps" if entry.fixed_steps else "Settings"
        doc = textwrap.indent(f'r"""{inspect.getdoc(METHODS[name])}\n"""', "    ")
        fields = "".join(
            f"    {it.name}: {annotation(it)}{'' if it.required else ' = ...'}\n"
            for it in entry.settings
        )
        head = f"@dataclasses.dataclass(frozen=True)\nclass {name}({base}):\n"
        parts.append(f"{head}{doc}\n\n{fields}")
    return "\n".join(parts)


def binding() -> str:
    """Give the part of the stub of the extension that knows the methods."""
    lines = [BEGIN, "@final", "class Method:"]
    for name, entry in _zivi.METHODS.items():
        settings = [
            f"        {it.name}: {annotation(it)}{'' if it.required else ' = ...'},"
            for it in entry.settings
        ]
        lines += ["    @overload", "    def __new__("]
        lines += ["        cls,", f'        name: Literal["{name}"],', "        *,", *settings]
        lines += ["    ) -> Self: ..."]
    lines += ["    @overload", "    def __new__(cls, name: str, **settings: Any) -> Self: ..."]
    lines += ["", END]
    return "\n".join(lines)


def texts() -> dict[Path, str]:
    """Give each stub with what it should hold."""
    before, _, rest = BINDING.read_text(encoding="utf-8").partition(BEGIN)
    after = rest.partition(END)[2]
    return {CLASSES: classes(), BINDING: f"{before}{binding()}{after}"}


def main() -> None:
    """Write the stubs, or say which is not up to date."""
    stale = [
        path for path, text in texts().items() if not path.exists() or path.read_text() != text
    ]
    if "--check" in sys.argv[1:]:
        if stale:
            names = ", ".join(path.name for path in stale)
            sys.exit(f"{names}: not up to date, run python tools/stubs.py")
        return
    for path, text in texts().items():
        path.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
