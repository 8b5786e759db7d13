"""Fast searches by compiled normal equations, about fixed or renewed equilibria."""

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, cast
from weakref import WeakKeyDictionary

import numpy as np

from estimators.fitting.fit_problem import FitProblem, all_finite
from estimators.fitting.gauss_newton import damped_gauss_newton, damped_step, predicted_change
from estimators.fitting.trust_region import OUT_OF_EVALUATIONS, Minimiser, SearchResult
from robotmodels.common.arrays import Array
from robotmodels.common.errors import IdentificationError
from robotmodels.linear.normal_equations import NormalEquations
from robotmodels.linear.response import HasEquilibriumDerivatives
from robotmodels.linear.spring_network import SpringNetwork

if TYPE_CHECKING:
    from estimators.fitting.frf_problem import FrfProblem
    from robotmodels.kernel import CostKernel, FitKernel


# Largest change of ln theta over which `EquilibriumShift.gradient` is carried: an error of a
# hundredth of a hundredth of the cost's slope.
NEAR = 0.1


@dataclass(frozen=True, eq=False)
class EquilibriumShift:
    """Derivatives of stiffness and mass through the shift of the equilibria with ln theta.

    Attributes
    ----------
    values : ndarray, (p,)
        Parameters at which it was computed.
    stiffness, mass : ndarray, (Q, p, d, d)
        Derivatives by ln theta.
    """

    values: Array
    stiffness: Array
    mass: Array

    def near(self, values: Array) -> bool:
        """Tell whether no parameter that shifts equilibria differs much at `values` (p,)."""
        shifts = self.stiffness.any(axis=(0, 2, 3)) | self.mass.any(axis=(0, 2, 3))
        return bool((np.abs(np.log(values / self.values))[shifts] <= NEAR).all())

    def gradient(self, network: SpringNetwork, kernel: "FitKernel") -> Array:
        """Return the part of dV/d ln theta, (p,), that frozen equilibria leave out.

        That is the inner product of dV/dK and dV/dM with what the equilibria's shift changes in K
        and M: the data are looked at once, whatever the number of parameters. A spring gives way
        in inverse proportion to its stiffness, which carries the shifts to a point nearby.

        Parameters
        ----------
        network : SpringNetwork
            Network at the parameters in question, about their equilibria.
        kernel : FitKernel
            The cost about these equilibria.
        """
        q, p = self.stiffness.shape[:2]
        total = np.zeros(p)
        for change, slope in zip((self.stiffness, self.mass), kernel.model_slopes(), strict=True):
            total += np.einsum("qpi,qi->p", change.reshape(q, p, -1), slope.reshape(q, -1))
        return total * self.values / network.parameters.values


def network_and_shift(
    problem: FitProblem, values: Array
) -> tuple[SpringNetwork, EquilibriumShift | None]:
    """Return the network about the equilibria at `values` (p,), and how these shift.

    Raises
    ------
    IdentificationError
        If there is no equilibrium.
    """
    model, positions = problem.model, problem.positions
    if not isinstance(model, HasEquilibriumDerivatives):
        return model.network(positions, values), None
    network, tangents = model.linearization(positions, values, equilibrium_shift=True)
    if tangents is None:
        return network, None
    return network, EquilibriumShift(values, tangents.stiffness, tangents.mass)


# Fewer numbers than this in the Jacobian are faster by numpy than compiled code is loaded.
WORTHWHILE = 80_000
# The first searches need not be better than the equilibria of their starts.
ROUGH = (1e-4, 1e-8)
# Share of the cost that a full step would take away, above which a start is far from a minimum.
FAR = 0.1
# Renewals of the equilibria. Two or three do; where springs are so soft that more are needed, the
# search goes on with equilibria computed anew at every point.
ROUNDS = 8
# Share of what renewed equilibria gain by which the cost about them may be wrong.
INEXACT = 1e-3
# Halvings of the way to a point where the robot has no equilibrium.
HALVINGS = 8


def can_compile(problem: FitProblem, network: SpringNetwork) -> bool:
    """Tell whether a problem is one for the compiled normal equations, and large enough."""
    if problem.loss != "linear" or problem.size * len(network.parameters) < WORTHWHILE:
        return False
    if network.only_motors:
        return problem.compiles(network)
    # Slopes by the equilibria are those of mass and stiffness alone.
    stay = network.outputs_stay and (network.torque_springs is None or not hardens(network))
    return stay and problem.any_outputs and problem.compiles(network)


