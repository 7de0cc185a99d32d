"""Derivatives of solutions of VIs, against differences of the solver and closed forms."""

import numpy as np
import pytest
import scipy.optimize
import scipy.sparse as sp

import zivi
from interrupting import in_own_process
from zivi.vi import solution_derivative

H = 1e-6


def differences(solve, n):
    """Give the derivatives of a solution by steps of the parameters."""
    return np.column_stack([(solve(H * e) - solve(-H * e)) / (2 * H) for e in np.eye(n)])


@pytest.fixture(params=range(6))
def problem(request):
    """Give a random affine problem with components at both bounds and between."""
    draw = np.random.default_rng(request.param)
    n = 25
    A = draw.normal(size=(n, n))
    M = A @ A.T / n + 0.3 * np.eye(n) + 0.3 * (A - A.T)
    lower = np.where(draw.random(n) < 0.6, draw.normal(size=n) - 0.3, -np.inf)
    upper = np.where(draw.random(n) < 0.5, np.maximum(lower, -1.0) + 0.4, np.inf)
    return M, draw.normal(size=n), lower, upper


def test_derivatives_are_differences_of_solutions(problem):
    M, q, lower, upper = problem
    n = len(q)
    res = zivi.solve_avi(M, q, lower, upper)
    found = solution_derivative(res, M, np.eye(n), lower, upper)
    assert len(found.free)
    assert len(found.at_lower)
    assert len(found.at_upper)
    assert not len(found.unclear)
    exact = differences(lambda dq: zivi.solve_avi(M, q + dq, lower, upper).x, n)
    assert np.abs(found.matrix - exact).max() < 1e-7
    # components at their bounds stay
    assert not found.matrix[found.at_lower].any()
    # and are those that the map holds
    assert np.all(res.F[found.at_lower] > 0)
    assert np.all(res.F[found.at_upper] < 0)


def test_bounds_may_move(problem):
    M, q, lower, upper = problem
    n = len(q)
    res = zivi.solve_avi(M, q, lower, upper)
    dl, du = (np.diag(np.isfinite(box) * 1.0) for box in (lower, upper))
    no = np.zeros((n, n))
    found = solution_derivative(res, M, no, lower, upper, dlower=dl, dupper=2 * du)
    exact = differences(lambda p: zivi.solve_avi(M, q, lower + p, upper + 2 * p).x, n)
    assert np.abs(found.matrix - exact).max() < 1e-7


def test_sparse_is_dense_and_backwards_is_forwards(problem):
    M, q, lower, upper = problem
    n = len(q)
    draw = np.random.default_rng(9)
    dF, dl = draw.normal(size=(n, 3)), draw.normal(size=(n, 3))
    res = zivi.solve_avi(M, q, lower, upper)
    dense = solution_derivative(res, M, dF, lower, upper, dlower=dl)
    sparse = solution_derivative(
        res, sp.csc_array(M), sp.coo_array(dF), lower, upper, dlower=sp.csr_array(dl)
    )
    weights, dp = draw.normal(size=(n, 2)), draw.normal(size=3)
    for found in (dense, sparse):
        assert found.shape == (n, 3) == found.matrix.shape
        assert np.allclose(found.matrix, dense.matrix, rtol=0, atol=1e-12)
        assert np.allclose(found.vjp(weights), found.matrix.T @ weights, rtol=0, atol=1e-11)
        assert np.allclose(found.jvp(dp), found.matrix @ dp, rtol=0, atol=1e-12)
        assert found.vjp(weights[:, 0]).shape == (3,)


def test_an_obstacle_problem_with_ten_thousand_unknowns():
    side = 100
    one = sp.diags_array([-1.0, 2.0, -1.0], offsets=[-1, 0, 1], shape=(side, side))
    M = (sp.kron(one, sp.eye_array(side)) + sp.kron(sp.eye_array(side), one)).tocsc()
    load = np.full(side**2, 0.1 / side**2)
    ticks = np.arange(1, side + 1) / (side + 1)
    x, y = np.meshgrid(ticks, ticks)
    bump = (0.02 - 0.5 * ((x - 0.5) ** 2 + (y - 0.5) ** 2)).ravel()
    res = zivi.solve_avi(M, -load, bump, np.inf)
    found = solution_derivative(res, M, -load, bump, np.inf, dlower=np.ones(side**2))
    assert len(found.at_lower) > 100
    assert not len(found.unclear)
    up, down = (zivi.solve_avi(M, -(1 + s) * load, bump + s, np.inf).x for s in (1e-5, -1e-5))
    assert np.abs(found.matrix[:, 0] - (up - down) / 2e-5).max() < 1e-3
    # and of the mean height, by one system of equations
    mean = np.full(side**2, 1 / side**2)
    assert abs(found.vjp(mean)[0] - found.matrix[:, 0].mean()) < 1e-12


