from collections.abc import Callable, Sequence
from typing import Any, Literal, Self, final, overload

import numpy as np
from numpy.typing import NDArray
from typing_extensions import disjoint_base

__all__ = [
    "CONTROL_SETTINGS",
    "FORMAT",
    "IMPACT_LAWS",
    "METHODS",
    "SETTINGS",
    "STATUS_MESSAGES",
    "Ballistic",
    "BatchRecord",
    "Believed",
    "CalledLoop",
    "CompiledFunction",
    "Configuration",
    "Event",
    "Explicit",
    "Force",
    "Friction",
    "FrictionRecord",
    "GapLoop",
    "GapTracker",
    "Hits",
    "ImpactLaw",
    "Inputs",
    "LiftedSamples",
    "LoopBatchRecord",
    "LoopRecord",
    "LoopSigns",
    "MechanicalEnds",
    "MechanicalLoopRecord",
    "MechanicalPath",
    "MechanicalRecord",
    "MechanicalRuns",
    "MechanicalSensitivityRecord",
    "Mechanism",
    "Method",
    "MethodEntry",
    "Model",
    "MotionPath",
    "Moved",
    "Nearest",
    "Observer",
    "Occurrences",
    "Part",
    "Partials",
    "PeriodicImpulses",
    "PointMass",
    "RecordOptions",
    "Reference",
    "Regulator",
    "Restitution",
    "RunRecord",
    "SensitivityRecord",
    "Setting",
    "State",
    "StrikeLoop",
    "Striker",
    "TimeTable",
    "Tracker",
    "Tree",
    "Wall",
    "__version__",
    "available_threads",
    "ballistic_motion",
    "check_impact_map",
    "compiled_model",
    "contact_forces",
    "controls",
    "correct_sequence",
    "cosine",
    "decoupling_force",
    "fly_apart",
    "force_raised",
    "forget_runs",
    "grid_times",
    "is_off_scale",
    "is_sound",
    "lemke_howson",
    "lift",
    "map_of_impacts",
    "mechanical_sensitivity",
    "minimum_degree",
    "natural_residual",
    "orbits_of_impacts",
    "project",
    "sensitivity",
    "sequence_equations",
    "simulate",
    "simulate_batch",
    "simulate_closed_loop",
    "simulate_closed_loop_batch",
    "simulate_mechanical_loop",
    "solve_avi",
    "solve_steps",
    "solve_tracking_steps",
    "solve_vi",
    "stop_runs",
]

__version__: str
FORMAT: int
STATUS_MESSAGES: list[str]

_Array = NDArray[np.float64]

@final
class Setting:
    @property
    def name(self) -> str: ...
    @property
    def meaning(self) -> str: ...
    @property
    def unit(self) -> str: ...
    @property
    def range(self) -> str: ...
    @property
    def above(self) -> float | None: ...
    @property
    def below(self) -> float | None: ...
    @property
    def least(self) -> Any: ...
    @property
    def most(self) -> Any: ...
    @property
    def whole(self) -> bool: ...
    @property
    def pair(self) -> bool: ...
    @property
    def choices(self) -> tuple[Any, ...] | None: ...
    @property
    def default(self) -> Any: ...
    @property
    def required(self) -> bool: ...
    @property
    def comes(self) -> str | None: ...

SETTINGS: dict[str, list[Setting]]
IMPACT_LAWS: dict[str, list[Setting]]
CONTROL_SETTINGS: dict[str, list[Setting]]

@final
class MethodEntry:
    @property
    def name(self) -> str: ...
    @property
    def meaning(self) -> str: ...
    @property
    def settings(self) -> tuple[Setting, ...]: ...
    @property
    def fixed_steps(self) -> bool: ...
    @property
    def penetrates(self) -> bool: ...
    @property
    def takes_mechanism(self) -> bool: ...

METHODS: dict[str, MethodEntry]

