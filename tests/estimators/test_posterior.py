import pickle
from dataclasses import replace

import numpy as np
import pytest
from mass_springs import OMEGA, POSITIONS, MassSprings
from test_frf_estimate import full_covariance
from test_least_squares import MODEL, TRUTH, exact

from estimators import covariance, fit, sample_posterior, simulate_frf
from estimators.fitting.priors import Prior
from estimators.sampling.convergence import StoppingCriterion
from estimators.sampling.ensemble import Sampler, run_ensembles
from estimators.sampling.likelihood import Noise
from estimators.sampling.log_posterior import log_posterior
from estimators.sampling.posterior import posterior_of_chains
from robotmodels import InvalidInput, RelativeNoise, SolverFailed


class Normal:
    """N(mean, covariance) whose standard deviations differ a hundredfold."""

    def __init__(self):
        root = np.random.default_rng(8).standard_normal((4, 4)) + 2 * np.eye(4)
        self.root = np.array([0.01, 0.1, 1.0, 1.0])[:, None] * root
        self.mean = np.arange(4.0)

    def __call__(self, x):
        return -0.5 * np.sum(np.linalg.solve(self.root, (x - self.mean).T) ** 2, axis=0)

    def starts(self, ensembles, walkers, rng):
        return self.mean + rng.standard_normal((ensembles, walkers, 4)) @ self.root.T


NAMES = ("a", "b", "c", "d")
KNOWN, FEW = Noise(), StoppingCriterion(ess=400)


