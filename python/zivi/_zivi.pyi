from collections.abc import Callable
from typing import Any, Self, final

import numpy as np
from numpy.typing import NDArray
from typing_extensions import disjoint_base

__all__ = [
    "STATUS_MESSAGES",
    "BatchRecord",
    "Explicit",
    "LoopBatchRecord",
    "LoopRecord",
    "MechanicalPath",
    "MechanicalRecord",
    "MotionPath",
    "Observer",
    "Regulator",
    "RunRecord",
    "SensitivityRecord",
    "Tracker",
    "ViRecord",
    "__version__",
    "available_threads",
    "ballistic_motion",
    "check_impact_map",
    "check_moreau_jean",
    "check_switched_rk",
    "check_theta_gamma",
    "compiled_force",
    "compiled_model",
    "fly_apart",
    "force_raised",
    "grid_times",
    "lift",
    "map_of_impacts",
    "natural_residual",
    "orbits_of_impacts",
    "project",
    "restitution",
    "sensitivity",
    "simulate_batch",
    "simulate_closed_loop",
    "simulate_closed_loop_batch",
    "simulate_explicit_euler",
    "simulate_mechanical",
    "simulate_mechanical_moreau_jean",
    "simulate_mechanical_theta_gamma",
    "simulate_moreau_jean",
    "simulate_switched_rk",
    "simulate_theta_gamma",
    "solve_avi",
    "solve_steps",
    "solve_tracking_steps",
    "solve_vi",
]

__version__: str
STATUS_MESSAGES: list[str]

_Array = NDArray[np.float64]

@final
class RunRecord:
    @property
    def columns(self) -> _Array: ...
    @property
    def n_samples(self) -> int: ...
    @property
    def impacts(self) -> _Array: ...
    @property
    def zeno_times(self) -> _Array: ...
    @property
    def liftoff_times(self) -> _Array: ...
    @property
    def rest_time(self) -> float | None: ...
    @property
    def failed_steps(self) -> NDArray[np.int64]: ...
    @property
    def hits(self) -> list[tuple[_Array, _Array, _Array]]: ...
    @property
    def n_steps(self) -> int | None: ...
    @property
    def n_rejected(self) -> int: ...
    @property
    def path(self) -> MotionPath | None: ...
    @property
    def status(self) -> int: ...
    @property
    def message(self) -> str: ...
    @property
    def nfev(self) -> int: ...
    @property
    def raised(self) -> BaseException | None: ...

_SwitchedSettings = tuple[float, tuple[float, float], int, float, float | None, int, int, str]

@final
class MotionPath:
    def numbers(self) -> _Array: ...
    @staticmethod
    def restored(numbers: _Array) -> MotionPath: ...
    def __reduce__(self) -> tuple[Any, tuple[_Array]]: ...
    @property
    def dense(self) -> bool: ...
    @property
    def span(self) -> tuple[float, float] | None: ...
    @property
    def tails(self) -> list[tuple[float, float]]: ...
    def starts(self) -> _Array: ...
    def physical(self, times: _Array) -> tuple[_Array, _Array]: ...
    def lifted(self, times: _Array) -> tuple[_Array, _Array]: ...
    def skipped_impacts(self, speed: float, at_most: int) -> tuple[_Array, _Array, _Array]: ...

def compiled_model(callable: tuple[Any, ...], argument: str) -> tuple[int, int | None, bool]: ...

@final
class MechanicalPath:
    def numbers(self) -> _Array: ...
    @staticmethod
    def restored(numbers: _Array) -> MechanicalPath: ...
    def __reduce__(self) -> tuple[Any, tuple[_Array]]: ...
    @property
    def span(self) -> tuple[float, float] | None: ...
    def at(self, times: _Array) -> tuple[_Array, _Array, _Array, _Array, NDArray[np.bool_]]: ...

