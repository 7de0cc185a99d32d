"""Impact laws: runs, batches, derivatives against closed forms, another solver, differences."""

import copy
import dataclasses
import json
import math
import pickle

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import zivi
from inside import (
    FileError,
    _zivi,
    digest,
    law_class,
    prepare_control,
    prepare_simulate,
    system_impact_law as impact_law,
)

G = 9.81
PLASTIC = zivi.SpeedDependentImpact(e0=0.5, v0=1.0, k=0.25)
CAPPED = zivi.SpeedDependentImpact(e0=0.7, v0=2.0, k=0.2, e_max=0.9)
FALLING = zivi.SpeedDependentImpact(e0=0.6, v0=1.0, k=-0.3)
TIGHT = zivi.SwitchedRK(rtol=1e-12, atol=1e-13)


def coefficient(law, v):
    """Give ``e(v)`` as the law is stated."""
    return min(law.e0 * (v / law.v0) ** -law.k, law.e_max)


def bounces(law, height, until, least=0.0):
    """Give times, speeds before and after of a ball that falls, from the parabolas."""
    v = math.sqrt(2.0 * G * height)
    t, rows = v / G, []
    while t < until and v > max(least, 1e-300):
        rows.append((t, v, coefficient(law, v) * v))
        v = rows[-1][2]
        t += 2.0 * v / G
    return np.array(rows)


@pytest.mark.parametrize("flights", ["rk", "series"])
@pytest.mark.parametrize("law", [PLASTIC, CAPPED, FALLING], ids=["plastic", "capped", "falling"])
def test_impacts_of_a_ball_are_those_of_its_parabolas(law, flights):
    method = zivi.SwitchedRK(rtol=1e-12, atol=1e-13, flights=flights)
    sol = zivi.simulate(zivi.ImpactSystem(-G, e=law), (0, 6), (1, 0), method)
    assert sol.success
    exact = bounces(law, 1.0, 6.0)
    n = len(sol.impacts)
    assert n > 7
    assert np.abs(sol.impacts["t"] - exact[:n, 0]).max() < 1e-12
    assert np.abs(sol.impacts["xdot_before"] + exact[:n, 1]).max() < 1e-12
    assert np.abs(sol.impacts["xdot_after"] - exact[:n, 2]).max() < 1e-12


def test_without_loss_at_low_speeds_a_ball_bounces_for_good():
    sol = zivi.simulate(zivi.ImpactSystem(-G, e=PLASTIC), (0, 40), (1, 0))
    assert (sol.success, sol.rest_time, len(sol.zeno_times)) == (True, None, 0)
    slowest = 0.5**4  # v0 e0^(1/k)
    assert len(sol.impacts) == len(bounces(PLASTIC, 1.0, 40.0)) > 3000
    assert sol.impacts["xdot_after"][-1] == pytest.approx(slowest, rel=1e-12)
    assert np.diff(sol.impacts["t"])[-1] == pytest.approx(2 * slowest / G, rel=1e-11)


def test_below_the_cap_impacts_accumulate_as_under_newtons_law():
    sol = zivi.simulate(zivi.ImpactSystem(-G, e=CAPPED), (0, 6), (1, 0), TIGHT)
    least = CAPPED.v0 * (CAPPED.e0 / CAPPED.e_max) ** (1 / CAPPED.k)
    above = bounces(CAPPED, 1.0, 6.0, least)
    # from the last impact of another ratio on the flights are a geometric series
    t, u = above[-1, 0], above[-1, 2]
    assert 0.0 < u < least
    end = t + 2 * u / (G * (1 - CAPPED.e_max))
    assert sol.rest_time == pytest.approx(end, abs=1e-13)
    assert sol.zeno_times.tolist() == [sol.rest_time]


@pytest.mark.parametrize("k", [-0.02, -0.3, -1.0, -4.0])
def test_a_coefficient_that_vanishes_with_the_speed_leads_to_rest(k):
    law = zivi.SpeedDependentImpact(e0=0.6, v0=5.0, k=k)
    sol = zivi.simulate(zivi.ImpactSystem(-G, e=law), (0, 9), (1, 0), TIGHT)
    exact = bounces(law, 1.0, 9.0)
    end = 2 * math.sqrt(2 / G) + math.fsum(2 * exact[:, 2] / G) - math.sqrt(2 / G)
    assert sol.rest_time == pytest.approx(end, abs=1e-14 * len(exact))
    assert sol.zeno_times.tolist() == [sol.rest_time]
    n = len(sol.impacts)
    assert n > 1
    assert np.abs(sol.impacts["t"] - exact[:n, 0]).max() < 1e-12
    assert sol(8.0)[0] == 0.0


