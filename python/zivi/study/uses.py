"""What the code of a function refers to: global names, attributes of modules, imports."""

from __future__ import annotations

import ast
import builtins
import dis
import functools
import importlib.util
import inspect
import sys
import sysconfig
import textwrap
import types
from collections.abc import Iterator
from pathlib import Path
from typing import Any

__all__ = ["is_ours", "kept_attributes", "kept_cells", "unformatted", "used"]

DYNAMIC = {"getattr", "globals", "vars", "eval", "exec", "import_module", "__import__"}
"""Calls by which names come from texts."""
CHANGING = {
    *("append", "extend", "insert", "add", "update", "setdefault", "pop", "popitem", "clear"),
    *("remove", "discard", "move_to_end", "appendleft"),
}
"""Methods by which a function keeps something for its next call."""
MISSING = "no such name"


def used(function: types.FunctionType) -> Iterator[tuple[str, Any]]:
    """Give what a function looks up outside of itself, by name, in the order of the names.

    Not what it writes itself: counters and results kept for the next call are no part of the study.
    """
    codes = list(_codes(function.__code__))
    names = {name for code in codes for name in code.co_names}
    texts = {it for code in codes for it in code.co_consts if isinstance(it, str)}
    written = _written(function)
    if names & DYNAMIC:
        names |= texts
    for name in sorted(names & function.__globals__.keys() - written):
        value = function.__globals__[name]
        yield name, _of_module(value, names, set()) if _is_module(value) else value
    for name in sorted(_imported(codes, function.__globals__)):
        yield f"import {name}", _text_of_module(name)
    for name in sorted(_globals(codes) - function.__globals__.keys() - vars(builtins).keys()):
        yield name, MISSING


def kept_cells(function: types.FunctionType) -> Iterator[tuple[str, types.CellType]]:
    """Give the variables of a closure that the function does not write itself."""
    written = _written(function)
    for name, cell in zip(function.__code__.co_freevars, function.__closure__ or (), strict=True):
        if name not in written:
            yield name, cell


def kept_attributes(value: Any) -> set[str]:
    """Name the attributes of a callable object that its call writes: they are no settings."""
    call = vars(type(value)).get("__call__")
    if not isinstance(call, types.FunctionType):
        return set()
    steps = (it for code in _codes(call.__code__) for it in dis.get_instructions(code))
    return {it.argval for it in steps if it.opname in ("STORE_ATTR", "DELETE_ATTR")}


def is_ours(thing: Any) -> bool:
    """Whether a function, class or module belongs to the user, not to an installed library."""
    name = thing.__name__ if isinstance(thing, types.ModuleType) else thing.__module__
    return name is None or _is_users(str(name))


@functools.lru_cache(1024)
def _is_users(module: str) -> bool:
    root = module.partition(".")[0]
    if root == "__main__":
        return True
    if root == "zivi" or root in sys.stdlib_module_names:
        return False
    folders = {sysconfig.get_paths()[key] for key in ("purelib", "platlib")}
    return not any(Path(file).is_relative_to(it) for it in folders for file in _files(root))


def _files(root: str) -> list[str]:
    """Tell where a module or package at the top is, also before it is imported."""
    try:
        spec = getattr(sys.modules.get(root), "__spec__", None) or importlib.util.find_spec(root)
    except (ImportError, ValueError):
        spec = None
    file = getattr(sys.modules.get(root), "__file__", None)
    if spec is None:
        return [file] if file else []
    return [it for it in (spec.origin, *(spec.submodule_search_locations or ())) if it]


def unformatted(text: str) -> str:
    """Give the text of a function or class without comments and layout."""
    try:
        return ast.unparse(ast.parse(textwrap.dedent(text)))
    except (SyntaxError, ValueError, RecursionError):
        return text


def _codes(code: types.CodeType) -> Iterator[types.CodeType]:
    yield code
    for part in code.co_consts:
        if isinstance(part, types.CodeType):
            yield from _codes(part)


def _globals(codes: list[types.CodeType]) -> set[str]:
    steps = (step for code in codes for step in dis.get_instructions(code))
    return {step.argval for step in steps if step.opname in ("LOAD_GLOBAL", "LOAD_NAME")}


def _is_module(value: Any) -> bool:
    return isinstance(value, types.ModuleType)


def _of_module(module: types.ModuleType, names: set[str], known: set[int]) -> Any:
    """Give what may be looked up in a module of the user; a library by its name."""
    if not is_ours(module) or id(module) in known:
        return module
    known.add(id(module))
    there = sorted(names & vars(module).keys())
    values = ((name, vars(module)[name]) for name in there)
    return [
        module.__name__,
        *((name, _of_module(it, names, known) if _is_module(it) else it) for name, it in values),
    ]


def _imported(codes: list[types.CodeType], scope: dict[str, Any]) -> set[str]:
    """Name the modules of the user that are imported when the function runs."""
    found = set()
    for code in codes:
        steps = list(dis.get_instructions(code))
        for number, step in enumerate(steps):
            if step.opname == "IMPORT_NAME":
                level = steps[number - 2].argval if number > 1 else 0
                name = "." * level + step.argval if isinstance(level, int) else step.argval
                found |= _absolute(name, scope)
    return {name for name in found if _is_users(name)}


def _absolute(name: str, scope: dict[str, Any]) -> set[str]:
    try:
        return {importlib.util.resolve_name(name, scope.get("__package__") or None)}
    except ImportError:
        return set()


def _text_of_module(name: str) -> str:
    """Give the text of a module without importing it."""
    try:
        spec = importlib.util.find_spec(name)
        return unformatted(Path(spec.origin).read_text()) if spec and spec.origin else MISSING
    except (ImportError, AttributeError, ValueError, OSError, UnicodeDecodeError):
        return MISSING


def _written(function: types.FunctionType) -> set[str]:
    """Name the variables outside of a function that it assigns, or changes in place."""
    steps = (it for code in _codes(function.__code__) for it in dis.get_instructions(code))
    found = {it.argval for it in steps if it.opname in ("STORE_GLOBAL", "DELETE_GLOBAL")}
    free = set(function.__code__.co_freevars)
    steps = (it for code in _codes(function.__code__) for it in dis.get_instructions(code))
    found |= {it.argval for it in steps if it.opname == "STORE_DEREF" and it.argval in free}
    try:
        tree = ast.parse(textwrap.dedent(inspect.getsource(function)))
    except (OSError, TypeError, SyntaxError, ValueError):
        return found
    return found | {name for node in ast.walk(tree) for name in _changed_by(node)}


def _changed_by(node: ast.AST) -> Iterator[str]:
    """Name what an assignment to an item, or a method that changes a container, works on."""
    target: ast.expr | None = None
    if isinstance(node, ast.Subscript) and isinstance(node.ctx, ast.Store | ast.Del):
        target = node.value
    if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute):
        target = node.func.value if node.func.attr in CHANGING else None
    if isinstance(target, ast.Name):
        yield target.id
