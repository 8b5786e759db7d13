"""How many experiments a whole plan needs to identify what its criterion asks for."""

from dataclasses import replace

import numpy as np

from oed.design.polytope import Polytope
from oed.exact.exchange import ExactProblem
from oed.information_sets.null_space import weak_directions
from robotmodels.common.arrays import Array
from robotmodels.common.symmetric_matrices import ROUNDING


def too_few(problem: ExactProblem, n_experiments: int) -> str:
    """Return the remedy for a plan with too few experiments."""
    objective, prior = problem.objective, problem.prior
    information = np.zeros_like(problem.reference) if prior is None else prior.copy()
    free = replace(problem, allowed=Polytope.shares(len(problem.candidates)))
    enough = 0
    # Additions raise the rank every time, as all candidates together have full rank.
    while not objective.log_value(information) > -np.inf:
        added = _most_informative(free, information)
        information = information + problem.candidates.take(np.array([added]))[0]
        enough += 1
    if enough <= n_experiments:
        return f"in other positions {enough} experiments suffice; limits may keep them out"
    plural = "experiment is" if n_experiments == 1 else "experiments are"
    few = f"{n_experiments} {plural} too few"
    least = _least_experiments(problem)
    if least == enough:
        return f"{few}, {enough} are needed"
    if least > n_experiments:
        return f"{few}, at least {least} are needed and {enough} suffice"
    return f"{few}, {enough} suffice"


def _most_informative(problem: ExactProblem, information: Array) -> int:
    """Return the candidate that informs most on the directions that are still open."""
    ridged = information + 1e-9 * problem.reference
    gradient = problem.objective.log_gradient(ridged)
    return int(np.argmax(problem.candidates.directional_derivatives(gradient)))


def _least_experiments(problem: ExactProblem) -> int:
    """Return how many experiments the ranks of the candidates ask for, at least two.

    It is 1 where there is a prior, or not every parameter is asked for.
    """
    if problem.prior is not None or weak_directions(first_sample(problem.reference)).shape[1]:
        return 1
    if any(term.mean.combinations is not None for term in problem.objective.terms):
        return 1
    largest, p = 1, len(problem.candidates.names)
    for start in range(0, len(problem.candidates), 2048):
        block = np.arange(start, min(start + 2048, len(problem.candidates)))
        matrices = problem.candidates.take(block).reshape(len(block), -1, p, p)[:, 0]
        eigenvalues = np.linalg.eigvalsh(matrices)
        ranks = (eigenvalues > ROUNDING * eigenvalues[:, -1:]).sum(axis=1)
        largest = max(largest, int(ranks.max()))
    return max(-(-p // largest), 2)


def first_sample(information: Array) -> Array:
    """Return the information of the first sample of theta."""
    return information if information.ndim == 2 else np.asarray(information[0])
