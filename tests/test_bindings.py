"""What crosses the border to the extension: typed objects, refused where they do not fit."""

import gc
import re
import weakref
from pathlib import Path

import numpy as np
import pytest

import zivi
from inside import _zivi

ROOT = Path(__file__).parents[1]
ONE = _zivi.Force.constant(-1.0)
TABLE = _zivi.Wall.harmonic(amplitude=0.1, omega=3.0, phase=0.0, offset=0.0)
PLASTIC = _zivi.ImpactLaw.newton(0.0, 1.0)


def linear(**given):
    names = ("stiffness", "damping", "gravity", "amplitude", "omega", "phase")
    return _zivi.Force.native("LinearForce", **{name: given.get(name, 0.0) for name in names})


@pytest.mark.parametrize(
    ("force", "constant", "native"),
    [
        (ONE, True, True),
        (linear(gravity=9.81), False, True),
        (_zivi.Force.callable(lambda t, x, xdot: -1.0), False, False),
        (_zivi.Force.above(TABLE, ONE), False, True),
        (_zivi.Force.above(_zivi.Wall.callable(lambda t: (0.0, 0.0, 0.0)), ONE), False, False),
        (_zivi.Force.parametric(ONE, lambda t, x, xdot, g: -g, [1.0]), False, True),
    ],
    ids=["constant", "linear", "callable", "vibrating", "moving", "parametric"],
)
def test_a_force_tells_what_it_needs(force, constant, native):
    assert (force.is_constant, force.is_native, force.is_compiled) == (constant, native, False)
    assert force.address is None


@pytest.mark.parametrize(
    ("make", "error", "message"),
    [
        (lambda: _zivi.PointMass(-9.81, PLASTIC), TypeError, "Force"),
        (lambda: _zivi.PointMass(("constant", -9.81), PLASTIC), TypeError, "Force"),
        (lambda: _zivi.PointMass(ONE, (0.5, 1 / 3)), TypeError, "ImpactLaw"),
        (lambda: _zivi.Force.constant("heavy"), TypeError, "real number"),
        (lambda: _zivi.Force.native("Spring", k=1.0), ValueError, 'no native force "Spring"'),
        (lambda: _zivi.Force.native("LinearForce"), TypeError, "stiffness must be given"),
        (lambda: linear(phase="late"), TypeError, "real number"),
        (
            lambda: _zivi.Force.native("LinearForce", **vars(zivi.LinearForce()), k=1.0),
            TypeError,
            "stiffness, damping, gravity, amplitude, omega, phase only",
        ),
        (lambda: _zivi.Force.above(_zivi.Force.constant(1.0), ONE), TypeError, "Wall"),
        (
            lambda: _zivi.Force.above(TABLE, _zivi.Force.above(TABLE, ONE)),
            ValueError,
            "a moving wall above a moving wall",
        ),
        (
            lambda: _zivi.Force.compiled(1, parameters=[1.0] * 6, owner=None),
            ValueError,
            "a compiled force has at most 5 parameters, got 6",
        ),
        (
            lambda: _zivi.Restitution(e=0.5, kappa=0.2),
            ValueError,
            "exactly one of e and kappa must be given, got both",
        ),
        (
            lambda: _zivi.Restitution(),
            ValueError,
            "exactly one of e and kappa must be given, got neither",
        ),
        (lambda: _zivi.Restitution(e=1.2), ValueError, r"e must lie in \[0, 1\], got 1.2"),
        (lambda: _zivi.Restitution.of_both(0.5, 0.5), ValueError, "kappa must lie"),
        (lambda: _zivi.Mechanism(ONE, n=1, m=0, e=np.empty(0)), TypeError, "Model"),
        (lambda: _zivi.Partials.differences([1.0]), TypeError, "Moved"),
    ],
)
def test_what_is_of_another_kind_is_refused(make, error, message):
    with pytest.raises(error, match=message):
        make()


def test_both_coefficients_keep_their_digits():
    for given in ({"e": 1e-15}, {"kappa": 1e-15}):
        first = _zivi.Restitution(**given)
        again = _zivi.Restitution.of_both(first.e, first.kappa)
        assert (again.e, again.kappa) == (first.e, first.kappa)


def test_a_force_that_refers_to_its_system_is_collected():
    class Law:
        def __call__(self, t, x, xdot):
            return -1.0

    law = Law()
    law.system = zivi.ImpactSystem(law, e=0.5)
    gone = weakref.ref(law)
    del law
    gc.collect()
    assert gone() is None


def test_hits_of_a_mass_and_of_a_mechanism_are_of_one_class():
    event = _zivi.Event(lambda t, *state: t - 0.5, direction=0, terminal=None)
    keep, method = _zivi.RecordOptions(events=[event]), zivi.SwitchedRK()._core
    mass = _zivi.PointMass(ONE, PLASTIC)
    of_mass = _zivi.simulate(mass, method, (0.0, 1.0), _zivi.State(2.0, 0.0), keep).hits[0]
    system = zivi.MechanicalSystem(mass=[[1.0]], force=[-1.0], gaps=[], e=[])
    mechanism = _zivi.Mechanism(system.model(1).spec, n=1, m=0, e=np.empty(0))
    start = _zivi.Configuration(np.array([2.0]), np.array([0.0]))
    of_mechanism = _zivi.simulate(mechanism, method, (0.0, 1.0), start, keep).hits[0]
    for hits in (of_mass, of_mechanism):
        assert isinstance(hits, _zivi.Hits)
        assert hits.t == pytest.approx([0.5], abs=1e-9)
        assert hits.q == pytest.approx(np.array([[1.875]]), abs=1e-9)
        assert hits.qdot == pytest.approx(np.array([[-0.5]]), abs=1e-9)


def test_a_native_force_is_named_in_its_file_and_in_the_list():
    source = Path(__file__).parents[1] / "crates" / "zivi-py" / "src"
    named = {
        str(path.relative_to(source))
        for path in source.rglob("*.rs")
        for line in path.read_text(encoding="utf-8").splitlines()
        if "LinearForce" in line.partition("//")[0]
    }
    # in an error, and as the force that has a table, too
    others = {"batch.rs", "force/mod.rs"}
    assert named == {"force/native/force.rs", "force/native/mod.rs"} | others


@pytest.mark.parametrize(
    ("file", "trait"),
    [
        ("force", "Force"),
        ("slopes", "DifferentiableForce"),
        ("dynamics", "Dynamics"),
        ("partials", "DifferentiableDynamics"),
    ],
)
def test_what_is_borrowed_hands_on_every_function(file, trait):
    """One that is forgotten would be the one that the trait gives by itself, without a word."""
    text = (ROOT / "crates" / "zivi" / "src" / "system" / f"{file}.rs").read_text()

    def functions(head):
        (body,) = re.findall(rf"^{head} \{{\n(.*?)^\}}$", text, re.MULTILINE | re.DOTALL)
        heads = re.findall(r"^    fn (\w+)([^{;]*)", body, re.MULTILINE)
        # what compares two of one type is not there for one that is known at run time only
        return [name for name, more in heads if "Self: Sized" not in more]

    own = functions(rf"pub trait {trait}<E>[^{{\n]*")
    assert len(own) >= 3
    assert functions(rf"impl<[^\n]*> {trait}<E> for &mut \w") == own
    if trait == "Dynamics":  # a system with its friction
        text = (ROOT / "crates" / "zivi-py" / "src" / "friction.rs").read_text()
        assert sorted(functions(r"impl<[^\n]*> Dynamics<\w+> for Rubbing<'_, D>")) == sorted(own)
