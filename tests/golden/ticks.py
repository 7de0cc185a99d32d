"""Ticks of controllers and observers, as `golden.solvers` traces them."""

import math
import random

import numpy as np

import zivi


def control():
    """Ticks on drawn samples, and what an observer makes of them."""
    for h in (1e-3, 1e-2):
        for e in (0.1, 0.5, 0.9):
            yield (
                f"regulator {h} {e}",
                lambda h=h, e=e: ticks(zivi.TwistingRegulator(30, 17, h=h, e=e), h),
            )
            for settings in ({}, {"branch": "nearest"}, {"horizon": 3.0}, {"shift": True}):
                key = f"tracker {h} {e} {settings}"
                yield (
                    key,
                    lambda h=h, e=e, settings=settings: ticks(
                        zivi.TwistingTracker(30, 17, h=h, e=e, **settings), h, reference=True
                    ),
                )
            yield (
                f"explicit {h} {e}",
                lambda h=h, e=e: ticks(zivi.ExplicitTwisting(30, 17, h=h, e=e), h, reference=True),
            )
            for only in (True, False):
                yield f"observer {h} {e} {only}", lambda h=h, e=e, only=only: seen(h, e, only)


def ticks(it, h, *, reference=False, odd=False):
    """Give the controls of drawn samples, the last ones near the wall and on it."""
    draw, found = random.Random(7), []
    if reference:
        it.reset(1.0, 0.5)
    for k in range(300):
        size = 1.0 if k < 120 else 30.0 * h * h * draw.choice([0.0, 0.3, 1.0, 5.0])
        x = size * draw.random()
        xdot = draw.uniform(-1, 1) * (3.0 if k < 120 else 40.0 * h)
        if k > 280:
            x = xdot = 0.0
        force = -9.81 + draw.uniform(-2, 2)
        more = (draw.choice([-9.81, -9.81, 3.0]),) if reference else ()
        period = {}
        if odd and k % 11 == 5:
            x = xdot = None
        if odd and k % 7 == 3:
            period = {"dt": h * draw.choice([0.3, 2.0])}
        found.append(it.step(x, xdot, force, *more, **period))
        found.append([*it._signs, it._status])
    return found


def seen(h, e, only, *, gaps=False, **more):
    """Give what an observer makes of a bouncing mass with noise, outliers and a kick."""
    draw = random.Random(9)
    start = zivi.ImpactSystem(-9.0, e=e)
    sol = zivi.simulate(start, (0, 400 * h), (0.3 * 100 * h, 0.0), t_eval=np.arange(400) * h)
    noise = (1e-4, 1e-2)
    x = [max(0.0, value + noise[0] * draw.gauss(0, 1)) for value in sol.x]
    v = [value + noise[1] * draw.gauss(0, 1) for value in sol.xdot]
    for k in range(50, 400, 37):
        x[k] += draw.uniform(0, 0.3)
    t = sol.t
    if gaps:
        v[250:260] = [math.nan] * 10
        keep = [k for k in range(400) if not 300 <= k < 310]
        t, x, v = t[keep], [x[k] for k in keep], [v[k] for k in keep]
    settings = {"noise": noise[0], "position_only": True} if only else {"noise": noise}
    given = (t, x) if only else (t, x, v)
    found = zivi.ImpactObserver(e, h, **settings, **more).observe(*given, force=-9.81)
    return [found.x, found.xdot, found.d, found.std, found.refused, found.e, found.std_e]


def choices():
    """Ticks by every choice: solvers, horizons, limits, periods and samples that are missing."""
    makers = {
        "regulator": (zivi.TwistingRegulator, False),
        "tracker": (zivi.TwistingTracker, True),
    }
    choices = {
        "paper": {"landing": False},
        "newton": {"landing": False, "solver": "newton"},
        "outer": {"landing": False, "solver": "outer"},
        "outer, two": {"landing": False, "solver": "outer", "linearisations": 2},
        "ahead": {"ahead": 3, "quiet": 1e-3},
        "limits": {"u_limits": (-20.0, 35.0), "depth": 1e-3},
    }
    tracking = {
        "press": {"press": 2.0},
        "other wall": {"e_ref": 0.7},
        "nearest newton": {"solver": "newton", "landing": False, "branch": "nearest"},
        "nearest paper": {"landing": False, "branch": "nearest"},
        "horizon": {"landing": False, "horizon": 4.0},
    }
    for name, (maker, reference) in makers.items():
        for of_choice, settings in (choices | (tracking if reference else {})).items():
            for e in (0.2, 0.6, 1.0):
                if of_choice == "other wall" and e != 0.2:
                    continue
                yield (
                    f"{name} {of_choice} {e}",
                    lambda m=maker, r=reference, e=e, o=settings: ticks(
                        m(30, 17, h=2e-3, e=e, **o), 2e-3, reference=r, odd=True
                    ),
                )
    for branch in ("positive", "nearest"):
        for e in (0.2, 0.6):
            for landing in (False, True):
                yield (
                    f"given {branch} {e} {landing}",
                    lambda b=branch, e=e, o=landing: given(
                        zivi.TwistingTracker(30, 17, h=2e-3, e=e, branch=b, landing=o), 2e-3
                    ),
                )