def hardens(network: SpringNetwork) -> bool:
    """Tell whether a spring's slope follows its load, so that frozen equilibria lead astray."""
    return not bool(np.isin(network.exponents, (0.0, 1.0)).all())


def renewed_search(
    problem: FitProblem,
    start: Array,
    max_evaluations: int,
    tolerance: float,
    minimise: Minimiser = damped_gauss_newton,
) -> SearchResult:
    """Search as `exact_search` does, but with compiled normal equations at every point.

    Cost and gradient are exact; the Hessian leaves out how the equilibria shift.

    Raises
    ------
    IdentificationError
        If the model has no FRF at the start.
    """
    return minimise(problem, _RenewedModel(problem), start, max_evaluations, tolerance)


@dataclass(frozen=True, eq=False)
class _RenewedModel:
    """The objective whose equilibria are computed anew at every point."""

    problem: FitProblem

    def normal_equations(self, values: Array) -> NormalEquations:
        return self._at(values).normal_equations(values)

    def gradient(self, values: Array) -> tuple[float, Array]:
        return self._at(values).gradient(values)

    def _at(self, values: Array) -> "CorrectedModel":
        return CorrectedModel(self.problem, *network_and_shift(self.problem, values))


def frozen_search(
    problem: FitProblem,
    start: Array,
    network: SpringNetwork,
    max_evaluations: int,
    tolerance: float,
    minimise: Minimiser = damped_gauss_newton,
) -> SearchResult:
    """Search as `exact_search` does, ten times faster.

    Equilibria are computed at one point, and fixed there while `minimise` minimises
    V(x; fixed equilibria) + s^T tanh(x), x = ln theta from that point on and s the gradient through
    the equilibria there: a model of V that is exact in cost and gradient at the point, not much
    less than V anywhere, and costs a few products of small matrices. Its minimum is the next
    point, until a minimum is the point itself: there cost and gradient of V are exact (the
    first-order corrected models of Alexandrov and Lewis 2001). The first time s is zero, and far
    away the cost that of `FitProblem.rough`.
    The search ends where the next point would gain nothing, judging by how much less the last one
    gained than the one before. Where points do not get better, or too many are needed, it goes on
    from the best with equilibria computed anew at every step.

    Parameters
    ----------
    network : SpringNetwork
        Network at the start.

    Raises
    ------
    IdentificationError
        If the model has no FRF at the start.
    """
    values, best, least, gain, curvature = start, start, np.inf, np.inf, None
    first, spent = _first_model(problem, start, network), 0
    shift: EquilibriumShift | None = None
    for nth in range(ROUNDS):
        model = CorrectedModel(problem, network, shift) if nth else first
        allowed = max(tolerance, ROUGH[nth]) if nth < len(ROUGH) else tolerance
        outcome = minimise(
            problem, model, values, max(max_evaluations - spent, 2), allowed, curvature
        )
        spent, curvature = spent + outcome.evaluations, outcome.curvature
        end = replace(outcome, evaluations=spent)
        if model.problem is problem and model.cost < least:
            best, least = values, model.cost
        if nth:
            before, gain = gain, model.cost - outcome.cost
            ratio = gain / before if np.isfinite(before) and before > gain else 1.0
            next_gain = gain * max(ratio, INEXACT)
            if outcome.status and next_gain <= tolerance * outcome.cost:
                return end
        if not (nth == 0 or outcome.status) or spent > max_evaluations - 2:
            return _unfinished(problem, end, best, least)
        if nth and model.cost > least * (1 + tolerance):
            break
        values, network, shift = _reachable(problem, values, outcome.values, network, shift)
    outcome = renewed_search(problem, best, max_evaluations - spent, tolerance, minimise)
    return replace(outcome, evaluations=spent + outcome.evaluations)


def _first_model(problem: FitProblem, start: Array, network: SpringNetwork) -> "CorrectedModel":
    """Return the cost to begin with, which has been evaluated at the start if it is a rough one."""
    rough = problem.rough
    if rough is not problem:
        model = CorrectedModel(rough, network, None)
        if model.far(start):
            return model
    return CorrectedModel(problem, network, None)


def _unfinished(problem: FitProblem, end: SearchResult, best: Array, least: float) -> SearchResult:
    """Return where a search without evaluations left ends, or the `best` point before it.

    The cost is that about the equilibria at this end.
    """
    end = replace(end, status=0, message=OUT_OF_EVALUATIONS)
    try:
        residuals, _ = problem.evaluate(end.values)
    except IdentificationError:
        return replace(end, values=best, cost=least)
    cost_at_end = float(residuals @ residuals)
    if cost_at_end <= least:
        return replace(end, cost=cost_at_end)
    return replace(end, values=best, cost=least)