# methods, by tools/stubs.py
@final
class Method:
    @overload
    def __new__(
        cls,
        name: Literal["SwitchedRK"],
        *,
        rtol: float = ...,
        atol: float | tuple[float, float] = ...,
        order: int = ...,
        max_step: float = ...,
        first_step: float | None = ...,
        max_steps: int = ...,
        max_impacts: int = ...,
        flights: str = ...,
    ) -> Self: ...
    @overload
    def __new__(
        cls,
        name: Literal["ThetaGamma"],
        *,
        h: float,
        theta: float = ...,
        gamma: float = ...,
        solver: str = ...,
        linearisations: int = ...,
    ) -> Self: ...
    @overload
    def __new__(
        cls,
        name: Literal["MoreauJean"],
        *,
        h: float,
        theta: float = ...,
    ) -> Self: ...
    @overload
    def __new__(
        cls,
        name: Literal["ExplicitEuler"],
        *,
        h: float,
    ) -> Self: ...
    @overload
    def __new__(cls, name: str, **settings: Any) -> Self: ...

# end of the methods

@final
class Wall:
    @staticmethod
    def harmonic(*, amplitude: float, omega: float, phase: float, offset: float) -> Wall: ...
    @staticmethod
    def table(table: TimeTable) -> Wall: ...
    @staticmethod
    def callable(motion: Callable[[float], tuple[float, float, float]]) -> Wall: ...
    @property
    def is_native(self) -> bool: ...

@final
class TimeTable:
    def __new__(
        cls,
        knots: NDArray[np.float64],
        coefficients: NDArray[np.float64],
        *,
        order: int,
        width: int,
        ends: tuple[NDArray[np.float64], NDArray[np.float64]] | None = None,
    ) -> TimeTable: ...
    def values(self, times: NDArray[np.float64], derivative: int = 0) -> NDArray[np.float64]: ...
    def motion(self, t: float) -> list[float]: ...
    def fill(self, t: float, out: NDArray[np.float64]) -> None: ...
    @property
    def functions(self) -> tuple[int, int, int]: ...

@final
class Force:
    @staticmethod
    def constant(value: float) -> Force: ...
    @staticmethod
    def native(name: str, **numbers: float) -> Force: ...
    @staticmethod
    def with_table(numbers: list[float], table: TimeTable) -> Force: ...
    @staticmethod
    def compiled(
        address: int,
        *,
        parameters: list[float] = ...,
        owner: object,
        reads_time: bool = True,
    ) -> Force: ...
    @staticmethod
    def low_level(callable: Any, argument: str) -> Force: ...
    @staticmethod
    def callable(
        function: Callable[..., float], *, of_array: bool = False, reads_time: bool = True
    ) -> Force: ...
    @staticmethod
    def parametric(
        plain: Force,
        function: Callable[..., float],
        values: list[float],
        jacobian: Callable[..., Any] | None = None,
    ) -> Force: ...
    @staticmethod
    def above(wall: Wall, force: Force) -> Force: ...
    @property
    def is_constant(self) -> bool: ...
    @property
    def is_compiled(self) -> bool: ...
    @property
    def is_native(self) -> bool: ...
    @property
    def address(self) -> int | None: ...

@final
class Restitution:
    def __new__(cls, *, e: float | None = None, kappa: float | None = None) -> Self: ...
    @staticmethod
    def of_both(e: float, kappa: float) -> Restitution: ...
    @property
    def e(self) -> float: ...
    @property
    def kappa(self) -> float: ...

@final
class ImpactLaw:
    def __new__(cls, name: str, values: list[float]) -> Self: ...
    @staticmethod
    def newton(e: float, kappa: float) -> ImpactLaw: ...
    @staticmethod
    def table(v: _Array, e: _Array) -> ImpactLaw: ...
    @staticmethod
    def compiled(
        address: int, slope: int | None, limit: float, geometric_up_to: float, owner: object
    ) -> ImpactLaw: ...
    @property
    def is_compiled(self) -> bool: ...
    def after(self, v: _Array) -> _Array: ...
    def slope(self, v: _Array) -> _Array: ...
    @property
    def limit(self) -> float | None: ...

@final
class PointMass:
    def __new__(cls, force: Force, law: ImpactLaw) -> Self: ...

@final
class State:
    def __new__(cls, x: float, xdot: float) -> Self: ...

