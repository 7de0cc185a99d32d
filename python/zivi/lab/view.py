"""What the page shows of settings: the figure, the numbers and the Python, or a message."""

from __future__ import annotations

import html
import time
from typing import Any

import marimo as mo

from zivi.lab.facts import facts, warnings
from zivi.lab.figures import figure
from zivi.lab.runs import compute
from zivi.lab.script import script
from zivi.lab.settings import Settings

__all__ = ["shown"]


def shown(kind: type[Settings], values: dict[str, Any]) -> Any:
    """Show what the controls of a tab ask for.

    Parameters
    ----------
    kind : type
        `Ball`, `Regulator` or `Tracker`.
    values : dict
        Values of the controls, by name.

    Returns
    -------
    marimo.Html
        A figure with its numbers and its Python; for an invalid value the library's message.
    """
    settings = kind(**{name: value for name, value in values.items() if name != "shown"})
    start = time.perf_counter()
    try:
        runs = compute(settings)
    except (ValueError, TypeError) as error:
        return _message(f"Not possible: {error}")
    low, high = (settings.t_end * percent / 100.0 for percent in values["shown"])
    drawn = mo.ui.plotly(figure(runs, (low, high)), config={"displaylogo": False})
    table = _table(facts(runs, (low, high)))
    took = f"<small>computed and drawn in {(time.perf_counter() - start) * 1e3:.0f} ms</small>"
    below = mo.hstack([table, mo.Html(took)], justify="start", align="end", gap=2)
    notes = [_message(text) for text in warnings(runs)]
    return mo.vstack([*notes, drawn, below, _code(settings)])


def _message(text: str) -> Any:
    return mo.callout(mo.Html(html.escape(text)), kind="warn")


def _table(rows: list[dict[str, str]]) -> Any:
    cell = '<{tag} style="padding: 0.2em 1.2em 0.2em 0; text-align: left">{text}</{tag}>'
    titles = "".join(cell.format(tag="th", text=html.escape(title)) for title in rows[0])
    lines = (
        "".join(cell.format(tag="td", text=html.escape(text)) for text in row.values())
        for row in rows
    )
    return mo.Html(f"<table><tr>{'</tr><tr>'.join([titles, *lines])}</tr></table>")


def _code(settings: Settings) -> Any:
    code = mo.md(f"```python\n{script(settings)}```")
    return mo.accordion({"Python for what is on the screen": code})
