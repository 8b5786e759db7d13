"""Results print as a few lines for people, never as arrays."""

import re

import numpy as np
import pytest
from random_candidates import random_set

import oed

ONE, OTHER = random_set(0, 30, 3, 2), random_set(1, 30, 3, 2)
LIMITS = oed.MoveLimits(("m1", "m2"), np.array([[-9, 9], [-9, 9]]), np.ones(2), np.ones(2))
PLACES = np.random.default_rng(0).random((5, 2))


@pytest.mark.parametrize(
    ("result", "said"),
    [
        (ONE, "information of 30 candidates on 3 parameters, 3 directions"),
        (oed.optimal_design(ONE), r"D-optimal design: \d of 30 candidates, certified gap .*\n  we"),
        (oed.exact_design(ONE, 4), r"D: 4 experiments in 4 .*, efficiency >= 0.9\d+: 1 in"),
        (oed.best_plans(ONE, 4, 2), r"2 best plans, proven, \d+ relaxed problems\n  D: .*\n  D: "),
        (oed.robust_design([ONE, OTHER]), r"keeps at each sample 0.77\d, 0.77\d\n.* 1.000, 0.3"),
        (oed.score(ONE, [0, 1, 2]), r"deviation 0.83\d, of k2\n  one more visit to 21: 2.79"),
        (oed.next_experiments(ONE, 3, np.eye(3)), "deviation 1 before, 0.277 after"),
        (oed.experiment_curve(ONE, [2, 4]), r"2 experiments: .*\n4 experiments: .* 0.253"),
        (oed.experiments_needed(ONE, 0.1), r"\d+ experiments are needed, the most for k\d"),
        (oed.visiting_order(PLACES, LIMITS), "order 2, 4, 3, 0, 1: moves take 5.8 s instead of 6."),
    ],
    ids=lambda value: type(value).__name__,
)
def test_results_print_for_people(result, said):
    text = str(result)
    assert "array" not in text
    assert all(len(line) < 120 for line in text.splitlines())
    assert re.search(said, text)
    assert result._repr_html_().startswith("<pre>")