@final
class Model:
    @staticmethod
    def compiled(
        address: int,
        *,
        data: int | None = None,
        owner: object,
        equalities: int | None = None,
        drives: list[tuple[int, Wall]] = ...,
        layout: tuple[int, int, int, int] | None = None,
    ) -> Model: ...
    def evaluate(self, t: float, q: _Array, qdot: _Array, size: int) -> _Array: ...
    @staticmethod
    def callable(
        function: Callable[[float, _Array, _Array], _Array], *, steady: bool = False
    ) -> Model: ...
    @staticmethod
    def linear(
        mass: list[float],
        damping: list[float],
        stiffness: list[float],
        *,
        load: list[float],
        waves: list[tuple[list[float], float, float]],
        tables: list[TimeTable],
        gaps: list[tuple[list[float], float, Wall | None]],
    ) -> Model: ...
    @staticmethod
    def tree(
        tree: Tree, *, drives: list[tuple[int, int]] = ..., owner: object | None = None
    ) -> Model: ...
    @staticmethod
    def parts(
        sizes: tuple[int, int, int, int],
        row: _Array,
        *,
        gaps: list[tuple[int, list[float], float, Wall | None]],
        belts: list[tuple[int, Wall]],
        without_static: list[int],
        functions: list[Part],
        steady: bool,
        constant: bool,
        owner: object,
    ) -> Model: ...
    @property
    def is_native(self) -> bool: ...

@final
class Part:
    @staticmethod
    def compiled(start: int, length: int, address: int, data: int | None = None) -> Part: ...
    @staticmethod
    def driven(start: int, length: int, address: int, table: TimeTable) -> Part: ...
    @staticmethod
    def python(
        start: int,
        shape: Sequence[int],
        function: Callable[..., Any],
        *,
        takes_velocities: bool,
        read: Callable[[Any], _Array],
    ) -> Part: ...
    @staticmethod
    def wall(gap: int, motion: Callable[[float], tuple[float, float, float]]) -> Part: ...
    @staticmethod
    def of_speed(
        channel: int, function: Callable[[float], Any], read: Callable[[Any], _Array]
    ) -> Part: ...

@final
class Tree:
    def __new__(
        cls,
        joints: list[tuple[int, str]],
        gaps: list[tuple[str, int, int]],
        friction: list[tuple[str, int]],
        numbers: _Array,
        constraints: list[tuple[str, int, int]] = ...,
        drives: list[tuple[int, Wall]] = ...,
    ) -> Self: ...

@final
class CompiledFunction:
    @property
    def address(self) -> int: ...
    @property
    def data(self) -> int | None: ...
    @property
    def returns_int(self) -> bool: ...

@final
class Partials:
    @staticmethod
    def differences(moved: list[Moved]) -> Partials: ...
    @staticmethod
    def function(function: Model, parameters: int) -> Partials: ...
    @staticmethod
    def tree(directions: list[list[float]]) -> Partials: ...

@final
class Moved:
    def __new__(
        cls,
        step: float,
        models: list[Model],
        impacts: list[tuple[int, list[ImpactLaw]]] = ...,
        contacts: list[tuple[int, int, float]] = ...,
    ) -> Self: ...

@final
class Mechanism:
    def __new__(
        cls,
        model: Model,
        *,
        n: int,
        m: int,
        e: _Array | list[ImpactLaw],
        friction: Friction | None = None,
        k: int = 0,
    ) -> Self: ...

@final
class Friction:
    def __new__(
        cls,
        channels: list[tuple[int | None, float]],
        *,
        law: str,
        impact_without_collision: bool,
        compliant: list[tuple[int, str, list[float], Any]] = ...,
    ) -> Self: ...

@final
class FrictionRecord:
    slips: _Array
    slip_distances: _Array
    forces: _Array
    modes: NDArray[np.int8]
    dissipated: _Array
    transition_t: _Array
    transition_channel: NDArray[np.int64]
    transition_before: NDArray[np.int8]
    transition_after: NDArray[np.int8]
    tangential_channel: NDArray[np.int64]
    tangential_group: NDArray[np.int64]
    tangential_slip_before: _Array
    tangential_slip_after: _Array
    tangential_impulse: _Array
    tangential_sticks: NDArray[np.bool_]

