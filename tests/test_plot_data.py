"""What plots draw is the run: its samples, its arcs between them, and its jumps."""

import dataclasses
import itertools

import matplotlib.pyplot as plt
import numpy as np
import pytest

import zivi
from inside import line_of

BALL = zivi.ImpactSystem(-9.81, e=0.5)
PLANT = zivi.ImpactSystem(-9.81, kappa=0.5)


@pytest.fixture(scope="module")
def tracking():
    tracker = zivi.TwistingTracker(30, 17, h=1e-3, kappa=0.5)
    return zivi.simulate_closed_loop(
        PLANT, tracker, (0, 2), (6, 5), y_ref0=(3, 3), force_ref=-19.81
    )


@pytest.fixture(scope="module")
def regulated():
    regulator = zivi.TwistingRegulator(30, 25, h=1e-3, kappa=0.5)
    return zivi.simulate_closed_loop(PLANT, regulator, (0, 1), (6, 5))


@pytest.fixture(scope="module")
def sol():
    return zivi.simulate(BALL, (0, 3), (1, 0))


def drawn(line):
    x, y = (np.asarray(values, float) for values in line.get_data())
    return x[~np.isnan(y)], y[~np.isnan(y)]


def test_a_loop_is_drawn_beside_its_reference(tracking):
    position, velocity = zivi.plot.position(tracking), zivi.plot.velocity(tracking)
    phase = zivi.plot.phase_plane(tracking)
    for ax, across, along in (
        (position, ("t", "t"), ("x", "x_ref")),
        (velocity, ("t", "t"), ("xdot", "xdot_ref")),
        (phase, ("x", "x_ref"), ("xdot", "xdot_ref")),
    ):
        assert len(ax.lines) == 2
        for line, first, second in zip(ax.lines, across, along, strict=True):
            np.testing.assert_array_equal(drawn(line)[0], getattr(tracking, first))
            np.testing.assert_array_equal(drawn(line)[1], getattr(tracking, second))
        assert ax.get_legend() is not None
    assert len(tracking.impacts) > 0
    for ax in (velocity, phase):
        assert np.any(np.isnan(ax.lines[0].get_ydata()))


def test_a_loop_without_a_reference_has_one_line(regulated):
    for draw in (zivi.plot.position, zivi.plot.velocity, zivi.plot.phase_plane):
        ax = draw(regulated)
        assert len(ax.lines) == 1
        assert ax.get_legend() is None


def test_the_control_and_the_signs_are_held_from_sample_to_sample(tracking, regulated):
    (held,) = zivi.plot.control(tracking).lines
    assert held.get_drawstyle() == "steps-post"
    np.testing.assert_array_equal(held.get_data(), (tracking.t, tracking.u))
    for run in (tracking, regulated):
        known = [signs for signs in run.signs.T if not np.all(np.isnan(signs))]
        lines = zivi.plot.signs(run).lines
        assert len(lines) == len(known)
        ax = lines[0].axes
        ticks, ends = ax.get_yticks(), ax.get_yticks(minor=True)
        for k, (line, signs) in enumerate(zip(lines, known, strict=True)):
            assert line.get_drawstyle() == "steps-post"
            # a row of its own from -1 to 1, as its ticks say
            top, bottom = ends[2 * k : 2 * k + 2]
            np.testing.assert_allclose(line.get_ydata(), ticks[k] + signs, atol=1e-14)
            assert (top, bottom) == pytest.approx((ticks[k] + 1.0, ticks[k] - 1.0))
            assert k == 0 or top < ends[2 * k - 1] - 0.5
    assert len(lines) < 6
    late = dataclasses.replace(tracking, signs=tracking.signs.copy())
    late.signs[0] = np.nan  # a sample that was refused
    assert len(zivi.plot.signs(late).lines) == 6


def test_labels_of_signs_do_not_overlap_in_a_small_panel(tracking):
    figure = plt.figure(figsize=(6.4, 7.2), layout="constrained")
    ax = figure.subplots(3, 2)[0, 0]  # as small as the panels of a page
    zivi.plot.signs(tracking, ax)
    figure.canvas.draw()
    boxes = [it.get_window_extent() for it in ax.get_yticklabels()]
    assert len(boxes) == 6
    for above, below in itertools.pairwise(boxes):
        assert below.y1 < above.y0
    # nor are they cut off, or over the label of the axis
    assert all(ax.yaxis.label.get_window_extent().x1 < it.x0 for it in boxes)


def test_reactions_begin_at_no_force_and_with_the_run():
    """Also where the gap is open at first, or the force is far from 0."""
    box = zivi.MechanicalSystem(
        mass=1.0, force=[-9.81], gaps=[zivi.LinearGap([1.0], name="floor")], e=0.0
    )
    sol = zivi.simulate(box, (1.0, 3.0), ([1.0], [0.0]))
    ax = zivi.plot.reactions(sol)
    (left, right), (bottom, top) = ax.get_xlim(), ax.get_ylim()
    assert np.nanmin(ax.lines[0].get_xdata()[np.isfinite(ax.lines[0].get_ydata())]) > 1.4
    assert left <= 1.0
    assert right >= 3.0
    assert -0.1 * top <= bottom <= 0.0
    assert top > 9.81


