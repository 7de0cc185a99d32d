"""The problems, read from their files, and their formulas as functions. Standard library only."""

import ast
import json
import math
from dataclasses import dataclass
from pathlib import Path

FOLDER = Path(__file__).parent / "problems"
FUNCTIONS = {"sin": math.sin, "cos": math.cos, "sqrt": math.sqrt, "exp": math.exp, "abs": abs}
ALLOWED = (
    *(ast.Expression, ast.BinOp, ast.UnaryOp, ast.Call, ast.Name, ast.Load, ast.Constant, ast.List),
    *(ast.Add, ast.Sub, ast.Mult, ast.Div, ast.Pow, ast.USub, ast.UAdd),
)


def check(formula):
    """Refuse what is not arithmetic with names, numbers and the five functions."""
    tree = ast.parse(formula, mode="eval")
    for node in ast.walk(tree):
        plain = isinstance(node, ALLOWED)
        if isinstance(node, ast.Call):
            plain = isinstance(node.func, ast.Name) and node.func.id in FUNCTIONS
        elif isinstance(node, ast.Constant):
            plain = isinstance(node.value, (int, float))
        if not plain:
            raise ValueError(f"formula {formula!r}: {type(node).__name__} is not allowed")


@dataclass
class Motion:
    """What a tool found: states at the times of the truth, times of accumulations, its work."""

    states: list
    """For each state of the truth a pair (q, qdot), or None where it was not reached."""
    zeno: list
    """Times, ascending; None from a tool that reports none."""
    evaluations: int
    steps: int
    orbit: list | None = None
    """Of an orbit: times of its impacts, then speeds after them."""


class Problem:
    """One file. Formulas become functions ``f(t, q, v)``; calls of the force are counted."""

    def __init__(self, given):
        self.given = given
        self.id, self.title = given["id"], given["title"]
        self.names = given["coordinates"]
        self.n, self.gaps, self.joints = len(self.names), given["gaps"], given["joints"]
        self.e = [float(gap["e"]) for gap in self.gaps]
        start = given["start"]
        self.t0, self.end = float(start["t"]), float(given["end"])
        self.q0, self.v0 = ([float(x) for x in start[key]] for key in ("q", "qdot"))
        self.constants = {key: float(x) for key, x in given["parameters"].items()}
        self.is_orbit = "orbit" in given["truth"]
        self.truth = given["truth"]
        self.times = [float(state["t"]) for state in self.truth["states"]]
        self.calls = 0
        self.mass = self.compile(given["mass"])
        force = self.compile(given["force"])

        def counted(t, q, v):
            self.calls += 1
            return force(t, q, v)

        self.force = counted

    def compile(self, formulas):
        """Make one function of a formula or of nested lists of formulas."""
        source = self.source(formulas)
        check(source)
        count = range(self.n)
        places = [f"_q[{i}]" for i in count] + [f"_v[{i}]" for i in count]
        names = self.names + [name + "dot" for name in self.names]
        head = "".join(f" {a} = {b}\n" for a, b in zip(names, places, strict=True) if a in source)
        scope = {"__builtins__": {}, **FUNCTIONS, **self.constants}
        exec(f"def f(t, _q, _v):\n{head} return {source}\n", scope)
        return scope["f"]

    def source(self, formulas):
        """Write nested lists of formulas as one expression."""
        if isinstance(formulas, str):
            return f"({formulas})"
        return "[" + ", ".join(self.source(part) for part in formulas) + "]"

    def number(self, name):
        """Evaluate a formula without variables."""
        return float(self.compile(name)(0.0, self.q0, self.v0))

    def part(self, key):
        """Compile one formula of every gap into one function."""
        return self.compile([gap[key] for gap in self.gaps])


def load(name=None):
    """Read one problem, or all in order of their files."""
    if name is not None:
        return Problem(json.loads((FOLDER / f"{name}.json").read_text()))
    return [load(path.stem) for path in sorted(FOLDER.glob("*.json"))]


def errors(problem, motion):
    """Largest error of states (or of an orbit), and of the times of accumulations.

    Infinite where a state is missing; None where the tool reports no such times, or the problem
    has none.
    """
    if problem.is_orbit:
        orbit = problem.truth["orbit"]
        true = [float(x) for x in orbit["times"] + orbit["speeds"]]
        found = motion.orbit
        return (max(abs(a - b) for a, b in zip(found, true)) if found else math.inf), None  # noqa: B905
    worst = 0.0
    for true, found in zip(problem.truth["states"], motion.states, strict=True):
        if found is None:
            return math.inf, None
        numbers = [float(x) for x in true["q"] + true["qdot"]]
        apart = [abs(a - b) for a, b in zip(numbers, [*found[0], *found[1]], strict=True)]
        worst = max(worst, *apart) if all(map(math.isfinite, apart)) else math.inf
    exact = [float(at["t"]) for at in problem.truth["zeno"]]
    if motion.zeno is None or not exact:
        return worst, None
    if not motion.zeno:
        return worst, math.inf
    return worst, max(min(abs(t - found) for found in motion.zeno) for t in exact)
