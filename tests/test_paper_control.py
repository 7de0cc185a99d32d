"""Figures 5 to 8 and the tables of the controllers: the checks hold, and can fail."""

import dataclasses
import math

import numpy as np
import pytest

import zivi
from inside import (
    paper_chattering as chattering,
    paper_closed_loops as closed_loops,
    paper_regulator as regulator,
    paper_report as report,
    paper_rest as rest,
    paper_robustness as robustness,
    paper_tracker as tracker,
)


def test_the_settling_time_is_that_of_the_events():
    # flight by flight: nothing of the closed form is used
    (mu1, mu2), e = closed_loops.REGULATOR, 1 / 3
    t, speed = math.sqrt(2 * 1.0 / (mu1 - mu2)), math.sqrt(2 * 1.0 * (mu1 - mu2))
    for _ in range(60):
        speed *= e
        height = speed**2 / (2 * (mu1 + mu2))
        t += speed / (mu1 + mu2)
        t += math.sqrt(2 * height / (mu1 - mu2))
        speed = math.sqrt(2 * height * (mu1 - mu2))
    assert regulator.exact_settling() == pytest.approx(t, abs=1e-12)
    assert regulator.exact_settling() == pytest.approx(1.7727623, abs=1e-7)


def test_the_zeno_points():
    ref = closed_loops.closed_form_zeno(closed_loops.START_REF, closed_loops.FORCE_REF)
    free = closed_loops.closed_form_zeno(closed_loops.START, closed_loops.FORCE)
    assert ref == pytest.approx(1.2930358, abs=1e-7)
    assert free == pytest.approx(2.9452697, abs=1e-7)


def test_all_checks_hold():
    for check in regulator.check_regulator() + tracker.check_tracker(tracker.runs()):
        assert check.ok, check


@pytest.mark.parametrize(
    "change",
    [
        {"delay": 3},
        {"e": 0.45},
        {"noise": (1e-4, 1e-2), "seed": 1},
        {"force": closed_loops.FORCE + 5},
        {"controller": "explicit"},
    ],
)
def test_the_checks_notice_another_loop(change):
    runs = {name: closed_loops.track(**change) for name in tracker.runs()}
    assert not all(check.ok for check in tracker.check_tracker(runs))


def test_the_checks_notice_a_wrong_settling_time(monkeypatch):
    monkeypatch.setattr(closed_loops, "REGULATOR", (3.0, 1.9))
    assert not all(check.ok for check in regulator.check_regulator())


def test_a_run_that_does_not_rest_is_no_number():
    run = closed_loops.track(force=closed_loops.FORCE + 1.5)
    assert math.isnan(report.rest_time_of(run))
    assert math.isnan(report.max_abs(run.x[:0]))
    assert math.isnan(closed_loops.last_above(run, 1e9))


def test_the_errors_are_of_the_lifted_states():
    run = closed_loops.track(sampled=False)
    e_s, e_v = tracker.errors(run)
    np.testing.assert_array_equal(e_s, run.error)
    kappa = closed_loops.KAPPA
    for k in (0, 400, 700, 900):
        v, v_ref = (xdot / (1 - kappa * np.sign(xdot)) for xdot in (run.xdot[k], run.xdot_ref[k]))
        assert e_v[k] == pytest.approx(v - v_ref, abs=1e-12)


def test_the_lifted_regulator_is_continuous():
    run = closed_loops.regulate()
    s, v = closed_loops.lift_run(run)
    np.testing.assert_array_equal(np.abs(s), run.x)
    assert len(run.resolved_impacts) > 3
    (mu1, mu2), kappa, h = closed_loops.REGULATOR, closed_loops.KAPPA, closed_loops.H
    # |v'| <= (mu1 + mu2)/(1 - kappa) and |s'| <= (1 + kappa) |v|
    assert np.abs(np.diff(v)).max() <= h * (mu1 + mu2) / (1 - kappa) * (1 + 1e-12)
    assert np.abs(np.diff(s)).max() <= h * (1 + kappa) * np.abs(v).max()
    assert s.min() < 0 < s.max()


