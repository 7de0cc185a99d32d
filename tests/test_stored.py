"""Pickles, studies and files of results that version 0.1 stored: read, and gone on with."""

import json
import pickle
import zipfile
from pathlib import Path

import numpy as np
import pytest

import zivi
from stored.make import plain
from stored.objects import CASES
from stored.studies import STUDIES

ARCHIVE = Path(__file__).parent / "stored" / "0.1.zip"


@pytest.fixture(scope="module")
def old(tmp_path_factory):
    folder = tmp_path_factory.mktemp("stored")
    with zipfile.ZipFile(ARCHIVE) as archive:
        archive.extractall(folder)
    return folder


@pytest.fixture(scope="module")
def told(old):
    return json.loads((old / "told.json").read_text())


ROUNDING = 1e-13
BY_STEPS = {"ImpactSystem_function": 1e-9}
"""Runs by steps of a pair under a smooth force: their last digits are those of a version."""


def agree(found, expected, rtol=ROUNDING):
    if isinstance(expected, dict):
        return all(agree(found[key], value) for key, value in expected.items())
    if expected is None or isinstance(expected, str):
        return found == expected
    found, expected = (json.loads(json.dumps(it, default=plain)) for it in (found, expected))
    if isinstance(expected, list) and not all(isinstance(it, (int, float)) for it in expected):
        pairs = zip(found, expected, strict=True)
        return all(agree(one, other, rtol) for one, other in pairs)
    np.testing.assert_allclose(found, expected, rtol=rtol, atol=1e-15)
    return True


@pytest.mark.parametrize("name", CASES)
def test_pickles_are_read(name, old, told):
    value = pickle.loads((old / "pickles" / f"{name}.pickle").read_bytes())
    assert agree(CASES[name][1](value), told[name], BY_STEPS.get(name, ROUNDING))


def test_an_observer_goes_on_from_its_first_state(old):
    """What it has more since then starts as in a new one; a kick later it finds the mass again."""
    it = pickle.loads((old / "pickles" / "ImpactObserver_seen.pickle").read_bytes())
    first = it.state[:7]
    assert it.e_est == 0.8
    assert it.e_std == 0.0
    x, xdot = it.estimate[:2]
    dt, kick = 1e-3 * np.arange(1, 16), 20.0
    for t in dt:
        known = it.step(x + xdot * t - 9.81 * t**2 / 2, None, -9.81, 0.0)[1]
    assert known == pytest.approx(xdot - 9.81 * dt[-1], abs=1e-3)
    assert it.n_refused == first[6]
    start, known = it.estimate[0], known + kick
    for t in dt:
        found = it.step(start + known * t - 9.81 * t**2 / 2, None, -9.81, 0.0)[1]
    assert found == pytest.approx(known - 9.81 * dt[-1], abs=0.02)
    assert 0 < it.n_refused - first[6] < 10
    for state in (first, (*first[:4], [0.0] * 6, 13, 2**32 - 1)):
        it.state = state
        assert it.state[:7] == tuple(state)


@pytest.mark.parametrize("name", ["Trajectory", "Trajectory_steps", "MechanicalTrajectory"])
def test_files_of_results_are_read(name, old, told):
    pytest.importorskip("h5netcdf", reason="the extra 'files' is not installed")
    value = zivi.files.load(old / "results" / f"{name}.nc")
    assert agree(CASES[name][1](value), told[name])


@pytest.mark.parametrize("name", STUDIES)
def test_studies_go_on(name, old):
    pytest.importorskip("zarr", reason="the extra 'study' is not installed")
    folder, study = old / "studies" / name, STUDIES[name]
    before = zivi.open_study(folder)
    first = np.asarray(before.value)
    done = np.isfinite(first)
    assert 2 * done.sum() == done.size
    # what the functions use was not stored
    with pytest.raises(ValueError, match="resume=True"):
        zivi.sweep(**study, out=folder)
    after = zivi.sweep(**study, out=folder, resume=True)
    afresh = zivi.sweep(**study)
    assert np.isfinite(after.value).all()
    np.testing.assert_allclose(after.value, afresh.value, rtol=1e-13)
    np.testing.assert_array_equal(np.asarray(after.value)[done], first[done])
