"""The gradient of a fit's cost through the robot's static equilibria."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from estimators.fitting.fit_problem import Problem
from robotmodels.common.arrays import Array
from robotmodels.linear.response import BeyondSprings
from robotmodels.linear.spring_network import SpringNetwork

if TYPE_CHECKING:
    from robotmodels.kernel import CostKernel

# Largest change of ln theta over which `Sag.gradient` keeps what it found: an error of a
# hundredth of a hundredth of the cost's slope.
NEAR = 0.1


@dataclass(frozen=True, eq=False)
class Sag:
    """What the equilibria's shift with ln theta changes in stiffness and mass.

    Attributes
    ----------
    values : ndarray, (p,)
        Parameters at which it was found.
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

    def gradient(self, network: SpringNetwork, kernel: "CostKernel") -> Array:
        """Return the part of dV/d ln theta, (p,), that frozen equilibria leave out.

        That is the inner product of dV/dK and dV/dM with what the equilibria's shift changes in K
        and M: the data are looked at once, whatever the number of parameters. A spring gives way
        in inverse proportion to its stiffness, which carries the shifts to a point nearby.

        Parameters
        ----------
        network : SpringNetwork
            Network at the parameters in question, equilibria found there.
        kernel : CostKernel
            The cost about these equilibria.
        """
        q, p = self.stiffness.shape[:2]
        total = np.zeros(p)
        for change, slope in zip((self.stiffness, self.mass), kernel.model_slopes(), strict=True):
            total += np.einsum("qpi,qi->p", change.reshape(q, p, -1), slope.reshape(q, -1))
        return total * self.values / network.parameters.values


def with_sag(problem: Problem, values: Array) -> tuple[SpringNetwork, Sag | None]:
    """Return the network about the equilibria at `values` (p,), and how these shift.

    Raises
    ------
    IdentificationError
        If there is no equilibrium.
    """
    model, positions = problem.model, problem.estimate.positions
    if not isinstance(model, BeyondSprings):
        return model.network(positions, values), None
    network, tangents = model.linearization(positions, values, sag=True)
    if tangents is None:
        return network, None
    return network, Sag(values, tangents.stiffness, tangents.mass)
