"""Tables of time: what is between their knots, and runs that they excite, move or feed."""

import ctypes
import pickle

import numpy as np
import pytest
from scipy import interpolate, optimize

import zivi

TIGHT = zivi.SwitchedRK(rtol=1e-13, atol=1e-15)


def draw(k=40, seed=0, width=None):
    rng = np.random.default_rng(seed)
    times = np.cumsum(rng.uniform(0.05, 0.3, k)) - 1.0
    return times, rng.normal(size=k if width is None else (k, width))


class TestValues:
    def test_lines_are_those_of_numpy(self):
        times, values = draw()
        at = np.linspace(times[0] - 1, times[-1] + 1, 1001)
        table = zivi.Table(times, values, offset=2.0, scale=-3.0)
        assert np.allclose(table(at), 2 - 3 * np.interp(at, times, values), rtol=0, atol=2e-14)

    @pytest.mark.parametrize("kind", ["cubic", "monotone"])
    @pytest.mark.parametrize("derivative", [0, 1, 2])
    def test_curves_and_their_derivatives_are_those_of_scipy(self, kind, derivative):
        times, values = draw(width=3)
        of = {"cubic": interpolate.CubicSpline, "monotone": interpolate.PchipInterpolator}[kind]
        at = np.linspace(times[0], times[-1], 999)[1:-1]
        found = zivi.Table(times, values, kind)(at, derivative)
        exact = of(times, values, axis=0)(at, derivative)
        assert found.shape == (997, 3)
        assert np.allclose(found, exact, rtol=1e-11, atol=1e-11)

    def test_a_held_value_begins_at_its_time(self):
        times, values = draw()
        table = zivi.Table(times, values, "hold")
        assert np.array_equal(table(times), values)
        assert np.array_equal(table(np.nextafter(times[1:], -9)), values[:-1])
        assert table(times[0] - 5) == values[0]
        assert table(99.0) == values[-1]

    @pytest.mark.parametrize("kind", ["linear", "cubic", "monotone"])
    def test_a_periodic_table_is_as_smooth_over_its_ends_as_within(self, kind):
        times = np.linspace(0.0, 1.0, 11)
        values = np.sin(2 * np.pi * times) + 0.3 * np.cos(4 * np.pi * times)
        values[-1] = values[0]
        table = zivi.Table(times, values, kind, "periodic")
        at = np.linspace(0, 1, 77)
        assert np.allclose(table(at), table(at - 3), atol=1e-13)
        assert np.allclose(table(at), table(at + 40), atol=1e-12)
        if kind != "linear":
            eps = 1e-9
            assert abs(table(-eps, 1) - table(eps, 1)) < 1e-6
        # rounding is no jump
        values[-1] += 1e-15
        rounded = zivi.Table(times, values, kind, "periodic")
        assert np.array_equal(rounded(at), table(at))
        assert rounded.values[-1] == values[0]
        # in a table of three periods the one between is far from the ends
        around = np.concatenate([times[:-1] - 1, times[:-1], times + 1])
        three = zivi.Table(around, np.concatenate([values[:-1], values[:-1], values]), kind)
        if kind != "cubic":  # of which the ends reach further
            assert np.allclose(three(at), table(at), atol=1e-12)

    def test_a_monotone_table_does_not_overshoot(self):
        steps = zivi.Table([0, 1, 2, 3, 4], [0, 0, 1, 1, 1], "monotone")(np.linspace(0, 4, 401))
        spline = zivi.Table([0, 1, 2, 3, 4], [0, 0, 1, 1, 1], "cubic")(np.linspace(0, 4, 401))
        assert steps.min() == 0
        assert steps.max() == 1
        assert spline.max() > 1.02

    def test_what_it_is_made_of(self, tmp_path):
        pandas = pytest.importorskip("pandas")
        times, values = draw()
        table = zivi.Table(times, values)
        assert zivi.Table(pandas.Series(values, index=times)) == table
        timed = pandas.Series(values, index=pandas.to_timedelta(times, unit="s"))
        assert np.allclose(zivi.Table(timed).times, times, atol=1e-9)
        frame = pandas.DataFrame({"a": values, "b": -values}, index=times)
        assert np.array_equal(zivi.Table(frame).values, np.column_stack([values, -values]))
        with pytest.raises(TypeError, match="dates"):
            zivi.Table(pandas.Series([1.0, 2.0], index=pandas.date_range("2020", periods=2)))
        frame.to_csv(tmp_path / "named.csv", index_label="t")
        named = zivi.Table.from_csv(tmp_path / "named.csv", time="t", columns="b", kind="hold")
        assert named == zivi.Table(times, -values, "hold")
        np.savetxt(tmp_path / "plain.txt", np.column_stack([values, times]), delimiter=";")
        plain = zivi.Table.from_csv(tmp_path / "plain.txt", time=1, delimiter=";", scale=2.0)
        assert np.allclose(plain.values, 2 * values, rtol=1e-15)
        assert pickle.loads(pickle.dumps(named)) == named
        with pytest.raises(ValueError, match="columns must be a column"):
            zivi.Table.from_csv(tmp_path / "named.csv", columns="c")

    @pytest.mark.parametrize(
        ("text", "settings", "told"),
        [
            ("t;a\n0;1\n1;2\n", {}, r"got '0;1' in line 2; use delimiter=';'$"),
            ("0;1\n1;2\n", {}, r"got '1;2' in line 2; use delimiter=';'$"),
            ("0\t1\n1\t2\n", {}, r"in line 2; use delimiter='\\t'$"),
            ("t;a\n0,5;1\n1;2\n", {"delimiter": ";"}, r"got '0,5' in line 2; write decimal po"),
            ("0,1\n\n1,2,3\n", {}, "got 3 columns instead of 2 in line 3$"),
            ("t,a\n0,1\n1,x\n", {}, "must hold numbers parted by ',', got 'x' in line 3$"),
        ],
    )
    def test_what_keeps_a_file_from_being_read_is_said(self, text, settings, told, tmp_path):
        (tmp_path / "a.csv").write_text(text)
        with pytest.raises(ValueError, match=told):
            zivi.Table.from_csv(tmp_path / "a.csv", **settings)

    @pytest.mark.parametrize("kind", ["linear", "cubic", "monotone"])
    def test_values_whose_slopes_are_too_large_are_told(self, kind):
        with pytest.raises(ValueError, match=r"slopes .* up to 1e\+308 .* 0\.5 s; use"):
            zivi.Table([0.0, 0.5, 2.0, 3.0], [1e308, -1e308, 1e308, 0.0], kind)

    @pytest.mark.parametrize(
        ("arguments", "told"),
        [
            (([0, 1, 1], [0, 0, 0]), "times must increase"),
            (([0], [0]), "k >= 2"),
            (([0, 1], [0, 1, 2]), "values must have shape"),
            (([0, 1], [0, np.nan]), "values must be finite"),
            (([0, 1], [0, 1], "spline"), "kind must be one of"),
            (([0, 1], [0, 1], "linear", "wrap"), "extend must be one of"),
            (([0, 1], [0, 1], "linear", "periodic"), "end as they begin"),
            (([0, 1, 2], [1, 0, 1 + 1e-13], "linear", "periodic"), "end as they begin"),
        ],
    )
    def test_what_is_no_table_is_refused(self, arguments, told):
        with pytest.raises(ValueError, match=told):
            zivi.Table(*arguments)


