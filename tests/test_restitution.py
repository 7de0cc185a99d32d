"""Coefficients of restitution that are functions or tables of the speed of the impact."""

import ctypes
import math
import pickle

import numpy as np
import pytest

import zivi
from inside import FileError, digest, prepare_simulate

G = 9.81
TABLE = zivi.RestitutionTable([0.0, 1.0, 4.0], [0.8, 0.6, 0.4])
TIGHT = zivi.SwitchedRK(rtol=1e-12, atol=1e-12)
VISCOELASTIC_REST = 10.284940314283
"""``2 sum u_k`` of ``u -> (1 - 0.2 u^(1/5)) u`` after the impact at speed 1, by mpmath."""


def half(v):
    return 0.5


def viscoelastic(v):
    return 1.0 - 0.2 * v**0.2


def lost_at_fast_impacts(v):
    if v > 3.0:
        raise RuntimeError("too fast")
    return 0.5


def ball(e, force=-G):
    return zivi.ImpactSystem(force, e=e)


def body(e, force=-G):
    return zivi.MechanicalSystem(mass=[[1.0]], force=[force], gaps=[zivi.LinearGap([1.0])], e=e)


def rest_of(system, start, until=30.0, method=TIGHT):
    if isinstance(system, zivi.ImpactSystem):
        return zivi.simulate(system, (0, until), start, method).zeno_times[0]
    (x, v) = start
    return zivi.simulate(system, (0, until), ([x], [v]), method).zeno_times[0]


@pytest.mark.parametrize("of", [ball, body])
def test_a_table_rests_where_its_series_ends(of):
    # 1.467450579275547683615166: sqrt(2/g) + 2/g sum u_k, by mpmath
    assert abs(rest_of(of(TABLE), (1.0, 0.0)) - 1.467450579275548) < 1e-12


@pytest.mark.parametrize("of", [ball, body])
def test_a_constant_function_is_newtons_law(of):
    ends = [rest_of(of(e), (1.0, 0.0)) for e in (0.5, half, zivi.Restitution(half))]
    assert np.ptp(ends) < 1e-12


def test_a_power_is_the_speed_dependent_law():
    power = zivi.SpeedDependentImpact(e0=0.5, v0=1.0, k=0.25, e_max=0.9)
    law = zivi.Restitution(lambda v: min(0.5 * v**-0.25, 0.9), limit=0.9)
    one, other = (zivi.simulate(ball(e), (0, 3), (1, 0), TIGHT) for e in (power, law))
    assert abs(one.rest_time - other.rest_time) < 1e-12
    n = min(len(one.impacts), len(other.impacts))
    assert n > 20
    for name in ("t", "xdot_before", "xdot_after"):
        assert np.abs(one.impacts[name][:n] - other.impacts[name][:n]).max() < 1e-12


@pytest.mark.parametrize("force", [-1.0, lambda t, x, xdot: -1.0])
def test_viscoelastic_spheres_rest_after_a_finite_time(force):
    law = zivi.Restitution(viscoelastic)
    assert law.limit == 1.0
    sol = zivi.simulate(ball(law, force), (0, 20), (0, -1.0))
    assert sol.success
    assert abs(sol.rest_time - VISCOELASTIC_REST) < 1e-10
    assert abs(sol(sol.rest_time)[0]) < 1e-9


def test_viscoelastic_gaps_rest_within_the_tolerance_of_the_speed():
    loose = zivi.SwitchedRK(rtol=1e-6, atol=1e-7)
    found = rest_of(body(viscoelastic, -1.0), (0.0, -1.0), 20.0, loose)
    assert abs(found - VISCOELASTIC_REST) < 2e-6


def lossy(v):
    return 1.0 / (1.0 + v**0.5)


LOSSY_RESTS = 1.17770485536, 1.05364217016
"""Impacts of ``lossy`` one by one from height 1, 4,000,000 of them: under ``g`` and ``g + 3 t``."""


