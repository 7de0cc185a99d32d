"""The command ``zivi``, also as ``python -m zivi``."""

import sys

from zivi.base.extras import have


def main() -> None:
    """Run the command line; one line and exit code 2 where a library or standard output fails."""
    missing = [library for library in ("typer", "rich") if not have(library)]
    if missing:
        need = f"the commands of zivi need {', '.join(missing)}: pip install 'zivi[cli]'"
        sys.exit(_report(ImportError(need)))
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
