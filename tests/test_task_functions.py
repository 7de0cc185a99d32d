"""Functions of the coordinates that follow a reference beside the gaps: the law written anew."""

import pickle

import numpy as np
import pytest
import sympy

import zivi
import zivi.mechanics
from mechanical_arms import START, angles, tracker, two_links
from random_arms import chain

X = "l1*cos(a) + l2*cos(a + b)"


def swinging(t):
    """A place along the table with its derivatives."""
    return 0.35 + 0.15 * np.sin(4 * t), 0.6 * np.cos(4 * t), -2.4 * np.sin(4 * t)


def tip(run):
    return 0.5 * np.cos(run.q[:, 0]) + 0.45 * np.cos(run.q.sum(axis=1))


def follow_tip(controller, floor="rest", **asked):
    start = (angles(0.35, -0.05), [0, 0])
    reference = {"floor": floor, "x": swinging} | asked
    return zivi.simulate_closed_loop(
        two_links(), controller, (0, 1.5), start, reference=reference, method=zivi.RKPeriod()
    )


def test_a_tip_is_led_along_a_table_that_it_falls_on_and_presses():
    run = follow_tip(tracker(tasks={"x": X}))
    late = run.t > 1.0
    assert run.contacts[late].all()
    # what is held over a period: h^2/2 of the jerk, against kp
    np.testing.assert_allclose(tip(run)[late], swinging(run.t[late])[0], atol=2e-5)
    np.testing.assert_allclose(run.reactions[late], 10.0, rtol=2e-3)


def test_a_gap_follows_a_run_of_its_own_while_the_tip_is_led():
    drop = zivi.simulate(zivi.ImpactSystem(-9.81, e=0.6), (0, 1.6), (0.25, 0))
    run = follow_tip(tracker(tasks={"x": X}), floor=drop)
    bouncing = (run.t > 0.4) & (run.t < 0.85)
    assert np.sqrt(np.mean(run.error_gaps[bouncing] ** 2)) < 5e-5
    late = run.t > 1.3
    np.testing.assert_allclose(tip(run)[late], swinging(run.t[late])[0], atol=1e-4)


def by_hand(system, functions, goals, asked, state):
    """The controls of the law, with all matrices written out."""
    (q, qdot), (a, wanted), (kp, kd) = state, asked, (400.0, 40.0)
    split = zivi.mechanics.gap_coordinates(system, q, qdot)
    here = system.at(0.0, q, qdot)
    symbols = sympy.symbols(system.coordinate_names(len(q)))
    at = dict(zip(symbols, q, strict=True))
    J = np.array([[float(f.diff(s).subs(at)) for s in symbols] for f in functions])
    hessians = [np.array(sympy.hessian(f, symbols).subs(at), float) for f in functions]
    drift = np.array([qdot @ it @ qdot for it in hessians])
    y = np.array([float(f.subs(at)) for f in functions])
    to_gaps = np.linalg.solve(here.mass, split.N.T) @ np.linalg.inv(split.D)
    JT = J @ split.T
    along = JT @ split.Z @ qdot
    right = goals[2] - drift + J @ to_gaps @ here.curvatures
    right = right - kp * (y - goals[0]) - kd * (along - goals[1])
    # least squares, then as little kinetic energy as possible away from what the posture wants
    root = np.linalg.cholesky(split.T.T @ here.mass @ split.T).T
    b0 = split.Z @ wanted
    b = b0 + np.linalg.solve(root, np.linalg.pinv(JT @ np.linalg.inv(root)) @ (right - JT @ b0))
    force = here.mass @ (to_gaps @ (a - here.curvatures) + split.T @ b) - here.force
    return np.linalg.solve(system.control_inputs(q).at(q), force)


@pytest.mark.parametrize(("n", "count"), [(2, 1), (3, 1), (3, 2), (3, 3), (4, 2)])
def test_controls_are_those_of_the_law_written_out(n, count):
    source = np.random.default_rng(n * 10 + count)
    system = chain(n, 1).replace(a0=0.2, b0=1.0, d0=0.7)
    turns = np.cumsum(sympy.symbols(system.coordinate_names(n)))
    functions = [
        0.4 * sum(sympy.cos(it) for it in turns),
        sum(turns) / 2 + turns[0] ** 2,
        0.3 * sympy.sin(turns[-1]),
    ][:count]
    formulas = {f"y{i}": sympy.sstr(it) for i, it in enumerate(functions)}
    gains = {"plane0": (40, 22)}
    ctl = zivi.GapTracker(system, h=1e-3, gains=gains, tasks=formulas)
    q, qdot = source.uniform(0.2, 0.9, n), source.uniform(-1, 1, n)
    goals, posture = source.uniform(-1, 1, (3, count)), source.uniform(-1, 1, (3, n))
    now = zivi.ReferenceSample(
        posture[0], posture[1], np.ones(1), np.ones(1, bool), qddot=posture[2], tasks=goals
    )
    u = ctl.step_to(0.0, q, qdot, now, now)
    wanted = posture[2] - 400.0 * (q - posture[0]) - 40.0 * (qdot - posture[1])
    expected = by_hand(system, functions, goals, (ctl.accelerations, wanted), (q, qdot))
    np.testing.assert_allclose(u, expected, rtol=1e-8, atol=1e-8)
    free = ctl.step_to(1e-3, q, qdot, now._replace(tasks=None), now)
    assert not np.allclose(free, u)  # the posture alone


