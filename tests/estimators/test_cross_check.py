"""Every rule of the cross-check on a case made for it, and a case on which it is silent."""

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
    multistart,
    perturbed_starts,
    profile_likelihood,
    sample_posterior,
    simulate_frf,
)
from estimators.uncertainty.convergence import Target
from estimators.uncertainty.model_error import informative_lines
from robotmodels import InvalidInput, RelativeNoise, SpringNetwork, sensitivity


@pytest.fixture(scope="module")
def good():
    return fit(MODEL, noisy(0.01, 0.003), "nls", "optimal")


@pytest.fixture(scope="module")
def posterior(good):
    return sample_posterior(good, rng=np.random.default_rng(0), walkers=16, target=Target(ess=600))


def test_on_good_data_all_methods_agree(good, posterior):
    starts = perturbed_starts(MODEL.parameters, 4, 0.1, np.random.default_rng(0))
    table = cross_check(
        good,
        posterior=posterior,
        importance=importance_sample(good, rng=np.random.default_rng(1), draws=4000),
        profiles=profile_likelihood(good, ["k1", "c12"]),
        multistart=multistart(MODEL, good.estimate, starts, "nls", "optimal"),
    )
    assert set(table.verdicts) == {"agree"}
    assert table.methods == ("Theorem 1", "posterior", "importance", "profile", "multistart")
    assert table.notes == ()
    assert table.covering is None
    assert not any(table.evidence)
    std = covariance(good).std
    assert table.stds[1] == pytest.approx(std, rel=0.15)
    assert np.isnan(table.stds[3]).tolist() == [False, True, True, True, True, False]
    assert (table.stds[4] < 1e-3 * std).all()
    assert "k12" in str(table)
    assert str(table).count("agree") == 6


def test_rule_1_singular_information():
    model = Blind(_exponents("product"))
    data = simulate_frf(model, POSITIONS, OMEGA, RelativeNoise(), np.random.default_rng(0))
    table = cross_check(fit(model, data, "nls", "optimal"))
    assert table.verdicts[:2] == ("not identifiable",) * 2
    assert "information is singular" in table.evidence[0][0]
    assert "not identifiable" not in table.verdicts[2:]


def test_rule_1_flat_profiles():
    found = fit(MODEL, noisy(0.6, 0.6), "nls", "optimal", bounds=(1e-2, 1e2))
    c12 = found.parameters.index("c12")
    table = cross_check(found, profiles=profile_likelihood(found, ["c12"]))
    assert table.verdicts[c12] == "not identifiable"
    assert any("flat up to the lower bound" in e for e in table.evidence[c12])
    assert table.verdicts[0] != "not identifiable"


def test_rule_1_posteriors_at_a_bound(good, posterior):
    low = np.log(good.bounds[0, 1])
    chains = posterior.chains.copy()
    chains[..., 1] = low + np.abs(chains[..., 1] - chains[..., 1].mean())
    table = cross_check(good, posterior=replace(posterior, chains=chains))
    assert table.verdicts[1] == "not identifiable"
    assert "the posterior reaches a bound" in table.evidence[1]
    assert table.verdicts[0] == "agree"


def test_rule_1_wide_standard_deviations(good):
    std = np.full(6, 0.01)
    std[2] = 1.1
    table = cross_check(
        good, theorem1=Uncertainty(good.parameters.names, np.diag(std**2), "constructed")
    )
    assert table.verdicts[2] == "not identifiable"
    assert "more than an e-fold" in table.evidence[2][0]
    assert table.verdicts[0] == "agree"


class Heavier(MassSprings):
    """The robot that is measured has 10 % more mass than the model knows."""

    def network(self, positions, parameters=None):
        network = super().network(positions, parameters)
        return SpringNetwork(**vars(network) | {"mass": 1.1 * network.mass})


@pytest.mark.parametrize("residual", ["nls", "lls"])
def test_rule_2_costs_that_noise_does_not_explain(residual):
    rng = np.random.default_rng(0)
    data = simulate_frf(Heavier(), POSITIONS, OMEGA, RelativeNoise(0.02, 0.01), rng)
    found = fit(MODEL, data, residual, "optimal")
    table = cross_check(found)
    assert set(table.verdicts) == {"model error suspected"}
    assert "noise explains" in table.notes[0]
    empirical = covariance(found, "empirical")
    judged = cross_check(found, empirical=empirical)
    for verdict, wider in zip(judged.verdicts, empirical.std / covariance(found).std, strict=True):
        assert (verdict == "model error suspected") == (wider > 1.5)
    assert "model error suspected" in judged.verdicts


def test_rule_2_is_silent_where_the_model_is_right():
    rng = np.random.default_rng(0)
    right = simulate_frf(MODEL, POSITIONS, OMEGA, RelativeNoise(0.02, 0.01), rng)
    wrong = simulate_frf(Heavier(), POSITIONS, OMEGA, RelativeNoise(0.02, 0.01), rng)
    for residual, weights in (("nls", "optimal"), ("lls_magnitude", "optimal"), ("lls", "user")):
        table = cross_check(fit(MODEL, right, residual, weights))
        assert set(table.verdicts) == {"agree"}, (residual, weights)
        table = cross_check(fit(MODEL, wrong, residual, weights))
        assert set(table.verdicts) == {"model error suspected"}, (residual, weights)


