"""The sparse solver of box VIs: counts of factorisations, other solvers, and definitions."""

import itertools
import sys
from pathlib import Path

import numpy as np
import pytest
import scipy.sparse as sp

import zivi
from example_scripts import example

sys.path.append(str(Path(__file__).parents[1] / "benchmarks"))
import vi_sparse_problems

INF = np.inf
SPARSE = zivi.VIOptions(linear_algebra="sparse")
large = example("large_vi")


def test_the_figure_is_drawn(tmp_path, capsys):
    large.main(str(tmp_path / "large.png"), n=18)
    assert (tmp_path / "large.png").stat().st_size > 1000
    assert capsys.readouterr().out.count("factorisations") == 6


def residual(p, x):
    """The natural residual with the rows of the matrix scaled to 1, written anew."""
    F = (p.M @ x + p.q) / abs(p.M).max(axis=1).toarray().ravel()
    assert np.all((p.lower <= x) & (x <= p.upper))
    return np.max(np.abs(np.maximum(x - p.upper, np.minimum(x - p.lower, F))))


@pytest.mark.parametrize(
    ("name", "n", "most"),
    [
        ("obstacle", 48, 12),
        ("torsion", 48, 13),
        ("bearing", 48, 14),
        ("american_put", 2000, 12),
        ("american_put", 20_000, 17),
    ],
)
def test_few_factorisations_from_afar(name, n, most):
    p = getattr(large, name)(n)
    res = zivi.solve_avi(*p)
    assert res.success, res.message
    assert residual(p, res.x) <= 1e-12
    assert 0 < res.n_factorisations <= most
    assert res.n_pivots == 0
    assert res.fill > p.M.nnz / 2
    np.testing.assert_array_equal(res.F, p.M @ res.x + p.q)


@pytest.mark.parametrize("name", ["obstacle", "torsion", "bearing"])
def test_a_cascade_of_grids_takes_few_factorisations_on_the_finest(name):
    problem = getattr(large, name)
    results = large.cascade(problem, [12, 24, 48])
    assert all(res.success for res in results)
    assert results[-1].n_factorisations <= 4
    assert residual(problem(48), results[-1].x) <= 1e-12


def test_a_warm_start_takes_few_factorisations():
    p = large.obstacle(40)
    first = zivi.solve_avi(*p)
    heavier = p._replace(q=1.01 * p.q)
    again = zivi.solve_avi(*heavier, first.x)
    assert again.success
    assert again.n_factorisations <= 4
    assert residual(heavier, again.x) <= 1e-12
    assert zivi.solve_avi(*p, first.x).n_iter == 0


def test_equal_to_the_dense_solver_on_grids():
    for name, n in (("obstacle", 18), ("torsion", 18), ("bearing", 18), ("american_put", 400)):
        p = getattr(large, name)(n)
        dense = zivi.solve_avi(p.M.toarray(), *p[1:])
        res = zivi.solve_avi(*p)
        assert dense.n_factorisations == dense.fill == 0 < res.n_factorisations
        np.testing.assert_allclose(res.x, dense.x, atol=1e-9)


def test_a_membrane_between_two_obstacles_needs_no_pivots():
    p = vi_sparse_problems.two_sided(24)
    res = zivi.solve_avi(*p)
    assert res.success
    assert res.n_pivots == 0
    assert residual(p, res.x) <= 1e-12


def test_a_pile_of_discs_with_a_singular_matrix():
    p = large.discs(12, 13)
    n = len(p.q)
    assert np.linalg.matrix_rank(p.M.toarray()) < n
    res = zivi.solve_avi(*p)
    assert res.status in (zivi.VIStatus.SOLVED, zivi.VIStatus.SOLVED_NOT_ISOLATED)
    assert res.n_factorisations <= 16
    assert residual(p, res.x) <= 1e-13  # exact, though the Jacobian inside is singular
    # the gap velocities are unique, the impulses are not
    p = large.discs(5, 6)
    res = zivi.solve_avi(*p, options=SPARSE)
    dense = zivi.solve_avi(p.M.toarray(), *p[1:])
    assert dense.success
    np.testing.assert_allclose(p.M @ res.x + p.q, p.M @ dense.x + p.q, atol=1e-6)


