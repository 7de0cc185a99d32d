"""Arrays of parameters in batches: each run is that of a replaced system, to the last bit."""

import numpy as np
import pytest

import zivi

FLOOR = zivi.LinearGap([1.0], name="floor")
N = 7


def drawn(seed, **ranges):
    rng = np.random.default_rng(seed)
    return {name: rng.uniform(*ends, N) for name, ends in ranges.items()}


def assert_same_masses(batch, system, columns, span, y0, **more):
    for i in range(N):
        own = system.replace(**{name: float(values[i]) for name, values in columns.items()})
        sol = zivi.simulate(own, span, y0[i], **more)
        ends = batch.x[i], batch.xdot[i], batch.status[i]
        assert ends == (sol.x[-1], sol.xdot[-1], sol.status), i
        # no samples are drawn, for which the force is evaluated in tails
        assert batch.nfev[i] <= sol.nfev


MASSES = {
    "linear": (
        zivi.ImpactSystem(zivi.LinearForce(gravity=9.81, stiffness=1.0), e=0.5),
        {"e": (0.2, 0.9), "gravity": (1.0, 10.0), "damping": (0.0, 0.5)},
    ),
    "constant": (zivi.ImpactSystem(-9.81, e=0.5), {"force": (-10.0, -5.0), "e": (0.1, 0.8)}),
    "wall": (
        zivi.ImpactSystem(
            zivi.LinearForce(gravity=9.81), e=0.5, wall=zivi.HarmonicWall(0.01, 30.0)
        ),
        {"wall.amplitude": (0.0, 0.02), "wall.phase": (-3, 3), "wall.omega": (20, 40)},
    ),
    "constant force above a wall": (
        zivi.ImpactSystem(-9.81, e=0.5, wall=zivi.HarmonicWall(0.01, 30.0)),
        {"force": (-10.0, -5.0), "wall.amplitude": (0.0, 0.02), "wall.offset": (0.0, 0.1)},
    ),
    "table": (
        zivi.ImpactSystem(
            zivi.LinearForce(
                gravity=9.81, excitation=zivi.Table([0.0, 1.0, 5.0], [0.0, 3.0, -1.0])
            ),
            e=0.5,
        ),
        {"gravity": (5.0, 10.0), "e": (0.2, 0.9)},
    ),
    "law": (
        zivi.ImpactSystem(-9.81, e=zivi.SpeedDependentImpact(0.6, 3.0, 0.3)),
        {"law.e0": (0.5, 0.8), "force": (-10.0, -8.0)},
    ),
}


@pytest.mark.parametrize("name", MASSES)
def test_runs_of_masses_are_those_of_replaced_systems(name):
    system, ranges = MASSES[name]
    columns = drawn(3, **ranges)
    y0 = np.column_stack([np.linspace(0.1, 1.5, N), np.linspace(-1, 1, N)])
    batch = zivi.simulate_batch(system, (0.25, 2.5), y0, parameters=columns)
    assert_same_masses(batch, system, columns, (0.25, 2.5), y0)


def test_fixed_steps_sample_each_run_with_its_own_restitution():
    ball = zivi.ImpactSystem(zivi.LinearForce(gravity=9.81), e=0.5)
    columns = drawn(4, e=(0.2, 0.9), gravity=(3.0, 10.0))
    times, method = np.linspace(0, 2, 9), zivi.ThetaGamma(h=1e-2)
    y0 = np.tile([0.5, 0.3], (N, 1))
    batch = zivi.simulate_batch(
        ball, (0, 2), [0.5, 0.3], method=method, t_eval=times, parameters=columns
    )
    for i in range(N):
        own = ball.replace(e=float(columns["e"][i]), gravity=float(columns["gravity"][i]))
        sol = zivi.simulate(own, (0, 2), y0[i], method=method, t_eval=times)
        assert np.array_equal(batch.sample_x[i], sol.x)
        assert np.array_equal(batch.sample_xdot[i], sol.xdot)


def test_compiled_forces_take_their_parameters():
    numba = pytest.importorskip("numba")

    @numba.njit
    def spring(t, x, xdot, k, c):
        return -k * x - c * xdot - 1.0

    system = zivi.ImpactSystem(zivi.ParametricForce(spring, {"k": 4.0, "c": 0.1}), e=0.5)
    columns = drawn(5, k=(2.0, 6.0), c=(0.0, 0.5), e=(0.3, 0.9))
    y0 = np.tile([0.5, 0.0], (N, 1))
    batch = zivi.simulate_batch(system, (0, 5), [0.5, 0.0], parameters=columns)
    assert_same_masses(batch, system, columns, (0, 5), y0)


