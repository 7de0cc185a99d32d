"""The language of the pages, docstrings, messages and comments: faults per 10,000 words, by kind.

Each kind is a pattern that marks a sentence a reader has to decode: a clause in place of a noun,
data that are told or asked, an afterthought, a preposition that mathematics does not use. The
budgets are in tests/style.toml; they fall as sentences are rewritten, and none may rise.
``python tests/test_style.py KIND [SET]`` lists the sentences.
"""

import ast
import re
import sys
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
BUDGET = tomllib.loads((ROOT / "tests" / "style.toml").read_text("utf-8"))
BEFORE = r"of|to|by|from|in|for|with|as|than|at|on|and|or|gives?|keeps?|holds?|says?|is|are|takes?"
KINDS = {
    # a clause in place of a noun: "what a batch takes of memory"
    "what_clause": rf"\b(?:{BEFORE}|tells?|knows?) what\b|(?:^|[.:;] )What\b[^?]*$",
    # data and functions that speak: "the step is told the reference"
    "told_asked": r"\b(?:is|are|was|were|be|been|being|not) "
    r"(?:asked|told|said|wanted|looked (?:at|for|up)|sought|believed|thought|spoken)\b"
    r"|\b(?:asks?|asking) (?:for|of|at|whether|what|how)\b"
    r"|\b(?:tells?|says?) (?:of|that|what|how|whether|which|who|where|when|why)\b"
    r"|\bbelieve[sd]?\b|\blooks? (?:at|for|of)\b"
    r"|\b(?:as|what|how far|so far as) .{0,25}\b(?:known|knows)\b",
    # a negated noun in place of a negated verb: "is no parameter of this force"
    "is_no": r"\b(?:is|are|was|be|has|have|had|takes?|gives?|needs?|knows?) no\b(?! longer)"
    r"|\bnone (?:of|is|are)\b|\bnothing\b|\bnobody\b|, nor\b|[.] Nor\b",
    # an afterthought: ", also of", "if it is"
    "shared_rel": r", (?:as|also|but|and|or|too|not|nor|so|then) "
    r"(?:of|for|with|where|by|in|at|on|to|from)\b|, too\b"
    r"|\b(?:if it is|if there is|if they are|where it is|where there is|where they are|as it is"
    r"|that it is|it was)\b",
    # places and times of another century: "behind the wall", "anew"
    "beyond_etc": r"\b(?:beyond|behind|beside|besides|anew|apart|off by|by itself|by themselves"
    r"|along the way|on the way|under way|far enough|near to|for ever|for good|by turns|at once"
    r"|so many|so long|as long as)\b",
    # a summary that gives or tells: "Give the time"
    "take_give": r"(?:^|[.;:] )(?:Give|Take|Tell|Say|Let|Put|Go|Part|Lay|Mend|Name)\b"
    r"|\b(?:takes?|gives?) (?:it|them|part|place|all|no|any|an?|the)\b",
}


def clean(text):
    """Text in one line, with code and formulas replaced by one letter."""
    text = re.sub(r":\w+:`[^`]*`|``[^`]*``|`[^`]*`|\$[^$]*\$", "X", text)
    return re.sub(r"\s+", " ", re.sub(r"\]\([^)]*\)", "]", text)).strip()


def paragraphs(numbered):
    """Paragraphs and items of lists with the number of their first line."""
    found, buffer, start = [], [], 0
    for number, line in [*numbered, (0, "")]:
        item = line.lstrip().startswith(("- ", "* ", "|"))
        if buffer and (item or not line.strip()):
            found.append((start, clean(" ".join(buffer))))
            buffer = []
        if line.strip():
            start = start if buffer else number
            buffer.append(line.strip())
    return found


def of_page(text):
    """Prose of a page: without code, headings and tables' rules."""
    code, lines = False, []
    for number, line in enumerate(text.splitlines(), 1):
        fence = line.lstrip().startswith("```")
        code ^= fence
        prose = not code and not fence and not line.startswith(("    ", "#", "---"))
        lines.append((number, line if prose else ""))
    return paragraphs(lines)


def of_docstrings(tree):
    for node in ast.walk(tree):
        if not isinstance(node, ast.FunctionDef | ast.ClassDef | ast.Module):
            continue
        text = ast.get_docstring(node) or ""
        code = (">>>", "...", "..", "---")
        lines = [it if not it.strip().startswith(code) else "" for it in text.splitlines()]
        number = getattr(node, "lineno", 1)
        yield from ((number, it) for _, it in paragraphs([(number, line) for line in lines]))


