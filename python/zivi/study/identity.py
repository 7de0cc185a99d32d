"""What makes a study the same study."""

from __future__ import annotations

import functools
import hashlib
import json
import re
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

import zivi._zivi as _zivi
from zivi.study.design import Design
from zivi.study.digest import VERSION, UndigestibleError, digest, module_of, source, state_of, uses

__all__ = ["differences", "identity", "named"]

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
    """Tell a study in plain values.

    With `faithful`, a TypeError names what has no content that could be compared later; otherwise
    it is told by its type.
    """
    of = functools.partial(plain, faithful=faithful)
    return {
        "function": named(function),
        "source": source(function),
        "held": of("the function", function, state_of),
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
    """Say what differs between a store and a study, except what may if the user insists."""
    comparable = there.get("digests") == here["digests"]
    there = {"vectorized": False, **there}  # version 0.1 did not say so
    # a seed or a chunk that is not given is that of the store
    left_out = {key for key in ("seed", "chunk") if here[key] is None}
    if mild:
        left_out |= set(MILD)
        # version 0.1.0 did not say what a function holds, other digests cannot be compared
        if "held" not in there or not comparable:
            left_out.add("held")
        if not comparable:
            there, here = ({**it, **_undigested(it)} for it in (there, here))
    return {
        key: f"{words}: {there.get(key)!r} there, {here[key]!r} here"
        for key, words in WORDS.items()
        # as text: NaN is not equal to itself
        if key not in left_out and _text(there.get(key)) != _text(here[key])
    }


def _undigested(identity: Mapping[str, Any]) -> dict[str, Any]:
    """Give the function and the fixed arguments without digests, and without rooms of zivi."""
    return {key: _bare(identity.get(key)) for key in ("function", "fixed")}


def _bare(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {key: _bare(it) for key, it in value.items()}
    return _ROOM.sub("zivi.", _DIGEST.sub("", value)) if isinstance(value, str) else value


def _text(value: Any) -> str:
    return json.dumps(value, sort_keys=True)


def named(function: Callable[..., Any]) -> str:
    """Name a function, or what it was made of."""
    if isinstance(function, functools.partial):
        given = [_shown(it) for it in function.args]
        given += [f"{key}={_shown(value)}" for key, value in function.keywords.items()]
        return f"{named(function.func)}({', '.join(given)})"
    name = getattr(function, "__qualname__", None) or type(function).__qualname__
    module = module_of(function) or module_of(type(function))
    return f"{module}.{name}"


def _kind(value: Any) -> str:
    return f"{module_of(type(value))}.{type(value).__qualname__}"


def _shown(value: Any) -> str:
    return repr(plain("", value, faithful=False))


def plain(what: str, value: Any, of: Callable[[Any], Any] | None = None, *, faithful: bool) -> Any:
    """Reduce a value to what JSON can hold; what it cannot is told by a digest of its content."""
    try:
        return (of or _plain)(value)
    except (UndigestibleError, RecursionError) as error:
        if not faithful:
            return _kind(value)
        raise TypeError(
            f"{what} holds {_error_text(error)}, of which it cannot be told later whether it is "
            "still the same, so that a study in a folder could not go on: hand over what it is "
            "made of (numbers, a path) and make it in the function"
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
        return f"{named(value)} {digest(value)}"
    return f"{_kind(value)} {digest(value)}"
