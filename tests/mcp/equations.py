"""Systems of equations (free variables) and problems at the edge of their domain."""

import numpy as np

from .problem import INF, nonlinear

MGH = "More, Garbow & Hillstrom 1981, no. "


def _rosenbrock():
    return nonlinear(
        "mgh_rosen",
        lambda x: np.array([10 * (x[1] - x[0] ** 2), 1 - x[0]]),
        lambda x: np.array([[-20 * x[0], 10], [-1, 0.0]]),
        -INF,
        INF,
        [[-1.2, 1], [-12, 10]],
        MGH + "1",
        [[1, 1]],
    )


def _powell_singular():
    r5, r10 = 5**0.5, 10**0.5

    def F(x):
        a, b, c, d = x
        return np.array([a + 10 * b, r5 * (c - d), (b - 2 * c) ** 2, r10 * (a - d) ** 2])

    def jac(x):
        a, b, c, d = x
        e, g = 2 * (b - 2 * c), 2 * r10 * (a - d)
        return np.array([[1, 10, 0, 0], [0, 0, r5, -r5], [0, e, -2 * e, 0], [g, 0, 0, -g]])

    return nonlinear(
        "mgh_powell_sing",
        F,
        jac,
        -INF,
        INF,
        [[3, -1, 0, 1]],
        MGH + "13: singular at the solution",
        [[0] * 4],
        near=1e-3,
    )


def _powell_badly_scaled():
    def F(x):
        return np.array([1e4 * x[0] * x[1] - 1, np.exp(-x[0]) + np.exp(-x[1]) - 1.0001])

    def jac(x):
        return np.array([[1e4 * x[1], 1e4 * x[0]], [-np.exp(-x[0]), -np.exp(-x[1])]])

    small, large = 1.098159e-5, 9.106146
    return nonlinear(
        "mgh_powell_bad",
        F,
        jac,
        -INF,
        INF,
        [[0, 1]],
        MGH + "3",
        [[small, large], [large, small]],
    )


def _broyden():
    n = 10

    def F(x):
        return (3 - 2 * x) * x - np.r_[0, x[:-1]] - 2 * np.r_[x[1:], 0] + 1

    def jac(x):
        return np.diag(3 - 4 * x) - np.eye(n, k=-1) - 2 * np.eye(n, k=1)

    return nonlinear("mgh_broyden10", F, jac, -INF, INF, [[-1] * n, [-10] * n], MGH + "30")


def problems():
    yield _rosenbrock()
    yield _powell_singular()
    yield _powell_badly_scaled()
    yield _broyden()
    yield nonlinear(
        "atan",
        np.arctan,
        lambda x: np.array([[1 / (1 + x[0] ** 2)]]),
        -INF,
        INF,
        [[2.0], [20.0], [-5]],
        "Dennis & Schnabel 1983: Newton's method diverges for |x| > 1.39",
        [[0]],
    )
    yield nonlinear(
        "logdom",
        lambda x: np.log(x) + x - 1 if x[0] > 0 else np.array([np.nan]),
        lambda x: np.array([[1 / x[0] + 1 if x[0] > 0 else np.nan]]),
        0,
        INF,
        [[5.0], [20.0], [1e-3], [0.0]],
        "made by hand: F undefined on the bound",
        [[1]],
    )
    yield nonlinear(
        "cubic_degenerate",
        lambda x: np.array([x[0] ** 3, x[1] - x[0]]),
        lambda x: np.array([[3 * x[0] ** 2, 0], [-1, 1.0]]),
        0,
        INF,
        [[1, 1], [0, 1], [5, 0]],
        "made by hand: singular and biactive at the solution",
        [[0, 0]],
        near=1.1e-3,
    )
