"""Names that users of SciPy, python-control, MuJoCo and MATLAB try: each is answered by a hint."""

import inspect
import json
import operator
import pickle
import re
import warnings

import numpy as np
import pytest

import zivi
import zivi.plot
from inside import ARGUMENTS, ATTRIBUTES, CALLS as RIGHT, MODULE, MODULE_CALLS, PLOT

BALL = zivi.ImpactSystem(-9.81, e=0.5)
FLOOR = zivi.LinearGap([1.0])
MASS = zivi.MechanicalSystem(mass=np.eye(1), force=[-9.81], gaps=[FLOOR], e=0.5)
SPAN, START = (0, 0.1), (1, 0)

CALLS = {
    "ImpactSystem": (zivi.ImpactSystem, (-9.81,)),
    "LinearForce": (zivi.LinearForce, ()),
    "HarmonicWall": (zivi.HarmonicWall, (0.01,)),
    "MechanicalSystem": (zivi.MechanicalSystem, ()),
    "LinearGap": (zivi.LinearGap, ()),
    "method": (zivi.SwitchedRK, ()),
    "simulate": (zivi.simulate, (BALL, SPAN, START)),
    "simulate_closed_loop": (zivi.simulate_closed_loop, (BALL, None, SPAN, START)),
    "simulate_batch": (zivi.simulate_batch, (BALL, SPAN, [START])),
    "controller": (zivi.TwistingTracker, (30, 17)),
    "solve_vi": (zivi.solve_vi, (lambda x: x,)),
    "sensitivity": (zivi.sensitivity, (BALL, SPAN, START)),
    "periodic_orbit": (zivi.periodic_orbit, (BALL,)),
    "continue_orbit": (zivi.continue_orbit, (None, "amplitude", (0, 1))),
    "sweep": (zivi.sweep, (len, {"x": [1]})),
    "at": (MASS.at, (0.0, [1.0], [0.0])),
    "sample": (zivi.sample, ("sobol", 2, {"x": (0, 1)})),
    "Gap": (zivi.Gap, (len,)),
    "Contact": (zivi.mechanics.Contact, ("ball", "floor")),
    "DryFriction": (zivi.DryFriction, ()),
    "LinearSystem": (zivi.LinearSystem, ([[1.0]], [[0.0]], [[1.0]])),
    "Harmonic": (zivi.Harmonic, ([1.0], 2.0)),
    "Table": (zivi.Table, ([0, 1], [0, 1])),
    "Level": (zivi.Level, ()),
    "event": (zivi.event, ()),
    "symbolic": (zivi.symbolic.system, ("a",)),
    "design": (zivi.design_tracker, (1.0,)),
    "observer": (zivi.ImpactObserver, (0.5, 1e-3)),
    "animate": (zivi.plot.animate, ()),
    "settled": (zivi.bifurcation_diagram, (BALL, "amplitude", [1.0])),
}
ALIKE = {
    "method": [zivi.ThetaGamma, zivi.MoreauJean, zivi.ExplicitEuler],
    "controller": [zivi.TwistingRegulator, zivi.ExplicitTwisting],
    "solve_vi": [zivi.solve_avi, zivi.solve_ncp, zivi.solve_lcp],
    "simulate_batch": [zivi.simulate_closed_loop_batch],
    "design": [zivi.design_regulator],
    "settled": [zivi.basins, zivi.lyapunov_exponents],
}
RESULTS = {
    "run": zivi.simulate(BALL, SPAN, START),
    "mechanical run": zivi.simulate(MASS, SPAN, ([1.0], [0.0])),
    "loop": zivi.simulate_closed_loop(
        BALL, zivi.TwistingTracker(30, 17, h=1e-2, e=0.5), SPAN, START
    ),
    "VI result": zivi.solve_lcp([[1.0]], [-1.0]),
    "controller": zivi.TwistingTracker(30, 17, h=1e-2, e=0.5),
    "system": BALL,
    "mechanism": MASS,
    "sensitivity": zivi.sensitivity(BALL, SPAN, START),
}


