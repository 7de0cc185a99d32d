"""Implicit Euler follows every reference trajectory at first order, with all of its events.

Vibrating tables, a ball with drag, oscillators that rattle to rest and leave it, and periodic
orbits of twenty impacts. All have e > 0 and a linear force, so none is left out.
"""

import dataclasses
import functools

import numpy as np
import pytest

from references import REFERENCES, follow
from scheme import fitted_order, jittered

RUNS = 7
# the oscillators are smooth enough for first order from h = 1e-2 on; the others have a sample
# within 0.01 s of an impact, on the other side of which the coarsest step would be
STEPS = {name: (1e-2, 1e-3, 1e-4) for name in REFERENCES if name.startswith("O")}
SMALL_STEPS = (1e-3, 1e-4, 1e-5)
RESTING = [name for name, case in REFERENCES.items() if case["zeno"]]
LEAVING = [name for name, case in REFERENCES.items() if case["lift"]]
PERIODIC = [name for name, case in REFERENCES.items() if not case["impacts"]]


@dataclasses.dataclass
class Summary:
    """What is looked at of one run (a run of a million steps is not kept)."""

    h: float
    states: dict
    impacts: np.ndarray
    zeno_times: np.ndarray
    liftoff_times: np.ndarray
    resting: bool


class Family:
    """Runs of one case with jittered step sizes about each of three."""

    def __init__(self, name):
        self.case = case = REFERENCES[name]
        self.steps = STEPS.get(name, SMALL_STEPS)
        self.samples = {float(t): tuple(state) for t, state in case["samples"].items()}
        self.samples[case["t_end"]] = (case["x_end"], case["xdot_end"])
        self.runs = [[self.summary(h) for h in jittered(middle, RUNS)] for middle in self.steps]

    def summary(self, h):
        sol = follow(self.case, h)
        assert sol.success, sol.message
        states = {t: tuple(sol(t).tolist()) for t in self.samples}
        resting = sol.rest_time is not None and sol.rest_time == sol.zeno_times[-1]
        return Summary(h, states, sol.resolved_impacts, sol.zeno_times, sol.liftoff_times, resting)

    def rms(self, error):
        """Root mean square of `error(run)` for each step size."""
        return [np.sqrt(np.mean([error(run) ** 2 for run in row])) for row in self.runs]

    def worst(self, error):
        """Largest `error(run) / h` for each step size."""
        return [max(np.max(error(run)) / run.h for run in row) for row in self.runs]

    def all(self):
        return [run for row in self.runs for run in row]


family = functools.cache(Family)


@pytest.mark.slow
@pytest.mark.parametrize("name", REFERENCES)
def test_distance_and_velocity_are_first_order(name):
    """Fitted over two decades: 0.8 allows for the scatter of the runs behind up to 20 impacts.

    Samples nearer to the wall than 0.01 m, where an impact may be on its other side, are left out.
    """
    runs = family(name)
    flying = {t: state for t, state in runs.samples.items() if state[0] > 1e-2}
    assert flying or runs.case["at_rest_at_end"]
    for t, (x, xdot) in flying.items():
        distance = runs.rms(lambda run, t=t, x=x: run.states[t][0] - x)
        velocity = runs.rms(lambda run, t=t, xdot=xdot: run.states[t][1] - xdot)
        assert distance[-1] < 1e-3 * (1 + x)
        assert velocity[-1] < 2e-3 * (1 + abs(xdot))
        assert fitted_order(runs.steps, distance) > 0.8, (t, distance)
        assert fitted_order(runs.steps, velocity) > 0.8, (t, velocity)


@pytest.mark.parametrize("name", REFERENCES)
def test_rest_where_the_reference_rests(name):
    runs = family(name)
    for run in runs.all():
        assert run.resting == runs.case["at_rest_at_end"]
        for t, state in runs.samples.items():
            assert state != (0.0, 0.0) or run.states[t] == (0.0, 0.0)


@pytest.mark.parametrize("name", REFERENCES)
def test_first_impacts(name):
    """Times of the first three to O(h), and the speeds after them to first order."""
    runs = family(name)
    for n, (t, after) in enumerate(runs.case["impacts"][:3]):
        assert max(runs.worst(lambda run, n=n, t=t: abs(run.impacts["t"][n] - t))) < 15
        errors = runs.rms(lambda run, n=n, after=after: run.impacts["xdot_after"][n] - after)
        assert fitted_order(runs.steps, errors) > 0.8


@pytest.mark.parametrize("name", RESTING)
def test_every_zeno_point_is_reported(name):
    """Times within C h log10(1/h), C measured, and an apparent order between 0.65 and 0.95."""
    runs, expected = family(name), np.array(REFERENCES[name]["zeno"])
    assert all(run.zeno_times.shape == expected.shape for run in runs.all())
    worst = np.array(runs.worst(lambda run: np.abs(run.zeno_times - expected)))
    assert np.all(worst < 35 * np.log10(1 / np.array(runs.steps)))
    assert 0.65 < fitted_order(runs.steps, worst * runs.steps) < 0.95


@pytest.mark.parametrize("name", LEAVING)
def test_every_lift_off_is_reported_within_a_step(name):
    runs, expected = family(name), np.array(REFERENCES[name]["lift"])
    assert all(run.liftoff_times.shape == expected.shape for run in runs.all())
    assert max(runs.worst(lambda run: np.abs(run.liftoff_times - expected))) < 1.01


@pytest.mark.parametrize("name", PERIODIC)
def test_periodic_orbits_keep_their_impacts(name):
    """Twenty impacts at equal intervals; both orbits are stable, so errors do not pile up."""
    runs, case = family(name), REFERENCES[name]
    # one impact in one period (O4) or in two (O5) of the excitation
    per_impact = 2 if name.startswith("O5") else 1
    flight = per_impact * 2 * np.pi / case["force"]["omega"]
    for run in runs.all():
        assert len(run.impacts) == case["n_impacts"]
        assert run.zeno_times.size == run.liftoff_times.size == 0
    spread = runs.worst(lambda run: np.abs(np.diff(run.impacts["t"])[-5:] - flight))
    assert max(spread) < 5


def test_a_resting_branch_would_be_seen():
    """Negative control: under a heavier gravity the table's ball rests where it must leave."""
    case = REFERENCES["T1_tab_G1.5"]
    heavy = case | {"force": case["force"] | {"gravity": 15.0}}
    assert follow(case, 1e-3).liftoff_times.size == 9
    assert follow(heavy, 1e-3).liftoff_times.size == 0
