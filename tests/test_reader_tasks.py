"""Ten tasks of readers, each as it is written from the README and two pages and no more.

Whatever a program names of zivi stands on its pages; what it finds is compared by other ways.
"""

import concurrent.futures
import inspect
import itertools
import math
import re
import subprocess
import textwrap

import numpy as np
import pytest

import zivi
from page_blocks import DOCS

pytestmark = pytest.mark.slow

TASKS = {}


def task(*pages):
    """A test of a task, with the pages from which it can be written."""

    def keep(function):
        TASKS[function.__name__] = (function, pages)
        return function

    return keep


@task("tutorial", "tutorial_orbits")
def test_five_figures_for_a_lecture(tmp_path):
    plt = pytest.importorskip("matplotlib.pyplot")
    figure, axes = plt.subplots(1, 5)
    restitutions = np.linspace(0.05, 0.85, 9)
    rest = []
    for e in restitutions:
        sol = zivi.simulate(zivi.ImpactSystem(-9.81, e=e), (0, 6), (1, 0))
        zivi.plot.position(sol, ax=axes[0], label=f"e = {e:.2f}")
        rest.append(sol.rest_time)
    zivi.plot.lifted(sol, ax=axes[1])
    axes[2].semilogy(sol.impacts["t"], sol.impacts["speed_after"], ".")
    axes[3].plot(restitutions, rest)

    def table(gamma):
        force = zivi.LinearForce(gravity=1.0, amplitude=gamma, phase=-math.pi / 2)
        return zivi.ImpactSystem(force, e=0.5)

    orbit = zivi.periodic_orbit(table(1.3), zivi.simulate(table(1.3), (0, 600), (0.3, 1.9)))
    branch = zivi.continue_orbit(orbit, "amplitude", (1.0, 1.7))
    gammas = np.linspace(1.2, 1.7, 20)
    diagram = zivi.bifurcation_diagram(table(1.3), "amplitude", gammas, starts=(0.3, 1.9))
    zivi.plot.diagram(diagram, branches=[branch], ax=axes[4])
    figure.savefig(tmp_path / "lecture.png")
    plt.close(figure)

    exact = math.sqrt(2 / 9.81) * (1 + restitutions) / (1 - restitutions)
    np.testing.assert_allclose(rest, exact, rtol=1e-12)
    assert all(ax.lines for ax in axes)
    doubling = branch.of_kind("period_doubling")[0].value
    assert doubling == pytest.approx(math.hypot(math.pi / 3, 10 / 9), abs=1e-9)


@task("choose_gains", "noise_delay")
def test_gains_for_a_loop_with_noise_and_delay():
    design = zivi.design_tracker(2.0, e=0.7, bound=1.0, delay=3, quiet=5 * 0.01)
    for seed, unknown in enumerate((-1.0, -0.3, 0.4, 1.0)):
        run = zivi.simulate_closed_loop(
            zivi.ImpactSystem(-9.81 + unknown, e=0.7),
            design.controller(),
            (0, 3),
            (1, 0),
            y_ref0=(0, 0),
            force_model=-9.81,
            noise=(1e-5, 0.01),
            seed=seed,
            delay=3,
        )
        still = run.t > design.settling_time
        assert np.all(run.x[still] == 0)
        assert np.all(run.xdot[still] == 0)
        assert design.u_min - 1e-9 <= run.u.min() <= run.u.max() <= design.u_max + 1e-9


