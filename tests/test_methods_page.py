"""What pages and results say of the methods is computed again, errors against other solutions."""

import math
import re
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import brentq

import zivi
from closed_form import Ball
from references import REFERENCES

ROOT = Path(__file__).parents[1]
FILES = ("docs/methods.md", "docs/tolerances.md", "benchmarks/results/accuracy.md")
PAGE = "\n".join((ROOT / name).read_text() for name in FILES)
TEXT = " ".join(PAGE.split())

GRAVITY, DRAG = 9.81, 0.3
DRAGGED = zivi.LinearForce(gravity=GRAVITY, damping=DRAG)


def rows(header):
    """Cells of the table whose header line starts so."""
    lines = PAGE[PAGE.index(header) :].splitlines()[2:]
    for line in lines:
        if not line.startswith("|"):
            return
        yield [cell.strip() for cell in line.strip("|").split("|")]


def simulate(case, method):
    system = zivi.ImpactSystem(zivi.LinearForce(**case["force"]), e=case["e"])
    state = (case["x0"], case["xdot0"])
    return zivi.simulate(system, (case["t0"], case["t_end"]), state, method)


def with_tolerance(rtol, order=8):
    return zivi.SwitchedRK(rtol=rtol, atol=rtol / 1000, order=order, flights="rk")


def test_the_table_of_the_methods_at_work():
    names = {name: getattr(zivi, name) for name in zivi.__all__}
    case = REFERENCES["T1_tab_G1.5"] | {"t_end": 3.7}
    table = list(rows("| method | force"))
    assert len(table) == 7
    for name, nfev, error_x, error_v, lowest in table:
        sol = simulate(case, eval(name.strip("`"), names))
        x, xdot = np.abs(sol(3.7) - case["samples"]["3.7"])
        assert sol.nfev == pytest.approx(int(nfev), rel=0.1)
        # rounding may be less on another machine
        assert x == pytest.approx(float(error_x), rel=0.5, abs=3e-16)
        assert xdot == pytest.approx(float(error_v), rel=0.5, abs=3e-15)
        assert sol.x.min() == pytest.approx(float(lowest), rel=0.05, abs=1e-9)


def test_rest_and_range_of_e_of_each_method():
    ball = zivi.ImpactSystem(-9.81, e=0.5)
    ends = {
        method: zivi.simulate(ball, (0, 3), (1, 0), method)
        for method in (zivi.SwitchedRK(), zivi.ThetaGamma(1e-3), zivi.MoreauJean(1e-3))
    }
    switched, implicit, stepped = ends.values()
    for exact in (switched, implicit):
        assert exact.x[-1] == exact.xdot[-1] == 0
    assert 0 < abs(stepped.x[-1]) < 1e-3
    assert abs(stepped.xdot[-1]) < 1e-200
    assert zivi.simulate(ball, (0, 3), (1, 0), zivi.ExplicitEuler(1e-3)).rest_time is None
    plastic = zivi.ImpactSystem(-9.81, e=0)
    for method in (zivi.SwitchedRK(), zivi.MoreauJean(1e-3)):
        rest = zivi.simulate(plastic, (0, 3), (1, 0), method).rest_time
        assert rest == pytest.approx(math.sqrt(2 / 9.81), abs=4e-3)
    for method in (zivi.ThetaGamma(1e-3), zivi.ExplicitEuler(1e-3)):
        with pytest.raises(ValueError, match="e must be > 0"):
            zivi.simulate(plastic, (0, 3), (1, 0), method)


def test_the_zeno_time_of_time_stepping_is_of_order_one():
    zeno = Ball(1.0, 0.0, e=0.7).zeno
    for h in (1e-2, 1e-3, 1e-4):
        ball = zivi.ImpactSystem(-9.81, e=0.7)
        sol = zivi.simulate(ball, (0, 4), (1, 0), zivi.MoreauJean(h))
        assert abs(sol.rest_time - zeno) < 20 * h
        assert (
            abs(zivi.simulate(ball, (0, 4), (1, 0), zivi.ThetaGamma(h)).rest_time - zeno) > 40 * h
        )


def test_time_stepping_is_of_order_two_in_flight():
    case = REFERENCES["T3_tab_G3"]
    system = zivi.ImpactSystem(zivi.LinearForce(**case["force"]), e=case["e"])
    wanted = case["samples"]["0.9"][0]
    for theta, order in [(0.5, 2), (1.0, 1)]:
        far, near = (
            zivi.simulate(system, (0, 1), (0, 0), zivi.MoreauJean(h, theta)).x[round(0.9 / h)]
            for h in (1e-3, 1e-4)
        )
        assert math.log10(abs(far - wanted) / abs(near - wanted)) == pytest.approx(order, abs=0.1)


