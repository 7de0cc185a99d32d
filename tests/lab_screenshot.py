"""Write the picture of docs/lab.md: python tests/lab_screenshot.py docs/figures/lab.png."""

import shutil
import sys

from playwright.sync_api import sync_playwright

from lab_server import serving

SIZE = {"width": 1500, "height": 900}


def main(path):
    with serving() as (_, url), sync_playwright() as driver:
        arguments = {"executable_path": shutil.which("chromium"), "args": ["--no-sandbox"]}
        browser = driver.chromium.launch(**arguments)
        page = browser.new_page(viewport=SIZE)
        page.goto(url)
        page.get_by_role("tab", name="Tracker").click()
        page.get_by_text("reference", exact=True).first.wait_for()
        page.mouse.move(SIZE["width"] / 2, 5)
        page.wait_for_timeout(1000)  # what fades in has faded in
        page.screenshot(path=path)
        browser.close()


if __name__ == "__main__":
    main(sys.argv[1])
