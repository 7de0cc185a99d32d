"""What zivi warns of, by name, at the line of the user's that called it."""

from __future__ import annotations

import sys
import warnings
from pathlib import Path

__all__ = ["ModelWarning", "warn"]


class ModelWarning(UserWarning):
    """A model, or a closed loop, is not what it seems to be meant to be.

    A controller believes in another plant than there is, more than a tenth of its updates were
    rejected or saturated, or a constant force takes a mass away for ever. Give the controller no
    `e` and it takes the plant's. Where it is meant, to see what it does,
    ``warnings.simplefilter("ignore", zivi.ModelWarning)``.
    """


PACKAGE = str(Path(__file__).parents[1])


def warn(text: str, category: type[Warning] = ModelWarning) -> None:
    """Warn at the nearest line that is not of this package."""
    level, frame = 2, sys._getframe(1)
    while frame.f_back is not None and frame.f_code.co_filename.startswith(PACKAGE):
        level, frame = level + 1, frame.f_back
    warnings.warn(text, category, stacklevel=level)
