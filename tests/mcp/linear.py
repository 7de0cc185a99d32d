"""Affine problems: LCPs, obstacle problems, equilibria of bimatrix games and networks."""

import numpy as np

from .problem import INF, affine


def _exponential_for_pivoting():
    for n in (8, 16):
        upper = np.eye(n) + 2 * np.triu(np.ones((n, n)), 1)
        starts = [np.zeros(n), np.ones(n)]
        yield affine(
            f"murty{n}",
            upper,
            -np.ones(n),
            0,
            INF,
            starts,
            "Murty 1988, chapter 6",
            [np.eye(n)[-1]],
        )
        i = np.arange(n)
        fathi = 4.0 * np.minimum.outer(i, i) + 2
        fathi[i, i] = 4 * i + 1
        yield affine(f"fathi{n}", fathi, -np.ones(n), 0, INF, starts, "Fathi 1979", [np.eye(n)[0]])


def _knapsack():
    """0-1 knapsack with weights 3, 5, 7, 11 and capacity 16 as an LCP."""
    weights, capacity = np.array([3.0, 5, 7, 11]), 16
    M = np.zeros((6, 6))
    M[:4, :4] = -np.eye(4)
    M[4, :4], M[4, 4] = 1, -1
    M[5, :4], M[5, 5] = -1, -1
    return affine(
        "chung6",
        M,
        np.r_[weights, -capacity, capacity],
        0,
        INF,
        [np.zeros(6), np.ones(6), [3, 5, 7, 11, 0, 0]],
        "Chung 1989",
        [[0, 5, 0, 11, 0, 0]],
    )


def _tridiagonal(n, below, diagonal, above):
    return diagonal * np.eye(n) + below * np.eye(n, k=-1) + above * np.eye(n, k=1)


def _small_lcps():
    yield affine(
        "cycle3",
        [[1, 2, 0], [0, 1, 2], [2, 0, 1]],
        [-1] * 3,
        0,
        INF,
        [[0] * 3, [1, 0, 0], [1, 1, 1]],
        "Murty 1988: principal pivoting and Newton-min cycle",
        [[1 / 3] * 3],
    )
    n = 64
    starts = [np.zeros(n), np.ones(n)]
    yield affine("ahn64", _tridiagonal(n, 1, 4, -2), -np.ones(n), 0, INF, starts, "Ahn 1983")
    yield affine(
        "geigerkanzow64",
        _tridiagonal(n, -1, 4, -1),
        -np.ones(n),
        0,
        INF,
        starts,
        "Geiger & Kanzow 1996",
    )
    yield affine(
        "pathmanual4",
        [[0, 0, -1, -1], [0, 0, 1, -2], [1, -1, 2, -2], [1, 2, -2, 4]],
        [2, 2, -2, -6],
        0,
        INF,
        [[0] * 4, [1] * 4, [10] * 4],
        "the example LCP of PATH's C interface",
        [[2.8, 0, 0.8, 1.2]],
    )


def _bimatrix(A, B):
    """The LCP of Lemke & Howson 1964 for costs A, B."""
    m, n = A.shape
    return np.block([[np.zeros((m, m)), A], [B.T, np.zeros((n, n))]])


def _games():
    A = np.array([[2, 3, 1], [1, 2, 3], [3, 1, 2.0]])
    yield affine(
        "rps6",
        _bimatrix(A, 4 - A),
        -np.ones(6),
        0,
        INF,
        [np.zeros(6), np.ones(6)],
        "Lemke & Howson 1964 on rock, paper, scissors",
        [np.full(6, 1 / 6)],
    )
    yield affine(
        "battle4",
        _bimatrix(np.array([[1, 3], [3, 2.0]]), np.array([[2, 3], [3, 1.0]])),
        -np.ones(4),
        0,
        INF,
        [[0] * 4, [1] * 4, [1, 0, 1, 0]],
        "Lemke & Howson 1964 on the battle of the sexes: three equilibria",
        [[0.5, 0, 1, 0], [0, 1, 0, 0.5], [2 / 7, 1 / 7, 1 / 7, 2 / 7]],
    )


def laplacian(m):
    """Five-point Laplacian on an m x m grid of the unit square, spacing 1/(m + 1)."""
    T = _tridiagonal(m, -1, 2, -1)
    return (np.kron(T, np.eye(m)) + np.kron(np.eye(m), T)) * (m + 1) ** 2


def _grid(m):
    ticks = np.arange(1, m + 1) / (m + 1)
    return np.meshgrid(ticks, ticks, indexing="ij")