def test_an_accumulation_under_a_force_that_varies():
    # the force of the fixed frame varies by a tenth over a chain: its end against impact by impact
    def force(t, x, xdot):
        return -G - 2.0 * math.sin(3.0 * t) - 0.4 * xdot - 5.0 * x

    law = zivi.SpeedDependentImpact(e0=0.4, v0=2.0, k=0.1, e_max=0.5)
    sol = zivi.simulate(zivi.ImpactSystem(force, e=law), (0, 3), (1, 0), TIGHT)
    times, _ = by_events(force, law, (1.0, 0.0), 3.0, least=1e-5)
    n = min(len(times), len(sol.impacts))
    assert n > 6
    assert np.abs(sol.impacts["t"][:n] - times[:n]).max() < 1e-9
    assert times[-1] < sol.rest_time < times[-1] + 1e-5


def by_events(force, law, start, until, least):
    """Give times and speeds after of 40 impacts at most, by SciPy from one to the next."""

    def wall(t, y):
        return y[0]

    wall.terminal, wall.direction = True, -1.0
    t, y, times, speeds = 0.0, list(start), [], []
    while t < until and len(times) < 40:
        run = solve_ivp(
            lambda t, y: [y[1], force(t, *y)],
            (t, until),
            y,
            "DOP853",
            events=wall,
            rtol=3e-14,
            atol=1e-15,
        )
        if run.status != 1:
            break
        t, before = run.t[-1], -run.y[1, -1]
        y = [0.0, coefficient(law, before) * before]
        times.append(t)
        speeds.append(y[1])
        if y[1] < least:
            break
    return np.array(times), np.array(speeds)


@pytest.mark.parametrize("law", [PLASTIC, FALLING], ids=["plastic", "falling"])
def test_impacts_of_an_excited_oscillator_are_those_of_another_solver(law):
    force = zivi.LinearForce(stiffness=9.0, damping=0.1, gravity=-1.0, amplitude=8.0, omega=2.2)
    sol = zivi.simulate(zivi.ImpactSystem(force, e=law), (0, 12), (0.5, 0), TIGHT)
    times, speeds = by_events(force, law, (0.5, 0.0), 12.0, least=1e-3)
    n = len(times)
    assert n > 3
    assert np.abs(sol.impacts["t"][:n] - times).max() < 1e-9
    assert np.abs(sol.impacts["xdot_after"][:n] - speeds).max() < 1e-8


def test_no_run_gains_energy():
    rng = np.random.default_rng(5)
    for _ in range(60):
        e0 = rng.uniform(0, 1)
        law = zivi.SpeedDependentImpact(
            e0, 10 ** rng.uniform(-2, 1), rng.uniform(-1.5, 0.9), rng.uniform(e0, 1)
        )
        stiffness, gravity = rng.uniform(0, 4), rng.uniform(1, 20)
        force = zivi.LinearForce(stiffness=stiffness, damping=rng.uniform(0, 0.2), gravity=gravity)
        method = zivi.SwitchedRK(rtol=1e-10, atol=1e-12, max_steps=20_000)
        y0 = rng.uniform(0, 2), rng.uniform(-3, 3)
        sol = zivi.simulate(zivi.ImpactSystem(force, e=law), (0, 5), y0, method)
        energy = 0.5 * sol.xdot**2 + 0.5 * stiffness * sol.x**2 + gravity * sol.x
        assert np.all(np.diff(energy) <= 1e-9 * energy[0]), (law, force)
        impacts = sol.impacts
        expected = law.after(-impacts["xdot_before"])
        assert np.allclose(impacts["xdot_after"], expected, rtol=1e-14, atol=1e-150)


def test_without_an_exponent_the_law_is_newtons():
    for e in (0.0, 0.4, 0.97, 1.0):
        power = zivi.SpeedDependentImpact(e0=e, v0=3.0, k=0.0)
        runs = [
            zivi.simulate(zivi.ImpactSystem(-G, e=law), (0, 5), (1, 0))
            for law in (e, zivi.NewtonImpact(e), power)
        ]
        for run in runs[1:]:
            assert np.array_equal(run.t, runs[0].t)
            assert np.array_equal(run.xdot, runs[0].xdot)
            assert run.rest_time == runs[0].rest_time
        assert np.array_equal(runs[1].transformed.v, runs[0].transformed.v)


