"""Write the pictures of docs/lab.md: python tests/lab_screenshot.py docs/figures."""

import sys
from pathlib import Path

from lab_server import serving
from screenshots import browser, save

PICTURES = {
    "lab": (1280, 760, "?tab=Tracker"),
    "lab_middle": (900, 760, "?tab=Regulator"),
    "lab_narrow": (420, 560, "?tab=Ball"),
}
"""Width, height and settings of each."""


def main(folder):
    with serving() as (_, url), browser() as chromium:
        for name, (width, height, query) in PICTURES.items():
            page = chromium.new_page(viewport={"width": width, "height": height})
            page.goto(url + query)
            page.locator(".js-plotly-plot .main-svg").first.wait_for()
            page.mouse.move(width / 2, 5)
            page.wait_for_timeout(1500)  # what fades in has faded in
            save(page, Path(folder) / f"{name}.png")
            page.close()


if __name__ == "__main__":
    main(sys.argv[1])