def test_components_that_are_at_a_bound_without_being_held_are_named():
    # x = max(p, 0) at p = 0
    res = zivi.solve_lcp(np.eye(2), np.array([0.0, -1.0]))
    found = solution_derivative(res, np.eye(2), -np.eye(2), 0.0)
    assert found.unclear.tolist() == [0]
    assert found.free.tolist() == [1]
    assert found.matrix.tolist() == [[0.0, 0.0], [0.0, 1.0]]
    # the same in other units
    for unit in (1e-9, 1e9):
        res = zivi.solve_lcp(np.eye(2), unit * np.array([0.3, -1.0]), tol=1e-12 * unit)
        assert not len(solution_derivative(res, np.eye(2), np.eye(2), 0.0).unclear)


def test_bounds_that_are_equal_hold_whatever_the_map_does():
    res = zivi.solve_avi(np.eye(2), np.array([1.0, -1.0]), [2.0, 0.0], [2.0, 9.0])
    found = solution_derivative(res, np.eye(2), np.eye(2), [2.0, 0.0], [2.0, 9.0])
    assert found.at_lower.tolist() == [0]
    assert not len(found.unclear)


def test_without_parameters_or_free_components():
    res = zivi.solve_lcp(np.eye(2), np.ones(2))
    assert not solution_derivative(res, np.eye(2), np.eye(2), 0.0).matrix.any()
    assert solution_derivative(res, np.eye(2), np.zeros((2, 0)), 0.0).matrix.shape == (2, 0)


@pytest.mark.parametrize("kind", [np.asarray, sp.csr_array])
def test_a_solution_that_is_not_isolated_has_no_derivative(kind):
    M = np.array([[1.0, -1.0], [-1.0, 1.0]])
    res = zivi.solve_avi(M, np.zeros(2), None, None, [1.0, 0.5])
    found = solution_derivative(res, kind(M), np.eye(2))
    with pytest.raises(np.linalg.LinAlgError, match="not isolated"):
        _ = found.matrix
    with pytest.raises(np.linalg.LinAlgError, match="not isolated"):
        found.vjp([1.0, 0.0])


def test_bad_arguments_are_named():
    res = zivi.solve_lcp(np.eye(2), -np.ones(2))
    for arguments, told in [
        ((res, np.eye(3), np.eye(2)), r"jac must have shape \(2, 2\), got \(3, 3\)"),
        ((res, np.eye(2), np.eye(3)), r"dF must have shape \(2, k\), got \(3, 3\)"),
        ((res, [[1, np.nan], [0, 1]], np.eye(2)), r"jac\[0, 1\] must be finite"),
        ((res, np.eye(2), np.eye(2), [0, 0, 0]), "lower must have 2 entries"),
    ]:
        with pytest.raises(ValueError, match=told):
            solution_derivative(*arguments)
    with pytest.raises(ValueError, match=r"dlower must have shape \(2, 2\)"):
        solution_derivative(res, np.eye(2), np.eye(2), dlower=np.ones((2, 1)))
    with pytest.raises(ValueError, match=r"tol must be in \(0, 1\)"):
        solution_derivative(res, np.eye(2), np.eye(2), tol=2.0)
    with pytest.raises(TypeError, match=r"solution must be a zivi.VIResult"):
        solution_derivative(res.x, np.eye(2), np.eye(2))
    failed = zivi.solve_lcp(-np.eye(2), -np.ones(2))
    assert not failed.success
    with pytest.raises(ValueError, match="solution must be one, got"):
        solution_derivative(failed, -np.eye(2), np.eye(2))
    found = solution_derivative(res, np.eye(2), np.eye(2))
    with pytest.raises(ValueError, match="dp must have 2 rows"):
        found.jvp([1.0])
    with pytest.raises(ValueError, match="weights must have 2 rows"):
        found.vjp([[1.0], [2.0], [3.0]])


