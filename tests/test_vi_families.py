"""Families of problems with an answer of their own: closed forms, other solvers, definitions."""

import itertools

import numpy as np
import pytest
import scipy.optimize

import zivi
from mcp.linear import laplacian

INF = np.inf


def cournot(costs, scale=25.0, price=50.0):
    """Firms with marginal costs ``c + (q/K)^0.8``, whose slope is infinite at zero output, and a
    linear price ``p - Q``."""
    costs = np.asarray(costs, float)

    def F(q):
        return costs + (q / scale) ** 0.8 + q - (price - q.sum())

    def jac(q):
        with np.errstate(divide="ignore"):
            own = 0.8 / scale * (q / scale) ** -0.2
        return np.diag(own + 1) + 1

    return F, jac


@pytest.mark.filterwarnings("ignore::RuntimeWarning")
@pytest.mark.parametrize("costs", [(2, 3, 60), (2, 70, 60), (2, 3, 49)])
@pytest.mark.parametrize("start", [0.0, 1.0, 20.0])
@pytest.mark.parametrize("given", [True, False])
def test_slopes_that_are_infinite_at_a_bound(costs, start, given):
    F, jac = cournot(costs)
    res = zivi.solve_vi(F, 0, INF, np.full(3, start), jac=jac if given else None)
    assert res.success, res.message
    # the definition: who produces earns its marginal cost, the others would not
    value = F(res.x)
    assert np.all(res.x >= 0)
    assert np.all(np.abs(value[res.x > 0]) <= 1e-9)
    assert np.all(value[res.x == 0] >= 0)
    assert res.x[-1] == 0


@pytest.mark.filterwarnings("ignore::RuntimeWarning")
def test_slopes_that_are_infinite_at_the_end_of_the_domain():
    """``F = 1/2 - sqrt(1 - x)``: beyond 1 there is no value to difference with."""
    res = zivi.solve_vi(
        lambda x: 0.5 - np.sqrt(1 - x), -INF, INF, [1.0], jac=lambda x: [0.5 / np.sqrt(1 - x)]
    )
    assert res.success
    assert res.x == pytest.approx([0.75], abs=1e-8)


def test_a_cournot_duopoly_in_closed_form():
    """Costs linear, ``q_i = (p - 2 c_i + c_j) / 3``; a firm that would lose stays out."""
    for own, other in ((2.0, 5.0), (2.0, 40.0)):
        costs = np.array([own, other])
        linear = zivi.solve_ncp(lambda q, c: c + q - (50.0 - q.sum()), [1.0, 1.0], args=(costs,))
        both = np.array([50 - 2 * own + other, 50 - 2 * other + own]) / 3
        expected = both if both.min() > 0 else np.array([(50 - own) / 2, 0.0])
        np.testing.assert_allclose(linear.x, expected, atol=1e-9)


@pytest.mark.parametrize("m", [3, 10, 20, 40])
def test_random_bimatrix_games(m):
    """No pure strategy of either player pays more; payoffs of any scale and offset."""
    for seed in range(5):
        rng = np.random.default_rng((m, seed))
        A, B = 7 * rng.normal(size=(m, m)) - 3, 1e-3 * rng.normal(size=(m, m))
        game = zivi.bimatrix(A, B)
        assert game.success, game.result.message
        for strategy in (game.x, game.y):
            assert np.all(strategy >= 0)
            assert np.sum(strategy) == pytest.approx(1, abs=1e-14)
        assert np.max(A @ game.y) <= game.x @ A @ game.y + 7e-9
        assert np.max(game.x @ B) <= game.x @ B @ game.y + 1e-12
        assert game.payoffs == pytest.approx((game.x @ A @ game.y, game.x @ B @ game.y))
        assert game.regret < 1e-8


