"""The small elastic system of `mass_springs` with other sensors than the motors' own."""

from dataclasses import dataclass, replace

import numpy as np
from mass_springs import MassSprings

from robotmodels.linear.linear_model import Channels, Measurement

# Rows over the coordinates, two motors and two arm masses; springs of torque sensors, or -1.
MOTOR, LINK, TORQUE, ACCELERATION = "motor angle", "link angle", "torque", "acceleration"
SENSORS = {
    "link": [(LINK, [0, 0, 1, 0]), (LINK, [0, 0, 0, 1])],
    "torque": [(TORQUE, 0), (TORQUE, 1)],
    "accelerometer": [(ACCELERATION, [0, 0, 1, 0.5]), (ACCELERATION, [0, 0, -0.3, 1])],
    "mixed": [
        (MOTOR, [1, 0, 0, 0]),
        (LINK, [0, 0, 0, 1]),
        (TORQUE, 2),
        (ACCELERATION, [0, 0, 1, 0.5]),
    ],
    "angles": [(MOTOR, [1, 0, 0, 0]), (LINK, [0, 0, 1, 0]), (LINK, [0, 0, 0, 1])],
    "one": [(ACCELERATION, [0, 0, 0.4, 1])],
}
LATE = {"mixed": Channels(np.array([1.0, -1.1, 1.0, 1.0]), np.full(4, 1e-3), np.full(4, 2e-3))}


@dataclass(frozen=True, eq=False)
class SensedSprings(MassSprings):
    """Its outputs are one of `SENSORS`."""

    outputs: str = "link"

    def network(self, positions, parameters=None):
        """Return the network with these outputs."""
        rows = SENSORS[self.outputs]
        C = np.zeros((3, len(positions), len(rows), 4))
        springs = np.full(len(rows), -1)
        for i, (kind, of) in enumerate(rows):
            if kind == TORQUE:
                springs[i] = of
            else:
                C[2 if kind == ACCELERATION else 0, :, i] = of
        return replace(
            super().network(positions, parameters),
            measurement=Measurement(
                *C, torque=Channels.plain(np.ones(2)), sensor=LATE.get(self.outputs)
            ),
            torque_springs=springs if (springs >= 0).any() else None,
        )
