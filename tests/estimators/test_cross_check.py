"""Evidence that refines the verdict, what is noted, and what is left out."""

from dataclasses import replace

import numpy as np
import pytest
from mass_springs import OMEGA, POSITIONS, MassSprings
from test_covariance import Blind, _exponents
from test_least_squares import MODEL
from test_profile import noisy

from estimators import (
    Uncertainty,
    covariance,
    cross_check,
    fit,
    importance_sample,
    likelihood_fit,
    multistart,
    perturbed_starts,
    profile_likelihood,
    sample_posterior,
    simulate_frf,
)
from estimators.sampling.convergence import StoppingCriterion
from robotmodels import InvalidInput, RelativeNoise, SpringNetwork


@pytest.fixture(scope="module")
def good():
    return fit(MODEL, noisy(0.01, 0.003), "nls", "optimal")


@pytest.fixture(scope="module")
def posterior(good):
    return sample_posterior(
        good, rng=np.random.default_rng(0), walkers=16, target=StoppingCriterion(ess=600)
    )


def test_on_good_data_all_methods_agree(good, posterior):
    starts = perturbed_starts(MODEL.parameters, 4, 0.1, np.random.default_rng(0))
    table = cross_check(
        good,
        posterior=posterior,
        importance=importance_sample(good, rng=np.random.default_rng(1), draws=4000),
        profiles=profile_likelihood(good, ["k1", "c12"]),
        multistart=multistart(MODEL, good.estimate, starts, "nls", "optimal"),
    )
    assert set(table.verdicts) == {"trustworthy"}
    methods = ("recommended", "Theorem 1", "posterior", "importance", "profile", "multistart")
    assert table.methods == methods
    assert set(methods[1:4]) <= set(table.agreeing())
    assert table.covering is None
    std = covariance(good).std
    assert table.stds[0] == pytest.approx(std, rel=1e-6)
    assert table.ratio() == pytest.approx(np.ones(6), rel=0.15)
    assert np.isnan(table.stds[4]).tolist() == [False, True, True, True, True, False]
    assert (table.stds[5] < 1e-3 * std).all()
    assert "k12" in str(table)


def test_singular_information_is_not_identifiable():
    model = Blind(_exponents("product"))
    data = simulate_frf(model, POSITIONS, OMEGA, RelativeNoise(), np.random.default_rng(0))
    table = cross_check(fit(model, data, "nls", "optimal"))
    assert table.verdicts[:2] == ("not identifiable",) * 2
    assert "not identifiable" not in table.verdicts[2:]
    assert table.trust.intervals[0].low is None


def test_flat_profiles_are_not_identifiable():
    noisy_fit = fit(MODEL, noisy(0.6, 0.6), "nls", "optimal", bounds=(1e-2, 1e2))
    c12 = noisy_fit.parameters.index("c12")
    table = cross_check(noisy_fit, profiles=profile_likelihood(noisy_fit, ["c12"]))
    assert table.verdicts[c12] == "not identifiable"
    assert table.verdicts[0] != "not identifiable"


def test_a_posterior_at_a_bound_is_not_identifiable(good, posterior):
    low = np.log(good.bounds[0, 1])
    chains = posterior.chains.copy()
    chains[..., 1] = low + np.abs(chains[..., 1] - chains[..., 1].mean())
    table = cross_check(good, posterior=replace(posterior, chains=chains))
    assert table.verdicts[1] == "not identifiable"
    assert "the posterior reaches a bound" in table.trust.reasons[1]
    assert table.verdicts[0] == "trustworthy"


def test_good_fits_that_disagree_are_not_identifiable(good):
    std = covariance(good).std
    values = good.parameters.values.copy()
    values[3] *= np.exp(3 * std[3])
    other = replace(good, parameters=replace(good.parameters, values=values), cost=good.cost + 0.1)
    worse = replace(other, cost=good.cost + 10)
    assert cross_check(good, multistart=(good, other)).verdicts[3] == "not identifiable"
    assert cross_check(good, multistart=(good, worse)).verdicts[3] == "trustworthy"


class Heavier(MassSprings):
    """The robot that is measured has 10 % more mass than the model knows."""

    def network(self, positions, parameters=None):
        network = super().network(positions, parameters)
        return SpringNetwork(**vars(network) | {"mass": 1.1 * network.mass})


