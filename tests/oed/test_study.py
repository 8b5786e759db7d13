from dataclasses import dataclass, field, replace

import numpy as np
import pytest
from two_axes import TwoAxes

import oed.study.stages.result
from estimators import simulate_frf
from oed.study.settings.fit_settings import Estimator, WeightChoice
from oed.study.stages.fit import Search, positions_of, start_number
from oed.study.stages.result import best_likelihood
from robotmodels import RelativeNoise
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
    return Search(estimator, runs, runs[0], np.arange(1))


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


AXES = TwoAxes()
OMEGA = 2 * np.pi * np.geomspace(2.0, 60.0, 30)


def data(noise, positions=((0.3, 0.1), (-1.0, 1.6), (0.2, 0.8))):
    """Return FRFs whose positions have standard deviations times `noise` (Q,)."""
    rng = np.random.default_rng(0)
    estimate = simulate_frf(AXES, np.array(positions), OMEGA, RelativeNoise(0.03), rng)
    factors = np.square(noise)[:, None, None, None]
    return replace(estimate, covariance=estimate.covariance * factors)


def positions_used(estimator, estimate):
    return positions_of(estimator, AXES, estimate, WeightChoice()).tolist()


@pytest.mark.parametrize("residual", ["nls", "lls"])
@pytest.mark.parametrize("weights", ["optimal", "user"])
@pytest.mark.parametrize("best", range(3))
def test_the_best_position_is_that_with_the_least_covariance_of_the_estimator(
    residual, weights, best
):
    kind = Estimator(name="one", residual=residual, weights=weights, positions="best")
    noise = np.full(3, 4.0)
    noise[best] = 1.0
    assert positions_used(kind, data(noise)) == [best]


def test_no_position_alone_may_do():
    kind = LLS.model_copy(update={"positions": "best"})
    beyond = WeightChoice(low=70.0)  # [Hz]: no line of the data counts
    with pytest.raises(NotIdentifiable, match="no single position identifies all parameters"):
        positions_of(kind, AXES, data(np.ones(3)), beyond)


def test_positions_by_number():
    some = LLS.model_copy(update={"positions": (0, 2)})
    assert positions_used(some, data([1, 1, 1])) == [0, 2]
    with pytest.raises(InvalidInput, match="lls: there is no position 2; the data have 2"):
        positions_used(some, data([1, 1], ((0.3, 0.1), (-1.0, 1.6))))