def test_there_are_sixty_and_more():
    of_calls = sum(map(len, ARGUMENTS.values()))
    assert of_calls + sum(map(len, ATTRIBUTES.values())) + len(MODULE) + len(PLOT) >= 300
    assert set(CALLS) == set(ARGUMENTS)
    assert {*RESULTS, "impacts"} == set(ATTRIBUTES)
    assert set(ARGUMENTS) <= set(RIGHT)


@pytest.mark.parametrize("owner", CALLS)
def test_arguments_of_others_are_answered(owner):
    function, args = CALLS[owner]
    for name, hint in ARGUMENTS[owner].items():
        if name == "*":
            continue
        for called in (function, *ALIKE.get(owner, [])):
            if name in inspect.signature(called).parameters:
                assert called is not function or owner == "method"
                continue
            with pytest.raises(TypeError, match=rf"'{name}': ") as told:
                called(*(args if called is function else ()), **{name: 1.0})
            if called is function:
                assert hint in str(told.value) or "it belongs" in str(told.value)


@pytest.mark.parametrize("kind", RESULTS)
def test_attributes_of_others_are_answered(kind):
    result = RESULTS[kind]
    for name, hint in ATTRIBUTES[kind].items():
        with pytest.raises(AttributeError) as told:
            getattr(result, name)
        assert str(told.value).endswith(hint), name
        assert not hasattr(result, name)
    with pytest.raises(AttributeError, match=r"has no attribute 'nothing'$"):
        result.nothing  # noqa: B018
    if hasattr(result, "status"):
        assert pickle.loads(pickle.dumps(result)).status == result.status


def test_an_argument_that_is_needed_is_named_as_it_was_given():
    with pytest.raises(TypeError, match="unexpected keyword argument 'tspan': it is t_span"):
        zivi.simulate(BALL, tspan=SPAN, y0=START)


def test_functions_of_others_are_answered():
    for name, hint in MODULE.items():
        with pytest.raises(AttributeError) as told:
            getattr(zivi, name)
        assert str(told.value) == f"module 'zivi' has no attribute {name!r}: {hint}"


def test_plots_of_others_are_answered():
    for name, hint in PLOT.items():
        with pytest.raises(AttributeError) as told:
            getattr(zivi.plot, name)
        assert str(told.value) == f"module 'zivi.plot' has no attribute {name!r}: {hint}"
    with pytest.raises(AttributeError, match=r"has no attribute 'nothing'$"):
        zivi.plot.nothing  # noqa: B018


@pytest.mark.parametrize(
    ("kind", "states", "hint"),
    [
        ("run", "x, sol.xdot", "y"),
        ("mechanical run", "q, sol.qdot", "x"),
        ("loop", "x, sol.xdot", "e"),
    ],
)
def test_items_and_unpacking_are_answered(kind, states, hint):
    sol = RESULTS[kind]
    with pytest.raises(TypeError, match=r"is not indexable: it is sol\.t$"):
        sol["t"]
    with pytest.raises(TypeError, match=re.escape(ATTRIBUTES[kind][hint])):
        sol[hint]
    with pytest.raises(TypeError, match=r"is not indexable$"):
        sol["nothing"]
    with pytest.raises(TypeError, match=r"sol\.t\[i\]"):
        sol[0]
    with pytest.raises(TypeError, match=re.escape(f"its arrays are sol.t, sol.{states}")):
        _t, _x = sol
    assert not np.iterable(sol)


