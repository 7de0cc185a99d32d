"""Systems keep the models that runs integrate: no change of numbers is missed, nothing leaks."""

import copy
import gc
import os
import pickle
import threading
import weakref

import numpy as np
import pytest

import zivi
from zivi.mechanics import Body, PlaneGap

FLOOR = zivi.LinearGap([1.0], name="floor")
SPAN, START = (0.0, 1.5), ([1.0], [0.0])


def of_arrays():
    return zivi.MechanicalSystem(mass=2.0, force=[-19.62], gaps=[FLOOR], e=0.5)


def weight(t, q, qdot):
    return [-9.81 - 0.1 * qdot[0]]


def of_functions():
    return zivi.MechanicalSystem(mass=1.0, force=weight, gaps=[FLOOR], e=0.5)


def linear():
    load = zivi.Harmonic([1.0], omega=3.0)
    return zivi.LinearSystem([[1.0]], [[0.1]], [[4.0]], excitation=load, gaps=[FLOOR], e=0.5)


def rubbing():
    belt = zivi.DryFriction([1.0], limit=0.8, static=1.2, velocity=0.2)
    return zivi.MechanicalSystem(mass=1.0, force=lambda t, q, qdot: -q, friction=[belt])


def tree():
    bob = Body("bob", axis=[0, 1, 0], mass=2.0, com=[0, 0, -1], inertia=0.01)
    floor = PlaneGap("bob", point=[0, 0, -1], offset=-0.9, radius=0.05, name="floor")
    return zivi.Tree([bob], gaps=[floor], e=0.5)


def symbolic():
    given = {"T": "m*xdot**2/2", "V": "m*g*x", "parameters": {"m": 2.0, "g": 9.81}}
    return zivi.symbolic.system("x", **given, gaps={"floor": "x"}, e=0.5)


def built(mass=1.0):
    return zivi.MechanicalSystem(mass=mass, force=[-9.81 * mass], gaps=[FLOOR], e=0.5)


def parametric():
    return zivi.ParametricSystem(built, {"mass": 2.0})


KINDS = (of_arrays, of_functions, linear, rubbing, tree, symbolic, parametric)


def bits(system, span=SPAN, start=START):
    sol = zivi.simulate(system, span, start)
    return [getattr(sol, name).tobytes() for name in ("t", "q", "qdot", "reactions")]


@pytest.mark.parametrize("make", KINDS)
def test_a_model_is_made_once(make):
    system = make()
    first = bits(system)
    model = system.model(1)
    assert bits(system) == first == bits(make())
    assert system.model(1) is model
    zivi.simulate_batch(system, SPAN, (np.ones((3, 1)), np.zeros((3, 1))), threads=2)
    assert system.model(1) is model


@pytest.mark.parametrize("make", [kind for kind in KINDS if kind is not rubbing])
def test_pickles_and_copies_do_without_the_model(make):
    system = make()
    fresh, text = pickle.dumps(system), repr(system)
    first = bits(system)
    assert pickle.dumps(system) == fresh
    assert repr(system) == text
    for other in (pickle.loads(fresh), copy.copy(system), copy.deepcopy(system)):
        assert other.model(1) is not system.model(1)
        assert bits(other) == first


def test_replaced_numbers_are_those_of_a_new_system():
    system = of_arrays()
    bits(system)
    other = zivi.LinearGap([1.0], 0.3, name="floor")
    for changes in ({"mass": 3.0}, {"force": [-5.0]}, {"gaps": [other]}, {"e": 0.7}):
        given = {"mass": 2.0, "force": [-19.62], "gaps": [FLOOR], "e": 0.5} | changes
        assert bits(system.replace(**changes)) == bits(zivi.MechanicalSystem(**given))
    shaken = linear()
    bits(shaken)
    assert bits(shaken.at(omega=2.0)) == bits(linear().at(omega=2.0)) != bits(shaken)
    assert bits(shaken.replace(K=[[9.0]])) == bits(linear().replace(K=[[9.0]])) != bits(shaken)


@pytest.mark.parametrize(("make", "name"), [(tree, "bob.mass"), (symbolic, "m")])
def test_a_changed_parameter_holds_for_the_next_run(make, name):
    system, force = make(), {"bob.torque": 1.5} if make is tree else {"g": 5.0}
    before = bits(system)
    system.parameters.update(force)
    moved = make()
    moved.parameters.update(force)
    assert bits(system) == bits(moved) == bits(make().replace(**force)) != before
    system.parameters[name] = 7.0
    assert system.at(0.0, [0.0], [0.0]).mass[0, 0] > 6.9
    heavy = system.replace(**{name: 3.0})
    system.parameters[name] = 3.0
    assert bits(heavy) == bits(system)
    system.parameters.update(force | {name: make().parameters[name]})
    assert bits(system) == bits(moved)


def test_the_copy_of_a_tree_does_not_take_the_model_of_the_other():
    first = tree()
    first.parameters["bob.mass"] = 2.5
    bits(first)
    second = first.replace(**{"bob.torque": 1.5})
    first.parameters["bob.torque"] = 1.5  # the numbers of both are the same, after as many changes
    alone = tree()
    alone.parameters.update({"bob.mass": 2.5, "bob.torque": 1.5})
    assert bits(second) == bits(first) == bits(alone)


