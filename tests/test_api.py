"""Conventions of the package: the public list, the documentation, and what importing does."""

import ast
import dataclasses
import doctest
import importlib
import inspect
import pkgutil
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import zivi

PACKAGE = Path(zivi.__file__).parent
# what the interface promises at this stage, spelled out; more may be there
PROMISED = {
    "ImpactSystem": ["force", "e", "kappa"],
    "LinearForce": ["stiffness", "damping", "gravity", "amplitude", "omega", "phase"],
    "ThetaGamma": ["h", "theta", "gamma", "solver"],
    "ExplicitEuler": ["h"],
    "SwitchedRK": ["rtol", "atol", "order"],
    "MoreauJean": ["h", "theta"],
    "simulate": [
        "system",
        "t_span",
        "y0",
        "method",
        "t_eval",
        "events",
        "dense_output",
        "progress",
    ],
    "TwistingRegulator": ["mu1", "mu2", "h", "e", "kappa"],
    "TwistingTracker": ["mu1", "mu2", "h", "e", "kappa", "e_ref", "kappa_ref", "branch"],
    "ExplicitTwisting": ["mu1", "mu2", "h", "e", "kappa", "e_ref", "kappa_ref"],
    "simulate_closed_loop": [
        *("system", "controller", "t_span", "y0", "y_ref0", "force_ref", "force_model"),
    ],
    "lift": ["x", "xdot", "e", "kappa", "branch"],
    "project": ["s", "v", "e", "kappa"],
}
RESULT = "t x xdot s v lambda_s lambda_v residual impacts zeno_times liftoff_times rest_time"
RESULT += " status success message nfev n_steps to_xarray"

# made by the package, not by its users
RESULTS = {"Batch", "ClosedLoop", "ClosedLoopBatch", "Equilibrium", "Observed", "Trajectory"}
RESULTS |= {"MechanicalBatch", "MechanicalSensitivity", "MechanicalTrajectory"}
RESULTS |= {"Attractor", "Basins", "Branch", "BranchEvent", "Diagram", "Lyapunov"}
RESULTS |= {"PeriodicOrbit", "Sensitivity", "VIProgress", "VIResult"}
RESULTS |= {"GainDesign", "MechanicalBranch", "MechanicalClosedLoop", "MechanicalEvent"}
RESULTS |= {"MechanicalLoopBatch", "MechanicalOrbit", "ReferenceSample"}
RESULTS |= {"CodimensionTwo", "EventCurve"}
RESULTS |= {"Bootstrap", "Fit", "Profile"}
# found in the rooms of the package, and as `zivi.Name`, but not among the names to begin with
IN_ROOMS = RESULTS | {"ImpactMap", "ImpactReturn"}
NAMES = sorted({*zivi.__all__, *IN_ROOMS})
# described by what they have, not made by a call
PROTOCOLS = {"zivi.Controller", "zivi.ImpactLaw", "zivi.MechanicalController", "zivi.Method"}


def modules():
    names = [info.name for info in pkgutil.walk_packages([str(PACKAGE)], "zivi.")]
    return [name for name in names if not name.endswith(("_zivi", "__main__"))]


def public_things():
    """Every public class and function, by its full name."""
    found = {f"zivi.{name}": getattr(zivi, name) for name in NAMES}
    found |= {f"zivi.plot.{name}": getattr(zivi.plot, name) for name in zivi.plot.__all__}
    return {
        name: thing
        for name, thing in found.items()
        if callable(thing) and not inspect.ismodule(thing)
    }


PUBLIC = public_things()


def called_by_users(name):
    thing = PUBLIC[name]
    no_call = inspect.isclass(thing) and issubclass(thing, int | Exception)
    return not no_call and name not in PROTOCOLS | {f"zivi.{made}" for made in RESULTS}


def documented_parameters(thing):
    """Names in the Parameters section of a numpydoc docstring."""
    text = inspect.getdoc(thing) or ""
    section = re.search(r"Parameters\n-+\n(.*?)(?=\n\n\w[\w ,]*\n-+\n|\Z)", text, re.DOTALL)
    if section is None:
        return None
    lines = [line for line in section[1].splitlines() if re.match(r"[\w*]", line)]
    names = [name.strip().lstrip("*") for line in lines for name in line.split(" : ")[0].split(",")]
    return set(names)


def test_the_public_list_is_complete_and_sorted():
    assert sorted(set(zivi.__all__)) == zivi.__all__
    assert len(zivi.__all__) < 95  # with fits
    assert not IN_ROOMS & set(zivi.__all__)
    tree = ast.parse((PACKAGE / "__init__.py").read_text())
    imported = {
        alias.asname or alias.name
        for node in ast.walk(tree)
        if isinstance(node, ast.ImportFrom) and node.module.split(".")[0] == "zivi"
        for alias in node.names
    }
    # for type checkers the modules that are imported when they are asked for
    modules = {"files", "interop", "mechanics", "methods", "native", "plot", "symbolic"}
    assert imported | {"plot"} == {*NAMES, *modules}


