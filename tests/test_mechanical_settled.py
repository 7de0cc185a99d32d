"""What mechanical systems settle on: diagrams, basins, Lyapunov exponents."""

import math

import numpy as np
import pytest

import zivi

K = np.array([[2.0, -1.0], [-1.0, 1.0]])
STOP = zivi.LinearGap([-1, 0], 0.3, name="stop")
TURN = 2 * math.pi


def chain(omega, damping=0.2, e=0.6):
    """Two masses; the first hits a stop."""
    load = zivi.Harmonic([0, 1.0], omega)
    return zivi.LinearSystem(np.eye(2), damping * K, K, excitation=load, gaps=[STOP], e=e)


def pair(amplitude=0.5, omega=2.8, damping=0.02, e=0.9):
    """One mass at a spring above a wall, as a mass and as a mechanism."""
    force = zivi.LinearForce(stiffness=1, damping=damping, amplitude=amplitude, omega=omega)
    wall = zivi.LinearGap([1.0], name="wall")
    load = zivi.Harmonic([amplitude], omega)
    linear = zivi.LinearSystem(
        [[1.0]], [[damping]], [[1.0]], excitation=load, gaps=[wall], e=e, coordinates=["x"]
    )
    return zivi.ImpactSystem(force, e=e), linear


@pytest.mark.parametrize("section", ["impacts", "strobe"])
def test_a_diagram_of_one_coordinate_is_that_of_the_mass(section):
    mass, linear = pair(0.8, 1.3, 0.1, 0.7)
    omegas = np.linspace(0.9, 2.2, 14)
    settings = {"section": section, "transient": 120, "keep": 12}
    one = zivi.bifurcation_diagram(mass, "omega", omegas, starts=(1, 0), **settings)
    other = zivi.bifurcation_diagram(linear, "omega", omegas, starts=([1], [0]), **settings)
    assert [(it.kind, it.multiple) for it in one.attractors] == [
        (it.kind, it.multiple) for it in other.attractors
    ]
    assert {it.multiple for it in other.attractors} == {1, 2}
    for mine, its in zip(one.attractors, other.attractors, strict=True):
        np.testing.assert_allclose(its.impacts, mine.impacts, atol=1e-6)
        assert not its.gaps.any()
    if section == "strobe":
        for name in ("first", "second"):
            mine, its = (np.sort(getattr(it, name).reshape(14, 12)) for it in (one, other))
            np.testing.assert_allclose(its, mine, atol=1e-6)
        assert set(other.gap) == {-1}
    assert other.to_xarray().gap.dims == ("point",)


def test_what_a_chain_settles_on_are_its_periodic_orbits():
    omegas = [0.5, 0.9, 1.2, 1.5]
    found = zivi.bifurcation_diagram(chain(1.0), "omega", omegas, transient=150, keep=16)
    assert [it.kind for it in found.attractors] == ["resting", *3 * ["impacting"]]
    for omega, mine in zip(omegas[1:], found.attractors[1:], strict=True):
        run = zivi.simulate(chain(omega), (0, 150 * TURN / omega), ([0, 0], [0, 0]))
        orbit = zivi.periodic_orbit(chain(omega), run)
        assert (mine.multiple, len(mine.impacts)) == (orbit.multiple, len(orbit.impacts))
        rows = np.column_stack([orbit.impacts["t"] * omega / TURN % 1.0, orbit.impacts["u"]])
        np.testing.assert_allclose(mine.impacts, rows[np.argsort(rows[:, 0])], atol=1e-5)


def test_a_diagram_follows_goes_on_as_a_study_and_chooses_a_gap(tmp_path):
    upper = zivi.LinearGap([0, -1], 0.9, name="upper")
    load = zivi.Harmonic([0, 1.0], 1.1)
    both = zivi.LinearSystem(np.eye(2), 0.2 * K, K, excitation=load, gaps=[STOP, upper], e=0.6)
    settings = {"transient": 60, "keep": 8}
    found = zivi.bifurcation_diagram(both, "omega", [1.0, 1.1], **settings)
    assert set(found.gap) == {0, 1}
    one = zivi.bifurcation_diagram(both, "omega", [1.0, 1.1], gap="upper", **settings)
    assert set(one.gap) == {1}
    np.testing.assert_array_equal(one.second, found.second[found.gap == 1])
    study = zivi.bifurcation_diagram(both, "omega", [1.0, 1.1], out=tmp_path / "d", **settings)
    np.testing.assert_array_equal(study.second, found.second)
    np.testing.assert_array_equal(study.gap, found.gap)
    for mine, its in zip(study.attractors, found.attractors, strict=True):
        assert (mine.kind, mine.multiple) == (its.kind, its.multiple)
        np.testing.assert_array_equal(mine.impacts, its.impacts)
        np.testing.assert_array_equal(mine.gaps, its.gaps)
    follow = zivi.bifurcation_diagram(both, "omega", [1.0, 1.1], starts="follow", **settings)
    np.testing.assert_array_equal(follow.second[follow.run == 0], found.second[found.run == 0])
    axes = zivi.plot.diagram(found)
    assert axes.get_ylabel() == "speed after the impact"


