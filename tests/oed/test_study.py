from dataclasses import dataclass, field, replace

import numpy as np
import pytest
from two_axes import TwoAxes

import oed.study.stages.result
from estimators import simulate_frf
from estimators.fitting.weights import MINIMUM_SNR
from oed.study.settings.fit_settings import Estimator, FitChoice, WeightChoice
from oed.study.stages.fit import Search, positions_of, start_number, weights_of
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
    prior: None = None

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
        monkeypatch.setattr(
            oed.study.stages.result, "fit", lambda *args, start, prior: Ended(cost, start)
        )

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
    return positions_of(estimator, AXES, estimate, FitChoice()).tolist()


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
    beyond = FitChoice(user_weights=WeightChoice(low=70.0))  # [Hz]: no line of the data counts
    with pytest.raises(NotIdentifiable, match="no single position identifies all parameters"):
        positions_of(kind, AXES, data(np.ones(3)), beyond)


def test_positions_by_number():
    some = LLS.model_copy(update={"positions": (0, 2)})
    assert positions_used(some, data([1, 1, 1])) == [0, 2]
    with pytest.raises(InvalidInput, match="lls: there is no position 2; the data have 2"):
        positions_used(some, data([1, 1], ((0.3, 0.1), (-1.0, 1.6))))


@pytest.mark.parametrize("residual", ["nls", "lls"])
def test_weights_as_published_leave_nothing_out_and_follow_each_line(residual):
    """[WM] (6) and (8) from the covariance as estimated; user weights are constant."""
    estimate = data([1.0, 20.0, 400.0])
    scatter = np.random.default_rng(2).gamma(7.0, 1 / 7.0, estimate.response.shape)
    estimate = replace(
        estimate, covariance=estimate.covariance * scatter, degrees_of_freedom=np.full(3, 7.0)
    )
    choice = FitChoice(minimum_snr=0.0, variances="own")
    kind = Estimator(name="one", residual=residual, weights="optimal")
    size = np.abs(estimate.response) ** 2 if residual == "lls" else 1.0
    printed = size / estimate.covariance
    np.testing.assert_allclose(weights_of(kind, estimate, choice), printed, rtol=1e-12)
    user = weights_of(kind.model_copy(update={"weights": "user"}), estimate, choice)
    n = estimate.response.shape[-1]
    assert (user == np.where(np.eye(n, dtype=bool), 1.0, 0.1)).all()
    # By default noisy elements of a logarithm have no weight, and variances are pooled.
    usual = weights_of(kind.model_copy(update={"weights": "user"}), estimate, FitChoice())
    assert (usual == 0).any() == (residual == "lls")
    assert weights_of(kind, estimate, FitChoice()) == "optimal"
    masked = weights_of(kind, estimate, FitChoice(variances="own"))
    assert (masked == 0).any() == (residual == "lls")


def test_the_default_ratio_of_a_study_is_that_of_named_weights():
    assert FitChoice().minimum_snr == MINIMUM_SNR
