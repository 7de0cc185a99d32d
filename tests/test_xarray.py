"""Labelled data: units, the configuration as JSON, and a file and back."""

import json

import numpy as np
import pytest

import zivi

xarray = pytest.importorskip("xarray")

UNITS = {
    "x": "m",
    "xdot": "m/s",
    "s": "m",
    "v": "m/s",
    "lambda_s": "1",
    "lambda_v": "1",
    "residual": "1",
    "time": "s",
    "impact_time": "s",
    "impact_xdot_before": "m/s",
    "impact_xdot_after": "m/s",
    "zeno_time": "s",
    "liftoff_time": "s",
}


@pytest.fixture(scope="module")
def sol():
    table = zivi.LinearForce(gravity=9.81, amplitude=14.715, omega=6.28, phase=-1.57)
    system = zivi.ImpactSystem(table, e=0.5)
    return zivi.simulate(system, (0, 3), (0.2, 0), method=zivi.ThetaGamma(h=1e-3))


def test_every_variable_has_its_unit_and_a_description(sol):
    data = sol.to_xarray()
    assert set(data.variables) == set(UNITS)
    for name, unit in UNITS.items():
        assert data[name].attrs["units"] == unit, name
        assert data[name].attrs["long_name"], name


def test_values_are_those_of_the_run(sol):
    data = sol.to_xarray()
    lifted = {name: getattr(sol.transformed, name) for name in ("s", "v", "lambda_s", "lambda_v")}
    for name, values in (lifted | {"x": sol.x, "xdot": sol.xdot, "residual": sol.residual}).items():
        assert data[name].dims == ("time",)
        np.testing.assert_array_equal(data[name], values)
    np.testing.assert_array_equal(data.time, sol.t)
    np.testing.assert_array_equal(data.impact_time, sol.impacts["t"])
    np.testing.assert_array_equal(data.impact_xdot_after, sol.impacts["xdot_after"])
    np.testing.assert_array_equal(data.zeno_time, sol.zeno_times)
    np.testing.assert_array_equal(data.liftoff_time, sol.liftoff_times)
    assert len(sol.zeno_times) > 0
    assert len(sol.liftoff_times) > 0


def test_attributes_tell_the_run_again(sol):
    data = sol.to_xarray()
    assert json.loads(data.attrs["config"]) == sol.config
    assert data.attrs["status"] == 0
    assert data.attrs["nfev"] == sol.nfev
    assert data.attrs["n_steps"] == sol.n_steps
    assert zivi.__version__ in data.attrs["source"]


def test_selecting_by_time(sol):
    near = sol.to_xarray().x.sel(time=0.5, method="nearest")
    assert float(near) == sol.x[500]


def test_a_netcdf_file_and_back(sol, tmp_path):
    pytest.importorskip("scipy")
    path = tmp_path / "run.nc"
    data = sol.to_xarray()
    data.to_netcdf(path, engine="scipy")
    with xarray.open_dataset(path, engine="scipy") as back:
        xarray.testing.assert_equal(back.load(), data)
        assert json.loads(back.attrs["config"]) == sol.config
        assert back.x.attrs == data.x.attrs


@pytest.mark.parametrize("force", [-9.81, lambda t, x, xdot: -9.81])
def test_a_run_without_rest_or_impacts_can_be_saved(force, tmp_path):
    pytest.importorskip("scipy")
    system = zivi.ImpactSystem(force, e=0.5)
    sol = zivi.simulate(system, (0, 0.1), (1, 0), method=zivi.ThetaGamma(h=1e-2))
    data = sol.to_xarray()
    assert np.isnan(data.attrs["rest_time"])
    assert data.sizes["impact_time"] == data.sizes["zeno"] == 0
    json.loads(data.attrs["config"])
    data.to_netcdf(tmp_path / "run.nc", engine="scipy")