def held_flights(times, values, k, x, v, e, end):
    """Impacts and the last state of ``x'' = -k x + u`` with held ``u``, by cosines and sines."""
    w, t, hits = np.sqrt(k), times[0], []
    for start, stop, u in zip(times, [*times[1:], end], values, strict=True):
        assert t == start
        while t < stop:

            def at(s, x=x, v=v, u=u):
                c = x - u / k
                return u / k + c * np.cos(w * s) + v / w * np.sin(w * s)

            def rate(s, x=x, v=v, u=u):
                return -w * (x - u / k) * np.sin(w * s) + v * np.cos(w * s)

            grid = np.linspace(0, stop - t, 400)
            below = np.flatnonzero(at(grid[1:]) < 0)
            if not len(below):
                x, v, t = at(stop - t), rate(stop - t), stop
                break
            low = grid[below[0]] if below[0] or x > 0 else 1e-9
            s = optimize.brentq(at, low, grid[below[0] + 1], xtol=1e-16, rtol=1e-15)
            t, x, v = t + s, 0.0, -e * rate(s)
            hits.append(t)
    return np.array(hits), x, v


def test_a_held_excitation_is_that_of_the_closed_form():
    times = np.arange(12) * 0.7
    values = np.array([-3, -8, 1, -2, -9, -4, 3, -7, -5, -1, -6, -8.0])
    exact, x, v = held_flights(times, values, 4.0, 1.0, 0.5, 0.8, 8.4)
    table = zivi.Table(times, values, "hold")
    force = zivi.LinearForce(stiffness=4.0, excitation=table)
    assert force(0.75, 0.5, 0.0) == -2.0 - 8.0
    mass = zivi.simulate(zivi.ImpactSystem(force, e=0.8), (0, 8.4), (1.0, 0.5), TIGHT)
    assert len(exact) > 8
    assert np.max(np.abs(mass.impacts["t"] - exact)) < 1e-12
    assert abs(mass.x[-1] - x) < 1e-12
    assert abs(mass.xdot[-1] - v) < 1e-12
    system = zivi.MechanicalSystem(
        mass=1.0,
        force=lambda t, q, qdot, u: u - 4 * q,
        gaps=[zivi.LinearGap([1.0])],
        e=0.8,
        inputs=table,
    )
    again = zivi.simulate(system, (0, 8.4), ([1.0], [0.5]), TIGHT)
    assert np.max(np.abs(again.impacts["t"] - exact)) < 1e-12
    assert abs(again.q[-1, 0] - x) < 1e-12