@pytest.mark.parametrize(
    "status",
    [*zivi.Status, *zivi.StudyStatus, *zivi.VIStatus, *zivi.OrbitStatus],
    ids=lambda it: f"{type(it).__name__}.{it.name}",
)
def test_statuses_are_written_by_their_names_and_are_numbers(status):
    number = status.value
    assert f"{status}" == str(status) == "%s" % status == status.name  # noqa: UP031
    assert f"{status:>30}" == status.name.rjust(30)
    assert f"{status:3d}" == f"{number:3d}"
    assert f"{status:d}" == "%d" % status == json.dumps(status) == str(int(status))  # noqa: UP031
    assert status == number == np.uint8(status)
    assert pickle.loads(pickle.dumps(status)) is status
    assert np.asarray([status]).dtype == np.asarray([number]).dtype


def test_hints_name_what_exists():
    texts = [*MODULE.values(), *PLOT.values(), *MODULE_CALLS.values(), *RIGHT.values()]
    texts += [it for hints in (*ARGUMENTS.values(), *ATTRIBUTES.values()) for it in hints.values()]
    for text in texts:
        for name in re.findall(r"zivi\.((?:plot\.)?\w+)", text):
            assert operator.attrgetter(name)(zivi), text
    for owner, hints in ARGUMENTS.items():
        known = set(inspect.signature(CALLS[owner][0]).parameters)
        known |= {"rtol", "atol", "max_step", "h", "offset"} if owner == "method" else set()
        for text in hints.values():
            for name in re.findall(r"^(?:it is|they are) (\w+)(?=$|,| \()", text):
                assert name in known, (owner, text)
    fields = set(RESULTS["run"].impacts.dtype.names)
    for text in ATTRIBUTES["impacts"].values():
        assert set(re.findall(r"'(\w+)'", text)) <= fields
    for kind, hints in ATTRIBUTES.items():
        for text in hints.values() if kind in RESULTS else ():
            for name in re.findall(r"^(?:it is|they are|it is|.* (?:is|are)) (\w+)$", text):
                assert hasattr(RESULTS[kind], name), (kind, text)


