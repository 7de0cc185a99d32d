"""Karush-Kuhn-Tucker systems of the problems of Hock & Schittkowski 1981."""

import dataclasses
from collections.abc import Callable

import numpy as np

from .problem import INF, nonlinear


@dataclasses.dataclass(frozen=True)
class Constraint:
    """``c(x) >= 0``, or ``c(x) = 0`` when `is_equality`."""

    value: Callable
    gradient: Callable
    hessian: Callable
    is_equality: bool = False


def _linear(offset, slope):
    slope = np.array(slope, float)
    n = len(slope)
    return Constraint(
        lambda x: offset + slope @ x, lambda x: slope.copy(), lambda x: np.zeros((n, n))
    )


def _kkt(number, gradient, hessian, constraints, bounds, best, starts, multipliers=None, **truth):
    """``F = (grad f - sum mu_i grad c_i, c)``, each start with multipliers 0 and with 1."""
    nx, m = len(best), len(constraints)

    def F(z):
        x, mu = z[:nx], z[nx:]
        stationarity = np.array(gradient(x), float)
        for weight, c in zip(mu, constraints, strict=True):
            stationarity -= weight * c.gradient(x)
        return np.r_[stationarity, [c.value(x) for c in constraints]]

    def jac(z):
        x, mu = z[:nx], z[nx:]
        J = np.zeros((nx + m, nx + m))
        J[:nx, :nx] = hessian(x)
        for i, c in enumerate(constraints):
            J[:nx, :nx] -= mu[i] * c.hessian(x)
            J[:nx, nx + i], J[nx + i, :nx] = -c.gradient(x), c.gradient(x)
        return J

    lower = np.r_[bounds[0], [-INF if c.is_equality else 0.0 for c in constraints]]
    upper = np.r_[bounds[1], [INF] * m]
    best = np.array(best, float)
    if multipliers is None and "accepts" not in truth:
        truth["accepts"] = lambda z: np.max(np.abs(z[:nx] - best)) < 1e-5
    solutions = [np.r_[best, multipliers]] if multipliers is not None else []
    return nonlinear(
        f"hs{number}",
        F,
        jac,
        lower,
        upper,
        [np.r_[x, np.full(m, mu)] for mu in (0.0, 1.0) for x in starts],
        f"Hock & Schittkowski 1981, no. {number}",
        solutions + truth.pop("others", []),
        **truth,
    )


def _quadratic_programs():
    H = np.array([[4, 2, 2], [2, 4, 0], [2, 0, 2.0]])
    yield _kkt(
        35,
        lambda x: H @ x - [8, 6, 4],
        lambda x: H,
        [_linear(3, [-1, -1, -2])],
        ([0] * 3, [INF] * 3),
        [4 / 3, 7 / 9, 4 / 9],
        [[0.5] * 3],
        [2 / 9],
    )
    G = np.array([[2, 0, -1, 0], [0, 1, 0, 0], [-1, 0, 2, 1], [0, 0, 1, 1.0]])
    yield _kkt(
        76,
        lambda x: G @ x - [1, 3, -1, 1],
        lambda x: G,
        [
            _linear(5, [-1, -2, -1, -1]),
            _linear(4, [-3, -1, -2, 1]),
            _linear(-1.5, [0, 1, 4, 0]),
        ],
        ([0] * 4, [INF] * 4),
        [3 / 11, 23 / 11, 0, 6 / 11],
        [[0.5] * 4],
    )


def _rosen_suzuki():
    D = np.array([2, 2, 4, 2.0])

    def ellipsoid(offset, squares, linear):
        squares, linear = np.array(squares, float), np.array(linear, float)
        return Constraint(
            lambda x: offset - squares @ x**2 + linear @ x,
            lambda x: -2 * squares * x + linear,
            lambda x: np.diag(-2 * squares),
        )

    return _kkt(
        43,
        lambda x: D * x + [-5, -5, -21, 7],
        lambda x: np.diag(D),
        [
            ellipsoid(8, [1, 1, 1, 1], [-1, 1, -1, 1]),
            ellipsoid(10, [1, 2, 1, 2], [1, 0, 0, 1]),
            ellipsoid(5, [2, 1, 1, 0], [-2, 1, 0, 1]),
        ],
        ([-INF] * 4, [INF] * 4),
        [0, 1, 2, -1],
        [[0] * 4],
        [1, 0, 2],
    )


