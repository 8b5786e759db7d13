"""What designs need of candidates: the protocol, plain matrices, samples of theta."""

from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np

from oed.information_sets.null_space import open_combinations, unidentifiable, weak_directions
from robotmodels.common.arrays import Array, IntArray, read_only
from robotmodels.common.deprecation import renamed_attributes
from robotmodels.common.errors import InvalidInput


class Candidates(Protocol):
    """What designs need of candidates, in memory or not; `InformationSet` is one."""

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the p parameters."""

    @property
    def samples(self) -> int:
        """Number K of parameter values for which there is information."""

    def __len__(self) -> int: ...

    def take(self, indices: IntArray) -> Array:
        """Return matrices, (n, p, p), or (n, K, p, p) with samples."""

    def directional_derivatives(self, weight: Array) -> Array:
        """Return tr(W H_i), (Q,), summed over samples; W is (p, p) or (K, p, p)."""

    def combined(self, weights: Array) -> Array:
        """Return sum_i w_i H_i, (p, p) or (K, p, p)."""


def check_candidates(info: object, argument: str = "info") -> None:
    """Refuse what has no information of candidates.

    Raises
    ------
    InvalidInput
        Saying what would be right.
    """
    needed = ("names", "samples", "take", "directional_derivatives", "combined")
    if not all(hasattr(info, name) for name in needed):
        shape = getattr(info, "shape", None)
        what = type(info).__name__ if shape is None else f"an array of shape {shape}"
        raise InvalidInput(
            f"{argument}: {what}; an InformationSet is needed, which "
            "oed.InformationSet(positions, matrices, names) makes of matrices (Q, p, p)"
        )


class OneValue:
    """What candidates for one value of the parameters inform on, by the sum of their matrices."""

    names: tuple[str, ...]

    @property
    def total(self) -> Array:
        """The sum of all candidates' information, (p, p)."""
        raise NotImplementedError

    @property
    def samples(self) -> int:
        """The number of parameter values the information was computed for: one."""
        return 1

    @property
    def rank(self) -> int:
        """The number of parameter directions that all candidates together inform on."""
        return len(self.names) - int(weak_directions(self.total).shape[1])

    def unidentifiable(self, total: Array | None = None) -> tuple[str, ...]:
        """Return the parameters not determined by `total` (p, p), by default all candidates."""
        return unidentifiable(self.total if total is None else total, self.names)

    def open_combinations(self, total: Array | None = None) -> tuple[str, ...]:
        """Return the undetermined combinations, as ``"a - 0.5 b"``, one for each direction.

        Along it parameters may move together, by these factors, and no experiment would tell.
        """
        return open_combinations(self.total if total is None else total, self.names)


@dataclass(frozen=True, eq=False)
class Matrices:
    """Candidates without positions, as they are: matrices (Q, p, p) or (Q, K, p, p)."""

    names: tuple[str, ...]
    matrices: Array

    def __len__(self) -> int:
        return len(self.matrices)

    @property
    def samples(self) -> int:
        """Number K of parameter values."""
        return 1 if self.matrices.ndim == 3 else self.matrices.shape[1]

    def take(self, indices: IntArray) -> Array:
        """Return matrices, see `Candidates`."""
        return np.asarray(self.matrices[indices])

    def directional_derivatives(self, weight: Array) -> Array:
        """Return tr(W H_i), see `Candidates`."""
        return sensitivities(weight, self.matrices)

    def combined(self, weights: Array) -> Array:
        """Return sum_i w_i H_i, see `Candidates`."""
        return np.asarray(np.tensordot(weights, self.matrices, axes=1))


def sensitivities(gradient: Array, matrices: Array) -> Array:
    """Return tr(W H_i), (Q,), of candidates (Q, ..., p, p): the sensitivity function of a design.

    With samples of theta, W and H_i have an axis for them, and the traces are summed.
    """
    return np.asarray(matrices.reshape(len(matrices), -1) @ gradient.ravel())


@renamed_attributes("0.2", prices="directional_derivatives")
@dataclass(frozen=True, eq=False)
class InformationSamples:
    """The information of the same candidates for K values of the parameters.

    Attributes
    ----------
    sets : tuple of Candidates
        One set of candidates for each value, in memory or in a store; the first one is the nominal
        value's.

    Raises
    ------
    InvalidInput
        If there is none, or candidates or parameters differ.
    """

    sets: tuple[Candidates, ...]

    def __post_init__(self) -> None:
        object.__setattr__(self, "sets", tuple(self.sets))
        if not self.sets:
            raise InvalidInput("samples: no information set; at least one is needed")
        for k, other in enumerate(self.sets):
            check_candidates(other, f"samples: set {k}")
            if len(other) != len(self) or other.names != self.names or other.samples != 1:
                raise InvalidInput(
                    f"samples: set {k} has {len(other)} candidates and parameters "
                    f"{', '.join(other.names)}; set 0 has {len(self)} and {', '.join(self.names)}"
                )

    def __len__(self) -> int:
        return len(self.sets[0])

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the p parameters."""
        return self.sets[0].names

    @property
    def samples(self) -> int:
        """The number K of parameter values."""
        return len(self.sets)

    @cached_property
    def matrices(self) -> Array:
        """All matrices, (Q, K, p, p), or (Q, p, p) of a single set."""
        return read_only(self.take(np.arange(len(self))))

    def take(self, indices: IntArray) -> Array:
        """Return matrices, (n, K, p, p), or (n, p, p) of a single set, as it does itself."""
        if self.samples == 1:
            return self.sets[0].take(indices)
        return np.stack([one.take(indices) for one in self.sets], axis=1)

    def directional_derivatives(self, weight: Array) -> Array:
        """Return sum_k tr(W_k H_ik), (Q,), for W (K, p, p), or (p, p) of a single set."""
        parts = zip(self.sets, weight.reshape(-1, *weight.shape[-2:]), strict=True)
        return np.asarray(np.sum([one.directional_derivatives(W) for one, W in parts], axis=0))

    def combined(self, weights: Array) -> Array:
        """Return sum_i w_i H_ik, (K, p, p), or (p, p) of a single set."""
        if self.samples == 1:
            return self.sets[0].combined(weights)
        return np.stack([one.combined(weights) for one in self.sets])
