"""The information in a chunk of positions: by the kernel, or the general way."""

from dataclasses import dataclass

import numpy as np

from robotmodels.arrays import Array
from robotmodels.elastic.spring_network import SpringNetwork
from robotmodels.noise import LoopNoise, RelativeNoise, SeparableNoise
from robotmodels.response import Elastic, sensitivity

_GENERAL = 64
"""Positions whose sensitivities are held at once where the kernel does not serve."""


@dataclass(frozen=True, eq=False)
class ChunkInformation:
    """Positions (Q, n) to information (Q, p, p), in two stages that may overlap.

    Attributes
    ----------
    robot, noise : as of `oed.information`.
    omega : (F,) [rad/s].
    """

    robot: Elastic
    omega: Array
    noise: RelativeNoise | LoopNoise

    def __call__(self, positions: Array) -> Array:
        """Return the information, (Q, p, p)."""
        return self.finish(self.prepare(positions))

    def prepare(self, positions: Array) -> tuple[Array, SpringNetwork]:
        """Return the positions and the robot's network there."""
        return positions, self.robot.network(positions)

    def finish(self, prepared: tuple[Array, SpringNetwork]) -> Array:
        """Return the information, (Q, p, p), of what `prepare` returned."""
        # Imported when used: a user's own matrices do not need it.
        import robotmodels.kernel as kernel

        positions, network = prepared
        plain = network.only_springs and network.measurement is None
        if plain and isinstance(self.noise, RelativeNoise | SeparableNoise):
            return np.asarray(kernel.information(network, self.omega, self.noise))
        # The kernel knows springs, dampers, motors' inertias and accelerations, and noise that is
        # independent or separable; the rest takes the general way, which needs much memory.
        parts = range(0, len(positions), _GENERAL)
        return np.concatenate([self._general(positions[i : i + _GENERAL]) for i in parts])

    def _general(self, positions: Array) -> Array:
        from estimators.fisher_information import information

        response, jacobian = sensitivity(self.robot, positions, self.omega, sag=False)
        if isinstance(self.noise, RelativeNoise):
            return information(jacobian, 1.0 / self.noise.variance(response))
        weights = self.noise.weights(self.robot.network(positions), self.omega)
        return information(jacobian, weights)