# as a function of parameters


def prices(x, p):
    """Two markets whose supply and demand curves have the parameters p."""
    return np.array([x[0] ** 2 + x[1] - p[0], 2 * x[1] + 0.5 * x[0] - p[1] * p[0] + 1.0])


def slopes(x, p):
    return np.array([[2 * x[0], 1.0], [0.5, 2.0]])


def by_parameters(x, p):
    return np.array([[-1.0, 0.0], [-p[1], -p[0]]])


@pytest.mark.parametrize("dF", [None, by_parameters])
def test_a_function_of_the_parameters_fits_data(dF):
    f = zivi.interop.solution_function(prices, 0, None, [1, 1], ["a", "b"], jac=slopes, dF=dF)
    assert f.shape == (2,)
    assert f.wrt == ("a", "b")
    truth = np.array([4.0, 0.9])
    measured = f.fun(truth)
    fit = scipy.optimize.least_squares(
        lambda p: f.fun(p) - measured, [3.0, 0.8], jac=f.jac, gtol=1e-12
    )
    assert np.abs(fit.x - truth).max() < 1e-8
    x, derivative = f(truth)
    exact = np.linalg.solve(slopes(x, truth), -by_parameters(x, truth))
    assert np.abs(derivative - exact).max() < 1e-8
    weights = np.array([0.3, -2.0])
    assert np.allclose(f.gradient(truth, weights), weights @ exact, atol=1e-8)
    # held at zero
    low = f.evaluate([4.0, 0.1])
    assert low.value[1] == 0.0
    assert low.of.at_lower.tolist() == [1]
    assert np.allclose(low.derivative, [[1 / (2 * low.value[0]), 0.0], [0.0, 0.0]], atol=1e-8)


def test_bounds_may_be_functions_of_the_parameters():
    f = zivi.interop.solution_function(
        lambda x, p: x + 1.0, lambda p: [p[0] ** 2, -np.inf], None, [5, 5], "height",
        jac=lambda x, p: np.eye(2),
    )  # fmt: skip
    x, derivative = f([3.0])
    assert x.tolist() == [9.0, -1.0]
    assert np.allclose(derivative, [[6.0], [0.0]], atol=1e-8)


def test_where_there_is_no_solution_it_is_infinite():
    f = zivi.interop.solution_function(
        lambda x, p: -x - p[0], 0, None, [1.0], ["p"], jac=lambda x, p: -np.eye(1)
    )
    value, derivative = f([1.0])
    assert np.isinf(value).all()
    assert np.isnan(derivative).all()
    assert np.isnan(f.gradient([1.0], [1.0])).all()
    assert f.evaluate([1.0]).solution.status is not zivi.VIStatus.SOLVED
    with pytest.raises(ValueError, match="p must have 1 entries, got 2"):
        f([1.0, 2.0])
    for wrong, told in [({"jac": 3}, "jac must be callable"), ({"dF": 3}, "dF must be callable")]:
        with pytest.raises(TypeError, match=told):
            zivi.interop.solution_function(prices, 0, None, [1, 1], "a", **{"jac": slopes} | wrong)
    with pytest.raises(ValueError, match="wrt must be names"):
        zivi.interop.solution_function(prices, 0, None, [1, 1], [], jac=slopes)


def in_jax():
    """Check derivatives of solutions in JAX, which is to be alone in its process."""
    import jax

    jax.config.update("jax_enable_x64", True)
    f = zivi.interop.solution_function(prices, 0, None, [1, 1], ["a", "b"], jac=slopes)
    solution = zivi.interop.jax_function(f)
    p = np.array([4.0, 0.9])
    found = jax.jacobian(solution)(p)
    assert np.abs(np.asarray(found) - f.jac(p)).max() < 1e-10
    gradient = jax.grad(lambda p: (solution(p) ** 2).sum())(p)
    assert np.allclose(gradient, f.gradient(p, 2 * f.fun(p)), atol=1e-9)


@pytest.mark.slow
def test_jax_differentiates_solutions():
    in_own_process("jax", "import test_vi_derivatives; test_vi_derivatives.in_jax()")
