"""Plots draw into the axes they are given, label them with units and never show."""

import matplotlib as mpl

mpl.use("Agg")

import matplotlib.pyplot as plt
import numpy as np
import pytest

import zivi

PLOTS = {
    "position": zivi.plot.position,
    "velocity": zivi.plot.velocity,
    "lifted": zivi.plot.lifted,
    "multipliers": zivi.plot.multipliers,
    "phase_plane": zivi.plot.phase_plane,
    "phase_plane physical": lambda *a, **k: zivi.plot.phase_plane(*a, coordinates="physical", **k),
}


@pytest.fixture(scope="module")
def sol():
    ball = zivi.ImpactSystem(-9.81, e=0.5)
    return zivi.simulate(ball, (0, 2), (1, 0), method=zivi.ThetaGamma(h=1e-2))


@pytest.fixture(autouse=True)
def no_window(monkeypatch):
    def show(*args, **kwargs):
        raise AssertionError("a plot function called show")

    monkeypatch.setattr(plt, "show", show)
    yield
    plt.close("all")


@pytest.mark.parametrize("name", PLOTS)
def test_a_new_figure_is_made_and_drawn(name, sol):
    ax = PLOTS[name](sol)
    assert isinstance(ax, mpl.axes.Axes)
    assert plt.get_fignums() == [ax.figure.number]
    assert len(ax.lines) >= 1
    ax.figure.canvas.draw()


@pytest.mark.parametrize("name", PLOTS)
def test_given_axes_are_used(name, sol):
    _, (left, right) = plt.subplots(1, 2)
    assert PLOTS[name](sol, right) is right
    assert PLOTS[name](sol, ax=right) is right
    assert not left.lines
    assert len(plt.get_fignums()) == 1


@pytest.mark.parametrize("name", PLOTS)
def test_labels_carry_units(name, sol):
    ax = PLOTS[name](sol)
    for label in (ax.get_xlabel(), ax.get_ylabel()):
        texts = [label]
        if "state" in label:  # two quantities on one axis: their units are in the legend
            texts = [text.get_text() for text in ax.get_legend().get_texts()]
        assert all(text.endswith(("(s)", "(m)", "(m/s)", "(1)")) for text in texts), texts


@pytest.mark.parametrize("name", PLOTS)
def test_line_settings_are_passed_on_and_no_global_is_changed(name, sol):
    before = dict(mpl.rcParams)
    ax = PLOTS[name](sol, color="red", lw=3)
    assert {line.get_color() for line in ax.lines} == {"red"}
    assert {line.get_linewidth() for line in ax.lines} == {3}
    assert dict(mpl.rcParams) == before


def test_the_data_are_those_of_the_run(sol):
    np.testing.assert_array_equal(zivi.plot.position(sol).lines[0].get_ydata(), sol.x)
    lifted = zivi.plot.lifted(sol)
    np.testing.assert_array_equal(lifted.lines[0].get_ydata(), sol.s)
    np.testing.assert_array_equal(lifted.lines[1].get_ydata(), sol.v)
    phase = zivi.plot.phase_plane(sol)
    np.testing.assert_array_equal(phase.lines[0].get_xydata(), np.column_stack([sol.s, sol.v]))


def test_the_velocity_is_broken_at_impacts(sol):
    line = zivi.plot.velocity(sol).lines[0]
    t, xdot = line.get_data()
    assert np.count_nonzero(np.isnan(xdot)) <= len(sol.impacts)
    kept = ~np.isnan(xdot)
    np.testing.assert_array_equal(xdot[kept], sol.xdot)
    first = np.flatnonzero(~kept)[0]
    assert t[first - 1] <= sol.impacts["t"][0] <= t[first + 1]


def test_other_coordinates_are_refused(sol):
    with pytest.raises(ValueError, match="coordinates"):
        zivi.plot.phase_plane(sol, coordinates="polar")
