"""``python -m zivi`` is the command ``zivi``."""

from zivi.cli import app

if __name__ == "__main__":
    app(prog_name="zivi")
