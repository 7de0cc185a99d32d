"""The studies of the gallery against computations that share no code with zivi."""

import math
import re

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

import control_oracle
import zivi
from example_scripts import example, shown

pytestmark = [pytest.mark.slow, pytest.mark.xdist_group("gallery")]

pytest.importorskip("xarray", reason="the gallery's studies need the extra 'study'")
pytest.importorskip("matplotlib", reason="the gallery draws")


table = example("gallery_table_bifurcation")
oscillator = example("gallery_oscillator_bifurcation")
basins = example("gallery_basins")
gains = example("gallery_gain_map")
orbits = example("gallery_orbits")


@pytest.mark.parametrize(
    "module", [table, oscillator, basins, gains, orbits], ids=lambda it: it.__name__
)
def test_every_study_draws_its_figure(module, tmp_path, capsys):
    path = tmp_path / "out.png"
    module.main(str(path))
    assert path.stat().st_size > 50_000
    assert capsys.readouterr().out


# --- the ball on a vibrating table, from impact to impact


def next_impacts(t, u, excitation, e):
    """Times and relative speeds after the next impacts, for arrays of those after the last.

    Gravity is 1 m/s^2 and the table ``excitation sin t``, so a period is 2 pi. The flight is a
    parabola; it is scanned from the time before which it cannot have ended, and then bisected.
    """

    def gap(tau):
        table = excitation * (np.sin(t + tau) - np.sin(t))
        return (u + excitation * np.cos(t)) * tau - tau**2 / 2 - table

    least = 2 * u / (1 + excitation)
    up = u + excitation * np.cos(t)
    most = up + np.sqrt(up**2 + 4 * excitation) + 1e-6
    before, after = least * (1 - 1e-9), most.copy()
    open_ = np.ones(len(t), bool)
    last = before.copy()
    for share in np.linspace(0, 1, 120)[1:]:
        tau = least ** (1 - share) * most**share
        crossed = open_ & (gap(tau) < 0)
        before[crossed], after[crossed] = last[crossed], tau[crossed]
        open_ &= ~crossed
        last = tau
    for _ in range(60):
        middle = 0.5 * (before + after)
        below = gap(middle) < 0
        before, after = np.where(below, before, middle), np.where(below, middle, after)
    relative = up - after - excitation * np.cos(t + after)
    return t + after, -e * relative


@pytest.mark.parametrize(("e", "printed"), [(0.5, 1.526824), (0.8, 1.070836)])
def test_the_diagram_tells_where_the_period_doubles(e, printed):
    expected = math.hypot(math.pi * (1 - e) / (1 + e), 2 * (1 + e**2) / (1 + e) ** 2)
    assert expected == pytest.approx(printed, abs=5e-7)
    assert table.doubling(e) == pytest.approx(expected, abs=1e-6)


@pytest.mark.parametrize(
    ("e", "excitation", "period"),
    [(0.5, 1.45, 1), (0.5, 1.6, 2), (0.5, 1.68, 4), (0.8, 1.0, 1), (0.8, 1.15, 2), (0.8, 1.235, 4)],
)
def test_the_phases_of_the_diagram(e, excitation, period):
    excitations, phases = table.diagram(e)
    place = np.argmin(np.abs(excitations - excitation))
    excitation, drawn = excitations[place], table.wrapped(phases[place])
    phase, _ = table.orbit(excitation, e)
    t, u = np.array([phase]), np.array([2.002 * math.pi * e / (1 + e)])
    found = []
    for _ in range(300):
        t, u = next_impacts(t, u, excitation, e)
        found.append(table.wrapped(t[0]))
    assert np.sort(drawn[-period:]) == pytest.approx(np.sort(found[-period:]), abs=2e-6)
    assert np.ptp(drawn[-1 - period :: period]) < 1e-6
    assert period == 1 or np.ptp(drawn[-period:]) > 0.1


# --- the oscillator