def test_functions_of_systems_without_formulas_are_gaps():
    floor = zivi.LinearGap([0, 0, 1], name="floor")
    box = zivi.MechanicalSystem(mass=np.eye(3), force=[0, 0, -9.81], gaps=[floor], e=0.5)
    ring = zivi.Gap(
        lambda t, q: q[0] ** 2 + q[1] ** 2,
        lambda t, q: np.array([2 * q[0], 2 * q[1], 0.0]),
        lambda t, q, w: 2 * (w[0] ** 2 + w[1] ** 2),
    )
    ctl = zivi.GapTracker(box, h=1e-3, gains={"floor": (30, 17)}, tasks={"ring": ring})
    assert ctl.tasks == ("ring",)
    reference = {"floor": "rest", "ring": lambda t: 1.0 + 0.1 * np.sin(t)}
    start = ([0.8, 0.3, 0.2], [0, 0, 0])
    run = zivi.simulate_closed_loop(box, ctl, (0, 3), start, reference=reference)
    radius = run.q[:, 0] ** 2 + run.q[:, 1] ** 2
    # derivatives that are not given are 0: it lags by kd/kp ydot
    assert abs(radius[-1] - 1.0 - 0.1 * np.sin(3)) < 0.011
    other = zivi.simulate_closed_loop(
        box,
        pickle.loads(pickle.dumps(zivi.GapTracker(box, h=1e-3, gains={"floor": (30, 17)}))),
        (0, 3),
        start,
        reference={"floor": "rest"},
    )
    assert abs(other.q[-1, 0] - 0.8) < 1e-9  # without: the posture alone
    wrong = zivi.Gap(lambda t, q: q[0] ** 2, lambda t, q: np.array([q[0], 0.0, 0.0]))
    bad = zivi.GapTracker(box, h=1e-3, gains={"floor": (30, 17)}, tasks={"ring": wrong})
    with pytest.raises(ValueError, match="gradient"):
        zivi.simulate_closed_loop(box, bad, (0, 3), start, reference=reference)


def test_formulas_follow_the_parameters_of_the_system_and_travel():
    arm = two_links().replace(l2=0.4)
    ctl = tracker(system=arm, tasks={"x": X})
    arm.parameters["l2"] = 0.45
    same = tracker(tasks={"x": X})
    one = follow_tip(ctl)
    assert np.array_equal(one.u, follow_tip(same).u)
    assert np.array_equal(one.u, follow_tip(pickle.loads(pickle.dumps(same))).u)
    # called tick by tick: as in a loop without the interpreter
    called = type("Called", (), {"h": 1e-3, "step_to": same.step_to, "tasks": same.tasks})()
    called.step = same.step
    assert np.array_equal(one.u, follow_tip(called).u)


def test_dynamic_symbols_are_formulas_too():
    a, b = sympy.symbols("a b", cls=sympy.Function)
    t = sympy.Symbol("t")
    formula = 0.5 * sympy.cos(a(t)) + 0.45 * sympy.cos(a(t) + b(t))
    one, other = (follow_tip(tracker(tasks={"x": it})) for it in (formula, X))
    np.testing.assert_allclose(one.u, other.u, rtol=1e-6, atol=1e-6)


@pytest.mark.parametrize(
    ("tasks", "reference", "kind", "message"),
    [
        ({"floor": X}, {}, ValueError, "other than"),
        ({"posture": X}, {}, ValueError, "other than"),
        ({"x": 3.0, "z": zivi.LinearGap([1, 0])}, {}, TypeError, "formulas"),
        ({"x": X}, {"z": 1.0}, ValueError, "unknown entry"),
        ({"x": X, "z": "a"}, {"x": 1.0}, ValueError, "task 'z'"),
        ({"x": X}, {"x": np.nan}, ValueError, "finite"),
        ({"x": X}, {"x": [1, 2, 3, 4]}, ValueError, "derivatives"),
        ({"x": "l3*cos(a)"}, {"x": 0.0}, ValueError, "l3"),
    ],
)
def test_what_is_no_task_is_named(tasks, reference, kind, message):
    with pytest.raises(kind, match=message):
        zivi.simulate_closed_loop(
            two_links(),
            tracker(tasks=tasks),
            (0, 0.01),
            (angles(0.35, -0.05), [0, 0]),
            reference={"floor": "rest"} | reference,
        )


