"""``system.replace(...)``: one way to another value, whatever the system is."""

import pickle

import numpy as np
import pytest

import zivi

STOP = zivi.LinearGap([1.0], 0.5, name="stop")
WALL = zivi.HarmonicWall(0.01, 20.0)


def drop(mass, floor):
    gap = zivi.LinearGap([1.0], -floor, name="floor")
    return zivi.MechanicalSystem(mass=mass, force=[-9.81 * mass], gaps=[gap], e=0.5)


def mass(force=-9.81, e=0.5, **more):
    return zivi.ImpactSystem(force, e=e, **more)


def linear(gravity=9.81, stiffness=0.0, **more):
    return mass(zivi.LinearForce(gravity=gravity, stiffness=stiffness), **more)


def several(force=-9.81, e=0.5, **more):
    return zivi.MechanicalSystem(mass=1.0, force=[force], gaps=[STOP], e=e, **more)


def matrices(K=4.0, e=0.5, omega=2.0):
    load = zivi.Harmonic([1.0], omega=omega)
    return zivi.LinearSystem([[1.0]], [[0.1]], [[K]], excitation=load, gaps=[STOP], e=e)


def energies(g=9.81, e=0.5):
    gaps, parameters = {"floor": "a"}, {"g": g}
    return zivi.symbolic.system("a", T="adot**2/2", V="g*a", gaps=gaps, parameters=parameters, e=e)


def tree(mass=1.0, e=0.5):
    rod = zivi.mechanics.Body("rod", mass=mass, axis=[0, 1, 0], com=[0, 0, -1], inertia=0.1)
    return zivi.Tree([rod], gaps=[zivi.mechanics.JointLimit("rod", lower=0.0)], e=e)


def built(mass=1.0, floor=0.1):
    return zivi.ParametricSystem(drop, {"mass": mass, "floor": floor})


CASES = {
    "number": (mass, {"force": -3.0, "e": 0.8}),
    "parameters of the force": (linear, {"gravity": 3.0, "stiffness": 4.0}),
    "law": (mass, {"e": zivi.SpeedDependentImpact(0.5, 1.0, 0.2)}),
    "wall": (mass, {"wall": WALL}),
    "friction": (mass, {"friction": zivi.DryFriction(limit=0.5)}),
    "mechanism": (several, {"force": -3.0, "e": 0.8}),
    "friction of a mechanism": (several, {"friction": [zivi.DryFriction(limit=0.5)]}),
    "matrices": (matrices, {"K": 9.0, "e": 0.8, "omega": 3.0}),
    "energies": (energies, {"g": 3.0, "e": 0.8}),
    "tree": (tree, {"e": 0.8}),
    "built": (built, {"mass": 3.0, "floor": 0.2}),
}


def motion(system):
    one = isinstance(system, zivi.ImpactSystem)
    sol = zivi.simulate(system, (0, 1), (1, 0) if one else ([1.0], [0.0]))
    return sol.to_pandas(n=9).to_numpy(), sol.impacts["t"]


def same(one, other):
    pairs = zip(motion(one), motion(other), strict=True)
    return all(np.array_equal(a, b, equal_nan=True) for a, b in pairs)


def given(kind, changes):
    """Arguments as the system takes them: lists and matrices where the tests have a number."""
    lists = {"force": lambda it: [it], "K": lambda it: [[it]]} if kind is not mass else {}
    return {name: lists.get(name, lambda it: it)(value) for name, value in changes.items()}


@pytest.mark.parametrize("name", CASES)
def test_another_value_is_the_system_that_has_it(name):
    kind, changes = CASES[name]
    system = kind()
    moved = system.replace(**given(kind, changes))
    assert type(moved) is type(system)
    assert same(moved, kind(**changes))
    assert not same(moved, system)
    assert same(system, kind())
    assert same(system.replace(), system)
    if kind is not energies:  # whose pickles have tests of their own
        assert same(pickle.loads(pickle.dumps(moved)), moved)
    with pytest.raises(KeyError, match="unknown parameter"):
        system.replace(nothing=1.0)


def test_the_numbers_of_a_tree_have_their_names():
    assert same(tree().replace(**{"rod.mass": 2.0}), tree(mass=2.0))


def test_what_is_not_named_keeps_its_bits():
    ball = linear(e=None, kappa=0.41)
    moved = ball.replace(gravity=3.0).replace(force=-1.0)
    assert (moved.e, moved.kappa) == (ball.e, 0.41)
    assert ball.replace(e=0.5).kappa == 1 / 3
    shaken = mass(wall=WALL).replace(**{"wall.amplitude": 0.2}, force=-1.0)
    assert (shaken.wall.amplitude, shaken.wall.omega, shaken.force) == (0.2, 20.0, -1.0)
    rubbed = mass(friction=zivi.DryFriction(limit=0.5)).replace(e=0.2)
    assert rubbed.friction.limit == 0.5


def test_a_built_system_keeps_another_restitution():
    system = built().replace(e=0.8)
    again = pickle.loads(pickle.dumps(system)).replace(floor=0.2)
    assert again.e == system.e == [0.8]
    # of the first impact after a fall from 1 - floor: sqrt(2 h/g) by floor is -1/sqrt(2 g h)
    slopes = zivi.sensitivity(again, (0, 0.6), ([1.0], [0.0]), wrt=("floor", "e"))
    by_floor = -1 / np.sqrt(2 * 9.81 * 0.8)
    assert slopes.impacts["dt"][0] == pytest.approx([by_floor, 0.0], rel=1e-6)


def test_frequencies_are_those_of_at():
    system = matrices()
    assert same(system.replace(omega=3.0), system.at(omega=3.0))
    with pytest.raises(ValueError, match="needs Harmonic loads of one frequency"):
        system.replace(excitation=None, omega=3.0)
