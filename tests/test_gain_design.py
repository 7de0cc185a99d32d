"""Gains that are computed: what they promise, against closed forms, an oracle and runs."""

import importlib.util
import math
import pickle
import shutil
from pathlib import Path

import numpy as np
import pytest

import zivi
from inside import Landing, bound_landing

SCRIPT = Path(__file__).parents[1] / "benchmarks" / "design_promises.py"


@pytest.fixture(scope="module")
def promises():
    spec = importlib.util.spec_from_file_location("design_promises", SCRIPT)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def oracle(promises, tmp_path_factory):
    if shutil.which("cc") is None:
        pytest.skip("no C compiler")
    return promises.oracle(str(tmp_path_factory.mktemp("oracle")))


@pytest.mark.slow
def test_promises_are_kept_whatever_the_unknown_force_does(promises, oracle):
    parts, inside, drawn = promises.promised(64, 7, oracle)
    assert np.all(parts <= 1.0)  # not NaN: all rest
    assert np.all(inside)
    assert np.median(parts) > 0.5  # and not by gains without measure
    assert {design.delay for design, _, _ in drawn} == set(promises.DELAYS)


@pytest.mark.slow
def test_what_may_go_on_bouncing_stays_as_low_as_promised(promises, oracle):
    heights = promises.practical(24, 5, oracle)
    assert heights.size >= 5
    assert np.all(heights <= 1.0)
    assert heights.max() > 0.01


@pytest.mark.slow
def test_beyond_the_bound_a_force_that_follows_the_motion_lets_none_rest(promises, oracle):
    assert promises.sharp(8, 3, oracle, 0.9) == 8
    assert promises.sharp(8, 3, oracle, 1.1) == 0


def bounce(e, rising, falling, x):
    """Time to rest from x, flight by flight."""
    t, v = np.sqrt(2 * x / falling), np.sqrt(2 * falling * x)
    while v > 1e-12:
        v *= e
        top = v * v / (2 * rising)
        t += v / rising + np.sqrt(2 * top / falling)
        v = np.sqrt(2 * falling * top)
    return t


def bounded(e, U, D, start, *, bound=0.0, h=1e-9, force=0.0, delay=0, quiet=0.0):
    """The promise of one landing."""
    landing = Landing(e, force, bound, start, delay, quiet)
    found = bound_landing(landing, np.array([U]), np.array([D]), np.array([h]))
    return float(found.time[0]), float(found.height[0])


def by_hand(e, U, D, start, *, bound=0.0, h=1e-9, force=0.0, delay=0, quiet=0.0):
    """The same written flight by flight from docs/exact_rest.md, without arrays."""
    M, m, (x, v) = bound, min(U, D), start
    tau, stops, dl = (1 + delay) * h, (1 + delay) * h * U + 2 * quiet, delay * h
    low, high = v + (force - M) * dl, v + (force + M) * dl
    top = x + max(v, 0) * dl + max(force + M, 0) * dl**2 / 2
    lowest = min(x + v * t + (force - M) * t * t / 2 for t in np.linspace(0, dl, 1001))
    if delay and lowest <= 0:
        speed = abs(v) + max(abs(force - M), abs(force + M)) * dl
        up = e * speed + max(force + M, 0) * dl
        low, high, top = min(low, -speed), max(high, up), max(top, up * dl)
    held = 0.0 if U > D else tau * (D - U) / (D - M)

    def rise(w, late):
        if U <= D:
            return w / (U - M), w * w / (2 * (U - M))
        if w <= stops:
            return w / (D - M), w * w / (2 * (D - M))
        v1 = max(w - (D - M) * late, stops)
        X = (w * w - v1 * v1 + stops * stops) / (2 * (D - M))
        X += (v1 * v1 - stops * stops) / (2 * (U - M))
        return (w - v1 + stops) / (D - M) + (v1 - stops) / (U - M), X

    T, X = rise(max(high, 0), tau if delay else 0.0)
    X += top
    down = max(-high, 0)
    if X > 0:
        T += 2 * X / (down + math.sqrt(down**2 + 2 * (D - M) * X))
    fast = max(2 * (D + M) * X, max(-low, 0) ** 2 + 2 * (D + M) * top)
    T, w = T + dl + held, e * math.sqrt(fast)
    while w > stops:
        longer, X = rise(w, tau)
        T += longer + math.sqrt(2 * X / (D - M)) + held
        w = e * math.sqrt(2 * (D + M) * X)
    r = e * math.sqrt((D + M) / (m - M))
    return T + 2 * w / (m - M) / (1 - r) + (tau if U <= D else 0.0) + h


