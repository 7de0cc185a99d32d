"""Write pictures of the site at three widths: python tests/site_screenshot.py SITE docs/figures."""

import sys
from pathlib import Path

from screenshots import browser, save

PICTURES = {
    "site_wide": (1440, 800, "tutorial.html"),
    "site_middle": (768, 800, "control.html"),
    "site_narrow": (420, 800, "gallery/programs.html"),
}
"""Width, height and page of each."""


def main(site, folder):
    with browser() as chromium:
        for name, (width, height, page) in PICTURES.items():
            shown = chromium.new_page(viewport={"width": width, "height": height})
            shown.goto((Path(site) / page).resolve().as_uri())
            shown.wait_for_timeout(500)
            save(shown, Path(folder) / f"{name}.png")
            shown.close()


if __name__ == "__main__":
    main(*sys.argv[1:])
