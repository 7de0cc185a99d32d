"""The README is a promise: its snippet runs, its numbers are computed again, its links exist."""

import importlib
import math
import re
import tomllib
from pathlib import Path

import pytest

import zivi
from closed_form import Ball
from page_blocks import run

ROOT = Path(__file__).parents[1]
README = (ROOT / "README.md").read_text()


@pytest.fixture
def table() -> dict[str, str]:
    rows = re.findall(r"^\| \*\*(.+?)\*\* \| (.+) \|$", README, re.MULTILINE)
    return dict(rows)


def ball(h):
    system = zivi.ImpactSystem(-9.81, kappa=0.41)
    return zivi.simulate(system, (0, 4), (1, 6), method=zivi.ThetaGamma(h=h))


def test_the_snippet_runs_as_it_stands(tmp_path, monkeypatch):
    import matplotlib.pyplot as plt

    snippet, *_ = re.findall(r"```python\n(.*?)```", README, re.DOTALL)
    assert sum(bool(line.strip()) for line in snippet.splitlines()) <= 8
    monkeypatch.chdir(tmp_path)
    names: dict = {}
    run(snippet, names)
    plt.close("all")
    assert (tmp_path / "ball.png").stat().st_size > 1000
    (printed,) = re.findall(r"rest_time\)  # (\d+\.\d+) = 3 sqrt\(2/9.81\):", snippet)
    assert f"{3 * math.sqrt(2 / 9.81):.12f}" == printed


def test_its_size_and_what_comes_first():
    assert len(README.splitlines()) <= 130
    assert len(README.split()) <= 1150
    assert README.index("pip install '.[all]'") < README.index("```python") < README.index("## ")


def test_what_comes_first_can_be_installed():
    """No package index has zivi yet: both pages begin with what works in a clone."""
    for page in (README, (ROOT / "docs" / "install.md").read_text()):
        first, *_ = re.findall(r"^pip install (\S+)", page, re.MULTILINE)
        assert first == "'.[all]'"
        assert "No package index has zivi yet" in " ".join(page.split())


def test_extras_that_it_names_exist():
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"][
        "optional-dependencies"
    ]
    for named in re.findall(r"(?:zivi|\.)\[([\w,]+)\]", README):
        assert set(named.split(",")) <= set(extras)


def run_section(title, monkeypatch, tmp_path):
    """Names and text of the snippet of a section, run after `import zivi`."""
    import matplotlib.pyplot as plt

    section = README.split(f"## {title}\n")[1].split("\n## ")[0]
    (snippet,) = re.findall(r"```python\n(.*?)```", section, re.DOTALL)
    monkeypatch.chdir(tmp_path)
    names = {"zivi": zivi}
    run(snippet, names)
    plt.close("all")
    return names, snippet


def test_the_mechanical_system(monkeypatch, tmp_path):
    """Times to the digits printed; those of the machine itself are held to references elsewhere."""
    names, snippet = run_section("Mechanical systems", monkeypatch, tmp_path)
    zeno, liftoffs = (
        [float(t) for t in times.split(",")] for times in re.findall(r"# ([\d., ]+):", snippet)
    )
    tight = zivi.simulate(names["pendulum"], (0, 5), ([0.5, 0.5], [0, 0]), zivi.SwitchedRK(1e-11))
    for sol, tol in ((tight, 6e-7), (names["swing"], 1e-5)):
        assert sol.zeno["t"] == pytest.approx(zeno, abs=tol)
        assert sol.liftoffs["t"] == pytest.approx(liftoffs, abs=tol)


def test_derivatives_and_orbits(monkeypatch, tmp_path):
    names, snippet = run_section("Derivatives and orbits", monkeypatch, tmp_path)
    # t_inf = sqrt(2 x0/g) (1 + e)/(1 - e)
    x0, g, e = 1.0, 9.81, 0.5
    by_x0 = (1 + e) / (1 - e) / math.sqrt(2 * g * x0)
    by_e = 2 * math.sqrt(2 * x0 / g) / (1 - e) ** 2
    printed = [float(number) for number in re.findall(r"\[\[(\S+) (\S+)\]\]", snippet)[0]]
    assert printed == pytest.approx([by_x0, by_e], abs=1e-8)
    assert names["result"].zeno_times[0] == pytest.approx([by_x0, by_e], rel=1e-7)
    # fold at F = pi (1 - e)/(1 + e); doubling at F^2 = that^2 + (2 (1 + e^2)/(1 + e)^2)^2
    fold = math.pi * (1 - e) / (1 + e)
    doubling = math.hypot(fold, 2 * (1 + e**2) / (1 + e) ** 2)
    told = dict(re.findall(r"(fold|period_doubling) (\d\.\d+)", snippet))
    found = {event.kind: event.value for event in names["branch"].events}
    for kind, value in {"fold": fold, "period_doubling": doubling}.items():
        assert float(told[kind]) == pytest.approx(value, abs=1e-9)
        assert found[kind] == pytest.approx(value, abs=1e-9)