CASES = [
    (0.5, 11.0, 7.0, (1.0, 0.0), {"bound": 1.0, "h": 2e-3}),
    (0.5, 11.0, 7.0, (1.0, 0.0), {"bound": 1.0, "h": 0.02, "quiet": 0.1}),
    (0.8, 30.0, 9.0, (0.3, 4.0), {"bound": 0.7, "h": 5e-3}),
    (0.8, 30.0, 9.0, (0.3, -4.0), {"bound": 0.7, "h": 5e-3}),
    (0.3, 5.0, 8.0, (0.3, 2.0), {"bound": 0.7, "h": 0.01, "quiet": 0.02}),
    (0.3, 5.0, 8.0, (0.3, -2.0), {"bound": 0.7, "h": 0.01, "delay": 3, "force": 2.0}),
    (0.6, 12.0, 8.0, (0.3, 2.0), {"bound": 1.0, "h": 0.01, "delay": 2, "force": -9.0}),
    (0.6, 12.0, 8.0, (0.01, -1.0), {"bound": 1.0, "h": 0.01, "delay": 5, "force": -9.0}),
    (0.6, 12.0, 8.0, (0.01, -1.0), {"bound": 1.0, "h": 0.01, "delay": 5, "force": 9.0}),
    (0.6, 12.0, 8.0, (1.0, -0.3), {"bound": 1.0, "h": 0.01, "delay": 5, "force": 9.0}),
    (0.6, 12.0, 8.0, (1.0, -0.3), {"bound": 0.5, "h": 0.01, "delay": 5, "force": -9.0}),
    (0.6, 12.0, 8.0, (0.0, 0.0), {"bound": 0.5, "h": 0.01, "delay": 1, "force": 1.0}),
    (0.5, 9.0, 9.0, (0.0, -1.0), {"bound": 0.5, "h": 0.01}),
]


@pytest.mark.parametrize(("e", "U", "D", "start", "more"), CASES)
def test_the_promise_is_the_longest_of_each_flight(e, U, D, start, more):
    time, height = bounded(e, U, D, start, **more)
    assert time == pytest.approx(by_hand(e, U, D, start, **more), rel=1e-12)
    assert height == 0.0


@pytest.mark.parametrize("e", [0.1, 0.5, 0.9])
def test_the_settling_bound_is_the_time_itself_without_an_unknown_force(e):
    for rising, falling, x in ((11.0, 7.0, 1.0), (20.0, 3.0, 0.3)):
        wanted = bounce(e, rising, falling, x)
        found, _ = bounded(e, rising, falling, (x, 0.0))
        assert found == pytest.approx(wanted, rel=1e-6)
        r = falling / rising
        closed = np.sqrt(2 * x / falling) * (1 + e * r) / (1 - e * np.sqrt(r))
        assert found == pytest.approx(closed, rel=1e-6)
    # upwards with v is as from the top, later by the climb; downwards earlier by the fall
    up, _ = bounded(e, 11.0, 7.0, (1.0, 3.0))
    top = 1 + 9 / 22
    assert up == pytest.approx(3 / 11 + bounce(e, 11.0, 7.0, top), rel=1e-6)
    down, _ = bounded(e, 11.0, 7.0, (1.0, -3.0))
    assert down == pytest.approx(bounce(e, 11.0, 7.0, 1 + 9 / 14) - 3 / 7, rel=1e-6)


