"""solve_vi, solve_avi, natural_residual: what goes in, what comes out."""

import signal
import traceback

import numpy as np
import pytest
import scipy.optimize
import scipy.sparse

import zivi
from interrupting import ctrl_c
from mcp import BY_NAME
from mcp.linear import laplacian
from zivi import vi

INF = np.inf


def parabola(x):
    return x**2 - 2


def untouchable(x):
    raise AssertionError("F must not be called")


def test_the_residual_is_that_of_the_definition():
    rng = np.random.default_rng(0)
    for _ in range(200):
        n = rng.integers(1, 9)
        lower, width = rng.normal(size=n), rng.exponential(size=n)
        lower[rng.random(n) < 0.3] = -INF
        upper = np.where(rng.random(n) < 0.3, INF, np.where(np.isinf(lower), 1.0, lower) + width)
        x = np.clip(rng.normal(size=n), lower, upper)
        F = rng.normal(size=n)
        expected = np.max(np.abs(x - np.clip(x - F, lower, upper)))
        assert zivi.natural_residual(x, F, lower, upper) == pytest.approx(expected, abs=1e-14)
    assert zivi.natural_residual([1e20], [1.57], -INF, INF) == 1.57
    assert np.isnan(zivi.natural_residual([0.5, 0.5], [0.0, np.nan], 0, 1))


def test_the_result():
    res = zivi.solve_vi(parabola, [0.0], [INF], [1.0], jac=lambda x: np.diag(2 * x))
    assert res.success
    assert res.status is zivi.VIStatus.SOLVED
    assert res.status == 0
    assert res.x == pytest.approx([np.sqrt(2)])
    assert pytest.approx([0], abs=1e-9) == res.F
    assert res.residual == zivi.natural_residual(res.x, res.F, 0, INF) <= 1e-9
    assert res.n_iter >= 1
    assert res.nfev >= 2
    assert res.njev >= 1
    assert res.n_pivots >= 0
    assert res.stage == "S0"
    assert not res.projected
    assert "residual" in res.message


def test_evaluations_are_counted():
    calls = {"F": 0, "jac": 0}

    def F(x):
        calls["F"] += 1
        return np.arctan(x)

    def jac(x):
        calls["jac"] += 1
        return np.diag(1 / (1 + x**2))

    res = zivi.solve_vi(F, -INF, INF, [20.0], jac=jac)
    assert (res.nfev, res.njev) == (calls["F"], calls["jac"])
    calls["F"] = 0
    res = zivi.solve_vi(F, -INF, INF, [20.0])
    assert res.nfev == calls["F"]


def test_a_start_outside_the_box_is_projected_and_noted():
    res = zivi.solve_vi(parabola, 0, 1, [7.0])
    assert res.projected
    assert res.x == [1.0]
    assert not zivi.solve_vi(parabola, 0, 1, [0.5]).projected


def test_a_constant_jacobian_dense_and_sparse():
    M, q = laplacian(5), np.full(25, -3.0)
    results = [
        zivi.solve_vi(lambda x: M @ x + q, 0, 0.15, np.zeros(25), jac=jac)
        for jac in (None, M, scipy.sparse.csr_array(M), lambda x: scipy.sparse.csc_matrix(M))
    ]
    results += [zivi.solve_avi(A, q, 0, 0.15) for A in (M, scipy.sparse.coo_array(M), M.tolist())]
    for res in results:
        assert res.success
        np.testing.assert_allclose(res.x, results[0].x, atol=1e-9)
    assert 0 < np.sum(results[0].x == 0.15) < 25


def test_sparse_beyond_the_documented_size_is_not_made_dense():
    n = vi.MAX_DENSE + 1
    eye = scipy.sparse.eye_array(n)
    options = zivi.VIOptions(linear_algebra="dense")
    hint = rf"M is sparse with shape \({n}, {n}\).*MAX_DENSE.*linear_algebra='auto' or 'sparse'"
    with pytest.raises(ValueError, match=hint):
        zivi.solve_avi(eye, np.ones(n), 0, 1, options=options)
    with pytest.raises(ValueError, match="jac is sparse"):
        zivi.solve_vi(untouchable, 0, 1, np.zeros(n), jac=eye, options=options)


def test_exceptions_reach_the_caller_with_their_traceback():
    def F(x):
        if x[0] < 1.5:
            raise RuntimeError("deep inside")
        return np.arctan(x)

    with pytest.raises(RuntimeError, match="deep inside") as caught:
        zivi.solve_vi(F, -INF, INF, [2.0])
    assert any(frame.name == "F" for frame in traceback.extract_tb(caught.value.__traceback__))

    def jac(x):
        raise KeyError("in the Jacobian")

    with pytest.raises(KeyError, match="in the Jacobian"):
        zivi.solve_vi(np.arctan, -INF, INF, [2.0], jac=jac)


