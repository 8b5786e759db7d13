"""Set the small weights of a barrier method to zero, where they are not needed.

At the optimum either a weight or its reduced cost is zero (complementarity). Where the optimum is
singular, the information of the remaining weights is too; its derivative is then not unique, and
the gap is that by the witness of all weights.
"""

import numpy as np

from oed.criteria.matrix_means import OPEN
from oed.design.problem import ScaledProblem, SolverAnswer
from oed.information_sets.candidates import sensitivities
from robotmodels.common.arrays import Array

_SHARES = (1e-3, 1e-4, 1e-5, 1e-6)  # of the largest weight
_RANK = 1e-12  # of the largest eigenvalue of a candidate's information
_TIGHT = 1e-6  # room of a row that is used up


def trimmed(
    problem: ScaledProblem, answer: SolverAnswer, value: float, loss: float, rounding: float
) -> list[tuple[Array, float, bool]]:
    """Return fewer weights (n,), their log value, and whether their information is singular.

    Several choices, those of the fewest weights first; none if all are needed.

    Parameters
    ----------
    problem : ScaledProblem
        Problem that was solved.
    answer : SolverAnswer
        Its answer, whose weights are complete.
    value : float
        log value of all weights.
    loss : float
        How much less the value may be.
    rounding : float
        Rounding of the candidates' matrices.
    """
    weights = answer.weights
    terms = zip(problem.objective.terms, answer.witness, strict=True)
    derivatives = np.sum([sensitivities(W, problem.matrices[t.sample]) for t, W in terms], axis=0)
    excess = answer.row_multipliers @ problem.rows - derivatives
    limits = (np.maximum(excess, loss), *(share * weights.max() for share in _SHARES))
    choices = [_without(problem, weights, weights > least) for least in limits]
    by_size = {int(np.count_nonzero(choice)): choice for choice in choices}
    evaluated = [
        (by_size[size], *_value(problem, by_size[size], max(_RANK, rounding)))
        for size in sorted(by_size)
        if 0 < size < np.count_nonzero(weights)
    ]
    return [one for one in evaluated if one[1] >= value - loss]


def _without(problem: ScaledProblem, weights: Array, used: Array) -> Array:
    """Return the used weights, changed so that rows stay as far used up as they are.

    The change is the least one relative to each weight, or to the distance to its cap.
    """
    fewer = np.where(used, weights, 0.0)
    tight = problem.rows @ weights >= problem.bounds - _TIGHT
    rows = problem.rows[tight]
    scale = np.minimum(fewer, np.maximum(problem.caps - fewer, 0.0))
    change = np.linalg.lstsq(rows * scale, rows @ (weights - fewer), rcond=1e-12)[0]
    return np.asarray(np.maximum(fewer + scale * change, 0.0))


def _value(problem: ScaledProblem, weights: Array, rounding: float) -> tuple[float, bool]:
    """Return the log value, and whether the information is singular but for rounding."""
    used = np.flatnonzero(weights)
    factors = []
    for base, H in zip(problem.base, problem.matrices, strict=True):
        parts = np.concatenate([weights[used, None, None] * H[used], base[None]])
        eigenvalues, vectors = np.linalg.eigh(parts)
        significant = (eigenvalues > rounding * eigenvalues[:, -1:]) & (eigenvalues > 0)
        roots = vectors * np.sqrt(np.where(significant, eigenvalues, 0.0))[:, None, :]
        factors.append(np.swapaxes(roots, 1, 2)[significant].T)
    values = [
        sum(t.share * t.mean.log_value_of_factor(factors[t.sample]) for t in group)
        for group in problem.objective.groups
    ]
    value = float((np.array(values) - problem.objective.log_references).min())
    return value, any(np.linalg.matrix_rank(F, tol=OPEN) < len(F) for F in factors)
