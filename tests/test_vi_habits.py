"""The solver of box VIs as users of SciPy type it."""

import signal
import time

import numpy as np
import pytest
import scipy.optimize
import scipy.sparse

import zivi

INF = np.inf
M = np.array([[4.0, 1.0, 0.0], [-1.0, 3.0, 1.0], [0.5, 0.0, 2.0]])
Q = np.array([-3.0, 1.0, -9.0])


def F(x):
    return M @ x + Q + x**3


def jac(x):
    return M + np.diag(3 * x**2)


EXPECTED = zivi.solve_vi(F, [0, 0, 0], [INF, INF, 1.0], [0.5, 0.5, 0.5], jac=jac)


@pytest.mark.parametrize(
    "solve",
    [
        lambda x: zivi.solve_vi(F, x, bounds=scipy.optimize.Bounds(0, [INF, INF, 1]), jac=jac),
        lambda x: zivi.solve_vi(F, x0=x, bounds=[(0, None), (0, INF), (0, 1)], jac=jac),
        lambda x: zivi.solve_vi(F, x, bounds=((0, None), (0, None), (0, 1.0)), jac=jac),
        lambda x: zivi.solve_vi(F, scipy.optimize.Bounds(0, [INF, INF, 1]), x, jac=jac),
        lambda x: zivi.solve_vi(F, scipy.optimize.Bounds(0, [INF, INF, 1]), x0=x, jac=jac),
        lambda x: zivi.solve_vi(F, 0, [None, None, 1], x, jac=jac),
        lambda x: zivi.solve_vi(lambda y: (F(y), jac(y)), 0, [INF, INF, 1], x, jac=True),
        lambda x: zivi.solve_ncp(F, x, jac=jac, upper=[None, INF, 1]),
        lambda x: zivi.solve_vi(F, 0, (INF, INF, 1), x, jac=jac, options={"restarts": 2}),
    ],
)
def test_bounds_and_jacobians_as_in_scipy(solve):
    res = solve([0.5, 0.5, 0.5])
    np.testing.assert_array_equal(res.x, EXPECTED.x)
    assert EXPECTED.success
    assert res.x[2] == 1
    assert zivi.natural_residual(res.x, F(res.x), 0, [INF, INF, 1]) < 1e-9


def test_no_bounds_are_equations():
    expected = scipy.optimize.root(F, np.ones(3), jac=jac, tol=1e-13).x
    for res in (
        zivi.solve_vi(F, None, None, np.ones(3)),
        zivi.solve_vi(F, x0=np.ones(3), jac=False),
        zivi.solve_vi(F, x0=np.ones(3), bounds=scipy.optimize.Bounds()),
    ):
        np.testing.assert_allclose(res.x, expected, atol=1e-9)
    np.testing.assert_allclose(zivi.solve_avi(M, Q).x, np.linalg.solve(M, -Q), atol=1e-12)
    bounds = scipy.optimize.Bounds([0, -INF, 0], [INF, INF, 1])
    np.testing.assert_array_equal(
        zivi.solve_avi(M, Q, bounds=bounds).x, zivi.solve_avi(M, Q, bounds.lb, bounds.ub).x
    )
    np.testing.assert_array_equal(
        zivi.solve_avi(M, Q, bounds).x, zivi.solve_avi(M, Q, bounds.lb, bounds.ub).x
    )


def test_upper_bounds_of_complementarity_problems():
    res = zivi.solve_lcp(M, Q, upper=[INF, INF, 1])
    np.testing.assert_array_equal(res.x, zivi.solve_avi(M, Q, 0, [INF, INF, 1]).x)
    assert res.x[2] == 1
    assert res.F[2] < 0
    assert zivi.solve_lcp(M, Q, upper=None).x[2] > 1


def test_a_map_that_returns_its_jacobian_is_called_once_a_point():
    calls = []

    def both(x):
        calls.append(x.copy())
        return F(x), jac(x)

    res = zivi.solve_vi(both, 0, INF, np.ones(3), jac=True)
    assert res.success
    assert res.nfev == len(calls)
    expected = zivi.solve_vi(F, 0, INF, np.ones(3), jac=jac)
    assert res.nfev <= expected.nfev + 1
    with pytest.raises(TypeError, match=r"F must return \(F\(x\), jac\(x\)\) for jac=True"):
        zivi.solve_vi(F, 0, INF, np.ones(3), jac=True)


