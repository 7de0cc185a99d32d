"""The published problems: every start, and random starts, judged by a residual written anew."""

import numpy as np
import pytest

import zivi
from mcp import BY_NAME, PROBLEMS

SOLVABLE = [problem for problem in PROBLEMS if problem.solvable]

pytestmark = pytest.mark.filterwarnings("ignore::RuntimeWarning")  # overflow in F is part of it


def solve(problem, x0, **options):
    return zivi.solve_vi(
        problem.F,
        problem.lower,
        problem.upper,
        x0,
        jac=problem.jac,
        options=zivi.VIOptions(**options),
    )


def names(problems):
    return [problem.name for problem in problems]


def test_the_set_is_complete():
    assert len(PROBLEMS) == len(BY_NAME) == 51
    assert sum(len(problem.starts) for problem in SOLVABLE) == 129
    assert all(problem.source for problem in PROBLEMS)


@pytest.mark.parametrize("problem", PROBLEMS, ids=names(PROBLEMS))
def test_the_jacobian_is_that_of_the_map(problem):
    step = 1e-6
    for start in problem.starts:
        x = np.clip(start, problem.lower, problem.upper) + 0.013
        if not np.all(np.isfinite(problem.F(x))):
            continue
        columns = [
            (problem.F(x + step * e) - problem.F(x - step * e)) / (2 * step)
            for e in np.eye(problem.n)
        ]
        difference = np.array(columns).T - problem.jac(x)
        assert np.max(np.abs(difference)) <= 1e-5 * (1 + np.max(np.abs(columns)))


@pytest.mark.parametrize("problem", PROBLEMS, ids=names(PROBLEMS))
def test_the_listed_solutions_solve_it(problem):
    for solution in problem.solutions:
        assert problem.residual(solution) <= 1e-3


@pytest.mark.parametrize("problem", SOLVABLE, ids=names(SOLVABLE))
def test_every_start_is_solved(problem):
    for start in problem.starts:
        res = solve(problem, start)
        assert res.success, res.message
        assert problem.residual(res.x) <= 1e-9
        assert res.residual == pytest.approx(problem.residual(res.x), abs=1e-14)
        assert np.all((problem.lower <= res.x) & (res.x <= problem.upper))
        np.testing.assert_allclose(res.F, problem.F(res.x), rtol=0, atol=1e-12)
        assert problem.is_true(res.x), res.x


@pytest.mark.parametrize("problem", SOLVABLE, ids=names(SOLVABLE))
def test_every_start_is_solved_with_differences(problem):
    """Without a Jacobian, F is never called outside the box."""

    def F(x):
        assert np.all((problem.lower <= x) & (x <= problem.upper))
        return problem.F(x)

    # enumeration would follow Newton out of the box
    options = zivi.VIOptions(enumerate_up_to=0 if problem.name != "chung6" else 6)
    map_ = F if problem.name != "chung6" else problem.F
    for start in problem.starts:
        res = zivi.solve_vi(map_, problem.lower, problem.upper, start, options=options)
        assert res.success, res.message
        assert problem.residual(res.x) <= 1e-9


@pytest.mark.parametrize("name", ["nosol_quad", "nosol_lcp"])
def test_no_false_success(name):
    problem = BY_NAME[name]
    for start in problem.starts:
        res = solve(problem, start)
        assert not res.success
        assert res.residual > 0.5


def test_a_solution_at_infinity_can_be_told():
    """exp(-x) has none, but its residual tends to 0: size and convergence ratio show it."""
    problem = BY_NAME["nosol_exp"]
    for start in problem.starts:
        res = solve(problem, start)
        assert res.success
        assert np.max(res.x) > 20
        assert 0.3 < res.convergence_ratio < 0.4  # 1/e a step: linear, not quadratic


def random_starts(seed):
    """Ten for every problem, at distances from 0.1 to 100 of its own starts."""
    rng = np.random.default_rng(seed)
    for problem in SOLVABLE:
        for _ in range(10):
            near = problem.starts[rng.integers(len(problem.starts))]
            spread = 10 ** rng.uniform(-1, 2)
            yield problem, near + spread * rng.uniform(-1, 1, problem.n)


@pytest.mark.parametrize("seed", range(4))
def test_random_starts(seed):
    solved = total = 0
    for problem, x0 in random_starts(seed):
        res = solve(problem, x0)
        residual = problem.residual(res.x)
        assert not res.success or residual <= 1e-9, problem.name
        total += 1
        solved += res.success
    assert total == 480
    assert solved >= 471


OFF = {
    "smoothing": False,
    "semismooth": False,
    "proximal": False,
    "restarts": 0,
    "enumerate_up_to": 0,
}


@pytest.mark.parametrize(
    ("options", "unsolved"),
    [
        ({**OFF, "line_search": False, "descent_steps": False}, ("atan", [20.0])),
        (OFF, ("billups", [0.0])),
        ({"josephy_newton": False, "proximal": False, **OFF, "semismooth": True}, ("hs5", [0, 0])),
        ({"enumerate_up_to": 0}, ("chung6", np.zeros(6))),
        ({**OFF, "memory": 1}, ("hs1", [-2, 1])),
    ],
)
def test_each_fall_back_is_needed_somewhere(options, unsolved):
    """Switched off, the solver fails, and says so; with it the same start is solved."""
    name, x0 = unsolved
    problem = BY_NAME[name]
    without = solve(problem, x0, **options)
    assert not without.success
    assert problem.residual(without.x) > 1e-9
    assert solve(problem, x0).success
