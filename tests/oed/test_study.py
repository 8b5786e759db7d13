from dataclasses import dataclass

import pytest

import oed.study
from oed.study import Multistart, best_likelihood
from robotmodels.errors import SolverFailed


@dataclass
class Ended:
    """What the choice of the best fit looks at."""

    cost: float
    residual: str = "nls"

    @property
    def parameters(self):
        return self

    @property
    def values(self):
        return self.cost


def runs(*costs):
    return Multistart(tuple(map(Ended, costs)), tuple(range(len(costs))))


@pytest.fixture
def refine_to(monkeypatch):
    def set_cost(cost):
        monkeypatch.setattr(oed.study, "Fit", Ended)
        monkeypatch.setattr(oed.study, "fit_from", lambda robot, estimate, task: Ended(cost))

    return set_cost


def test_starts_at_one_minimum_are_counted_together():
    assert runs(10.0, 10.001, 10.5, 900.0).reached() == 2
    assert runs(10.0, 10.001).reached(best=5.0) == 0
    assert runs().reached() == 0


def test_the_best_lls_fit_rescues_nls_starts_that_lost_the_way(refine_to):
    refine_to(100.0)
    fit, origin = best_likelihood(None, None, {"lls": runs(7.0), "nls": runs(4000.0, 5000.0)})
    assert fit.cost == 100.0
    assert origin == "the best LLS fit"


def test_an_nls_start_that_found_the_minimum_is_preferred(refine_to):
    refine_to(100.0)
    starts = Multistart((Ended(100.001), Ended(4000.0)), (2, 0))
    _, origin = best_likelihood(None, None, {"lls": runs(7.0), "nls": starts})
    assert origin == "perturbed start 3"


def test_no_fit_at_all_says_why():
    failed = Multistart((), (), ((0, "springs give way"),))
    with pytest.raises(SolverFailed, match="springs give way"):
        best_likelihood(None, None, {"nls": failed})
