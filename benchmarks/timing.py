"""Interleaved repetitions and their medians: on a shared machine only ratios in one run count."""

from __future__ import annotations

import ctypes
import statistics
import time
from collections.abc import Callable
from typing import Any, TypeAlias

Contender: TypeAlias = tuple[Callable[[], Any], Callable[[Any], None]]
"""What is timed, and what puts its result away (not timed)."""


def _give_back_memory() -> None:
    """Return freed memory to the system, so that every repetition pays for fresh pages.

    Without it the allocator keeps what the last contender freed, or not, and one side may get
    pages that the other has already paid for.
    """
    trim = getattr(ctypes.CDLL(None), "malloc_trim", None)
    if trim is not None:
        trim(0)


def interleaved(contenders: dict[str, Contender], repetitions: int) -> dict[str, list[float]]:
    """Time all contenders in turn, `repetitions` times (s), after one round of warming up."""
    times: dict[str, list[float]] = {name: [] for name in contenders}
    for repetition in range(repetitions + 1):
        for name, (run, put_away) in contenders.items():
            _give_back_memory()
            start = time.perf_counter()
            result = run()
            took = time.perf_counter() - start
            put_away(result)
            del result
            if repetition:
                times[name].append(took)
    return times


def medians(times: dict[str, list[float]], per: int) -> dict[str, float]:
    """Median of each contender in ns, divided by the number `per` of steps."""
    return {name: statistics.median(values) / per * 1e9 for name, values in times.items()}


def ratio(times: dict[str, list[float]], of: str, to: str) -> float:
    """Median over the rounds of the ratio of two contenders that ran next to each other."""
    pairs = zip(times[of], times[to], strict=True)
    return statistics.median(a / b for a, b in pairs)


def nothing(_: Any) -> None:
    """Put away a result that frees itself."""
