"""What the pages show of the code, written when the site is built.

- ``<!-- keys of simulate -->`` becomes the table of the keys of a file, in three columns.
- A fence ```` ```{api} ```` with names becomes a summary of them and their docstrings.
- Each script of ``examples`` that ``gallery.md`` lists gets a page: its docstring, what it prints,
  its figure, the pages that link to it, its code. Links to the script lead there, and the list
  becomes a table with the figures.
- The short programs of ``examples/programs`` are one page.
"""

from __future__ import annotations

import ast
import enum
import importlib
import inspect
import json
import re
from pathlib import Path
from typing import TYPE_CHECKING

import zivi
from zivi.files import file_keys

if TYPE_CHECKING:
    from sphinx.application import Sphinx

DOCS = Path(__file__).parents[1]
EXAMPLES = DOCS.parent / "examples"
ITEM = re.compile(r"^- \[(.+?)\]\(\.\./examples/(\w+)\.py\)(.*)$", re.MULTILINE)
"""An example in the list of the gallery: title, script, remark."""
API = re.compile(r"^```\{api\}\n(.*?)^```$", re.DOTALL | re.MULTILINE)
FIGURES = {"readme_picture": "zeno"}
"""Figures of the repository that do not have the name of their script."""


# --- keys of files


def three_columns(page: str) -> str:
    """Put unit and default of a key behind what is allowed, its owner before its meaning."""

    def row(line: str) -> str:
        key, only, unit, allowed, default, meaning = (
            cell.strip() for cell in line.strip("|").split(" | ")
        )
        value = f"{allowed} ({unit})" if unit not in ("", "1") else allowed
        if "required" in default:
            value += f", {default}" if default.startswith("**") else f"; {default}"
        elif default:
            value += f"; default {default}"
        owner = f"*{only}:* " if only else ""
        return f"| {key} | {value} | {owner}{meaning} |"

    def table(match: re.Match[str]) -> str:
        rows = "\n".join(map(row, match[1].splitlines()))
        return f"| key | value | meaning |\n|---|---|---|\n{rows}\n"

    return re.sub(re.escape(file_keys.HEAD) + r"((?:\|.*\n)+)", table, page)


# --- the reference


def names(page: str) -> list[str]:
    """Names that a page of the reference describes, without ``zivi.``."""
    return [name.removesuffix("()") for fence in API.findall(page) for name in fence.split()]


def directive(name: str) -> str:
    """Give the directive that shows a docstring; ``NAME()`` is a class that users do not make."""
    parts = name.removesuffix("()").split(".")
    thing: object = zivi
    for i, part in enumerate(parts, 1):
        if not hasattr(thing, part):
            importlib.import_module(".".join(["zivi", *parts[:i]]))
        thing = getattr(thing, part)
    if not isinstance(thing, type):
        return f".. auto{'module' if inspect.ismodule(thing) else 'function'}:: zivi.{name}\n"
    if issubclass(thing, BaseException) and not name.endswith("()"):
        return f".. autoexception:: zivi.{name}\n"
    options = [":members:"]
    if issubclass(thing, enum.Enum):
        options.append(":undoc-members:")
    elif not issubclass(thing, (tuple, BaseException)):
        options.append(":inherited-members:")
    # fields of a named tuple are described once, with the class
    fields = ", ".join(getattr(thing, "_fields", ()))
    if inspect.isfunction(vars(thing).get("__call__")):
        options.append(":special-members: __call__")
        options += [f":exclude-members: {fields}"] if fields else []
    else:
        options.append(f":exclude-members: __new__, __init__{fields and ', '}{fields}")
    return f".. autoclass:: zivi.{name}\n" + "".join(f"   {option}\n" for option in options)


def reference(page: str) -> str:
    """Put the docstrings in place of the names."""

    def shown(match: re.Match[str]) -> str:
        listed = match[1].split()
        out = ["```{eval-rst}", ".. py:currentmodule:: zivi", ""]
        if len(listed) > 1:
            out += [".. autosummary::", "   :nosignatures:", ""]
            out += [*(f"   {name.removesuffix('()')}" for name in listed), ""]
        return "\n".join([*out, *map(directive, listed), "```"])

    return API.sub(shown, page)


# --- the gallery


def listed() -> dict[str, str]:
    """Titles of the pages of the gallery, by their scripts."""
    return {
        name: title for title, name, _ in ITEM.findall((DOCS / "gallery.md").read_text("utf-8"))
    }


def to_gallery(page: str) -> str:
    """Let links to scripts lead to their pages."""
    for name in listed():
        page = page.replace(f"](../examples/{name}.py)", f"](gallery/{name}.md)")
    return page.replace("](../examples/programs)", "](gallery/programs.md)")