def test_an_unknown_force_makes_it_no_shorter_and_has_a_condition():
    bounds = np.linspace(0, 8, 33)
    times = [bounded(0.7, 11.0, 7.0, (1.0, 0.5), bound=it)[0] for it in bounds]
    assert times == sorted(times)
    # M < (min(U, D) - e^2 D)/(1 + e^2): rest; else e^2 (D + M) < U - M: long bounces shrink
    rests = 7.0 * (1 - 0.49) / 1.49
    shrink = (11.0 - 0.49 * 7.0) / 1.49
    for bound in bounds:
        time, height = bounded(0.7, 11.0, 7.0, (1.0, 0.5), bound=bound, h=1e-3)
        assert np.isfinite(time) == (bound < shrink)
        if np.isfinite(time):
            assert (height == 0.0) == (bound < rests)
    assert not np.isfinite(bounded(0.7, 7.0, 14.0, (1.0, 0.5), bound=0.2)[0])


def test_a_mass_that_does_not_rest_stays_below_its_last_cycle():
    e, U, D, M, h = 0.7, 11.0, 7.0, 3.5, 1e-3
    _, height = bounded(e, U, D, (1.0, 0.5), bound=M, h=h)

    def flight(w):
        v1 = max(w - (D - M) * h, h * U)
        X = (w * w - v1 * v1 + (h * U) ** 2) / (2 * (D - M))
        X += (v1 * v1 - (h * U) ** 2) / (2 * (U - M))
        return e * math.sqrt(2 * (D + M) * X), X

    w = 1.0
    for _ in range(10_000):
        w, X = flight(w)
    assert w > h * U
    assert X < height < 1.4 * X
    assert flight(1.1 * w)[1] == pytest.approx(height, rel=1e-9)


def test_the_least_acceleration_is_taken():
    """Against a grid of all ratios and accelerations, by the promise written by hand."""
    T, e, M = 1.5, 0.6, 0.8
    design = zivi.design_tracker(T, e=e, bound=M, start=(0.7, -0.4))
    kappa, best = (1 - e) / (1 + e), math.inf
    B = 1.2 * M
    for ratio in np.geomspace(0.4, 1.1, 24):
        h = 0.1 * T / (3 * (1 + 1 / kappa) * max(1, 1 / ratio) + 11)
        for U in np.geomspace(5.0, 40.0, 120):
            D = ratio * U
            mu1, mu2 = zivi_gains(e, U, D)
            image = B * (1 + e) / (2 * e)
            if not (B * (1 + e * e) <= min(U, D) - e * e * D and image <= mu2 <= mu1 - image):
                continue
            if by_hand(e, U, D, (0.7, -0.4), bound=M, h=h) <= 0.98 * T:
                best = min(best, max(U, D))
                break
    assert max(design.rising, design.falling) == pytest.approx(best, rel=0.03)
    assert design.settling_time == pytest.approx(
        by_hand(e, design.rising, design.falling, (0.7, -0.4), bound=M, h=design.h), rel=1e-9
    )
    assert (design.mu1, design.mu2) == pytest.approx(zivi_gains(e, design.rising, design.falling))


def zivi_gains(e, U, D):
    """Solve D = 2 (mu1 - mu2)/(1 + e), U = 2 e (mu1 + mu2)/(1 + e)."""
    both, rest = U * (1 + e) / (2 * e), D * (1 + e) / 2
    return (both + rest) / 2, (both - rest) / 2


