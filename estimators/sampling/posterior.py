"""The posterior of a fit's parameters, sampled with emcee until it is good enough."""

from concurrent.futures import Executor
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from estimators.fitting.fitted_model import FittedModel
from estimators.fitting.priors import Prior
from estimators.sampling.chain_checkpoint import Store
from estimators.sampling.convergence import StoppingCriterion, assess_convergence, has_converged
from estimators.sampling.ensemble import (
    Sampler,
    check_starts,
    checked_starts,
    drawn_starts,
    run_ensembles,
)
from estimators.sampling.likelihood import Noise
from estimators.sampling.log_posterior import LogPosterior, posterior_density
from estimators.sampling.student_t_proposal import StudentT, laplace
from estimators.uncertainty.covariance import Uncertainty
from robotmodels.common.arrays import (
    Array,
    IntArray,
    check_kind,
    check_level,
    check_memory,
    read_only,
)
from robotmodels.common.errors import InvalidInput
from robotmodels.common.fingerprints import fingerprint
from robotmodels.common.printing import ReprHtml
from robotmodels.common.process_pool import elsewhere
from robotmodels.common.progress import Progress

_COPIES = 2  # of the chains, while they are joined


@dataclass(frozen=True, eq=False)
class Posterior(ReprHtml):
    """Posterior draws of ln theta, with diagnostics of their convergence.

    Attributes
    ----------
    names : tuple of str
        p parameters.
    chains : ndarray, (ensembles, snapshots, walkers, p)
        Chains of ln theta after burn-in.
    r_hat : ndarray, (p,)
        Across ensembles; walkers of one ensemble are not independent.
    ess : ndarray, (p,)
        Effective number of draws in all ensembles.
    autocorrelation_time : ndarray, (p,), steps
        Autocorrelation time.
    burn_in : int
        Number of steps dropped at the start.
    steps : int
        Steps of each ensemble, burn-in included.
    acceptance : float
        Fraction of proposals taken.
    noise : Noise
        Assumption on the noise.
    converged : bool
        Whether R-hat, effective sizes and length are good enough.
    message : str
        If not, which parameter is worst and what to do.
    """

    names: tuple[str, ...]
    chains: Array
    r_hat: Array
    ess: Array
    autocorrelation_time: Array
    burn_in: int
    steps: int
    acceptance: float
    noise: Noise
    converged: bool
    message: str

    @property
    def scale(self) -> float:
        """The factor of the cost, see `sample_posterior`."""
        return self.noise.scale

    @property
    def draws(self) -> Array:
        """All draws of ln theta, (N, p)."""
        return self.chains.reshape(-1, self.chains.shape[-1])

    def uncertainty(self) -> Uncertainty:
        """Return the draws' covariance."""
        draws = self.draws
        return Uncertainty(
            self.names,
            np.cov(draws, rowvar=False, ddof=1).reshape(draws.shape[1], draws.shape[1]),
            "emcee",
        )

    def interval(self, level: float = 0.95) -> Array:
        """Return central credible intervals, (p, 2), of the parameters [SI]."""
        check_level(level, "interval")
        ends = np.quantile(self.draws, [(1 - level) / 2, (1 + level) / 2], axis=0)
        return np.asarray(np.exp(ends.T))

    def __str__(self) -> str:
        width = max(len(name) for name in self.names)
        lines = [f"posterior: {self.message}; acceptance {self.acceptance:.2f}"]
        for name, std, r, n in zip(
            self.names, self.uncertainty().std, self.r_hat, self.ess, strict=True
        ):
            lines.append(f"  {name:<{width}}  std {std:.4g}  R-hat {r:.3f}  ESS {n:.0f}")
        return "\n".join(lines)


