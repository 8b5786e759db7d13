"""Criteria: how good the information of a design is, and how it changes with the design.

A criterion is concave in the information and grows with it. Its gradient W(M) is all a search or
a certificate needs: towards candidate i it changes by tr(W H_i) - tr(W M). Another criterion is
another class with the same three members, entered in `CRITERIA`.
"""

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from oed.information_set import unit_diagonal_scaling
from robotmodels.arrays import Array
from robotmodels.errors import InvalidInput, nearest


class Criterion(Protocol):
    """A concave function of the information matrix (p, p); greater is better."""

    @property
    def name(self) -> str:
        """What users call it."""
        ...

    def value(self, information: Array) -> float:
        """Return the criterion, -inf where the information is singular."""
        ...

    def gradient(self, information: Array) -> Array:
        """Return W, (p, p), not finite where the information is singular."""
        ...


@dataclass(frozen=True)
class DCriterion:
    """log det M: the volume of the confidence ellipsoid, whatever the parameters' units."""

    name: str = "D"

    def value(self, information: Array) -> float:
        """Return log det M, or -inf where M (p, p) is singular to rounding."""
        factors = _scaled_factor(information)
        if factors is None:
            return -np.inf
        s, L = factors
        return float(2 * (np.log(np.diagonal(L)).sum() - np.log(s).sum()))

    def gradient(self, information: Array) -> Array:
        """Return M^-1, (p, p), or infinities where M is singular to rounding."""
        factors = _scaled_factor(information)
        if factors is None:
            return np.full(information.shape, np.inf)
        s, L = factors
        inverse = np.linalg.solve(L, np.diag(s))
        return np.asarray(inverse.T @ inverse)


CRITERIA: dict[str, Criterion] = {"D": DCriterion()}


def criterion(name: str) -> Criterion:
    """Return the criterion of that name.

    Raises
    ------
    InvalidInput : if there is none.
    """
    if name not in CRITERIA:
        raise InvalidInput(
            f"criterion {name!r} is not known{nearest(name, CRITERIA)}; "
            f"there is {', '.join(CRITERIA)}"
        )
    return CRITERIA[name]


def sensitivities(gradient: Array, matrices: Array) -> Array:
    """Return tr(W H_i), (Q,), of candidates (Q, p, p): the sensitivity function of the design."""
    return np.asarray(matrices.reshape(len(matrices), -1) @ gradient.ravel())


def _scaled_factor(information: Array) -> tuple[Array, Array] | None:
    """Return s, (p,), and L with diag(s) M diag(s) = L L^T, or None where M is singular."""
    s = unit_diagonal_scaling(information)
    if not s.all():
        return None
    try:
        L = np.asarray(np.linalg.cholesky(s[:, None] * information * s), dtype=float)
    except np.linalg.LinAlgError:
        return None
    # A pivot of rounding size is a singular matrix that happened to pass.
    return (s, L) if np.diagonal(L).min() > 1e-7 else None
