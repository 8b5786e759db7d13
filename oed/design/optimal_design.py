"""The relaxed design: how many of the experiments go to each candidate position, not yet whole.

Maximising a concave criterion of sum_i w_i H_i over weights w is convex. Few candidates carry
weight, so the problem is solved over an active set; the certificate checks all others and says
when none of them could help. Size is then no matter.
"""

import numpy as np

from oed.criteria.criteria import Criterion, objective_of
from oed.design.constraints import Constraints
from oed.design.design import SHOWN as SHOWN, Design as Design
from oed.design.many_candidates import solve_by_size
from oed.design.polytope import Polytope
from oed.design.problem import DesignProblem, DesignSolver
from oed.design.solvers import design_solvers
from oed.information_sets.candidates import Candidates, check_candidates
from robotmodels.common.arrays import Array, real_numbers
from robotmodels.common.errors import InvalidInput, SolverFailed


def optimal_design(
    info: Candidates,
    criterion: str | Criterion = "D",
    constraints: Constraints | Polytope | None = None,
    prior: Array | None = None,
    tolerance: float = 1e-6,
    max_rounds: int = 50,
    solver: str | DesignSolver = "auto",
    form: str | None = None,
) -> Design:
    """Return the weights that maximise the criterion, certified over all candidates.

    Parameters
    ----------
    info : Candidates
        Information of each candidate, in memory or in a store; with samples of theta for the robust
        criteria.
    criterion : str or Criterion
        "D", "A", "E" or an object of `oed.criteria.criteria`; with samples of theta one that is not
        robust itself is averaged over them.
    constraints : Constraints or Polytope, optional
        What limits the weights; None for shares that sum to one.
    prior : ndarray, (p, p), optional
        Information of experiments there are already, in units of the weights: for shares of N
        experiments to come, a Nth of it.
    tolerance : float
        Largest certified gap accepted.
    max_rounds : int
        Largest number of active sets, and of pools, see `many_candidates`.
    solver : str or DesignSolver
        "newton", short for `Newton()`, the barrier method of this package, which takes every
        criterion but E; "cvxpy", short for `Cvxpy()` (SCS, then Clarabel); a solver of your own; or
        "auto", the former where it can, and the latter. Where one stalls, others go on;
        `Design.solver` names every one.
    form : str, optional
        Form of "cvxpy", "primal" or "dual"; None is the dual of E and the primal of all else, and
        with "auto" no wish for cvxpy.

    Raises
    ------
    NotIdentifiable
        Naming the parameters, if all candidates together leave open what the criterion asks for.
    SolverFailed
        If the solver gives no answer, or the gap stays above `tolerance`.
    InvalidInput
        If criterion, solver or form are unknown, the tolerance is not positive, the prior does not
        fit, or constraints do not fit or conflict (it says which).
    """
    check_candidates(info)
    if not tolerance > 0:
        raise InvalidInput(f"tolerance: {tolerance!r} is not a number > 0")
    objective = objective_of(criterion, info.names, info.samples)
    solvers = design_solvers(solver, form, objective)
    problem = DesignProblem(
        info, objective, allowed_weights(constraints, len(info)), checked_prior(prior, info)
    )
    design = solve_by_size(problem, tolerance, max_rounds, solvers)
    if not design.gap <= tolerance:
        raise SolverFailed(
            f"optimal design: the certified gap is {design.gap:.2g} after {design.rounds} rounds, "
            f"above the tolerance {tolerance:.2g}; allow more rounds or a larger tolerance"
        )
    return design


def allowed_weights(constraints: Constraints | Polytope | None, n_candidates: int) -> Polytope:
    """Return the weights that constraints allow; shares if there are none."""
    if constraints is None:
        return Polytope.shares(n_candidates)
    if isinstance(constraints, Polytope):
        return constraints
    return constraints.polytope(n_candidates)


def checked_prior(prior: Array | None, info: Candidates) -> Array | None:
    """Return a prior information of the shape of a candidate's, or None.

    Raises
    ------
    InvalidInput
        If it is not (p, p) or (K, p, p), finite, symmetric and positive semidefinite.
    """
    check_candidates(info)
    if prior is None:
        return None
    p = len(info.names)
    matrix = real_numbers(prior, "prior")
    shapes = [(p, p)] if info.samples == 1 else [(p, p), (info.samples, p, p)]
    if matrix.shape not in shapes or not np.isfinite(matrix).all():
        raise InvalidInput(
            f"prior: shape {matrix.shape}; finite numbers of shape {shapes[0]} needed"
        )
    scale = np.abs(matrix).max()
    if np.abs(matrix - np.swapaxes(matrix, -1, -2)).max() > 1e-9 * scale:
        raise InvalidInput("prior: the matrix is not symmetric")
    if np.linalg.eigvalsh(matrix).min() < -1e-9 * scale:
        raise InvalidInput("prior: the matrix is not positive semidefinite")
    return matrix if info.samples == 1 else np.broadcast_to(matrix, (info.samples, p, p)).copy()
