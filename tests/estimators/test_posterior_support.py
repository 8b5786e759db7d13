"""Posteriors whose support has holes: no equilibrium, no cost, bounds."""

from dataclasses import fields, replace

import numpy as np
import pytest
from mass_springs import OMEGA, POSITIONS, MassSprings

from estimators import fit, importance_sample, sample_posterior, simulate_frf
from estimators.sampling.likelihood import Noise
from estimators.sampling.log_posterior import LogPosterior, log_posterior
from robotmodels import InvalidInput, NoEquilibrium, RelativeNoise, SolverFailed


class Fragile(MassSprings):
    """Its network is made anew for each k1, and does not exist below the weakest."""

    def network(self, positions, parameters=None):
        return replace(super().network(positions, parameters), non_spring_parameters=("k1",))


def fitted(weakest=0.0):
    noise = RelativeNoise(0.1, 0.03)
    data = simulate_frf(MassSprings(), POSITIONS[:1], OMEGA[2::7], noise, np.random.default_rng(2))
    found = fit(Fragile(), data, "nls", "optimal")
    return replace(found, model=Fragile(weakest=weakest * found.parameters.values[0]))


def test_starts_without_an_equilibrium_are_drawn_again():
    found = fitted(weakest=0.9999)
    posterior = sample_posterior(
        found, rng=np.random.default_rng(0), ensembles=2, walkers=12, steps=40, thin=2
    )
    k1 = np.exp(posterior.draws[:, 0])
    assert k1.min() >= found.model.weakest
    # About half the draws of the whole posterior would lie below.
    sample = importance_sample(found, rng=np.random.default_rng(0), draws=200)
    assert 0.3 < np.mean(sample.weights == 0) < 0.7


def test_given_starts_without_a_cost_are_refused():
    found = fitted(weakest=0.9)
    starts = np.tile(found.parameters.values, (12, 1))
    starts[3, 0] *= 0.8
    with pytest.raises(InvalidInput, match=r"starts: 2 of 24 walkers .* one at k1 = \d+"):
        sample_posterior(
            found, rng=np.random.default_rng(0), ensembles=2, walkers=12, starts=starts
        )


def test_a_support_without_the_fit_is_refused():
    found = fitted(weakest=1.5)
    with pytest.raises(NoEquilibrium, match=r"k1 = \d+\.\d+ is below"):
        sample_posterior(found, rng=np.random.default_rng(0), walkers=12)


def test_a_fit_without_a_cost_is_refused():
    found = replace(fitted(), cost=np.inf, message="no FRF at the start")
    with pytest.raises(SolverFailed, match="no FRF at the start"):
        sample_posterior(found, rng=np.random.default_rng(0), walkers=12)


class Broken(LogPosterior):
    """Its cost is not a number for stiff k12."""

    def costs(self, parameters):
        return np.where(parameters[:, 2] > 500, np.nan, super().costs(parameters))


def test_costs_that_are_no_numbers_name_the_parameters():
    target = log_posterior(fitted(), Noise())
    broken = Broken(**{f.name: getattr(target, f.name) for f in fields(target) if f.init})
    x = np.log(target.network.parameters.values)
    assert np.isfinite(broken(x)).all()
    x[2] = np.log(600)
    with pytest.raises(SolverFailed, match=r"posterior: no cost at k12 = 600 \(fit \d+"):
        broken(x)
