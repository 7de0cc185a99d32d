"""Kicks: given impulses, which change the velocities instantaneously."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from zivi.base.check import Array, all_of, check_arguments, finite, real_array
from zivi.base.habits import hinted
from zivi.system.mass import ImpactSystem
from zivi.system.mechanism import MechanicalSystem
from zivi.system.tree import Tree
from zivi.system.tree_bodies import PlaneGap

MOST = 1_000_000
"""Kicks of one run."""


@hinted("Kick")
@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class Kick:
    r"""Impulses at given times, which change the velocities instantaneously.

    .. math:: v^+ = v^- + \Delta v \qquad \text{or} \qquad v^+ = v^- + M(q)^{-1} J

    Parameters
    ----------
    t : float or array_like, optional
        Times (s), finite. Exactly one of `t` and `every` is given.
    every : float, optional
        Period of the kicks (s), > 0.
    start : float, optional
        Time of the first kick with `every` (s). Default 0.
    dv : float, array_like of shape (n,) or callable, optional
        Change of the velocity, or a function ``dv(t, q, v)`` of the state before the kick; of a
        mass ``dv(t, x, xdot) -> float`` (m/s). Exactly one of `dv` and `impulse` is given.
    impulse : float, array_like of shape (n,) or callable, optional
        Generalised impulse :math:`J`, or a function ``impulse(t, q, v)``; of a mass per unit mass
        (m/s). With `body` an impulse with three components in axes of the world (N s).
    body : str, optional
        Body of a `Tree` on which `impulse` acts.
    point : array_like of shape (3,), optional
        Point of the body in its own frame (m). Default: its origin.

    Raises
    ------
    ValueError
        If not exactly one of `t` and `every`, and one of `dv` and `impulse`, is given, or a number
        is out of range.
    TypeError
        If a function has other arguments than three.

    See Also
    --------
    zivi.simulate : its argument ``kicks=``.

    Notes
    -----
    At one instant the kick comes first, then the impact on closed gaps with a speed towards zero,
    with their coefficient of restitution. Friction in joints is a finite force: a kick makes joints
    slip that stick. Kicks at the start of a span change the initial velocity, those at its end do
    nothing. A sample of `t_eval` at a kick shows the state after it.

    Examples
    --------
    >>> ball = zivi.ImpactSystem(-9.81, e=0.5)
    >>> sol = zivi.simulate(ball, (0, 3), (0, 0), kicks=[zivi.Kick(t=1.0, dv=-2.0)])
    >>> sol.kicks["t"], float(sol.impacts["xdot_after"][0])
    (array([1.]), 1.0)
    >>> round(float(sol.rest_time), 6)
    1.407747
    """

    t: float | ArrayLike | None = None
    every: float | None = None
    start: float = 0.0
    dv: float | ArrayLike | Callable[..., Any] | None = None
    impulse: float | ArrayLike | Callable[..., Any] | None = None
    body: str | None = None
    point: ArrayLike = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        if (self.t is None) == (self.every is None):
            raise ValueError("exactly one of t and every must be given")
        if (self.dv is None) == (self.impulse is None):
            raise ValueError("exactly one of dv and impulse must be given")
        if self.every is not None and not finite("every", self.every) > 0.0:
            raise ValueError(f"every must be > 0, got {self.every!r}")
        finite("start", self.start)
        times = np.atleast_1d(real_array("t", () if self.t is None else self.t))
        if times.ndim != 1 or not np.all(np.isfinite(times)):
            raise ValueError("t must be one finite time or a one-dimensional array of them")
        if self.body is not None and self.impulse is None:
            raise ValueError("body must be None with dv; give impulse")
        name = "dv" if self.impulse is None else "impulse"
        given = getattr(self, name)
        if callable(given):
            check_arguments(name, given, "t, q, v")
        elif not np.all(np.isfinite(real_array(name, given))):
            raise ValueError(f"{name} must be finite, got {given!r}")

    def times(self, span: tuple[float, float]) -> Array:
        """Return the times of the kicks in ``t0 <= t < t1`` (s)."""
        t0, t1 = span
        if self.every is None:
            times = np.unique(np.atleast_1d(real_array("t", self.t)))
        else:
            first = max(math.floor((t0 - self.start) / self.every) - 1, 0)
            last = math.ceil((t1 - self.start) / self.every) + 1
            if last - first > MOST:
                raise ValueError(
                    f"every must leave at most {MOST} kicks in t_span, got {last - first}"
                )
            times = self.start + self.every * np.arange(first, max(last, first), dtype=np.float64)
        inside: Array = times[(times >= t0) & (times < t1)]
        return inside

    @property
    def value_given(self) -> Any:
        """`dv` or `impulse` as given."""
        return self.dv if self.impulse is None else self.impulse

    def value(self, t: float, q: Any, v: Any) -> Any:
        """Return `dv` or `impulse` at a state."""
        given = self.value_given
        return given(t, q, v) if callable(given) else given


class KickSchedule:
    """The kicks of a run: a function of the state that returns the velocities after a kick.

    Parameters
    ----------
    kicks : sequence of Kick
        The kicks.
    system : ImpactSystem or MechanicalSystem
        The system.
    n : int or None
        Its coordinates; None for a mass.
    span : (float, float)
        Start and end of the run (s).
    """

    def __init__(
        self, kicks: Sequence[Kick], system: Any, n: int | None, span: tuple[float, float]
    ) -> None:
        self.kicks, self.n = tuple(kicks), n
        self.model: Any = None if n is None else system.model(n)
        self.arms = [None if it.body is None else _arm(system, it) for it in self.kicks]
        self.at: dict[float, list[int]] = {}
        for i, kick in enumerate(self.kicks):
            for t in kick.times(span).tolist():
                self.at.setdefault(t, []).append(i)
        self.rows: list[tuple[float, Any, Any, Any]] = []

    @property
    def stops(self) -> Array:
        """Times of the kicks (s), increasing."""
        return np.array(sorted(self.at))

    def start(self, t0: float, q: Any, v: Any) -> Any:
        """Return the initial velocities after the kicks at the start."""
        after = self(t0, q, v)
        return v if after is None else after

    def constant(self) -> list[tuple[float, float]]:
        """Return times and changes of the velocity of a mass; an error for kicks of functions."""
        if any(callable(it.value_given) for it in self.kicks):
            raise ValueError(
                "kicks must be numbers for batches of an ImpactSystem, got a function; use "
                "zivi.simulate, or a MechanicalSystem of one coordinate"
            )
        return [
            (t, float(sum(self.kicks[i].value_given for i in chosen)))
            for t, chosen in sorted(self.at.items())
        ]

    def __call__(self, t: float, q: Any, v: Any) -> Any:
        """Return the velocities after the kicks at `t`, and list them; None without one."""
        after = self.after(t, q, v)
        if after is not None:
            self.rows.append((t, v, after - v, after))
        return after

    def after(self, t: float, q: Any, v: Any) -> Any:
        """Return the velocities after the kicks at `t`; None without one."""
        chosen = self.at.get(t)
        if chosen is None:
            return None
        after = v
        for i in chosen:
            after = after + self._change(i, t, q, after)
        return after

    def depends_on_state(self, t: float) -> bool:
        """Whether the change of the velocities at `t` may depend on the state."""
        chosen = [self.kicks[i] for i in self.at.get(t, ())]
        return any(callable(it.value_given) for it in chosen) or self.depends_on_mass(t)

    def depends_on_mass(self, t: float) -> bool:
        """Whether the mass matrix has a part in the kicks at `t`."""
        return self.n is not None and any(
            self.kicks[i].impulse is not None for i in self.at.get(t, ())
        )

    def _change(self, i: int, t: float, q: Any, v: Any) -> Any:
        """Return the change of the velocities by a kick."""
        kick, arm = self.kicks[i], self.arms[i]
        name = "dv" if kick.impulse is None else "impulse"
        if self.n is None:
            return finite(name, kick.value(t, q, v))
        value = real_array(name, kick.value(t, q.copy(), v.copy()))
        wanted = (self.n,) if arm is None else (3,)
        value = value.reshape(1) if value.ndim == 0 and wanted == (1,) else value
        if value.shape != wanted or not np.all(np.isfinite(value)):
            raise ValueError(f"{name} must be finite with shape {wanted}, got {value.tolist()}")
        if kick.impulse is None:
            return value
        model = self.model
        mass = model.layout.read(model.evaluate(t, q, v)).mass
        return np.linalg.solve(mass, value if arm is None else arm(t, q, v).T @ value)


def _arm(system: Any, kick: Kick) -> Callable[..., Array]:
    """Return the Jacobian of a point of a body of a tree, three rows."""
    if not isinstance(system, Tree):
        raise ValueError(f"body must be None for a {type(system).__name__}; a zivi.Tree has bodies")
    names = [body.name for body in system.bodies]
    if kick.body not in names:
        raise ValueError(f"body must be one of {', '.join(names)}, got {kick.body!r}")
    axes = [
        PlaneGap(str(kick.body), kick.point, tuple(row), name=f"axis {i}")
        for i, row in enumerate(np.eye(3).tolist())
    ]
    probe = Tree(system.bodies, gaps=axes, gravity=system._gravity)
    for name, value in system.parameters.items():
        if name in probe.parameters:
            probe.parameters[name] = value
    model = probe.model(len(probe._structure.moving))

    def at(t: float, q: Array, v: Array) -> Array:
        gradients: Array = model.layout.read(model.evaluate(t, q, v)).gradients
        return gradients

    return at


def schedule_of(
    kicks: Any, system: ImpactSystem | MechanicalSystem, n: int | None, span: tuple[float, float]
) -> KickSchedule | None:
    """Read the argument `kicks` of a run; None without kicks."""
    if kicks is None:
        return None
    each = all_of("kicks", kicks, Kick)
    for kick in each:
        if n is None and kick.body is not None:
            raise ValueError("body must be None for an ImpactSystem; a zivi.Tree has bodies")
    return KickSchedule(each, system, n, span) if each else None


def kicks_table(rows: Sequence[tuple[float, Any, Any, Any]], n: int | None) -> np.ndarray:
    """Return the table of kicks: t (s), the velocity before, its change, the velocity after."""
    name, shape = ("xdot", ()) if n is None else ("qdot", (n,))
    kind = [("t", float), (f"{name}_before", float, shape), ("dv", float, shape)]
    return np.array(list(rows), dtype=[*kind, (f"{name}_after", float, shape)])