def of_messages(tree):
    """Texts that a module raises, with X where a value is inserted."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Raise) and isinstance(node.exc, ast.Call):
            for text in node.exc.args:
                if isinstance(text, ast.JoinedStr):
                    parts = (
                        it.value if isinstance(it, ast.Constant) else "X" for it in text.values
                    )
                    yield node.lineno, clean("".join(parts))
                elif isinstance(text, ast.Constant) and isinstance(text.value, str):
                    yield node.lineno, clean(text.value)


def of_rustdoc(text):
    code, lines = False, []
    for number, line in enumerate(text.splitlines(), 1):
        line = line.strip()
        doc = line.startswith(("///", "//!"))
        fence = doc and "```" in line
        code ^= fence
        lines.append((number, line[3:] if doc and not code and not fence else ""))
    return paragraphs(lines)


def of_comments(text, sign):
    lines = ((i, line.strip()) for i, line in enumerate(text.splitlines(), 1))
    return paragraphs([(i, it[len(sign) :] if it.startswith(sign) else "") for i, it in lines])


def collected():
    """All sentences by set: pairs of a place and a paragraph."""
    names = "pages", "changelog", "docstrings", "messages", "rustdoc", "comments"
    found = {name: [] for name in names}

    def put(name, path, texts):
        found[name] += [(f"{path.relative_to(ROOT)}:{i}", text) for i, text in texts]

    for path in [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]:
        put("pages", path, of_page(path.read_text("utf-8")))
    changes = ROOT / "CHANGELOG.md"
    put("changelog", changes, of_page(changes.read_text("utf-8")))
    for path in sorted((ROOT / "python" / "zivi").rglob("*.py")):
        text = path.read_text("utf-8")
        tree = ast.parse(text)
        put("docstrings", path, of_docstrings(tree))
        put("messages", path, of_messages(tree))
        put("comments", path, of_comments(text, "# "))
    for path in sorted((ROOT / "crates").rglob("*.rs")):
        if "target" not in path.parts:
            text = path.read_text("utf-8")
            put("rustdoc", path, of_rustdoc(text))
            put("comments", path, of_comments(text, "// "))
    return found


SETS = collected()


def hits(kind, text):
    return len(re.findall(KINDS[kind], text))


def rate(kind, name):
    """Faults of a kind per 10,000 words of a set."""
    words = sum(len(text.split()) for _, text in SETS[name])
    return 1e4 * sum(hits(kind, text) for _, text in SETS[name]) / words


@pytest.mark.parametrize("name", SETS)
def test_faults_are_within_their_budget(name):
    assert BUDGET[name].keys() == KINDS.keys()
    assert sum(len(text.split()) for _, text in SETS[name]) > 5000
    many = {
        kind: f"{found:.1f} per 10,000 words; the budget is {budget}: "
        f"python tests/test_style.py {kind} {name}"
        for kind, budget in BUDGET[name].items()
        if (found := rate(kind, name)) > budget
    }
    assert many == {}


@pytest.mark.parametrize(
    ("kind", "sentence", "better"),
    [
        ("what_clause", "What a batch takes of memory.", "Memory requirement of a batch (bytes)."),
        ("told_asked", "its step is told the reference", "the reference is passed to its step"),
        ("is_no", "'mas' is no parameter of this force", "unknown parameter 'mas'"),
        ("shared_rel", "The file, also of a batch.", "The file of a run or a batch."),
        ("beyond_etc", "a point behind the wall", "a point at x < 0"),
        ("take_give", "Give the time of rest.", "Return the time of rest (s)."),
    ],
)
def test_a_fault_is_found(kind, sentence, better):
    assert hits(kind, sentence) == 1
    assert not any(hits(it, better) for it in KINDS)


def test_messages_have_their_values_inserted():
    """A part of a text in several lines that lacks its f shows the name in braces."""
    braces = re.compile(r"\{\w+[^{}]*\}")
    assert not [it for it in SETS["messages"] if braces.search(it[1])]
    tree = ast.parse('raise ValueError(f"x is {x}, " "got {y!r:.9}")')
    assert [braces.search(it).group() for _, it in of_messages(tree)] == ["{y!r:.9}"]


def test_code_is_left_out():
    page = "Text.\n\n```python\nWhat it is.\n```\n\nA `what is` of\nwhat follows.\n"
    assert of_page(page) == [(1, "Text."), (7, "A X of what follows.")]
    rust = "/// Give it.\nfn give() {}\n    // why\n"
    assert of_rustdoc(rust) == [(1, "Give it.")]
    assert of_comments(rust, "// ") == [(3, "why")]
    tree = ast.parse('def f(x):\n    """Give x."""\n    raise ValueError(f"{x} is no number")\n')
    assert list(of_docstrings(tree)) == [(1, "Give x.")]
    assert list(of_messages(tree)) == [(3, "X is no number")]


if __name__ == "__main__":
    chosen = sys.argv[2:] or list(SETS)
    for name in chosen:
        for place, text in SETS[name]:
            if sys.argv[1:] and hits(sys.argv[1], text):
                print(f"{name}\t{place}\t{text[:240]}")
        print(name, {kind: round(rate(kind, name), 1) for kind in KINDS})
