"""Section V.B: the mass follows a bouncing reference into its Zeno point (figures 6 to 8).

The paper's data are used, with h = 1e-3 s, which it does not give.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import NDArray

import zivi._zivi as _zivi
from zivi import plot
from zivi.control.closed_loop import simulate_closed_loop
from zivi.control.loop_run import SIGNS, ClosedLoop
from zivi.control.twisting import TwistingTracker
from zivi.paper import step_solvers
from zivi.paper.closed_loops import (
    FORCE,
    FORCE_REF,
    KAPPA,
    MU1,
    MU2,
    PAPER_LOOP,
    START,
    START_REF,
    TRACKING,
    H,
    closed_form_zeno,
    last_above,
    track,
)
from zivi.paper.report import Check, PaperFigure, farthest_from, loop_data, max_abs
from zivi.paper.step_solvers import PROBLEMS, SPEEDS, Array, Solver, Steps, worst_row_residual
from zivi.simulation.methods import ThetaGamma
from zivi.simulation.run import simulate
from zivi.simulation.trajectory import Trajectory
from zivi.system.mass import ImpactSystem, lift

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

NEAR = 1e-2
"""The reference counts as reached within this distance (m)."""
SETTLED = 1.5
"""From here on both rest (s)."""
UNMODELLED = 1.5
SHOWN = 1.6
"""End of the time axes (s)."""
ZENO = closed_form_zeno(START_REF, FORCE_REF)
"""Where the impacts of the reference accumulate (s)."""


def runs() -> dict[str, ClosedLoop]:
    """Run both loops with both branch strategies; the first is the paper's."""
    return {
        f"{loop}_{branch}": track(branch, sampled=loop == "sampled")
        for loop in ("paper", "sampled")
        for branch in ("positive", "nearest")
    }