def test_importing_the_package_leaves_numpy_for_later():
    program = "import sys, zivi.cli; print('numpy' in sys.modules, zivi.Trajectory.__module__)"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert done.stdout == "False zivi\n", done.stderr


def test_simulating_leaves_studies_orbits_and_plots_for_later():
    program = (
        "import sys, zivi; zivi.simulate\n"
        "late = {'zivi.study', 'zivi.orbits', 'zivi.plot', 'zivi.fmu', 'matplotlib', 'scipy'}\n"
        "print(sorted(late & set(sys.modules)))\n"
        "print(zivi.PeriodicOrbit.__module__, zivi.Study.__module__, zivi.plot.__name__)\n"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert done.stdout.splitlines() == ["[]", "zivi zivi zivi.plot"], done.stderr


ROOMS = (zivi.simulation, zivi.control, zivi.derivatives, zivi.estimation, zivi.orbits, zivi.vi)


@pytest.mark.parametrize("name", sorted(IN_ROOMS))
def test_what_functions_return_is_in_a_room(name):
    (room,) = [room for room in ROOMS if name in room.__all__]
    assert getattr(room, name) is getattr(zivi, name)
    assert getattr(zivi, name).__module__ == "zivi"


def test_a_room_names_what_it_has():
    for room in ROOMS:
        assert sorted(room.__all__) == sorted(set(room.__all__))
        assert all(hasattr(room, name) for name in room.__all__)


@pytest.mark.parametrize("name", PROMISED)
def test_the_promised_arguments(name):
    parameters = list(inspect.signature(getattr(zivi, name)).parameters)
    assert parameters[: len(PROMISED[name])] == PROMISED[name]


def test_the_promised_defaults():
    parameters = inspect.signature(zivi.ThetaGamma).parameters
    defaults = [parameters[name].default for name in ("theta", "gamma", "solver")]
    assert defaults == [1.0, 1.0, "exact"]
    coefficients = inspect.signature(zivi.LinearForce).parameters.values()
    assert [p.default for p in coefficients] == [0.0, 0.0, 0.0, 0.0, 1.0, 0.0, None]
    for name in ("e", "kappa"):
        assert inspect.signature(zivi.ImpactSystem).parameters[name].kind.name == "KEYWORD_ONLY"


def test_the_promised_results():
    fields = {field.name for field in dataclasses.fields(zivi.Trajectory)}
    assert set(RESULT.split()) <= fields | set(dir(zivi.Trajectory))
    ball = zivi.ImpactSystem(-9.81, e=0.5)
    assert [name for name in dir(ball) if not name.startswith("_")] == [
        "e",
        "force",
        "friction",
        "kappa",
        "law",
        "replace",
        "wall",
    ]


@pytest.mark.parametrize("name", PUBLIC)
def test_everything_public_is_documented(name):
    thing = PUBLIC[name]
    assert inspect.getdoc(thing)
    if inspect.isclass(thing):
        for member, value in vars(thing).items():
            described = inspect.isfunction(value) or isinstance(value, property)
            if described and not member.startswith("_"):
                assert inspect.getdoc(value), f"{name}.{member}"


@pytest.mark.parametrize("name", list(filter(called_by_users, PUBLIC)))
def test_every_parameter_is_documented(name):
    thing = PUBLIC[name]
    parameters = set(inspect.signature(thing).parameters)
    if "Parameters and return value as for `" in inspect.getdoc(thing):
        own = parameters - {"sol", "run", "ax", "line"}
        assert all(parameter in inspect.getdoc(thing) for parameter in own), own
    else:
        assert (documented_parameters(thing) or set()) == parameters


@pytest.mark.parametrize("name", sorted(RESULTS))
def test_every_result_field_is_documented(name):
    thing = getattr(zivi, name)
    kinds = [it for it in thing.__mro__ if f"zivi.{it.__name__}" in PUBLIC]
    section = "\n".join(inspect.getdoc(it).split("Attributes\n----------\n")[1] for it in kinds)
    documented = {
        part.strip()
        for line in section.splitlines()
        if re.match(r"\w[\w, ]* : ", line)
        for part in line.split(" : ")[0].split(",")
    }
    # a named tuple has its fields by another name
    named = getattr(thing, "_fields", None)
    fields = set(named or (field.name for field in dataclasses.fields(thing)))
    assert {field for field in fields if not field.startswith("_")} <= documented


def test_the_parameter_check_can_fail():
    def undocumented(a, b):
        """Do.

        Parameters
        ----------
        a : int
            Something.

        Returns
        -------
        int
        """

    assert documented_parameters(undocumented) == {"a"}


SLOW = {"zivi.paper.write"}  # every figure and table of the paper


@pytest.mark.parametrize(
    "name",
    [pytest.param(name, marks=[pytest.mark.slow] * (name in SLOW)) for name in modules()],
)
def test_docstring_examples_run(name):
    import matplotlib.pyplot as plt

    plt.switch_backend("Agg")
    module = importlib.import_module(name)
    result = doctest.testmod(module, extraglobs={"zivi": zivi, "np": np})
    plt.close("all")
    assert result.failed == 0


def examples_of(thing, name, **finder):
    """The examples of a thing whose module is not where it says that it is defined."""
    tests = doctest.DocTestFinder(**finder).find(
        thing, name, module=False, globs={"zivi": zivi, "np": np}
    )
    return [test for test in tests if test.examples]


def failures_of(tests):
    runner = doctest.DocTestRunner()
    for test in tests:
        runner.run(test)
    return runner.failures


CLASSES = [name for name in NAMES if isinstance(getattr(zivi, name), type)]
EXAMPLES = {name: examples_of(getattr(zivi, name), name) for name in CLASSES}


@pytest.mark.parametrize("name", [name for name, tests in EXAMPLES.items() if tests])
def test_docstring_examples_of_public_classes_run(name):
    import matplotlib.pyplot as plt

    plt.switch_backend("Agg")
    assert failures_of(EXAMPLES[name]) == 0
    plt.close("all")


def test_the_package_itself_is_an_example():
    tests = examples_of(zivi, "zivi", recurse=False)
    assert tests
    assert failures_of(tests) == 0


FORMER = (  # modules of version 0.1, and what users may take from them
    *("batch.Batch", "closed_loop.Controller", "control.TwistingTracker", "design.design_tracker"),
    *("events.Level", "loop_batch.ClosedLoopBatch", "loop_run.ClosedLoop", "maps.ImpactMap"),
    *("mechanics.LinearGap", "mechanics.gap.Gap", "mechanics.trajectory.MechanicalTrajectory"),
    *(
        "methods.SwitchedRK",
        "observer.ImpactObserver",
        "orbits.Branch",
        "parametric.ParametricForce",
    ),
    *("sensitivity.Sensitivity", "simulate.simulate", "status.Status"),
    *("system.ImpactSystem", "trajectory.Trajectory", "transform.lift", "vi.solve_vi"),
    *("wall.HarmonicWall", "fmu.export_fmu", "native.prefix", "files.save"),
)


@pytest.mark.parametrize("place", FORMER)
def test_modules_of_the_first_version_are_found(place):
    module, _, name = place.rpartition(".")
    found = getattr(importlib.import_module(f"zivi.{module}"), name)
    assert found is getattr(zivi, name, found)
    assert callable(zivi.simulate)
    assert callable(zivi.sensitivity)


def test_importing_is_silent_and_light():
    program = (
        "import sys, zivi\n"
        "heavy = {'matplotlib', 'xarray', 'scipy', 'rich', 'pandas', 'numba'}\n"
        "assert not heavy & set(sys.modules), heavy & set(sys.modules)\n"
        "ball = zivi.ImpactSystem(-1.0, e=.5)\n"
        "zivi.simulate(ball, (0, 1), (1, 0), zivi.ThetaGamma(h=.1))\n"
        "assert not heavy & set(sys.modules), heavy & set(sys.modules)\n"
    )
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", program], capture_output=True, text=True, check=False
    )
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")


