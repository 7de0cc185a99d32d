"""Lyapunov exponents, bifurcation diagrams and basins, against closed forms."""

from __future__ import annotations

import math

import numpy as np
import pytest

import zivi

SINE = -math.pi / 2


def table(amplitude: float, e: float = 0.5) -> zivi.ImpactSystem:
    """A ball on a table, in the frame of the table."""
    return zivi.ImpactSystem(zivi.LinearForce(gravity=1.0, amplitude=amplitude, phase=SINE), e=e)


def callable_table(t: float, x: float, xdot: float) -> float:
    """The force of a table of 1.3 g, in the interpreter."""
    return -1.0 + 1.3 * math.sin(t)


def test_exponents_of_an_orbit_are_those_of_its_multipliers():
    # det e^2 in one period: ln(e)/(2 pi) each while they are complex
    found = zivi.lyapunov_exponents(table(1.3), (0, 3000), (0.1, 2.0), transient=300)
    np.testing.assert_allclose(found.exponents, math.log(0.5) / (2 * math.pi), atol=1e-4)
    assert found.success


def test_the_sum_of_the_exponents_of_a_chaotic_motion():
    e = 0.8
    found = zivi.lyapunov_exponents(table(2.0, e), (0, 4000), (0.5, 1.0), transient=300)
    assert 0.09 < found.exponents[0] < 0.13
    rows = found.trajectory.resolved_impacts
    u = rows["xdot_after"][rows["t"] >= 300]
    total = (2 * found.n_impacts * math.log(e) + math.log(u[0] / u[-1])) / found.duration
    assert abs(np.sum(found.exponents) - total) < 1e-9


def test_exponents_in_flight_are_the_damping():
    force = zivi.LinearForce(stiffness=4.0, damping=0.2, gravity=-8.0, amplitude=0.1)
    found = zivi.lyapunov_exponents(zivi.ImpactSystem(force, e=0.5), (0, 200), (2.0, 0.0))
    np.testing.assert_allclose(found.exponents, -0.1, atol=1e-3)
    assert found.n_impacts == 0


def test_a_run_that_rests_has_no_finite_exponent():
    found = zivi.lyapunov_exponents(table(1.3), (0, 300), (0.0, 0.0), transient=100)
    assert found.status is zivi.OrbitStatus.RESTS
    assert np.all(found.exponents == -np.inf)
    assert not found.success


def test_a_diagram_has_the_orbits_of_the_closed_form_and_those_that_rest():
    values = np.linspace(1.08, 1.48, 4)
    found = zivi.bifurcation_diagram(
        table(1.3), "amplitude", values, starts=[(0.0, 0.0), (0.3, 1.9)], transient=100, keep=8
    )
    assert found.resting[found.run_start == 0].all()
    moving = ~found.resting[found.run]
    phase = np.arccos(math.pi / 3 / found.value[moving]) / (2 * math.pi)
    np.testing.assert_allclose(found.first[moving], phase, atol=1e-7)
    np.testing.assert_allclose(found.second[moving], 2 * math.pi / 3, atol=1e-7)
    assert np.sum(moving) >= 8 * np.sum(~found.resting)
    data = found.to_xarray()
    assert data.sizes["run"] == 8


@pytest.mark.parametrize("how", ["follow", "strobe", "callable"])
def test_other_ways_to_a_diagram(how):
    starts = "follow" if how == "follow" else (0.3, 1.9)
    section = "strobe" if how == "strobe" else "impacts"
    system, name, values = table(1.3), "amplitude", np.array([1.25, 1.3])
    if how == "callable":
        force = zivi.ParametricForce(lambda t, x, v, a: -1 + a * math.sin(t), {"a": 1.3})
        system, name, values = zivi.ImpactSystem(force, e=0.5), "a", np.array([1.3])
    found = zivi.bifurcation_diagram(
        system, name, values, section, starts, transient=60, keep=6, period=2 * math.pi
    )
    kinds = {(it.kind, it.multiple) for it in found.attractors}
    assert kinds <= {("impacting", 1), ("resting", 1)}
    if how == "strobe":
        # x and xdot at t = 0: a flight after the impact of the last period
        for value, x in zip(found.value, found.first, strict=True):
            t, u = math.acos(math.pi / 3 / value), 2 * math.pi / 3
            tau = 2 * math.pi - t
            exact = u * tau - tau**2 / 2 - value * (0 - math.sin(t) - math.cos(t) * tau)
            assert abs(x - exact) < 1e-4


