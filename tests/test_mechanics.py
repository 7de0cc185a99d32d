"""Mechanical systems: laws, equivalences, bad input, and what a result can do."""

import ctypes
import itertools
import math
import pickle
import threading

import numpy as np
import pytest

import zivi
from inside import check_start
from interrupting import wait_for
from mechanical_models import model, multi_case, ndof_case

pytestmark = pytest.mark.xdist_group("mechanical models")

TIGHT = zivi.SwitchedRK(rtol=1e-10, atol=1e-12)
FLOOR = zivi.LinearGap([0, 1], name="floor")
WALL = zivi.LinearGap([-1, 0], 0.8, name="wall")


def box(**changes):
    given = {"mass": np.eye(2), "force": [2.0, -9.81], "gaps": [FLOOR, WALL], "e": [0.5, 0.3]}
    return zivi.MechanicalSystem(**given | changes)


# --- the smallest case, and independent gaps


SCALAR = [
    (zivi.LinearForce(gravity=9.81), 0.5, (1.0, 0.3), 3.0),
    (zivi.LinearForce(gravity=1.0, amplitude=2.0, omega=3.0, damping=0.1), 0.6, (0.5, 0.0), 6.0),
    (zivi.LinearForce(stiffness=4.0, gravity=0.5), 0.3, (0.2, -0.4), 5.0),
    (zivi.LinearForce(gravity=9.81), 0.0, (1.0, 0.0), 2.0),
    (zivi.LinearForce(gravity=9.81), 1.0, (1.0, 0.0), 2.0),
]


@pytest.mark.parametrize("order", [5, 8])
@pytest.mark.parametrize("case", range(len(SCALAR)))
def test_one_coordinate_and_one_gap_are_an_impact_system(case, order):
    force, e, (x, xdot), end = SCALAR[case]
    method = zivi.SwitchedRK(rtol=1e-9, atol=1e-11, order=order, flights="rk")
    one = zivi.simulate(zivi.ImpactSystem(force, e=e), (0, end), (x, xdot), method)
    system = zivi.MechanicalSystem(
        mass=1.0,
        force=lambda t, q, qdot: [force(t, q[0], qdot[0])],
        gaps=[zivi.LinearGap([1])],
        e=e,
    )
    sol = zivi.simulate(system, (0, end), ([x], [xdot]), method)
    assert sol.success
    # a mass takes impacts from its dense output where that is good, but under a constant force
    close = 1e-13 if force.stiffness == force.amplitude == 0.0 else 0.1 * method.rtol
    assert sol.zeno["t"] == pytest.approx(one.zeno_times, abs=close)
    assert sol.liftoffs["t"] == pytest.approx(one.liftoff_times, abs=close)
    n = min(len(sol.resolved_impacts), len(one.resolved_impacts), 8)
    assert sol.resolved_impacts["t"][:n] == pytest.approx(one.resolved_impacts["t"][:n], abs=close)
    assert [sol.q[-1, 0], sol.qdot[-1, 0]] == pytest.approx([one.x[-1], one.xdot[-1]], abs=close)


def test_orthogonal_gaps_are_scalar_runs():
    push = zivi.LinearForce(gravity=-2.0, amplitude=3.0, omega=2.0)
    method = zivi.SwitchedRK(rtol=1e-13, atol=1e-14)
    system = box(force=lambda t, q, qdot: [push(t, 0.0, 0.0), -9.81])
    sol = zivi.simulate(system, (0, 3), ([0.0, 0.5], [0.5, 0.0]), method)
    below = zivi.simulate(zivi.ImpactSystem(-9.81, e=0.5), (0, 3), (0.5, 0.0), method)
    away = zivi.LinearForce(gravity=2.0, amplitude=-3.0, omega=2.0)
    beside = zivi.simulate(zivi.ImpactSystem(away, e=0.3), (0, 3), (0.8, -0.5), method)
    for gap, run in ((0, below), (1, beside)):
        assert sol.zeno["t"][sol.zeno["gap"] == gap] == pytest.approx(run.zeno_times, abs=1e-12)
        mine = sol.liftoffs["t"][sol.liftoffs["gap"] == gap]
        assert mine == pytest.approx(run.liftoff_times, abs=1e-12)
        assert sol.gaps[-1, gap] == pytest.approx(run.x[-1], abs=1e-12)
    times = np.linspace(0, 3, 50)
    assert sol(times)[0, :, 1] == pytest.approx(below(times)[0], abs=1e-10)
    assert len(sol.flags) == 0


@pytest.mark.parametrize("order", [0, 1])
def test_gaps_that_are_hit_together_again_and_again_under_different_pulls(order):
    """Two balls whose flights take the same time: one chain of both, by the pull of either."""
    pulls, heights = np.array([19.62, 9.81]), np.array([2.0, 1.0])
    if order:
        pulls, heights = pulls[::-1], heights[::-1]
    gaps = [zivi.LinearGap([1.0, 0.0]), zivi.LinearGap([0.0, 1.0])]
    balls = zivi.MechanicalSystem(mass=np.eye(2), force=-pulls, e=0.5, gaps=gaps)
    run = zivi.simulate(balls, (0, 3), (heights, [0.0, 0.0]), dense_output=True)
    zeno = 3 * np.sqrt(2 / 9.81)
    np.testing.assert_allclose(run.zeno["t"], zeno, rtol=1e-9)
    assert len(np.unique(run.resolved_impacts["group"])) <= 5
    # within the accumulation, at the apex of each flight
    for k in range(1, 8):
        length = 2 * np.sqrt(2 / 9.81) * 0.5**k
        at = zeno - length * (0.5 + 1.0)  # flights of length, length/2, ... follow
        np.testing.assert_allclose(run(at)[0], pulls * length**2 / 8, atol=1e-6 * heights.max())


