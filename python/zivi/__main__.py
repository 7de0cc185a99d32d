"""The command ``zivi``, also as ``python -m zivi``."""

import sys

from zivi.base.extras import needed


def main() -> None:
    """Run the command line; one line and exit code 2 where a library or standard output fails."""
    try:
        for library in ("typer", "rich"):
            needed(library, "the commands of zivi")
    except ImportError as error:
        sys.exit(_report(error))
    from zivi.cli import app

    try:
        app()
    except OSError as error:  # what is printed before any command begins
        sys.exit(_report(error))


def _report(error: Exception) -> int:
    print(f"zivi: {error}", file=sys.stderr)
    return 2


if __name__ == "__main__":
    main()
