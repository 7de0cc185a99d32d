"""Content of the page: figure, numbers, Python script or message."""

from __future__ import annotations

import html
import inspect
import time
from typing import Any

import marimo as mo
import numpy as np

from zivi.control.loop_run import ClosedLoop
from zivi.lab.figures import draw_runs, film
from zivi.lab.runs import (
    FAR,
    BeltRun,
    Drawn,
    ExplicitFollower,
    ExplicitRegulator,
    Runs,
    SignedSlip,
    facts,
    simulate_settings,
    warning_texts,
)
from zivi.lab.settings import (
    Ball,
    Belt,
    Regulator,
    Settings,
    Tracker,
    end_notices,
    landing_of,
    observer_of,
    query,
)
from zivi.simulation.trajectory import Trajectory

# Description of the figure in a sentence or two.

LATE = 0.5
"""The last part of the motion before the rest, if there is one, in which a loop is judged."""
ALIKE = 1.5
"""Changes of the control that differ by less than this factor are called alike."""


def describe_signs(runs: Runs) -> str:
    """Describe the control on the screen with implicit and with explicit signs.

    Parameters
    ----------
    runs : dict
        What `zivi.lab.runs.simulate_settings` gave.

    Returns
    -------
    str
        Plain text.
    """
    implicit, explicit = runs["implicit"], runs["explicit"]
    if isinstance(implicit, BeltRun):
        assert isinstance(explicit, BeltRun)
        return _belt_message(implicit, explicit, runs["high_order"])
    if not isinstance(implicit, ClosedLoop):
        assert isinstance(explicit, Trajectory)
        return _ball_message(implicit, explicit, runs["high_order"])
    assert isinstance(explicit, ClosedLoop)
    if np.all(np.isnan(implicit.x_ref)):
        said = f"The mass is {_rest_text(implicit)} with implicit signs, "
        return f"{said}{_rest_text(explicit)} with explicit ones. {_switching(implicit, explicit)}"
    start, end = _late_window(implicit, explicit)
    errors = [
        f"{np.abs(run.error[(run.t >= start) & (run.t <= end)]).max():.2g} m"
        for run in (implicit, explicit)
    ]
    return (
        f"From {start:.3g} to {end:.3g} s the mass is at most {errors[0]} off its reference with "
        f"implicit signs, {errors[1]} with explicit ones. {_switching(implicit, explicit)}"
    )


def _ball_message(implicit: Trajectory, explicit: Trajectory, high_order: Any) -> str:
    said = f"The ball is {_rest_text(implicit)} with implicit signs, "
    said += f"{_rest_text(explicit)} with explicit ones."
    if isinstance(high_order, Trajectory) and high_order.rest_time is not None:
        said += f" SwitchedRK, to its tolerance: {_rest_text(high_order)}."
    return said


def _belt_message(implicit: BeltRun, explicit: BeltRun, high_order: Any) -> str:
    said = f"With the implicit sign the mass sticks {implicit.stuck:.1%} of the time"
    said += f", to the tolerance of SwitchedRK {high_order.stuck:.1%}."
    jumps = np.abs(np.diff(explicit.friction)) > 0.0
    if jumps.any():
        said += f" The explicit sign never sticks: its force jumps {int(jumps.sum())} times."
    return said


def _rest_text(run: Trajectory | ClosedLoop) -> str:
    if run.rest_time is None:
        return f"not at rest within {run.t[-1]:.4g} s"
    return f"exactly at rest from {run.rest_time:.4g} s"


def _switching(implicit: ClosedLoop, explicit: ClosedLoop) -> str:
    """Compare how much the controls change late in the motion."""
    start, end = _late_window(implicit, explicit)
    quiet, loud = (
        float(np.abs(np.diff(run.u[(run.t >= start) & (run.t <= end)])).sum())
        for run in (implicit, explicit)
    )
    if max(quiet, loud) == 0.0:
        return "Then neither control changes any more."
    if quiet * ALIKE < loud:
        much = f"{loud / quiet:.3g} times" if quiet > 1e-6 * loud else "more than a million times"
        return f"The explicit control then changes {much} as much as the implicit one."
    if loud * ALIKE < quiet:
        return f"The implicit control then changes {quiet / max(loud, 1e-300):.3g} times as much."
    return "Both controls then change alike."


def _late_window(*runs: ClosedLoop) -> tuple[float, float]:
    """Return the later part of the time in which a mass moves (s)."""
    first, last = float(runs[0].t[0]), float(runs[0].t[-1])
    ends = [last if run.rest_time is None else float(run.rest_time) for run in runs]
    end = max(ends)
    return end - LATE * (end - first), end