@pytest.mark.parametrize("m", [10, 20, 40])
def test_the_path_goes_on_after_a_ray(m):
    """The complementarity problem of Lemke and Howson ends on a ray at once from either start."""
    alone = {
        "active_set": False,
        "smoothing": False,
        "semismooth": False,
        "proximal": False,
        "restarts": 0,
    }
    for seed in range(5):
        rng = np.random.default_rng(seed)
        A, B = 1 + rng.random((m, m)), 1 + rng.random((m, m))
        M = np.block([[np.zeros((m, m)), A], [B.T, np.zeros((m, m))]])
        options = zivi.VIOptions(**alone, descent_steps=False, stage_iterations=1)
        res = zivi.solve_lcp(M, -np.ones(2 * m), options=options)
        assert res.success
        x, y = res.x[:m] / res.x[:m].sum(), res.x[m:] / res.x[m:].sum()
        assert np.min(A @ y) >= x @ A @ y - 1e-9
        assert np.min(x @ B) >= x @ B @ y - 1e-9


def test_games_with_ties_and_of_other_shapes():
    pennies = zivi.bimatrix([[1, -1], [-1, 1]], [[-1, 1], [1, -1]])
    np.testing.assert_allclose([*pennies.x, *pennies.y], 0.5)
    rps = np.array([[0, -1, 1], [1, 0, -1], [-1, 1, 0]])
    game = zivi.bimatrix(rps, -rps)
    np.testing.assert_allclose([*game.x, *game.y], 1 / 3)
    dilemma = zivi.bimatrix([[-1, -3], [0, -2]], [[-1, 0], [-3, -2]])
    np.testing.assert_array_equal([*dilemma.x, *dilemma.y], [0, 1, 0, 1])
    inspection = zivi.bimatrix([[-1, 1], [0, -3]], [[2, -4], [2, 4]])
    np.testing.assert_allclose([*inspection.x, *inspection.y], [0.25, 0.75, 0.8, 0.2])
    constant = zivi.bimatrix(np.zeros((2, 3)), np.full((2, 3), 1e300))
    assert constant.success
    assert constant.regret <= 1e285
    rng = np.random.default_rng(3)
    for _ in range(40):
        shape = tuple(rng.integers(1, 5, 2))
        A, B = rng.integers(-2, 3, shape), rng.integers(-2, 3, shape)
        game = zivi.bimatrix(A, B)
        assert game.success
        assert np.max(A @ game.y) - game.x @ A @ game.y <= 1e-8
        assert np.max(game.x @ B) - game.x @ B @ game.y <= 1e-8
    with pytest.raises(ValueError, match=r"B must have the shape \(2, 2\) of A, got \(1, 2\)"):
        zivi.bimatrix(np.eye(2), [[1, 2]])
    with pytest.raises(ValueError, match="A must be a matrix with at least one entry"):
        zivi.bimatrix([1, 2], [1, 2])
    with pytest.raises(ValueError, match=r"B\[0, 1\] must be finite, got nan"):
        zivi.bimatrix([[1, 2]], [[1, np.nan]])


def solutions_of_lcp(M, q):
    """All of them, pattern by pattern."""
    n = len(q)
    for inside in itertools.product([False, True], repeat=n):
        x, on = np.zeros(n), np.flatnonzero(inside)
        try:
            x[on] = np.linalg.solve(M[np.ix_(on, on)], -q[on])
        except np.linalg.LinAlgError:
            continue
        if np.all(x >= -1e-12) and np.all(M @ x + q >= -1e-12):
            yield x


def test_linear_complementarity_problems_against_enumeration():
    unsolvable = 0
    for seed in range(60):
        rng = np.random.default_rng(seed)
        n = int(rng.integers(1, 6))
        M, q = rng.normal(size=(n, n)), rng.normal(size=n)
        expected = list(solutions_of_lcp(M, q))
        res = zivi.solve_lcp(M, q)
        assert res.success == bool(expected)
        if expected:
            assert min(np.max(np.abs(res.x - x)) for x in expected) < 1e-7
        unsolvable += not expected
    assert unsolvable > 5


def planted(n, seed):
    rng = np.random.default_rng(seed)
    M = rng.normal(size=(n, n))
    x = np.where(rng.random(n) < 0.5, rng.random(n), 0)
    return M, np.where(x > 0, 0, rng.random(n)) - M @ x


