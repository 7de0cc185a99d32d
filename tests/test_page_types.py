"""Code of the README and of the documentation as mypy and pyright see it.

A page is a module: its blocks one after the other, at their lines, with nothing before them. So is
a script that a page shows. A user annotates nothing, everything else is as strict as the package.
"""

import json
import os
import re
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import pytest

import generated

ROOT = Path(__file__).parents[1]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
BLOCK = re.compile(r"^```(?:\{code-cell\} )?python\n(.*?)^```$", re.DOTALL | re.MULTILINE)
# what mypy --strict asks of definitions, and of what other libraries leave open
OF_USERS = (
    *("disallow_untyped_calls", "disallow_untyped_defs", "disallow_incomplete_defs"),
    *("disallow_untyped_decorators", "disallow_any_generics", "warn_return_any"),
)

WRONG = """\
import zivi

ball = zivi.ImpactSystem(-9.81, restitution=0.5)
sol = zivi.simulate(zivi.ImpactSystem(-9.81, e=0.5), (0, 4), (1, 0))
sol.rest_times


class NoController:
    h = 1e-3


zivi.simulate_closed_loop(ball, NoController(), (0, 1), (1, 0))
"""
"""A page with mistakes in the lines 3, 5 and 12."""

CONTROLLER = """\
from dataclasses import dataclass

import numpy as np

import zivi
from zivi.interop import controller_block


@dataclass
class PD:
    gain: float
    h: float = 1e-3
    x_ref: float = 0.5

    def step(self, x: float, xdot: float, force: float) -> float:
        return self.gain * (self.x_ref - x) - 20.0 * xdot - force


class Advised:
    h = 1e-3

    def step(self, x: float, xdot: float, force: float, x_ref: float, t: float) -> np.float64:
        return np.float64(100.0 * (x_ref - x) - 20.0 * xdot - force + 0.0 * t)


plant = zivi.ImpactSystem(-9.81, e=0.5)
run = zivi.simulate_closed_loop(plant, PD(100.0), (0, 1), (1, 0))
run = zivi.simulate_closed_loop(plant, Advised(), (0, 1), (1, 0), reference=lambda t: (0.5, 0.0))
zivi.simulate_closed_loop_batch(plant, [PD(100.0), PD(200.0)], (0, 1), [(1, 0), (2, 0)], seed=1)
zivi.simulate_closed_loop_batch(
    plant, [PD(100.0), zivi.TwistingRegulator(30, 17, h=1e-3)], (0, 1), (1, 0)
)
controller_block(PD(100.0))
observer = zivi.ImpactObserver(0.5, 1e-3, noise=(1e-4, 1e-2))
late = zivi.simulate_closed_loop(plant, PD(100.0), (0, 1), (1, 0), observer=observer, delay=1)
print(late.rest_time + run.u[-1] + late.d_est[-1])
"""
"""A controller of the user's wherever one of zivi's is taken."""

pytestmark = [pytest.mark.slow, pytest.mark.xdist_group("page types")]


def module(text: str) -> str:
    """Code of a page at its lines; empty without any."""
    lines = [""] * text.count("\n")
    for block in BLOCK.finditer(text):
        first = text.count("\n", 0, block.start(1))
        code = block[1].splitlines()
        lines[first : first + len(code)] = code
    return "\n".join(lines).rstrip() + "\n" if any(lines) else ""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Folder with a package `pages`."""
    made = tmp_path_factory.mktemp("typed") / "pages"
    made.mkdir()
    (made / "__init__.py").touch()
    for page in PAGES:
        if code := module(page.read_text()):
            (made / f"{page.stem.lower()}.py").write_text(code)
    assert len(list(made.iterdir())) >= 20
    # scripts that pages of the gallery show
    for name in generated.listed():
        (made / f"{name}.py").write_text((ROOT / "examples" / f"{name}.py").read_text())
    (made / "wrong.py").write_text(WRONG)
    (made / "controller.py").write_text(CONTROLLER)
    return made.parent


def mypy(folder):
    """What mypy says, with the settings and the cache of `make lint`."""
    package = (ROOT / "pyproject.toml").read_text()
    package = package[package.index("[tool.mypy]") : package.index("[tool.pytest")]
    users = ["[[tool.mypy.overrides]]", 'module = "pages.*"', *(f"{it} = false" for it in OF_USERS)]
    (folder / "mypy.toml").write_text("\n".join([package, *users]))
    done = subprocess.run(
        [sys.executable, "-m", "mypy", "--config-file", folder / "mypy.toml", "-p", "pages"],
        cwd=ROOT,
        env=os.environ | {"MYPYPATH": f"{folder}{os.pathsep}{ROOT / 'python'}"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode in (0, 1), done.stderr
    lines = [line for line in done.stdout.splitlines() if ": error: " in line]
    return [line.partition(f"pages{os.sep}")[2] for line in lines]


def pyright(folder):
    """What pyright says."""
    # what a library without types does is not guessed from its defaults: nor does mypy
    settings = {"extraPaths": [str(ROOT / "python")], "useLibraryCodeForTypes": False}
    (folder / "pyrightconfig.json").write_text(json.dumps(settings))
    done = subprocess.run(
        [
            *(sys.executable, "-m", "pyright", "--outputjson", "--pythonpath", sys.executable),
            *("--project", folder),
        ],
        env=os.environ | {"PYRIGHT_PYTHON_IGNORE_WARNINGS": "1"},
        capture_output=True,
        text=True,
        check=False,
    )
    said = json.loads(done.stdout)
    assert said["summary"]["filesAnalyzed"] >= len(list(folder.rglob("*.py")))
    return [
        f"{Path(it['file']).name}:{it['range']['start']['line'] + 1}: {it['message']}"
        for it in said["generalDiagnostics"]
        if it["severity"] == "error"
    ]


@pytest.mark.parametrize("checker", [mypy, pyright], ids=["mypy", "pyright"])
def test_a_type_checker_finds_the_mistakes_and_nothing_on_a_page(folder, checker):
    if find_spec(checker.__name__) is None:
        pytest.skip(f"{checker.__name__} is not installed: it comes with the extra lint")
    said = checker(folder)
    mistakes = [line for line in said if line.startswith("wrong.py:")]
    assert {int(line.split(":")[1]) for line in mistakes} == {3, 5, 12}
    assert not (rest := [line for line in said if line not in mistakes]), "\n".join(rest)
