"""Films of mechanical systems."""

import numpy as np
import pytest
from PIL import Image

import zivi
from example_scripts import example

plt = pytest.importorskip("matplotlib.pyplot")

PENDULUM = zivi.MechanicalSystem(
    mass=0.25,
    force=lambda t, q, qdot: [-4.9 * np.sin(q[0])],
    gaps=[zivi.LinearGap([1], name="stop")],
    e=0.6,
    coordinates=["phi"],
)


@pytest.fixture(scope="module")
def sol():
    return zivi.simulate(PENDULUM, (0, 1), ([0.8], [0.0]))


def arm(t, q):
    return [([0, np.sin(q[0])], [0, -np.cos(q[0])]), (np.sin(q[0]), -np.cos(q[0]))]


def played(film, number):
    film._draw_was_started = True  # it was looked at, if not shown
    return film._func(number)


def test_the_bodies_are_where_the_coordinates_are(sol):
    film = zivi.plot.animate(
        sol, bodies=arm, walls=lambda t, q: [([0, 0], [-1.2, -0.8 - 0.1 * t])], fps=20
    )
    for number in (0, 7, 20):
        line, bob, wall, gap, clock = played(film, number)
        t = number / 20
        (phi,) = sol(t)[0]
        assert line.get_xdata() == pytest.approx([0, np.sin(phi)])
        assert bob.get_ydata() == pytest.approx([-np.cos(phi)])
        assert wall.get_ydata() == pytest.approx([-1.2, -0.8 - 0.1 * t])
        assert gap.get_xdata()[-1] == pytest.approx(t)
        assert gap.get_ydata()[-1] == pytest.approx(phi, abs=1e-12)
        assert gap.get_ydata() == pytest.approx(sol(gap.get_xdata())[0, :, 0], abs=1e-9)
        assert clock.get_text() == f"$t$ = {t:.2f} s"
    left, right = line.figure.axes
    for number in range(21):
        x, y = played(film, number)[0].get_data()
        assert left.get_xlim()[0] < min(x) <= max(x) < left.get_xlim()[1]
        assert left.get_ylim()[0] < min(y) <= max(y) < left.get_ylim()[1]
    assert right.get_legend().get_texts()[0].get_text() == "stop"


@pytest.mark.parametrize("n", [1, 2, 3])
def test_without_bodies_it_is_points(n):
    system = zivi.MechanicalSystem(mass=np.eye(n), force=-np.ones(n), gaps=[], e=0.5)
    run = zivi.simulate(system, (0, 1), (np.arange(n) + 1.0, np.zeros(n)))
    film = zivi.plot.animate(run, fps=10)
    shown = played(film, 10)[: 1 if n == 2 else n]
    data = np.array([mark.get_data() for mark in shown]).reshape(-1)
    q = run.q[-1]
    expected = q if n == 2 else np.array([[k, q[k]] for k in range(n)]).reshape(-1)
    assert data == pytest.approx(expected)


def test_steps_are_joined_where_no_motion_is_kept(sol):
    bare = zivi.simulate(PENDULUM, (0, 1), ([0.8], [0.0]), dense_output=False)
    _, bob, *_ = played(zivi.plot.animate(bare, bodies=arm, fps=10), 10)
    assert bob.get_xdata() == pytest.approx([np.sin(bare.q[-1, 0])])


@pytest.mark.parametrize(
    ("lines", "told"),
    [
        (lambda t, q: [1, 2, 3], "bodies must return pairs of x and y"),
        (lambda t, q: [([0, 1], [0, 1, 2])], "bodies must return pairs of x and y"),
        (lambda t, q: [(0, 0)] * (1 + int(t > 0.5)), "as many lines at all times"),
    ],
)
def test_bodies_that_are_none(sol, lines, told):
    with pytest.raises(ValueError, match=told):
        zivi.plot.animate(sol, bodies=lines, fps=10)


def test_a_mass_above_a_wall_has_no_bodies(sol):
    ball = zivi.simulate(zivi.ImpactSystem(-9.81, e=0.5), (0, 1), (1, 0))
    with pytest.raises(TypeError, match="walls must be a function"):
        zivi.plot.animate(ball, walls=arm)
    with pytest.raises(TypeError, match="bodies must be a function"):
        zivi.plot.animate(sol, bodies=3)