def test_restarts_get_their_share_of_the_pivots():
    """Solved by a restart; with one budget for all, the first stages used it up."""
    M, q = planted(20, 1)
    res = zivi.solve_lcp(M, q)
    assert res.success
    assert res.stage.startswith("R")
    assert np.min(M @ res.x + q) > -1e-8
    assert abs(res.x @ (M @ res.x + q)) < 1e-7
    short = zivi.VIOptions(total_pivots=1000)
    assert zivi.solve_lcp(M, q, options=short).n_restarts > 0


@pytest.mark.parametrize("n", [100, 400])
def test_a_row_that_cannot_be_satisfied_is_found_at_once(n):
    rng = np.random.default_rng(n)
    M, q = rng.normal(size=(n, n)), rng.normal(size=n)
    M[n // 2], q[n // 2] = -rng.random(n), -1
    res = zivi.solve_lcp(M, q)
    assert res.status is zivi.VIStatus.INFEASIBLE
    assert res.n_iter == res.n_pivots == 0
    assert res.residual == zivi.natural_residual(res.x, M @ res.x + q, 0, INF)
    M[n // 2, 0] = 1e-3  # satisfied far out: no proof any more
    quick = zivi.VIOptions(total_pivots=10)
    assert zivi.solve_lcp(M, q, options=quick).status is not zivi.VIStatus.INFEASIBLE


@pytest.mark.parametrize(
    ("q", "lower", "upper", "infeasible"),
    [
        (-3.5, [0, 0], [INF, 3], True),  # sup F_0 = -0.5 with x_0 unbounded above
        (-3.5, [0, 0], [9, 3], False),  # x_0 = 9 may have F_0 < 0
        (-3.0, [0, 0], [INF, 3], False),  # zero is reached
        (0.5, [-INF, 0], [0, 3], True),  # inf F_0 = 0.5 with x_0 unbounded below
        (0.5, [-9, 0], [0, 3], False),
        (-3.5, [0, 0], [INF, INF], False),  # satisfied for large x_1
    ],
)
def test_infeasible_only_where_it_is_a_proof(q, lower, upper, infeasible):
    """``F_0 = x_1 + q`` with ``0 <= x_1 <= 3``."""
    res = zivi.solve_avi([[0, 1], [-1, 0.5]], [q, 1], lower, upper)
    assert (res.status is zivi.VIStatus.INFEASIBLE) == infeasible
    assert not (infeasible and res.success)


def test_rounding_proves_nothing():
    """Zero is reached at the lower bound of ``x_1`` alone; the sums say -1e-8 from some starts."""
    M, q = [[0, -1e8], [0, 1]], [1e8 / 3, -1 / 3]
    for start in np.linspace(0.4, 9, 40):
        res = zivi.solve_avi(M, q, [0, 1 / 3], INF, [0.0, start])
        assert res.status is not zivi.VIStatus.INFEASIBLE


def projected_sor(M, q, lower, sweeps=2000):
    """Cryer's method: component by component, over-relaxed and projected."""
    x = np.maximum(0.0, lower)
    for _ in range(sweeps):
        before = x.copy()
        for i in range(len(q)):
            x[i] = max(lower[i], x[i] - 1.6 * (M[i] @ x + q[i]) / M[i, i])
        if np.max(np.abs(x - before)) < 1e-14:
            break
    return x


def test_an_obstacle_problem_against_projected_sor():
    m = 9
    M, q = laplacian(m), np.full(m * m, 0.02)
    grid = np.linspace(-1, 1, m + 2)[1:-1]
    lower = (0.4 - grid[:, None] ** 2 - grid**2).ravel()
    res = zivi.solve_avi(M, q, lower, INF)
    np.testing.assert_allclose(res.x, projected_sor(M, q, lower), atol=1e-11)
    assert 0 < np.sum(res.x == lower) < m * m


def bearing(m, eccentricity=0.8):
    """A journal bearing: Reynolds' equation for the film pressure, zero where it cavitates."""
    theta = 2 * np.pi * np.arange(1, m + 1) / (m + 1)
    step = np.array([2 * np.pi, 2.0]) / (m + 1)

    def film(angle):
        return (1 + eccentricity * np.cos(angle)) ** 3

    right, left = film(theta + step[0] / 2), film(theta - step[0] / 2)
    along = (np.diag(left + right) - np.diag(right[:-1], 1) - np.diag(left[1:], -1)) / step[0] ** 2
    across = (2 * np.eye(m) - np.eye(m, k=1) - np.eye(m, k=-1)) / step[1] ** 2
    M = np.kron(np.eye(m), along) + np.kron(across, np.diag(film(theta)))
    return M, np.tile(-eccentricity * np.sin(theta), m)


def test_grids_need_no_pivots():
    """The active set by Newton's method; pivoting alone takes hundreds."""
    m = 24
    grid = np.linspace(-1, 1, m + 2)[1:-1]
    obstacle = laplacian(m), np.full(m * m, 0.005), (0.5 - grid[:, None] ** 2 - grid**2).ravel()
    for M, q, lower in (obstacle, (*bearing(m), np.zeros(m * m))):
        res = zivi.solve_avi(M, q, lower, INF)
        assert res.success
        assert res.n_pivots == 0
        assert 0 < np.sum(res.x == lower) < m * m
        pivoting = zivi.solve_avi(M, q, lower, INF, options=zivi.VIOptions(active_set=False))
        assert pivoting.n_pivots > 100
        np.testing.assert_allclose(res.x, pivoting.x, atol=1e-9)


@pytest.mark.parametrize("m", [75, 100, 150])
def test_large_bimatrix_games(m):
    """Labels of Lemke and Howson's paths take turns: one alone may need thousands of pivots."""
    for seed in range(4):
        rng = np.random.default_rng((m, seed))
        A, B = rng.normal(size=(m, m)), rng.normal(size=(m, m))
        game = zivi.bimatrix(A, B)
        assert game.success
        assert game.result.n_pivots < 40 * m
        for strategy in (game.x, game.y):
            assert np.min(strategy) >= 0
            assert np.sum(strategy) == pytest.approx(1, abs=1e-14)
        assert np.max(A @ game.y) - game.x @ A @ game.y < 1e-9
        assert np.max(game.x @ B) - game.x @ B @ game.y < 1e-9


def test_a_game_whose_paths_are_too_long_is_solved_without_them(monkeypatch):
    monkeypatch.setattr("zivi._zivi.lemke_howson", lambda *given: None)
    rng = np.random.default_rng(0)
    A, B = rng.normal(size=(2, 5, 7))
    game = zivi.bimatrix(A, B)
    assert game.success
    assert game.regret < 1e-9


def excluded(rng, n, rows):
    """A random LCP whose rows exclude each other: ``y'(M x + q) < 0`` for all ``x >= 0``."""
    M, q = rng.normal(size=(n, n)), rng.normal(size=n)
    y = np.zeros(n)
    y[rng.permutation(n)[:rows]] = rng.uniform(0.5, 2, rows)
    k = np.flatnonzero(y)[0]
    M[k] -= (y @ M + 0.1 * rng.random(n)) / y[k]
    q[k] -= (y @ q + 1) / y[k]
    return M, q


@pytest.mark.parametrize(("n", "rows"), [(3, 2), (8, 5), (40, 2), (40, 20), (100, 50), (400, 2)])
def test_rows_that_exclude_each_other_are_proved_to(n, rows):
    """By Farkas' lemma, for problems that are not monotone as well."""
    for seed in range(3):
        M, q = excluded(np.random.default_rng((n, rows, seed)), n, rows)
        res = zivi.solve_lcp(M, q)
        assert res.status is zivi.VIStatus.INFEASIBLE
        assert res.n_pivots == 0 or n < 16
        opposite = M.copy()
        opposite[1] = -opposite[0]
        res = zivi.solve_lcp(opposite, np.append([1.0, -2.0], q[2:]))
        assert res.status is zivi.VIStatus.INFEASIBLE


@pytest.mark.slow
def test_infeasible_on_a_box_with_all_kinds_of_bounds():
    """A linear program by another solver decides."""
    infeasible = 0
    for seed in range(50):
        rng = np.random.default_rng(seed)
        n = int(rng.integers(2, 20))
        M, q = rng.normal(size=(n, n)), 2 * rng.normal(size=n)
        M[rng.random((n, n)) < 0.5] = 0
        lower = np.where(rng.random(n) < 0.25, -INF, -rng.random(n))
        upper = np.where(rng.random(n) < 0.6, INF, rng.random(n))
        res = zivi.solve_avi(M, q, lower, upper)
        up, down = np.isinf(upper), np.isinf(lower)
        program = scipy.optimize.linprog(
            np.zeros(n),
            np.vstack([-M[up], M[down], np.zeros((1, n))]),
            np.concatenate([q[up], -q[down], [0.0]]),
            bounds=list(zip(lower, upper, strict=True)),
        )
        if res.status is zivi.VIStatus.INFEASIBLE:
            assert program.status == 2
        if program.status == 2:
            assert res.status is zivi.VIStatus.INFEASIBLE
            infeasible += 1
        assert not (res.success and program.status == 2)
    assert 10 < infeasible < 40


def test_feasible_problems_without_solutions_are_not_called_infeasible():
    """The rows can be satisfied, complementarity cannot."""
    res = zivi.solve_lcp([[0, 1], [-1, 0]], [-1, 2])
    assert res.success
    res = zivi.solve_lcp([[-1.0, 2.0], [0.0, 0.0]], [-1.0, 1.0])  # x_1 would have to be positive
    assert not res.success
    assert res.status is not zivi.VIStatus.INFEASIBLE


def test_steep_jacobians_are_no_excuse():
    """With a Jacobian of 1e13 the residual would be within what rounding allows."""
    for steepness in (1e13, -1e13):
        res = zivi.solve_vi(
            lambda x: np.array([x[0] - 1 + 1e-3, x[1] - 2]),
            -INF,
            INF,
            [1.0, 2.0],
            jac=steepness * np.eye(2),
        )
        assert not res.success
    # where it is right it is believed, at bounds, too
    for lower in (-INF, 1.0):
        res = zivi.solve_vi(
            lambda x: 1e13 * np.array([x[0] + x[1] - np.pi - 1, x[1] - 1]),
            [-INF, lower],
            INF,
            [1.0, 2.0],
            jac=1e13 * np.array([[1.0, 1.0], [0.0, 1.0]]),
        )
        assert res.success
        np.testing.assert_allclose(res.x, [np.pi, 1.0], rtol=1e-14)


def test_obstacles_on_both_sides_need_no_pivots():
    """The smoothing Newton method: pivoting takes hundreds."""
    m = 24
    s = np.sin(np.linspace(0, 3 * np.pi, m))
    middle = (s[:, None] * s).ravel()
    M, q = laplacian(m), np.full(m * m, -0.02)
    lower, upper = middle - 0.05, middle + 0.05
    res = zivi.solve_avi(M, q, lower, upper)
    assert res.success
    assert res.n_pivots == 0
    assert min(np.sum(res.x == lower), np.sum(res.x == upper)) > 20
    alone = zivi.VIOptions(active_set=False, smoothing=False)
    np.testing.assert_allclose(
        zivi.solve_avi(M, q, lower, upper, options=alone).x, res.x, atol=1e-9
    )


def test_units_from_1e_minus_8_to_1e8():
    """Rows and unknowns of a monotone problem in units of their own."""
    for seed in range(12):
        rng = np.random.default_rng(seed)
        n = 12
        A = rng.normal(size=(n, n))
        M = A @ A.T / n + 0.5 * (A - A.T) + 0.1 * np.eye(n)
        x = np.where(rng.random(n) < 0.5, rng.random(n), 0)
        q = np.where(x > 0, 0, rng.random(n)) - M @ x
        rows, columns = (10 ** rng.uniform(-8, 8, n) for _ in range(2))
        res = zivi.solve_lcp(rows[:, None] * M * columns, rows * q)
        assert res.success
        np.testing.assert_allclose(res.x * columns, x, atol=1e-6)


def excess_contacts(rng, n, dofs):
    """``G W G'`` of contacts in excess, and ``A`` with ``M = A'A``, ``q = -A'b``."""
    G = rng.normal(size=(n, dofs)) * (rng.random((n, dofs)) < 0.4)
    A = (G * np.sqrt(rng.uniform(0.5, 2.0, dofs))).T
    b = rng.normal(size=dofs)
    return A.T @ A, -A.T @ b, A, b


@pytest.mark.parametrize(("n", "dofs"), [(30, 10), (80, 40), (200, 100), (200, 30)])
def test_more_contacts_than_degrees_of_freedom(n, dofs):
    """The impulses are those of non-negative least squares, where they do not depend on which."""
    for seed in range(3):
        M, q, A, b = excess_contacts(np.random.default_rng((n, dofs, seed)), n, dofs)
        res = zivi.solve_lcp(M, q)
        assert res.success
        F = M @ res.x + q
        assert np.max(np.abs(np.minimum(res.x, F))) <= 1e-12
        least, _ = scipy.optimize.nnls(A, b, maxiter=100 * n)
        assert A @ res.x == pytest.approx(A @ least, abs=1e-11)
        # principal pivots, hardly more than contacts that press
        assert res.stage == "S0"
        assert res.n_pivots <= 2 * n


def test_singular_monotone_problems_on_boxes():
    """Not symmetric, of low rank, on all kinds of bounds, from any start: what all solutions share
    of a monotone problem is ``(M + M') x``."""
    solved = 0
    for seed in range(40):
        rng = np.random.default_rng(seed)
        n, rank = int(rng.integers(20, 70)), int(rng.integers(3, 15))
        A, B = rng.normal(size=(2, rank, n))
        M = (A.T @ A + A.T @ B - B.T @ A) / n
        lower = np.where(rng.random(n) < 0.2, -INF, -rng.random(n))
        upper = np.where(rng.random(n) < 0.4, INF, rng.random(n))
        kind = rng.random(n)
        low, high = np.isfinite(lower) & (kind < 0.4), np.isfinite(upper) & (kind > 0.7)
        inside = np.clip(rng.normal(size=n), lower, upper)
        x = np.where(low, lower, np.where(high, upper, inside))
        push = rng.random(n)
        F = np.where(x == lower, push, np.where(x == upper, -push, 0))
        q = F - M @ x
        for start in (None, rng.normal(size=n)):
            res = zivi.solve_avi(M, q, lower, upper, start)
            assert res.success
            natural = np.maximum(res.x - upper, np.minimum(res.x - lower, M @ res.x + q))
            assert np.max(np.abs(natural)) <= 1e-9
            assert (M + M.T) @ res.x == pytest.approx((M + M.T) @ x, abs=2e-7)
            solved += res.stage == "S0" and not res.n_pivots
    assert solved >= 78


@pytest.mark.parametrize("n", [40, 200])
def test_singular_monotone_problems_without_a_solution(n):
    """``M y = 0`` and ``q'y < 0`` for a ``y >= 0``: the proximal steps drift along it."""
    for seed in range(3):
        rng = np.random.default_rng((n, seed))
        y = np.where(rng.random(n) < 0.3, rng.random(n), 0)
        A = rng.normal(size=(n // 4, n))
        A -= np.outer(A @ y, y) / (y @ y)
        q = rng.normal(size=n)
        q -= y * (q @ y + 0.1) / (y @ y)
        res = zivi.solve_lcp(A.T @ A / n, q)
        assert res.status is zivi.VIStatus.INFEASIBLE
        # told before the smoothing Newton method has begun
        assert res.n_iter <= 30
