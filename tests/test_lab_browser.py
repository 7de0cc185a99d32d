"""The page in a real browser: it loads, sliders move the curves, messages, the Python."""

import dataclasses
import json
import math
import os
import shutil
import time

import numpy as np
import pytest

from lab_server import serving
from zivi.lab.figures import curves
from zivi.lab.runs import compute
from zivi.lab.settings import Ball, Regulator, Tracker

for module in ("marimo", "plotly", "uvicorn"):
    pytest.importorskip(module, reason=f"the lab needs {module} (zivi[lab])")
playwright = pytest.importorskip(
    "playwright.sync_api", reason="playwright drives the browser (pip install playwright)"
)
CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser"))), None)
pytestmark = [
    pytest.mark.browser,
    pytest.mark.xdist_group("lab"),
    pytest.mark.skipif(
        CHROMIUM is None, reason="no chromium on the path (apt-get install chromium)"
    ),
]

WAIT = 60.0
LINES = """graph => JSON.stringify((graph._fullData || []).map(line => [
    line.name, line.yaxis, Array.from(line.x, Number), Array.from(line.y, Number)]))"""


class Lab:
    """The page, as its user sees it."""

    def __init__(self, page, url):
        self.page, self.url = page, url
        self.wrong, self.elsewhere = [], []
        page.on("console", lambda said: said.type == "error" and self.wrong.append(said.text))
        page.on("pageerror", lambda error: self.wrong.append(str(error)))
        page.on("request", self._requested)
        page.on("response", lambda r: r.status >= 400 and self.wrong.append(f"{r.status} {r.url}"))

    def _requested(self, request):
        if not request.url.startswith((self.url, self.url.replace("http", "ws"), "data:", "blob:")):
            self.elsewhere.append(request.url)

    def open(self):
        self.page.goto(self.url)
        self.page.locator(".js-plotly-plot .main-svg").first.wait_for(timeout=WAIT * 1e3)

    def choose(self, tab):
        self.page.get_by_role("tab", name=tab).click()

    def slider(self, label):
        return self.page.locator("marimo-slider").filter(has_text=label).get_by_role("slider")

    def field(self, label):
        return self.page.locator("marimo-slider").filter(has_text=label).locator("input:visible")

    def lines(self):
        """Give the lines that plotly draws, as (name, axis, x, y)."""
        graph = self.page.locator(".js-plotly-plot").first
        return [
            (name, axis, numbers(x), numbers(y))
            for name, axis, x, y in json.loads(graph.evaluate(LINES, timeout=WAIT * 1e3))
        ]

    def shows(self, settings, window=None):
        """Whether the drawn lines are those of `settings`."""
        wanted = curves(compute(settings), window)
        drawn = self.lines()
        return [line.look.name for line in wanted] == [line[0] for line in drawn] and all(
            np.array_equal(a, b, equal_nan=True)
            for line, (_, _, x, y) in zip(wanted, drawn, strict=True)
            for a, b in ((line.x, x), (line.y, y))
        )


def numbers(values):
    return np.array([math.nan if value is None else value for value in values])


def soon(holds, *arguments, within=WAIT):
    end = time.monotonic() + within
    while not holds(*arguments):
        assert time.monotonic() < end, f"{holds} did not hold within {within} s"
        time.sleep(0.05)


@pytest.fixture(scope="module")
def lab():
    arguments = ["--no-sandbox"] if getattr(os, "geteuid", lambda: 1)() == 0 else []
    with serving() as (_, url), playwright.sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=CHROMIUM, args=arguments)
        try:
            page = browser.new_page(viewport={"width": 1500, "height": 1000})
            page.set_default_timeout(WAIT * 1e3)
            opened = Lab(page, url)
            opened.open()
            yield opened
        finally:
            browser.close()


def test_it_loads_with_three_tabs_and_draws_the_defaults(lab):
    assert lab.page.title() == "zivi lab"
    assert lab.page.get_by_role("tab").all_text_contents() == ["Ball", "Regulator", "Tracker"]
    for tab, kind in {"Regulator": Regulator, "Tracker": Tracker, "Ball": Ball}.items():
        lab.choose(tab)
        soon(lab.shows, kind())