def test_a_number_is_for_all_runs_and_the_result_keeps_copies():
    ball = zivi.ImpactSystem(zivi.LinearForce(gravity=9.81), e=0.5)
    e = np.array([0.3, 0.6])
    batch = zivi.simulate_batch(ball, (0, 3), (1, 0), parameters={"e": e, "gravity": 5.0})
    e[:] = 0.0
    assert batch.parameters["e"].tolist() == [0.3, 0.6]
    assert batch.parameters["gravity"].tolist() == [5.0, 5.0]
    # at rest after (1 + e)/(1 - e) times the fall
    fall = np.sqrt(2 / 5.0)
    np.testing.assert_allclose(batch.rest_time, fall * np.array([1.3 / 0.7, 1.6 / 0.4]), rtol=1e-9)
    assert batch.config["parameters"] == {"e": [0.3, 0.6], "gravity": [5.0, 5.0]}
    assert batch.to_pandas()["e"].tolist() == [0.3, 0.6]
    assert batch.to_xarray()["gravity"].values.tolist() == [5.0, 5.0]


def pendulum(**more):
    return zivi.symbolic.system(
        "phi",
        T="m*l**2*phidot**2/2",
        V="-m*g*l*cos(phi)",
        gaps={"wall": "phi + 0.2"},
        parameters={"m": 1.0, "l": 1.0, "g": 9.81},
        e=0.6,
        **more,
    )


def mechanisms():
    load = zivi.Harmonic([1.0], omega=2.0)
    return {
        "symbolic": (pendulum(), {"e": (0.3, 0.9), "l": (0.5, 2.0), "g": (5.0, 12.0)}),
        "arrays": (
            zivi.MechanicalSystem(mass=1.0, force=[-9.81], gaps=[FLOOR], e=0.5),
            {"e": (0.2, 0.9)},
        ),
        "linear": (
            zivi.LinearSystem([[1.0]], [[0.1]], [[4.0]], excitation=load, gaps=[FLOOR], e=0.5),
            {"e": (0.2, 0.9), "omega": (1.0, 3.0)},
        ),
    }


@pytest.mark.parametrize("name", ["symbolic", "arrays", "linear"])
def test_runs_of_mechanisms_are_those_of_replaced_systems(name):
    system, ranges = mechanisms()[name]
    columns = drawn(6, **ranges)
    q, w = np.linspace(0.1, 0.7, N)[:, None], np.linspace(-1, 1, N)[:, None]
    batch = zivi.simulate_batch(system, (0.5, 3.0), (q, w), parameters=columns)
    listed = zivi.simulate_batch(system, (0.5, 3.0), (q, w), parameters=columns, save="events")
    for i in range(N):
        own = system.replace(**{key: float(values[i]) for key, values in columns.items()})
        sol = zivi.simulate(own, (0.5, 3.0), (q[i], w[i]))
        for these in (batch, listed):
            assert np.array_equal(these.q[i], sol.q[-1])
            assert np.array_equal(these.qdot[i], sol.qdot[-1])
            assert np.array_equal(these.gaps[i], sol.gaps[-1])
            assert np.array_equal(these.contacts[i], sol.contacts[-1])
            assert (these.status[i], these.n_zeno[i]) == (sol.status, len(sol.zeno))
            rest = np.nan if sol.rest_time is None else sol.rest_time
            assert np.array_equal(these.rest_time[i], rest, equal_nan=True)
        assert batch.nfev[i] == listed.nfev[i]
    for quantity in ("first_impact", "last_impact", "n_impacts", "n_liftoffs", "n_flags"):
        one, other = getattr(batch, quantity), getattr(listed, quantity)
        assert np.array_equal(one, other, equal_nan=True), quantity
    assert batch.parameters.keys() == columns.keys()
    assert batch.to_xarray()["e"].dims == ("run",)


def test_dry_friction_takes_arrays_of_restitution():
    system = zivi.ImpactSystem(-9.81, e=0.5, friction=zivi.DryFriction(limit=0.5))
    batch = zivi.simulate_batch(system, (0, 2), (0.5, 0.0), parameters={"e": [0.3, 0.7]})
    for i, e in enumerate((0.3, 0.7)):
        sol = zivi.simulate(system.replace(e=e), (0, 2), (0.5, 0.0))
        assert batch.q[i] == sol.q[-1]


