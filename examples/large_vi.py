"""Large sparse variational inequalities: membranes, a bearing, an option, prices, a pile of discs.

Each function returns a matrix, a constant and bounds for `zivi.solve_avi` (the prices a map with
its Jacobian for `zivi.solve_vi`). Run as ``python examples/large_vi.py [out.png]``.
"""

import dataclasses
import sys
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import scipy.sparse as sp

import zivi


class Linear(NamedTuple):
    """``M x + q`` on a box."""

    M: sp.csr_array
    q: np.ndarray
    lower: np.ndarray
    upper: np.ndarray


def second_differences(n: int) -> sp.dia_array:
    """Return minus the second differences of `n` values between two zeros."""
    return sp.diags_array([-1.0, 2.0, -1.0], offsets=[-1, 0, 1], shape=(n, n))


def laplacian(n: int) -> sp.csr_array:
    """Return minus the five-point Laplacian, times the area of a cell, inside an n x n grid."""
    one, unit = second_differences(n), sp.eye_array(n)
    return sp.csr_array(sp.kron(one, unit) + sp.kron(unit, one))


def grid(n: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the inner points of the unit square."""
    x, y = np.meshgrid(*2 * [np.arange(1, n + 1) / (n + 1)], indexing="ij")
    return x.ravel(), y.ravel()


def obstacle(n: int, weight: float = 5.0) -> Linear:
    """Hang a membrane under its weight over a bump: ``-Laplace u + weight >= 0``, ``u >= bump``."""
    x, y = grid(n)
    bump = np.maximum(0.0, 0.3 - 4 * ((x - 0.5) ** 2 + (y - 0.5) ** 2))
    q = np.full(n * n, weight / (n + 1) ** 2)
    return Linear(laplacian(n), q, bump, np.full(n * n, np.inf))


def torsion(n: int, twist: float = 5.0) -> Linear:
    """Twist an elastic-plastic bar: Prandtl's stress function is nowhere steeper than 1."""
    x, y = grid(n)
    distance = np.minimum(np.minimum(x, 1 - x), np.minimum(y, 1 - y))
    return Linear(laplacian(n), np.full(n * n, -twist / (n + 1) ** 2), -distance, distance)


def bearing(n: int, eccentricity: float = 0.1, length: float = 10.0) -> Linear:
    """Lubricate a journal bearing: Reynolds' equation where the pressure is positive.

    ``-div((1 + e cos s)^3 grad p) - e sin s >= 0``, ``p >= 0``, on ``(0, 2 pi) x (0, 2 length)``.
    """
    hx, hy = 2 * np.pi / (n + 1), 2 * length / (n + 1)
    s = np.arange(1, n + 1) * hx

    def film(s: np.ndarray) -> np.ndarray:
        return (1 + eccentricity * np.cos(s)) ** 3

    before, behind = film(s - hx / 2), film(s + hx / 2)
    around = sp.diags_array(
        [-behind[:-1], before + behind, -behind[:-1]], offsets=[-1, 0, 1], shape=(n, n)
    )
    M = sp.kron(around * (hy / hx), sp.eye_array(n))
    M = M + sp.kron(sp.diags_array(film(s) * (hx / hy)), second_differences(n))
    q = np.repeat(-eccentricity * np.sin(s) * hx * hy, n)
    return Linear(sp.csr_array(M), q, np.zeros(n * n), np.full(n * n, np.inf))


def american_put(n: int, step: float = 0.02, rate: float = 0.05, sigma: float = 0.2) -> Linear:
    """Take one implicit step of Black and Scholes' operator back from expiry; the strike is 1.

    ``V/step - L V - payoff/step >= 0``, ``V >= payoff``, for prices up to 4.
    """
    price = np.linspace(0, 4, n + 2)[1:-1]
    h = price[1] - price[0]
    spread, drift = 0.5 * (sigma * price / h) ** 2, rate * price / (2 * h)
    M = sp.diags_array(
        [-(spread - drift)[1:], 1 / step + rate + 2 * spread, -(spread + drift)[:-1]],
        offsets=[-1, 0, 1],
    )
    payoff = np.maximum(1 - price, 0.0)
    q = -payoff / step
    q[0] -= (spread - drift)[0]  # the payoff is 1 at the price 0
    return Linear(sp.csr_array(M), q, payoff, np.full(n, np.inf))


@dataclasses.dataclass(frozen=True)
class Prices:
    """Spatial price equilibrium: `m` regions sell to `k` cities over roads that get crowded.

    The unknowns are flows, prices of the regions, prices of the cities, all at least zero; a road
    is used where ``region + cost(flow) = city``, and nowhere is ``region + cost(flow) < city``.
    """

    m: int
    k: int
    seed: int = 0

    def parts(self) -> tuple[np.ndarray, ...]:
        """Costs of the empty roads, their slopes, supplies and demands."""
        rng = np.random.default_rng(self.seed)
        costs, slopes = rng.uniform(1, 10, self.m * self.k), rng.uniform(0.05, 0.5, self.m * self.k)
        return costs, slopes, rng.uniform(1, 3, self.m), rng.uniform(20, 60, self.k)

    def incidence(self) -> sp.csr_array:
        """Which flows leave a region (-1) and reach a city (1)."""
        leaving = sp.kron(sp.eye_array(self.m), -np.ones((1, self.k)))
        reaching = sp.kron(np.ones((1, self.m)), sp.eye_array(self.k))
        return sp.csr_array(sp.vstack([leaving, reaching]))

    def problem(self) -> tuple[Callable, Callable, np.ndarray]:
        """Return the map, its Jacobian, and a start."""
        costs, slopes, supplies, demands = self.parts()
        A = self.incidence()
        roads, m = self.m * self.k, self.m

        def loss(z: np.ndarray) -> np.ndarray:
            flow, prices = z[:roads], z[roads:]
            cost = costs + slopes * flow + 0.01 * flow**3
            supply = supplies * (prices[:m] + 0.02 * prices[:m] ** 3)
            demand = demands * np.exp(-0.1 * prices[m:])
            return np.append(cost - A.T @ prices, A @ flow + np.append(supply, -demand))

        def jac(z: np.ndarray) -> sp.csr_array:
            flow, prices = z[:roads], z[roads:]
            own = slopes + 0.03 * flow**2
            supply = supplies * (1 + 0.06 * prices[:m] ** 2)
            demand = 0.1 * demands * np.exp(-0.1 * prices[m:])
            corner = sp.diags_array(np.append(supply, demand))
            return sp.csr_array(sp.block_array([[sp.diags_array(own), -A.T], [A, corner]]))

        return loss, jac, np.append(np.zeros(roads), np.ones(m + self.k))


def discs(rows: int, columns: int, seed: int = 0) -> Linear:
    """Contact impulses of a hexagonal pile of discs on a floor between walls, without friction.

    ``W p + v`` are the gap velocities after a step with the impulses ``p >= 0``, ``W = H M^-1 H'``:
    more contacts than degrees of freedom, so that the impulses are not unique and `W` is singular.
    """
    centres = np.array(
        [(i + 0.5 * (j % 2), j * np.sqrt(0.75)) for j in range(rows) for i in range(columns)]
    )
    near = _neighbours(rows, columns)
    normals = centres[near[:, 1]] - centres[near[:, 0]]
    one, other = (2 * near[:, side, None] + [0, 1] for side in (0, 1))
    row = np.tile(np.repeat(np.arange(len(near)), 2), 2)
    between = sp.coo_array(
        (np.append(-normals, normals), (row, np.append(one, other))),
        shape=(len(near), 2 * len(centres)),
    )
    left = columns * np.arange(rows)
    held = np.concatenate([2 * np.arange(columns) + 1, 2 * left, 2 * (left + columns - 1)])
    signs = np.append(np.ones(columns + rows), -np.ones(rows))
    around = sp.coo_array(
        (signs, (np.arange(len(held)), held)), shape=(len(held), 2 * len(centres))
    )
    H = sp.csr_array(sp.vstack([between, around]))
    mass = np.repeat(np.random.default_rng(seed).uniform(1, 2, len(centres)), 2)
    free = np.tile([0.0, -0.1], len(centres))  # what gravity adds in a step
    W = sp.csr_array(H @ sp.diags_array(1 / mass) @ H.T)
    n = len(W.indptr) - 1
    return Linear(W, H @ free, np.zeros(n), np.full(n, np.inf))


def _neighbours(rows: int, columns: int) -> np.ndarray:
    """Return the pairs of discs that touch."""
    pairs = []
    for j in range(rows):
        for i in range(columns):
            here = j * columns + i
            if i + 1 < columns:
                pairs.append((here, here + 1))
            shift = j % 2
            for k in (i - 1 + shift, i + shift):
                if j + 1 < rows and 0 <= k < columns:
                    pairs.append((here, (j + 1) * columns + k))
    return np.array(pairs)


def finer(u: np.ndarray, n: int) -> np.ndarray:
    """Interpolate values inside a square grid, zero around it, on one with `n` points a side."""
    side = int(np.sqrt(len(u)))
    values = np.pad(u.reshape(side, side), 1)
    ticks = np.arange(1, n + 1) / (n + 1) * (side + 1)
    low = np.minimum(ticks.astype(int), side)
    t = ticks - low
    along = values[low] * (1 - t)[:, None] + values[low + 1] * t[:, None]
    return (along[:, low] * (1 - t) + along[:, low + 1] * t).ravel()


def smooth(problem: Linear, u: np.ndarray, sweeps: int = 30) -> np.ndarray:
    """Sweep over the grid by Jacobi's method in the box: the kinks of interpolation go."""
    M, q, lower, upper = problem
    diagonal = M.diagonal()
    for _ in range(sweeps):
        u = np.clip(u - 0.7 * (M @ u + q) / diagonal, lower, upper)
    return u


def cascade(problem: Callable[[int], Linear], sides: list[int]) -> list[zivi.VIResult]:
    """Solve on finer and finer grids, each from the solution on the one before, smoothed."""
    results: list[zivi.VIResult] = []
    for n in sides:
        fine = problem(n)
        start = smooth(fine, finer(results[-1].x, n)) if results else None
        results.append(zivi.solve_avi(*fine, start))
    return results


def main(path: str | None, n: int = 60) -> None:
    """Solve all, print the work, and draw if a path is given."""
    problems = {
        "membrane on a bump": obstacle(n),
        "plastic zones of a twisted bar": torsion(n, 8.0),
        "pressure in a journal bearing": bearing(n),
        "American put before expiry": american_put(20 * n, step=0.5),
        "pile of discs": discs(n // 4, n // 4),
    }
    results = {name: zivi.solve_avi(*problem) for name, problem in problems.items()}
    market = Prices(n // 3, n // 3)
    loss, jac, start = market.problem()
    results["flows between regions and cities"] = zivi.solve_ncp(loss, start, jac=jac)
    for name, res in results.items():
        print(f"{name}: {len(res.x)} unknowns, {res.n_factorisations} factorisations, "
              f"residual {res.residual:.0e}")  # fmt: skip
    if path is not None:
        draw(path, n, problems, results)


def draw(path: str, n: int, problems: dict[str, Linear], results: dict[str, zivi.VIResult]) -> None:
    """Draw the six solutions."""
    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt

    plt.style.use("zivi.plot.figures")
    figure, axes = plt.subplots(2, 3, figsize=(9.6, 5.6), layout="constrained")
    for ax, (name, res) in zip(axes.flat, results.items(), strict=True):
        ax.set_title(name, fontsize=9, loc="left")
        p = problems.get(name)
        if name.startswith("American"):
            price = np.linspace(0, 4, len(res.x) + 2)[1:-1]
            ax.plot(price, res.x, color=zivi.plot.BLUE, label="value")
            ax.plot(price, p.lower, "--", color=zivi.plot.ORANGE, label="payoff")
            ax.set(xlabel="price (strike)", ylabel="value (strike)", xlim=(0.5, 1.5), ylim=(0, 0.5))
            ax.legend()
        elif name.startswith("pile"):
            ax.hist(res.x, 30, color=zivi.plot.BLUE)
            ax.set(xlabel="impulse", ylabel="contacts")
        elif name.startswith("flows"):
            flows = res.x[: (n // 3) ** 2].reshape(n // 3, -1)
            image = ax.imshow(flows, aspect="auto", cmap="cividis")
            figure.colorbar(image, ax=ax, label="flow")
            ax.set(xlabel="city", ylabel="region")
        else:
            values, active = res.x.reshape(n, n).T, (res.x <= p.lower) | (res.x >= p.upper)
            image = ax.imshow(values, origin="lower", aspect="auto", cmap="cividis")
            figure.colorbar(image, ax=ax, label="solution (1)")
            active = active.reshape(n, n).T.astype(float)
            ax.contour(active, [0.5], colors="white", linewidths=1)
            ax.set(xlabel="cell", ylabel="cell")
    figure.savefig(path, dpi=110)


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else None)
