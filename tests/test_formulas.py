"""The language of formulas: what it takes means what it says, all else is refused, soon."""

import functools
import math
import random
import resource
import sys
from pathlib import Path

import numpy as np
import pytest

import zivi
from inside import (
    FUNCTIONS,
    FormulaError,
    depends,
    derive,
    expression,
    files_commands as commands,
    parse,
)
from interrupting import calls_in
from zivi import files
from zivi.files import FileError

sympy = pytest.importorskip("sympy")

sys.path.append(str(Path(__file__).parents[1] / "benchmarks"))
import fuzz_formulas  # noqa: E402

X, Y = sympy.symbols("x y", real=True)
NAMES = {"x": X, "y": Y}


def derived(V="0", T="m*xdot**2/2", parameters=("m", "k"), **others):
    given = {"Q": None, "gaps": ["x"], "qdot": None} | others
    return derive("x", T, V, parameters=dict.fromkeys(parameters, 1.5), **given)


@pytest.mark.parametrize(
    ("name", "meant"),
    [
        *(
            (name, "")
            for name in ("E", "I", "S", "N", "Q", "O", "oo", "zoo", "nan", "gamma", "zeta")
        ),
        ("beta", ""),
        ("xdott", "did you mean xdot?"),
        ("M", "did you mean m?"),
        ("__import__", ""),
    ],
)
def test_a_forgotten_parameter_is_named_with_all_that_is_declared(name, meant):
    with pytest.raises(FormulaError) as told:
        derived(V=f"{name}*k*x**2/2")
    assert f"V has {name}, which is not a coordinate (x), a velocity (xdot)" in str(told.value)
    assert "a parameter (m, k)" in str(told.value)
    assert meant in str(told.value)
    assert meant or f"parameters={{'{name}': ...}}" in str(told.value)


@pytest.mark.parametrize("name", ["E", "I", "S", "N", "Q", "C", "O", "beta", "gamma", "zeta"])
def test_every_name_can_be_declared(name):
    system = zivi.symbolic.system(
        "x", T="xdot**2/2", V=f"{name}*x**2/2", parameters={name: 3.0}, gaps=["x"]
    )
    assert system.at(0.0, [2.0], [0.0]).force == pytest.approx([-6.0])


def test_an_exponent_that_is_whole_but_for_rounding_is_whole():
    # tanh(1000) is 1 - 1e-868, which SymPy cannot tell from 1
    system = zivi.symbolic.system(
        "x", T="xdot**2/2", Q=["(1 + x**2)**(tanh(1000) - 3)"], gaps=["x"]
    )
    assert system.at(0.0, [2.0], [0.0]).force == pytest.approx([1 / 25])


def test_a_tower_of_powers_of_numbers_takes_no_time():
    one, tower, systems = math.pi ** (1 / 3), "**".join(["(pi**(1/3))"] * 17), []

    def make():
        systems.append(zivi.symbolic.system("x", T="xdot**2/2", Q=[f"x*{tower}"], gaps=["x"]))

    assert calls_in(make) < 1_000_000
    (system,) = systems
    exact = functools.reduce(lambda exponent, _: one**exponent, range(16), one)
    assert system.at(0.0, [1.0], [0.0]).force == pytest.approx([exact], rel=1e-14)


