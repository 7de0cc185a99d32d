"""The README is a promise: its snippet runs, its numbers are computed again, its links exist."""

import math
import re
from pathlib import Path

import pytest

import zivi
from closed_form import Ball

ROOT = Path(__file__).parents[1]
README = (ROOT / "README.md").read_text()


@pytest.fixture
def table() -> dict[str, str]:
    rows = re.findall(r"^\| \*\*(.+?)\*\* \| (.+) \|$", README, re.MULTILINE)
    return dict(rows)


def ball(h):
    system = zivi.ImpactSystem(-9.81, kappa=0.41)
    return zivi.simulate(system, (0, 4), (1, 6), method=zivi.ThetaGamma(h=h))


def test_the_snippet_runs_as_it_stands(tmp_path, monkeypatch, capsys):
    import matplotlib.pyplot as plt

    snippet, *_ = re.findall(r"```python\n(.*?)```", README, re.DOTALL)
    assert 8 <= sum(bool(line.strip()) for line in snippet.splitlines()) <= 12
    monkeypatch.chdir(tmp_path)
    names: dict = {}
    exec(compile(snippet, "README.md", "exec"), names)
    plt.close("all")
    assert (tmp_path / "ball.png").stat().st_size > 1000
    (printed,) = re.findall(r"rest_time\)  # (\d+\.\d+) = 3 sqrt\(2/9.81\):", snippet)
    assert names["sol"].rest_time == float(printed)
    assert 3 * math.sqrt(2 / 9.81) == pytest.approx(float(printed), abs=1e-15)
    assert printed[:-2] in capsys.readouterr().out


def run_section(title, monkeypatch, tmp_path):
    """Names and text of the snippet of a section, run after `import zivi`."""
    import matplotlib.pyplot as plt

    section = README.split(f"## {title}\n")[1].split("\n## ")[0]
    (snippet,) = re.findall(r"```python\n(.*?)```", section, re.DOTALL)
    monkeypatch.chdir(tmp_path)
    names = {"zivi": zivi}
    exec(compile(snippet, "README.md", "exec"), names)
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
    assert names["slopes"].zeno_times[0] == pytest.approx([by_x0, by_e], rel=1e-7)
    # fold at F = pi (1 - e)/(1 + e); doubling at F^2 = that^2 + (2 (1 + e^2)/(1 + e)^2)^2
    fold = math.pi * (1 - e) / (1 + e)
    doubling = math.hypot(fold, 2 * (1 + e**2) / (1 + e) ** 2)
    told = dict(re.findall(r"(fold|period_doubling) (\d\.\d+)", snippet))
    found = {event.kind: event.value for event in names["branch"].events}
    for kind, value in {"fold": fold, "period_doubling": doubling}.items():
        assert float(told[kind]) == pytest.approx(value, abs=1e-9)
        assert found[kind] == pytest.approx(value, abs=1e-9)


def test_what_the_default_promises(table):
    """The errors on the references are those of the page on the methods, which has its own test."""
    row = table["To the tolerance"]
    page = (ROOT / "docs" / "methods.md").read_text()
    for printed, rtol in re.findall(r"(\d\.\d) `rtol` at (1e-\d)", row):
        cells = re.search(rf"^\| {rtol} \| (\S+) \| (\S+) \| (\S+) \|", page, re.MULTILINE)
        assert max(map(float, cells.groups())) == pytest.approx(float(printed), abs=0.05)
    system = zivi.ImpactSystem(-9.81, kappa=0.41)
    sol = zivi.simulate(system, (0, 4), (1, 6), zivi.SwitchedRK(flights="rk"))
    rest, nfev = re.findall(r"rest at (\S+) s after (\d+) evaluations", row)[0]
    assert sol.rest_time == pytest.approx(float(rest), abs=1e-13)
    assert sol.nfev == int(nfev)


def test_what_it_promises_to_rounding(table):
    """The references have a test of their own."""
    row = table["To rounding"]
    rest, nfev = re.findall(r"rest at (\S+) s, 2e-16 s from the exact time, after (\d+)", row)[0]
    for rtol in (1e-4, 1e-12):
        method = zivi.SwitchedRK(rtol)
        sol = zivi.simulate(zivi.ImpactSystem(-9.81, kappa=0.41), (0, 4), (1, 6), method)
        assert sol.rest_time == pytest.approx(float(rest), abs=6e-16)
        assert sol.rest_time == pytest.approx(Ball.of_kappa(1, 6, kappa=0.41).zeno, abs=6e-16)
        assert sol.nfev == int(nfev)


def test_the_limits_are_those_of_the_page(table):
    page = (ROOT / "docs" / "methods.md").read_text()
    impacts, e = re.findall(r"\((\d+) impacts at `e = (\S+)`\)", table["Limits"])[0]
    assert re.search(rf"^\| {e} \| \S+ \| {impacts} \|", page, re.MULTILINE)
    with pytest.raises(ValueError, match="e must be > 0"):
        zivi.simulate(zivi.ImpactSystem(-9.81, e=0), (0, 1), (1, 0), zivi.ThetaGamma(1e-2))


def test_the_two_commands_are_targets():
    (commands,) = re.findall(r"```sh\n(.*?)```", README, re.DOTALL)
    makefile = (ROOT / "Makefile").read_text()
    for command in re.findall(r"^make (\w+)", commands, re.MULTILINE):
        assert re.search(rf"^{command}:", makefile, re.MULTILINE)


def test_the_first_order_errors(table):
    exact = 1.0 + 6.0 - 9.81 / 2
    printed = [float(x) for x in re.findall(r"(\d\.\de-\d),? ", table["First order"])[:3]]
    assert len(printed) == 3
    for h, error in zip([1e-2, 1e-3, 1e-4], printed, strict=True):
        assert abs(ball(h)([1.0])[0, 0] - exact) == pytest.approx(error, rel=0.02)


def test_the_rest_times(table):
    row = table["Slower than first order"]
    printed = [float(x) for x in re.findall(r"2\.\d+", row)]
    assert printed == [2.34, 2.444, 2.4626]
    for h, rest in zip([1e-2, 1e-3, 1e-4], printed, strict=True):
        assert ball(h).rest_time == pytest.approx(rest, abs=1e-9)


def test_the_exact_zeno_point():
    zeno = Ball.of_kappa(1.0, 6.0, kappa=0.41).zeno
    (printed,) = re.findall(r"Zeno point is at (\d\.\d+) s", README)
    assert float(printed) == pytest.approx(zeno, abs=1e-14)


def test_every_link_leads_somewhere():
    for target in re.findall(r"\]\(([^)#:]+)(?:#[^)]*)?\)", README):
        assert (ROOT / target).exists(), target
