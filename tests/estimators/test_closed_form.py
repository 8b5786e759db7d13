"""Theorem 1, posterior, importance sampling and profile on a linear Gaussian problem."""

import numpy as np
import pytest
from linear_gaussian import NAMES, TRUTH, closed_form, fitted, simulated
from scipy.stats import norm, t

from estimators import covariance, importance_sample, profile_likelihood, sample_posterior
from estimators.fitting.priors import Prior
from estimators.sampling.convergence import StoppingCriterion, effective_size, r_hat


@pytest.fixture(scope="module")
def estimate():
    return simulated(np.random.default_rng(5))


@pytest.fixture(scope="module")
def found(estimate):
    return fitted(estimate)


@pytest.fixture(scope="module")
def posterior(found):
    return sample_posterior(
        found,
        rng=np.random.default_rng(1),
        walkers=32,
        scale=1.0,
        target=StoppingCriterion(ess=2000),
    )


def test_theorem_1_is_the_closed_form(estimate, found):
    mean, truth = closed_form(estimate)
    assert np.log(found.parameters.values) == pytest.approx(mean, abs=1e-8)
    assert covariance(found).covariance == pytest.approx(truth, rel=0.2)  # |G| is the measured's
    exact = simulated(np.random.default_rng(0), sigma=1e-3)
    _, truth = closed_form(exact, sigma=1e-3)
    assert covariance(fitted(exact, sigma=1e-3)).covariance == pytest.approx(truth, rel=2e-3)


def test_the_posterior_is_the_closed_form(estimate, found, posterior):
    mean, truth = closed_form(estimate)
    std = np.sqrt(np.diag(truth))
    assert posterior.converged
    error = posterior.draws.mean(axis=0) - mean
    assert (np.abs(error) < 4 * std / np.sqrt(posterior.ess)).all()
    within = 3 / np.sqrt(2 * posterior.ess.min())
    assert posterior.uncertainty().std == pytest.approx(std, rel=within)
    correlation = truth / np.outer(std, std)
    assert posterior.uncertainty().correlation == pytest.approx(correlation, abs=within)
    # Negative control: the test sees 10 % too wide a posterior.
    assert posterior.uncertainty().std != pytest.approx(1.1 * std, rel=within)


def test_convergence_is_judged_as_arviz_stats_does(posterior):
    assert (posterior.r_hat == r_hat(posterior.chains)).all()
    assert (posterior.ess == effective_size(posterior.chains)).all()
    assert posterior.r_hat.max() < 1.01
    assert posterior.ess.min() > 2000


def test_importance_sampling_is_the_closed_form(estimate, found):
    mean, truth = closed_form(estimate)
    sample = importance_sample(found, rng=np.random.default_rng(2), draws=40_000, scale=1.0)
    std = np.sqrt(np.diag(truth))
    assert sample.trusted
    assert sample.ess > 20_000
    assert (np.abs(sample.mean - mean) < 4 * std / np.sqrt(sample.ess)).all()
    assert sample.uncertainty().std == pytest.approx(std, rel=0.02)
    ends = np.log(sample.interval(0.9))
    assert ends[:, 1] - ends[:, 0] == pytest.approx(2 * norm.ppf(0.95) * std, rel=0.02)


def test_the_profile_is_the_closed_form(estimate, found):
    mean, truth = closed_form(estimate)
    for level in (0.6827, 0.95):
        profiles = profile_likelihood(found, level=level, scale=1.0)
        half = norm.ppf((1 + level) / 2) * np.sqrt(np.diag(truth))
        assert [p.name for p in profiles] == list(NAMES)
        assert np.log([p.mode for p in profiles]) == pytest.approx(mean, abs=1e-4)
        assert np.log([p.lower for p in profiles]) == pytest.approx(mean - half, abs=1e-3)
        assert np.log([p.upper for p in profiles]) == pytest.approx(mean + half, abs=1e-3)
        assert [p.asymmetry for p in profiles] == pytest.approx([1, 1, 1], rel=0.01)
        assert [p.std for p in profiles] == pytest.approx(np.sqrt(np.diag(truth)), rel=0.01)


def test_a_profile_rises_like_a_parabola(found):
    (profile,) = profile_likelihood(found, ["b"], points=9, scale=1.0)
    x = np.log(profile.curve[0] / profile.mode) / profile.std
    assert profile.curve[1] == pytest.approx(x**2, abs=0.02)
    assert x[0] == pytest.approx(-2 * 1.96, rel=0.01)


def test_priors_are_the_closed_form(estimate):
    mean, std = np.log(TRUTH) + 0.05, np.array([0.02, 1e3, 0.03])
    prior = Prior(NAMES, np.exp(mean), std)
    expected, truth = closed_form(estimate, prior=(mean, std))
    width = np.sqrt(np.diag(truth))
    assert (width[0] < 0.9 * np.sqrt(np.diag(closed_form(estimate)[1]))[0]).all()
    for found, given in ((fitted(estimate), prior), (fitted(estimate, prior=prior), None)):
        sample = importance_sample(
            found, rng=np.random.default_rng(3), draws=10_000, scale=1.0, prior=given
        )
        assert (np.abs(sample.mean - expected) < 4 * width / np.sqrt(sample.ess)).all()
        assert sample.uncertainty().std == pytest.approx(width, rel=0.03)
        profiles = profile_likelihood(found, scale=1.0, prior=given)
        assert np.log([p.mode for p in profiles]) == pytest.approx(expected, abs=1e-3)
        assert [p.std for p in profiles] == pytest.approx(width, rel=0.01)
    posterior = sample_posterior(
        found,
        rng=np.random.default_rng(4),
        walkers=16,
        scale=1.0,
        target=StoppingCriterion(ess=600),
    )
    assert posterior.uncertainty().std == pytest.approx(width, rel=3.5 / np.sqrt(1200))


def test_weights_known_but_for_a_factor_give_a_student_t(estimate):
    """Marginalised over the scale, ln theta is Student t with n - p degrees of freedom."""
    found = fitted(estimate, weights=np.full(estimate.response.shape, 7.0))
    mean, truth = closed_form(estimate)
    n, p = 2 * estimate.response.size, 3
    # V at 7 instead of 1/sigma^2, with which the closed form's covariance is scaled back.
    scale = np.sqrt(found.cost * 2 / (n - p) / 7.0 * np.diag(truth) / 0.1**2)
    sample = importance_sample(found, rng=np.random.default_rng(3), draws=40_000, noise="unknown")
    for level in (0.5, 0.95):
        half = t.ppf((1 + level) / 2, n - p) * scale
        ends = np.log(sample.interval(level))
        assert ends[:, 1] - ends[:, 0] == pytest.approx(2 * half, rel=0.03)
    assert sample.mean == pytest.approx(mean, abs=4 * scale.max() / np.sqrt(sample.ess))