def given(it, h):
    """Give the controls towards a reference that is told at each tick, through its impacts."""
    draw, found = random.Random(13), []
    it.reset(1.0, 0.0)
    ball = zivi.simulate(zivi.ImpactSystem(-9.81, e=it.e), (0, 1.2), (0.3, 0.0))
    times = np.arange(400) * h
    path = ball(times).T.tolist()
    for k in range(399):
        (x, xdot), after = path[k], path[k + 1]
        x, xdot = max(0.0, x + 0.01 * draw.gauss(0, 1)), xdot + 0.3 * draw.gauss(0, 1)
        branch = draw.choice([1.0, -1.0])
        if k % 40 == 39:
            x = xdot = None
        more = (-9.81,) if k % 3 == 0 else ()
        now = (*path[k], branch)
        found.append(it.step_to(x, xdot, -9.81, now, (*after, branch), *more))
        found.append([*it._signs, it._status])
    return found


def observers():
    """Observers by every choice."""
    choices = {
        "learns": {"learn_e": True, "se": 0.2},
        "learns, changes": {"learn_e": True, "q_e": 1e-4},
        "unsure": {"se": 0.05, "dmax": 3.0, "q_d": 0.2},
        "sure": {"dmax": 0.5, "q_d": 1e-4},
    }
    for name, settings in choices.items():
        for only in (True, False):
            for e in (0.0, 0.4, 0.8, 1.0):
                yield (
                    f"{name} {only} {e}",
                    lambda e=e, only=only, o=settings: [
                        seen(2e-3, e, only, gaps=True, **o),
                        walked(e, only, **o),
                    ],
                )
    plant = zivi.ImpactSystem(-9.81, e=0.5)
    for delay in (0, 2):
        for only in (True, False):
            yield f"loop {delay} {only}", lambda d=delay, only=only: driven(plant, d, only)


def walked(e, only, **settings):
    """Give an observer's estimates tick by tick: missing samples, kicks, periods that differ."""
    draw, h, found = random.Random(31), 2e-3, []
    it = zivi.ImpactObserver(e, h, noise=(1e-4, 1e-2), position_only=only, **settings)
    x, v = 0.02, 0.0
    for k in range(600):
        dt = h * draw.choice([1.0, 1.0, 1.0, 0.5, 2.5])
        u = 2.0 * math.sin(0.05 * k)
        a = -9.81 + u + 0.5 * math.sin(0.01 * k)
        x, v = x + dt * (v + 0.5 * dt * a), v + dt * a
        if x < 0.0:
            x, v = -e * x, -e * v
        if x < 1e-6 and abs(v) < 1e-2:
            x = v = 0.0
        if k in (200, 350):
            x, v = x + 0.05, v + 1.0
        seen_x = None if draw.random() < 0.1 else max(0.0, x + draw.gauss(0, 1e-4))
        if draw.random() < 0.05:
            seen_x = draw.uniform(0, 0.5)
        seen_v = None if only or draw.random() < 0.2 else v + draw.gauss(0, 1e-2)
        found.append(it.step(seen_x, seen_v, -9.81, u, dt=dt))
        found.append([list(it._restitution), it.n_refused])
        if k % 20 == 0:
            found.append([list(row) for row in it._covariance])
    return found


def driven(plant, delay, only):
    """Give a loop that an observer closes."""
    h = 2e-3
    observer = zivi.ImpactObserver(0.5, h, noise=(1e-4, 1e-2), position_only=only)
    loop = zivi.simulate_closed_loop(
        plant,
        zivi.TwistingTracker(30, 17, h=h, e=0.5, ahead=1 + delay, quiet=0.05),
        (0, 1.5),
        (0.5, 0.0),
        y_ref0=(0.3, 0.0),
        noise=(1e-4, 1e-2),
        seed=3,
        delay=delay,
        observer=observer,
        dense_output=False,
    )
    return [loop.t, loop.x, loop.xdot, loop.u, loop.resolved_impacts, loop.signs]
