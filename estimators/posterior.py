"""The posterior of a fit's parameters, sampled with emcee."""

import hashlib
from collections.abc import Callable
from concurrent.futures import Executor
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from estimators.covariance import SINGULAR, Uncertainty, covariance, sandwich_parts
from estimators.ensemble import Store, autocorrelation_time, run_ensembles
from estimators.least_squares import Fit
from estimators.residuals import Residual, find_residual
from estimators.weights import square_root, used_elements, whiten
from robotmodels.arrays import Array, ComplexArray, IntArray, read_only
from robotmodels.errors import InvalidInput, SolverFailed
from robotmodels.linear_model import LinearModel
from robotmodels.spring_network import SpringNetwork

# Vehtari et al. (2021), section 4: R-hat below 1.01 and an effective sample size above 400.
R_HAT = 1.01
ESS = 400.0
# Chains shorter than this many autocorrelation times do not tell their autocorrelation time.
TIMES = 20.0
# Matrix entries solved in one call when small systems are evaluated for many walkers.
BATCH = 2**20


@dataclass(frozen=True, eq=False)
class FixedEquilibria:
    """Logarithm of the posterior of ln theta, equilibria held fixed at the fit.

    log p = -scale V inside the bounds, flat prior in ln theta. Holding the equilibria fixed leaves
    out the change of gravity sag within the posterior, which is of the order of the sag angle
    times the relative width.

    Attributes
    ----------
    network : at the fitted parameters.
    omega, measured, weights, kind : as in the fit.
    scale : factor of the cost.
    bounds : (2, p) of ln theta.
    """

    network: SpringNetwork
    omega: Array
    measured: ComplexArray
    weights: Array | ComplexArray
    kind: Residual
    scale: float
    bounds: Array
    root: Array | ComplexArray = field(init=False)
    used: NDArray[np.bool_] = field(init=False)

    def __post_init__(self) -> None:
        shape = self.measured.shape
        object.__setattr__(self, "root", square_root(self.weights, shape))
        object.__setattr__(self, "used", used_elements(self.weights, shape))

    def __call__(self, ln_theta: Array) -> Array:
        """Return log p (W,), up to a constant, at `ln_theta` (W, p)."""
        ln_theta = np.atleast_2d(ln_theta)
        inside = ((ln_theta >= self.bounds[0]) & (ln_theta <= self.bounds[1])).all(axis=1)
        result = np.full(len(ln_theta), -np.inf)
        if inside.any():
            cost = self.costs(np.exp(ln_theta[inside]))
            result[inside] = np.where(np.isfinite(cost), -self.scale * cost, -np.inf)
        return result

    def costs(self, parameters: Array) -> Array:
        """Return the fit's cost V (W,) at `parameters` (W, p) [SI]."""
        result = np.empty(len(parameters))
        q, d = self.network.mass.shape[:2]
        together = max(1, BATCH // (q * len(self.omega) * d**2))
        for first in range(0, len(parameters), together):
            models = [self.network.linear_model(t) for t in parameters[first : first + together]]
            batch = LinearModel(
                mass=self.network.mass,
                damping=np.stack([model.damping for model in models]),
                stiffness=np.stack([model.stiffness for model in models]),
                selector=self.network.selector,
            )
            for i, G in enumerate(batch.frequency_response(self.omega), first):
                error = whiten(self.root, self.kind.error(self.measured, G, self.used))
                result[i] = np.sum(np.abs(error) ** 2)
        return result


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
    steps: int = 3000,
    thin: int = 5,
    scale: float | None = None,
    backend: str | Path | None = None,
    progress: Callable[[int, int], None] | None = None,
    executor: Executor | None = None,
) -> Posterior:
    """Return draws from exp(-scale V), V the fitted cost, with a flat prior of ln theta in bounds.

    For nls with optimal weights that is the exact likelihood. The scale makes the posterior as
    wide as Theorem 1 on average: p / tr(bread^-1 meat), one for optimal weights (the magnitude
    adjustment of Pauli, Racugno and Ventura 2011, eq. 8). With other weights single parameters'
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
    InvalidInput : for too few ensembles, walkers or steps, or a backend of another fit or seed.
    NotIdentifiable : if the information at the fit is singular.
    """
    p = len(fit.parameters)
    _check_sizes(p, ensembles, walkers, steps, thin)
    width = covariance(fit)
    scale = _scale(fit) if scale is None else float(scale)
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


def log_posterior(fit: Fit, scale: float) -> FixedEquilibria:
    """Return the function that is sampled.

    Raises
    ------
    SolverFailed : if the cost with fixed equilibria is not the fit's own at the fit.
    """
    theta = fit.parameters.values
    kind = find_residual(fit.residual)
    target = FixedEquilibria(
        network=fit.model.network(fit.estimate.positions, theta),
        omega=fit.estimate.omega,
        measured=fit.estimate.response,
        weights=fit.weights,
        kind=kind,
        scale=scale,
        bounds=read_only(np.log(fit.bounds)),
    )
    cost = target.costs(theta[None])[0]
    if not np.isclose(cost, fit.cost, rtol=1e-6):
        raise SolverFailed(f"posterior: the cost at the fit is {cost:g}, the fit's {fit.cost:g}")
    return target


def judged(
    names: tuple[str, ...], chains: Array, thin: int, acceptance: float, scale: float
) -> Posterior:
    """Return the posterior of chains (E, T, W, p): burn-in left out, convergence examined.

    Three autocorrelation times are left out, at most half of the chain.
    """
    from arviz_stats.base.array import array_stats

    statistics: Any = array_stats  # has no types
    tau, _ = autocorrelation_time(chains, TIMES)
    burn = min(chains.shape[1] // 2, int(np.ceil(3 * tau.max())))
    kept = chains[:, burn:]
    tau, trusted = autocorrelation_time(kept, TIMES)
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
    if not trusted:
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
