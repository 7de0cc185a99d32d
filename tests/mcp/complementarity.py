"""Nonlinear complementarity problems, market and game equilibria."""

import numpy as np

from .problem import INF, nonlinear

UNIT = np.eye


def _kojima_shindo_family(c23, c34, c3):
    """The quadratic map that Kojima-Shindo and Josephy share; they differ in three coefficients."""

    def F(x):
        a, b, c, d = x
        return np.array(
            [
                3 * a * a + 2 * a * b + 2 * b * b + c + 3 * d - 6,
                2 * a * a + a + b * b + c23 * c + 2 * d - 2,
                3 * a * a + a * b + 2 * b * b + 2 * c + c34 * d - c3,
                a * a + 3 * b * b + 2 * c + 3 * d - 3,
            ]
        )

    def jac(x):
        a, b, _, _ = x
        return np.array(
            [
                [6 * a + 2 * b, 2 * a + 4 * b, 1, 3],
                [4 * a + 1, 2 * b, c23, 2],
                [6 * a + b, a + 4 * b, 2, c34],
                [2 * a, 6 * b, 2, 3],
            ],
            float,
        )

    return F, jac


def _quadratic_problems():
    starts = [[0] * 4, [1] * 4, [100] * 4, [1, 0, 1, 0], [1, 0, 0, 0], [0, 1, 1, 0]]
    degenerate = [np.sqrt(6) / 2, 0, 0, 0.5]
    yield nonlinear(
        "kojshin",
        *_kojima_shindo_family(10, 9, 9),
        0,
        INF,
        starts,
        "Kojima & Shindo 1986; kojshin of MCPLIB (Dirkse & Ferris 1995)",
        [degenerate, [1, 0, 3, 0]],
    )
    yield nonlinear(
        "josephy",
        *_kojima_shindo_family(3, 3, 1),
        0,
        INF,
        starts,
        "Josephy 1979; josephy of MCPLIB",
        [degenerate],
    )
    yield nonlinear(
        "billups",
        lambda x: (x - 1) ** 2 - 1.01,
        lambda x: np.array([[2 * (x[0] - 1)]]),
        0,
        INF,
        [[0.0], [1.0], [0.5], [3.0]],
        "Billups 1995, PhD thesis; billups of MCPLIB",
        [[1 + np.sqrt(1.01)]],
    )


def _mathiesen():
    def F(x):
        a, b, c, d = x
        return np.array(
            [
                -b + c + d,
                a - (4.5 * c + 2.7 * d) / (b + 1),
                5 - a - (0.5 * c + 0.3 * d) / (c + 1),
                3 - a,
            ]
        )

    def jac(x):
        _, b, c, d = x
        p, r = b + 1, c + 1
        return np.array(
            [
                [0, -1, 1, 1],
                [1, (4.5 * c + 2.7 * d) / p**2, -4.5 / p, -2.7 / p],
                [-1, 0, -0.5 / r + (0.5 * c + 0.3 * d) / r**2, -0.3 / r],
                [-1, 0, 0, 0],
            ]
        )

    return nonlinear(
        "mathiesen4",
        F,
        jac,
        0,
        INF,
        [[1] * 4, [0] * 4, [0.1] * 4, [1, 0, 1, 0], [10] * 4],
        "Mathiesen 1987, as in Pang & Gabriel 1993",
        accepts=lambda x: -1e-6 <= x[0] <= 3 + 1e-6 and np.max(np.abs(x[1:])) < 1e-5,
    )


def _watson():
    centre = np.arange(-1.0, 4.0)

    def F(x):
        d = x - centre
        return 2 * d * np.exp(d @ d)

    def jac(x):
        d = x - centre
        e = np.exp(d @ d)
        return 2 * e * UNIT(5) + 4 * e * np.outer(d, d)

    return nonlinear(
        "watson4",
        F,
        jac,
        0,
        INF,
        [[0] * 5, [1] * 5, [2] * 5],
        "Watson 1979, problem 4",
        [[0, 0, 1, 2, 3]],
    )


def _cournot(cost, scale, beta, gamma):
    """Marginal cost minus marginal revenue under the demand p(Q) = (5000/Q)^(1/gamma)."""
    cost, beta = np.array(cost, float), np.array(beta, float)
    n = len(cost)

    def price(Q):
        p = (5000 / Q) ** (1 / gamma)
        return p, -p / (gamma * Q), p * (1 / gamma) * (1 / gamma + 1) / Q**2

    def F(q):
        p, slope, _ = price(q.sum())
        return cost + scale(beta) * np.abs(q) ** (1 / beta) - p - q * slope

    def jac(q):
        _, slope, curvature = price(q.sum())
        own = scale(beta) / beta * np.abs(q) ** (1 / beta - 1) - slope
        return np.diag(own) - (slope + q * curvature)[:, None] * np.ones((1, n))

    return F, jac


