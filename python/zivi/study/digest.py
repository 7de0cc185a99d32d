"""Identity of a study: digests of functions and values by content."""

from __future__ import annotations

import ast
import builtins
import copyreg
import dataclasses
import dis
import enum
import functools
import hashlib
import importlib.util
import inspect
import json
import linecache
import re
import sys
import sysconfig
import textwrap
import types
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

import zivi._zivi as _zivi
from zivi.study.design import Design
from zivi.system.mass import ImpactSystem

# Names that the code of a function refers to: globals, attributes of modules, imports.

DYNAMIC = {"getattr", "globals", "vars", "eval", "exec", "import_module", "__import__"}
"""Calls by which names come from texts."""
CHANGING = {
    *("append", "extend", "insert", "add", "update", "setdefault", "pop", "popitem", "clear"),
    *("remove", "discard", "move_to_end", "appendleft"),
}
"""Methods by which a function keeps something for its next call."""
MISSING = "no such name"


def used(function: types.FunctionType) -> Iterator[tuple[str, Any]]:
    """Yield the globals that a function uses, with their names, in the order of the names.

    Globals that it writes itself (counters, caches) do not belong to the study.
    """
    codes = list(_codes(function.__code__))
    names = {name for code in codes for name in code.co_names}
    texts = {it for code in codes for it in code.co_consts if isinstance(it, str)}
    written = _assigned_names(function)
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
    """Yield the closure variables that the function does not write itself."""
    written = _assigned_names(function)
    for name, cell in zip(function.__code__.co_freevars, function.__closure__ or (), strict=True):
        if name not in written:
            yield name, cell


def kept_attributes(value: Any) -> set[str]:
    """Return the attributes that the call of an object writes: they are not settings."""
    call = vars(type(value)).get("__call__")
    if not isinstance(call, types.FunctionType):
        return set()
    steps = (it for code in _codes(call.__code__) for it in dis.get_instructions(code))
    return {it.argval for it in steps if it.opname in ("STORE_ATTR", "DELETE_ATTR")}


def is_local(thing: Any) -> bool:
    """Whether a function, class or module is user code, as opposed to an installed library."""
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
    """Return the path of a top-level module or package, without importing it."""
    try:
        spec = getattr(sys.modules.get(root), "__spec__", None) or importlib.util.find_spec(root)
    except (ImportError, ValueError):
        spec = None
    file = getattr(sys.modules.get(root), "__file__", None)
    if spec is None:
        return [file] if file else []
    return [it for it in (spec.origin, *(spec.submodule_search_locations or ())) if it]


def unformatted(text: str) -> str:
    """Return the text of a function or class without comments and layout."""
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
    """Return the globals used in a user module; for a library, its name."""
    if not is_local(module) or id(module) in known:
        return module
    known.add(id(module))
    there = sorted(names & vars(module).keys())
    values = ((name, vars(module)[name]) for name in there)
    return [
        module.__name__,
        *((name, _of_module(it, names, known) if _is_module(it) else it) for name, it in values),
    ]


def _imported(codes: list[types.CodeType], scope: dict[str, Any]) -> set[str]:
    """Return the user modules that are imported when the function runs."""
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
    """Return the text of a module without importing it."""
    try:
        spec = importlib.util.find_spec(name)
        return unformatted(Path(spec.origin).read_text()) if spec and spec.origin else MISSING
    except (ImportError, AttributeError, ValueError, OSError, UnicodeDecodeError):
        return MISSING


def _assigned_names(function: types.FunctionType) -> set[str]:
    """Return the non-local variables that a function assigns or changes in place."""
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
    """Yield the names changed by assignments to items or by mutating methods."""
    target: ast.expr | None = None
    if isinstance(node, ast.Subscript) and isinstance(node.ctx, ast.Store | ast.Del):
        target = node.value
    if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute):
        target = node.func.value if node.func.attr in CHANGING else None
    if isinstance(target, ast.Name):
        yield target.id


