"""About a thousand runs of every method and setting, each under a name that says what it is."""

import math
from collections.abc import Callable, Iterator
from random import Random

import zivi

Run = Callable[[], object]

SPAN = (0.0, 3.0)
KAPPAS = (0.05, 1 / 3, 0.41, 0.8)
TABLE = zivi.LinearForce(stiffness=1.0, damping=0.1, gravity=9.0, amplitude=4.0, omega=5.0)
OSCILLATOR = zivi.LinearForce(stiffness=4.0, damping=0.1, gravity=1.0, amplitude=3.0, omega=2.0)


def cubic_spring(t, x, xdot):
    return -9.81 - 40.0 * x * x * x - 0.1 * xdot


def drag(t, x, xdot):
    return -9.81 - 0.3 * xdot * abs(xdot)


def ramp(t, x, xdot):
    return -9.81 + 5.0 * t


def touching(t, x, xdot):
    return -1.0 + 1.2 * math.sin(2.0 * t) - 0.2 * x


PYTHON_FORCES = {"cubic": cubic_spring, "drag": drag, "ramp": ramp, "touching": touching}


def compiled_forces(random: Random) -> Iterator[tuple[str, object]]:
    """Balls, tables, oscillators, springs: constant and linear forces."""
    for g in (9.81, 1.0, 0.25):
        yield f"g{g}", -g
    for i in range(12):
        yield (
            f"linear{i}",
            zivi.LinearForce(
                stiffness=random.choice((0.0, random.uniform(0.5, 30.0))),
                damping=random.choice((0.0, random.uniform(0.0, 1.0))),
                gravity=random.uniform(-2.0, 10.0),
                amplitude=random.choice((0.0, random.uniform(0.0, 15.0))),
                omega=random.uniform(1.0, 12.0),
                phase=random.uniform(-3.0, 3.0),
            ),
        )


def states(random: Random) -> Iterator[tuple[float, float]]:
    """A drop, rest at the wall, a throw."""
    yield 1.0, 0.0
    yield 0.0, 0.0
    yield random.uniform(0.0, 1.0), random.uniform(-5.0, 5.0)


def pair(**settings) -> zivi.SwitchedRK:
    """Flights by the Runge-Kutta pair, whatever the force is."""
    return zivi.SwitchedRK(**settings, flights="rk")


def switched() -> Iterator[tuple[str, zivi.SwitchedRK]]:
    """Every setting of the switched method."""
    for order in (8, 5):
        for rtol in (1e-4, 1e-9, 1e-12):
            yield f"rk{order}-{rtol:g}", pair(rtol=rtol, atol=1e-3 * rtol, order=order)
    yield "rk8-max", pair(max_step=0.05)
    yield "rk8-first", pair(first_step=1e-3)
    yield "rk5-budget", pair(order=5, max_steps=40)
    yield "rk8-zeno", pair(rtol=1e-12, max_impacts=4)


def fixed_steps() -> Iterator[tuple[str, object]]:
    """Every method of fixed steps."""
    for theta, gamma in ((1.0, 1.0), (0.5, 0.5), (0.5, 1.0), (0.75, 0.6)):
        yield f"theta{theta}-gamma{gamma}", zivi.ThetaGamma(0.01, theta, gamma)
    yield "fine", zivi.ThetaGamma(1e-3)
    yield "newton", zivi.ThetaGamma(0.01, solver="newton")
    yield "outer", zivi.ThetaGamma(0.01, solver="outer")
    yield "outer-1", zivi.ThetaGamma(0.01, solver="outer", linearisations=1)
    for theta in (0.0, 0.5, 1.0):
        yield f"moreau{theta}", zivi.MoreauJean(0.01, theta)
    yield "explicit", zivi.ExplicitEuler(0.01)


