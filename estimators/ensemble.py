"""Ensembles of walkers: moves, running in blocks, storage that can be resumed. Wraps emcee."""

from collections.abc import Callable
from concurrent.futures import Executor
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import emcee
import h5py
import numpy as np

from robotmodels.arrays import Array, IntArray
from robotmodels.errors import InvalidInput

LogProbability = Callable[[Array], Array]

# Snapshots between two writes: progress and what an interruption can cost.
BLOCK = 20


class SnookerMove(emcee.moves.RedBlueMove):  # type: ignore[misc]  # emcee has no types
    """Snooker update of ter Braak and Vrugt (2008).

    x' = x + gamma (P z1 - P z2) with P the orthogonal projection onto the line through x and z,
    accepted with the factor (|x' - z| / |x - z|)^(p - 1). emcee 3.1.6's own divides the direction
    by the root of its length, so its steps depend on where they start, and halves the exponent:
    it samples another distribution.
    """

    def __init__(self, gamma: float = 1.7) -> None:
        super().__init__(nsplits=4)
        self.gamma = gamma

    def get_proposal(
        self, sample: Array, complement: list[Array], random: np.random.RandomState
    ) -> tuple[Array, Array]:
        """Return proposals (w, p) for walkers `sample`, and logarithms of their factors (w,)."""
        w, p = sample.shape
        order = np.argsort(random.random_sample((w, 3)), axis=1)
        picks = np.stack([c[random.randint(len(c), size=w)] for c in complement])
        z, z1, z2 = (picks[order[:, i], np.arange(w)] for i in range(3))
        delta = sample - z
        before = np.linalg.norm(delta, axis=1)
        # A walker exactly on z has no line: it stays, with a factor that rejects.
        with np.errstate(invalid="ignore", divide="ignore"):
            direction = delta / before[:, None]
            along = self.gamma * np.einsum("wp,wp->w", direction, z1 - z2)
            proposal = sample + along[:, None] * direction
            after = np.linalg.norm(proposal - z, axis=1)
            factor = (p - 1) * np.log(after / before)
        apart = (before > 0) & (after > 0)
        return np.where(apart[:, None], proposal, sample), np.where(apart, factor, -np.inf)


@dataclass(frozen=True, eq=False)
class Block:
    """Snapshots (T, W, p) of one ensemble, and the state from which it goes on."""

    chain: Array
    log_probability: Array
    accepted: IntArray
    random_state: tuple[Any, ...]


def start_state(walkers: Array, seed: int) -> Block:
    """Return an ensemble at `walkers` (W, p) that has not moved yet."""
    w = len(walkers)
    random_state = tuple(np.random.RandomState(seed).get_state(legacy=True))
    return Block(walkers[None], np.full((1, w), np.nan), np.zeros(w, dtype=np.int64), random_state)


def advance(log_probability: LogProbability, block: Block, snapshots: int, thin: int) -> Block:
    """Return the next `snapshots`, `thin` steps apart: 80 % DE and 20 % snooker moves."""
    walkers, p = block.chain.shape[1:]
    sampler = emcee.EnsembleSampler(
        walkers,
        p,
        log_probability,
        moves=[(emcee.moves.DEMove(), 0.8), (SnookerMove(), 0.2)],
        vectorize=True,
    )
    last = block.log_probability[-1]
    state = emcee.State(
        block.chain[-1].copy(),
        log_prob=None if np.isnan(last).any() else last.copy(),
        random_state=block.random_state,
    )
    state = sampler.run_mcmc(state, snapshots, thin_by=thin, skip_initial_state_check=True)
    return Block(
        sampler.get_chain(),
        sampler.get_log_prob(),
        sampler.backend.accepted.astype(np.int64),
        tuple(state.random_state),
    )