def _games():
    F, jac = _cournot([10, 8, 6, 4, 2], lambda b: 5.0 ** (-1 / b), [1.2, 1.1, 1.0, 0.9, 0.8], 1.1)
    yield nonlinear(
        "nash5",
        F,
        jac,
        0,
        INF,
        [[10] * 5, [1] * 5, [100] * 5, [0.01] * 5],
        "Murphy, Sherali & Soyster 1982; Harker 1984, five firms",
        [[36.932511, 41.818141, 43.706578, 42.659240, 39.178953]],
        near=1e-6,
    )
    F, jac = _cournot(
        [5, 3, 8, 5, 1, 3, 7, 4, 6, 3],
        lambda b: 10.0 ** (1 / b),
        [1.2, 1, 0.9, 0.6, 1.5, 1, 0.7, 1.1, 0.95, 0.75],
        1.2,
    )
    yield nonlinear(
        "nash10",
        F,
        jac,
        0,
        INF,
        [[10] * 10, [1] * 10, [0.1] * 10],
        "Harker 1984, ten firms; nash of MCPLIB",
        [
            [
                7.441546697,
                4.097810447,
                2.590643747,
                0.935385768,
                17.948952342,
                4.097810447,
                1.304725758,
                5.590082544,
                3.222179454,
                1.677094317,
            ]
        ],
        near=1e-6,
    )


def _exchange_economy():
    """Cobb-Douglas consumers; the price of the first good is fixed to 1."""
    endowment = np.array([[1, 2, 0], [0, 1, 2], [2, 0, 1.0]])
    share = np.array([[0.5, 0.25, 0.25], [0.3, 0.4, 0.3], [0.2, 0.2, 0.6]])

    def F(p):
        if not np.all(p > 0):
            return np.full(3, np.nan)
        spent = (share * (endowment @ p)[:, None]).sum(0)
        return endowment.sum(0) - spent / p

    def jac(p):
        spent = (share * (endowment @ p)[:, None]).sum(0)
        return np.diag(spent / p**2) - (share.T @ endowment) / p[:, None]

    # supply = demand is linear in the prices: their ray is a null vector
    balance = np.diag(endowment.sum(0)) - share.T @ endowment
    ray = np.linalg.svd(balance)[2][-1]
    return nonlinear(
        "walras3",
        F,
        jac,
        [1, 0, 0],
        [1, INF, INF],
        [[1, 1, 1], [1, 0.1, 5], [1, 20, 20]],
        "Cobb-Douglas exchange economy (Mas-Colell, Whinston & Green 1995, chapter 17)",
        [ray / ray[0]],
    )


def _without_solution():
    yield nonlinear(
        "nosol_quad",
        lambda x: -1 - x**2,
        lambda x: np.array([[-2 * x[0]]]),
        0,
        INF,
        [[0.0], [3.0]],
        "F < 0 on x >= 0",
        solvable=False,
    )
    yield nonlinear(
        "nosol_exp",
        lambda x: -np.exp(-x),
        lambda x: np.array([[np.exp(-x[0])]]),
        0,
        INF,
        [[0.0], [5.0]],
        "the residual tends to 0 at infinity",
        solvable=False,
    )


def _impact_step(name, s, v, h, f, kappa, solution):
    """The signs of one implicit step of a bouncing ball."""

    def F(signs):
        a, b = signs
        R = 1 - kappa * a * b
        v_new = v + h * f * a / R
        return -np.array([s + h * R * v_new, v_new])

    def jac(signs):
        a, b = signs
        R = 1 - kappa * a * b
        of_s = h * np.array([-kappa * b * v + h * f, -kappa * a * v])
        of_v = h * f / R**2 * np.array([1, kappa * a * a])
        return -np.array([of_s, of_v])

    return nonlinear(
        name,
        F,
        jac,
        -1,
        1,
        [[0, 0], [1, 1], [-1, 1], [1, -1]],
        "Huber & Oza 2016, implicit step of the bouncing ball",
        [solution],
    )


def problems():
    yield from _quadratic_problems()
    yield _mathiesen()
    yield _watson()
    yield from _games()
    yield _exchange_economy()
    yield _impact_step("zi_ball_free", 1.0, 2.0, 1e-3, -9.81, 0.41, [1, 1])
    yield _impact_step("zi_ball_cross", 1e-3, -4.0, 1e-2, -9.81, 0.41, [-1, -1])
    yield from _without_solution()
