"""solve_vi and solve_avi: what F may do, how a solve is watched, where slopes come from."""

import numpy as np
import pytest
import scipy.sparse

import zivi
from zivi import vi

INF = np.inf
ONE_STAGE = {
    "smoothing": False,
    "semismooth": False,
    "proximal": False,
    "restarts": 0,
    "enumerate_up_to": 0,
}


@pytest.mark.parametrize("error", [ZeroDivisionError, OverflowError, ValueError])
def test_errors_of_arithmetic_at_trial_points_mean_undefined(error):
    """The first Newton step from 2 goes to -3.5: as if F were NaN there."""

    def F(x, fail):
        if x[0] < -1.5:
            if fail:
                raise error("out of the domain")
            return np.array([np.nan])
        return np.arctan(x)

    res, expected = (zivi.solve_vi(F, -INF, INF, [2.0], args=(fail,)) for fail in (True, False))
    assert res.success
    assert "out of the domain" in res.message
    np.testing.assert_array_equal(res.x, expected.x)
    assert res.nfev == expected.nfev
    assert "domain" not in expected.message


def test_at_the_start_they_reach_the_caller():
    def F(x):
        raise ValueError("not here")

    with pytest.raises(ValueError, match="not here"):
        zivi.solve_vi(F, 0, 1, [0.5])
    with pytest.raises(ValueError, match="not here"):
        zivi.solve_vi(np.arctan, -1, 1, [0.5], jac=F)


def test_a_wrong_shape_is_an_error_at_any_point():
    def F(x):
        return np.zeros(2) if x[0] < 1.5 else np.arctan(x)

    with pytest.raises(ValueError, match=r"F\(x\) must have shape \(1,\), got \(2,\)"):
        zivi.solve_vi(F, -INF, INF, [2.0])


def test_slopes_that_fail_at_trial_points_are_differenced():
    def jac(x):
        if x[0] == 0:
            raise ZeroDivisionError
        return [[0.5 / np.sqrt(x[0])]]

    res = zivi.solve_vi(lambda x: np.sqrt(x) - [0.3], 0, INF, [4.0], jac=jac)
    assert res.success
    assert res.x == pytest.approx([0.09], abs=1e-8)


@pytest.mark.parametrize("jac", [None, "given"])
def test_single_precision_has_its_own_rounding(jac):
    """F from a library in float32 cannot be smaller than its rounding, 1e-7 of its terms."""
    rng = np.random.default_rng(4)
    A, b = rng.normal(size=(8, 8)), 100 * rng.normal(size=8)
    M = A @ A.T + np.eye(8)
    single, calls = M.astype(np.float32), [0]

    def F(x):
        calls[0] += 1
        return single @ x.astype(np.float32) + b.astype(np.float32)

    res = zivi.solve_vi(F, -INF, INF, np.zeros(8), jac=None if jac is None else M)
    assert res.success, res.message
    assert 1e-9 < res.residual <= res.tolerance < 1e-2
    np.testing.assert_allclose(res.x, np.linalg.solve(M, -b), rtol=1e-3, atol=1e-3)
    assert calls[0] == res.nfev <= 200
    exact = zivi.solve_vi(lambda x: M @ x + b, -INF, INF, np.zeros(8), jac=M)
    assert exact.tolerance < 1e-9 + 1e-10


def test_one_unknown_may_be_a_number():
    res = zivi.solve_vi(lambda x: float(x[0]) ** 2 - 2, 0, INF, 1.0, jac=lambda x: 2 * x[0])
    assert res.success
    assert res.x.shape == res.F.shape == (1,)
    assert res.x == pytest.approx([np.sqrt(2)])
    assert zivi.solve_ncp(lambda x: x - 3, 1).x == pytest.approx([3.0])