def test_a_belt_with_dry_friction_has_a_diagram():
    """A mass at a shaken spring on a belt that sticks: it settles on the period of the shaking."""

    def build(F):
        rub = zivi.DryFriction(limit=0.4, static=0.5, velocity=0.3)
        return zivi.MechanicalSystem(
            mass=1.0,
            force=lambda t, q, qdot: [F * math.cos(0.5 * t) - q[0] - 0.1 * qdot[0]],
            friction=[rub],
        )

    system = zivi.ParametricSystem(build, {"F": 0.3})
    found = zivi.bifurcation_diagram(
        system,
        "F",
        [0.3],
        "strobe",
        starts=([0], [0.0]),
        period=2 * TURN,
        transient=30,
        keep=6,
    )
    assert (found.attractors[0].kind, found.attractors[0].multiple) == ("flight", 1)


def test_basins_of_one_coordinate_are_those_of_the_mass():
    # orbits of one period and of six
    mass, linear = pair(0.5, 2.6, 0.05, 0.9)
    x, v = np.linspace(0, 3, 9), np.linspace(-3, 3, 9)
    settings = {"transient": 500, "keep": 16}
    one = zivi.basins(mass, x, v, **settings)
    other = zivi.basins(linear, x, v, axes=("q0.x", "qdot0[0]"), **settings)
    kinds = [[(it.kind, it.multiple) for it in b.attractors] for b in (one, other)]
    assert kinds[0] == kinds[1]
    # a tolerance decides a cell or two of a border that is everywhere
    differ = one.label != other.label
    assert np.count_nonzero(differ) <= 3
    assert (one.border | other.border)[differ].all()
    assert not other.grazing.any()
    # a cell below the wall has no attractor
    cut = zivi.basins(linear, [-1.0, 1.0], [0.0], transient=20, keep=4)
    assert cut.label.tolist() == [[-1, 0]]
    assert cut.shares.sum() == 1.0
    assert (cut.axes, cut.to_xarray().attrs["axes"]) == (("q0.x", "qdot0.x"), list(cut.axes))
    assert zivi.plot.basins(cut).get_xlabel() == "initial q0.x"


def test_basins_know_given_orbits_and_the_rest_of_the_state():
    system = chain(1.2)
    run = zivi.simulate(system, (0, 150 * TURN / 1.2), ([0, 0], [0, 0]))
    orbit = zivi.periodic_orbit(system, run)
    settings = {"axes": ("q0[1]", "qdot0[1]"), "transient": 120, "keep": 12}
    found = zivi.basins(system, [-0.3, 0.4], [0.1], [orbit], **settings)
    assert len(found.attractors) == 1
    assert found.label.tolist() == [[0, 0]]
    resting = chain(0.5)
    run = zivi.simulate(resting, (0, 100 * 2 * TURN), ([0, 0], [0, 0]))
    rests = zivi.periodic_orbit(resting, run)
    found = zivi.basins(resting, [-0.3, 0.2], [0.0], [rests], y0=([0, 0], [0.1, 0]), **settings)
    assert [it.kind for it in found.attractors] == ["resting"]
    with pytest.raises(TypeError, match=r"attractors must be zivi\.MechanicalOrbit"):
        zivi.basins(system, [0.0], [0.0], [1.0])


@pytest.mark.parametrize("omega", [0.9, 1.2])
def test_exponents_of_a_periodic_motion_are_those_of_its_multipliers(omega):
    run = zivi.simulate(chain(omega), (0, 100 * TURN / omega), ([0, 0], [0, 0]))
    orbit = zivi.periodic_orbit(chain(omega), run)
    length = TURN / omega
    found = zivi.lyapunov_exponents(
        chain(omega), (0, 300 * length), ([0, 0], [0, 0]), 100 * length, progress=False
    )
    exact = np.sort(np.log(np.abs(orbit.multipliers)))[::-1] / (orbit.multiple * orbit.period)
    np.testing.assert_allclose(found.exponents, exact, atol=3e-4)
    assert found.exponents.sum() == pytest.approx(exact.sum(), abs=1e-9)
    assert found.n_impacts == 200 * len(orbit.impacts)
    assert (found.status, found.trajectory) == (zivi.OrbitStatus.COMPLETED, None)