def test_samples_have_the_transform_without_loss():
    sol = zivi.simulate(zivi.ImpactSystem(-G, e=PLASTIC), (0, 3), (1, 0))
    x, xdot = zivi.project(sol.transformed.s, sol.transformed.v, kappa=0.0)
    assert np.array_equal(x, sol.x)
    assert np.array_equal(np.abs(xdot), np.abs(sol.xdot))
    assert np.array_equal(np.abs(sol.transformed.v), np.abs(sol.xdot))


DIFFERENCED = ("x0", "xdot0", "gravity", "law.e0", "law.v0", "law.k", "law.e_max")


@pytest.mark.parametrize(
    ("law", "until"),
    [(PLASTIC, 2.5), (CAPPED, 2.5), (FALLING, 2.5), (CAPPED, 5.0), (FALLING, 5.5)],
    ids=["plastic", "capped", "falling", "capped to rest", "falling to rest"],
)
def test_derivatives_are_differences(law, until):
    def run(moved, step):
        values = {"x0": 1.0, "xdot0": 0.2, "gravity": G}
        changed = law
        if moved.startswith("law."):
            name = moved.removeprefix("law.")
            changed = dataclasses.replace(law, **{name: getattr(law, name) + step})
        elif moved:
            values[moved] += step
        system = zivi.ImpactSystem(zivi.LinearForce(gravity=values["gravity"]), e=changed)
        return zivi.simulate(system, (0, until), (values["x0"], values["xdot0"]), TIGHT)

    names = [name for name in DIFFERENCED if not (name == "law.e_max" and law.e_max == 1.0)]
    system = zivi.ImpactSystem(zivi.LinearForce(gravity=G), e=law)
    found = zivi.sensitivity(system, (0, until), (1.0, 0.2), names, TIGHT)
    sol = found.trajectory
    n = min(len(found.impacts), 12)
    for column, name in enumerate(names):
        h = 1e-6
        above, below = run(name, h), run(name, -h)
        for of, rates in (("t", "dt"), ("xdot_after", "du")):
            difference = (above.impacts[of][:n] - below.impacts[of][:n]) / (2 * h)
            assert np.allclose(found.impacts[rates][:n, column], difference, rtol=2e-6, atol=2e-7)
        if sol.rest_time is None:
            final = [(above.x[-1] - below.x[-1]), (above.xdot[-1] - below.xdot[-1])]
            assert np.allclose(found.final[:, column], np.array(final) / (2 * h), 2e-6, 1e-6)
        else:
            difference = (above.rest_time - below.rest_time) / (2 * h)
            assert found.zeno_times[0, column] == pytest.approx(difference, rel=1e-5, abs=1e-6)


def test_a_batch_of_laws_is_its_runs():
    laws = [0.5, PLASTIC, CAPPED, FALLING, zivi.NewtonImpact(0.8)]
    systems = [zivi.ImpactSystem(-G, e=law) for law in laws]
    batch = zivi.simulate_batch(systems, (0, 6), np.tile((1.0, 0.0), (5, 1)), save="events")
    for i, system in enumerate(systems):
        sol = zivi.simulate(system, (0, 6), (1, 0))
        assert (batch.x[i], batch.xdot[i]) == (sol.x[-1], sol.xdot[-1])
        assert np.array_equal(batch.events[i]["impacts"], sol.impacts)
    one = zivi.simulate_batch(systems[1], (0, 6), [(1, 0), (2, 0)])
    assert one.x[0] == batch.x[1]


def test_impacts_at_one_time_end_a_run():
    # speeds fall to 1e-60 m/s, where no flight can be told from its ends
    law = zivi.SpeedDependentImpact(e0=1e-3, v0=1.0, k=0.05)
    sol = zivi.simulate(zivi.ImpactSystem(-G, e=law), (0, 3), (1, 0))
    assert sol.status is zivi.Status.ZENO_BUDGET
    assert sol.rest_time is None
    assert len(sol.impacts) < 20
    # to 1e-10 m/s: flights of 2e-11 s
    law = zivi.SpeedDependentImpact(e0=0.1, v0=1.0, k=0.1)
    method = zivi.SwitchedRK(max_steps=5000)
    sol = zivi.simulate(zivi.ImpactSystem(-G, e=law), (0, 3), (1, 0), method)
    assert sol.status is zivi.Status.STEP_BUDGET