@final
class Configuration:
    def __new__(cls, q: _Array, qdot: _Array) -> Self: ...

@final
class Event:
    def __new__(
        cls,
        function: Callable[..., float],
        *,
        direction: int,
        terminal: int | None,
        level_x: float | None = None,
        level_xdot: float | None = None,
    ) -> Self: ...
    @property
    def function(self) -> Callable[..., float]: ...
    @property
    def direction(self) -> int: ...
    @property
    def terminal(self) -> int | None: ...
    @property
    def level_x(self) -> float | None: ...
    @property
    def level_xdot(self) -> float | None: ...

@final
class Hits:
    @property
    def t(self) -> _Array: ...
    @property
    def q(self) -> _Array: ...
    @property
    def qdot(self) -> _Array: ...

@final
class RecordOptions:
    def __new__(
        cls,
        *,
        t_eval: _Array | None = None,
        tstops: _Array | None = None,
        kicks: object = None,
        events: list[Event] = ...,
        ends: bool = False,
        dense: bool = False,
        arcs: bool = False,
    ) -> Self: ...

@overload
def simulate(
    system: PointMass,
    method: Method,
    span: tuple[float, float],
    start: State,
    keep: RecordOptions,
    progress: Callable[[int, int], None] | None = None,
) -> RunRecord: ...
@overload
def simulate(
    system: Mechanism,
    method: Method,
    span: tuple[float, float],
    start: Configuration,
    keep: RecordOptions,
    progress: Callable[[int, int], None] | None = None,
) -> MechanicalRecord: ...

@final
class RunRecord:
    @property
    def columns(self) -> _Array: ...
    @property
    def n_samples(self) -> int: ...
    @property
    def last(self) -> float | None: ...
    def drawn(self, row: int) -> _Array: ...
    def drawn_lifted(self) -> list[_Array]: ...
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
    def hits(self) -> list[Hits]: ...
    @property
    def n_steps(self) -> int: ...
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

def compiled_model(callable: Any, argument: str) -> CompiledFunction: ...
def is_sound(row: _Array, n: int, m: int) -> bool: ...
def contact_forces(
    row: _Array,
    w: _Array,
    friction: Friction | None,
    closed: list[bool],
    modes: list[int],
) -> _Array | None: ...

@final
class MechanicalPath:
    def numbers(self) -> _Array: ...
    @staticmethod
    def restored(numbers: _Array) -> MechanicalPath: ...
    def __reduce__(self) -> tuple[Any, tuple[_Array]]: ...
    @property
    def span(self) -> tuple[float, float] | None: ...
    def at(self, times: _Array) -> tuple[_Array, _Array, _Array, _Array, NDArray[np.bool_]]: ...
    def friction_at(self, times: _Array) -> tuple[_Array, _Array, _Array, NDArray[np.int8]]: ...
    def skipped_impacts(
        self, speed: float, at_most: int
    ) -> tuple[_Array, _Array, _Array, _Array]: ...

@final
class Occurrences:
    impact_t: _Array
    impact_gap: NDArray[np.int64]
    impact_speed_before: _Array
    impact_speed_after: _Array
    impact_impulse: _Array
    impact_group: NDArray[np.int64]
    zeno_t: _Array
    zeno_gap: NDArray[np.int64]
    zeno_closed: NDArray[np.bool_]
    contact_t: _Array
    contact_gap: NDArray[np.int64]
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

@final
class MechanicalRecord:
    t: _Array
    q: _Array
    qdot: _Array
    gaps: _Array
    gap_rates: _Array
    reactions: _Array
    constraint_forces: _Array | None
    contacts: NDArray[np.bool_]
    speeds: tuple[float, float, float] | None
    occurrences: Occurrences | None
    hits: list[Hits]
    status: int
    message: str
    nfev: int
    n_steps: int
    n_rejected: int
    n_impacts: int
    raised: BaseException | None
    path: MechanicalPath | None
    friction: FrictionRecord | None

