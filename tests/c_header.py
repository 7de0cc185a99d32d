"""A C header read: its structures as ctypes, its functions and constants."""

from __future__ import annotations

import ctypes
import re
from pathlib import Path
from typing import Any

TYPES = {
    "double": ctypes.c_double,
    "uint32_t": ctypes.c_uint32,
    "int32_t": ctypes.c_int32,
    "uint64_t": ctypes.c_uint64,
}


class Header:
    """What a header of the repository declares: of structures those of plain numbers."""

    def __init__(self, path: Path) -> None:
        text = re.sub(r"/\*.*?\*/|//[^\n]*", "", path.read_text(), flags=re.DOTALL)
        self.constants = {
            name: int(value) for name, value in re.findall(r"#define (ZIVI_\w+) (-?\d+)", text)
        }
        self.structures: dict[str, Any] = {}
        for name, body in re.findall(r"typedef struct (\w+) \{(.*?)\} \1;", text, re.DOTALL):
            fields = re.findall(r"(\w+) (\*?\w+)(?:\[(\d+)\])?;", body.replace("struct ", ""))
            known = TYPES | self.structures
            if all(kind in known and not field.startswith("*") for kind, field, _ in fields):
                members = [
                    (field, known[kind] * int(many) if many else known[kind])
                    for kind, field, many in fields
                ]
                self.structures[name] = type(name, (ctypes.Structure,), {"_fields_": members})
        self.functions = set(re.findall(r"\b(zivi_\w+)\(", text))
