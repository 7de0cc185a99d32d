"""The marimo app: controls on the left, what they give on the right. Nothing is computed here."""
# mypy: ignore-errors

import marimo

app = marimo.App(width="full", app_title="zivi lab")


@app.cell(hide_code=True)
def _():
    import marimo as mo

    from zivi.lab import controls, link, presets, view

    return controls, link, mo, presets, view


@app.cell(hide_code=True)
def _(link, mo, presets):
    # what the address asks for; its states are bound to no name, so that nothing runs again
    asked = mo.query_params().to_dict()
    first = link.settings_of(asked)
    columns = int(asked["columns"]) if asked.get("columns") in ("1", "2") else 3
    tabs = mo.ui.tabs(dict.fromkeys(link.KINDS, ""), value=type(first).__name__)
    moves, set_moves = mo.state(0)
    starts, set_starts = mo.state(
        {kind: first if kind is type(first) else kind() for kind in link.KINDS.values()}
    )
    names = {kind: next(iter(presets.PRESETS[kind])) for kind in link.KINDS.values()}
    panels, before = {}, {}
    tabs  # noqa: B018 the output of the cell
    return before, columns, moves, names, panels, set_moves, set_starts, starts, tabs


@app.cell(hide_code=True)
def _(controls, panels, set_moves, starts):
    # all controls are made anew where one tab begins with a preset; the other tabs keep theirs
    panels.update(
        {
            kind: controls.panel(start, lambda _: set_moves(lambda count: count + 1))
            for kind, start in starts().items()
        }
    )
    made = starts()
    return (made,)


@app.cell(hide_code=True)
def _(controls, link, made, mo, names, panels, presets, set_starts, tabs):
    kind = link.KINDS[tabs.value]

    def take(name):
        names[kind] = name
        now = {it: controls.chosen(it, panels[it]) for it in made}
        set_starts(now | {kind: presets.PRESETS[kind][name]})

    choice, reset = controls.presets(kind, names[kind], take)
    mo.sidebar(controls.laid_out(kind, panels[kind], (choice, reset)), width="21rem")
    return (kind,)


@app.cell(hide_code=True)
def _(before, columns, controls, kind, made, moves, panels, view):
    made, moves()  # this cell runs again when a control has moved, or controls were made
    view.shown(
        controls.chosen(kind, panels[kind]), panels[kind][controls.SHOWN].value, columns, before
    )
    return


if __name__ == "__main__":
    app.run()