@task("linear_systems", "batch")
def test_a_damper_of_three_coordinates_over_its_clearance():
    mass, stiffness = np.diag([1.0, 1.0, 0.1]), np.zeros((3, 3))
    stiffness[:2, :2] = [[200, -100], [-100, 100]]
    omega = math.sqrt(np.linalg.eigvalsh(stiffness[:2, :2])[0])
    damping = 0.02 / omega * stiffness

    def building(clearance):
        return zivi.LinearSystem(
            mass,
            damping,
            stiffness,
            excitation=zivi.Harmonic([1.0, 0.0, 0.0], omega=omega),
            gaps=[
                zivi.LinearGap([0, -1, 1], clearance, name="left"),
                zivi.LinearGap([0, 1, -1], clearance, name="right"),
            ],
            e=0.6,
        )

    still = (np.zeros(3), np.zeros(3))
    period = 2 * math.pi / omega
    t = np.linspace(80 * period, 120 * period, 801)
    clearances = np.append(np.geomspace(0.05, 0.4, 7), 10.0)
    batch = zivi.simulate_batch([building(d) for d in clearances], (0, t[-1]), still, t_eval=t)
    rms = np.sqrt(np.mean(batch.sample_q[:, :, 1] ** 2, axis=1))

    # without impacts: the response of the two storeys, from their matrices
    dynamic = stiffness[:2, :2] - omega**2 * np.eye(2) + 1j * omega * damping[:2, :2]
    response = abs(np.linalg.solve(dynamic, [1.0, 0.0])[1]) / math.sqrt(2)
    assert batch.n_impacts[-1] == 0
    assert rms[-1] == pytest.approx(response, rel=1e-2)
    assert rms[:-1].min() < 0.2 * response


def film(t, x0, e):
    """Heights of a ball dropped without drag, flight by flight."""
    fall = math.sqrt(2 * x0 / 9.81)
    speed, start = 9.81 * fall, fall
    x = np.where(t <= fall, x0 - 9.81 * t**2 / 2, 0.0)
    for _ in range(200):
        speed *= e
        s = t - start
        x = np.where((s > 0) & (s < 2 * speed / 9.81), speed * s - 9.81 * s**2 / 2, x)
        start += 2 * speed / 9.81
    return x


@task("fit")
def test_a_fit_of_e_to_data():
    t = np.linspace(0.02, 3, 150)
    measured = film(t, 0.8, 0.72) + 2e-3 * np.random.default_rng(0).standard_normal(len(t))
    ball = zivi.ImpactSystem(zivi.LinearForce(gravity=9.81), e=0.6)
    fit = zivi.fit(ball, zivi.Record(t, measured), ("x0", "e"), y0=(1, 0))
    assert np.all(fit.deviations < 5e-4)
    assert np.all(np.abs(fit.x - [0.8, 0.72]) < 4 * fit.deviations)


@task("vi")
def test_a_linear_complementarity_problem():
    M, q = np.array([[4, 1, 0], [-1, 3, 1], [0, 2, 5.0]]), np.array([-3, 2, -4.0])
    result = zivi.solve_lcp(M, q)
    assert result.success
    # every set of positive unknowns
    found = []
    for chosen in itertools.product((False, True), repeat=3):
        x, on = np.zeros(3), np.array(chosen)
        x[on] = np.linalg.solve(M[np.ix_(on, on)], -q[on])
        if x.min() >= 0 and (M @ x + q)[~on].min(initial=0) >= 0:
            found.append(x)
    assert len(found) == 1
    np.testing.assert_allclose(result.x, found[0], atol=1e-12)


@task("control_mechanics", "tutorial_mechanism")
def test_an_arm_on_a_table():
    pytest.importorskip("sympy")
    arm = zivi.symbolic.system(
        "a b",
        T="m1*l1**2*adot**2/2 + m2*(l1**2*adot**2 + l2**2*(adot + bdot)**2"
        " + 2*l1*l2*adot*(adot + bdot)*cos(b))/2",
        V="m1*g*l1*sin(a) + m2*g*(l1*sin(a) + l2*sin(a + b))",
        gaps={"table": "l1*sin(a) + l2*sin(a + b) + d"},
        parameters={"m1": 1.0, "m2": 0.5, "l1": 0.4, "l2": 0.4, "g": 9.81, "d": 0.25},
        e=0.5,
        inputs={"shoulder": [1, 0], "elbow": [0, 1]},
    )
    start = ([0.4, -0.9], [0.0, 0.0])
    reference = zivi.reference_run(arm, (0, 1.2), start, virtual={"table": -9.81})
    tracker = zivi.GapTracker(arm, h=1e-3, gains={"table": (40, 22)}, force={"table": 8.0})
    run = zivi.simulate_closed_loop(
        arm, tracker, (0, 1.2), ([0.42, -0.92], [0.1, -0.1]), reference=reference
    )
    # the tip falls like a ball: its Zeno time in closed form
    height = 0.4 * math.sin(0.4) + 0.4 * math.sin(-0.5) + 0.25
    exact = 3 * math.sqrt(2 * height / 9.81)
    assert reference.zeno["t"][0] == pytest.approx(exact, abs=1e-6)
    assert run.zeno["t"][-1] == pytest.approx(exact, abs=0.02)
    pressed = run.reactions[run.t > 1.0, 0]
    assert np.all(np.abs(pressed - 8.0) < 1e-6)


