"""The scripts of the examples as modules."""

import functools
import importlib.util
import sys
from pathlib import Path

from generated import gallery_page

ROOT = Path(__file__).parents[1]


@functools.cache
def example(name):
    """Run a script up to its definitions, once for all tests of a process."""
    spec = importlib.util.spec_from_file_location(name, ROOT / "examples" / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    spec.loader.exec_module(module)
    return module


def shown(name):
    """Text above the script on its page, in one line."""
    return " ".join(gallery_page(name).partition("## The script")[0].split())
