"""What SciPy does when a precaution of the script is left out: bounded runs."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator
from typing import Any

import scipy_events
from methods_counts import follow, switched
from methods_problems import Problem

TOL = 1e-10


@dataclasses.dataclass(frozen=True)
class Row:
    """One variant and its end."""

    variant: str
    problem: str
    events: str
    """Events that advanced the time."""
    reached: str
    x: str
    what: str


def _unguarded(ball: Problem) -> Iterator[Row]:
    variants: dict[str, dict[str, Any]] = {
        "no guard": {},
        "no guard, x left as the event found it": {"put_on_wall": False},
        "direction of the event left at its default, 0": {"direction": 0.0},
        "the same, x left as the event found it": {"direction": 0.0, "put_on_wall": False},
        "event not terminal, one call": {"terminal": False},
    }
    for name, settings in variants.items():
        end = scipy_events.careless(ball, TOL, **settings)
        if end.finished:
            what = "**through the floor**" if end.x < 0.0 else "done"
        else:
            what = f"**stuck**: {end.standing} restarts in a row without advance, then cut off"
        true = end.events - end.standing
        reached = f"{end.t:.9g}" + ("" if end.finished else " (cut off)")
        yield Row(name, ball.key, str(true), reached, f"{end.x:.3g}", what)


def _guarded(ball: Problem) -> Iterator[Row]:
    assert ball.rest is not None
    for guard in (1e-3, 1e-6, 1e-9):
        end = scipy_events.follow(ball, TOL, guard=guard)
        assert end.rest is not None
        what = f"rest {ball.rest - end.rest:.1e} s early"
        name = f"guard: rest where the speed is below {guard:g} m/s"
        yield Row(name, ball.key, str(end.impacts), f"{end.t:g}", f"{end.x:.3g}", what)


def _uncapped(table: Problem) -> Row:
    end = scipy_events.follow(table, TOL, cap=math.inf)
    true = len(follow(table, switched(8, TOL)).impacts)
    what = f"**impacts missed**, there are {true}"
    name = "half of the predicted arc not watched, however long"
    assert end.impacts < true
    return Row(name, table.key, str(end.impacts), f"{end.t:.4g}", f"{end.x:.3g}", what)


def _ours(ball: Problem) -> Row:
    sol = follow(ball, switched(8, TOL))
    assert ball.rest is not None
    off = abs(sol.rest_time - ball.rest)
    what = f"rest found to {off:.0e} s" if off else "rest found exactly"
    return Row("zivi.SwitchedRK", ball.key, str(len(sol.impacts)), f"{sol.t[-1]:g}", "0", what)


def rows(ball: Problem, table: Problem) -> list[Row]:
    """Run all variants."""
    return [*_unguarded(ball), _uncapped(table), *_guarded(ball), _ours(ball)]