def test_a_contact_takes_exponents_away():
    system = chain(0.5)
    run = zivi.simulate(system, (0, 100 * 2 * TURN), ([0, 0], [0, 0]))
    orbit = zivi.periodic_orbit(system, run)
    found = zivi.lyapunov_exponents(system, (0, 200 * TURN), ([0, 0], [0, 0]), 80 * TURN)
    live = np.sort(np.log(np.abs(orbit.multipliers[:2])))[::-1] / orbit.period
    np.testing.assert_allclose(found.exponents[:2], live, atol=1e-6)
    assert found.exponents[2:].tolist() == [-math.inf, -math.inf]


def test_exponents_without_impacts_are_real_parts_of_eigenvalues():
    free = zivi.LinearSystem(np.eye(2), 0.05 * K, K)
    matrix = np.block([[np.zeros((2, 2)), np.eye(2)], [-K, -0.05 * K]])
    exact = np.sort(np.linalg.eigvals(matrix).real)[::-1]
    found = zivi.lyapunov_exponents(free, (0, 900), ([1, 0], [0, 0]))
    np.testing.assert_allclose(found.exponents, exact, atol=1e-3)
    assert found.exponents.sum() == pytest.approx(exact.sum(), abs=1e-9)


def test_a_chaotic_motion_has_the_exponents_of_the_mass():
    """Their sum is exact: an impact shrinks areas by e^2, the damper c does by exp(-c t)."""
    mass, linear = pair(0.5, 3.2, 0.1, 0.9)
    length = TURN / 3.2
    one = zivi.lyapunov_exponents(mass, (0, 1500 * length), (1.0, 0.3), 200 * length)
    other = zivi.lyapunov_exponents(linear, (0, 1500 * length), ([1.0], [0.3]), 200 * length)
    assert other.exponents[0] == pytest.approx(one.exponents[0], abs=0.03)
    assert 0.1 < other.exponents[0] < 0.2
    exact = 2 * math.log(0.9) * other.n_impacts / other.duration - 0.1
    assert other.exponents.sum() == pytest.approx(exact, abs=1e-8)


def test_bad_input():
    mass, linear = pair()
    diagram, basins = zivi.bifurcation_diagram, zivi.basins
    with pytest.raises(ValueError, match=r"unknown parameter 'zeta'; the parameters are omega"):
        diagram(linear, "zeta", [1.0])
    with pytest.raises(ValueError, match=r"gap must be one of 'wall', got 'floor'"):
        diagram(linear, "omega", [1.0], gap="floor")
    with pytest.raises(ValueError, match=r"coordinate must be one of 'x', got 'y'"):
        diagram(linear, "omega", [1.0], coordinate="y")
    with pytest.raises(ValueError, match=r"starts must be \(q0, qdot0\), or several"):
        diagram(linear, "omega", [1.0], starts=[1.0, 0.0])
    with pytest.raises(ValueError, match=r"gap and coordinate are for a zivi.MechanicalSystem"):
        diagram(mass, "omega", [1.0], gap="wall")
    with pytest.raises(ValueError, match=r"axes must be two of 'q0.x', 'qdot0.x', got 'x'"):
        basins(linear, [1.0], [0.0], axes=("x", "q0.x"))
    with pytest.raises(ValueError, match=r"axes must be two different initial values"):
        basins(linear, [1.0], [0.0], axes=("q0.x", "q0.x"))
    with pytest.raises(ValueError, match=r"axes and y0 are for a zivi.MechanicalSystem"):
        basins(mass, [1.0], [0.0], axes=("q0.x", "qdot0.x"))
    with pytest.raises(ValueError, match=r"piece is for a zivi.MechanicalSystem"):
        zivi.lyapunov_exponents(mass, (0, 9), (1, 0), piece=1.0)
    with pytest.raises(ValueError, match=r"piece must be > 0 and within t_span, got 10"):
        zivi.lyapunov_exponents(linear, (0, 9), ([1], [0]), piece=10)
    unexcited = zivi.LinearSystem([[1.0]], None, [[1.0]], gaps=[zivi.LinearGap([1.0])], e=0.5)
    with pytest.raises(
        ValueError, match=r"period must be given .s.: the system does not have a single"
    ):
        basins(unexcited, [1.0], [0.0])
