"""The sampled loop as it is called: foreign controllers, errors, data, plots, interrupts."""

import contextlib
import copy
import dataclasses
import inspect
import io
import json
import pickle
import signal

import matplotlib as mpl

mpl.use("Agg")

import matplotlib.pyplot as plt
import numpy as np
import pytest

import zivi
import zivi.base.progress
from control_loops import (
    PAPER,
    PLANT,
    TRACKING,
    Foreign,
    ForeignRegulator,
    Scripted,
    assert_equal_runs,
    loop,
)
from interrupting import ctrl_c
from zivi.plot.curves import SIGN_ROW

pytestmark = pytest.mark.filterwarnings("ignore:a landing may never rest")


def test_names_and_defaults_of_the_contract():
    parameters = inspect.signature(zivi.simulate_closed_loop).parameters
    assert list(parameters)[:4] == ["system", "controller", "t_span", "y0"]
    keywords = {n: p.default for n, p in parameters.items() if p.kind is p.KEYWORD_ONLY}
    assert {name: keywords[name] for name in ("y_ref0", "force_ref", "force_model")} == {
        "y_ref0": None,
        "force_ref": None,
        "force_model": None,
    }
    run = loop()
    n = len(run.t)
    for name in ("t", "x", "xdot", "x_ref", "xdot_ref", "u", "error"):
        values = getattr(run, name)
        assert values.dtype == np.float64
        assert values.shape == (n,)
    assert run.signs.shape == (n, 6)
    assert run.tick_status.dtype == np.uint8
    assert run.status is zivi.Status.COMPLETED
    assert run.success
    np.testing.assert_array_equal(run.error, run.x - run.x_ref)
    assert "TwistingTracker" in repr(run)
    assert "completed" in repr(run)


def test_a_run_is_the_ticks_one_by_one():
    """By hand: measure, tick, hold; the same numbers to the last bit."""
    run = loop(t_span=(0, 1.5))
    tracker = zivi.TwistingTracker(**PAPER)
    tracker.reset(3, 3)
    for k in range(len(run.t) - 1):
        assert (tracker.x_ref, tracker.xdot_ref) == (run.x_ref[k], run.xdot_ref[k])
        assert tracker.step(run.x[k], run.xdot[k], -9.81, -19.81) == run.u[k]
        np.testing.assert_array_equal(tracker.signs, run.signs[k])


def test_signs_that_nobody_asked_for_go_along():
    """They are unpacked when they are read; copies and pickles have them either way."""
    read, unread = loop(t_span=(0, 3)), loop(t_span=(0, 3))
    signs = read.signs
    assert read.signs is signs
    assert len(np.unique(signs)) > 10
    for again in (copy.copy(unread), copy.deepcopy(unread), pickle.loads(pickle.dumps(unread))):
        np.testing.assert_array_equal(again.signs, signs)
    np.testing.assert_array_equal(dataclasses.replace(unread, nfev=1).signs, signs)
    with pytest.raises(AttributeError, match="no attribute 'sign'"):
        _ = unread.sign


@pytest.mark.parametrize("paper", [False, True], ids=["sampled", "paper's loop"])
def test_foreign_controllers_run_as_ours(paper):
    method = zivi.ThetaGamma(1e-3) if paper else None
    for branch in ("positive", "nearest"):
        ours = loop(zivi.TwistingTracker(**PAPER, branch=branch), method=method, t_span=(0, 2))
        inner = zivi.TwistingTracker(**PAPER, branch=branch)
        theirs = loop(Foreign(inner), method=method, t_span=(0, 2))
        assert_equal_runs(ours, theirs, names=("t", "x", "xdot", "x_ref", "xdot_ref", "u"))
        np.testing.assert_array_equal(ours.resolved_impacts, theirs.resolved_impacts)
        assert np.all(np.isnan(theirs.signs))
        assert theirs.config["controller"] == {"name": "Foreign"}
    regulator = zivi.TwistingRegulator(**PAPER)
    ours = loop(regulator, method=method, t_span=(0, 2))
    theirs = loop(ForeignRegulator(regulator.copy()), method=method, t_span=(0, 2))
    assert_equal_runs(ours, theirs, names=("t", "x", "xdot", "x_ref", "u"))
    assert np.all(np.isnan(theirs.x_ref))


