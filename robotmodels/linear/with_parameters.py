"""A robot at other values of its free parameters."""

from dataclasses import dataclass

import numpy as np

from robotmodels.common.arrays import Array
from robotmodels.description.parameters import Parameters
from robotmodels.linear.equilibrium_sensitivity import Tangents
from robotmodels.linear.response import BeyondSprings, Elastic
from robotmodels.linear.spring_network import SpringNetwork


@dataclass(frozen=True, eq=False)
class AtValues:
    """An elastic system whose own parameter values are others: a robot as it might be.

    Attributes
    ----------
    model : Elastic
        The system.
    values : ndarray, (p,)
        Values in the order of its parameters [SI].
    """

    model: Elastic
    values: Array

    @property
    def parameters(self) -> Parameters:
        """The free parameters."""
        own = self.model.parameters
        return Parameters(own.names, np.asarray(self.values), own.units)

    def network(self, positions: Array, parameters: Array | None = None) -> SpringNetwork:
        """Return the spring network about the equilibria at `positions` (Q, n)."""
        return self.model.network(positions, self._own(parameters))

    def tangents(
        self, positions: Array, parameters: Array | None = None, *, sag: bool = True
    ) -> Tangents | None:
        """Return what the network's sensitivities leave out."""
        if not isinstance(self.model, BeyondSprings):
            return None
        return self.model.tangents(positions, self._own(parameters), sag=sag)

    def linearization(
        self, positions: Array, parameters: Array | None = None, *, sag: bool = True
    ) -> tuple[SpringNetwork, Tangents | None]:
        """Return `network` and `tangents` about the same equilibria."""
        if not isinstance(self.model, BeyondSprings):
            return self.network(positions, parameters), None
        return self.model.linearization(positions, self._own(parameters), sag=sag)

    def _own(self, parameters: Array | None) -> Array:
        return np.asarray(self.values) if parameters is None else parameters
