"""The sparse solver of box VIs on sets of problems, beside the dense one, and with wrong slopes."""

import itertools
import sys
from pathlib import Path

import numpy as np
import pytest
import scipy.sparse as sp

import zivi

sys.path.append(str(Path(__file__).parents[1] / "benchmarks"))
import vi_families
import vi_sparse_published


def test_published_problems_are_solved_as_with_dense_matrices():
    """All of them: ``python benchmarks/vi_sparse_published.py``."""
    count = vi_sparse_published.campaign(vi_sparse_published.PROBLEMS[::5], 0)
    assert count.starts >= 20
    assert count.lost == count.false == 0
    assert 0 < count.wrong < count.starts


@pytest.mark.slow
@pytest.mark.parametrize("name", vi_families.FAMILIES)
def test_families_are_solved_as_often_as_with_dense_matrices(name):
    """All of them: ``python benchmarks/vi_families.py linear_algebra=sparse``."""
    solved, dense = 0, 0
    for p in itertools.islice(vi_families.draws(name, 1), 2):
        with np.errstate(all="ignore"):
            res = vi_families.solved(p, linear_algebra="sparse")
            found = vi_families.residual(p, res.x)
            dense += vi_families.solved(p).success
        solved += res.success
        limit = 1.01 * max(res.tolerance, 1e-9) + vi_families.rounding(p, res.x)
        assert not res.success or found <= limit
    assert solved >= dense


def test_wrong_slopes_are_no_solution():
    rng = np.random.default_rng(1)
    options = {"linear_algebra": "sparse", "restarts": 0, "enumerate_up_to": 0}
    for k in range(6):
        n = int(rng.integers(3, 12))
        A = rng.normal(size=(n, n))
        M, q = A @ A.T / n + 0.1 * np.eye(n), rng.normal(size=n)

        def F(x, M=M, q=q):
            return M @ x + q + np.sinh(x)

        wrong = sp.csr_array(rng.normal(size=(n, n)) * 10.0 ** rng.uniform(-3, 6, (n, 1)))
        res = zivi.solve_vi(
            F, -1, 2, np.full(n, 0.5), jac=lambda x, J=wrong: J, options=options, max_iter=60
        )
        found = np.max(np.abs(np.maximum(res.x - 2, np.minimum(res.x + 1, F(res.x)))))
        assert res.residual == pytest.approx(found, abs=1e-12), k
        assert not res.success or found <= 1e-9