def simulations() -> Iterator[tuple[str, Run]]:
    """Single runs: each method on several forces, walls and states."""
    random = Random(1)
    forces = [*compiled_forces(random), *PYTHON_FORCES.items()]
    for name, method in [*switched(), *fixed_steps()]:
        for of_force, force in forces:
            for i, y0 in enumerate(states(random)):
                if i < 2 and random.random() < 0.4:
                    continue
                kappa = random.choice(KAPPAS)
                system = zivi.ImpactSystem(force, kappa=kappa)
                label = f"{name} {of_force} kappa{kappa:.3g} y{i}"
                yield label, lambda s=system, y=y0, m=method: zivi.simulate(s, SPAN, y, method=m)


def options() -> Iterator[tuple[str, Run]]:
    """Plastic, elastic and moving walls, events, t_eval, dense output off, far from t = 0."""
    times = [0.05 * k for k in range(61)]
    table = zivi.HarmonicWall(amplitude=0.02, omega=25.0)

    def level(t, x, xdot):
        return x - 0.3

    def apex(t, x, xdot):
        return xdot

    apex.terminal = 4
    methods = {
        "rk8": pair(),
        "rk5": pair(rtol=1e-8, order=5),
        "theta": zivi.ThetaGamma(0.01),
        "moreau": zivi.MoreauJean(0.01),
    }
    for name, method in methods.items():
        for e in (0.0, 1e-9, 0.3, 0.95, 1.0):
            if e == 0.0 and name == "theta":
                continue
            for force in (-9.81, drag, TABLE):
                for key, more in (
                    ("plain", {}),
                    ("t_eval", {"t_eval": times}),
                    ("events", {"events": [level, apex]}),
                    ("sparse", {"dense_output": False}),
                    ("steps", {"samples": "steps"}),
                ):
                    system = zivi.ImpactSystem(force, e=e)
                    kind = (
                        force if isinstance(force, float) else getattr(force, "__name__", "linear")
                    )
                    yield (
                        f"{name} e{e:g} {kind} {key}",
                        lambda s=system, m=method, more=more: zivi.simulate(
                            s, SPAN, (0.7, 1.0), method=m, **more
                        ),
                    )
        moving = zivi.ImpactSystem(-9.81, e=0.6, wall=table)
        yield f"{name} table", lambda s=moving, m=method: zivi.simulate(s, SPAN, (0.2, 0), method=m)
        late = zivi.ImpactSystem(OSCILLATOR, e=0.7)
        yield (
            f"{name} late",
            lambda s=late, m=method: zivi.simulate(s, (1e4, 1e4 + 3.0), (0.5, 0), method=m),
        )


def papers_regulator(mu1, mu2, **settings):
    """Give the paper's tick, without the landing."""
    return zivi.TwistingRegulator(mu1, mu2, **settings, landing=False)


def papers_tracker(mu1: float, mu2: float, **settings: float) -> zivi.TwistingTracker:
    """Give the paper's tick, without the landing."""
    return zivi.TwistingTracker(mu1, mu2, **settings, landing=False)


STILL = {"dense_output": False}
"""Without the motion between the samples, which costs evaluations."""


