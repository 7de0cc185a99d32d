"""``zivi fmu FILE``: units of mechanical systems from the command line."""

import numpy as np
import pytest
from typer.testing import CliRunner

import zivi
from fmu_unit import Archive, Unit
from inside import files_commands as commands
from tree_models import ARM, URDF
from zivi.cli import app

pytestmark = pytest.mark.xdist_group("fmu")

BALL = "t_span = [0, 3]\ny0 = [1, 0]\n[system]\nforce = -9.81\ne = 0.5\n"


def run(*arguments, code=0):
    result = CliRunner().invoke(app, ["fmu", *(str(argument) for argument in arguments)])
    assert result.exit_code == code, result.output + repr(result.exception)
    assert "Traceback" not in result.output
    return result.output


def steps_as(tree, start, path, folder):
    """Whether a unit moves as the tree."""
    unit = Unit(Archive(path, folder)).start()
    names = [f"q_{name}" for name in tree.coordinate_names(2)]
    assert [unit.get(name) for name in names] == start
    assert unit.step(0.0, 1.5) == 0, unit.told
    close = zivi.SwitchedRK(rtol=1e-11, atol=1e-13)
    sol = zivi.simulate(tree, (0, 1.5), (start, [0.0, 0.0]), close)
    assert len(sol.impacts) > 2
    assert np.abs([unit.get(name) for name in names] - sol.q[-1]).max() < 1e-7
    unit.free()


def test_a_tree_of_a_file_is_a_unit(tmp_path):
    file, out = tmp_path / "arm.toml", tmp_path / "fmus"
    file.write_text(commands.example_file("tree"))
    told = run(file, "--out", out, "--name", "Arm", "--fmi", 3)
    assert told.split() == [str(out / "Arm3.fmu")]
    system, (q0, _) = zivi.files.mechanism_of(file)
    steps_as(system, q0, out / "Arm3.fmu", tmp_path / "unpacked")


def test_a_model_of_mujoco_is_a_unit(tmp_path):
    pytest.importorskip("mujoco")
    file, out = tmp_path / "arm.xml", tmp_path / "fmus"
    file.write_text(ARM)
    gaps = ("--gap", "elbow", "--gap", "tip,table", "--e", 0.5)
    told = run(file, "--out", out, *gaps, "--q0", 0, "--q0", 0.5)
    assert [line.rsplit("/", 1)[-1] for line in told.split()] == [
        "MechanicalSystem2.fmu",
        "MechanicalSystem3.fmu",
    ]
    tree = zivi.Tree.from_mjcf(file, gaps=["elbow", ("tip", "table")], e=0.5)
    steps_as(tree, [0.0, 0.5], out / "MechanicalSystem2.fmu", tmp_path / "unpacked")
    assert not run(file, "--out", out, "--quiet")


def test_a_model_of_urdf_is_read(tmp_path):
    pytest.importorskip("mujoco")
    file = tmp_path / "two.urdf"
    file.write_text(URDF)
    system, start = zivi.files.mechanism_of(file, gaps=["first"], e=[0.4], q0=[0.1, 0.2])
    assert start == ([0.1, 0.2], [0.0, 0.0])
    assert system.gap_names == ("first.lower", "first.upper")
    assert system.e.tolist() == [0.4, 0.4]
    assert system.parameters["tool.mass"] == 0.4


def test_what_is_wrong_is_named(tmp_path):
    out, ball = tmp_path / "fmus", tmp_path / "ball.toml"
    ball.write_text(BALL)
    tree = tmp_path / "tree.toml"
    tree.write_text(commands.example_file("tree"))
    cases = [
        ((ball,), "--model mass"),
        ((tmp_path / "none.xml",), "is not a file"),
        ((tree, "--gap", "elbow"), "--gap is for MJCF and URDF"),
        ((tree, "--model", "mass"), "--model is for zivi's own models"),
        ((tree, "--name", "2 arms"), "name"),
        (("--name", "Arm"), "are for a FILE"),
    ]
    for arguments, part in cases:
        assert part in run(*arguments, "--out", out, code=2), arguments
    assert not out.exists()