def test_a_diagram_as_a_study_goes_on(tmp_path):
    pytest.importorskip("zarr")
    system, values = table(1.3), np.array([1.2, 1.3])
    arguments = {"starts": [(0.0, 0.0), (0.3, 1.9)], "transient": 100, "keep": 8}
    plain = zivi.bifurcation_diagram(system, "amplitude", values, **arguments)
    for _ in range(2):
        study = zivi.bifurcation_diagram(
            system, "amplitude", values, **arguments, out=tmp_path / "diagram"
        )
        np.testing.assert_array_equal(study.second, plain.second)
        np.testing.assert_array_equal(study.run, plain.run)
        kinds = [(it.kind, it.multiple) for it in study.attractors]
        assert kinds == [(it.kind, it.multiple) for it in plain.attractors]


def test_basins_of_a_bistable_table():
    across, along = np.linspace(0, 2, 5), np.linspace(-1.5, 2.1, 5)
    known = zivi.periodic_orbit(table(1.3), [(0.6, 2.1)])
    rests = zivi.periodic_orbit(table(1.3), (0.0, (0.0, 0.0)))
    found = zivi.basins(table(1.3), across, along, [known, rests], transient=120, keep=12)
    assert [it.kind for it in found.attractors] == ["impacting", "resting"]
    assert set(np.unique(found.label)) == {0, 1}
    assert math.isclose(found.shares.sum(), 1.0)
    # each cell by a run of its own, one by one
    for i, j in ((0, 0), (2, 3), (4, 4), (1, 2)):
        run = zivi.simulate(table(1.3), (0, 900), (across[j], along[i]))
        assert (found.label[i, j] == 1) == bool(np.any(run.zeno_times > 800))
    assert found.border.shape == found.label.shape
    assert found.to_xarray().label.dims == ("xdot0", "x0")


@pytest.mark.parametrize("flights", ["rk", "series", "callable"])
def test_cells_that_a_grazing_decides_are_marked(flights):
    # x'' = 1 - x from (x0, 0) touches the wall for x0 = 2: below it swings, above it hits
    near = 2 + np.array([-0.1, -1e-5, -1e-10, 0.0, 1e-10, 1e-5, 0.1])
    method = zivi.SwitchedRK(
        rtol=1e-8, atol=1e-10, flights="rk" if flights == "callable" else flights
    )
    force = zivi.LinearForce(stiffness=1.0, gravity=-1.0)
    system = zivi.ImpactSystem(spring if flights == "callable" else force, e=0.8)
    found = zivi.basins(system, near, [0.0], period=2 * math.pi, transient=1, keep=2, method=method)
    assert found.grazing.tolist() == [[False, False, True, True, True, False, False]]
    assert found.border[found.grazing].all()
    assert found.to_xarray().grazing.dims == ("xdot0", "x0")
    if flights != "callable":
        starts = np.column_stack([near, 0 * near])
        batch = zivi.simulate_batch(system, (0, 7), starts, method=method, save="grazing")
        assert batch.grazing.tolist() == found.grazing[0].tolist()
        plain = zivi.simulate_batch(system, (0, 7), starts, method=method)
        assert (batch.x.tobytes(), plain.grazing) == (plain.x.tobytes(), None)


def spring(t: float, x: float, xdot: float) -> float:
    """The same force, in the interpreter."""
    return 1.0 - x


def test_a_chain_of_impacts_is_no_grazing():
    found = zivi.basins(table(1.3), np.linspace(0, 2, 12), [0.3], transient=20, keep=4)
    assert "resting" in {it.kind for it in found.attractors}
    assert not found.grazing.any()


def test_cells_that_merge_settle_on_what_each_would_alone():
    across, along = np.linspace(0, 2, 9), np.linspace(-1.5, 2.1, 9)
    found = zivi.basins(table(1.3), across, along, transient=100, keep=8)
    for i, v in enumerate(along):
        for j, x in enumerate(across):
            alone = zivi.basins(table(1.3), [x], [v], transient=0, keep=100, tolerance=1e-4)
            assert alone.attractors[0].kind == found.attractors[found.label[i, j]].kind


