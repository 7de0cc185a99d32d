"""The pictures of examples that are kept, and that the comparison with them can fail."""

import copy
import re
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pytest

import figure_data

EXAMPLES = figure_data.ROOT / "examples"
OTHERS = {"every_plot", "cluster_study"}
"""Pictures of a panel of panels and of contours: their words and limits are compared."""
PICTURES = sorted(
    path
    for path in figure_data.FIGURES.glob("*.png")
    if path.stem in figure_data.KEPT or (EXAMPLES / f"{path.stem}.py").exists()
)


@pytest.mark.parametrize("path", PICTURES, ids=lambda it: it.stem)
def test_pictures_of_examples_say_what_they_show(path):
    panels = figure_data.kept(path)
    assert panels, f"{path.name}: make picture"
    shown = [it for panel in panels for kind in ("lines", "clouds", "images") for it in panel[kind]]
    assert shown or path.stem in OTHERS


def test_tests_draw_the_pictures():
    tests = "".join(it.read_text() for it in Path(__file__).parent.glob("test_*.py"))
    for path in PICTURES:
        name = figure_data.KEPT.get(path.stem, path.stem)
        script = next((it for it, n in figure_data.ARGUMENTS.items() if f"{name}.png" in n), name)
        assert name.startswith("mechanics_") or re.search(rf'"{script}"', tests), name


@pytest.fixture
def drawn():
    _, (left, right) = plt.subplots(1, 2)
    t = np.linspace(0, 1, 50)
    left.plot(t, np.sin(t), label="x")
    left.set(title="A motion", xlabel="t (s)")
    left.legend()
    right.scatter(t, t**2)
    right.imshow(np.outer(t, t), extent=(0, 1, 0, 1))
    return left.figure


def test_the_same_figure_is_the_same(drawn):
    first = figure_data.drawn(drawn)
    assert len(first) == 2
    assert figure_data.differences(first, figure_data.drawn(drawn)) == []
    assert figure_data.differences(first, None)


@pytest.mark.parametrize(
    "change",
    [
        lambda left, right: left.set_title("Another"),
        lambda left, right: left.lines[0].set_ydata(1.1 * left.lines[0].get_ydata()),
        lambda left, right: left.plot([0, 1], [0, 1]),
        lambda left, right: left.set_xlim(0, 2),
        lambda left, right: left.legend(["y"]),
        lambda left, right: left.get_legend().remove(),
        lambda left, right: right.images[0].set_data(np.ones((50, 50))),
        lambda left, right: right.collections[0].set_offsets([[0.1, 0.2], [0.3, 0.9]]),
        lambda left, right: right.remove(),
    ],
    ids=["title", "line", "one more", "limits", "legend", "none", "image", "cloud", "panel"],
)
def test_another_figure_is_not(drawn, change):
    before = copy.deepcopy(figure_data.drawn(drawn))
    change(*drawn.axes)
    assert figure_data.differences(before, figure_data.drawn(drawn))


def test_a_script_that_draws_something_else_fails(tmp_path, monkeypatch):
    code = compile(
        "import matplotlib.pyplot as plt\nplt.plot([0, 1])\nplt.gcf().savefig(path)",
        str(EXAMPLES / "hammer.py"),
        "exec",
    )
    with pytest.raises(AssertionError, match=r"hammer\.png shows something else: make picture"):
        exec(code, {"path": str(tmp_path / "out.png")})
    assert (tmp_path / "out.png").exists()