def test_flights_by_power_series_are_for_impact_systems():
    system = box(force=lambda t, q, qdot: [0.0, -9.81])
    with pytest.raises(ValueError, match="flights must be 'auto' or 'rk' for a MechanicalSystem"):
        zivi.simulate(system, (0, 1), ([1, 1], [0, 0]), zivi.SwitchedRK(flights="series"))


# --- energy


@pytest.mark.parametrize("e", [0.0, 0.5, 1.0, (0.9, 0.2)])
@pytest.mark.parametrize("name", ["wedge", "rock"])
def test_the_energy_never_rises(name, e):
    par = {
        "wedge": {"m": 1.3, "G": 9.81, "cd": 0.0, "a1": 1.1, "a2": 0.9},
        "rock": {"m": 1, "J": 5 / 12, "G": 9.81, "hh": 0.5, "b": 1, "A": 0, "B": 0, "om": 1},
    }[name]
    start = {"wedge": ([0.1, 1.2], [0.3, 0.0]), "rock": ([0.9, 0.1], [0.0, 0.3])}[name]
    system = model(name, par, e)
    method = zivi.SwitchedRK(rtol=1e-12, atol=1e-13)
    sol = zivi.simulate(system, (0, 1.5), start, method)
    mass = np.diag(system.at(0, *start).mass)
    height = sol.q[:, 1] if name == "wedge" else sol.q[:, 0]
    energy = (sol.qdot**2) @ mass / 2 + par["m"] * 9.81 * height
    assert np.max(np.diff(energy)) < 1e-11 * energy[0]
    if e == 1.0:
        assert energy[-1] == pytest.approx(energy[0], rel=1e-10)


def test_every_impact_obeys_its_law():
    system, span, state = multi_case("dumb")
    sol = zivi.simulate(system, span, state, TIGHT)
    rows = sol.resolved_impacts
    assert np.all(rows["speed_before"] <= 0)
    assert np.all(rows["impulse"] >= 0)
    hit = rows["impulse"] > 0
    expected = -system.e[rows["gap"]] * rows["speed_before"]
    assert rows["speed_after"][hit] == pytest.approx(expected[hit], rel=1e-9, abs=1e-12)
    assert np.all(rows["speed_after"] >= expected - 1e-12)


# --- known answers, and what they hang on


def test_newtons_cradle():
    gaps = [zivi.LinearGap([-1, 1, 0]), zivi.LinearGap([0, -1, 1])]
    line = zivi.MechanicalSystem(mass=np.eye(3), force=np.zeros(3), gaps=gaps, e=1.0)
    sol = zivi.simulate(line, (0, 1), ([-0.5, 0, 0], [1, 0, 0]), TIGHT)
    assert sol.qdot[-1] == pytest.approx([-1 / 3, 2 / 3, 2 / 3], abs=1e-13)
    apart = zivi.simulate(line, (0, 1), ([-0.5, 0, 1e-6], [1, 0, 0]), TIGHT)
    assert apart.qdot[-1] == pytest.approx([0, 0, 1], abs=1e-12)


@pytest.mark.parametrize(
    ("tilt", "rests", "flagged"),
    [(0.0, 0.957826, True), (1e-10, 0.685957, True), (1e-12, None, True), (0.1, None, False)],
)
def test_a_bar_dropped_flat(tilt, rests, flagged):
    par = {"m": 1, "J": 1 / 12, "G": 9.81, "l": 0.5, "d": 10}
    system = model("dumb", par, 0.5)
    method = zivi.SwitchedRK(rtol=1e-9, atol=1e-9)
    sol = zivi.simulate(system, (0, 1.2), ([0, 0.5, tilt], [0, 0, 0]), method)
    assert sol.success
    assert bool(len(sol.flags)) is flagged
    assert sol.contacts[-1].tolist() == [True, True, False]
    if rests is not None:
        last = max([*sol.zeno["t"], *sol.corners["t"]])
        assert last == pytest.approx(rests, abs=2e-6)


def test_four_feet_fall_as_one():
    # a bar over a floor: four feet, two coordinates
    feet = [zivi.LinearGap([1, x], name=f"foot {x}") for x in (-1, -0.5, 0.5, 1)]
    bar = zivi.MechanicalSystem(mass=np.diag([1.0, 0.3]), force=[-9.81, 0], gaps=feet, e=0.5)
    sol = zivi.simulate(bar, (0, 3), ([0.5, 0.0], [0, 0]), TIGHT)
    assert sol.success, sol.message
    assert sol.zeno["t"] == pytest.approx(np.full(4, 3 * np.sqrt(1 / 9.81)), abs=1e-9)
    assert np.abs(sol.q[-1]).max() < 1e-12


def test_the_reactions_are_those_of_the_equations():
    system, span, state = multi_case("rock_wide")
    sol = zivi.simulate(system, span, state, TIGHT)
    closed = np.flatnonzero(sol.contacts.any(axis=1))
    assert len(closed) > 10
    for k in closed[::7]:
        here = system.at(sol.t[k], sol.q[k], sol.qdot[k])
        on = sol.contacts[k]
        inverse = np.linalg.solve(here.mass, np.column_stack([here.force, here.gradients[on].T]))
        free = here.gradients[on] @ inverse[:, 0] + here.curvatures[on]
        force = np.zeros(len(on))
        force[on] = -np.linalg.solve(here.gradients[on] @ inverse[:, 1:], free)
        assert sol.reactions[k] == pytest.approx(force, abs=1e-7 * (1 + np.max(np.abs(force))))
        # they keep the gaps closed
        acceleration = np.linalg.solve(here.mass, here.force + here.gradients.T @ force)
        second = here.gradients @ acceleration + here.curvatures
        assert np.abs(second[sol.contacts[k]]).max() < 1e-10
    assert np.all(sol.reactions[~sol.contacts] == 0)


