"""Names and calls that people bring from other libraries or misspell, and what is right here.

SciPy, python-control, MuJoCo, MATLAB: an argument, an attribute or a function of theirs gets an
error that names the one of zivi; what is spelt nearly right, the name that is near. Nothing here
accepts another name.
"""

from __future__ import annotations

import difflib
import functools
import importlib
import inspect
import sys
import types
from collections.abc import Callable, Iterable, Mapping
from typing import TYPE_CHECKING, Any, ClassVar, NoReturn, TypeVar, cast

from zivi.base.foreign_arguments import ARGUMENTS, CALLS
from zivi.base.foreign_names import ATTRIBUTES, MODULE, MODULE_CALLS, PLOT

__all__ = [
    "ARGUMENTS",
    "ATTRIBUTES",
    "CALLS",
    "MODULE",
    "MODULE_CALLS",
    "PLOT",
    "CallableHint",
    "Hinted",
    "attribute_error",
    "closest",
    "field_error",
    "hint_calls",
    "hinted",
    "keyword_hint",
    "module_error",
    "name_hint",
]

Called = TypeVar("Called", bound=Callable[..., Any])


def closest(name: str, known: Iterable[str], cutoff: float = 0.6) -> str | None:
    """Find the known name that is spelt most alike; capitals and underscores do not count."""
    plain = {_plain(it): it for it in known}
    close = difflib.get_close_matches(_plain(name), plain, 1, cutoff)
    return plain[close[0]] if close else None


def _plain(name: str) -> str:
    return name.lower().replace("_", "")


def name_hint(name: str, known: Iterable[str], hints: Mapping[str, str]) -> str:
    """Say what a name is called here, or which is spelt nearly so; "" if nothing is near."""
    if name in hints:
        return f": {hints[name]}"
    if name.startswith("_"):  # what machinery asks for
        return ""
    close = closest(name, known, 0.75)
    return f": did you mean {close!r}?" if close else ""


def keyword_hint(owner: str, name: str, known: tuple[str, ...] = ()) -> str:
    """Say what an argument is called here, or which is spelt nearly so; "" if nothing is near."""
    hints = ARGUMENTS.get(owner, {})
    if name not in hints and (close := closest(name, known)):
        return f": did you mean {close!r}?"
    hint = hints.get(name) or hints.get(ANY, "").replace(ANY, name)
    return f": {hint}" if hint else ""


ANY = "*"
"""Stands for every argument that is not known otherwise, in its hint for its name."""


def attribute_error(kind: str, thing: object, name: str) -> AttributeError:
    """Make the error of an attribute that a result or a system does not have."""
    known = (it for it in dir(type(thing)) if not it.startswith("_"))
    hint = name_hint(name, [*known, *_fields(thing)], ATTRIBUTES[kind])
    text = f"{type(thing).__name__!r} object has no attribute {name!r}"
    # Python adds a suggestion of its own if it knows the object
    return AttributeError(f"{text}{hint}", name=name, obj=None if hint else thing)


def _fields(thing: object) -> Iterable[str]:
    names = getattr(type(thing), "__dataclass_fields__", None) or ()
    return [it for it in names if not it.startswith("_")]


def module_error(module: str, name: str, known: Iterable[str], hints: Mapping[str, str]) -> Any:
    """Make the error of a name that a module does not have."""
    hint = name_hint(name, known, hints)
    return AttributeError(f"module {module!r} has no attribute {name!r}{hint}")


class CallableHint(types.ModuleType):
    """A module that is called as if it were a function: the error names the function."""

    def __call__(self, *args: Any, **kwargs: Any) -> NoReturn:
        """Raise a TypeError."""
        hint = MODULE_CALLS.get(self.__name__)
        raise TypeError(f"module {self.__name__!r} is not callable{f': {hint}' if hint else ''}")

    def __reduce__(self) -> tuple[Any, ...]:
        # cloudpickle takes along the modules that a function names, this one among them
        return importlib.import_module, (self.__name__,)


def field_error(kind: str, name: str, fields: Iterable[str]) -> ValueError:
    """Make the error of a field that a table does not have."""
    fields = tuple(fields)
    hint = name_hint(name, fields, ATTRIBUTES[kind])
    return ValueError(f"no field of name {name!r}{hint}; the fields are {', '.join(fields)}")


def hint_calls(module: str) -> None:
    """Let the call of a module raise an error with a hint."""
    sys.modules[module].__class__ = CallableHint


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
                _note(error, args)  # not of this call's arguments
                raise
            text = _call_error(function, owner, str(error), args, kwargs)
            if text is None:
                raise
            raise TypeError(text) from None

    return call


def _call_error(
    function: Callable[..., Any], owner: str, text: str, args: Any, kwargs: dict[str, Any]
) -> str | None:
    """Say what to write instead of a call; None where nothing is known."""
    parameters = inspect.signature(function).parameters
    example = CALLS.get(function.__qualname__.partition(".")[0], CALLS[owner])
    known = tuple(parameters)
    wrong = [name for name in kwargs if name not in known]
    hint = keyword_hint(owner, wrong[0], known) if wrong else ""
    if hint:
        text = text.partition(". Did you mean")[0]
        if "missing" in text:  # under another name
            text = f"{function.__name__}() got an unexpected keyword argument {wrong[0]!r}"
        return f"{text}{hint}"
    if "positional argument" in text and "takes" in text:
        place = [it.name for it in parameters.values() if it.kind is not it.KEYWORD_ONLY]
        named = [name for name in known if name not in place and name not in kwargs]
        pairs = zip(named, args[len(place) :], strict=False)
        written = ", ".join(f"{name}={short(value)}" for name, value in pairs)
        if written and not any(map(callable, args[len(place) :])):  # no decorator without brackets
            return f"{text}: write {written}, as in {example}"
    return None if wrong else f"{text}: write {example}"


def short(value: object) -> str:
    """Show a value in a few characters."""
    text = repr(value)
    return text if len(text) <= 40 and "\n" not in text else "..."


OF_NUMBERS = ("is not subscriptable", "has no len()", "is not iterable", "unpack non-iterable")
"""What Python says of a number that is used as an array."""


def _note(error: TypeError, args: tuple[Any, ...]) -> None:
    """Say with what a function of the user is called, where it took a number for an array."""
    form = next((it._call_form for it in args[:1] if hasattr(it, "_call_form")), None)
    if form and "float" in str(error) and any(it in str(error) for it in OF_NUMBERS):
        error.add_note(f"zivi: {form}")
