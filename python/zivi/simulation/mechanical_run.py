"""A run of a mechanical system: its arguments, checked, and its record as a result."""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Callable
from typing import Any, TypeAlias

import numpy as np

import zivi._zivi as _zivi
from zivi.base.check import Array, real_array
from zivi.base.status import warn
from zivi.simulation.mechanical_trajectory import MechanicalTrajectory
from zivi.simulation.method_settings import FixedSteps, Settings
from zivi.simulation.methods import MoreauJean, SwitchedRK, ThetaGamma
from zivi.simulation.run_result import Closer, closer_mechanism
from zivi.simulation.trajectory import describe_restitutions
from zivi.system.kicks import KickSchedule, schedule_of
from zivi.system.mechanism import MechanicalSystem, Model, check_planar, check_rotations
from zivi.system.start import check_start, consistent, kinetic_cosines

FixedOrSwitched: TypeAlias = SwitchedRK | FixedSteps
"""The methods that take mechanical systems."""


@dataclasses.dataclass(slots=True)
class RunRequest:
    """Arguments of a run, checked.

    Parameters
    ----------
    span : (float, float)
        Start and end.
    q, qdot : ndarray
        The state at the start.
    t_eval : ndarray or None
        Times of the samples.
    tstops : ndarray
        Times where the force is not smooth.
    events : list
        Events, returned by `events_of`.
    dense : bool
        Whether the motion between the samples is kept.
    kicks : KickSchedule or None
        The velocities after kicks at some of the declared times.
    arcs : bool
        Whether at least the arcs of it are kept that jumps skip, with the impacts on them.
    ends : bool
        Whether without times of samples only the ends are sampled.
    """

    span: tuple[float, float]
    q: Array
    qdot: Array
    t_eval: Array | None
    tstops: Array
    events: list[_zivi.Event]
    dense: bool
    kicks: KickSchedule | None = None
    arcs: bool = False
    ends: bool = False

    def keep(self) -> _zivi.RecordOptions:
        """Return what the extension keeps."""
        return _zivi.RecordOptions(
            t_eval=self.t_eval,
            tstops=self.tstops,
            kicks=self.kicks,
            events=self.events,
            ends=self.ends,
            dense=self.dense,
            arcs=self.arcs,
        )


def state_of(y0: Any, n: int | None) -> tuple[Array, Array]:
    """Read ``(q0, qdot0)``."""
    try:
        given = tuple(y0)
    except TypeError:
        given = ()
    if len(given) != 2:
        raise TypeError(f"y0 must be (q0, qdot0), two arrays of shape (n,), got {y0!r}")
    q, qdot = real_array("q0", given[0]), real_array("qdot0", given[1])
    if not q.ndim:
        q = q.reshape(1)
    if not qdot.ndim:
        qdot = qdot.reshape(1)
    size = len(q) if n is None else n
    for name, value in (("q0", q), ("qdot0", qdot)):
        if value.shape != (size,):
            raise ValueError(f"{name} must have shape ({size},), got {value.shape}")
        if not all(map(math.isfinite, value.tolist())):
            raise ValueError(f"{name} must be finite, got {value.tolist()}")
    return q, qdot


def check_mechanical_method(method: Any) -> None:
    """Reject methods that do not support mechanical systems, with the reason."""
    if not isinstance(method, Settings):
        raise TypeError(f"method must be zivi.SwitchedRK() or zivi.MoreauJean(h), got {method!r}")
    if not method._entry.takes_mechanism:
        name = method._entry.name
        raise ValueError(f"{name} supports a zivi.ImpactSystem only: use zivi.SwitchedRK()")
    if isinstance(method, SwitchedRK) and method.flights == "series":
        raise ValueError("flights must be 'auto' or 'rk' for a MechanicalSystem, got 'series'")
    if isinstance(method, ThetaGamma) and (method.theta, method.gamma, method.solver) != IMPLICIT:
        raise ValueError(
            f"a MechanicalSystem takes zivi.ThetaGamma(h) with its defaults, got {method}"
        )


