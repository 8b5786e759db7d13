"""Outputs that are not the motors' motions, as readings of more motors, see `output_cells`."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from robotmodels.common.arrays import Array, ComplexArray, IntArray
from robotmodels.linear.linear_model import Measurement
from robotmodels.linear.spring_network import SpringNetwork


@dataclass(frozen=True, eq=False)
class Terminals:
    """A network whose outputs are other than its motors' motions, each motor on one coordinate.

    Attributes
    ----------
    network : SpringNetwork
        The network.
    """

    network: SpringNetwork

    @property
    def measurement(self) -> Measurement:
        """What is measured."""
        measurement = self.network.measurement
        assert measurement is not None
        return measurement

    @cached_property
    def coordinates(self) -> IntArray:
        """Coordinates that motors act on or outputs see, the motors' first."""
        network, parts = self.network, self.measurement
        acted = np.abs(network.selector).argmax(axis=0)
        rows = [parts.position, parts.velocity, parts.acceleration]
        seen = np.any([np.any(C != 0, axis=tuple(range(C.ndim - 1))) for C in rows], axis=0)
        ends = network.nodes[self._torques[1]].ravel()
        seen[ends[ends >= 0]] = True
        return np.concatenate([acted, np.setdiff1d(np.flatnonzero(seen), acted)])

    @cached_property
    def _torques(self) -> tuple[IntArray, IntArray]:
        """Outputs that are torques of springs, and these springs."""
        springs = self.network.torque_springs
        if springs is None:
            springs = np.empty(0, dtype=np.int64)
        rows = np.flatnonzero(springs >= 0)
        return rows, springs[rows]

    @cached_property
    def system(self) -> SpringNetwork:
        """The network of all these motors; those of torque sensors act on coordinates of their own.

        Such a coordinate has a unit stiffness and is tied to nothing.
        """
        network, more = self.network, len(self._torques[0])
        d, n = network.selector.shape
        selector = np.eye(d + more)[:, [*self.coordinates, *range(d, d + more)]]
        selector[:d, :n] = network.selector
        mass, damping, stiffness = (
            np.pad(matrix, [(0, 0)] * (matrix.ndim - 2) + [(0, more)] * 2)
            for matrix in (network.mass, network.damping, network.stiffness)
        )
        stiffness[:, range(d, d + more), range(d, d + more)] = 1.0
        return replace(
            network,
            mass=mass,
            damping=damping,
            stiffness=stiffness,
            selector=selector,
            measurement=None,
            torque_springs=None,
        )

    @cached_property
    def readings(self) -> Array:
        """By how much angles, speeds and accelerations of all motors enter, (Q, 3, m, t)."""
        n, more = self.network.selector.shape[1], len(self._torques[0])
        parts = self.measurement.position, self.measurement.velocity, self.measurement.acceleration
        shape = len(self.network.mass), *parts[0].shape[-2:]
        gears = np.ones(len(self.coordinates))
        gears[:n] = self.network.selector[self.coordinates[:n], np.arange(n)]
        rows = np.stack(
            [np.broadcast_to(C, shape)[..., self.coordinates] / gears for C in parts], 1
        )
        return np.pad(rows, [(0, 0)] * 3 + [(0, more)])

    def sensors(self, omega: Array) -> ComplexArray:
        """Return gains, delays and lags, (F, m)."""
        count = self.measurement.position.shape[-2]
        return np.broadcast_to(self.measurement.sensors(omega), (len(omega), count))

    def table(self, needed: IntArray) -> IntArray:
        """Return (torques, 5) output, spring, motors at its ends or -1, its index in `needed`."""
        motor = {-1: -1} | {int(c): i for i, c in enumerate(self.coordinates)}
        index = {int(s): i for i, s in enumerate(needed)}
        table = [
            (row, s, *(motor[int(c)] for c in self.network.nodes[s]), index.get(int(s), -1))
            for row, s in zip(*self._torques, strict=True)
        ]
        return np.array(table, dtype=np.int64).reshape(-1, 5)
