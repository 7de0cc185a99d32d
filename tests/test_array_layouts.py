"""Arrays count by their entries, whatever their order in memory: same bits from every layout."""

import ctypes

import numpy as np
import pytest
import scipy.sparse

import zivi

N = 4
RNG = np.random.default_rng(5)
A = RNG.normal(size=(N, N))
M = A @ A.T + 3 * (np.triu(A) - np.triu(A).T) + np.eye(N)
Q = RNG.normal(size=N) - 1


def strided(a):
    wide = np.full([2 * k for k in a.shape], np.nan)
    part = wide[tuple(slice(None, None, 2) for _ in a.shape)]
    part[...] = a
    return part


def backwards(a):
    turned = tuple(slice(None, None, -1) for _ in a.shape)
    return a[turned].copy()[turned]


LAYOUTS = {
    "fortran": np.asfortranarray,
    "transposed": lambda a: np.array([*a.T]).T,
    "strided": strided,
    "backwards": backwards,
    "big-endian": lambda a: a.astype(">f8"),
}


@pytest.fixture(params=LAYOUTS)
def laid(request):
    def of(values):
        values = np.array(values, dtype=float)
        found = LAYOUTS[request.param](values)
        np.testing.assert_array_equal(found, values)
        return found

    return of


def same(one, other):
    np.testing.assert_array_equal(one, other)
    assert np.all(np.isfinite(one))


def cubic(x):
    return M @ x + Q + x**3


def slopes(x):
    return M + np.diag(3 * x**2)


def test_jacobians_and_values_of_a_map(laid):
    expected = zivi.solve_ncp(cubic, np.ones(N), jac=slopes)
    assert expected.success
    assert 0 < np.sum(expected.x > 0) < N
    for F, jac in (
        (cubic, lambda x: laid(slopes(x))),
        (lambda x: laid(cubic(x)), slopes),
    ):
        res = zivi.solve_ncp(F, laid(np.ones(N)), jac=jac)
        same(res.x, expected.x)
        assert (res.n_iter, res.nfev, res.njev) == (
            expected.n_iter,
            expected.nfev,
            expected.njev,
        )


def test_monotone_problems_are_solved_whatever_the_layout(laid):
    """A transposed Jacobian of these loses nearly all of them."""
    for seed in range(20):
        rng = np.random.default_rng(seed)
        a, q = rng.normal(size=(10, 10)), 5 * rng.normal(size=10)
        m = (a - a.T) * 4 + 0.1 * np.eye(10)
        res = zivi.solve_ncp(
            lambda x, m=m, q=q: m @ x + np.arctan(x) + q,
            np.zeros(10),
            jac=lambda x, m=m: laid(m + np.diag(1 / (1 + x**2))),
        )
        assert res.success
        assert res.stage == "S0"


def test_constant_matrices(laid):
    expected = zivi.solve_avi(M, Q, -0.1, 2.0)
    res = zivi.solve_avi(laid(M), laid(Q), laid(np.full(N, -0.1)), laid(np.full(N, 2.0)))
    same(res.x, expected.x)
    same(zivi.solve_lcp(laid(M), laid(Q)).x, zivi.solve_lcp(M, Q).x)
    given = [zivi.solve_ncp(cubic, np.ones(N), jac=it).x for it in (M, laid(M))]
    same(*given)
    scales = [
        zivi.solve_ncp(cubic, np.ones(N), options=zivi.VIOptions(row_scale=it)).x
        for it in (np.arange(1.0, 5.0), laid(np.arange(1.0, 5.0)))
    ]
    same(*scales)
    same(zivi.natural_residual(laid(Q), laid(Q), -1, 1), zivi.natural_residual(Q, Q, -1, 1))


@pytest.mark.parametrize("kind", ["csr", "csc", "coo", "bsr", "lil"])
def test_sparse_jacobians(kind):
    expected = zivi.solve_ncp(cubic, np.ones(N), jac=slopes)
    make = getattr(scipy.sparse, f"{kind}_array")
    for jac in (lambda x: make(slopes(x)), lambda x: make(slopes(x)).toarray()):
        same(zivi.solve_ncp(cubic, np.ones(N), jac=jac).x, expected.x)