@pytest.mark.parametrize("turned", [0.02, 0.3])
def test_coupling_is_looked_at_where_the_functions_lead(turned):
    """Where the reference is, and so how the gaps are coupled, follows from gaps and functions."""
    system = zivi.symbolic.system(
        "x y r",
        T="xdot**2/2 + ydot**2/2 + rdot**2/2 + sin(r)*xdot*ydot",
        V="9.81*x + 6*y",
        gaps={"floor": "x", "wall": "y"},
        e=0.5,
    )
    falls = [
        zivi.simulate(zivi.ImpactSystem(-pull, e=0.5), (0, 0.5), (0.1, 0)) for pull in (9.81, 6.0)
    ]
    gains = {"floor": (40, 22), "wall": (40, 22)}
    ctl = zivi.GapTracker(system, h=1e-3, gains=gains, tasks={"turn": "2*r + x"})
    reference = dict(zip(gains, falls, strict=True))
    reference["turn"] = lambda t: (4.0 * turned * t, 4.0 * turned)
    start = ([0.1, 0.1, -0.05], [0, 0, 0])

    def run():
        return zivi.simulate_closed_loop(system, ctl, (0, 0.5), start, reference=reference)

    if turned > 0.05:
        with pytest.raises(ValueError, match=r"c = 0\.29.*reference_run"):
            run()
    else:
        assert np.abs(run().error_gaps).max() < 2e-2


def test_gaps_that_no_configuration_has_at_once_are_refused():
    gaps = [zivi.LinearGap([1, 0], name="left")]
    gaps += [
        zivi.Gap(
            lambda t, q: 1.0 + 0.1 * np.tanh(q[1]),
            lambda t, q: np.array([0.0, 0.1 / np.cosh(q[1]) ** 2]),
            name="right",
        )
    ]
    system = zivi.MechanicalSystem(mass=np.eye(2), force=[0, 0], gaps=gaps, e=0.5)
    drop = zivi.simulate(zivi.ImpactSystem(-9.81, e=0.5), (0, 1), (0.3, 0))
    ctl = zivi.GapTracker(system, h=1e-3, gains={"left": (30, 17), "right": (30, 17)})
    with pytest.raises(ValueError, match=r"at t = 0 is out of reach.*'right' = 0.3"):
        zivi.simulate_closed_loop(
            system, ctl, (0, 1), ([1, 1], [0, 0]), reference={"left": drop, "right": drop}
        )


@pytest.mark.parametrize(
    ("reference", "words"),
    [
        ({"floor": "rest", "x": 2.0}, r"at t = 0 .*'x' = 2 \("),
        ({"floor": "rest", "x": lambda t: 0.6 + 0.6 * t}, r"at t = 0.55 .*'x' = 0.93 \("),
        # the tip is 1.25 m above the floor at most
        ({"floor": 3.0}, r"at t = 0 .*'floor' = 3 \(1\.7\d from the nearest found, 1\.2"),
    ],
    ids=["place", "motion", "gap"],
)
def test_what_no_configuration_reaches_is_told_before_the_run(reference, words, monkeypatch):
    if reference["floor"] == 3.0:
        drop = zivi.simulate(zivi.ImpactSystem(-9.81, e=0.6), (0, 1.1), (3.0, 0))
        reference, tasks = {"floor": drop}, {}
    else:
        tasks = {"x": X}
    monkeypatch.setattr(zivi._zivi, "simulate_mechanical_loop", None)  # nothing runs
    with pytest.raises(ValueError, match=words):
        zivi.simulate_closed_loop(
            two_links(),
            tracker(tasks=tasks),
            (0, 1),
            (START, [0, 0]),
            reference=reference,
            method=zivi.RKPeriod(),
        )


def test_what_is_just_in_reach_runs():
    # links of 0.5 and 0.45 m, 0.3 m above the floor: the tip on the floor is 0.9014 m off at most
    run = zivi.simulate_closed_loop(
        two_links(),
        tracker(tasks={"x": X}),
        (0, 0.3),
        (START, [0, 0]),
        reference={"floor": "rest", "x": 0.9},
    )
    assert run.status == zivi.Status.COMPLETED