@final
class MechanicalRecord:
    t: _Array
    q: _Array
    qdot: _Array
    gaps: _Array
    gap_rates: _Array
    reactions: _Array
    contacts: NDArray[np.bool_]
    impact_t: _Array
    impact_gap: NDArray[np.int64]
    impact_speed_before: _Array
    impact_speed_after: _Array
    impact_impulse: _Array
    impact_group: NDArray[np.int64]
    zeno_t: _Array
    zeno_gap: NDArray[np.int64]
    zeno_closed: NDArray[np.bool_]
    liftoff_t: _Array
    liftoff_gap: NDArray[np.int64]
    opened_t: _Array
    opened_gap: NDArray[np.int64]
    corner_t: _Array
    corner_gaps: NDArray[np.bool_]
    flag_kind: list[str]
    flag_t: _Array
    flag_gaps: NDArray[np.bool_]
    flag_size: _Array
    hits: list[tuple[_Array, _Array, _Array]]
    status: int
    message: str
    nfev: int
    n_steps: int
    n_rejected: int
    n_impacts: int
    raised: BaseException | None
    path: MechanicalPath | None

def simulate_mechanical(
    model: tuple[Any, ...],
    method: _SwitchedSettings,
    *,
    n: int,
    m: int,
    e: _Array,
    span: tuple[float, float],
    q0: _Array,
    qdot0: _Array,
    t_eval: _Array | None,
    tstops: _Array,
    events: list[tuple[Any, int, int | None]],
    dense: bool,
    progress: Any = None,
) -> MechanicalRecord: ...
def simulate_mechanical_moreau_jean(
    model: tuple[Any, ...],
    *,
    n: int,
    m: int,
    e: _Array,
    h: float,
    theta: float,
    span: tuple[float, float],
    q0: _Array,
    qdot0: _Array,
    events: list[tuple[Any, int, int | None]],
    progress: Any = None,
) -> MechanicalRecord: ...
def simulate_mechanical_theta_gamma(
    model: tuple[Any, ...],
    *,
    n: int,
    m: int,
    e: _Array,
    h: float,
    span: tuple[float, float],
    q0: _Array,
    qdot0: _Array,
    events: list[tuple[Any, int, int | None]],
    progress: Any = None,
) -> MechanicalRecord: ...
def check_moreau_jean(theta: float) -> None: ...
def simulate_moreau_jean(
    force: tuple[Any, ...],
    *,
    wall: tuple[float, float],
    h: float,
    theta: float,
    span: tuple[float, float],
    state: tuple[float, float],
    events: list[tuple[Any, int, int | None, tuple[bool, float] | None]],
    progress: Any = None,
) -> RunRecord: ...
def check_impact_map(force: tuple[Any, ...], of_wall: tuple[float, float]) -> None: ...
def map_of_impacts(
    force: tuple[Any, ...],
    of_wall: tuple[float, float],
    starts: _Array,
    *,
    parameters: list[str],
    threads: int,
    progress: Callable[[int, int], None] | None = None,
) -> tuple[_Array, _Array, _Array]: ...
def orbits_of_impacts(
    forces: list[tuple[Any, ...]],
    walls: list[tuple[float, float]],
    starts: _Array,
    *,
    skip: int,
    n: int,
    threads: int,
    progress: Callable[[int, int], None] | None = None,
) -> _Array: ...
def check_switched_rk(given: _SwitchedSettings) -> None: ...
def simulate_switched_rk(
    force: tuple[Any, ...],
    method: _SwitchedSettings,
    *,
    wall: tuple[float, float],
    span: tuple[float, float],
    state: tuple[float, float],
    t_eval: _Array | None,
    tstops: _Array,
    events: list[tuple[Any, int, int | None, tuple[bool, float] | None]],
    dense: bool,
    drawn: bool,
    progress: Any = None,
) -> RunRecord: ...

@final
class SensitivityRecord:
    @property
    def run(self) -> RunRecord: ...
    @property
    def x(self) -> _Array: ...
    @property
    def xdot(self) -> _Array: ...
    @property
    def impact_dt(self) -> _Array: ...
    @property
    def impact_du(self) -> _Array: ...
    @property
    def zeno_times(self) -> _Array: ...
    @property
    def liftoff_times(self) -> _Array: ...
    @property
    def radius(self) -> _Array: ...
    @property
    def nearest(self) -> list[tuple[int, float, float] | None]: ...
    @property
    def grazing(self) -> bool: ...
    @property
    def samples(self) -> _Array: ...
    @property
    def n_slopes(self) -> int: ...

