"""How much the pages say, and that they say it once."""

import re
from collections import defaultdict

import pytest

from page_blocks import DOCS

PAGES = sorted(path for path in DOCS.glob("*.md") if not path.name.startswith("_"))
LONGEST = 1300
"""Words of a page."""
ALL = 46_000
"""Words of all pages (`wc -w docs/*.md`), above their number: a guard against copies.

A page for one kind of reader (structures, walking, teaching, theorems) has about 600.
"""
RUN = 7
"""So many words that two pages share are a copy."""


def prose(path):
    """Text of a page without code, formulas, headings and targets of links."""
    text = re.sub(r"\A---\n.*?^---\n", "", path.read_text(), flags=re.DOTALL | re.MULTILINE)
    text = re.sub(r"^(```+).*?^\1\s*$", "", text, flags=re.DOTALL | re.MULTILINE)
    text = re.sub(r"^(#{1,6} .*| {4}.*)$", "", text, flags=re.MULTILINE)
    return re.sub(r"\]\([^)\s]*\)", "]", text)


def words(path):
    """Words of a page as it is written."""
    return len(path.read_text().split())


def runs(texts):
    """Runs of words that several texts share, as long as they are, and in which."""
    where, split = defaultdict(set), {}
    for name, text in texts.items():
        split[name] = re.findall(r"\w+(?:[.'-]\w+)*", text.lower())
        for k in range(len(split[name]) - RUN + 1):
            where[tuple(split[name][k : k + RUN])].add(name)
    found = set()
    for text in split.values():
        k = 0
        while k + RUN <= len(text):
            others = where[tuple(text[k : k + RUN])]
            end = k + RUN
            if len(others) > 1:
                while len(where[tuple(text[end - RUN + 1 : end + 1])] & others) > 1:
                    end += 1
                found.add((" ".join(text[k:end]), tuple(sorted(others))))
                k = end - RUN + 1
            k += 1
    return found


def test_runs_are_found():
    one = "a mass above a wall moves under a force and stops"
    found = runs({"a": f"then {one}", "b": f"so {one}. But", "c": "a mass above a wall"})
    assert found == {(one, ("a", "b"))}


@pytest.mark.parametrize("path", PAGES, ids=lambda path: path.stem)
def test_a_page_is_short(path):
    assert words(path) <= LONGEST


def test_all_pages_are_short():
    assert sum(map(words, DOCS.glob("*.md"))) <= ALL


def test_evidence_stands_with_the_results():
    """Pages of users name no tests and no benchmarks: numbers are in benchmarks/results."""
    for path in PAGES:
        found = re.findall(r"\btests/\S+|\bbenchmarks/\w+\.py", path.read_text())
        assert not found, (path.name, found)


def test_a_fact_is_on_one_page():
    copies = runs({path.stem: prose(path) for path in PAGES})
    assert not copies, sorted(copies)
