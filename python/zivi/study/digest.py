"""Digests of values by their content, the same in every process.

Numbers, texts, containers, arrays, tables, functions with what they hold and use, classes, and
every object that can be taken apart as pickle does it. What cannot be has no digest: whether it has
changed since a study was begun cannot be known.
"""

from __future__ import annotations

import ast
import copyreg
import dataclasses
import enum
import functools
import hashlib
import inspect
import linecache
import sys
import types
from collections.abc import Callable, Iterable
from typing import Any

import numpy as np

from zivi.study.uses import is_ours, kept_attributes, kept_cells, unformatted, used
from zivi.system.mass import ImpactSystem

__all__ = ["VERSION", "UndigestibleError", "digest", "module_of", "source", "state_of", "uses"]

VERSION = 2
"""Version of the digests: those of another one cannot be compared with them."""

PLAIN = (type(None), bool, int, float, complex, str, bytes, type(...), type(NotImplemented))
SHOWN = 16
"""Characters of a digest that are kept."""


class UndigestibleError(TypeError):
    """A value whose content cannot be told; the text says which."""


def digest(value: Any) -> str:
    """Tell the content of a value in a few characters.

    Raises
    ------
    UndigestibleError
        If a part of it is an open file, a lock, a pointer, ...
    """
    try:
        return hashlib.sha256(_Content().token(value)).hexdigest()[:SHOWN]
    except UndigestibleError:
        raise
    except Exception as error:  # whatever an object says as it is taken apart
        raise UndigestibleError(f"{_kind(value)} ({type(error).__name__}: {error})") from None


def state_of(function: Callable[..., Any]) -> str | None:
    """Tell what a function holds besides its text: defaults, closure, the object of a method.

    Returns
    -------
    str or None
        A digest; None if it holds nothing.
    """
    parts: tuple[Any, ...]
    if isinstance(function, functools.partial):
        parts = function.args, function.keywords, state_of(function.func)
    elif isinstance(function, types.MethodType):
        parts = function.__self__, state_of(function.__func__)
    elif isinstance(function, types.FunctionType):
        parts = _held_by(function)
    elif isinstance(function, type):
        parts = ()
    elif (inner := _inner(function)) is not None:
        return state_of(inner)
    else:
        parts = _state(function)
    return digest(parts) if any(parts) else None


def uses(function: Callable[..., Any]) -> str | None:
    """Tell what a function uses that it does not hold: helpers, other globals, its class.

    Returns
    -------
    str or None
        A digest; None if it uses nothing but libraries.
    """
    while isinstance(function, functools.partial):
        function = function.func
    if isinstance(function, types.MethodType):
        return uses(function.__func__)
    if (inner := _inner(function)) is not None:
        return uses(inner)
    content = _Content(tolerant=True)
    if isinstance(function, types.FunctionType):
        found = list(used(function)) if is_ours(function) else []
        return hashlib.sha256(content.token(found)).hexdigest()[:SHOWN] if found else None
    kind = function if isinstance(function, type) else type(function)
    return hashlib.sha256(content.token(kind)).hexdigest()[:SHOWN] if is_ours(kind) else None


def source(function: Callable[..., Any]) -> str | None:
    """Tell the text of a function, or of the class of a callable object, in a few characters."""
    while isinstance(function, functools.partial):
        function = function.func
    function = _inner(function) or function
    has_text = isinstance(function, type) or hasattr(function, "__code__")
    text = _text(function if has_text else type(function))
    return hashlib.sha256(text).hexdigest()[:SHOWN] if text else None


def _text(thing: Any) -> bytes:
    """Give the text of a function or class; its code where there is no text."""
    code = getattr(thing, "__code__", None)
    try:
        text = _text_of_lambda(code) if code and code.co_name == "<lambda>" else None
        return (text or inspect.getsource(thing)).encode()
    except (OSError, TypeError, SyntaxError):
        return _Content().token(code) if code else b""


def _text_of_lambda(code: types.CodeType) -> str | None:
    """Find the text of one of the lambdas that may share a line."""
    lines = "".join(linecache.getlines(code.co_filename))
    # those of instructions that stand for something in the text
    known = (it for it in code.co_positions() if None not in it)
    places = [it for it in known if (it[0], it[2]) != (it[1], it[3])]
    best: ast.Lambda | None = None
    for node in _lambdas(lines):
        body = node.body
        start, end = (body.lineno, body.col_offset), (body.end_lineno, body.end_col_offset)
        inside = all(start <= (a, c) and (b, d) <= end for a, b, c, d in places)
        if inside and places and (best is None or start > (best.lineno, best.col_offset)):
            best = node
    return ast.get_source_segment(lines, best) if best else None


@functools.lru_cache(8)
def _lambdas(text: str) -> list[ast.Lambda]:
    return [node for node in ast.walk(ast.parse(text)) if isinstance(node, ast.Lambda)]