def errors(case, sol):
    """Largest errors of x, x' and the Zeno times."""
    samples = {float(t): state for t, state in case["samples"].items()}
    samples[case["t_end"]] = (case["x_end"], case["xdot_end"])
    wanted = np.array(list(samples.values())).T
    x, xdot = np.abs(sol(np.array(list(samples))) - wanted).max(axis=1)
    assert len(sol.zeno_times) == len(case["zeno"])
    assert len(sol.liftoff_times) == len(case["lift"])
    assert np.abs(sol.liftoff_times - case["lift"]).max(initial=0) < 2e-14
    return x, xdot, np.abs(sol.zeno_times - case["zeno"]).max(initial=0)


def test_errors_are_proportional_to_the_tolerance():
    table = list(rows("| `rtol` | order 8"))
    assert len(table) == 5
    for tolerance, *cells in table:
        rtol = float(tolerance)
        for order, printed in [(8, cells[:4]), (5, cells[4:])]:
            sols = {name: simulate(it, with_tolerance(rtol, order)) for name, it in CASES}
            worst = np.max([errors(it, sols[name]) for name, it in CASES], axis=0) / rtol
            # the sizes of the steps decide how errors add up: a small change of the method shows
            assert worst == pytest.approx([float(it) for it in printed[:3]], rel=0.5, abs=0.1)
            assert np.all(worst < 5)
            total = sum(sol.nfev for sol in sols.values())
            assert total == pytest.approx(int(printed[3]), rel=0.1)


def test_the_page_quotes_the_largest_factors():
    (told,) = re.findall(r"at most (\d\.\d) at order 8 and (\d\.\d) at order 5", TEXT)
    table = [[float(cell) for cell in row[1:]] for row in rows("| `rtol` | order 8")]
    largest = [max(max(row[k : k + 3]) for row in table) for k in (0, 4)]
    assert [float(it) for it in told] == pytest.approx(largest, abs=0.05)


@pytest.mark.parametrize("rtol", [1e-4, 1e-6, 1e-8, 1e-10])
def test_power_series_are_right_to_rounding_and_zeno_times_to_the_tolerance(rtol):
    assert "2e-14 (m, m/s) for any `rtol`" in TEXT
    assert "the error of a Zeno time (s) is at most 0.08 `rtol`" in TEXT
    for _, it in CASES:
        x, xdot, zeno = errors(it, simulate(it, zivi.SwitchedRK(rtol=rtol, atol=rtol / 1000)))
        assert max(x, xdot) < 2e-14
        assert zeno < 0.08 * rtol + 2e-14


CASES = list(REFERENCES.items())


def test_there_are_nine_references():
    assert "nine reference trajectories" in TEXT
    assert len(CASES) == 9


# --- a ball with drag, solved arc by arc


def arc(u):
    """Flight time from the wall under gravity and drag.

    With ``p = c tau`` and ``a = c u/g`` the height is zero where ``p/(1 - exp(-p)) = 1 + a``.
    """

    def excess(p):
        if p < 0.3:
            return p / 2 + p**2 / 12 - p**4 / 720 + p**6 / 30240 - p**8 / 1209600
        return p / -math.expm1(-p) - 1

    a = DRAG * u / GRAVITY
    return brentq(lambda p: excess(p) - a, a, 2.1 * a, xtol=1e-300, rtol=1e-15) / DRAG


def dragged_arcs(e):
    """Start, length and first speed of the arcs of a ball dropped from 1 m, and the rest time."""
    t = brentq(
        lambda t: 1 - (GRAVITY / DRAG) * (t + math.expm1(-DRAG * t) / DRAG), 0.1, 5, rtol=1e-15
    )
    u = e * (GRAVITY / DRAG) * -math.expm1(-DRAG * t)
    arcs = []
    while u > 1e-9:
        tau = arc(u)
        arcs.append((t, tau, u))
        # the speed at the end: x' + c x = u - g tau with x = 0
        t, u = t + tau, e * (GRAVITY * tau - u)
    rest = math.fsum([arcs[0][0], *(it[1] for it in arcs)])
    return arcs, rest + 2 * u / (GRAVITY * (1 - e))


def dropped(e, rtol, t_end=80.0):
    system = zivi.ImpactSystem(DRAGGED, e=e)
    return zivi.simulate(system, (0, t_end), (1, 0), with_tolerance(rtol))


