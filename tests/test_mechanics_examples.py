"""The examples from mechanics against closed forms and simulations that share no code with zivi."""

import math
import re

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm
from scipy.optimize import brentq

import zivi
from example_scripts import example, shown
from references import REFERENCES

PAGE = "".join(map(shown, ("vibrating_table", "rocking_block", "compressor_valve")))


table = example("vibrating_table")
oscillator = example("impact_oscillator")
block = example("rocking_block")
valve = example("compressor_valve")

EXAMPLES = [table, oscillator, block, valve]


@pytest.mark.slow
@pytest.mark.parametrize("module", EXAMPLES, ids=lambda module: module.__name__)
def test_every_example_draws_its_figure(module, tmp_path, capsys):
    path = tmp_path / "out.png"
    module.main(str(path))
    assert path.stat().st_size > 10_000
    # what is printed beside an expected number in brackets agrees with it to the digits printed
    pairs = re.findall(r"(\d+\.\d{4,})[^(\d]*\((\d+\.\d{4,})\)", capsys.readouterr().out)
    for found, expected in pairs:
        digits = len(found.split(".")[1])
        assert float(found) == pytest.approx(float(expected), abs=1.5 * 10.0**-digits)
    assert pairs or module is table


# --- the vibrating table


def exact_impacts(excitation, e, start, n):
    """Impacts in the fixed frame: parabolas and the first root of their height above the table."""
    g, omega = table.GRAVITY, table.OMEGA
    a = excitation * g / omega**2
    t, speed = start
    found = []
    for _ in range(n):
        y, v = a * math.sin(omega * t), a * omega * math.cos(omega * t) + speed

        def gap(tau, t=t, y=y, v=v):
            return y + v * tau - g * tau**2 / 2 - a * math.sin(omega * (t + tau))

        grid = np.linspace(1e-3, 3, 30_000)
        heights = y + v * grid - g * grid**2 / 2 - a * np.sin(omega * (t + grid))
        k = int(np.argmax(heights < 0))
        tau = brentq(gap, grid[k - 1], grid[k], xtol=1e-15, rtol=1e-14)
        t, relative = t + tau, v - g * tau - a * omega * math.cos(omega * (t + tau))
        speed = -e * relative
        found.append((t, speed))
    return np.array(found)


@pytest.mark.parametrize("frame", [table.in_table_frame, table.in_fixed_frame])
def test_both_frames_follow_the_parabolas(frame):
    start = (0.1, 4.0)
    expected = exact_impacts(1.6, 0.5, start, 12)
    span = (start[0], expected[-1, 0] + 1e-3)
    sol = zivi.simulate(frame(1.6, 0.5), span, (0, start[1]), table.TIGHT)
    assert np.abs(sol.resolved_impacts["t"] - expected[:, 0]).max() < 1e-9
    assert np.abs(sol.resolved_impacts["xdot_after"] - expected[:, 1]).max() < 1e-8


def test_the_two_frames_agree_through_rests():
    system = table.in_fixed_frame(1.5, 0.5)
    sol = zivi.simulate(system, (0, 10), (0.2, 0))
    assert len(sol.zeno_times) == 10
    assert table.difference_of_frames() < 1e-9
    # in the fixed frame a resting ball moves with the table
    times = np.linspace(1.0, 1.1, 11)
    rest = zivi.simulate(system, (0, 10), (0.2, 0), t_eval=times)
    position, velocity = rest.fixed()
    a, omega = 1.5 * table.GRAVITY / table.OMEGA**2, table.OMEGA
    assert position == pytest.approx(a * np.sin(omega * times), abs=1e-15)
    assert velocity == pytest.approx(a * omega * np.cos(omega * times), abs=1e-14)


@pytest.mark.parametrize(("e", "printed"), [(0.5, 1.526824), (0.8, 1.070836)])
def test_the_period_doubles_where_it_should(e, printed):
    alone, doubling = math.pi * (1 - e) / (1 + e), 2 * (1 + e**2) / (1 + e) ** 2
    expected = math.sqrt(alone**2 + doubling**2)
    assert expected == pytest.approx(printed, abs=5e-7)
    assert table.threshold(e) == pytest.approx(expected, abs=1e-7)
    below = table.impact_phases(expected - 1e-3, e, 3000, 20)
    above = table.impact_phases(expected + 1e-3, e, 3000, 20)
    assert np.ptp(below) < 1e-5
    assert below[0] == pytest.approx(math.acos(alone / (expected - 1e-3)), abs=1e-5)
    assert np.ptp(above[::2]) < 1e-5
    assert np.ptp(above[1::2]) < 1e-5
    assert abs(above[0] - above[1]) > 0.05


