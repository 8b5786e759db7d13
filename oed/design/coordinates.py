"""Coordinates in which the information of a design is of order one, and the rank check first."""

from dataclasses import dataclass, replace

import numpy as np

from oed.design.null_space import open_combinations, unidentifiable, unit_diagonal_scaling
from oed.design.objective import Objective, Term
from robotmodels.arrays import Array
from robotmodels.errors import NotIdentifiable

_RANK_TOLERANCE = 1e-12
_OPEN = 1e-6
_REMEDY = "add positions or frequencies, or fix or tie some of these parameters"


@dataclass(frozen=True, eq=False)
class Coordinates:
    """For each sample a T, (r, p), such that T reference T' is the identity.

    r < p where the reference is singular; then nothing that the objective asks for is lost.
    """

    transforms: tuple[Array, ...]

    @classmethod
    def whitening(
        cls, references: Array, objective: Objective, names: tuple[str, ...]
    ) -> "Coordinates":
        """Return coordinates for references (K, p, p) that all candidates together reach.

        Raises
        ------
        NotIdentifiable : naming the parameters, if they leave open what the objective asks for.
        """
        transforms, left_open = [], []
        for reference in references:
            s = unit_diagonal_scaling(reference)
            eigenvalues, vectors = np.linalg.eigh(s[:, None] * reference * s)
            known = eigenvalues > _RANK_TOLERANCE * max(eigenvalues[-1], 1.0)
            left_open.append((s, vectors[:, ~known]))
            transforms.append((vectors[:, known] / np.sqrt(eigenvalues[known])).T * s)
        for term in objective.terms:
            s, null = left_open[term.sample]
            if null.shape[1] and _needs(term, s, null):
                reference = references[term.sample]
                raise NotIdentifiable(
                    unidentifiable(reference, names), _REMEDY, open_combinations(reference, names)
                )
        return cls(tuple(transforms))

    def objective(self, objective: Objective) -> Objective:
        """Return the same objective of the information in these coordinates."""
        groups = tuple(
            tuple(replace(t, mean=t.mean.transformed(self.transforms[t.sample])) for t in group)
            for group in objective.groups
        )
        return replace(objective, groups=groups)

    def matrices(self, matrices: Array) -> tuple[Array, ...]:
        """Return T H_i T' of candidates (n, K, p, p), (n, r, r) for each sample."""
        white = [
            _congruent(T, np.ascontiguousarray(matrices[:, k]))
            for k, T in enumerate(self.transforms)
        ]
        return tuple(white)

    def witness(self, objective: Objective, white: tuple[Array, ...]) -> tuple[Array, ...]:
        """Return T' W_j T of the objective's terms: what prices candidates as they are given."""
        terms = zip(objective.terms, white, strict=True)
        return tuple(self.transforms[t.sample].T @ W @ self.transforms[t.sample] for t, W in terms)


def _needs(term: Term, s: Array, null: Array) -> bool:
    """Return whether a term has a part in the null space of the scaled reference."""
    B = term.mean.combinations
    if B is None:
        return True
    missing = s == 0
    if np.abs(B[missing]).max(initial=0.0) > 0:
        return True
    units = s[:, None] * B
    left_open = np.linalg.norm(null.T @ units, axis=0)
    return bool((left_open > _OPEN * np.linalg.norm(units, axis=0)).any())


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
