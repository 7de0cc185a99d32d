"""Run an example for its page: what it prints, and its figure. ``%run ../_gallery.py NAME``."""

import os
import subprocess
import sys
import tempfile
from pathlib import Path

from IPython.display import Image, display

EXAMPLES = Path(__file__).parents[1] / "examples"
WIDTH = 110


def show(name: str, *, figure: bool = True) -> None:
    """Run ``examples/NAME.py`` in a process of its own; a failure fails the page.

    Parameters
    ----------
    name : str
        The example.
    figure : bool
        Whether its argument is the file of a figure.
    """
    with tempfile.TemporaryDirectory() as folder:
        picture = Path(folder) / "figure.png"
        done = subprocess.run(
            [sys.executable, EXAMPLES / f"{name}.py", *([picture] if figure else [])],
            env=os.environ | {"COLUMNS": str(WIDTH), "MPLBACKEND": "Agg"},
            capture_output=True,
            text=True,
            check=False,
        )
        if done.returncode:
            raise RuntimeError(f"{name} failed:\n{done.stderr}")
        # the folder's name is of no interest
        print(done.stdout.replace(f"{folder}{os.sep}", "").strip())
        if figure:
            display(Image(picture))


if __name__ == "__main__":
    show(sys.argv[1], figure="--no-figure" not in sys.argv)