def test_bad_input():
    with pytest.raises(ValueError, match="transient"):
        zivi.lyapunov_exponents(table(1.3), (0, 10), (1, 0), transient=11)
    with pytest.raises(ValueError, match="transient"):
        zivi.lyapunov_exponents(table(1.3), (5, 8), (1, 0), transient=4)
    with pytest.raises(ValueError, match="section"):
        zivi.bifurcation_diagram(table(1.3), "amplitude", [1.3], "sometimes")
    with pytest.raises(ValueError, match="follow"):
        zivi.bifurcation_diagram(table(1.3), "amplitude", [1.3], starts="random")
    with pytest.raises(ValueError, match="x0s"):
        zivi.basins(table(1.3), [-1.0], [0.0])


def test_pictures():
    plt = pytest.importorskip("matplotlib.pyplot")
    plt.switch_backend("Agg")
    orbit = zivi.periodic_orbit(table(1.3), [(0.6, 2.1)])
    branch = zivi.continue_orbit(orbit, "amplitude", (1.0, 1.7))
    ax = zivi.plot.branch(branch)
    marks = [line for line in ax.lines if line.get_marker() in ("s", "D")]
    np.testing.assert_allclose(
        sorted(float(line.get_xdata()[0]) for line in marks),
        sorted(event.value for event in branch.events),
    )
    assert zivi.plot.multipliers(branch).get_aspect() == 1.0
    found = zivi.bifurcation_diagram(
        table(1.3), "amplitude", [1.2, 1.3], starts=[(0, 0), (0.3, 1.9)], transient=50, keep=4
    )
    lines = zivi.plot.diagram(found, branches=[branch]).lines
    assert sum(len(line.get_xdata()) for line in lines[:2]) == len(found.value)
    cells = zivi.basins(table(1.3), [0.0, 1.0], [-1.0, 2.0], transient=50, keep=6)
    assert zivi.plot.basins(cells).get_legend() is not None
    with pytest.raises(ValueError, match="y must be"):
        zivi.plot.branch(branch, "speed")
    plt.close("all")


@pytest.mark.parametrize(("e", "amplitude"), [(0.5, 1.3), (0.95, 0.1)])
def test_a_run_that_repeats_itself_is_not_run_on_and_is_what_it_would_be(e, amplitude):
    # differences shrink by e in a period: to rounding in 100 for .5, to 2e-7 in 164 for .95
    system = table(amplitude, e)
    u = 2 * math.pi * e / (1 + e)
    phase = math.acos(math.pi * (1 - e) / (1 + e) / amplitude)
    t = 2 * math.pi - phase  # from the impact to the end of the period
    x = u * t - t * t / 2 + amplitude * (t * math.cos(phase) + math.sin(phase))
    xdot = u - t + amplitude * (math.cos(phase) - 1)
    found = zivi.bifurcation_diagram(system, "amplitude", [amplitude], starts=(x, xdot + 1e-3))
    (attractor,) = found.attractors
    assert (attractor.kind, attractor.multiple) == ("impacting", 1)
    np.testing.assert_allclose(attractor.impacts, [[phase / (2 * math.pi), u]], atol=1e-10)


def test_values_with_periods_of_their_own_are_what_they_are_alone():
    system = zivi.ImpactSystem(
        zivi.LinearForce(stiffness=1, damping=0.05, gravity=0.2, amplitude=0.6, omega=0.9), e=0.7
    )
    values = np.linspace(0.85, 1.15, 7)
    both = [
        zivi.bifurcation_diagram(system, "omega", values, starts=(1, 0), section=section)
        for section in ("impacts", "strobe")
    ]
    for k, value in enumerate(values):
        for found in both:
            alone = zivi.bifurcation_diagram(
                system, "omega", [value], starts=(1, 0), section=found.section
            )
            own = found.run == k
            np.testing.assert_array_equal(found.first[own], alone.first)
            np.testing.assert_array_equal(found.second[own], alone.second)
