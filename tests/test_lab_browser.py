"""The page in a real browser: it loads, sliders move the curves, messages, the Python."""

import dataclasses
import json
import math
import os
import shutil
import time

import numpy as np
import pytest

from inside import KINDS, PRESETS, Ball, Regulator, Tracker, curves, ranges, simulate_settings
from lab_server import PROGRAM, serving

for module in ("marimo", "plotly", "uvicorn"):
    pytest.importorskip(module, reason=f"the lab needs {module} (zivi[lab])")
CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser"))), None)
pytestmark = [
    pytest.mark.browser,
    pytest.mark.xdist_group("lab"),
    pytest.mark.skipif(
        CHROMIUM is None, reason="no chromium on the path (apt-get install chromium)"
    ),
]

WAIT = 60.0
MANY = f"import zivi.lab.server as server; server.MOST_SESSIONS = 100; {PROGRAM}"
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

    def open(self, query=""):
        self.page.goto(self.url + query)
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
        wanted = curves(simulate_settings(settings), window)
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
def served():
    arguments = ["--no-sandbox"] if getattr(os, "geteuid", lambda: 1)() == 0 else []
    playwright = pytest.importorskip(
        "playwright.sync_api", reason="playwright drives the browser (pip install playwright)"
    )
    with serving(MANY) as (_, url), playwright.sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=CHROMIUM, args=arguments)
        try:
            page = browser.new_page()
            page.set_default_timeout(WAIT * 1e3)
            yield Lab(page, url)
        finally:
            browser.close()


@pytest.fixture
def lab(served):
    """The page as it opens; nothing may go wrong in it or come from elsewhere."""
    served.page.set_viewport_size({"width": 1500, "height": 1000})
    served.open()
    soon(served.shows, Ball())
    yield served
    assert served.wrong == []
    assert served.elsewhere == []


def test_it_loads_with_its_tabs_and_draws_the_defaults(lab):
    assert lab.page.title() == "zivi lab"
    assert lab.page.get_by_role("tab").all_text_contents() == [
        "Ball",
        "Regulator",
        "Tracker",
        "Belt",
    ]
    for tab, kind in {"Regulator": Regulator, "Tracker": Tracker, "Ball": Ball}.items():
        lab.choose(tab)
        soon(lab.shows, kind())


def test_every_control_survives_every_round_trip_through_the_tabs(lab):
    tabs = ("Belt", "Ball", "Tracker", "Belt", "Regulator", "Ball", "Regulator", "Tracker", "Ball")
    for tab in tabs:
        lab.choose(tab)
        kind = KINDS[tab]
        soon(lab.shows, kind())
        fields = lab.page.locator("marimo-slider").locator("input:visible")
        wanted = sum("switch" not in it and "options" not in it for it in ranges(kind).values())
        assert fields.count() == wanted, tab
    lab.slider("e, restitution").press("ArrowRight")
    soon(lab.shows, Ball(e=0.51))


def test_a_number_beyond_the_range_is_taken_to_its_end_and_said(lab):
    field = lab.field("gravity (m/s²), -5 to 20")
    field.fill("500")
    field.press("Enter")
    soon(lab.shows, Ball(gravity=20.0))
    lab.page.get_by_text("gravity (m/s²): 20 is an end of its range, -5 to 20").wait_for()


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


def test_gains_in_the_wrong_order_get_the_message_and_the_last_plots_stay(lab):
    lab.choose("Regulator")
    soon(lab.shows, Regulator())
    lab.slider("μ2").press("End")
    said = "Not possible: mu2 must be a gain with 0 < mu2 < mu1 (m/s^2), got 20"
    lab.page.get_by_text(said).wait_for()
    assert lab.shows(Regulator())
    lab.field("μ2").fill("1.5")
    lab.field("μ2").press("Enter")
    soon(lab.shows, Regulator(mu2=1.5))
    assert lab.page.get_by_text("Not possible").count() == 0


def test_sliders_end_at_possible_values(lab):
    thumb = lab.slider("e, restitution")
    thumb.press("End")
    soon(lab.shows, Ball(e=1.0))
    thumb.press("Home")
    soon(lab.shows, Ball(e=0.01))


