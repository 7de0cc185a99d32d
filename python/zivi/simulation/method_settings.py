"""Common part of all methods: classes made from settings that the core checks."""

from __future__ import annotations

import dataclasses
import numbers
from typing import Any, ClassVar, Protocol

import zivi._zivi as _zivi
from zivi.base.check import Array, integer, real
from zivi.simulation.dense import DenseMotion, LinearPath, PenetratingPath


class Method(Protocol):
    """Anything that `simulate` can run."""

    @property
    def _core(self) -> _zivi.Method: ...


class Settings:
    """Settings that the core keeps, and checks, as well."""

    _entry: ClassVar[_zivi.MethodEntry]
    _takes_tstops: ClassVar[bool] = True

    def __post_init__(self) -> None:
        for setting in self._entry.settings:
            value = _read_setting(setting, getattr(self, setting.name))
            object.__setattr__(self, setting.name, value)
        _ = self._core

    def _values(self) -> dict[str, Any]:
        """Return the settings by name."""
        own = self.__dict__
        return {name: own[name] for name in type(self).__dataclass_fields__}  # type: ignore[attr-defined]

    @property
    def _core(self) -> _zivi.Method:
        """The method for the core, created once."""
        if "_made" not in self.__dict__:
            self.__dict__["_made"] = _zivi.Method(self._entry.name, **self._values())
        made: _zivi.Method = self.__dict__["_made"]
        return made

    def __getstate__(self) -> dict[str, Any]:
        # the object of the core is created again
        return {name: value for name, value in self.__dict__.items() if name != "_made"}


class FixedSteps(Settings):
    """Settings of a method that knows the motion at its steps only."""

    _takes_tstops: ClassVar[bool] = False

    def _path(self, kappa: float, t: Array, samples: dict[str, Array]) -> DenseMotion:
        s, v = samples["s"], samples["v"]
        if self._entry.penetrates:
            return PenetratingPath(t, s, v, kappa, x=samples["x"], xdot=samples["xdot"])
        return LinearPath(t, s, v, kappa)


def class_of(entry: _zivi.MethodEntry, doc: str | None = None) -> type[Settings]:
    """Make the class of a method: a frozen dataclass whose fields are its settings."""
    base = FixedSteps if entry.fixed_steps else Settings
    fields = [
        (it.name, annotation(it), dataclasses.field())
        if it.required
        else (it.name, annotation(it), dataclasses.field(default=it.default))
        for it in entry.settings
    ]
    doc = _documentation(entry) if doc is None else doc
    made = dataclasses.make_dataclass(
        entry.name, fields, bases=(base,), namespace={"__doc__": doc, "_entry": entry}, frozen=True
    )
    made.__module__ = "zivi"  # where users find it, and where pickles look for it
    return made


def annotation(setting: _zivi.Setting) -> str:
    """Return the type of a setting."""
    kind = "float"
    if setting.choices is not None:
        kind = type(setting.choices[0]).__name__
    elif setting.whole:
        kind = "int"
    elif setting.pair:
        kind = "float | tuple[float, float]"
    return kind if setting.comes is None else f"{kind} | None"


def _documentation(entry: _zivi.MethodEntry) -> str:
    """Return the docstring of a method from the core's description."""
    kinds = "A method of fixed steps." if entry.fixed_steps else "A method."
    systems = "`ImpactSystem` and `MechanicalSystem`" if entry.takes_mechanism else "`ImpactSystem`"
    lines = [f"{_sentence(entry.meaning)}", "", f"{kinds} It runs {systems}."]
    lines += ["", "Parameters", "----------"]
    for it in entry.settings:
        unit = f" ({it.unit})" if it.unit not in ("", "1") else ""
        lines += [f"{it.name} : {_type_text(it)}", f"    {_sentence(it.meaning + unit)}"]
        lines[-1] += f" It must be {it.range}."
        if it.comes is not None:
            lines[-1] += f" By default {it.comes}."
    return "\n".join([*lines, "", "Raises", "------", "ValueError", f"    {OUT_OF_RANGE}", ""])


OUT_OF_RANGE = "If a setting is out of range."


def _type_text(setting: _zivi.Setting) -> str:
    if setting.choices is not None:
        return "{" + ", ".join(repr(it) for it in setting.choices) + "}"
    kind = annotation(setting).removesuffix(" | None")
    kind = kind.replace("tuple[float, float]", "(float, float)").replace(" | ", " or ")
    return kind if setting.comes is None else f"{kind}, optional"


def _sentence(words: str) -> str:
    return f"{words[0].upper()}{words[1:]}."


def _read_setting(setting: _zivi.Setting, value: Any) -> Any:
    """Read a value of a setting; its range is left to the core."""
    if value is None and setting.comes is not None:
        return None
    if setting.whole or (setting.choices is not None and isinstance(setting.choices[0], int)):
        return integer(setting.name, value)
    if setting.choices is not None:
        return value
    return _one_or_two(setting.name, value) if setting.pair else real(setting.name, value)


def _one_or_two(name: str, value: Any) -> float | tuple[float, float]:
    """Return a number for both components of the state, or one for each."""
    if isinstance(value, numbers.Real):
        return real(name, value)
    try:
        of_x, of_xdot = value
    except (TypeError, ValueError):
        raise TypeError(f"{name} must be a number or two, (x, xdot), got {value!r}") from None
    return real(name, of_x), real(name, of_xdot)
