"""The table of error against work, by one command: ``python -m zeno --out results.md``.

Every adapter runs in an interpreter of its own, by default this one;
``--python siconos_moreau=/usr/bin/python3`` names another. A tool that is missing is left out with
a word.
"""

import argparse
import json
import math
import os
import subprocess
import sys
from pathlib import Path

from .problem import load

HERE = Path(__file__).parent
ADAPTERS = sorted(path.stem for path in (HERE / "adapters").glob("[!_]*.py"))
HEAD = ("tool", "setting", "error", "error of Zeno times", "evaluations", "steps", "CPU (s)")


def gather(adapter, options, python):
    """Run the worker on each problem; gives its lines, and a word if it broke or took too long."""
    rows, path = [], os.pathsep.join([str(HERE.parent), os.environ.get("PYTHONPATH", "")])
    for problem in options.problems or [problem.id for problem in load()]:
        command = [python, "-m", "zeno.worker", adapter, "--seconds", str(options.seconds)]
        try:
            done = subprocess.run(
                [*command, "--problems", problem],
                capture_output=True,
                text=True,
                env={**os.environ, "PYTHONPATH": path},
                timeout=60 + 4 * options.seconds,
            )
        except subprocess.TimeoutExpired:
            rows.append({"tool": adapter, "problem": problem, "failed": "did not end"})
            continue
        found = [json.loads(line) for line in done.stdout.splitlines() if line.startswith("{")]
        rows += found
        if done.returncode:
            last = (done.stderr.strip().splitlines() or ["no message"])[-1]
            rows.append({"tool": adapter, "problem": problem, "failed": last})
        if any("missing" in row for row in found):
            break
    return rows


def figure(x):
    """Write an error."""
    return "" if x is None else "not reached" if not math.isfinite(x) else f"{x:.0e}"


def table(rows):
    """Write all runs as Markdown."""
    lines = []
    for row in rows:
        if "missing" in row:
            lines.append(f"{row['tool']}: left out ({row['missing']})\n")
    for problem in load():
        mine = [row for row in rows if row.get("problem") == problem.id]
        if not mine:
            continue
        lines += [f"\n## {problem.id}: {problem.title}\n", "| " + " | ".join(HEAD) + " |"]
        lines.append("|" + " --- |" * len(HEAD))
        for row in mine:
            if why := row.get("refused") or row.get("failed"):
                body = [row["tool"], str(row.get("level", "")), why, "", "", "", ""]
            else:
                body = [row["tool"], f"{row['level']:.0e}", figure(row["error"])]
                body += [figure(row["zeno"]), str(row["evaluations"]), str(row["steps"])]
                body.append(f"{row['seconds']:.2f}")
            lines.append("| " + " | ".join(body) + " |")
    return "\n".join(lines) + "\n"


def main():
    """Run, write, print."""
    parser = argparse.ArgumentParser(prog="zeno", description=__doc__)
    parser.add_argument("--adapters", nargs="*", default=ADAPTERS, choices=ADAPTERS)
    parser.add_argument("--problems", nargs="*", default=[], help="by their files' names")
    parser.add_argument("--python", nargs="*", default=[], metavar="ADAPTER=PROGRAM")
    parser.add_argument(
        "--seconds", type=float, default=30.0, help="no finer setting of a problem after so long"
    )
    parser.add_argument("--out", help="write here instead of printing")
    options = parser.parse_args()
    pythons = dict(each.split("=", 1) for each in options.python)
    rows = []
    for adapter in options.adapters:
        rows += gather(adapter, options, pythons.get(adapter, sys.executable))
    text = table(rows)
    if options.out:
        head = "# Results\n\nWritten by `python -m zeno --out`; CPU times are of one machine.\n\n"
        Path(options.out).write_text(head + text)
    else:
        print(text)


if __name__ == "__main__":
    main()