MISTAKES = r"""
zivi.ImpactSystem(-9.81, 0.5) | write e=0.5, as in zivi.ImpactSystem(-9.81, e=0.5)
zivi.ImpactSystem(0.5) | exactly one of e and kappa must be given
zivi.ImpactSystem(e=0.5) | write zivi.ImpactSystem(-9.81, e=0.5)
zivi.ImpactSystem(lambda x, xdot: x[0], e=0.5) | time is its first argument
zivi.ImpactSystem(lambda x, v, t: -x, e=0.5) | time is its first argument
zivi.ImpactSystem(lambda y, t: -y[0], e=0.5) | time is its first argument
zivi.ImpactSystem(lambda x: -x, e=0.5) | force must be a function of (t, x, xdot), or of (t, y)
zivi.ImpactSystem("-9.81", e=0.5) | force must be a number, a zivi.LinearForce, a callable
zivi.ImpactSystem(-9.81, E=0.5) | did you mean 'e'?
zivi.ImpactSystem(-9.81, restitution=0.5) | the coefficient of restitution is e
zivi.LinearForce(4.0, 0.1) | write stiffness=4.0, damping=0.1, as in
zivi.LinearForce(Stiffness=4.0) | did you mean 'stiffness'?
zivi.HarmonicWall() | write zivi.HarmonicWall(amplitude=0.1, omega=10.0)
zivi.HarmonicWall(0.1) | missing 1 required positional argument: 'omega': write
zivi.HarmonicWall(0.1, freq=3) | 2 pi times the frequency
zivi.MechanicalSystem(np.eye(1), [-9.81]) | force=[-9.81], as in zivi.MechanicalSystem(mass=M
zivi.MechanicalSystem(mass=1.0, force=lambda q, qdot: -q) | force must be a function of (t, q, qdot)
zivi.MechanicalSystem(mass=1.0, force=lambda q, qdot, t: -q) | time is its first argument
zivi.MechanicalSystem(mass=lambda q, t: np.eye(1), force=[0.0]) | time is its first argument
zivi.MechanicalSystem(mass=1.0) | write zivi.MechanicalSystem(mass=M, force=F
zivi.MechanicalSystem(mass=1.0, force=[0.0], gaps=[[1.0]]) | gaps[0] must be a zivi.Gap or
zivi.LinearSystem([[1.0]]) | write zivi.LinearSystem(M, C, K
zivi.Gap(lambda q: q[0]) | write zivi.Gap(g, gradient)
zivi.Gap(lambda q, t: q[0], lambda q, t: [1.0]) | time is its first argument
zivi.LinearGap() | write zivi.LinearGap([0.0, 1.0])
zivi.DryFriction(mu=0.3) | mu belongs to zivi.LinearGap
zivi.Table([0, 1]) | values must be given, unless times is a pandas.Series
zivi.SwitchedRK(tol=1e-6) | tolerances are rtol and atol
zivi.SwitchedRK(Rtol=1e-6) | did you mean 'rtol'?
zivi.ThetaGamma() | write zivi.ThetaGamma(h=1e-3)
zivi.MoreauJean(dt=1e-3) | the step of a method of fixed steps is h
zivi.simulate(BALL) | write zivi.simulate(system, (0, 1), (x0, xdot0))
zivi.simulate(BALL, 10, START) | t_span must be two numbers (t0, t1), got 10
zivi.simulate(BALL, SPAN, 1.0) | y0 must be two numbers (x0, xdot0), got 1.0
zivi.simulate(-9.81, SPAN, START) | the force makes a system with a wall
zivi.simulate(SPAN, START, BALL) | the system is the first argument, the span the second
zivi.simulate(BALL, SPAN, START, "SwitchedRK") | the object is meant, zivi.SwitchedRK()
zivi.simulate(BALL, SPAN, START, zivi.ThetaGamma) | call it, zivi.ThetaGamma(h=1e-3)
zivi.simulate(BALL, SPAN, START, rtol=1e-9) | zivi.SwitchedRK(rtol=1e-09)
zivi.simulate(BALL, SPAN, START, t_eval=100) | write t_eval=numpy.linspace(t0, t1, n)
zivi.simulate(BALL, SPAN, START, events=[3]) | events[0] must be a function g(t, x, xdot)
zivi.simulate(BALL, SPAN, START, events=lambda x, v: x) | time is its first argument
zivi.simulate(MASS, SPAN, [1.0]) | y0 must be (q0, qdot0)
zivi.simulate_batch(BALL, SPAN) | write zivi.simulate_batch(system, (0, 1), [(x0, xdot0), ...])
zivi.simulate_closed_loop(BALL, SPAN, START) | write zivi.simulate_closed_loop(system, controller
zivi.TwistingTracker() | write zivi.TwistingTracker(mu1, mu2, h=1e-3, e=0.5)
zivi.TwistingTracker(30, 17, 1e-3, e=0.5) | write h=0.001, as in zivi.TwistingTracker
zivi.TwistingRegulator(30) | write zivi.TwistingRegulator(mu1, mu2
zivi.design_tracker() | write zivi.design_tracker(1.0, start=(x0, xdot0))
zivi.ImpactObserver() | write zivi.ImpactObserver(e, h)
zivi.solve_vi() | write zivi.solve_vi(F, lower, upper, x0)
zivi.solve_lcp([[1.0]]) | write zivi.solve_lcp(M, q)
zivi.solve_ncp(len) | write zivi.solve_ncp(F, x0)
zivi.solve_avi([[1.0]]) | write zivi.solve_avi(M, q, lower, upper)
zivi.sensitivity(BALL) | write zivi.sensitivity(system, (0, 1), (x0, xdot0)
zivi.sensitivity(BALL, SPAN, START, ("gravity",)) | the one parameter force: zivi.LinearForce
zivi.sensitivity(BALL, SPAN, START, ("x_0",)) | did you mean 'x0'?
zivi.sensitivity(MASS, SPAN, ([1.0], [0.0]), ("qdot_0",)) | did you mean 'qdot0'?
zivi.sensitivity(MASS, SPAN, ([1.0], [0.0]), ("m",)) | this system does not have named parameters
zivi.periodic_orbit(BALL) | write zivi.periodic_orbit(system, (0, (x0, xdot0)))
zivi.continue_orbit(BALL) | write zivi.continue_orbit(orbit, "amplitude", (1.0, 1.8))
zivi.bifurcation_diagram(BALL) | write zivi.bifurcation_diagram(system, "amplitude", values)
zivi.basins(BALL) | write zivi.basins(system, x0s, v0s)
zivi.lyapunov_exponents(BALL) | write zivi.lyapunov_exponents(system, t_span, y0)
zivi.sweep(len, e=[0.1, 0.2]) | one dictionary, the second argument: {'e': [...]}
zivi.sweep(len) | write zivi.sweep(function, {'e': [0.1, 0.2]})
zivi.sweep(len, {"e": [0.1]}, n_jobs=2) | it is workers, with executor='processes'
zivi.sample(e=(0, 1)) | one dictionary, the third argument: {'e': (low, high)}
zivi.sample("sobol", 2) | write zivi.sample('sobol', 64, {'e': (0.1, 0.9)})
zivi.event(lambda t, x, xdot: x) | write @zivi.event(terminal=True) above the function
zivi.symbolic.system() | write zivi.symbolic.system("a", T=
zivi.export_fmu(BALL) | out must be a path, got ImpactSystem; write zivi.export_fmu(folder, model)
zivi.plot(SOL) | it is zivi.plot.overview(sol), or sol.plot()
zivi.symbolic("a") | it is zivi.symbolic.system
zivi.files(SOL) | it is zivi.files.save(sol, path)
zivi.batch(BALL) | it is zivi.simulate_batch
zivi.control(BALL) | it is zivi.simulate_closed_loop
zivi.Simulate | did you mean 'simulate'?
zivi.impact_system | did you mean 'ImpactSystem'?
zivi.MechanicalSytem | did you mean 'MechanicalSystem'?
zivi.simulateBatch | did you mean 'simulate_batch'?
zivi.Thetagamma | did you mean 'ThetaGamma'?
zivi.twisting_tracker | did you mean 'TwistingTracker'?
zivi.solve_ivp | it is zivi.simulate
zivi.plot.Position | did you mean 'position'?
zivi.plot.phaseplane | did you mean 'phase_plane'?
zivi.plot.trajectory | it is zivi.plot.overview(sol)
zivi.plot.position(SOL, ax=3) | ax must be a matplotlib.axes.Axes, got 3
zivi.plot.velocity(SOL, "r") | settings of the line have names, color='r'
zivi.plot.gaps(RUN, plt) | write ax=plt.gca()
zivi.plot.gaps(RUN, np.array([None, None])) | write one of them, ax=axes[0]
zivi.plot.overview(SOL, "position") | figure must be a matplotlib.figure.Figure, got 'position'
zivi.plot.position(SOL.x) | draws a zivi.Trajectory or a zivi.ClosedLoop, got ndarray
zivi.plot.position(RUN) | of a mechanical system draw zivi.plot.gaps
SOL.impacts["time"] | it is 't'; the fields are t, gap, speed_before
SOL.impacts["speed"] | it is 'speed_before', or 'speed_after'
SOL.impacts["Impulse"] | did you mean 'impulse'?
SOL.impacts.velocity | it is 'speed_before', or 'speed_after'
SOL.zeno["times"] | they are 't'; the fields are t, gap, closed
SOL.impacts_down_to(0.1)["time"] | it is 't'
RUN.impacts["time"] | it is 't'
RUN.liftoffs["time"] | it is 't'; the fields are t, gap
SOL.t_impacts | they are impacts['t']
SOL.X | did you mean 'x'?
SOL.x_dot | it is xdot
SOL.rest_times | did you mean 'rest_time'?
SOL.t_zeno | they are zeno['t'], the end of all is rest_time
SOL["x"] | it is sol.x
RUN.t_impacts | they are impacts['t']
RUN.Q | did you mean 'q'?
RUN.gap_name | did you mean 'gap_names'?
BALL.simulate | it is zivi.simulate(system, t_span, y0)
BALL.restitution | it is e
BALL.gravity | it belongs to the force
BALL.Force | did you mean 'force'?
MASS.simulate | it is zivi.simulate(system, t_span, (q0, qdot0))
MASS.M | it is at(t, q, qdot).mass
MASS.at(e=0.5) | at evaluates a state; another system is replace(e=...)
zivi.LinearSystem([[1.0]], None, [[1.0]]).at(e=0.5) | another system is replace(e=...)
MASS.gap | did you mean 'gaps'?
DERIVED.rest_time | the time is trajectory.rest_time, its derivatives are zeno_times[-1]
DERIVED.xdot | 'Sensitivity' object has no attribute 'xdot': it is trajectory.xdot
DERIVED.zeno_time | did you mean 'zeno_times'?
zivi.sensitivity(MASS, SPAN, ([1.0], [0.0])).reactions | it is trajectory.reactions
zivi.mechanics.Contact("ball", "floor", friction=0.3) | 'friction': it is mu
zivi.mechanics.Contact() | write zivi.mechanics.Contact("ball", "floor", mu=0.3)
zivi.Contact(friction=0.3) | shapes of a zivi.Tree have zivi.mechanics.Contact
"""
"""Mistakes that were typed, and what the error says in its words or in a note."""