def errors(run: ClosedLoop) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Errors ``e_s = s - s_r`` and ``e_v = v - v_r``, all lifted to ``s >= 0`` as in the paper."""
    s, v = lift(run.x, run.xdot, kappa=KAPPA)
    s_ref, v_ref = lift(run.x_ref, run.xdot_ref, kappa=KAPPA)
    return s - s_ref, v - v_ref


PAPER: dict[str, float | str] = TRACKING | {"branch": "positive", "loop": PAPER_LOOP}


def draw_tracker(run: ClosedLoop) -> Iterator[PaperFigure]:
    """Draw figures 6 to 8, and the errors and the signs of the same run."""
    e_s, e_v = errors(run)
    pictures = (
        ("fig6_positions", "Positions of both systems", _draw_positions, ("x", "x_ref")),
        ("fig7_velocities", "Velocities of both systems", _draw_velocities, ("xdot", "xdot_ref")),
        ("fig8_control", "The control", _draw_control, ("u",)),
        ("tracking_errors", "Errors of the tracker, lifted to s >= 0", _draw_errors, ("x", "xdot")),
        ("tracking_signs", "Signs of the tracker's steps", _draw_tick_signs, SIGNS),
    )
    for name, title, draw, quantities in pictures:
        data = loop_data(run, *quantities)
        if draw is _draw_errors:
            data = data.assign(e_s=e_s, e_v=e_v)[["e_s", "e_v"]]
        yield PaperFigure(name, title, PAPER, draw(run), {"": data})


def _axes_over_time(height: float) -> tuple[Figure, Axes]:
    import matplotlib.pyplot as plt

    figure, ax = plt.subplots(layout="constrained", figsize=(6.4, height))
    ax.axvline(ZENO, color="0.5", ls=":", lw=1, label=f"reference's Zeno point, {ZENO:.4f} s")
    return figure, ax


def _draw_positions(run: ClosedLoop) -> Figure:
    figure, ax = _axes_over_time(4.0)
    plot.position(run, ax).set_xlim(0, SHOWN)
    return figure


def _draw_velocities(run: ClosedLoop) -> Figure:
    figure, ax = _axes_over_time(4.0)
    plot.velocity(run, ax).set_xlim(0, SHOWN)
    _legend_above(ax)
    return figure


def _draw_control(run: ClosedLoop) -> Figure:
    figure, ax = _axes_over_time(3.8)
    plot.control(run, ax, lw=1).set_xlim(0, SHOWN)
    ax.axhline(-FORCE, color="0.5", lw=0.8, label=f"$-F$ = {-FORCE:g} m/s$^2$, which holds it")
    _legend_above(ax)
    return figure


def _legend_above(ax: Axes) -> None:
    ax.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=3, frameon=False)


def _draw_errors(run: ClosedLoop) -> Figure:
    import matplotlib.pyplot as plt

    e_s, e_v = errors(run)
    figure, (left, right) = plt.subplots(1, 2, layout="constrained", figsize=(8.4, 3.8))
    left.plot(run.t, e_s, color=plot.BLUE, label="$e_s$ (m)")
    left.plot(run.t, e_v, color=plot.ORANGE, ls="--", label="$e_v$ (m/s)")
    left.set(xlabel="time $t$ (s)", ylabel="errors in $(s, v)$", xlim=(0, SHOWN))
    left.legend()
    right.plot(e_s, e_v, color=plot.BLUE, lw=1)
    right.plot(e_s[0], e_v[0], "o", color=plot.GREEN, label="start")
    right.plot(0, 0, "s", color=plot.ORANGE, label="end")
    right.set(xlabel="$e_s$ (m)", ylabel="$e_v$ (m/s)")
    right.legend()
    return figure


PAIRS = (
    (r"\lambda_s", r"\lambda_v"),
    (r"\lambda_{s_r}", r"\lambda_{v_r}"),
    (r"\lambda_{e_s}", r"\lambda_{e_v}"),
)
"""The six signs in the order of the columns of a run."""


def _draw_tick_signs(run: ClosedLoop) -> Figure:
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(3, 1, sharex=True, layout="constrained", figsize=(6.4, 4.8))
    for ax, pair, column in zip(axes, PAIRS, (0, 2, 4), strict=True):
        _pair_of_signs(run, ax, pair, column)
    axes[1].set_ylabel("multipliers (1)")
    axes[2].set(xlabel="time $t$ (s)", xlim=(0, SHOWN))
    return figure


def _pair_of_signs(run: ClosedLoop, ax: Axes, names: tuple[str, str], column: int) -> None:
    looks = ((plot.BLUE, "-"), (plot.ORANGE, "--"))
    for name, (color, style), offset in zip(names, looks, (0, 1), strict=True):
        values = run.signs[:, column + offset]
        ax.step(run.t, values, where="post", color=color, ls=style, lw=1.2, label=f"${name}$")
    ax.set_ylim(-1.2, 1.2)
    ax.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), frameon=False)


def sampled_and_paper(made: dict[str, ClosedLoop]) -> PaperFigure:
    """Draw the distance to the reference in both loops, with both branch strategies."""
    import matplotlib.pyplot as plt

    figure, ax = plt.subplots(layout="constrained", figsize=(6.4, 4.0))
    looks = ((plot.BLUE, "-"), (plot.GREEN, "--"), (plot.ORANGE, "-"), (plot.PURPLE, "--"))
    for (name, run), (color, style) in zip(made.items(), looks, strict=True):
        loop, branch = name.split("_")
        label = f"{'the paper' + chr(39) + 's' if loop == 'paper' else loop} loop, {branch}"
        distance = np.abs(run.error)
        ax.semilogy(run.t, np.maximum(distance, 1e-9), color=color, ls=style, lw=1, label=label)
    ax.axhline(NEAR, color="0.5", ls=":", lw=1)
    ax.set(xlabel="time $t$ (s)", ylabel="$|x - x_r|$ (m), cut at $10^{-9}$", xlim=(0, SHOWN))
    ax.legend(loc="lower left")
    title = "Distance to the reference, both loops and branches"
    data = {name: loop_data(run) for name, run in made.items()}
    return PaperFigure("tracking_loops", title, TRACKING, figure, data)


def check_tracker(made: dict[str, ClosedLoop]) -> list[Check]:
    """Hold the runs against closed forms and against another implementation."""
    result = [
        _zeno("Zeno point, reference (s)", START_REF, FORCE_REF),
        _zeno("Zeno point, free plant (s)", START, FORCE),
    ]
    # by a prototype in Python with the same selection rule
    expected = {"paper_positive": 1.198, "sampled_positive": 1.21, "sampled_nearest": 1.195}
    for key, time in expected.items():
        what = f"1 cm off, {key.replace('_', ' ')} (s)"
        result.append(Check(what, last_above(made[key], NEAR), time, "scheme", 2 * H))
    for key, run in made.items():
        name, after = key.replace("_", " "), run.t >= SETTLED
        result += [
            Check(f"|e|, |x'|, {name}", _unrest(run, after), 0.0, "exact", 0.0),
            Check(f"u at rest, {name}", farthest_from(run.u[after], -FORCE), -FORCE, "exact", 0.0),
        ]
    for branch in ("positive", "nearest"):
        run = track(branch, force=FORCE + UNMODELLED)
        after = run.t >= SETTLED
        what = f"F +{UNMODELLED}, {branch}:"
        result += [
            Check(f"{what} |e| (m)", max_abs(run.error[after]), 0.0, "bound", 1e-6),
            Check(f"{what} |x'| (m/s)", max_abs(run.xdot[after]), 0.0, "bound", 2e-3),
        ]
    return result


def _unrest(run: ClosedLoop, after: NDArray[np.bool_]) -> float:
    return max_abs(np.stack([run.error[after], run.xdot[after]]))


def _zeno(what: str, state: tuple[float, float], force: float) -> Check:
    exact = closed_form_zeno(state, force)
    sol: Trajectory = simulate(
        ImpactSystem(force, kappa=KAPPA), (0.0, exact + 0.1), state, ThetaGamma(1e-6)
    )
    measured = float(sol.zeno_times[0]) if len(sol.zeno_times) else float("nan")
    return Check(what, measured, exact, "exact", 1e-4)


# Steps of the tracker of section V, with six simultaneous signs.


T_END = 2.0
Branch = Literal["positive", "nearest"]
BRANCHES: tuple[Branch, ...] = ("positive", "nearest")


def _loop_solver(solver: str, linearisations: int = 1, fall_backs: bool = True) -> Solver:
    def solve(states: Array, starts: Array) -> Array:
        signs, _ = _zivi.solve_tracking_steps(
            states,
            starts,
            gains=(MU1, MU2),
            kappa=KAPPA,
            kappa_ref=KAPPA,
            h=H,
            f=FORCE,
            f_ref=FORCE_REF,
            solver=solver,
            linearisations=linearisations,
            fall_backs=fall_backs,
        )
        return signs

    return solve


def loop_solvers() -> dict[str, Solver]:
    """Return zivi's general solvers, the control update, and Siconos' solvers if installed.

    "outer n": at most n linearisations; "inner only": without the fall-backs after Josephy-Newton.
    """
    own = {f"outer {n}": _loop_solver("outer", n) for n in (1, 5, 20, 100)}
    own["inner only"] = _loop_solver("newton", fall_backs=False)
    own["inner"] = _loop_solver("newton")
    own["tick"] = _loop_solver("exact")
    return own | step_solvers.siconos_solvers(
        "tracking", MU1, MU2, KAPPA, KAPPA, FORCE, FORCE_REF, H
    )


@np.errstate(all="ignore")  # a failed solve may have left anything
def loop_residual(states: Array, multipliers: Array) -> Array:
    """Relative natural residual of the six inclusions."""
    (s, v, s_ref, v_ref), (ls, lv, lsr, lvr, les, lev) = states.T, multipliers.T
    r, r_ref = 1.0 - KAPPA * ls * lv, 1.0 - KAPPA * lsr * lvr
    a = lsr * FORCE_REF / r_ref
    reference_v = v_ref + H * a
    reference_s = s_ref + H * r_ref * reference_v
    held = ls**2 * (a - MU1 * les - MU2 * lev)
    plant_v = v + H * (held + ls * (1.0 - ls**2) * FORCE / r)
    plant_s = s + H * r * plant_v
    of_v = np.abs(v) + H * (MU1 + MU2 + np.abs(a) + np.abs(FORCE) / r)
    of_s = np.abs(s) + H * r * of_v
    of_v_ref = np.abs(v_ref) + H * np.abs(FORCE_REF) / r_ref
    of_s_ref = np.abs(s_ref) + H * r_ref * of_v_ref
    rows = (
        (ls, plant_s, of_s),
        (lv, plant_v, of_v),
        (lsr, reference_s, of_s_ref),
        (lvr, reference_v, of_v_ref),
        (les, plant_s - reference_s, of_s + of_s_ref),
        (lev, plant_v - reference_v, of_v + of_v_ref),
    )
    return worst_row_residual(rows)


def signs_of(states: Array) -> Array:
    """Return the signs of states and of their errors, with which a first solve can begin."""
    s, v, s_ref, v_ref = states.T
    signs: Array = np.sign(np.column_stack([s, v, s_ref, v_ref, s - s_ref, v - v_ref]))
    return signs


def random_loop_states(speed: float, seed: int, problems: int = PROBLEMS) -> Array:
    """States near the wall and near the reference, uniform.

    ``|v|, |v_r - v| <= speed`` and ``|s|, |s_r - s| <= h speed``.
    """
    random = np.random.default_rng(seed)
    within = speed * np.array([H, 1.0])
    z = within * random.uniform(-1.0, 1.0, (problems, 2))
    error = within * random.uniform(-1.0, 1.0, (problems, 2))
    return np.column_stack([z, z + error])


def loop_states(branch: Branch) -> tuple[Array, Array]:
    """Return the lifted states of the paper's loop, and the signs of its ticks."""
    tracker = TwistingTracker(MU1, MU2, h=H, kappa=KAPPA, branch=branch, landing=False)
    tracker.reset(*START_REF)
    run = simulate_closed_loop(
        ImpactSystem(FORCE, kappa=KAPPA),
        tracker,
        (0.0, T_END),
        START,
        force_ref=FORCE_REF,
        method=ThetaGamma(H),
    )
    measured: Array = np.column_stack(_zivi.lift(run.x[:-1], run.xdot[:-1], 1.0, KAPPA))
    references = []
    for x, xdot in zip(run.x[:-1], run.xdot[:-1], strict=True):
        references.append(tracker.state[:2])
        tracker.step(x, xdot, FORCE, FORCE_REF)
    reference = np.array(references)
    if branch == "nearest":
        (s, v), (s_ref, v_ref) = measured.T, reference.T
        # by the energy of the error, mu1 |e_s| + e_v^2/2
        nearer = MU1 * (np.abs(s + s_ref) - np.abs(s - s_ref)) + 2.0 * v * v_ref
        measured[nearer < 0.0] *= -1.0
    return np.column_stack([measured, reference]), run.signs[:-1]


def loop_step_sets() -> Iterator[Steps]:
    """Yield all steps that are measured."""
    available = loop_solvers()

    def steps(label: str, states: Array, starts: Array) -> Steps:
        return Steps("tracking", f"tracking, {label}", states, starts, available, loop_residual)

    for branch in BRANCHES:
        states, signs = loop_states(branch)
        own = signs_of(states)
        first, unknown = own[:1], np.full_like(own[1:], np.nan)
        yield steps(f"{branch}, tick", states, np.vstack([first, signs[:-1]]))
        yield steps(f"{branch}, state", states, own)
        yield steps(f"{branch}, own last", states, np.vstack([first, unknown]))
    for j, speed in enumerate(SPEEDS):
        states = random_loop_states(speed, seed=j)
        yield steps(f"random, |v|<={speed:.0e}", states, signs_of(states))
