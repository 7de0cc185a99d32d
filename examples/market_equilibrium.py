"""A spatial price equilibrium as a mixed complementarity problem.

Two regions produce a good at rising marginal cost, two cities buy it at a falling price. Goods
flow from region i to city j only where the city's price pays for production and transport:

    0 <= x_ij   _|_   supply_price_i(sum_j x_ij) + transport_ij - demand_price_j(sum_i x_ij) >= 0

Run as ``python examples/market_equilibrium.py``.
"""

import numpy as np

import zivi

TRANSPORT = np.array([[1.0, 6.0], [5.0, 2.0]])
"""Cost of moving one unit from region i to city j."""


def supply_price(produced: np.ndarray) -> np.ndarray:
    """Return the marginal cost of each region."""
    return np.array([2.0, 3.0]) + np.array([0.5, 0.2]) * produced


def demand_price(bought: np.ndarray) -> np.ndarray:
    """Return what each city pays: it falls like a power of what is bought."""
    return np.array([40.0, 25.0]) / (1.0 + bought) ** np.array([0.6, 0.8])


def losses(x: np.ndarray) -> np.ndarray:
    """Return the loss per unit of each flow: what supply and transport cost less the price."""
    flow = x.reshape(2, 2)
    cost = supply_price(flow.sum(axis=1))[:, None] + TRANSPORT
    return (cost - demand_price(flow.sum(axis=0))[None, :]).ravel()


def main() -> zivi.VIResult:
    """Solve and print the equilibrium."""
    result = zivi.solve_vi(losses, 0.0, np.inf, np.ones(4))
    flow, loss = result.x.reshape(2, 2), result.F.reshape(2, 2)
    print(f"{result.message} residual {result.residual:.1e}, {result.n_iter} iterations")
    for i in range(2):
        for j in range(2):
            print(
                f"region {i} -> city {j}: flow {flow[i, j]:7.4f}, loss per unit {loss[i, j]:7.4f}"
            )
    print("prices in the cities:", demand_price(flow.sum(axis=0)).round(4))
    return result


if __name__ == "__main__":
    main()