def test_a_preset_and_back_to_it_while_the_other_tabs_keep_theirs(lab):
    lab.slider("e, restitution").press("ArrowRight")
    soon(lab.shows, Ball(e=0.51))
    lab.choose("Tracker")
    soon(lab.shows, Tracker())
    preset = PRESETS[Tracker]["chattering"]
    lab.page.locator("select:visible").first.select_option(label="chattering")
    soon(lab.shows, preset)
    lab.slider("disturbance").press("ArrowRight")
    soon(lab.shows, dataclasses.replace(preset, disturbance=0.1))
    soon(lambda: preset_of(lab) == "chattering, changed")
    lab.choose("Ball")
    soon(lab.shows, Ball(e=0.51))
    lab.choose("Tracker")
    soon(lab.shows, dataclasses.replace(preset, disturbance=0.1))
    assert preset_of(lab) == "chattering, changed"
    lab.page.get_by_role("button", name="Reset", exact=True).click()
    soon(lab.shows, preset)
    soon(lambda: preset_of(lab) == "chattering")


def preset_of(lab):
    select = lab.page.locator("select:visible").first
    return select.evaluate("it => it.selectedOptions[0].textContent")


def test_switches(lab):
    lab.choose("Tracker")
    soon(lab.shows, Tracker())
    for changed in ({"landing": False}, {"landing": False, "drawn": True}):
        label = "drawn by hand" if "drawn" in changed else "landing"
        switch = lab.page.locator("marimo-switch").filter(has_text=label)
        switch.get_by_role("switch").click()
        soon(lab.shows, Tracker(**changed))


def test_a_link_carries_the_settings(lab):
    lab.choose("Tracker")
    soon(lab.shows, Tracker())
    lab.page.locator("select:visible").last.select_option(label="nearest")
    given = Tracker(branch="nearest")
    soon(lab.shows, given)
    query = lab.page.locator("#zivi-link").get_attribute("href")
    lab.open(query)
    soon(lab.shows, given)
    assert lab.page.get_by_role("tab", name="Tracker").get_attribute("aria-selected") == "true"


def test_the_motion_moves(lab):
    lab.page.get_by_role("button", name="The motion").click()
    ball = lab.page.locator("svg[aria-label='The masses in motion'] circle:visible").first
    ball.wait_for()
    place = "it => it.getBoundingClientRect().top"
    first = ball.evaluate(place)
    soon(lambda: abs(ball.evaluate(place) - first) > 10)
    lab.page.get_by_role("button", name="The motion").click()


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
    lab.page.locator("select:visible").last.select_option(label="nearest")
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
    shown = lab.page.locator("marimo-range-slider").get_by_role("slider")
    for _ in range(5):
        shown.first.press("ArrowRight")
    soon(lab.shows, Ball(), (0.2, 4.0))


INSIDE = """graph => {
    const edge = document.documentElement.clientWidth + 0.5;
    const texts = Array.from(graph.querySelectorAll("text"), it => it.getBoundingClientRect())
        .filter(box => box.width > 0);
    const apart = (a, b) => a.right < b.left + 1 || b.right < a.left + 1 ||
        a.bottom < b.top + 3 || b.bottom < a.top + 3;
    return texts.filter((box, k) => box.left < 0 || box.right > edge ||
        texts.slice(0, k).some(other => !apart(box, other))).length;
}"""


def graph_is_readable(graph):
    return graph.evaluate(INSIDE) == 0


@pytest.mark.parametrize(("width", "height"), [(1280, 720), (900, 700), (420, 900)])
def test_everything_can_be_read_at_every_width(lab, width, height):
    lab.page.set_viewport_size({"width": width, "height": height})
    columns = {1280: 3, 900: 2, 420: 1}[width]
    for tab, kind in {"Ball": Ball, "Tracker": Tracker}.items():
        lab.open(f"?tab={tab}")
        soon(lab.shows, kind())
        graph = lab.page.locator(".js-plotly-plot").first
        lefts = graph.evaluate(
            "it => Object.values(it._fullLayout).filter(a => a?.domain && "
            "a._id?.startsWith('x')).map(a => a.domain[0])"
        )
        assert len(set(lefts)) == columns
        soon(graph_is_readable, graph)
        assert lab.page.evaluate("document.querySelector('#App').scrollWidth") <= width
        tabs = lab.page.get_by_role("tab", name="Ball")
        tabs.click(timeout=5e3)  # nothing lies over it
    if columns < 3:
        lab.page.locator("button:visible").first.click()  # the sidebar lies over a narrow page
    soon(lambda: lab.page.locator("select:visible").count() > 0)
    title = lab.page.get_by_text("zivi lab", exact=True).locator("visible=true").first
    soon(lambda: title.bounding_box() is not None)
    below = title.bounding_box()["y"] + title.bounding_box()["height"]
    assert lab.page.locator("select:visible").first.bounding_box()["y"] - below < 40.0
