"""What each accelerometer of a robot file would tell, beside the motors, for `optimal_sensors`."""

import numpy as np

from estimators.uncertainty.sandwich import information
from oed.information_sets.information_set import InformationSet
from robotmodels.common.arrays import Array
from robotmodels.common.errors import InvalidInput
from robotmodels.elastic.robot import ElasticRobot
from robotmodels.linear.noise import NoiseLaw
from robotmodels.linear.response import check_omega, sensitivity

_PART = 64  # positions whose sensitivities are held at once


def sensor_information(
    robot: ElasticRobot, positions: Array, omega: Array, noise: NoiseLaw
) -> tuple[InformationSet, dict[str, InformationSet]]:
    """Return the information of the motors alone, and what each accelerometer adds, by name.

    Errors of different sensors are independent. The noise law holds for the motors' rows of the
    FRF, and for each accelerometer's row by itself: its floor is a part of the row's largest
    element, as accelerations of links [m/s^2] and of motors [rad/s^2] have nothing in common.

    Parameters
    ----------
    robot : ElasticRobot
        Robot with all the accelerometers that could be bought.
    positions : ndarray, (Q, n), rad
        Positions.
    omega : ndarray, (F,), rad/s
        Angular frequencies.
    noise : NoiseLaw
        The noise law of the FRF estimates.

    Raises
    ------
    InvalidInput
        If the robot file has no accelerometer, there is no position, or a position or frequency
        cannot be used.
    NoEquilibrium
        If the springs cannot carry the robot's weight in a position.
    """
    positions, omega = np.atleast_2d(np.asarray(positions, dtype=float)), check_omega(omega)
    motors, names = len(robot.motor_names), robot.output_names
    if len(names) == motors:
        raise InvalidInput(f"robot {robot.name!r} has no accelerometers; name some in its file")
    if not positions.size:
        raise InvalidInput("positions: none given; at least one candidate position is needed")
    rows = [slice(0, motors), *(slice(r, r + 1) for r in range(motors, len(names)))]
    parts = []
    for start in range(0, len(positions), _PART):
        G, J = sensitivity(robot, positions[start : start + _PART], omega, sag=False)
        parts.append([information(J[:, :, r], 1.0 / noise.variance(G[:, :, r])) for r in rows])
    base, *added = (
        InformationSet(positions, np.concatenate(row), robot.parameters.names)
        for row in zip(*parts, strict=True)
    )
    return base, dict(zip(names[motors:], added, strict=True))