def test_statuses_match_the_extension():
    from inside import _zivi

    assert [status.value for status in zivi.Status] == list(range(len(_zivi.STATUS_MESSAGES)))
    assert all(_zivi.STATUS_MESSAGES)
    assert len(set(_zivi.STATUS_MESSAGES)) == len(_zivi.STATUS_MESSAGES)


def test_stubs_name_what_the_extension_has():
    from inside import _zivi

    tree = ast.parse((PACKAGE / "_zivi.pyi").read_text())
    declared = {
        node.name for node in tree.body if isinstance(node, ast.FunctionDef | ast.ClassDef)
    } | {node.target.id for node in tree.body if isinstance(node, ast.AnnAssign)}
    public = {name for name in dir(_zivi) if not name.startswith("__")} | {"__version__"}
    declared = {name for name in declared if not name.startswith("_") or name == "__version__"}
    assert declared - {"__all__"} == public


def test_stubs_declare_every_column_of_a_run():
    from inside import _zivi

    tree = ast.parse((PACKAGE / "_zivi.pyi").read_text())
    record = next(node for node in tree.body if getattr(node, "name", "") == "RunRecord")
    declared = {node.name for node in record.body}
    assert declared == {name for name in dir(_zivi.RunRecord) if not name.startswith("_")}


def test_the_package_says_that_it_is_typed():
    assert (PACKAGE / "py.typed").exists()


def test_version():
    assert re.fullmatch(r"\d+\.\d+\.\d+\S*", zivi.__version__)