def check_impact_map(system: PointMass) -> None: ...
def map_of_impacts(
    system: PointMass,
    starts: _Array,
    *,
    parameters: list[str],
    threads: int,
    progress: Callable[[int, int], None] | None = None,
) -> tuple[_Array, _Array, _Array]: ...
def orbits_of_impacts(
    systems: list[PointMass],
    starts: _Array,
    *,
    skip: int,
    n: int,
    threads: int,
    progress: Callable[[int, int], None] | None = None,
) -> _Array: ...

@final
class PeriodicImpulses:
    def __new__(
        cls,
        gaps: list[int],
        *,
        period: float,
        rates: _Array,
        kernels: _Array,
        vectors: _Array,
        inputs: _Array,
        pushes: _Array,
        forced_gaps: _Array,
        forced_states: _Array,
        omegas: _Array,
        mobilities: _Array,
        e: _Array,
    ) -> Self: ...
    @property
    def mobilities(self) -> _Array: ...
    def equations(self, y: _Array) -> tuple[_Array, _Array, _Array]: ...
    def turned(self, y: _Array, kappa: float) -> tuple[_Array, _Array]: ...
    def curvature(self, y: _Array, kappa: float, w: _Array, v: _Array) -> tuple[_Array, _Array]: ...
    def states(self, y: _Array) -> _Array: ...

@final
class Nearest:
    @property
    def limit(self) -> int: ...
    @property
    def t(self) -> float: ...
    @property
    def depth(self) -> float: ...

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
    def nearest(self) -> list[Nearest | None]: ...
    @property
    def grazing(self) -> bool: ...
    @property
    def samples(self) -> _Array: ...
    @property
    def n_slopes(self) -> int: ...

def sensitivity(
    system: PointMass,
    method: Method,
    span: tuple[float, float],
    start: State,
    *,
    wrt: list[int],
    sizes: _Array,
    controlled: bool,
    dense: bool,
    drawn: bool,
    tstops: _Array,
    times: _Array,
    progress: Any = None,
) -> SensitivityRecord: ...

@final
class MechanicalSensitivityRecord:
    @property
    def run(self) -> MechanicalRecord: ...
    @property
    def q(self) -> _Array: ...
    @property
    def qdot(self) -> _Array: ...
    @property
    def impact_dt(self) -> _Array: ...
    @property
    def impact_du(self) -> _Array: ...
    @property
    def zeno_times(self) -> _Array: ...
    @property
    def liftoff_times(self) -> _Array: ...
    @property
    def touchdown_times(self) -> _Array: ...
    @property
    def transition_times(self) -> _Array: ...
    @property
    def radius(self) -> _Array: ...
    @property
    def nearest(self) -> list[Nearest | None]: ...
    @property
    def grazing(self) -> bool: ...
    @property
    def lost_at(self) -> float | None: ...
    @property
    def samples(self) -> _Array: ...
    @property
    def n_slopes(self) -> int: ...

