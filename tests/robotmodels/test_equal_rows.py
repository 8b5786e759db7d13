"""Rows that are equal but for rounding share a group."""

import numpy as np
import pytest

from robotmodels.common.arrays import equal_rows


@pytest.mark.parametrize("seed", range(20))
def test_rounding_tears_no_equals_apart(seed):
    """Rows at and beside the edges of multiples of the step, where one rounding alone fails."""
    rng = np.random.default_rng(seed)
    step = 1e-9
    rows = rng.integers(-3, 4, (30, 2)) * step * rng.choice([2.5, 1e3 + 0.5], (30, 1))
    groups = rng.integers(0, 30, 200)
    group = equal_rows((rows[groups] + rng.uniform(-1e-13, 1e-13, (200, 2))).T, step)
    exact = np.unique(rows, axis=0, return_inverse=True)[1].ravel()[groups]
    same = exact[:, None] == exact
    assert (group[:, None] == group)[same].all()
    # Rows a step or more apart are told apart.
    apart = np.abs(rows[groups][:, None] - rows[groups]).max(axis=2) >= 2 * step
    assert not (group[:, None] == group)[apart].any()


def test_one_rounding_tears_them():
    rows = 1e-9 * np.array([[0.5 - 1e-5], [0.5 + 1e-5]])
    assert len(np.unique(np.round(rows / 1e-9))) == 2
    assert len(np.unique(equal_rows(rows.T, 1e-9))) == 1
