"""Fits to runs go through the searches and checks of those to FRFs; designs know them too."""

import numpy as np
import pytest
from derivatives import circular
from mass_springs import OMEGA, POSITIONS
from noisy_runs import MODEL, RESPONSE, TRUTH, F, Q, noise_root, noisy_runs

import oed
from estimators import (
    RunFit,
    covariance,
    cross_check,
    fit,
    likelihood_fit,
    multistart,
    perturbed_starts,
    profile_likelihood,
    sample_posterior,
)
from estimators.fitting.run_problem import RunProblem
from estimators.sampling.convergence import StoppingCriterion
from robotmodels import InvalidInput
from robotmodels.linear.noise import RunNoise

DATA = noisy_runs(np.random.default_rng(21), 1, 0.2)
SAMPLED = noisy_runs(np.random.default_rng(22), 2, 0.2, freedom=8)


def test_many_starts_are_stored_and_end_in_one_minimum(tmp_path):
    starts = perturbed_starts(MODEL.parameters, 4, 0.2, np.random.default_rng(1))
    fits = multistart(MODEL, DATA, starts, store=tmp_path / "searches.h5")
    again = multistart(MODEL, DATA, starts, store=tmp_path / "searches.h5")
    assert [one.cost for one in again] == [one.cost for one in fits]
    assert all(isinstance(one, RunFit) and one.residual == "sml" for one in fits)
    assert fits[0].cost == pytest.approx(fits[1].cost, rel=1e-8)
    with pytest.raises(InvalidInput, match="searches of another model"):
        multistart(MODEL, SAMPLED, starts, store=tmp_path / "searches.h5")


@pytest.mark.parametrize(("data", "weights"), [(DATA, "joint"), (SAMPLED, "row_wise")])
def test_every_method_agrees_with_the_covariance(data, weights):
    fitted = fit(MODEL, data, weights=weights)
    assert likelihood_fit(fitted) is fitted
    theorem1 = covariance(fitted)
    posterior = sample_posterior(
        fitted,
        rng=np.random.default_rng(2),
        walkers=24,
        target=StoppingCriterion(r_hat=1.05, ess=600),
    )
    profiles = profile_likelihood(fitted)
    sampled, profiled = posterior.uncertainty().std, [one.std for one in profiles]
    np.testing.assert_allclose(profiled, theorem1.std, rtol=0.15)
    # One factor for all parameters: right on average.
    assert np.exp(np.mean(np.log(sampled / theorem1.std))) == pytest.approx(1.0, abs=0.15)
    check = cross_check(fitted, theorem1=theorem1, posterior=posterior, profiles=profiles)
    assert str(check.trust.verdict) == "trustworthy"
    assert "posterior" in check.methods


def test_what_only_frfs_have_is_refused():
    with pytest.raises(InvalidInput, match="residual: 'nls' compares FRFs; runs have 'sml'"):
        fit(MODEL, DATA, "nls")
    with pytest.raises(InvalidInput, match="loss: 'huber' is defined for FRFs"):
        fit(MODEL, DATA, loss="huber")
    with pytest.raises(InvalidInput, match="start: 'physics' needs FRFs"):
        fit(MODEL, DATA, start="physics")
    with pytest.raises(InvalidInput, match="weights: 'optimal' is none of auto, joint, row_wise"):
        fit(MODEL, DATA, weights="optimal")
    with pytest.raises(InvalidInput, match="fit: data: ndarray given; FrfEstimate or RunSpectra"):
        fit(MODEL, RESPONSE)
    with pytest.raises(InvalidInput, match="inputs: "):
        type(DATA)(POSITIONS, OMEGA, "text", DATA.outputs, DATA.covariance)
    with pytest.raises(InvalidInput, match="subset: "):
        DATA.subset("first")
    with pytest.raises(InvalidInput, match=r"subset: \[9\] does not choose from positions 0 to 2"):
        DATA.subset([9])


@pytest.mark.parametrize("runs", [1, 2, 5])
def test_designs_have_the_information_of_the_fit(runs):
    """(U0 U0^H)^T kron Sigma^-1 is that of the likelihood at the true torques."""
    rng = np.random.default_rng(runs)
    U = circular(rng, Q, F, 2, runs)
    root = noise_root(0.3, 0.1)
    C = root @ np.conj(root.swapaxes(1, 2))
    exact = type(DATA)(
        POSITIONS,
        OMEGA,
        np.moveaxis(U, 3, 1),
        np.moveaxis(RESPONSE @ U, 3, 1),
        np.broadcast_to(C, (Q, F, 4, 4)),
    )
    bounds = np.outer([1e-3, 1e3], TRUTH)
    problem = RunProblem(model=MODEL, data=exact, weighting="joint", bounds=bounds)
    _, jacobian = problem.evaluate(TRUTH)
    expected = 2 * jacobian.T @ jacobian
    noise = RunNoise(U, C)
    matrices = oed.information(MODEL, POSITIONS, OMEGA, noise).matrices
    size = np.sqrt(np.diag(expected))
    difference = (matrices.sum(axis=0) - expected) / np.outer(size, size)
    assert np.abs(difference).max() < 1e-11
    general = oed.information(MODEL, POSITIONS, OMEGA, noise, equilibrium_shift=True).matrices
    np.testing.assert_allclose(general, matrices, atol=1e-11 * size.max() ** 2)