def check_friction(system: MechanicalSystem, method: Any) -> None:
    """Reject methods that do not support the friction or compliant gaps of a system."""
    if system.equality_names and not isinstance(method, SwitchedRK):
        raise NotImplementedError(
            f"equality rows are not supported by {type(method).__name__}; use zivi.SwitchedRK()"
        )
    if system.impact_law != "newton" and not isinstance(method, SwitchedRK):
        raise ValueError(
            f"impact_law must be 'newton' for {type(method).__name__}, got "
            f"{system.impact_law!r}; use zivi.SwitchedRK()"
        )
    compliant = system._compliant()
    if compliant and not isinstance(method, SwitchedRK):
        name = system.gap_names[compliant[0][0]]
        raise NotImplementedError(
            f"gap {name!r} is compliant, which {type(method).__name__} does not support: use "
            "zivi.SwitchedRK()"
        )
    if isinstance(method, MoreauJean):
        check_rotations(system, type(method).__name__)
    elif not isinstance(method, SwitchedRK):
        check_planar(system, type(method).__name__)
    at_gaps = [channel.name for channel in system._channels if channel.gap is not None]
    if at_gaps and isinstance(method, ThetaGamma):
        raise ValueError(
            f"gap {at_gaps[0]!r} must be without friction for ThetaGamma, which supports friction "
            "in joints only: an impact changes the tangential velocity as well. Use "
            "zivi.SwitchedRK() or zivi.MoreauJean(h)"
        )
    known = SwitchedRK | MoreauJean | ThetaGamma
    if system._channels and not isinstance(method, known):
        raise NotImplementedError(
            f"{type(method).__name__} does not support dry friction: its step does not contain the "
            "sign of the slip speeds. Use zivi.SwitchedRK()"
        )


IMPLICIT = (1.0, 1.0, "exact")
"""theta, gamma and solver of the member that comes to rest exactly."""

COUPLED = (
    "an impact on one of them changes the speed of the others at once, which the continuous "
    "velocity v of ThetaGamma cannot follow. Use zivi.SwitchedRK()"
)


def run_mechanical(
    system: MechanicalSystem, method: FixedOrSwitched, asked: RunRequest, report: Any
) -> tuple[MechanicalTrajectory, BaseException | None]:
    """Check the initial state, run, and return the result with the exception that ended it."""
    record, model = record_of(system, method, asked, report)
    setup = setup_of(system, model, method, asked)
    closer = closer_of(system, method, asked)
    stepped = not isinstance(method, SwitchedRK)
    sol = MechanicalTrajectory._from_record(record, system, model, setup, closer, stepped=stepped)
    if not isinstance(method, SwitchedRK) and asked.t_eval is not None:
        sol = sol.resample(asked.t_eval[asked.t_eval <= sol.t[-1]])
    return sol, record.raised


def record_of(
    system: MechanicalSystem, method: FixedOrSwitched, asked: RunRequest, report: Any
) -> tuple[_zivi.MechanicalRecord, Model]:
    """Check the initial state, run, and return the record of the extension."""
    check_friction(system, method)
    model: Model = system.model(len(asked.q))
    check_start(system, model, asked.span, asked.q, asked.qdot)
    if isinstance(method, MoreauJean) and _coupled(system, model, asked, differing=True):
        warn(ENERGY.format(e=system.e.tolist()), RuntimeWarning)
    if isinstance(method, ThetaGamma) and _coupled(system, model, asked):
        raise ValueError(f"the gaps {', '.join(system.gap_names)} are coupled: {COUPLED}")
    record = _zivi.simulate(
        system.mechanism(model),
        method._core,
        asked.span,
        _zivi.Configuration(asked.q, asked.qdot),
        asked.keep(),
        report,
    )
    return record, model


