"""What is wrong with a file is told with the file, the key and what is allowed."""

import pytest

import zivi
from zivi.files import FileError, prepare_control, prepare_simulate, prepare_sweep

BALL = """
t_span = [0.0, 3.0]
y0 = [1.0, 0.0]
[system]
force = -9.81
e = 0.5
"""
LOOP = """
t_span = [0.0, 0.1]
y0 = [6.0, 5.0]
y_ref0 = [3.0, 3.0]
[system]
force = -9.81
kappa = 0.5
[controller]
name = "TwistingTracker"
mu1 = 30
mu2 = 17
h = 1e-3
"""
STUDY = """
experiment = "ball_rest_time"
[parameters]
e = [0.3, 0.5]
"""


@pytest.fixture
def written(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)

    def write(text, *changes, name="run.toml"):
        for old, new in changes:
            assert text.count(old) == 1, old
            text = text.replace(old, new)
        path = (tmp_path / name).relative_to(tmp_path)
        path.write_text(text)
        return path

    return write


def refused(prepare, path, *expected):
    """Each expected text is one line of the error, after the name of the file."""
    with pytest.raises(FileError) as caught:
        prepare(path).run()
    assert str(caught.value).splitlines() == [f"{path}: {text}" for text in expected]


FORCE_ALLOWED = (
    "a finite number, or a table with stiffness, damping, gravity, amplitude, omega, phase"
)
METHODS = 'one of "SwitchedRK", "ThetaGamma", "MoreauJean", "ExplicitEuler"'
E = (
    "a finite number >= 0 and <= 1, "
    'or a table with law = one of "NewtonImpact", "SpeedDependentImpact", '
    '"RestitutionTable"'
)
PAIR = "a list of two finite numbers, [x >= 0, xdot]"


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ("y0 =", "y1 =", [
            "y1 is not a known key; did you mean 'y0'? "
            "allowed: t_span, y0, system, method, t_eval, tstops",
            f"y0 is missing: initial distance from the wall and velocity, {PAIR}",
        ]),
        ("y0 = [1.0, 0.0]", "y0 = 1.0", [f"y0 must be {PAIR}, got 1.0"]),
        ("y0 = [1.0, 0.0]", "y0 = [1.0]", [f"y0 must be {PAIR}, got [1.0]"]),
        ("y0 = [1.0, 0.0]", "y0 = [-1, true]", [
            "y0[0] must be a finite number >= 0, got -1",
            "y0[1] must be a finite number, got True",
        ]),
        ("3.0]", "inf]", ["t_span[1] must be a finite number, got inf"]),
        ("[0.0, 3.0]", "[3, 0.0]", ["t_span must run forward, t0 < t1, got (3.0, 0.0)"]),
        ("[system]", "[sistem]", [
            "sistem is not a known key; did you mean 'system'? "
            "allowed: t_span, y0, system, method, t_eval, tstops",
            "system is missing: the mass and its wall, "
            "a table with force, e, kappa, wall, friction",
        ]),
        ("[system]", "[[system]]", [
            "system must be a table with force, e, kappa, wall, friction, "
            "got [{'force': -9.81, 'e': 0.5}]",
        ]),
        ("e = 0.5", "e = 1.5", [f"system.e must be {E}, got 1.5"]),
        ("e = 0.5", "e = nan", [f"system.e must be {E}, got nan"]),
        ("e = 0.5", "e = 0.5\nkappa = 0.1", [
            "system: exactly one of e and kappa must be given, got both",
        ]),
        ("e = 0.5", "", ["system: exactly one of e and kappa must be given, got neither"]),
        ("force = -9.81", 'force = "x**2"', [f"system.force must be {FORCE_ALLOWED}, got 'x**2'"]),
        ("force = -9.81", "force = [1]", [f"system.force must be {FORCE_ALLOWED}, got [1]"]),
        ("force = -9.81", "force = inf", [f"system.force must be {FORCE_ALLOWED}, got inf"]),
        ("force = -9.81", "force = { gravty = 9.81 }", [
            "system.force.gravty is not a known key; did you mean 'gravity'? allowed: "
            "stiffness, damping, gravity, amplitude, omega, phase",
        ]),
        ("force = -9.81", "force = { gravity = '9' }", [
            "system.force.gravity must be a finite number, got '9'",
        ]),
        ("force = -9.81", "force = -9.81\nwall = { amplitude = 0.1 }", [
            "system.wall.omega is missing: omega, a finite number",
        ]),
        ("force = -9.81", "force = -9.81\nwall = 3", [
            "system.wall must be a table with amplitude, omega, phase, offset, got 3",
        ]),
        ("e = 0.5", 'e = 0.5\n[method]\nname = "thetagamma"', [
            f"method.name must be {METHODS}, got 'thetagamma'; did you mean 'ThetaGamma'?",
        ]),
        ("e = 0.5", "e = 0.5\n[method]\nname = 3", [f"method.name must be {METHODS}, got 3"]),
        ("e = 0.5", 'e = 0.5\n[method]\nname = "ThetaGamma"', [
            "method.h is missing: step, a finite number > 0",
        ]),
        ("e = 0.5", 'e = 0.5\n[method]\nname = "ThetaGamma"\nh = 0', [
            "method.h must be a finite number > 0, got 0",
        ]),
        ("e = 0.5", 'e = 0.5\n[method]\nname = "ThetaGamma"\nh = 1e-3\nrtol = 1e-3', [
            "method.rtol is not a setting of ThetaGamma, but of SwitchedRK",
        ]),
        ("e = 0.5", 'e = 0.5\n[method]\nname = "ThetaGamma"\nh = 1e-14', [
            "method.h must give at most 1e9 steps over t_span, 1e-14 gives 3.000e14",
        ]),
        ("e = 0.5", "e = 0.5\n[method]\nrtoll = 1", [
            "method.rtoll is not a known key; did you mean 'rtol'? "
            "allowed: rtol, atol, order, max_step, "
            "first_step, max_steps, max_impacts, flights",
        ]),
        ("e = 0.5", "e = 0.5\n[method]\nrtol = 1", [
            "method.rtol must be a finite number >= 1e-14 and < 1, got 1",
        ]),
        ("e = 0.5", "e = 0.5\n[method]\norder = 8.0\nmax_steps = 1e3\nmax_step = 0", [
            "method.order must be one of 8, 5, got 8.0",
            "method.max_steps must be a whole number >= 1, got 1000.0",
            "method.max_step must be a number > 0 or inf, got 0",
        ]),
        ("e = 0.5", 'e = 0\n[method]\nname = "ThetaGamma"\nh = 1e-3', [
            "system.e must be > 0 for this scheme (R = 0 at e = 0; below about 1e-16 kappa "
            "rounds to 1), got 0.0",
        ]),
        ("e = 0.5", 'kappa = 1\n[method]\nname = "ThetaGamma"\nh = 1e-3', [
            "system.kappa must be > 0 for this scheme (R = 0 at e = 0; below about 1e-16 kappa "
            "rounds to 1), got 0.0",
        ]),
        ("y0 =", "t_eval = [2.0, 1.0]\ny0 =", [
            "t_eval must be increasing and within t_span = (0.0, 3.0)",
        ]),
        ("y0 =", "t_eval = []\ny0 =", [
            "t_eval must be a list, each a finite number, or a table with start, stop, num, got []",
        ]),
        ("y0 =", "t_eval = [1, '2']\ny0 =", ["t_eval[1] must be a finite number, got '2'"]),
        ("y0 =", "t_eval = { start = 0, stop = 3, num = 0 }\ny0 =", [
            "t_eval.num must be a whole number >= 1 and <= 1000000, got 0",
        ]),
        ("y0 =", "t_eval = { start = 3, stop = 1, num = 3 }\ny0 =", [
            "t_eval.stop must be >= start, got 1.0",
        ]),
        ("y0 =", '"a b" = 1\ny0 =', [
            '"a b" is not a known key; allowed: t_span, y0, system, method, t_eval, tstops',
        ]),
    ],
)  # fmt: skip
def test_simulate(written, old, new, expected):
    refused(prepare_simulate, written(BALL, (old, new)), *expected)