# Digests of values by their content, the same in every process.
#
# Digests cover numbers, texts, containers, arrays, tables, functions with their state and
# dependencies, classes, and every object that pickle can reduce. Other objects have no digest: a
# change since the start of a study cannot be detected.

VERSION = 2
"""Version of the digests: those of another one cannot be compared with them."""

PLAIN = (type(None), bool, int, float, complex, str, bytes, type(...), type(NotImplemented))
SHOWN = 16
"""Characters of a digest that are kept."""


class UndigestibleError(TypeError):
    """Raised for a value without a digest; the message names it."""


def digest(value: Any) -> str:
    """Return a digest of a value.

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
        raise UndigestibleError(f"{_type_name(value)} ({type(error).__name__}: {error})") from None


def function_state(function: Callable[..., Any]) -> str | None:
    """Return a digest of a function's state: defaults, closure, the object of a method.

    Returns
    -------
    str or None
        A digest; None if it holds nothing.
    """
    parts: tuple[Any, ...]
    if isinstance(function, functools.partial):
        parts = function.args, function.keywords, function_state(function.func)
    elif isinstance(function, types.MethodType):
        parts = function.__self__, function_state(function.__func__)
    elif isinstance(function, types.FunctionType):
        parts = _held_by(function)
    elif isinstance(function, type):
        parts = ()
    elif (inner := _inner(function)) is not None:
        return function_state(inner)
    else:
        parts = _state(function)
    return digest(parts) if any(parts) else None


def uses(function: Callable[..., Any]) -> str | None:
    """Return a digest of a function's dependencies: helpers, other globals, its class.

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
        found = list(used(function)) if is_local(function) else []
        return hashlib.sha256(content.token(found)).hexdigest()[:SHOWN] if found else None
    kind = function if isinstance(function, type) else type(function)
    return hashlib.sha256(content.token(kind)).hexdigest()[:SHOWN] if is_local(kind) else None


def source_digest(function: Callable[..., Any]) -> str | None:
    """Return a digest of the source of a function or of a callable object's class."""
    while isinstance(function, functools.partial):
        function = function.func
    function = _inner(function) or function
    has_text = isinstance(function, type) or hasattr(function, "__code__")
    text = _text(function if has_text else type(function))
    return hashlib.sha256(text).hexdigest()[:SHOWN] if text else None


def _text(thing: Any) -> bytes:
    """Return the source of a function or class; its bytecode if the source is missing."""
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
        (name, _Empty if _is_empty_cell(cell) else cell.cell_contents)
        for name, cell in kept_cells(function)
    ]
    return function.__defaults__, function.__kwdefaults__, cells, function.__dict__


class _Empty:
    """Marker for a closure variable without a value."""


def _is_empty_cell(cell: types.CellType) -> bool:
    try:
        _ = cell.cell_contents
    except ValueError:
        return True
    return False


def module_of(thing: Any) -> str | None:
    """Return the module of a class or function; "zivi" for all modules of zivi."""
    module = getattr(thing, "__module__", None)
    return "zivi" if module is not None and str(module).startswith("zivi.") else module


def _type_name(value: Any) -> str:
    return f"{module_of(type(value))}.{type(value).__qualname__}"


class _Content:
    """Reduces values to tokens: what is plain to its text, the rest to a hash of its parts."""

    def __init__(self, *, tolerant: bool = False) -> None:
        # whether irreducible objects count by their type
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
        found = hashlib.sha256(_type_name(value).encode())
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
        """Return a digest of the dependencies of a function; locks and loggers are ignored."""
        before, self._tolerant = self._tolerant, True
        try:
            return self.token(value)
        finally:
            self._tolerant = before

    def _parts(self, value: Any) -> Iterable[Any]:
        """Return the parts of a value; a memoryview counts by its bytes."""
        kind = type(value)
        if kind in (tuple, list):
            return (len(value), *value)
        if kind is dict:
            return (len(value), *(part for pair in value.items() for part in pair))
        if kind in (set, frozenset):
            return sorted(self.token(part) for part in value)
        if kind in (np.ndarray, np.memmap) or isinstance(value, np.generic):
            return _array_parts(np.asarray(value))
        if isinstance(value, types.CodeType):
            names = value.co_names, value.co_varnames, value.co_freevars, value.co_cellvars
            return (value.co_code, value.co_consts, *names, value.co_flags)
        if isinstance(value, type) and is_local(value):
            return (value.__module__, value.__qualname__, self._tolerated(_of_class(value)))
        if isinstance(value, types.ModuleType | types.BuiltinFunctionType | type):
            owner = getattr(value, "__self__", None)
            named = (module_of(value), getattr(value, "__qualname__", None))
            return (*named, value.__name__, None if isinstance(owner, types.ModuleType) else owner)
        if isinstance(value, types.FunctionType):
            named = (module_of(value), value.__qualname__)
            if not is_local(value):
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
        return (kind if is_local(kind) else None, *_state(value))


