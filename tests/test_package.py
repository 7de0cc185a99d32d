"""What is released: its description, its metadata, the workflow that makes it."""

import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())
DESCRIPTION = ROOT / PROJECT["project"]["readme"]
BLOCK = re.compile(r"```python\n(.*?)```", re.DOTALL)


def test_the_description_stands_alone():
    """A package index shows it without the files beside it."""
    text = DESCRIPTION.read_text()
    assert not re.findall(r"\]\((?!https?:)", text), "a link or a picture that is not there"
    assert DESCRIPTION.name.startswith("_"), "no page of the site"


@pytest.mark.parametrize(
    "page", [DESCRIPTION, ROOT / "docs" / "install.md"], ids=lambda it: it.name
)
def test_its_code_prints_what_it_says(page):
    for code in BLOCK.findall(page.read_text()):
        expected = re.search(r"rest_time[^#]*# ([\d.]+)", code).group(1)
        done = subprocess.run(
            [sys.executable, "-c", code], capture_output=True, text=True, check=True
        )
        assert done.stdout.split("\n")[0] == expected


def test_the_smoke_test_passes():
    subprocess.run([sys.executable, ROOT / "tools" / "smoke.py"], check=True, capture_output=True)


def test_one_rust_version_everywhere():
    version = tomllib.loads((ROOT / "Cargo.toml").read_text())["workspace"]["package"]
    minor = version["rust-version"]
    for file in (
        "tools/check-tools.sh",
        "tools/build/zivi_build.py",
        "docs/install.md",
        "README.md",
    ):
        text = (ROOT / file).read_text()
        assert re.findall(rf"(?:Rust|cargo) >= {re.escape(minor)}", text), file


def test_without_cargo_there_is_one_line():
    """The build backend says what is missing, before anything is built or downloaded."""
    code = "import zivi_build; zivi_build.build_wheel('nowhere')"
    done = subprocess.run(
        [sys.executable, "-c", code],
        capture_output=True,
        text=True,
        check=False,
        env={"PATH": "/nowhere", "PYTHONPATH": str(ROOT / "tools" / "build")},
    )
    assert done.returncode == 1
    assert done.stderr.startswith("zivi: cargo is missing")
    assert done.stderr.count("\n") == 1


def test_the_workflow_knows_its_files():
    yaml = pytest.importorskip("yaml")
    flow = yaml.safe_load((ROOT / ".github" / "workflows" / "release.yml").read_text())
    jobs = flow["jobs"]
    assert set(jobs["publish"]["needs"]) == {"sdist", "wheels"}
    names = {it["name"] for it in jobs["wheels"]["strategy"]["matrix"]["include"]}
    for system in ("linux", "musl", "macos"):
        assert {f"{system}-x86_64", f"{system}-aarch64"} <= names
    assert "windows-x86_64" in names
    commands = [step.get("run", "") for job in jobs.values() for step in job["steps"]]
    assert sum("tools/smoke.py" in it for it in commands) == 3