# From settings to Python: a script that runs what is on the screen.


def script(settings: Settings) -> str:
    """Write a script that repeats the runs of `zivi.lab.runs.simulate_settings` and plots one.

    Parameters
    ----------
    settings : Ball, Regulator, Tracker or Belt
        The settings of a tab.

    Returns
    -------
    str
        Python. Its variables ``implicit`` and ``explicit``, of a ball or a belt also
        ``high_order``, are the runs; ``figure`` is a matplotlib figure.
    """
    if isinstance(settings, Ball):
        return _ball_script(settings)
    if isinstance(settings, Belt):
        return _belt_script(settings)
    if isinstance(settings, Regulator):
        return _regulator_script(settings)
    return _tracker_script(settings)


def _ball_script(ball: Ball) -> str:
    force = f"gravity={ball.gravity!r}, amplitude={ball.amplitude!r}, omega={ball.omega!r}"
    return f"""\
import zivi

force = zivi.LinearForce({force})
ball = zivi.ImpactSystem(force, e={ball.e!r})
span, start = (0.0, {ball.t_end!r}), ({ball.x0!r}, {ball.xdot0!r})

implicit = zivi.simulate(ball, span, start, method=zivi.ThetaGamma(h={ball.h!r}))
explicit = zivi.simulate(ball, span, start, method=zivi.ExplicitEuler(h={ball.h!r}))
high_order = zivi.simulate(ball, span, start)

for run in (implicit, explicit, high_order):
    print(run)
figure = zivi.plot.position(implicit).figure  # figure.savefig("ball.png")
"""


def _belt_script(given: Belt) -> str:
    force = f"-{given.stiffness!r} * q - {given.damping!r} * qdot"
    limits = f"limit={given.limit!r}, static={given.limit!r} + {given.extra!r}"
    numbers = f"{given.stiffness!r}, {given.damping!r}, {given.limit!r}, {given.speed!r}"
    return f"""\
from typing import Any

import numpy as np

import zivi

FAR = {FAR!r}  # m: the wall is never met


{inspect.getsource(SignedSlip)}

belt = zivi.DryFriction({limits}, velocity={given.speed!r})
system = zivi.MechanicalSystem(mass=1.0, force=lambda t, q, qdot: {force}, friction=[belt])
span, start = (0.0, {given.t_end!r}), ([{given.x0!r}], [{given.xdot0!r}])
times = np.linspace(0.0, {given.t_end!r}, round({given.t_end!r} / {given.h!r}) + 1)

implicit = zivi.simulate(system, span, start, zivi.ThetaGamma(h={given.h!r}))
high_order = zivi.simulate(system, span, start, t_eval=times)
signed = zivi.ImpactSystem(SignedSlip({numbers}), e=1.0)
far = (FAR + {given.x0!r}, {given.xdot0!r})
explicit = zivi.simulate(signed, span, far, zivi.ExplicitEuler(h={given.h!r}))

for run in (implicit, explicit, high_order):
    print(run)
figure = zivi.plot.modes(high_order).figure  # figure.savefig("belt.png")
"""


def _regulator_script(given: Regulator) -> str:
    gains = f"{given.mu1!r}, {given.mu2!r}, h={given.h!r}"
    return f"""\
import math

import zivi


{inspect.getsource(ExplicitRegulator)}

{_world(given)}
regulator = zivi.TwistingRegulator({gains}, e={given.e!r}, {_keyword_text(landing_of(given))})
baseline = ExplicitRegulator({gains})

{RUN_BOTH.format(controller="regulator", name="regulator")}"""


def _tracker_script(given: Tracker) -> str:
    gains = f"{given.mu1!r}, {given.mu2!r}, h={given.h!r}, e={given.e!r}"
    reference = (
        f"    y_ref0=({given.x_ref0!r}, {given.xdot_ref0!r}),\n    force_ref={given.force_ref!r},\n"
    )
    baseline, sources = "zivi.ExplicitTwisting", ""
    if given.drawn:
        reference = f"    reference=Drawn({given.heights!r}, {given.t_end!r}),\n"
        baseline = "ExplicitFollower"
        shown = "\n\n".join(inspect.getsource(it) for it in (Drawn, ExplicitFollower))
        sources = f"from zivi import ExplicitTwisting\n\n\n{shown}\n"
    return f"""\
import zivi
{sources}
{_world(given, reference)}
tracker = zivi.TwistingTracker(
    {gains}, branch="{given.branch}", {_keyword_text(landing_of(given))}
)
baseline = {baseline}({gains})

{RUN_BOTH.format(controller="tracker", name="tracking")}"""