def _exponential_constraints():
    def above_exponential(of, by):
        unit = np.eye(3)
        return Constraint(
            lambda x: x[by] - np.exp(x[of]),
            lambda x: unit[by] - np.exp(x[of]) * unit[of],
            lambda x: -np.exp(x[of]) * np.outer(unit[of], unit[of]),
        )

    constraints = [above_exponential(0, 1), above_exponential(1, 2)]
    bounds = ([0] * 3, [100, 100, 10])
    nothing = np.zeros((3, 3))
    for number, slope, best in (
        (66, [-0.8, 0, 0.2], [0.1841264879, 1.202167873, 3.327322322]),
        (34, [-1.0, 0, 0], [np.log(np.log(10)), np.log(10), 10]),
    ):
        yield _kkt(
            number,
            lambda x, slope=slope: np.array(slope),
            lambda x: nothing,
            constraints,
            bounds,
            best,
            [[0, 1.05, 2.9]],
        )


def _hs71():
    def others_product(x, *left_out):
        return np.prod(np.delete(x, left_out))

    def gradient(x):
        a, b, c, d = x
        return np.array([d * (2 * a + b + c), a * d, a * d + 1, a * (a + b + c)])

    def hessian(x):
        a, b, c, d = x
        s = 2 * a + b + c
        return np.array([[2 * d, d, d, s], [d, 0, 0, a], [d, 0, 0, a], [s, a, a, 0]])

    product = Constraint(
        lambda x: np.prod(x) - 25,
        lambda x: np.array([others_product(x, i) for i in range(4)]),
        lambda x: np.array(
            [[others_product(x, i, j) if i != j else 0.0 for j in range(4)] for i in range(4)]
        ),
    )
    sphere = Constraint(
        lambda x: x @ x - 40, lambda x: 2 * x, lambda x: 2 * np.eye(4), is_equality=True
    )
    return _kkt(
        71,
        gradient,
        hessian,
        [product, sphere],
        ([1] * 4, [5] * 4),
        [1, 4.742999643, 3.821149984, 1.379408294],
        [[1, 5, 5, 1]],
    )


def _bounds_only():
    def trigonometric(x):
        return np.cos(x[0] + x[1]) + np.array([2, -2]) * (x[0] - x[1]) + [-1.5, 2.5]

    third = np.pi / 3
    yield _kkt(
        5,
        trigonometric,
        lambda x: -np.sin(x[0] + x[1]) * np.ones((2, 2)) + np.array([[2, -2], [-2, 2]]),
        [],
        ([-1.5, -3], [4, 3]),
        [0.5 - third, -0.5 - third],
        [[0, 0]],
        [],
        others=[np.array([0.5 + third, third - 0.5])],  # a saddle, by pattern enumeration
    )
    yield _colville()
    yield _kkt(
        45,
        lambda x: np.array([-np.prod(np.delete(x, i)) / 120 for i in range(5)]),
        lambda x: np.array(
            [
                [0 if i == j else -np.prod(np.delete(x, [i, j])) / 120 for j in range(5)]
                for i in range(5)
            ]
        ),
        [],
        ([0] * 5, [1, 2, 3, 4, 5]),
        [1, 2, 3, 4, 5],
        [[2] * 5, [1] * 5],
        accepts=lambda z: True,  # every face with two zeros is stationary too
    )
    yield _kkt(
        1,
        lambda x: np.array(
            [-400 * x[0] * (x[1] - x[0] ** 2) - 2 * (1 - x[0]), 200 * (x[1] - x[0] ** 2)]
        ),
        lambda x: np.array([[1200 * x[0] ** 2 - 400 * x[1] + 2, -400 * x[0]], [-400 * x[0], 200]]),
        [],
        ([-INF, -1.5], [INF, INF]),
        [1, 1],
        [[-2, 1]],
        [],
    )


def _colville():
    def gradient(x):
        a, b, c, d = x
        return np.array(
            [
                400 * a * (a * a - b) + 2 * (a - 1),
                -200 * (a * a - b) + 20.2 * (b - 1) + 19.8 * (d - 1),
                360 * c * (c * c - d) + 2 * (c - 1),
                -180 * (c * c - d) + 20.2 * (d - 1) + 19.8 * (b - 1),
            ]
        )

    def hessian(x):
        a, b, c, d = x
        return np.array(
            [
                [1200 * a * a - 400 * b + 2, -400 * a, 0, 0],
                [-400 * a, 220.2, 0, 19.8],
                [0, 0, 1080 * c * c - 360 * d + 2, -360 * c],
                [0, 19.8, -360 * c, 200.2],
            ]
        )

    return _kkt(
        38,
        gradient,
        hessian,
        [],
        ([-10] * 4, [10] * 4),
        [1] * 4,
        [[-3, -1, -3, -1]],
        [],
        # a stationary point that is no minimum, computed
        others=[np.array([-0.96797402, 0.94713914, -0.96951631, 0.95124767])],
    )


def problems():
    yield from _quadratic_programs()
    yield _rosen_suzuki()
    yield from _exponential_constraints()
    yield _hs71()
    yield from _bounds_only()
