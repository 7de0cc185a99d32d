"""`zivi fit`: a system, and data in the file or in tables beside it."""

import json
import math

import numpy as np
import pytest
from typer.testing import CliRunner

import zivi
from inside import file_columns
from zivi.cli import app

pytest.importorskip("h5netcdf")
xarray = pytest.importorskip("xarray")


def fitted(tmp_path, text, *options):
    path = tmp_path / "ball.toml"
    path.write_text(text)
    return CliRunner().invoke(app, ["fit", str(path), *options])


BALL = """
y0 = [1.0, 0.0]
params = ["e"]
starts = 2
[system]
e = 0.6
force = -9.81
"""


def bounces(e, number):
    fall = math.sqrt(2 / 9.81)
    return fall + np.concatenate([[0.0], np.cumsum(2 * fall * e ** np.arange(1.0, number))])


def test_the_example_is_fitted(tmp_path):
    text = CliRunner().invoke(app, ["fit", "--example"]).output
    done = fitted(tmp_path, text, "--json")
    assert done.exit_code == 0, done.output
    told = json.loads(done.output)
    assert told["values"]["e"] == pytest.approx(0.778, abs=1e-3)
    with xarray.open_dataset(tmp_path / "ball.nc", engine="h5netcdf") as result:
        assert float(result.value.sel(parameter="e")) == told["values"]["e"]
        assert float(result.deviation[0]) == told["std"]["e"]


def test_tables_beside_the_file_are_read(tmp_path):
    times = bounces(0.7, 7)
    (tmp_path / "clicks.csv").write_text("\n".join(["n, time", *(f"1, {t}" for t in times)]))
    data = '[[data]]\nkind = "bounces"\nfile = "clicks.csv"\ncolumn = "time"\nsigma = 1e-3\n'
    done = fitted(tmp_path, BALL + data)
    assert done.exit_code == 0, done.output
    assert "2 of 2 starts" in done.output
    assert "0.7" in done.output
    t = np.linspace(0.05, 0.4, 20)
    rows = [f"{time},{1 - 4.905 * time**2}" for time in t]
    rows[3] = f"{t[3]},"
    (tmp_path / "video.csv").write_text("\n".join(["t,x", *rows]))
    record = BALL.replace('["e"]', '["x0"]') + '[[data]]\nkind = "record"\nfile = "video.csv"\n'
    done = fitted(tmp_path, record, "--force", "--json")
    assert json.loads(done.output)["values"]["x0"] == pytest.approx(1.0, abs=1e-6)


def test_mechanisms_are_fitted(tmp_path):
    pytest.importorskip("sympy")
    text = """
        y0 = [[1.0], [0.0]]
        params = ["e", "g"]
        starts = 1
        [system]
        q = ["y"]
        T = "ydot**2/2"
        V = "g*y"
        gaps = { floor = "y" }
        parameters = { g = 9.0 }
        e = 0.5
        [[data]]
        kind = "bounces"
        gap = "floor"
        sigma = 1e-3
    """
    times = f"times = {bounces(0.7, 6).tolist()}"
    done = fitted(tmp_path, text + times, "--json")
    assert done.exit_code == 0, done.output
    values = json.loads(done.output)["values"]
    assert [values["e"], values["g"]] == pytest.approx([0.7, 9.81], abs=1e-4)


CLICKS = '[[data]]\nkind = "bounces"\ntimes = [0.45, 1.0]\n'


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (BALL, "data is missing"),
        (BALL + CLICKS + "sigm = 1", "data[0].sigm is not a known key; did you mean 'sigma'"),
        (BALL + CLICKS + 'file = "a.csv"', "data[0] must have either file or times"),
        (BALL + CLICKS.replace("1.0", "0.1"), "times must increase"),
        (BALL + CLICKS.replace("bounces", "jumps"), "data[0].kind must be"),
        ('loss = "x"' + BALL + CLICKS, "loss must be"),
        (BALL.replace('"e"', '"f"') + CLICKS, "'f'"),
        (BALL + CLICKS + "[bounds]\nq = [0, 1]", "bounds must name parameters"),
        (BALL + '[[data]]\nkind = "record"\nfile = "none.csv"', "none.csv: cannot be read"),
    ],
)
def test_mistakes_are_named(tmp_path, text, words):
    done = fitted(tmp_path, text)
    assert done.exit_code == 2, done.output
    assert words in done.output


def test_mistakes_of_tables_are_named(tmp_path):
    table = tmp_path / "a.csv"
    table.write_text("t,x\n1,2\n2,two\n")
    with pytest.raises(zivi.files.FileError, match="line 3: 'two' is not a number"):
        file_columns(table, ["x"])
    with pytest.raises(zivi.files.FileError, match="column 'y' is missing; the file has t, x"):
        file_columns(table, ["y"])


def test_a_file_for_a_fit_is_not_a_run(tmp_path):
    path = tmp_path / "ball.toml"
    path.write_text(BALL + CLICKS)
    done = CliRunner().invoke(app, ["simulate", str(path)])
    assert done.exit_code == 2
    assert "is a file for zivi fit" in done.output


def test_several_runs_with_initial_states_of_their_own(tmp_path):
    rows = []
    for height in (0.95, 1.05):
        fall = math.sqrt(2 * height / 9.81)
        flights = np.cumsum(2 * fall * 0.7 ** np.arange(1.0, 6))
        times = (fall + np.concatenate([[0.0], flights])).tolist()
        own = "" if height < 1.0 else "y0 = [[1.0], [0.0]]\n"
        rows.append(f'[[data]]\nkind = "bounces"\ntimes = {times}\nsigma = 1e-3\n{own}')
    done = fitted(
        tmp_path, BALL.replace("starts", 'own = ["x0"]\nstarts') + "".join(rows), "--json"
    )
    assert done.exit_code == 0, done.output
    values = json.loads(done.output)["values"]
    assert values["e"] == pytest.approx(0.7, abs=1e-6)
    assert [values[name] for name in values if name != "e"] == pytest.approx([0.95, 1.05], abs=1e-6)