@pytest.mark.parametrize("kind", ["tracker", "regulator"])
@pytest.mark.parametrize("e", [0.2, 1 / 3, 0.5, 0.7, 0.8, 0.9, 0.95])
def test_the_best_ratio_is_the_numeric_minimum(kind, e):
    ratios = np.linspace(0.0, 0.9999, 4001)
    if kind == "tracker":
        rising, falling = 2 * e * (1 + ratios) / (1 + e), 2 * (1 - ratios) / (1 + e)
    else:
        rising, falling = 1 + ratios, 1 - ratios
    landing = Landing(e, 0.0, 0.0, (1.0, 0.0), 0, 0.0)
    time = bound_landing(landing, rising, falling, np.full(ratios.shape, 1e-7)).time
    scaled = time * np.sqrt(np.maximum(rising, falling))
    assert zivi.best_ratio(e, kind) == pytest.approx(ratios[np.argmin(scaled)], abs=1e-3)


def test_the_best_time_for_the_largest_acceleration():
    """T sqrt(U/2X) of the derivation in exact_rest.md."""
    for e, wanted in zip(
        (0.2, 1 / 3, 0.5, 0.7, 0.8, 0.9, 0.95), (1.5, 2, 2.73, 3.58, 4, 4.42, 4.62), strict=True
    ):
        ratio = zivi.best_ratio(e)
        rising = 2 * e * (1 + ratio)
        time, _ = bounded(e, rising, 2 * (1 - ratio), (1.0, 0.0))
        assert time * np.sqrt(rising / 2) == pytest.approx(wanted, rel=3e-3)


def test_the_designs_of_the_documentation():
    for design, mu1, mu2 in (
        (zivi.design_tracker(1.5, e=0.5, bound=1.0), 11.35, 5.49),
        (zivi.design_tracker(1.5, e=0.8, bound=1.0), 18.83, 11.11),
        (zivi.design_regulator(1.5, e=0.5, bound=1.0), 9.52, 1.70),
    ):
        assert design.mu1 == pytest.approx(mu1, rel=0.01)
        assert design.mu2 == pytest.approx(mu2, rel=0.02)
        assert design.settling_time <= 1.5 * (1 + 1e-12)
        assert design.controller().settings["mu1"] == design.mu1
        assert pickle.loads(pickle.dumps(design)) == design


@pytest.mark.parametrize(("e", "U_over_D"), [(0.5, 1.0), (0.8, 3.0)])
@pytest.mark.parametrize("delay", [0, 3])
def test_the_sampling_period_is_a_tenth_of_the_time_over_its_cost(e, U_over_D, delay):
    design = zivi.design_tracker(1.5, e=e, bound=1.0, delay=delay)
    ratio = max(1.0, design.rising / design.falling)
    assert ratio > U_over_D
    kappa = (1 - e) / (1 + e)
    periods = (1 + delay) * (3 * (1 + 1 / kappa) * ratio + 11)
    assert design.h == pytest.approx(0.1 * 1.5 / periods, rel=1e-12)


@pytest.mark.parametrize("kind", ["tracker", "regulator"])
def test_with_a_delay_it_samples_faster_and_is_in_time(kind):
    make = zivi.design_tracker if kind == "tracker" else zivi.design_regulator
    more = {"y_ref0": (0, 0), "force_model": -9.81} if kind == "tracker" else {}
    force = -9.81 if kind == "tracker" else 0.0
    design = make(1.0, e=0.8, bound=0.5, delay=3, force=force)
    assert design.h < 0.3 * make(1.0, e=0.8, bound=0.5, force=force).h
    assert design.controller().ahead == 4
    run = zivi.simulate_closed_loop(
        zivi.ImpactSystem(force - 0.45, e=0.8),
        design.controller(),
        (0, 1.5),
        (1, 0),
        delay=3,
        **more,
    )
    assert run.rest_time < design.settling_time
    assert design.u_min <= run.u.min()
    assert run.u.max() <= design.u_max
    # nothing acts before the first control does
    assert design.u_min <= 0.0 <= design.u_max