def test_spatial_prices():
    F, jac, x0 = large.Prices(15, 12).problem()
    small = large.Prices(2, 3).problem()
    assert zivi.check_jacobian(small[0], small[1], np.full(11, 1.5)).error < 1e-6
    res = zivi.solve_ncp(F, x0, jac=jac)
    assert res.success
    assert res.n_factorisations <= 25
    assert np.max(np.abs(np.minimum(res.x, F(res.x)))) <= 1e-9
    used = res.x[: 15 * 12] > 1e-6
    assert 10 < used.sum() < 15 * 12


def test_firms_that_sell_to_many_markets():
    """A few long rows and no symmetric pattern: an order by A'A would fill all."""
    loss, jac, lower, start = vi_sparse_problems.cournot(5, 7)
    assert zivi.check_jacobian(loss, jac, 1.3 * start + 0.1 * np.arange(len(start))).error < 1e-6
    loss, jac, lower, start = vi_sparse_problems.cournot(40, 40)
    res = zivi.solve_vi(loss, lower, np.inf, start, jac=jac)
    assert res.success
    assert res.n_factorisations <= 25
    assert res.fill < 5 * jac(start).nnz
    F = loss(res.x)
    np.testing.assert_array_less(np.abs(np.where(lower < 0, F, np.minimum(res.x, F))), 1e-9)
    sells = res.x[:1600] > 1e-6
    assert 200 < sells.sum() < 1400


def test_a_transport_problem_has_the_cost_of_the_linear_program():
    from scipy.optimize import linprog

    k = 20
    p = vi_sparse_problems.transport(k)
    A, flows = -p.M[:, : k * k][k * k :], p.M[: k * k]
    assert flows[:, : k * k].nnz == 0
    best = linprog(p.q[: k * k], A, p.q[k * k :])
    res = zivi.solve_lcp(p.M, p.q)
    assert res.success
    assert res.n_factorisations <= 40
    assert res.x[: k * k] @ p.q[: k * k] == pytest.approx(best.fun, rel=1e-9)


def enumerated(M, q):
    """All solutions of a small linear complementarity problem with regular submatrices."""
    n = len(q)
    for pattern in itertools.product([False, True], repeat=n):
        free = np.flatnonzero(pattern)
        x = np.zeros(n)
        x[free] = np.linalg.solve(M[np.ix_(free, free)], -q[free])
        if np.all(x >= -1e-9) and np.all(M @ x + q >= -1e-9):
            yield x


def test_small_problems_by_enumeration():
    rng = np.random.default_rng(0)
    for _ in range(40):
        n = rng.integers(2, 6)
        A = rng.normal(size=(n, n))
        M, q = A @ A.T + (A - A.T) + 0.1 * np.eye(n), rng.normal(size=n)
        res = zivi.solve_lcp(sp.csr_array(M), q, options=SPARSE)
        assert res.success
        assert any(np.allclose(res.x, x, atol=1e-7) for x in enumerated(M, q))


def chain(x):
    """A map whose Jacobian is tridiagonal."""
    left, right = np.append(0, x[:-1]), np.append(x[1:], 0)
    return 2 * x + np.exp(0.3 * x) - 0.9 * np.sin(left) - 0.8 * right - 1.5


def chain_slopes(x):
    n = len(x)
    return sp.diags_array(
        [-0.9 * np.cos(x[:-1]), 2 + 0.3 * np.exp(0.3 * x), np.full(n - 1, -0.8)],
        offsets=[-1, 0, 1],
        format="csr",
    )


@pytest.mark.parametrize(("scheme", "per_jacobian"), [(None, 7), ("2-point", 4), ("cs", 3)])
@pytest.mark.parametrize("n", [50, 500])
def test_coloured_differences(scheme, per_jacobian, n):
    calls = [0]

    def F(x):
        calls[0] += 1
        return chain(x)

    pattern = sp.diags_array([1.0, 1.0, 1.0], offsets=[-1, 0, 1], shape=(n, n))
    start = np.linspace(0, 1, n)
    res = zivi.solve_vi(F, 0, 0.8, start, jac=scheme, jac_sparsity=pattern)
    expected = zivi.solve_vi(chain, 0, 0.8, start, jac=chain_slopes)
    assert res.success
    assert res.nfev == calls[0] <= expected.nfev + 2 + per_jacobian * (res.njev + 1)
    np.testing.assert_allclose(res.x, expected.x, atol=1e-8)
    assert np.max(np.abs(np.maximum(res.x - 0.8, np.minimum(res.x, chain(res.x))))) <= 1e-9


