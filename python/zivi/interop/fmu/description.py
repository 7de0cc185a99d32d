"""``modelDescription.xml`` for FMI 2.0 and 3.0, made from the tables."""

from __future__ import annotations

from collections.abc import Iterable
from xml.etree import ElementTree as Xml

import zivi._zivi as _zivi
from zivi.interop.fmu.table import Model, Variable

__all__ = ["IDENTIFIER", "description"]

IDENTIFIER = "zivi"
"""Name of the binary in the archive."""

UNITS = {
    "m": {"m": "1"},
    "m/s": {"m": "1", "s": "-1"},
    "m/s2": {"m": "1", "s": "-2"},
    "s": {"s": "1"},
}
TYPES = {
    2: {"real": "Real", "integer": "Integer", "boolean": "Boolean"},
    3: {"real": "Float64", "integer": "Int32", "boolean": "Boolean"},
}


def description(model: Model, fmi: int) -> bytes:
    """Write the description of one model."""
    root = Xml.Element(
        "fmiModelDescription",
        {
            "fmiVersion": f"{fmi}.0",
            "modelName": model.name,
            "guid" if fmi == 2 else "instantiationToken": model.token,
            "description": model.description,
            "version": _zivi.__version__,
            "generationTool": f"zivi {_zivi.__version__}",
            "license": "Apache-2.0",
            "variableNamingConvention": "flat",
        },
    )
    if fmi == 2:
        root.set("numberOfEventIndicators", "0")
    Xml.SubElement(root, "CoSimulation", _abilities(model, fmi))
    units = Xml.SubElement(root, "UnitDefinitions")
    for name, exponents in UNITS.items():
        Xml.SubElement(Xml.SubElement(units, "Unit", name=name), "BaseUnit", exponents)
    Xml.SubElement(root, "DefaultExperiment", startTime="0", stopTime="4", stepSize="0.001")
    variables = Xml.SubElement(root, "ModelVariables")
    for reference, variable in enumerate(model.variables):
        (_variable2 if fmi == 2 else _variable3)(variables, variable, reference)
    structure = Xml.SubElement(root, "ModelStructure")
    (_structure2 if fmi == 2 else _structure3)(structure, model)
    Xml.indent(root)
    return b'<?xml version="1.0" encoding="UTF-8"?>\n' + Xml.tostring(root) + b"\n"


def _abilities(model: Model, fmi: int) -> dict[str, str]:
    state = "FMUstate" if fmi == 2 else "FMUState"
    abilities = {
        "modelIdentifier": IDENTIFIER,
        "canHandleVariableCommunicationStepSize": "true",
        "canBeInstantiatedOnlyOncePerProcess": "false",
        f"canGetAndSet{state}": "true",
        f"canSerialize{state}": "true",
    }
    if fmi == 2:
        abilities["canNotUseMemoryManagementFunctions"] = "true"
    return abilities


def _number(variable: Variable) -> str:
    if variable.kind == "boolean":
        return "true" if variable.start else "false"
    return repr(float(variable.start)) if variable.kind == "real" else str(int(variable.start))


def _common(variable: Variable, reference: int) -> dict[str, str]:
    common = {
        "name": variable.name,
        "valueReference": str(reference),
        "description": variable.description,
        "causality": "independent" if variable.role == "time" else variable.role,
    }
    if variable.role == "parameter":
        common |= {"variability": "fixed", "initial": "exact"}
    elif variable.role == "output":
        common["initial"] = "calculated"
    if variable.kind != "real" and variable.role != "parameter":
        common["variability"] = "discrete"
    elif variable.role == "time":
        common["variability"] = "continuous"
    return common


def _values(variable: Variable) -> dict[str, str]:
    values = {}
    if variable.unit is not None:
        values["unit"] = variable.unit
    if variable.role in ("parameter", "input"):
        values["start"] = _number(variable)
    return values


def _variable2(parent: Xml.Element, variable: Variable, reference: int) -> None:
    scalar = Xml.SubElement(parent, "ScalarVariable", _common(variable, reference))
    Xml.SubElement(scalar, TYPES[2][variable.kind], _values(variable))


def _variable3(parent: Xml.Element, variable: Variable, reference: int) -> None:
    attributes = _common(variable, reference) | _values(variable)
    Xml.SubElement(parent, TYPES[3][variable.kind], attributes)


def _structure2(structure: Xml.Element, model: Model) -> None:
    index = {variable.name: place + 1 for place, variable in enumerate(model.variables)}
    for title, dependencies in (("Outputs", model.feedthrough), ("InitialUnknowns", model.initial)):
        unknowns = Xml.SubElement(structure, title)
        for name in _outputs(model):
            known = _references(index, dependencies.get(name, ()))
            Xml.SubElement(unknowns, "Unknown", index=str(index[name]), dependencies=known)


def _structure3(structure: Xml.Element, model: Model) -> None:
    reference = {variable.name: place for place, variable in enumerate(model.variables)}
    for title, dependencies in (("Output", model.feedthrough), ("InitialUnknown", model.initial)):
        for name in _outputs(model):
            known = _references(reference, dependencies.get(name, ()))
            unknown = {"valueReference": str(reference[name]), "dependencies": known}
            Xml.SubElement(structure, title, unknown)


def _outputs(model: Model) -> Iterable[str]:
    return (variable.name for variable in model.variables if variable.role == "output")


def _references(places: dict[str, int], names: Iterable[str]) -> str:
    return " ".join(str(place) for place in sorted(places[name] for name in names))
