"""The commands on files: results, tables, exit codes, what is never overwritten."""

import io
import json
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import matplotlib.image
import numpy as np
import psutil
import pytest
import xarray
from rich.console import Console
from typer.testing import CliRunner

import zivi
from inside import files_commands as commands, files_summary as summary
from zivi import files
from zivi.cli import app

for module in ("h5netcdf", "zarr"):
    pytest.importorskip(module)

BALL = "t_span = [0, 3]\ny0 = [1, 0]\n[system]\nforce = -9.81\ne = 0.5\n"
LOOP = """
t_span = [0, 2]
y0 = [6, 5]
y_ref0 = [3, 3]
force_ref = -19.81
[system]
force = -9.81
kappa = 0.5
[controller]
name = "TwistingTracker"
mu1 = 30
mu2 = 17
h = 1e-3
"""
STUDY = """
experiment = "ball_rest_time"
[parameters]
e = [0.3, 0.5, 0.7]
"""
TEXTS = {"simulate": BALL, "control": LOOP, "sweep": STUDY}
SUFFIX = {"simulate": ".nc", "control": ".nc", "sweep": ".zarr"}


@pytest.fixture
def place(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for command, text in TEXTS.items():
        Path(f"{command}.toml").write_text(text)
    return tmp_path


def run(*arguments, code=0):
    result = CliRunner().invoke(app, [str(argument) for argument in arguments])
    assert result.exit_code == code, result.output + repr(result.exception)
    assert "Traceback" not in result.output
    return result


def change(file, old, new):
    text = Path(file).read_text()
    assert old in text
    Path(file).write_text(text.replace(old, new))


def test_simulate(place):
    told = run("simulate", "simulate.toml").output
    assert 'simulate.nc: xarray.open_dataset("simulate.nc")' in told
    sol = files.load("simulate.nc")
    rest = f"{sol.rest_time:.9g} s"
    for text in ("completed", "3 resolved", f"1, at {rest}", f"from {rest}", "x = 0 m"):
        assert text in told, told
    assert re.search(rf"evaluations of the force\W+{sol.nfev}\b", told)
    assert sol.rest_time == pytest.approx(3 * np.sqrt(2 / 9.81), rel=1e-6)
    with xarray.open_dataset("simulate.nc") as dataset:
        assert dataset.x.attrs["units"] == "m"
        assert json.loads(dataset.attrs["config"])["e"] == 0.5
    assert sorted(os.listdir(place)) == sorted([f"{it}.toml" for it in TEXTS] + ["simulate.nc"])


def test_control(place):
    told = run("control", "control.toml").output
    found = files.load("control.nc")
    assert re.search(r"samples\W+2001\b", told)
    assert re.search(r"control updates\W+2000 +│", told)  # none rejected, none saturated
    for text in (
        "completed",
        "x - x_ref = 0 m",
        f"{len(found.resolved_impacts)} res",
    ):
        assert text in told, told
    low, high = re.search(r"control\s+│ (\S+) \.\. (\S+) m/s\^2", told).groups()
    assert float(low) == pytest.approx(found.u.min(), rel=1e-5)
    assert float(high) == pytest.approx(found.u.max(), rel=1e-5)
    assert re.search(r"at rest at the end\W+from 1\.\d+ s", told)


def test_sweep(place):
    told = run("sweep", "sweep.toml").output
    assert 'sweep.zarr: xarray.open_zarr("sweep.zarr")' in told
    assert re.search(r"completed\W+3\n?", told)
    assert re.search(r"failed\W+0", told)
    with xarray.open_zarr("sweep.zarr", chunks=None) as dataset:
        np.testing.assert_allclose(dataset.rest_time, dataset.exact, rtol=1e-9)
    # the same again: nothing to do
    files_before = {p: p.stat().st_mtime_ns for p in Path("sweep.zarr").rglob("0")}
    assert "completed" in run("sweep", "sweep.toml").output
    assert files_before == {p: p.stat().st_mtime_ns for p in Path("sweep.zarr").rglob("0")}


def test_sweep_of_more_values_computes_the_new_ones(place):
    run("sweep", "sweep.toml", "-q")
    before = zivi.open_study("sweep.zarr").rest_time.load()
    change("sweep.toml", "[0.3, 0.5, 0.7]", "[0.7, 0.4, 0.3, 0.5]")
    record = json.loads(run("sweep", "sweep.toml", "--json").output)
    assert record["points"] == 4 * before.size // 3
    after = zivi.open_study("sweep.zarr").rest_time
    assert after.e.values.tolist() == [0.7, 0.4, 0.3, 0.5]
    assert np.array_equal(after.sel(e=before.e), before)
    run("sweep", "sweep.toml", "-q", "--out", "whole.zarr")
    assert np.array_equal(after, zivi.open_study("whole.zarr").rest_time)


@pytest.mark.parametrize("executor", ["threads", "processes"])
def test_executors_give_the_same(place, executor):
    run("sweep", "sweep.toml", "-q")
    change("sweep.toml", "[parameters]", f'executor = "{executor}"\nworkers = 2\n[parameters]')
    run("sweep", "sweep.toml", "-q", "--out", "other.zarr")
    studies = [zivi.open_study(name).dataset.load() for name in ("sweep.zarr", "other.zarr")]
    assert studies[0].identical(studies[1])


def test_points_that_fail(place):
    change("sweep.toml", "0.7]", "1.0]")
    told = run("sweep", "sweep.toml", code=1).output
    assert re.search(r"failed\W+1", told)
    assert "point 2" in told
    assert "a ball rests for 0 < e < 1" in told
    run("sweep", "sweep.toml", "-q", code=1)
    run("sweep", "sweep.toml", "-q", "--retry-failed", code=1)
    run("show", "sweep.zarr", "-q")
    change("sweep.toml", "[0.3, 0.5, 1.0]", "[1.0]")
    result = run("sweep", "sweep.toml", "--out", "all.zarr", code=1)
    assert "all 1 points failed" in result.stderr


def test_another_study(place):
    run("sweep", "sweep.toml", "-q")
    change("sweep.toml", "0.7]", "0.8]")
    told = run("sweep", "sweep.toml", code=2).stderr
    assert "sweep.toml: sweep.zarr has another study: the values of the parameters" in told
    assert "--force starts anew, --out names another folder" in told
    assert zivi.open_study("sweep.zarr").e.values.tolist() == [0.3, 0.5, 0.7]
    run("sweep", "sweep.toml", "-q", "--force")
    assert zivi.open_study("sweep.zarr").e.values.tolist() == [0.3, 0.5, 0.8]
    assert sorted(os.listdir(place)) == sorted([f"{it}.toml" for it in TEXTS] + ["sweep.zarr"])
    run("sweep", "sweep.toml", "-q", "--resume")
    told = run("sweep", "sweep.toml", "--resume", "--out", "no", code=2).stderr
    assert "no does not contain a study" in told


def test_force_removes_studies_only(place):
    Path("precious").mkdir()
    Path("precious", "thesis.txt").write_text("all of it")
    told = run("sweep", "sweep.toml", "--force", "--out", "precious", code=2).stderr
    assert "precious: is not removed, since it is not a study" in told
    told = run("sweep", "sweep.toml", "--out", "precious", code=2).stderr
    assert Path("precious", "thesis.txt").read_text() == "all of it"
    run("sweep", "sweep.toml", "--force", "--out", "simulate.toml", code=2)
    assert Path("simulate.toml").read_text() == BALL
    with zivi_writes("busy.zarr"):
        told = run("sweep", "sweep.toml", "--force", "--out", "busy.zarr", code=1).stderr
    assert "another run writes" in told


def zivi_writes(path):
    """Hold the lock of a study."""
    import contextlib

    from inside import FolderStore

    @contextlib.contextmanager
    def held():
        zivi.sweep("ball_rest_time", {"e": [0.3]}, out=path)
        store = FolderStore(Path(path), write=True)
        try:
            yield
        finally:
            store.close()

    return held()


@pytest.mark.parametrize("command", ["simulate", "control"])
def test_nothing_is_overwritten(place, command):
    file, result = f"{command}.toml", f"{command}.nc"
    run(command, file, "-q")
    before = Path(result).read_bytes()
    told = run(command, file, code=2).stderr
    assert told == (f"zivi: {result}: exists; --force replaces it, --out names another\n")
    assert Path(result).read_bytes() == before
    assert "is the input file" in run(command, file, "--out", file, "--force", code=2).stderr
    assert Path(file).read_text() == TEXTS[command]
    Path("folder").mkdir()
    assert "is a folder" in run(command, file, "--out", "folder", "--force", code=2).stderr
    change(file, "t_span = [0,", "t_span = [0.5,")
    run(command, file, "-q", "--force")
    assert files.load(result).t[0] == 0.5
    run(command, file, "-q", "--out", "new/deep.nc")
    assert files.load("new/deep.nc").t[0] == 0.5


@pytest.mark.slow
@pytest.mark.parametrize("command", TEXTS)
def test_quiet(place, command):
    result = run(command, f"{command}.toml", "--quiet")
    assert result.output == ""
    result = run("show", f"{command}{SUFFIX[command]}", "--quiet")
    assert result.output == f"picture: {command}.png\n"


@pytest.mark.slow
def test_a_run_that_ends_early_is_kept(place):
    change("simulate.toml", "e = 0.5", "e = 0.5\n[method]\nmax_steps = 2")
    result = run("simulate", "simulate.toml", code=1)
    sol = files.load("simulate.nc")
    assert sol.status == zivi.Status.STEP_BUDGET
    assert f"the run ended early, at {sol.t[-1]:.9g} s: {sol.message}" in result.stderr
    assert "step_budget" in result.stdout
    run("show", "simulate.nc", "-q")
    change("control.toml", "force = -9.81", "force = { stiffness = -1e300, gravity = 9.81 }")
    run("control", "control.toml", code=1)
    assert not files.load("control.nc").success


@pytest.mark.parametrize("command", TEXTS)
def test_a_bad_file(place, command):
    file = f"{command}.toml"
    change(file, "force" if command != "sweep" else "experiment", "farce")
    result = run(command, file, code=2)
    assert result.stdout == ""
    lines = result.stderr.splitlines()
    assert len(lines) >= 2
    assert all(line.startswith(f"{file}: ") for line in lines)
    assert not list(place.glob("*.nc")) + list(place.glob("*.zarr"))
    assert run(command, "no.toml", code=2).stderr == "no.toml: does not exist\n"
    assert run(command, code=2)


def test_a_folder_that_cannot_be_written(place, monkeypatch):
    Path("file").write_text("")
    told = run("simulate", "simulate.toml", "--out", "file/ball.nc", code=2).stderr
    assert told.startswith("zivi: ")

    def full(*args, **kwargs):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(commands, "save", full)
    told = run("simulate", "simulate.toml", code=2).stderr
    assert "zivi: simulate.nc: cannot be written" in told
    assert "No space" in told


def test_missing_libraries(place, monkeypatch):
    monkeypatch.setitem(sys.modules, "h5netcdf", None)
    told = run("simulate", "simulate.toml", code=2).stderr
    assert "pip install 'zivi[files]'" in told
    monkeypatch.setitem(sys.modules, "zarr", None)
    told = run("sweep", "sweep.toml", code=2).stderr
    assert "pip install 'zivi[study]'" in told


STUDIES = {
    "line": "e = [0.3, 0.5, 0.7]",
    "lines": "e = [0.3, 0.5, 0.7]\nh = [1e-3, 1e-2]",
    "map": "e = { start = 0.1, stop = 0.9, num = 7 }\n"
           "h = { start = 1e-4, stop = 1e-1, num = 7, log = true }",
    "cube": "e = [0.3, 0.5]\nh = [1e-3, 1e-2]\nx0 = [1, 2]",
    "sample": "e = { start = 0.1, stop = 0.9 }\n[design]\nkind = 'sample'\nn = 8",
}  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("kind", STUDIES)
def test_show_studies(place, kind):
    change("sweep.toml", "e = [0.3, 0.5, 0.7]", STUDIES[kind])
    run("sweep", "sweep.toml", "-q")
    told = run("show", "sweep.zarr").output
    assert "picture: sweep.png" in told
    assert "rest_time" in told
    picture = matplotlib.image.imread("sweep.png")
    assert min(picture.shape[:2]) > 300
    assert picture[..., :3].std() > 0.01


def test_cells_of_a_map_surround_their_values():
    from inside import _edges

    np.testing.assert_allclose(_edges(np.array([1.0, 2.0, 4.0])), [0.5, 1.5, 3.0, 5.0])
    np.testing.assert_allclose(
        _edges(np.array([1e-3, 1e-2, 1e-1])), 10.0 ** np.array([-3.5, -2.5, -1.5, -0.5])
    )
    np.testing.assert_allclose(_edges(np.array(["a", "b"])), [-0.5, 0.5, 1.5])


@pytest.mark.slow
def test_show_studies_of_python(place):
    zivi.sweep("ball_rest_time", zivi.points(e=[0.3, 0.5], x0=[1, 2]), out="list.zarr")
    run("show", "list.zarr", "-q")

    def named(kind, size):
        return {"a": size * len(kind), "b": np.arange(3.0)}

    zivi.sweep(named, {"kind": ["x", "yy"], "size": [1.0, 2.0]}, out="named.zarr")
    run("show", "named.zarr", "-q")
    zivi.sweep(named, zivi.points(size=[1.0, 2.0], kind=["x", "yy"]), out="listed.zarr")
    run("show", "listed.zarr", "-q")
    sizes = np.arange(1.0, 8.0)
    zivi.sweep(named, {"kind": [k * "x" for k in range(1, 8)], "size": sizes}, out="map.zarr")
    run("show", "map.zarr", "-q")


@pytest.mark.slow
def test_show_runs(place):
    for command in ("simulate", "control"):
        run(command, f"{command}.toml", "-q")
        told = run("show", f"{command}.nc").output
        assert "completed" in told
        assert min(matplotlib.image.imread(f"{command}.png").shape[:2]) > 500
        assert "png: exists; --force" in run("show", f"{command}.nc", code=2).stderr
        run("show", f"{command}.nc", "-q", "--force")
    run("show", "control.nc", "-q", "--out", "pictures/loop.svg")
    assert "<svg" in Path("pictures/loop.svg").read_text()
    assert not list(place.rglob(".*"))


def test_show_what_is_wrong(place, monkeypatch):
    assert "does not exist" in run("show", "no.nc", code=2).stderr
    assert "is not a netCDF file" in run("show", "simulate.toml", code=2).stderr
    Path("folder").mkdir()
    assert "is not a study" in run("show", "folder", code=2).stderr
    run("simulate", "simulate.toml", "-q")
    content = bytearray(Path("simulate.nc").read_bytes())
    content[len(content) // 2] ^= 1
    Path("simulate.nc").write_bytes(content)
    told = run("show", "simulate.nc", code=2).stderr
    assert told == "zivi: simulate.nc: was damaged or changed since zivi wrote it\n"
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr(sys, "platform", "linux")
    told = run("show", "simulate.nc", "--out", "a.xyz", code=2).stderr
    assert told == "a.xyz: must end in .png, .svg, .pdf\n"
    assert "cannot open a display" in run("show", "simulate.nc", "--window", code=2).stderr


def test_a_damaged_study_is_shown_as_far_as_it_can_be_read(place):
    change("sweep.toml", "[parameters]", "chunk = 1\n[parameters]")
    run("sweep", "sweep.toml", "-q")
    file = Path("sweep.zarr", "rest_time", "c", "1")
    file.write_bytes(file.read_bytes()[:-3])
    result = run("show", "sweep.zarr")
    assert "is damaged" in result.stderr
    assert re.search(r"missing\W+1", result.stdout)
    run("sweep", "sweep.toml", "-q")
    assert zivi.open_study("sweep.zarr", verify=True).complete


def test_a_file_for_another_command_is_rejected_in_one_line(place):
    kinds = {"simulate": "simulate", "control": "control", "sweep": "sweep"}
    for command in kinds:
        for kind in kinds:
            if kind == command:
                continue
            told = run(command, f"{kind}.toml", code=2).stderr
            assert told == f"{kind}.toml: is a file for zivi {kind}, not for zivi {command}\n"


def test_the_input_is_looked_at_before_the_picture_that_is_there(place):
    Path("simulate.png").write_text("")
    told = run("show", "simulate.toml", code=2).stderr
    assert told.startswith("zivi: simulate.toml: is not a netCDF file")
    assert "zivi simulate" in told
    assert run("show", "no.nc", code=2).stderr == "zivi: no.nc: does not exist\n"


@pytest.mark.parametrize(("name", "meant"), [("restitution", "e"), ("eps", "e")])
def test_names_of_other_tools_are_understood(place, name, meant):
    change("simulate.toml", "[system]", f"[system]\n{name} = 0.41")
    assert (
        f"is not a known key; did you mean '{meant}'?"
        in run("simulate", "simulate.toml", code=2).stderr
    )


@pytest.mark.parametrize("width", [30, 24])
def test_values_wrap_on_a_narrow_terminal(place, monkeypatch, width):
    monkeypatch.setenv("COLUMNS", str(width))
    lines = run("simulate", "simulate.toml").stdout.splitlines()[1:-1]
    assert all(len(line) <= width for line in lines)
    values = "".join(line.strip("\u2502").split("\u2502")[-1].strip() for line in lines)
    assert "completed:" in values
    assert f"{files.load('simulate.nc').rest_time:.9g}" in values


def test_json(place):
    told = json.loads(run("simulate", "simulate.toml", "--json").stdout)
    sol = files.load("simulate.nc")
    assert told["result"] == "simulate.nc"
    assert (told["exit_code"], told["kind"], told["status"]) == (0, "Trajectory", "completed")
    assert (told["t_end"], told["rest_time"], told["nfev"]) == (sol.t[-1], sol.rest_time, sol.nfev)
    shown = json.loads(run("show", "simulate.nc", "--json").stdout)
    assert shown.pop("picture") == "simulate.png"
    assert shown == told
    told = json.loads(run("control", "control.toml", "--json").stdout)
    assert told["kind"] == "ClosedLoop"
    told = json.loads(run("sweep", "sweep.toml", "--json").stdout)
    study = zivi.open_study("sweep.zarr")
    assert (told["points"], told["completed"]) == (len(study.status), len(study.status))
    for name, range_ in told["results"].items():
        values = study.dataset[name].values
        assert (range_["min"], range_["max"]) == (np.nanmin(values), np.nanmax(values))
    shown = json.loads(run("show", "sweep.zarr", "--json").stdout)
    assert shown.pop("picture") == "sweep.png"
    assert shown == told


def test_a_status_stands_out_in_colour_and_only_on_a_terminal(place):
    assert "\x1b" not in run("simulate", "simulate.toml").stdout
    sol = files.load("simulate.nc")
    lost = zivi.simulate(
        zivi.ImpactSystem(-9.81, e=0.5), (0, 9), (1, 0), zivi.SwitchedRK(max_steps=2)
    )
    for shown, colour in ((sol, "\x1b[32m"), (lost, "\x1b[1;31m")):
        console = Console(
            force_terminal=True, color_system="standard", file=io.StringIO(), width=90
        )
        console.print(summary.run_table(shown))
        assert f"{colour}{shown.status.name.lower()}: " in console.file.getvalue()


def test_completion_names_the_commands(monkeypatch):
    words = {"_ZIVI_COMPLETE": "complete_bash", "COMP_WORDS": "zivi s", "COMP_CWORD": "1"}
    told = CliRunner().invoke(app, prog_name="zivi", env=words).stdout
    assert told.split() == ["simulate", "sweep", "show"]


def test_help():
    assert run("--version").output == f"zivi {zivi.__version__}\n"
    told = run("--help").output
    for command in (*TEXTS, "show", "paper"):
        assert command in told
        text = run(command, "--help").output
        assert "--out" in text
    assert "130" in run("simulate", "--help").output
    told = run("sweep", "--experiments").output
    for name in zivi.study.EXPERIMENTS:
        assert name in told
    assert "Gamma = 1.2" in told


def process(*arguments, **kwargs):
    return subprocess.run(
        [sys.executable, "-m", "zivi", *arguments],
        capture_output=True, text=True, timeout=60, check=False, **kwargs,
    )  # fmt: skip


@pytest.mark.slow
def test_as_a_process(place):
    ended = process("simulate", "simulate.toml")
    assert (ended.returncode, ended.stderr) == (0, "")
    assert "at rest" in ended.stdout
    ended = process("simulate", "simulate.toml")
    assert (ended.returncode, ended.stdout) == (2, "")
    ended = subprocess.run(
        [Path(sys.executable).with_name("zivi"), "show", "simulate.nc"],
        capture_output=True, text=True, timeout=60, check=False,
    )  # fmt: skip
    assert (ended.returncode, ended.stderr) == (0, "")
    assert Path("simulate.png").exists()


INTERRUPTIBLE = """
import signal, sys
signal.signal(signal.SIGINT, signal.default_int_handler)  # a background shell ignores it
from zivi.cli import app
print("started", flush=True)
app(sys.argv[1:])
"""


def computed_for(child, seconds):
    """Wait until a process has had so much of a processor, however busy the machine is."""
    process = psutil.Process(child.pid)
    begun = sum(process.cpu_times()[:2])
    while child.poll() is None and sum(process.cpu_times()[:2]) < begun + seconds:
        time.sleep(0.05)


@pytest.mark.slow
@pytest.mark.xdist_group("interrupt")
@pytest.mark.skipif(os.name != "posix", reason="sends SIGINT to a process")
@pytest.mark.parametrize("command", TEXTS)
def test_interrupt(place, command):
    # slow steps: what is computed within a second is not large
    method = "\n[method]\nname = 'ThetaGamma'\nh = 1e-7\nsolver = 'newton'\n"
    if command == "simulate":
        change("simulate.toml", "e = 0.5", "e = 0.5" + method)
    elif command == "control":
        change("control.toml", "h = 1e-3", "h = 1e-7\n[method]\nname = 'SwitchedRK'\nrtol = 1e-12")
        change("control.toml", "force = -9.81", "force = { gravity = 9.81, damping = 0.1 }")
    else:
        change(
            "sweep.toml", "[0.3, 0.5, 0.7]", "{ start = 0.3, stop = 0.9, num = 1000 }\nh = [1e-6]"
        )
        change("sweep.toml", "[parameters]", "chunk = 1\n[parameters]")
    with subprocess.Popen(
        [sys.executable, "-c", INTERRUPTIBLE, command, f"{command}.toml"],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    ) as child:  # fmt: skip
        try:
            assert child.stdout.readline() == "started\n"
            if command == "sweep":
                while not list(place.glob("sweep.zarr/status/c/*/*")) and child.poll() is None:
                    time.sleep(0.05)
            else:
                computed_for(child, 1.0)
            child.send_signal(signal.SIGINT)
            _, errors = child.communicate(timeout=40)
        finally:
            child.kill()
    assert child.returncode == 130, errors
    assert "Traceback" not in errors
    if command == "sweep":
        assert "stopped by Ctrl-C" in errors
        study = zivi.open_study("sweep.zarr")
        assert 0 < np.count_nonzero(study.status == 1) < 1000
    else:
        found = files.load(f"{command}.nc")
        assert found.status == zivi.Status.RAISED
        assert "the run ended early" in errors
        assert len(found.t) > 1
