"""A robot about equilibria that are held: quick to simulate and to fit near its own values."""

from dataclasses import dataclass, replace

import numpy as np

from robotmodels.common.arrays import Array
from robotmodels.description.parameters import Parameters
from robotmodels.linear.response import Elastic
from robotmodels.linear.spring_network import SpringNetwork


@dataclass(frozen=True, eq=False)
class Held:
    """An elastic system in some positions, whose equilibria do not follow its parameters.

    FRFs at the system's own values are its own; close to them it differs as information matrices
    do, which hold equilibria too: by up to 0.3 % of a standard deviation for the built-in robots.

    Attributes
    ----------
    fixed : SpringNetwork
        The network at the system's own values.
    """

    fixed: SpringNetwork

    @property
    def parameters(self) -> Parameters:
        """The free parameters."""
        return self.fixed.parameters

    def network(self, positions: Array, parameters: Array | None = None) -> SpringNetwork:
        """Return the network at other values; `positions` are those it was made for."""
        if parameters is None:
            return self.fixed
        own = self.fixed.parameters
        stiffness, damping = self.fixed.springs(parameters)
        moved = self.fixed.inertances
        if moved is not None:
            first, second = self.fixed.coefficients_at(parameters)
            s = len(self.fixed.ends)
            moved = replace(moved, friction=first[0, s:], inertia=second[0, s:])
        return replace(
            self.fixed,
            spring_stiffness=stiffness,
            spring_damping=damping,
            inertances=moved,
            parameters=Parameters(own.names, np.array(parameters, dtype=float), own.units),
        )


def held(system: Elastic, positions: Array) -> Elastic:
    """Return `system` in `positions` with equilibria held, or itself where that would mislead.

    It would if parameters act beyond springs, dampers and inertias of single coordinates, or if a
    spring's slope follows its load.
    """
    network = system.network(positions)
    linear = bool(np.isin(network.exponents, (0.0, 1.0)).all())
    return Held(network) if network.only_springs and linear else system