N = 3
STIFFNESS = 60.0 * np.array([[2.0, -1, 0], [-1, 2, -1], [0, -1, 1]])
DAMPING = 0.003 * STIFFNESS
STOPS = [
    zivi.LinearGap([0, 0, 1.0], 0.05, name="left"),
    zivi.LinearGap([0, 0, -1.0], 0.05, name="right"),
]


def ground(kind="linear", extend="hold"):
    """Accelerations at 100 Hz, filtered noise."""
    noise, values = np.random.default_rng(3).normal(size=2001), [0.0]
    for it in noise[1:]:
        values.append(0.9 * values[-1] + it)
    return zivi.Table(np.arange(2001) / 100, values, kind, extend, scale=0.5)


def compiled_force():
    """``F = -K q - C q' - u`` through pointers, as compiled code has it."""

    pointer = ctypes.POINTER(ctypes.c_double)

    @ctypes.CFUNCTYPE(None, ctypes.c_double, pointer, pointer, pointer, pointer)
    def force(_, q, qdot, u, out):
        at, speed = np.array(q[:N]), np.array(qdot[:N])
        for i, value in enumerate((-STIFFNESS @ at - DAMPING @ speed - u[0]).tolist()):
            out[i] = value

    return force


def driven(force=None, **more):
    given = force or (lambda t, q, qdot, u: -STIFFNESS @ q - DAMPING @ qdot - u)
    return zivi.MechanicalSystem(mass=np.eye(N), force=given, gaps=STOPS, e=0.5, **more)


REST = (np.zeros(N), np.zeros(N))


@pytest.mark.slow
def test_the_knots_of_an_accelerogram_are_steps_without_being_given_again():
    system = driven(inputs=ground())
    run = zivi.simulate(system, (0, 20), REST, dense_output=False)
    exact = zivi.simulate(system, (0, 20), REST, TIGHT, dense_output=False)
    assert run.nfev <= 34_000
    assert len(exact.impacts) >= 10
    first = np.abs(run.impacts["t"][:10] - exact.impacts["t"][:10])
    assert np.max(first) <= 1e-11
    times = ground().times
    looked = driven(lambda t, q, qdot: -STIFFNESS @ q - DAMPING @ qdot - ground_at(t))
    told = zivi.simulate(looked, (0, 2), REST, tstops=times, dense_output=False)
    short = zivi.simulate(system, (0, 2), REST, dense_output=False)
    assert np.max(np.abs(told.q[-1] - short.q[-1])) < 1e-12


GROUND = ground()


def ground_at(t):
    return np.interp(t, GROUND.times, GROUND.values)


