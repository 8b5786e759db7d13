"""Where an ensemble's walkers start: drawn about the mode, or given by a user."""

import numpy as np

from estimators.uncertainty.laplace import StudentT
from estimators.uncertainty.log_posterior import LogPosterior
from robotmodels.arrays import Array
from robotmodels.errors import InvalidInput

# Draws of the walkers' starts before giving up.
ROUNDS = 20


def drawn_starts(
    proposal: StudentT, density: LogPosterior, walkers: int, rng: np.random.Generator
) -> Array:
    """Return starts (W, p) drawn from the proposal, mirrored at the bounds.

    Draws without a finite cost are drawn again, closer to the mode; those left after all rounds
    are for `check_starts` to refuse.
    """
    low, high = density.bounds
    found = np.empty((walkers, len(low)))
    missing = np.ones(walkers, dtype=bool)
    for shrink in 0.8 ** np.arange(ROUNDS):
        draws = proposal.center + shrink * (proposal.draw(walkers, rng) - proposal.center)
        draws = np.where(draws < low, 2 * low - draws, draws)
        draws = np.where(draws > high, 2 * high - draws, draws)
        # What is wider than the bounds twice over is spread evenly.
        outside = (draws < low) | (draws > high)
        draws = np.where(outside, rng.uniform(low, high, draws.shape), draws)
        found[missing] = draws[missing]
        missing[missing] = ~np.isfinite(density(found[missing]))
        if not missing.any():
            break
    return found


def given_starts(
    starts: Array | None, density: LogPosterior, ensembles: int, walkers: int
) -> Array | None:
    """Return a user's `starts`, (W, p) or (E, W, p) [SI], as (E, W, p) of ln theta, or None.

    Raises
    ------
    InvalidInput
        For another shape, or a start outside the bounds.
    """
    if starts is None:
        return None
    values, p = np.asarray(starts, dtype=float), len(density.names)
    shapes = ((walkers, p), (ensembles, walkers, p))
    if values.shape not in shapes:
        raise InvalidInput(
            f"starts: shape {values.shape} given; {shapes[0]} or {shapes[1]} is needed"
        )
    values = np.broadcast_to(values, shapes[1])
    low, high = np.exp(density.bounds)
    wrong = np.argwhere(~((values >= low) & (values <= high)))
    if wrong.size:
        e, w, i = wrong[0]
        raise InvalidInput(
            f"starts: {density.names[i]} = {values[e, w, i]:g} of walker {w} lies outside its "
            f"bounds [{low[i]:g}, {high[i]:g}]"
        )
    return np.asarray(np.log(values))


def check_starts(density: LogPosterior, starts: Array) -> None:
    """Refuse walkers whose `starts` (..., p) of ln theta have no cost.

    Raises
    ------
    InvalidInput
        Telling how many, and where one of them is.
    """
    flat = starts.reshape(-1, starts.shape[-1])
    wrong = ~np.isfinite(density(flat))
    if wrong.any():
        raise InvalidInput(
            f"starts: {wrong.sum()} of {len(flat)} walkers start without a finite cost, one at "
            f"{density.described(np.exp(flat[np.argmax(wrong)]))}; start closer to the fit, or "
            "fix what the data do not tell"
        )
