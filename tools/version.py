"""The version, in every file that names it: ``python tools/version.py 0.2.0`` sets it.

Without a version it says which stands where, and fails where two differ; ``--tag v0.2.0`` fails
where it is not that of the tag. Setting it also cuts CHANGELOG.md: what is unreleased becomes the
release.
"""

import argparse
import datetime
import re
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
NUMBER = r"\d+\.\d+\.\d+"
PLACES = {
    "Cargo.toml": [
        r'(?m)^version = "({})"$',
        r'(?m)^zivi[\w-]* = \{{ path = "[^"]*", version = "({})"',
    ],
    "crates/zivi-wasm/Cargo.toml": [r'(?m)^version = "({})"$'],
    "CITATION.cff": [r"(?m)^version: ({})$"],
}
LOCKS = ("Cargo.lock", "crates/zivi-wasm/Cargo.lock", "tools/no-panic/Cargo.lock")
LOCKED = r'name = "zivi[\w-]*"\nversion = "({})"'
"""In locks, only packages of this project (those without a source) have such names."""


def places(root):
    """Give each file with its expressions."""
    found = dict(PLACES)
    found |= {name: [LOCKED] for name in LOCKS if re.search("zivi", (root / name).read_text())}
    return found


def read(root):
    """Give file and version for every place."""
    return [
        (name, match.group(1))
        for name, expressions in places(root).items()
        for expression in expressions
        for match in re.finditer(expression.format(NUMBER), (root / name).read_text())
    ]


def put(match, version):
    """Replace the version in what was found."""
    start, end = (at - match.start() for at in match.span(1))
    return match.group(0)[:start] + version + match.group(0)[end:]


def write(root, version, day):
    """Set the version, cut the list of changes, date the citation."""
    for name, expressions in places(root).items():
        text = (root / name).read_text()
        for expression in expressions:
            text = re.sub(expression.format(NUMBER), lambda match: put(match, version), text)
        if name == "CITATION.cff":
            text = re.sub(r"(?m)^date-released:.*\n", "", text)
            text = re.sub(r"(?m)^(version: .*\n)", rf"\g<1>date-released: {day}\n", text)
        (root / name).write_text(text)
    changes = root / "CHANGELOG.md"
    text = changes.read_text()
    if f"## {version} " in text:
        raise SystemExit(f"CHANGELOG.md has {version} already")
    heading = f"## Unreleased\n\n## {version} ({day})\n"
    changes.write_text(text.replace("## Unreleased\n", heading, 1))


def main():
    """Check, or set."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("version", nargs="?")
    parser.add_argument("--tag", help="of the release, with its v")
    parser.add_argument("--root", type=Path, default=ROOT)
    options = parser.parse_args()
    if options.version:
        if not re.fullmatch(NUMBER, options.version):
            parser.error(f"version must be three numbers, got {options.version!r}")
        write(options.root, options.version, datetime.date.today().isoformat())
    found = read(options.root)
    for name, version in found:
        print(f"{version}  {name}")
    versions = {version for _, version in found}
    if len(versions) != 1:
        sys.exit("the versions differ")
    if options.tag and options.tag != "v" + versions.pop():
        sys.exit(f"the tag is {options.tag}")


if __name__ == "__main__":
    main()