def test_compiled_forces_take_the_inputs_as_functions_do():
    table = ground()
    plain = zivi.simulate(driven(inputs=table), (0, 1), REST)
    fast = zivi.simulate(driven(compiled_force(), inputs=table), (0, 1), REST)
    assert np.array_equal(plain.q[-1], fast.q[-1])
    assert len(plain.impacts) > 0
    wide = zivi.Table(table.times, np.column_stack([table.values] * N))
    each = zivi.simulate(driven(inputs=wide), (0, 1), REST)
    assert np.array_equal(plain.q[-1], each.q[-1])
    batch = zivi.simulate_batch(driven(inputs=table), (0, 1), REST)
    assert np.array_equal(batch.q[0], plain.q[-1])
    signature = ctypes.CFUNCTYPE(None, ctypes.c_double, *[ctypes.c_void_p] * 3)
    with pytest.raises(TypeError, match=r"double \*u"):
        driven(signature(lambda *_: None), inputs=table)
    # without a time it is the matrix of the inputs of a controller
    with pytest.raises(ValueError, match="inputs must be for as many coordinates"):
        driven(lambda t, q, qdot: -q, inputs=[1.0, 2.0])


CUBIC = np.polynomial.Polynomial([0.1, -0.2, 0.3, -0.05])
LIFT = zivi.MovingWall(
    lambda t: float(CUBIC(t)), lambda t: float(CUBIC.deriv()(t)), lambda t: float(CUBIC.deriv(2)(t))
)


def lift_table(**more):
    times = np.linspace(0.0, 4.0, 9)
    return zivi.Table(times, CUBIC(times), "cubic", **more)


class TestWalls:
    """A not-a-knot spline through points of a cubic is that cubic."""

    def test_a_mass_above_a_wall_of_a_table(self):
        runs = [
            zivi.simulate(zivi.ImpactSystem(-9.81, e=0.7, wall=it), (0, 3), (1, 0), TIGHT)
            for it in (lift_table(), LIFT)
        ]
        times = [run.impacts["t"] for run in runs]
        assert len(times[0]) == len(times[1]) > 5
        assert np.max(np.abs(times[0] - times[1])) < 1e-12
        fixed = [run.fixed(np.linspace(0, 3, 50))[0] for run in runs]
        assert np.max(np.abs(fixed[0] - fixed[1])) < 1e-11

    @pytest.mark.parametrize("native", [False, True])
    def test_a_gap_over_a_wall_of_a_table(self, native):
        signature = ctypes.CFUNCTYPE(None, ctypes.c_double, *[ctypes.POINTER(ctypes.c_double)] * 3)

        def weight(_, q, qdot, out):
            out[0] = -9.81

        force = signature(weight) if native else [-9.81]
        runs = [
            zivi.simulate(
                zivi.MechanicalSystem(
                    mass=1.0, force=force, gaps=[zivi.LinearGap([1.0], motion=it)], e=0.7
                ),
                (0, 3),
                ([1.1], [0.0]),
                TIGHT,
            )
            for it in (lift_table(), LIFT)
        ]
        times = [run.impacts["t"] for run in runs]
        assert len(times[0]) == len(times[1]) > 5
        assert np.max(np.abs(times[0] - times[1])) < 1e-12

    @pytest.mark.parametrize("kind", ["linear", "hold"])
    def test_walls_whose_velocity_jumps_are_refused(self, kind):
        table = zivi.Table([0, 1, 2], [0, 1, 0], kind)
        with pytest.raises(ValueError, match="'cubic' or 'monotone'"):
            zivi.LinearGap([1.0], motion=table)
        with pytest.raises(ValueError, match="'cubic' or 'monotone'"):
            zivi.ImpactSystem(-9.81, e=0.5, wall=table)
        with pytest.raises(ValueError, match="2 columns"):
            zivi.LinearGap([1.0], motion=zivi.Table([0, 1, 2], np.zeros((3, 2)), "cubic"))

    def test_a_wall_does_not_stop_at_once_at_the_end_of_its_table(self):
        system = zivi.ImpactSystem(-9.81, e=0.7, wall=lift_table())
        with pytest.raises(ValueError, match="velocity would jump"):
            zivi.simulate(system, (0, 5), (1, 0))


