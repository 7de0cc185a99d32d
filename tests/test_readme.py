"""The README is a promise: its snippet runs, its numbers are computed again, its links exist."""

import re
from pathlib import Path

import pytest

import zivi

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

    (snippet,) = re.findall(r"```python\n(.*?)```", README, re.DOTALL)
    assert 8 <= sum(bool(line.strip()) for line in snippet.splitlines()) <= 12
    monkeypatch.chdir(tmp_path)
    names: dict = {}
    exec(compile(snippet, "README.md", "exec"), names)
    plt.close("all")
    assert (tmp_path / "ball.png").stat().st_size > 1000
    assert names["sol"].rest_time == pytest.approx(2.444, abs=1e-12)
    assert "2.444" in capsys.readouterr().out


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
    e, speed = 0.59 / 1.41, (36 + 2 * 9.81) ** 0.5
    zeno = (6 + speed) / 9.81 + 2 * e * speed / (9.81 * (1 - e))
    (printed,) = re.findall(r"Zeno point is at (\d\.\d+) s", README)
    assert float(printed) == pytest.approx(zeno, abs=5e-5)


def test_every_link_leads_somewhere():
    for target in re.findall(r"\]\(([^)#:]+)(?:#[^)]*)?\)", README):
        assert (ROOT / target).exists(), target
