"""The three ways to find the signs of a step give one trajectory; failures are counted."""

import numpy as np
import pytest

import zivi

TABLE = zivi.LinearForce(gravity=9.81, amplitude=14.715, omega=2 * np.pi, phase=-np.pi / 2)
OSCILLATOR = zivi.LinearForce(stiffness=1.0, damping=0.1, amplitude=1.0, omega=0.6)
RUNS = {
    "ball": (zivi.ImpactSystem(-9.81, kappa=0.41), (0, 3), (1, 6)),
    "table with lift-offs": (zivi.ImpactSystem(TABLE, e=0.5), (0, 3.7), (0.2, 0)),
    "oscillator": (zivi.ImpactSystem(OSCILLATOR, e=0.5), (0, 30), (0.5, 0)),
    "elastic": (zivi.ImpactSystem(-9.81, e=1.0), (0, 2), (1, 0)),
    "nearly plastic": (zivi.ImpactSystem(-9.81, e=1e-3), (0, 2), (1, 0)),
}
OTHERS = {
    "newton": {"solver": "newton"},
    "outer": {"solver": "outer"},
    "one linearisation": {"solver": "outer", "linearisations": 1},
}


@pytest.mark.parametrize("h", [1e-2, 1e-3])
@pytest.mark.parametrize("settings", OTHERS.values(), ids=OTHERS)
@pytest.mark.parametrize("run", RUNS.values(), ids=RUNS)
def test_one_trajectory(run, settings, h):
    exact = zivi.simulate(*run, zivi.ThetaGamma(h))
    other = zivi.simulate(*run, zivi.ThetaGamma(h, **settings))
    assert other.success
    # a step is solved to 1e-12 of its terms; thousands of steps follow one another
    scale = np.abs(exact.transformed.v).max()
    assert np.abs(other.x - exact.x).max() <= 1e-10 * scale
    assert np.abs(other.xdot - exact.xdot).max() <= 1e-8 * scale
    assert other.rest_time == exact.rest_time
    assert len(other.resolved_impacts) == len(exact.resolved_impacts)
    np.testing.assert_array_equal(other.liftoff_times, exact.liftoff_times)
    assert np.nanmax(other.residual) <= 1e-12
    assert len(exact.failed_steps) == 0


def test_rest_is_exact_with_every_solver():
    for settings in OTHERS.values():
        sol = zivi.simulate(*RUNS["ball"], zivi.ThetaGamma(1e-3, **settings))
        at_rest = sol.t >= sol.rest_time
        assert at_rest.any()
        assert not np.any(
            [
                sol.x[at_rest],
                sol.xdot[at_rest],
                sol.transformed.s[at_rest],
                sol.transformed.v[at_rest],
            ]
        )


def test_a_single_linearisation_fails_where_signs_change_and_is_counted():
    sol = zivi.simulate(*RUNS["ball"], zivi.ThetaGamma(1e-3, solver="outer", linearisations=1))
    assert 0 < len(sol.failed_steps) < 50
    # everywhere else it is solved from the last signs: a failed step is one at which they change
    failed = sol.failed_steps
    signs = np.sign(np.stack([sol.transformed.lambda_s, sol.transformed.lambda_v]))
    interior = np.abs(sol.transformed.lambda_s[failed]) < 1
    interior |= np.abs(sol.transformed.lambda_v[failed]) < 1
    changes = np.any(signs[:, failed] != signs[:, failed - 1], axis=0)
    assert np.all(changes | interior)
    assert f"{len(failed)} not solved" in repr(sol)
    assert sol.to_xarray().attrs["n_failed_steps"] == len(failed)


def test_a_step_taken_on_the_patterns_is_counted():
    # pulled off the wall in the apex strip: the selected solution jumps over the root
    force = zivi.LinearForce(stiffness=9.7, gravity=-13.7)
    system, h = zivi.ImpactSystem(force, e=0.26), 0.134
    counts = {}
    for solver in ("exact", "newton", "outer"):
        sol = zivi.simulate(system, (0, h), (0.9887, -0.53), zivi.ThetaGamma(h, solver=solver))
        assert sol.success
        assert sol.transformed.v[-1] == pytest.approx(
            0.852054, abs=1e-6
        )  # by enumeration of the patterns
        counts[solver] = len(sol.failed_steps)
    assert counts == {"exact": 0, "newton": 1, "outer": 1}


def test_iterated_outer_and_inner_do_not_fail_on_the_ball():
    for settings in ({"solver": "newton"}, {"solver": "outer", "linearisations": 20}):
        sol = zivi.simulate(*RUNS["ball"], zivi.ThetaGamma(1e-3, **settings))
        assert len(sol.failed_steps) == 0


@pytest.mark.parametrize(("theta", "gamma"), [(0.5, 0.5), (1.0, 0.5), (0.7, 0.6)])
def test_other_members_of_the_family(theta, gamma):
    run = RUNS["ball"]
    # before the accumulation, where these members chatter
    span = (0, 2.2)
    exact = zivi.simulate(run[0], span, run[2], zivi.ThetaGamma(1e-3, theta, gamma))
    other = zivi.simulate(run[0], span, run[2], zivi.ThetaGamma(1e-3, theta, gamma, "newton"))
    assert np.abs(other.x - exact.x).max() <= 1e-10


@pytest.mark.parametrize(
    ("settings", "error", "words"),
    [
        ({"solver": "path"}, ValueError, "solver must be one of exact, newton, outer"),
        ({"solver": "outer", "linearisations": 0}, ValueError, "linearisations must be from 1"),
        (
            {"solver": "outer", "linearisations": 2.5},
            TypeError,
            "linearisations must be a whole number",
        ),
    ],
)
def test_settings_are_checked(settings, error, words):
    with pytest.raises(error, match=words):
        zivi.ThetaGamma(1e-3, **settings)