def flight(omega, t, speed):
    """One flight from the wall by SciPy: time and speed after the impact that ends it."""

    def field(time, y):
        return [y[1], -y[0] - 2 * oscillator.ZETA * y[1] + math.cos(omega * time)]

    def wall(time, y):
        return y[0]

    wall.terminal, wall.direction = True, -1
    settings = {"method": "DOP853", "rtol": 1e-12, "atol": 1e-13, "max_step": 0.05}
    end = solve_ivp(field, (t, t + 20), [1e-300, speed], events=wall, **settings)
    return end.t[-1], -oscillator.E * end.y[1, -1]


@pytest.mark.parametrize(("omega", "k"), [(1.5, 1), (2.0, 1), (2.6, 1), (3.6, 2), (4.5, 2)])
def test_the_branches_of_the_oscillator(omega, k):
    t, speed = oscillator.orbit(omega, k)
    ends, after = flight(omega, t, speed)
    assert ends == pytest.approx(t + 2 * math.pi * k / omega, abs=1e-9)
    assert after == pytest.approx(speed, abs=1e-9)
    omegas, speeds = oscillator.branch(k)
    place = int(np.argmin(np.abs(omegas - omega)))
    assert omegas[place] == pytest.approx(omega, abs=1e-9)
    assert speeds[place] == pytest.approx(speed, abs=1e-6)


def test_the_resonance_of_the_oscillator():
    # of the mirror image, a wall above the mass: half a period earlier
    t, speed = oscillator.orbit(2.0)
    assert (t - math.pi / 2, speed / oscillator.E) == pytest.approx(
        (0.7624356, 3.9016493), abs=5e-8
    )


@pytest.mark.parametrize(("omega", "k"), [(2.2, 1), (2.7, 1), (4.3, 2)])
def test_the_multipliers_of_the_oscillator(omega, k):
    state, step = np.array(oscillator.orbit(omega, k)), 1e-6
    columns = [
        np.subtract(flight(omega, *(state + shift)), flight(omega, *(state - shift)))
        for shift in step * np.eye(2)
    ]
    found = np.linalg.eigvals(np.column_stack(columns) / (2 * step))
    expected = oscillator.multipliers(omega, k)
    assert found.sum() == pytest.approx(expected.sum(), abs=1e-5)
    assert found.prod() == pytest.approx(expected.prod(), abs=1e-5)


@pytest.mark.parametrize("k", [1, 2])
def test_the_branches_end_where_the_orbit_is_unstable(k):
    omegas, speeds = oscillator.branch(k)
    low, high = oscillator.window(k)
    assert low < omegas[0] < low + 0.0125
    assert high - 0.0125 < omegas[-1] < high
    everything = [omega for omega in oscillator.FREQUENCIES if low + 0.0125 < omega < high - 0.0125]
    assert set(everything) <= set(omegas)
    assert speeds == pytest.approx([oscillator.orbit(omega, k)[1] for omega in omegas], abs=1e-6)


# --- the basins


def attractors_by_parabolas(states):
    """Number of the attractor of each state, from impact to impact."""
    g, omega, excitation, e = basins.GRAVITY, basins.OMEGA, basins.EXCITATION, basins.E
    # in units of the table: time 1/omega, length g/omega^2
    x, v = states[:, 0] * omega**2 / g, states[:, 1] * omega / g
    t, u = np.zeros(len(x)), np.zeros(len(x))
    for i in range(len(x)):

        def gap(tau, i=i):
            return x[i] + (v[i] + excitation) * tau - tau**2 / 2 - excitation * np.sin(tau)

        grid = np.linspace(0, 60, 3001)
        first = int(np.argmax(gap(grid) < 0))
        t[i] = brentq(gap, grid[first - 1], grid[first])
        u[i] = -e * (v[i] + excitation - t[i] - excitation * math.cos(t[i]))
    found = np.full(len(x), -1)
    going = np.arange(len(x))
    for _ in range(90):
        after, speed = next_impacts(t[going], u[going], excitation, e)
        turns = (after - t[going]) / (2 * math.pi)
        t[going], u[going] = after, speed
        found[going] = np.round(turns)
        rests = speed < 1e-4
        found[going[rests]] = 0
        going = going[~rests]
    return found


