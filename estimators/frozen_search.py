"""Fast searches: compiled normal equations at frozen equilibria, then exact ones."""

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from estimators.cost import Problem
from estimators.frf_estimate import is_full
from estimators.sag import sag_gradient
from estimators.trust_region import Outcome, exact_search, trust_region
from robotmodels.arrays import Array
from robotmodels.errors import IdentificationError, SolverFailed
from robotmodels.normal_equations import NormalEquations, Residual
from robotmodels.spring_network import SpringNetwork

if TYPE_CHECKING:
    from robotmodels.kernel import CostKernel

# Fewer numbers than this in the Jacobian are faster by numpy than compiled code is loaded.
WORTHWHILE = 200_000
# A frozen search need not be better than its equilibria, those of the start in the first round.
# They are renewed until ln theta moves less, or so often.
FROZEN_TOLERANCES = 1e-4, 1e-6
SETTLED = 0.02
ROUNDS = 6
# Evaluations with the shift in the gradient only; where it rules the Hessian, as for a hardening
# gear under its load, the search then goes on with exact derivatives.
LAST = 15
# Halvings of the way to a point where the robot has no equilibrium.
HALVINGS = 8
_KERNEL_RESIDUALS: dict[str, Residual] = {
    "nls": "nls",
    "lls": "lls",
    "lls_magnitude": "lls_magnitude",
}


def can_freeze(problem: Problem, network: SpringNetwork) -> bool:
    """Tell whether a problem is one for the compiled normal equations, and large enough."""
    shape = problem.estimate.response.shape
    if problem.loss != "linear" or is_full(problem.weights, shape):
        return False
    if not network.only_springs or network.measurement is not None:
        return False
    return int(np.prod(shape)) * len(network.parameters) >= WORTHWHILE


def frozen_search(
    problem: Problem,
    start: Array,
    network: SpringNetwork,
    max_evaluations: int,
    tolerance: float,
) -> Outcome:
    """Search as `exact_search` does, ten times faster.

    While the search is far from its end, static equilibria are held where they are and only now
    and then found anew; the model then costs a few multiplications of small matrices. The end is
    exact: cost and gradient include the shift of the equilibria, only the Hessian leaves it out.

    Parameters
    ----------
    network : at the start.

    Raises
    ------
    IdentificationError : if the model has no FRF at the start.
    """
    values, spent = start, 0
    for nth in range(ROUNDS):
        limit = max_evaluations - spent - 2
        if limit < 2:
            break
        frozen = _Frozen(problem, network)
        rough = FROZEN_TOLERANCES[min(nth, 1)]
        found = trust_region(problem, frozen, values, limit, max(tolerance, rough))
        spent += found.evaluations
        before = values
        values, network = _reachable(problem, values, found.values, network)
        if np.abs(np.log(values / before)).max() < SETTLED:
            break
    limit = max(max_evaluations - spent, 2)
    found = trust_region(problem, _Exact(problem), values, min(limit, LAST), tolerance)
    spent += found.evaluations
    if found.status == 0 and spent < max_evaluations:
        found = exact_search(problem, found.values, max_evaluations - spent, tolerance)
        spent += found.evaluations
    return replace(found, evaluations=spent)


def squares(normal: NormalEquations) -> tuple[Array, Array]:
    """Return p + 1 residuals r and their Jacobian J with the given normal equations.

    r^T r is the cost, 2 J^T r the gradient, 2 J^T J the Hessian. The last residual is the part of
    the cost that no step can take away to first order, so its row of J is zero. Directions the
    data do not see have neither residual nor slope.

    Raises
    ------
    SolverFailed : if they are not finite.
    """
    if not (np.isfinite(normal.cost) and np.isfinite(normal.hessian).all()):
        raise SolverFailed("the model's FRF or its sensitivity is not finite")
    size = np.sqrt(np.diag(normal.hessian) / 2)
    size = np.where(size > 0, size, 1.0)
    values, vectors = np.linalg.eigh(normal.hessian / 2 / np.outer(size, size))
    seen = values > len(values) * np.finfo(float).eps * values[-1]
    root = np.sqrt(np.where(seen, values, 1.0))
    r = np.where(seen, vectors.T @ (normal.gradient / 2 / size) / root, 0.0)
    J = np.where(seen, root, 0.0)[:, None] * vectors.T * size
    # A gradient with more than the Hessian's own derivatives in it may ask for more than the
    # whole cost: a larger Hessian asks for less.
    if normal.cost > 0 and r @ r > 0.99 * normal.cost:
        excess = np.sqrt(r @ r / (0.99 * normal.cost))
        r, J = r / excess, J * excess
    rest = np.sqrt(max(normal.cost - float(r @ r), 0.0))
    return np.append(r, rest), np.vstack([J, np.zeros(len(values))])


class _Frozen:
    """Residuals and Jacobian equivalent to the cost about the equilibria of one network."""

    def __init__(self, problem: Problem, network: SpringNetwork) -> None:
        self.problem = problem
        self.kernel = _kernel(problem, network)

    def __call__(self, values: Array) -> tuple[Array, Array]:
        found = self.kernel.normal_equations(values)
        return squares(_with_prior(self.problem, values, found))


class _Exact:
    """The same about the equilibria of every point, whose shift is part of the gradient."""

    def __init__(self, problem: Problem) -> None:
        self.problem = problem
        self.kernel: CostKernel | None = None

    def __call__(self, values: Array) -> tuple[Array, Array]:
        network = _network(self.problem, values)
        kernel = self.kernel
        self.kernel = _kernel(self.problem, network) if kernel is None else kernel.at(network)
        found = self.kernel.normal_equations(values)
        found = replace(found, gradient=found.gradient + sag_gradient(self.problem, network))
        return squares(_with_prior(self.problem, values, found))


def _kernel(problem: Problem, network: SpringNetwork) -> "CostKernel":
    from robotmodels.kernel import CostKernel

    estimate = problem.estimate
    weights = np.asarray(problem.weights, dtype=float)
    residual = _KERNEL_RESIDUALS[problem.kind.name]
    return CostKernel(network, estimate.omega, estimate.response, weights, residual)


def _network(problem: Problem, values: Array) -> SpringNetwork:
    return problem.model.network(problem.estimate.positions, values)


def _with_prior(problem: Problem, values: Array, data: NormalEquations) -> NormalEquations:
    if problem.prior is None:
        return data
    names = problem.model.parameters.names
    slope, z = problem.prior.slope(names), problem.prior.standardised(names, values)
    return NormalEquations(
        data.cost + float(z @ z) / 2, data.gradient + slope.T @ z, data.hessian + slope.T @ slope
    )


def _reachable(
    problem: Problem, values: Array, wanted: Array, network: SpringNetwork
) -> tuple[Array, SpringNetwork]:
    """Return `wanted`, or the first of its halvings towards `values` that has an equilibrium."""
    for _ in range(HALVINGS):
        try:
            return wanted, _network(problem, wanted)
        except IdentificationError:
            wanted = np.sqrt(values * wanted)
    return values, network