def test_options_as_a_dict():
    res = zivi.solve_vi(np.arctan, x0=[20.0], options={"maxiter": 2})
    assert res.status is zivi.VIStatus.ITERATION_LIMIT
    assert res.n_iter == 2
    one, other = (
        zivi.solve_vi(np.arctan, x0=[20.0], options=it)
        for it in ({"line_search": False}, zivi.VIOptions(line_search=False))
    )
    assert one.n_iter == other.n_iter


def test_results_by_their_names():
    res = zivi.solve_lcp(M, Q)
    assert res["x"] is res.x
    assert res["fun"] is res.F
    assert res["nit"] == res.n_iter
    assert "success" in res
    assert "y" not in res
    assert set(dict(res)) == set(res.keys()) >= {"x", "fun", "success", "status", "message"}
    with pytest.raises(KeyError, match=r"'y'.*there are x, F"):
        res["y"]


def test_pairs_of_bounds_are_checked():
    with pytest.raises(ValueError, match=r"pairs \(lower, upper\), got \(0,\) as number 1"):
        zivi.solve_vi(F, np.ones(3), bounds=[(0, 1), (0,), (0, 1)])
    with pytest.raises(TypeError, match=r"scipy.optimize.Bounds or a sequence of pairs"):
        zivi.solve_vi(F, np.ones(3), bounds=3)
    with pytest.raises(ValueError, match="lower must have 3 entries"):
        zivi.solve_vi(F, np.ones(3), bounds=[(0, 1), (0, 1)])


@pytest.mark.parametrize("scale", [1e-9, 1.0, 1e9])
def test_the_check_of_a_jacobian_is_relative_to_its_slopes(scale):
    """An entry of 2e-9 that is 2.5 times too large beside others of any size."""
    slopes = np.array([[2e-9, 0.0], [1.0, 3.0]]) * scale
    x = [0.3, 0.4]
    good = zivi.check_jacobian(lambda x: slopes @ x, slopes, x)
    assert good.error < 1e-6
    wrong = slopes.copy()
    wrong[0, 0] *= 2.5
    for given in (wrong, scipy.sparse.csr_array(wrong), lambda x: wrong):
        bad = zivi.check_jacobian(lambda x: slopes @ x, given, x)
        assert (bad.row, bad.column) == (0, 0)
        assert bad.error == pytest.approx(0.6, rel=1e-3)
        assert bad.expected == pytest.approx(2e-9 * scale, rel=1e-3)
    # a slope that should not be there, and one that is missing
    for i, j, value in ((0, 1, 1e-7 * scale), (1, 0, 0.0)):
        wrong = slopes.copy()
        wrong[i, j] = value
        bad = zivi.check_jacobian(lambda x: slopes @ x, wrong, x)
        assert (bad.row, bad.column) == (i, j)
        assert bad.error > 0.9


def test_right_slopes_pass_the_check_whatever_their_size():
    """Differences of a large `F` tell little of its small slopes: that is no error."""
    rng = np.random.default_rng(0)
    for _ in range(200):
        n = rng.integers(1, 6)
        A = rng.normal(size=(n, n)) * 10.0 ** rng.uniform(-10, 3, (n, n))
        b = rng.normal(size=n) * 10.0 ** rng.uniform(-3, 6, n)
        x = rng.normal(size=n)
        found = zivi.check_jacobian(
            lambda x, A=A, b=b: A @ np.sin(x) + b, lambda x, A=A: A * np.cos(x), x
        )
        assert found.error < 1e-6


def test_the_check_of_a_map_that_returns_both():
    assert zivi.check_jacobian(lambda x: (F(x), jac(x)), True, np.ones(3)).error < 1e-6
    bad = zivi.check_jacobian(lambda x: (F(x), 2 * jac(x)), True, np.ones(3))
    assert bad.error == pytest.approx(0.5, rel=1e-6)


@pytest.mark.slow
@pytest.mark.skipif(not hasattr(signal, "setitimer"), reason="needs an interval timer")
def test_ctrl_c_at_1500_unknowns():
    rng = np.random.default_rng(0)
    n = 1500
    big, q = rng.normal(size=(n, n)), rng.normal(size=n)
    began = []

    def interrupt(*_):
        began.append(time.thread_time())
        raise KeyboardInterrupt

    before = signal.signal(signal.SIGALRM, interrupt)
    signal.setitimer(signal.ITIMER_REAL, 1.5)
    called = time.thread_time()
    try:
        with pytest.raises(KeyboardInterrupt):
            zivi.solve_lcp(big, q)
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)
    # the handler runs where the solver looks: what it has used by then is what it was given, beside
    # what other threads still do of the tests before
    assert began[0] - called < 2.5
    assert time.thread_time() - began[0] < 0.5