def test_a_slider_moves_the_curves_by_key_and_while_it_is_dragged(lab):
    before = lab.lines()
    thumb = lab.slider("e, restitution")
    thumb.press("ArrowRight")
    soon(lab.shows, Ball(e=0.51))
    assert not np.array_equal(before[0][3], lab.lines()[0][3])

    box = thumb.bounding_box()
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    lab.page.mouse.move(x, y)
    lab.page.mouse.down()
    lab.page.mouse.move(x + 30, y, steps=5)
    soon(lambda: thumb.get_attribute("aria-valuenow") != "0.51")
    dragged = Ball(e=float(thumb.get_attribute("aria-valuenow")))
    soon(lab.shows, dragged)  # with the button still down
    lab.page.mouse.up()
    assert dragged.e > 0.52


def test_an_invalid_value_gets_the_message_and_a_valid_one_the_curves_again(lab):
    thumb = lab.slider("e, restitution")
    thumb.press("End")
    lab.page.get_by_text("Not possible: e must lie in [0, 1], got 1.1").wait_for()
    assert lab.page.locator(".js-plotly-plot").count() == 0
    thumb.press("Home")
    lab.page.get_by_text("Not possible: e must be > 0 for this scheme").wait_for()
    lab.field("e, restitution").fill("0.7")
    lab.field("e, restitution").press("Enter")
    soon(lab.shows, Ball(e=0.7))
    assert lab.page.get_by_text("Not possible").count() == 0


def test_gains_in_the_wrong_order_get_the_message(lab):
    lab.choose("Regulator")
    soon(lab.shows, Regulator())
    lab.slider("μ2").press("End")
    said = "Not possible: mu2 must be a gain with 0 < mu2 < mu1 (m/s^2), got 20"
    lab.page.get_by_text(said).wait_for()
    lab.slider("μ1").press("Home")
    lab.page.get_by_text("Not possible: mu1 must be a gain > 0").wait_for()


def test_samples_that_are_refused_are_told(lab):
    lab.choose("Tracker")
    soon(lab.shows, Tracker())
    lab.slider("noise of x").press("End")
    lab.page.get_by_text("samples lay too deep behind the wall").first.wait_for()
    lab.slider("noise of x").press("Home")
    soon(lab.shows, Tracker())


def test_the_code_is_shown_and_gives_what_is_drawn(lab):
    lab.choose("Tracker")
    soon(lab.shows, Tracker())
    # both at once: neither may get lost
    lab.slider("disturbance").press("ArrowRight")
    lab.page.locator("select:visible").select_option(label="nearest")
    given = dataclasses.replace(Tracker(), disturbance=0.1, branch="nearest")
    soon(lab.shows, given)
    lab.page.get_by_text("Python for what is on the screen").click()
    code = lab.page.get_by_role("region", name="Python for").locator("pre")
    code.wait_for()
    made = {}
    exec(code.inner_text(), made)
    drawn = {(name, axis): (x, y) for name, axis, x, y in lab.lines()}
    for name in ("implicit", "explicit"):
        t, u = drawn[f"{name} signs", "y4"]
        assert np.array_equal(t, made[name].t)
        assert np.array_equal(u, made[name].u)


def test_a_part_of_the_run_can_be_shown(lab):
    lab.choose("Ball")
    soon(lab.shows, Ball(e=0.7))
    shown = lab.page.locator("marimo-range-slider").get_by_role("slider")
    for _ in range(5):
        shown.first.press("ArrowRight")
    soon(lambda: min(np.nanmin(x) for _, axis, x, _ in lab.lines() if axis == "y") >= 0.2)
    assert lab.shows(Ball(e=0.7), (0.2, 4.0))


def test_nothing_went_wrong_and_nothing_came_from_elsewhere(lab):
    assert lab.wrong == []
    assert lab.elsewhere == []
