"""Random runs: what must not change them, and the equations that they must obey.

``ZIVI_METAMORPHIC_RUNS=5000 pytest tests/test_metamorphic.py`` is the campaign.
"""

import os
from dataclasses import replace

import numpy as np
import pytest

import contact_patterns
import friction_draws as draws
import metamorphic as m
import motion_oracle
import zivi

RUNS = int(os.environ.get("ZIVI_METAMORPHIC_RUNS", "200"))
SEED = int(os.environ.get("ZIVI_METAMORPHIC_SEED", "1"))


@pytest.mark.slow
@pytest.mark.parametrize("name", m.FAMILIES)
def test_units_coordinates_and_spans_do_not_change_a_motion(name):
    """Also no representation; of all runs at most 2 in 100 hang on 1e-8 of their start."""
    wrong, unsteady = m.campaign(name, runs_of(name), SEED)
    assert not wrong, "\n".join(map(str, wrong))
    assert len(unsteady) <= runs_of(name) / 50, "\n".join(map(str, unsteady))


CORNERS = {
    "accumulation within a flight": (9, 54),
    "feet that slide with a friction each": (21, 299),
    "undetermined impact": (21, 256),
    "a foot between others that hits with them": (21, 80),
    "a foot that takes a part of the impulse of others": (21, 95),
    "feet that meet a wall together, or one after the other by rounding": (77, 131),
    "the same, with a load that is shared": (77, 1003),
}


@pytest.mark.parametrize("what", CORNERS)
def test_rounding_of_the_coordinates_decides_nothing_in_a_corner(what):
    it = m.case("corners", *CORNERS[what])
    assert it.holds, str(it)


def test_a_wall_that_is_left_like_the_square_of_a_small_speed_stops_no_block():
    """It rocks on two feet, from which a wall at the lower corner parts by second order only."""
    it = m.case("corners", 21, 558)
    runs = m.simulate(it.model), m.simulate(it.other)
    assert [run.status for run in runs] == ["COMPLETED"] * 2
    assert it.verdict.state < m.ALLOWED


RELATED = {
    "a joint sticks where a tail that turns its slip ends, followed or not": ("friction", 91, 991),
    "a joint takes over what a gap would have to pull, in any coordinates": ("friction", 91, 133),
    "a moving wall touches at the start, but for rounding of a late time": ("friction", 91, 379),
    "impacts below the absolute tolerance that no impulses return": ("friction", 91, 2699),
    "samples within a tail, in units in which all speeds are small": ("friction", 91, 4090),
}


@pytest.mark.parametrize("what", RELATED)
def test_rounding_of_times_coordinates_and_units_decides_nothing(what):
    it = m.case(*RELATED[what])
    assert it.holds, str(it)


def test_samples_within_a_tail_whose_joint_slips_on_follow_its_bounces():
    """The belt of the joint is faster than the bounces."""
    it = m.case("friction", 92, 1828)
    assert it.verdict.state < m.ALLOWED, str(it)


FRICTION = {
    "a belt at a wall that the mass rests against": (77, 390),
    "the same, with tangential restitution": (77, 838),
    "a slip that turns within an accumulation": (77, 539),
    "elastic impacts from which a joint takes energy": (77, 514),
    "elastic impacts whose contact sticks": (77, 228),
    "a joint that turns between impacts": (77, 819),
    "impacts that turn the slip round": (78, 793),
    "a joint that holds what the gap does not press": (78, 52),
    "two opposite gaps and a joint": (78, 97),
    "a joint that holds a mass at a wall": (78, 729),
    "an accumulation of accumulations that friction makes": (77, 992),
    "a gap that comes to rest within each flight of another": (78, 477),
    "elastic impacts that are slower than all tolerances": (78, 751),
    "a joint along the normal of a gap, at its limit": (78, 828),
    "impacts at one instant, next to moving belts": (78, 995),
    "a slip on a shaking belt in an accumulation by Poisson's law": (81, 542),
    "a joint and a gap that give way together": (84, 661),
    "a load that goes from one wall to the opposite one": (82, 787),
}


@pytest.mark.parametrize("what", FRICTION)
def test_accumulations_with_friction_end_as_the_laws_ask(what):
    seed, index = FRICTION[what]
    rng = np.random.default_rng([seed, index, *b"friction"])
    model = m.FAMILIES["friction"].draw(rng)
    assert m.simulate(model).status == "COMPLETED"
    assert not faults_of_run(model, rng)


def test_a_slip_turns_within_an_accumulation():
    """It comes to rest where all impacts, each followed in closed form, lead."""
    model = m.FAMILIES["friction"].draw(np.random.default_rng([77, 539, *b"friction"]))
    (sol,) = m.simulate(model).parts
    assert sol.q[-1] == pytest.approx([0.0774726228917162, 0.1664634471038962], abs=1e-9)
    assert sol.zeno["t"] == pytest.approx([0.52660353383949], abs=1e-9)