def _held_by(function: types.FunctionType) -> tuple[Any, ...]:
    cells = [
        (name, _Empty if _is_empty(cell) else cell.cell_contents)
        for name, cell in kept_cells(function)
    ]
    return function.__defaults__, function.__kwdefaults__, cells, function.__dict__


class _Empty:
    """What a variable of a closure is before it gets its value."""


def _is_empty(cell: types.CellType) -> bool:
    try:
        _ = cell.cell_contents
    except ValueError:
        return True
    return False


def module_of(thing: Any) -> str | None:
    """Name the module of a class or function; what is zivi's may move within it."""
    module = getattr(thing, "__module__", None)
    return "zivi" if module is not None and str(module).startswith("zivi.") else module


def _kind(value: Any) -> str:
    return f"{module_of(type(value))}.{type(value).__qualname__}"


class _Content:
    """Reduces values to tokens: what is plain to its text, the rest to a hash of its parts."""

    def __init__(self, *, tolerant: bool = False) -> None:
        # whether what cannot be taken apart counts by its kind
        self._tolerant = tolerant
        self._known: dict[int, bytes] = {}
        # so that no other object gets the place of one that is known
        self._alive: list[Any] = []

    def token(self, value: Any) -> bytes:
        if type(value) in PLAIN:
            text = f"{type(value).__name__} {value!r}".encode("utf-8", "surrogatepass")
            return f"{len(text)} ".encode() + text
        if id(value) in self._known:
            return self._known[id(value)]
        self._alive.append(value)
        self._known[id(value)] = f"around {len(self._alive)} ".encode()
        found = hashlib.sha256(_kind(value).encode())
        try:
            for part in self._parts(value):
                found.update(part if isinstance(part, memoryview) else self.token(part))
        except RecursionError:
            raise
        except Exception:
            if not self._tolerant:
                raise
        self._known[id(value)] = found.digest()
        return self._known[id(value)]

    def _tolerated(self, value: Any) -> bytes:
        """Tell what a function uses, where a lock or a logger is no reason to refuse it."""
        before, self._tolerant = self._tolerant, True
        try:
            return self.token(value)
        finally:
            self._tolerant = before

    def _parts(self, value: Any) -> Iterable[Any]:
        """Take a value apart; a memoryview counts by its bytes."""
        kind = type(value)
        if kind in (tuple, list):
            return (len(value), *value)
        if kind is dict:
            return (len(value), *(part for pair in value.items() for part in pair))
        if kind in (set, frozenset):
            return sorted(self.token(part) for part in value)
        if kind in (np.ndarray, np.memmap) or isinstance(value, np.generic):
            return _of_array(np.asarray(value))
        if isinstance(value, types.CodeType):
            names = value.co_names, value.co_varnames, value.co_freevars, value.co_cellvars
            return (value.co_code, value.co_consts, *names, value.co_flags)
        if isinstance(value, type) and is_ours(value):
            return (value.__module__, value.__qualname__, self._tolerated(_of_class(value)))
        if isinstance(value, types.ModuleType | types.BuiltinFunctionType | type):
            owner = getattr(value, "__self__", None)
            named = (module_of(value), getattr(value, "__qualname__", None))
            return (*named, value.__name__, None if isinstance(owner, types.ModuleType) else owner)
        if isinstance(value, types.FunctionType):
            named = (module_of(value), value.__qualname__)
            if not is_ours(value):
                return (*named, _text(value), *_held_by(value))
            more = self._tolerated(list(used(value)))
            return (*named, _unformatted(value), *_held_by(value), more)
        if isinstance(value, staticmethod | classmethod):
            return (value.__func__,)
        if isinstance(value, property):
            return (value.fget, value.fset, value.fdel)
        if isinstance(value, types.MethodType):
            return (value.__func__, value.__self__)
        return self._of_object(value)

    def _of_object(self, value: Any) -> Iterable[Any]:
        if isinstance(value, ImpactSystem):  # not the address of a compiled force
            # a number where the law is Newton's
            return (value.force, value._e, value.wall)
        if (told := _of_library(value)) is not None:
            return told
        if (inner := _inner(value)) is not None:
            return (inner, getattr(value, "targetoptions", None))
        if callable(getattr(value, "__dask_tokenize__", None)):
            return (value.__dask_tokenize__(),)
        kind = type(value)
        return (kind if is_ours(kind) else None, *_state(value))


def _unformatted(function: types.FunctionType) -> bytes:
    """Give the text of a function without comments and layout; its code where there is none."""
    text = _text(function)
    try:
        return unformatted(text.decode()).encode()
    except UnicodeDecodeError:  # a digest of its code
        return text


