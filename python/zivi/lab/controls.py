"""The sliders and fields of each tab."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import marimo as mo

from zivi.lab.settings import PRESETS, SECTIONS, Settings, range_text, ranges

SHOWN = "shown"
"""The control of the window that is shown, which is no setting."""
Moved = Callable[[Any], None]


def panel(settings: Settings, moved: Moved) -> dict[str, Any]:
    """Make the controls of a tab.

    Parameters
    ----------
    settings : Ball, Regulator, Tracker or Belt
        What they begin with.
    moved : callable
        What is called when one of them has changed.

    Returns
    -------
    dict
        The elements by the names of the settings. They are no ``marimo.ui.dictionary``: where two
        elements of one change while the page computes, marimo 0.25 forgets the first.
    """
    elements = {
        name: _element(given | {"on_change": moved}, getattr(settings, name))
        for name, given in ranges(type(settings)).items()
    }
    elements[SHOWN] = mo.ui.range_slider(
        start=0.0,
        stop=100.0,
        step=1.0,
        value=[0.0, 100.0],
        label="shown (% of the run)",
        full_width=True,
        on_change=moved,
    )
    return elements


def _element(given: dict[str, Any], value: Any) -> Any:
    if "switch" in given:
        return mo.ui.switch(value, label=given["label"], on_change=given["on_change"])
    if "options" in given:
        return mo.ui.dropdown(**given, value=value, full_width=True)
    label = f"{given['label']}, {range_text(given)}"
    return mo.ui.slider(
        **given | {"label": label}, value=value, include_input=True, full_width=True
    )


def read_controls(kind: type[Settings], elements: dict[str, Any]) -> Settings:
    """Read the settings from the controls of a tab."""
    return kind(**{name: elements[name].value for name in ranges(kind)})


def presets(kind: type[Settings], name: str, changed: bool, take: Moved) -> tuple[Any, Any]:
    """Make the list of presets of a tab, and the button that goes back to the one chosen.

    Parameters
    ----------
    kind : type
        `Ball`, `Regulator`, `Tracker` or `Belt`.
    name : str
        The preset that was chosen last.
    changed : bool
        Whether the settings differ from it, which the list shows instead of its name.
    take : callable
        What is called with the name of a preset.

    Returns
    -------
    tuple of marimo elements
    """
    names = {it: it for it in PRESETS[kind]} | ({f"{name}, changed": name} if changed else {})
    choice = mo.ui.dropdown(
        names,
        value=f"{name}, changed" if changed else name,
        label="preset",
        on_change=take,
        allow_select_none=False,
    )
    return choice, mo.ui.button(label="Reset", on_change=lambda _: take(name))


def laid_out(kind: type[Settings], elements: dict[str, Any], above: tuple[Any, Any]) -> Any:
    """Arrange the controls of a tab in a column, in groups below the presets."""
    rows: list[Any] = [
        mo.Html('<div style="font-size: 1.4em; font-weight: bold">zivi lab</div>'),
        mo.hstack(above, justify="start", align="end", gap=1),
    ]
    for title, group in SECTIONS[kind].items():
        rows.append(mo.Html(f'<div style="font-weight: bold; margin-top: 0.5em">{title}</div>'))
        rows += [elements[name] for name in group]
    # nested one section deeper than the tab before: otherwise the page reuses its sliders, and one
    # that changes from listed steps to even ones fails (marimo 0.25)
    depth = 1 + list(SECTIONS).index(kind)
    inside = mo.vstack([*rows, elements[SHOWN]], gap=0.3)
    return mo.Html("<section>" * depth + str(inside.text) + "</section>" * depth)
