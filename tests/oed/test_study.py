from dataclasses import dataclass, field

import numpy as np
import pytest

import oed.study
from oed.study import Search, best_likelihood, search_all, start_number
from robotmodels.errors import SolverFailed

STARTS = np.array([[1.0, 2.0], [3.0, 1.0], [2.0, 2.0]])


@dataclass
class Ended:
    """What the choice of the best fit looks at."""

    cost: float
    start: np.ndarray = field(default_factory=lambda: STARTS[0])
    message: str = ""

    @property
    def parameters(self):
        return self

    @property
    def values(self):
        return self.start


def search(*runs):
    return Search(runs, "optimal", runs[0])


@pytest.fixture
def refine_to(monkeypatch):
    def set_cost(cost):
        monkeypatch.setattr(oed.study, "fit", lambda *args, start: Ended(cost, start))

    return set_cost


def test_starts_at_one_minimum_are_counted_together():
    runs = search(*map(Ended, (10.0, 10.000001, 10.5, np.inf)))
    assert runs.reached() == 2
    assert runs.reached(best=5.0) == 0


def test_a_run_knows_its_start():
    assert [start_number(STARTS, Ended(1.0, start)) for start in STARTS] == [0, 1, 2]


def test_the_lls_fit_rescues_nls_starts_that_lost_the_way(refine_to):
    refine_to(100.0)
    searches = {"lls": search(Ended(7.0)), "nls": search(Ended(4000.0), Ended(5000.0))}
    fit, origin = best_likelihood(None, None, searches, STARTS)
    assert fit.cost == 100.0
    assert origin == "the LLS fit"


def test_an_nls_start_that_found_the_minimum_is_preferred(refine_to):
    refine_to(100.0)
    searches = {"lls": search(Ended(7.0)), "nls": search(Ended(100.00001, STARTS[2]))}
    _, origin = best_likelihood(None, None, searches, STARTS)
    assert origin == "perturbed start 3"


def test_log_fits_start_with_user_weights_and_are_reweighted_once_judged(monkeypatch):
    asked, steps = [], []

    def multistart(robot, estimate, starts, residual, weights, executor, progress):
        asked.append((residual, weights))
        progress(2, 2)
        return Ended(3.0), Ended(4.0)

    monkeypatch.setattr(oed.study, "multistart", multistart)
    monkeypatch.setattr(oed.study, "reweighted", lambda found: Ended(10 * found.cost))
    searches = search_all(
        None, None, ("lls", "nls"), STARTS, progress=lambda *step: steps.append(step)
    )
    assert asked == [("lls", "user"), ("nls", "optimal")]
    assert steps == [(2, 4), (4, 4)]
    assert searches["lls"].result.cost == 30.0
    assert searches["nls"].result is searches["nls"].runs[0]
    assert searches["lls"].reached() == 1


def test_no_fit_at_all_says_why(monkeypatch):
    failed = (Ended(np.inf, message="no FRF at the start: springs give way"),)
    monkeypatch.setattr(oed.study, "multistart", lambda *args, **kwargs: failed)
    with pytest.raises(SolverFailed, match="springs give way"):
        search_all(None, None, ("nls",), STARTS)
