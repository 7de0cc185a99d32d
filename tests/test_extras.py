"""NumPy is all that zivi needs; what an extra brings is asked for when it is used."""

import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

import zivi
from inside import EXTRAS

ROOT = Path(__file__).parents[1]

BARE = """
import sys

class Refuse:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in {refused!r}:
            raise ModuleNotFoundError(f"No module named {{name!r}}", name=name)

sys.meta_path.insert(0, Refuse())
import zivi
ball = zivi.ImpactSystem(-9.81, e=0.5)
sol = zivi.simulate(ball, (0, 3), (1, 0))
"""


def bare(code):
    """Run code in an interpreter that has NumPy only."""
    program = BARE.format(refused=set(EXTRAS)) + code
    return subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=False, timeout=60
    )


def test_numpy_is_enough():
    done = bare(
        "run = zivi.simulate_closed_loop(ball, zivi.TwistingRegulator(30, 17, h=1e-3, e=.5),"
        " (0, 1), (1, 0))\n"
        "batch = zivi.simulate_batch(ball, (0, 3), [[1, 0], [2, 0]], method=zivi.SwitchedRK())\n"
        "assert zivi.solve_avi([[2.0]], [-1.0], [0.0], [10.0]).success\n"
        "print(sol.rest_time, run.success, batch.success.all())"
    )
    assert done.stderr == ""
    assert done.stdout.split()[1:] == ["True", "True"]
    assert float(done.stdout.split()[0]) == pytest.approx(1.3545709229571772)


@pytest.mark.parametrize(
    ("code", "extra"),
    [
        ("sol.to_xarray()", "xarray"),
        ("zivi.plot.position(sol)", "plot"),
        ("zivi.simulate(ball, (0, 3), (1, 0), progress=True)", "cli"),
        ("zivi.files.save(sol, 'ball.nc')", "files"),
        ("zivi.sample('sobol', 4, {'a': (0, 1)})", "study"),
        ("zivi.interop.impact_plant(ball, 0.01)", "control"),
    ],
)
def test_what_is_missing_is_named_in_one_line(code, extra):
    done = bare(f"try:\n    {code}\nexcept ImportError as error:\n    print(error)\n")
    assert done.stderr == ""
    assert f"pip install 'zivi[{extra}]'" in done.stdout
    assert done.stdout.count("\n") == 1


def test_the_command_says_what_it_needs():
    done = bare("import sys; sys.argv = ['zivi', '--version']\nimport zivi.__main__ as m; m.main()")
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr.startswith(
        "zivi: the commands of zivi need typer, rich: pip install 'zivi[cli]'"
    )
    assert done.stderr.count("\n") == 1


def test_the_command_runs_as_a_module():
    done = subprocess.run(
        [sys.executable, "-m", "zivi", "--version"], capture_output=True, text=True, check=True
    )
    assert done.stdout == f"zivi {zivi.__version__}\n"


def test_every_extra_is_an_extra_of_the_package():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    extras = project["optional-dependencies"]
    assert [it.partition(">")[0] for it in project["dependencies"]] == ["numpy"]
    assert set(EXTRAS.values()) <= set(extras)
    everything = extras["all"][0].removeprefix("zivi[").removesuffix("]").split(",")
    assert set(everything) == set(extras) - {"all", "test", "lint", "docs", "mujoco"}
    for library, extra in EXTRAS.items():
        brought = " ".join(extras[extra])
        assert library in brought or library == "pandas", library  # xarray brings pandas


def test_modules_are_attributes():
    for name in ("files", "interop", "lab", "study"):
        assert name in dir(zivi)
        assert getattr(zivi, name).__name__ == f"zivi.{name}"
    with pytest.raises(AttributeError, match="has no attribute 'nothing'"):
        zivi.nothing  # noqa: B018