def test_keyboard_interrupt_reaches_the_caller():
    def F(x):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        zivi.solve_vi(F, -INF, INF, [2.0])


@pytest.mark.parametrize(
    ("returned", "error", "match"),
    [
        (np.zeros(3), ValueError, r"F\(x\) must have shape \(2,\), got \(3,\)"),
        (0.0, ValueError, r"F\(x\) must have shape \(2,\)"),
        (np.zeros((2, 1)), ValueError, r"F\(x\) must have shape"),
        (np.zeros(2, complex), TypeError, r"F\(x\) must hold real numbers.*complex"),
        (["a", "b"], TypeError, r"F\(x\) must hold real numbers"),
        (None, TypeError, r"F\(x\) must hold real numbers.*object"),
    ],
)
def test_what_f_must_return(returned, error, match):
    with pytest.raises(error, match=match):
        zivi.solve_vi(lambda x: returned, 0, 1, [0.5, 0.5])


def test_what_jac_must_return():
    with pytest.raises(ValueError, match=r"jac\(x\) must have shape \(1, 1\)"):
        zivi.solve_vi(parabola, 0, INF, [1.0], jac=lambda x: np.zeros((2, 2)))
    with pytest.raises(ValueError, match=r"jac must have shape \(1, 1\)"):
        zivi.solve_vi(untouchable, 0, INF, [1.0], jac=np.zeros((2, 2)))
    with pytest.raises(ValueError, match=r"jac\[0, 0\] must be finite"):
        zivi.solve_vi(untouchable, 0, INF, [1.0], jac=[[np.nan]])


def test_arrays_of_other_layouts_are_taken():
    M = np.asfortranarray([[2.0, 1.0], [0.0, 3.0]])
    q = np.array([-1.0, 9.0, -1.0])[::2]
    res = zivi.solve_avi(M, q, 0, INF)
    np.testing.assert_allclose(res.F, M @ res.x + q)
    assert zivi.solve_avi([[1]], [-1], 0, 5).x == [1.0]
    x0 = np.array([1, 0], dtype=np.int32)
    assert zivi.solve_vi(lambda x: M @ x + q, 0, INF, x0, jac=M).success


@pytest.mark.parametrize(
    ("change", "error", "match"),
    [
        ({"F": 3.0}, TypeError, "F must be callable, got float"),
        ({"x0": []}, ValueError, "x0 must have at least one entry, got none"),
        ({"jac": "4-point"}, ValueError, "jac must be '2-point', '3-point' or 'cs', got '4-point'"),
        ({"args": 3}, TypeError, "args must be a tuple, got int"),
        ({"rtol": 1.0}, ValueError, "rtol must be at least 0 and below 1, got 1"),
        ({"rtol": np.nan}, ValueError, "rtol must be at least 0"),
        ({"time_limit": 0}, ValueError, "time_limit must be > 0 seconds, got 0"),
        ({"time_limit": np.nan}, ValueError, "time_limit must be > 0"),
        ({"callback": 3}, TypeError, "callback must be callable, got int"),
        ({"x0": [[0.5, 0.5]]}, ValueError, "x0 must be one-dimensional"),
        ({"x0": [0.5, np.nan]}, ValueError, r"x0\[1\] must be finite, got NaN"),
        ({"x0": [INF, 0.5]}, ValueError, r"x0\[0\] must be finite, got inf"),
        ({"x0": [0.5j, 0.5]}, TypeError, "x0 must hold real numbers.*complex"),
        ({"x0": ["a", "b"]}, TypeError, "x0 must hold real numbers"),
        ({"lower": [0.0]}, ValueError, "lower must have 2 entries"),
        ({"upper": [1.0] * 3}, ValueError, "upper must have 2 entries"),
        ({"lower": [0.0, np.nan]}, ValueError, r"lower\[1\] must be a number"),
        ({"upper": np.nan}, ValueError, r"upper\[0\] must be a number"),
        ({"lower": [0.0, 2.0]}, ValueError, r"lower\[1\] must be <= upper\[1\], got 2 > 1"),
        ({"lower": INF, "upper": INF}, ValueError, r"lower\[0\] must be < \+inf"),
        ({"lower": -INF, "upper": -INF}, ValueError, r"upper\[0\] must be > -inf"),
        ({"tol": 0.0}, ValueError, "tol must be a finite number > 0, got 0"),
        ({"tol": np.nan}, ValueError, "tol must be"),
        ({"tol": "small"}, TypeError, "tol must be a real number"),
        ({"max_iter": 0}, ValueError, "max_iter must be >= 1, got 0"),
        ({"max_iter": -1}, ValueError, "max_iter must be >= 1, got -1"),
        ({"max_iter": 2.5}, TypeError, "max_iter must be an integer"),
        ({"options": 3}, TypeError, "options must be a VIOptions or a dict, got int"),
        ({"options": {"restart": 3}}, TypeError, "options has unknown entry 'restart'; .*restarts"),
        ({"options": {"maxiter": 0}}, ValueError, "max_iter must be >= 1, got 0"),
        ({"bounds": (0, 1)}, TypeError, "bounds must be given once"),
        ({"x0": None}, TypeError, "x0 must be given"),
        ({"options": zivi.VIOptions(restarts=9)}, ValueError, "restarts must be 0 to 8"),
        ({"options": zivi.VIOptions(memory=0)}, ValueError, "memory must be 1 to 16"),
        ({"options": zivi.VIOptions(row_scale="rows")}, ValueError, "row_scale must be None"),
        ({"options": zivi.VIOptions(row_scale=[1.0])}, ValueError, "row_scale must have 2"),
        ({"options": zivi.VIOptions(row_scale=[1.0, 0.0])}, ValueError, "row_scale must be"),
    ],
)
def test_bad_input_is_refused_before_f_is_called(change, error, match):
    given = {"F": untouchable, "lower": 0.0, "upper": 1.0, "x0": [0.5, 0.5]} | change
    with pytest.raises(error, match=match):
        zivi.solve_vi(**given)


