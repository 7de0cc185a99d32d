"""What a picture of an example draws, kept in it: ``python tests/figure_data.py [NAME ...]``.

The command makes the pictures of ``docs/figures`` anew, all or those of some scripts. While tests
run, each picture that a script of ``examples`` writes is compared with the one that is kept.
"""

from __future__ import annotations

import contextlib
import json
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import matplotlib.figure
import numpy as np
import PIL.Image

from golden.solvers import read
from golden.trace import libm

ROOT = Path(__file__).resolve().parents[1]
FIGURES = ROOT / "docs" / "figures"
KEY = "zivi: drawn"
ARGUMENTS = {"readme_picture": ["zeno.png"], "readme_tracking": ["tracking.png", "chattering.png"]}
"""Scripts with pictures of other names."""
KEPT = {Path(it).stem: Path(it).stem for names in ARGUMENTS.values() for it in names}
NOT_COMPARED = {"large_vi"}
"""Scripts that tests run with less than the picture shows."""
POINTS = 9
"""Of a line or a cloud of points; in parts of its panel."""
COMPARED = read()[0] == libm()
"""Motions that are chaotic are the same where the functions of the C library are."""
CLOSE = 0.01
"""Largest difference of what is the same, in parts of the panel."""


def places(ax: Any, xy: Any) -> list[float]:
    """Give some of many points, x then y, in parts of a panel."""
    xy = np.ma.filled(np.ma.asarray(xy, dtype=float), np.nan)
    xy = xy[np.isfinite(xy).all(axis=1)]
    if not len(xy):
        return []
    some = xy[np.linspace(0, len(xy) - 1, POINTS).round().astype(int)]
    parts = ax.transAxes.inverted().transform(ax.transData.transform(some))
    return [round(float(it), 4) for it in np.clip(parts, -1.0, 2.0).T.ravel()]


def panel(ax: Any) -> dict[str, Any]:
    """Give what a panel says and shows."""
    legend = ax.get_legend()
    marks = [it for it in ax.lines if it.get_transform() == ax.transData]
    clouds = [it for it in ax.collections if len(it.get_offsets()) > 1]
    images = [np.ma.filled(it.get_array(), 0.0) for it in ax.images]
    return {
        "words": [ax.get_title(), ax.get_xlabel(), ax.get_ylabel()],
        "legend": [it.get_text() for it in legend.get_texts()] if legend else [],
        "limits": [float(f"{it:.5g}") for it in (*ax.get_xlim(), *ax.get_ylim())],
        "lines": [places(ax, it.get_xydata()) for it in marks],
        "clouds": [places(ax, it.get_offsets()) for it in clouds],
        "images": [[*it.shape, float(f"{np.mean(it):.3g}")] for it in images],
    }


def drawn(figure: Any) -> list[dict[str, Any]]:
    """Give what the panels of a figure show."""
    figure.draw_without_rendering()
    return [panel(ax) for ax in figure.axes]


def kept(path: Path) -> list[dict[str, Any]] | None:
    """Give what a picture says that it shows."""
    with PIL.Image.open(path) as picture:
        text = picture.info.get(KEY)
    return None if text is None else json.loads(text)


def differences(one: Any, other: Any, where: str = "") -> list[str]:
    """Tell where two figures differ."""
    if isinstance(one, dict):
        return [it for key in one for it in differences(one[key], other[key], f"{where} {key}")]
    if isinstance(one, list) and isinstance(other, list) and len(one) == len(other):
        if one and where.endswith("limits"):
            close = CLOSE * np.repeat(np.abs(np.diff(np.reshape(one, (2, 2)))), 2)
            return [where] if np.any(np.abs(np.subtract(one, other)) > close) else []
        pairs = enumerate(zip(one, other, strict=True))
        return [it for k, (a, b) in pairs for it in differences(a, b, f"{where} {k}")]
    if isinstance(one, float) and isinstance(other, (int, float)):
        return [] if abs(one - other) <= CLOSE else [f"{where}: {one}, kept {other}"]
    return [] if one == other else [f"{where}: {one}, kept {other}"]


@contextlib.contextmanager
def watched(*, keep: bool = False) -> Iterator[list[str]]:
    """Compare each picture that a script writes with that of `docs/figures`, or keep it there.

    The list has the names of the pictures.
    """
    save, seen = matplotlib.figure.Figure.savefig, []

    def savefig(self: Any, path: Any, **more: Any) -> None:
        script = Path(sys._getframe(1).f_code.co_filename)
        if script.parent != ROOT / "examples":
            return save(self, path, **more)
        known = FIGURES / f"{KEPT.get(Path(path).stem, script.stem)}.png"
        seen.append(known.stem)
        if keep:
            return save(self, known, **more, metadata={KEY: json.dumps(drawn(self))})
        # nobody looks at this one: written fast
        fast = {"pil_kwargs": {"compress_level": 1}} if Path(path).suffix == ".png" else {}
        save(self, path, **fast, **more)
        if script.stem in NOT_COMPARED or not COMPARED or not known.exists():
            return None
        if wrong := differences([panel(ax) for ax in self.axes], kept(known)):
            raise AssertionError(f"{known.name} shows something else: make picture; {wrong[:5]}")
        return None

    matplotlib.figure.Figure.savefig = savefig
    try:
        yield seen
    finally:
        matplotlib.figure.Figure.savefig = save


def main(names: list[str]) -> None:
    """Make the pictures of some scripts, of all without a name."""
    matplotlib.use("Agg")
    from example_scripts import example

    scripts = {path.stem for path in (ROOT / "examples").glob("*.py")}
    pictures = {path.stem for path in FIGURES.glob("*.png")}
    with watched(keep=True) as made:
        for name in names or sorted((scripts & pictures) | set(ARGUMENTS)):
            example(name).main(*ARGUMENTS.get(name, [f"{name}.png"]))
    print(f"{FIGURES}: {', '.join(made)}")


if __name__ == "__main__":
    main(sys.argv[1:])
