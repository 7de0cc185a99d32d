"""The inputs of symbolic systems: constant columns, or a compiled matrix of the coordinates."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np

import zivi._zivi as _zivi
from zivi.base.check import Array
from zivi.base.machine_code import Native, compiled
from zivi.system.control_inputs import ControlInputs
from zivi.system.symbolic.source import c_source, python_source

__all__ = ["SymbolicInputs"]


@dataclasses.dataclass(frozen=True)
class SymbolicInputs:
    """What a symbolic system keeps of its inputs.

    Parameters
    ----------
    names : tuple of str
        The controls.
    n : int
        Number of coordinates.
    constant : tuple of float or None
        The matrix row by row, if it is one.
    sources : dict
        Else the sources of the function that fills it in.
    """

    names: tuple[str, ...]
    n: int
    constant: tuple[float, ...] | None
    sources: dict[str, str]

    @classmethod
    def of(cls, names: tuple[str, ...], entries: tuple[Any, ...]) -> SymbolicInputs:
        """Keep expressions, n for each control, row by row."""
        n = len(entries) // len(names)
        if all(entry.is_number for entry in entries):
            return cls(names, n, tuple(float(entry) for entry in entries), {})
        return cls(names, n, None, {"c": c_source(entries), "numba": python_source(entries)})

    def made(self, compiler: str, parameters: Any) -> ControlInputs:
        """Compile them; `parameters` has their ``address``."""
        if self.constant is not None:
            return ControlInputs(self.names, np.reshape(self.constant, (self.n, len(self.names))))
        native = compiled(self.sources, compiler)
        return CompiledInputs(self.names, _matrix(native, self, parameters), native, parameters)


@dataclasses.dataclass(frozen=True, eq=False)
class CompiledInputs(ControlInputs):
    """Inputs whose matrix is compiled.

    Parameters
    ----------
    names, matrix
        As those of `ControlInputs`; the function is the compiled one.
    native : Native
        The compiled function.
    parameters : Parameters
        What it takes.
    """

    native: Native
    parameters: Any

    def spec(self) -> _zivi.Inputs:
        """Give what the extension takes."""
        owner = self.native, self.parameters
        address = self.parameters.address
        return _zivi.Inputs.compiled(self.r, self.native.address, address, owner)


def _matrix(native: Native, inputs: SymbolicInputs, parameters: Any) -> Any:
    function, shape = native.function, (inputs.n, len(inputs.names))

    def matrix(q: Array) -> Array:
        out, row = np.empty(shape), np.ascontiguousarray(q, dtype=np.float64)
        at = row.ctypes.data
        function(0.0, at, at, out.ctypes.data, parameters.address)
        return out

    return matrix