def test_a_run_does_not_leave_a_table_that_has_an_end():
    table = zivi.Table([0, 1, 2], [0, 1, 0], extend="error")
    system = zivi.ImpactSystem(zivi.LinearForce(gravity=1, excitation=table), e=0.5)
    assert zivi.simulate(system, (0, 2), (1, 0)).success
    with pytest.raises(ValueError, match="within the times of the table"):
        zivi.simulate(system, (0, 2.1), (1, 0))
    with pytest.raises(ValueError, match="t must be within the times"):
        table(2.5)


def test_derivatives_of_a_run_under_a_table_are_those_by_differences():
    table = zivi.Table([0, 0.5, 1.1, 2, 3], [0, 1, -2, 3, 1.0], "linear")

    def run(stiffness, x0):
        force = zivi.LinearForce(stiffness=stiffness, gravity=3.0, excitation=table)
        return zivi.ImpactSystem(force, e=0.7), (x0, 0.0)

    system, start = run(2.0, 1.0)
    found = zivi.sensitivity(system, (0, 3), start, wrt=("stiffness", "x0"), method=TIGHT)
    step = 1e-5
    for column, change in enumerate([(step, 0.0), (0.0, step)]):
        ends = []
        for sign in (1, -1):
            near, y0 = run(2.0 + sign * change[0], 1.0 + sign * change[1])
            sol = zivi.simulate(near, (0, 3), y0, TIGHT)
            ends.append([sol.x[-1], sol.xdot[-1]])
        difference = (np.array(ends[0]) - np.array(ends[1])) / (2 * step)
        assert np.allclose(np.ravel(found.final[:, column]), difference, rtol=1e-6, atol=1e-7)


def test_what_does_not_step_onto_knots_takes_no_table():
    table = zivi.Table([0, 1, 2], [0, 1, 0], extend="periodic")
    system = zivi.ImpactSystem(zivi.LinearForce(gravity=1, excitation=table), e=0.5)
    with pytest.raises(TypeError, match=r"does not support zivi\.Table"):
        zivi.periodic_orbit(system, (1, 0))
    with pytest.raises(TypeError, match=r"excitation must be a zivi\.Table"):
        zivi.LinearForce(excitation=3.0)
    walled = zivi.ImpactSystem(-9.81, e=0.5, wall=lift_table())
    with pytest.raises(TypeError, match=r"wall of system 1 must not be a zivi\.Table in a batch"):
        zivi.simulate_batch([zivi.ImpactSystem(-9.81, e=0.5), walled], (0, 1), (1, 0))


def random_tables(seed, count):
    """Masses under tables of all kinds, knots of their own, and their starts."""
    rng = np.random.default_rng(seed)
    kinds = ("linear", "cubic", "monotone", "hold")
    systems, starts = [], []
    for i in range(count):
        times = np.sort(rng.uniform(0, 2, rng.integers(3, 12)))
        extend = ("hold", "periodic")[i % 2]
        values = rng.normal(0, 4, len(times))
        if extend == "periodic":
            values[-1] = values[0]
        force = zivi.LinearForce(
            stiffness=rng.uniform(0, 20),
            damping=rng.uniform(0, 1),
            gravity=rng.uniform(0, 9),
            excitation=zivi.Table(times, values, kinds[i % 4], extend),
        )
        systems.append(zivi.ImpactSystem(force, e=rng.uniform(0, 0.95)))
        starts.append((rng.uniform(0, 1), rng.normal(0, 2)))
    return systems, np.array(starts)