def test_both_velocities_are_broken_at_impacts_and_nowhere_else():
    run = closed_loops.track(sampled=False)
    plant, reference = (line.get_xydata() for line in zivi.plot.velocity(run).lines)
    for line, (t, xdot) in ((plant, (run.t, run.xdot)), (reference, (run.t, run.xdot_ref))):
        shown = line[~np.isnan(line[:, 0])]
        np.testing.assert_array_equal(shown, np.column_stack([t, xdot]))
    # the reference falls freely: its velocity rises at impacts only, the closed form knows when
    gaps = reference[np.flatnonzero(np.isnan(reference[:, 0])) - 1, 0]
    speed = math.sqrt(3**2 + 2 * 19.81 * 3)
    first = (3 + speed) / 19.81
    second = first + 2 / 3 * speed / 19.81
    assert gaps[:2] == pytest.approx([first, second], abs=6e-3)
    assert len(gaps) == np.count_nonzero((run.xdot_ref[:-1] < 0) & (run.xdot_ref[1:] > 0))


def test_the_explicit_controller_chatters_and_the_implicit_one_does_not():
    found = {
        (row.where, row.force_error, row.h, row.controller): row
        for row in chattering.measure_chattering()
    }
    for h in chattering.STEPS:
        explicit = found["rising", 0.0, h, "explicit"]
        # the control jumps over its whole range in almost every period, whatever the period
        assert explicit.u_range > 40
        assert explicit.u_variation > 10 / h
        assert {row.u_range for key, row in found.items() if key[:3] == ("wall", 0.0, h)} == {0.0}
        for branch in ("positive", "nearest"):
            rising = found["rising", 0.0, h, branch]
            assert rising.u_variation < 0.01
            assert rising.error_mean == pytest.approx(h**2 * 9.81 / 2, rel=0.01)
            wall = found["wall", 1.5, h, branch]
            assert wall.u_range < found["wall", 1.5, h, "explicit"].u_range / 5
            apex = found["apex", 0.0, h, branch]
            assert apex.u_variation < found["apex", 0.0, h, "explicit"].u_variation / 10


def test_disturbances_are_bounded_and_repeatable():
    rows = robustness.measure_robustness()
    assert [row.disturbance for row in rows[::2]] == list(robustness.DISTURBANCES)
    assert rows == robustness.measure_robustness()
    for row in rows:
        assert row.reached < 1.8
        assert row.error < 1e-3
        assert row.speed < 0.2
        assert row.at_rest == 0 or "noise" not in row.disturbance
    calm = rows[0]
    assert calm.disturbance == "none"
    assert calm.at_rest >= 18
    busy = next(row for row in rows if row.disturbance.startswith("noise 1e-3"))
    assert busy.u_high - busy.u_low > 100
    assert (
        busy.error
        > 10 * next(row for row in rows if row.disturbance.startswith("noise 1e-5")).error
    )


def test_exact_rest_in_the_sampled_loop_depends_on_e():
    rows = {row.e: row for row in rest.measure_rest()}
    assert all(row.paper == rest.STARTS for row in rows.values())
    for e, row in rows.items():
        if e <= 0.38:
            assert row.sampled >= 0.85 * rest.STARTS
        if e >= 0.5:
            assert row.sampled == 0
            assert 0 < row.distance < 2e-4


@pytest.mark.parametrize("e", [0.5, 0.7])
def test_what_is_left_shrinks_with_the_period(e, monkeypatch):
    monkeypatch.setattr(rest, "RESTITUTIONS", (e,))
    (coarse,), (fine,) = rest.measure_rest(1e-2), rest.measure_rest(1e-3)
    assert coarse.distance / fine.distance == pytest.approx(100, rel=0.05)
    assert coarse.speed / fine.speed == pytest.approx(10, rel=0.05)


@pytest.mark.parametrize("e", [0.05, 0.3, 0.5, 0.7, 0.9])
def test_the_regulator_rests_from_every_start(e):
    generator = np.random.default_rng(1)
    for _ in range(20):
        start = (10 ** generator.uniform(-6, 0), generator.normal())
        run = zivi.simulate_closed_loop(
            zivi.ImpactSystem(0.0, e=e),
            zivi.TwistingRegulator(3, 2, h=1e-3, e=e),
            (0, 20),
            start,
        )
        assert run.rest_time is not None


def test_rows_are_saved_in_full(tmp_path):
    rows = robustness.measure_robustness()[:2]
    zivi.paper.report.save_rows(rows, tmp_path / "rows.csv")
    lines = (tmp_path / "rows.csv").read_text().splitlines()
    assert lines[0].split(",") == [field.name for field in dataclasses.fields(rows[0])]
    assert float(lines[1].split(",")[3]) == rows[0].reached
