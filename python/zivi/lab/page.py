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
def _(controls, settings):
    panels = {
        "Ball": controls.panel(settings.Ball),
        "Regulator": controls.panel(settings.Regulator),
        "Tracker": controls.panel(settings.Tracker),
    }
    ball, regulator, tracker = panels.values()
    return ball, panels, regulator, tracker


@app.cell(hide_code=True)
def _(controls, mo, panels, tabs):
    mo.sidebar(controls.laid_out(panels[tabs.value]), width="21rem")
    return


@app.cell(hide_code=True)
def _(ball, regulator, settings, tabs, tracker, view):
    # names the controls, so that it runs again when one of them moves
    chosen = {
        "Ball": (settings.Ball, ball),
        "Regulator": (settings.Regulator, regulator),
        "Tracker": (settings.Tracker, tracker),
    }
    kind, values = chosen[tabs.value]
    view.shown(kind, values.value)
    return


if __name__ == "__main__":
    app.run()
