"""The joints whose angle no frequency response depends on."""

import numpy as np

from robotmodels.elastic.robot import ElasticRobot
from robotmodels.errors import NoEquilibrium
from robotmodels.response import linearize

# Frequencies [rad/s] and parts of the joints' ranges without meaning: any would do.
_OMEGA = 2 * np.pi * np.array([4.0, 23.0])
_STEP = 0.13
_GOLDEN = (np.sqrt(5) - 1) / 2
# Far above rounding, far below what noise would leave of a change.
_CHANGE = 1e-6


def idle_joints(robot: ElasticRobot) -> tuple[str, ...]:
    """Return the motor joints that need not be varied: no response changes when they move.

    Mostly that is the first joint, vertical on a rigid base. It is not idle where springs lie
    between it and the ground, or where it is not vertical. None is idle where gravity is too much
    for the springs.
    """
    low, high = robot.position_limits.T
    parts = 0.2 + 0.4 * (np.arange(1, len(low) + 1) * _GOLDEN % 1)
    position = low + parts * (high - low)
    try:
        given = linearize(robot, position).frequency_response(_OMEGA)
        moved = linearize(robot, position + _STEP * np.diag(high - low)).frequency_response(_OMEGA)
    except NoEquilibrium:
        return ()
    change = np.abs(moved - given).max(axis=(1, 2, 3))
    idle = change < _CHANGE * np.abs(given).max()
    return tuple(name for name, still in zip(robot.motor_joints, idle, strict=True) if still)
