"""Names that people bring from other libraries, and what they are called here.

SciPy, python-control, MuJoCo, MATLAB: an argument, an attribute or a function of theirs gets an
error that names the one of zivi. Nothing here accepts another name.
"""

from __future__ import annotations

import difflib
import functools
import inspect
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, ClassVar, TypeVar, cast

from zivi.base.foreign_arguments import ARGUMENTS
from zivi.base.foreign_names import ATTRIBUTES, MODULE, PLOT

__all__ = [
    "ARGUMENTS",
    "ATTRIBUTES",
    "MODULE",
    "PLOT",
    "Hinted",
    "attribute_error",
    "hinted",
    "keyword_hint",
]

Called = TypeVar("Called", bound=Callable[..., Any])


def keyword_hint(owner: str, name: str, known: tuple[str, ...] = ()) -> str:
    """Say what an argument is called here, or which is spelt nearly so; "" if nothing is near."""
    hint = ARGUMENTS.get(owner, {}).get(name)
    if hint is not None:
        return f": {hint}"
    close = difflib.get_close_matches(name, known, 1)
    return f": did you mean {close[0]!r}?" if close else ""


def attribute_error(kind: str, thing: object, name: str) -> AttributeError:
    """Make the error of an attribute that a result does not have."""
    hint = ATTRIBUTES[kind].get(name)
    text = f"{type(thing).__name__!r} object has no attribute {name!r}"
    return AttributeError(f"{text}: {hint}" if hint else text, name=name, obj=thing)


class Hinted:
    """A run: names that it does not have, keys and unpacking are answered by a hint."""

    _habits: ClassVar[str]

    if not TYPE_CHECKING:  # which would take any name for granted

        def __getattr__(self, name):
            raise attribute_error(self._habits, self, name)

        def __getitem__(self, key):
            kind = type(self).__name__
            if not isinstance(key, str):
                raise TypeError(f"{kind!r} object has no items: ask its arrays, sol.t[i]")
            hint = f"it is sol.{key}" if hasattr(self, key) else ATTRIBUTES[self._habits].get(key)
            raise TypeError(f"{kind!r} object has no items{f': {hint}' if hint else ''}")

        def __iter__(self):
            states = "sol.q, sol.qdot" if "x" in ATTRIBUTES[self._habits] else "sol.x, sol.xdot"
            kind = type(self).__name__
            raise TypeError(f"{kind!r} object is not iterable: its arrays are sol.t, {states}")


def hinted(owner: str) -> Callable[[Called], Called]:
    """Decorate a function or a class: errors of arguments that it does not have get a hint."""

    def decorate(it: Called) -> Called:
        if isinstance(it, type):
            it.__init__ = _hinting(it.__init__, owner)  # type: ignore[misc]
            return cast(Called, it)
        return cast(Called, _hinting(it, owner))

    return decorate


def _hinting(function: Callable[..., Any], owner: str) -> Callable[..., Any]:
    @functools.wraps(function)
    def call(*args: Any, **kwargs: Any) -> Any:
        try:
            return function(*args, **kwargs)
        except TypeError as error:
            where = error.__traceback__
            if where is None or where.tb_next is not None:
                raise  # not of this call's arguments
            known = tuple(inspect.signature(function).parameters)
            wrong = [name for name in kwargs if name not in known]
            hint = keyword_hint(owner, wrong[0], known) if wrong else ""
            if not hint:
                raise
            text = str(error).partition(". Did you mean")[0]
            if "missing" in text:  # under another name
                text = f"{function.__name__}() got an unexpected keyword argument {wrong[0]!r}"
            raise TypeError(f"{text}{hint}") from None

    return call