class Stubborn(zivi.TwistingTracker):
    def step(self, x, xdot, force, force_ref):
        return 2 * super().step(x, xdot, force, force_ref)


class Renamed(zivi.TwistingTracker):
    pass


def test_a_subclass_with_a_step_of_its_own_is_run_with_it():
    plain, stubborn = loop(), loop(Stubborn(**PAPER))
    assert stubborn.u[0] == 2 * plain.u[0]
    assert stubborn.x_ref[1] == plain.x_ref[1]
    assert_equal_runs(plain, loop(Renamed(**PAPER)))


def test_ours_is_copied_and_a_run_goes_on_where_it_was():
    tracker = zivi.TwistingTracker(**PAPER)
    tracker.reset(3, 3)
    before = tracker.state
    whole = loop(tracker, t_span=(0, 1.024), y_ref0=None)
    assert tracker.state == before
    # the same in two parts, restarted from the states
    half = loop(tracker, t_span=(0, 0.512), y_ref0=None)
    tracker.reset(half.x_ref[-1], half.xdot_ref[-1])
    rest = loop(tracker, t_span=(0.512, 1.024), y0=(half.x[-1], half.xdot[-1]), y_ref0=None)
    np.testing.assert_allclose(rest.x, whole.x[512:], rtol=0, atol=1e-12)
    # a foreign one is used itself
    foreign = Foreign(tracker)
    loop(foreign)
    assert (foreign.x_ref, foreign.xdot_ref) != (3, 3)


NAN, INF = float("nan"), float("inf")
WRONG = [
    ("system", TypeError, [3, None, -9.81]),
    ("controller", TypeError, [3, None, zivi.TwistingTracker, lambda: 1]),
    ("t_span", ValueError, [(1, 0), (0, 0), (NAN, 1), (0, INF)]),
    ("t_span", TypeError, [(0,), 1, None, "ab"]),
    ("x0", ValueError, [(-1, 0), (NAN, 0), (INF, 0)]),
    ("xdot0", ValueError, [(0, INF), (1, NAN)]),
    ("y0", TypeError, [1, None, (1, 2, 3), "ab"]),
    ("x_ref", ValueError, [(-1, 0), (NAN, 0)]),
    ("y_ref0", TypeError, [1, (1, 2, 3), "ab"]),
    ("force_ref", TypeError, ["a", 1j, [1]]),
    ("force_ref", ValueError, [NAN, INF]),
    ("force_model", TypeError, ["a", 1j, [1]]),
    ("force_model", ValueError, [NAN, INF]),
    ("method", TypeError, [3, "RK", zivi.ExplicitEuler(h=1e-3)]),
    ("h", ValueError, [zivi.ThetaGamma(h=2e-3)]),
    ("noise", ValueError, [(-1, 0), (NAN, 0), (0, INF)]),
    ("noise", TypeError, [1, (1,), None, "ab"]),
    ("quantization", ValueError, [(-1, 0), (NAN, 0), (0, INF)]),
    ("quantization", TypeError, [1, (1,), None]),
    ("delay", ValueError, [-1, 10**30, 1001]),
    ("delay", TypeError, [1.5, "a", None, True]),
]
GIVEN = {"x0": "y0", "xdot0": "y0", "x_ref": "y_ref0", "h": "method"}


@pytest.mark.parametrize(
    ("name", "error", "value"),
    [(name, error, value) for name, error, values in WRONG for value in values],
)
def test_a_wrong_argument_is_named(name, error, value):
    arguments = {"system": PLANT, "controller": zivi.TwistingTracker(**PAPER)}
    arguments |= {"t_span": (0, 1), "y0": (6, 5), **TRACKING, GIVEN.get(name, name): value}
    with pytest.raises(error, match=rf"(?<![\w]){name}(?!\w)"):
        zivi.simulate_closed_loop(**arguments)