def sample_posterior(
    fit: FittedModel,
    *,
    rng: np.random.Generator,
    ensembles: int = 4,
    walkers: int = 64,
    steps: int = 20_000,
    thin: int = 5,
    noise: str = "known",
    scale: float | None = None,
    prior: Prior | None = None,
    target: StoppingCriterion | None = None,
    starts: Array | None = None,
    backend: str | Path | None = None,
    progress: Progress | None = None,
    executor: Executor | None = None,
) -> Posterior:
    """Return draws from the likelihood of a fit's cost V times the prior, within the fit's bounds.

    For nls with optimal weights exp(-V) is the likelihood. With other weights it is the density of
    the cost of the fit and no likelihood: its widths are not those of the estimates, which
    `likelihood_fit` gives.

    Sampling ends once the chains meet the target, after 3 autocorrelation times of burn-in.
    Of the moves 0.65 are independent draws from a Student t about the mode, 0.28 differential
    evolution, 0.07 snooker updates.

    Parameters
    ----------
    rng : Generator
        Source of the seeds and starts.
    ensembles : int
        Independent ones, at least 2, for R-hat.
    walkers : int
        Walkers in each, at least twice the parameters.
    steps : int
        Steps of each ensemble at most.
    thin : int
        Steps from one stored snapshot to the next.
    noise : str
        "known" or "unknown" (but for one common factor), see
        `estimators.sampling.likelihood.Noise`.
    scale : float, optional
        Factor of V where the noise is known; one where None.
    prior : Prior, optional
        None takes the fit's cost.
    target : Target, optional
        R-hat and least effective sample size at which to stop; 1.01 and 4000 where None.
    starts : ndarray, (walkers, p) or (ensembles, walkers, p), optional
        Parameter values [SI]; None draws them about the mode.
    backend : str or Path, optional
        HDF5 file, read by ``emcee.backends.HDFBackend(path, name="ensemble_0")``; a run that was
        interrupted goes on from it, as does one with more steps. None keeps the chains in memory
        only.
    progress : Progress, optional
        Called with the steps done in all ensembles, and the most there can be.
    executor : Executor, optional
        Advances the ensembles; in sequence where None.

    Raises
    ------
    InvalidInput
        For too few ensembles, walkers or steps, noise settings that do not fit, a start outside the
        bounds or without a cost, or a backend of another fit or seed.
    SolverFailed
        If a cost is not a number, with the parameters.
    """
    check_kind(fit, FittedModel, "posterior: fit")
    check_sizes(len(fit.parameters), ensembles, walkers, steps, thin)
    seeds = rng.integers(2**32, size=ensembles, dtype=np.int64)
    density, proposal, first = elsewhere(
        executor, _begun, fit, (noise, scale, prior), walkers, seeds, starts
    )
    aim, store = target or StoppingCriterion(), None
    if backend is not None:
        told = _fingerprint(fit, density, seeds, walkers, thin, starts)
        store = Store(Path(backend), told)
    chains, acceptance = run_ensembles(
        Sampler(density, thin, proposal),
        first,
        seeds,
        steps // thin,
        lambda so_far: has_converged(so_far, aim),
        store,
        progress,
        executor,
    )
    return posterior_of_chains(density.names, chains, thin, acceptance, density.noise, aim)


def _begun(
    fit: FittedModel,
    settings: tuple[str, float | None, Prior | None],
    walkers: int,
    seeds: IntArray,
    starts: Array | None,
) -> tuple[LogPosterior, StudentT, Array]:
    """Return what is sampled, the proposal, and where ensembles begin, (E, W, p)."""
    noise, scale, prior = settings
    density = posterior_density(fit, noise=noise, scale=scale, prior=prior)
    proposal = laplace(fit, density)
    first = checked_starts(starts, density, len(seeds), walkers)
    if first is None:
        rngs = [np.random.default_rng(int(seed)) for seed in seeds]
        first = np.stack([drawn_starts(proposal, density, walkers, one) for one in rngs])
    check_starts(density, first)
    return density, proposal, first


def posterior_of_chains(
    names: tuple[str, ...],
    chains: Array,
    thin: int,
    acceptance: float,
    noise: Noise,
    target: StoppingCriterion | None = None,
) -> Posterior:
    """Return the posterior of chains (E, T, W, p): without burn-in, with its convergence."""
    convergence = assess_convergence(names, chains, target or StoppingCriterion())
    steps = int(np.ceil(convergence.needed * thin / 100) * 100)
    message = "converged"
    if convergence.faults:
        message = f"not converged: {'; '.join(convergence.faults)}; run about {steps} steps"
    elif convergence.short:
        message = f"converged, {convergence.short}: that takes about {steps} steps"
    return Posterior(
        names,
        read_only(chains[:, convergence.burn_in :]),
        convergence.r_hat,
        convergence.ess,
        convergence.autocorrelation_time * thin,
        convergence.burn_in * thin,
        chains.shape[1] * thin,
        acceptance,
        noise,
        not convergence.faults,
        message,
    )


def check_sizes(p: int, ensembles: int, walkers: int, steps: int, thin: int) -> None:
    """Refuse what cannot be sampled or judged with `p` parameters.

    Raises
    ------
    InvalidInput
        For too few ensembles, walkers or steps, or more than memory holds.
    """
    if ensembles < 2:
        raise InvalidInput(f"ensembles: {ensembles}; at least 2 are needed to compare them")
    if walkers < max(2 * p, 8):
        raise InvalidInput(
            f"walkers: {walkers} are too few for {p} parameters; "
            f"at least {max(2 * p, 8)} are needed"
        )
    if thin < 1 or steps // thin < 10:
        raise InvalidInput(
            f"steps: {steps} steps, thinned by {thin}, leave fewer than 10 snapshots"
        )
    draws = ensembles * walkers * (steps // thin)
    check_memory(_COPIES * 8.0 * draws * (p + 1), "posterior: ensembles, walkers, steps")


def _fingerprint(
    fit: FittedModel,
    density: LogPosterior,
    seeds: IntArray,
    walkers: int,
    thin: int,
    starts: Array | None,
) -> str:
    """Return a digest of what the chains depend on; computed numbers rounded, inputs not."""
    data, made_of_it = fit.problem.identity
    inputs = (
        data,
        (density.names, density.noise.kind, density.prior),
        (seeds, walkers, thin, starts),
    )
    computed = (made_of_it, fit.parameters.values, fit.bounds, np.array(density.noise.scale))
    return fingerprint(inputs, (computed, density.network))