def test_what_the_default_promises(table):
    """The errors on the references are those of the results, which have a test of their own."""
    row = table["Other forces"]
    page = (ROOT / "benchmarks" / "results" / "accuracy.md").read_text()
    promises = re.findall(r"(\d\.\d) `rtol` at (1e-\d)", row)
    assert len(promises) == 2
    for printed, rtol in promises:
        cells = re.search(rf"^\| {rtol} \| (\S+) \| (\S+) \| (\S+) \|", page, re.MULTILINE)
        assert max(map(float, cells.groups())) == pytest.approx(float(printed), abs=0.05)


def test_rest_and_impacts_are_exact():
    sol = zivi.simulate(zivi.ImpactSystem(-9.81, kappa=0.41), (0, 4), (1, 6))
    assert sol.rest_time == pytest.approx(Ball.of_kappa(1, 6, kappa=0.41).zeno, abs=6e-16)
    still = sol.t > sol.rest_time
    assert not sol.x[still].any()
    assert not sol.xdot[still].any()
    assert sol.x.min() >= 0
    e = (1 - 0.41) / (1 + 0.41)
    impacts = sol.impacts
    assert impacts["xdot_after"] == pytest.approx(-e * impacts["xdot_before"], rel=1e-15)


def test_a_delayed_loop_rests_with_its_horizon():
    for d in (0, 1, 3):
        tracker = zivi.TwistingTracker(30, 17, h=1e-3, e=0.8, ahead=1 + d)
        ball = zivi.ImpactSystem(-9.81, e=0.8)
        run = zivi.simulate_closed_loop(ball, tracker, (0, 6), (1, 0), delay=d)
        assert run.rest_time is not None


def test_its_make_commands_are_targets():
    named = set(re.findall(r"`make (\w+)", README))
    assert named == {"paper", "test"}
    makefile = (ROOT / "Makefile").read_text()
    for target in named:
        assert re.search(rf"^{target}:", makefile, re.MULTILINE)


def test_its_shell_commands_run(tmp_path, monkeypatch):
    testing = pytest.importorskip("typer.testing")
    pytest.importorskip("h5netcdf")
    cli = importlib.import_module("zivi.cli")
    monkeypatch.chdir(tmp_path)
    commands = re.findall(r"`zivi (.+?)`", README)
    assert [command.split()[0] for command in commands] == ["simulate", "simulate", "show"]
    for command in commands:
        arguments, _, file = command.partition(" > ")
        done = testing.CliRunner().invoke(cli.app, arguments.split())
        assert done.exit_code == 0, (command, done.output)
        if file:
            (tmp_path / file).write_text(done.stdout)


def test_the_ball_of_the_figure():
    caption = re.search(r"^\*Another ball, (.*?)\*$", README, re.MULTILINE | re.DOTALL)[1]
    speed, height, zeno = re.findall(r"(\d[\d.]*) (?:m/s|m,|s\n)", caption)
    assert (float(speed), float(height)) == (6.0, 1.0)
    assert float(zeno) == pytest.approx(Ball.of_kappa(1.0, 6.0, kappa=0.41).zeno, abs=5e-5)


def test_the_first_order_errors(table):
    exact = 1.0 + 6.0 - 9.81 / 2
    printed = [
        float(x) for x in re.findall(r"(\d\.\de-\d),? ", table["Fixed steps (`ThetaGamma`)"])[:3]
    ]
    assert len(printed) == 3
    for h, error in zip([1e-2, 1e-3, 1e-4], printed, strict=True):
        assert abs(ball(h)([1.0])[0, 0] - exact) == pytest.approx(error, rel=0.02)


def test_the_rest_times(table):
    row = table["Fixed steps (`ThetaGamma`)"].split("converges")[1]
    *printed, exact = [float(x) for x in re.findall(r"2\.\d+", row)]
    assert printed == [2.34, 2.444, 2.4626]
    for h, rest in zip([1e-2, 1e-3, 1e-4], printed, strict=True):
        assert ball(h).rest_time == pytest.approx(rest, abs=1e-9)
    assert exact == pytest.approx(Ball.of_kappa(1.0, 6.0, kappa=0.41).zeno, abs=1e-14)


def test_every_link_leads_somewhere():
    for target in re.findall(r"\]\(([^)#:]+)(?:#[^)]*)?\)", README):
        assert (ROOT / target).exists(), target