ENERGY = (
    "MoreauJean predicts which gaps are hit in a step; where coupled gaps have different "
    "coefficients of restitution, here {e}, such a step may raise the energy. SwitchedRK never does"
)


def _coupled(
    system: MechanicalSystem, model: Model, asked: RunRequest, *, differing: bool = False
) -> bool:
    """Whether gaps, or those with different e, are coupled through the mass matrix at the start."""
    pairs = ~np.eye(system.m, dtype=bool)
    if differing:
        pairs &= system.e[:, None] != system.e
    if not np.any(pairs):
        return False
    here = model.layout.read(model.evaluate(asked.span[0], asked.q, asked.qdot))
    cosines = kinetic_cosines(here.gradients @ np.linalg.solve(here.mass, here.gradients.T))
    return bool(np.any(np.abs(cosines)[pairs] > 1e-9))


def stops_with(kicked: KickSchedule, stops: Array, method: Any) -> Array:
    """Return the declared times together with those of the kicks."""
    if not getattr(method, "_takes_tstops", False):
        raise ValueError(
            f"kicks are not supported by {type(method).__name__}; use zivi.SwitchedRK()"
        )
    return np.unique(np.concatenate([stops, kicked.stops]))


def with_kicks(asked: RunRequest, kicks: Any, system: MechanicalSystem, method: Any) -> RunRequest:
    """Return the arguments of a run with kicks, from the state after initial ones."""
    kicked = schedule_of(kicks, system, len(asked.q), asked.span)
    if kicked is None:
        return asked
    stops = stops_with(kicked, asked.tstops, method)
    qdot = kicked.start(asked.span[0], asked.q, asked.qdot)
    if system.equality_names:
        qdot = consistent(system, asked.q, qdot, asked.span[0])[1]
    return dataclasses.replace(asked, tstops=stops, qdot=qdot, kicks=kicked)


def closer_of(
    system: MechanicalSystem, method: FixedOrSwitched, asked: RunRequest
) -> Closer | None:
    """Return a function that repeats the run with smaller tolerances."""
    if not isinstance(method, SwitchedRK):
        return None
    state = (asked.q, asked.qdot)
    return functools.partial(closer_mechanism, system, method, asked.span[0], state, asked.tstops)


def configuration(
    system: MechanicalSystem, model: Model, method: Any, asked: RunRequest
) -> dict[str, Any]:
    """Plain values that tell the run again (functions only by their names)."""
    return setup_of(system, model, method, asked)()


def setup_of(
    system: MechanicalSystem, model: Model, method: Any, asked: RunRequest
) -> Callable[[], dict[str, Any]]:
    """Return a function that makes the `configuration` later, from the present parameters."""
    told, parameters = system._told()
    return functools.partial(_configuration, system, told, parameters, model, method, asked)


def _configuration(
    system: MechanicalSystem,
    told: str | None,
    parameters: dict[str, float] | None,
    model: Model,
    method: Any,
    asked: RunRequest,
) -> dict[str, Any]:
    config = {
        "system": repr(system) if told is None else told,
        "e": describe_restitutions(system._e),
        "coordinates": list(system.coordinate_names(model.layout.n)),
        "gaps": list(system.gap_names),
        "t_span": list(asked.span),
        "q0": asked.q.tolist(),
        "qdot0": asked.qdot.tolist(),
        "method": {"name": type(method).__name__, **method._values()},
    }
    if (units := system._units()) is not None:
        config["units"] = units
    if rotations := system._rotations():
        config["rotations"] = {name: list(it) for name, it in rotations.items()}
    if system._channels:
        config["friction"] = list(system.channel_names)
        config |= {"impact_law": system.impact_law, "paradox": system.paradox}
    if system.equality_names:
        config["equalities"] = list(system.equality_names)
    if parameters:
        config["parameters"] = dict(parameters)
    return config
