"""Design solvers by value or by name, and what is asked of their answers."""

from dataclasses import replace

import numpy as np

from oed.criteria.objective import Objective
from oed.design.coordinates import semidefinite
from oed.design.cvxpy_solver import Cvxpy
from oed.design.interior_point import Newton
from oed.design.problem import DesignSolver, ScaledProblem, SolverAnswer
from robotmodels.common.errors import InvalidInput, SolverFailed, check_word


def design_solvers(
    solver: str | DesignSolver, form: str | None, objective: Objective
) -> tuple[DesignSolver, ...]:
    """Return the solvers that are asked in turn until an answer is certified.

    "auto" begins with `Newton` where the objective is smooth, and with "cvxpy" elsewhere or where
    there is a `form`; "newton" and "cvxpy" are short for `Newton` and `Cvxpy`. Whatever else there
    is, `Newton` goes on where it stalls.

    Raises
    ------
    InvalidInput
        If there is no solver or form of that name, or it does not take the objective.
    """
    conic = _conic(form, objective)
    automatic = Newton() if objective.smooth and form is None else conic
    named: dict[str, DesignSolver] = {"auto": automatic, "cvxpy": conic, "newton": Newton()}
    if isinstance(solver, str):
        check_word("solver", solver, named)
    elif not isinstance(solver, DesignSolver):
        raise InvalidInput(f"solver {solver!r} is neither a name nor a `DesignSolver`")
    first = named[solver] if isinstance(solver, str) else solver
    first.check(objective)
    turns = first.each() if isinstance(first, Cvxpy) else (first,)
    if not isinstance(first, Newton):
        return (*turns, Newton())
    return (*turns, *conic.each()) if solver == "auto" else turns


def _conic(form: str | None, objective: Objective) -> Cvxpy:
    """Return `Cvxpy` as it takes the least time.

    SCS takes fewer iterations for the dual of E, and more for that of other criteria. E has no
    multiplicative steps, so that most candidates come in later and first answers may be rough.
    """
    if objective.smooth:
        return Cvxpy("primal" if form is None else form)
    usual = "dual" if len(objective.terms) == 1 else "primal"
    return Cvxpy(usual if form is None else form, first_goal=Newton().first_goal)


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