def _unformatted(function: types.FunctionType) -> bytes:
    """Return the source of a function without comments and layout; else its bytecode."""
    text = _text(function)
    try:
        return unformatted(text.decode()).encode()
    except UnicodeDecodeError:  # a digest of its code
        return text


def _inner(value: Any) -> types.FunctionType | None:
    """Return the function that a library compiled or cached (numba, functools).

    A wrapper of the user has a state of its own.
    """
    if isinstance(value, types.FunctionType | type) or not callable(value) or is_local(type(value)):
        return None
    inner = getattr(value, "__wrapped__", None)
    return inner if isinstance(inner, types.FunctionType) else None


def _state(value: Any) -> tuple[Any, ...]:
    """Return the state of an object, without attributes that its call writes."""
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
    """Return the parts of a class: bases, attributes, methods."""
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
    """Return the parts of an object, like pickle."""
    reducer = copyreg.dispatch_table.get(type(value))
    try:
        reduced: Any = reducer(value) if reducer else value.__reduce_ex__(4)
    except Exception as error:  # whatever a library says
        raise UndigestibleError(f"{_type_name(value)} ({error})") from None
    if isinstance(reduced, str):  # the name of something global
        return (module_of(value), reduced)
    make, arguments, state, items, pairs = [*reduced, None, None, None][:5]
    named = f"{module_of(make)}.{make.__qualname__}"
    return (named, arguments, state, list(items or ()), list(pairs or ()))


def _array_parts(array: Any) -> Iterable[Any]:
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
    """Return the content of tables, independent of their memory layout."""
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


# Identity of a study.

MILD = ("zivi", "source", "uses", "digests")
"""What may differ if the user insists on going on."""
_DIGEST = re.compile(r" [0-9a-f]{16}$")
_ROOM = re.compile(r"\bzivi\.(?:\w+\.)+(?=\w)")
"""Where a class of zivi was when a version stored its name."""
WORDS = {
    "function": "the function",
    "source": "the text of the function",
    "digests": "the version of the digests, which differ between versions",
    "held": "what the function holds (digest)",
    "uses": "what the function uses, helpers and other globals (digest)",
    "kind": "the kind of design",
    "parameters": "the parameters",
    "shape": "the number of points",
    "values": "the values of the parameters (digest)",
    "fixed": "the fixed arguments",
    "seed": "the seed",
    "chunk": "the points of a chunk",
    "vectorized": "whether the function takes many points at a time",
    "zivi": "the version of zivi",
}


def identity(
    function: Callable[..., Any],
    design: Design,
    fixed: Mapping[str, Any],
    seed: int | None,
    chunk: int | None,
    *,
    vectorized: bool = False,
    faithful: bool,
) -> dict[str, Any]:
    """Return the description of a study in plain values.

    With `faithful`, raise a TypeError for values without comparable content; otherwise such values
    are represented by their type.
    """
    of = functools.partial(plain, faithful=faithful)
    return {
        "function": function_name(function),
        "source": source_digest(function),
        "held": of("the function", function, function_state),
        "uses": of("the function", function, uses),
        "digests": VERSION,
        "kind": design.kind,
        "parameters": list(design.names),
        "shape": list(design.shape),
        "values": design.digest(),
        "fixed": {name: of(f"fixed[{name!r}]", value) for name, value in fixed.items()},
        "seed": seed,
        "chunk": chunk,
        "vectorized": vectorized,
        "shards": True,
        "zivi": _zivi.__version__,
    }