@pytest.mark.parametrize(
    ("time", "e", "start", "delay"), [(3, 0.5, (0.01, 0), 3), (2, 0.3, (0.001, 0), 1)]
)
def test_a_small_brake_that_comes_late_is_in_time_under_gravity(time, e, start, delay):
    design = zivi.design_tracker(time, e=e, start=start, delay=delay)
    plant, span = zivi.ImpactSystem(-9.81, e=e), (0, 2 * time)
    run = zivi.simulate_closed_loop(
        plant, design.controller(), span, start, y_ref0=(0, 0), delay=delay
    )
    assert run.rest_time < design.settling_time <= time


def test_a_force_that_follows_the_motion_is_borne():
    design = zivi.design_tracker(2.0, e=0.7, bound=2.0)
    plant = zivi.ImpactSystem(lambda t, x, v: -9.81 + 2.0 * math.tanh(1e3 * v), e=0.7)
    run = zivi.simulate_closed_loop(
        plant, design.controller(), (0, 2.5), (1, 0), y_ref0=(0, 0), force_model=-9.81
    )
    assert run.rest_time < design.settling_time


@pytest.mark.parametrize("kind", ["tracker", "regulator"])
@pytest.mark.parametrize("delay", [0, 2])
def test_the_control_reaches_both_ends_of_its_range_and_no_further(kind, delay):
    make = zivi.design_tracker if kind == "tracker" else zivi.design_regulator
    design = make(1.0, e=0.7, bound=0.3, start=(0.5, 1.0), force=-4.0, delay=delay)
    more = {"y_ref0": (0, 0)} if kind == "tracker" else {}
    run = zivi.simulate_closed_loop(
        zivi.ImpactSystem(-4.0, e=0.7),
        design.controller(),
        (0, 1.5),
        (0.5, 1.0),
        delay=delay,
        **more,
    )
    assert run.u.min() == design.u_min
    assert (
        run.u.max()
        == design.u_max
        == (
            0.0
            if delay
            else -design.mu1 + design.mu2
            if kind == "regulator"
            else 4.0 - min(design.controller()._accelerations())
        )
    )
    assert design.peak == max(abs(run.u.min()), abs(run.u.max()))


def test_a_moving_reference_keeps_the_control_in_its_range():
    design = zivi.design_tracker(1.0, e=0.5, force_ref=-20.0)
    assert design.u_max > zivi.design_tracker(1.0, e=0.5).u_max
    for y0, y_ref0 in (((2.0, 3.0), (0.5, -1.0)), ((0.2, -3.0), (2.5, 4.0))):
        run = zivi.simulate_closed_loop(
            zivi.ImpactSystem(-9.81, e=0.5),
            design.controller(),
            (0, 4),
            y0,
            y_ref0=y_ref0,
            force_ref=-20.0,
        )
        assert design.u_min <= run.u.min()
        assert run.u.max() <= design.u_max
        assert run.rest_time is not None
    # (1 + kappa)(mu1 + mu2 + |F_r|/R_r) on either side of -F, or of 0
    kappa = 1 / 3
    moving = (1 + kappa) * (design.mu1 + design.mu2 + 20.0 / (1 - kappa))
    assert design.u_max == pytest.approx(9.81 + moving)
    assert design.u_min == pytest.approx(-moving)


def test_the_sign_of_the_force_is_the_actuators_too():
    """It need not lift the mass: gravity is what it works against."""
    slow = zivi.design_tracker(10, e=0.5, u_limits=9)
    assert 8.9 < slow.u_min <= slow.u_max <= 9.0
    fast = zivi.design_tracker(1.0, e=0.5, u_limits=12)
    assert -12.0 <= fast.u_min <= fast.u_max <= 12.0
    for design, limit in ((slow, 9), (fast, 12)):
        asked = 10 if limit == 9 else 1
        run = zivi.simulate_closed_loop(
            zivi.ImpactSystem(-9.81, e=0.5),
            design.controller(u_limits=(-limit, limit)),
            (0, asked),
            (1, 0),
            y_ref0=(0, 0),
        )
        assert run.rest_time < design.settling_time <= asked
        assert not np.any(run.tick_status)  # nothing was cut
    # an actuator that only pushes away from the wall
    one_sided = zivi.design_tracker(2.0, e=0.5, u_limits=(0.0, 9.0))
    assert one_sided.u_min >= 0.0
    assert one_sided.u_max <= 9.0
    with pytest.raises(zivi.InfeasibleError, match="too weak for any"):
        zivi.design_regulator(2.0, e=0.5, u_limits=(0.0, 9.0))