RUN_BOTH = """\
implicit = zivi.simulate_closed_loop(plant, {controller}, span, start, **world)
explicit = zivi.simulate_closed_loop(plant, baseline, span, start, **world)

for run in (implicit, explicit):
    print(run)
figure = zivi.plot.overview(implicit)  # figure.savefig("{name}.png")
"""


def _world(given: Regulator | Tracker, reference: str = "") -> str:
    """Write the plant, and everything around it that the controller does not choose."""
    force = f"{given.force!r} + {given.disturbance!r}"
    if given.amplitude:
        sine = f"amplitude={given.amplitude!r}, omega={given.omega!r}"
        force = f"zivi.LinearForce(gravity=-({force}), {sine})"
    observer = "None"
    if given.observer:
        named = _keyword_text(observer_of(given))
        observer = f"zivi.ImpactObserver(\n        {given.e!r}, {given.h!r}, {named}\n    )"
    return f"""\
plant = zivi.ImpactSystem({force}, e={given.e!r})
span, start = (0.0, {given.t_end!r}), ({given.x0!r}, {given.xdot0!r})
world = dict(
{reference}    force_model={given.force!r},  # what the controller knows of the force
    noise=({given.noise_x!r}, {given.noise_xdot!r}),
    seed={given.seed!r},
    delay={given.delay!r},
    observer={observer},
)"""


def _keyword_text(arguments: dict[str, Any]) -> str:
    return ", ".join(f"{name}={value!r}" for name, value in arguments.items())


# Output of the page for settings: figure, numbers and Python code, or a message.


def show_tab(
    settings: Settings,
    preset: Settings,
    part: tuple[float, float],
    columns: int,
    before: dict[type, Any],
) -> Any:
    """Show the result of a tab's controls.

    Parameters
    ----------
    settings : Ball, Regulator, Tracker or Belt
        The settings of a tab.
    preset : Ball, Regulator, Tracker or Belt
        The preset that they began with.
    part : (float, float)
        Start and end of the shown interval (% of the run).
    columns : {3, 2, 1}
        Number of plots in a row.
    before : dict
        What was shown last of each kind of settings; it is brought up to date.

    Returns
    -------
    marimo.Html
        What is seen in a sentence, a figure, its numbers, the motion and the Python; for an
        invalid value the library's message, above what was shown before.
    """
    start = time.perf_counter()
    try:
        runs = simulate_settings(settings)
    except (ValueError, TypeError) as error:
        said = _message(f"Not possible: {error}. Below is what was shown before.")
        return mo.vstack([said, before.get(type(settings), mo.Html(""))])
    window = (settings.t_end * part[0] / 100.0, settings.t_end * part[1] / 100.0)
    drawn = mo.ui.plotly(draw_runs(runs, window, columns), config={"displaylogo": False})
    table = _html_table(facts(runs, window))
    took = f"<small>computed and drawn in {(time.perf_counter() - start) * 1e3:.0f} ms</small>"
    below = mo.hstack([mo.Html(took), _link(settings)], justify="start", gap=2, wrap=True)
    notes = [_message(text) for text in warning_texts(runs)]
    said = " ".join([describe_signs(runs), *end_notices(settings, preset)])
    seen = mo.Html(f"<p>{html.escape(said)}</p>")
    more = mo.accordion({"The motion": mo.Html(film(runs)), CODE: _code(settings)})
    before[type(settings)] = mo.vstack([*notes, seen, drawn, table, below, more])
    return before[type(settings)]


def _message(text: str) -> Any:
    return mo.callout(mo.Html(html.escape(text)), kind="warn")


def _html_table(rows: list[dict[str, str]]) -> Any:
    cell = '<{tag} style="padding: 0.2em 1.2em 0.2em 0; text-align: left">{text}</{tag}>'
    titles = "".join(cell.format(tag="th", text=html.escape(title)) for title in rows[0])
    lines = (
        "".join(cell.format(tag="td", text=html.escape(text)) for text in row.values())
        for row in rows
    )
    rows_of = "</tr><tr>".join([titles, *lines])
    return mo.Html(f'<div style="overflow-x: auto"><table><tr>{rows_of}</tr></table></div>')


CODE = "Python for what is on the screen"


def _code(settings: Settings) -> Any:
    return mo.md(f"```python\n{script(settings)}```")


def _link(settings: Settings) -> Any:
    to = html.escape(query(settings), quote=True)
    return mo.Html(f'<a id="zivi-link" href="{to}"><u>Link to these settings</u></a>')
