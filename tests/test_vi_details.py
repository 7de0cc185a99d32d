"""Small cases of the solvers of VIs: single stages, limits, what is read and what is refused."""

import threading
from types import SimpleNamespace

import numpy as np
import pytest
import scipy.optimize
import scipy.sparse as sp
from scipy.sparse.linalg import splu

import zivi
from inside import (
    Affine,
    AffineMap,
    ColouredDifferences,
    Factoriser,
    Factors,
    ReleaseEvent,
    Search,
    _agrees,
    _is_within_rounding,
    _proves,
    _sizes,
    _Smoothing,
    _zivi,
    colours_of,
    in_thread,
    interior_point,
    is_infeasible,
    pattern_of,
    vi_sparse,
    vi_sparse_methods,
)
from interrupting import HANGS

INF = np.inf
SPARSE = {"linear_algebra": "sparse"}
N = 40


def tridiagonal(n=N, middle=2.0):
    return sp.diags_array([-1.0, middle, -1.0], offsets=[-1, 0, 1], shape=(n, n), format="csr")


def load(n=N):
    """A right-hand side whose solution between -1 and 1.5 meets both bounds."""
    return np.where(np.arange(n) < n // 3, -0.3, 0.2)


def residual(x, F, lower, upper):
    return np.max(np.abs(np.maximum(x - upper, np.minimum(x - lower, F))))


def bent(x):
    """A monotone map that is not affine."""
    return tridiagonal(len(x)) @ x + np.arctan(x) + load(len(x))


def bent_slopes(x):
    return tridiagonal(len(x)) + sp.diags_array(1 / (1 + x**2))


PLAIN = {
    "tol": 1e-9,
    "rtol": 0.0,
    "max_iterations": 100,
    "row_scale": None,
    "time_limit": None,
    "observe": None,
}


def search_of(M, q, lower, upper, x0, map_=None):
    """A search of the sparse solver at its start."""
    box = (np.broadcast_to(np.asarray(it, float), len(q)) for it in (lower, upper))
    search = Search(map_ or AffineMap(sp.csr_array(M), q), *box, np.asarray(x0, float), **PLAIN)
    search.consider(search.x0, search.value(search.x0))
    return search


@pytest.mark.parametrize(
    ("options", "stage", "most"),
    [
        ({}, {"S0", "IP"}, 12),
        ({"active_set": False}, {"IP"}, 7),
        ({"active_set": False, "smoothing": False}, {"S2"}, 60),
    ],
)
@pytest.mark.parametrize("where", ["lower", "upper", "both", "fixed"])
def test_every_stage_of_an_affine_problem(options, stage, most, where):
    M, q = tridiagonal(), load()
    lower = np.full(N, -INF if where == "upper" else -1.0)
    upper = np.full(N, INF if where == "lower" else 1.5)
    if where == "fixed":
        lower[::7] = upper[::7] = 0.25
    res = zivi.solve_avi(M, q, lower, upper, options=SPARSE | options)
    assert res.status is zivi.VIStatus.SOLVED
    assert res.stage in stage
    assert 0 < res.n_factorisations <= most
    dense = zivi.solve_avi(M.toarray(), q, lower, upper)
    np.testing.assert_allclose(res.x, dense.x, atol=1e-8)
    assert residual(res.x, M @ res.x + q, lower, upper) <= 1e-9
    np.testing.assert_array_equal(res.F, M @ res.x + q)


@pytest.mark.parametrize(
    ("options", "stage", "most"),
    [
        ({}, "S0", 6),
        ({"active_set": False}, "SM", 6),
        ({"active_set": False, "smoothing": False}, "S2", 20),
        ({"row_scale": "jacobian"}, "S0", 6),
    ],
)
@pytest.mark.parametrize("where", ["lower", "upper", "both"])
def test_every_stage_of_a_problem_that_is_not_affine(options, stage, most, where):
    lower, upper = (-INF if where == "upper" else -1.0), (INF if where == "lower" else 1.5)
    start = np.linspace(-0.5, 1, N)
    res = zivi.solve_vi(bent, lower, upper, start, jac=bent_slopes, options=SPARSE | options)
    assert res.status is zivi.VIStatus.SOLVED
    assert res.stage == stage
    assert 0 < res.n_factorisations <= most
    dense = zivi.solve_vi(bent, lower, upper, start, jac=lambda x: bent_slopes(x).toarray())
    np.testing.assert_allclose(res.x, dense.x, atol=1e-8)
    assert residual(res.x, bent(res.x), lower, upper) <= 1e-9


@pytest.mark.parametrize(("seed", "stage"), [(0, "IP"), (10, "SM"), (34, "SM"), (4, "S2")])
def test_where_a_stage_gives_up_the_next_one_goes_on(seed, stage):
    """Matrices that are not monotone: each stage from the end of those before."""
    rng = np.random.default_rng(seed)
    M, q = rng.normal(size=(12, 12)) + 1.5 * np.eye(12), rng.normal(size=12)
    res = zivi.solve_avi(sp.csr_array(M), q, -1, 1, options=SPARSE | {"restarts": 0})
    assert (res.status, res.stage, res.n_pivots) == (zivi.VIStatus.SOLVED, stage, 0)
    assert residual(res.x, M @ res.x + q, -1, 1) <= 1e-9


def test_row_scales_of_sparse_problems_are_checked():
    for bad, match in (
        (np.ones(3), "row_scale must have 40 entries, got 3"),
        (np.where(np.arange(N) == 7, -1.0, 1.0), "row_scale must be finite and > 0, got -1.0"),
        (np.where(np.arange(N) == 7, INF, 1.0), "row_scale must be finite and > 0, got inf"),
    ):
        with pytest.raises(ValueError, match=match):
            zivi.solve_lcp(tridiagonal(), load(), options=SPARSE | {"row_scale": bad})
    scale = np.linspace(1, 5, N)
    res = zivi.solve_lcp(tridiagonal(), load(), options=SPARSE | {"row_scale": scale})
    plain = zivi.solve_lcp(tridiagonal(), load(), options=SPARSE)
    np.testing.assert_allclose(res.x, plain.x, atol=1e-9)


@pytest.mark.parametrize("scheme", ["3-point", "2-point", "cs"])
def test_differences_stay_in_the_box(scheme):
    """At a bound to one side, in a narrow box by less, and in one without width out of it."""
    x = np.array([0.0, 1.0, 0.5, 0.3, 0.2])
    lower = np.array([0.0, 0.0, 0.0, 0.3 - 1e-9, 0.2])
    upper = np.array([1.0, 1.0, 1.0, 0.3 + 1e-9, 0.2])
    seen = []

    def cubes(z):
        seen.append(np.real(z).copy())
        return z**3 + np.append(0, z[:-1]) * z

    pattern = pattern_of(sp.eye_array(5) + sp.eye_array(5, k=-1), 5)
    J = ColouredDifferences(cubes, pattern, scheme, lower, upper)(x, 2.3e-16).toarray()
    exact = np.diag(3 * x**2 + np.append(0, x[:-1])) + np.diag(x[1:], -1)
    # a step of 1e-9 leaves six digits of a difference
    close = {"3-point": 1e-9, "2-point": 1e-7, "cs": 1e-15}[scheme]
    np.testing.assert_allclose(J[:3], exact[:3], atol=close)
    np.testing.assert_allclose(J[3:], exact[3:], atol=1e-6)
    inside = np.array(seen)[:, :4]
    assert np.all((inside >= lower[:4]) & (inside <= upper[:4]))


def test_fixed_unknowns_are_held_whatever_the_size_of_their_rows():
    lower, upper = np.full(N, -1.0), np.full(N, 1.5)
    lower[::7] = upper[::7] = 0.25
    options = SPARSE | {"active_set": False}
    plain = zivi.solve_avi(tridiagonal(), load(), lower, upper, options=options, tol=1e-9)
    for size in (1e-3, 1e8):
        scaled = tridiagonal() * size, load() * size
        res = zivi.solve_avi(*scaled, lower, upper, options=options, tol=1e-9 * size)
        assert res.stage == plain.stage == "IP"
        assert abs(res.n_factorisations - plain.n_factorisations) <= 1
        np.testing.assert_allclose(res.x, plain.x, atol=1e-8)


def test_one_step_where_the_active_set_is_known():
    """The first component goes to its bound, and takes the second one along."""
    M = sp.csr_array(np.array([[2.0, -1.0], [-1.0, 2.0]]))
    res = zivi.solve_lcp(M, np.array([10.0, -1.0]), np.ones(2), options=SPARSE)
    np.testing.assert_array_equal(res.x, [0.0, 0.5])
    assert (res.n_iter, res.n_factorisations, res.stage) == (1, 1, "S0")


class Foreign:
    """An array of another library, with a dtype of its own."""

    dtype = "float of another library"

    def __init__(self, values):
        self._values = np.asarray(values, np.float32)

    def __array__(self, dtype=None, copy=None):
        return np.array(self._values, dtype)


def test_arrays_of_other_libraries_round_as_they_do():
    res = zivi.solve_vi(lambda x: Foreign(bent(x)), -1, 1.5, np.zeros(8), tol=1e-4)
    assert res.success
    np.testing.assert_allclose(res.x, zivi.solve_vi(bent, -1, 1.5, np.zeros(8)).x, atol=1e-3)


def test_small_units_and_their_counts():
    M, q = 1e-7 * tridiagonal(), 1e-9 * load()
    seen = []
    res = zivi.solve_lcp(M, q, options=SPARSE, callback=seen.append)
    assert res.success
    np.testing.assert_allclose(res.x, 1e-2 * zivi.solve_lcp(1e7 * M, 1e9 * q).x, rtol=1e-6)
    assert res.n_iter == len(seen)
    assert res.n_factorisations > 0
    small = zivi.solve_vi(lambda x: 1e-9 * bent(1e3 * x), -1, 1, np.zeros(N), options=SPARSE)
    assert small.success
    assert residual(small.x, bent(1e3 * small.x), -1, 1) <= 1e-6


def test_a_singular_problem_is_exact():
    """More unknowns than rows that differ: the interior-point method, and what settles its end."""
    rng = np.random.default_rng(0)
    A = sp.random_array((60, 25), density=0.2, rng=rng)
    M, q = sp.csr_array(A @ A.T), -(A @ A.T) @ (0.5 + rng.random(60))
    res = zivi.solve_lcp(M, q, options=SPARSE)
    assert res.status is zivi.VIStatus.SOLVED_NOT_ISOLATED
    assert res.stage == "IP"
    assert res.scaled_residual <= 1e-13
    never = sp.csr_array(np.array([[0.0, 1.0], [-1.0, 0.0]]))  # F = (y - 1, 2 - x)
    res = zivi.solve_lcp(never, np.array([-1.0, 2.0]), options=SPARSE)
    assert res.success
    np.testing.assert_allclose(res.x, [2.0, 1.0], atol=1e-8)


def test_what_no_sparse_stage_solves_the_dense_solver_takes_over():
    off = {"active_set": False, "smoothing": False, "proximal": False}
    seen = []
    M, q = tridiagonal(), load()
    res = zivi.solve_avi(M, q, -1, 1.5, options=SPARSE | off, callback=seen.append)
    assert res.success
    assert res.n_factorisations == 0
    expected = zivi.solve_avi(M.toarray(), q, -1, 1.5)
    np.testing.assert_allclose(res.x, expected.x, atol=1e-8)
    start = np.zeros(N)
    jac = bent_slopes
    res = zivi.solve_vi(bent, -1, 1.5, start, jac=jac, options=SPARSE | off, callback=seen.append)
    assert res.success
    assert residual(res.x, bent(res.x), -1, 1.5) <= 1e-9
    assert len(seen) > 0
    assert res.nfev > 1
    # with its settings: one iteration is not enough
    few = zivi.solve_vi(bent, -1, 1.5, start, jac=jac, options=SPARSE | off, max_iter=1)
    assert few.status is zivi.VIStatus.ITERATION_LIMIT
    assert few.n_iter == 1


def test_slopes_that_are_not_defined_where_the_dense_solver_takes_over():
    """It makes differences there, in the place of a Jacobian that raises."""
    calls = []

    def slopes(x):
        calls.append(x)
        if len(calls) > 1:
            raise ArithmeticError("no slopes")
        return bent_slopes(x)

    off = {"active_set": False, "smoothing": False, "proximal": False}
    res = zivi.solve_vi(bent, -1, 1.5, np.zeros(8), jac=slopes, options=SPARSE | off)
    assert res.success
    assert len(calls) > 1
    assert residual(res.x, bent(res.x), -1, 1.5) <= 1e-9


@pytest.mark.parametrize("box", [(-INF, INF), (0.0, INF), (-3.0, INF)])
def test_maps_without_a_zero_are_not_solved(box):
    """``-1 - x^2`` is nowhere zero, and pushes upwards without an end."""
    for options in ({}, {"active_set": False}, {"active_set": False, "smoothing": False}):
        res = zivi.solve_vi(
            lambda x: -1 - x**2,
            *box,
            np.ones(3),
            jac=lambda x: sp.diags_array(-2 * x),
            options=SPARSE | {"restarts": 0} | options,
        )
        assert not res.success
        assert res.residual >= 1


def test_the_start_may_be_the_solution():
    """Isolated or not, also where a component is exactly at the end of the box."""
    M = sp.diags_array(np.where(np.arange(8) == 5, 0.0, 1.0), format="csr")
    start = np.where(np.arange(8) == 5, 1.0, 0.0)
    for x5 in (0.0, 0.5, 1.0):
        start[5] = x5
        res = zivi.solve_avi(M, np.zeros(8), -1, 1, start, options=SPARSE)
        assert (res.n_iter, res.residual) == (0, 0.0)
        assert res.status is zivi.VIStatus.SOLVED_NOT_ISOLATED
    res = zivi.solve_avi(sp.eye_array(8), np.zeros(8), -1, 1, options=SPARSE)
    assert res.status is zivi.VIStatus.SOLVED
    moved = zivi.solve_avi(sp.eye_array(8), np.ones(8), 0, 2, np.full(8, 2.0), options=SPARSE)
    assert moved.n_iter > 0
    assert not moved.projected
    outside = zivi.solve_avi(sp.eye_array(8), np.ones(8), 0, 2, np.full(8, 3.0), options=SPARSE)
    assert outside.projected


def test_reports_name_the_worst_component():
    seen = []
    q = np.where(np.arange(N) == 17, -5.0, -0.1)
    res = zivi.solve_vi(
        lambda x: 2 * x + x**3 + q,
        0,
        INF,
        np.zeros(N),
        jac=lambda x: sp.diags_array(2 + 3 * x**2),
        options=SPARSE,
        callback=seen.append,
    )
    assert res.success
    assert len(seen) == res.n_iter > 2
    assert {it.worst for it in seen[:-2]} == {17}
    assert all(it.residual > 0 for it in seen[:-1])
    assert seen[-1].residual == res.residual


def test_factors_that_do_not_belong_to_the_matrix_give_no_solution():
    """Refinement that stays finite, but far from a solution; a small error is mended."""
    eye = sp.csc_array(sp.eye_array(3))
    b = np.ones(3)
    assert Factors(splu(eye), sp.csc_array(5 * eye)).solve(b) is None
    np.testing.assert_allclose(Factors(splu(eye), sp.csc_array(1.001 * eye)).solve(b), b / 1.001)
    assert Factors(splu(eye), sp.csc_array(INF * eye)).solve(b) is None
    empty_row = sp.csc_array(sp.diags_array([1.0, 1.0, 0.0]))
    empty_row.eliminate_zeros()
    assert Factors(splu(eye), empty_row).solve(b) is None


def test_pivoting_follows_the_pattern_and_the_diagonal():
    rng = np.random.default_rng(0)
    arrow = sp.lil_array((60, 60))
    arrow.setdiag(3.0)
    arrow[0], arrow[:, 1] = 1.0, 1.0
    zero = sp.csr_array(np.array([[0.0, 1.0], [1.0, 0.0]]))
    negative = sp.csr_array(np.array([[-2.0, 1.0], [1.0, 0.0]]))
    loose = sp.random_array((60, 60), density=0.05, rng=rng) + 4 * sp.eye_array(60)
    for A in (sp.csr_array(arrow), zero, negative, sp.csr_array(loose), tridiagonal()):
        factoriser = Factoriser(lambda: None)
        factoriser.see_pattern(A)
        b, c = rng.normal(size=(2, A.shape[0]))
        found = factoriser.solve(A, b, c)
        for x, right in zip(found, (b, c), strict=True):
            np.testing.assert_allclose(x, np.linalg.solve(A.toarray(), right), atol=1e-12)
        assert factoriser.count == 1
        assert factoriser.fill >= A.shape[0]
    singular = sp.csr_array(np.ones((3, 3)))
    factoriser = Factoriser(lambda: None)
    factoriser.see_pattern(singular)
    assert factoriser.solve(singular, np.array([1.0, 2.0, 3.0])) is None


def test_a_matrix_without_enough_places_for_pivots_is_not_given_to_superlu(capfd):
    """It wrote beyond its memory: messages of the BLAS, sometimes the end of the process."""
    rng = np.random.default_rng(0)
    B, C = 1 + rng.random((24, 20)), 1 + rng.random((20, 24))
    A = sp.csr_array(sp.block_array([[None, sp.csr_array(B)], [sp.csr_array(C), None]]))
    factoriser = Factoriser(lambda: None)
    factoriser.see_pattern(A)
    assert factoriser.solve(A, np.ones(44)) is None
    assert factoriser.factors_of(A) is None
    assert capfd.readouterr().out == ""
    x = factoriser.solve(A + sp.eye_array(44), np.ones(44))[0]
    np.testing.assert_allclose(A @ x + x, 1.0)
    square = sp.csr_array(
        sp.block_array([[None, sp.csr_array(B[:20])], [sp.csr_array(C[:, :20]), None]])
    )
    (x,) = Factoriser(lambda: None).solve(square[:, ::-1], np.ones(40))
    np.testing.assert_allclose(square[:, ::-1] @ x, 1.0)


def test_a_thread_keeps_what_it_made_until_it_is_told():
    keep, polls = ReleaseEvent(), []
    assert in_thread(lambda: 7, lambda: polls.append(1), keep) == 7
    assert keep.thread.is_alive()
    keep.set()
    keep.settle()
    keep.thread.join(HANGS)
    assert not keep.thread.is_alive()
    assert in_thread(lambda: 8, lambda: None) == 8
    with pytest.raises(ZeroDivisionError):
        in_thread(lambda: 1 // 0, lambda: None, ReleaseEvent())

    def over():
        raise TimeoutError

    keep, gate = ReleaseEvent(), threading.Event()
    for until in (keep, None):
        with pytest.raises(TimeoutError):
            in_thread(gate.wait, over, until)
    gate.set()
    assert keep.is_set()
    keep.thread.join(HANGS)
    assert not keep.thread.is_alive()


def test_colours_and_differences():
    arrow = sp.lil_array((9, 9))
    arrow.setdiag(1.0)
    arrow[0] = 1.0
    pattern = pattern_of(arrow, 9)
    assert sorted(colours_of(pattern)) == list(range(9))
    assert list(colours_of(pattern_of(sp.eye_array(9), 9))) == [0] * 9
    assert max(colours_of(pattern_of(tridiagonal(9), 9))) == 2
    for scheme in (None, "2-point", "cs"):
        for n in (8, N):  # dense, sparse
            res = zivi.solve_vi(bent, -1, 1.5, np.zeros(n), jac=scheme, jac_sparsity=tridiagonal(n))
            assert res.success
            assert (res.n_factorisations > 0) == (n == N)
            exact = zivi.solve_vi(bent, -1, 1.5, np.zeros(n), jac=bent_slopes)
            np.testing.assert_allclose(res.x, exact.x, atol=1e-8)


def test_constant_jacobians_and_what_is_refused():
    def straight(x):
        return tridiagonal() @ x + load()

    start = np.zeros(N)
    for jac in (tridiagonal(), sp.coo_matrix(tridiagonal())):
        res = zivi.solve_vi(straight, -1, 1.5, start, jac=jac, options=SPARSE)
        assert res.success
        assert res.n_factorisations > 0
        assert res.njev > 0
    holed = tridiagonal().tolil()
    holed[3, 4] = np.nan
    with pytest.raises(ValueError, match=r"jac\[3, 4\] must be finite, got nan"):
        zivi.solve_vi(bent, -1, 1.5, start, jac=holed, options=SPARSE)
    with pytest.raises(ValueError, match=r"M\[3, 4\] must be finite, got nan"):
        zivi.solve_avi(holed, load(), -1, 1.5, options=SPARSE)
    with pytest.raises(TypeError, match=r"jac\(x\) must hold real numbers, got None"):
        zivi.solve_vi(bent, -1, 1.5, start, jac=lambda x: None, options=SPARSE)
    calls = []

    def forgets(x):
        calls.append(x)
        return bent(x) if len(calls) < 3 else None

    with pytest.raises(TypeError, match=r"F\(x\) must hold real numbers, got None"):
        zivi.solve_vi(forgets, -1, 1.5, start, jac=bent_slopes, options=SPARSE)
    for bad in ({"x0": np.full(N, np.nan)}, {"x0": np.where(np.arange(N) == 3, INF, 0.0)}):
        with pytest.raises(ValueError, match=r"x0\[\d\] must be finite"):
            zivi.solve_lcp(tridiagonal(), load(), **bad, options=SPARSE)
    begun = zivi.solve_lcp(tridiagonal(), np.full(N, 0.1), np.ones(N), options=SPARSE)
    assert begun.n_iter > 0  # from 1, though zero is the solution
    assert zivi.solve_lcp(tridiagonal(), np.full(N, 0.1), options=SPARSE).n_iter == 0


def test_repeated_and_unsorted_entries_are_summed_and_left_alone():
    twice = sp.coo_array((np.array([1.0, 1.0, 4.0]), ([0, 0, 1], [0, 0, 1])), shape=(2, 2))
    unsorted = sp.csr_array(
        (np.array([-1.0, 2.0, 2.0, -1.0]), np.array([1, 0, 1, 0]), np.array([0, 2, 4]))
    )
    for M, x in ((twice, [1.0, 0.75]), (unsorted, [7 / 3, 8 / 3])):
        before = M.copy()
        res = zivi.solve_lcp(M, np.array([-2.0, -3.0]), options=SPARSE)
        np.testing.assert_allclose(res.x, x, atol=1e-12)
        np.testing.assert_array_equal(M.data, before.data)
    for dtype in (int, np.float32, np.int8, np.longdouble):
        res = zivi.solve_lcp(tridiagonal().astype(dtype), load(), options=SPARSE)
        np.testing.assert_allclose(res.x, zivi.solve_lcp(tridiagonal(), load()).x, atol=1e-9)
    for form in ("csr", "csc", "coo", "lil", "dok", "bsr", "dia"):
        for kind in ("array", "matrix"):
            M = getattr(sp, f"{form}_{kind}")(tridiagonal())
            assert zivi.solve_lcp(M, load(), options=SPARSE).success
    wide = sp.csr_array(tridiagonal())
    wide.indices, wide.indptr = wide.indices.astype(np.int64), wide.indptr.astype(np.int64)
    assert zivi.solve_lcp(wide, load(), options=SPARSE).success


def test_rounding_at_the_best_point_is_told_row_by_row():
    """The row of 1e8 x rounds; the one at the tolerance does not, but is within it."""
    M, q = sp.diags_array([0.0, 1e8], format="csr"), np.array([1e-9, 100.0])
    search = search_of(M, q, -INF, INF, [0.0, 1e10])
    search.best_F = np.array([1e-9, 100.0])
    assert not _is_within_rounding(search, 1e8)  # of 1e18 nothing near that is left
    assert _is_within_rounding(search, 1e12)
    assert 100 < search.tol < 1e4
    search = search_of(M, q, -INF, INF, [0.0, 1e10])
    search.best_F = np.array([2e-9, 100.0])
    assert not _is_within_rounding(search, 1e12)
    assert search.tol == 1e-9


@pytest.mark.parametrize("seed", [5395, 12, 40])
def test_a_point_that_has_run_away_is_no_solution(seed):
    """Without one, the iterates go off until all of `F` is rounding: 0.06 at 1e15 is no zero."""
    rng = np.random.default_rng(seed)
    A = rng.normal(size=(12, 4))
    u, q = np.linalg.svd(A)[0][:, -1], rng.normal(size=12)
    M, q = A @ A.T, q - u * (u @ q) - 0.01 * u  # u'(M x + q) = -0.01
    res = zivi.solve_avi(sp.csr_array(M), q, -INF, INF, options=SPARSE)
    assert not res.success
    assert res.tolerance < 1e-6
    box = np.where(u > 0, 0.0, -INF), np.where(u > 0, INF, 0.0)
    res = zivi.solve_avi(sp.csr_array(M), q, *box, options=SPARSE)
    assert res.status is zivi.VIStatus.INFEASIBLE


def test_slopes_are_not_believed_where_the_map_is_not_defined():
    holes = {"first": [None, np.ones(2)], "second": [np.ones(2), None], "none": [np.ones(2)] * 2}
    for name, values in holes.items():
        left = list(values)
        map_ = SimpleNamespace(
            is_affine=False, rounding=2e-16, nfev=0, value=lambda x, left=left: left.pop(0)
        )
        search = SimpleNamespace(
            map=map_, n=2, inside=lambda x: x, value=lambda x, map_=map_: map_.value(x)
        )
        agrees = _agrees(search, np.zeros(2), sp.csr_array((2, 2)))
        assert agrees.all() == (name == "none")
        assert agrees.any() == (name == "none")


@pytest.mark.parametrize("stage", ["interior_point", "smoothing_newton", "proximal_newton"])
def test_success_is_told_by_the_residual_alone(monkeypatch, stage):
    """A stage that says that it was successful is not believed."""
    off = {"active_set": False, "smoothing": stage != "proximal_newton"}
    monkeypatch.setattr(vi_sparse, stage, lambda *_, **__: True)
    n = zivi.vi.MAX_DENSE + 1  # the dense solver does not take over
    if stage == "interior_point":
        res = zivi.solve_avi(tridiagonal(n), load(n), -1, 1.5, options=off)
    else:
        res = zivi.solve_vi(bent, -1, 1.5, np.zeros(n), jac=bent_slopes, options=off)
    assert res.status is zivi.VIStatus.STALLED
    assert res.residual > 1e-3


def test_a_smoothing_step_that_fails_says_so():
    """A singular matrix gives no direction; slopes of the wrong sign give one that only grows."""
    x, none = np.array([1.0, 2.0]), sp.csr_array((2, 2))
    search = search_of(none, x, -INF, INF, x)
    assert not _Smoothing(search, x, x, none, 1e-3).step()
    search = search_of(sp.eye_array(2), np.zeros(2), -INF, INF, x)
    assert not _Smoothing(search, x, x, sp.csr_array(-sp.eye_array(2)), 1e-3).step()
    method = _Smoothing(search, x, x, sp.csr_array(sp.eye_array(2)), 1e-3)
    assert method.step()
    np.testing.assert_allclose(method.point.x, 0.0, atol=1e-15)


def test_a_proof_of_infeasibility_counts_the_rounding_of_finite_terms_only():
    """``y'F = -1e-7`` everywhere, by terms of 1e9 that cancel and unknowns without bounds."""
    M, q = sp.csr_array(np.array([[1e9, 0.0], [-1e9, 0.0]])), np.array([0.0, -1e-7])
    search = SimpleNamespace(lower=np.full(2, -INF), upper=np.full(2, INF), tol=1e-9, n=2)
    assert _proves(search, M, q, np.ones(2))
    assert not _proves(search, M, -q, np.ones(2))
    # beside a bound at 1 the same terms round by more
    search.lower = np.array([1.0, -INF])
    assert not _proves(search, M, q, np.ones(2))


@pytest.mark.parametrize("size", [1e-6, 1.0, 1e6, 1e13])
def test_a_proof_of_infeasibility_does_not_depend_on_the_unit_of_F(size):
    """``x0 - x1 >= 1`` and ``x1 - x0 >= 1``: multipliers of both rows, which are 1/size."""
    M, q = sp.csr_array(np.array([[size, -size], [-size, size]])), np.full(2, -size)
    search = search_of(M, q, 0.0, INF, np.zeros(2))
    assert is_infeasible(search, M, q)
    assert not is_infeasible(search, M, np.array([size, -size]))


def test_the_interior_point_method_says_where_it_gives_up(monkeypatch):
    M = tridiagonal()

    def solves(bound=1.5, limit=40, **parts):
        search = search_of(M, load(), -bound, bound, np.zeros(N))
        for name, part in parts.items():
            setattr(search, name, part)
        return interior_point(search, search.x0, M, load(), 1.0, limit=limit)

    assert solves()
    assert not solves(limit=1)
    assert not solves(bound=INF)
    assert not solves(factoriser=SimpleNamespace(factors_of=lambda _: None))
    assert not solves(value=lambda _: None)
    monkeypatch.setattr(
        vi_sparse_methods, "active_set_newton", lambda *_, **__: SimpleNamespace(solved=False)
    )
    tried = []
    assert not solves(end_iteration=lambda *_: tried.append(1), limit=1000)
    assert 10 < len(tried) < 500


@pytest.mark.parametrize("free", [False, True])
def test_rows_that_exclude_each_other(free):
    """``x0 - x1 >= 1`` and ``x1 - x0 >= 1``, or their negatives where there is no floor."""
    M, q = sp.lil_array(np.eye(N)), np.zeros(N)
    M[:2, :2] = [[1, -1], [-1, 1]]
    q[:2] = -1.0
    sign, box = (-1.0, (-INF, 5.0)) if free else (1.0, (0.0, INF))
    res = zivi.solve_avi(M, sign * q, *box, options=SPARSE)
    assert res.status is zivi.VIStatus.INFEASIBLE
    q[0] = 1.0
    assert zivi.solve_avi(M, sign * q, *box, options=SPARSE).success


def test_maps_that_are_nowhere_defined():
    res = zivi.solve_vi(
        lambda x: np.full(2500, np.nan), 0, 1, np.zeros(2500), jac=sp.eye_array(2500)
    )
    assert res.status is zivi.VIStatus.DOMAIN_ERROR
    assert np.isnan(res.F).all()
    assert np.isnan(res.scaled_residual)


def test_derivatives_of_small_and_of_singular_matrices():
    M = 0.25 * tridiagonal(6).toarray()
    res = zivi.solve_avi(M, -np.arange(6.0), -500, 500)
    inverse = -np.linalg.inv(M)
    for jac in (M, sp.csr_array(M)):
        found = zivi.vi.solution_derivative(res, jac, np.eye(6), -500, 500)
        np.testing.assert_allclose(found.matrix, inverse, rtol=1e-10)
        np.testing.assert_allclose(found.vjp(np.eye(6)), inverse.T, rtol=1e-10)
        singular = zivi.vi.solution_derivative(res, 0 * jac, np.eye(6), -500, 500)
        with pytest.raises(np.linalg.LinAlgError, match="not isolated"):
            singular.jvp(np.ones(6))


def test_bounds_and_options_in_other_forms():
    M, q = tridiagonal(4), load(4)
    expected = zivi.solve_avi(M, q, [-1, -2, -3, -4], [1, 2, 3, 4]).x
    pairs = [(-1, 1), (-2, 2), (-3, 3), (-4, 4)]
    for bounds in (pairs, scipy.optimize.Bounds([-1, -2, -3, -4], [1, 2, 3, 4])):
        np.testing.assert_array_equal(zivi.solve_avi(M, q, bounds=bounds).x, expected)
    with pytest.raises(TypeError, match=r"bounds must be a scipy\.optimize\.Bounds or"):
        zivi.solve_avi(M, q, bounds=SimpleNamespace(lb=0))
    few = zivi.solve_vi(bent, -1, 1.5, np.zeros(N), max_iter=1)
    assert few.n_iter == 1
    assert not few.success


def test_the_check_of_a_jacobian_in_single_precision_and_at_its_point():
    x = np.array([0.5, -2.0, 30.0])
    seen = []

    def slopes(z, power):
        seen.append(z)
        return np.diag(power * z ** (power - 1))

    worst = zivi.check_jacobian(lambda z, power: z**power, slopes, x, args=(3,))
    assert worst.error < 1e-9
    np.testing.assert_array_equal(seen[0], x)
    wrong = zivi.check_jacobian(lambda z: z**3, np.diag([0.75, 12.0, 2600.0]), x)
    assert (wrong.row, wrong.column, wrong.given) == (2, 2, 2600.0)
    assert wrong.expected == pytest.approx(2700.0, rel=1e-6)
    assert wrong.error == pytest.approx(100 / 2700, rel=1e-3)
    with pytest.raises(ValueError, match=r"jac\(x\) must have shape \(3, 3\), got \(2, 2\)"):
        zivi.check_jacobian(lambda z: z**3, np.eye(2), x)


def test_a_game_with_its_result():
    game = zivi.vi.bimatrix(np.array([[3.0, 0.0], [0.0, 1.0]]), np.array([[1.0, 0.0], [0.0, 3.0]]))
    assert game.success
    assert isinstance(game.result, zivi.VIResult)
    assert 0 <= game.regret < 1e-9


def test_the_least_size_is_that_of_rows_and_unknowns():
    """What is off scale is found by a loop; beside it NumPy, on whole arrays as for sparse ones."""
    rng = np.random.default_rng(3)
    small = 0
    for _ in range(300):
        n = int(rng.integers(1, 7))
        M = rng.standard_normal((n, n)) * 10.0 ** rng.integers(-6, 3) * (rng.random((n, n)) < 0.7)
        q = rng.standard_normal(n) * 10.0 ** rng.integers(-6, 3) * (rng.random(n) < 0.8)
        lower = np.where(rng.random(n) < 0.3, -INF, rng.standard_normal(n))
        width = np.where(rng.random(n) < 0.5, INF, 10.0 ** rng.integers(-4, 2, n))
        upper = np.where(lower > -INF, np.maximum(lower, -9.0) + width, 2.0)
        x0 = None if rng.random() < 0.5 else rng.standard_normal(n)
        begin = np.clip(np.zeros(n) if x0 is None else x0, lower, upper)
        rows, columns = _sizes(Affine(sp.csr_array(M), q, lower, upper, begin))
        expected = min(rows.min(), columns.min())
        for limit in (1e-3, expected / 3, expected * (1 - 1e-12), expected * (1 + 1e-12)):
            is_off = _zivi.is_off_scale(M, q, lower, upper, x0, limit)
            assert is_off == (expected < limit), (limit, expected)
        small += expected < 1e-3
    assert 50 < small < 250
    # none of a problem: the solver says what is wrong with it
    assert not _zivi.is_off_scale(np.eye(1), np.ones(1), 1.0, 0.0, None, 9.0)
    assert not _zivi.is_off_scale(np.eye(1), np.array([np.nan]), 0.0, 1.0, None, 9.0)
    assert not _zivi.is_off_scale(np.array([[INF]]), np.ones(1), 0.0, 1.0, None, 9.0)
