"""What a release is made of: actions by digest, packages by hash; pages with a policy."""

import os
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
WORKFLOWS = sorted((ROOT / ".github" / "workflows").glob("*.yml"))


def test_actions_are_named_by_their_digest():
    uses = [line for file in WORKFLOWS for line in file.read_text().splitlines() if "uses:" in line]
    assert len(uses) > 8
    for line in uses:
        assert re.search(r"uses: [\w-]+/[\w-]+@[0-9a-f]{40} # v\d+\.\d+\.\d+$", line), line


def test_one_action_has_one_digest():
    text = "".join(file.read_text() for file in WORKFLOWS)
    pins = set(re.findall(r"uses: ([\w/-]+)@(\w+)", text))
    assert len(pins) == len({name for name, _ in pins})


def test_the_tests_are_those_of_the_makefile():
    makefile = (ROOT / "Makefile").read_text()
    workflow = next(file for file in WORKFLOWS if file.name == "tests.yml").read_text()
    commands = re.findall(r"^\tcargo test .*", makefile, re.MULTILINE)
    assert [it.strip() for it in commands] == re.findall(r"cargo test .*", workflow)
    options = re.search(r"^PYTEST := \$\(BIN\)/python -m pytest (.*)", makefile, re.MULTILINE)[1]
    assert f"python -m pytest {options} -m 'not browser'" in workflow


def test_a_release_takes_packages_by_their_hashes():
    text = (ROOT / ".github" / "release.txt").read_text()
    pinned = dict(re.findall(r"^([\w-]+)==([\w.]+)", text, re.MULTILINE))
    known = dict(
        re.findall(r"^([\w-]+)==([\w.]+)", (ROOT / "constraints.txt").read_text(), re.MULTILINE)
    )
    assert pinned == {name: known[name] for name in ("maturin", "numpy")}
    hashes = re.findall(r"--hash=sha256:([0-9a-f]{64})\b", text)
    assert len(hashes) > 20
    assert "//" not in text
    release = next(file for file in WORKFLOWS if file.name == "release.yml").read_text()
    for line in re.findall(r"pip install (.*)", release):
        assert "--require-hashes" in line or "--no-deps" in line


def test_the_page_without_python_loads_nothing_from_elsewhere():
    page = (ROOT / "docs" / "_static" / "browser" / "index.html").read_text()
    (policy,) = re.findall(r'http-equiv="Content-Security-Policy" content="([^"]*)"', page)
    assert "default-src 'none'" in policy
    assert "unsafe-inline" not in policy
    # what such a policy forbids is not in the page
    assert not re.search(r"<script(?![^>]*\bsrc=)|<style| style=| on\w+=", page)
    assert all(
        not it.startswith("http")
        for it in re.findall(r'(?:src|href)="([^"]*)"', page.split("<body>")[0])
    )


@pytest.mark.xdist_group("groups")
def test_tests_of_a_group_stay_with_one_worker(request):
    if os.environ.get("PYTEST_XDIST_WORKER") and request.config.getoption("loadgroup", False):
        assert request.node.nodeid.endswith("@groups")


SLEEPERS = [
    "interrupting",
    "sweep_functions",
    "test_cli_files",
    "test_lab_browser",
    "test_lab_command",
    "test_lab_updates",
    "test_leaving",
    "test_sweep_resume",
    "test_sweep_shards",
]
"""What waits for others, and asserts nothing by a clock but that it does not hang."""


def test_no_test_measures_seconds():
    clock = "(perf_counter|monotonic|process_time)"
    measured = re.compile(rf"time\.sleep\(|assert .*{clock}|{clock}\(\) - ")
    files = (ROOT / "tests").glob("*.py")
    found = {it.stem for it in files if measured.search(it.read_text("utf-8"))}
    # a ratio of processor times: how the cost of batches grows, which no count tells
    assert found - {*SLEEPERS} <= {"test_batch"}
