import numpy as np
import pytest
from arviz_stats.base.array import array_stats
from mass_springs import OMEGA, POSITIONS
from scipy.stats import norm, t
from test_least_squares import MODEL
from test_profile import noisy

from estimators import fit, importance_sample, sample_posterior
from estimators.sampling.convergence import StoppingCriterion
from estimators.sampling.importance_sampling import smoothed
from estimators.sampling.pareto_smoothing import pareto_smoothed
from robotmodels import InvalidInput, SolverFailed


def test_importance_sampling_agrees_with_emcee():
    found = fit(MODEL, noisy(0.1, 0.03), "nls", "optimal")
    told = []
    sample = importance_sample(
        found, rng=np.random.default_rng(0), progress=lambda done, total: told.append((done, total))
    )
    posterior = sample_posterior(
        found, rng=np.random.default_rng(1), walkers=24, target=StoppingCriterion(ess=6000)
    )
    assert sample.trusted
    assert "trusted" in str(sample)
    assert sample.uncertainty().std == pytest.approx(posterior.uncertainty().std, rel=0.07)
    assert np.log(sample.interval() / posterior.interval()) == pytest.approx(
        np.zeros((6, 2)), abs=0.15 * sample.uncertainty().std.max()
    )
    assert told[-1] == (20_000, 20_000)
    again = sample.resampled(5000, np.random.default_rng(2))
    assert again.std(axis=0) == pytest.approx(sample.uncertainty().std, rel=0.05)


def test_a_posterior_far_from_normal_is_not_trusted():
    found = fit(MODEL, noisy(1.5, 1.0), "nls", "optimal")
    sample = importance_sample(found, rng=np.random.default_rng(0), draws=5000)
    assert not sample.trusted
    assert "NOT to be trusted: sample with emcee" in str(sample)
    assert len(OMEGA) > len(POSITIONS)


def test_pareto_k_tells_a_proposal_with_light_tails():
    rng = np.random.default_rng(0)
    x = rng.standard_t(5, 20_000)
    good, k = smoothed(norm.logpdf(x) - t.logpdf(x, 5))
    assert k < 0.5
    assert np.exp(good) @ x**2 == pytest.approx(1.0, rel=0.05)
    y = rng.standard_normal(20_000)
    _, k = smoothed(t.logpdf(y, 2) - norm.logpdf(y))
    assert k > 0.7


def test_draws_outside_the_support_have_no_weight():
    raw = 1e-3 * np.random.default_rng(0).standard_normal(1000)
    raw[:400] = -np.inf
    log_weights, _ = smoothed(raw)
    assert np.exp(log_weights[:400]).sum() == 0
    assert np.exp(log_weights).sum() == pytest.approx(1)
    with pytest.raises(SolverFailed, match="no draw has a finite cost"):
        smoothed(np.full(1000, -np.inf))


def test_few_draws_and_impossible_levels_are_refused():
    found = fit(MODEL, noisy(), "nls", "optimal")
    with pytest.raises(InvalidInput, match="draws: 10; at least 100"):
        importance_sample(found, rng=np.random.default_rng(0), draws=10)
    sample = importance_sample(found, rng=np.random.default_rng(0), draws=200)
    with pytest.raises(InvalidInput, match=r"level 0\.0 does not lie"):
        sample.interval(0.0)


@pytest.mark.parametrize("spread", [1e3, 1e5, 1e10])
def test_weights_that_vanish_beside_the_largest_are_not_trusted(spread):
    raw = spread * np.random.default_rng(3).standard_normal(2000)
    log_weights, k = smoothed(raw)
    assert k == np.inf
    assert np.exp(log_weights).sum() == pytest.approx(1)
    assert log_weights.argmax() == raw.argmax()


@pytest.mark.parametrize("seed", range(20))
def test_smoothed_weights_are_those_of_arviz_stats(seed):
    rng = np.random.default_rng(seed)
    raw = 10 ** rng.uniform(-3, 1) * rng.standard_t(5, int(rng.choice([100, 226, 5000])))
    with np.errstate(all="ignore"):
        expected, k = array_stats.psislw(-raw)
    assert np.isfinite(expected).all()
    log_weights, own = pareto_smoothed(raw)
    assert own == pytest.approx(k, rel=1e-9, abs=1e-9)
    assert np.exp(log_weights) == pytest.approx(np.exp(expected), rel=1e-9, abs=1e-12)


def test_few_weights_are_not_trusted_and_equal_ones_are():
    assert pareto_smoothed(np.zeros(24))[1] == np.inf
    log_weights, k = pareto_smoothed(np.full(400, 3.0))
    assert k == 0.0
    assert np.exp(log_weights) == pytest.approx(np.full(400, 1 / 400))