def mechanical_sensitivity(
    system: Mechanism,
    partials: Partials,
    method: Method,
    span: tuple[float, float],
    start: Configuration,
    *,
    wrt: list[tuple[int, int, int]],
    sizes: _Array,
    controlled: bool,
    dense: bool,
    tstops: _Array,
    times: _Array,
    progress: Any = None,
) -> MechanicalSensitivityRecord: ...
def fly_apart(
    force: Force,
    method: Method,
    flights: _Array,
    by: list[int],
    sizes: _Array,
    minima: bool,
) -> tuple[int, _Array]: ...
def sequence_equations(
    force: Force,
    method: Method,
    unknowns: _Array,
    last: tuple[float, float],
    period: float,
    e: float,
    wrt: tuple[int, float] | None,
) -> tuple[int, list[_Array]]: ...
def correct_sequence(
    at: Callable[[float], tuple[Force, float, float, float]],
    method: Method,
    code: int,
    guess: _Array,
    normal: _Array,
    scale: _Array,
    sizes: _Array,
    evaluations: int,
    limits: tuple[float, float, float],
) -> tuple[int, tuple[_Array, _Array, int, float, list[_Array]] | None]: ...
def lift(x: _Array, xdot: _Array, sigma: float, kappa: float) -> tuple[_Array, _Array]: ...
def project(s: _Array, v: _Array, kappa: float) -> tuple[_Array, _Array]: ...
def force_raised() -> None: ...
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
        quiet: float,
        delay: int,
    ) -> Self: ...
    def step(
        self,
        x: float | None,
        xdot: float | None = None,
        force: float = 0.0,
        *,
        dt: float | None = None,
    ) -> float: ...
    def _solve_by(self, solver: str, linearisations: int) -> None: ...
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
        quiet: float,
        press: float | None,
        horizon: float,
        shift: bool,
        delay: int,
    ) -> Self: ...
    def step(
        self,
        x: float | None,
        xdot: float | None = None,
        force: float = 0.0,
        force_ref: float = 0.0,
        *,
        dt: float | None = None,
    ) -> float: ...
    def step_to(
        self,
        x: float | None,
        xdot: float | None,
        force: float,
        now: tuple[float, float, float],
        next: tuple[float, float, float],
        acceleration: float | None = None,
        *,
        dt: float | None = None,
    ) -> float: ...
    def _solve_by(self, solver: str, linearisations: int) -> None: ...
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
        learn_e: bool,
        q_e: float,
    ) -> Self: ...
    def step(
        self,
        x: float | None,
        xdot: float | None = None,
        force: float = 0.0,
        u: float = 0.0,
        *,
        dt: float | None = None,
    ) -> tuple[float, float, float]: ...
    def reset(self) -> None: ...
    def _observe(
        self, t: _Array, x: _Array, xdot: _Array, held: _Array
    ) -> tuple[list[_Array], list[_Array], NDArray[np.bool_]]: ...
    @property
    def _covariance(self) -> list[list[float]]: ...
    @property
    def _restitution(self) -> tuple[float, float]: ...
    def _get_state(
        self,
    ) -> tuple[bool, float, float, float, list[float], int, int, list[float]]: ...
    def _set_state(self, state: Any) -> None: ...

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
    def step(
        self,
        x: float | None,
        xdot: float | None = None,
        force: float = 0.0,
        force_ref: float = 0.0,
        *,
        dt: float | None = None,
    ) -> float: ...
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
    def signs(self) -> LoopSigns: ...
    @property
    def estimates(self) -> list[_Array]: ...
    @property
    def ticks(self) -> NDArray[np.uint8]: ...
    @property
    def updates(self) -> list[int]: ...
    @property
    def impacts(self) -> _Array: ...
    @property
    def zeno_times(self) -> _Array: ...
    @property
    def liftoff_times(self) -> _Array: ...
    @property
    def rest_time(self) -> float | None: ...
    @property
    def own_force(self) -> float | None: ...
    @property
    def path(self) -> MotionPath | None: ...
    @property
    def lifted(self) -> LiftedSamples | None: ...
    @property
    def hits(self) -> list[Hits]: ...
    @property
    def status(self) -> int: ...
    @property
    def message(self) -> str: ...
    @property
    def nfev(self) -> int: ...
    @property
    def raised(self) -> BaseException | None: ...

@final
class LoopSigns:
    def rows(self) -> _Array: ...

@final
class LiftedSamples:
    @property
    def s(self) -> _Array: ...
    @property
    def v(self) -> _Array: ...

def simulate_closed_loop(
    controller: Any,
    forces: list[Force],
    *,
    restitution: Restitution,
    h: float,
    span: tuple[float, float],
    start: State,
    method: Method,
    exact: bool,
    noise: tuple[_Array, _Array],
    resolution: tuple[float, float],
    delay: int,
    observer: Observer | None,
    interface: dict[str, bool],
    ours: bool,
    dense: bool,
    events: list[Event],
    given: Any,
    restitution_ref: Restitution,
    kicks: tuple[_Array, Any] | None = None,
    progress: Any = None,
) -> LoopRecord: ...

@final
class Ballistic:
    @property
    def x(self) -> _Array: ...
    @property
    def xdot(self) -> _Array: ...
    @property
    def n_impacts(self) -> _Array: ...