# --- the same system, given otherwise


def sine(**curvature):
    a, k = 0.25, 2.0
    gap = zivi.Gap(
        lambda t, q: q[1] - a * math.sin(k * q[0]),
        lambda t, q: [-a * k * math.cos(k * q[0]), 1.0],
        *curvature.values(),
        name="floor",
    )
    return zivi.MechanicalSystem(mass=np.eye(2), force=[0, -9.81], gaps=[gap], e=0.3)


@pytest.mark.parametrize(
    "system",
    [
        sine(),
        sine(h=lambda t, q, qdot: math.sin(2 * q[0]) * qdot[0] ** 2),
    ],
    ids=["differenced", "given"],
)
def test_python_functions_give_what_the_compiled_system_gives(system):
    derived, span, state = ndof_case("sine")
    method = zivi.SwitchedRK(rtol=1e-9, atol=1e-9)
    sols = [zivi.simulate(it, span, state, method) for it in (derived, system)]
    assert sols[1].zeno["t"] == pytest.approx(sols[0].zeno["t"], abs=1e-9)
    assert sols[1].q[-1] == pytest.approx(sols[0].q[-1], abs=1e-9)


def test_compiled_parts():
    DOUBLES = ctypes.POINTER(ctypes.c_double)

    @ctypes.CFUNCTYPE(None, ctypes.c_double, DOUBLES, DOUBLES, DOUBLES)
    def force(t, q, qdot, out):
        out[0], out[1] = 2.0 - 0.1 * qdot[0], -9.81

    @ctypes.CFUNCTYPE(None, ctypes.c_double, DOUBLES, DOUBLES, DOUBLES)
    def height(t, q, qdot, out):
        out[0] = q[1]

    start = ([0.0, 0.5], [0.5, 0.0])
    gaps = [zivi.Gap(height, [0, 1], name="floor"), WALL]
    system = box(force=force, gaps=gaps)
    by_c = zivi.simulate(system, (0, 2), start)
    by_python = zivi.simulate(box(force=lambda t, q, w: [2.0 - 0.1 * w[0], -9.81]), (0, 2), start)
    assert by_c.q[-1] == pytest.approx(by_python.q[-1], abs=1e-14)
    assert by_c.zeno["t"] == pytest.approx(by_python.zeno["t"], abs=1e-14)


def test_compiled_parts_and_functions_give_the_same_numbers():
    @ctypes.CFUNCTYPE(
        None, ctypes.c_double, *[ctypes.POINTER(ctypes.c_double)] * 3, ctypes.c_void_p
    )
    def force(t, q, qdot, out, data):
        out[0], out[1] = 2.0 - 0.1 * qdot[0] * t, -9.81

    table = zivi.HarmonicWall(0.07, 9.0, phase=0.3, offset=0.02)
    moving = zivi.MovingWall(
        *(
            lambda t, k=k: [
                0.02 + 0.07 * np.cos(9 * t + 0.3),
                -0.63 * np.sin(9 * t + 0.3),
                -5.67 * np.cos(9 * t + 0.3),
            ][k]
            for k in range(3)
        )
    )
    forces = force, lambda t, q, qdot: (2.0 - 0.1 * qdot[0] * t, -9.81)
    mass = [[2.0, 0.1], [0.1, 1.5]]
    masses = mass, lambda t, q: np.array(mass)
    state = (0.7, np.array([0.3, 0.4]), np.array([1.1, -0.7]))
    w, wdot, wddot = table(0.7)
    for force_of, mass_of, wall in itertools.product(forces, masses, (table, moving)):
        floor = zivi.LinearGap([0.3, 2.0], 0.1, wall, "floor")
        slope = zivi.Gap(
            lambda t, q: q[0] * t,
            lambda t, q: [t, 0],
            lambda t, q, w: 2 * w[0],
            lambda t, q: q[0],
            "slope",
        )
        system = box(force=force_of, gaps=[WALL, floor, slope], mass=mass_of, e=0.5)
        native = force_of is force and mass_of is mass and wall is table
        assert not system.model(2).spec.is_native
        assert system.replace(gaps=[WALL, floor], e=0.5).model(2).spec.is_native == native
        here = system.at(*state)
        assert here.mass.tolist() == mass
        assert here.force == pytest.approx([2.0 - 0.1 * 1.1 * 0.7, -9.81], rel=1e-15)
        assert here.gaps == pytest.approx([0.5, 0.09 + 0.8 + 0.1 - w, 0.21], rel=1e-15)
        assert here.gradients.tolist() == [[-1, 0], [0.3, 2.0], [0.7, 0]]
        assert here.rates == pytest.approx([0, -wdot, 0.3], rel=1e-14)
        assert here.curvatures == pytest.approx([0, -wddot, 2.2], rel=1e-14)


def test_flat_gaps_and_constants_call_no_function():
    calls = []

    def force(t, q, qdot):
        calls.append("force")
        return np.array([0.0, -9.81])

    def wall(t):
        calls.append("wall")
        return 0.0

    floor = zivi.LinearGap([0, 1], name="floor")
    system = zivi.MechanicalSystem(mass=np.eye(2), force=force, gaps=[floor], e=0.5)
    sol = zivi.simulate(system, (0, 1.2), ([0, 1], [1, 0]))
    calls.clear()  # the first run compares derivatives with differences
    assert zivi.simulate(system, (0, 1.2), ([0, 1], [1, 0])).nfev == sol.nfev == len(calls) - 1
    moving = zivi.LinearGap([0, 1], motion=zivi.MovingWall(wall, wall, wall), name="floor")
    other = zivi.simulate(system.replace(gaps=[moving]), (0, 1.2), ([0, 1], [1, 0]))
    assert calls.count("wall") > 0
    assert other.q == pytest.approx(sol.q, abs=1e-12)


