from dataclasses import dataclass, field

import numpy as np
import pytest

import oed.study.stages.result
from oed.information_sets.information_set import InformationSet
from oed.study.settings.fit_settings import Estimator
from oed.study.stages.fit import Search, positions_of, start_number
from oed.study.stages.result import best_likelihood
from robotmodels.common.errors import InvalidInput, NotIdentifiable

STARTS = np.array([[1.0, 2.0], [3.0, 1.0], [2.0, 2.0]])
NLS = Estimator(name="nls", residual="nls", weights="optimal")
LLS = Estimator(name="lls", residual="lls", weights="user", reweight=True)


@dataclass
class Ended:
    """What the choice of the best fit looks at."""

    cost: float
    start: np.ndarray = field(default_factory=lambda: STARTS[0])

    @property
    def parameters(self):
        return self

    @property
    def values(self):
        return self.start


def search(estimator, *runs):
    return Search(estimator, runs, runs[0])


@pytest.fixture
def refine_to(monkeypatch):
    def set_cost(cost):
        monkeypatch.setattr(oed.study.stages.result, "fit", lambda *args, start: Ended(cost, start))

    return set_cost


def test_starts_at_one_minimum_are_counted_together():
    runs = search(LLS, *map(Ended, (10.0, 10.000001, 10.5, np.inf)))
    assert runs.reached() == 2
    assert runs.reached(best=5.0) == 0


def test_a_run_knows_its_start():
    assert [start_number(STARTS, Ended(1.0, start)) for start in STARTS] == [0, 1, 2]


def test_the_lls_fit_rescues_nls_starts_that_lost_the_way(refine_to):
    refine_to(100.0)
    searches = {"lls": search(LLS, Ended(7.0)), "nls": search(NLS, Ended(4000.0), Ended(5000.0))}
    found = best_likelihood(None, None, searches, STARTS)
    assert found.fit.cost == 100.0
    assert found.origin == "the lls fit"


def test_an_nls_start_that_found_the_minimum_is_preferred(refine_to):
    refine_to(100.0)
    searches = {"lls": search(LLS, Ended(7.0)), "nls": search(NLS, Ended(100.00001, STARTS[2]))}
    assert best_likelihood(None, None, searches, STARTS).origin == "perturbed start 3"


def test_nls_with_other_weights_or_positions_is_no_likelihood(refine_to):
    refine_to(100.0)
    for other in ({"weights": "user"}, {"positions": "best"}):
        kind = NLS.model_copy(update=other)
        found = best_likelihood(None, None, {"nls": search(kind, Ended(3.0))}, STARTS)
        assert found.fit.cost == 100.0


INFO = InformationSet(
    np.array([[1.0], [1.0 + 1e-8], [1.0 + 2e-8]]),  # closer than any tolerance of a look-up
    np.array([np.diag([1.0, 0.0]), np.diag([1.0, 1.0]), np.diag([9.0, 9.0])]),
    ("a", "b"),
)


def positions_used(estimator, candidates):
    return positions_of(estimator, INFO, np.array(candidates)).tolist()


def test_the_best_position_is_that_of_the_data_with_the_largest_information():
    best = LLS.model_copy(update={"positions": "best"})
    assert positions_used(best, [1, 0]) == [0]
    assert positions_used(best, [0, 1, 2]) == [2]
    with pytest.raises(NotIdentifiable, match="b; no single position"):
        positions_used(best, [0])


def test_positions_by_number():
    some = LLS.model_copy(update={"positions": (0, 2)})
    assert positions_used(some, [0, 1, 2]) == [0, 2]
    with pytest.raises(InvalidInput, match="lls: there is no position 2; the data have 2"):
        positions_used(some, [0, 1])
