"""Controllers and observers with a model of the mechanical plant."""

from __future__ import annotations

from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

import zivi._zivi as _zivi
from zivi.base.check import Array, real, real_array
from zivi.control.component import limits_of
from zivi.system.mechanism import ControlInputs, MechanicalSystem, check_rigid
from zivi.system.start import GapKinetics

# A model of a plant for a controller, integrated period by period.


class BelievedPlant:
    """A system that moves under held controls, with its impacts and contacts.

    Parameters
    ----------
    system : MechanicalSystem
        The controller's model of the plant.
    h : float
        Length of a period (s).
    n : int
        Number of coordinates.
    tasks : MechanicalSystem, optional
        A system whose gaps are functions of the coordinates that may follow a reference.
    """

    def __init__(
        self, system: MechanicalSystem, h: float, n: int, tasks: MechanicalSystem | None = None
    ) -> None:
        self.h, self.model = h, system.model(n)
        self.tasks = None if tasks is None else tasks.model(n)
        controls = system.control_inputs(np.zeros(n))
        self.r, inputs = controls.r, controls.spec()
        functions = None
        if tasks is not None and self.tasks is not None:
            functions = tasks.mechanism(self.tasks)
        self.core = _zivi.Believed(system.mechanism(self.model), inputs, h, functions)

    def moved(
        self, t: float, q: Array, qdot: Array, controls: Array
    ) -> tuple[Array, Array, NDArray[np.bool_]]:
        """Return coordinates, velocities and contacts after as many periods as there are controls.

        Parameters
        ----------
        t : float
            Time at the start (s).
        q, qdot : ndarray
            The state there, shape (n,); no gap may be below 0.
        controls : ndarray
            The controls, shape (d, r).
        """
        q, qdot, closed = self.core.moved(t, q, qdot, controls)
        return q, qdot, np.array(closed, dtype=bool)

    def onto(
        self, t: float, q: Array, qdot: Array, closed: NDArray[np.bool_]
    ) -> tuple[Array, Array]:
        """Move a state, M-orthogonally, to where contacts are closed and no gap is below 0."""
        return self.core.onto(t, q, qdot, closed)


# Base class of model-based controllers of mechanisms.


class ModelBased:
    """Settings, a model, its prediction over a delay, and the last controls.

    Parameters
    ----------
    system : MechanicalSystem
        The controller's model of the plant.
    settings : dict
        The arguments of the constructor, with ``h``, ``delay`` and ``u_limits``.
    """

    _law: Any

    def __init__(self, system: MechanicalSystem, settings: dict[str, Any]) -> None:
        self.system = system
        self._settings = {**settings, "u_limits": limits_of(settings["u_limits"])}
        self._inputs: ControlInputs | None = None
        self._believed: BelievedPlant | None = None

    @property
    def h(self) -> float:
        """Sampling period (s)."""
        return float(self._settings["h"])

    @property
    def delay(self) -> int:
        """Periods from a measurement to the moment when its control acts."""
        return int(self._settings["delay"])

    @property
    def settings(self) -> dict[str, Any]:
        """All settings, as they are given to the constructor."""
        return dict(self._settings)

    def reset(self) -> None:
        """Forget all that was measured."""
        self._law.reset()

    def copy(self) -> Self:
        """Copy it: the same settings, the same state."""
        twin = type(self).__new__(type(self))
        vars(twin).update(vars(self))
        twin._law = self._law.copy()
        return twin

    def __copy__(self) -> Self:
        return self.copy()

    def __deepcopy__(self, memo: dict[int, Any]) -> Self:
        return self.copy()

    def __repr__(self) -> str:
        shown = ", ".join(f"{name}={it!r}" for name, it in self._settings.items() if it is not None)
        return f"{type(self).__name__}({self.system!r}, {shown})"

    def _measured(self, q: ArrayLike, qdot: ArrayLike) -> tuple[_zivi.Believed, Array, Array]:
        """Return the model and the measurement, as arrays of matching shape."""
        at, speed = (np.atleast_1d(real_array(*it)) for it in (("q", q), ("qdot", qdot)))
        if at.shape != speed.shape or at.ndim != 1:
            raise ValueError(f"qdot must have shape {at.shape}, got {speed.shape}")
        return self._model(at)[1].core, at, speed

    def _model(self, q: Array) -> tuple[ControlInputs, BelievedPlant]:
        """Return inputs and plant, built at the first sample for its number of coordinates."""
        if self._inputs is None or self._believed is None:
            inputs, limits = self.system.control_inputs(q), self._settings["u_limits"]
            if limits is not None and len(limits) != inputs.r:
                raise ValueError(
                    f"u_limits must have a pair for each of {inputs.r} controls, got {len(limits)}"
                )
            self._look_at(q)
            tasks = self._functions(q)
            self._inputs = inputs
            self._believed = BelievedPlant(self.system, self.h, len(q), tasks)
        return self._inputs, self._believed

    def _look_at(self, q: Array) -> None:
        """Check what only a sample shows."""

    def _functions(self, q: Array) -> MechanicalSystem | None:
        """Return a system whose gaps are the tasks that follow a reference; None without any."""
        return None