@pytest.mark.parametrize(
    ("change", "error", "match"),
    [
        ({"M": np.eye(3)}, ValueError, r"M must have shape \(2, 2\), got \(3, 3\)"),
        ({"M": np.eye(2) * 1j}, TypeError, "M must hold real numbers"),
        ({"M": [[1, 0], [np.nan, 1]]}, ValueError, r"M\[1, 0\] must be finite"),
        ({"q": [0.0, INF]}, ValueError, r"q\[1\] must be finite, got inf"),
        ({"q": [], "M": []}, ValueError, "q must have at least one entry, got none"),
        ({"q": 1.0}, ValueError, "q must be one-dimensional"),
        ({"x0": [0.0]}, ValueError, "x0 must have 2 entries"),
        ({"lower": [3.0, 0.0]}, ValueError, r"lower\[0\] must be <= upper\[0\]"),
    ],
)
def test_bad_affine_input_is_refused(change, error, match):
    given = {"M": np.eye(2), "q": [0.0, 1.0], "lower": 0.0, "upper": 1.0} | change
    with pytest.raises(error, match=match):
        zivi.solve_avi(**given)


def test_unknown_keywords_raise():
    with pytest.raises(TypeError, match="tolerance"):
        zivi.solve_vi(parabola, 0, 1, [0.5], tolerance=1e-6)
    with pytest.raises(TypeError, match="restart"):
        zivi.VIOptions(restart=3)


def test_an_iteration_limit_keeps_the_best_point():
    res = zivi.solve_vi(np.arctan, -INF, INF, [20.0], max_iter=2)
    assert res.status is zivi.VIStatus.ITERATION_LIMIT
    assert not res.success
    assert res.n_iter == 2
    assert abs(res.x[0]) < 20
    assert res.residual == abs(np.arctan(res.x[0]))


def test_non_finite_everywhere_is_a_domain_error():
    res = zivi.solve_vi(lambda x: x * np.nan, 0, 1, [0.5])
    assert res.status is zivi.VIStatus.DOMAIN_ERROR
    assert not res.success


def test_row_scaling_changes_what_is_small():
    weak = {"F": lambda x: 1e-12 * (x - 0.25), "lower": 0, "upper": 1, "x0": [0.9], "tol": 1e-9}
    assert zivi.solve_vi(**weak).x == [0.9]
    for row_scale in ("jacobian", [1e12]):
        res = zivi.solve_vi(**weak, options=zivi.VIOptions(row_scale=row_scale))
        assert res.x == pytest.approx([0.25], abs=1e-9)
        assert res.residual < res.scaled_residual or res.scaled_residual == 0


def test_the_default_tolerance_knows_small_units():
    assert zivi.solve_lcp([[1e-12]], [-1e-10]).x == pytest.approx([100.0], rel=1e-9)
    assert zivi.solve_lcp([[1e-12]], [-1e-10], tol=1e-9).x == [0.0]
    assert not zivi.solve_lcp([[-1e-12]], [-1e-10]).success
    assert not zivi.solve_ncp(lambda x: -1e-10 * (1 + x**2), [0.0]).success
    for scale in 10.0 ** np.arange(-15, 1):
        res = zivi.solve_vi(lambda x, s=scale: s * (x**3 - 8), 0, INF, [1.0])
        assert res.success
        assert res.x == pytest.approx([2.0], rel=1e-7)
        rng = np.random.default_rng(1)
        A, q = rng.normal(size=(6, 6)), rng.normal(size=6)
        M = A @ A.T + np.eye(6)
        expected = zivi.solve_lcp(M, q).x
        assert 0 < np.sum(expected > 0) < 6
        for m, c in ((scale, scale), (1, scale), (scale, 1), (1 / scale, scale)):
            res = zivi.solve_lcp(m * M, c * q)
            assert res.success
            np.testing.assert_allclose(res.x, expected * c / m, rtol=1e-6, atol=1e-9 * c / m)
    # a start that is a solution but for rounding remains one
    res = zivi.solve_vi(lambda x: x**3, 0, INF, [1e-6])
    assert res.success
    assert zivi.solve_vi(lambda x: x - np.pi, -INF, INF, [np.pi * (1 + 3e-16)]).success