def test_the_micro_sign_is_the_letter_mu():
    for declared in ("\N{MICRO SIGN}", "\N{GREEK SMALL LETTER MU}"):
        for used in ("\N{MICRO SIGN}", "\N{GREEK SMALL LETTER MU}"):
            system = zivi.symbolic.system(
                "x", T="xdot**2/2", Q=[f"-{used}*xdot"], parameters={declared: 0.5}, gaps=["x"]
            )
            assert system.at(0.0, [1.0], [2.0]).force == pytest.approx([-1.0])
            assert system.replace(**{used: 1.0}).parameters[declared] == 1.0
    with pytest.raises(ValueError, match="must mean one thing"):
        derived(parameters=("\N{MICRO SIGN}", "\N{GREEK SMALL LETTER MU}"))


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("9**9**9", "the exponent 3.8742e[+]08 is too high: at most 100"),
        ("9**(+999999999)", "the exponent 1e[+]09 is too high"),
        ("((9**99)**99)**99", "a number is too large"),
        ("x**-101", "the exponent -101 is too high"),
        ("(x + xdot + 1)**(10*11)", "the exponent 110 is too high"),
        ("((x + 1)**100)**11", "its degree is above 1000"),
        ("((3*x)**30)**30", "a number is too large"),
        ("(x/x)*9**99*9**99*9**99*9**99", "a number is too large"),
        ("exp(exp(exp(7*x/x)))", "a number is too large"),
        ("exp(1e300*x)*1e10", "a number is too large"),
        ("x**(101*x/x)", "an exponent is too high"),
        ("tan(pi)**x", "a power of a number <= 0"),
        ("(-2)**x", "a power of a number <= 0"),
        ("exp(-900)", "a number is too small"),
        ("1e-200*x*1e-200", "a number is too small"),
        ("1/0", "it divides by zero"),
        ("1/(x - x)", "not a real number"),
        ("x*log(0)", "not a real number"),
        ("sqrt(-2)", "not a real number"),
        ("acos(2)*x", "not a real number"),
        ("1e400", "a number is too large"),
        ("1" + 310 * "0", "a number is too large"),
        ("x" + "+x" * 250, "more than 500 numbers, names, operators and functions"),
        (
            "*".join(f"sin({n}*x)" for n in range(40)),
            "second derivatives have more than 10000 parts",
        ),
        ("(" * 45 + "x" + "**x)" * 45, "second derivatives have more"),
        ("sin(" * 45 + "x" + ")" * 45, "more than 40 levels"),
        ("-" * 3000 + "x", "it is not a formula|more than 40 levels"),
        ("(" * 3000, "it is not a formula"),
        ("x" * 10_001, "more than 10000 characters"),
        ("x²", "invalid character '²'"),
        ("x − 1", "invalid character '−'"),
        ("lambda*x", "it is not a formula"),
        ("x^2", r"a power is \*\*"),
        ("x % 2", "Mod is not allowed in a formula"),
        ("x//2", "FloorDiv is not allowed"),
        ("x == 2", "Compare is not allowed"),
        ("x.real", "Attribute is not allowed"),
        ("sin(x)(2)", "Call is not allowed"),
        ("sin(x, evaluate=1)", "Call is not allowed"),
        ("True*x", "Constant is not allowed"),
        ("2j", "Constant is not allowed"),
        ("not x", "UnaryOp is not allowed"),
        ("~x", "UnaryOp is not allowed"),
        ("sin(x, x)", "sin takes 1 argument, got 2"),
        ("atan2(x)", "atan2 takes 2 arguments, got 1"),
        ("sin*x", "sin needs an argument"),
        ("sinn(x)", r"unknown function sinn; did you mean sin\?"),
        ("Abs(x)", r"unknown function Abs; did you mean abs\?"),
        ("x(2)", "unknown function x$"),
        ("", "it is not a formula"),
        ("\0", "it is not a formula"),
    ],
)
def test_what_is_no_formula_or_too_large_is_refused_at_once(text, told):
    def refused():
        with pytest.raises(FormulaError, match=told):
            derived(V=text)

    assert calls_in(refused) < 500_000


@pytest.mark.parametrize("raised", [TypeError, ValueError, AttributeError, RecursionError])
@pytest.mark.parametrize(
    ("broken", "told"),
    [
        ("sympy.core.numbers.Float.__add__", "the formula"),
        ("sympy.core.expr.Expr.diff", "T, V, Q and gaps"),
        ("sympy.core.basic.Basic.has", "the equations"),
        ("sympy.cse", "the equations"),
        ("sympy.printing.c.C99CodePrinter.doprint", "the equations"),
    ],
)
def test_whatever_sympy_raises_the_formula_is_refused(monkeypatch, broken, told, raised):
    def fails(*_, **__):
        raise raised("Invalid comparison of\nnon-real log(tanh(pi**2))")

    monkeypatch.setattr(broken, fails)
    wanted = rf"SymPy cannot work with {told} \({raised.__name__}: Invalid comparison of non-real"
    with pytest.raises(FormulaError, match=wanted):
        zivi.symbolic.system("x", T="xdot**2/2", V="(0.5 + x)*x", gaps=["x"])


