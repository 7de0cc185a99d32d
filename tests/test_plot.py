"""Plots draw into the axes they are given, label them with units and never show."""

import base64
import io
import itertools
import re

import matplotlib as mpl

mpl.use("Agg")

import matplotlib.pyplot as plt
import numpy as np
import pytest
from PIL import Image

import zivi
from interrupting import calls_in

PLOTS = {
    "position": zivi.plot.position,
    "velocity": zivi.plot.velocity,
    "lifted": zivi.plot.lifted,
    "signs": zivi.plot.signs,
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
    np.testing.assert_array_equal(lifted.lines[0].get_ydata(), sol.transformed.s)
    np.testing.assert_array_equal(lifted.lines[1].get_ydata(), sol.transformed.v)
    phase = zivi.plot.phase_plane(sol)
    np.testing.assert_array_equal(
        phase.lines[0].get_xydata(), np.column_stack([sol.transformed.s, sol.transformed.v])
    )


def test_the_velocity_is_broken_at_impacts(sol):
    line = zivi.plot.velocity(sol).lines[0]
    t, xdot = line.get_data()
    assert np.count_nonzero(np.isnan(xdot)) <= len(sol.resolved_impacts)
    kept = ~np.isnan(xdot)
    np.testing.assert_array_equal(xdot[kept], sol.xdot)
    first = np.flatnonzero(~kept)[0]
    assert t[first - 1] <= sol.resolved_impacts["t"][0] <= t[first + 1]


def test_other_coordinates_are_refused(sol):
    with pytest.raises(ValueError, match="coordinates"):
        zivi.plot.phase_plane(sol, coordinates="polar")


def test_an_overlay_takes_the_next_colour(sol):
    ax = zivi.plot.position(sol)
    for _ in range(8):
        zivi.plot.position(sol, ax)
    colours = [line.get_color() for line in ax.lines]
    assert colours[0] == zivi.plot.BLUE
    assert len(set(colours[:7])) == 7
    assert all(one != next_ for one, next_ in itertools.pairwise(colours))


@pytest.fixture(scope="module")
def on_a_table():
    table = zivi.HarmonicWall(amplitude=0.05, omega=20.0)
    ball = zivi.ImpactSystem(-9.81, e=0.6, wall=table)
    return zivi.simulate(ball, (0, 1), (0.3, 0))


def test_the_frame_of_a_moving_wall_is_named(on_a_table, sol):
    relative, fixed = (zivi.plot.position(on_a_table, frame=it) for it in ("wall", "fixed"))
    assert relative.get_ylabel() == "distance from the wall $x$ (m)"
    assert fixed.get_ylabel() == "position $x + w$, fixed frame (m)"
    t, x = relative.lines[0].get_data()
    w = 0.05 * np.cos(20.0 * t)
    np.testing.assert_allclose(fixed.lines[0].get_ydata(), x + w, atol=1e-15)
    np.testing.assert_allclose(fixed.lines[1].get_ydata(), w, atol=1e-15)
    moving = zivi.plot.velocity(on_a_table, frame="fixed").lines[0].get_ydata()
    t, still = zivi.plot.velocity(on_a_table).lines[0].get_data()
    kept = ~np.isnan(t)
    shift = -0.05 * 20.0 * np.sin(20.0 * t[kept])
    np.testing.assert_allclose(moving[kept], still[kept] + shift, atol=1e-14)
    plane = zivi.plot.phase_plane(on_a_table, coordinates="physical", frame="fixed")
    assert plane.get_xlabel() == fixed.get_ylabel()
    with pytest.raises(ValueError, match="frame must be 'wall' or 'fixed', got 'moon'"):
        zivi.plot.position(on_a_table, frame="moon")
    assert zivi.plot.position(sol, frame="fixed").get_ylabel() == "position $x$ (m)"


def test_an_overview_of_a_trajectory(sol):
    figure = zivi.plot.overview(sol)
    assert [ax.get_ylabel() for ax in figure.axes] == [
        "position $x$ (m)",
        r"velocity $\dot x$ (m/s)",
        "transformed state $s$, $v$",
        r"velocity $\dot x$ (m/s)",
    ]
    assert figure.axes[3].get_xlim() != figure.axes[0].get_xlim()


def test_a_poincare_section_of_a_periodic_orbit_is_a_point():
    """On a table the speed after the impact is ``g T/2 - W`` for ``W = (1-e)/(1+e) g T/2``."""
    g, e, omega = 9.81, 0.5, 20.0
    period = 2 * np.pi / omega
    speed = g * period / 2
    wall_speed = (1 - e) / (1 + e) * speed
    amplitude = 1.2 * wall_speed / omega
    phase = np.arccos(wall_speed / (amplitude * omega))  # w' = A omega cos(omega t + phase)
    table = zivi.HarmonicWall(amplitude=amplitude, omega=omega, phase=phase - np.pi / 2)
    ball = zivi.ImpactSystem(-g, e=e, wall=table)
    start = (0, speed - wall_speed)
    sol = zivi.simulate(ball, (0, 40 * period), start, zivi.SwitchedRK(rtol=1e-11))
    across, along = zivi.plot.poincare(sol, period, section="impacts", skip=2).lines[0].get_data()
    assert len(across) >= 35
    np.testing.assert_allclose(np.minimum(across, 1 - across), 0.0, atol=1e-6)
    np.testing.assert_allclose(along, speed - wall_speed, rtol=1e-6)
    middle = zivi.plot.poincare(sol, period, phase=0.4 * period).lines[0].get_data()
    expected = sol(0.4 * period)
    np.testing.assert_allclose(middle, np.tile(expected[:, None], 40), rtol=1e-5)


def test_a_section_without_points_is_refused(sol):
    with pytest.raises(ValueError, match="the run has 2 points of this section, and skip is 5"):
        zivi.plot.poincare(sol, 1.5, skip=5)
    with pytest.raises(ValueError, match=r"period must be > 0, got 0\.0"):
        zivi.plot.poincare(sol, 0.0)
    with pytest.raises(ValueError, match="section must be 'period' or 'impacts'"):
        zivi.plot.poincare(sol, 1.0, section="there")


def test_a_film_shows_the_motion(on_a_table, tmp_path):
    film = zivi.plot.animate(on_a_table, speed=0.5, fps=20)
    for number in (0, 7, 23, 40):
        ball, floor, line, clock = film._func(number)
        t = 0.025 * number
        w = 0.05 * np.cos(20.0 * t)
        assert ball.get_ydata()[0] == pytest.approx(on_a_table(t)[0] + w, abs=2e-4)
        assert floor.get_ydata()[0] == pytest.approx(w, abs=1e-12)
        assert line.get_xdata()[-1] == pytest.approx(t)
        assert clock.get_text() == f"$t$ = {t:.2f} s"
    film._draw_was_started = True  # it was looked at, if not shown
    short = zivi.simulate(zivi.ImpactSystem(-9.81, e=0.5), (0, 0.2), (0.1, 0))
    zivi.plot.animate(short, fps=10).save(tmp_path / "ball.gif", writer="pillow")
    assert (tmp_path / "ball.gif").read_bytes()[:6] == b"GIF89a"


def test_a_film_of_a_closed_loop_has_its_reference():
    plant = zivi.ImpactSystem(-9.81, kappa=0.5)
    tracker = zivi.TwistingTracker(30, 17, h=1e-2, kappa=0.5)
    run = zivi.simulate_closed_loop(plant, tracker, (0, 1), (2, 0), y_ref0=(1, 0), force_ref=-19.81)
    film = zivi.plot.animate(run, fps=10)
    ball, reference, *_ = film._func(10)
    assert ball.get_ydata()[0] == pytest.approx(run.x[-1])
    assert reference.get_ydata()[0] == pytest.approx(run.x_ref[-1])
    film._draw_was_started = True


@pytest.mark.parametrize("wrong", [{"speed": 0.0}, {"fps": -1.0}, {"speed": 1e-9}])
def test_a_film_that_cannot_be_is_refused(sol, wrong):
    with pytest.raises(ValueError, match=next(iter(wrong))):
        zivi.plot.animate(sol, **wrong)


OSCILLATOR = zivi.LinearSystem(
    np.eye(1),
    [[0.05]],
    [[1.0]],
    excitation=zivi.Harmonic([1.0], omega=1.2),
    gaps=[zivi.LinearGap([-1.0], 0.5, name="stop")],
    e=0.7,
)


@pytest.mark.parametrize("span", [20.0, 600.0])
def test_a_mechanical_line_follows_the_motion_however_long_it_is(span):
    sol = zivi.simulate(OSCILLATOR, (0, span), ([0.2], [0.0]), t_eval=[0.0, span])
    t, q = zivi.plot.coordinates(sol).lines[0].get_data()
    assert len(t) < 30 * span + 300
    between = np.linspace(0, span, 20_011)
    exact = sol(between)[0][:, 0]
    assert np.abs(np.interp(between, t, q) - exact).max() < 2e-3 * np.ptp(exact)
    # a velocity is not joined across an impact
    position, speed = zivi.plot.configuration(sol).lines[0].get_data()
    hits = len(np.unique(sol.impacts["t"]))
    assert np.count_nonzero(np.isnan(speed)) == hits
    breaks = np.flatnonzero(np.isnan(speed))
    assert position[breaks - 1] == pytest.approx(0.5, abs=1e-6)
    assert speed[breaks + 1] == pytest.approx(-0.7 * speed[breaks - 1], rel=1e-3, abs=1e-3)


def test_a_reaction_is_followed_while_nothing_moves():
    def force(t, q, qdot):
        return [-9.81 + 5 * np.cos(20 * t)]

    pressed = zivi.MechanicalSystem(mass=1.0, force=force, gaps=[zivi.LinearGap([1.0])], e=0.5)
    sol = zivi.simulate(pressed, (0, 3), ([0.0], [0.0]), t_eval=[0.0, 3.0])
    t, reaction = zivi.plot.reactions(sol).lines[0].get_data()
    between = np.linspace(0, 3, 5001)
    expected = 9.81 - 5 * np.cos(20 * between)
    assert np.abs(np.interp(between, t, reaction) - expected).max() < 2e-2


def test_fixed_steps_are_drawn_at_their_steps():
    sol = zivi.simulate(OSCILLATOR, (0, 5), ([0.2], [0.0]), zivi.MoreauJean(1e-2), t_eval=[0, 5])
    steps = zivi.simulate(OSCILLATOR, (0, 5), ([0.2], [0.0]), zivi.MoreauJean(1e-2))
    t, q = zivi.plot.coordinates(sol).lines[0].get_data()
    np.testing.assert_array_equal(np.interp(steps.t, t, q), steps.q[:, 0])


CORNER = zivi.MechanicalSystem(
    mass=np.eye(2),
    force=[2.0, -9.81],
    gaps=[
        zivi.LinearGap([0, 1], name="floor"),
        zivi.LinearGap([-1, 0], 0.8, name="right"),
        zivi.LinearGap([1, 0], 0.3, name="left"),
    ],
    e=[0.5, 0.6, 0.6],
    coordinates=["x", "y"],
)
ROD = zivi.mechanics.Body("rod", mass=1, axis=[0, 1, 0], com=[0, 0, -1], inertia=0.1)
SLED = zivi.mechanics.Body("sled", mass=1, axis=[1, 0, 0], kind="slide", position=[1, 0, 0])


def test_gaps_mark_impacts_and_opposite_ones_are_two_walls():
    sol = zivi.simulate(CORNER, (0, 2.5), ([0, 0.5], [1.5, 0]))
    ax = zivi.plot.gaps(sol, units="m")
    drawn = {line.get_label(): line for line in ax.lines}
    assert ax.get_ylabel() == "gaps $g_i$ (m)"
    named = [text.get_text() for text in ax.get_legend().get_texts()]
    assert named == ["floor", "right", "left closed", "impact", "accumulation"]
    # right + left = 0.8 + 0.3
    assert drawn["left closed"].get_ydata() == pytest.approx([1.1, 1.1])
    marks = [line for line in ax.lines if line.get_marker() == "|"]
    seen = np.concatenate([line.get_xdata() for line in marks])
    np.testing.assert_array_equal(np.sort(seen), np.sort(sol.impacts["t"]))
    plane = zivi.plot.configuration(sol).lines[1]
    at = sol(np.unique(sol.impacts["t"]))[0]
    np.testing.assert_allclose(plane.get_xydata(), at, atol=1e-12)
    (ticks,) = [line for line in zivi.plot.coordinates(sol).lines if line.get_marker() == "|"]
    np.testing.assert_array_equal(ticks.get_xdata(), np.unique(sol.impacts["t"]))


def test_units_are_those_of_joints_or_as_given():
    gaps = [zivi.mechanics.JointLimit(joint, lower=-1.0) for joint in ("rod", "sled")]
    sol = zivi.simulate(zivi.Tree([ROD, SLED], gaps=gaps, e=0.5), (0, 1), ([0.5, 0], [0, 0]))
    coordinates, gaps, plane = zivi.plot.overview(sol).axes
    for ax in (coordinates, gaps):
        assert "(" not in ax.get_ylabel()
        units = [text.get_text().split(" (")[1] for text in ax.get_legend().get_texts()[:2]]
        assert units == ["rad)", "m)"]
    assert (plane.get_xlabel(), plane.get_ylabel()) == ("rod (rad)", "sled (m)")
    alone = zivi.simulate(OSCILLATOR, (0, 1), ([0.2], [0.0]))
    (name,) = alone.coordinate_names
    assert zivi.plot.coordinates(alone).get_ylabel() == name
    labelled = zivi.plot.configuration(alone, units={name: "m"})
    assert labelled.get_ylabel() == f"velocity of {name} (m/s)"
    assert zivi.plot.reactions(alone, units="m").get_ylabel().endswith("(N)")
    with pytest.raises(TypeError, match="units must be a string or a dict by name, got 3"):
        zivi.plot.gaps(alone, units=3)


def test_a_histogram_counts_every_impact_once(sol):
    bars = zivi.plot.impacts(sol, bins=7).patches
    assert sum(bar.get_height() for bar in bars) == len(sol.impacts)
    run = zivi.simulate(CORNER, (0, 2.5), ([0, 0.5], [1.5, 0]))
    ax = zivi.plot.impacts(run)
    assert ax.get_xscale() == "log"
    for number, bars in zip((0, 1), ax.containers, strict=True):  # the left wall is not hit
        own = -run.impacts["speed_before"][run.impacts["gap"] == number]
        assert sum(bar.get_height() for bar in bars) == len(own)
        low, high = (f(it.get_x() for it in bars if it.get_height()) for f in (min, max))
        assert low <= own.min()
        assert high <= own.max() <= 1.001 * (high + max(it.get_width() for it in bars))
    still = zivi.simulate(CORNER, (0, 0.1), ([0, 0.5], [0, 0]))
    assert zivi.plot.impacts(still).texts[0].get_text() == "no impacts"
    with pytest.raises(ValueError, match="bins must be >= 1, got 0"):
        zivi.plot.impacts(sol, bins=0)


class Spring:
    h = 1e-2

    def step(self, x, xdot, force):
        return 40.0 * (0.5 - x) - 6.0 * xdot - force


def test_an_overview_has_no_empty_panels():
    free = zivi.MechanicalSystem(mass=np.eye(2), force=[0.0, -1.0], gaps=[], e=0.5)
    rubbed = zivi.MechanicalSystem(
        mass=1.0, force=[1.0], gaps=[], friction=[zivi.DryFriction(limit=0.5, name="guide")]
    )
    runs = {
        2: zivi.simulate(free, (0, 1), ([0.0, 0.0], [1.0, 1.0])),
        3: zivi.simulate(OSCILLATOR, (0, 20), ([0.2], [0.0])),
        4: zivi.simulate(rubbed, (0, 1), ([0.0], [0.0])),
    }
    ball = zivi.ImpactSystem(-9.81, e=0.5)
    unsigned = zivi.simulate_closed_loop(ball, Spring(), (0, 1), (1, 0))
    for number, run in [*runs.items(), (4, unsigned)]:
        figure = zivi.plot.overview(run)
        assert len(figure.axes) == number
        for ax in figure.axes:
            drawn = [np.isfinite(np.asarray(line.get_ydata(), float)).any() for line in ax.lines]
            assert any(drawn) or ax.collections
            assert not ax.texts


def test_legends_stand_beside_the_curves(sol):
    figure = zivi.plot.overview(zivi.simulate(OSCILLATOR, (0, 20), ([0.2], [0.0])))
    figure.canvas.draw()
    for ax in figure.axes[:2]:
        legend = ax.get_legend().get_window_extent()
        assert legend.x0 >= ax.get_window_extent().x1
        assert legend.x1 <= figure.bbox.x1
    # where nothing makes room, it would be cut off
    _, plain = plt.subplots()
    zivi.plot.lifted(sol, plain)
    plain.figure.canvas.draw()
    assert plain.get_legend().get_window_extent().x1 <= plain.get_window_extent().x1


def test_a_picture_of_a_film_is_not_drawn_from_the_start(on_a_table):
    for run in (on_a_table, zivi.simulate(OSCILLATOR, (0, 20), ([0.2], [0.0]))):
        film = zivi.plot.animate(run, fps=10 / (run.t[-1] - run.t[0]))
        pages = []
        calls = calls_in(lambda film=film, pages=pages: pages.append(film.to_jshtml()))
        assert calls / 11 < 25_000
        (page,) = pages
        pictures = re.findall(r'frames\[\d+\] = "data:image/png;base64,([^"]+)"', page)
        assert len(set(pictures)) == 11


def test_a_page_shows_what_the_film_does(on_a_table):
    film = zivi.plot.animate(on_a_table, fps=10)
    page = film.to_jshtml()
    pictures = re.findall(r'frames\[\d+\] = "data:image/png;base64,([^"]+)"', page)
    figure = film._fig
    for number in (0, 4, 9):
        film._func(number)
        whole = io.BytesIO()
        figure.savefig(whole, format="png", dpi=figure.dpi)
        expected, found = (
            np.asarray(Image.open(io.BytesIO(it)).convert("RGB"), float)
            for it in (whole.getvalue(), base64.b64decode(pictures[number].replace("\\\n", "")))
        )
        assert expected.shape == found.shape
        assert np.mean(np.abs(expected - found) > 32) < 1e-3


def test_a_diagram_and_a_branch_say_what_is_what():
    table = zivi.ImpactSystem(zivi.LinearForce(gravity=1.0, amplitude=1.3, phase=-np.pi / 2), e=0.5)
    branch = zivi.continue_orbit(zivi.periodic_orbit(table, [(0.6, 2.1)]), "amplitude", (1.0, 1.6))
    found = zivi.bifurcation_diagram(
        table, "amplitude", [0.5, 1.3], starts=[(0, 0), (0.3, 1.9)], transient=50, keep=4
    )
    ax = zivi.plot.diagram(found, branches=[branch])
    names = [text.get_text() for text in ax.get_legend().get_texts()]
    assert names == [
        "impacts",
        "impacts, then rest",
        "stable",
        "unstable",
        "fold",
        "period doubling",
    ]
    low, high = zivi.plot.branch(branch).get_ylim()
    assert high - low > 0.1  # the speed is the same all along