def test_a_late_control_samples_finer_where_the_actuator_is_weak():
    """It is pushed away until its first control acts, and can do little about it then."""
    asked = {"e": 0.5, "start": (0.02, 0.0), "delay": 10, "force": 3.0}
    free = zivi.design_tracker(40.0, **asked)
    design = zivi.design_tracker(40.0, **asked, u_limits=(-3.003, 10.0))
    assert design.u_min >= -3.003 > free.u_min
    assert design.h < 0.5 * free.h
    run = zivi.simulate_closed_loop(
        zivi.ImpactSystem(3.0, e=0.5),
        design.controller(),
        (0, 40),
        (0.02, 0.0),
        y_ref0=(0, 0),
        force_ref=-1.0,  # the reference stays at rest
        delay=10,
    )
    assert run.rest_time < design.settling_time <= 40.0


@pytest.mark.parametrize("limits", [30.0, (-30.0, 50.0)])
def test_what_the_actuator_cannot_is_told_with_what_it_can(limits):
    with pytest.raises(zivi.InfeasibleError, match=r"feasible is settling_time >= ") as raised:
        zivi.design_tracker(0.5, e=0.5, bound=1.0, u_limits=limits)
    feasible = raised.value.settling_time
    design = zivi.design_tracker(feasible, e=0.5, bound=1.0, u_limits=limits)
    assert design.u_min >= -30.0
    assert feasible * 0.97 < design.settling_time <= feasible
    with pytest.raises(zivi.InfeasibleError):
        zivi.design_tracker(0.999 * feasible, e=0.5, bound=1.0, u_limits=limits)
    peak = raised.value.peak
    assert zivi.design_tracker(0.5, e=0.5, bound=1.0, u_limits=1.0001 * peak).peak <= 1.0001 * peak
    with pytest.raises(zivi.InfeasibleError):
        zivi.design_tracker(0.5, e=0.5, bound=1.0, u_limits=0.999 * peak)


def test_an_actuator_that_is_too_weak_for_any_time_is_told_so():
    with pytest.raises(zivi.InfeasibleError, match="too weak for any") as raised:
        zivi.design_tracker(0.5, e=0.5, bound=15.0, u_limits=30.0)
    assert raised.value.settling_time is None
    again = pickle.loads(pickle.dumps(raised.value))
    assert (str(again), again.peak) == (str(raised.value), raised.value.peak)
    with pytest.raises(zivi.InfeasibleError, match="1e\\+12"):
        zivi.design_tracker(1e-9, e=0.5)


@pytest.mark.parametrize("make", [zivi.design_tracker, zivi.design_regulator])
def test_errors_of_the_velocity_are_in_the_promise(make):
    asked = {"e": 0.8, "bound": 0.5, "force": -4.0}
    design = make(2.0, **asked, quiet=0.05)
    controller = design.controller()
    assert controller.quiet == design.quiet == 0.05
    exact = make(2.0, **asked)
    assert max(design.rising, design.falling) > max(exact.rising, exact.falling)
    more = {"y_ref0": (0, 0), "force_model": -4.0} if design.kind == "tracker" else {}
    for seed in range(3):
        run = zivi.simulate_closed_loop(
            zivi.ImpactSystem(-3.6, e=0.8),
            controller,
            (0, 2.5),
            (1, 0),
            noise=(0.0, 0.01),
            seed=seed,
            **more,
        )
        assert run.rest_time < design.settling_time <= 2.0


