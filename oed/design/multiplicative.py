"""The multiplicative algorithm: monotone steps towards a design.

Each multiplies every share by a power of its directional derivative (Silvey, Titterington and
Torsney 1978; Yu 2010: the value never falls). They select the candidates that cvxpy begins with,
and make its weights precise: an error that is invisible in the value shows in the derivative by its
root.
"""

import numpy as np

from oed.design.problem import ScaledProblem, SolverAnswer
from oed.information_sets.candidates import sensitivities
from robotmodels.common.arrays import Array

NAME = "multiplicative steps"
_LOOK = 100
"""Steps after which their rate is looked at."""
_LEAST = 1e-12
"""Shares do not fall below it, so that information near a singular optimum stays invertible."""


def multiplicative(
    problem: ScaledProblem, goal: float, weights: Array | None = None, steps: int = 20
) -> SolverAnswer:
    """Return shares of a budget, which must be the only limit.

    Parameters
    ----------
    problem : ScaledProblem
        Its objective must be smooth, of one group.
    goal : float
        Steps end where no derivative exceeds the mean one by a larger part, or where at the rate
        of the last hundred all that remain do not come that far.
    weights : ndarray, (n,), optional
        Weights to begin with, equal ones if None.
    steps : int
        Steps at most.
    """
    n, terms = len(problem.start), problem.objective.terms
    weights = np.full(n, 1.0 / n) if weights is None else weights
    power = 1.0 if all(term.mean.kind == "D" for term in terms) else 0.5
    before = np.inf
    for step in range(steps + 1):
        witness = problem.objective.witness(problem.information(weights))
        parts = zip(terms, witness, strict=True)
        derivatives = np.sum(
            [sensitivities(W, problem.matrices[t.sample]) for t, W in parts], axis=0
        )
        level = float(weights @ derivatives)
        if step == steps or derivatives.max() <= (1.0 + goal) * level:
            break
        if step and step % _LOOK == 0:
            excess = derivatives.max() / level - 1.0
            if excess * (excess / before) ** ((steps - step) / _LOOK) > goal:
                break
            before = excess
        least = np.minimum(weights, _LEAST)
        weights = np.maximum(weights * np.maximum(derivatives, 0.0) ** power, least)
        weights = weights / weights.sum()
    return SolverAnswer(weights, np.array([level]), witness, NAME)