@pytest.mark.parametrize(
    ("name", "values"),
    [
        ("e0", (1.2, 1.0, 0.2)),
        ("e0", (-0.1, 1.0, 0.2)),
        ("e0", (math.nan, 1.0, 0.2)),
        ("v0", (0.5, 0.0, 0.2)),
        ("v0", (0.5, math.inf, 0.2)),
        ("k", (0.5, 1.0, 1.0)),
        ("k", (0.5, 1.0, -math.inf)),
        ("e_max", (0.5, 1.0, 0.2, 0.4)),
        ("e_max", (0.5, 1.0, 0.2, 1.1)),
    ],
)
def test_what_is_out_of_range_is_named(name, values):
    with pytest.raises(ValueError, match=f"^{name} must be"):
        zivi.SpeedDependentImpact(*values)


def test_laws_of_other_kinds_are_refused():
    with pytest.raises(ValueError, match=r"^e must be"):
        zivi.NewtonImpact(1.1)
    with pytest.raises(ValueError, match='no impact law "ImpactLaw"'):
        zivi.ImpactLaw()
    with pytest.raises(TypeError, match=r"^e must be"):
        zivi.ImpactSystem(-G, e=zivi.SpeedDependentImpact)
    with pytest.raises(ValueError, match="exactly one of e and kappa"):
        zivi.ImpactSystem(-G, e=PLASTIC, kappa=0.3)
    with pytest.raises(ValueError, match=r"^v must be"):
        PLASTIC.after([-1.0])


REFUSING = {
    "ThetaGamma": lambda it: zivi.simulate(it, (0, 1), (1, 0), zivi.ThetaGamma(h=1e-2)),
    "MoreauJean": lambda it: zivi.simulate(it, (0, 1), (1, 0), zivi.MoreauJean(h=1e-2)),
    "ExplicitEuler": lambda it: zivi.simulate(it, (0, 1), (1, 0), zivi.ExplicitEuler(h=1e-2)),
    "batch": lambda it: zivi.simulate_batch(it, (0, 1), (1, 0), method=zivi.ThetaGamma(h=1e-2)),
    "closed_loop": lambda it: zivi.simulate_closed_loop(
        it, zivi.TwistingRegulator(40.0, 20.0, h=1e-2, e=0.5), (0, 1), (1, 0)
    ),
    "closed_loop_of_the_plants_wall": lambda it: zivi.simulate_closed_loop(
        it, zivi.TwistingRegulator(40.0, 20.0, h=1e-2), (0, 1), (1, 0)
    ),
    "loop_batch": lambda it: zivi.simulate_closed_loop_batch(
        it, zivi.TwistingRegulator(40.0, 20.0, h=1e-2, e=0.5), (0, 1), (1, 0)
    ),
    "impact_map": lambda it: zivi.impact_map(it),
    "orbit": lambda it: zivi.periodic_orbit(it, (0.0, (0.1, 1.0))),
    "basins": lambda it: zivi.basins(it, np.linspace(0, 1, 3), np.linspace(0, 1, 3)),
    "lyapunov": lambda it: zivi.lyapunov_exponents(it, (0, 1), (1, 0)),
    "diagram": lambda it: zivi.bifurcation_diagram(it, "omega", [1.0, 2.0]),
    "e": lambda it: it.e,
    "kappa": lambda it: it.kappa,
}


@pytest.mark.parametrize("name", REFUSING)
def test_what_needs_newtons_law_says_so(name):
    force = zivi.LinearForce(gravity=G, amplitude=3.0, omega=5.0)
    if name == "batch":
        force = -G
    with pytest.raises(ValueError, match=r"e .*must be a number.*Newton's impact law"):
        REFUSING[name](zivi.ImpactSystem(force, e=PLASTIC))


def test_parameters_of_a_law_have_their_names():
    system = zivi.ImpactSystem(-G, e=PLASTIC)
    with pytest.raises(ValueError, match=r"unknown parameter 'e'; .*law\.e0, law\.v0, law\.k"):
        zivi.sensitivity(system, (0, 1), (1, 0), wrt=("e",))


