"""Pictures of pages in a browser, small enough to keep."""

import contextlib
import io
import shutil

from PIL import Image
from playwright.sync_api import sync_playwright

COLORS = 128
"""Of a picture that is kept."""


@contextlib.contextmanager
def browser():
    """Give chromium, without a window."""
    path = shutil.which("chromium") or shutil.which("chromium-browser")
    with sync_playwright() as driver:
        chromium = driver.chromium.launch(executable_path=path, args=["--no-sandbox"])
        try:
            yield chromium
        finally:
            chromium.close()


def save(page, path):
    """Write what the window shows of a page."""
    shot = Image.open(io.BytesIO(page.screenshot())).convert("RGB")
    few = shot.quantize(COLORS, method=Image.Quantize.MEDIANCUT, dither=Image.Dither.NONE)
    few.save(path, optimize=True)
    print(path, path.stat().st_size)