def test_other_wrong_calls():
    with pytest.raises(TypeError, match="unexpected keyword"):
        loop(horizon=3)
    with pytest.raises(TypeError, match="y_ref0"):
        zivi.simulate_closed_loop(
            PLANT, zivi.TwistingRegulator(**PAPER), (0, 1), (1, 0), y_ref0=(1, 0)
        )
    for h in (0, -1, NAN, INF):
        with pytest.raises(ValueError, match="h must be"):
            loop(Scripted([0.0], h))
    with pytest.raises(TypeError, match=r"controller\.h"):
        loop(Scripted([0.0], None))


def later(bad, good=0.0, after=5):
    """A controller that is good for some samples."""

    class Failing(Scripted):
        def step(self, x, xdot, force):
            super().step(x, xdot, force)
            if len(self.seen) <= after:
                return good
            return bad() if callable(bad) else bad

    return Failing([0.0])


def interrupt():
    raise KeyboardInterrupt


@pytest.mark.parametrize("method", [None, zivi.ThetaGamma(0.1)], ids=["sampled", "paper's loop"])
@pytest.mark.parametrize(
    ("answer", "error"),
    [
        (lambda: 1 / 0, ZeroDivisionError),
        (interrupt, KeyboardInterrupt),
        (None, TypeError),
        ("1.0", TypeError),
        (1j, TypeError),
        ([1.0], TypeError),
        (10**400, OverflowError),
    ],
    ids=["raises", "interrupted", "None", "str", "complex", "list", "huge int"],
)
def test_what_a_controller_raises_arrives_with_the_run(answer, error, method):
    with pytest.raises(error) as caught:
        loop(later(answer), method=method)
    part = caught.value.trajectory
    assert part.status is zivi.Status.RAISED
    assert not part.success
    whole = loop(Scripted([0.0]), method=method)
    assert len(part.t) == 6
    assert_equal_runs(part, whole, until=6, names=("t", "x", "xdot"))


@pytest.mark.parametrize("answer", [NAN, INF, -INF])
def test_a_control_that_is_not_finite_is_rejected_and_the_last_one_held(answer):
    with pytest.warns(zivi.ModelWarning, match="control updates of Failing were rejected"):
        run = loop(later(answer))
    n = len(run.t) - 1
    assert (run.status, run.success) == (zivi.Status.CONTROL_REJECTED, False)
    assert run.tick_status.tolist() == [0] * 5 + [4] * (n - 5) + [0]
    assert np.all(run.u == run.u[4])
    assert run.message.endswith(f" {n - 5} of {n} control updates rejected, 0 saturated.")


@pytest.mark.parametrize("mechanical", [False, True], ids=["mass", "mechanism"])
@pytest.mark.parametrize(
    ("rejected", "status"),
    [
        (range(300, 390), "COMPLETED"),
        (range(361, 400), "COMPLETED"),
        (range(360, 400), "CONTROL_REJECTED"),
        (range(361, 399), "COMPLETED"),
        ([], "COMPLETED"),
    ],
)
def test_a_loop_fails_whose_last_tenth_of_updates_is_rejected(mechanical, rejected, status):
    """The same rule for one mass and for mechanisms."""

    class Partly:
        h, k = 2.0**-10, -1

        def step(self, *sample):
            self.k += 1
            return NAN if self.k in rejected else 1.0

    ball = zivi.MechanicalSystem(mass=1.0, force=[-9.81], inputs=[[1.0]])
    plant = ball if mechanical else zivi.ImpactSystem(-9.81, e=0.5)
    start = ([9.0], [0.0]) if mechanical else (9.0, 0.0)
    expected = pytest.warns(zivi.ModelWarning) if len(rejected) > 40 else contextlib.nullcontext()
    with expected:
        run = zivi.simulate_closed_loop(plant, Partly(), (0, 400 * Partly.h), start)
        batch = zivi.simulate_closed_loop_batch(plant, Partly(), (0, 400 * Partly.h), start)
    assert run.status.name == zivi.Status(int(batch.status[0])).name == status
    counts = (400, len(rejected), 0)
    assert (run.n_updates, run.n_refused, run.n_saturated) == counts
    assert (batch.n_updates[0], batch.n_refused[0], batch.n_saturated[0]) == counts
    assert repr(run).endswith(f": {status.lower()}>")
    told = f"{len(rejected)} of 400 control updates rejected"
    assert all(
        (told in text) == bool(len(rejected)) for text in (run.message, repr(run), repr(batch))
    )
    again = pickle.loads(pickle.dumps(run))
    assert again.updates == run.updates
    assert run.to_xarray().attrs["n_refused"] == len(rejected)