def _inner(value: Any) -> types.FunctionType | None:
    """Give the function that a library compiled or cached (numba, functools).

    A wrapper of the user has a state of its own.
    """
    if isinstance(value, types.FunctionType | type) or not callable(value) or is_ours(type(value)):
        return None
    inner = getattr(value, "__wrapped__", None)
    return inner if isinstance(inner, types.FunctionType) else None


def _state(value: Any) -> tuple[Any, ...]:
    """Take an object apart, but for what its call keeps for the next one."""
    parts = _taken_apart(value)
    kept = kept_attributes(value)
    if not kept or len(parts) < 3 or type(parts[2]) is not dict:
        return parts
    state = {name: it for name, it in parts[2].items() if name not in kept}
    return (*parts[:2], state, *parts[3:])


SKIPPED = {
    *("__dict__", "__weakref__", "__doc__", "__module__", "__qualname__", "__annotations__"),
    *("__dataclass_fields__", "__dataclass_params__", "__match_args__", "__abstractmethods__"),
    *("__firstlineno__", "__static_attributes__", "__annotate__", "__annotate_func__"),
    *("__parameters__", "__orig_bases__", "__annotations_cache__", "__classdictcell__"),
}
"""What a class has that says nothing, or is said by something else."""
GENERATED = "<string>"
"""The file of the methods that a dataclass writes."""


def _of_class(kind: type) -> list[Any]:
    """Take a class apart: its bases, its attributes, its methods."""
    found: list[Any] = [*kind.__bases__, type(kind)]
    if issubclass(kind, enum.Enum):
        found += [(name, it.value) for name, it in kind.__members__.items()]
    if dataclasses.is_dataclass(kind):
        fields = dataclasses.fields(kind)
        found += [(it.name, it.default, it.default_factory, it.init) for it in fields]
    for name, value in sorted(vars(kind).items()):
        if name in SKIPPED or name.startswith("_abc_") or _is_slot(value):
            continue
        if issubclass(kind, enum.Enum) and not _is_method(value):
            continue
        code = getattr(value, "__code__", None)
        if dataclasses.is_dataclass(kind) and code and code.co_filename == GENERATED:
            continue
        found.append((name, value))
    return found


def _is_slot(value: Any) -> bool:
    return isinstance(value, types.MemberDescriptorType | types.GetSetDescriptorType)


def _is_method(value: Any) -> bool:
    return isinstance(value, types.FunctionType | property | staticmethod | classmethod)


def _taken_apart(value: Any) -> tuple[Any, ...]:
    """Take an object apart as pickle does."""
    reducer = copyreg.dispatch_table.get(type(value))
    try:
        reduced: Any = reducer(value) if reducer else value.__reduce_ex__(4)
    except Exception as error:  # whatever a library says
        raise UndigestibleError(f"{_kind(value)} ({error})") from None
    if isinstance(reduced, str):  # the name of something global
        return (module_of(value), reduced)
    make, arguments, state, items, pairs = [*reduced, None, None, None][:5]
    named = f"{module_of(make)}.{make.__qualname__}"
    return (named, arguments, state, list(items or ()), list(pairs or ()))


def _of_array(array: Any) -> Iterable[Any]:
    yield from (array.dtype.str, array.shape)
    if array.dtype.names is not None:  # not the bytes between the fields
        yield from (part for name in array.dtype.names for part in (name, array[name]))
    elif array.dtype.kind in "OT":
        yield array.tolist()
    elif array.dtype.char in "gG":  # bytes that mean nothing
        yield array.astype(str)
    else:
        yield memoryview(np.ascontiguousarray(array).tobytes())


def _of_library(value: Any) -> tuple[Any, ...] | None:
    """Take tables apart: what they hold, however they happen to hold it."""
    pandas, xarray = sys.modules.get("pandas"), sys.modules.get("xarray")
    if pandas is not None:
        if isinstance(value, pandas.DataFrame):
            columns = [value.iloc[:, k] for k in range(value.shape[1])]
            return (value.columns, value.index, value.attrs, *map(_of_column, columns))
        if isinstance(value, pandas.Series):
            return (value.name, value.index, value.attrs, *_of_column(value))
        if isinstance(value, pandas.MultiIndex):
            return (list(value.names), *(value.get_level_values(k) for k in range(value.nlevels)))
        if isinstance(value, pandas.Index):
            return (value.name, *_of_column(value))
    if xarray is not None:
        if isinstance(value, xarray.Dataset):
            coordinates = sorted(map(repr, value.coords))
            return (dict(value.attrs), dict(value.variables), coordinates)
        if isinstance(value, xarray.DataArray):
            return (value.name, value.variable, dict(value.coords.variables))
        if isinstance(value, xarray.Variable):
            return (value.dims, dict(value.attrs), value.values)
    return None


def _of_column(column: Any) -> tuple[Any, ...]:
    kind = column.dtype if column.dtype.kind == "O" else str(column.dtype)
    return (kind, column.to_numpy())
