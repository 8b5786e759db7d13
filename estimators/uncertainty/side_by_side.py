"""FRFs at the parameters of many walkers in one call."""

from dataclasses import replace

import numpy as np

from robotmodels.arrays import Array, ComplexArray
from robotmodels.elastic.spring_network import SpringNetwork
from robotmodels.linear_model import LinearModel


def side_by_side(network: SpringNetwork, parameters: Array, omega: Array) -> ComplexArray:
    """Return FRFs (w, Q, F, m, n) at parameters (w, p), equilibria held fixed."""
    w, s = len(parameters), len(network.ends)
    own = network.inertances
    friction = own is not None and bool(own.exponents[: len(own.friction)].any())
    if not network.only_motors or friction:
        models = [network.linear_model(theta) for theta in parameters]
        batch = LinearModel(
            mass=np.stack([model.mass for model in models]),
            damping=np.stack([model.damping for model in models]),
            stiffness=np.stack([model.stiffness for model in models]),
            selector=network.selector,
            measurement=network.measurement,
        )
        return batch.frequency_response(omega)
    from robotmodels import kernel

    # One network of w Q positions: the kernel has no axis for parameters.
    each = [network.coefficients_at(theta) for theta in parameters]
    unsprung = [network.unsprung(theta) for theta in parameters]
    damping = unsprung[0][1]
    wide = replace(
        network,
        mass=np.concatenate([mass for mass, _ in unsprung]),
        damping=damping if damping.ndim == 2 else damping[0],
        stiffness=np.tile(network.stiffness, (w, 1, 1)),
        spring_stiffness=np.concatenate([first[:, :s] for first, _ in each]),
        spring_damping=np.concatenate([second[:, :s] for _, second in each]),
        exponents=np.tile(network.exponents, (w, 1, 1)),
        inertances=None,
        measurement=None,
    )
    G = kernel.frequency_response(wide, omega) * network.motor_factors(omega)[:, None, :]
    return G.reshape(w, -1, *G.shape[1:])