def test_rule_2_good_fits_that_disagree(good):
    std = covariance(good).std
    values = good.parameters.values.copy()
    values[3] *= np.exp(3 * std[3])
    other = replace(good, parameters=replace(good.parameters, values=values), cost=good.cost + 0.1)
    worse = replace(other, cost=good.cost + 10)
    assert cross_check(good, multistart=(good, other)).verdicts[3] == "model error suspected"
    assert cross_check(good, multistart=(good, worse)).verdicts[3] == "agree"


def test_rule_3_skewed_profiles():
    found = fit(MODEL, noisy(0.35, 0.12), "nls", "optimal")
    table = cross_check(found, profiles=profile_likelihood(found))
    skewed = [i for i, v in enumerate(table.verdicts) if v == "posterior skewed"]
    assert skewed
    assert "times its lower one" in table.evidence[skewed[0]][0]


def test_rule_3_skewed_draws(good, posterior):
    center = np.log(good.parameters.values)
    z = (posterior.chains - center) / posterior.uncertainty().std
    bent = 0.8 * (z + 0.4 * (z**2 - 1))
    chains = center + posterior.uncertainty().std * np.where(np.arange(6) == 4, bent, z)
    table = cross_check(good, posterior=replace(posterior, chains=chains))
    assert table.verdicts[4] == "posterior skewed"
    assert "skewness is +" in table.evidence[4][0]
    assert table.verdicts[0] == "agree"


def test_rule_3_widths_that_differ(good, posterior):
    mean = posterior.chains.mean(axis=(0, 1, 2))
    wider = replace(posterior, chains=mean + 1.5 * (posterior.chains - mean))
    table = cross_check(good, posterior=wider)
    assert set(table.verdicts) == {"posterior skewed"}
    assert "1.5 times as wide as Theorem 1" in table.evidence[0][0]
    assert set(cross_check(good, posterior=posterior).verdicts) == {"agree"}


def test_what_is_not_to_be_trusted_is_left_out(good, posterior):
    doubtful = replace(posterior, converged=False, message="not converged: R-hat 1.2")
    sample = importance_sample(good, rng=np.random.default_rng(1), draws=4000)
    table = cross_check(
        replace(good, status=0, message="out of evaluations"),
        posterior=doubtful,
        importance=replace(sample, pareto_k=0.9),
    )
    assert table.methods == ("Theorem 1",)
    assert "posterior left out: not converged: R-hat 1.2" in table.notes
    assert "importance sampling left out: Pareto k 0.90" in table.notes
    assert "the fit has not converged: out of evaluations" in table.notes


def test_methods_about_other_parameters_are_refused(good):
    other = Uncertainty(("a",), np.eye(1), "constructed")
    with pytest.raises(InvalidInput, match="cross-check: Uncertainty is about a, the fit about k1"):
        cross_check(good, empirical=other)


def test_what_the_weights_alone_make_of_the_posterior_is_no_skewness():
    data = noisy(0.01, 0.003)
    uneven = np.ones(data.response.shape[-2:])
    uneven[0, 0] = 1e4
    weighted = fit(MODEL, data, "nls", uneven)
    sampled = importance_sample(weighted, rng=np.random.default_rng(1), draws=4000)
    table = cross_check(weighted, importance=sampled)
    widths = table.stds[table.methods.index("importance")] / table.stds[0]
    assert np.abs(widths - 1).max() > 0.25
    assert set(table.verdicts) == {"agree"}
    (note,) = (note for note in table.notes if "the weights are not those of the noise" in note)
    assert "Theorem 1 knows weights and noise apart" in note


def test_parameters_that_few_lines_tell_are_named(good):
    table = cross_check(good, empirical=covariance(good, "empirical"))
    few = [n for n, c in zip(good.parameters.names, informative_lines(good), strict=True) if c < 20]
    notes = [note for note in table.notes if "where few lines carry the information" in note]
    assert few
    assert len(notes) == 1
    assert all(name in note for note in notes for name in few)
    assert not any("few lines" in note for note in cross_check(good).notes)


def test_lines_that_count():
    data = noisy(0.01, 0.003)
    everywhere = fit(MODEL, data, "nls", "optimal")
    _, J = sensitivity(MODEL, data.positions, data.omega, everywhere.parameters.values)
    diagonals = np.einsum("qfmn,qfmnp->qfp", everywhere.weights, np.abs(J) ** 2)
    share = diagonals / diagonals.sum(axis=(0, 1))
    expected = 1 / (share**2).sum(axis=(0, 1))
    np.testing.assert_allclose(informative_lines(everywhere), expected, rtol=1e-9)
    weights = np.zeros(data.response.shape)
    weights[:, :12] = 1.0
    some = fit(MODEL, data, "lls", weights, start=everywhere.parameters.values)
    assert (informative_lines(some) <= 12 * data.response.shape[0] + 1e-9).all()
    assert (informative_lines(some) >= 1).all()
