"""How many modes FRFs show, and how many masses a chain would then have."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from estimators.chains.mode_search import fit_modes
from estimators.chains.modes import FittedModes
from estimators.chains.whitened_frf import Data
from robotmodels.common.arrays import Array, ComplexArray
from robotmodels.common.errors import InvalidInput, NotIdentifiable

MOST_MASSES = 8
_CLEAR = 30.0  # Wald statistic per motor, about five standard deviations
_LARGEST_DAMPING = 0.3
_EDGE = 1.1  # a resonance this far beyond the band may still be seen by its flank
_SHARE = 0.02  # of a motor's high-frequency gain
_ROUNDS = 15  # of a search whose modes are only counted
_EXCESS = 1.5  # misfit over noise from which on another mode is looked for


class WrongModeCount(InvalidInput):
    """FRFs that show more or fewer modes than the chains asked for have.

    Attributes
    ----------
    omega : ndarray, (F,), rad/s
        Angular frequencies.
    response : ndarray of complex, (F, M, M)
        FRFs that were searched.
    resonances : ndarray, (k,), rad/s
        Frequencies of the modes that the FRFs show.
    expected : int
        Number of modes.
    """

    def __init__(self, data: Data, resonances: Array, expected: int, n_masses: int) -> None:
        self.omega: Array = data.omega
        self.response: ComplexArray = data.response
        self.resonances = np.asarray(resonances)
        self.expected = expected
        m, k = data.chains, len(self.resonances)
        fits = f"; n_masses = {k // m + 1} would fit" if k and k % m == 0 else ""
        few = k < expected
        remedy = "a mode is missing from the band or hidden in noise" if few else "a mode too many"
        super().__init__(
            f"n_masses: {m} chain{'s' if m > 1 else ''} of {n_masses} masses have {expected} "
            f"resonances, {'only ' if few else ''}{k} {'is' if k == 1 else 'are'} found "
            f"({_listed(self.resonances)}): {remedy}{fits}"
        )

    def with_picture(self, path: Path) -> InvalidInput:
        """Return the error with the place of a picture of it."""
        return InvalidInput(f"{self}; picture: {path}")


@dataclass(frozen=True, eq=False)
class OrderProposal:
    """Numbers of masses that were tried, and the one the data speak for.

    Attributes
    ----------
    n_masses : int
        Proposed N.
    tried : tuple of int, (k,)
        Numbers of masses N.
    costs : ndarray, (k,)
        Sums of squared whitened residuals.
    scores : ndarray, (k,)
        BIC with the noise enlarged to the misfit of the largest order; infinite where a mode is not
        clear, or all but cancels against a zero.
    """

    n_masses: int
    tried: tuple[int, ...]
    costs: Array
    scores: Array


def propose_order(data: Data) -> OrderProposal:
    """Return the number of masses per chain that the FRFs speak for.

    Models of 2, 3, ... masses are fitted until two in a row hold a mode that is not clear. The
    score is BIC; its noise is that of the best fit, or else the distortion in real FRFs, which no
    model explains, would always ask for one mode more.

    Raises
    ------
    NotIdentifiable
        If not even two masses can be made out.
    """
    if data.undamped:
        return _count_exact(data)
    fits: list[FittedModes] = []
    for n_masses in range(2, MOST_MASSES + 1):
        count = data.chains * (n_masses - 1)
        if data.size < 4 * (count * (data.chains + 2) + 10):
            break
        fits.append(fit_modes(data, count, _ROUNDS))
        if len(fits) > 1 and _enough(fits):
            break
    if not fits:
        raise NotIdentifiable(("n_masses",), f"{len(data.omega)} lines are too few; measure more")
    costs = np.array([f.cost for f in fits])
    freedom = np.array([max(data.size - len(f.x), 1) / 2 for f in fits])
    noise = max(float((costs / freedom).min()), 1e-300)
    noise = noise if data.scaled else max(noise, 1.0)
    scores = 2 * costs / noise + np.array([len(f.x) for f in fits]) * np.log(data.size)
    scores[[not (clear_modes(f) & prominent_modes(f)).all() for f in fits]] = np.inf
    if not np.isfinite(scores).any():
        raise NotIdentifiable(("n_masses",), "no clear resonance in the band; measure a wider one")
    tried = tuple(range(2, 2 + len(fits)))
    return OrderProposal(tried[int(np.argmin(scores))], tried, costs, scores)


def _enough(fits: list[FittedModes]) -> bool:
    """Tell that higher orders will not do better: nothing left to explain, or nothing clear."""
    last, before = (clear_modes(f).all() for f in (fits[-1], fits[-2]))
    if last:
        return False
    explained = not fits[-1].data.scaled and fits[-2].misfit < _EXCESS
    return bool(not before or explained)


def clear_modes(modes: FittedModes) -> NDArray[np.bool_]:
    """Return which modes, (n,), are in the band, lightly damped and clear of the noise."""
    if modes.data.undamped:
        return np.ones(modes.layout.modes, dtype=bool)
    low, high = modes.data.omega[[0, -1]]
    m = modes.layout.chains
    noise = 1.0 if modes.data.scaled else max(modes.misfit, 1.0)
    return np.asarray(
        (modes.omega > low / _EDGE)
        & (modes.omega < high * _EDGE)
        & (modes.damping < _LARGEST_DAMPING)
        & (modes.significance > _CLEAR * m * noise)
    )


def prominent_modes(modes: FittedModes) -> NDArray[np.bool_]:
    """Return which modes, (n,), do not all but cancel against a zero in every chain.

    A proposal counts those only: in FRFs of little noise, pairs of a pole and a zero mop up what
    friction and backlash do.
    """
    share = modes.shapes**2 / modes.high_gains
    return np.asarray(share.max(axis=1) > _SHARE)


def check_not_too_few(modes: FittedModes, n_masses: int) -> None:
    """Refuse more masses than the FRFs show.

    Raises
    ------
    WrongModeCount
        With the resonances of the FRFs.
    """
    clear = clear_modes(modes)
    if not clear.all():
        raise WrongModeCount(modes.data, modes.omega[clear], modes.layout.modes, n_masses)


def check_not_too_many(modes: FittedModes, n_masses: int) -> None:
    """Refuse fewer masses than the FRFs show: more modes are clear, and halve the misfit.

    Raises
    ------
    WrongModeCount
        With the resonances of the FRFs.
    """
    data, count = modes.data, modes.layout.modes
    if data.scaled or modes.misfit < _EXCESS:
        return  # nothing is left to explain, or nobody knows how much
    more = modes
    for extra in (1, data.chains, 2 * data.chains):
        if data.size < 4 * (more.layout.size + extra * (data.chains + 2)):
            break
        trial = fit_modes(data, count + extra, _ROUNDS)
        if (clear_modes(trial) & prominent_modes(trial)).all() and trial.cost < 0.5 * more.cost:
            more = trial
    if more is not modes:
        raise WrongModeCount(data, more.omega, count, n_masses)


def _count_exact(data: Data) -> OrderProposal:
    from estimators.chains.rational_approximation import exact_poles

    count = len(exact_poles(data.omega, data.response.real))
    if count == 0 or count % data.chains:
        raise NotIdentifiable(
            ("n_masses",),
            f"{count} resonances for {data.chains} chains, which is no multiple; widen the band",
        )
    n_masses = count // data.chains + 1
    return OrderProposal(n_masses, (n_masses,), np.zeros(1), np.zeros(1))


def _listed(omega: Array) -> str:
    return ", ".join(f"{w / (2 * np.pi):.4g}" for w in omega) + (" Hz" if len(omega) else "none")
