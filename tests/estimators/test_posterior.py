import pickle
from concurrent.futures import ThreadPoolExecutor

import emcee
import numpy as np
import pytest
from mass_springs import OMEGA, POSITIONS, MassSprings
from test_frf_estimate import full_covariance
from test_least_squares import MODEL, exact

from estimators import covariance, fit, sample_posterior, simulate_frf
from estimators.ensemble import SnookerMove, autocorrelation_time, run_ensembles
from estimators.log_posterior import log_posterior
from estimators.posterior import judged
from robotmodels import InvalidInput, RelativeNoise, SolverFailed

P = 5


def sampled_variance(move, seed=0, steps=700, walkers=20):
    """Variance that a move gives to N(0, I); its truth is 1."""
    state = np.random.RandomState(seed)
    sampler = emcee.EnsembleSampler(
        walkers, P, lambda x: -0.5 * np.sum(x**2, axis=1), vectorize=True, moves=[move]
    )
    start = emcee.State(state.randn(walkers, P), random_state=state.get_state())
    sampler.run_mcmc(start, steps, skip_initial_state_check=True)
    return sampler.get_chain()[100:].var()


def test_the_snooker_move_keeps_the_normal_and_the_stock_one_does_not():
    assert abs(sampled_variance(SnookerMove()) - 1) < 0.1
    assert sampled_variance(emcee.moves.DESnookerMove()) < 0.85


def test_a_walker_on_its_anchor_stays():
    random = np.random.RandomState(0)
    sample = np.zeros((1, 2))
    proposal, factor = SnookerMove().get_proposal(sample, [np.zeros((1, 2))] * 3, random)
    assert (proposal == sample).all()
    assert factor[0] == -np.inf


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


def run(target, steps=600, seed=0, starts=None, **arguments):
    rng = np.random.default_rng(seed)
    starts = target.starts(2, 32, rng) if starts is None else starts
    seeds = rng.integers(2**32, size=len(starts))
    return run_ensembles(target, starts, seeds, steps // 5, 5, **arguments)


@pytest.fixture(scope="module")
def normal_chains():
    return run(Normal())


def test_a_normal_posterior_is_found(normal_chains):
    target = Normal()
    chains, acceptance = normal_chains
    posterior = judged(NAMES, chains, 5, acceptance.mean(), 1.0)
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
    posterior = judged(NAMES, chains, 5, 0.3, 1.0)
    assert not posterior.converged
    assert "fewer than 10 autocorrelation times" in posterior.message
    assert "run about" in posterior.message
    assert "not converged" in str(posterior)


def test_autocorrelation_times_of_an_autoregression_are_known():
    """x' = a x + noise has the time (1 + a)/(1 - a), in short chains too."""
    rng, a = np.random.default_rng(0), 0.8
    x = np.empty((4, 80, 200, 1))
    x[:, 0] = rng.standard_normal((4, 200, 1))
    for t in range(1, 80):
        x[:, t] = a * x[:, t - 1] + np.sqrt(1 - a**2) * rng.standard_normal((4, 200, 1))
    assert autocorrelation_time(x)[0] == pytest.approx(9.0, rel=0.1)


def test_ensembles_that_disagree_do_not_claim_convergence(normal_chains):
    chains, _ = normal_chains
    shifted = chains.copy()
    shifted[0, ..., 2] += 2 * chains[..., 2].std()
    posterior = judged(NAMES, shifted, 5, 0.3, 1.0)
    assert not posterior.converged
    assert "R-hat" in posterior.message
    assert "for c" in posterior.message


def test_ensembles_are_reproducible_and_independent_of_the_executor():
    first, _ = run(Normal(), steps=100)
    second, _ = run(Normal(), steps=100)
    with ThreadPoolExecutor(2) as executor:
        third, _ = run(Normal(), steps=100, executor=executor)
    other, _ = run(Normal(), steps=100, seed=1)
    assert (first == second).all()
    assert (first == third).all()
    assert (first != other).all()
    assert not np.allclose(first[0], first[1])


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
        steps=550,
        progress=lambda done, total: told.append((done, total)),
    )
    assert posterior.converged, posterior.message
    assert posterior.scale == pytest.approx(1.0)
    ratio = covariance(found).std / posterior.uncertainty().std
    assert (ratio > 0.9).all()
    assert (ratio < 1.1).all()
    assert told[-1] == (1100, 1100)
    assert "converged" in str(posterior)
    assert "k12" in str(posterior)


