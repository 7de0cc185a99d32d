"""An FMU loaded and called by ctypes, in both versions of FMI, with one interface."""

from __future__ import annotations

import ctypes as c
import json
import subprocess
import sys
import zipfile
from pathlib import Path
from typing import Any, Self
from xml.etree import ElementTree as Xml

LOGGER2 = c.CFUNCTYPE(None, c.c_void_p, c.c_char_p, c.c_int, c.c_char_p, c.c_char_p)
LOGGER3 = c.CFUNCTYPE(None, c.c_void_p, c.c_int, c.c_char_p, c.c_char_p)
TYPES = {
    "Real": ("Real", c.c_double),
    "Integer": ("Integer", c.c_int),
    "Boolean": ("Boolean", c.c_int),
    "Float64": ("Float64", c.c_double),
    "Int32": ("Int32", c.c_int32),
}


class Callbacks(c.Structure):
    """``fmi2CallbackFunctions``."""

    _fields_ = [
        ("logger", LOGGER2),
        ("allocate", c.c_void_p),
        ("free", c.c_void_p),
        ("finished", c.c_void_p),
        ("environment", c.c_void_p),
    ]


class Archive:
    """An FMU unpacked, its description read, its binary loaded."""

    def __init__(self, path: Path, folder: Path) -> None:
        with zipfile.ZipFile(path) as archive:
            archive.extractall(folder)
        self.folder = folder.resolve()
        self.root = Xml.parse(folder / "modelDescription.xml").getroot()
        self.fmi = int(self.root.attrib["fmiVersion"][0])
        self.token = self.root.attrib["guid" if self.fmi == 2 else "instantiationToken"].encode()
        (binary,) = (folder / "binaries").rglob("zivi.*")
        self.library = c.CDLL(str(binary))
        self.variables: dict[str, tuple[str, int, dict[str, str]]] = {}
        for entry in self.root.find("ModelVariables"):  # type: ignore[union-attr]
            inner = entry[0] if self.fmi == 2 else entry
            attributes = {**entry.attrib, **inner.attrib}
            reference = int(attributes["valueReference"])
            self.variables[attributes["name"]] = (inner.tag, reference, attributes)