def test_a_law_is_kept_in_what_keeps_a_system():
    system = zivi.ImpactSystem(-G, e=CAPPED)
    again = pickle.loads(pickle.dumps(system))
    assert again.law == CAPPED
    assert repr(again) == repr(system)
    assert repr(system) == f"ImpactSystem(force=-9.81, e={CAPPED!r})"
    assert zivi.ImpactSystem(-G, kappa=0.5).law == zivi.NewtonImpact(1 / 3)
    twin = zivi.ImpactSystem(-G, e=copy.copy(CAPPED))
    other = zivi.ImpactSystem(-G, e=PLASTIC)
    newton = [zivi.ImpactSystem(-G, e=e) for e in (0.5, zivi.NewtonImpact(0.5))]
    assert digest(system) == digest(twin) == digest(again) != digest(other)
    assert digest(newton[0]) == digest(newton[1]) != digest(other)
    _ = CAPPED.limit  # what the core made of it is no part of it
    assert digest(CAPPED) == digest(zivi.SpeedDependentImpact(0.7, 2.0, 0.2, 0.9))


def test_results_tell_their_law(tmp_path):
    sol = zivi.simulate(zivi.ImpactSystem(-G, e=CAPPED), (0, 6), (1, 0))
    law = {"name": "SpeedDependentImpact", "e0": 0.7, "v0": 2.0, "k": 0.2, "e_max": 0.9}
    assert sol.config["e"] == law
    assert sol.config["kappa"] is None
    assert json.loads(sol.to_xarray().attrs["config"])["e"] == law
    again = pickle.loads(pickle.dumps(sol))
    assert np.array_equal(again(1.234)[0], sol(1.234)[0])
    path = tmp_path / "run.nc"
    zivi.files.save(sol, path)
    stored = zivi.files.load(path)
    assert np.array_equal(stored.x, sol.x)
    assert stored(1.234)[0] == sol(1.234)[0]
    assert np.array_equal(stored.impacts_down_to(1e-3), sol.impacts_down_to(1e-3))


def test_every_law_of_the_core_has_a_class():
    assert set(impact_law.LAWS) == {*_zivi.IMPACT_LAWS, "RestitutionTable"}
    assert impact_law.LAWS["SpeedDependentImpact"] is zivi.SpeedDependentImpact
    # one that only the core knows gets its class of its parameters
    made = law_class("SpeedDependentImpact")
    law = made(e0=0.5, v0=1.0, k=0.25)
    assert law.e_max == 1.0
    assert law.after([2.0]) == PLASTIC.after([2.0])
    with pytest.raises(ValueError, match=r"^v0 must be"):
        made(0.5, -1.0, 0.25)
    for name, parameters in _zivi.IMPACT_LAWS.items():
        fields = list(impact_law.LAWS[name].__dataclass_fields__)
        assert fields == [it.name for it in parameters]


FILE = """
t_span = [0, 6]
y0 = [1, 0]

[system]
force = -9.81
e = {law}
"""


def run_file(path):
    return prepare_simulate(path).run(False)


def test_a_file_gives_a_law(tmp_path):
    def written(law):
        path = tmp_path / "run.toml"
        path.write_text(FILE.format(law=law))
        return path

    law = '{ law = "SpeedDependentImpact", e0 = 0.7, v0 = 2.0, k = 0.2, e_max = 0.9 }'
    sol = run_file(written(law))
    same = zivi.simulate(zivi.ImpactSystem(-G, e=CAPPED), (0, 6), (1, 0))
    assert sol.rest_time == same.rest_time
    for law, told in [
        ('{ law = "SpeedDependentImpact", e0 = 0.7, v0 = 2.0 }', r"system\.e\.k is missing"),
        ('{ law = "SpeedDependentImpact", e0 = 0.7, v0 = 0, k = 0.2 }', r"system\.e\.v0 must be"),
        (
            '{ law = "SpeedDependentImpact", e0 = 0.7, v0 = 1, k = 0.2, e_max = 0.6 }',
            r"system\.e\.e_max must be a number from e0 to 1",
        ),
        ('{ law = "Hertz" }', r"system\.e\.law must be one of"),
    ]:
        with pytest.raises(FileError, match=told):
            run_file(written(law))


LOOP = """
t_span = [0, 1]
y0 = [1, 0]

[system]
force = -9.81
e = { law = "SpeedDependentImpact", e0 = 0.7, v0 = 2.0, k = 0.2 }

[controller]
name = "TwistingRegulator"
mu1 = 40
mu2 = 20
h = 0.01
"""


@pytest.mark.parametrize("own", ["", "e = 0.5\n"], ids=["e of the plant", "e of its own"])
def test_a_file_of_a_loop_refuses_a_law(tmp_path, own):
    path = tmp_path / "loop.toml"
    path.write_text(LOOP + own)
    with pytest.raises(FileError, match=r"system\.e must be a finite number"):
        prepare_control(path).run(False)