def sensitivity(
    force: tuple[Any, ...],
    method: _SwitchedSettings,
    *,
    wall: tuple[float, float],
    span: tuple[float, float],
    state: tuple[float, float],
    wrt: list[int],
    sizes: _Array,
    controlled: bool,
    dense: bool,
    drawn: bool,
    tstops: _Array,
    times: _Array,
    progress: Any = None,
) -> SensitivityRecord: ...
def fly_apart(
    force: tuple[Any, ...],
    method: _SwitchedSettings,
    flights: _Array,
    by: list[int],
    sizes: _Array,
    minima: bool,
) -> tuple[int, _Array]: ...
def restitution(*, e: float | None = None, kappa: float | None = None) -> tuple[float, float]: ...
def lift(x: _Array, xdot: _Array, sigma: float, kappa: float) -> tuple[_Array, _Array]: ...
def project(s: _Array, v: _Array, kappa: float) -> tuple[_Array, _Array]: ...
def check_theta_gamma(h: float, theta: float, gamma: float, kappa: float) -> None: ...
def force_raised() -> None: ...
def compiled_force(callable: Any, argument: str) -> tuple[int, int | None]: ...
def simulate_theta_gamma(
    force: tuple[Any, ...],
    *,
    wall: tuple[float, float],
    h: float,
    theta: float,
    gamma: float,
    solver: str,
    linearisations: int,
    span: tuple[float, float],
    state: tuple[float, float],
    events: list[tuple[Any, int, int | None, tuple[bool, float] | None]],
    progress: Any = None,
) -> RunRecord: ...
def solve_steps(
    s: _Array,
    v: _Array,
    f: _Array,
    *,
    kappa: float,
    h: float,
    solver: str,
    linearisations: int,
    fall_backs: bool,
) -> tuple[_Array, _Array, NDArray[np.bool_]]: ...
def solve_tracking_steps(
    states: _Array,
    starts: _Array,
    *,
    gains: tuple[float, float],
    kappa: float,
    kappa_ref: float,
    h: float,
    f: float,
    f_ref: float,
    solver: str,
    linearisations: int,
    fall_backs: bool,
) -> tuple[_Array, NDArray[np.bool_]]: ...
def simulate_explicit_euler(
    force: tuple[Any, ...],
    *,
    wall: tuple[float, float],
    h: float,
    span: tuple[float, float],
    state: tuple[float, float],
    events: list[tuple[Any, int, int | None, tuple[bool, float] | None]],
    progress: Any = None,
) -> RunRecord: ...

_State = tuple[float, float, float, float, list[float], int]

@disjoint_base
class Regulator:
    def __new__(
        cls,
        mu1: float,
        mu2: float,
        *,
        h: float,
        kappa: float,
        bound: float | None,
        depth: float,
        actuator: tuple[float, float],
        ahead: int | None,
    ) -> Self: ...
    def step(self, x: float, xdot: float, force: float) -> float: ...
    def reset(self) -> None: ...
    @property
    def u(self) -> float: ...
    @property
    def _signs(self) -> list[float]: ...
    @property
    def _status(self) -> int: ...
    def _get_state(self) -> _State: ...
    def _set_state(self, state: _State) -> None: ...

@disjoint_base
class Tracker:
    def __new__(
        cls,
        mu1: float,
        mu2: float,
        *,
        h: float,
        kappa: float,
        kappa_ref: float,
        nearest: bool,
        bound: float | None,
        depth: float,
        actuator: tuple[float, float],
        ahead: int | None,
        press: float | None,
        horizon: float,
        shift: bool,
    ) -> Self: ...
    def step(self, x: float, xdot: float, force: float, force_ref: float) -> float: ...
    def step_to(
        self,
        x: float,
        xdot: float,
        force: float,
        now: tuple[float, float, float],
        next: tuple[float, float, float],
        acceleration: float | None = None,
    ) -> float: ...
    def _accelerations(self) -> list[float] | None: ...
    def reset(self, x_ref: float, xdot_ref: float) -> None: ...
    @property
    def x_ref(self) -> float: ...
    @property
    def xdot_ref(self) -> float: ...
    @property
    def u(self) -> float: ...
    @property
    def _signs(self) -> list[float]: ...
    @property
    def _status(self) -> int: ...
    def _get_state(self) -> _State: ...
    def _set_state(self, state: _State) -> None: ...

