"""What makes a study the same study."""

from __future__ import annotations

import functools
import hashlib
import inspect
import json
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from zivi import _zivi
from zivi.study.design import Design

__all__ = ["differences", "identity", "named", "plain"]

MILD = ("zivi", "source")
"""What may differ if the user insists on going on."""
WORDS = {
    "function": "the function",
    "source": "the text of the function",
    "kind": "the kind of design",
    "parameters": "the parameters",
    "shape": "the number of points",
    "values": "the values of the parameters (digest)",
    "fixed": "the fixed arguments",
    "seed": "the seed",
    "chunk": "the points of a chunk",
    "zivi": "the version of zivi",
}


def identity(
    function: Callable[..., Any],
    design: Design,
    fixed: Mapping[str, Any],
    seed: int | None,
    chunk: int | None,
) -> dict[str, Any]:
    """Tell a study in plain values."""
    return {
        "function": named(function),
        "source": _source(function),
        "kind": design.kind,
        "parameters": list(design.names),
        "shape": list(design.shape),
        "values": design.digest(),
        "fixed": plain(dict(fixed)),
        "seed": seed,
        "chunk": chunk,
        "zivi": _zivi.__version__,
    }


def differences(there: Mapping[str, Any], here: Mapping[str, Any], *, mild: bool) -> list[str]:
    """List what differs between a store and a study, except what may if the user insists."""
    # a seed or a chunk that is not given is that of the store
    open_ = {key for key in ("seed", "chunk") if here[key] is None}
    left_out = open_ | (set(MILD) if mild else set())
    return [
        f"{words}: {there.get(key)!r} there, {here[key]!r} here"
        for key, words in WORDS.items()
        # as text: NaN is not equal to itself
        if key not in left_out and json.dumps(there.get(key)) != json.dumps(here[key])
    ]


def named(function: Callable[..., Any]) -> str:
    """Name a function, or what it was made of."""
    if isinstance(function, functools.partial):
        given = [repr(plain(it)) for it in function.args]
        given += [f"{key}={plain(value)!r}" for key, value in function.keywords.items()]
        return f"{named(function.func)}({', '.join(given)})"
    name = getattr(function, "__qualname__", None) or type(function).__qualname__
    module = getattr(function, "__module__", None) or type(function).__module__
    return f"{module}.{name}"


def _source(function: Callable[..., Any]) -> str | None:
    while isinstance(function, functools.partial):
        function = function.func
    thing = function if hasattr(function, "__code__") else type(function)
    try:
        text = inspect.getsource(thing)
    except (OSError, TypeError):
        return None
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def plain(value: Any) -> Any:
    """Reduce a value to what JSON can hold; what it cannot is told by a digest or a type."""
    if value is None or isinstance(value, bool | int | float | str):
        return value
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, Mapping):
        return {str(key): plain(it) for key, it in value.items()}
    if isinstance(value, list | tuple):
        return [plain(it) for it in value]
    if isinstance(value, np.ndarray):
        digest = hashlib.sha256(np.ascontiguousarray(value).tobytes()).hexdigest()[:16]
        return f"array {value.dtype} {value.shape} {digest}"
    if callable(value):
        return named(value)
    text = repr(value)
    return f"{type(value).__module__}.{type(value).__qualname__}" if " at 0x" in text else text
