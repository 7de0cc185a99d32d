"""Blocks of Python on the pages: found, run in the order of a page, compared with what they say.

What a comment after a ``print`` says is what is printed: all of it, or what is before a colon; or
its numbers, to the digits that are given. Words that are not printed are a remark.
"""

import contextlib
import importlib
import io
import re
import warnings
from pathlib import Path

import zivi

DOCS = Path(__file__).parents[1] / "docs"
PRINT = re.compile(r"^ *(?:print\(.*\)|\))  # (.*)$", re.MULTILINE)
"""A promise, after a ``print`` of one line or of several."""


def blocks(page):
    """Blocks of code of a page; whether the site executes them."""
    text = (DOCS / f"{page}.md").read_text()
    pattern = r"^```(\{code-cell\} )?python\n(.*?)^```$"
    return [(bool(cell), code) for cell, code in re.findall(pattern, text, re.DOTALL | re.M)]


def missing(code):
    """Libraries that a block needs and this machine lacks."""
    wanted = re.findall(r"^(?:import|from) (\w+(?:\.\w+)?)", code, re.MULTILINE)
    wanted += ["zarr", "pyarrow"] if "out=" in code else []
    for name in wanted:
        with contextlib.suppress(ImportError):
            importlib.import_module(name)
            continue
        yield name


def run(code, names):
    """Run a block and compare what it prints with what its comments say; it warns of no model."""
    out = io.StringIO()
    with contextlib.redirect_stdout(out), warnings.catch_warnings():
        warnings.simplefilter("error", zivi.ModelWarning)
        exec(compile(code, "page", "exec"), names)
    printed = out.getvalue().splitlines()
    promised = PRINT.findall(code)
    assert len(printed) >= len(promised)
    for line, comment in zip(printed, promised, strict=False):
        assert agrees(line, comment), (line, comment)


NUMBER = re.compile(r"-?\d+\.?\d*(?:e[+-]?\d+)?")


def agrees(line, comment):
    """Whether what is printed is what the comment says."""
    if line == comment or comment.startswith(f"{line}: "):
        return True
    promise = re.split(r" = |: ", comment)[0]
    told, found = NUMBER.findall(promise), NUMBER.findall(line)
    if not told:
        return " " in promise
    return len(told) <= len(found) and all(map(rounded, told, found))


def rounded(told, found):
    """Whether a number is another one, but for the digits that are not given."""
    mantissa, _, exponent = told.partition("e")
    last = 10.0 ** (int(exponent or 0) - len(mantissa.partition(".")[2]))
    return abs(float(told) - float(found)) <= 0.5 * last * (1 + 1e-9)
