"""The site in a browser: nothing sticks out at any width, and the buttons copy."""

import contextlib

import pytest

from test_docs_site import site  # noqa: F401 a fixture

pytest.importorskip("playwright", reason="playwright drives the browser")
from screenshots import browser

pytestmark = [pytest.mark.browser, pytest.mark.xdist_group("site")]

CUT_OFF = """() => {
    const width = document.documentElement.clientWidth;
    const scrolls = it => it && (["auto", "scroll"].includes(getComputedStyle(it).overflowX) ||
        scrolls(it.parentElement));
    const out = Array.from(document.querySelectorAll("article *"))
        .filter(it => it.getBoundingClientRect().right > width + 1 && !scrolls(it));
    const wide = document.documentElement.scrollWidth > width ? [document.documentElement] : [];
    return [...out, ...wide].map(it => `${it.tagName} ${it.textContent.slice(0, 60)}`);
}"""


@pytest.fixture(scope="module")
def chromium():
    with contextlib.ExitStack() as stack:
        yield stack.enter_context(browser())


@pytest.mark.parametrize("width", [1440, 768, 420])
def test_nothing_is_cut_off(site, chromium, width):  # noqa: F811
    page = chromium.new_page(viewport={"width": width, "height": 900})
    for path in sorted(site.rglob("*.html")):
        if "_static" not in path.parts:
            page.goto(path.as_uri())
            assert page.evaluate(CUT_OFF) == [], path.name
    page.close()


UNTOLD = """() => Array.from(document.querySelectorAll("article img"))
    .filter(it => !it.alt || it.alt.endsWith(".png") || it.alt.includes("_images"))
    .map(it => it.src)"""


def test_every_picture_of_a_script_is_told(site, chromium):  # noqa: F811
    page = chromium.new_page()
    for path in [site / "gallery.html", site / "lab.html", *sorted((site / "gallery").glob("*"))]:
        page.goto(path.as_uri())
        assert page.evaluate(UNTOLD) == [], path.name
    page.close()


def test_the_buttons_copy_what_is_typed(site, chromium):  # noqa: F811
    page = chromium.new_page()
    page.goto((site / "gallery" / "programs.html").as_uri())
    first = page.locator("div.highlight-python").first
    first.hover()
    first.get_by_role("button", name="Copy").click()
    first.get_by_role("button", name="Copied").wait_for()
    # what a program prints is nothing to copy
    assert page.locator("div.highlight-text button").count() == 0
    typed = page.evaluate("typed('>>> a = 1\\n>>> for b in c:\\n...     d\\n3\\n')")
    assert typed == "a = 1\nfor b in c:\n    d"
    page.close()