@pytest.mark.parametrize("residual", ["nls", "lls", "lls_magnitude"])
@pytest.mark.parametrize("weights", ["optimal", "full"])
def test_log_posterior_is_minus_the_cost_inside_the_bounds(residual, weights):
    estimate = exact(full_covariance((3, 23, 2, 2))) if weights == "full" else exact()
    found = fit(MODEL, estimate, residual, "optimal")
    target = log_posterior(found, 0.5)
    shifts = np.array([[0.0] * 6, [0.05, -0.02, 0.1, 0.3, -0.2, 0.1], [20.0] + [0.0] * 5])
    x = np.log(found.parameters.values) + shifts
    value = target(x)
    moved = fit(MODEL, estimate, residual, "optimal", start=np.exp(x[1]), max_evaluations=1)
    assert value[0] == pytest.approx(0.0, abs=1e-6)
    assert value[1] == pytest.approx(-0.5 * moved.cost)
    assert value[2] == -np.inf
    assert (pickle.loads(pickle.dumps(target))(x) == value).all()


def test_scaled_weights_do_not_change_the_posterior(found):
    """The magnitude adjustment undoes a common factor of the weights."""
    scaled = fit(MODEL, found.estimate, "nls", 7.0 * found.weights)
    posterior = sample_posterior(
        scaled, rng=np.random.default_rng(0), ensembles=2, walkers=12, steps=50
    )
    assert posterior.scale == pytest.approx(1 / 7)


def test_an_interrupted_run_goes_on_as_if_nothing_had_happened(found, tmp_path):
    def stop(done, total):
        if done >= 150:
            raise KeyboardInterrupt

    def sample(backend, progress=None):
        return sample_posterior(
            found,
            rng=np.random.default_rng(5),
            ensembles=2,
            walkers=16,
            steps=120,
            thin=2,
            backend=backend,
            progress=progress,
        )

    whole = sample(None)
    path = tmp_path / "chains.h5"
    # Interrupted before the first block, too.
    emcee.backends.HDFBackend(str(path), name="ensemble_1").reset(16, 6)
    with pytest.raises(KeyboardInterrupt):
        sample(path, stop)
    partial = emcee.backends.HDFBackend(str(path), name="ensemble_0")
    assert 0 < partial.iteration < 60
    resumed = sample(path)
    assert (resumed.chains == whole.chains).all()
    assert resumed.acceptance == whole.acceptance
    reader = emcee.backends.HDFBackend(str(path), name="ensemble_1", read_only=True)
    assert reader.get_chain().shape == (60, 16, 6)
    assert (sample(path).chains == whole.chains).all()  # nothing left to do


def test_a_backend_of_another_run_is_refused(found, tmp_path):
    path = tmp_path / "chains.h5"
    arguments = {"ensembles": 2, "walkers": 16, "steps": 50, "backend": path}
    sample_posterior(found, rng=np.random.default_rng(5), **arguments)
    with pytest.raises(InvalidInput, match=r"chains\.h5: holds chains of another fit, seed"):
        sample_posterior(found, rng=np.random.default_rng(6), **arguments)
    path.write_text("no chains")
    with pytest.raises(InvalidInput, match="not an HDF5 file"):
        sample_posterior(found, rng=np.random.default_rng(5), **arguments)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"ensembles": 1}, "at least 2 are needed"),
        ({"walkers": 10}, "10 are too few for 6 parameters; at least 12"),
        ({"steps": 10}, "fewer than 10 snapshots"),
        ({"thin": 0}, "fewer than 10 snapshots"),
        ({"scale": 0.0}, "scale: 0 is not a positive"),
    ],
)
def test_settings_that_cannot_work_are_named(found, arguments, message):
    with pytest.raises(InvalidInput, match=message):
        sample_posterior(found, rng=np.random.default_rng(0), **arguments)


def test_levels_lie_between_zero_and_one(found):
    posterior = judged(NAMES, run(Normal(), steps=100)[0], 5, 0.3, 1.0)
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
    other = type(found)(**(vars(found) | {"model": Sagging(), "cost": 2 * found.cost}))
    with pytest.raises(SolverFailed, match="the cost at the fit is"):
        log_posterior(other, 1.0)
