"""Large sparse problems beside those of ``examples/large_vi.py``: a transport LP, Cournot firms."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import scipy.sparse as sp

sys.path.append(str(Path(__file__).parents[1] / "examples"))
import large_vi

Array = Any


def two_sided(n: int, seed: int = 0) -> large_vi.Linear:
    """Hang a membrane on an `n` x `n` grid under a random load between two obstacles."""
    x, y = large_vi.grid(n)
    middle = np.sin(3 * x) * np.sin(5 * y)
    q = 0.05 * np.random.default_rng(seed).normal(size=n * n)
    return large_vi.Linear(large_vi.laplacian(n), q, middle - 0.05, middle + 0.05)


def transport(k: int, seed: int = 0) -> large_vi.Linear:
    """Pose a linear program of `k` sources and `k` sinks with its prices: skew and degenerate.

    ``min c'x`` with ``sum_j x_ij <= s_i``, ``sum_i x_ij >= d_j``, ``x >= 0``.
    """
    rng = np.random.default_rng(seed)
    leaving = -sp.kron(sp.eye_array(k), np.ones((1, k)))
    A = sp.vstack([leaving, sp.kron(np.ones((1, k)), sp.eye_array(k))])
    demand, costs = rng.uniform(0.5, 1.0, k), rng.uniform(1, 10, k * k)
    supply = np.full(k, 1.2 * demand.sum() / k)
    n = k * k + 2 * k
    M = sp.csr_array(sp.block_array([[None, -A.T], [A, None]]))
    q = np.concatenate([costs, supply, -demand])
    return large_vi.Linear(M, q, np.zeros(n), np.full(n, np.inf))


def cournot(
    firms: int, markets: int, seed: int = 0
) -> tuple[Callable[[Array], Array], Callable[[Array], Any], Array, Array]:
    """Let firms with capacities and convex costs sell to markets with linear prices.

    The unknowns are sales ``x_fm >= 0``, output ``T_f >= 0``, the free total ``Q_m`` of a market,
    and the price ``r_f >= 0`` of a capacity. Returned are the map, its Jacobian, lower bounds, and
    a start.
    """
    rng = np.random.default_rng(seed)
    f, m = firms, markets
    base, slope = rng.uniform(50, 100, m), rng.uniform(0.2, 1.0, m)
    roads, cost = rng.uniform(1, 10, f * m), rng.uniform(5, 20, f)
    size, capacity = rng.uniform(5, 20, f), rng.uniform(20, 80, f)
    by_firm = sp.csr_array(sp.kron(sp.eye_array(f), np.ones((1, m))))
    by_market = sp.csr_array(sp.kron(np.ones((1, f)), sp.eye_array(m)))
    slopes = np.tile(slope, f)
    ends = np.cumsum([f * m, f, m])

    def loss(z: Array) -> Array:
        x, T, Q, r = np.split(z, ends)
        marginal = cost + (np.abs(T) / size) ** 1.5
        price = base - slope * Q
        gain = np.tile(price, f) - slopes * x
        return np.concatenate(
            [by_firm.T @ (marginal + r) + roads - gain, T - by_firm @ x, Q - by_market @ x,
             capacity - T]
        )  # fmt: skip

    def jac(z: Array) -> Any:
        T = z[ends[0] : ends[1]]
        bend = sp.diags_array(1.5 / size * np.sqrt(np.abs(T) / size) * np.sign(T))
        one, none = sp.eye_array(f), None
        return sp.csr_array(
            sp.block_array([
                [sp.diags_array(slopes), by_firm.T @ bend, by_market.T * slope, by_firm.T],
                [-by_firm, one, none, none],
                [-by_market, none, sp.eye_array(m), none],
                [none, -one, none, none],
            ])
        )  # fmt: skip

    lower = np.zeros(f * m + 2 * f + m)
    lower[ends[1] : ends[2]] = -np.inf
    return loss, jac, lower, np.ones(len(lower))