@disjoint_base
class Observer:
    def __new__(
        cls,
        e: float,
        h: float,
        *,
        noise: tuple[float, float],
        q_d: float,
        se: float,
        dmax: float,
        position_only: bool,
    ) -> Self: ...
    def step(
        self, x: float, xdot: float | None, force: float, u: float
    ) -> tuple[float, float, float]: ...
    def reset(self) -> None: ...
    def _observe(
        self, t: _Array, x: _Array, xdot: _Array, held: _Array
    ) -> tuple[list[_Array], list[_Array], NDArray[np.bool_]]: ...
    @property
    def _covariance(self) -> list[list[float]]: ...
    def _get_state(
        self,
    ) -> tuple[bool, float, float, float, list[float], int, int]: ...
    def _set_state(
        self, state: tuple[bool, float, float, float, list[float], int, int]
    ) -> None: ...

@disjoint_base
class Explicit:
    def __new__(
        cls,
        mu1: float,
        mu2: float,
        *,
        h: float,
        kappa: float,
        kappa_ref: float,
        bound: float | None,
        depth: float,
        actuator: tuple[float, float],
    ) -> Self: ...
    def step(self, x: float, xdot: float, force: float, force_ref: float) -> float: ...
    def reset(self, x_ref: float, xdot_ref: float) -> None: ...
    @property
    def x_ref(self) -> float: ...
    @property
    def xdot_ref(self) -> float: ...
    @property
    def u(self) -> float: ...
    @property
    def _signs(self) -> list[float]: ...
    @property
    def _status(self) -> int: ...
    def _get_state(self) -> _State: ...
    def _set_state(self, state: _State) -> None: ...

@final
class LoopRecord:
    @property
    def columns(self) -> list[_Array]: ...
    @property
    def estimates(self) -> list[_Array]: ...
    @property
    def ticks(self) -> NDArray[np.uint8]: ...
    @property
    def impacts(self) -> _Array: ...
    @property
    def zeno_times(self) -> _Array: ...
    @property
    def liftoff_times(self) -> _Array: ...
    @property
    def rest_time(self) -> float | None: ...
    @property
    def path(self) -> float | MotionPath | tuple[_Array, _Array] | None: ...
    @property
    def hits(self) -> list[tuple[_Array, _Array, _Array]]: ...
    @property
    def status(self) -> int: ...
    @property
    def message(self) -> str: ...
    @property
    def nfev(self) -> int: ...
    @property
    def raised(self) -> BaseException | None: ...

def simulate_closed_loop(
    controller: Any,
    forces: list[tuple[Any, ...]],
    *,
    wall: tuple[float, float],
    h: float,
    span: tuple[float, float],
    state: tuple[float, float],
    scheme: tuple[float, float] | None,
    switched: _SwitchedSettings,
    exact: bool,
    noise: tuple[_Array, _Array],
    resolution: tuple[float, float],
    delay: int,
    observer: Observer | None,
    interface: dict[str, bool],
    ours: bool,
    dense: bool,
    events: list[tuple[Any, int, int | None, tuple[bool, float] | None]],
    given: Any,
    wall_ref: tuple[float, float],
    progress: Any = None,
) -> LoopRecord: ...
def ballistic_motion(rows: _Array, wall: tuple[float, float]) -> list[_Array]: ...

@final
class LoopBatchRecord:
    @property
    def last(self) -> _Array: ...
    @property
    def settling_time(self) -> _Array: ...
    @property
    def error_max(self) -> _Array: ...
    @property
    def error_rms(self) -> _Array: ...
    @property
    def u_max(self) -> _Array: ...
    @property
    def u_rms(self) -> _Array: ...
    @property
    def u_variation(self) -> _Array: ...
    @property
    def rest_time(self) -> _Array: ...
    @property
    def samples_x(self) -> _Array: ...
    @property
    def samples_x_ref(self) -> _Array: ...
    @property
    def samples_u(self) -> _Array: ...
    @property
    def n_impacts(self) -> NDArray[np.uint64]: ...
    @property
    def n_refused(self) -> NDArray[np.uint64]: ...
    @property
    def status(self) -> NDArray[np.uint8]: ...