@pytest.mark.parametrize("of", [ball, body])
def test_impacts_that_lose_ever_less_rest_where_their_flights_end(of):
    """The flights that are left last 1e-4 s where their speeds are below the tolerance."""
    law = zivi.Restitution(lossy, limit=1.0)
    near = zivi.SwitchedRK(rtol=1e-7, atol=1e-7)
    assert abs(rest_of(of(law), (1.0, 0.0), 3.0, near) - LOSSY_RESTS[0]) < 1e-8


@pytest.mark.parametrize("kind", ["mass", "mechanism", "slider"])
def test_they_rest_under_a_pull_that_changes_meanwhile(kind):
    near = zivi.SwitchedRK(rtol=1e-7, atol=1e-7)
    law = zivi.Restitution(lossy, limit=1.0)
    if kind == "mass":
        found = rest_of(ball(law, lambda t, x, xdot: -G - 3.0 * t), (1.0, 0.0), 3.0, near)
    elif kind == "mechanism":
        gaps, force = [zivi.LinearGap([1.0])], lambda t, q, qdot: [-G - 3.0 * t]
        system = zivi.MechanicalSystem(mass=[[1.0]], force=force, gaps=gaps, e=law)
        found = rest_of(system, (1.0, 0.0), 3.0, near)
    else:
        gap = zivi.LinearGap([0.0, 1.0])
        system = zivi.MechanicalSystem(
            mass=np.eye(2), force=lambda t, q, qdot: [0.0, -G - 3.0 * q[0]], gaps=[gap], e=law
        )
        sol = zivi.simulate(system, (0, 3), ([0.0, 1.0], [1.0, 0.0]), near)
        (found,) = sol.zeno_times
        assert np.abs(sol.q[sol.t > found] - np.outer(sol.t[sol.t > found], [1, 0])).max() < 1e-9
    assert abs(found - LOSSY_RESTS[1]) < 2e-8


def test_gaps_that_bounce_for_long_are_not_brought_to_rest():
    """Two at once have no common end that is known: the run says that its steps are used up."""
    gaps = [zivi.LinearGap([1.0, 0.0]), zivi.LinearGap([0.0, 1.0])]
    law = zivi.Restitution(lambda v: 1.0 / (1.0 + 2.0 * v**0.7), limit=1.0)
    system = zivi.MechanicalSystem(mass=np.eye(2), force=[-G, -G], gaps=gaps, e=law)
    method = zivi.SwitchedRK(rtol=1e-6, atol=1e-4, max_steps=8000)
    sol = zivi.simulate(system, (0, 3), ([1.0, 0.9], [0.0, 0.0]), method)
    assert sol.status.name == "STEP_BUDGET"
    assert not len(sol.zeno_times)


@pytest.mark.parametrize("e", [viscoelastic, TABLE, lambda v: 0.9 / (1.0 + 0.3 * v)])
def test_derivatives_are_differences(e):
    def run(x0, gravity, damping):
        force = zivi.LinearForce(gravity=gravity, damping=damping)
        return ball(e, force), (x0, 0.0)

    system, start = run(0.5, 1.0, 0.1)
    wrt = ("x0", "gravity", "damping")
    found = zivi.sensitivity(system, (0, 30), start, wrt=wrt, method=TIGHT).zeno_times[0]
    for i, value in enumerate((0.5, 1.0, 0.1)):
        ends = []
        for move in (1e-5, -1e-5):
            moved = [0.5, 1.0, 0.1]
            moved[i] = value + move
            ends.append(rest_of(*run(*moved)))
        assert abs((ends[0] - ends[1]) / 2e-5 - found[i]) < 1e-5 * abs(found[i])


def test_the_slope_of_a_function_is_that_given_or_a_difference():
    law = zivi.Restitution(lambda v: 1.0 / (1.0 + v))
    given = zivi.Restitution(lambda v: 1.0 / (1.0 + v), slope=lambda v: -1.0 / (1.0 + v) ** 2)
    v = np.array([0.01, 0.3, 2.0, 17.0])
    assert np.abs(law.slope(v) - 1.0 / (1.0 + v) ** 2).max() < 1e-11
    assert np.abs(given.slope(v) - 1.0 / (1.0 + v) ** 2).max() < 1e-15
    assert np.abs(law.after(v) - v / (1.0 + v)).max() < 1e-15


