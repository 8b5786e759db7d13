"""A few steps of the multiplicative algorithm: which candidates matter, roughly and surely.

Each step multiplies every share by the square root of what it is worth (Silvey, Titterington and
Torsney 1978; Yu 2010: the value never falls). The other methods take over long before it converges.
"""

import numpy as np

from oed.design.criteria import sensitivities
from oed.design.white_problem import Answer, WhiteProblem

_STEPS = 20


def multiplicative(problem: WhiteProblem, goal: float) -> Answer:
    """Return shares of a budget, which must be the only limit, until none is worth `goal` more."""
    weights = np.full(len(problem.start), 1.0 / len(problem.start))
    terms = problem.objective.terms
    for step in range(_STEPS + 1):
        witness = problem.objective.witness(problem.information(weights))
        parts = zip(terms, witness, strict=True)
        worth = np.sum([sensitivities(W, problem.matrices[t.sample]) for t, W in parts], axis=0)
        level = float(weights @ worth)
        if step == _STEPS or worth.max() <= (1.0 + goal) * level:
            break
        weights = weights * np.sqrt(np.maximum(worth, 0.0))
        weights /= weights.sum()
    return Answer(weights, np.array([level]), witness, "multiplicative steps")