TICK = r"""
#include <stdio.h>

#include "zivi.h"

int main(void)
{
    zivi_tracker tracker;
    zivi_tracker_config config;
    double x, xdot, u = 0.0;

    zivi_tracker_defaults(&config);
    config.mu1 = 30.0;
    config.mu2 = 17.0;
    config.h = 1e-3;
    config.e = 0.5;
    config.u_min = -80.0;
    config.u_max = 80.0;
    if (zivi_tracker_init(&tracker, &config) != ZIVI_OK)
        return 2;
    if (zivi_tracker_reset(&tracker, 0.0, 0.0) != ZIVI_OK)
        return 2;
    while (scanf("%lf %lf", &x, &xdot) == 2) {
        if (zivi_tracker_step(&tracker, x, xdot, -9.81, 0.0, &u) < 0)
            return 3;
        printf("%.17g\n", u);
    }
    return 0;
}
"""


@task("tutorial_target", "deploy")
def test_the_tick_in_c(tmp_path):
    from zivi import native

    prefix = native.prefix()
    (tmp_path / "tick.c").write_text(TICK)
    subprocess.run(
        [
            "cc",
            "-std=c99",
            tmp_path / "tick.c",
            f"-I{prefix / 'include'}",
            prefix / "lib" / "libzivi.a",
            "-o",
            tmp_path / "tick",
        ],
        check=True,
    )
    tracker = zivi.TwistingTracker(30, 17, h=1e-3, e=0.5, u_limits=(-80.0, 80.0))
    plant = zivi.ImpactSystem(-9.81, e=0.5)
    run = zivi.simulate_closed_loop(plant, tracker, (0, 2), (0.8, 0.0), y_ref0=(0, 0))
    assert run.rest_time is not None
    samples = "".join(
        f"{x:.17g} {v:.17g}\n" for x, v in zip(run.x.tolist(), run.xdot.tolist(), strict=True)
    )
    told = subprocess.run(
        [tmp_path / "tick"], input=samples, capture_output=True, text=True, check=True
    )
    # after each sample but the last its control acts
    controls = [float(line) for line in told.stdout.split()]
    assert controls[: len(run.u)] == run.u.tolist()[: len(controls)]
    assert len(controls) == len(run.x) > 1000


@task("studies", "tutorial_studies")
def test_a_study_that_outgrows_a_machine(tmp_path):
    pytest.importorskip("zarr")
    switch = tmp_path / "stop"
    switch.touch()

    def bounces(e, v):  # arrays of one length
        if e.max() > 0.6 and switch.exists():
            raise KeyboardInterrupt
        balls = [zivi.ImpactSystem(-9.81, e=it) for it in e]
        starts = np.column_stack([np.ones(len(v)), v])
        batch = zivi.simulate_batch(balls, (0, 60), starts, threads=1)
        return {"rest_time": batch.rest_time}

    grid = {"e": np.linspace(0.1, 0.9, 20), "v": np.linspace(0, 4, 50)}

    def study(executor=None):
        return zivi.sweep(
            bounces,
            grid,
            vectorized=True,
            chunk=100,
            out=tmp_path / "rest.zarr",
            executor=executor,
            units={"v": "m/s", "rest_time": "s"},
        )

    with pytest.raises(KeyboardInterrupt):
        study()
    begun = int((zivi.open_study(tmp_path / "rest.zarr").status == 1).sum())
    assert 0 < begun < 1000
    switch.unlink()
    with concurrent.futures.ThreadPoolExecutor(2) as cluster:
        study(cluster)
    found = zivi.open_study(tmp_path / "rest.zarr")
    e, v = np.meshgrid(grid["e"], grid["v"], indexing="ij")
    exact = (v + np.sqrt(v**2 + 2 * 9.81) * (1 + e) / (1 - e)) / 9.81
    np.testing.assert_allclose(found.rest_time.transpose("e", "v"), exact, rtol=1e-12)