def test_idle_gaps_cost_no_evaluations():
    idle = [zivi.LinearGap([1.0], 10.0 + i, name=f"idle{i}") for i in range(63)]
    one = zivi.MechanicalSystem(mass=1.0, force=[-9.81], gaps=[zivi.LinearGap([1.0])], e=0.5)
    many = one.replace(gaps=[*one.gaps, *idle], e=0.5)
    few, much = (zivi.simulate(it, (0, 6), ([1.0], [0.0])) for it in (one, many))
    assert much.nfev == few.nfev
    assert much.q[-1] == few.q[-1] == 0.0
    assert much.zeno["t"].tolist() == few.zeno["t"].tolist()


# --- walls that move


def test_a_moving_wall_is_that_of_an_impact_system():
    table = zivi.HarmonicWall(0.12, 11.0, phase=0.4)
    ball = zivi.ImpactSystem(-9.81, e=0.4, wall=table)
    method = zivi.SwitchedRK(rtol=1e-10, atol=1e-12)
    one = zivi.simulate(ball, (0, 4), (0.3, 0.0), method)
    w, wdot, _ = table(0.0)
    system = zivi.MechanicalSystem(
        mass=2.0, force=[-19.62], gaps=[zivi.LinearGap([1], motion=table)], e=0.4
    )
    sol = zivi.simulate(system, (0, 4), ([0.3 + w], [wdot]), method)
    assert sol.zeno["t"] == pytest.approx(one.zeno_times, abs=1e-9)
    assert sol.liftoffs["t"] == pytest.approx(one.liftoff_times, abs=1e-9)
    assert len(sol.liftoffs) > 1


# --- events, samples, the motion between them


def test_events_and_times():
    def apex(t, q, qdot):
        return qdot[1]

    apex.direction = -1

    def stop(t, q, qdot):
        return q[0] - 0.75

    stop.terminal = True
    times = np.linspace(0, 3, 31)
    sol = zivi.simulate(box(), (0, 3), ([0.0, 0.5], [0.5, 0.0]), TIGHT, times, events=[apex, stop])
    assert sol.status is zivi.Status.TERMINATED_BY_EVENT
    assert sol.t_events[1] == pytest.approx([-0.25 + math.sqrt(0.0625 + 0.75)], abs=1e-9)
    assert sol.q_events[1][0, 0] == pytest.approx(0.75, abs=1e-9)
    fall = math.sqrt(2 * 0.5 / 9.81)
    assert sol.t_events[0][0] == pytest.approx(fall + 0.5 * fall, abs=1e-9)
    assert np.isin(sol.t, [*times, *sol.t_events[1]]).all()


def test_the_motion_between_the_samples():
    system, span, state = ndof_case("surf3")
    sol = zivi.simulate(system, span, state, TIGHT)
    mid = (sol.t[1:] + sol.t[:-1]) / 2
    found = sol(mid)
    again = zivi.simulate(system, span, state, TIGHT, mid)
    assert found.shape == (2, len(mid), 3)
    assert found[0] == pytest.approx(again.q, abs=1e-7)
    assert sol(0.3).shape == (2, 3)
    other = sol.resample(n=101)
    assert other.q.shape == (101, 3)
    here = [system.at(t, q, w).gaps for t, q, w in zip(other.t, other.q, other.qdot, strict=True)]
    assert other.gaps == pytest.approx(np.array(here), abs=1e-8)
    assert np.all(other.reactions[other.contacts] > 0)
    with pytest.raises(ValueError, match="within the computed span"):
        sol(span[1] + 1)
    bare = zivi.simulate(system, span, state, TIGHT, dense_output=False)
    with pytest.raises(ValueError, match="dense_output=True"):
        bare(0.1)


def test_what_a_result_can_do(tmp_path):
    sol = zivi.simulate(box(coordinates=["x", "y"]), (0, 3), ([0.0, 0.5], [0.5, 0.0]))
    assert repr(sol).startswith("<MechanicalTrajectory 0 .. 3 s")
    assert "floor" in sol._repr_html_()
    assert np.array_equal(sol.zeno.t, sol.zeno["t"])
    copy = pickle.loads(pickle.dumps(sol))
    assert np.array_equal(copy(1.234), sol(1.234))
    assert copy.gap_names == ("floor", "wall")
    pytest.importorskip("pandas")
    table = sol.to_pandas(n=5)
    assert list(table.columns)[:6] == ["x", "y", "xdot", "ydot", "floor", "wall"]
    data = sol.to_xarray(n=7)
    assert data.q.sel(coordinate="y").shape == (7,)
    assert data.reactions.sel(gap="floor").values[-1] == pytest.approx(9.81)
    pytest.importorskip("h5netcdf")
    zivi.files.save(sol, tmp_path / "box.nc")
    back = zivi.files.load(tmp_path / "box.nc")
    assert np.array_equal(back(1.234), sol(1.234))
    for name in ("t", "q", "contacts", "reactions", "impacts", "zeno", "flags", "corners"):
        assert np.array_equal(getattr(back, name), getattr(sol, name)), name
    assert back.config == sol.config
    assert repr(back) == repr(sol)


