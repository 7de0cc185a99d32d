"""What zivi warns of, by name."""

from __future__ import annotations

__all__ = ["ModelWarning"]


class ModelWarning(UserWarning):
    """What a controller believes of the plant is not what the plant is.

    Give the controller no `e` and it takes the plant's; where the difference is meant, to see what
    it does, ``warnings.simplefilter("ignore", zivi.ModelWarning)``.
    """
