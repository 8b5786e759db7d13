"""Whether chains of walkers are long enough: R-hat, effective sample size, autocorrelation time."""

from dataclasses import dataclass

import numpy as np

from estimators.sampling.mixing import bulk_size, rank_r_hat
from robotmodels.common.arrays import Array
from robotmodels.common.errors import InvalidInput

# Vehtari et al. (2021): R-hat below 1.01 and an effective sample size above 400.
R_HAT = 1.01
ESS = 400.0
# Enough for standard deviations to about 1 %, as 1/sqrt(2 ESS).
AIM = 4000.0
# Chains shorter than this many autocorrelation times do not tell their autocorrelation time.
TIMES = 10.0
# What a start drawn about the fit needs to forget it.
BURN_IN_TIMES = 3.0


@dataclass(frozen=True)
class StoppingCriterion:
    """Criterion by which an ensemble of walkers stops.

    Attributes
    ----------
    r_hat : float
        Largest R-hat.
    ess : float
        Smallest effective sample size; 400 tell convergence, the default tells widths to 1 %.
    """

    r_hat: float = R_HAT
    ess: float = AIM

    def __post_init__(self) -> None:
        if not (self.r_hat > 1 and self.ess > 0):
            raise InvalidInput(
                f"target: R-hat {self.r_hat:g} and effective size {self.ess:g}; more than 1 and 0 "
                "are needed"
            )


@dataclass(frozen=True, eq=False)
class ChainConvergence:
    """Burn-in, mixing and convergence of chains (E, T, W, p).

    Attributes
    ----------
    burn_in : int
        Number of snapshots that are dropped at the start.
    autocorrelation_time : ndarray, (p,)
        Autocorrelation time in snapshots.
    r_hat, ess : ndarray, (p,)
        See `r_hat` and `effective_size`.
    faults : tuple of str
        Reasons against convergence; none if converged.
    short : str
        Criterion that the chains miss although converged; empty if none.
    needed : int
        Number of snapshots that is likely to be enough.
    """

    burn_in: int
    autocorrelation_time: Array
    r_hat: Array
    ess: Array
    faults: tuple[str, ...]
    short: str
    needed: int


def assess_convergence(
    names: tuple[str, ...], chains: Array, target: StoppingCriterion
) -> ChainConvergence:
    """Return burn-in and convergence of chains (E, T, W, p).

    Three autocorrelation times are dropped, at most half of the chain.
    """
    burn, tau = burn_in(chains)
    used = chains[:, burn:]
    e, t, w, _ = used.shape
    r_hats, ess = r_hat(used), effective_size(used)
    per_snapshot = np.nanmin(ess) / t if np.isfinite(ess).any() else e * w / tau.max()
    needed = max(TIMES * tau.max(), target.ess / per_snapshot) + burn
    if not r_hats.max() <= R_HAT:
        needed = max(needed, 2 * chains.shape[1])
    worst, least = names[int(np.argmax(r_hats))], names[int(np.argmin(ess))]
    faults = []
    if not r_hats.max() <= R_HAT:
        faults.append(f"R-hat {r_hats.max():.3f} for {worst} (at most {R_HAT:g})")
    if not ess.min() >= ESS:
        faults.append(f"effective sample size {ess.min():.0f} for {least} (at least {ESS:.0f})")
    if t < TIMES * tau.max():
        slow = names[int(np.argmax(tau))]
        faults.append(
            f"{t} snapshots are fewer than {TIMES:.0f} autocorrelation times, {tau.max():.0f} "
            f"snapshots for {slow}"
        )
    short = ""
    if not (r_hats.max() <= target.r_hat and ess.min() >= target.ess):
        short = f"short of R-hat {target.r_hat:g} and effective size {target.ess:.0f}"
    return ChainConvergence(burn, tau, r_hats, ess, tuple(faults), short, int(np.ceil(needed)))


def has_converged(chains: Array, target: StoppingCriterion) -> bool:
    """Return whether chains meet the criterion, by the cheapest tests first."""
    burn, tau = burn_in(chains)
    used = chains[:, burn:]
    if used.shape[1] < TIMES * tau.max() or not effective_size(used).min() >= target.ess:
        return False
    return bool(r_hat(used).max() <= target.r_hat)


def burn_in(chains: Array) -> tuple[int, Array]:
    """Return the snapshots to leave out of chains (E, T, W, p), and tau (p,) of what remains."""
    first = autocorrelation_time(chains)
    burn = min(chains.shape[1] // 2, int(np.ceil(BURN_IN_TIMES * first.max())))
    return burn, autocorrelation_time(chains[:, burn:])


def r_hat(chains: Array) -> Array:
    """Return the rank-normalised split R-hat (p,) across ensembles.

    One series per ensemble, its walkers in order of time: those of one ensemble are not
    independent, so only ensembles may be compared.
    """
    e, t, w, p = chains.shape
    series = np.moveaxis(chains, -1, 0).reshape(p, e, t * w)
    return np.array([rank_r_hat(one) for one in series])


def effective_size(chains: Array) -> Array:
    """Return the bulk effective sample size (p,) of all walkers' series."""
    e, t, w, p = chains.shape
    series = np.moveaxis(chains, (-1, 2), (0, 2)).reshape(p, e * w, t)
    return np.array([bulk_size(one) for one in series])


def autocorrelation_time(chains: Array) -> Array:
    """Return integrated autocorrelation times (p,) in snapshots of chains (E, T, W, p).

    Sokal's window of five times, as in emcee, but about the mean of all walkers in all ensembles:
    about each walker's own mean, short chains seem to forget far too soon.
    """
    e, t, w, p = chains.shape
    times = np.empty(p)
    for i in range(p):
        series = np.moveaxis(chains[..., i], 1, -1).reshape(e * w, t)
        spectrum = np.fft.rfft(series - series.mean(), n=2 * t, axis=-1)
        products = np.fft.irfft(np.abs(spectrum) ** 2, n=2 * t, axis=-1)[:, :t].mean(axis=0)
        correlation = products / np.arange(t, 0, -1)
        growing = 2 * np.cumsum(correlation / correlation[0]) - 1
        outside = np.arange(t) >= 5 * growing
        times[i] = growing[int(np.argmax(outside)) if outside.any() else t - 1]
    return np.maximum(times, 1.0)