@pytest.mark.parametrize(("excitation", "e"), [(1.2, 0.5), (1.5, 0.5), (1.05, 0.8)])
def test_the_multipliers_of_the_table(excitation, e):
    sine = math.sqrt(1 - (math.pi * (1 - e) / ((1 + e) * excitation)) ** 2)
    trace = 1 + e**2 - (1 + e) ** 2 * excitation * sine
    found = table.multipliers(excitation, e)
    assert found.prod() == pytest.approx(e**2, abs=1e-7)
    assert found.sum() == pytest.approx(trace, abs=1e-7)


@pytest.mark.parametrize("n", [1, 2, 3])
def test_the_orbit_of_n_periods(n):
    excitation, e = 1.02 * n * math.pi / 3, 0.5
    t, speed = table.orbit(excitation, e, n)
    span = (t, t + n * table.PERIOD + 1e-3)
    sol = zivi.simulate(table.in_table_frame(excitation, e), span, (0, speed), table.TIGHT)
    (impact,) = sol.resolved_impacts
    assert impact["t"] == pytest.approx(t + n * table.PERIOD, abs=1e-10)
    assert impact["xdot_after"] == pytest.approx(speed, abs=1e-9)


# --- the oscillator


def flow(tau, zeta):
    return expm(np.array([[0.0, 1.0], [-1.0, -2 * zeta]]) * tau)


def steady(t, omega, zeta):
    """The forced motion without a wall."""
    response = 1 / (1 - omega**2 + 2j * zeta * omega)
    turn = response * np.exp(1j * omega * t)
    return np.array([turn.real, (1j * omega * turn).real])


def periodic_impact(omega, e, zeta):
    """Time and speed after the impact of the orbit of one period, by elimination.

    With ``z = (0, u) - steady(t)`` at the impact, ``flow(T) z + steady(t) = (0, -u/e)``: for each
    `t` the first row gives `u`, the second is solved for `t`.
    """
    period = 2 * math.pi / omega
    matrix = flow(period, zeta)

    def speed(t):
        z = steady(t, omega, zeta)
        return ((matrix @ z)[0] - z[0]) / matrix[0, 1]

    def mismatch(t):
        z, u = steady(t, omega, zeta), speed(t)
        return (matrix @ (np.array([0, u]) - z) + z)[1] + u / e

    grid = np.linspace(0, period, 400)
    values = [mismatch(t) for t in grid]
    roots = [
        brentq(mismatch, a, b, xtol=1e-14)
        for a, b, left, right in zip(grid, grid[1:], values, values[1:], strict=False)
        if left * right < 0
    ]
    return next((t, speed(t)) for t in roots if speed(t) > 0)


def test_the_constants_of_the_oscillator_are_those_of_the_references():
    stick, (pressed,) = (REFERENCES[name]["zeno"] for name in ("O2_osc_stick", "O1_osc_zeno"))
    assert pytest.approx(stick, abs=1e-14) == oscillator.STICK_ZENO
    assert pytest.approx(pressed, abs=1e-14) == oscillator.PRESSED_ZENO
    t, u = periodic_impact(2.2, 0.7, 0.05)
    period = 2 * math.pi / 2.2
    assert pytest.approx(t, abs=1e-11) == oscillator.PERIODIC[0] % period
    assert pytest.approx(u, abs=1e-11) == oscillator.PERIODIC[1]


def test_the_oscillator_sticks_and_leaves():
    sol = oscillator.sticking()
    assert sol.zeno_times == pytest.approx(REFERENCES["O2_osc_stick"]["zeno"], abs=1e-8)
    leaves = (1.5 * math.pi + 2 * math.pi * np.arange(3)) / 0.6
    assert sol.liftoff_times == pytest.approx(leaves, abs=1e-12)
    for start, end in zip(sol.zeno_times, sol.liftoff_times, strict=True):
        assert np.all(sol(np.linspace(start, end, 50)) == 0)


