"""Several alternatives of one spring: the probability that none of them fits better."""

import numpy as np
import pytest
from scipy.special import ndtr

from estimators.structure.power import share_of_right

DATA = 40


def _models(count, spread, rng):
    """Columns of a right model, two of them of the spring, and of alternatives close to it."""
    shared, spring = rng.standard_normal((DATA, 3)), rng.standard_normal((DATA, 2))
    others = [spring + spread * rng.standard_normal((DATA, 2)) for _ in range(count)]
    return shared, np.hstack([shared, spring]), [np.hstack([shared, each]) for each in others]


def _off(columns, values):
    """Values (.., r) less their fit by columns."""
    return values - values @ np.linalg.pinv(columns.T) @ columns.T


@pytest.mark.parametrize(("size", "spread"), [(1.5, 0.1), (4.0, 0.1), (8.0, 0.3)])
def test_alternatives_win_as_often_as_in_refits_of_drawn_data(size, spread):
    rng = np.random.default_rng(4)
    shared, right, alternatives = _models(5, spread, rng)
    signal = right[:, 3]
    change = _off(shared, signal)
    change *= (size + 3.5) / np.linalg.norm(change)
    data = change + rng.standard_normal((40_000, DATA))
    misfits = [np.square(_off(each, data)).sum(axis=1) for each in (right, *alternatives)]
    test = data @ change / np.linalg.norm(change)
    hits = (test > 3.5) & (misfits[0] < np.min(misfits[1:], axis=0))
    remainders = [_off(each, change) for each in alternatives]
    predicted = share_of_right(
        size, change, right, list(zip(remainders, alternatives, strict=True))
    )
    assert predicted == pytest.approx(hits.mean(), abs=0.015)
    # The best alternative alone promises too much.
    nearest = min(np.linalg.norm(each) for each in remainders)
    assert ndtr(size) * ndtr(nearest / 2) > predicted + 0.05


def test_one_alternative_and_the_test_have_closed_forms():
    line, other = np.eye(DATA)[:, :1], np.eye(DATA)[:, 1:2]
    far = [(30.0 * other[:, 0], line)]
    assert share_of_right(0.5, line[:, 0], line, far) == pytest.approx(ndtr(0.5), abs=0.015)
    near = [(1.2 * other[:, 0], line)]
    assert share_of_right(9.0, line[:, 0], line, near) == pytest.approx(ndtr(0.6), abs=0.015)