def test_sparse_slopes_that_are_too_large_to_be_made_dense_are_refused_before_f_is_called():
    def untouchable(x):
        raise AssertionError("F must not be called")

    n = vi.MAX_DENSE + 1
    eye = scipy.sparse.eye_array(n, format="csr")
    with pytest.raises(ValueError, match=r"jac\(x\) is sparse with shape"):
        zivi.solve_vi(
            untouchable,
            0,
            1,
            np.zeros(n),
            jac=lambda x: eye,
            options={"linear_algebra": "dense"},
        )


def test_further_arguments_reach_f_and_its_jacobian():
    res = zivi.solve_vi(
        lambda x, a, b: a * x - b,
        -INF,
        INF,
        [0.0],
        args=(4.0, 2.0),
        jac=lambda x, a, b: [[a]],
    )
    assert res.x == [0.5]


def coupled(x):
    return np.array([x[0] ** 3 + np.exp(x[1]) - 2, np.sin(x[0]) + 3 * x[1] - 1])


def slopes(x):
    return np.array([[3 * x[0] ** 2, np.exp(x[1])], [np.cos(x[0]), 3.0]])


@pytest.mark.parametrize(("scheme", "per_jacobian"), [("2-point", 3), ("3-point", 4), ("cs", 2)])
def test_schemes_for_the_slopes(scheme, per_jacobian):
    calls = [0]

    def F(x):
        calls[0] += 1
        return coupled(x)

    res = zivi.solve_vi(F, -INF, INF, [0.5, 0.5], jac=scheme)
    expected = zivi.solve_vi(coupled, -INF, INF, [0.5, 0.5], jac=slopes)
    assert res.success
    np.testing.assert_allclose(res.x, expected.x, atol=1e-8)
    assert res.nfev == calls[0]
    # the evaluations that are not for slopes are those with slopes given
    assert res.nfev <= expected.nfev + 2 + per_jacobian * res.njev


def test_complex_steps_need_an_analytic_map():
    with pytest.raises(TypeError, match="must be complex where x is"):
        zivi.solve_vi(lambda x: np.abs(x) - 1, -INF, INF, [0.5], jac="cs")


def test_the_isolation_test_makes_no_new_differences():
    """25 evaluations in 100 were for it."""
    rng = np.random.default_rng(0)
    M, b = np.eye(20) * 4 + rng.normal(size=(20, 20)) / 5, rng.normal(size=20)

    def F(x):
        return M @ x + np.arctan(x) + b

    tested, untested = (
        zivi.solve_vi(F, 0, INF, np.ones(20), options=zivi.VIOptions(test_isolation=flag))
        for flag in (True, False)
    )
    assert tested.success
    assert tested.nfev == untested.nfev
    continuum = zivi.solve_vi(lambda x: np.full(2, x.sum() - 0.5), -1, 1, [0.3, 0.4])
    assert continuum.status is zivi.VIStatus.SOLVED_NOT_ISOLATED


def test_the_callback_sees_every_iteration():
    seen = []
    res = zivi.solve_vi(coupled, -INF, INF, [0.5, 0.5], jac=slopes, callback=seen.append)
    assert [progress.iteration for progress in seen] == list(range(1, res.n_iter + 1))
    assert seen[-1].residual == res.residual
    assert {progress.stage for progress in seen} == {"S0"}
    M, q = np.diag([1.0, 1.0, 1.0]), np.array([0.0, -3.0, 0.0])
    seen.clear()
    one_step = {"stage_iterations": 1, "line_search": True, **ONE_STAGE}
    zivi.solve_vi(
        lambda x: M @ x + q + x**3,
        -INF,
        INF,
        np.zeros(3),
        callback=seen.append,
        options=zivi.VIOptions(**one_step),
    )
    assert [progress.worst for progress in seen] == [1]
    affine = []
    assert zivi.solve_avi(M, q, -1, 1, callback=affine.append).n_iter == len(affine) == 1


