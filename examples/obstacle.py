"""A membrane over an obstacle: a linear complementarity problem with a few hundred unknowns.

A membrane is fixed at the edge of the unit square, pulled down by its weight, and held up by an
obstacle: -Laplace u + weight >= 0, u >= obstacle, and one of them is tight at every point.

Run as ``python examples/obstacle.py [out.png]``.
"""

import sys

import numpy as np
import scipy.sparse as sp

import zivi

N = 20
"""Inner grid points along a side."""
WEIGHT = 4.0


def laplacian(n: int) -> sp.csr_matrix:
    """Return minus the five-point Laplacian on an n x n grid of the unit square."""
    one = 2 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1)
    unit = sp.eye(n)
    return sp.csr_matrix((sp.kron(one, unit) + sp.kron(unit, one)) * (n + 1) ** 2)


def obstacle(n: int) -> np.ndarray:
    """Height of a round hill and a ridge over the grid, row by row."""
    x, y = np.meshgrid(*2 * [np.arange(1, n + 1) / (n + 1)], indexing="ij")
    hill = 0.2 - 4.0 * ((x - 0.35) ** 2 + (y - 0.4) ** 2)
    ridge = 0.12 - 3.0 * np.abs(x - 0.75) - 0.3 * (y - 0.6) ** 2
    return np.maximum(np.maximum(hill, ridge), -0.4).ravel()


def solve(n: int = N) -> zivi.VIResult:
    """Solve for the heights of the membrane."""
    lower = obstacle(n)
    return zivi.solve_avi(laplacian(n), np.full(n * n, WEIGHT), lower, np.inf)


def main(path: str | None) -> None:
    """Solve, print, and draw if a path is given."""
    result = solve()
    touching = result.x <= obstacle(N)
    print(f"{result.message} {N * N} unknowns, residual {result.residual:.1e}, "
          f"{result.n_pivots} pivots, {touching.sum()} points touch")  # fmt: skip
    if path is None:
        return
    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt

    plt.style.use("zivi.plot.figures")
    figure, (left, right) = plt.subplots(1, 2, figsize=(7.6, 3.3), layout="constrained")
    extent = (0, 1, 0, 1)
    image = left.imshow(result.x.reshape(N, N).T, origin="lower", extent=extent, cmap="cividis")
    figure.colorbar(image, ax=left, label="height $u$ (1)")
    left.contour(
        touching.reshape(N, N).T.astype(float), [0.5], extent=extent, colors="white", linewidths=1
    )
    left.set(xlabel="$x$ (1)", ylabel="$y$ (1)", title="membrane (white: where it touches)")
    row = int(0.4 * (N + 1)) - 1
    grid = np.arange(1, N + 1) / (N + 1)
    right.plot(grid, result.x.reshape(N, N)[:, row], color=zivi.plot.BLUE, label="membrane")
    right.plot(grid, obstacle(N).reshape(N, N)[:, row], "--", color=zivi.plot.ORANGE,
               label="obstacle")  # fmt: skip
    right.set(xlabel="$x$ (1)", ylabel="height (1)", title=f"cut at y = {grid[row]:.2f}")
    right.legend()
    figure.savefig(path, dpi=160)


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else None)
