"""The posterior of a fit's parameters, sampled with emcee."""

import hashlib
from collections.abc import Callable
from concurrent.futures import Executor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from estimators.covariance import SINGULAR, Uncertainty, covariance, sandwich_parts
from estimators.ensemble import Store, autocorrelation_time, run_ensembles
from estimators.least_squares import Fit
from estimators.log_posterior import log_posterior
from robotmodels.arrays import Array, IntArray, read_only
from robotmodels.errors import InvalidInput

# Vehtari et al. (2021): R-hat below 1.01 and an effective sample size above 400.
R_HAT = 1.01
ESS = 400.0
# Chains shorter than this many autocorrelation times do not tell their autocorrelation time.
TIMES = 10.0


@dataclass(frozen=True, eq=False)
class Posterior:
    """Draws of ln theta, and whether to trust them.

    Attributes
    ----------
    names : p parameters.
    chains : (ensembles, snapshots, walkers, p) of ln theta after burn-in.
    r_hat : (p,) across ensembles; walkers of one ensemble are not independent.
    ess : (p,) effective number of draws in all ensembles.
    autocorrelation_time : (p,) [steps].
    burn_in : steps left out.
    acceptance : fraction of proposals taken.
    scale : factor of the cost, see `sample_posterior`.
    converged : whether R-hat, effective sizes and length are good enough.
    message : if not, which parameter is worst and what to do.
    """

    names: tuple[str, ...]
    chains: Array
    r_hat: Array
    ess: Array
    autocorrelation_time: Array
    burn_in: int
    acceptance: float
    scale: float
    converged: bool
    message: str

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
        if not 0 < level < 1:
            raise InvalidInput(f"interval: level {level} does not lie between 0 and 1")
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
    fit: Fit,
    *,
    rng: np.random.Generator,
    ensembles: int = 4,
    walkers: int = 64,
    steps: int = 2000,
    thin: int = 5,
    scale: float | None = None,
    backend: str | Path | None = None,
    progress: Callable[[int, int], None] | None = None,
    executor: Executor | None = None,
) -> Posterior:
    """Return draws from exp(-scale V), V the fitted cost, with a flat prior of ln theta in bounds.

    For nls with optimal weights that is the exact likelihood. The scale makes the posterior as
    wide as Theorem 1 on average: p / tr(bread^-1 meat), one for optimal weights (the magnitude
    adjustment of Pauli, Racugno and Ventura 2011). With other weights single parameters'
    widths may still differ from Theorem 1's.

    Parameters
    ----------
    rng : source of the seeds and starts.
    ensembles : independent ones, at least 2, for R-hat.
    walkers : in each, at least twice the parameters.
    steps, thin : of each ensemble, and from one stored snapshot to the next.
    backend : HDF5 file, read by ``emcee.backends.HDFBackend(path, name="ensemble_0")``; a run that
        was interrupted goes on from it. None keeps the chains in memory only.
    progress : called with the steps done in all ensembles, and their total.
    executor : advances the ensembles; in sequence where None.

    Raises
    ------
    InvalidInput : for too few ensembles, walkers or steps, a scale that is not positive, or a
        backend of another fit or seed.
    NotIdentifiable : if the information at the fit is singular.
    """
    p = len(fit.parameters)
    _check_sizes(p, ensembles, walkers, steps, thin)
    width = covariance(fit)
    scale = _scale(fit) if scale is None else float(scale)
    if not (np.isfinite(scale) and scale > 0):
        raise InvalidInput(f"scale: {scale:g} is not a positive number")
    target = log_posterior(fit, scale)
    seeds = rng.integers(2**32, size=ensembles, dtype=np.int64)
    starts = np.stack(
        [_ball(fit, width, walkers, np.random.default_rng(int(seed))) for seed in seeds]
    )
    store = None
    if backend is not None:
        store = Store(Path(backend), _fingerprint(fit, starts, seeds, thin, scale))
    chains, acceptance = run_ensembles(
        target, starts, seeds, steps // thin, thin, store, progress, executor
    )
    return judged(fit.parameters.names, chains, thin, float(acceptance.mean()), scale)


def judged(
    names: tuple[str, ...], chains: Array, thin: int, acceptance: float, scale: float
) -> Posterior:
    """Return the posterior of chains (E, T, W, p): burn-in left out, convergence examined.

    Three autocorrelation times are left out, at most half of the chain.
    """
    from arviz_stats.base.array import array_stats

    statistics: Any = array_stats  # has no types
    tau = autocorrelation_time(chains)
    burn = min(chains.shape[1] // 2, int(np.ceil(3 * tau.max())))
    kept = chains[:, burn:]
    tau = autocorrelation_time(kept)
    e, t, w, p = kept.shape
    # Split R-hat of one chain per ensemble, its walkers in order of time.
    one = np.moveaxis(kept, -1, 0).reshape(p, e, t * w)
    r_hat = np.array([float(statistics.rhat(series)) for series in one])
    ess = e * t * w / tau
    need = max(TIMES, t * ESS / ess.min() / tau.max()) * tau.max() + burn
    if r_hat.max() > R_HAT:
        need = max(need, 2 * chains.shape[1])
    steps = int(np.ceil(need * thin / 100) * 100)
    worst = names[int(np.argmax(r_hat))], names[int(np.argmin(ess))]
    faults = []
    if not r_hat.max() <= R_HAT:
        faults.append(f"R-hat {r_hat.max():.3f} for {worst[0]} (at most {R_HAT})")
    if not ess.min() >= ESS:
        faults.append(f"effective sample size {ess.min():.0f} for {worst[1]} (at least {ESS:.0f})")
    if t < TIMES * tau.max():
        faults.append(f"{t} snapshots are fewer than {TIMES:.0f} autocorrelation times")
    message = "converged"
    if faults:
        message = f"not converged: {'; '.join(faults)}; run about {steps} steps"
    return Posterior(
        names,
        read_only(kept),
        r_hat,
        ess,
        tau * thin,
        burn * thin,
        acceptance,
        scale,
        not faults,
        message,
    )


def _check_sizes(p: int, ensembles: int, walkers: int, steps: int, thin: int) -> None:
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


def _scale(fit: Fit) -> float:
    bread, meat = sandwich_parts(fit)
    return len(bread) / float(np.trace(np.linalg.solve(bread, meat)))


def _ball(fit: Fit, width: Uncertainty, walkers: int, rng: np.random.Generator) -> Array:
    """Return starts (W, p) drawn from the Theorem 1 normal, drawn again where out of bounds."""
    center = np.log(fit.parameters.values)
    low, high = np.log(fit.bounds)
    values, vectors = np.linalg.eigh(width.correlation)
    root = width.std[:, None] * vectors * np.sqrt(np.clip(values, SINGULAR, None))
    found = np.empty((0, len(center)))
    spread = 1.0
    while len(found) < walkers:
        draws = center + spread * rng.standard_normal((walkers, len(center))) @ root.T
        found = np.concatenate([found, draws[((draws > low) & (draws < high)).all(axis=1)]])
        spread *= 0.7
    return found[:walkers]


def _fingerprint(fit: Fit, starts: Array, seeds: IntArray, thin: int, scale: float) -> str:
    digest = hashlib.sha256(repr((fit.residual, fit.parameters.names, thin, scale)).encode())
    for array in (fit.estimate.response, fit.weights, fit.parameters.values, starts, seeds):
        digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()
