"""Examples of whole tasks: what they print is what they expect, by other ways."""

import re

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import zivi
from example_scripts import example, shown

pytestmark = pytest.mark.slow


def printed(name, tmp_path, capsys):
    """Lines of an example that also draws."""
    picture = tmp_path / "out.png"
    example(name).main(str(picture))
    assert picture.stat().st_size > 10_000
    return capsys.readouterr().out


def test_five_figures_for_a_lecture(tmp_path, capsys):
    text = printed("lecture_figures", tmp_path, capsys)
    pairs = re.findall(r"(\d\.\d{9,}) (?:s )?\((\d\.\d{9,})\)", text)
    assert len(pairs) == 4
    for found, exact in pairs:
        assert float(found) == pytest.approx(float(exact), abs=2e-9)
    assert float(re.search(r"81 times of rest: (\S+) s", text)[1]) < 1e-12


def test_the_film_is_a_motion():
    """Closed forms from arc to arc beside SciPy, up to the third impact."""
    film = example("fit_restitution")
    x0, e, c, g = film.TRUTH.values()

    def hit(t, y):
        return y[0]

    hit.terminal, hit.direction = True, -1
    start, state = 0.0, [x0, 0.0]
    for _ in range(3):
        arc = solve_ivp(
            lambda t, y: [y[1], -g - c * y[1]],
            (start, 4.0),
            state,
            events=hit,
            rtol=1e-12,
            atol=1e-13,
            dense_output=True,
            first_step=1e-3,
        )
        during = (start < film.TIMES) & (arc.t[-1] > film.TIMES)
        assert during.any()
        heights = film.heights(film.TIMES)[during]
        np.testing.assert_allclose(arc.sol(film.TIMES[during])[0], heights, atol=1e-9)
        start, state = arc.t[-1], [1e-16, -e * arc.y[1, -1]]


def test_a_fit_finds_the_parameters_of_the_video():
    film = example("fit_restitution")
    exact = film.fit(zivi.Record(film.TIMES, film.heights(film.TIMES), sigma=film.NOISE))
    np.testing.assert_allclose(exact.x, list(film.TRUTH.values()), rtol=1e-6)


def test_deviations_are_the_scatter_of_many_videos(tmp_path, capsys):
    lines = printed("fit_restitution", tmp_path, capsys).splitlines()
    assert lines[4] == "found by 4 of 4 starts"
    for line in lines[:4]:
        value, true, own, seen = map(float, re.findall(r"\d+\.?\d*(?:e-\d+)?", line[8:]))
        assert abs(value - true) < 4 * own
        assert own == pytest.approx(seen, rel=0.45)


def test_a_recording_gives_restitution_release_and_height(tmp_path, capsys):
    lines = printed("fit_microphone", tmp_path, capsys).splitlines()
    assert lines[0].startswith("11 clicks")
    for line in lines[1:]:
        value, std, true = map(float, re.findall(r"\d+\.\d+", line[2:]))
        assert abs(value - true) < 4 * std + 1e-5


def test_a_stop_is_found_where_plain_least_squares_stop(tmp_path, capsys):
    lines = printed("fit_stop", tmp_path, capsys).splitlines()
    for line in lines[:4]:
        value, std, true = map(float, re.findall(r"\d+\.\d+", line[3:]))
        assert abs(value - true) < 4 * std
    cost, other = map(float, re.findall(r"\d+\.?\d*", lines[4]))
    assert cost < 80 < 1e3 < other
    one, many = (int(line.rpartition(" ")[2]) for line in lines[5:])
    assert (one, many) == (1, 14)
    assert "one minimum" in shown("fit_stop")


def test_what_data_do_not_determine_is_said(tmp_path, capsys):
    lines = printed("fit_identifiability", tmp_path, capsys).splitlines()
    deviations = [float(re.search(r"\+- (\S+),", line)[1]) for line in lines[:3]]
    assert deviations[0] > 5 * deviations[1] > 25 * deviations[2]
    assert lines[3] == "mass and stiffness are not determined separately by these data"


def test_an_optimal_throw_has_the_least_effort(tmp_path, capsys):
    lines = printed("optimal_throw", tmp_path, capsys).splitlines()
    # a hover without impacts in closed form; with impacts by another program
    expected = [4 * 9.81**2 * 1.5 * (3 / 4 - 3 / 2 + 1), 48.450553243181511, 24.733333702082727]
    for line, effort in zip(lines, expected, strict=True):
        found, error = re.findall(r"effort (\S+) .*\((\S+)\)", line)[0]
        assert float(found) == pytest.approx(effort, abs=1e-6)
        assert float(error) < 1e-7


def test_designed_gains_keep_their_promise(tmp_path, capsys):
    gains = example("design_gains")
    designed = gains.design()
    rising, falling, bound = gains.accelerations(designed)
    assert (designed.rising, designed.falling) == pytest.approx((rising, falling), rel=1e-12)
    assert bound > gains.BOUND
    assert designed.settling_time <= gains.TIME
    for run in gains.loops(designed):
        assert run.rest_time is not None
        assert run.rest_time < designed.settling_time
        assert designed.u_min - 1e-12 <= run.u.min() <= run.u.max() <= designed.u_max + 1e-12
    assert "60 of 60 rest" in printed("design_gains", tmp_path, capsys)


def test_a_clearance_above_the_amplitude_does_nothing():
    damper = example("mechanics_damper")
    still = damper.amplitude()[1] / np.sqrt(2)
    wide, good = damper.sweep(np.array([0.9, 0.18]))
    assert wide == pytest.approx(still, rel=0.02)
    assert good < 0.15 * still
    best = damper.sweep(np.geomspace(0.01, 1.0, 60)).min() / still
    assert f"keeps {100 * best:.0f} %" in shown("mechanics_damper")


def test_a_study_that_outgrows_a_machine(tmp_path, capsys):
    pytest.importorskip("zarr")
    text = printed("cluster_study", tmp_path, capsys)
    assert re.search(r"stopped: 4000 of 10000 points\ncontinued: 10000 of 10000 points", text)
    # the closed form of the program is that of its test
    study = example("cluster_study")
    e, v = np.array([0.5, 0.2]), np.array([0.0, 3.0])
    first = (v + np.sqrt(v**2 + 2 * 9.81)) / 9.81
    later = 2 * e * np.sqrt(v**2 + 2 * 9.81) / 9.81 / (1 - e)
    np.testing.assert_allclose(study.exact(e, v), first + later, rtol=1e-15)
    np.testing.assert_allclose(study.rest_times(e, v)["rest_time"], first + later, rtol=1e-13)
    assert float(re.search(r"error: (\S+)", text)[1]) < 1e-13


def test_every_plot_is_drawn(tmp_path, capsys):
    printed("every_plot", tmp_path, capsys)
    program = example("every_plot")
    drawn = {name for name, *_ in [*program.runs(), *program.orbits()]}
    others = {
        "overview",
        "animate",
        "curve",
        "map",
    }  # several panels, a film, one of a chart, an alias
    functions = {name for name in zivi.plot.__all__ if callable(getattr(zivi.plot, name))}
    assert drawn == functions - others


def test_the_methods_have_their_orders(tmp_path, capsys):
    found = re.findall(r"order (\S+) \((\d)\)", printed("orders", tmp_path, capsys))
    assert len(found) == 4
    for measured, expected in found:
        # steps that adapt to the tolerance are not powers of each other
        assert float(measured) == pytest.approx(float(expected), rel=0.25)
