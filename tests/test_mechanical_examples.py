"""The examples of mechanical systems: what they print agrees with what they expect."""

import re
from pathlib import Path

import pytest

from example_scripts import example

pytest.importorskip("sympy")
pytest.importorskip("matplotlib")

pytestmark = [pytest.mark.slow, pytest.mark.xdist_group("mechanical models")]

NAMES = sorted(
    path.stem for path in (Path(__file__).parents[1] / "examples").glob("mechanics_*.py")
)


@pytest.mark.parametrize("name", NAMES)
def test_every_number_is_the_expected_one(name, tmp_path, capsys):
    path = tmp_path / "out.png"
    example(name).main(str(path))
    assert path.stat().st_size > 10_000
    pairs = re.findall(r"(\d+\.\d{4,})[^(\d]*\((\d+\.\d{4,})\)", capsys.readouterr().out)
    assert len(pairs) >= 2
    for found, expected in pairs:
        digits = len(expected.split(".")[1])
        assert float(found) == pytest.approx(float(expected), abs=1.5 * 10.0**-digits)


def test_the_hopper_and_the_arm_touch_when_mujoco_says(tmp_path, capsys):
    pytest.importorskip("mujoco")
    models = example("mujoco_hopper_arm")
    models.main(str(tmp_path / "out.png"))
    assert (tmp_path / "out.png").stat().st_size > 10_000
    told = capsys.readouterr().out
    pairs = re.findall(r"(\d+\.\d{4,})[^(\d]*\((\d+\.\d{4,})\)", told)
    assert len(pairs) == 3
    for found, expected in pairs:
        assert float(found) == pytest.approx(float(expected), abs=1.5e-9)
    soft = [float(it) for it in re.findall(r"least distance (-\d+\.\d+) mm", told)]
    assert len(soft) == 2
    assert max(soft) < -5.0
    for name in models.MODELS:
        sol = models.run(name)
        assert sol.gaps.min() >= 0.0
        assert sol.success


def test_the_hopper_stands_where_friction_holds_it(tmp_path, capsys):
    pytest.importorskip("mujoco")
    models = example("mujoco_standing_hopper")
    models.main(str(tmp_path / "out.png"))
    assert (tmp_path / "out.png").stat().st_size > 10_000
    told = capsys.readouterr().out
    pairs = re.findall(r"(\d+\.\d{4,})[^(\d]*\((\d+\.\d{4,})\)", told)
    assert len(pairs) == 4
    for found, expected in pairs:
        digits = len(expected.split(".")[1])
        assert float(found) == pytest.approx(float(expected), abs=1.5 * 10.0**-digits)
    assert told.count("largest slip while it sticks 0.0 m/s (0)") == 2


def test_the_pages_show_all_of_them():
    gallery = (Path(__file__).parents[1] / "docs" / "gallery.md").read_text()
    assert all(f"../examples/{name}.py)" in gallery for name in NAMES)
    assert len(NAMES) >= 6