def loops() -> Iterator[tuple[str, Run]]:
    """Closed loops: controllers, plants, imperfections."""
    reference = {"y_ref0": (3, 3), "force_ref": -19.81}
    for kappa in KAPPAS[1:]:
        spring = zivi.LinearForce(stiffness=5.0, damping=0.2, gravity=9.81)
        plants = {
            "ball": zivi.ImpactSystem(-9.81, kappa=kappa),
            "drag": zivi.ImpactSystem(drag, kappa=kappa),
            "spring": zivi.ImpactSystem(spring, kappa=kappa),
        }
        for of_plant, plant in plants.items():
            for h in (1e-2, 2e-3):
                for key, make, given in (
                    ("regulator", zivi.TwistingRegulator, {}),
                    ("paper's regulator", papers_regulator, {}),
                    ("tracker", zivi.TwistingTracker, reference),
                    ("paper's tracker", papers_tracker, reference),
                    ("explicit", zivi.ExplicitTwisting, reference),
                ):
                    for imperfect, more in (
                        ("exact", {}),
                        ("delay", {"delay": 2}),
                        ("noise", {"noise": (1e-4, 1e-2), "seed": 7}),
                        ("paper", {"method": zivi.ThetaGamma(h)}),
                    ):
                        if of_plant == "spring" and "method" not in more:
                            more = more | {"method": pair(rtol=1e-9, atol=1e-12)}
                        yield (
                            f"{key} {of_plant} kappa{kappa:.3g} h{h} {imperfect}",
                            lambda p=plant, m=make, h=h, k=kappa, r=given, o=more: (
                                zivi.simulate_closed_loop(
                                    p,
                                    m(30, 17, h=h, kappa=k),
                                    (0, 2),
                                    (2, 1),
                                    **STILL,
                                    **r,
                                    **o,
                                )
                            ),
                        )


def batches() -> Iterator[tuple[str, Run]]:
    """Many runs at once."""
    random = Random(2)
    y0 = [(random.uniform(0, 2), random.uniform(-3, 3)) for _ in range(33)]
    systems = {
        "ball": zivi.ImpactSystem(-9.81, kappa=0.41),
        "linear": zivi.ImpactSystem(TABLE, e=0.7),
    }
    methods = {
        "theta": zivi.ThetaGamma(0.01),
        "mid": zivi.ThetaGamma(0.01, 0.5, 0.5),
        "rk8": pair(),
        "moreau": zivi.MoreauJean(0.01),
    }
    for of_system, system in systems.items():
        for name, method in methods.items():
            for save in ("final", "statistics", 10):
                if save == 10 and name == "rk8":
                    continue
                yield (
                    f"batch {of_system} {name} {save}",
                    lambda s=system, m=method, save=save: zivi.simulate_batch(
                        s, SPAN, y0, method=m, save=save
                    ),
                )


def series() -> Iterator[tuple[str, Run]]:
    """Flights by power series: all kinds of linear forces, walls and output."""
    random = Random(3)
    method = zivi.SwitchedRK(flights="series")
    walls = {
        "still": None,
        "one": zivi.HarmonicWall(amplitude=0.02, omega=5.0, phase=0.3),
        "two": zivi.HarmonicWall(amplitude=0.02, omega=17.0, offset=-0.1),
    }
    for of_force, force in [*compiled_forces(random), ("table", TABLE)]:
        for i, y0 in enumerate(states(random)):
            for of_wall, wall in walls.items():
                e = random.choice((0.0, 0.3, 0.8, 0.95, 1.0))
                system = zivi.ImpactSystem(force, e=e, wall=wall)
                label = f"series {of_force} {of_wall} e{e:g} y{i}"
                yield label, lambda s=system, y=y0: zivi.simulate(s, SPAN, y, method=method)
    oscillator = zivi.ImpactSystem(OSCILLATOR, e=0.7)
    outputs = {
        "t_eval": {"t_eval": [0.05 * k for k in range(61)]},
        "event": {"events": [lambda t, x, xdot: x - 0.3]},
        "sparse": {"dense_output": False},
        "steps": {"samples": "steps"},
    }
    for key, more in outputs.items():
        yield (
            f"series {key}",
            lambda more=more: zivi.simulate(oscillator, SPAN, (0.7, 1.0), method=method, **more),
        )
    late = (1e4, 1e4 + 3.0)
    yield "series late", lambda: zivi.simulate(oscillator, late, (0.5, 0), method=method)
    starts = [(random.uniform(0, 2), random.uniform(-3, 3)) for _ in range(33)]
    yield (
        "series batch",
        lambda: zivi.simulate_batch(oscillator, SPAN, starts, method=method, save="events"),
    )


GROUPS = {
    "simulations": simulations,
    "options": options,
    "loops": loops,
    "batches": batches,
    "series": series,
}