@pytest.mark.parametrize("line", MISTAKES.strip().splitlines())
def test_what_is_typed_wrong_is_answered_by_what_is_right(line):
    import matplotlib.pyplot as plt

    typed, hint = line.split(" | ")
    names = {"SOL": RESULTS["run"], "RUN": RESULTS["mechanical run"], "plt": plt, **globals()}
    names["DERIVED"] = RESULTS["sensitivity"]
    with pytest.raises((TypeError, ValueError, AttributeError)) as told:
        eval(typed, names)
    assert hint in str(told.value)
    plt.close("all")


def test_a_force_that_takes_a_number_for_an_array_is_told_what_it_gets():
    three = zivi.ImpactSystem(lambda t, x, xdot: -x[0], e=0.5)
    two = zivi.ImpactSystem(lambda t, y: -t[0], e=0.5)
    several = zivi.MechanicalSystem(mass=1.0, force=lambda t, q, qdot: t[0])
    notes = "(t, x, xdot), three", "f(t, y)", "two arrays"
    for system, note in zip((three, two, several), notes, strict=True):
        with pytest.raises(TypeError, match="subscriptable") as told:
            zivi.simulate(system, SPAN, ([1.0], [0.0]) if system is several else START)
        assert note in " ".join(told.value.__notes__)


