from typing import Any, final

import numpy as np
from numpy.typing import NDArray

__all__ = [
    "RunRecord",
    "STATUS_MESSAGES",
    "__version__",
    "check_theta_gamma",
    "compiled_force",
    "lift",
    "project",
    "restitution",
    "simulate_explicit_euler",
    "simulate_theta_gamma",
]

__version__: str
STATUS_MESSAGES: list[str]

_Array = NDArray[np.float64]

@final
class RunRecord:
    @property
    def t(self) -> _Array: ...
    @property
    def x(self) -> _Array: ...
    @property
    def xdot(self) -> _Array: ...
    @property
    def s(self) -> _Array: ...
    @property
    def v(self) -> _Array: ...
    @property
    def lambda_s(self) -> _Array: ...
    @property
    def lambda_v(self) -> _Array: ...
    @property
    def residual(self) -> _Array: ...
    @property
    def impact_t(self) -> _Array: ...
    @property
    def impact_xdot_before(self) -> _Array: ...
    @property
    def impact_xdot_after(self) -> _Array: ...
    @property
    def zeno_times(self) -> _Array: ...
    @property
    def liftoff_times(self) -> _Array: ...
    @property
    def rest_time(self) -> float | None: ...
    @property
    def status(self) -> int: ...
    @property
    def message(self) -> str: ...
    @property
    def nfev(self) -> int: ...
    @property
    def raised(self) -> BaseException | None: ...

def restitution(*, e: float | None = None, kappa: float | None = None) -> tuple[float, float]: ...
def lift(x: _Array, xdot: _Array, sigma: float, kappa: float) -> tuple[_Array, _Array]: ...
def project(s: _Array, v: _Array, kappa: float) -> tuple[_Array, _Array]: ...
def check_theta_gamma(h: float, theta: float, gamma: float, kappa: float) -> None: ...
def compiled_force(callable: Any) -> tuple[int, int | None]: ...
def simulate_theta_gamma(
    force: tuple[Any, ...],
    *,
    kappa: float,
    h: float,
    theta: float,
    gamma: float,
    span: tuple[float, float],
    state: tuple[float, float],
    progress: Any = None,
) -> RunRecord: ...
def simulate_explicit_euler(
    force: tuple[Any, ...],
    *,
    kappa: float,
    h: float,
    span: tuple[float, float],
    state: tuple[float, float],
    progress: Any = None,
) -> RunRecord: ...