def test_the_basins_against_parabolas():
    every, cells = 6, basins.CELLS
    states = basins.grid().reshape(cells, cells, 2)[2::every, 2::every].reshape(-1, 2)
    zivis = basins.basins()[2::every, 2::every].ravel()
    own = attractors_by_parabolas(states)
    # where the basins are finer than the tolerance of the method, a cell may differ
    assert np.mean(own == zivis) > 0.99
    for number, share in enumerate(basins.shares(basins.basins())):
        assert np.mean(own == number) == pytest.approx(share, abs=0.02)


def test_nothing_is_undecided():
    assert not np.any(basins.basins() == basins.UNDECIDED)


def test_the_orbits_are_in_their_basins():
    around = 0.05 * np.array([[0, 0], [1, 0], [-1, 0], [0, 1], [0, -1]])
    for n in (1, 2):
        for state in basins.orbit(n):
            assert np.all(basins.attractors(state + around) == n)
    assert basins.attractors(np.array([[0.0, 0.0], [0.01, 0.0]])).tolist() == [0, 0]


@pytest.mark.parametrize("n", [1, 2])
def test_the_states_of_the_orbits(n):
    """They return after n periods, by parabolas."""
    g, omega, excitation, e = basins.GRAVITY, basins.OMEGA, basins.EXCITATION, basins.E
    phase = math.acos(n * math.pi * (1 - e) / ((1 + e) * excitation))
    u = 2 * math.pi * n * e / (1 + e)
    after, speed = next_impacts(np.array([phase]), np.array([u]), excitation, e)
    assert after[0] == pytest.approx(phase + 2 * math.pi * n, abs=1e-9)
    assert speed[0] == pytest.approx(u, abs=1e-9)
    for period, (x, xdot) in enumerate(basins.orbit(n), start=1):
        tau = 2 * math.pi * period - phase
        up = u + excitation * math.cos(phase)
        height = up * tau - tau**2 / 2 + excitation * math.sin(phase)
        assert x * omega**2 / g == pytest.approx(height, abs=1e-12)
        assert xdot * omega / g == pytest.approx(up - tau - excitation, abs=1e-12)


# --- the gains


def settling_by_the_oracle(mu1, mu2, missing, end):
    """Last time away from the reference, by controller and plant written out in NumPy."""
    h, kappa = gains.H, gains.KAPPA
    ball, reference = control_oracle.Flights(6.0, 5.0, (1 - kappa) / (1 + kappa)), (3.0, 2.0 * 3.0)
    last = 0.0
    for k in range(round(end / h)):
        if abs(ball.x - control_oracle.projected(*reference, kappa)[0]) > 0.01:
            last = k * h
        (following,) = set(control_oracle.reference_solution(reference, -19.81, h, kappa))
        tick = control_oracle.Tracking(
            h,
            kappa,
            kappa,
            mu1,
            mu2,
            control_oracle.lifted(ball.x, ball.v, kappa),
            reference,
            -9.81 - missing,
            -19.81,
        )
        push = (following[1] - reference[1]) / h
        # in flight, where v_r+ = 0: R_r = F_r/A
        lvr = np.sign(following[1]) or (1 + 19.81 / push) / kappa
        *_, u = tick.selected((*following, push), lvr)
        ball.hold(u - 9.81, (k + 1) * h)
        reference = control_oracle.lifted(*control_oracle.projected(*following, kappa), kappa)
    return last


@pytest.mark.parametrize(
    ("mu1", "mu2", "missing", "end"),
    [(30, 17, 0.0, 1.25), (60, 34, 0.0, 1.05), (45, 30, 0.0, 1.2), (40, 20, 9.81, 1.25)],
)
def test_the_settling_times_of_the_map(mu1, mu2, missing, end):
    drawn = float(gains.gain_map().sel(mu1=mu1, mu2=mu2, missing=missing))
    expected = settling_by_the_oracle(mu1, mu2, missing, end)
    assert drawn == pytest.approx(min(drawn, end), abs=1e-9), "the oracle ends before"
    assert drawn == pytest.approx(expected, abs=1e-9)