UP = "write a negative number, as in zivi.ImpactSystem"
FLOOR_ONLY = {"mass": np.eye(2), "gaps": [zivi.LinearGap([0, 1], name="floor")]}
START_OF_TWO = ([0.0, 1.0], [0.0, -1.0])


@pytest.mark.parametrize(
    "force", [9.81, 9, np.float64(9.81), zivi.LinearForce(gravity=-9.81, omega=3.0)]
)
def test_a_mass_that_flies_off_for_ever_is_warned_of(force):
    with pytest.warns(zivi.ModelWarning, match=UP) as told:
        sol = zivi.simulate(zivi.ImpactSystem(force, e=0.5), (0, 2), (1, -5))
    assert told[0].filename == __file__
    assert sol.x[-1] > 1.0
    with warnings.catch_warnings(action="error"):  # still on its way to the wall
        zivi.simulate(zivi.ImpactSystem(force, e=0.5), (0, 0.1), (1, -5))


def test_a_gap_that_opens_for_ever_is_warned_of():
    up = zivi.MechanicalSystem(force=[1.0, 9.81], **FLOOR_ONLY)
    with pytest.warns(zivi.ModelWarning, match="force opens the gap floor for ever") as told:
        zivi.simulate(up, (0, 2), START_OF_TWO)
    assert told[0].filename == __file__


