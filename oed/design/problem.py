"""A design's problem: candidates, what is maximised, and the weights that are allowed."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from oed.design.criteria import sensitivities
from oed.design.objective import Objective
from oed.design.polytope import Polytope
from robotmodels.arrays import Array, IntArray
from robotmodels.errors import InvalidInput


class Candidates(Protocol):
    """What designs need of candidates, in memory or not; `InformationSet` is one."""

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the p parameters."""
        ...

    @property
    def samples(self) -> int:
        """Number K of parameter values for which the information is known."""
        ...

    def __len__(self) -> int: ...

    def take(self, indices: IntArray) -> Array:
        """Return matrices, (n, p, p), or (n, K, p, p) with samples."""
        ...

    def prices(self, weight: Array) -> Array:
        """Return tr(W H_i), (Q,), summed over samples; W is (p, p) or (K, p, p)."""
        ...

    def combined(self, weights: Array) -> Array:
        """Return sum_i w_i H_i, (p, p) or (K, p, p)."""
        ...


def check_candidates(info: object, argument: str = "info") -> None:
    """Refuse what has no information of candidates.

    Raises
    ------
    InvalidInput
        Saying what would be right.
    """
    needed = ("names", "samples", "take", "prices", "combined")
    if not all(hasattr(info, name) for name in needed):
        shape = getattr(info, "shape", None)
        what = type(info).__name__ if shape is None else f"an array of shape {shape}"
        raise InvalidInput(
            f"{argument}: {what}; an InformationSet is needed, which "
            "oed.InformationSet(positions, matrices, names) makes of matrices (Q, p, p)"
        )


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

    def prices(self, weight: Array) -> Array:
        """Return tr(W H_i), see `Candidates`."""
        return sensitivities(weight, self.matrices)

    def combined(self, weights: Array) -> Array:
        """Return sum_i w_i H_i, see `Candidates`."""
        return np.asarray(np.tensordot(weights, self.matrices, axes=1))


@dataclass(frozen=True, eq=False)
class Problem:
    """Maximise objective(prior + sum_i w_i H_i) over the allowed weights.

    Attributes
    ----------
    candidates : Candidates
        Information of the candidates.
    objective : Objective
        Function of the information that is maximised.
    allowed : Polytope
        Constraints on the weights.
    prior : ndarray or None
        M_0, of the shape of one candidate's information, or None.
    """

    candidates: Candidates
    objective: Objective
    allowed: Polytope
    prior: Array | None = None

    def information(self, weights: Array) -> Array:
        """Return the prior and sum_i w_i H_i, (p, p) or (K, p, p)."""
        own = self.candidates.combined(weights)
        return own if self.prior is None else own + self.prior
