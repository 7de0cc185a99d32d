"""`zivi paper`: what it writes, what it checks, and that it fails when a number is off."""

import csv
import importlib
import io

import matplotlib.image
import numpy as np
import PIL.Image
import pytest
from rich.console import Console
from typer.testing import CliRunner

import zivi
from inside import (
    SIGNS,
    paper_ball as ball,
    paper_linearisation as linearisation,
    paper_rest as rest,
    paper_robustness as robustness,
    paper_step_solvers as step_solvers,
    track,
)
from zivi.cli import app
from zivi.paper import Check

pytestmark = [pytest.mark.slow, pytest.mark.xdist_group("paper")]

write = importlib.import_module("zivi.paper.write")  # the function hides the module

FIGURES = {
    "fig1_sv_plane": ["s", "v"],
    "fig2_s_v": ["s", "v"],
    "fig3_signs": ["lambda_s", "lambda_v"],
    "fig4_x_xdot": ["x", "xdot"],
    "explicit_and_implicit": None,
    "fig5_regulator_sv_plane": ["x", "xdot", "s", "v"],
    "regulator_over_time": ["x", "xdot", "u", "lambda_s", "lambda_v"],
    "fig6_positions": ["x", "x_ref"],
    "fig7_velocities": ["xdot", "xdot_ref"],
    "fig8_control": ["u"],
    "tracking_errors": ["e_s", "e_v"],
    "tracking_signs": list(SIGNS),
    "tracking_loops": None,
    "chattering": None,
}
"""With the columns of the data; None where each run has its own file."""


def rows(path):
    with path.open() as file:
        return list(csv.DictReader(line for line in file if not line.startswith("#")))


def paper(out, *options):
    return CliRunner().invoke(app, ["paper", "--out", str(out), *options])


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """Everything, once."""
    out = tmp_path_factory.mktemp("paper") / "new" / "folder"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(step_solvers, "interpreter", lambda: None)
        return out, paper(out)


def test_it_writes_figures_data_and_tables(written):
    out, result = written
    assert result.exit_code == 0, result.output
    for name, columns in FIGURES.items():
        picture = matplotlib.image.imread(out / f"{name}.png")
        assert min(picture.shape[:2]) > 500
        assert picture[..., :3].std() > 0.01
        if columns is not None:
            assert list(rows(out / f"{name}.csv")[0]) == ["time", *columns]
    checks = rows(out / "checks.csv")
    assert len(checks) >= 40
    assert all(row["ok"] == "yes" for row in checks)
    assert any(row["paper"] == "about 2.45" for row in checks)
    assert len(rows(out / "linearisation.csv")) == 5 * 17 + 7 * 11
    assert len(rows(out / "chattering.csv")) == 4 * 3 * 3
    assert len(rows(out / "robustness.csv")) == 2 * len(robustness.DISTURBANCES)
    assert len(rows(out / "rest.csv")) == len(rest.RESTITUTIONS)


def test_the_output_fits_80_columns_and_ends_with_the_verdict(written):
    lines = written[1].output.splitlines()
    assert lines[-1] == "40 of 40 agree"
    titles = "Section V.A", "Explicit and implicit", "under disturbances", "rest of", "Checked"
    for title in titles:
        assert any(title in line for line in lines)
    tables = lines[:-2]  # the folder has a line of its own, however long it is
    assert not [line for line in tables if len(line) > 80 or "\u2026" in line]
    checked = [line for line in lines if line.rstrip().endswith(" yes")]
    assert len(checked) == 40  # none is broken


def test_tables_with_siconos_fit_as_well():
    solvers = ("outer 1", "outer 5", "outer 20", "outer 100", "inner only", "inner", "tick")
    solvers += ("Siconos VI_BOX_AVI_LSA", "Siconos VI_BOX_QI")
    label = "tracking, random, |v|<=1e+00"
    rates = [linearisation.Rate("tracking", name, label, 1, 800) for name in solvers]
    console = Console(width=80, record=True, file=io.StringIO())
    console.print(linearisation.failure_tables(rates))
    text = console.export_text()
    assert text.count("0.12") == len(solvers)
    assert "\u2026" not in text