def differences(there: Mapping[str, Any], here: Mapping[str, Any], *, mild: bool) -> dict[str, str]:
    """Return the differences between a store and a study; with `mild`, the grave ones only."""
    comparable = there.get("digests") == here["digests"]
    there = {"vectorized": False, **there}  # version 0.1 did not say so
    # a seed or a chunk that is not given is that of the store
    left_out = {key for key in ("seed", "chunk") if here[key] is None}
    if mild:
        left_out |= set(MILD)
        # version 0.1.0 did not store a function's state, other digests cannot be compared
        if "held" not in there or not comparable:
            left_out.add("held")
        if not comparable:
            there, here = ({**it, **_undigested(it)} for it in (there, here))
    return {
        key: f"{words}: {there.get(key)!r} there, {here[key]!r} here"
        for key, words in WORDS.items()
        # as text: NaN is not equal to itself
        if key not in left_out and canonical_json(there.get(key)) != canonical_json(here[key])
    }


def _undigested(identity: Mapping[str, Any]) -> dict[str, Any]:
    """Return the function and the fixed arguments without digests, and without rooms of zivi."""
    return {key: _bare(identity.get(key)) for key in ("function", "fixed")}


def _bare(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {key: _bare(it) for key, it in value.items()}
    return _ROOM.sub("zivi.", _DIGEST.sub("", value)) if isinstance(value, str) else value


def canonical_json(value: Any) -> str:
    """Write a value as JSON, in which 1, 1.0 and true differ."""
    return json.dumps(value, sort_keys=True)


def function_name(function: Callable[..., Any]) -> str:
    """Return the name of a function, with the arguments of a partial."""
    if isinstance(function, functools.partial):
        given = [_plain_repr(it) for it in function.args]
        given += [f"{key}={_plain_repr(value)}" for key, value in function.keywords.items()]
        return f"{function_name(function.func)}({', '.join(given)})"
    name = getattr(function, "__qualname__", None) or type(function).__qualname__
    module = module_of(function) or module_of(type(function))
    return f"{module}.{name}"


def _kind_name(value: Any) -> str:
    return f"{module_of(type(value))}.{type(value).__qualname__}"


def _plain_repr(value: Any) -> str:
    return repr(plain("", value, faithful=False))


def plain(what: str, value: Any, of: Callable[[Any], Any] | None = None, *, faithful: bool) -> Any:
    """Convert a value to JSON types; other values are represented by a digest."""
    try:
        return (of or _plain)(value)
    except (UndigestibleError, RecursionError) as error:
        if not faithful:
            return _kind_name(value)
        raise TypeError(
            f"{what} holds {_error_text(error)}, whose content cannot be compared later, so that a "
            "study in a folder could not be resumed: pass its ingredients (numbers, a path) and "
            "create it in the function"
        ) from None


def _error_text(error: Exception) -> str:
    deep = isinstance(error, RecursionError)
    return "what is nested too deeply (RecursionError)" if deep else str(error)


def _plain(value: Any) -> Any:
    if type(value) in (type(None), bool, int, float, str):
        return value
    if isinstance(value, np.bool_ | np.integer | np.floating) and value.itemsize <= 8:
        return value.item()
    if type(value) is dict and all(isinstance(key, str) for key in value):
        return {key: _plain(it) for key, it in value.items()}
    if type(value) in (list, tuple):
        return [_plain(it) for it in value]
    if type(value) is np.ndarray and value.dtype.char not in "gGOTV":
        bytes_ = np.ascontiguousarray(value).tobytes()
        return f"array {value.dtype} {value.shape} {hashlib.sha256(bytes_).hexdigest()[:16]}"
    if callable(value):
        return f"{function_name(value)} {digest(value)}"
    return f"{_kind_name(value)} {digest(value)}"