def test_the_gains_of_the_paper():
    assert float(gains.gain_map().sel(**gains.PAPER, missing=0)) == pytest.approx(1.21, abs=1e-9)


@pytest.mark.parametrize("missing", gains.MISSING)
def test_all_gains_inside_the_condition_settle(missing):
    times = gains.gain_map().sel(missing=missing)
    mu1, mu2 = np.meshgrid(*gains.GAINS.values(), indexing="ij")
    inside = (missing < mu2) & (mu2 < mu1 - missing)
    assert inside.sum() > 800
    assert np.all(np.isfinite(times.values[inside]))
    assert np.all(np.isnan(times.values[mu2 >= mu1]))


def test_some_gains_outside_the_condition_do_not():
    times = gains.gain_map().sel(missing=gains.MISSING[1])
    assert np.isinf(times.sel(mu1=40, mu2=38))
    assert np.isinf(times.sel(mu1=15, mu2=4))


# --- the page


def test_the_numbers_of_the_page(capsys):
    modules = (table, oscillator, basins, gains)
    page = "".join(shown(module.__name__) for module in modules)
    doubling = tuple(f"{table.doubling(e):.6f}" for e in (0.5, 0.8))
    pattern = r"own data: (\S+) for `e = 0.5` and (\S+) for `e = 0.8`"
    assert re.findall(pattern, page) == [doubling]
    ends = tuple(f"{omega:.3f}" for k in (1, 2) for omega in oscillator.window(k))
    pattern = r"from (\d\.\d+) to (\d\.\d+), in two from (\d\.\d+) to (\d\.\d+)"
    assert re.findall(pattern, page) == [ends]
    pattern = r"rest (\S+) %, one impact a period (\S+) %, one in two periods (\S+) %"
    ((*written,),) = re.findall(pattern, page)
    shares = [100 * share for share in basins.shares(basins.basins())]
    assert [float(share) for share in written] == pytest.approx(shares, abs=0.1)
    gains.main()
    pattern = r"missing 9\.81.*condition (\d+) of .*outside (\d+) of (\d+)"
    ((inside, settled, outside),) = re.findall(pattern, capsys.readouterr().out)
    pattern = r"all (\d+) pairs inside settle, outside (\d+) of (\d+)"
    ((*written,),) = re.findall(pattern, page)
    assert (written[0], written[2]) == (inside, outside)
    assert int(written[1]) == pytest.approx(int(settled), abs=5)


def test_the_orbits_of_the_gallery_are_those_of_the_closed_forms():
    ratio = math.pi / 3
    first = orbits.cascade()[0]
    assert first.of_kind("fold")[0].value == pytest.approx(ratio, rel=1e-11)
    assert orbits.cascade()[-1].orbits[0].multiple == orbits.LONGEST
    end = orbits.resting().of_kind("end_of_rest")[0].value
    assert end == pytest.approx(1.5973488311951537, rel=1e-9)  # in high precision
    d, a, b = orbits.closed()
    smooth, other = orbits.grazing()
    assert smooth.of_kind("interior_impact")[0].value == pytest.approx(math.sqrt(d), rel=1e-10)
    for orbit in other.orbits:
        u, force = orbit.impacts["u"][0], orbit.system.force.amplitude
        assert force**2 == pytest.approx(d * (a * u * u + b * u + 1), rel=1e-8)
    # the design rests when it should, by a plain run
    (e, x0), speed, _ = orbits.design()
    spring = zivi.LinearForce(stiffness=1.0, damping=0.2, gravity=9.81)
    run = zivi.simulate(zivi.ImpactSystem(spring, e=e), (0, 60), (x0, 0))
    assert run.rest_time == pytest.approx(3.0, abs=1e-5)
    assert -run.resolved_impacts["xdot_before"][0] == pytest.approx(speed, rel=1e-6)
