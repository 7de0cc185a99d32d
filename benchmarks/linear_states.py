"""Exact flights of linear systems beside the embedded pair, up to the tenth rest.

    python benchmarks/linear_states.py

The chains of ``linear_gain.py`` between two stops, both methods at 1e-13: by how much the states
differ at 400 times, and the Zeno times; and by how much one unit in the last place of the load, of
the offsets or of the stiffness moves the exact motion itself.
"""

import numpy as np

import zivi
from linear_gain import chain

RESTS, TIMES = 10, 400
CASES = [(3, 0.5, 8), (3, 0.8, 8), (3, 1.1, 6), (3, 1.7, 4), (20, 0.8, 6), (20, 1.7, 3)]
ULP = 1 + np.finfo(float).eps
EXACT = zivi.SwitchedRK(rtol=1e-13, atol=1e-15)
PAIR = zivi.SwitchedRK(rtol=1e-13, atol=1e-16, flights="rk", max_steps=10**7)


def row(n: int, hertz: float, end: float) -> str:
    """Tell a line of the table."""
    rest = (np.zeros(n), np.zeros(n))

    def run(factors: tuple[float, float, float], method: zivi.SwitchedRK) -> zivi.Trajectory:
        return zivi.simulate(chain(n, hertz, *factors), (0, end), rest, method)

    exact, pair = run((1, 1, 1), EXACT), run((1, 1, 1), PAIR)
    last = min(RESTS, len(exact.zeno)) - 1
    t = np.linspace(0, exact.zeno["t"][last], TIMES)
    others = [run(factors, EXACT) for factors in np.where(np.eye(3), ULP, 1.0)]
    apart = [np.abs(exact(t) - other(t)).max(axis=(1, 2)) for other in (pair, *others)]
    zeno = np.abs(exact.zeno["t"] - pair.zeno["t"])[: last + 1].max()
    condition = np.max(apart[1:], axis=0)
    return (
        f"{n} masses, {hertz} Hz, {last + 1} rests: q {apart[0][0]:.1e}, q' {apart[0][1]:.1e}, "
        f"Zeno times {zeno:.1e}; by a unit in the last place q {condition[0]:.1e}, "
        f"q' {condition[1]:.1e}; impacts {len(exact.resolved_impacts)}, "
        f"rests {len(exact.zeno)} and {len(pair.zeno)}"
    )


if __name__ == "__main__":
    for case in CASES:
        print(row(*case), flush=True)