def test_plots(monkeypatch):
    mpl = pytest.importorskip("matplotlib")
    mpl.use("Agg")
    import matplotlib.pyplot as plt

    sol = zivi.simulate(box(coordinates=["x", "y"]), (0, 3), ([0.0, 0.5], [0.5, 0.0]))
    ax = zivi.plot.gaps(sol)
    assert [line.get_label() for line in ax.lines[:2]] == ["floor", "wall"]
    assert np.nanmin(ax.lines[0].get_ydata()) >= 0
    ax = zivi.plot.configuration(sol, over=("y", "x"))
    assert (ax.get_xlabel(), ax.get_ylabel()) == ("y", "x")
    ax = zivi.plot.reactions(sol)
    assert ax.lines[0].get_ydata()[-1] == pytest.approx(9.81)
    assert len(zivi.plot.overview(sol).axes) == 4
    with pytest.raises(ValueError, match="over must hold"):
        zivi.plot.configuration(sol, over=("z", "x"))
    with pytest.raises(TypeError, match="of a mechanical system draw"):
        zivi.plot.position(sol)
    ball = zivi.simulate(zivi.ImpactSystem(-9.81, e=0.5), (0, 3), (1, 0))
    with pytest.raises(TypeError, match="MechanicalTrajectory"):
        zivi.plot.gaps(ball)
    plt.close("all")


# --- batches


def test_batches():
    par = {"al": 0.3, "G": 9.81, "mm": 2.0}
    heights = np.linspace(0.5, 1.0, 5)
    q0 = np.column_stack([np.zeros(5), heights])
    batch = zivi.simulate_batch(
        model("incline", par, 0.6), (0, 3), (q0, [1.0, 0.5]), method=TIGHT, threads=2, save="runs"
    )
    assert batch.success.all()
    for q, qdot, run, start in zip(batch.q, batch.qdot, batch.runs, q0, strict=True):
        one = zivi.simulate(model("incline", par, 0.6), (0, 3), (start, [1.0, 0.5]), TIGHT)
        assert np.array_equal(one.q[-1], q)
        assert np.array_equal(one.qdot[-1], qdot)
        assert np.array_equal(run.t, one.t)
    assert batch.n_zeno.tolist() == [1] * 5
    slopes = [model("incline", par | {"al": angle}, 0.6) for angle in (0.1, 0.2)]
    other = zivi.simulate_batch(
        slopes, (0, 3), ([0.0, 1.0], [1.0, 0.5]), method=TIGHT, save="events"
    )
    assert other.events[0]["zeno"]["t"][0] != other.events[1]["zeno"]["t"][0]
    pytest.importorskip("xarray")
    assert batch.to_xarray().q.sel(coordinate="y").shape == (5,)
    with pytest.raises(ValueError, match="save must be one of"):
        zivi.simulate_batch(slopes, (0, 3), ([0.0, 1.0], [1.0, 0.5]), method=TIGHT, save="all")
    with pytest.raises(ValueError, match="a row for each"):
        zivi.simulate_batch(slopes, (0, 3), (q0, [1.0, 0.5]), method=TIGHT)


# --- what goes wrong


def raises():
    raise ZeroDivisionError("of the user")


def test_walls_that_are_equal_at_the_start_and_move_apart_are_two():
    """The lower one carries at first, the upper one rises 5 cm above it and throws the box up."""
    rising = zivi.LinearGap([0, 1], motion=zivi.HarmonicWall(-0.025, 3.0), offset=-0.025)
    box = zivi.MechanicalSystem(mass=np.eye(2), force=[0, -9.81], gaps=[FLOOR, rising], e=0.0)
    sol = zivi.simulate(box, (0, 1), ([0.0, 0.0], [0.0, 0.0]))
    assert sol.success, sol.message
    assert sol.q[-1, 1] == pytest.approx(0.025 - 0.025 * math.cos(3.0), abs=1e-8)


def test_what_a_function_raises_keeps_the_run():
    def force(t, q, qdot):
        return raises() if t > 1 else [2.0, -9.81]

    with pytest.raises(ZeroDivisionError, match="of the user") as caught:
        zivi.simulate(box(force=force), (0, 3), ([0.0, 0.5], [0.5, 0.0]))
    partial = caught.value.trajectory
    assert partial.status is zivi.Status.RAISED
    assert 0.3 < partial.t[-1] <= 1.0


def bowl(**parts):
    given = {
        "value": lambda t, q: q[1] - q[0] ** 2 / 2,
        "gradient": lambda t, q: [-q[0], 1.0],
        "curvature": lambda t, q, qdot: -(qdot[0] ** 2),
        "name": "bowl",
    }
    return zivi.Gap(**given | parts)


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        ({"mass": [[1.0, 2.0], [2.0, 1.0]]}, "mass must be positive definite"),
        ({"mass": [[1.0, 0.5], [0.0, 1.0]]}, "mass must be symmetric"),
        ({"mass": lambda t, q: -np.eye(2)}, "mass must be positive definite"),
        ({"mass": np.eye(3)}, "for as many coordinates"),
        ({"mass": lambda t, q: np.eye(3)}, r"mass must have shape \(2, 2\)"),
        ({"force": lambda t, q, qdot: [1.0]}, r"force must have shape \(2,\)"),
        ({"force": [np.nan, 0]}, "force must be finite"),
        ({"e": 1.1}, r"e\[0\] must be in \[0, 1\]"),
        ({"e": [0.5]}, "e must be one number or one for each"),
        ({"gaps": [FLOOR, FLOOR]}, "'floor' twice"),
        ({"gaps": [FLOOR, zivi.LinearGap([0, 2], name="again")]}, "'again' is redundant"),
        ({"gaps": [zivi.LinearGap([0, -1], name="roof")], "e": 0.5}, "'roof' must be >= 0"),
        ({"gaps": [bowl(gradient=lambda t, q: [q[0], 1.0])]}, "gradient.* of gap 'bowl'"),
        (
            {"gaps": [bowl(curvature=lambda t, q, w: w[0] ** 2)], "e": 0.5},
            "curvature of gap 'bowl'",
        ),
        (
            {"gaps": [bowl(value=lambda t, q: q[1] - t - q[0] ** 2 / 2)], "e": 0.5},
            "'bowl' depends on time",
        ),
        ({"gaps": [bowl(gradient=[[1.0, 2.0]])], "e": 0.5}, "bowl"),
        ({"gaps": [bowl(gradient=lambda t, q: [1.0])]}, r"gradient of gap 'bowl' must have shape"),
        ({"gaps": [bowl(gradient=lambda t, q: [np.inf, 1.0])]}, "gradient of gap 'bowl' must be f"),
        ({"gaps": [bowl(value=lambda t, q: q)]}, r"value of gap 'bowl' must be one number, .*\(2,"),
        ({"gaps": [bowl(value=lambda t, q: np.nan)]}, "gap 'bowl' must be finite"),
        ({"gaps": [bowl(curvature=lambda t, q, w: w)]}, "curvature of gap 'bowl' must be one"),
        ({"gaps": [bowl(rate=lambda t, q: q)]}, "rate of gap 'bowl' must be one number"),
        ({"gaps": [bowl(rate=lambda t, q: np.nan)]}, "rate of gap 'bowl' must be finite"),
        (
            {"gaps": [bowl(gradient=lambda t, q: [0.0, 0.0], value=lambda t, q: 1.0)]},
            "gradient of gap 'bowl' must not be zero",
        ),
        ({"gaps": [FLOOR, bowl(), bowl(name="basin")]}, "'basin' is redundant: it is gap 'bowl'"),
        ({"mass": np.zeros((0, 0))}, r"mass must have shape \(n, n\) with n >= 1"),
        ({"mass": np.ones((2, 3))}, r"mass must have shape \(n, n\)"),
        ({"mass": lambda t, q: np.full((2, 2), np.nan)}, "mass must be finite at the start"),
        ({"gaps": [bowl(rate=0.3)], "e": 0.5}, "rate of gap 'bowl'"),
        ({"coordinates": ["x"]}, "coordinates must be 2 names"),
    ],
)
def test_bad_systems_are_named(changes, told):
    with pytest.raises(ValueError, match=told):
        zivi.simulate(box(**{"e": 0.5} | changes), (0, 1), ([0.1, 0.5], [0.5, 0.0]))


