"""Chains of walkers in an HDF5 file that emcee reads, written so that a kill cannot spoil it."""

from collections.abc import Sequence
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from robotmodels.common.arrays import Array, BoolArray
from robotmodels.common.checkpoint_file import CheckpointFile


@dataclass(frozen=True, eq=False)
class Chain:
    """Snapshots of one ensemble, and the state from which it goes on.

    Attributes
    ----------
    walkers : ndarray, (T, W, p)
        Walkers.
    log_probability : ndarray, (T, W)
        Not a number where the ensemble has not moved yet.
    accepted : ndarray of bool, (T, W)
        Whether the proposal of the step to each snapshot was taken.
    random_state : tuple of Any
        Random state of numpy's Mersenne twister.
    """

    walkers: Array
    log_probability: Array
    accepted: BoolArray
    random_state: tuple[Any, ...]

    def followed_by(self, more: "Chain") -> "Chain":
        """Return both in a row."""
        return Chain(
            np.concatenate([self.walkers, more.walkers]),
            np.concatenate([self.log_probability, more.log_probability]),
            np.concatenate([self.accepted, more.accepted]),
            more.random_state,
        )


class Store:
    """Chains in a file that ``emcee.backends.HDFBackend(path, name="ensemble_0")`` reads.

    The file is always whole: a new one is written beside it and replaces it at once. As the
    chunks between two writes grow with the chains, that costs twelve times the final size at most.

    Parameters
    ----------
    path : Path
        Path of the file.
    fingerprint : str
        Fingerprint of the problem and of the settings, so that other chains are not continued.
    """

    def __init__(self, path: Path, fingerprint: str) -> None:
        other = "chains of another fit, seed or sampler setting"
        self.file = CheckpointFile(path, fingerprint, "chains", other)

    def load(self) -> list[Chain] | None:
        """Return the chains of all ensembles, or None if there is no file.

        Raises
        ------
        InvalidInput
            If the file holds something else.
        """
        if not self.file.path.exists():
            return None
        with self.file.reading() as file:
            return [_read(file[_group(e)]) for e in range(len(file))]

    def save(self, chains: Sequence[Chain]) -> None:
        """Write the chains of all ensembles.

        Raises
        ------
        InvalidInput
            If the file cannot be written.
        """
        with self.file.writing() as file:
            for e, chain in enumerate(chains):
                _write(file.create_group(_group(e)), chain)


def _group(ensemble: int) -> str:
    return f"ensemble_{ensemble}"


def _write(group: Any, chain: Chain) -> None:
    """Write what emcee's HDFBackend expects."""
    t, w, p = chain.walkers.shape
    attributes = {"version": version("emcee"), "nwalkers": w, "ndim": p, "has_blobs": False}
    for name, value in (attributes | {"iteration": t}).items():
        group.attrs[name] = value
    for i, value in enumerate(chain.random_state):
        group.attrs[f"random_state_{i}"] = value
    group.create_dataset("accepted", data=chain.accepted.sum(axis=0, dtype=float))
    group.create_dataset("steps_accepted", data=chain.accepted)
    group.create_dataset("chain", data=chain.walkers)
    group.create_dataset("log_prob", data=chain.log_probability)


def _read(group: Any) -> Chain:
    return Chain(
        group["chain"][:],
        group["log_prob"][:],
        group["steps_accepted"][:],
        tuple(group.attrs[f"random_state_{i}"] for i in range(5)),
    )