def test_free_problems_agree_with_scipy():
    """Where all variables are free it is a system of equations."""
    agreed = 0
    for seed in range(200):
        rng = np.random.default_rng(seed)
        n = rng.integers(1, 8)
        A, b = rng.normal(size=(n, n)), rng.normal(size=n)
        M = A @ A.T + 0.5 * np.eye(n)

        def F(x, M=M, b=b):
            return M @ x + np.arctan(x) + b

        ours = zivi.solve_vi(F, -INF, INF, np.zeros(n))
        theirs = scipy.optimize.root(F, np.zeros(n), tol=1e-12)
        assert ours.success
        if theirs.success:
            np.testing.assert_allclose(ours.x, theirs.x, atol=1e-7)
            agreed += 1
    assert agreed >= 190


def test_a_bounded_quadratic_program_agrees_with_scipy():
    """x minimises x'Hx/2 + q'x on the box exactly when it solves the AVI with H, q."""
    for seed in range(50):
        rng = np.random.default_rng(seed)
        n = 30
        A, q = rng.normal(size=(n, n)), rng.normal(size=n)
        H = A @ A.T / n + 0.01 * np.eye(n)
        root = np.linalg.cholesky(H).T
        target = np.linalg.solve(root.T, -q)
        theirs = scipy.optimize.lsq_linear(root, target, (-0.5, 0.5), method="bvls", tol=1e-14)
        ours = zivi.solve_avi(H, q, -0.5, 0.5)
        assert ours.success
        np.testing.assert_allclose(ours.x, theirs.x, atol=1e-8)


def test_sizes_of_the_obstacle_problem():
    """The pivotal solver alone reaches the solution: one affine solve, no Newton iteration."""
    for m in (5, 10, 15):
        M, q = laplacian(m), np.full(m * m, -10.0)
        res = zivi.solve_avi(M, q, 0, 0.5)
        assert res.success
        assert res.n_iter == 1
        assert 0 < np.sum(res.x == 0.5) < m * m
        np.testing.assert_allclose(res.x, res.x.reshape(m, m).T.ravel(), atol=1e-10)


@pytest.mark.skipif(not hasattr(signal, "setitimer"), reason="needs an interval timer")
@pytest.mark.parametrize("jac", ["affine", "given", "differences"])
def test_ctrl_c_interrupts_long_pivoting(jac):
    """Random matrices of this size take many seconds, most of them in vain."""
    rng = np.random.default_rng(0)
    n = 400
    M, q = rng.normal(size=(n, n)), rng.normal(size=n)

    def solve():
        if jac == "affine":
            return zivi.solve_avi(M, q, 0, INF)
        constant = M if jac == "given" else None
        return zivi.solve_vi(lambda x: M @ x + q, 0, INF, np.zeros(n), jac=constant)

    with ctrl_c(), pytest.raises(KeyboardInterrupt):
        solve()


def test_a_continuum_is_told_from_an_isolated_solution():
    M, q = [[1, 1], [1, 1]], [-0.5, -0.5]
    assert zivi.solve_avi(M, q, -1, 1).status is zivi.VIStatus.SOLVED_NOT_ISOLATED
    untested = zivi.VIOptions(test_isolation=False)
    assert zivi.solve_avi(M, q, -1, 1, options=untested).status is zivi.VIStatus.SOLVED
    assert zivi.solve_avi([[1, 1], [0, 1]], q, -1, 1).status is zivi.VIStatus.SOLVED


def test_statuses_have_messages_that_say_what_to_try():
    messages = {}
    problem = BY_NAME["nosol_quad"]
    for res in (
        zivi.solve_vi(problem.F, 0, INF, [0.0]),
        zivi.solve_vi(np.arctan, -INF, INF, [20.0], max_iter=1),
        zivi.solve_vi(lambda x: x * np.nan, 0, 1, [0.5]),
    ):
        messages[res.status] = res.message
    assert len(messages) == 3
    assert all("try" in text or "raise" in text or "start" in text for text in messages.values())