@pytest.mark.parametrize(
    ("changes", "status", "told"),
    [
        ({"mass": lambda t, q: np.diag([1 - t, 1])}, "MASS_NOT_DEFINITE", "mass matrix"),
        (
            {"mass": lambda t, q: [[1, 0.1 * (t > 1)], [0, 1]]},
            "MASS_NOT_DEFINITE",
            "not symmetric",
        ),
        ({"mass": lambda t, q: np.diag([np.nan if t > 1 else 1, 1])}, "FORCE_NOT_FINITE", "mass"),
        ({"force": lambda t, q, w: [0, np.nan if t > 1 else -9.81]}, "FORCE_NOT_FINITE", "force"),
    ],
)
def test_what_goes_wrong_later_is_a_status_and_keeps_the_run(changes, status, told):
    sol = zivi.simulate(box(**changes), (0, 3), ([0.0, 0.5], [0.1, 0.0]))
    assert sol.status.name == status
    assert told in sol.message
    assert sol.t[-1] == pytest.approx(1.0, abs=1e-3)
    assert len(sol.resolved_impacts) > 2
    assert sol(0.2)[0, 1] == pytest.approx(0.5 - 9.81 * 0.02, abs=1e-9)


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        ({"mass": "heavy"}, "mass must be an array, a function"),
        ({"gaps": 3}, "gaps must be a sequence"),
        ({"gaps": [lambda t, q: q[1]]}, r"gaps\[0\] must be a zivi.Gap"),
        ({"force": lambda t, q, w: ["a", "b"]}, "force must hold real numbers"),
        ({"gaps": [bowl(value=lambda t, q: "high")], "e": 0.5}, "value of gap 'bowl' must be one"),
    ],
)
def test_bad_types_are_named(changes, told):
    with pytest.raises(TypeError, match=told):
        zivi.simulate(box(**changes), (0, 1), ([0.1, 0.5], [0.5, 0.0]))


@pytest.mark.parametrize(
    ("y0", "error", "told"),
    [
        (([0.0, 0.5, 0.0], [0.5, 0.0]), ValueError, r"q0 must have shape \(2,\)"),
        (([0.0, 0.5], [0.5]), ValueError, r"qdot0 must have shape \(2,\)"),
        (([0.0, np.inf], [0.5, 0.0]), ValueError, "q0 must be finite"),
        (0.5, TypeError, r"y0 must be \(q0, qdot0\)"),
    ],
)
def test_bad_states_are_named(y0, error, told):
    with pytest.raises(error, match=told):
        zivi.simulate(box(), (0, 1), y0)


def test_methods_that_do_not_take_it_say_why():
    start = ([0.0, 0.5], [0.5, 0.0])
    with pytest.raises(ValueError, match="ExplicitEuler supports"):
        zivi.simulate(box(), (0, 1), start, zivi.ExplicitEuler(h=1e-3))
    with pytest.raises(ValueError, match="with its defaults"):
        zivi.simulate(box(), (0, 1), start, zivi.ThetaGamma(h=1e-3, theta=0.5))
    system, span, state = multi_case("wedge_acute")
    with pytest.raises(ValueError, match="coupled"):
        zivi.simulate(system, span, state, zivi.ThetaGamma(h=1e-3))


def test_the_implicit_scheme_comes_to_rest_between_orthogonal_gaps():
    errors = []
    for h in (4e-3, 1e-3):
        sol = zivi.simulate(box(), (0, 3), ([0.0, 0.5], [0.5, 0.0]), zivi.ThetaGamma(h=h))
        assert sol.success
        assert sol.contacts[-1].tolist() == [True, True]
        assert np.all(sol.qdot[-1] == 0)
        exact = zivi.simulate(box(), (0, 3), ([0.0, 0.5], [0.5, 0.0]), TIGHT)
        errors.append(np.abs(sol(0.3)[0] - exact(0.3)[0]).max())
    assert errors[1] < 0.4 * errors[0]


