"""The lab without its page: settings become runs, figures, numbers and Python."""

import dataclasses
import subprocess
import sys
import xml.etree.ElementTree
from urllib.parse import parse_qsl

import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import given, settings

import zivi
from inside import (
    FAR,
    PRESETS,
    Ball,
    Belt,
    BeltRun,
    Regulator,
    Tracker,
    describe_signs,
    facts,
    film,
    query,
    ranges,
    read_query,
    script,
    simulate_settings,
    thinned,
    warning_texts,
)
from zivi import plot

CASES = {
    "ball": Ball(),
    "ball, shaken": Ball(e=0.8, h=1e-3, amplitude=20.0, omega=30.0, x0=0.0, xdot0=-1.0),
    "ball, pushed off": Ball(gravity=-1.0),
    "regulator": Regulator(),
    "regulator, disturbed": Regulator(force=-1.0, disturbance=0.5, noise_x=1e-4, noise_xdot=1e-2),
    "tracker": Tracker(),
    "tracker, the paper's": Tracker(h=1e-3, force_ref=-19.81),
    "tracker, disturbed": Tracker(branch="nearest", disturbance=5.0, delay=2, noise_x=1e-4, seed=7),
    "tracker, without landing": Tracker(landing=False, delay=1),
    "tracker, observed": Tracker(observer=True, position_only=True, amplitude=2.0, noise_x=1e-3),
    "tracker, drawn": Tracker(drawn=True, delay=1, t_end=1.234),
    "belt": Belt(),
    "belt, a brake": Belt(speed=0.0, extra=0.0, limit=0.3, x0=2.0, xdot0=0.0, h=5e-3, t_end=10.0),
    "regulator, observed": Regulator(observer=True, amplitude=0.3, omega=4.5, landing=False),
}
SAMPLED = ("t", "x", "xdot")


def same(run, other):
    if isinstance(other, BeltRun):
        mine = run.x - FAR if hasattr(run, "x") else run.q[:, 0]
        return np.array_equal(mine, other.x) and np.array_equal(run.t, other.t)
    both = [(getattr(run, name), getattr(other, name)) for name in SAMPLED]
    if isinstance(run, zivi.ClosedLoop):
        both += [(run.u, other.u), (run.signs, other.signs)]
    return run.rest_time == other.rest_time and all(
        np.array_equal(a, b, equal_nan=True) for a, b in both
    )


@pytest.mark.parametrize("case", CASES)
def test_the_script_gives_the_runs_on_the_screen(case, capsys):
    runs = simulate_settings(CASES[case])
    made = {}
    exec(script(CASES[case]), made)
    assert all(same(made[name], run) for name, run in runs.items())
    assert len(capsys.readouterr().out.splitlines()) == len(runs)
    assert made["figure"].axes


@pytest.mark.parametrize("kind", [Ball, Belt, Regulator, Tracker])
def test_the_script_knows_every_setting(kind):
    plain = kind in (Ball, Belt)
    starts = [kind()] if plain else [kind(amplitude=1.0, observer=True)]
    starts += [Tracker(drawn=True)] if kind is Tracker else []
    for field in dataclasses.fields(kind):
        changed = [dataclasses.replace(it, **{field.name: _other(it, field)}) for it in starts]
        assert [script(it) for it in changed] != [script(it) for it in starts], field.name


def _other(start, field):
    value = getattr(start, field.name)
    return "nearest" if field.name == "branch" else not value if isinstance(value, bool) else 7