def test_whatever_sympy_raises_derivatives_slip_speeds_and_inputs_are_refused(monkeypatch):
    def fails(*_, **__):
        raise TypeError("no truth value")

    found = derived(V="k*x**2/2")
    with monkeypatch.context() as inside:
        inside.setattr("sympy.core.expr.Expr.diff", fails)
        with pytest.raises(FormulaError, match="cannot work with the derivatives of the equations"):
            found.partials()
    with monkeypatch.context() as inside:
        # the first question is of T, the second of the slip speed
        answers = iter([lambda *_: False, fails])
        inside.setattr("zivi.system.symbolic_system.depends", lambda *of: next(answers)(*of))
        slip = {"slips": {"gap0": "xdot"}, "mu": {"gap0": 0.5}}
        with pytest.raises(FormulaError, match="cannot work with slip speed of gap 'gap0'"):
            zivi.symbolic.system("x", T="xdot**2/2", gaps=["x"], **slip)
    monkeypatch.setattr("sympy.core.numbers.Float.__complex__", fails, raising=False)
    with pytest.raises(FormulaError, match=r"with inputs\['u0'\] \(TypeError: no truth"):
        zivi.symbolic.system("x", T="xdot**2", gaps=["x"], inputs=[[sympy.Float(0.5)]])


def test_a_parameter_that_is_a_word_of_python():
    with pytest.raises(FormulaError, match="lambda is a word of Python: give it another name"):
        derived(V="lambda*x", parameters=("m", "lambda"))
    with pytest.raises(ValueError, match="pi must not be redefined"):
        derived(parameters=("m", "pi"))
    with pytest.raises(ValueError, match="q must hold names of letters and digits, got '2x'"):
        derive("2x", "1", 0, None, [], None, qdot=None)


def test_limits_are_the_last_values_that_are_taken():
    sines = "sin(" * 25 + "x" + ")" * 25
    for text in ("x**100", "x**-100", "(x**100)**10", "x" + "+x" * 249, " " * 9_999 + "x", sines):
        assert parse(text)
    for text in ("-" * 40 + "x", "1e300", "1e-300", "(x)+(+x)--x"):
        assert parse(text)
    assert derived(Q=["(x + xdot + 1)**100"]).entries


def worked_out(text, x, y):
    """The value as Python itself has it."""
    names = {name: function for name, (_, function) in FUNCTIONS.items()}
    return eval(text, {"__builtins__": {}}, names | {"pi": math.pi, "x": x, "y": y})


@pytest.mark.parametrize(
    "text",
    [
        *(f"{name}(x)" for name, (n, _) in FUNCTIONS.items() if n == 1 and name != "acosh"),
        *(f"{name}(x, y) + {name}(y, x)" for name in ("atan2", "min", "max")),
        "acosh(1 + x) + sqrt((x - 1)**2)",
        "x - y - 1 - (x - (y - 1))",
        "x/y/2/(x/(y/2))",
        "x**y**2 + -x**2 + (-x)**2 + 2**-x",
        "+x - -y*pi + 1_0*0x10/3",
        "12345678*x + 12345678/7 + y*1e17",
        "min(3, 2)*x + max(pi, 4)*y + abs(-3) + sign(-2) + sign(0)",
    ],
)
def test_the_value_is_that_of_python(text):
    found = expression(text, NAMES)
    for x, y in ((0.3, 0.7), (0.9, 0.2)):
        system = zivi.symbolic.system("u", T="udot**2/2", Q=[text], parameters={"x": x, "y": y})
        value = worked_out(text, x, y)
        assert system.at(0.0, [0.0], [0.0]).force == pytest.approx([value], rel=1e-14)
        assert found.free_symbols <= {X, Y}


@pytest.mark.parametrize(
    "text", ["abs(x)", "sign(x)*x**2", "max(x, y)*x", "min(x, 2*y)", "sqrt(x**2)"]
)
@pytest.mark.parametrize("compiler", ["c", "numba"])
def test_derivatives_of_functions_with_a_kink_against_differences(text, compiler):
    if compiler == "numba":
        pytest.importorskip("numba")
    system = zivi.symbolic.system(
        "x y", T="(xdot**2 + ydot**2)/2", V=text, gaps=[text + "+ 9"], compiler=compiler
    )
    h = 1e-6
    for place in ((0.3, 0.7), (0.9, -0.2), (-0.4, -0.9)):

        def energy(i, s, place=place):
            moved = list(place)
            moved[i] += s
            return worked_out(text, *moved)

        slope = [(energy(i, h) - energy(i, -h)) / (2 * h) for i in range(2)]
        here = system.at(0.0, place, [0.0, 0.0])
        assert -here.force == pytest.approx(np.array(slope), abs=1e-8)
        assert here.gradients[0] == pytest.approx(np.array(slope), abs=1e-8)


