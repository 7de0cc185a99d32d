"""The page without Python: its binary, and its runs bit by bit those of the host library."""

import base64
import hashlib
import json
import os
import re
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

from browser_cases import COLUMNS, REGULATOR, SIGNS, cases, differences, native

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs" / "_static" / "browser"
CRATE = ROOT / "crates" / "zivi-wasm"
NODE = shutil.which("node")
pytestmark = pytest.mark.xdist_group("browser page")


def test_the_binary_has_its_hash_and_is_what_a_page_from_a_disk_holds():
    binary = (PAGE / "zivi.wasm").read_bytes()
    assert (PAGE / "zivi.wasm.sha256").read_text().split()[0] == hashlib.sha256(binary).hexdigest()
    encoded = re.search(r'ZIVI_WASM = "(.*)"', (PAGE / "binary.js").read_text())
    assert base64.b64decode(encoded.group(1)) == binary
    assert len(binary) < 30_000


def test_no_label_takes_an_output_and_every_input_has_one():
    text = (PAGE / "index.html").read_text()
    labels = re.findall(r"<label.*?</label>", text, re.DOTALL)
    assert not [it for it in labels if "<output" in it]
    for control in re.findall(r'<(?:input|select)[^>]* id="(\w+)"', text):
        wrapped = any(f'id="{control}"' in it for it in labels)
        assert wrapped or f'<label for="{control}">' in text, control
    script = (PAGE / "page.js").read_text()
    assert "htmlFor: input.id" in script
    assert script.count('"aria-valuetext"') == 2


@pytest.mark.skipif(NODE is None, reason="no node on the path (apt-get install nodejs)")
def test_runs_in_node_are_the_native_ones_bit_by_bit():
    runs = cases()
    done = subprocess.run(
        [NODE, str(ROOT / "tests" / "browser_runs.cjs"), str(PAGE)],
        input=json.dumps(runs).encode(),
        capture_output=True,
        check=True,
        timeout=60,
    )
    names, at = ("t", *COLUMNS, *SIGNS), 0
    values = np.frombuffer(done.stdout)
    for case in runs:
        n = case[3] + 1
        block = values[at : at + len(names) * n].reshape(len(names), n)
        at += block.size
        columns = dict(zip(names, block, strict=True))
        assert differences(case, columns) == [], case
    assert at == values.size


@pytest.fixture(scope="module")
def page():
    """The page, opened from the disk."""
    playwright = pytest.importorskip(
        "playwright.sync_api", reason="playwright drives the browser (pip install playwright)"
    )
    chromium = next(filter(None, map(shutil.which, ("chromium", "chromium-browser"))), None)
    if chromium is None:
        pytest.skip("no chromium on the path (apt-get install chromium)")
    arguments = ["--no-sandbox"] if getattr(os, "geteuid", lambda: 1)() == 0 else []
    with playwright.sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=chromium, args=arguments)
        opened = browser.new_page(viewport={"width": 1280, "height": 720})
        opened.wrong = []
        opened.on("console", lambda said: opened.wrong.append(said.text))
        opened.on("pageerror", lambda error: opened.wrong.append(str(error)))
        opened.on("request", lambda it: it.url.startswith("http") and opened.wrong.append(it.url))
        yield opened
        browser.close()


def visit(page, link=""):
    page.goto("about:blank")
    page.goto((PAGE / "index.html").as_uri() + link)
    page.locator("body[data-ready]").wait_for()
    return page


def facts(page):
    rows = page.locator("#facts tr").all()
    return {row.locator("th").inner_text(): row.locator("td").all_inner_texts() for row in rows}


BYTES = """([system, settings, signs, n]) => {
    const run = model[system](settings, signs, n);
    const all = ["t", ...COLUMNS].flatMap(name => Array.from(new Uint8Array(run[name].buffer)));
    let text = "";
    for (const byte of all) text += String.fromCharCode(byte);
    return btoa(text);
}"""


@pytest.mark.browser
def test_runs_in_chromium_are_the_native_ones_bit_by_bit(page):
    visit(page)
    for system, settings, signs, _ in cases()[::3]:
        case = (system, settings, signs, 400)
        block = np.frombuffer(base64.b64decode(page.evaluate(BYTES, list(case))))
        columns = dict(zip(("t", *COLUMNS, *SIGNS), block.reshape(-1, 401), strict=True))
        assert differences(case, columns) == [], case


