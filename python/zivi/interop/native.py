"""The C library: location of library and header, and gap trackers as C sources for a target."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

import zivi._zivi as _zivi
from zivi.base.check import identifier
from zivi.control.gap_tracker import GapTracker, check_gap_tracker
from zivi.system.mechanism import check_rigid
from zivi.system.symbolic_system import SymbolicInputs, SymbolicSystem

__all__ = ["gap_tracker_source", "prefix"]

LAW = Path(__file__).with_name("gap_tracker.c")
"""The law, the same for all systems."""


def prefix() -> Path:
    """Return the folder with ``include/zivi.h`` and ``lib/libzivi.a``.

    It is laid out like ``/usr/local`` and contains ``lib/pkgconfig`` and ``lib/cmake``.

    Returns
    -------
    pathlib.Path
        A folder of the installed package.

    Raises
    ------
    FileNotFoundError
        If this installation was built without them; the message names the build command.

    Examples
    --------
    >>> from zivi import native
    >>> (native.prefix() / "include" / "zivi.h").exists()
    True
    """
    folder = Path(__file__).parents[1] / "_native"
    if not (folder / "include" / "zivi.h").exists():
        raise FileNotFoundError(
            f"no C library in {folder}: this installation was built without it. In the source "
            "tree, python tools/native.py builds it (make test does that too)"
        )
    return folder


def gap_tracker_source(
    controller: GapTracker, name: str = "gap_tracker", *, single: bool = False
) -> str:
    """Write a `GapTracker` as a C99 source for a target, to be compiled with the C library.

    The source has the compiled model, the decoupling, the latch of contacts, and calls
    ``zivi_tracker_step_to`` for each gap. It allocates nothing and needs ``math.h`` only. Its calls
    are in a comment at its beginning. Controls outside their limits are clipped one by one, while
    the Python controller redistributes them with priority for the gaps.

    Parameters
    ----------
    controller : GapTracker
        Of a `zivi.symbolic.system` without friction, with as many controls as coordinates, without
        `delay`, `tasks` and `learn_offset`. A force that is a function of time begins at the
        landing's: assign ``force[i]``.
    name : str
        Beginning of all names of the source: a letter, then letters, digits and underscores.
    single : bool
        Use single precision, ``zivi_f32.h``; compile with ``-fsingle-precision-constant``.

    Returns
    -------
    str
        The source.

    Raises
    ------
    TypeError, ValueError
        For a controller or a name of another kind.

    Examples
    --------
    >>> ball = zivi.symbolic.system(
    ...     "y", T="ydot**2/2", V="9.81*y", gaps={"floor": "y"}, e=0.5, inputs={"f": [1]}
    ... )
    >>> ctl = zivi.GapTracker(ball, h=1e-3, gains={"floor": (30, 17)})
    >>> from zivi import native
    >>> source = native.gap_tracker_source(ctl, "ball")
    >>> "int32_t ball_step(" in source
    True
    """
    check_gap_tracker(controller)
    system = controller.system
    if not isinstance(system, SymbolicSystem):
        raise TypeError(
            "the model of the controller must be a zivi.symbolic.system, whose formulas are known, "
            f"got {type(system).__name__}"
        )
    identifier("name", name)
    settings = controller.settings
    for setting in ("delay", "tasks", "learn_offset"):
        if settings[setting]:
            raise ValueError(f"{setting} must not be set in C, got {settings[setting]}")
    n, m = len(system.coordinate_names(0) or ()), system.m
    inputs = system.control_inputs(np.zeros(n))
    check_rigid(system, "controllers")
    if system._channels:
        raise ValueError("the model of the controller must not have friction in C")
    if inputs.r != n or not m:
        raise ValueError(
            f"controller must have gaps and as many controls as coordinates in C, {n}; it has {m} "
            f"gaps and {inputs.r} controls"
        )
    real = "float" if single else "double"
    parts = [
        _head(controller, name, single, (n, m)),
        _types(real, "zivi_f32_" if single else "zivi_", (n, m, len(system.parameters))),
        _settings_source(controller, system, n),
        _model_source(system, inputs, real, n),
        LAW.read_text(encoding="ascii"),
    ]
    whole = "\n".join(parts)
    return re.sub(r"\bcontroller(?=_|\b)", name, whole)


def _head(controller: GapTracker, name: str, single: bool, sizes: tuple[int, int]) -> str:
    n, m = sizes
    system = controller.system
    real, header = ("float", "zivi_f32.h") if single else ("double", "zivi.h")
    limits = "" if controller.settings["u_limits"] is None else ", cut to their limits"
    return f"""\
/* {name}: the GapTracker of a mechanism, whose gaps follow bouncing references. Made by zivi
 * {_zivi.__version__}; compile it with the C library, -lm and -ffp-contract=off.
 *
 * coordinates {", ".join(system.coordinate_names(n))}
 * gaps        {", ".join(system.gap_names)}
 * controls    {", ".join(system.control_inputs(np.zeros(n)).names)}{limits}
 *
 *     int32_t {name}_init({name} *it);
 *         A code < 0 if the settings are refused.
 *     int32_t {name}_step({name} *it, {real} t, const {real} *q, const {real} *qdot,
 *                         const {name}_sample *now, const {name}_sample *next, {real} *u);
 *         The {n} controls for the period that starts at the time t, with measured coordinates and
 *         velocities, for a reference at this sample and at the next one; NULL: all gaps land and
 *         rest. Bits: 2 cut to the limits, 4 refused, the last controls held, 16 a contact lost;
 *         or < 0: refused, with a code of {header} or {name}_E_...
 *     uint32_t {name}_size(void);
 *
 * it->force[{m}]: contact forces that are asked for (N), those of the landing while not > 0;
 * it->held[{m}]: contacts that are held; it->parameters: those of the model. */