def believed(system: Any) -> MechanicalSystem:
    """Check that a model was given."""
    if not isinstance(system, MechanicalSystem):
        raise TypeError(f"system must be a zivi.MechanicalSystem, got {type(system).__name__}")
    check_rigid(system, "controllers")
    return system


def check_believes(told: str, system: MechanicalSystem, plant: MechanicalSystem, q: Array) -> None:
    """Reject a model whose coordinates, gaps or controls are others than the plant's.

    Parameters
    ----------
    told : str
        Whose model it is.
    system, plant : MechanicalSystem
        The model and the plant.
    q : ndarray
        Coordinates of the plant.
    """
    n = system._n
    if n is not None and n != len(q):
        raise ValueError(f"{told} must have {len(q)} coordinates like the plant, got {n}")
    if system.gap_names != plant.gap_names:
        raise ValueError(
            f"{told} must have the gaps of the plant, {plant.gap_names}, got {system.gap_names}"
        )
    believed, known = system.control_inputs(q).names, plant.control_inputs(q).names
    if len(believed) != len(known):
        raise ValueError(
            f"{told} must have {len(known)} controls like the plant, got {len(believed)}"
        )


# Velocities of a mechanism from its measured coordinates, through impacts and contacts.

OPENS = 6.0
"""Deviations of the measured gap beyond which a contact may have opened."""
OUT = 5
"""So many in a row, and it has."""


