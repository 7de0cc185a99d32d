"""Models and variables of FMUs; ``modelDescription.xml`` for FMI 2.0 and 3.0."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from typing import Literal
from xml.etree import ElementTree as Xml

import zivi._zivi as _zivi

# The models and their variables: the one place from which their descriptions are made.
#
# The place of a variable is its value reference, which never changes once it is released: what is
# new comes at the end. The binary has the same tables without names (``crates/zivi-fmu``).

Kind = Literal["real", "integer", "boolean"]
Role = Literal["time", "parameter", "input", "output"]


@dataclass(frozen=True)
class Variable:
    """One variable of a model."""

    name: str
    kind: Kind
    role: Role
    start: float
    unit: str | None
    description: str


@dataclass(frozen=True)
class FMU:
    """A model that is exported."""

    key: str
    name: str
    token: str
    description: str
    variables: tuple[Variable, ...]
    feedthrough: dict[str, tuple[str, ...]]
    """Outputs that depend on inputs of the same moment."""
    initial: dict[str, tuple[str, ...]]
    """Outputs that depend on parameters or inputs at the start."""
    any_step: bool = field(default=False)
    """Whether a communication step need not be a multiple of `h`."""

    def with_token(self, token: str) -> FMU:
        """Return it with the token with which an importer instantiates it."""
        return replace(self, token=token)


def real(name: str, role: Role, start: float, unit: str | None, description: str) -> Variable:
    """Describe a real variable."""
    return Variable(name, "real", role, start, unit, description)


def integer(name: str, role: Role, start: int, description: str) -> Variable:
    """Describe an integer variable."""
    return Variable(name, "integer", role, start, None, description)


def boolean(name: str, role: Role, start: bool, description: str) -> Variable:
    """Describe a boolean variable."""
    return Variable(name, "boolean", role, start, None, description)


TIME = real("time", "time", 0.0, "s", "The last communication point")
STATUS = integer(
    "status",
    "output",
    0,
    "Of the last tick: bits 1 (x < 0 taken as 0) and 2 (u cut), < 0: sample refused, u held",
)

CONTROL = (
    real("mu1", "parameter", 30.0, "m/s2", "Gain on the sign of the position (error)"),
    real("mu2", "parameter", 17.0, "m/s2", "Gain on the sign of the velocity (error), < mu1"),
    real("h", "parameter", 1e-3, "s", "Sampling period"),
    real("e", "parameter", 0.5, None, "Coefficient of restitution of the wall, in (0, 1]"),
)
LIMITS = (
    real("bound", "parameter", 0.0, "m/s2", "Bound of the unknown force that gains must stand"),
    real("depth", "parameter", 0.1, "m", "How far behind the wall a measurement may lie"),
    real("u_min", "parameter", -1e300, "m/s2", "Least control of the actuator"),
    real("u_max", "parameter", 1e300, "m/s2", "Largest control of the actuator"),
)
LANDING = (
    boolean("landing", "parameter", True, "Whether the control ends in exact rest"),
    integer("ahead", "parameter", 1, "Horizon of the landing: 1 + the periods of delay"),
)
QUIET = real("quiet", "parameter", 0.0, "m/s", "Bound of the errors of the measured velocity")
REFERENCE = (
    real("e_ref", "parameter", 0.0, None, "Restitution of the reference's wall; 0: as e"),
    real("x_ref0", "parameter", 0.0, "m", "Where the reference starts"),
    real("xdot_ref0", "parameter", 0.0, "m/s", "Velocity with which the reference starts"),
)
TRACKING = (
    *CONTROL,
    *REFERENCE,
    *LIMITS,
    boolean("nearest", "parameter", False, "Lift to the preimage nearer to the reference"),
    *LANDING,
    real("press", "parameter", 0.0, "m/s2", "Pressing of a mass at rest; 0: the law's own"),
    real("horizon", "parameter", 1.0, None, "Periods that a step is planned over, >= 1"),
    boolean("shift", "parameter", False, "Take the measured velocity half a period back"),
    QUIET,
)
START = (
    real("x0", "parameter", 1.0, "m", "Distance from the wall at the start, >= 0"),
    real("xdot0", "parameter", 0.0, "m/s", "Velocity at the start"),
)
FORCE = real("force", "input", -9.81, "m/s2", "Known force on the mass without control")
FORCE_REF = real("force_ref", "input", -9.81, "m/s2", "Force on the reference")
CONTROLLED = real("u", "output", 0.0, "m/s2", "The control, to be held for one period")
REFERENCE_OUT = (
    real("x_ref", "output", 0.0, "m", "The reference: distance from the wall"),
    real("xdot_ref", "output", 0.0, "m/s", "The reference: velocity"),
)
MEASURED = (
    real("x", "input", 0.0, "m", "Measured distance from the wall"),
    real("xdot", "input", 0.0, "m/s", "Measured velocity"),
)
MOVED = (
    real("x", "output", 0.0, "m", "Distance from the wall"),
    real("xdot", "output", 0.0, "m/s", "Velocity, at the wall the one after the impact"),
)
ESTIMATES = ("x_est", "xdot_est", "d_est", "refused", "status", "e_est", "e_std")
REFERENCE_START = ("x_ref0", "xdot_ref0", "e", "e_ref")

MODELS = {
    model.key: model
    for model in (
        FMU(
            "mass",
            "ImpactingMass",
            "zivi-impacting-mass-1",
            "A mass above a wall, x'' = u - g, with impacts x'+ = -e x'-, through Zeno points",
            (
                TIME,
                real("u", "input", 0.0, "m/s2", "Force per unit mass, held over a step"),
                *MOVED,
                real("s", "output", 0.0, "m", "Transformed position, x = |s|"),
                real("v", "output", 0.0, "m/s", "Transformed velocity"),
                boolean("at_rest", "output", False, "Whether the mass rests on the wall"),
                real("h", "parameter", 1e-3, "s", "Step size of the implicit Euler scheme"),
                real("e", "parameter", 0.5, None, "Coefficient of restitution, in (0, 1]"),
                real("g", "parameter", 9.81, "m/s2", "Acceleration towards the wall"),
                *START,
            ),
            feedthrough={},
            initial={
                "x": ("x0",),
                "xdot": ("x0", "xdot0", "e"),
                "s": ("x0",),
                "v": ("xdot0", "e"),
                "at_rest": ("x0", "xdot0"),
            },
            any_step=True,
        ),
        FMU(
            "regulator",
            "TwistingRegulator",
            "zivi-twisting-regulator-1",
            "The twisting regulator: brings a mass with impacts to rest at the wall",
            (
                TIME,
                *MEASURED,
                real("force", "input", 0.0, "m/s2", "Known force on the mass without control"),
                CONTROLLED,
                STATUS,
                *CONTROL,
                *LIMITS,
                *LANDING,
                QUIET,
            ),
            feedthrough={"u": ("x", "xdot", "force"), "status": ("x", "xdot", "force")},
            initial={"u": ("x", "xdot", "force"), "status": ("x", "xdot", "force")},
        ),
        FMU(
            "tracker",
            "TwistingTracker",
            "zivi-twisting-tracker-1",
            "The twisting tracker: makes a mass with impacts follow a bouncing reference",
            (
                TIME,
                *MEASURED,
                FORCE,
                FORCE_REF,
                CONTROLLED,
                *REFERENCE_OUT,
                STATUS,
                *TRACKING,
            ),
            feedthrough={
                "u": ("x", "xdot", "force", "force_ref"),
                "status": ("x", "xdot", "force", "force_ref"),
            },
            initial={
                "u": ("x", "xdot", "force", "force_ref", *REFERENCE_START),
                "x_ref": REFERENCE_START,
                "xdot_ref": REFERENCE_START,
                "status": ("x", "xdot", "force", "force_ref"),
            },
        ),
        FMU(
            "loop",
            "TwistingLoop",
            "zivi-twisting-loop-1",
            "A mass with impacts and its twisting tracker in a closed loop, without any delay",
            (
                TIME,
                real("disturbance", "input", 0.0, "m/s2", "Force that the controller ignores"),
                FORCE,
                FORCE_REF,
                *MOVED,
                *REFERENCE_OUT,
                CONTROLLED,
                STATUS,
                *START,
                *TRACKING,
            ),
            feedthrough={"u": ("force", "force_ref"), "status": ("force", "force_ref")},
            initial={
                "x": ("x0",),
                "xdot": ("x0", "xdot0", "e"),
                "x_ref": REFERENCE_START,
                "xdot_ref": REFERENCE_START,
                "u": ("force", "force_ref", "x0", "xdot0", *REFERENCE_START),
                "status": ("force", "force_ref"),
            },
        ),
        FMU(
            "observer",
            "ImpactObserver",
            "zivi-impact-observer-1",
            "Position, velocity and an unknown force of a mass with impacts, from measurements",
            (
                TIME,
                *MEASURED,
                FORCE,
                real("u", "input", 0.0, "m/s2", "Control that acted over the period that ends now"),
                real("x_est", "output", 0.0, "m", "Estimate of the distance from the wall"),
                real("xdot_est", "output", 0.0, "m/s", "Estimate of the velocity"),
                real("d_est", "output", 0.0, "m/s2", "Estimate of the unknown force"),
                integer("refused", "output", 0, "Measurements beyond 5 standard deviations so far"),
                integer("status", "output", 0, "< 0: the measurement was not finite"),
                real("h", "parameter", 1e-3, "s", "Sampling period"),
                real("e", "parameter", 0.5, None, "Coefficient of restitution, in (0, 1]"),
                real("noise_x", "parameter", 1e-4, "m", "Standard deviation of a position"),
                real("noise_xdot", "parameter", 1e-2, "m/s", "Standard deviation of a velocity"),
                real("q_d", "parameter", 1e-3, None, "Variance that a period adds to the force"),
                real("se", "parameter", 0.0, None, "Standard deviation of e"),
                real("dmax", "parameter", 20.0, "m/s2", "Bound of the unknown force"),
                boolean("position_only", "parameter", False, "Whether xdot is not measured"),
                boolean("learn_e", "parameter", False, "Whether e is learnt from the impacts"),
                real("q_e", "parameter", 0.0, None, "Variance that an impact adds to a learnt e"),
                real("e_est", "output", 0.0, None, "The restitution, as far as it is known"),
                real("e_std", "output", 0.0, None, "Its standard deviation, 0 if it is not learnt"),
            ),
            feedthrough=dict.fromkeys(ESTIMATES, ("x", "xdot", "force", "u")),
            initial=dict.fromkeys(ESTIMATES, ("x", "xdot", "force", "u")),
        ),
    )
}
"""All models by their key."""


# ``modelDescription.xml`` for FMI 2.0 and 3.0, made from the tables.

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


def description(model: FMU, fmi: int) -> bytes:
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


def _abilities(model: FMU, fmi: int) -> dict[str, str]:
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


def _start_text(variable: Variable) -> str:
    if variable.kind == "boolean":
        return "true" if variable.start else "false"
    return repr(float(variable.start)) if variable.kind == "real" else str(int(variable.start))


def _common_attributes(variable: Variable, reference: int) -> dict[str, str]:
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


def _unit_and_start(variable: Variable) -> dict[str, str]:
    values = {}
    if variable.unit is not None:
        values["unit"] = variable.unit
    if variable.role in ("parameter", "input"):
        values["start"] = _start_text(variable)
    return values


def _variable2(parent: Xml.Element, variable: Variable, reference: int) -> None:
    scalar = Xml.SubElement(parent, "ScalarVariable", _common_attributes(variable, reference))
    Xml.SubElement(scalar, TYPES[2][variable.kind], _unit_and_start(variable))


def _variable3(parent: Xml.Element, variable: Variable, reference: int) -> None:
    attributes = _common_attributes(variable, reference) | _unit_and_start(variable)
    Xml.SubElement(parent, TYPES[3][variable.kind], attributes)


def _structure2(structure: Xml.Element, model: FMU) -> None:
    index = {variable.name: place + 1 for place, variable in enumerate(model.variables)}
    for title, dependencies in (("Outputs", model.feedthrough), ("InitialUnknowns", model.initial)):
        unknowns = Xml.SubElement(structure, title)
        for name in _outputs(model):
            known = _references(index, dependencies.get(name, ()))
            Xml.SubElement(unknowns, "Unknown", index=str(index[name]), dependencies=known)


def _structure3(structure: Xml.Element, model: FMU) -> None:
    reference = {variable.name: place for place, variable in enumerate(model.variables)}
    for title, dependencies in (("Output", model.feedthrough), ("InitialUnknown", model.initial)):
        for name in _outputs(model):
            known = _references(reference, dependencies.get(name, ()))
            unknown = {"valueReference": str(reference[name]), "dependencies": known}
            Xml.SubElement(structure, title, unknown)


def _outputs(model: FMU) -> Iterable[str]:
    return (variable.name for variable in model.variables if variable.role == "output")


def _references(places: dict[str, int], names: Iterable[str]) -> str:
    return " ".join(str(place) for place in sorted(places[name] for name in names))
