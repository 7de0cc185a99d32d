"""Files of mechanical systems: what they give, what is refused, and that no code is run."""

import re
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import zivi
from inside import files_commands as commands
from mechanical_models import ndof_case
from zivi import files
from zivi.cli import app
from zivi.files import FileError

pytest.importorskip("h5netcdf")
pytestmark = pytest.mark.xdist_group("mechanical models")

EXAMPLE = commands.example_file("mechanics")


def changed(tmp_path, pattern, line):
    path = tmp_path / "file.toml"
    text, found = re.subn(pattern, lambda _: line, EXAMPLE, flags=re.MULTILINE)
    assert found == 1
    path.write_text(text)
    return path


def test_the_command_gives_what_python_gives(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("pendulum.toml").write_text(EXAMPLE)
    ended = CliRunner().invoke(app, ["simulate", "pendulum.toml"])
    assert ended.exit_code == 0, ended.output
    assert "Mechanical system" in ended.output
    system, span, start = ndof_case("dpend")  # the same pendulum
    one = zivi.simulate(system, span, start, zivi.SwitchedRK(rtol=1e-8, atol=1e-10))
    sol = files.load("pendulum.nc")
    assert sol.gap_names == ("wall",)
    assert sol.coordinate_names == ("a", "b")
    assert sol.zeno["t"] == pytest.approx(one.zeno["t"], abs=1e-9)
    assert sol.q[-1] == pytest.approx(one.q[-1], abs=1e-8)
    assert sol.config["parameters"]["m2"] == 0.8
    shown = CliRunner().invoke(app, ["show", "pendulum.nc"])
    assert shown.exit_code == 0, shown.output
    assert Path("pendulum.png").stat().st_size > 10_000


def test_times_and_other_methods(tmp_path):
    path = changed(tmp_path, r"^# t_eval = .*$", "t_eval = { start = 0.0, stop = 1.0, num = 5 }")
    sol = files.prepare_simulate(path).run()
    assert sol.t == pytest.approx(np.linspace(0, 1, 5))
    path = changed(tmp_path, r"^name = .*\n.*\n.*$", 'name = "MoreauJean"\nh = 1e-3')
    stepped = files.prepare_simulate(path).run()
    assert stepped(1.0)[0] == pytest.approx(sol.q[-1], abs=0.02)


def test_a_run_that_ends_early_is_kept(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("bar.toml").write_text(
        "t_span = [0, 2]\ny0 = [[0.0], [0.0]]\n[system]\nq = ['y']\n"
        "T = 'ydot**2/2'\nV = '9.81*y'\ne = [0.5, 0.5]\n"
        "gaps = { ground = 'y', press = '1 - t - y' }\n"
    )
    ended = CliRunner().invoke(app, ["simulate", "bar.toml", "-q"])
    assert ended.exit_code == commands.EARLY
    assert "these gaps touch: 'ground', 'press'" in ended.output
    sol = files.load("bar.nc")
    assert sol.status is zivi.Status.REDUNDANT_CONTACTS
    assert sol.t[-1] == pytest.approx(1.0)


DISC = """
t_span = [0, 0.6]
y0 = [[0.0, 0.4, 0.0], [1.0, 0.0, -10.0]]
[system]
q = ["x", "y", "th"]
T = "(xdot**2 + ydot**2)/2 + r**2*thdot**2/4"
V = "9.81*y"
e = 0.5
gaps = { floor = "y - r" }
slips = { floor = "xdot + r*thdot - 0.1" }
mu = { floor = ["mu", 0.4] }
e_t = { floor = 0.1 }
friction = { axle = ["thdot", 2e-3, 3e-3] }
impact_law = "newton"
parameters = { r = 0.1, mu = 0.3 }
"""


def test_dry_friction_is_that_of_python(tmp_path):
    (tmp_path / "disc.toml").write_text(DISC)
    sol = files.prepare_simulate(tmp_path / "disc.toml").run()
    floor = zivi.LinearGap(
        [0, 1, 0], -0.1, tangent=[1, 0, 0.1], mu=0.3, mu_static=0.4, e_t=0.1, belt=0.1
    )
    axle = zivi.DryFriction([0, 0, 1], limit=2e-3, static=3e-3)
    mass, force = np.diag([1.0, 1.0, 0.005]), [0.0, -9.81, 0.0]
    disc = zivi.MechanicalSystem(mass=mass, force=force, gaps=[floor], e=0.5, friction=[axle])
    exact = zivi.simulate(disc, (0, 0.6), ([0, 0.4, 0], [1, 0, -10]))
    assert sol.channel_names == ("floor", "axle")
    assert len(exact.resolved_impacts) > 1
    for name in ("q", "qdot"):
        found, true = (getattr(it, name)[-1] for it in (sol, exact))
        assert found == pytest.approx(true, abs=1e-12)
    assert sol.transitions["after"].tolist() == exact.transitions["after"].tolist()


def test_paradox_and_impact_law_reach_the_run(tmp_path):
    rod = """
    t_span = [0, 0.1]
    y0 = [[0.0, 0.8414709848078965, 1.0], [-2.0, 0.0, 0.0]]
    system.q = ["x", "y", "th"]
    system.T = "(xdot**2 + ydot**2)/2 + thdot**2/6"
    system.V = "9.81*y"
    system.gaps.tip = "y - sin(th)"
    system.slips.tip = "xdot + sin(th)*thdot"
    system.mu.tip = 1.6
    """
    path = tmp_path / "rod.toml"
    path.write_text(rod)
    assert files.prepare_simulate(path).run().status is zivi.Status.INCONSISTENT_CONTACT
    path.write_text(f'{rod}\nsystem.paradox = "impact"\nsystem.impact_law = "stronge"')
    sol = files.prepare_simulate(path).run()
    assert sol.flags["kind"].tolist() == ["impact_without_collision"]


def test_a_mass_in_a_guide_has_friction(tmp_path):
    path = tmp_path / "guide.toml"
    path.write_text(
        "t_span = [0, 3]\ny0 = [1, 0]\n[system]\nforce = -9.81\ne = 0.6\n"
        "friction = { limit = 2.0 }\n"
    )
    sol = files.prepare_simulate(path).run()
    ball = zivi.ImpactSystem(-9.81, e=0.6, friction=zivi.DryFriction(limit=2.0))
    assert sol.zeno["t"].tolist() == zivi.simulate(ball, (0, 3), (1, 0)).zeno["t"].tolist()
    text = path.read_text()
    for wrong, told in (
        ("limit = -1", "system.friction.limit must be a finite number >= 0"),
        ("limit = 1, static = 0.5", "system.friction.static of friction must be at least limit"),
        ("static = 1", "system.friction.limit is missing"),
    ):
        path.write_text(text.replace("limit = 2.0", wrong))
        with pytest.raises(FileError, match=told):
            files.prepare_simulate(path)
    path.write_text(f"{text}wall = {{ amplitude = 0.1, omega = 3.0 }}")
    with pytest.raises(
        FileError, match=r"system.wall must be None \(at rest\) for a mass with friction"
    ):
        files.prepare_simulate(path)


@pytest.mark.parametrize(
    ("line", "wrong", "told"),
    [
        ('["mu", 0.4]', "[0.3, 0.4, 0.5]", r"system.mu.floor must be mu or \[mu, mu_static\]"),
        ('["mu", 0.4]', '["mu", true]', r"system.mu.floor\[1\] must be an expression"),
        ('["mu", 0.4]', "-0.3", "mu of gap 'floor' must be >= 0"),
        ('"xdot + r*thdot - 0.1"', '"xdot**2"', "must be linear in the velocities"),
        ("slips = { floor", "slips = { flor", "slips has unknown key 'flor'; the gaps"),
        ("e_t = { floor = 0.1", "e_t = { floor = 2", "system.e_t.floor must be a finite number"),
        ('["thdot", 2e-3, 3e-3]', '"thdot"', r"axle must be \[slip speed, limit\] or \[slip"),
        ('"newton"', '"hertz"', 'system.impact_law must be one of "newton", "poisson"'),
    ],
)
def test_wrong_friction_names_its_key(tmp_path, line, wrong, told):
    path = tmp_path / "disc.toml"
    assert line in DISC
    path.write_text(DISC.replace(line, wrong))
    with pytest.raises(FileError, match=told):
        files.prepare_simulate(path).run()


@pytest.mark.parametrize(
    ("pattern", "line", "told"),
    [
        (r"^wall = .*$", "wall = 'l1*sin(a) + l9'", "system: gap 'wall' has l9, which is no"),
        (r"^wall = .*$", "wall = 'l1*sinn(a)'", "unknown function sinn"),
        (r"^wall = .*$", "wall = 'l1*sin'", "sin needs an argument"),
        (r"^wall = .*$", "wall = 'a +* b'", "it is not a formula"),
        (r"^wall = .*$", "wall = 'a^2'", r"a power is \*\*"),
        (r"^wall = .*$", "wall = 'a**2000'", "the exponent 2000 is too high"),
        (r"^wall = .*$", "wall = 'a + 1e999'", "a number is too large"),
        (r"^wall = .*$", "wall = true", "system.gaps.wall must be an expression or a finite"),
        (r"^wall = .*$", "wall = 'a + adot'", "got velocities"),
        (r"^wall = .*$", "wall = '-1 - a**2'", "gap 'wall' must be >= 0 at the start"),
        (r"^T = .*$", "T = 'adot**2/2'", "mass must be positive definite"),
        (r"^T = .*$", "TT = 'adot**2/2'", r"system.TT is not a known key[^\0]*system.T is missing"),
        (r"^Q = .*$", "Q = ['1']", "system.Q must have an entry for each of the 2 coordinates"),
        (r"^q = .*$", "q = ['a', 'a']", r"system.q\[1\] must be another name"),
        (r"^q = .*$", "q = ['a', 'b c']", r"system.q\[1\] must be a name of letters"),
        (r"^e = .*$", "e = 1.4", "system.e must be a finite number >= 0 and <= 1"),
        (r"^e = .*$", "e = [0.1, 0.2]", "system.e must be one number or one for each"),
        (r"^e = .*$", "e = [1.2]", r"system.e\[0\] must be a finite number"),
        (
            r"^e = .*$",
            "e = { law = 'SpeedDependentImpact', e0 = 0.9, v0 = 1.0, k = 0.2, e_max = 0.5 }",
            r"system\.e",
        ),
        (r"^y0 = .*$", "y0 = [0.5, 0.9]", r"y0\[0\] must be a list"),
        (r"^y0 = .*$", "y0 = [[0.5, 0.9], [0.0]]", r"y0 must have shape \(2,\)"),
        (r"^d = .*$", "d = '0.1'", "system.parameters.d must be a finite number"),
        (r"^name = .*$", "name = 'ExplicitEuler'", "method.name must be one of"),
    ],
)
def test_what_is_wrong_names_its_key(tmp_path, pattern, line, told):
    path = changed(tmp_path, pattern, line)
    with pytest.raises(FileError, match=told):
        files.prepare_simulate(path).run()


@pytest.mark.parametrize(
    "text",
    [
        "__import__('os').mkdir('ran')",
        "().__class__.__bases__",
        "[x for x in (1, 2)]",
        "(lambda: 1)()",
        "open",
        "eval('1')",
        "sin(x=1)",
        "'a'",
        "a if b else 1",
        "a < b",
        "a @ b",
        "f'{a}'",
        "(a := 1)",
        "a[0]",
        "sin(*a)",
        "None",
        "1j",
    ],
)
def test_no_code_is_run(tmp_path, monkeypatch, text):
    monkeypatch.chdir(tmp_path)
    path = changed(tmp_path, r"^V = .*$", f'V = "{text}"')
    with pytest.raises(FileError, match=r"system\.V"):
        files.prepare_simulate(path).run()
    assert not Path("ran").exists()
