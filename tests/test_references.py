"""Implicit Euler follows every reference trajectory at first order, with all of its events.

Vibrating tables, a ball with drag, oscillators that rattle to rest and leave it, and periodic
orbits of twenty impacts. All have e > 0 and a linear force, so none is left out.
"""

import numpy as np
import pytest
from references import REFERENCES, follow
from scheme import fitted_order, jittered

RUNS = 5
# the oscillators are smooth enough for first order from h = 1e-2 on; the others have a sample
# within 0.01 s of an impact, which the coarsest step would miss
STEPS = {name: (1e-2, 1e-3, 1e-4) for name in REFERENCES if name.startswith("O")}
SMALL_STEPS = (1e-3, 1e-4, 1e-5)
RESTING = [name for name, case in REFERENCES.items() if case["zeno"]]
LEAVING = [name for name, case in REFERENCES.items() if case["lift"]]
PERIODIC = [name for name, case in REFERENCES.items() if not case["impacts"]]


class Family:
    """Runs of one case with jittered step sizes about each of three."""

    def __init__(self, name):
        self.case = REFERENCES[name]
        self.steps = STEPS.get(name, SMALL_STEPS)
        self.jittered = [jittered(h, RUNS) for h in self.steps]
        self.runs = [[follow(self.case, h) for h in row] for row in self.jittered]

    def rms(self, error):
        """Root mean square of `error(run)` for each step size."""
        return [np.sqrt(np.mean([error(sol) ** 2 for sol in row])) for row in self.runs]

    def worst(self, error):
        """Largest `error(run) / h` for each step size."""
        return [
            max(np.max(error(sol)) / h for sol, h in zip(row, steps, strict=True))
            for row, steps in zip(self.runs, self.jittered, strict=True)
        ]

    def all(self):
        return [sol for row in self.runs for sol in row]


@pytest.fixture(scope="module", params=REFERENCES)
def family(request):
    return request.param, Family(request.param)


def test_distance_and_velocity_are_first_order(family):
    """Fitted over two decades: 0.8 allows for the scatter of five runs behind ten impacts or more.

    Samples nearer to the wall than 0.01 m, where an impact may be on its other side, are left out.
    """
    name, runs = family
    assert all(sol.success for sol in runs.all())
    samples = {float(t): state for t, state in runs.case["samples"].items()}
    samples[runs.case["t_end"]] = (runs.case["x_end"], runs.case["xdot_end"])
    fitted = 0
    for t, (x, xdot) in samples.items():
        if x > 1e-2:
            errors = runs.rms(lambda sol, t=t, x=x: sol(t)[0] - x)
            assert errors[-1] < 1e-3 * (1 + x)
            assert fitted_order(runs.steps, errors) > 0.8, (name, t, errors)
            errors = runs.rms(lambda sol, t=t, xdot=xdot: sol(t)[1] - xdot)
            assert fitted_order(runs.steps, errors) > 0.8, (name, t, errors)
            fitted += 1
    assert fitted or runs.case["at_rest_at_end"]


def test_rest_where_the_reference_rests(family):
    _, runs = family
    resting = [float(t) for t, state in runs.case["samples"].items() if state == [0.0, 0.0]]
    for sol in runs.all():
        assert (sol.rest_time is not None) == runs.case["at_rest_at_end"]
        if runs.case["at_rest_at_end"]:
            assert sol.x[-1] == sol.xdot[-1] == sol.s[-1] == sol.v[-1] == 0.0
        for t in resting:
            assert not sol(t).any()


def test_first_impacts(family):
    """Times of the first three to O(h), and the speeds after them to first order."""
    _, runs = family
    for n, (t, after) in enumerate(runs.case["impacts"][:3]):
        assert max(runs.worst(lambda sol, n=n, t=t: abs(sol.impacts["t"][n] - t))) < 20
        errors = runs.rms(lambda sol, n=n, after=after: sol.impacts["xdot_after"][n] - after)
        assert fitted_order(runs.steps, errors) > 0.8


@pytest.mark.parametrize("name", RESTING)
def test_every_zeno_point_is_reported(name):
    """Times within C h log10(1/h), C measured, and an apparent order between 0.65 and 0.95."""
    runs, expected = Family(name), np.array(REFERENCES[name]["zeno"])
    assert all(sol.zeno_times.shape == expected.shape for sol in runs.all())
    worst = np.array(runs.worst(lambda sol: np.abs(sol.zeno_times - expected)))
    assert np.all(worst < 35 * np.log10(1 / np.array(runs.steps)))
    assert 0.65 < fitted_order(runs.steps, worst * runs.steps) < 1.05


@pytest.mark.parametrize("name", LEAVING)
def test_every_lift_off_is_reported_within_a_step(name):
    runs, expected = Family(name), np.array(REFERENCES[name]["lift"])
    assert all(sol.liftoff_times.shape == expected.shape for sol in runs.all())
    assert max(runs.worst(lambda sol: np.abs(sol.liftoff_times - expected))) < 1.01


@pytest.mark.parametrize("name", PERIODIC)
def test_periodic_orbits_keep_their_impacts(name):
    """Twenty impacts at equal intervals; both orbits are stable, so errors do not pile up."""
    runs, case = Family(name), REFERENCES[name]
    # one impact in one period (O4) or in two (O5) of the excitation
    per_impact = 2 if name.startswith("O5") else 1
    flight = per_impact * 2 * np.pi / case["force"]["omega"]
    for sol in runs.all():
        assert len(sol.impacts) == case["n_impacts"]
        assert sol.zeno_times.size == sol.liftoff_times.size == 0
    spread = runs.worst(lambda sol: np.abs(np.diff(sol.impacts["t"])[-5:] - flight))
    assert max(spread) < 5


def test_a_resting_branch_would_be_seen():
    """Negative control: under a heavier gravity the table's ball rests where it must leave."""
    case = REFERENCES["T1_tab_G1.5"]
    heavy = case | {"force": case["force"] | {"gravity": 15.0}}
    assert follow(case, 1e-3).liftoff_times.size == 9
    assert follow(heavy, 1e-3).liftoff_times.size == 0