@pytest.mark.browser
def test_the_page_shows_what_the_library_computes(page):
    visit(page)
    assert facts(page)["exactly at rest from"] == ["2.444 s", "not within 3 s"]
    assert facts(page)["exact Zeno point"][0] == "2.46585 s"
    page.get_by_role("tab", name="Regulator").click()
    run = native("regulator", REGULATOR, False, 2500)
    moving = np.flatnonzero((run["x"] != 0.0) | (run["xdot"] != 0.0))
    assert facts(page)["exactly at rest from"][0] == f"{run['t'][moving[-1] + 1]:.6g} s"
    page.get_by_role("tab", name="Tracker").click()
    assert facts(page)["the reference's Zeno point, exact"][0] == "1.29304 s"
    page.select_option("#preset", "In the air")
    quiet, loud = facts(page)["changes of u per second, last tenth"]
    assert float(quiet.split()[0]) < 1e-6 < 1e4 < float(loud.split()[0])
    assert page.wrong == []


@pytest.mark.browser
def test_sliders_link_and_film(page):
    visit(page)
    page.locator("input[name=h]").press("End")
    assert page.locator("#preset").input_value() == ""
    assert facts(page)["exactly at rest from"][0] != "2.444 s"
    link = page.evaluate("location.hash")
    shown = facts(visit(page, link))
    assert "h=0.02" in link
    page.locator("#reset").click()
    assert facts(page) != shown
    # what a link asks beyond a slider's end is taken to the end
    visit(page, "#tracker?mu1=20&mu2=90&e=7&h=nonsense")
    assert page.evaluate("[state.settings.mu2, state.settings.e, state.settings.h]") == [
        19.5,
        0.95,
        1e-3,
    ]
    page.locator("#play").click()
    page.wait_for_function("state.time > 0.05")
    page.locator("#play").click()
    assert page.locator("#play").inner_text() == "Play"
    page.locator("#zoom").check()
    assert page.evaluate("state.time >= shown()[0]")
    assert page.wrong == []


NAMED = """() => Array.from(document.querySelectorAll("input, select"), it => [
    it.id || it.name, it.labels.length, it.getAttribute("aria-valuetext")])"""


@pytest.mark.browser
def test_every_control_has_a_name_and_a_value_with_its_unit_and_tabs_have_keys(page):
    for system in ("ball", "regulator", "tracker"):
        visit(page, f"#{system}")
        found = page.evaluate(NAMED)
        assert [name for name, labels, _ in found if labels != 1] == []
        sliders = [text for name, _, text in found if name.startswith("slider-") or name == "time"]
        assert len(sliders) > 5
        assert None not in sliders
    slider = page.get_by_role("slider", name="step h")
    assert slider.get_attribute("aria-valuetext") == "0.001 s"
    page.get_by_role("tab", name="Tracker").focus()
    for key, name in {"ArrowRight": "Ball", "ArrowLeft": "Tracker", "Home": "Ball"}.items():
        page.keyboard.press(key)
        chosen = page.get_by_role("tab", name=name)
        assert chosen.get_attribute("aria-selected") == "true"
        assert chosen.evaluate("it => it === document.activeElement")
    assert page.wrong == []


@pytest.mark.browser
def test_changes_of_the_control_have_their_unit_and_rounding_is_zero(page):
    visit(page, "#tracker")
    for key in ("End", "Home"):
        for slider in page.locator("#sliders input").all():
            slider.press(key)
            changes = facts(page)["changes of u per second, last tenth"]
            speeds = facts(page)["largest |x'|, last tenth"]
            assert all(text.endswith(" m/s\u00b2 per s") for text in changes)
            for text in (*changes, *speeds):
                number = float(text.split()[0])
                assert number == 0.0 or number > 1e-10, text
    assert page.wrong == []


INSIDE = """() => Array.from(document.querySelectorAll("button, select, output, input, canvas, td"))
    .filter(it => it.offsetParent).map(it => it.getBoundingClientRect())
    .every(box => box.left >= 0 && box.right <= innerWidth && box.width > 8 && box.height > 8)"""


@pytest.mark.browser
@pytest.mark.parametrize(("width", "height"), [(1280, 720), (420, 900)])
def test_nothing_sticks_out_at_either_width(page, width, height):
    page.set_viewport_size({"width": width, "height": height})
    for system in ("ball", "regulator", "tracker"):
        visit(page, f"#{system}")
        assert page.evaluate(INSIDE)
        assert page.evaluate("document.documentElement.scrollWidth") <= width
        if width == 1280:
            assert page.evaluate("document.documentElement.scrollHeight") <= height
        drawn = page.evaluate("""() => Array.from(document.querySelectorAll("canvas")).every(it =>
            it.getContext("2d").getImageData(0, 0, it.width, it.height).data.some(v => v > 0))""")
        assert drawn