def test_colours_share_no_row():
    from inside import colours_of, pattern_of

    for seed in range(10):
        pattern = pattern_of(sp.random_array((40, 40), density=0.08, rng=seed), 40)
        colours = colours_of(pattern)
        for colour in range(colours.max() + 1):
            rows = np.asarray(pattern.todense())[:, colours == colour].sum(axis=1)
            assert rows.max() <= 1
    dense = zivi.solve_vi(chain, 0, 0.8, np.ones(8), jac_sparsity=np.ones((8, 8)))
    assert dense.success
    with pytest.raises(ValueError, match=r"jac_sparsity must have shape \(8, 8\)"):
        zivi.solve_vi(chain, 0, 0.8, np.ones(8), jac_sparsity=np.ones((8, 7)))
    with pytest.raises(ValueError, match="jac_sparsity needs finite differences"):
        zivi.solve_vi(chain, 0, 1, np.ones(8), jac=chain_slopes, jac_sparsity=np.ones((8, 8)))


def test_problems_without_a_solution():
    n = 400
    M = sp.eye_array(n, format="lil")
    M[0, 0], M[0, 1], M[1, 0], M[1, 1] = 1.0, -1.0, -1.0, 1.0
    q = np.zeros(n)
    q[:2] = -1.0  # x0 - x1 >= 1 and x1 - x0 >= 1
    res = zivi.solve_lcp(M, q)
    assert res.status is zivi.VIStatus.INFEASIBLE
    one = sp.diags_array(np.append(np.ones(n - 1), 0.0), format="csr")
    q = np.append(np.zeros(n - 1), -1.0)
    assert zivi.solve_lcp(one, q).status is zivi.VIStatus.INFEASIBLE
    assert zivi.solve_lcp(one, -q).success
    # three rows that exclude each other, none of them alone nor two
    M = sp.eye_array(n, format="lil")
    M[:3, :3] = [[1, -1, 0], [0, 1, -1], [-1, 0, 1]]
    q = np.append(np.full(3, -0.1), np.zeros(n - 3))
    assert zivi.solve_lcp(M, q).status is zivi.VIStatus.INFEASIBLE


def test_the_callback_and_the_limits():
    p = large.torsion(30)
    seen = []
    res = zivi.solve_avi(*p, callback=seen.append)
    assert [it.iteration for it in seen][-1] <= res.n_iter
    assert {it.stage for it in seen} == {"S0", "IP"}

    def stop(progress):
        if progress.iteration == 2:
            raise StopIteration

    stopped = zivi.solve_avi(*p, callback=stop, tol=1e-9)
    assert stopped.status is zivi.VIStatus.STOPPED
    assert stopped.n_iter == 2
    assert stopped.residual == zivi.natural_residual(stopped.x, p.M @ stopped.x + p.q, *p[2:])
    few = zivi.solve_avi(*p, max_iter=3, tol=1e-9)
    assert few.status is zivi.VIStatus.ITERATION_LIMIT
    assert few.n_iter == 3
    late = zivi.solve_avi(*large.torsion(60), time_limit=1e-9)
    assert late.status is zivi.VIStatus.TIME_LIMIT

    def fail(progress):
        raise KeyError("in the callback")

    with pytest.raises(KeyError, match="in the callback"):
        zivi.solve_avi(*p, callback=fail)