def simulate_closed_loop_batch(
    controllers: list[Any],
    observers: list[Observer],
    forces: tuple[list[Any], list[Any], list[Any]],
    walls: _Array,
    states: _Array,
    *,
    span: tuple[float, float],
    scheme: tuple[float, float] | None,
    switched: _SwitchedSettings,
    exact: bool,
    resolution: tuple[float, float],
    delay: int,
    within: float,
    every: int,
    threads: int,
    references: list[tuple[_Array, float]] = ...,
    progress: Any = None,
) -> LoopBatchRecord: ...

@final
class BatchRecord:
    @property
    def t(self) -> _Array: ...
    @property
    def x(self) -> _Array: ...
    @property
    def xdot(self) -> _Array: ...
    @property
    def x_max(self) -> _Array: ...
    @property
    def speed_max(self) -> _Array: ...
    @property
    def first_impact(self) -> _Array: ...
    @property
    def last_impact(self) -> _Array: ...
    @property
    def hardest_impact(self) -> _Array: ...
    @property
    def rest_time(self) -> _Array: ...
    @property
    def grazing(self) -> NDArray[np.bool_]: ...
    @property
    def samples_x(self) -> _Array: ...
    @property
    def samples_xdot(self) -> _Array: ...
    @property
    def samples_s(self) -> _Array: ...
    @property
    def samples_v(self) -> _Array: ...
    @property
    def impact_t(self) -> list[_Array]: ...
    @property
    def impact_xdot_before(self) -> list[_Array]: ...
    @property
    def impact_xdot_after(self) -> list[_Array]: ...
    @property
    def zeno_times(self) -> list[_Array]: ...
    @property
    def liftoff_times(self) -> list[_Array]: ...
    @property
    def status(self) -> NDArray[np.uint8]: ...
    @property
    def nfev(self) -> NDArray[np.uint64]: ...
    @property
    def counts(self) -> NDArray[np.uint64]: ...

def available_threads() -> int: ...
def grid_times(t0: float, t1: float, h: float, every: int) -> _Array: ...
def simulate_batch(
    forces: list[tuple[Any, ...]],
    walls: _Array,
    states: _Array,
    method: tuple[Any, ...],
    *,
    span: tuple[float, float],
    save: Any,
    threads: int,
    at: _Array | None = None,
    steps: NDArray[np.intp] | None = None,
    progress: Any = None,
) -> BatchRecord: ...

@final
class ViRecord:
    @property
    def x(self) -> _Array: ...
    @property
    def f(self) -> _Array: ...
    @property
    def residual(self) -> float: ...
    @property
    def scaled_residual(self) -> float: ...
    @property
    def tolerance(self) -> float: ...
    @property
    def status(self) -> int: ...
    @property
    def message(self) -> str: ...
    @property
    def stage(self) -> str: ...
    @property
    def n_iter(self) -> int: ...
    @property
    def nfev(self) -> int: ...
    @property
    def njev(self) -> int: ...
    @property
    def n_pivots(self) -> int: ...
    @property
    def n_semismooth_steps(self) -> int: ...
    @property
    def n_gradient_steps(self) -> int: ...
    @property
    def n_restarts(self) -> int: ...
    @property
    def size(self) -> float: ...
    @property
    def convergence_ratio(self) -> float: ...
    @property
    def projected(self) -> bool: ...

def solve_vi(
    f: Callable[[_Array], Any],
    lower: _Array | float,
    upper: _Array | float,
    x0: _Array,
    jac: Callable[[_Array], Any] | str,
    convert: tuple[Callable[[Any], tuple[_Array, float]], Callable[[Any], _Array]],
    settings: dict[str, Any],
    time_limit: float | None = None,
    observe: Callable[[int, float, int, str], object] | None = None,
) -> ViRecord: ...
def solve_avi(
    matrix: _Array,
    q: _Array,
    lower: _Array | float,
    upper: _Array | float,
    x0: _Array | None,
    settings: dict[str, Any],
    time_limit: float | None = None,
    observe: Callable[[int, float, int, str], object] | None = None,
) -> ViRecord: ...
def natural_residual(
    x: _Array, f: _Array, lower: _Array | float, upper: _Array | float
) -> float: ...