def test_the_check_of_a_jacobian_tells_a_transposed_one(laid):
    x = np.linspace(0.5, 1.5, N)
    good = zivi.check_jacobian(cubic, lambda x: laid(slopes(x)), x)
    assert good.error < 1e-8
    bad = zivi.check_jacobian(cubic, lambda x: laid(slopes(x).T), x)
    assert bad.error > 0.5
    assert bad.given == slopes(x)[bad.column, bad.row] != slopes(x)[bad.row, bad.column]


def test_payoffs_of_a_game(laid):
    a, b = RNG.normal(size=(3, 4)), RNG.normal(size=(3, 4))
    one, other = zivi.bimatrix(a, b), zivi.bimatrix(laid(a), laid(b))
    same(one.x, other.x)
    same(one.y, other.y)


# a chain of two masses above a floor: mass matrix not diagonal, gradients that differ
MASS = np.array([[2.0, 0.3], [0.3, 1.0]])


def chain(lay=np.asarray):
    return zivi.MechanicalSystem(
        mass=lambda t, q: lay(MASS * (1 + 0.1 * q[0] ** 2)),
        force=lambda t, q, w: lay([-9.81 - q[0], -4.0 - 0.1 * w[1]]),
        gaps=[
            zivi.Gap(
                value=lambda t, q: q[0] + 0.2 * q[1],
                gradient=lambda t, q: lay([1.0, 0.2]),
                curvature=lambda t, q, w: lay([0.0])[0],
            ),
            zivi.LinearGap(lay([-0.5, 1.0]), 1.0),
        ],
        e=lay([0.5, 0.6]),
    )


def test_parts_of_a_mechanical_system(laid):
    start = [1.0, 0.5], [0.1, -0.2]
    one = zivi.simulate(chain(), (0, 2), start, dense_output=True)
    other = zivi.simulate(chain(laid), (0, 2), (laid(start[0]), laid(start[1])), dense_output=True)
    times = np.linspace(0, 2, 7)
    assert len(one.resolved_impacts) > 3
    same(one.q, other.q)
    same(one(times), other(laid(times)))
    same(one.resample(times).reactions, other.resample(laid(times)).reactions)
    grid = times[:6].reshape(2, 3)
    same(one(grid), other(laid(grid)))


def test_a_constant_mass_matrix_of_a_mechanical_system(laid):
    skewed = MASS + np.array(
        [[0.0, 1e-12], [0.0, 0.0]]
    )  # its transpose differs within the tolerance
    runs = []
    for lay in (np.asarray, laid):
        gaps = [zivi.LinearGap(lay([1.0, 0.2]))]
        system = zivi.MechanicalSystem(mass=lay(skewed), force=lay([-9.8, -1.0]), e=0.5, gaps=gaps)
        runs.append(zivi.simulate(system, (0, 1), ([1.0, 0.5], [0.0, 0.0])))
    same(runs[0].q, runs[1].q)


PART = ctypes.CFUNCTYPE(None, ctypes.c_double, *[ctypes.POINTER(ctypes.c_double)] * 3)


def test_compiled_parts_are_given_contiguous_states(laid):
    @PART
    def force(t, q, w, out):
        out[0], out[1] = -9.81 - q[1], -2.0 - q[0]

    def mass(t, q):
        return MASS

    gaps = [zivi.LinearGap([1.0, 0.0])]
    system = zivi.MechanicalSystem(mass=mass, force=force, gaps=gaps, e=0.0)
    q, w = np.array([0.0, 0.7]), np.zeros(2)
    same(system.at(0.0, q, w).force, system.at(0.0, laid(q), laid(w)).force)
    run = zivi.simulate(system, (0, 1), ([0.2, 0.7], [0.0, 0.0]), dense_output=True)
    times = np.linspace(0, 1, 5)
    same(run.resample(times).reactions, run.resample(laid(times)).reactions)