ARM = """
<mujoco>
  <worldbody>
    <geom name="table" type="plane" size="2 2 .1" pos="0 0 -.5" condim="1"/>
    <body pos="0 0 0">
      <joint name="shoulder" type="slide" axis="0 0 1"/>
      <geom name="tip" type="sphere" size=".1" condim="1"/>
      <body pos=".1 0 0">
        <joint name="elbow" type="hinge" axis="0 1 0" range="-10 120" limited="true"/>
        <geom type="sphere" pos="0 0 0" size=".02" contype="0" conaffinity="0"/>
      </body>
    </body>
  </worldbody>
</mujoco>
"""


@task("trees", "mechanics")
def test_a_model_from_mjcf(tmp_path):
    pytest.importorskip("mujoco")
    (tmp_path / "arm.xml").write_text(ARM)
    arm = zivi.Tree.from_mjcf(tmp_path / "arm.xml", gaps=["elbow", ("tip", "table")], e=0.5)
    sol = zivi.simulate(arm, (0, 3), ([0.0, 0.5], [0.0, 0.0]))
    # the ball falls 0.4 m; what hangs at it turns about its own centre
    assert sol.zeno["t"] == pytest.approx([3 * math.sqrt(0.8 / 9.81)], abs=1e-6)
    assert sol.q[-1] == pytest.approx([-0.4, 0.5], abs=1e-12)


@task("friction")
def test_friction_on_a_belt():
    speed = 0.2
    belt = zivi.DryFriction(limit=0.8, static=1.2, velocity=speed, name="belt")
    oscillator = zivi.MechanicalSystem(mass=1.0, force=lambda t, q, qdot: -q, friction=[belt])
    sol = zivi.simulate(oscillator, (0, 30), ([0.0], [speed]))
    # it slips at x = 1.2, by x - 0.8 = 0.4 cos s + 0.2 sin s, until x' is the belt's speed again
    slip = 2 * math.pi - 2 * math.atan2(0.4, speed)
    caught = 0.8 + 0.4 * math.cos(slip) + speed * math.sin(slip)
    ends = np.cumsum([1.2 / speed, slip + (1.2 - caught) / speed])
    assert sol.stick["t_end"][:2] == pytest.approx(ends, abs=1e-6)
    box = zivi.MechanicalSystem(
        mass=np.eye(2),
        force=[0, -9.81],
        gaps=[zivi.LinearGap([0, 1], tangent=[1, 0], mu=0.3, belt=1.0)],
        e=0.0,
    )
    sol = zivi.simulate(box, (0, 2), ([0, 0], [0, 0]))
    assert sol.stick["t_start"] == pytest.approx([1 / (0.3 * 9.81)], abs=1e-9)


@pytest.mark.parametrize("name", TASKS)
def test_two_pages_are_enough(name):
    function, pages = TASKS[name]
    assert len(pages) <= 2
    told = "".join((DOCS / f"{page}.md").read_text() for page in ("../README", *pages))
    code = textwrap.dedent(inspect.getsource(function))
    names = set(re.findall(r"\bzivi((?:\.\w+)+)", code))
    assert names
    used = {part for name in names for part in name[1:].split(".")}
    # what is taken of results, and arguments
    used |= set(re.findall(r"\b(?:run|sol|batch|design|model|result|branch)\.([a-z]\w+)", code))
    used |= set(re.findall(r"^ {8,}(\w+)=", code, re.MULTILINE))
    missing = {it for it in used if not re.search(rf"\b{it}\b", told)}
    assert not missing


def test_there_are_ten_of_them():
    assert len(TASKS) == 10
