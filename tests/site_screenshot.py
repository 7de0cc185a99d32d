"""Write pictures of every page of the site at three widths, to look at.

python tests/site_screenshot.py out/site out/pages [NAME ...]
"""

import sys
from pathlib import Path

from screenshots import browser

WIDTHS = 1440, 768, 420


def main(site, folder, *names):
    """Take whole pages, all of them or those of some names."""
    out = Path(folder)
    out.mkdir(parents=True, exist_ok=True)
    pages = [it for it in sorted(Path(site).rglob("*.html")) if "_static" not in it.parts]
    with browser() as chromium:
        for width in WIDTHS:
            shown = chromium.new_page(viewport={"width": width, "height": 900})
            for path in pages:
                if names and path.stem not in names:
                    continue
                shown.goto(path.resolve().as_uri())
                name = "-".join(path.relative_to(site).with_suffix("").parts)
                shown.screenshot(path=out / f"{name}_{width}.png", full_page=True)
            shown.close()
    print(f"{out}: {len(list(out.glob('*.png')))} pictures")


if __name__ == "__main__":
    main(*sys.argv[1:])