def _membranes():
    m = 10
    X, Y = _grid(m)
    hill = np.maximum(0, 0.3 - 4 * ((X - 0.5) ** 2 + (Y - 0.5) ** 2)).ravel()
    yield affine(
        "obstacle100",
        laplacian(m),
        np.full(m * m, 5.0),
        hill,
        INF,
        [hill, hill + 1, np.zeros(m * m)],
        "membrane over an obstacle (Glowinski 1984; More & Toraldo 1991)",
    )
    distance = np.minimum(np.minimum(X, 1 - X), np.minimum(Y, 1 - Y)).ravel()
    yield affine(
        "torsion100",
        laplacian(m),
        np.full(m * m, -10.0),
        -distance,
        distance,
        [np.zeros(m * m), distance, -distance],
        "elastic-plastic torsion (Glowinski 1984; MINPACK-2)",
    )
    n = 20
    yield affine(
        "string20",
        _tridiagonal(n, -1, 2, -1) * (n + 1) ** 2,
        np.full(n, 8.0),
        -0.25,
        INF,
        [np.zeros(n), np.full(n, -0.25)],
        "string over a flat obstacle (Kinderlehrer & Stampacchia 1980)",
    )


def _boxes():
    yield affine(
        "sic2",
        [[2, 1], [1, 2]],
        [-5, -6],
        -1,
        1,
        [[0, 0], [1, -1]],
        "vi_function_2D of Siconos' tests",
        [[1, 1]],
    )
    yield affine(
        "sic3",
        [[0, -1, 2], [2, 0, -2], [-1, 1, 0]],
        [-3, 6, -1],
        -1,
        1,
        [[0] * 3, [1, 1, -1]],
        "vi_function_3D of Siconos' tests; two of the solutions by pattern enumeration",
        [[-1, -1, 1], [0, -1, 1], [1, -1, 1]],
    )
    yield affine(
        "free_saddle",
        [[2, 0, 1], [0, 2, 1], [-1, -1, 0]],
        [-2, -5, 1],
        -INF,
        INF,
        [[0] * 3, [5, 5, -3]],
        "equality-constrained quadratic program (form of Nocedal & Wright, chapter 16)",
        [[-0.25, 1.25, 2.5]],
    )
    yield affine(
        "fixedvar",
        [[2, 1, 0], [1, 2, 1], [0, 1, 2]],
        [-4, 0, -1],
        [0, 1, 0],
        [INF, 1, INF],
        [[0, 1, 0], [5, 7, 5]],
        "made by hand: lower = upper, and F_3 = 0 at x_3 = 0",
        [[1.5, 1, 0]],
    )


def _transport():
    """Dantzig's two plants and three markets: shipments, then prices of supply and demand."""
    cost = 0.09 * np.array([[2.5, 1.7, 1.8], [2.5, 1.8, 1.4]])
    supply, demand = np.array([350, 600.0]), np.array([325, 300, 275.0])
    M, q = np.zeros((11, 11)), np.r_[cost.ravel(), supply, -demand]
    for plant in range(2):
        for market in range(3):
            k = 3 * plant + market
            M[k, 6 + plant], M[6 + plant, k] = 1, -1
            M[k, 8 + market], M[8 + market, k] = -1, 1
    return affine(
        "transmcp",
        M,
        q,
        0,
        INF,
        [np.zeros(11), np.ones(11)],
        "Dantzig 1963; transmcp of GAMS, cost 153.675",
        accepts=lambda x: abs(cost.ravel() @ x[:6] - 153.675) < 1e-3,
    )


def _braess():
    """Six travellers on five links, three paths; the fourth unknown is the travel time."""
    links = np.array([[1, 0, 1], [0, 1, 0], [1, 0, 0], [0, 1, 1], [0, 0, 1.0]])
    slope, free_time = np.diag([10, 1, 1, 10, 1.0]), np.array([0, 50, 50, 0, 10.0])
    M = np.zeros((4, 4))
    M[:3, :3], M[:3, 3], M[3, :3] = links.T @ slope @ links, -1, 1
    return affine(
        "braess",
        M,
        np.r_[links.T @ free_time, -6],
        [0, 0, 0, -INF],
        INF,
        [[0] * 4, [6, 0, 0, 0], [1, 1, 1, 100]],
        "Braess 1968",
        [[2, 2, 2, 92]],
    )


def _control():
    """Double integrator, |u| <= 1, to a target just beyond reach in the time 2."""
    N = 40
    dt = 2.0 / N
    k = np.arange(N)
    B = np.array([dt * (N - k - 0.5) * dt, np.full(N, dt)])
    return affine(
        "bangbang40",
        B.T @ B + 1e-4 * np.eye(N),
        -B.T @ np.array([1.05, 0.0]),
        -1,
        1,
        [np.zeros(N), np.ones(N)],
        "form of Bryson & Ho 1975",
    )


def problems():
    yield from _exponential_for_pivoting()
    yield _knapsack()
    yield from _small_lcps()
    yield from _games()
    yield from _membranes()
    yield from _boxes()
    yield _transport()
    yield _braess()
    yield _control()
    yield affine(
        "nosol_lcp",
        [[0, 0], [1, 1]],
        [-1, 1],
        0,
        INF,
        [[0, 0], [1, 1]],
        "F_1 = -1 everywhere",
        solvable=False,
    )
