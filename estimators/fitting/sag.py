"""The gradient of a fit's cost through the robot's static equilibria."""

from typing import TYPE_CHECKING

import numpy as np

from estimators.fitting.cost import Problem
from robotmodels.arrays import Array
from robotmodels.elastic.spring_network import SpringNetwork
from robotmodels.response import BeyondSprings

if TYPE_CHECKING:
    from robotmodels.kernel import CostKernel


def sag_gradient(problem: Problem, network: SpringNetwork, kernel: "CostKernel") -> Array:
    """Return the part of dV/d ln theta, (p,), that frozen equilibria leave out.

    That is the inner product of dV/dK and dV/dM with what the equilibria's shift changes in K and
    M: the data are looked at once, whatever the number of parameters.

    Parameters
    ----------
    problem : whose cost.
    network : at the parameters in question, equilibria found there.
    kernel : the cost about these equilibria.
    """
    if not isinstance(problem.model, BeyondSprings):
        return np.zeros(len(network.parameters))
    positions, values = problem.estimate.positions, network.parameters.values
    tangents = problem.model.tangents(positions, values, sag=True)
    if tangents is None:
        return np.zeros(len(network.parameters))
    q, p = tangents.stiffness.shape[:2]
    changes = (tangents.stiffness, tangents.mass)
    total = np.zeros(p)
    for change, slope in zip(changes, kernel.model_slopes(), strict=True):
        total += np.einsum("qpi,qi->p", change.reshape(q, p, -1), slope.reshape(q, -1))
    return total