def test_each_figure_states_what_it_was_made_with(written):
    out, _ = written
    stated = {
        "fig2_s_v": {
            "h": "0.001 s",
            "kappa": "0.41",
            "g": "9.81 m/s^2",
            "scheme": "implicit Euler",
        },
        "fig5_regulator_sv_plane": {
            "mu1": "3 m/s^2",
            "branch": "positive",
            "loop": "the paper's, plant by the implicit step",
        },
        "fig8_control": {"mu1": "30 m/s^2", "kappa_ref": "0.5", "F_ref": "-19.81 m/s^2"},
    }
    for name, settings in stated.items():
        text = PIL.Image.open(out / f"{name}.png").text
        assert settings.items() <= text.items()
        head = (out / f"{name}.csv").read_text().split("time,")[0].splitlines()
        assert head[0] == f"# {text['Title']}"
        for key, value in settings.items():
            assert f"# {key} = {value}" in head
            assert f"{key} = {value}" in text["Description"]
    assert "the paper's" in PIL.Image.open(out / "fig6_positions.png").text["loop"]


def test_the_data_are_those_of_the_figure(written):
    out, _ = written
    sol = ball.simulate_ball(zivi.ThetaGamma(ball.H))
    data = rows(out / "fig4_x_xdot.csv")
    np.testing.assert_array_equal([float(row["x"]) for row in data], sol.x)
    np.testing.assert_array_equal([float(row["xdot"]) for row in data], sol.xdot)
    run = track(sampled=False)
    data = rows(out / "fig8_control.csv")
    np.testing.assert_array_equal([float(row["u"]) for row in data], run.u)
    data = rows(out / "tracking_signs.csv")
    np.testing.assert_array_equal([float(row["lambda_es"]) for row in data], run.signs[:, 4])
    data = rows(out / "tracking_loops_sampled_nearest.csv")
    np.testing.assert_array_equal([float(row["x_ref"]) for row in data], track("nearest").x_ref)


def test_one_stage_alone_and_quietly(tmp_path):
    result = paper(tmp_path, "--only", "regulator", "--quiet")
    assert (result.exit_code, result.output.splitlines()) == (0, ["9 of 9 agree"])
    assert sorted(path.name for path in tmp_path.glob("*.png")) == [
        "fig5_regulator_sv_plane.png",
        "regulator_over_time.png",
    ]
    result = paper(tmp_path / "none", "--only", "ball", "--only", "balls")
    assert result.exit_code == 2
    assert "--only must be one of ball, regulator" in result.output
    assert "'balls'" in result.output
    assert not (tmp_path / "none").exists()


def test_the_stages_are_reported(tmp_path, monkeypatch):
    said = []
    monkeypatch.setattr(
        write, "STAGES", dict.fromkeys(write.STAGES, lambda folder, found: said.append(found))
    )
    write.write(tmp_path, only=["tracker", "ball"], report=lambda *stage: said.append(stage))
    assert said[::2] == [("ball", 0, 2), ("tracker", 1, 2), ("", 2, 2)]


def test_a_number_that_is_off_fails(tmp_path, monkeypatch):
    wrong = [Check("a number", 1.0, 2.0, "exact", 0.5), Check("no number", np.nan, 0.0, "exact", 1)]
    monkeypatch.setattr(ball, "check_ball", lambda sol: wrong)
    result = paper(tmp_path, "--only", "ball", "--only", "regulator")
    assert result.exit_code == 1
    assert result.output.splitlines()[-1] == "9 of 11 agree"
    verdicts = [row["ok"] for row in rows(tmp_path / "checks.csv")]
    assert verdicts == ["NO"] * 2 + ["yes"] * 9


def test_the_checks_notice_a_wrong_scheme():
    coarse = ball.simulate_ball(zivi.ThetaGamma(3 * ball.H))
    chattering = ball.simulate_ball(zivi.ExplicitEuler(ball.H))
    assert not all(check.ok for check in ball.check_ball(coarse))
    assert not all(check.ok for check in ball.check_ball(chattering))


def test_what_the_page_on_the_paper_says_of_the_ball():
    rests = [ball.simulate_ball(zivi.ThetaGamma(h)).rest_time for h in (9e-4, 7e-4, 6e-4, 5e-4)]
    assert (min(rests), max(rests)) == pytest.approx((2.448, 2.453), abs=6e-4)
    sol = ball.simulate_ball(zivi.ThetaGamma(ball.H))
    first = [
        sol.t[np.argmax(signs < 1)]
        for signs in (sol.transformed.lambda_s, sol.transformed.lambda_v)
    ]
    assert first == pytest.approx([1.372, 0.612])
    assert first == pytest.approx(
        [sol.resolved_impacts["t"][0], ball.XDOT0 / ball.GRAVITY], abs=2 * ball.H
    )
