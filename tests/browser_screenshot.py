"""Write the picture of docs/browser.md: python tests/browser_screenshot.py FILE."""

import shutil
import sys
from pathlib import Path

from playwright.sync_api import sync_playwright

PAGE = Path(__file__).parents[1] / "docs" / "_static" / "browser" / "index.html"


def main(path):
    with sync_playwright() as driver:
        arguments = {"executable_path": shutil.which("chromium"), "args": ["--no-sandbox"]}
        browser = driver.chromium.launch(**arguments)
        page = browser.new_page(viewport={"width": 1280, "height": 680})
        page.goto(PAGE.as_uri())
        page.locator("body[data-ready]").wait_for()
        page.locator("#zoom").check()
        page.screenshot(path=path)
        browser.close()


if __name__ == "__main__":
    main(sys.argv[1])
