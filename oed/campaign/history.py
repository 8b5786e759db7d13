"""How the estimates of a campaign came to be what they are: a small file that grows."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from oed.campaign.estimate import Estimate
from robotmodels.common.arrays import Array, IntArray
from robotmodels.common.atomic_files import atomic_write
from robotmodels.common.dataclass_files import read_dataclass, write_dataclass
from robotmodels.common.errors import InvalidInput


@dataclass(frozen=True, eq=False)
class History:
    """All K estimates of a campaign, the first one first.

    Attributes
    ----------
    digests : tuple of str
        What each is known by.
    visits : ndarray of int, (K,)
        Visits whose records it rests on.
    minutes : ndarray, (K,)
        Robot time used until then [min].
    values : ndarray, (K, p), SI
        Estimates.
    std : ndarray, (K, p)
        Relative standard deviations.
    cost : ndarray, (K,)
        Cost over what noise makes of it.
    """

    digests: tuple[str, ...]
    visits: IntArray
    minutes: Array
    values: Array
    std: Array
    cost: Array

    def __len__(self) -> int:
        return len(self.digests)

    @classmethod
    def load(cls, path: Path, parameters: int) -> "History":
        """Return what the file holds; an unreadable one begins anew, as nothing rests on it."""
        try:
            return read_dataclass(path, cls)
        except InvalidInput:
            none = np.zeros((0, parameters))
            return cls((), np.zeros(0, dtype=np.int64), np.zeros(0), none, none, np.zeros(0))

    def extended(self, digest: str, visits: int, minutes: float, latest: Estimate) -> "History":
        """Return the history with one more estimate."""
        return History(
            (*self.digests, digest),
            np.append(self.visits, visits),
            np.append(self.minutes, minutes),
            np.vstack([self.values, latest.values]),
            np.vstack([self.std, latest.std]),
            np.append(self.cost, latest.cost),
        )

    def save(self, path: Path) -> None:
        """Write it, as a whole."""
        with atomic_write(path) as part:
            write_dataclass(part, self)
