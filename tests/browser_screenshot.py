"""Write the picture of docs/lab.md: python tests/browser_screenshot.py FILE."""

import sys
from pathlib import Path

from screenshots import browser, save

PAGE = Path(__file__).parents[1] / "docs" / "_static" / "browser" / "index.html"


def main(path):
    with browser() as chromium:
        page = chromium.new_page(viewport={"width": 1280, "height": 680})
        page.goto(PAGE.as_uri())
        page.locator("body[data-ready]").wait_for()
        page.locator("#zoom").check()
        save(page, Path(path))


if __name__ == "__main__":
    main(sys.argv[1])