@pytest.mark.slow
@pytest.mark.xdist_group("mechanical models")
@pytest.mark.parametrize("name", ["mechanics_double_pendulum", "mechanics_block"])
def test_films_of_the_examples(name, tmp_path, monkeypatch):
    pytest.importorskip("sympy")
    made = []
    animate = zivi.plot.animate

    def noted(*run, **settings):
        made.append(animate(*run, **settings))
        return Unwritten()

    monkeypatch.setattr(zivi.plot, "animate", noted)
    example(name).film(str(tmp_path / "film.gif"))
    assert len(made) == 1
    played(made[0], 5)


class Unwritten:
    """Takes the place of a film, which takes seconds to write."""

    def save(self, path, writer, dpi):
        assert writer == "pillow"


@pytest.mark.parametrize("fps", [25, 30, 12])
def test_a_gif_lasts_as_long_as_the_motion(sol, tmp_path, fps):
    film = zivi.plot.animate(sol, fps=fps, figure=plt.figure(figsize=(2, 1)))
    film.save(tmp_path / "film.gif", dpi=20)
    with Image.open(tmp_path / "film.gif") as written:
        lasting = 0.0
        for number in range(written.n_frames):
            written.seek(number)
            lasting += written.info["duration"] / 1e3
    # each of the pictures, the first at t = 0, lasts 1/fps
    assert lasting == pytest.approx((1 + np.ceil(fps * 1.0)) / fps, abs=0.0051)


def test_floor_and_wall_are_drawn_where_the_gaps_close():
    gaps = [zivi.LinearGap([0, 1], 0.5), zivi.LinearGap([-2, 0], 3.0)]
    system = zivi.MechanicalSystem(mass=np.eye(2), force=[0, -9.81], gaps=gaps, e=0.8)
    run = zivi.simulate(system, (0, 1), ([0, 1], [3, 0]))
    _, floor, wall, *_ = played(zivi.plot.animate(run, fps=5), 3)
    assert floor.get_ydata() == pytest.approx([-0.5, -0.5])
    assert wall.get_xdata() == pytest.approx([1.5, 1.5])
    left = floor.figure.axes[0]
    assert min(floor.get_xdata()) < left.get_xlim()[0] < left.get_xlim()[1] < max(floor.get_xdata())
    system = zivi.MechanicalSystem(
        mass=np.eye(3), force=-np.ones(3), gaps=[zivi.LinearGap([0, 2, 0], -1.0)], e=0.5
    )
    run = zivi.simulate(system, (0, 1), ([1, 2, 3], [0, 0, 0]))
    floor = played(zivi.plot.animate(run, fps=5), 3)[3]
    assert floor.get_data()[1] == pytest.approx([0.5, 0.5])
    assert np.mean(floor.get_data()[0]) == 1.0


SHAPES = {
    "box": zivi.mechanics.Box([0.1, 0.2, 0.3]),
    "ball": zivi.mechanics.Ball(0.2, body="bob"),
    "rod": zivi.mechanics.Capsule(0.05, 0.3, [1, 2, 2], [0.1, 0, 0], body="box"),
    "post": zivi.mechanics.Ball(0.1, [1, 0, 0.1]),
    "floor": zivi.mechanics.Plane([0, 3, 4], offset=-1.0),
}


@pytest.fixture(scope="module")
def flown():
    bodies = [
        zivi.mechanics.Body(name, kind="free", mass=1.0, inertia=[0.1, 0.2, 0.15])
        for name in ("box", "bob")
    ]
    tree = zivi.Tree(bodies)
    start = [0, 0, 1, 1, 0, 0, 0, 1, 1, 1, 1, 0, 0, 0], [1, 0, 0, 5, 2, 9, *[0] * 6]
    return zivi.simulate(tree, (0, 1), start)