CONTROLLERS = 'one of "TwistingRegulator", "TwistingTracker", "ExplicitTwisting"'


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ('"TwistingTracker"', '"TwistingTraker"', [
            f"controller.name must be {CONTROLLERS}, got 'TwistingTraker'; "
            "did you mean 'TwistingTracker'?",
        ]),
        ('"TwistingTracker"', '"Mine"', [
            f"controller.name must be {CONTROLLERS}, got 'Mine'; "
            "a file has no code: a controller of your own is for zivi.simulate_closed_loop",
        ]),
        ('name = "TwistingTracker"', "", [
            f"controller.name is missing: it must be {CONTROLLERS}",
        ]),
        ("mu2 = 17", "mu2 = 31", [
            "controller.mu2 must be a gain with 0 < mu2 < mu1 (m/s^2), got 31.0",
        ]),
        ("mu2 = 17", "mu2 = 17\nbound = 20", [
            "controller.mu2 must be greater than bound (1 + e)/(2 e) = 40.0 m/s^2 "
            "for bound = 20.0, got 17.0",
        ]),
        ("mu2 = 17", "mu2 = 17\nu_limits = [2, 1]", [
            "controller.u_limits must be greater than u_min (m/s^2), got 1.0",
        ]),
        ("mu2 = 17", "mu2 = 17\nbranch = 'near'", [
            'controller.branch must be one of "positive", "nearest", got \'near\'; '
            "did you mean 'nearest'?",
        ]),
        ("mu2 = 17", "mu2 = 17\ne = 0.5\nkappa = 0.5", [
            "controller: exactly one of e and kappa must be given, got both",
        ]),
        ("mu2 = 17", "mu2 = 17\ne_ref = 0.5\nkappa_ref = 0.5", [
            "controller: exactly one of e_ref and kappa_ref must be given, got both",
        ]),
        ("kappa = 0.5", "kappa = 1", [
            "system.kappa must be > 0 (R = 0 at e = 0; below about 1e-16 kappa rounds to 1), "
            "got 0.0",
        ]),
        ('"TwistingTracker"', '"TwistingRegulator"', [
            "y_ref0 must be left out: a TwistingRegulator does not follow a reference",
        ]),
        ("y_ref0 = [3.0, 3.0]", "y_ref0 = [-3, 3.0]", [
            "y_ref0[0] must be a finite number >= 0, got -3",
        ]),
        ("y_ref0 =", "noise = [1e-3]\ny_ref0 =", [
            "noise must be a list of two finite numbers, [of x >= 0, of xdot >= 0], got [0.001]",
        ]),
        ("y_ref0 =", "quantization = [1e-3, -1]\ny_ref0 =", [
            "quantization[1] must be a finite number >= 0, got -1",
        ]),
        ("y_ref0 =", "seed = -1\ndelay = 1.5\ny_ref0 =", [
            "seed must be a whole number >= 0, got -1",
            "delay must be a whole number >= 0 and <= 1000000000, got 1.5",
        ]),
        ("y_ref0 =", "force_ref = 'g'\ny_ref0 =", [
            f"force_ref must be {FORCE_ALLOWED}, got 'g'",
        ]),
        ("h = 1e-3", "h = 1e-3\n[method]\nname = 'ThetaGamma'\nh = 1e-4", [
            "method.h must be the controller's h = 0.001, got 0.0001",
        ]),
        ("h = 1e-3", "h = 1e-3\n[method]\nname = 'MoreauJean'\nh = 1e-4", [
            'method.name must be one of "SwitchedRK", "ThetaGamma", got \'MoreauJean\'',
        ]),
        ("h = 1e-3", "h = 1e-12", [
            "controller.h must give at most 1e9 steps over t_span, 1e-12 gives 1.000e11",
        ]),
    ],
)  # fmt: skip
def test_control(written, old, new, expected):
    refused(prepare_control, written(LOOP, (old, new)), *expected)