class Unit:
    """An instance."""

    def __init__(self, archive: Archive) -> None:
        self.archive, self.fmi, self.told = archive, archive.fmi, []
        resources = archive.folder / "resources"
        if self.fmi == 2:
            self.logger: Any = LOGGER2(lambda _e, _n, status, _c, words: self._tell(status, words))
            self.callbacks = Callbacks(self.logger, None, None, None, None)
            instantiate = archive.library.fmi2Instantiate
            instantiate.argtypes = [c.c_char_p, c.c_int, c.c_char_p, c.c_char_p]
            instantiate.argtypes += [c.POINTER(Callbacks), c.c_int, c.c_int]
            rest: tuple[Any, ...] = (c.byref(self.callbacks), 0, 0)
            arguments = (b"unit", 1, archive.token, resources.as_uri().encode(), *rest)
        else:
            self.logger = LOGGER3(lambda _e, status, _c, words: self._tell(status, words))
            instantiate = archive.library.fmi3InstantiateCoSimulation
            instantiate.argtypes = [c.c_char_p] * 3 + [c.c_bool] * 4
            instantiate.argtypes += [c.c_void_p, c.c_size_t, c.c_void_p, LOGGER3, c.c_void_p]
            flags = (False, False, False, False)
            arguments = (
                b"unit",
                archive.token,
                bytes(resources),
                *flags,
                None,
                0,
                None,
                self.logger,
                None,
            )
        instantiate.restype = c.c_void_p
        self.pointer = instantiate(*arguments)
        assert self.pointer

    def _tell(self, status: int, words: bytes) -> None:
        self.told.append((status, words.decode()))

    def call(self, name: str, *arguments: Any) -> int:
        """Call a function of FMI by its name without the prefix."""
        function = getattr(self.archive.library, f"fmi{self.fmi}{name}")
        return function(c.c_void_p(self.pointer), *arguments)

    def _access(self, what: str, kind: str, reference: int, value: Any) -> int:
        title, _ = TYPES[kind]
        references = (c.c_uint32 * 1)(reference)
        sizes = (c.c_size_t(1),)
        last = sizes if self.fmi == 3 else ()
        return self.call(f"{what}{title}", references, *sizes, c.byref(value), *last)

    def _place(self, kind: str, value: float = 0) -> Any:
        if kind == "Boolean" and self.fmi == 3:
            return c.c_bool(bool(value))
        plain = TYPES[kind][1]
        return plain(value) if plain is c.c_double else plain(int(value))

    def get(self, name: str) -> float:
        """Read a variable."""
        kind, reference, _ = self.archive.variables[name]
        place = self._place(kind)
        assert self._access("Get", kind, reference, place) == 0, self.told
        return place.value

    def try_get(self, kind: str, reference: int) -> int:
        """Read anything; give the status."""
        return self._access("Get", kind, reference, self._place(kind))

    def set(self, **values: float) -> int:
        """Set variables; give the status."""
        status = 0
        for name, value in values.items():
            kind, reference, _ = self.archive.variables[name]
            status = max(status, self._access("Set", kind, reference, self._place(kind, value)))
        return status

    def start(self, **values: float) -> Self:
        """Set and initialise."""
        assert self.set(**values) == 0, self.told
        assert self.initialise() == 0, self.told
        return self

    def initialise(self) -> int:
        """Go through the initialisation; give the status."""
        zero = c.c_double(0.0)
        if self.fmi == 2:
            self.call("SetupExperiment", 0, zero, zero, 0, zero)
            status = self.call("EnterInitializationMode")
        else:
            flag = c.c_bool(False)
            status = self.call("EnterInitializationMode", flag, zero, zero, flag, zero)
        return max(status, self.call("ExitInitializationMode"))

    def step(self, time: float, length: float) -> int:
        """Make a communication step; give the status."""
        points = (c.c_double(time), c.c_double(length))
        if self.fmi == 2:
            return self.call("DoStep", *points, 1)
        flags, last = (c.c_bool * 3)(True, True, True), c.c_double()
        places = [c.byref(flags, k) for k in range(3)]
        status = self.call("DoStep", *points, c.c_bool(True), *places, c.byref(last))
        assert not any(flags)
        return status

    def state(self) -> c.c_void_p:
        """Get the state."""
        state = c.c_void_p()
        assert self.call(f"GetFMU{self._s}tate", c.byref(state)) == 0
        return state

    def restore(self, state: c.c_void_p) -> int:
        """Set the state."""
        return self.call(f"SetFMU{self._s}tate", state)

    def free_state(self, state: c.c_void_p) -> int:
        """Free a state."""
        return self.call(f"FreeFMU{self._s}tate", c.byref(state))

    def stored(self, state: c.c_void_p) -> bytes:
        """Give a state as bytes."""
        size = c.c_size_t()
        assert self.call(f"SerializedFMU{self._s}tateSize", state, c.byref(size)) == 0
        room = (c.c_uint8 * size.value)()
        assert self.call(f"SerializeFMU{self._s}tate", state, room, size) == 0
        return bytes(room)

    def unstored(self, data: bytes) -> tuple[int, c.c_void_p]:
        """Give the status and the state from bytes."""
        state = c.c_void_p()
        name = f"{'DeSerialize' if self.fmi == 2 else 'Deserialize'}FMU{self._s}tate"
        room = (c.c_uint8 * len(data))(*data)
        return self.call(name, room, c.c_size_t(len(data)), c.byref(state)), state

    @property
    def _s(self) -> str:
        return "s" if self.fmi == 2 else "S"

    def free(self) -> None:
        """Free the instance."""
        self.call("FreeInstance")
        self.pointer = None


ELSEWHERE = """
import json, sys
sys.modules["zivi"] = None
from fmpy import simulate_fmu
from fmpy.validation import validate_fmu
told = []
stop, step, *names = json.loads(sys.argv[1])
for path in sys.argv[2:]:
    problems = validate_fmu(path)
    rows = simulate_fmu(path, stop_time=stop, step_size=step, output_interval=step)
    told.append([list(problems), *(float(rows[name][-1]) for name in names)])
print(json.dumps(told))
"""


def simulated_elsewhere(
    folder: Path, stop: float, step: float, names: tuple[str, ...]
) -> list[list[Any]]:
    """What fmpy says of each FMU in a folder, and what it ends with, without zivi."""
    files = sorted(str(it) for it in folder.glob("*.fmu"))
    asked = json.dumps([stop, step, *names])
    command = [sys.executable, "-P", "-c", ELSEWHERE, asked, *files]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    told: list[list[Any]] = json.loads(done.stdout.splitlines()[-1])
    assert len(told) == len(files) > 0
    return told