class Store:
    """Chains in a file that `emcee.backends.HDFBackend` reads: one group per ensemble."""

    def __init__(self, path: Path, fingerprint: str) -> None:
        self.path = path
        self.fingerprint = fingerprint

    def load(self, ensemble: int) -> Block | None:
        """Return what is stored of an ensemble, or None.

        Raises
        ------
        InvalidInput : if the file holds the chains of something else.
        """
        if not self.path.exists():
            return None
        try:
            with h5py.File(self.path, "r") as file:
                if _group(ensemble) not in file:
                    return None
                group = file[_group(ensemble)]
                done = int(group.attrs["iteration"])
                if not done:
                    return None
                if group.attrs.get("fingerprint") != self.fingerprint:
                    raise InvalidInput(
                        f"{self.path}: holds chains of another fit, seed or sampler setting; "
                        "remove the file or name another"
                    )
                return Block(
                    group["chain"][:done],
                    group["log_prob"][:done],
                    group["accepted"][:].astype(np.int64),
                    tuple(group.attrs[f"random_state_{i}"] for i in range(5)),
                )
        except OSError as error:
            raise InvalidInput(f"{self.path}: is not an HDF5 file of chains ({error})") from error

    def append(self, ensemble: int, block: Block) -> None:
        """Add a block; the file is opened once, so that an interruption leaves whole blocks."""
        snapshots, walkers, p = block.chain.shape
        with h5py.File(self.path, "a") as file:
            name = _group(ensemble)
            fresh = name not in file or not file[name].attrs["iteration"]
        if fresh:
            emcee.backends.HDFBackend(str(self.path), name=name).reset(walkers, p)
        with h5py.File(self.path, "a") as file:
            group = file[name]
            group.attrs["fingerprint"] = self.fingerprint
            total = int(group.attrs["iteration"]) + snapshots
            for key, values in (("chain", block.chain), ("log_prob", block.log_probability)):
                group[key].resize(total, axis=0)
                group[key][total - snapshots :] = values
            group["accepted"][:] += block.accepted
            for i, value in enumerate(block.random_state):
                group.attrs[f"random_state_{i}"] = value
            group.attrs["iteration"] = total


def run_ensembles(
    log_probability: LogProbability,
    starts: Array,
    seeds: IntArray,
    snapshots: int,
    thin: int,
    store: Store | None = None,
    progress: Callable[[int, int], None] | None = None,
    executor: Executor | None = None,
) -> tuple[Array, Array]:
    """Return chains (E, T, W, p) and acceptance fractions (E,) of independent ensembles.

    The result depends neither on the executor nor on interruptions.

    Parameters
    ----------
    log_probability : (w, p) -> (w,); minus infinity outside the support.
    starts : (E, W, p).
    seeds : (E,).
    snapshots, thin : T, and steps from one to the next.
    """
    kept: list[list[Block]] = []
    for e, (walkers, seed) in enumerate(zip(starts, seeds, strict=True)):
        stored = None if store is None else store.load(e)
        kept.append([start_state(walkers, int(seed)) if stored is None else stored])
    fresh = [np.isnan(blocks[0].log_probability).any() for blocks in kept]
    done = [0 if f else len(b[0].chain) for f, b in zip(fresh, kept, strict=True)]
    total = snapshots * len(kept)
    while min(done) < snapshots:
        behind = [e for e, d in enumerate(done) if d < snapshots]
        sizes = [min(BLOCK, snapshots - done[e]) for e in behind]
        one = partial(_advance, log_probability, thin)
        tasks = [(kept[e][-1], size) for e, size in zip(behind, sizes, strict=True)]
        blocks = map(one, tasks) if executor is None else executor.map(one, tasks)
        for e, block in zip(behind, blocks, strict=True):
            kept[e].append(block)
            done[e] += len(block.chain)
            if store is not None:
                store.append(e, block)
            if progress is not None:
                progress(thin * sum(done), thin * total)
    own = [blocks[1:] if f else blocks for f, blocks in zip(fresh, kept, strict=True)]
    chains = np.stack([np.concatenate([b.chain for b in bs])[:snapshots] for bs in own])
    moved = np.array([np.mean(sum(b.accepted for b in bs)) for bs in own])
    return chains, moved / np.array(done)


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


def _group(ensemble: int) -> str:
    return f"ensemble_{ensemble}"


def _advance(log_probability: LogProbability, thin: int, task: tuple[Block, int]) -> Block:
    block, snapshots = task
    return advance(log_probability, block, snapshots, thin)