#include <math.h>
#include <stddef.h>
#include <stdint.h>
{"#include <tgmath.h>" if single else ""}

#include "{header}"
"""


def _types(real: str, prefix: str, sizes: tuple[int, int, int]) -> str:
    n, m, count = sizes
    return f"""\
typedef {real} real;
typedef {prefix}given_reference reference;
typedef {prefix}tracker_config tracker_config;
#define tracker_defaults {prefix}tracker_defaults
#define tracker_init {prefix}tracker_init
#define tracker_step_to {prefix}tracker_step_to

enum {{ COORDINATES = {n}, GAPS = {m}, PARAMETERS = {count}, ROW = {n * n + n + m * (n + 3)} }};
enum {{ SATURATED = 2, REFUSED = 4, LATCH_LOST = 16 }};
/* the model is not finite, the gaps are not independent, the controls do not reach all */
enum {{ controller_E_MODEL = -60, controller_E_DEPENDENT = -61, controller_E_UNREACHED = -62 }};

typedef struct controller_sample {{
    real q[{n}], qdot[{n}], qddot[{n}]; /* without contact forces */
    real gaps[{m}], gap_rates[{m}];
    real accelerations[{m}]; /* without the force of their own contact; NaN if not known */
    real sides[{m}];         /* 1 or -1, the other after each impact */
    real contacts[{m}];      /* 1 where the gap is closed and stays so, else 0 */
}} controller_sample;
typedef controller_sample sample;

typedef struct controller {{
    {prefix}tracker trackers[{m}];
    real force[{m}], u[{n}], place[{n}], parameters[{max(count, 1)}];
    int32_t beyond[{m}];
    uint8_t held[{m}], placed;
    uint32_t status;
}} controller;

int32_t controller_init(controller *it);
int32_t controller_step(controller *it, real t, const real *q, const real *qdot, const sample *now,
                        const sample *next, real *u);
uint32_t controller_size(void);
"""


def _settings_source(controller: GapTracker, system: SymbolicSystem, n: int) -> str:
    told = controller.settings
    gains = [told["gains"][name] for name in system.gap_names]
    forces = [told["force"].get(name, 0.0) for name in system.gap_names]
    forces = [0.0 if callable(it) else it for it in forces]
    pulls, (exact, noise) = controller._law.pulls, controller._law.closed_within
    latch = told["latch"]
    limits = told["u_limits"]
    ranges = [["-HUGE_VAL", "HUGE_VAL"]] * n if limits is None else limits.tolist()
    rows = [
        ("GAINS[GAPS][2]", gains),
        ("RESTITUTION[GAPS]", system.e),
        ("FORCE[GAPS]", forces),
        ("PRESS[GAPS]", [press for press, _ in pulls]),
        ("WEAKEST[GAPS]", [least for _, least in pulls]),
        ("LATCH[2]", exact if latch is None else latch),
        ("NOISE[2]", noise if latch is None else [0.0, 0.0]),
        ("POSTURE[2]", told["posture"]),
        ("LIMITS[COORDINATES][2]", ranges),
        ("PARAMETER[]", [*system.parameters.values()] or [0.0]),
    ]
    lines = [f"static const real {name} = {_braced(values)};" for name, values in rows]
    numbers = {"PERIOD": told["h"], "HORIZON": told["horizon"], "REDUNDANT": 1e-10}
    lines += [f"static const real {name} = {_c_number(it)};" for name, it in numbers.items()]
    lines += [f"enum {{ SHIFT = {int(told['shift'])} }};", ""]
    return "\n".join(lines)


def _braced(values: Iterable[Any]) -> str:
    inner = [
        _braced(it) if isinstance(it, Sequence) and not isinstance(it, str) else _c_number(it)
        for it in values
    ]
    return "{" + ", ".join(inner) + "}"


def _c_number(value: Any) -> str:
    return value if isinstance(value, str) else repr(float(value))


def _model_source(system: SymbolicSystem, inputs: Any, real: str, n: int) -> str:
    """Write the system and its inputs as functions of the source."""
    told = system._symbolic_inputs
    if isinstance(told, SymbolicInputs) and told.sources:
        fill = _function_source(told.sources["c"], "inputs_of", real)
        fill += "\nstatic void inputs_at(real t, const real *q, real *out, real *p)\n"
        fill += "{\n    inputs_of(t, q, q, out, p);\n}\n"
    elif callable(inputs.matrix):
        raise TypeError("inputs must be numbers or expressions in C")
    else:
        values = np.ravel(np.asarray(inputs.matrix, dtype=np.float64)).tolist()
        fill = "static void inputs_at(real t, const real *q, real *out, real *p)\n{\n"
        fill += "    (void)t; (void)q; (void)p;\n"
        fill += "".join(f"    out[{k}] = {_c_number(it)};\n" for k, it in enumerate(values)) + "}\n"
    return _function_source(system.source, "system_at", real) + "\n" + fill


def _function_source(source: str, name: str, real: str) -> str:
    body = source.replace("#include <math.h>\n", "").replace("int model(", f"static int {name}(")
    return re.sub(r"\bdouble\b", "real", body) if real == "float" else body