def test_work_grows_as_e_approaches_one():
    table = list(rows("| `e` | rest at (s)"))
    assert len(table) == 7
    for row in table:
        e, rest, few, few_error, many, many_error = map(float, row)
        _, exact = dragged_arcs(e)
        assert exact == pytest.approx(rest, abs=6e-7)
        for rtol, impacts, error in [(1e-6, few, few_error), (1e-10, many, many_error)]:
            sol = dropped(e, rtol)
            assert len(sol.resolved_impacts) == pytest.approx(impacts, rel=0.1, abs=1)
            assert abs(sol.rest_time - exact) < max(3 * error, 1e-13 * rest * e / (1 - e))
            # what is promised: atol + rtol T
            assert abs(sol.rest_time - exact) < 1.5 * rtol * (rest + 1e-3) + 1e-11
    (cost,) = set(re.findall(r"An impact costs about (\d+) evaluations", TEXT))
    sol = dropped(0.99, 1e-6)
    assert sol.nfev / len(sol.resolved_impacts) == pytest.approx(int(cost), rel=0.1)


def test_the_skipped_arcs():
    (v6, v10, x6, x10) = re.findall(
        r"in them is (\S+) m/s .*, (\S+) for 1e-10 \(of `x`, (\S+) and (\S+) m\)", TEXT
    )[0]
    arcs, _ = dragged_arcs(0.6)
    for rtol, error_x, error_v in [(1e-6, x6, v6), (1e-10, x10, v10)]:
        sol = dropped(0.6, rtol, 4.0)
        n = len(sol.resolved_impacts)
        worst = np.zeros(2)
        for t, length, u in arcs[n - 1 : n + 12]:
            tau = np.linspace(0.05, 0.95, 50) * length
            fade = -np.expm1(-DRAG * tau)
            x = (u + GRAVITY / DRAG) * fade / DRAG - GRAVITY * tau / DRAG
            xdot = u - (u + GRAVITY / DRAG) * fade
            worst = np.maximum(worst, np.abs(sol(t + tau) - [x, xdot]).max(axis=1))
        assert worst == pytest.approx([float(error_x), float(error_v)], rel=0.1)


# --- the other limits


def test_a_force_that_ends_at_the_wall():
    def root(t, x, xdot):
        return -9.81 - math.sqrt(x)

    def drop(force):
        return zivi.simulate(zivi.ImpactSystem(force, e=0.5), (0, 3), (1, 0))

    exact = drop(lambda t, x, xdot: root(t, max(x, 0.0), xdot)).rest_time
    assert drop(root).rest_time == pytest.approx(exact, abs=2e-6)


def test_a_force_that_jumps():
    """Twisting: up and down the force is constant, the arcs are parabolas, rho their ratio."""
    up, down, e = 10.31, 9.31, 0.5

    def force(t, x, xdot):
        return -up if xdot > 0 else -down

    rho, speed = e * math.sqrt(down / up), math.sqrt(2 * down)
    exact = speed / down + e * speed * (1 / up + 1 / math.sqrt(up * down)) / (1 - rho)
    system = zivi.ImpactSystem(force, e=e)
    for rtol in (1e-6, 1e-9):
        sol = zivi.simulate(system, (0, 3), (1, 0), with_tolerance(rtol))
        assert abs(sol.rest_time - exact) < 2 * rtol
        assert sol.n_rejected > 50


@pytest.mark.parametrize(
    ("width", "max_step", "found"), [(0.1, math.inf, True), (0.01, 1.0, True), (0.001, 1.0, False)]
)
def test_a_short_pulse_at_rest(width, max_step, found):
    def force(t, x, xdot):
        return -1 + 5 * math.exp(-(((t - 5.1) / width) ** 2))

    method = zivi.SwitchedRK(max_step=max_step)
    sol = zivi.simulate(zivi.ImpactSystem(force, e=0.5), (0, 10), (0, 0), method)
    assert bool(len(sol.liftoff_times)) is found
    if found:
        expected = 5.1 - width * math.sqrt(math.log(5))
        assert sol.liftoff_times[0] == pytest.approx(expected, abs=1e-12)