def test_practical_rest_asks_for_less_and_says_how_high():
    asked = {"e": 0.9, "bound": 3.0, "force": -9.81}
    exact = zivi.design_tracker(2.0, **asked)
    assert (exact.rest, exact.within) == ("exact", 0.0)
    D, U, e2 = exact.falling, exact.rising, 0.81
    assert exact.bound < (min(U, D) - e2 * D) / (1 + e2)
    weaker = zivi.design_tracker(2.0, **asked, rest="practical")
    assert weaker.rest == "practical"
    assert weaker.peak < 0.7 * exact.peak
    assert 0.0 < weaker.within < 1e-2
    D, U = weaker.falling, weaker.rising
    assert weaker.bound > (min(U, D) - e2 * D) / (1 + e2)
    assert e2 * (D + 3.0) < U - 3.0
    # without an unknown force nothing is gained
    assert zivi.design_tracker(2.0, e=0.9, rest="practical").rest == "exact"


@pytest.mark.parametrize("make", [zivi.design_tracker, zivi.design_regulator])
def test_gains_have_their_reserve(make):
    """A bound that decides: 1.2 M meets the conditions, 1.3 M does not."""
    design = make(50.0, e=0.8, bound=2.0)
    D, U, e2 = design.falling, design.rising, 0.64
    holds = (min(U, D) - e2 * D) / (1 + e2)
    if design.kind == "tracker":
        image = (1 + 0.8) / (2 * 0.8)
        holds = min(holds, design.mu2 / image, (design.mu1 - design.mu2) / image)
    assert 1.2 * 2.0 * (1 - 1e-9) <= holds < 1.3 * 2.0


@pytest.mark.parametrize("force", [-12.0, 3.0])
def test_a_regulator_has_gains_in_order(force):
    design = zivi.design_regulator(3.0, e=0.6, force=force, start=(0.1, 0.0))
    assert 0.0 < design.mu2 < design.mu1
    assert design.rising == pytest.approx(design.mu1 + design.mu2 - force)
    assert design.falling == pytest.approx(design.mu1 - design.mu2 - force)
    run = zivi.simulate_closed_loop(
        zivi.ImpactSystem(force, e=0.6), design.controller(), (0, 3), (0.1, 0.0)
    )
    assert run.rest_time < design.settling_time <= 3.0


@pytest.mark.parametrize("make", [zivi.design_tracker, zivi.design_regulator])
def test_bad_input(make):
    for arguments, name in (
        ({"settling_time": 0.0, "e": 0.5}, "settling_time"),
        ({"settling_time": np.nan, "e": 0.5}, "settling_time"),
        ({"settling_time": 1.0, "e": 1.0}, "e must be in"),
        ({"settling_time": 1.0, "e": 0.0}, "e must be in"),
        ({"settling_time": 1.0}, "exactly one of e and kappa"),
        ({"settling_time": 1.0, "e": 0.5, "bound": -1.0}, "bound"),
        ({"settling_time": 1.0, "e": 0.5, "start": (-1.0, 0.0)}, "start"),
        ({"settling_time": 1.0, "e": 0.5, "u_limits": (1.0, 2.0)}, "u_limits"),
        ({"settling_time": 1.0, "e": 0.5, "u_limits": (0.0, 0.0)}, "u_limits"),
        ({"settling_time": 1.0, "e": 0.5, "quiet": -1.0}, "quiet"),
        ({"settling_time": 1.0, "e": 0.5, "rest": "soon"}, "rest"),
        ({"settling_time": 1.0, "e": 0.5, "start": (np.inf, 0.0)}, "start"),
        ({"settling_time": 1.0, "e": 0.5, "u_limits": -1.0}, "u_limits"),
        ({"settling_time": 1.0, "e": 0.5, "delay": -1}, "delay"),
        ({"settling_time": 1.0, "e": 0.5, "force": np.inf}, "force"),
    ):
        with pytest.raises(ValueError, match=name):
            make(**arguments)
    with pytest.raises(TypeError):
        make("soon", e=0.5)
    with pytest.raises(ValueError, match="kind"):
        zivi.best_ratio(0.5, "observer")
