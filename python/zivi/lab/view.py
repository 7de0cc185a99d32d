"""What the page shows of settings: the figure, the numbers and the Python, or a message."""

from __future__ import annotations

import html
import time
from typing import Any

import marimo as mo

from zivi.lab.animation import film
from zivi.lab.facts import facts, warnings
from zivi.lab.figures import figure
from zivi.lab.link import query
from zivi.lab.messages import sentence
from zivi.lab.ranges import ends
from zivi.lab.runs import compute
from zivi.lab.script import script
from zivi.lab.settings import Settings

__all__ = ["shown"]


def shown(
    settings: Settings,
    preset: Settings,
    part: tuple[float, float],
    columns: int,
    before: dict[type, Any],
) -> Any:
    """Show what the controls of a tab ask for.

    Parameters
    ----------
    settings : Ball, Regulator, Tracker or Belt
        The settings of a tab.
    preset : Ball, Regulator, Tracker or Belt
        The preset that they began with.
    part : (float, float)
        Beginning and end of what is shown (% of the run).
    columns : {3, 2, 1}
        How many plots stand beside each other.
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
        runs = compute(settings)
    except (ValueError, TypeError) as error:
        said = _message(f"Not possible: {error}. Below is what was shown before.")
        return mo.vstack([said, before.get(type(settings), mo.Html(""))])
    window = (settings.t_end * part[0] / 100.0, settings.t_end * part[1] / 100.0)
    drawn = mo.ui.plotly(figure(runs, window, columns), config={"displaylogo": False})
    table = _table(facts(runs, window))
    took = f"<small>computed and drawn in {(time.perf_counter() - start) * 1e3:.0f} ms</small>"
    below = mo.hstack([mo.Html(took), _link(settings)], justify="start", gap=2, wrap=True)
    notes = [_message(text) for text in warnings(runs)]
    said = " ".join([sentence(runs), *ends(settings, preset)])
    seen = mo.Html(f"<p>{html.escape(said)}</p>")
    more = mo.accordion({"The motion": mo.Html(film(runs)), CODE: _code(settings)})
    before[type(settings)] = mo.vstack([*notes, seen, drawn, table, below, more])
    return before[type(settings)]


def _message(text: str) -> Any:
    return mo.callout(mo.Html(html.escape(text)), kind="warn")


def _table(rows: list[dict[str, str]]) -> Any:
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