def test_shapes_of_free_bodies_are_wireframes(flown):
    film = zivi.plot.animate(flown, shapes=SHAPES, fps=10)
    box, ball, rod, post, floor = (np.array(it.get_data_3d()) for it in played(film, 7)[:5])
    at = flown.resample([0.7])
    place, p = at.pose("box")
    # distances of corners and of the axis of a capsule do not turn
    far = np.linalg.norm(box.T - place, axis=1)
    assert far[~np.isnan(far)] == pytest.approx(np.sqrt(0.14), abs=1e-12)
    w, v = p[0, 0], p[0, 1:]
    corner = np.array([-0.1, -0.2, -0.3])
    turned = corner + 2 * np.cross(v, np.cross(v, corner) + w * corner)
    assert box[:, 0] == pytest.approx(place[0] + turned, abs=1e-12)
    to_bob = np.linalg.norm(ball.T - at.pose("bob")[0], axis=1)
    assert to_bob[~np.isnan(to_bob)] == pytest.approx(0.2, abs=1e-12)
    assert np.nanmax(np.linalg.norm(rod.T - place, axis=1)) < 0.1 + 0.35
    assert np.linalg.norm(post.T[0] - [1, 0, 0.1]) == pytest.approx(0.1)
    heights = np.array([0, 0.6, 0.8]) @ floor
    assert np.count_nonzero(~np.isnan(heights)) == 28
    assert heights[~np.isnan(heights)] == pytest.approx(-1.0, abs=1e-12)
    assert len(film.to_jshtml()) > 1000
    axes = zivi.plot.animate(flown, fps=10)
    ends = [np.array(it.get_data_3d())[:, 0] for it in played(axes, 7)[:3]]
    assert ends == pytest.approx(np.tile(place, (3, 1)))
    assert len(axes.to_jshtml()) > 1000


def test_axes_in_space_are_labelled_and_show_the_floor():
    shapes = {
        "bob": zivi.mechanics.Ball(0.1),
        "floor": zivi.mechanics.Plane(),
        "far": zivi.mechanics.Plane([1, 0, 0], -50.0),
    }
    tree = zivi.Tree(
        [zivi.mechanics.Body("bob", kind="free", mass=1.0, inertia=0.004)],
        contacts=[zivi.mechanics.Contact("bob", "floor")],
        shapes=shapes,
    )
    start = [0.3, -0.2, 1.0, 1, 0, 0, 0], [1.0, 0, 0, 0, 0, 0]
    run = zivi.simulate(tree, (0, 0.1), start)  # it does not reach the floor
    ball, floor, *others = played(zivi.plot.animate(run, shapes=shapes, fps=10), 1)
    assert len(others) == 2  # gap and clock; no plane far away
    axes = ball.axes
    limits = np.array([axes.get_xlim(), axes.get_ylim(), axes.get_zlim()])
    assert np.diff(limits, axis=1) == pytest.approx(np.ptp(limits[0]))  # a ball is round
    for line in (ball, floor):
        points = np.array(line.get_data_3d())
        points = points[:, ~np.isnan(points[0])].T
        assert np.all((limits[:, 0] < points) & (points < limits[:, 1]))
    labels = [axes.get_xlabel(), axes.get_ylabel(), axes.get_zlabel()]
    assert labels == ["$x$ (m)", "$y$ (m)", "$z$ (m)"]
    pixels = ball.figure.transSubfigure.inverted()
    around = axes.zaxis.label.get_window_extent().transformed(pixels)
    assert around.x1 < ball.figure.axes[1].yaxis.label.get_window_extent().transformed(pixels).x0


def test_shapes_that_cannot_be_drawn(flown, sol):
    with pytest.raises(ValueError, match="shape 'foot' must be on a free body"):
        zivi.plot.animate(flown, shapes={"foot": zivi.mechanics.Ball(1, body="arm")})
    with pytest.raises(TypeError, match="shapes must be given for a run with free bodies"):
        zivi.plot.animate(sol, shapes=SHAPES)
    lines = [([0, 1], [0, 1])], [(0, 0, 0)]
    with pytest.raises(ValueError, match=r"lines \(x, y\), or all of them \(x, y, z\)"):
        zivi.plot.animate(flown, bodies=lambda t, q: lines[0], walls=lambda t, q: lines[1])