def ballistic_motion(rows: _Array, restitution: Restitution) -> Ballistic: ...

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
    def n_updates(self) -> NDArray[np.uint64]: ...
    @property
    def n_refused(self) -> NDArray[np.uint64]: ...
    @property
    def n_saturated(self) -> NDArray[np.uint64]: ...
    @property
    def n_unsolved(self) -> NDArray[np.uint64]: ...
    @property
    def status(self) -> NDArray[np.uint8]: ...

def simulate_closed_loop_batch(
    controllers: list[Any],
    observers: list[Observer],
    forces: tuple[list[Force], list[Force], list[Force]],
    restitutions: _Array,
    states: _Array,
    *,
    span: tuple[float, float],
    method: Method,
    exact: bool,
    resolution: tuple[float, float],
    delay: int,
    within: float,
    every: int,
    slowest: float,
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
    def last_resolved(self) -> _Array: ...
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
    def impacts(self) -> list[_Array]: ...
    @property
    def resolved_impacts(self) -> list[_Array]: ...
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

def stop_runs(seconds: float) -> bool: ...
def forget_runs() -> None: ...
def available_threads() -> int: ...
def cosine(x: float) -> float: ...
def grid_times(t0: float, t1: float, h: float, every: int) -> _Array: ...

@final
class MechanicalRuns:
    def __new__(
        cls,
        mechanisms: list[Mechanism],
        q: _Array,
        qdot: _Array,
        *,
        tstops: list[_Array],
        e: _Array | None = None,
        data: _Array | None = None,
    ) -> Self: ...
    def unsound_starts(self, t: float) -> list[int]: ...
    def run(
        self,
        method: Method,
        *,
        span: tuple[float, float],
        slowest: float,
        threads: int,
        progress: Any = None,
    ) -> MechanicalEnds: ...

@final
class MechanicalEnds:
    @property
    def t(self) -> _Array: ...
    @property
    def q(self) -> _Array: ...
    @property
    def gaps(self) -> _Array: ...
    @property
    def qdot(self) -> _Array: ...
    @property
    def contacts(self) -> NDArray[np.bool_]: ...
    @property
    def totals(self) -> NDArray[np.int64]: ...
    @property
    def first_impact(self) -> _Array: ...
    @property
    def last_impact(self) -> _Array: ...
    @property
    def speeds(self) -> _Array: ...
    @property
    def status(self) -> NDArray[np.uint8]: ...
    @property
    def nfev(self) -> NDArray[np.int64]: ...

def simulate_batch(
    forces: list[Force],
    laws: list[ImpactLaw],
    states: _Array,
    method: Method,
    *,
    span: tuple[float, float],
    save: Any,
    slowest: float,
    threads: int,
    at: _Array | None = None,
    steps: NDArray[np.intp] | None = None,
    ends: list[float] | None = None,
    tstops: list[_Array] | None = None,
    kicks: list[tuple[float, float]] | None = None,
    columns: list[tuple[int | None, _Array]] = ...,
    progress: Any = None,
) -> BatchRecord: ...
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
) -> dict[str, Any]: ...
def solve_avi(
    matrix: _Array,
    q: _Array,
    lower: _Array | float,
    upper: _Array | float,
    x0: _Array | None,
    settings: dict[str, Any],
    time_limit: float | None = None,
    observe: Callable[[int, float, int, str], object] | None = None,
) -> dict[str, Any]: ...
def is_off_scale(
    matrix: _Array,
    q: _Array,
    lower: _Array | float,
    upper: _Array | float,
    x0: _Array | None,
    limit: float,
) -> bool: ...
def lemke_howson(
    a: _Array, b: _Array, limit: int, time_limit: float | None = None
) -> tuple[_Array, _Array, int] | None: ...
def minimum_degree(starts: NDArray[np.int32], rows: NDArray[np.int32]) -> NDArray[np.int32]: ...
def natural_residual(
    x: _Array, f: _Array, lower: _Array | float, upper: _Array | float
) -> float: ...

@final
class Inputs:
    @staticmethod
    def constant(r: int, matrix: list[float]) -> Inputs: ...
    @staticmethod
    def compiled(r: int, address: int, data: int, owner: Any) -> Inputs: ...
    @staticmethod
    def callable(r: int, function: Callable[[float, _Array], _Array]) -> Inputs: ...