def test_a_controller_without_a_reference_is_given_none(written):
    changes = ('"TwistingTracker"', '"TwistingRegulator"'), ("[system]", "force_ref = -1\n[system]")
    path = written(LOOP, *changes)
    names = ("y_ref0", "force_ref")
    text = "must be left out: a TwistingRegulator does not follow a reference"
    refused(prepare_control, path, *(f"{name} {text}" for name in names))


EXPERIMENTS = ", ".join(f'"{name}"' for name in zivi.study.EXPERIMENTS)
PARAMETERS = "allowed: e, x0, v0, g, h"


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ('"ball_rest_time"', '"ball_rest"', [
            f"experiment must be one of {EXPERIMENTS}, got 'ball_rest'; "
            "did you mean 'ball_rest_time'?",
        ]),
        ("e = [0.3, 0.5]", "E = [0.3, 0.5]", [
            f"parameters.E is not a parameter of the experiment; did you mean 'e'? {PARAMETERS}",
        ]),
        ("e = [0.3, 0.5]", "", [f"parameters must have one at least; {PARAMETERS}"]),
        ("e = [0.3, 0.5]", "e = 0.3", [
            "parameters.e must be a list, each a finite number, or a table with "
            "start, stop, num, log, got 0.3",
        ]),
        ("e = [0.3, 0.5]", "e = [0.3, 'x']", ["parameters.e[1] must be a finite number, got 'x'"]),
        ("e = [0.3, 0.5]", "e = { start = 0.1, num = 3 }", [
            "parameters.e.stop is missing: last value, or upper bound, a finite number",
        ]),
        ("e = [0.3, 0.5]", "e = { start = 0.1, stop = 0.5 }", [
            "parameters.e.num is missing: number of values",
        ]),
        ("e = [0.3, 0.5]", "e = { start = 0.0, stop = 0.5, num = 3, log = true }", [
            "parameters.e.start must be > 0 with log = true, got 0.0",
        ]),
        ("e = [0.3, 0.5]", "e = { start = 0.1, stop = 0.5, num = 3, log = 1 }", [
            "parameters.e.log must be true or false, got 1",
        ]),
        ("e = [0.3, 0.5]", "e = [0.3]\n[fixed]\ne = 1\nq = 1", [
            f"fixed.q is not a parameter of the experiment; {PARAMETERS}",
            "fixed.e is among the parameters, too",
        ]),
        ("e = [0.3, 0.5]", "e = [0.3]\n[fixed]\ng = 'x'", [
            "fixed.g must be a finite number, got 'x'",
        ]),
        ("e = [0.3, 0.5]", "e = [0.3, 0.5]\nh = [1e-3]\n[design]\nkind = 'list'", [
            "parameters must be of one length in a list of points, got e 2, h 1",
        ]),
        ("e = [0.3, 0.5]", "e = [0.3, 0.5]\n[design]\nkind = 'sample'", [
            "design.n is missing: number of points, a whole number >= 1 and <= 1000000",
        ]),
        ("e = [0.3, 0.5]", "e = [0.3, 0.5]\n[design]\nkind = 'sample'\nn = 4", [
            "parameters.e must be a table with start and stop, the bounds of a sample, got a list",
        ]),
        ("e = [0.3, 0.5]",
         "e = { start = 0.5, stop = 0.1, num = 3 }\n[design]\nkind = 'sample'\nn = 4", [
            "parameters.e.num is not allowed in a sample: design.n is the number of points",
            "parameters.e.stop must be > start in a sample, got 0.1",
        ]),
        ("e = [0.3, 0.5]", "e = [0.3, 0.5]\n[design]\nn = 4", [
            "design.n is not a setting of grid, but of sample",
        ]),
        ("[parameters]", "executor = 'dask'\n[parameters]", [
            'executor must be one of "serial", "threads", "processes", got \'dask\'',
        ]),
        ("[parameters]", "workers = 2\n[parameters]", [
            'workers goes with executor = "threads" or "processes"',
        ]),
        ("[parameters]", "workers = 0\nseed = 0.5\nchunk = 0\n[parameters]", [
            "workers must be a whole number >= 1, got 0",
            "seed must be a whole number >= 0, got 0.5",
            "chunk must be a whole number >= 1, got 0",
        ]),
        ("e = [0.3, 0.5]",
         "e = { start = 0, stop = 1, num = 100000 }\ng = { start = 1, stop = 2, num = 101 }", [
            "parameters must give at most 10000000 points, they give 10100000",
        ]),
    ],
)  # fmt: skip
def test_sweep(written, old, new, expected):
    refused(lambda path: prepare_sweep(path), written(STUDY, (old, new)), *expected)


