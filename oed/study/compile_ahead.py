"""Compiled code of fits, made after an installation while designs still have theirs compiled."""

import numpy as np

from robotmodels import kernel
from robotmodels.library import load_robot


def compile_ahead() -> None:
    """Compile what fits of FRFs and posteriors call, unless it is stored.

    Any small model will do: the code is the same for all of them.
    """
    if kernel.is_compiled():
        return
    robot = load_robot("manutec_r3")
    network, omega = robot.network(robot.position_limits.mean(axis=1)[None]), np.array([20.0, 50.0])
    response = kernel.frequency_response(network, omega)
    cost = kernel.CostKernel(network, omega, response, np.ones(response.shape))
    cost.normal_equations(network.parameters.values)
    cost.model_slopes()
    cost(network.parameters.values[None])
