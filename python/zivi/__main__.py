"""The command ``zivi``, also as ``python -m zivi``."""

import sys

from zivi._extras import needed


def main() -> None:
    """Run the command line; one line and exit code 2 where its libraries are missing."""
    try:
        for library in ("typer", "rich"):
            needed(library, "the commands of zivi")
    except ImportError as error:
        sys.exit(_told(error))
    from zivi.cli import app

    app()


def _told(error: ImportError) -> int:
    print(f"zivi: {error}", file=sys.stderr)
    return 2


if __name__ == "__main__":
    main()
