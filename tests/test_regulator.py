"""The regulated mass: rest in finite time, at the time that the closed form gives."""

import math

import numpy as np
import pytest

import zivi
from control_oracle import settling_time
from scheme import fitted_order, jittered

EXAMPLE = {"mu1": 3.0, "mu2": 2.0, "kappa": 0.5}
SETTLED = 1.7727622615101677
LOOPS = ["sampled", "paper's"]
"""The sampled loop with a landing; the paper's plant with the paper's tick."""


def regulate(loop, h, *, mu1, mu2, kappa, f=0.0, y0=(1.0, 0.0), end=None, **more):
    e = (1 - kappa) / (1 + kappa)
    if end is None:
        end = settling_time(*y0, mu1=mu1, mu2=mu2, e=e, f=f) * 1.1 + 40 * h
    return zivi.simulate_closed_loop(
        zivi.ImpactSystem(f, kappa=kappa),
        zivi.TwistingRegulator(mu1, mu2, h=h, kappa=kappa, landing=loop == "sampled"),
        (0, end),
        y0,
        method=zivi.ThetaGamma(h) if loop == "paper's" else None,
        **more,
    )


def allowed(loop, h, speed, *, mu1, mu2, e, f=0.0):
    """How far sampling may move the settling time.

    Every change of the sign of x' (two a bounce) is answered up to a period late, in which
    x'' is wrong by 2 mu2. To first order in h that changes the speed of the next contact by at most
    2 mu2 h, and with it what remains to be settled and the flight at hand; it happens at each of
    the bounces that are longer than a period. The paper's plant moves by implicit Euler steps: an
    impact or a stop within a step changes the speed by up to a step's worth of U once more.
    """
    up, down = mu1 - f + mu2, mu1 - f - mu2
    ratio = e * math.sqrt(down / up)
    remaining = e * (1 / up + 1 / math.sqrt(up * down)) / (1 - ratio)  # per speed
    bounces = max(0.0, math.log(speed / (h * up)) / math.log(1 / ratio))
    wrong = 2 * mu2 + (up if loop == "paper's" else 0.0)
    late = wrong * (1 / up + 1 / down + remaining)
    return h * (late * (1 + bounces) + 2 * up * remaining + 3)


def test_the_closed_form_is_the_documented_one():
    """Numbers of the paper's example, and the same by adding up bounces one by one."""
    assert math.isclose(settling_time(1, 0, mu1=3, mu2=2, e=1 / 3), SETTLED, rel_tol=1e-15)
    assert f"{SETTLED:.7f}" == "1.7727623"
    # up with -mu1 - mu2, down with -mu1 + mu2
    t, speed = math.sqrt(2), math.sqrt(2)
    for _ in range(40):
        speed /= 3
        height = speed**2 / 10
        t += speed / 5 + math.sqrt(2 * height)
        speed = math.sqrt(2 * height)
    assert math.isclose(t, SETTLED, rel_tol=1e-14)


@pytest.mark.parametrize("loop", LOOPS)
def test_the_example_settles_at_its_time_as_h_vanishes(loop):
    """First order up to a logarithm (one error a bounce): slope 0.8 .. 1.2 over three decades.

    The worst of seven jittered periods at each h, since the error depends on where in a period
    the switches fall. At h = 1e-5 it is below 2e-4.
    """
    steps = [1e-2, 1e-3, 1e-4, 1e-5]
    worst = []
    for h in steps:
        errors = [regulate(loop, hh, **EXAMPLE).rest_time - SETTLED for hh in jittered(h)]
        worst.append(max(map(abs, errors)))
        assert worst[-1] <= allowed(loop, 1.2 * h, math.sqrt(2) / 3, mu1=3, mu2=2, e=1 / 3)
    assert 0.8 <= fitted_order(steps, worst) <= 1.2
    assert worst[-1] <= 2e-4


@pytest.mark.parametrize("loop", LOOPS)
@pytest.mark.parametrize("h", [1e-2, 1e-3])
def test_rest_is_exact_and_stays(loop, h):
    """Zeros, not small numbers, for every step size tried; and no chattering of the control.

    A landing presses the mass onto the wall with -mu1 + mu2; the paper's tick leaves it with -mu1.
    """
    u, signs = (-1, [1, -1]) if loop == "sampled" else (-3, [0, 0])
    for hh in jittered(h):
        run = regulate(loop, hh, **EXAMPLE, end=3.0)
        resting = run.t >= run.rest_time
        assert np.count_nonzero(resting) > 1.0 / hh
        assert np.all(run.x[resting] == 0)
        assert np.all(run.xdot[resting] == 0)
        assert np.all(run.u[resting][1:] == u)
        assert np.all(run.signs[resting][1:, :2] == signs)
        assert np.all(np.isnan(run.signs[:, 2:]))
        assert np.all(np.isnan(run.x_ref))
        assert run.zeno_times.size >= 1
        assert len(run.liftoff_times) == 0


