"""The information of single frequency lines and of single sensors, and what lines cost."""

import numpy as np

import estimators
from oed.information_sets.compute import information
from oed.information_sets.information_set import InformationSet
from oed.information_sets.matrix_checks import candidate_rows
from robotmodels.common.arrays import Array
from robotmodels.common.errors import InvalidInput
from robotmodels.elastic.robot import ElasticRobot
from robotmodels.linear.noise import NoiseLaw
from robotmodels.linear.response import Elastic, check_omega, frequency_response, sensitivity

_PART = 64  # positions whose sensitivities are in memory at once


def sensor_information(
    robot: ElasticRobot, positions: Array, omega: Array, noise: NoiseLaw
) -> tuple[InformationSet, dict[str, InformationSet]]:
    """Return the information of the motors' encoders alone, and what each other output adds.

    Errors of different sensors are independent. The noise law holds for the encoders' rows of the
    FRF, and for each other row by itself: its floor is a part of the row's largest
    element, as accelerations of links [m/s^2] and of motors [rad/s^2] have nothing in common.

    Parameters
    ----------
    robot : ElasticRobot
        Robot with all the sensors that could be bought.
    positions : ndarray, (Q, n), rad
        Positions.
    omega : ndarray, (F,), rad/s
        Angular frequencies.
    noise : NoiseLaw
        The noise law of the FRF estimates.

    Raises
    ------
    InvalidInput
        If the robot file has no other output or no motor encoder, there is no position, or a
        position or frequency cannot be used.
    NoEquilibrium
        If the springs cannot carry the robot's weight in a position.
    """
    positions, omega = candidate_rows(positions), check_omega(omega)
    encoders = [i for i, o in enumerate(robot.outputs) if o.kind == "motor" and o.encoder]
    others = [i for i in range(len(robot.outputs)) if i not in encoders]
    if not (others and encoders):
        missing = "outputs beside motors' encoders" if encoders else "motor encoders"
        raise InvalidInput(f"robot {robot.name!r} has no {missing}; name some in its file")
    rows = [encoders, *([i] for i in others)]
    parts = []
    for start in range(0, len(positions), _PART):
        G, J = sensitivity(robot, positions[start : start + _PART], omega, equilibrium_shift=False)
        parts.append(
            [estimators.information(J[:, :, r], 1.0 / noise.variance(G[:, :, r])) for r in rows]
        )
    base, *added = (
        InformationSet(positions, np.concatenate(row), robot.parameters.names)
        for row in zip(*parts, strict=True)
    )
    return base, dict(zip([robot.output_names[i] for i in others], added, strict=True))


def line_information(robot: Elastic, positions: Array, omega: Array, noise: NoiseLaw) -> Array:
    """Return the information of one experiment in each position at each line, (Q, F, p, p).

    The noise law says how precise FRFs are at the power of reference, which is then the unit of
    power: with k times the power, output noise being what it is, a line informs k times as much.

    Parameters
    ----------
    robot : Elastic
        A model with `parameters` and `network(positions)`.
    positions : ndarray, (Q, n), rad
        Positions.
    omega : ndarray, (F,), rad/s
        Angular frequencies.
    noise : NoiseLaw
        The noise law at the power of reference.
    """
    lines = np.asarray(omega, dtype=float)
    parts = [information(robot, positions, lines[f : f + 1], noise) for f in range(len(lines))]
    return np.stack([part.matrices for part in parts], axis=1)


def speed_cost(robot: Elastic, positions: Array, omega: Array) -> Array:
    """Return each motor's mean squared speed per unit of torque power, (n, Q, F) [rad^2/(N m s)^2].

    All motors are excited with the same power, in phases that do not add up: squares are summed.
    One row of it is the cost of a `LineLimit` on that motor's mean squared speed.

    Parameters
    ----------
    robot : Elastic
        As for `line_information`.
    positions : ndarray
        As for `line_information`.
    omega : ndarray
        As for `line_information`.
    """
    omega = np.asarray(omega, dtype=float)
    response = frequency_response(robot, np.atleast_2d(positions), omega)
    squares = np.sum(np.abs(response) ** 2, axis=-1) / omega[:, None] ** 2
    return np.asarray(np.moveaxis(squares, -1, 0))