TENT = [*FLOOR_ONLY["gaps"], zivi.LinearGap([0, -1], 2.0)]
RETURN = {
    "down": zivi.ImpactSystem(-9.81, e=0.5),
    "none": zivi.ImpactSystem(0.0, e=0.5),
    "spring": zivi.ImpactSystem(zivi.LinearForce(gravity=-1.0, stiffness=1.0), e=0.5),
    "wave": zivi.ImpactSystem(zivi.LinearForce(gravity=-1.0, amplitude=2.0), e=0.5),
    "wall": zivi.ImpactSystem(1.0, e=0.5, wall=zivi.Table([0, 1], [0, 1], kind="cubic")),
    "ceiling": zivi.MechanicalSystem(force=[0.0, 9.81], **FLOOR_ONLY | {"gaps": TENT}),
    "along": zivi.MechanicalSystem(force=[9.81, -1.0], **FLOOR_ONLY),
}


@pytest.mark.parametrize("name", RETURN)
def test_no_other_mass_is(name):
    several = isinstance(RETURN[name], zivi.MechanicalSystem)
    start = START_OF_TWO if several else (1, 0.1)
    with warnings.catch_warnings(action="error"):
        assert zivi.simulate(RETURN[name], (0, 0.9), start).success


def test_an_end_of_the_user_s_is_no_flight():
    gone = zivi.Level(x=1.5, terminal=True)
    with warnings.catch_warnings(action="error"):
        sol = zivi.simulate(zivi.ImpactSystem(9.81, e=0.5), (0, 9), (1, 0), events=gone)
    assert sol.status is zivi.Status.TERMINATED_BY_EVENT


def test_examples_of_calls_name_what_is_there():
    for owner, text in RIGHT.items():
        called = operator.attrgetter(re.match(r"@?zivi\.([\w.]+)", text)[1])(zivi)
        known = set(inspect.signature(called).parameters)
        inner = text.partition("(")[2].replace("zivi.LinearGap", "")
        assert set(re.findall(r"(\w+)=", inner)) <= known, owner


def test_modules_that_answer_calls_are_modules_still():
    cloudpickle = pytest.importorskip("cloudpickle")
    for module in (zivi.plot, zivi.control, zivi.batch):
        assert inspect.ismodule(module)
        assert cloudpickle.loads(cloudpickle.dumps(module)) is module


def test_misspelt_arguments_are_answered_too():
    with pytest.raises(TypeError, match=r"'stifness': did you mean 'stiffness'\?"):
        zivi.LinearForce(stifness=1.0)
    with pytest.raises(TypeError, match=r"'maximum'$"):
        zivi.solve_vi(len, maximum=3)


def test_errors_of_other_places_are_left_alone():
    def force(t, x, xdot):
        nothing = {}
        return nothing(k=1)

    with pytest.raises(TypeError, match="'dict' object is not callable"):
        zivi.sensitivity(zivi.ImpactSystem(force, e=0.5), SPAN, START)
    with pytest.raises(TypeError, match="missing 1 required positional argument"):
        zivi.ImpactSystem(e=0.5)


def test_signatures_and_names_are_those_of_the_functions():
    assert list(inspect.signature(zivi.solve_lcp).parameters)[:2] == ["M", "q"]
    assert zivi.sweep.__name__ == "sweep"
    assert pickle.loads(pickle.dumps(zivi.solve_vi)) is zivi.solve_vi
