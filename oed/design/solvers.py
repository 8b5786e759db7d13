"""Design solvers by value or by name, and what is asked of their answers."""

from dataclasses import replace

import numpy as np

from oed.criteria.objective import Objective
from oed.design.coordinates import semidefinite
from oed.design.cvxpy_solver import Cvxpy, check_word
from oed.design.interior_point import Newton
from oed.design.problem import DesignSolver, ScaledProblem, SolverAnswer
from robotmodels.common.errors import InvalidInput, SolverFailed


def design_solver(solver: str | DesignSolver, form: str = "primal") -> DesignSolver:
    """Return a solver; "newton" and "cvxpy" with a `form` are shorthands of `Newton` and `Cvxpy`.

    Raises
    ------
    InvalidInput
        If there is no solver or form of that name.
    """
    named: dict[str, DesignSolver] = {"cvxpy": Cvxpy(form), "newton": Newton()}
    if isinstance(solver, str):
        check_word("solver", solver, named)
        return named[solver]
    if not isinstance(solver, DesignSolver):
        raise InvalidInput(f"solver {solver!r} is neither a name nor a `DesignSolver`")
    return solver


def fast_solver(objective: Objective) -> DesignSolver:
    """Return the fastest solver that takes an objective."""
    return Newton() if objective.smooth else Cvxpy()


def checked_answer(answer: SolverAnswer, few: ScaledProblem) -> SolverAnswer:
    """Return an answer that a certificate may be computed of, whoever gave it.

    A witness that is not positive semidefinite bounds nothing.

    Raises
    ------
    SolverFailed
        If something is not finite, or of the wrong shape.
    """
    numbers = (answer.weights, answer.row_multipliers, *answer.witness)
    shapes = (
        few.start.shape,
        few.bounds.shape,
        *(few.base[t.sample].shape for t in few.objective.terms),
    )
    if tuple(map(np.shape, numbers)) != shapes or not all(np.isfinite(x).all() for x in numbers):
        raise SolverFailed(
            f"{answer.method}: weights, multipliers or witness of the wrong shape, or not finite"
        )
    multipliers = np.maximum(answer.row_multipliers, 0.0)
    return replace(
        answer, row_multipliers=multipliers, witness=tuple(map(semidefinite, answer.witness))
    )
