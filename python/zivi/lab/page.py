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
def _(mo):
    tabs = mo.ui.tabs({"Ball": "", "Regulator": "", "Tracker": ""})
    tabs  # noqa: B018 the output of the cell
    return (tabs,)


@app.cell(hide_code=True)
def _(mo):
    moves, set_moves = mo.state(0)
    return moves, set_moves


@app.cell(hide_code=True)
def _(controls, set_moves, settings):
    kinds = {"Ball": settings.Ball, "Regulator": settings.Regulator, "Tracker": settings.Tracker}
    panels = {
        name: controls.panel(kind, lambda _: set_moves(lambda count: count + 1))
        for name, kind in kinds.items()
    }
    return kinds, panels


@app.cell(hide_code=True)
def _(controls, mo, panels, tabs):
    mo.sidebar(controls.laid_out(panels[tabs.value]), width="21rem")
    return


@app.cell(hide_code=True)
def _(kinds, moves, panels, tabs, view):
    moves()  # this cell runs again when a control has moved
    view.shown(
        kinds[tabs.value], {name: element.value for name, element in panels[tabs.value].items()}
    )
    return


if __name__ == "__main__":
    app.run()