def test_arrows_of_multipliers_point_from_the_first_orbit_to_the_last():
    force = zivi.LinearForce(gravity=1.0, amplitude=1.3, phase=-np.pi / 2)
    orbit = zivi.periodic_orbit(zivi.ImpactSystem(force, e=0.5), [(0.6, 2.1)])
    branch = zivi.continue_orbit(orbit, "amplitude", (1.2, 1.7))
    back = dataclasses.replace(branch, orbits=branch.orbits[::-1], values=branch.values[::-1])
    directions = []
    for one in (branch, back):
        ax = zivi.plot.multipliers(one)
        arrows = [it for it in ax.texts if it.arrow_patch is not None]
        assert len(arrows) == 2
        for arrow, column in zip(arrows, one.multipliers.T, strict=True):
            start, end = (complex(*it) for it in (arrow.xyann, arrow.xy))
            places = [np.flatnonzero(np.abs(column - it) < 1e-12) for it in (start, end)]
            assert places[0].min() < places[1].max()
            # a step along the branch, not across it
            assert 0 < places[1].max() - places[0].min() < len(one)
            assert abs(end - start) > 0.04 * np.abs(np.diff(column)).sum()
            directions.append(end - start)
    for there, here in zip(directions[:2], directions[2:], strict=True):
        assert (there * np.conj(here)).real < 0.0


def test_selections_belong_to_the_step_that_ends_at_the_sample():
    sol = zivi.simulate(BALL, (0, 1), (1, 0), method=zivi.ThetaGamma(1e-2))
    first, second = zivi.plot.signs(sol).lines
    assert first.get_drawstyle() == second.get_drawstyle() == "steps-pre"
    np.testing.assert_array_equal(first.get_ydata(), sol.transformed.lambda_s)
    np.testing.assert_array_equal(second.get_ydata(), sol.transformed.lambda_v)
    assert np.any(sol.transformed.lambda_s != sol.transformed.lambda_v)
    with pytest.warns(DeprecationWarning, match=r"use plot\.signs"):
        former = zivi.plot.multipliers(sol)
    np.testing.assert_array_equal(former.lines[0].get_ydata(), first.get_ydata())


def test_an_overview_of_a_loop_in_a_figure_that_is_given(tracking):
    figure = plt.figure()
    assert zivi.plot.overview(tracking, figure) is figure
    assert plt.get_fignums() == [figure.number]
    words = [ax.get_ylabel().split()[0] for ax in figure.axes]
    assert words == ["position", "velocity", "control", "selections"]


def test_the_line_has_every_arc_and_every_jump(sol):
    line = line_of(sol)
    impacts = sol.impacts_down_to(1e-3 * sol.resolved_impacts["xdot_after"].max())
    assert len(impacts) > len(sol.resolved_impacts)  # with those that were extrapolated
    assert len(line.impacts) == len(impacts)
    after = line.impacts
    np.testing.assert_array_equal(line.t[after], impacts["t"])
    np.testing.assert_array_equal(line.t[after - 1], np.nextafter(impacts["t"], -np.inf))
    np.testing.assert_allclose(line.xdot[after], impacts["xdot_after"], rtol=1e-6)
    np.testing.assert_allclose(line.xdot[after - 1], impacts["xdot_before"], rtol=1e-6)
    assert np.isin(sol.t, line.t).all()
    assert line.t[-1] == sol.t[-1]
    # between two impacts there are points enough for a smooth arc
    assert np.diff(after)[:5].min() > 20
    np.testing.assert_allclose(line.x, sol(line.t)[0], atol=1e-15)


def test_the_line_takes_steps_apart_and_not_samples():
    few = zivi.simulate(BALL, (0, 3), (1, 0), samples="steps")
    many = zivi.simulate(BALL, (0, 3), (1, 0), t_eval=np.linspace(0, 3, 1001))
    assert len(line_of(many).t) < len(line_of(few).t) + 1001
    assert len(line_of(zivi.simulate(BALL, (0, 3), (1, 0), t_eval=[0, 3])).t) > 100


def test_a_jump_at_the_last_point_is_one(sol):
    first = sol.resolved_impacts["t"][0]
    cut = dataclasses.replace(sol, t=np.append(sol.t[sol.t < first], first))
    line = line_of(cut)
    assert line.impacts.tolist() == [len(line.t) - 1]


def test_a_jump_before_the_first_point_breaks_nothing():
    sol = zivi.simulate(BALL, (0, 0.1), (0, -3), method=zivi.ThetaGamma(1e-2))
    assert len(sol.resolved_impacts) == 1
    assert line_of(sol).impacts.size == 0 or line_of(sol).impacts[0] > 0


def test_jumps_between_and_after_the_points_that_were_asked_for():
    method = zivi.ThetaGamma(1e-3)
    few = zivi.simulate(BALL, (0, 3), (1, 0), method=method, t_eval=[0.0, 0.2, 1.3])
    assert np.count_nonzero(few.impacts["t"] < 1.3) > 1
    assert line_of(few).impacts.tolist() == [2]
    early = zivi.simulate(BALL, (0, 3), (1, 0), method=method, t_eval=[0.0, 0.2])
    assert line_of(early).impacts.size == 0


def test_a_section_at_impacts_has_their_phase(sol):
    (line,) = zivi.plot.poincare(sol, 0.7, section="impacts", phase=0.2).lines
    phase = (sol.impacts["t"] - 0.2) / 0.7 % 1.0
    np.testing.assert_array_equal(line.get_data(), (phase, sol.impacts["xdot_after"]))