def with_figures(page: str) -> str:
    """Make tables of the lists of examples."""

    def row(match: re.Match[str]) -> str:
        title, name, remark = match.groups()
        figure = f"figures/{FIGURES.get(name, name)}.png"
        has = (DOCS / figure).exists()
        picture = f"[![{title}]({figure})](gallery/{name}.md)" if has else ""
        return f"| {picture} | [{title}](gallery/{name}.md){remark} |"

    return re.sub(r"\n\n(?=\| )", "\n\n| | |\n|---|---|\n", ITEM.sub(row, page))


def gallery_page(name: str) -> str:
    """Write the page of a script."""
    script = (EXAMPLES / f"{name}.py").read_text("utf-8")
    tree = ast.parse(script)
    told = ast.get_docstring(tree) or ""
    head, _, rest = told.partition("\n\n")
    text = re.sub(
        r"^Run as ``.*\Z|^ {4}python examples/.*\Z", "", rest, flags=re.DOTALL | re.MULTILINE
    )
    links = [
        f"[{page.read_text('utf-8').partition('# ')[2].partition(chr(10))[0]}](../{page.name})"
        for page in sorted(DOCS.glob("*.md"))
        if page.stem != "gallery" and f"](../examples/{name}.py)" in page.read_text("utf-8")
    ]
    film = DOCS / "figures" / f"{name}.gif"
    parts = [
        "---\nfile_format: mystnb\nkernelspec:\n  name: python3\n---",
        f"# {listed()[name]}",
        f"{head}\n\n{text}".strip(),
        *([f"See {', '.join(links)}."] if links else []),
        "```{code-cell} python\n---\ntags: [remove-input]\nmystnb:\n  image:\n"
        f"    alt: {json.dumps(f'What the script draws: {listed()[name]}')}\n---\n"
        f"%run ../_gallery.py {name}{'' if 'out.png' in told else ' --no-figure'}\n```",
        *([f"![{listed()[name]}: a film](../figures/{film.name})"] if film.exists() else []),
        f"## The script\n\n`examples/{name}.py`",
        f"```{{literalinclude}} ../../examples/{name}.py\n:language: python\n"
        f":lines: {(tree.body[0].end_lineno or 0) + 2}-\n```",
    ]
    return "\n\n".join(parts) + "\n"


def programs() -> list[tuple[str, str, str]]:
    """Give what each short program says of itself, its code, and what it prints."""
    found = []
    for path in sorted((EXAMPLES / "programs").glob("*.py")):
        script = path.read_text("utf-8")
        told = ast.get_docstring(ast.parse(script)) or ""
        code, _, printed = script.partition('"""\n\n')[2].partition("\n# It prints:\n")
        found.append((told, code, re.sub(r"^# ?", "", printed, flags=re.MULTILINE)))
    return found


def programs_page() -> str:
    """Write the page of the short programs."""
    head = "Copy one and run it: each stands for itself, from `examples/programs`."
    parts = ["# Twelve programs", head]
    for told, code, printed in programs():
        title, _, text = told.partition("\n\n")
        parts += [f"## {title.rstrip('.')}", *filter(None, [text.strip()])]
        parts += [f"```python\n{code}```", f"```text\n{printed}```"]
    return "\n\n".join(parts) + "\n"


def gallery(folder: Path) -> None:
    """Write the pages of the gallery into a folder, those that changed."""
    folder.mkdir(exist_ok=True)
    pages = {name: gallery_page(name) for name in listed()} | {"programs": programs_page()}
    for path in folder.glob("*.md"):
        if path.stem not in pages:
            path.unlink()
    for name, page in pages.items():
        path = folder / f"{name}.md"
        if not path.exists() or path.read_text("utf-8") != page:
            path.write_text(page, "utf-8")


# --- the build


def shown(name: str, page: str) -> str:
    """Give a page as the site has it."""
    if name == "gallery":
        page = with_figures(page)
    return reference(three_columns(file_keys.insert(to_gallery(page))))


def setup(app: Sphinx) -> dict[str, bool]:
    """Register what writes."""
    from docutils import nodes

    def source(_: Sphinx, name: str, text: list[str]) -> None:
        text[0] = shown(name, text[0])

    def told(_: Sphinx, tree: nodes.document, name: str) -> None:
        for image in tree.findall(nodes.image):
            image["alt"] = image.get("alt") or "What the code above draws."

    app.connect("doctree-resolved", told)
    app.connect("builder-inited", lambda app: gallery(Path(app.srcdir) / "gallery"))
    app.connect("source-read", source)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
