"""Ensemble sampling: where walkers begin, and how far they have come."""

from collections.abc import Callable, Iterator
from concurrent.futures import Executor
from dataclasses import dataclass

import numpy as np

from estimators.sampling.chain_checkpoint import Chain, Store
from estimators.sampling.log_posterior import LogPosterior
from estimators.sampling.student_t_proposal import StudentT
from robotmodels.common.arrays import Array, IntArray
from robotmodels.common.errors import InvalidInput
from robotmodels.common.progress import Progress, tell

LogProbability = Callable[[Array], Array]

# Snapshots before the first check, whose chains are rarely long enough, and between two checks and
# two writes: at least so many, and a share of the past.
FIRST = 20
CHUNK = 5
CHUNK_SHARE = 0.1


@dataclass(frozen=True, eq=False)
class Sampler:
    """What advances an ensemble: picklable, so that another process can.

    Attributes
    ----------
    log_probability : LogProbability, (w, p)
        -> (w,); minus infinity outside the support.
    thin : int
        Steps from one snapshot to the next.
    proposal : StudentT or None
        Proposal of the independent moves; None for none.
    """

    log_probability: LogProbability
    thin: int
    proposal: StudentT | None = None

    def start(self, walkers: Array, seed: int) -> Chain:
        """Return an ensemble at `walkers` (W, p) that has not moved yet."""
        w = len(walkers)
        state = tuple(np.random.RandomState(seed).get_state(legacy=True))
        return Chain(walkers[None], np.full((1, w), np.nan), np.zeros((1, w), dtype=bool), state)

    def advance(self, task: tuple[Chain, int]) -> Chain:
        """Return the next snapshots of a chain."""
        # Imported here, by the processes that advance chains: it takes long to load.
        import emcee

        from estimators.sampling.moves import moves

        chain, snapshots = task
        walkers, p = chain.walkers.shape[1:]
        sampler = emcee.EnsembleSampler(
            walkers, p, self.log_probability, moves=moves(self.proposal), vectorize=True
        )
        # emcee's wrapper of it would print a traceback when interrupted.
        sampler.log_prob_fn = self.log_probability
        last = chain.log_probability[-1]
        state = emcee.State(
            chain.walkers[-1].copy(),
            log_prob=None if np.isnan(last).any() else last.copy(),
            random_state=chain.random_state,
        )
        totals = [np.zeros(walkers)]  # emcee counts what was taken in the steps it keeps
        steps = sampler.sample(
            state, iterations=snapshots, thin_by=self.thin, skip_initial_state_check=True
        )
        for state in steps:  # noqa: B007  # the last one is needed
            totals.append(sampler.backend.accepted.copy())
        return Chain(
            sampler.get_chain(),
            sampler.get_log_prob(),
            np.diff(totals, axis=0) > 0,
            tuple(state.random_state),
        )


def marks(limit: int) -> Iterator[int]:
    """Return the numbers of snapshots at which chains are checked and written, up to `limit`."""
    t = 0
    while t < limit:
        t = min(limit, max(FIRST, t + max(CHUNK, int(CHUNK_SHARE * t))))
        yield t


def run_ensembles(
    sampler: Sampler,
    starts: Array,
    seeds: IntArray,
    limit: int,
    has_converged: Callable[[Array], bool] | None = None,
    store: Store | None = None,
    progress: Progress | None = None,
    executor: Executor | None = None,
) -> tuple[Array, float]:
    """Return chains (E, T, W, p) of independent ensembles, and the fraction of proposals taken.

    The result depends neither on the executor nor on interruptions.

    Parameters
    ----------
    starts : ndarray, (E, W, p)
        Starts.
    seeds : ndarray of int, (E,)
        Seeds.
    limit : int
        Snapshots after which to stop in any case.
    has_converged : callable, optional
        Told the chains so far, whether to stop; None goes on to the limit.
    store : Store, optional
        Stores the chains, and lets them go on.
    progress : Progress, optional
        Called with the steps of all ensembles, and with those up to the limit; at the end with the
        steps done, twice.
    executor : Executor, optional
        Advances the ensembles; in sequence where None.
    """
    stored = None if store is None else store.load()
    begun = [sampler.start(w, int(s)) for w, s in zip(starts, seeds, strict=True)]
    chains = begun if stored is None else stored
    per_snapshot = sampler.thin * len(chains)
    done, mark = 0 if stored is None else len(chains[0].walkers), 0
    for mark in marks(limit):
        if mark > done:
            more = _advanced(sampler, chains, mark - done, executor)
            fresh = chains is begun
            chains = (
                more if fresh else [c.followed_by(m) for c, m in zip(chains, more, strict=True)]
            )
            done = mark
            if store is not None:
                store.save(chains)
            tell(progress, per_snapshot * mark, per_snapshot * limit)
        if has_converged is not None and has_converged(
            np.stack([c.walkers[:mark] for c in chains])
        ):
            break
    tell(progress, per_snapshot * mark, per_snapshot * mark)
    taken = np.mean([c.accepted[:mark] for c in chains])
    return np.stack([c.walkers[:mark] for c in chains]), float(taken)


def _advanced(
    sampler: Sampler, chains: list[Chain], snapshots: int, executor: Executor | None
) -> list[Chain]:
    # The last snapshot is all that another process needs.
    tasks = [
        (Chain(c.walkers[-1:], c.log_probability[-1:], c.accepted[-1:], c.random_state), snapshots)
        for c in chains
    ]
    one = sampler.advance
    return list(map(one, tasks) if executor is None else executor.map(one, tasks))


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
    starts = np.empty((walkers, len(low)))
    missing = np.ones(walkers, dtype=bool)
    for shrink in 0.8 ** np.arange(ROUNDS):
        draws = proposal.center + shrink * (proposal.draw(walkers, rng) - proposal.center)
        draws = np.where(draws < low, 2 * low - draws, draws)
        draws = np.where(draws > high, 2 * high - draws, draws)
        # What is wider than the bounds twice over is spread evenly.
        outside = (draws < low) | (draws > high)
        draws = np.where(outside, rng.uniform(low, high, draws.shape), draws)
        starts[missing] = draws[missing]
        missing[missing] = ~np.isfinite(density(starts[missing]))
        if not missing.any():
            break
    return starts


def checked_starts(
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
            "fix parameters that the data do not determine"
        )
