"""How the command line ends where its output, its files or their contents are in disorder."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
from typer.testing import CliRunner

import zivi
from inside import files_results as results, open_result
from zivi.cli import app
from zivi.files import save

for library in ("h5netcdf", "zarr", "matplotlib"):
    pytest.importorskip(library)

BALL = "t_span = [0, 3]\ny0 = [1, 0]\n[system]\nforce = -9.81\ne = 0.5\n"
full_disk = pytest.mark.skipif(not os.path.exists("/dev/full"), reason="needs /dev/full")


@pytest.fixture(autouse=True)
def place(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("ball.toml").write_text(BALL)
    return tmp_path


def in_process(*arguments, code):
    ended = CliRunner().invoke(app, arguments)
    assert ended.exit_code == code, ended.output + repr(ended.exception)
    assert ended.exception is None or isinstance(ended.exception, SystemExit)
    return ended.stderr


def zivi_ends(*arguments, code, **kwargs):
    command = [sys.executable, "-m", "zivi", *arguments]
    kwargs = {"stdout": subprocess.PIPE} | kwargs
    ended = subprocess.run(
        command, stderr=subprocess.PIPE, text=True, timeout=60, check=False, **kwargs
    )
    assert ended.returncode == code, ended.stderr
    assert "Traceback" not in ended.stderr
    return ended.stderr


@full_disk
@pytest.mark.parametrize("arguments", [["--version"], ["simulate", "--example"]])
def test_a_full_disk_behind_standard_output(arguments):
    with open("/dev/full", "w") as full:
        told = zivi_ends(*arguments, code=2, stdout=full)
    assert told.startswith("zivi: standard output cannot be written: No space left")
    assert told.count("\n") == 1


def closed_pipe():
    """The writing end of a pipe that nobody reads."""
    reading, writing = os.pipe()
    os.close(reading)
    return writing


@pytest.mark.parametrize("early", [False, True])
def test_a_reader_that_leaves_changes_nothing(early):
    if early:
        Path("ball.toml").write_text(BALL + "[method]\nmax_steps = 2\n")
    told = zivi_ends("simulate", "ball.toml", code=int(early), stdout=closed_pipe())
    assert told.startswith("zivi: the run ended early" if early else "")
    assert isinstance(zivi.files.load("ball.nc"), zivi.Trajectory)


@full_disk
@pytest.mark.parametrize("command", ["simulate", "show"])
def test_a_device_is_not_replaced(command):
    source = {"simulate": "ball.toml", "show": "ball.nc"}[command]
    save(zivi.simulate(zivi.ImpactSystem(-9.81, e=0.5), (0, 1), (1, 0)), "ball.nc")
    os.mkfifo("pipe.png")
    told = in_process(command, source, "--out", "pipe.png", "--force", code=2)
    assert "is a device or a pipe" in told
    assert Path("pipe.png").is_fifo()
    with pytest.raises(FileExistsError, match="is a device or a pipe"):
        save(zivi.files.load("ball.nc"), "/dev/full", overwrite=True)
    assert Path("/dev/full").is_char_device()


@pytest.mark.parametrize("folder", [".", "..", "/"])
def test_a_folder_that_is_no_study(place, folder, monkeypatch):
    inner = place / "inner" / "most"
    inner.mkdir(parents=True)
    monkeypatch.chdir(inner)
    told = in_process("show", folder, code=2)
    assert told.count("\n") == 1
    assert not list(place.rglob("*.png"))


@pytest.mark.parametrize("change", [{"config": "{"}, {"status": 99}, {"path": "bow"}])
def test_damaged_attributes_of_a_run(change):
    save(zivi.simulate(zivi.ImpactSystem(-9.81, e=0.5), (0, 1), (1, 0)), "ball.nc")
    dataset = open_result("ball.nc")
    dataset.attrs.update(change)
    dataset.to_netcdf("ball.nc", engine="h5netcdf")
    results._seal(Path("ball.nc"))
    told = in_process("show", "ball.nc", code=2)
    assert told.startswith("zivi: ball.nc: ")
    assert told.count("\n") == 1


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="nobody may write in /proc")
def test_what_cannot_be_written_is_the_same_everywhere():
    save(zivi.simulate(zivi.ImpactSystem(-9.81, e=0.5), (0, 1), (1, 0)), "ball.nc")
    for command, source in (("simulate", "ball.toml"), ("show", "ball.nc")):
        for out in ("/proc/new.png", "/proc/deeper/new.png"):
            told = in_process(command, source, "--out", out, code=2)
            assert told.startswith("zivi: ")
            assert "/proc" in told


def test_a_study_in_its_own_folder_is_shown(place, monkeypatch):
    experiment = zivi.study.EXPERIMENTS["ball_rest_time"]
    zivi.sweep(experiment, {"e": [0.2, 0.5]}, out="here.zarr", progress=False)
    monkeypatch.chdir("here.zarr")
    in_process("show", ".", "-q", code=0)
    assert (place / "here.png").is_file()


def test_pictures_have_the_style_of_the_figures(monkeypatch):
    plt = pytest.importorskip("matplotlib.pyplot")
    save(zivi.simulate(zivi.ImpactSystem(-9.81, e=0.5), (0, 1), (1, 0)), "ball.nc")
    made = []
    monkeypatch.setattr(
        plt.Figure, "savefig", lambda it, path, **_: made.append(it) or path.touch()
    )
    in_process("show", "ball.nc", "-q", code=0)
    (figure,) = made
    assert not any(ax.spines["top"].get_visible() for ax in figure.axes)
    assert plt.rcParams["axes.spines.top"]  # and the caller's style is left as it was