class CorrectedModel:
    """The objective that is the cost about the equilibria of one network, corrected.

    Attributes
    ----------
    cost : float
        Cost at the parameters of the network.
    """

    def __init__(
        self, problem: FitProblem, network: SpringNetwork, shift: EquilibriumShift | None
    ) -> None:
        self.problem = problem
        self.centre = network.parameters.values
        self.kernel = cost_kernel(problem, network)
        self.shift = np.zeros(len(self.centre))
        if shift is not None:
            self.shift = shift.gradient(network, self.kernel)
        self.cost = np.nan
        self._last: tuple[Array, NormalEquations] | None = None

    def normal_equations(self, values: Array) -> NormalEquations:
        """Return the cost at `values` (p,), its gradient by ln theta and Gauss-Newton's matrix.

        Raises
        ------
        SolverFailed
            If they are not finite.
        """
        # Whether a start is far is asked before a search begins there.
        if self._last is None or not np.array_equal(values, self._last[0]):
            normal = self.kernel.normal_equations(values)
            cost, gradient = self._corrected(values, normal.cost, normal.gradient)
            hessian, prior = normal.hessian, self.problem.prior
            if prior is not None:
                hessian = hessian + prior.information(self.problem.model.parameters.names)
            all_finite(np.array(cost), gradient, hessian)
            self._last = values.copy(), NormalEquations(cost, gradient, hessian)
        return self._last[1]

    def far(self, values: Array) -> bool:
        """Tell whether a full step from `values` (p,) would lower the cost much."""
        here = self.normal_equations(values)
        step = damped_step(here, 0.0, np.full(len(values), True))
        return -predicted_change(here, step) > FAR * here.cost

    def gradient(self, values: Array) -> tuple[float, Array]:
        """Return the cost and its gradient by ln theta (p,) at `values` (p,)."""
        cost, gradient = self._corrected(values, *self.kernel.gradient(values))
        all_finite(np.array(cost), gradient)
        return cost, gradient

    def _corrected(self, values: Array, cost: float, gradient: Array) -> tuple[float, Array]:
        """Add what the equilibria's shift and the prior make of cost and gradient."""
        # Linear nearby, but bounded: far away, a line would lead ever further.
        step = np.tanh(np.log(values / self.centre))
        cost += float(self.shift @ step)
        gradient = gradient + self.shift * (1 - step**2)
        prior, names = self.problem.prior, self.problem.model.parameters.names
        if prior is not None:
            z = prior.standardised(names, values)
            cost, gradient = cost + float(z @ z) / 2, gradient + prior.slope(names).T @ z
        if np.isnan(self.cost):
            self.cost = cost
        return cost, gradient


# Data are prepared once for all starts: most of what a kernel does before its first evaluation.
_PREPARED: "WeakKeyDictionary[FitProblem, FitKernel]" = WeakKeyDictionary()


def cost_kernel(problem: FitProblem, network: SpringNetwork) -> "FitKernel":
    """Return the compiled cost of a problem that `can_compile`, about a network's equilibria."""
    prepared = _PREPARED.get(problem)
    if prepared is not None:
        return prepared.at(network)
    kernel = problem.kernel(network)
    _PREPARED[problem] = kernel
    return kernel


def share_kernel(problem: "FrfProblem", prepared: "FrfProblem") -> None:
    """Let a problem use what was prepared for another of the same model, positions and lines."""
    kernel = cast("CostKernel | None", _PREPARED.get(prepared))
    if kernel is not None:
        _PREPARED[problem] = kernel.of_data(problem.data.response, np.asarray(problem.weights))


def _reachable(
    problem: FitProblem,
    values: Array,
    target: Array,
    network: SpringNetwork,
    shift: EquilibriumShift | None,
) -> tuple[Array, SpringNetwork, EquilibriumShift | None]:
    """Return `target`, or the first of its halvings towards `values` that has an equilibrium."""
    for _ in range(HALVINGS):
        try:
            if shift is not None and shift.near(target):
                return target, problem.model.network(problem.positions, target), shift
            return target, *network_and_shift(problem, target)
        except IdentificationError:
            target = np.sqrt(values * target)
    return values, network, shift