def test_a_script_can_be_a_file_of_its_own(tmp_path):
    file = tmp_path / "regulator.py"
    file.write_text(script(Regulator()))
    done = subprocess.run([sys.executable, file], capture_output=True, text=True, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "TwistingRegulator" in done.stdout


def test_the_zeno_point_is_that_of_the_ball():
    ball = Ball(e=0.5, gravity=9.81, x0=1.0, xdot0=0.0)
    run = simulate_settings(ball)["high_order"]
    assert run.rest_time == pytest.approx(3 * np.sqrt(2 / 9.81), rel=1e-6)


def test_the_regulator_settles_when_the_closed_form_says():
    # flights of constant deceleration, speeds in a geometric series
    given = Regulator(e=0.33, h=1e-4, mu1=3.0, mu2=2.0, x0=1.0, xdot0=0.0)
    ratio = given.e * np.sqrt(1 / 5)
    exact = np.sqrt(2) + given.e * np.sqrt(2) * (1 / 5 + 1 / np.sqrt(5)) / (1 - ratio)
    for run in simulate_settings(given).values():
        assert run.rest_time == pytest.approx(exact, abs=2e-3)


def test_explicit_signs_chatter_and_implicit_ones_do_not():
    # in free flight with the reference
    flight = Tracker(h=1e-3, force=-9.81, force_ref=-9.81, x0=3, xdot0=9, x_ref0=3, xdot_ref0=9)
    implicit, explicit = facts(simulate_settings(flight), (0.2, 0.8))
    title = "Σ|Δu| a second (m/s² per s)"
    assert float(implicit[title]) < 1e-3
    assert float(explicit[title]) > 1e3


def test_the_facts_have_the_variation_of_the_part_that_is_shown():
    runs = simulate_settings(Tracker(observer=True, noise_x=1e-4))
    for row, run in zip(facts(runs, (1.0, 3.0)), runs.values(), strict=True):
        shown = (run.t >= 1.0) & (run.t <= 3.0)
        steps = np.diff(run.u[shown])
        assert row["Σ|Δu| (m/s²)"] == f"{steps[steps > 0].sum() - steps[steps < 0].sum():.4g}"
        off = (run.xdot_est - run.xdot)[shown]
        rms = np.hypot(off.std(), off.mean())
        assert float(row["observed velocity off by, rms (m/s)"]) == pytest.approx(rms, rel=0.06)
    assert all("observed" not in title for title in facts(simulate_settings(Tracker()))[0])


def test_the_unknown_sine_pushes_the_mass_and_not_the_model():
    # u = -mu1 + mu2 while the mass falls
    given = Regulator(x0=5.0, xdot0=-6.0, amplitude=2.0, omega=4.0, disturbance=0.3, t_end=0.5)
    run = simulate_settings(given)["explicit"]
    t, constant = run.t, 0.3 - given.mu1 + given.mu2
    exact = 5.0 - 6.0 * t + constant * t**2 / 2 + 2.0 / 16.0 * (1.0 - np.cos(4.0 * t))
    assert np.abs(run.x - exact).max() < 1e-8
    assert run.config["force_model"] == 0.0


def test_the_switches_reach_the_loop():
    runs = simulate_settings(Tracker(delay=2, observer=True, position_only=True, noise_x=1e-3))
    controller = runs["implicit"].config["controller"]
    assert (controller["landing"], controller["ahead"]) == (True, 3)
    for run in runs.values():
        assert run.config["observer"]["position_only"] is True
        assert run.config["observer"]["noise"][0] == 1e-3
    runs = simulate_settings(Regulator(landing=False, delay=2))
    assert runs["implicit"].config["controller"]["landing"] is False
    assert "observer" not in runs["implicit"].config


def test_a_drawn_reference_is_followed_through_its_heights_and_a_rest():
    given = Tracker(drawn=True, h=1e-3, e=0.8, x0=2.0, xdot0=0.0, x_ref0=1.0, t_end=5.0)
    runs = simulate_settings(given)
    for run in runs.values():
        assert np.allclose(run.x_ref[::1000], given.heights, atol=1e-12)
        slopes = np.gradient(run.x_ref, run.t)
        assert np.abs(slopes - run.xdot_ref)[1:-1].max() < 2e-5
        assert np.abs(run.error[run.t > 2.0]).max() < 2e-2
    implicit = runs["implicit"]
    resting = (implicit.t > 3.5) & (implicit.t < 4.0)
    assert np.all(implicit.x[resting] == 0.0)
    assert len(set(implicit.u[resting])) == 1


def test_an_observer_finds_the_unknown_force():
    flying = Tracker(observer=True, position_only=True, noise_x=1e-4, disturbance=2.0, h=1e-3)
    for run in simulate_settings(flying).values():
        part = (run.t > 0.2) & (run.t < 0.4)
        assert run.resolved_impacts["t"][0] > 0.4
        assert np.abs(run.d_est[part] - 2.0).max() < 0.5


INVALID = {
    "e above 1": (Ball(e=1.1), "e must lie in [0, 1], got 1.1"),
    "e = 0": (Ball(e=0.0), "e must be > 0 for this scheme"),
    "x below the wall": (Ball(x0=-0.5), "x0 must be a finite distance >= 0 from the wall"),
    "h = 0": (Ball(h=0.0), "h must be"),
    "no time": (Ball(t_end=0.0), "t_span must run forward"),
    "endless": (Ball(h=1e-6), "t_end / h must be at most"),
    "an empty field": (Ball(x0=None), "x0 must be a real number"),
    "regulator, mu2 >= mu1": (Regulator(mu1=2, mu2=2), "mu2 must be a gain with 0 < mu2 < mu1"),
    "regulator, e": (Regulator(e=1.1), "e must lie in [0, 1], got 1.1"),
    "tracker, mu2 > mu1": (
        Tracker(mu2=31),
        "mu2 must be a gain with 0 < mu2 < mu1 (m/s^2), got 31",
    ),
    "tracker, mu1 = 0": (Tracker(mu1=0), "mu1 must be a gain > 0"),
    "tracker, reference": (Tracker(x_ref0=-1), "x_ref must be"),
    "tracker, branch": (Tracker(branch="other"), "branch must be one of positive, nearest"),
    "tracker, landing": (Tracker(landing=1), "landing must be True or False"),
    "tracker, seed": (Tracker(seed=-1), "seed must be a whole number >= 0"),
}


@pytest.mark.parametrize("case", INVALID)
def test_invalid_settings_get_a_message(case):
    wrong, message = INVALID[case]
    with pytest.raises((ValueError, TypeError)) as error:
        simulate_settings(wrong)
    assert message in str(error.value)


def test_refused_samples_are_told():
    runs = simulate_settings(Tracker(noise_x=0.1))
    said = warning_texts(runs)
    assert len(said) == 2
    for words, run in zip(said, runs.values(), strict=True):
        assert run.n_refused > 0
        assert f"{run.n_refused} of {run.n_updates} control updates rejected" in words
    assert warning_texts(simulate_settings(Tracker())) == []


def test_a_run_that_ends_early_is_told():
    runs = simulate_settings(Ball())
    runs["implicit"] = dataclasses.replace(
        runs["implicit"], status=zivi.Status.STEP_BUDGET, message="ended"
    )
    assert warning_texts(runs) == ["implicit signs: ended"]


@pytest.mark.parametrize("case", CASES)
def test_facts_are_those_of_the_runs(case):
    runs = simulate_settings(CASES[case])
    rows = facts(runs)
    assert [row[""] for row in rows][:2] == ["implicit signs", "explicit signs"]
    for row, run in zip(rows, runs.values(), strict=True):
        if isinstance(run, BeltRun):
            assert row["sticks"] == f"{run.stuck:.1%} of the time"
            continue
        rest = "no" if run.rest_time is None else f"from {run.rest_time:.6g} s"
        assert row["at rest at the end"] == rest
    assert facts(runs, (0.5, 0.5))


@settings(max_examples=60)
@given(
    length=st.integers(1, 5000),
    points=st.integers(10, 300),
    impacts=st.integers(0, 400),
    seed=st.integers(0, 100),
)
def test_thinning_keeps_extremes_ends_and_order(length, points, impacts, seed):
    source = np.random.default_rng(seed)
    t, x = np.arange(length, dtype=float), source.standard_normal(length)
    breaks = np.unique(source.integers(1, max(length, 2), impacts))
    few_t, few_x = thinned((t, x), breaks, points)
    assert len(few_t) == len(few_x) <= points
    kept = ~np.isnan(few_t)
    assert np.array_equal(kept, ~np.isnan(few_x))
    assert np.array_equal(few_x[kept], x[few_t[kept].astype(int)])
    assert np.all(np.diff(few_t[kept]) > 0)
    assert (few_t[0], few_t[-1]) == (0.0, length - 1.0)
    assert (np.nanmin(few_x), np.nanmax(few_x)) == (x.min(), x.max())


def test_a_short_line_is_left_as_it_is_but_broken_at_impacts():
    t = np.arange(5.0)
    few, twice = thinned((t, 2 * t), np.array([2]))
    assert np.array_equal(few, [0, 1, np.nan, 2, 3, 4], equal_nan=True)
    assert np.array_equal(twice, 2 * few, equal_nan=True)


def test_importing_zivi_does_not_import_the_page():
    code = (
        "import sys, zivi, zivi.cli, zivi.lab.runs, zivi.lab.figures, zivi.lab.command\n"
        "print({'marimo', 'plotly', 'uvicorn'} & set(sys.modules))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "set()"


class TestFigure:
    @pytest.fixture(autouse=True)
    def plotly(self):
        pytest.importorskip("plotly")

    @pytest.mark.parametrize("case", CASES)
    def test_lines_are_short_and_all_are_in_the_figure(self, case):
        from inside import curves, draw_runs

        given = dataclasses.replace(CASES[case], h=1e-4)
        runs = simulate_settings(given)
        lines = curves(runs)
        drawn = draw_runs(runs)
        assert len(drawn.data) == len(lines)
        assert all(0 < len(line.x) == len(line.y) <= 1000 for line in lines)
        by_panel = {line.panel for line in lines}
        last = "slip" if isinstance(given, Belt) else "signs"
        assert {"position", "velocity", "phase", last} <= by_panel
        assert ("control" in by_panel) == isinstance(runs["implicit"], zivi.ClosedLoop)
        titles = [drawn.layout[f"yaxis{k}"].title.text for k in range(1, len(by_panel) + 1)]
        assert len(set(titles)) >= len(by_panel) - 1  # that of the phase plane is the velocity's

    def test_what_is_drawn_is_the_run(self):
        from inside import curves

        runs = simulate_settings(Regulator())
        line = next(
            c for c in curves(runs) if c.panel == "control" and c.look.name == "implicit signs"
        )
        assert np.array_equal(line.x, runs["implicit"].t)
        assert np.array_equal(line.y, runs["implicit"].u)
        assert line.held
        assert line.look.color == plot.BLUE

    def test_a_window_shows_every_sample_in_it(self):
        from inside import curves

        runs = simulate_settings(Tracker(h=1e-4))
        for line in curves(runs, (2.0, 2.05)):
            if line.panel != "phase":
                assert 2.0 <= np.nanmin(line.x) <= np.nanmax(line.x) <= 2.05
            if line.held:
                assert len(line.x) in (500, 501)

    def test_a_window_without_samples_is_empty(self):
        from inside import draw_runs

        assert draw_runs(simulate_settings(Ball()), (1.0012, 1.0013)).data

    def test_an_impact_interrupts_the_velocity(self):
        from inside import curves

        lines = {(c.panel, c.look.name): c for c in curves(simulate_settings(Ball()))}
        assert np.isnan(lines["velocity", "SwitchedRK"].y).sum() > 3
        assert not np.isnan(lines["position", "SwitchedRK"].y).any()


@st.composite
def anything(draw):
    """Draw a position of all sliders of a tab, their ends more often."""
    kind = draw(st.sampled_from([Ball, Regulator, Tracker]))
    return kind(**{name: draw(_position(given)) for name, given in ranges(kind).items()})


def attempt(chosen):
    try:
        return simulate_settings(chosen), ""
    except ValueError as error:
        return {}, str(error)


def _position(given):
    if "switch" in given:
        return st.booleans()
    listed = given.get("options") or given.get("steps")
    if listed:
        return st.sampled_from(listed)
    start, step = given["start"], given["step"]
    last = round((given["stop"] - start) / step)
    return st.integers(0, last).map(lambda k: min(start + k * step, given["stop"]))


@settings(max_examples=60)
@given(data=st.data())
def test_every_position_of_the_sliders_is_possible_but_gains_in_the_wrong_order(data):
    from inside import curves

    chosen = data.draw(anything())
    assert read_query(dict(parse_qsl(query(chosen)[1:]))) == chosen
    runs, message = attempt(chosen)
    wrong = not isinstance(chosen, Ball) and chosen.mu2 >= chosen.mu1
    assert bool(runs) != wrong
    if wrong:
        assert message.startswith("mu2 must be a gain with 0 < mu2 < mu1")
        return
    assert all(len(line.x) <= 1000 for line in curves(runs, (0.0, chosen.t_end)))
    assert len(facts(runs)) == len(runs)
    assert all("\n" not in text for text in warning_texts(runs))
    assert describe_signs(runs).endswith(".")
    assert xml.etree.ElementTree.fromstring(film(runs)).tag == "svg"


@pytest.mark.parametrize("kind", [Ball, Regulator, Tracker])
def test_every_setting_has_a_control_that_can_take_the_presets(kind):
    pytest.importorskip("marimo")
    from inside import panel, read_controls

    assert sorted(ranges(kind)) == sorted(field.name for field in dataclasses.fields(kind))
    assert next(iter(PRESETS[kind].values())) == kind()
    for preset in PRESETS[kind].values():
        assert read_controls(kind, panel(preset, lambda _: None)) == preset
        assert read_query(dict(parse_qsl(query(preset)[1:]))) == preset


class TestBelt:
    def test_the_mass_leaves_the_belt_when_the_spring_pulls_as_hard_as_it_holds(self):
        # limit + extra = stiffness x, with the speed of the belt
        for speed, leaves in ((0.2, 6.0), (0.4, 3.0)):
            runs = simulate_settings(Belt(speed=speed, xdot0=speed, h=1e-3))
            for name, within in (("implicit", 2e-2), ("high_order", 1e-9)):
                sticks = runs[name].run.stick
                assert sticks["t_end"][0] == pytest.approx(leaves, abs=within)

    def test_what_is_shown_of_a_run_is_that_of_the_run(self):
        given = Belt(damping=0.1, x0=0.5, xdot0=-1.0)
        runs = simulate_settings(given)
        for run in runs.values():
            np.testing.assert_allclose(run.slip, run.xdot - given.speed, atol=1e-13)
            assert np.abs(run.friction).max() <= given.limit + given.extra + 1e-12
            assert (run.sticks == (run.slip == 0.0)).all() or run is runs["explicit"]
        # x'' = -k x - c x' + friction, by differences where nothing sticks or turns
        line = runs["explicit"]
        slopes = np.diff(line.xdot) / given.h
        smooth = -given.stiffness * line.x - given.damping * line.xdot + line.friction
        clear = np.abs(line.slip[:-1]) > 1e-9  # else rounding decides the sign
        assert np.abs(slopes - smooth[:-1])[clear].max() < 1e-9

    def test_the_explicit_sign_never_sticks(self):
        runs = simulate_settings(Belt())
        said = describe_signs(runs)
        jumps = np.count_nonzero(np.diff(runs["explicit"].friction))
        assert f"its force jumps {jumps} times" in said
        assert jumps > 100
        share = runs["high_order"].stuck
        assert f"SwitchedRK {share:.1%}" in said
        assert abs(runs["implicit"].stuck - share) < 0.01
        assert [row["caught"] for row in facts(runs)][1] == "0 times"

    def test_a_brake_stops_the_mass_for_good(self):
        runs = simulate_settings(PRESETS[Belt]["a brake"])
        for name in ("implicit", "high_order"):
            assert runs[name].sticks[-1]
            assert runs[name].xdot[-1] == 0.0
        assert "never sticks" in describe_signs(runs)