def test_arguments_of_sparse_problems():
    eye = sp.eye_array(400, format="csr")
    with pytest.raises(ValueError, match="linear_algebra must be 'auto', 'dense' or 'sparse'"):
        zivi.solve_lcp(eye, np.ones(400), options={"linear_algebra": "banded"})
    with pytest.raises(ValueError, match=r"M must have shape \(3, 3\), got \(400, 400\)"):
        zivi.solve_lcp(eye, np.ones(3), options=SPARSE)
    with pytest.raises(ValueError, match=r"lower\[7\] must be <= upper\[7\]"):
        zivi.solve_avi(eye, np.ones(400), np.where(np.arange(400) == 7, 2.0, 0.0), 1.0)
    with pytest.raises(ValueError, match=r"M\[3, 3\] must be finite, got nan"):
        zivi.solve_lcp(sp.diags_array(np.where(np.arange(400) == 3, np.nan, 1)), np.ones(400))
    with pytest.raises(ValueError, match=r"q\[2\] must be finite"):
        zivi.solve_lcp(eye, np.where(np.arange(400) == 2, INF, 1))
    with pytest.raises(ValueError, match=r"x0\[0\] must be finite"):
        zivi.solve_lcp(eye, np.ones(400), np.full(400, np.nan))
    with pytest.raises(TypeError, match="M must hold real numbers, got dtype complex128"):
        zivi.solve_lcp(eye * 1j, np.ones(400))
    with pytest.raises(ValueError, match="tol must be a finite number > 0"):
        zivi.solve_lcp(eye, np.ones(400), tol=-1)
    with pytest.raises(ValueError, match="row_scale must have 400 entries, got 3"):
        zivi.solve_lcp(eye, np.ones(400), options={"row_scale": np.ones(3)})


def test_every_way_to_a_sparse_jacobian():
    n = 400
    expected = zivi.solve_vi(chain, 0, 0.8, np.zeros(n), jac=lambda x: chain_slopes(x).toarray())
    for solve in (
        lambda: zivi.solve_vi(chain, 0, 0.8, np.zeros(n), jac=chain_slopes),
        lambda: zivi.solve_ncp(chain, np.zeros(n), upper=0.8, jac=chain_slopes),
        lambda: zivi.solve_vi(lambda x: (chain(x), chain_slopes(x)), 0, 0.8, np.zeros(n), jac=True),
        lambda: zivi.solve_vi(
            chain, 0, 0.8, np.zeros(n), jac=lambda x: chain_slopes(x).toarray(), options=SPARSE
        ),
        lambda: zivi.solve_vi(
            chain, 0, 0.8, np.zeros(n), jac=chain_slopes, options={"row_scale": "jacobian"}
        ),
        lambda: zivi.solve_vi(
            chain, 0, 0.8, np.zeros(n), jac=sp.coo_matrix(chain_slopes(expected.x))
        ),
    ):
        res = solve()
        assert res.success
        assert res.n_factorisations > 0
        np.testing.assert_allclose(res.x, expected.x, atol=1e-8)
    many = 2500
    res = zivi.solve_vi(chain, 0, 0.8, np.zeros(many), jac=chain_slopes)
    assert res.success
    np.testing.assert_allclose(res.x[:100], expected.x[:100], atol=1e-8)


def test_maps_that_are_not_defined_everywhere():
    """Logarithms whose Jacobian is infinite at the start, and exceptions."""
    n = 400
    A = chain_slopes(np.zeros(n))

    def F(x):
        if np.any(x < 0):
            raise ValueError("below zero")
        with np.errstate(divide="ignore"):
            return A @ x + np.log(x) + np.linspace(-3, 3, n)

    def jac(x):
        with np.errstate(divide="ignore"):
            return A + sp.diags_array(1 / x)

    res = zivi.solve_vi(F, 0, 5, np.zeros(n), jac=jac)
    assert res.success
    assert np.max(np.abs(np.maximum(res.x - 5, np.minimum(res.x, F(res.x))))) <= 1e-9
    with pytest.raises(ZeroDivisionError):
        zivi.solve_vi(lambda x: 1 / 0, 0, 5, np.zeros(n), jac=jac)
    nowhere = zivi.solve_vi(
        lambda x: np.full(3000, np.nan), 0, 5, np.zeros(3000), jac=sp.eye_array(3000)
    )
    assert nowhere.status is zivi.VIStatus.DOMAIN_ERROR


def test_small_units_are_solved_in_their_own():
    n = 400
    M = sp.diags_array([-1.0, 2.5, -1.0], offsets=[-1, 0, 1], shape=(n, n)) * 1e-12
    q = np.where(np.arange(n) % 3 == 0, -1.0, 0.3) * 1e-10
    res = zivi.solve_lcp(M, q)
    expected = zivi.solve_lcp(M * 1e12, q * 1e12)
    np.testing.assert_allclose(res.x, expected.x, atol=1e-6)
    assert expected.x.max() > 10
