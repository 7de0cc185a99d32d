"""What is requested of a batch of closed loops: its arguments, checked and translated."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import zivi._zivi as _zivi
from zivi.base.check import Array
from zivi.control.loop_arguments import check_observer, on_wall
from zivi.control.loop_reference import rows_of
from zivi.control.observer import ImpactObserver
from zivi.control.twisting import CONTROLLERS
from zivi.simulation.batch_arguments import check_native
from zivi.system.mass import ImpactSystem, force_spec, in_wall_frame

__all__ = [
    "common",
    "entry",
    "forces_of",
    "observers_of",
    "on_walls",
    "placed",
    "references_of",
    "several",
]


def observers_of(observer: Any, controllers: list[Any]) -> list[Any]:
    """Return the observers, each of its controller's period."""
    observers = [] if observer is None else several("observer", observer)
    for i in range(max(len(observers), len(controllers)) if observers else 0):
        if i < len(observers) or len(observers) == 1:
            check_observer(entry(observers, i), controllers[min(i, len(controllers) - 1)].h)
    return observers


def several(name: str, things: Any) -> list[Any]:
    """Return one thing, or several, as a list."""
    try:
        one = isinstance(things, (ImpactSystem, ImpactObserver, *CONTROLLERS))
        found = [things] if one else list(things)
    except TypeError:
        found = [things]
    if not found:
        raise ValueError(f"{name} must hold at least one")
    return found


def common(lists: dict[str, Any]) -> int:
    """Return the number of loops; every list has an entry for each, or one for all."""
    n = max(len(it) for it in lists.values())
    for name, it in lists.items():
        if len(it) not in (1, n):
            raise ValueError(f"{name} must have 1 or {n} entries, got {len(it)}")
    return n


def placed(controllers: list[Any], references: Array, n: int) -> list[Any]:
    """Copy the controllers, with their references where they start."""
    copies = []
    for i in range(n):
        controller = controllers[i if len(controllers) > 1 else 0].copy()
        controller.reset(*(float(it) for it in references[i if len(references) > 1 else 0]))
        copies.append(controller)
        if len(controllers) == 1 and len(references) == 1:
            break
    return copies


def on_walls(controllers: list[Any], plants: list[ImpactSystem], n: int) -> list[Any]:
    """Give the controllers without `e` their plants'."""
    ours = [it for it in controllers if isinstance(it, CONTROLLERS)]
    differ = len(plants) > 1 and any(it._settings["kappa"] is None for it in ours)
    count = n if differ else len(controllers)
    # one warning for all of a kind: the warnings of one place are shown once
    return [on_wall(entry(controllers, i), entry(plants, i)) for i in range(count)]


def references_of(
    references: list[Any], controllers: list[Any], span: tuple[float, float], n: int
) -> list[tuple[Array, float]]:
    """Give the references at the samples, and the kappas of their walls."""
    count = n if max(len(references), len({(it.h, it.kappa_ref) for it in controllers})) > 1 else 1
    pairs = [(entry(references, i), entry(controllers, i)) for i in range(count)]
    return [(rows_of(it, span, controller.h), controller.kappa_ref) for it, controller in pairs]


def entry(things: Sequence[Any] | Array, i: int) -> Any:
    """Return the entry of one loop, or the one for all."""
    return things[i if len(things) > 1 else 0]


def forces_of(
    plants: list[ImpactSystem], force_model: Any, force_ref: Any
) -> tuple[list[_zivi.Force], list[_zivi.Force], list[_zivi.Force]]:
    """Translate the forces on the plants, in the models and on the references."""
    own = [plant._spec for plant in plants]
    if force_model is None:
        models = own
    else:
        model = force_spec(force_model, "force_model")
        models = [in_wall_frame(plant, model) for plant in plants]
    references = models if force_ref is None else [force_spec(force_ref, "force_ref")]
    for name, specs in (("system", own), ("model", models), ("reference", references)):
        for i, spec in enumerate(specs):
            check_native(spec, f"the force of {name} {i}")
    return own, models, references