@pytest.mark.parametrize("threads", [1, 2])
def test_a_batch_under_tables_has_the_bits_of_single_runs(threads):
    systems, starts = random_tables(5, 60)
    span, times = (0.0, 5.0), np.linspace(0, 5, 23)
    for tstops in (None, [0.7, 3.1]):
        ends = zivi.simulate_batch(
            systems, span, starts, save="events", threads=threads, tstops=tstops
        )
        at = zivi.simulate_batch(
            systems, span, starts, t_eval=times, threads=threads, tstops=tstops
        )
        grazing = zivi.simulate_batch(systems, span, starts, save="grazing", tstops=tstops)
        for i, (system, y0) in enumerate(zip(systems, starts, strict=True)):
            sol = zivi.simulate(
                system, span, y0, samples="steps", dense_output=False, tstops=tstops
            )
            for batch in (ends, at, grazing):
                assert (batch.x[i], batch.xdot[i]) == (sol.x[-1], sol.xdot[-1])
            assert ends.nfev[i] == sol.nfev
            assert np.array_equal(ends.events[i]["impacts"], sol.impacts)
            assert np.array_equal(ends.events[i]["liftoffs"], sol.liftoffs)
            alone = zivi.simulate(system, span, y0, t_eval=times, tstops=tstops)
            assert np.array_equal(at.sample_x[i], alone.x)
            assert np.array_equal(at.sample_xdot[i], alone.xdot)
    assert ends.n_impacts.sum() > 300
    assert ends.n_liftoffs.sum() > 10


def test_a_batch_ends_its_steps_at_the_knots_of_one_table_for_all():
    """A pulse of a thousandth of a second is missed where steps do not end at its knots."""
    pulse = zivi.Table([0, 1, 1.0005, 1.001, 2], [0, 0, 3000, 0, 0])
    systems = [
        zivi.ImpactSystem(zivi.LinearForce(gravity=g, excitation=pulse), e=0.5) for g in (0.1, 0.2)
    ]
    starts = np.array([[1.0, 0.0]] * 3)
    batch = zivi.simulate_batch(systems[0], (0, 2), starts)
    # from 1 m: the pulse is 1.5 m/s at 1.0005 s
    exact = 1 - 0.1 * 2**2 / 2 + 1.5 * (2 - 1.0005)
    assert np.allclose(batch.x, exact, rtol=1e-12)
    batch = zivi.simulate_batch(systems, (0, 2), starts[:2])
    assert np.allclose(batch.x, [exact, exact - 0.2], rtol=1e-12)
    with pytest.raises(ValueError, match="tstops is not supported by"):
        zivi.simulate_batch(systems, (0, 2), starts[:2], method=zivi.ThetaGamma(h=1e-3), tstops=[1])
    method = zivi.ThetaGamma(h=1e-3)
    fixed = zivi.simulate_batch(systems, (0, 2), starts[:2], method=method)
    alone = [zivi.simulate(system, (0, 2), (1, 0), method).x[-1] for system in systems]
    assert np.array_equal(fixed.x, alone)


def test_forces_with_and_without_a_table_are_kept(tmp_path):
    plain = zivi.LinearForce(gravity=1.0)
    assert "excitation" not in repr(plain)
    assert pickle.loads(pickle.dumps(plain)) == plain
    table = lift_table()
    force = zivi.LinearForce(gravity=1.0, excitation=table)
    assert pickle.loads(pickle.dumps(force)) == force
    sol = zivi.simulate(zivi.ImpactSystem(force, e=0.5, wall=table), (0, 2), (1, 0))
    pytest.importorskip("xarray")
    zivi.files.save(sol, tmp_path / "run.nc")
    again = zivi.files.load(tmp_path / "run.nc")
    assert np.array_equal(again.fixed()[0], sol.fixed()[0])
    assert again.config["force"]["excitation"]["times"] == table.times.tolist()


def test_a_periodic_excitation_steps_onto_the_knots_of_all_periods():
    table = zivi.Table([0.0, 0.3, 0.7, 1.0], [-2, 5, -6, -2.0], "hold", "periodic")
    force = zivi.LinearForce(gravity=4.0, excitation=table)
    sol = zivi.simulate(zivi.ImpactSystem(force, e=0.6), (0, 30), (1, 0), TIGHT)
    times = np.ravel(np.arange(30)[:, None] + np.array([0.0, 0.3, 0.7]))
    values = np.tile([-2.0, 5.0, -6.0], 30)
    long = zivi.LinearForce(gravity=4.0, excitation=zivi.Table(times, values, "hold"))
    again = zivi.simulate(zivi.ImpactSystem(long, e=0.6), (0, 30), (1, 0), TIGHT)
    assert len(sol.impacts) > 20
    assert abs(sol.x[-1] - again.x[-1]) < 1e-9
