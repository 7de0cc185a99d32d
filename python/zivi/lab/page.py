"""The marimo app: controls on the left, what they give on the right. Nothing is computed here."""
# mypy: ignore-errors

import marimo

app = marimo.App(width="full", app_title="zivi lab")


@app.cell(hide_code=True)
def _():
    import marimo as mo

    from zivi.lab import controls, settings, view

    return controls, mo, settings, view


@app.cell(hide_code=True)
def _(mo, settings):
    # state from the address; it is not bound to a name, so that no cell runs again
    asked = mo.query_params().to_dict()
    first = settings.read_query(asked)
    columns = int(asked["columns"]) if asked.get("columns") in ("1", "2") else 3
    tabs = mo.ui.tabs(dict.fromkeys(settings.KINDS, ""), value=type(first).__name__)
    moves, set_moves = mo.state(0)
    starts, set_starts = mo.state(
        {kind: first if kind is type(first) else kind() for kind in settings.KINDS.values()}
    )
    # the preset of each tab, and the tabs whose settings differ from it
    names = {kind: settings.preset_name(start) for kind, start in starts().items()}
    changed, set_changed = mo.state(frozenset())
    panels, before = {}, {}
    tabs  # noqa: B018 the output of the cell
    return (
        before,
        changed,
        columns,
        moves,
        names,
        panels,
        set_changed,
        set_moves,
        set_starts,
        starts,
        tabs,
    )


@app.cell(hide_code=True)
def _(controls, panels, set_moves, starts):
    # all controls are created again when a tab starts with a preset; other tabs keep theirs
    panels.update(
        {
            kind: controls.panel(start, lambda _: set_moves(lambda count: count + 1))
            for kind, start in starts().items()
        }
    )
    made = starts()
    return (made,)


@app.cell(hide_code=True)
def _(settings, tabs):
    kind = settings.KINDS[tabs.value]
    return (kind,)


@app.cell(hide_code=True)
def _(changed, controls, kind, made, mo, names, panels, set_starts, settings):
    def take(name):
        names[kind] = name
        now = {it: controls.read_controls(it, panels[it]) for it in made}
        set_starts(now | {kind: settings.PRESETS[kind][name]})

    choice, reset = controls.presets(kind, names[kind], kind in changed(), take)
    mo.sidebar(controls.laid_out(kind, panels[kind], (choice, reset)), width="21rem")
    return


@app.cell(hide_code=True)
def _(
    before,
    changed,
    columns,
    controls,
    kind,
    made,
    moves,
    names,
    panels,
    set_changed,
    settings,
    view,
):
    made, moves()  # this cell runs again when a control has moved, or controls were made
    asks = controls.read_controls(kind, panels[kind])
    preset = settings.PRESETS[kind][names[kind]]
    if (asks != preset) != (kind in changed()):
        set_changed(changed() ^ {kind})
    view.show_tab(asks, preset, panels[kind][controls.SHOWN].value, columns, before)
    return


if __name__ == "__main__":
    app.run()
