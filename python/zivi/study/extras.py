"""Libraries that only studies need, imported when they are."""

import importlib
from typing import Any

__all__ = ["have", "needed"]


def needed(module: str, purpose: str) -> Any:
    """Import a library of the extra `study`; an ImportError says how to get it."""
    try:
        return importlib.import_module(module)
    except ImportError as error:
        library = module.partition(".")[0]
        raise ImportError(
            f"{purpose} need {library}: pip install 'zivi[study]' ({error})", name=library
        ) from error


def have(module: str) -> bool:
    """Whether a library can be imported."""
    try:
        importlib.import_module(module)
    except ImportError:
        return False
    return True