def test_the_callback_may_stop_the_solve():
    def stop(progress):
        if progress.iteration == 2:
            raise StopIteration

    res = zivi.solve_vi(np.arctan, -INF, INF, [20.0], callback=stop)
    assert res.status is zivi.VIStatus.STOPPED
    assert res.n_iter == 2
    assert not res.success
    assert np.arctan(res.x) == res.F
    assert res.residual == abs(np.arctan(res.x[0])) < np.arctan(20.0)

    def fail(progress):
        raise KeyError("in the callback")

    with pytest.raises(KeyError, match="in the callback"):
        zivi.solve_vi(np.arctan, -INF, INF, [20.0], callback=fail)


@pytest.mark.parametrize("affine", [True, False])
def test_a_time_limit_keeps_the_best_point(affine):
    """Random matrices of this size take many seconds, most of them in vain."""
    rng = np.random.default_rng(1)
    n = 250
    M = rng.normal(size=(n, n))
    q = rng.uniform(1, 2, n) - M @ rng.uniform(1, 2, n)  # feasible
    if affine:
        res = zivi.solve_lcp(M, q, time_limit=0.1)
    else:
        res = zivi.solve_ncp(lambda x: M @ x + q, np.zeros(n), jac=M, time_limit=0.1)
    assert res.status is zivi.VIStatus.TIME_LIMIT
    assert "time limit" in res.message
    np.testing.assert_allclose(res.F, M @ res.x + q)
    assert res.residual == zivi.natural_residual(res.x, res.F, 0, INF)
    assert zivi.solve_lcp(np.eye(2), [-1, 1], time_limit=1e300).success


def test_a_relative_tolerance():
    calls = [0]

    def F(x):
        calls[0] += 1
        return 1e6 * np.arctan(x)

    loose = zivi.solve_vi(F, -INF, INF, [1.0], rtol=1e-3)
    assert loose.success
    assert 1e-9 < loose.residual <= loose.tolerance == pytest.approx(1e3 * np.arctan(1.0))
    strict = zivi.solve_vi(F, -INF, INF, [1.0])
    assert strict.residual <= strict.tolerance < loose.residual
    scaled = zivi.solve_vi(
        F, -INF, INF, [1.0], rtol=1e-3, options=zivi.VIOptions(row_scale="jacobian")
    )
    assert scaled.tolerance == pytest.approx(1e-3 * np.arctan(1.0) / 0.5, rel=1e-6)


def test_the_names_of_scipy():
    res = zivi.solve_avi([[2, 1], [1, 2]], [-5, -6], -1, 1)
    assert res.fun is res.F
    assert res.nit == res.n_iter


def test_the_check_of_a_jacobian():
    good = zivi.check_jacobian(coupled, slopes, [0.3, -0.4])
    assert good.error < 1e-8

    def wrong(x, factor):
        J = slopes(x)
        J[1, 0] *= factor
        return J

    bad = zivi.check_jacobian(lambda x, _: coupled(x), wrong, [0.3, -0.4], args=(2.0,))
    assert (bad.row, bad.column) == (1, 0)
    assert bad.given == 2 * np.cos(0.3)
    assert bad.expected == pytest.approx(np.cos(0.3), abs=1e-8)
    assert np.isnan(zivi.check_jacobian(coupled, lambda x: np.full((2, 2), np.nan), [0, 0]).error)
    with pytest.raises(ValueError, match=r"jac\(x\) must have shape \(2, 2\)"):
        zivi.check_jacobian(coupled, lambda x: np.eye(3), [0.0, 0.0])


def test_a_budget_of_pivots_bounds_all_work():
    """Fifty pivots cost no more than a few factorisations, whatever stage makes them."""
    rng = np.random.default_rng(2)
    n = 150
    M, q = rng.normal(size=(n, n)), rng.normal(size=n)
    seen = []
    options = zivi.VIOptions(total_pivots=50)
    res = zivi.solve_lcp(M, q, callback=seen.append, options=options)
    assert not res.success
    assert res.n_pivots <= 50
    assert res.n_semismooth_steps <= 3
    assert res.n_iter <= 12