def test_grazing():
    factors = re.findall(
        r"is (\d+) `rtol` for `d` = 1e-2, (\d+) `rtol` for 1e-4, (\d+) `rtol` for 1e-6", TEXT
    )
    for d, factor in zip((1e-2, 1e-4, 1e-6), factors[0], strict=True):
        system = zivi.ImpactSystem(zivi.LinearForce(stiffness=1, gravity=-1), e=0.5)
        sol = zivi.simulate(system, (0, math.pi), (2 + d, 0), zivi.SwitchedRK(flights="rk"))
        hit = math.acos(-1 / (1 + d))
        speed = (1 + d) * math.sin(hit)
        assert speed == pytest.approx(math.sqrt(2 * d), rel=0.01)
        tau = math.pi - hit
        xdot = math.sin(tau) + 0.5 * speed * math.cos(tau)
        assert abs(sol(math.pi)[1] - xdot) / 1e-6 == pytest.approx(int(factor), rel=0.1)


def test_large_times():
    start, printed = re.findall(
        r"time of (\S+) s changes the Zeno time of a ball by (\S+) s\.", TEXT
    )[0]
    start = float(start)
    ball = zivi.ImpactSystem(-9.81, kappa=0.41)
    sol = zivi.simulate(ball, (start, start + 4), (1, 6), zivi.SwitchedRK(flights="rk"))
    zeno = Ball.of_kappa(1.0, 6.0, kappa=0.41).zeno
    assert abs(sol.rest_time - start - zeno) < 2 * float(printed)


def test_budgets_end_a_run():
    system = zivi.ImpactSystem(DRAGGED, e=0.9)
    for settings, status in [
        ({"max_impacts": 10}, zivi.Status.ZENO_BUDGET),
        ({"max_steps": 10}, zivi.Status.STEP_BUDGET),
    ]:
        sol = zivi.simulate(system, (0, 30), (1, 0), zivi.SwitchedRK(**settings))
        assert sol.status is status
        assert 0 < sol.t[-1] < 30


@pytest.mark.parametrize("at", [1, 40])
def test_impacts_without_loss_have_a_budget_in_both_representations(at):
    method = zivi.SwitchedRK(max_impacts=at + 2)
    for system, start in [
        (zivi.ImpactSystem(-9.81, e=1), (1, 0)),
        (zivi.ImpactSystem(DRAGGED, e=1), (1, 0)),
        (
            zivi.MechanicalSystem(mass=1, force=[-9.81], gaps=[zivi.LinearGap([1.0])], e=1),
            ([1.0], [0.0]),
        ),
    ]:
        sol = zivi.simulate(system, (0, 1e9), start, method)
        assert sol.status is zivi.Status.ZENO_BUDGET
        assert len(sol.resolved_impacts) == at + 3
        assert "e = 1" in sol.message


def test_forces_that_no_step_can_follow():
    noise = np.random.default_rng(1)
    for force, status in [
        (lambda t, x, xdot: xdot**3, zivi.Status.STEP_SIZE_TOO_SMALL),
        (lambda t, x, xdot: noise.uniform(-10, -9), zivi.Status.STEP_BUDGET),
    ]:
        system, method = zivi.ImpactSystem(force, e=0.5), zivi.SwitchedRK(max_steps=10_000)
        sol = zivi.simulate(system, (0, 3), (1, 1), method)
        assert sol.status is status
        # x'' = x'^3 from x' = 1: x' = 1/sqrt(1 - 2 t)
        assert sol.t[-1] <= 0.5 + 1e-6


def test_impacts_that_the_page_counts():
    """The page of tolerances has some of the rows of the results."""
    told = dict(re.findall(r"(\d+) at(?: `e` =)? (0\.\d+)", page_of_tolerances()))
    counts = {row[2]: row[0] for row in rows("| `e` | rest at (s)")}
    assert len(told) >= 4
    for count, e in told.items():
        assert counts[count] == e


def page_of_tolerances():
    text = " ".join((ROOT / "docs" / "tolerances.md").read_text().split())
    return text.partition("`x'' = -9.81 - 0.3 x'`, takes")[2].partition("for `rtol` = 1e-6")[0]


@pytest.mark.parametrize("width", [0.1, 0.01])
def test_a_pulse_at_rest_of_a_third_of_the_longest_step_is_seen(width):
    for place in np.random.default_rng(7).uniform(width, 10 - width, 10):

        def force(t, x, xdot, *, at=place):
            return 5.19 if abs(t - at) < width / 2 else -9.81

        method = zivi.SwitchedRK(max_step=3 * width)
        sol = zivi.simulate(zivi.ImpactSystem(force, e=0.5), (0, 10), (0, 0), method)
        assert sol.liftoff_times[:1] == pytest.approx([place - width / 2], abs=1e-9)