def test_a_batch_and_gaps_have_laws_of_their_own():
    laws = [TABLE, zivi.Restitution(half), 0.3]
    batch = zivi.simulate_batch([ball(law) for law in laws], (0, 3), [(1.0, 0.0)] * 3)
    ends = [zivi.simulate(ball(law), (0, 3), (1, 0)).rest_time for law in laws]
    assert np.abs(np.array(batch.rest_time) - ends).max() < 1e-15
    gaps = [zivi.LinearGap([1.0, 0.0]), zivi.LinearGap([0.0, 1.0])]
    two = zivi.MechanicalSystem(mass=np.eye(2), force=[-G, -G], gaps=gaps, e=[TABLE, half])
    sol = zivi.simulate(two, (0, 3), ([1.0, 1.0], [0.0, 0.0]), TIGHT)
    single = [rest_of(body(e), (1.0, 0.0)) for e in (TABLE, half)]
    assert np.abs(np.sort(sol.zeno_times) - np.sort(single)).max() < 1e-10


def test_a_function_of_ctypes_needs_no_interpreter():
    code = ctypes.CFUNCTYPE(ctypes.c_double, ctypes.c_double)(lambda v: 0.5)
    assert (
        abs(rest_of(ball(zivi.Restitution(code)), (1.0, 0.0)) - rest_of(ball(0.5), (1, 0))) < 1e-12
    )
    wrong = ctypes.CFUNCTYPE(ctypes.c_double, ctypes.c_int)(lambda v: 0.5)
    with pytest.raises((TypeError, ctypes.ArgumentError)):
        zivi.Restitution(wrong)


def test_functions_of_numba_are_compiled():
    numba = pytest.importorskip("numba")
    law = zivi.Restitution(numba.njit(lambda v: 1.0 - 0.2 * v**0.2))
    sol = zivi.simulate(ball(law, -1.0), (0, 20), (0, -1.0))
    assert abs(sol.rest_time - VISCOELASTIC_REST) < 1e-10


@pytest.mark.parametrize("of", [ball, body])
def test_what_a_function_raises_reaches_the_caller(of):
    fast = zivi.Restitution(_after_checks(lost_at_fast_impacts))
    start = (1.0, 0.0) if of is ball else ([1.0], [0.0])
    with pytest.raises(RuntimeError, match="too fast") as raised:
        zivi.simulate(of(fast), (0, 3), start)
    assert abs(raised.value.trajectory.t[-1] - math.sqrt(2 / G)) < 1e-6


def _after_checks(f):
    """Give a function that is half until construction is over."""
    calls = []

    def later(v):
        calls.append(v)
        return f(v) if len(calls) > 200 or v == pytest.approx(math.sqrt(2 * G)) else 0.5

    return later


def test_a_value_out_of_range_ends_a_run():
    def jump(v):
        return 2.0 if v == pytest.approx(math.sqrt(2 * G), rel=1e-6) else 0.5

    with pytest.raises(ValueError, match=r"e\(v\) must be in \[0, 1\], got 2 at v = 4\.42945"):
        zivi.simulate(ball(zivi.Restitution(jump)), (0, 3), (1, 0))


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: zivi.Restitution(lambda v: 1.5), r"f\(0\.0\) must be in \[0, 1\]"),
        (lambda: zivi.Restitution(lambda v: 1.0 - v), r"e\(v\) must be in \[0, 1\], got"),
        (lambda: zivi.Restitution(lambda v: 0.5 * v**-0.2), "limit must be given"),
        (lambda: zivi.Restitution(half, limit=0.9), r"limit must be the coefficient as v -> 0"),
        (lambda: zivi.Restitution(half, limit=1.1), r"limit must be in \[0, 1\]"),
        (lambda: zivi.RestitutionTable([0, 1], [0.5]), "one length"),
        (lambda: zivi.RestitutionTable([1, 0], [0.5, 0.4]), "increasing speeds"),
        (lambda: zivi.RestitutionTable([0, 1], [0.5, 1.4]), r"e\[1\] must be in \[0, 1\]"),
    ],
)
def test_what_is_out_of_range_is_named(make, message):
    with pytest.raises(ValueError, match=message):
        make()