BALL = zivi.ImpactSystem(zivi.LinearForce(gravity=9.81), e=0.5)


@pytest.mark.parametrize(
    ("parameters", "message"),
    [
        ({"gravty": [1.0]}, "did you mean 'gravity'"),
        ({"e": [0.5, 1.5]}, r"parameters\['e'\] must be in \[0, 1\], got 1.5 in run 1"),
        ({"e": [0.5, np.nan]}, r"parameters\['e'\] must be in \[0, 1\], got nan in run 1"),
        ({"gravity": [np.inf]}, r"parameters\['gravity'\] must be finite, got inf in run 0"),
        ({"e": [[0.5]]}, r"must be a number or have shape \(n,\), got shape \(1, 1\)"),
        ({"e": [0.5, 0.6], "gravity": [1.0] * 3}, r"parameters\['e'\] must have one value"),
        ({"x0": [0.5]}, "'x0' is set by y0 or t_span"),
    ],
)
def test_bad_parameters_of_a_mass_are_named(parameters, message):
    with pytest.raises(ValueError, match=message):
        zivi.simulate_batch(BALL, (0, 1), (1, 0), parameters=parameters)


def test_bad_arguments_are_named():
    with pytest.raises(ValueError, match="need one system for all runs"):
        zivi.simulate_batch([BALL, BALL], (0, 1), (1, 0), parameters={"e": [0.1, 0.2]})
    with pytest.raises(TypeError, match="parameters must be a dict"):
        zivi.simulate_batch(BALL, (0, 1), (1, 0), parameters=[0.1])
    with pytest.raises(ValueError, match="y0 must have one value or row for each of 3 runs, got 2"):
        zivi.simulate_batch(BALL, (0, 1), [[1, 0], [1, 0]], parameters={"e": [0.1, 0.2, 0.3]})
    with pytest.raises(ValueError, match="unknown parameter 'mass'"):
        zivi.simulate_batch(pendulum(), (0, 1), ([0.1], [0.0]), parameters={"mass": [1.0]})
    with pytest.raises(ValueError, match=r"parameters\['e'\] must be in \[0, 1\], got -1 in run 1"):
        zivi.simulate_batch(pendulum(), (0, 1), ([0.1], [0.0]), parameters={"e": [0.5, -1.0]})


def test_a_start_below_a_gap_is_named_by_its_run():
    q = np.array([[0.1], [0.2], [-0.3], [0.1]])
    with pytest.raises(ValueError, match=r"run 2 of the batch: gap 'wall' must be >= 0"):
        zivi.simulate_batch(pendulum(), (0, 1), (q, 0 * q))
    # what rounding makes of a gap that is closed is none
    q[2] = -0.2 * (1 + 1e-16)
    assert zivi.simulate_batch(pendulum(), (0, 1), (q, 0 * q)).success.all()


def test_threads_do_not_change_the_results():
    system, rng = pendulum(), np.random.default_rng(2)
    q, columns = rng.uniform(0, 1, (40, 1)), {"l": rng.uniform(0.5, 2, 40)}
    one, three = (
        zivi.simulate_batch(system, (0, 4), (q, 0 * q), parameters=columns, threads=threads)
        for threads in (1, 3)
    )
    assert np.array_equal(one.q, three.q)
    assert np.array_equal(one.nfev, three.nfev)


def test_batches_of_systems_with_equality_rows_check_each_start():
    rail = zivi.Equality(lambda t, q: q[1], lambda t, q: [0.0, 1.0], name="rail")
    system = zivi.MechanicalSystem(
        mass=np.eye(2),
        force=[-9.81, 0.0],
        gaps=[zivi.LinearGap([1.0, 0.0])],
        e=0.5,
        equalities=[rail],
    )
    q = np.array([[1.0, 0.0], [0.5, 0.0]])
    batch = zivi.simulate_batch(system, (0, 3), (q, 0 * q))
    np.testing.assert_allclose(batch.rest_time, 3 * np.sqrt(2 * q[:, 0] / 9.81), rtol=1e-9)
    q[1, 1] = 0.1
    with pytest.raises(ValueError, match="rail"):
        zivi.simulate_batch(system, (0, 3), (q, 0 * q))
