"""Models made of another: at other parameter values, or with fixed equilibria."""

from dataclasses import dataclass, replace

import numpy as np

from robotmodels.common.arrays import Array
from robotmodels.common.deprecation import renamed_keywords
from robotmodels.description.parameters import Parameters
from robotmodels.linear.equilibrium_sensitivity import Tangents
from robotmodels.linear.response import Elastic, HasEquilibriumDerivatives
from robotmodels.linear.spring_network import SpringNetwork


@dataclass(frozen=True, eq=False)
class WithParameters:
    """An elastic system with other nominal parameter values.

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
        parameters_of = self.model.parameters
        return Parameters(parameters_of.names, np.asarray(self.values), parameters_of.units)

    def network(self, positions: Array, parameters: Array | None = None) -> SpringNetwork:
        """Return the spring network about the equilibria at `positions` (Q, n)."""
        return self.model.network(positions, self._values_or(parameters))

    @renamed_keywords(since="0.2", sag="equilibrium_shift")
    def tangents(
        self, positions: Array, parameters: Array | None = None, *, equilibrium_shift: bool = True
    ) -> Tangents | None:
        """Return derivatives of the matrices that `network` omits from sensitivities."""
        if not isinstance(self.model, HasEquilibriumDerivatives):
            return None
        return self.model.tangents(
            positions, self._values_or(parameters), equilibrium_shift=equilibrium_shift
        )

    @renamed_keywords(since="0.2", sag="equilibrium_shift")
    def linearization(
        self, positions: Array, parameters: Array | None = None, *, equilibrium_shift: bool = True
    ) -> tuple[SpringNetwork, Tangents | None]:
        """Return `network` and `tangents` about the same equilibria."""
        if not isinstance(self.model, HasEquilibriumDerivatives):
            return self.network(positions, parameters), None
        return self.model.linearization(
            positions, self._values_or(parameters), equilibrium_shift=equilibrium_shift
        )

    def _values_or(self, parameters: Array | None) -> Array:
        return np.asarray(self.values) if parameters is None else parameters


@dataclass(frozen=True, eq=False)
class FixedEquilibriumModel:
    """A model whose static equilibria are computed at the nominal parameters and kept fixed.

    FRFs at the nominal parameters are exact; close to them the model differs as information
    matrices do, which fix equilibria too: by up to 0.3 % of a standard deviation for the
    built-in robots.

    Attributes
    ----------
    fixed : SpringNetwork
        The network at the nominal values.
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
        nominal = self.fixed.parameters
        stiffness, damping = self.fixed.springs(parameters)
        moved = self.fixed.inertances
        if moved is not None:
            first, second = self.fixed.coefficients_at(parameters)
            s = len(self.fixed.nodes)
            moved = replace(moved, friction=first[0, s:], inertia=second[0, s:])
        return replace(
            self.fixed,
            spring_stiffness=stiffness,
            spring_damping=damping,
            inertances=moved,
            parameters=Parameters(nominal.names, np.array(parameters, dtype=float), nominal.units),
        )


def with_fixed_equilibria(system: Elastic, positions: Array) -> Elastic:
    """Return `system` in `positions` with fixed equilibria, or itself where that would mislead.

    It would if parameters act beyond springs, dampers and inertias of single coordinates, or if a
    spring's slope follows its load.
    """
    network = system.network(positions)
    linear = bool(np.isin(network.exponents, (0.0, 1.0)).all())
    return FixedEquilibriumModel(network) if network.only_springs and linear else system
