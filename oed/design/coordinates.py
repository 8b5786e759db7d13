"""Coordinates in which the information of a design is of order one, and the rank check first."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from oed.criteria.objective import Objective, Term
from oed.information_sets.null_space import (
    open_combinations,
    unidentifiable,
)
from robotmodels.common.arrays import Array
from robotmodels.common.errors import NotIdentifiable
from robotmodels.common.symmetric_matrices import (
    ROUNDING,
    SPREAD,
    scaled_eigh,
    unit_diagonal_scaling,
)

# Rounding moves white matrices, and so a gap, by some 4e-17 of the condition of all candidates'
# information of unit diagonal: beyond this no design can be certified to 1e-6.
_CONDITION = 1e10
# Eigenvalues of a singular matrix of unit diagonal, for each parameter.
_ROUNDING = 16 * np.finfo(float).eps
# Of such eigenvalues, the largest that is called open in messages; and what the null space may
# hold of a unit combination that is determined.
_OPEN = 1e-8
_REMEDY = "add positions or frequencies, or fix or tie some of these parameters"
_COLLINEAR = (
    f"all candidates together determine combinations of them by less than 1/{_CONDITION:.0e} "
    "of what they determine of others, so that no design can be certified; add positions or "
    "frequencies, or fix or tie some of these parameters"
)
_SMALL = (
    f"sensitivities more than {SPREAD:.1e} times smaller than the largest cannot be told from "
    "rounding; give these parameters other units, estimate their logarithms (ln theta), or fix them"
)


@dataclass(frozen=True, eq=False)
class Coordinates:
    """For each sample a T, (r, p), such that T reference T' is the identity.

    r < p where the reference is singular; then nothing that the objective asks for is lost.

    Attributes
    ----------
    transforms : tuple of ndarray
        T of each sample.
    inverses : tuple of ndarray, (p, r)
        Inverses of each sample, T times which is the identity.
    condition : float
        The largest of the references' of unit diagonal.
    """

    transforms: tuple[Array, ...]
    inverses: tuple[Array, ...]
    condition: float

    @classmethod
    def whitening(
        cls, references: Array, objective: Objective, names: tuple[str, ...]
    ) -> "Coordinates":
        """Return coordinates for references (K, p, p) that all candidates together reach.

        Raises
        ------
        NotIdentifiable
            Naming the parameters, if they leave open what the objective asks for, or if that cannot
            be decided in floating-point numbers.
        """
        transforms, inverses, condition = [], [], 1.0
        for k, reference in enumerate(references):
            s, eigenvalues, vectors = scaled_eigh(reference)
            small = (s > 0) & (unit_diagonal_scaling(reference, SPREAD) == 0)
            if small.any():
                raise NotIdentifiable([names[i] for i in np.flatnonzero(small)], _SMALL)
            ratios = eigenvalues / max(eigenvalues[-1], 1.0)
            weak = vectors[:, ratios <= ROUNDING]
            if weak.shape[1] and any(
                _needs(term, s, weak) for term in objective.terms if term.sample == k
            ):
                raise NotIdentifiable(
                    unidentifiable(reference, names), _REMEDY, open_combinations(reference, names)
                )
            # Directions within rounding are omitted; those above it, too weak to be certain of
            # it, is not.
            regular = ratios > len(s) * _ROUNDING
            condition = max(condition, 1.0 / float(ratios[regular].min(initial=1.0)))
            if condition > _CONDITION:
                raise NotIdentifiable(unidentifiable(reference, names, 1 / _CONDITION), _COLLINEAR)
            roots, basis = np.sqrt(eigenvalues[regular]), vectors[:, regular]
            transforms.append((basis / roots).T * s)
            inverses.append(basis * roots / np.where(s > 0, s, 1.0)[:, None])
        return cls(tuple(transforms), tuple(inverses), condition)

    def objective(self, objective: Objective) -> tuple[Objective, float]:
        """Return the objective of the information in these coordinates, and a constant.

        The constant is what its log value lacks to that of the information as it is.
        """
        groups = tuple(
            tuple(replace(t, mean=t.mean.transformed(self.transforms[t.sample])) for t in group)
            for group in objective.groups
        )
        lacking = [sum(t.share * t.mean.offset for t in group) for group in groups]
        references = objective.log_references - lacking
        plain = tuple(
            tuple(replace(t, mean=replace(t.mean, offset=0.0)) for t in group) for group in groups
        )
        least = float(references.min())
        return Objective(objective.name, plain, tuple((references - least).tolist())), -least

    def matrices(self, matrices: Array) -> tuple[Array, ...]:
        """Return T H_i T' of candidates (n, K, p, p), (n, r, r) for each sample."""
        white = [
            _congruent(T, np.ascontiguousarray(matrices[:, k]))
            for k, T in enumerate(self.transforms)
        ]
        return tuple(white)

    def witness(self, objective: Objective, white: tuple[Array, ...]) -> tuple[Array, ...]:
        """Return T' W_j T of the objective's terms: the witness by the parameters."""
        terms = zip(objective.terms, white, strict=True)
        return tuple(self.transforms[t.sample].T @ W @ self.transforms[t.sample] for t, W in terms)

    def white_witness(self, objective: Objective, witness: Sequence[Array]) -> tuple[Array, ...]:
        """Return the positive semidefinite part of what `witness` made T' W_j T of."""
        white = []
        for term, W in zip(objective.terms, witness, strict=True):
            S = self.inverses[term.sample]
            white.append(semidefinite(S.T @ W @ S))
        return tuple(white)


def semidefinite(matrix: Array) -> Array:
    """Return the nearest positive semidefinite matrix."""
    eigenvalues, vectors = np.linalg.eigh(0.5 * (matrix + matrix.T))
    return np.asarray((vectors * np.maximum(eigenvalues, 0.0)) @ vectors.T)


def _needs(term: Term, s: Array, null: Array) -> bool:
    """Return whether a term has a part in the null space of the scaled reference."""
    B = term.mean.combinations
    if B is None:
        return True
    if np.abs(B[s == 0]).max(initial=0.0) > 0:
        return True
    units = s[:, None] * B
    open_part = np.linalg.norm(null.T @ units, axis=0)
    return bool((open_part > _OPEN * np.linalg.norm(units, axis=0)).any())


def _congruent(transform: Array, matrices: Array) -> Array:
    n, p = matrices.shape[:2]
    white = transform @ (matrices.reshape(n * p, p) @ transform.T).reshape(n, p, -1)
    return np.asarray(0.5 * (white + np.swapaxes(white, 1, 2)))


def whiten(matrices: Array, reference: Array) -> Array:
    """Return T H_i T', (Q, p, p), with T such that T reference T' is the identity.

    The reference, (p, p), must not be singular.
    """
    s = unit_diagonal_scaling(reference)
    L = np.linalg.cholesky(s[:, None] * reference * s)
    return _congruent(np.asarray(np.linalg.solve(L, np.diag(s))), matrices)