ENDS = {
    "INCONSISTENT_CONTACT": [(77, 117), (79, 965), (82, 6)],
    "INDETERMINATE_CONTACT": [(77, 695), (79, 292), (79, 439)],
    "INCONSISTENT_IMPACT": [(77, 829), (78, 994), (79, 65)],
    "CONTACT_NOT_SOLVED": [(79, 720), (81, 702)],
    "refused": [(80, 207)],
}


@pytest.mark.parametrize(("status", "run"), [(it, run) for it in ENDS for run in ENDS[it]])
def test_a_run_ends_where_no_motion_or_more_than_one_obeys_the_laws(status, run):
    """Linear programs over all patterns find none, or several."""
    found, verdict = contact_patterns.early(*run)
    assert found == status
    assert verdict.startswith("honest"), verdict


def test_runs_of_a_campaign_end_early_only_where_the_laws_ask():
    found = [contact_patterns.early(85, index) for index in range(RUNS // 2)]
    verdicts = [it[1] for it in found if it]
    assert all(it.startswith("honest") for it in verdicts), verdicts


def test_an_end_that_the_laws_do_not_ask_for_is_noticed():
    """A run is cut off within its motion, and called inconsistent."""
    model = m.FAMILIES["friction"].draw(np.random.default_rng([82, 787, *b"friction"]))
    system, half = model.system(), (0.0, 0.3)
    sol = zivi.simulate(system, half, model.start(), zivi.SwitchedRK(rtol=m.TOL, atol=m.TOL))
    for status in ("INCONSISTENT_CONTACT", "INDETERMINATE_CONTACT", "STEP_SIZE_TOO_SMALL"):
        vars(sol)["status"] = zivi.Status[status]
        assert contact_patterns.judge(model, sol) == "fault: one motion"


def test_the_message_tells_whether_a_prestress_decides():
    model = m.FAMILIES["friction"].draw(np.random.default_rng([79, 292, *b"friction"]))
    (sol,) = m.simulate(model).parts
    assert "prestress" in sol.message
    assert "Painlev" not in sol.message


def test_the_message_has_the_slip_after_an_impact_from_which_no_motion_goes_on():
    """The slip turns in the impact, and jams: ``K = N M^-1 (N - mu B)`` is negative."""
    model = m.FAMILIES["friction"].draw(np.random.default_rng([82, 6, *b"friction"]))
    (sol,) = m.simulate(model).parts
    (hit,) = sol.impacts
    assert hit["slip_before"] < 0 < hit["slip_after"]
    assert f"slides with {hit['slip_after']:.6g}, K = -1.03023" in sol.message


def test_an_impact_elsewhere_does_not_stop_a_rod_between_walls():
    """Both walls could press against each other, and hold it; those that are not hit do not."""
    it = m.case("friction", 82, 787)
    assert it.holds, str(it)


def test_elastic_impacts_that_nothing_slows_down_use_up_the_steps():
    """11,000 bounces of 1.8e-6 m/s fit into what is left of the span: more steps complete it."""
    model = m.FAMILIES["friction"].draw(np.random.default_rng([78, 572, *b"friction"]))
    (sol,) = m.simulate(model).parts
    assert sol.status.name == "STEP_BUDGET"
    hits = sol.impacts[sol.impacts["gap"] == 1][-100:]
    assert hits["speed_after"] == pytest.approx(-hits["speed_before"], rel=1e-12)
    assert (hits["speed_after"] > 1e-6).all()
    left = (model.span[1] - sol.t[-1]) / np.diff(hits["t"]).mean()
    assert 1e4 < left < 1e5


def test_impacts_at_one_instant_that_do_not_end_are_told():
    """Two gaps are hit in turn, and the belt of one gives back what the other takes."""
    model = m.FAMILIES["friction"].draw(np.random.default_rng([79, 720, *b"friction"]))
    (sol,) = m.simulate(model).parts
    assert sol.status.name == "CONTACT_NOT_SOLVED"
    assert "impacts at one instant do not end" in sol.message
    for gap in (0, 1):
        speeds = sol.impacts["speed_before"][sol.impacts["gap"] == gap][-40:]
        assert speeds == pytest.approx(speeds[0], rel=1e-12)
        assert speeds[0] < -0.1


def test_accumulations_of_corners_end_at_rest():
    """Each ends in a corner, from which the block slides to the wall: 25 of them in 1e-15 s."""
    rng = np.random.default_rng([77, 994, *b"corners"])
    model = m.FAMILIES["corners"].draw(rng)
    (sol,) = m.simulate(model).parts
    assert sol.success
    last = sol.corners["t"][-1]
    assert (sol.corners["t"] > last - 1e-12).sum() >= 3
    after = sol.t >= last
    assert np.abs(sol.qdot[after]).max() < 1e-9
    assert not faults_of_run(model, rng)


def test_an_impact_of_five_gaps_is_solved_where_it_has_a_solution():
    """A block falls back onto four feet of different friction in a corner, and stays there."""
    model = m.FAMILIES["corners"].draw(np.random.default_rng([77, 30, *b"corners"]))
    (sol,) = m.simulate(model).parts
    assert sol.success
    assert np.abs(sol.qdot[sol.t > 0.12]).max() < 1e-12
    assert sol.contacts[-1].all()


def runs_of(name):
    parts = {"guides": 5, "corners": 10, "loops": 2, "mechanical_loops": 2}
    return RUNS // parts.get(name, 1)


def energy_of(model):
    """Give the energy of a system that nothing drives, None of others."""
    driven = model.load.any() or any(c.motion for c in model.contacts)
    driven = driven or any(c.belt for c in model.channels if isinstance(c, m.Contact))
    if driven or model.damping.any() or any(j.velocity for j in model.joints):
        return None
    return lambda q, v: v @ model.mass @ v / 2 - model.force @ q + q @ model.stiffness @ q / 2


def faults_of_run(model, rng):
    """Put a run of a model, or of its loop, back into the equations, up to where it ends."""
    run = m.simulate(model)
    if not run.parts:
        return []
    (sol,), system, more = run.parts, model.system(), {}
    if model.control:
        forces, h = np.reshape(sol.u, (len(sol.t), -1)) @ model.control.matrix.T, model.control.h
        held = lambda t: forces[min(int((t - sol.t[0]) / h), len(forces) - 1)]  # noqa: E731
        more = {"jumps": np.arange(sol.t[0], sol.t[-1], h)}
    if model.kind != "mass":
        if model.control:
            more["push"] = held
        energy = None if model.control else energy_of(model)
        found = motion_oracle.check(system, sol, rng, 100 * m.TOL, energy, model.start(), **more)
        return found.faults
    (c,) = model.contacts

    def force(t, x, v):
        w, dw, ddw = c.motion.wall()(t) if c.motion else (0.0, 0.0, 0.0)
        pushed = held(t)[0] if model.control else 0.0
        return model.pull(t, np.array([x + w]), np.array([v + dw]))[0] - ddw + pushed

    return motion_oracle.check_mass(sol, rng, 100 * m.TOL, force, c.e, **more)


@pytest.mark.slow
@pytest.mark.parametrize("name", m.FAMILIES)
def test_runs_obey_the_equations_of_motion(name):
    """At random times and in all samples: balance, Coulomb, complementarity, energy."""
    faults = []
    for index in range(RUNS // 16 if name == "corners" else RUNS // 4):
        rng = np.random.default_rng([SEED, index, *name.encode()])
        model = m.FAMILIES[name].draw(rng)
        faults += [f"{name} {SEED} {index}: {it}" for it in faults_of_run(model, rng)]
    assert not faults, "\n".join(faults[:20])


@pytest.mark.slow
@pytest.mark.parametrize("family", draws.SYSTEMS)
def test_curved_and_moving_surfaces_obey_the_equations_of_motion(family):
    rng = np.random.default_rng(SEED)
    for _ in range(max(2, RUNS // 100)):
        it = draws.draw(family, rng)
        sol, system = draws.simulate(it, 1e-10), draws.SYSTEMS[family](it.numbers)
        assert sol.success, it
        energy = draws.ENERGIES.get(family)
        if energy and not any(x != 0 for x in draws.WAVES[family](it.numbers)):
            kept = lambda q, v, it=it, energy=energy: energy(it.numbers, q, v)  # noqa: E731
        else:
            kept = None
        found = motion_oracle.check(system, sol, rng, 1e-8, kept, (np.array(it.q), np.array(it.v)))
        assert not found.faults, f"{it}\n" + "\n".join(found.faults[:20])


@pytest.mark.parametrize("what", ["mu", "start", "e"])
def test_what_differs_by_a_millionth_is_noticed(what):
    """Neither test above may pass whatever it is given."""
    seen = 0
    for index in range(10):
        rng = np.random.default_rng([1, index, *b"friction"])
        model = m.FAMILIES["friction"].draw(rng)
        if what == "start":
            other = replace(model, v=model.v + 1e-6)
        elif what == "e":
            other = m.changed_contacts(model, lambda c: replace(c, e=c.e * (1 - 1e-6)))
        else:
            other = m.changed_contacts(
                model,
                lambda c: replace(c, mu=c.mu * (1 - 1e-6)),
                lambda j: replace(j, limit=j.limit * (1 - 1e-6)),
            )
        one, two = m.simulate(model), m.simulate(other)
        if not one.parts:
            continue
        if what == "mu":
            seen += bool(motion_oracle.check(other.system(), one.parts[0], rng, 1e-8).faults)
        else:
            verdict = m.compare(one, two, m.Map.same(model), rng)
            seen += bool(verdict.lists) or verdict.size > m.ALLOWED
    assert seen >= 5