@pytest.mark.parametrize("name", ["force_model", "force_ref"])
def test_forces_that_fail(name):
    def raising(t, x, xdot):
        if t > 0.5:
            raise ArithmeticError("no more")
        return -9.81

    with pytest.raises(ArithmeticError, match="no more") as caught:
        loop(**{name: raising})
    part = caught.value.trajectory
    assert part.status is zivi.Status.RAISED
    assert 0.5 < part.t[-1] < 0.502
    run = loop(**{name: lambda t, x, xdot: NAN if t > 0.5 else -9.81})
    assert run.status is zivi.Status.FORCE_NOT_FINITE
    assert 0.5 < run.t[-1] < 0.502
    assert np.all(np.isfinite(run.u))
    assert len(run.t) == len(run.u) == len(run.signs) == len(run.tick_status)


def test_a_reference_that_cannot_be_read_raises():
    class Broken(Foreign):
        reads = 0

        @property
        def x_ref(self):
            self.reads += 1
            if self.reads > 10:
                raise LookupError("gone")
            return self.inner.x_ref

    with pytest.raises(LookupError, match="gone") as caught:
        loop(Broken(zivi.TwistingTracker(**PAPER)))
    assert len(caught.value.trajectory.t) < 12


def test_labelled_data_and_back(tmp_path):
    xarray = pytest.importorskip("xarray")
    run = loop(t_span=(0, 2), noise=(1e-5, 1e-4), seed=2, delay=np.int64(1))
    data = run.to_xarray()
    for name in ("x", "xdot", "x_ref", "xdot_ref", "u", "tick_status"):
        np.testing.assert_array_equal(data[name], getattr(run, name))
        assert data[name].attrs["units"]
        assert data[name].attrs["long_name"]
    np.testing.assert_array_equal(data.time, run.t)
    np.testing.assert_array_equal(data.signs, run.signs)
    names = ["lambda_s", "lambda_v", "lambda_sr", "lambda_vr", "lambda_es", "lambda_ev"]
    assert list(data.sign.values) == names
    np.testing.assert_array_equal(data.signs.sel(sign="lambda_es"), run.signs[:, 4])
    np.testing.assert_array_equal(data.impact_time, run.impacts["t"])
    np.testing.assert_array_equal(data.impact_xdot_after, run.impacts["xdot_after"])
    np.testing.assert_array_equal(data.zeno_time, run.zeno_times)
    assert json.loads(data.attrs["config"]) == run.config
    assert run.config["seed"] == 2
    assert run.config["controller"]["name"] == "TwistingTracker"
    assert run.config["controller"]["mu1"] == 30
    # the settings build the controller again
    controller = dict(run.config["controller"])
    again = zivi.TwistingTracker(**{k: v for k, v in controller.items() if k != "name"})
    assert again.settings == zivi.TwistingTracker(**PAPER).settings
    path = tmp_path / "run.nc"
    try:
        data.to_netcdf(path)
    except (ImportError, ValueError):
        pytest.skip("no NetCDF library")
    with xarray.open_dataset(path) as read:
        xarray.testing.assert_identical(read.load()[["x", "u", "signs"]], data[["x", "u", "signs"]])


@pytest.fixture(scope="module")
def tracked():
    return loop(t_span=(0, 2))


@pytest.fixture(scope="module")
def regulated():
    return loop(zivi.TwistingRegulator(**PAPER), t_span=(0, 2), y0=(0.2, 0))


DRAWINGS = {
    "position": (("x", "x_ref"), 1),
    "velocity": (("xdot", "xdot_ref"), 1),
    "control": (("u",), 1),
    "signs": (("signs",) * 6, 2),
}


