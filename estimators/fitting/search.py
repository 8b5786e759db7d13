"""Searches for a local minimum of a fit's cost, from one start."""

import numpy as np

from estimators.fitting.fit_problem import FitProblem
from estimators.fitting.fixed_equilibrium_search import (
    CorrectedModel,
    can_compile,
    frozen_search,
    hardens,
    renewed_search,
)
from estimators.fitting.gauss_newton import damped_gauss_newton
from estimators.fitting.quasi_newton import quasi_newton
from estimators.fitting.trust_region import START_FAILED, Minimiser, Residuals, SearchResult
from robotmodels.common.arrays import Array, check_count
from robotmodels.common.errors import IdentificationError, InvalidInput
from robotmodels.linear.derived_models import FixedEquilibriumModel

MINIMISERS: dict[str, Minimiser] = {
    "trust_region": damped_gauss_newton,
    "quasi_newton": quasi_newton,
}


def check_effort(max_evaluations: int, tolerance: float) -> None:
    """Refuse limits of a search that it could not keep.

    Raises
    ------
    InvalidInput
        Unless evaluations are a whole number >= 1 and the tolerance lies between the rounding error
        and one.
    """
    check_count(max_evaluations, "max_evaluations")
    least = float(np.finfo(float).eps)
    if not least <= tolerance < 1:
        raise InvalidInput(f"tolerance: {tolerance!r}; {least:.2g} to less than 1 is needed")


def search(
    problem: FitProblem,
    start: Array,
    max_evaluations: int,
    tolerance: float,
    minimise: Minimiser = damped_gauss_newton,
) -> SearchResult:
    """Return the minimum from `start` (p,): compiled code for large problems of springs.

    Raises
    ------
    IdentificationError, numpy.linalg.LinAlgError
        If the model has no FRF at the start.
    """
    network = problem.model.network(problem.positions, start)
    if not can_compile(problem, network):
        return exact_search(problem, start, max_evaluations, tolerance, minimise)
    if isinstance(problem.model, FixedEquilibriumModel):
        objective = CorrectedModel(problem, problem.model.fixed, None)
        return minimise(problem, objective, start, max_evaluations, tolerance)
    if hardens(network):
        return renewed_search(problem, start, max_evaluations, tolerance, minimise)
    return frozen_search(problem, start, network, max_evaluations, tolerance, minimise)


def exact_search(
    problem: FitProblem,
    start: Array,
    max_evaluations: int,
    tolerance: float,
    minimise: Minimiser = damped_gauss_newton,
) -> SearchResult:
    """Search with exact residuals and derivatives, equilibria computed anew at every point."""
    loss = None if problem.loss == "linear" else problem.robust
    objective = Residuals(problem.evaluate, loss)
    return minimise(problem, objective, start, max_evaluations, tolerance)


def search_or_reason(
    problem: FitProblem,
    start: Array,
    max_evaluations: int,
    tolerance: float,
    minimise: Minimiser = damped_gauss_newton,
) -> SearchResult:
    """Return what a search came to, or why it could not begin or go on.

    An error that a start's numbers cause is returned as its reason: in a pool it would end all.
    """
    try:
        return search(problem, start, max_evaluations, tolerance, minimise)
    except (IdentificationError, ArithmeticError, ValueError, np.linalg.LinAlgError) as error:
        reason = " ".join(str(error).split()) or type(error).__name__
        return SearchResult(start, np.inf, START_FAILED, f"no FRF at the start: {reason}", 1)
