"""The information in a chunk of positions: by the kernel, or the general way."""

from dataclasses import dataclass

import numpy as np

from robotmodels.arrays import Array
from robotmodels.elastic.spring_network import SpringNetwork
from robotmodels.elastic.tangents import Tangents
from robotmodels.noise import LoopNoise, RelativeNoise, SeparableNoise
from robotmodels.response import Elastic, linearization, sensitivity_about

_GENERAL = 64
"""Positions whose sensitivities are held at once where the kernel does not serve."""
_FEW = 4
"""Positions by which it is found out whether it does."""

Prepared = tuple[Array, tuple[SpringNetwork, Tangents | None] | None]


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

    def prepare(self, positions: Array) -> Prepared:
        """Return the positions and the linearisation there; None where `finish` makes it."""
        if len(positions) <= _GENERAL:
            return positions, linearization(self.robot, positions, sag=False)
        # For the general way these are too many; what bars the kernel does so everywhere.
        if not self._suits_kernel(self.robot.network(positions[:_FEW])):
            return positions, None
        return positions, (self.robot.network(positions), None)

    def finish(self, prepared: Prepared) -> Array:
        """Return the information, (Q, p, p), of what `prepare` returned."""
        positions, found = prepared
        if found is None:
            parts = [positions[i : i + _GENERAL] for i in range(0, len(positions), _GENERAL)]
            return np.concatenate([self(part) for part in parts])
        network, tangents = found
        noise = self.noise
        if isinstance(noise, RelativeNoise | SeparableNoise) and self._suits_kernel(network):
            # Imported when used: a user's own matrices do not need it.
            import robotmodels.kernel as kernel

            return np.asarray(kernel.information(network, self.omega, noise))
        return self._general(network, tangents)

    def _suits_kernel(self, network: SpringNetwork) -> bool:
        """Return whether the kernel may serve.

        It knows springs, dampers, motors' inertias and motion, and noise that is independent or
        separable.
        """
        simple = isinstance(self.noise, RelativeNoise | SeparableNoise)
        return simple and network.only_springs and network.only_motors

    def _general(self, network: SpringNetwork, tangents: Tangents | None) -> Array:
        """Return the information the general way, which needs much memory."""
        from estimators.fisher_information import information

        response, jacobian = sensitivity_about(network, tangents, self.omega)
        if isinstance(self.noise, RelativeNoise):
            return information(jacobian, 1.0 / self.noise.variance(response))
        return information(jacobian, self.noise.weights(network, self.omega))
