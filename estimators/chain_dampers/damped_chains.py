"""Chains with everything free: dampers, motor friction and a delay too, for `estimators.fit`."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from estimators.chains.parameter_maps import ChainLayout
from robotmodels.common.arrays import Array
from robotmodels.description.parameters import Parameters
from robotmodels.linear.coupled_chains import CoupledChains
from robotmodels.linear.equilibrium_sensitivity import Tangents
from robotmodels.linear.linear_model import Channels, LinearModel, Measurement
from robotmodels.linear.spring_network import SpringNetwork


@dataclass(frozen=True, eq=False)
class DampedChains:
    """Chains whose masses, springs, couplings, dampers, motor friction and delay are all free.

    A fit's parameters are positive. Couplings, friction and delay may have either sign, so they
    are counted from an offset below them; their names end in ``.above``.

    Attributes
    ----------
    layout : ChainLayout
        Layout of theta.
    theta : ndarray, (k,)
        Masses, springs, couplings.
    dampers : ndarray, (M (N - 1),), N s/m
        Dampers, positive.
    friction : ndarray, (M,), N s/m
        Viscous, of the motors.
    delay : float, s
        Delay of the measured angles.
    offsets : ndarray, (M (M - 1)/2 + M + 1,)
        What couplings, friction and delay are counted from.
    """

    layout: ChainLayout
    theta: Array
    dampers: Array
    friction: Array
    delay: float
    offsets: Array

    @property
    def motor_names(self) -> tuple[str, ...]:
        """Names of the motors, for messages."""
        return tuple(f"motor {i + 1}" for i in range(self.layout.chains))

    @cached_property
    def parameters(self) -> Parameters:
        """Springs, dampers, masses, then couplings, friction and delay above their offsets."""
        s, m = self.layout.modes, self.layout.chains
        inertias, springs, couplings = np.split(
            self.theta, [m * self.layout.masses, self.layout.positive]
        )
        signed = np.concatenate([couplings, self.friction, [self.delay]])
        names = self.layout.names
        masses, springs_names = names[: len(inertias)], names[len(inertias) : self.layout.positive]
        pairs = [f"{name}.above" for name in names[self.layout.positive :]]
        return Parameters(
            names=(
                *springs_names,
                *(f"c{i + 1}" for i in range(s)),
                *masses,
                *pairs,
                *(f"friction{i + 1}.above" for i in range(m)),
                "delay.above",
            ),
            values=np.concatenate([springs, self.dampers, inertias, signed - self.offsets]),
            units=(
                *["N/m"] * s,
                *["N s/m"] * s,
                *["kg"] * (len(inertias) + len(pairs)),
                *["N s/m"] * m,
                "s",
            ),
        )

    def at(self, parameters: Array | None = None) -> "DampedChains":
        """Return the chains whose free parameters are `parameters` (p,).

        Raises
        ------
        InvalidInput
            If one is not positive.
        """
        values = self.parameters.check(parameters)
        s, m = self.layout.modes, self.layout.chains
        springs, dampers, masses, offset_values = np.split(
            values, np.cumsum([s, s, m * self.layout.masses])
        )
        signed = offset_values + self.offsets
        couplings, friction, delay = np.split(signed, [len(signed) - m - 1, len(signed) - 1])
        theta = np.concatenate([masses, springs, couplings])
        return DampedChains(self.layout, theta, dampers, friction, float(delay[0]), self.offsets)

    @property
    def chains(self) -> CoupledChains:
        """Masses, springs, couplings and dampers alone."""
        masses, springs, couplings = self.layout.split(self.theta)
        return CoupledChains(masses, springs, couplings, self.dampers.reshape(springs.shape))

    def linear_model(self) -> LinearModel:
        """Return the linear model, friction and delay included."""
        model = self.network(np.zeros((1, self.layout.chains))).linear_model()
        measured = None if model.measurement is None else model.measurement.at(0)
        return LinearModel(
            model.mass[0], model.damping[0], model.stiffness[0], model.selector, measured
        )

    def network(self, positions: Array, parameters: Array | None = None) -> SpringNetwork:
        """Return the spring network, the same for every row of `positions` (Q, anything).

        Raises
        ------
        InvalidInput
            If the mass matrix is not positive definite, or as `at`.
        """
        now = self.at(parameters)
        q, s, p = len(np.asarray(positions)), self.layout.modes, len(now.parameters)
        bare = now.chains.network(positions)
        exponents = np.zeros((q, 2 * s, p))
        exponents[:, np.arange(2 * s), np.arange(2 * s)] = 1.0
        S = bare.selector
        nothing, torque = np.zeros((q, *S.T.shape)), Channels.plain(np.ones(S.shape[1]))
        return SpringNetwork(
            mass=bare.mass,
            damping=(S * now.friction) @ S.T,
            stiffness=bare.stiffness,
            selector=S,
            nodes=bare.nodes,
            spring_stiffness=bare.spring_stiffness,
            spring_damping=bare.spring_damping,
            exponents=exponents,
            parameters=now.parameters,
            measurement=Measurement(nothing, nothing, nothing + S.T, torque, now.delay),
        )

    def linearization(
        self, positions: Array, parameters: Array | None = None, *, equilibrium_shift: bool = True
    ) -> tuple[SpringNetwork, Tangents]:
        """Return `network` and `tangents`.

        Raises
        ------
        InvalidInput
            As `network`.
        """
        return self.network(positions, parameters), self.tangents(
            positions, parameters, equilibrium_shift=equilibrium_shift
        )

    def tangents(
        self, positions: Array, parameters: Array | None = None, *, equilibrium_shift: bool = True
    ) -> Tangents:
        """Return the derivatives by masses, couplings, friction and delay; nothing sags here.

        Raises
        ------
        InvalidInput
            As `network`.
        """
        now = self.at(parameters)
        values = now.parameters.values
        q, p, m = len(np.asarray(positions)), len(values), self.layout.chains
        length, s = self.layout.masses, self.layout.modes
        d = m * length
        mass, damping = np.zeros((2, q, p, d, d))
        for i in range(d):
            mass[:, 2 * s + i, i, i] = values[2 * s + i]
        last, k = np.arange(1, m + 1) * length - 1, 2 * s + d
        for one, other in zip(*(last[side] for side in np.triu_indices(m, 1)), strict=True):
            mass[:, k, [one, other], [other, one]] = values[k]
            k += 1
        for i in range(m):
            damping[:, k + i, i * length, i * length] = values[k + i]
        delay = np.zeros(p)
        delay[-1] = values[-1]
        return Tangents(
            mass=mass,
            damping=damping,
            stiffness=np.zeros_like(mass),
            gravity=np.zeros((q, p, d)),
            delay=delay,
        )