def test_what_a_model_is_made_of_cannot_be_changed():
    mass, normal = np.array([[2.0]]), np.array([1.0])
    gap = zivi.LinearGap(normal, name="floor")
    system = zivi.MechanicalSystem(mass=mass, force=[-19.62], gaps=[gap], e=0.5)
    mass[0, 0], normal[0] = 5.0, 3.0
    assert bits(system) == bits(of_arrays()) == bits(pickle.loads(pickle.dumps(system)))
    shaken = linear()
    for array in (gap.normal, shaken.M, shaken.C, shaken.K, shaken.excitation[0].amplitude):
        with pytest.raises(ValueError, match="read-only"):
            array[...] = 1.0
    reread = pickle.loads(pickle.dumps(shaken))
    with pytest.raises(ValueError, match="read-only"):
        reread.K[...] = 1.0
    with pytest.raises(AttributeError, match=r"offset of a zivi\.LinearGap cannot be changed"):
        gap.offset = 1.0
    with pytest.raises(AttributeError, match=r"limit of a zivi\.DryFriction"):
        zivi.DryFriction(limit=1.0).limit = 2.0
    with pytest.raises(AttributeError, match="K"):
        shaken.K = np.eye(1)


def test_a_run_keeps_its_numbers_while_a_parameter_changes():
    system = tree()
    expected = bits(system)

    def change(t, q, qdot):
        system.parameters["bob.torque"] = 1.0 + t
        return 1.0

    sol = zivi.simulate(system, SPAN, START, events=change)
    assert sol.qdot[-1] == np.frombuffer(expected[2])[-1]


@pytest.mark.parametrize("make", [of_functions, tree, symbolic, linear])
def test_threads_may_start_the_first_run_at_once(make):
    system, expected = make(), bits(make())
    barrier, found = threading.Barrier(6), []

    def run():
        barrier.wait()
        found.append(bits(system))

    threads = [threading.Thread(target=run) for _ in range(6)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert found == [expected] * 6


def test_a_force_may_evaluate_and_simulate_its_own_system():
    def force(t, q, qdot):
        if system.seen is None:
            system.seen = "under way"
            system.at(t, q + 1.0, qdot + 1.0)
            system.seen = bits(system, start=([0.5], [1.0]))
        return weight(t, q, qdot)

    system = zivi.MechanicalSystem(mass=1.0, force=force, gaps=[FLOOR], e=0.5)
    system.seen = None
    assert bits(system) == bits(of_functions())
    assert system.seen == bits(of_functions(), start=([0.5], [1.0]))


def test_a_force_that_raises_leaves_nothing_behind():
    state = {"raises": True}

    def force(t, q, qdot):
        if state["raises"]:
            raise RuntimeError("not yet")
        return weight(t, q, qdot)

    system = zivi.MechanicalSystem(mass=1.0, force=force, gaps=[FLOOR], e=0.5)
    for _ in range(2):
        with pytest.raises(RuntimeError, match="not yet"):
            zivi.simulate(system, SPAN, START)
    state["raises"] = False
    assert bits(system) == bits(of_functions())


def test_a_wrong_start_is_told_again():
    wrong = zivi.Gap(lambda t, q: q[0], lambda t, q: [2.0], name="floor")
    system = zivi.MechanicalSystem(mass=1.0, force=[-9.81], gaps=[wrong], e=0.5)
    for _ in range(2):
        with pytest.raises(ValueError, match="not the derivative"):
            zivi.simulate(system, SPAN, START)


def test_functions_are_called_as_often_in_every_run():
    calls = []

    def force(t, q, qdot):
        calls.append(t)
        return weight(t, q, qdot)

    system = zivi.MechanicalSystem(mass=1.0, force=force, gaps=[FLOOR], e=0.5)
    counts = []
    for _ in range(3):
        calls.clear()
        sol = zivi.simulate(system, SPAN, START)
        counts.append(len(calls))
        assert calls.count(SPAN[0]) >= 1
        assert sol.nfev <= len(calls)
    assert counts[1] == counts[2] == sol.nfev + 1
    assert counts[0] >= counts[1]


@pytest.mark.parametrize("make", KINDS)
def test_a_dropped_system_is_freed(make):
    system = make()
    bits(system)
    system.at(0.0, [1.0], [0.0])
    gone = [weakref.ref(system), weakref.ref(system.model(1))]
    gc.disable()
    try:
        del system
        assert [it() for it in gone] == [None, None]
    finally:
        gc.enable()


@pytest.mark.skipif(not hasattr(os, "fork"), reason="there is no fork here")
@pytest.mark.filterwarnings("ignore:This process:DeprecationWarning")
@pytest.mark.filterwarnings("ignore:os.fork:RuntimeWarning")  # of JAX, where a test loads it
def test_a_forked_process_runs_a_kept_model():
    for make in (of_functions, tree, symbolic):
        system = make()
        expected = bits(system)
        child = os.fork()
        if not child:
            os._exit(0 if bits(system) == expected else 1)
        assert os.waitpid(child, 0)[1] == 0