def test_what_is_no_function_of_the_speed_is_named():
    with pytest.raises(TypeError, match="f must be a function"):
        zivi.Restitution(0.5)
    with pytest.raises(TypeError, match=r"f must be a function of \(v\)"):
        zivi.Restitution(lambda t, x, v: 0.5)


def test_chains_are_extrapolated_where_a_function_is_smooth():
    smooth = {
        half: 64.0,
        viscoelastic: 0.0,
        lambda v: 0.8 + 0.1 * math.sqrt(v) / (1 + v): 0.0,
        lambda v: 0.8 - 0.1 * min(v, 1.0): 1.0,
    }
    for f, up_to in smooth.items():
        found = vars(zivi.Restitution(f))["smooth_up_to"]
        assert (found == 0.0) if up_to == 0.0 else (up_to / 4 <= found <= up_to)


def test_laws_are_kept_compared_and_shown(tmp_path):
    law = zivi.Restitution(half)
    for it in (law, TABLE):
        again = pickle.loads(pickle.dumps(it))
        assert (repr(again), hash(again)) == (repr(it), hash(it))
        assert again == it
        assert zivi.simulate(pickle.loads(pickle.dumps(ball(it))), (0, 3), (1, 0)).success
    assert law not in (zivi.Restitution(viscoelastic), TABLE)
    assert repr(law) == "Restitution(half, limit=0.5)"
    other = zivi.RestitutionTable([0.0, 1.0], [0.8, 0.6])
    assert repr(other) == "RestitutionTable(v=[0.0, 1.0], e=[0.8, 0.6])"
    assert digest(ball(law)) == digest(ball(zivi.Restitution(half)))
    assert digest(ball(TABLE)) != digest(ball(other))
    sol = zivi.simulate(ball(TABLE), (0, 3), (1, 0))
    assert sol.config["e"] == {"name": "RestitutionTable", "v": [0, 1, 4], "e": [0.8, 0.6, 0.4]}
    zivi.files.save(sol, tmp_path / "run.nc")
    assert np.array_equal(zivi.files.load(tmp_path / "run.nc").x, sol.x)


def test_a_file_has_a_table(tmp_path):
    text = """
    t_span = [0, 3]
    y0 = [1, 0]
    [system]
    force = -9.81
    e = {law = "RestitutionTable", v = [0.0, 1.0, 4.0], e = [0.8, 0.6, %s]}
    """
    (tmp_path / "ball.toml").write_text(text % "0.4")
    run = prepare_simulate(tmp_path / "ball.toml").run(False)
    assert run.rest_time == zivi.simulate(ball(TABLE), (0, 3), (1, 0)).rest_time
    (tmp_path / "ball.toml").write_text(text % "1.4")
    with pytest.raises(FileError, match="e"):
        prepare_simulate(tmp_path / "ball.toml")


def test_a_closed_loop_of_gaps_takes_a_law():
    class Nothing:
        h = 0.01

        def step(self, t, q, qdot):
            return [0.0]

    gap = zivi.LinearGap([1.0])
    system = zivi.MechanicalSystem(mass=[[1.0]], force=[-G], gaps=[gap], e=TABLE, inputs=[[1.0]])
    start = ([1.0], [0.0])
    loop = zivi.simulate_closed_loop(system, Nothing(), (0, 1), start, method=TIGHT)
    plain = zivi.simulate(body(TABLE), (0, 1), start, TIGHT)
    assert np.allclose(loop.q[-1], plain.q[-1], rtol=0, atol=1e-9)


@pytest.mark.parametrize(
    ("f", "limit"),
    [
        (lambda v: 0.5004, 0.5),  # as near as a measured limit is
        (lambda v: 0.5 + 0.4 * v**0.01, 0.5),  # far at any speed, and tends to it
    ],
)
def test_a_limit_may_be_rounded_or_approached_slowly(f, limit):
    assert zivi.Restitution(f, limit=limit).limit == limit