@pytest.mark.parametrize("name", DRAWINGS)
def test_plots_show_the_samples(name, tracked, regulated):
    quantities, of_regulator = DRAWINGS[name]
    for run, count in ((tracked, len(quantities)), (regulated, of_regulator)):
        ax = getattr(zivi.plot, name)(run)
        assert len(ax.lines) == count
        for k, (line, quantity) in enumerate(zip(ax.lines, quantities, strict=False)):
            values = getattr(run, quantity)
            values = values[:, k] if quantity == "signs" else values
            rows = SIGN_ROW * k if quantity == "signs" else 0.0  # one below the other
            shown = np.asarray(line.get_ydata())
            if quantity.startswith("xdot"):  # broken at impacts
                shown = shown[~np.isnan(shown)]
            np.testing.assert_array_equal(shown, values - rows)
        assert "time" in ax.get_xlabel()
        assert "(" in ax.get_ylabel()
        ax.figure.canvas.draw()
        # held, not joined
        if name in ("control", "signs"):
            assert {line.get_drawstyle() for line in ax.lines} == {"steps-post"}


def test_the_phase_plane_and_the_overview(tracked, regulated):
    ax = zivi.plot.phase_plane(tracked)
    reference = ax.lines[1].get_xydata()
    reference = reference[~np.isnan(reference).any(axis=1)]
    np.testing.assert_array_equal(reference, np.column_stack([tracked.x_ref, tracked.xdot_ref]))
    own = ax.lines[0].get_xydata()
    own = own[~np.isnan(own).any(axis=1)]
    np.testing.assert_array_equal(own, np.column_stack([tracked.x, tracked.xdot]))
    assert len(zivi.plot.phase_plane(regulated).lines) == 1
    lifted = zivi.plot.phase_plane(tracked, coordinates="lifted")
    np.testing.assert_array_equal(
        lifted.lines[0].get_data(), (tracked.transformed.s, tracked.transformed.v)
    )
    s_ref, v_ref = lifted.lines[1].get_data()
    x_ref, xdot_ref = zivi.project(s_ref, v_ref, kappa=0.5)
    np.testing.assert_allclose(x_ref, tracked.x_ref, atol=1e-12)
    np.testing.assert_allclose(xdot_ref, tracked.xdot_ref, atol=1e-12)
    with pytest.raises(ValueError, match="coordinates"):
        zivi.plot.phase_plane(tracked, coordinates="sideways")
    figure = zivi.plot.overview(tracked)
    assert [len(ax.lines) for ax in figure.axes] == [2, 2, 1, 6]
    figure.canvas.draw()
    mine = plt.figure()
    assert zivi.plot.overview(regulated, figure=mine) is mine
    assert [len(ax.lines) for ax in mine.axes] == [1, 1, 1, 2]


class Terminal(io.StringIO):
    def isatty(self):
        return True


def test_progress_counts_the_samples_and_changes_nothing(monkeypatch):
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setattr(zivi.base.progress, "DELAY", 0.0)
    with contextlib.redirect_stderr(Terminal()) as screen:
        shown = loop(t_span=(0, 400), progress=True)
        assert screen.getvalue() != ""
    with contextlib.redirect_stderr(Terminal()) as screen:
        plain = loop(t_span=(0, 400), progress=False)
        assert screen.getvalue() == ""
    assert_equal_runs(shown, plain)


class Theirs:
    """Holds still."""

    h = 1e-7

    def step(self, x, xdot, force):
        return 0.0


@pytest.mark.slow
@pytest.mark.skipif(not hasattr(signal, "setitimer"), reason="sends signals to itself")
@pytest.mark.parametrize("controller", [zivi.TwistingTracker(30, 17, h=2e-8, kappa=0.5), Theirs()])
def test_ctrl_c_stops_a_loop(controller):
    plant = zivi.ImpactSystem(-9.81, kappa=0.5)
    with ctrl_c(by="thread", answers=25), pytest.raises(KeyboardInterrupt) as stop:
        zivi.simulate_closed_loop(plant, controller, (0, 1), (6, 5))
    run = stop.value.trajectory
    assert run.status == zivi.Status.RAISED
    assert not run.success
    assert len(run.t) == len(run.u) == len(run.signs) == len(run.tick_status)
    assert run.x[0] == 6
    assert 0 < len(run.t) < 1 / controller.h / 3