def test_derivatives_of_a_mechanical_system(laid):
    start = [1.0, 0.5], [0.1, -0.2]
    one = zivi.sensitivity(chain(), (0, 0.8), start, ("q0[0]", "e"))
    other = zivi.sensitivity(chain(laid), (0, 0.8), start, ("q0[0]", "e"))
    same(one.final, other.final)


def test_batches_and_times(laid):
    system = zivi.ImpactSystem(-9.81, e=0.7)
    states, times = np.array([[1.0, 0.0], [2.0, -1.0], [0.5, 3.0]]), np.linspace(0.0, 1.0, 5)
    one = zivi.simulate_batch(system, (0, 1), states, t_eval=times)
    other = zivi.simulate_batch(system, (0, 1), laid(states), t_eval=laid(times))
    same(one.sample_x, other.sample_x)
    same(one.xdot, other.xdot)
    runs = [
        zivi.simulate(system, (0, 1), it[1], t_eval=times, tstops=it[2], dense_output=True)
        for it in ((0, states[0], times[1:3]), (0, laid(states[0]), laid(times[1:3])))
    ]
    same(runs[0].x, runs[1].x)
    grid = times[:4].reshape(2, 2)
    same(runs[0](grid), runs[1](laid(grid)))
    mechanical = [
        zivi.simulate_batch(chain(lay), (0, 1), (lay(states**2 + [[0, 1]]), lay(states * 0)))
        for lay in (np.asarray, laid)
    ]
    same(mechanical[0].q, mechanical[1].q)


def test_the_slopes_of_a_force_and_its_derivatives(laid):
    def system(lay):
        return zivi.ImpactSystem(
            zivi.ParametricForce(
                lambda t, x, xdot, k, c: -9.81 - k * x - c * xdot,
                {"k": 0.5, "c": 0.1},
                jacobian=lambda t, x, xdot, k, c: lay([0.0, -k, -c, -x, -xdot]),
            ),
            e=0.6,
        )

    found = [
        zivi.sensitivity(system(lay), (0, 1), lay([1.0, 0.0]), ("x0", "k", "c")).final
        for lay in (np.asarray, laid)
    ]
    same(*found)


def test_impact_maps_and_changes_of_coordinates(laid):
    system = zivi.ImpactSystem(zivi.LinearForce(gravity=1, amplitude=0.3), e=0.8)
    phase, u = RNG.uniform(0.5, 1.0, (2, 3)), RNG.uniform(1.0, 2.0, (2, 3))
    found = [zivi.impact_map(system)(lay(phase), lay(u)) for lay in (np.asarray, laid)]
    same(found[0].phase, found[1].phase)
    same(found[0].jacobian, found[1].jacobian)
    lifted = [zivi.lift(lay(phase), lay(u), e=0.8) for lay in (np.asarray, laid)]
    same(*lifted)


def test_observers_and_references_of_loops(laid):
    t = np.arange(200) * 1e-3
    x = np.abs(1 - 4.905 * t**2)
    seen = [
        zivi.ImpactObserver(0.8, 1e-3, noise=1e-4, position_only=True).observe(
            lay(t), lay(x), force=lay(np.full(200, -9.81))
        )
        for lay in (np.asarray, laid)
    ]
    same(seen[0].xdot, seen[1].xdot)
    h, n = 1e-2, 51
    reference = np.array([np.full(n, 0.5), np.zeros(n)])
    loops = [
        zivi.simulate_closed_loop(
            zivi.ImpactSystem(-9.81, e=0.5),
            zivi.TwistingTracker(30.0, 17.0, e=0.5, h=h),
            (0, (n - 1) * h),
            lay([1.0, 0.0]),
            reference=lay(given),
        ).u
        for lay in (np.asarray, laid)
        for given in (reference, reference.T)
    ]
    same(loops[0], loops[2])
    same(loops[1], loops[3])