@pytest.mark.parametrize(("omega", "e"), [(2.2, 0.7), (2.0, 0.8)])
def test_the_section_of_the_periodic_orbit_is_one_point(omega, e):
    t, u = periodic_impact(omega, e, oscillator.ZETA)
    period = 2 * math.pi / omega
    z = np.array([0, u]) - steady(t, omega, oscillator.ZETA)
    expected = flow(period - t, oscillator.ZETA) @ z + steady(period, omega, oscillator.ZETA)
    points = oscillator.section(oscillator.oscillator(e, omega), omega, 300, 20)
    assert np.abs(points - expected).max() < 1e-5


def test_the_section_of_the_chaos_is_not():
    points = oscillator.section(oscillator.oscillator(0.8, 2.8), 2.8, 600, 100)
    assert len(np.unique(np.round(points, 6), axis=0)) == 100
    assert np.all(points[:, 0] >= 0)
    assert np.ptp(points[:, 1]) > 1


def test_a_wall_at_the_equilibrium_is_no_accumulation():
    sol = oscillator.at_the_equilibrium()
    zeta = oscillator.ZETA
    flight = math.pi / math.sqrt(1 - zeta**2)
    speeds = sol.resolved_impacts["xdot_after"]
    assert len(speeds) == 1 + math.floor((100 - sol.resolved_impacts["t"][0]) / flight)
    assert np.diff(sol.resolved_impacts["t"]) == pytest.approx(flight, abs=1e-6)
    ratio = 0.5 * math.exp(-zeta * flight)
    assert speeds[1:] / speeds[:-1] == pytest.approx(ratio, rel=1e-6)
    assert len(sol.zeno_times) == 0
    assert sol.rest_time is None
    # and what a little pressure makes of it
    pressed = oscillator.at_the_equilibrium(0.02)
    assert len(pressed.zeno_times) == 1
    assert pressed.rest_time < 20


def test_tolerances_of_the_default_do_not_make_a_rest_of_it():
    sol = zivi.simulate(oscillator.oscillator(0.5, 1.0, 0.0), (0, 300), (1, 0))
    assert sol.rest_time is None
    assert (
        np.abs(np.diff(sol.resolved_impacts["t"]) - math.pi / math.sqrt(1 - 0.05**2)).max() < 1e-2
    )


# --- the block


def rocking(phi, n):
    """Angle at n quarter periods, and the times of the impacts, from apex to apex."""
    e = 1 - 1.5 * math.sin(0.2) ** 2
    t, impacts, apexes, sign = 0.0, [], [(0.0, 0.2 * phi)], 1
    for _ in range(n):
        t += math.acosh(1 / (1 - phi))
        impacts.append(t)
        sign = -sign
        phi = 1 - math.sqrt(1 - e**2 * (1 - (1 - phi) ** 2))
        t += math.acosh(1 / (1 - phi))
        apexes.append((t, sign * 0.2 * phi))
    return np.array(impacts), np.array(apexes)


def test_the_block_rests_in_finite_time():
    assert block.restitution(0.2) == pytest.approx(0.9407957, abs=5e-8)
    sol = block.rock(0.5)
    assert sol.rest_time == pytest.approx(31.902716, abs=5e-7)
    # apex after apex, until the rest of the series is below the tolerance
    impacts, apexes = rocking(0.5, 250)
    assert sol.rest_time == pytest.approx(apexes[-1, 0], abs=1e-5)
    assert sol.resolved_impacts["t"][:40] == pytest.approx(impacts[:40], abs=1e-7)


def test_the_transformed_position_is_the_angle():
    _, apexes = rocking(0.5, 20)
    force = zivi.LinearForce(stiffness=-1.0, gravity=0.2)
    system = zivi.ImpactSystem(force, e=block.restitution(0.2))
    sol = zivi.simulate(system, (0, 30), (0.1, 0), block.METHOD, t_eval=apexes[:, 0])
    assert np.abs(sol.transformed.s - apexes[:, 1]).max() < 1e-8
    assert np.abs(sol.xdot).max() < 1e-7


@pytest.mark.parametrize(("factor", "falls"), [(0.999, False), (1.001, True)])
def test_the_block_falls_over(factor, falls):
    sol = block.rock(0.0, factor * 0.2)
    assert bool(len(sol.t_events[0])) is falls
    assert (sol.status is zivi.Status.TERMINATED_BY_EVENT) is falls
    if falls:  # x = alpha - alpha cosh t + w sinh t meets alpha where tanh t = alpha/w
        assert sol.t_events[0][0] == pytest.approx(math.atanh(1 / factor), abs=1e-8)