def random_cases(n, seed):
    rng = np.random.default_rng(seed)
    for _ in range(n):
        bound = rng.uniform(0.1, 5)
        mu2 = bound * rng.uniform(1.1, 3)
        mu1 = (mu2 + bound) * rng.uniform(1.1, 2)
        kappa = rng.uniform(0.05, 0.9)
        f = rng.uniform(-bound, bound)
        y0 = (rng.uniform(0.1, 3), rng.uniform(-4, 4))
        yield {"mu1": mu1, "mu2": mu2, "kappa": kappa, "f": f}, y0


@pytest.mark.parametrize("loop", LOOPS)
def test_random_gains_forces_and_walls_settle_on_time(loop):
    """At two step sizes within what sampling may do; their mean error shrinks with h."""
    totals = np.zeros(2)
    for case, y0 in random_cases(60, seed=7):
        e = (1 - case["kappa"]) / (1 + case["kappa"])
        law = {name: case[name] for name in ("mu1", "mu2", "f")} | {"e": e}
        exact = settling_time(*y0, **law)
        down = case["mu1"] - case["f"] - case["mu2"]
        up = down + 2 * case["mu2"]
        height = y0[0] + max(0, y0[1]) ** 2 / (2 * up)
        first = e * math.sqrt(min(0, y0[1]) ** 2 + 2 * down * height)
        for k, h in enumerate((1e-3, 1e-4)):
            run = regulate(loop, h, **case, y0=y0)
            error = run.rest_time - exact
            assert abs(error) <= allowed(loop, h, first, **law), (case, y0, h)
            totals[k] += abs(error)
    assert totals[1] < 0.25 * totals[0]


@pytest.mark.parametrize("loop", LOOPS)
def test_settling_slows_down_at_the_edge_of_the_gain_condition(loop):
    """The fall from x0 takes sqrt(2 x0/D), D = mu1 - F - mu2, and D = 0 is the edge."""
    times = []
    for gap in (1.0, 0.1, 0.01, 0.001):
        exact = settling_time(1, 0, mu1=3, mu2=2, e=1 / 3, f=1 - gap)
        run = regulate(loop, 1e-4, **EXAMPLE, f=1 - gap)
        limit = allowed(loop, 1e-4, math.sqrt(2 * gap) / 3, mu1=3, mu2=2, e=1 / 3, f=1 - gap)
        assert abs(run.rest_time - exact) <= limit
        times.append(run.rest_time)
    assert np.all(np.diff(times) > 0)
    # ten times less margin, sqrt 10 times the time, up to what the bounces add
    assert abs(times[-1] / times[-2] / math.sqrt(10) - 1) < 0.02
    # beyond the edge it does not come down: the sign of x' alone holds it where it is
    held = regulate(loop, 1e-3, **EXAMPLE, f=1.1, end=20.0)
    assert held.rest_time is None
    assert held.x.min() >= 1 - 1e-12


def test_forces_within_the_bound_need_not_be_told():
    """The law does not contain F but through the implicit signs: rest at the same time."""
    for f in (-1.9, 0.0, 0.9):
        run = regulate("sampled", 1e-3, **EXAMPLE, f=f, force_model=0.0)
        exact = settling_time(1, 0, mu1=3, mu2=2, e=1 / 3, f=f)
        limit = allowed("sampled", 1e-3, 0.5, mu1=3, mu2=2, e=1 / 3, f=f)
        assert abs(run.rest_time - exact) <= limit
        assert run.x[-1] == run.xdot[-1] == 0


def test_an_elastic_wall_is_stopped_too():
    """kappa = 0, all the energy is taken by the control: the formulas hold with e = 1.

    Sampled, the bounces within a period keep what energy they have: less than what one period of
    control moves, |x'| <= (mu1 + mu2) h.
    """
    exact = settling_time(1, 0, mu1=3, mu2=2, e=1.0)
    limit = allowed("paper's", 1e-4, math.sqrt(2), mu1=3, mu2=2, e=1.0)
    run = regulate("paper's", 1e-4, mu1=3, mu2=2, kappa=0.0)
    assert abs(run.rest_time - exact) <= limit
    assert run.x[-1] == run.xdot[-1] == 0
    run = regulate("sampled", 1e-4, mu1=3, mu2=2, kappa=0.0)
    late = run.t > exact + limit
    assert np.count_nonzero(late) > 100
    assert np.abs(run.xdot[late]).max() <= 5e-4
    assert run.x[late].max() <= 5e-4**2
