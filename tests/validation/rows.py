"""What a row says, and what the sources say."""

import dataclasses
import json
import math
from pathlib import Path
from typing import Any

import numpy as np

import zivi

SOURCES: dict[str, dict[str, Any]] = json.loads(
    (Path(__file__).parents[1] / "data" / "validation.json").read_text()
)
TIGHT = zivi.SwitchedRK(rtol=1e-13, atol=1e-14)


@dataclasses.dataclass(frozen=True)
class Row:
    """A published value and ours; ``within`` is what the page says of their difference."""

    source: str
    quantity: str
    published: str
    ours: str
    difference: float
    within: float


def link(name: str) -> str:
    """Name a file of a repository, with its commit."""
    at = SOURCES[name]["source"]
    title = at["repository"].split("/")[1]
    url = f"https://github.com/{at['repository']}/blob/{at['commit']}/{at['file']}"
    return f"{title} [{at['file'].split('/')[-1]}]({url})"


def columns(name: str) -> np.ndarray:
    """Give the rows of a source, one array for each of their columns."""
    return np.array(SOURCES[name]["rows"]).T


def series(source: str, quantity: str, published: Any, ours: Any, within: float) -> Row:
    """Compare many values; the row shows a large one of them."""
    one, other = (np.asarray(part, dtype=float).ravel() for part in (published, ours))
    assert one.shape == other.shape
    apart = float(np.abs(one - other).max())
    at = np.argsort(np.abs(one), kind="stable")[9 * one.size // 10]
    decimals = min(10, math.ceil(-math.log10(within)) + 1)
    shown = [f"{part[at]:.{decimals}f}" for part in (one, other)]
    quantity = f"{one.size} {quantity}" if one.size > 1 else quantity
    return Row(source, quantity, *shown, apart, within)
