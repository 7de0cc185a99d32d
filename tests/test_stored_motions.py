"""Motions as plain numbers: one format, and what older versions stored.

``data/stored_motions.json`` holds numbers that zivi wrote before format 3, of a mechanism also
those of format 4, and what these versions gave between the samples of these motions.
"""

import json
import pickle
from pathlib import Path

import numpy as np
import pytest

import zivi
from inside import _zivi

OLD = json.loads((Path(__file__).parent / "data" / "stored_motions.json").read_text())
MASSES = ("point_rk", "point_series")


def numbers_of(name):
    return np.array(OLD[name]["numbers"])


@pytest.mark.parametrize(
    ("name", "form"),
    [("point_rk", 1.0), ("point_rk", 2.0), ("point_series", 2.0)],  # format 1 had no series
)
def test_what_was_stored_of_a_mass_is_read(name, form):
    old, numbers = OLD[name], numbers_of(name)
    assert numbers[0] == 2.0
    numbers[0] = form
    motion = _zivi.MotionPath.restored(numbers)
    x, xdot = motion.physical(np.array(old["t"]))
    assert x == pytest.approx(old["x"], rel=1e-14, abs=1e-16)
    assert xdot == pytest.approx(old["xdot"], rel=1e-14, abs=1e-16)
    assert motion.tails == [tuple(tail) for tail in old["tails"]]
    again = motion.numbers()
    assert (again[:3] == [_zivi.FORMAT, 1.0, len(again)]).all()
    # its tails with zeros for the terms that they have had since
    assert len(again) == len(numbers) + 2 + 2 * 16 * len(old["tails"])
    copy = _zivi.MotionPath.restored(again)
    np.testing.assert_array_equal(copy.physical(np.array(old["t"])), (x, xdot))
    np.testing.assert_array_equal(copy.numbers(), again)


@pytest.mark.parametrize(("name", "form"), [("mechanism", 1.0), ("mechanism_4", 4.0)])
def test_what_was_stored_of_a_mechanism_is_read(name, form):
    old, numbers = OLD[name], numbers_of(name)
    assert numbers[0] == form
    motion = _zivi.MechanicalPath.restored(numbers)
    q, qdot, _gaps, _rates, contacts = motion.at(np.array(old["t"]))
    assert q == pytest.approx(np.array(old["q"]), rel=1e-14, abs=1e-16)
    assert qdot == pytest.approx(np.array(old["qdot"]), rel=1e-14, abs=1e-16)
    assert contacts.tolist() == old["contacts"]
    again = motion.numbers()
    assert (again[:3] == [_zivi.FORMAT, 2.0, len(again)]).all()
    copy = _zivi.MechanicalPath.restored(again)
    np.testing.assert_array_equal(copy.at(np.array(old["t"]))[0], q)
    np.testing.assert_array_equal(copy.numbers(), again)


@pytest.mark.parametrize(
    ("restored", "name", "other"),
    [
        (_zivi.MotionPath.restored, "point_series", "a mechanical system"),
        (_zivi.MechanicalPath.restored, "mechanism", "a mass above a wall"),
    ],
)
def test_what_is_no_motion_is_refused_in_the_same_words(restored, name, other):
    numbers = restored(numbers_of(name)).numbers()
    np.testing.assert_array_equal(restored(numbers).numbers(), numbers)
    another = numbers.copy()
    another[1] = 3.0 - another[1]
    newer = numbers.copy()
    newer[0] = _zivi.FORMAT + 1
    damaged = "the stored motion is damaged"
    for wrong, words in (
        (another, f"the stored motion is that of {other}"),
        (newer, f"the stored motion has format {_zivi.FORMAT + 1}, this zivi reads {_zivi.FORMAT}"),
        (numbers[:-1], damaged),
        (np.append(numbers, 0.0), damaged),
        (numbers[:0], damaged),
        (np.where(np.arange(len(numbers)) == 5, -1.0, numbers), damaged),
    ):
        with pytest.raises(ValueError, match=f"^{words}$"):
            restored(wrong)


def test_motions_are_pickled_as_their_numbers():
    for restored, name in (
        (_zivi.MotionPath.restored, "point_rk"),
        (_zivi.MechanicalPath.restored, "mechanism"),
    ):
        motion = restored(numbers_of(name))
        twin = pickle.loads(pickle.dumps(motion))
        assert twin.span == motion.span
        np.testing.assert_array_equal(twin.numbers(), motion.numbers())


def test_a_fresh_run_is_what_was_stored():
    force = zivi.LinearForce(gravity=9.81, amplitude=3.0, omega=5.0)
    ball, method = zivi.ImpactSystem(force, e=0.5), zivi.SwitchedRK(rtol=1e-10, atol=1e-12)
    sol = zivi.simulate(ball, (0, 2), (0.3, 0.0), method=method)
    for name in MASSES:
        for t, x in zip(OLD[name]["t"], OLD[name]["x"], strict=True):
            assert sol(t)[0] == pytest.approx(x, abs=1e-4)  # both at tol 1e-6