def test_bad_gaps_and_normals():
    with pytest.raises(ValueError, match="rate of gap 'bowl' must be one number"):
        bowl(rate=[0.0, 1.0])
    with pytest.raises(ValueError, match="normal of gap 'none' must be a vector"):
        zivi.LinearGap([0.0, 0.0], name="none")
    with pytest.raises(TypeError, match="motion must be"):
        zivi.LinearGap([1.0], motion=lambda t: 0.0)
    with pytest.raises(TypeError, match="value of gap 'w' must be a function"):
        zivi.Gap(1.0, [1.0], name="w")
    copy = pickle.loads(pickle.dumps(zivi.LinearGap([1, 0], 0.5, zivi.HarmonicWall(0.1, 2.0), "w")))
    assert copy._value(0.3, np.array([1.0, 0.0])) == pytest.approx(1.5 - 0.1 * math.cos(0.6))


def test_parameters_change_without_compiling():
    light = zivi.symbolic.system(
        "x", T="m*xdot**2/2", V="m*g*x", gaps={"floor": "x"}, parameters={"m": 1, "g": 9.81}
    )
    heavy = light.replace(m=3.0, g=1.62)
    assert light._native is heavy._native
    fall = zivi.simulate(heavy, (0, 1), ([2.0], [0.0]))
    assert fall.q[-1, 0] == pytest.approx(2.0 - 0.5 * 1.62, abs=1e-14)


# --- a second opinion


def test_moreau_jean_converges_to_the_switched_method(tmp_path):
    system, _, state = multi_case("wedge_acute")
    even = system.replace(e=0.5)
    exact = zivi.simulate(even, (0, 0.6), state, TIGHT)
    times = np.linspace(0.5, 0.6, 20)  # after some impacts
    errors = []
    for h in (4e-3, 1e-3, 2.5e-4):
        sol = zivi.simulate(even, (0, 0.6), state, zivi.MoreauJean(h=h), times)
        assert sol.success
        errors.append(np.sqrt(np.mean((sol.q - exact(times)[0]) ** 2)))
    slope = np.polyfit(np.log([4e-3, 1e-3, 2.5e-4]), np.log(errors), 1)[0]
    assert slope == pytest.approx(1.0, abs=0.35)
    stepped = zivi.simulate(even, (0, 0.6), state, zivi.MoreauJean(h=1e-3))
    assert stepped(0.1234).shape == (2, 2)
    pytest.importorskip("h5netcdf")
    zivi.files.save(stepped, tmp_path / "wedge.nc")
    back = zivi.files.load(tmp_path / "wedge.nc")
    assert np.array_equal(back(0.1234), stepped(0.1234))


def test_moreau_jean_warns_of_what_it_may_do_to_the_energy():
    system, _, state = multi_case("wedge_acute")  # coupled, e differ
    with pytest.warns(RuntimeWarning, match="may raise the energy"):
        zivi.simulate(system, (0, 0.1), state, zivi.MoreauJean(h=1e-2))
    # orthogonal gaps: no warning, which would be an error here
    zivi.simulate(box(), (0, 0.1), ([0.0, 0.5], [0.5, 0.0]), zivi.MoreauJean(h=1e-2))


def counted_ball(calls, *, rate=None, mass=1.0):
    """A ball above a floor whose functions count how often they are called."""

    def gap(t, q):
        calls.append(t)
        return q[0] - (0.1 * (t - 0.5) if t > 0.5 else 0.0)

    floor = zivi.Gap(gap, lambda t, q: [1.0], rate=rate)
    return zivi.MechanicalSystem(
        mass=lambda t, q: [[mass if q[0] < 2 else -mass]], force=[-9.81], gaps=[floor], e=0.5
    )


def test_derivatives_are_compared_with_differences_at_the_first_start_of_a_system():
    calls = []
    ball = counted_ball(calls)
    runs = []
    for height in (1.0, 1.0, 1.5):
        calls.clear()
        sol = zivi.simulate(ball, (0, 0.1), ([height], [0]))
        runs.append(len(calls) - sol.nfev)
    assert runs[0] > 20 > runs[1] + 10
    assert runs[1] == runs[2]


def moving_surface(rng, wrong=None):
    """A particle at a moving parabola, circle or plane in drawn units of length and time.

    One derivative is `wrong` by a drawn factor. Gives the system, the start and the span.
    """
    length, time = 10.0 ** rng.choice([0, 3, 6], size=2)
    omega, size = 10 ** rng.uniform(-1, 3) / time, 10 ** rng.uniform(-6, -1) * length
    bend, phase, t0 = (
        10 ** rng.uniform(-2, 2) / length,
        rng.uniform(0, 6),
        rng.choice([0, 3]) * time,
    )
    factor = rng.choice([0.0, 2.0, -1.0, 1.01])

    def of(part, value):
        return factor * value if part == wrong else value

    def wall(t):
        swing = size * np.exp(1j * (omega * t + phase))
        return swing.real, -omega * swing.imag, -(omega**2) * swing.real

    shape = rng.choice(["parabola", "circle", "plane"] if wrong != "gradient" else ["parabola"])
    high = 2 * size + 1e-3 * length
    if shape == "plane":
        if wrong is None and rng.random() < 0.5:
            motion = zivi.HarmonicWall(size, omega, phase)
        else:
            rate, pull = (lambda t: of("rate", wall(t)[1])), (lambda t: of("curvature", wall(t)[2]))
            motion = zivi.MovingWall(lambda t: wall(t)[0], rate, pull)
        gap, q = zivi.LinearGap([0.0, 1.0], motion=motion), np.array([0.0, high])
    elif shape == "parabola":
        gap = zivi.Gap(
            lambda t, q: q[1] - bend * q[0] ** 2 / 2 - wall(t)[0],
            lambda t, q: np.array([of("gradient", -bend * q[0]), 1.0]),
            lambda t, q, w: of("curvature", -bend * w[0] ** 2 - wall(t)[2]),
            lambda t, q: of("rate", -wall(t)[1]),
        )
        x = 10 ** rng.uniform(-3, 0) * length
        q = np.array([x, bend * x * x / 2 + high])
    else:
        gap = zivi.Gap(
            lambda t, q: math.hypot(*q) - 1 / bend - wall(t)[0],
            lambda t, q: q / math.hypot(*q),
            lambda t, q, w: of(
                "curvature", (q[0] * w[1] - q[1] * w[0]) ** 2 / math.hypot(*q) ** 3 - wall(t)[2]
            ),
            lambda t, q: of("rate", -wall(t)[1]),
        )
        q = np.array([0.6, 0.8]) * (1 / bend + high)
    mass = 10 ** rng.uniform(-3, 3)
    system = zivi.MechanicalSystem(mass=mass * np.eye(2), force=[0.0, 0.0], gaps=[gap], e=0.5)
    return system, q, (t0, t0 + 1e-3 * time)