class JointObserver:
    r"""Estimates coordinates and velocities from measured coordinates only.

    A copy of the model, impacts, accumulations and contacts included, moves under the controls that
    act and is corrected by the innovation :math:`y = q_{measured} - q`:

    .. math:: q \leftarrow q + \alpha y, \qquad
        \dot q \leftarrow \dot q + \frac{\alpha^2}{(2 - \alpha)\,h}\,y

    In contact the component of y that moves closed gaps is removed M-orthogonally, since noise
    would open them; five consecutive measurements outside 6 standard deviations open them.

    Parameters
    ----------
    system : MechanicalSystem
        The controller's model of the plant.
    noise : float
        Standard deviation of the measured coordinates, >= 0.
    alpha : float
        Gain of the correction of coordinates, in (0, 1).

    Raises
    ------
    ValueError, TypeError
        For a setting out of range.

    See Also
    --------
    ImpactObserver : observer of one mass.
    GapTracker : the controller.

    Notes
    -----
    The correction is that of an alpha-beta filter with the gains of Benedict and Bordner (1962). An
    update integrates the model over one period, with impacts.

    References
    ----------
    T. R. Benedict and G. W. Bordner, Synthesis of an optimal set of radar track-while-scan
    smoothing equations, IRE Trans. Automatic Control 7, 1962.

    D. Simon, Optimal State Estimation, Wiley, 2006.

    Examples
    --------
    >>> ball = zivi.MechanicalSystem(
    ...     mass=1.0, force=[-9.81], gaps=[zivi.LinearGap([1])], e=0.5, inputs=[[1.0]]
    ... )
    >>> ctl = zivi.GapTracker(ball, h=1e-3, gains={"gap0": (30, 17)})
    >>> run = zivi.simulate_closed_loop(
    ...     ball, ctl, (0, 1.5), ([0.3], [0]), reference="rest", noise=(1e-5, 0), seed=1,
    ...     observer=zivi.JointObserver(ball, noise=1e-5),
    ... )
    >>> run.contacts[-1]
    array([ True])
    """

    def __init__(self, system: MechanicalSystem, noise: float = 0.0, alpha: float = 0.3) -> None:
        if not isinstance(system, MechanicalSystem):
            raise TypeError(f"system must be a zivi.MechanicalSystem, got {type(system).__name__}")
        self.system = system
        self.noise, self.alpha = real("noise", noise), real("alpha", alpha)
        if not (np.isfinite(self.noise) and self.noise >= 0.0):
            raise ValueError(f"noise must be finite and >= 0, got {noise}")
        if not 0.0 < self.alpha < 1.0:
            raise ValueError(f"alpha must lie in (0, 1), got {alpha}")
        self._plant: BelievedPlant | None = None
        self.reset()

    def reset(self) -> None:
        """Forget all that was measured."""
        self._q: Array | None = None
        self._qdot: Array | None = None
        self._t = self._started = 0.0
        self._seen = 0
        self._closed: NDArray[np.bool_] = np.zeros(self.system.m, dtype=bool)
        self._beyond = np.zeros(self.system.m, dtype=int)

    def begun(self, h: float, n: int) -> Self:
        """Return a copy for a loop of period `h` (s) and `n` coordinates."""
        twin = type(self).__new__(type(self))
        vars(twin).update(vars(self))
        twin._plant = BelievedPlant(self.system, real("h", h), n)
        twin._closed, twin._beyond = self._closed.copy(), self._beyond.copy()
        return twin

    @property
    def deviations(self) -> tuple[float, float]:
        """Standard deviations of the estimates in flight: of coordinates and of velocities."""
        assert self._plant is not None
        a = self.alpha
        share = np.sqrt((2.0 * a + a * a * (2.0 - a)) / (4.0 - a)) if a else 0.0
        return self.noise * float(share), self.noise * self._gain

    @property
    def _gain(self) -> float:
        assert self._plant is not None
        return float(self.alpha**2 / ((2.0 - self.alpha) * self._plant.h))

    def step(self, t: float, q: ArrayLike, u: ArrayLike) -> tuple[Array, Array]:
        """Return coordinates and velocities at a sample.

        Parameters
        ----------
        t : float
            Time of the sample (s).
        q : array_like
            Measured coordinates, shape (n,).
        u : array_like
            The controls that acted since the last sample, shape (r,).

        Returns
        -------
        (ndarray, ndarray)
            The estimates, shape (n,) each; NaN before the first measurement that is finite.

        Notes
        -----
        Where `q` is not finite the sample counts as missed: the copy of the plant moves on.
        """
        if self._plant is None:
            raise ValueError("h of the observer is not set: zivi.simulate_closed_loop sets it")
        at, model = np.atleast_1d(real_array("q", q)), self._plant.model
        if at.shape != (model.layout.n,):
            raise ValueError(f"q must have shape ({model.layout.n},), got {at.shape}")
        missed = not np.all(np.isfinite(at))
        if self._q is None or self._qdot is None:
            if missed:
                return np.full_like(at, np.nan), np.full_like(at, np.nan)
            self._q, self._qdot, self._t = at, np.zeros_like(at), t
            self._started = t
            self._q, self._qdot = self._plant.onto(t, self._q, self._qdot, self._closed)
            return self._q.copy(), self._qdot.copy()
        controls = np.atleast_1d(real_array("u", u))[None]
        if controls.shape[1] != self._plant.r or not np.all(np.isfinite(controls)):
            raise ValueError(
                f"u must be {self._plant.r} finite controls, got {controls[0].tolist()}"
            )
        q0, speed, closed = self._plant.moved(self._t, self._q, self._qdot, controls)
        self._t, self._closed = t, np.array(closed)
        if missed:
            self._q, self._qdot = q0, speed
            return q0.copy(), speed.copy()
        y = at - q0
        self._seen += 1
        here = model.layout.read(model.evaluate(t, q0, speed))
        kinetics = GapKinetics.of(here, speed)
        out = here.gradients @ y
        far = out > OPENS * self.noise * np.sqrt(np.sum(here.gradients**2, axis=1))
        self._beyond = np.where(self._closed & far, self._beyond + 1, 0)
        self._closed &= self._beyond < OUT
        if self._closed.any():
            y = kinetics.without_gaps(y, self._closed)
        if self._seen == 1 and not self._closed.any():
            # two samples: the speed that nothing told before
            q0, speed = q0 + y, speed + y / (t - self._started)
        else:
            q0, speed = q0 + self.alpha * y, speed + self._gain * y
        self._q, self._qdot = self._plant.onto(t, q0, speed, self._closed)
        return self._q.copy(), self._qdot.copy()

    def __repr__(self) -> str:
        return f"JointObserver({self.system!r}, noise={self.noise!r}, alpha={self.alpha!r})"

    def __getstate__(self) -> dict[str, object]:
        return vars(self) | {"_plant": None}