def test_whole_parameters(written):
    path = written(
        STUDY,
        ("ball_rest_time", "table_period"),
        ("e = [0.3, 0.5]", "longest = [2, 4]\n[fixed]\ntransient = 3"),
    )
    prepared = prepare_sweep(path)
    assert prepared.design.values["longest"].dtype.kind == "i"
    assert prepared.options["fixed"] == {"transient": 3}
    assert type(prepared.options["fixed"]["transient"]) is int
    refused(
        prepare_sweep,
        written(path.read_text(), ("[2, 4]", "[2.5]"), ("= 3", "= 0.5")),
        "parameters.longest must hold whole numbers, got [2.5]",
    )


@pytest.mark.parametrize("prepare", [prepare_simulate, prepare_control, prepare_sweep])
def test_what_is_no_toml(written, tmp_path, prepare):
    refused(
        prepare,
        written("a = 1\nb = = 2\n"),
        "is not a TOML file: Invalid value (at line 2, column 5)",
    )
    (tmp_path / "run.toml").write_bytes(b"a = '\xff'")
    path = (tmp_path / "run.toml").relative_to(tmp_path)
    refused(prepare, path, "is not UTF-8 text (byte 5)")
    (tmp_path / "folder").mkdir()
    refused(prepare, (tmp_path / "folder").relative_to(tmp_path), "cannot be read: Is a directory")
    refused(prepare, path.with_name("nothing.toml"), "does not exist")
    refused(prepare, written("a = " + "[" * 100_000), "cannot be read: too deeply nested")
    for key in ("a" + ".a" * 100_000, "'a'" + " . 'a'" * 60, "b = {a" + ".a" * 50):
        refused(prepare, written(f"[b]\n{key} = 1\n"), "a key must have at most 50 parts (line 2)")