def test_right_derivatives_are_accepted_in_all_units_and_wrong_ones_refused():
    rng = np.random.default_rng(1)
    for _ in range(60):
        system, q, span = moving_surface(rng)
        check_start(system, system.model(2), span, q, np.zeros(2))
    for part in ["gradient", "curvature", "rate"] * 15:
        system, q, span = moving_surface(rng, part)
        with pytest.raises(ValueError, match="is not the derivative of the gap at the start"):
            check_start(system, system.model(2), span, q, np.zeros(2))


def test_a_wall_of_ours_that_vibrates_fast_is_simulated():
    wall = zivi.LinearGap([1.0], motion=zivi.HarmonicWall(1e-6, 1e5, 0.3))
    ball = zivi.MechanicalSystem(mass=1.0, force=[-9.81], gaps=[wall], e=0.5)
    assert zivi.simulate(ball, (0, 1e-3), ([1e-5], [0.0])).success
    slow = zivi.Gap(
        lambda t, q: q[0] - 1e-6 * math.cos(1e5 * t),
        [1.0],
        rate=lambda t, q: 0.1 * math.sin(1e5 * t),
    )
    ball = zivi.MechanicalSystem(mass=1.0, force=[-9.81], gaps=[slow], e=0.5)
    with pytest.raises(
        ValueError, match=r"curvature of gap 'gap0' \(differenced: give it\) is not"
    ):
        zivi.simulate(ball, (0, 1e-3), ([1e-5], [0.0]))


def test_every_start_has_its_mass_and_every_span_its_rates_checked():
    ball = counted_ball([])
    assert zivi.simulate(ball, (0, 0.1), ([1.0], [0])).success
    with pytest.raises(ValueError, match="mass must be positive definite"):
        zivi.simulate(ball, (0, 0.1), ([3.0], [0]))
    with pytest.raises(ValueError, match="gap 'gap0' must be >= 0"):
        zivi.simulate(ball, (0, 0.1), ([-1.0], [0]))
    with pytest.raises(ValueError, match="gap 'gap0' depends on time: give its rate"):
        zivi.simulate(ball, (0, 1.0), ([1.0], [0]))


@pytest.mark.parametrize(
    ("name", "given"),
    [
        ("mass", {"mass": np.broadcast_to(1.0, (10**6, 10**6))}),
        ("mass", {"mass": np.eye(257).tolist()}),
        ("force", {"mass": lambda t, q: np.eye(2), "force": np.zeros(257)}),
        (
            "gradient of gap 'gap0'",
            {
                "mass": lambda t, q: q,
                "gaps": [zivi.LinearGap(np.ones(257))],
                "force": lambda t, q, w: q,
            },
        ),
    ],
)
def test_too_many_coordinates_are_refused_at_once(name, given):
    told = f"{name} must be for at most 256 coordinates, got shape"
    with pytest.raises(ValueError, match=told):
        zivi.MechanicalSystem(**{"force": [0.0]} | given)


def concurrent_calls(threads, *, awaited=1, **more):
    """How many threads are in a compiled force at once, at most, in a batch: the first waits."""
    doubles, lock = ctypes.POINTER(ctypes.c_double), threading.Lock()
    inside, most = 0, 0

    @ctypes.CFUNCTYPE(None, ctypes.c_double, doubles, doubles, doubles)
    def force(t, q, w, out):
        nonlocal inside, most
        with lock:
            inside += 1
            most = max(most, inside)
        # the start is looked at by one thread, before all runs
        if t > 0.0:
            wait_for(lambda: most >= awaited)
        out[0] = -9.81
        with lock:
            inside -= 1

    system = zivi.MechanicalSystem(mass=1.0, force=force, gaps=[zivi.LinearGap([1])], **more)
    batch = zivi.simulate_batch(system, (0, 0.1), (np.ones((4, 1)), [0.0]), threads=threads)
    assert batch.q[:, 0] == pytest.approx(1 - 9.81 * 0.1**2 / 2, abs=1e-12)
    return most


def test_parts_that_are_not_reentrant_are_called_by_one_thread():
    assert concurrent_calls(4, awaited=2) > 1
    assert concurrent_calls(4, reentrant=False) == 1
    system = zivi.MechanicalSystem(mass=1.0, force=[0.0], reentrant=False)
    assert "reentrant=False" in repr(system)
    assert not pickle.loads(pickle.dumps(system)).reentrant
    with pytest.raises(TypeError, match="reentrant must be True or False"):
        zivi.MechanicalSystem(mass=1.0, force=[0.0], reentrant=1)
