"""`zivi paper`: what it writes, what it checks, and that it fails when a number is off."""

import csv

import matplotlib.image
import numpy as np
import pytest
from typer.testing import CliRunner

import zivi
from zivi.cli import app
from zivi.paper import Check, ball, rest, robustness, siconos
from zivi.paper.closed_loops import track

pytestmark = [pytest.mark.slow, pytest.mark.xdist_group("paper")]

FIGURES = (
    "fig1_transformed_state",
    "fig2_position_velocity",
    "fig3_phase_plane",
    "fig4_multipliers",
    "explicit_and_implicit",
    "fig5_regulator",
    "fig6_tracking",
    "fig7_errors",
    "fig8_control_and_signs",
    "tracking_loops",
    "chattering",
)


@pytest.fixture(scope="module", autouse=True)
def _without_siconos():
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(siconos, "interpreter", lambda: None)
        yield


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """What the command said, and the folder that it made."""
    out = tmp_path_factory.mktemp("paper") / "new" / "folder"
    return CliRunner().invoke(app, ["paper", "--out", str(out)]), out


def rows(path):
    with path.open() as file:
        return list(csv.DictReader(file))


def test_it_writes_figures_data_and_tables(written):
    result, out = written
    assert result.exit_code == 0, result.output
    for name in FIGURES:
        picture = matplotlib.image.imread(out / f"{name}.png")
        assert min(picture.shape[:2]) > 500
        assert picture[..., :3].std() > 0.01
    checks = rows(out / "checks.csv")
    assert len(checks) >= 39
    assert all(row["ok"] == "yes" for row in checks)
    assert any(row["paper"] == "about 2.45" for row in checks)
    assert len(rows(out / "linearisation.csv")) == 5 * 17 + 7 * 11
    assert len(rows(out / "chattering.csv")) == 4 * 3 * 3
    assert len(rows(out / "robustness.csv")) == 2 * len(robustness.DISTURBANCES)
    assert len(rows(out / "rest.csv")) == len(rest.RESTITUTIONS)
    for title in (
        "Checked numbers",
        "Explicit and implicit signs",
        "under disturbances",
        "rest of",
    ):
        assert title in result.output


def test_the_data_are_those_of_the_figure(written):
    _, out = written
    sol = ball.run(zivi.ThetaGamma(ball.H))
    data = rows(out / "fig2_position_velocity.csv")
    np.testing.assert_array_equal([float(row["x"]) for row in data], sol.x)
    np.testing.assert_array_equal([float(row["xdot"]) for row in data], sol.xdot)
    run = track(sampled=False)
    data = rows(out / "fig8_control_and_signs.csv")
    np.testing.assert_array_equal([float(row["u"]) for row in data], run.u)
    np.testing.assert_array_equal([float(row["lambda_es"]) for row in data], run.signs[:, 4])
    data = rows(out / "tracking_loops_sampled_nearest.csv")
    np.testing.assert_array_equal([float(row["x_ref"]) for row in data], track("nearest").x_ref)
    assert "x_ref" not in rows(out / "fig5_regulator.csv")[0]


def test_a_number_that_is_off_fails(tmp_path, monkeypatch):
    wrong = [Check("a number", 1.0, 2.0, "exact", 0.5), Check("no number", np.nan, 0.0, "exact", 1)]
    monkeypatch.setattr(ball, "checks", lambda sol: wrong)
    result = CliRunner().invoke(app, ["paper", "--out", str(tmp_path)])
    assert result.exit_code == 1
    assert "off" in result.output
    verdicts = [row["ok"] for row in rows(tmp_path / "checks.csv")]
    assert verdicts[:2] == ["NO", "NO"]
    assert set(verdicts[2:]) == {"yes"}


def test_the_checks_notice_a_wrong_scheme():
    coarse = ball.run(zivi.ThetaGamma(3 * ball.H))
    chattering = ball.run(zivi.ExplicitEuler(ball.H))
    assert not all(check.ok for check in ball.checks(coarse))
    assert not all(check.ok for check in ball.checks(chattering))