@final
class MechanicalLoopRecord:
    @property
    def run(self) -> MechanicalRecord: ...
    @property
    def u(self) -> _Array: ...
    @property
    def tick_status(self) -> NDArray[np.uint8]: ...
    @property
    def updates(self) -> list[int]: ...
    @property
    def latched(self) -> NDArray[np.bool_]: ...
    @property
    def q_est(self) -> _Array: ...
    @property
    def qdot_est(self) -> _Array: ...

@final
class Believed:
    def __new__(
        cls, mechanism: Mechanism, inputs: Inputs, h: float, tasks: Mechanism | None = None
    ) -> Self: ...
    def moved(
        self, t: float, q: _Array, qdot: _Array, controls: _Array
    ) -> tuple[_Array, _Array, list[bool]]: ...
    def onto(
        self, t: float, q: _Array, qdot: _Array, closed: NDArray[np.bool_]
    ) -> tuple[_Array, _Array]: ...

@final
class Reference:
    def __new__(
        cls,
        q: _Array,
        qdot: _Array,
        qddot: _Array,
        gaps: _Array,
        gap_rates: _Array,
        accelerations: _Array,
        sides: _Array,
        contacts: NDArray[np.bool_],
        tasks: _Array,
    ) -> Self: ...

@final
class GapTracker:
    noise: tuple[list[float], list[float]]
    @property
    def closed_within(self) -> tuple[list[float], list[float]]: ...
    @property
    def pulls(self) -> list[tuple[float, float]]: ...
    state: tuple[Any, ...]
    def __new__(
        cls,
        trackers: list[Any],
        *,
        h: float,
        posture: tuple[float, float],
        limits: list[tuple[float, float]] | None,
        latch: tuple[float, float] | None,
        delay: int,
        pressing: list[float | Callable[[float], float] | None],
        learn_offsets: bool,
    ) -> Self: ...
    def step(self, believed: Believed, t: float, q: _Array, qdot: _Array, ends: Any) -> _Array: ...
    def reset(self) -> None: ...
    def copy(self) -> GapTracker: ...

@final
class GapLoop:
    def __new__(cls, law: GapTracker, believed: Believed, reference: Reference | None) -> Self: ...

@final
class Striker:
    body: int | None
    noise: float
    state: tuple[Any, ...]
    def __new__(
        cls,
        *,
        gap: int,
        e: float,
        of_wall: bool,
        place: float,
        interval: float,
        h: float,
        learns: bool,
        learning: tuple[float, float, tuple[int, int], int],
        limits: list[tuple[float, float]] | None,
        posture: float,
        delay: int,
        target: float | Callable[[int], float],
    ) -> Self: ...
    def step(self, believed: Believed, t: float, q: _Array, qdot: _Array) -> _Array: ...
    def reset(self) -> None: ...
    def copy(self) -> Striker: ...

@final
class StrikeLoop:
    def __new__(cls, law: Striker, believed: Believed) -> Self: ...

@final
class CalledLoop:
    def __new__(
        cls, step: Callable[..., Any], counts: bool, status: Any, latched: Any, expected: str
    ) -> Self: ...

def controls(
    mass: _Array,
    force: _Array,
    gradients: _Array,
    curvatures: _Array,
    matrix: _Array,
    a: _Array,
    wanted: _Array,
    limits: list[tuple[float, float]] | None,
) -> tuple[_Array, bool, float | None]: ...
def decoupling_force(
    mass: _Array, gradients: _Array, curvatures: _Array, a: _Array, wanted: _Array
) -> _Array: ...
def simulate_mechanical_loop(
    system: Mechanism,
    inputs: Inputs,
    method: Method,
    times: _Array,
    stops: _Array,
    start: Configuration,
    controller: GapLoop | StrikeLoop | CalledLoop,
    *,
    observer: Callable[[float, _Array, _Array], tuple[_Array, _Array]] | None,
    noise: _Array | None,
    steps: tuple[float, float],
    delay: int,
    dense: bool,
    one_step: bool,
    kicks: object = None,
    progress: Callable[[int, int], None] | None = None,
) -> MechanicalLoopRecord: ...