@pytest.mark.parametrize(
    ("T", "quadratic"),
    [
        ("xdot**2*(sin(x)**2 + cos(x)**2)", True),
        ("xdot**4/(xdot + x)**2 + x*xdot**2", False),
        ("((xdot + 1)**2 - 2*xdot - 1)*exp(x)", True),
        ("((xdot + 1)**3 - xdot**3 - 3*xdot)/(1 + x**2)", True),
        ("xdot**2/2 + 1e-30*xdot**3", False),
        ("(x + xdot + 1)**100", False),
        ("exp(exp(exp(exp(exp(xdot)))))", False),
        ("xdot**2*log(x - 5)", True),
        ("abs(xdot)*xdot", False),
        ("max(xdot, x)*xdot", False),
    ],
)
def test_whether_the_kinetic_energy_is_quadratic(T, quadratic):
    if quadratic:
        derived(T=T)
    else:
        with pytest.raises(ValueError, match="T must be quadratic in the velocities"):
            derived(T=T)


def test_a_value_whose_imaginary_part_vanishes_on_the_way():
    # cos(acosh(x)) is real below 1, where acosh(x) is not
    assert derived(V="atan2(cos(acosh(x)), x)*xdot*0 + x").entries
    found = expression("atan2(cos(acosh(x)), x)*y**2", NAMES)
    assert depends(found, [Y])
    assert not depends(found.diff(Y).diff(Y), [Y])


def test_expressions_of_sympy_with_functions_that_have_no_digits():
    v, u = sympy.symbols("v u", real=True)
    kink = sympy.Piecewise((1, u < 0), (2, True))
    assert not depends(kink * (sympy.sin(v) ** 2 + sympy.cos(v) ** 2), [v])
    assert depends(kink * v, [v])
    assert not depends(kink, [v])


def test_what_is_given_as_no_text_is_never_parsed():
    class Trap:
        def __str__(self):
            return "k*x"

    for given in (Trap(), [1], None, b"x", {"x": 1}):
        with pytest.raises(TypeError, match="V must be one expression, got"):
            derived(V=given)
    assert derived(V=np.float64(2.0)).entries
    assert derived(V=sympy.Symbol("k") * sympy.Symbol("x")).entries


def test_files_and_python_have_one_language(tmp_path):
    for text in ("9**9**9", "((x + 1)**100)**11", "x²", "Abs(x)", "1/0"):
        with pytest.raises(FormulaError) as told:
            derived(V=text)
        path = tmp_path / "file.toml"
        energy = [
            line
            for line in commands.example_file("mechanics").splitlines()
            if line.startswith("V =")
        ]
        path.write_text(commands.example_file("mechanics").replace(energy[0], f'V = "{text}"'))
        with pytest.raises(FileError) as refused:
            files.prepare_simulate(path)
        assert str(told.value).split(": ", 1)[1] in str(refused.value)
        assert "system.V must be an expression" in str(refused.value)


def test_names_of_files_are_read_as_python_reads_them(tmp_path):
    path = tmp_path / "file.toml"
    path.write_text(
        "t_span = [0, 1]\ny0 = [[1.0], [0.0]]\n[system]\nq = ['\N{MICRO SIGN}']\n"
        "T = '\N{GREEK SMALL LETTER MU}dot**2/2'\ngaps = { floor = '\N{MICRO SIGN}' }\n",
        encoding="utf-8",
    )
    assert files.prepare_simulate(path).run().q[-1] == pytest.approx([1.0])


@pytest.mark.slow
def test_random_formulas_are_taken_or_refused_in_bounded_time():

    def tried(text, where):
        assert fuzz_formulas.tried(text, where) in ("taken", "refused", "no system"), text

    for n in range(120):
        drawn = random.Random(f"test-{n}")
        text, where = fuzz_formulas.draw(drawn), drawn.choice(fuzz_formulas.WHERE)
        assert calls_in(functools.partial(tried, text, where)) < 5_000_000, text
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss < 4e6