# --- the valve


def scipy_cycle(reed):
    """Open and close a valve with SciPy, from event to event, and extrapolate the last bounces."""

    def field(t, y):
        return [y[1], reed.force(t, y[0], y[1])]

    def seat(t, y):
        return y[0]

    seat.terminal, seat.direction = True, -1
    end, settings = valve.T_END, {"method": "DOP853", "rtol": 1e-12, "atol": 1e-14}
    early = np.linspace(0, valve.PEAK, 1000)
    after = early[np.argmax([reed.force(t, 0, 0) > 0 for t in early])]
    opens = brentq(lambda t: reed.force(t, 0, 0), 0, after, xtol=1e-15)
    # a Taylor step off the seat, where the force and the height are zero
    rise = (reed.force(opens + 1e-7, 0, 0) - reed.force(opens - 1e-7, 0, 0)) / 2e-7
    t, state = opens + 1e-6, [rise * 1e-18 / 6, rise * 1e-12 / 2]
    lands, lift = [], 0.0
    while True:
        leg = solve_ivp(field, (t, end), state, events=seat, max_step=1e-4, **settings)
        lift = max(lift, leg.y[0].max())
        t, before = leg.t[-1], leg.y[1, -1]
        lands.append((t, -before))
        u = -reed.e * before
        if u < 1e-5:
            return opens, lift, np.array(lands), t + 2 * u / (-reed.force(t, 0, 0) * (1 - reed.e))
        t, state = t, [1e-300, u]


@pytest.mark.parametrize("e", [0.0, 0.3, 0.6])
@pytest.mark.parametrize(("preload", "zeta"), [(0.5e-3, 0.1), (1.5e-3, 0.1), (0.5e-3, 0.4)])
def test_the_valve_against_scipy(e, preload, zeta):
    reed = valve.Valve(e=e, preload=preload, zeta=zeta)
    opens, lift, lands, shut = scipy_cycle(reed)
    found = valve.landing(reed)
    assert reed.opening == pytest.approx(opens, abs=1e-12)
    assert found.opens == pytest.approx(opens, abs=1e-12)
    assert found.lift == pytest.approx(lift, rel=1e-3)
    assert found.lands == pytest.approx(lands[0, 0], abs=1e-9)
    assert found.speed == pytest.approx(lands[0, 1], rel=1e-6)
    assert found.bounces == np.sum(e * lands[:, 1] >= valve.AUDIBLE)
    assert found.shut == pytest.approx(shut, abs=1e-8)
    assert found.energy == pytest.approx((1 - e**2) / 2 * np.sum(lands[:, 1] ** 2), rel=1e-6)


def test_the_seat_and_the_damper_take_what_the_pulse_gives():
    reed = valve.Valve()
    sol = reed.cycle()
    t = np.linspace(0, valve.T_END, 200_001)
    x, xdot = sol(t)
    pulse = valve.PULSE * np.exp(-(((t - valve.PEAK) / valve.WIDTH) ** 2))
    given = np.trapezoid(pulse * xdot, t)
    damped = np.trapezoid(2 * reed.zeta * valve.OMEGA0 * xdot**2, t)
    assert valve.landing(reed).energy == pytest.approx(given - damped, rel=1e-4)
    assert x[-1] == 0


def test_damping_for_a_soft_landing():
    zeta = valve.damping_for(1.0)
    _, _, lands, _ = scipy_cycle(valve.Valve(zeta=zeta))
    assert lands[0, 1] == pytest.approx(1.0, abs=1e-6)


# --- the page


def test_the_numbers_of_the_page():
    thresholds = re.findall(r"finds (\S+) for `e = 0.5` and (\S+) for `e = 0.8`", PAGE)[0]
    assert thresholds == tuple(f"{table.threshold(e):.6f}" for e in (0.5, 0.8))
    assert re.findall(r"it rests from\s(\S+) s\.", PAGE) == [f"{block.rock(0.5).rest_time:.6f}"]
    assert re.findall(r"1 m/s at (\S+) of", PAGE) == [f"{valve.damping_for(1.0):.4f}"]