@pytest.mark.parametrize(
    ("residual", "weights"),
    [("nls", "optimal"), ("lls", "optimal"), ("lls_magnitude", "optimal")],
)
def test_errors_of_the_model_give_no_interval(residual, weights):
    rng = np.random.default_rng(0)
    right = simulate_frf(MODEL, POSITIONS, OMEGA, RelativeNoise(0.02, 0.01), rng)
    wrong = simulate_frf(Heavier(), POSITIONS, OMEGA, RelativeNoise(0.02, 0.01), rng)
    assert set(cross_check(fit(MODEL, right, residual, weights)).verdicts) == {"trustworthy"}
    table = cross_check(fit(MODEL, wrong, residual, weights))
    # With residuals that are large everywhere alike the error may pass for too little noise.
    assert set(table.verdicts) <= {"model error", "noise understated"}
    if residual == "nls":
        assert set(table.verdicts) == {"model error"}
        assert all(i.low is None and i.high is None for i in table.trust.intervals)


def test_profiles_and_posteriors_that_are_not_normal_are_noted(good, posterior):
    noisy_fit = fit(MODEL, noisy(0.35, 0.12), "nls", "optimal")
    table = cross_check(noisy_fit, profiles=profile_likelihood(noisy_fit))
    assert any("times its lower one" in note for note in table.notes)
    center = np.log(good.parameters.values)
    z = (posterior.chains - center) / posterior.uncertainty().std
    bent = 0.8 * (z + 0.4 * (z**2 - 1))
    chains = center + posterior.uncertainty().std * np.where(np.arange(6) == 4, bent, z)
    table = cross_check(good, posterior=replace(posterior, chains=chains))
    (note,) = (note for note in table.notes if "skewed" in note)
    assert good.parameters.names[4] in note


def test_widths_that_differ_are_noted(good, posterior):
    mean = posterior.chains.mean(axis=(0, 1, 2))
    wider = replace(posterior, chains=mean + 1.5 * (posterior.chains - mean))
    table = cross_check(good, posterior=wider)
    assert "posterior" not in table.agreeing()
    assert any(n.startswith("posterior: standard") and "beyond" in n for n in table.notes)
    assert "posterior" in cross_check(good, posterior=posterior).agreeing()


def test_what_is_not_to_be_trusted_is_left_out(good, posterior):
    doubtful = replace(posterior, converged=False, message="not converged: R-hat 1.2")
    sample = importance_sample(good, rng=np.random.default_rng(1), draws=4000)
    table = cross_check(
        replace(good, status=0, message="out of evaluations"),
        posterior=doubtful,
        importance=replace(sample, pareto_k=0.9),
    )
    assert table.methods == ("recommended", "Theorem 1")
    assert "posterior left out: not converged: R-hat 1.2" in table.notes
    assert "importance sampling left out: Pareto k 0.90" in table.notes
    assert set(table.verdicts) == {"not converged"}


def test_methods_about_other_parameters_are_refused(good):
    other = Uncertainty(("a",), np.eye(1), "constructed")
    with pytest.raises(InvalidInput, match="cross-check: Uncertainty is about a, the fit about k1"):
        cross_check(good, theorem1=other)


def test_a_cost_with_other_weights_is_no_likelihood():
    """The density of the fit's own cost is labelled; the likelihood's widths are the noise's."""
    data = noisy(0.01, 0.003)
    uneven = np.ones(data.response.shape[-2:])
    uneven[0, 0] = 1e4
    weighted = fit(MODEL, data, "nls", uneven)
    rng = np.random.default_rng(1)
    own = sample_posterior(weighted, rng=rng, walkers=16, target=StoppingCriterion(ess=400))
    likelihood = likelihood_fit(weighted)
    sampled = sample_posterior(likelihood, rng=rng, walkers=16, target=StoppingCriterion(ess=400))
    table = cross_check(weighted, posterior=sampled, cost_posterior=own)
    (note,) = (note for note in table.notes if "no likelihood" in note)
    assert note.startswith("own cost")
    assert np.abs(np.log(table.ratio("own cost", "recommended"))).max() > 0.5
    # The likelihood's weights are the better ones: its widths are nowhere larger.
    assert (table.ratio("posterior", "recommended") < 1.15).all()
