"""Random formulas, most of them bad: each derived or refused with `FormulaError`, within bounds.

``python benchmarks/fuzz_formulas.py [N] [SEED]`` tries N of them (100000) and prints the slowest
and the memory; it ends with 1 if one raised another error, or took more than 2 s or 500 MB.
"""

from __future__ import annotations

import random
import resource
import sys
import time

from zivi.base.expressions import c_source
from zivi.symbolic import FormulaError
from zivi.system.symbolic_system import derive

SECONDS, MEGABYTES = 2.0, 500.0
NAMES = ("x", "xdot", "y", "ydot", "t", "k", "m", "pi")
STRANGE = (
    "E",
    "I",
    "S",
    "N",
    "Q",
    "gamma",
    "beta",
    "oo",
    "zoo",
    "nan",
    "µ",
    "x²",
    "lambda",
    "__import__",
    "q",
    "w",
    "p",
    "X",
)
FUNCTIONS = (
    *(
        "sin",
        "cos",
        "tan",
        "asin",
        "acos",
        "atan",
        "sinh",
        "cosh",
        "tanh",
        "asinh",
        "acosh",
        "atanh",
    ),
    *("exp", "log", "sqrt", "abs", "sign"),
)
NUMBERS = (
    *(
        "0",
        "1",
        "2",
        "3",
        "7",
        "-1",
        "0.5",
        "1.5",
        "99",
        "100",
        "+100",
        "101",
        "1e9",
        "1e300",
        "1e308",
        "1e-300",
        "1e999",
    ),
    *(
        "999999999",
        "1000000007",
        "(+999999999)",
        "9**9",
        "2**-99",
        "(1/3)",
        "1_000",
        "0x10",
        "1j",
        "True",
        "''",
        "0.0",
    ),
)
WHERE = ("V", "V", "V", "gap", "Q", "T")


def formula(drawn: random.Random, depth: int) -> str:
    """Draw a formula of a given depth."""
    kind = drawn.random()
    if depth <= 0 or kind < 0.12:
        lot = drawn.random()
        pool = NAMES if lot < 0.65 else NUMBERS if lot < 0.995 else STRANGE
        return drawn.choice(pool)
    inner = formula(drawn, depth - 1)
    if kind < 0.32:
        return f"{drawn.choice(FUNCTIONS)}({inner})"
    if kind < 0.36:
        return f"{drawn.choice(('min', 'max', 'atan2'))}({inner}, {formula(drawn, depth - 1)})"
    if kind < 0.42:
        return f"-({inner})"
    other = formula(drawn, depth - 1 - drawn.randrange(3))
    operator = drawn.choice(("+", "-", "*", "*", "/", "**", "**"))
    return drawn.choice((f"({inner}){operator}({other})", f"({inner} {operator} {other})"))


def long_formula(drawn: random.Random) -> str:
    """Draw a formula that repeats itself: towers, sums and products."""
    part, times = (
        formula(drawn, drawn.randrange(3)),
        drawn.choice((2, 3, 5, 9, 17, 30, 45, 90, 300)),
    )
    kind = drawn.randrange(4)
    if kind == 0:
        operator = drawn.choice(("+", "*", "**", "/", "-"))
        return operator.join([f"({part})"] * times)
    if kind == 1:
        operator = drawn.choice(("+", "*", "/"))
        return operator.join(f"{drawn.choice(FUNCTIONS)}({n}*x + {part})" for n in range(times))
    whole = part
    for n in range(times):
        step = ("{f}({n} + {w})", "(({w})**{n})", "({w} + k)**{e}", "x*{f}({w})", "1/({n} + {w})")[
            drawn.randrange(5)
        ]
        whole = step.format(
            f=drawn.choice(FUNCTIONS),
            n=n % 7,
            w=whole,
            e=drawn.choice(("2", "99", "x", "0.5", "-1")),
        )
    return whole


def spoiled(drawn: random.Random, text: str) -> str:
    """Change some characters."""
    letters = list(text)
    for _ in range(drawn.randrange(1, 4)):
        place = drawn.randrange(len(letters) + 1)
        letters[place : place + drawn.randrange(2)] = drawn.choice(
            ["(", ")", "*", "^", "[", "'", "\0", "\n", ".", "𝐱", "−", " ", "λ", ""]
        )
    return "".join(letters)


def draw(drawn: random.Random) -> str:
    """Draw a text."""
    text = long_formula(drawn) if drawn.random() < 0.1 else formula(drawn, drawn.randrange(1, 7))
    return spoiled(drawn, text) if drawn.random() < 0.1 else text


def tried(text: str, where: str) -> str:
    """Read, derive and print a formula in one place; give what came of it."""
    given = {"T": "m*xdot**2/2 + ydot**2/2", "V": "k*x**2/2", "gaps": ["x"], "Q": ["0", "-ydot"]}
    given |= {
        "V": {"V": text},
        "gap": {"gaps": [text]},
        "Q": {"Q": ["0", text]},
        "T": {"T": f"m*xdot**2/2 + ydot**2*({text})"},
    }[where]
    try:
        found = derive(
            "x y",
            given["T"],
            given["V"],
            given["Q"],
            given["gaps"],
            {"k": 2.0, "m": 1.0},
            qdot=None,
        )
        c_source(found.entries)
    except FormulaError:
        return "refused"
    except ValueError as error:
        # what the formulas mean together is wrong
        known = ("quadratic", "got velocities", "compiled form")
        return "no system" if any(word in str(error) for word in known) else f"ValueError: {error}"
    except Exception as error:
        return f"{type(error).__name__}: {error}"
    return "taken"


def main(count: int, seed: int) -> int:
    """Try formulas, and report."""
    counts: dict[str, int] = {}
    wrong, slowest = [], (0.0, "")
    tried("x", "V")  # imports
    for n in range(count):
        drawn = random.Random(f"{seed}-{n}")
        text, where = draw(drawn), drawn.choice(WHERE)
        start = time.process_time()
        told = tried(text, where)
        seconds = time.process_time() - start
        slowest = max(slowest, (seconds, f"{n}: {where} = {text[:300]}"))
        kind = told if told in ("taken", "refused", "no system") else "wrong"
        counts[kind] = counts.get(kind, 0) + 1
        if kind == "wrong" or seconds > SECONDS:
            wrong.append(n)
            print(f"{n}: {where} = {text[:600]!r}: {told[:300]}, {seconds:.1f} s", flush=True)
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    print(f"{counts}, slowest {slowest[0]:.2f} s ({slowest[1]}), memory {peak:.0f} MB")
    return int(bool(wrong) or peak > MEGABYTES)


if __name__ == "__main__":
    sys.exit(
        main(*(int(word) for word in (*sys.argv[1:], "100000", "1")[:2]))
        if len(sys.argv) != 2
        else main(int(sys.argv[1]), 1)
    )
