"""What is released: its description, its metadata, the workflow that makes it."""

import re
import shutil
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


VERSION = ROOT / "tools" / "version.py"


@pytest.mark.skipif(shutil.which("cargo") is None, reason="cargo is not installed")
@pytest.mark.parametrize(
    "other", ["zivi-fmu --features loops,avx512", "zivi-host --features avx512"]
)
def test_what_is_linked_beside_the_extension_has_its_features(other):
    """Otherwise the crate zivi is compiled once more for it."""

    def compiled(package):
        command = "cargo tree --locked --edges normal,no-proc-macro --prefix none --no-dedupe"
        told = subprocess.run(
            [*command.split(), "--format", "{p} {f}", "--package", *package.split()],
            cwd=ROOT, capture_output=True, text=True, check=True,
        ).stdout  # fmt: skip
        found = {}
        for line in told.splitlines():
            found.setdefault(line.split()[0], set()).add(line)
        return found

    extension, beside = compiled("zivi-py"), compiled(other)
    both = (extension.keys() & beside.keys()) - {"zivi-py"}
    assert both > {"zivi", "zivi-core", "pulp", "num-traits"}
    assert {it: beside[it] for it in both} == {it: extension[it] for it in both}


def test_one_version_everywhere():
    done = subprocess.run([sys.executable, VERSION], capture_output=True, text=True, check=True)
    found = [line.split() for line in done.stdout.splitlines()]
    workspace = tomllib.loads((ROOT / "Cargo.toml").read_text())["workspace"]["package"]
    assert {version for version, _ in found} == {workspace["version"]}
    assert len(found) > 10


@pytest.fixture
def copy(tmp_path):
    """The files that name the version."""
    names = [line.split()[1] for line in run_version().stdout.splitlines()]
    for name in {*names, "CHANGELOG.md", "tools/no-panic/Cargo.lock", "Cargo.lock"}:
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text((ROOT / name).read_text())
    return tmp_path


def run_version(*arguments):
    command = [sys.executable, VERSION, *arguments]
    return subprocess.run(command, capture_output=True, text=True, check=False)


def test_a_release_sets_its_version_everywhere_and_nothing_else(copy):
    done = run_version("--root", copy, "7.8.9")
    assert done.returncode == 0, done.stderr
    for path in copy.rglob("*"):
        if path.is_file():
            old = (ROOT / path.relative_to(copy)).read_text().splitlines()
            new = path.read_text().splitlines()
            changed = [line for line in new if line not in old]
            assert all("7.8.9" in line or "date-released" in line for line in changed), path
    changes = (copy / "CHANGELOG.md").read_text()
    assert changes.index("## Unreleased") < changes.index("## 7.8.9 (") < changes.index("### Added")
    assert run_version("--root", copy, "--tag", "v7.8.9").returncode == 0
    assert "the tag is v7.8.8" in run_version("--root", copy, "--tag", "v7.8.8").stderr
    assert "has 7.8.9 already" in run_version("--root", copy, "7.8.9").stderr


def test_versions_that_differ_are_refused(copy):
    cff = copy / "CITATION.cff"
    cff.write_text(re.sub(r"(?m)^version: .*", "version: 9.9.9", cff.read_text()))
    assert "the versions differ" in run_version("--root", copy).stderr
    assert "three numbers" in run_version("--root", copy, "next").stderr


def test_the_workflow_refuses_a_tag_that_is_not_the_version():
    flow = (ROOT / ".github" / "workflows" / "release.yml").read_text()
    assert 'tools/version.py --tag "$GITHUB_REF_NAME"' in flow


def test_what_is_fetched_while_the_extension_is_compiled():
    """What pip would install for the extras: their dependencies, those of extras in them too."""
    done = subprocess.run(
        [sys.executable, ROOT / "tools" / "requirements.py", "cli", "xarray"],
        capture_output=True,
        text=True,
        check=True,
    )
    names = [re.match(r"[\w-]+", line)[0] for line in done.stdout.splitlines()]
    assert names == ["numpy", "matplotlib", "rich", "typer", "xarray"]