def run(target, steps=600, seed=0):
    rng = np.random.default_rng(seed)
    seeds = rng.integers(2**32, size=2)
    return run_ensembles(Sampler(target, 5), target.starts(2, 32, rng), seeds, steps // 5)


@pytest.fixture(scope="module")
def normal_chains():
    return run(Normal())


def test_a_normal_posterior_is_found(normal_chains):
    target = Normal()
    chains, acceptance = normal_chains
    posterior = posterior_of_chains(NAMES, chains, 5, acceptance, KNOWN, FEW)
    assert posterior.converged, posterior.message
    truth = target.root @ target.root.T
    std = np.sqrt(np.diag(truth))
    assert np.allclose(posterior.uncertainty().std, std, rtol=0.05)
    assert np.allclose(posterior.uncertainty().correlation, truth / np.outer(std, std), atol=0.06)
    assert (np.abs(posterior.draws.mean(axis=0) - target.mean) < 0.1 * std).all()
    assert 0.2 < posterior.acceptance < 0.6
    # Effective sizes are honest within a factor: ensemble means scatter as they say.
    white = np.linalg.solve(target.root, (posterior.chains.mean(axis=(1, 2)) - target.mean).T)
    scatter = np.mean(white**2) * posterior.ess.mean() / 2
    assert 0.2 < scatter < 3.0
    ends = np.log(posterior.interval(0.95))
    assert np.allclose((ends[:, 1] - ends[:, 0]) / (2 * 1.96 * std), 1, atol=0.06)


def test_short_chains_do_not_claim_convergence():
    chains, _ = run(Normal(), steps=75)
    posterior = posterior_of_chains(NAMES, chains, 5, 0.3, KNOWN)
    assert not posterior.converged
    assert "fewer than 10 autocorrelation times" in posterior.message
    assert "run about" in posterior.message
    assert "not converged" in str(posterior)


def test_ensembles_that_disagree_do_not_claim_convergence(normal_chains):
    chains, _ = normal_chains
    shifted = chains.copy()
    shifted[0, ..., 2] += 2 * chains[..., 2].std()
    posterior = posterior_of_chains(NAMES, shifted, 5, 0.3, KNOWN)
    assert not posterior.converged
    assert "R-hat" in posterior.message
    assert "for c" in posterior.message


@pytest.fixture(scope="module")
def found():
    estimate = simulate_frf(
        MODEL,
        POSITIONS[:2],
        OMEGA[2::5],
        RelativeNoise(0.03, 0.01),
        np.random.default_rng(2),
    )
    return fit(MODEL, estimate, "nls", "optimal")


def test_the_posterior_is_as_wide_as_theorem_1(found):
    told = []
    posterior = sample_posterior(
        found,
        rng=np.random.default_rng(0),
        ensembles=2,
        walkers=24,
        target=StoppingCriterion(ess=1500),
        progress=lambda done, total: told.append((done, total)),
    )
    assert posterior.converged, posterior.message
    assert posterior.scale == pytest.approx(1.0)
    ratio = covariance(found).std / posterior.uncertainty().std
    assert (ratio > 0.9).all()
    assert (ratio < 1.1).all()
    assert told[-1] == (2 * posterior.steps, 2 * posterior.steps)
    assert posterior.ess.min() >= 1500
    assert posterior.r_hat.max() <= 1.01
    assert posterior.steps - posterior.burn_in >= 10 * posterior.autocorrelation_time.max()
    assert told[0] == (200, 40_000)
    assert "converged" in str(posterior)
    assert "k12" in str(posterior)


@pytest.mark.parametrize("residual", ["nls", "lls", "lls_magnitude"])
@pytest.mark.parametrize("weights", ["optimal", "full"])
def test_log_posterior_is_minus_the_cost_inside_the_bounds(residual, weights):
    estimate = exact(full_covariance((3, 23, 2, 2))) if weights == "full" else exact()
    found = fit(MODEL, estimate, residual, "optimal")
    target = log_posterior(found, Noise(scale=0.5))
    shifts = np.array([[0.0] * 6, [0.05, -0.02, 0.1, 0.3, -0.2, 0.1], [20.0] + [0.0] * 5])
    x = np.log(found.parameters.values) + shifts
    value = target(x)
    moved = fit(MODEL, estimate, residual, "optimal", start=np.exp(x[1]), max_evaluations=1)
    assert value[0] == pytest.approx(0.0, abs=1e-6)
    assert value[1] == pytest.approx(-0.5 * moved.cost)
    assert value[2] == -np.inf
    assert (pickle.loads(pickle.dumps(target))(x) == value).all()


def test_the_sampled_density_is_that_of_the_cost(found):
    """No adjustment to Theorem 1 hides that weights are seven times too large."""
    scaled = fit(MODEL, found.estimate, "nls", 7.0 * found.weights)
    posterior = sample_posterior(
        scaled, rng=np.random.default_rng(0), ensembles=2, walkers=12, steps=50
    )
    assert posterior.scale == 1.0


def test_the_backend_of_another_problem_is_refused(found, tmp_path):
    path = tmp_path / "chains.h5"
    arguments = {"ensembles": 2, "walkers": 16, "steps": 50, "backend": path}
    first = sample_posterior(found, rng=np.random.default_rng(5), **arguments)
    again = sample_posterior(found, rng=np.random.default_rng(5), **arguments)
    assert (again.chains == first.chains).all()
    longer = sample_posterior(found, rng=np.random.default_rng(5), **arguments | {"steps": 100})
    assert longer.steps == 100
    other = simulate_frf(
        MODEL, POSITIONS[:2], OMEGA[2::5], RelativeNoise(0.03, 0.01), np.random.default_rng(3)
    )
    prior = Prior(("k1",), np.array([900.0]), np.array([0.1]))
    for fitted, seed, more in (
        (found, 6, {}),
        (fit(MODEL, other, "nls", "optimal"), 5, {}),
        (found, 5, {"thin": 4}),
        (found, 5, {"prior": prior}),
        (found, 5, {"noise": "unknown"}),
    ):
        with pytest.raises(InvalidInput, match=r"chains\.h5: holds chains of another fit, seed"):
            sample_posterior(fitted, rng=np.random.default_rng(seed), **arguments | more)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"ensembles": 1}, "at least 2 are needed"),
        ({"walkers": 10}, "10 are too few for 6 parameters; at least 12"),
        ({"steps": 10}, "fewer than 10 snapshots"),
        ({"thin": 0}, "fewer than 10 snapshots"),
        ({"steps": 10**12}, "posterior: ensembles, walkers, steps: .* GB are needed"),
        ({"scale": 0.0}, "scale: 0.0 is not a number > 0"),
        ({"noise": "unknwon"}, "noise: 'unknwon' is unknown .did you mean 'unknown'"),
        ({"prior": Prior(("k3",), [1.0], [1.0])}, "prior: 'k3' is not a free parameter"),
        ({"starts": np.ones((3, 6))}, r"starts: shape \(3, 6\) given; \(64, 6\)"),
        ({"starts": np.tile(TRUTH * [1, 1, 1e4, 1, 1, 1], (64, 1))}, "starts: k12 = 4e.06 of"),
    ],
)
def test_settings_that_cannot_work_are_named(found, arguments, message):
    with pytest.raises(InvalidInput, match=message):
        sample_posterior(found, rng=np.random.default_rng(0), **arguments)


def test_levels_lie_between_zero_and_one(found):
    posterior = posterior_of_chains(NAMES, run(Normal(), steps=100)[0], 5, 0.3, KNOWN)
    with pytest.raises(InvalidInput, match="level 0"):
        posterior.interval(0.0)


def test_starts_stay_inside_narrow_bounds():
    estimate = simulate_frf(
        MODEL, POSITIONS, OMEGA, RelativeNoise(0.5, 0.2), np.random.default_rng(2)
    )
    found = fit(MODEL, estimate, "nls", "optimal", bounds=(0.98, 1.02))
    posterior = sample_posterior(found, rng=np.random.default_rng(0), walkers=16, steps=50)
    draws = np.exp(posterior.draws) / MODEL.parameters.values
    assert draws.min() >= 0.98
    assert draws.max() <= 1.02


class Sagging(MassSprings):
    """Its masses depend on k1, so a network of fixed equilibria from elsewhere differs."""

    def network(self, positions, parameters=None):
        network = super().network(positions, parameters)
        network.mass[:, 2, 2] *= (network.parameters.values[0] / 900.0) ** 0.2
        return network


def test_a_cost_that_is_not_the_fits_is_refused(found):
    other = replace(found, model=Sagging(), cost=2 * found.cost)
    with pytest.raises(SolverFailed, match="the cost at the fit is"):
        log_posterior(other, Noise())