def test_a_long_value_is_cut(written):
    path = written(BALL, ("force = -9.81", f"force = '{'x' * 500}'"))
    with pytest.raises(FileError) as caught:
        prepare_simulate(path)
    assert len(str(caught.value)) < 300


def test_lines_of_other_systems(written):
    path = written(BALL)
    path.write_bytes(b"\xef\xbb\xbf" + BALL.replace("\n", "\r\n").encode())
    assert prepare_simulate(path).run().success


def test_the_run_is_that_of_python(written):
    path = written(
        BALL,
        ("force = -9.81", "force = { gravity = 9.81, damping = 0.1 }\n"
                          "wall = { amplitude = 0.01, omega = 60 }"),
        ("y0 =", "t_eval = { start = 0, stop = 3, num = 31 }\ny0 ="),
        ("e = 0.5", "e = 0.5\n[method]\norder = 5\nmax_step = inf"),
    )  # fmt: skip
    found = prepare_simulate(path).run()
    table = zivi.HarmonicWall(0.01, 60.0)
    system = zivi.ImpactSystem(zivi.LinearForce(gravity=9.81, damping=0.1), e=0.5, wall=table)
    times = [0.1 * k for k in range(31)]
    expected = zivi.simulate(system, (0, 3), (1, 0), zivi.SwitchedRK(order=5), times)
    assert found.config == expected.config
    assert abs(found.x - expected.x).max() < 1e-9


@pytest.mark.filterwarnings("ignore:a landing may never rest")
def test_the_loop_is_that_of_python(written):
    path = written(
        LOOP,
        ("y_ref0 =", "noise = [1e-4, 1e-3]\nquantization = [1e-5, 0]\nseed = 7\ndelay = 2\n"
                     "force_ref = -19.81\nforce_model = { gravity = 9.5 }\ny_ref0 ="),
        ("mu1 = 30", "mu1 = 30\nbranch = 'nearest'\nu_limits = [-50, 50]\ne_ref = 0.3"),
    )  # fmt: skip
    found = prepare_control(path).run()
    law = zivi.TwistingTracker(
        30, 17, h=1e-3, kappa=0.5, branch="nearest", u_limits=(-50, 50), e_ref=0.3
    )
    expected = zivi.simulate_closed_loop(
        zivi.ImpactSystem(-9.81, kappa=0.5), law, (0, 0.1), (6, 5), y_ref0=(3, 3),
        force_ref=-19.81, force_model=zivi.LinearForce(gravity=9.5), noise=(1e-4, 1e-3),
        quantization=(1e-5, 0), seed=7, delay=2,
    )  # fmt: skip
    assert found.config == expected.config
    assert (found.u == expected.u).all()


def test_designs(written):
    grid = prepare_sweep(written(STUDY, ("e = [0.3, 0.5]", "e = [0.3, 0.5]\nh = [0, 1e-3, 1]")))
    assert grid.design.shape == (2, 3)
    text = "e = { start = 0.1, stop = 0.9, num = 3 }\nh = { start = 1e-4, stop = 1e-2, num = 3, log = true }"  # noqa: E501
    values = prepare_sweep(written(STUDY, ("e = [0.3, 0.5]", text))).design.values
    assert values["e"].tolist() == [0.1, 0.5, 0.9]
    assert values["h"].tolist() == pytest.approx([1e-4, 1e-3, 1e-2], rel=1e-12)
    listed = written(STUDY, ("e = [0.3, 0.5]", text + "\n[design]\nkind = 'list'"))
    assert prepare_sweep(listed).design.shape == (3,)
    text = text.replace(", num = 3", "") + "\n[design]\nkind = 'sample'\nn = 8\nsampler = 'lhs'"
    drawn = [
        prepare_sweep(written(STUDY, ("e = [0.3, 0.5]", text + f"\nseed = {seed}"))).design
        for seed in (1, 1, 2)
    ]
    expected = zivi.sample("lhs", 8, {"e": (0.1, 0.9), "h": (1e-4, 1e-2)}, log=["h"], seed=1)
    assert drawn[0].digest() == drawn[1].digest() == expected.digest() != drawn[2].digest()
