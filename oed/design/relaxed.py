"""The relaxed design: how many of the experiments go to each candidate position, not yet whole.

Maximising a concave criterion of sum_i w_i H_i over weights w is convex. Few candidates carry
weight, so the problem is solved over an active set; the certificate prices all others and says
when none of them could help. Size is then no matter.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from oed.design.active_set import Solution, solve
from oed.design.certificate import Candidates, efficiency_bound
from oed.design.constraints import Constraints
from oed.design.criteria import Criterion, objective
from oed.design.polytope import Polytope
from oed.design.scaled_problem import Problem
from robotmodels.arrays import Array, IntArray, read_only, real_numbers
from robotmodels.errors import InvalidInput, SolverFailed, nearest
from robotmodels.notebook import Printed

SOLVERS = ("cvxpy", "newton")
FORMS = ("primal", "dual")
SHOWN = 8
"""Candidates that a design names when it is printed."""


@dataclass(frozen=True, eq=False)
class Design(Printed):
    """Weights of the candidates, with their certificate.

    Attributes
    ----------
    weights : (Q,) shares that sum to one, or experiments where constraints say how many; of equal
        candidates one carries the weight.
    value : the criterion, see `Objective.value` (for D: log det).
    gap : certified over all candidates, see `certificate`.
    support : indices of the candidates with a positive weight.
    information : (p, p), or (K, p, p) for samples: the prior and sum_i w_i H_i.
    criterion, names : what was optimised, and for which parameters.
    rounds : active sets that `solver` solved.
    solver : that solved them.
    witness : W_j of each of the criterion's terms, with which the gap was found.
    sensitivity : (Q,) what a unit of each weight adds to the logarithm of the efficiency; over a
        position's cost it is nowhere above that of the support.
    multipliers : what a unit of each constraint's bound adds to it, by name.
    """

    weights: Array
    value: float
    gap: float
    support: IntArray
    information: Array
    criterion: str
    names: tuple[str, ...]
    rounds: int
    solver: str
    witness: tuple[Array, ...]
    sensitivity: Array
    multipliers: Mapping[str, float]

    @property
    def efficiency(self) -> float:
        """Certified lower bound on the efficiency against the true optimum."""
        return efficiency_bound(self.gap)

    def __str__(self) -> str:
        shares = ", ".join(f"{self.weights[i]:.3g} in {i}" for i in self.support[:SHOWN])
        more = len(self.support) - SHOWN
        return (
            f"{self.criterion}-optimal design: {len(self.support)} of {len(self.weights)} "
            f"candidates, certified gap {self.gap:.1e}\n"
            f"  weights {shares}{f' and {more} more' if more > 0 else ''}"
        )


def optimal_design(
    info: Candidates,
    criterion: str | Criterion = "D",
    constraints: Constraints | Polytope | None = None,
    prior: Array | None = None,
    tolerance: float = 1e-6,
    max_rounds: int = 50,
    solver: str = "cvxpy",
    form: str = "primal",
) -> Design:
    """Return the weights that maximise the criterion, certified over all candidates.

    Parameters
    ----------
    info : information of each candidate, in memory or in a store; with samples of theta for the
        robust criteria.
    criterion : "D", "A", "E" or an object of `oed.design.criteria`; with samples of theta one that
        is not robust itself is averaged over them.
    constraints : what limits the weights; None for shares that sum to one.
    prior : (p, p), information of experiments there are already, in units of the weights: for
        shares of N experiments to come, a Nth of it.
    tolerance : largest certified gap accepted.
    max_rounds : largest number of active sets.
    solver : "cvxpy" (Clarabel, then SCS), or "newton", an interior-point method of this package
        that is faster; it takes every criterion but E. For all criteria but E it also finds the
        candidates that cvxpy begins with.
    form : what cvxpy states, "primal" or "dual".

    Raises
    ------
    NotIdentifiable : naming the parameters, if all candidates together leave open what the
        criterion asks for.
    SolverFailed : if the solver gives no answer, or the gap stays above `tolerance`.
    InvalidInput : if criterion, solver or form are unknown, the tolerance is not positive, the
        prior does not fit, or constraints do not fit or conflict (it says which).
    """
    _known("solver", solver, SOLVERS)
    _known("form", form, FORMS)
    if not tolerance > 0:
        raise InvalidInput(f"tolerance: {tolerance!r} is not a number > 0")
    wanted = objective(criterion, info.names, info.samples)
    if solver == "newton" and not wanted.smooth:
        raise InvalidInput(f'criterion {wanted.name} is not smooth: use solver="cvxpy"')
    problem = Problem(
        info, wanted, allowed_weights(constraints, len(info)), checked_prior(prior, info)
    )
    found = solve(problem, tolerance, max_rounds, solver, form)
    if not found.certificate.gap <= tolerance:
        raise SolverFailed(
            f"optimal design: the certified gap is {found.certificate.gap:.2g} after "
            f"{found.rounds} rounds, above the tolerance {tolerance:.2g}; allow more rounds or a "
            "larger tolerance"
        )
    return _design(problem, found)


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
    InvalidInput : if it is not (p, p) or (K, p, p), finite, symmetric and positive semidefinite.
    """
    if prior is None:
        return None
    p = len(info.names)
    given = real_numbers(prior, "prior")
    shapes = [(p, p)] if info.samples == 1 else [(p, p), (info.samples, p, p)]
    if given.shape not in shapes or not np.isfinite(given).all():
        raise InvalidInput(
            f"prior: shape {given.shape}; finite numbers of shape {shapes[0]} needed"
        )
    scale = np.abs(given).max()
    if np.abs(given - np.swapaxes(given, -1, -2)).max() > 1e-9 * scale:
        raise InvalidInput("prior: the matrix is not symmetric")
    if np.linalg.eigvalsh(given).min() < -1e-9 * scale:
        raise InvalidInput("prior: the matrix is not positive semidefinite")
    return given if info.samples == 1 else np.broadcast_to(given, (info.samples, p, p)).copy()


def _design(problem: Problem, found: Solution) -> Design:
    wanted, info = problem.objective, problem.candidates
    information = problem.information(found.weights)
    return Design(
        weights=read_only(found.weights),
        value=wanted.value(information),
        gap=found.certificate.gap,
        support=read_only(np.flatnonzero(found.weights)),
        information=read_only(information),
        criterion=wanted.name,
        names=info.names,
        rounds=found.rounds,
        solver=found.solver,
        witness=found.witness,
        sensitivity=read_only(found.certificate.prices),
        multipliers=dict(
            zip(problem.allowed.names, map(float, found.row_multipliers), strict=True)
        ),
    )


def _known(what: str, word: str, known: Sequence[str]) -> None:
    if word not in known:
        raise InvalidInput(
            f"{what} {word!r} is not known{nearest(word, known)}; there are {', '.join(known)}"
        )
