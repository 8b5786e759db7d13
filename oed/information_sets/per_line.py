"""The information of single frequency lines, and what their powers cost, for `optimal_spectrum`."""

import numpy as np

from oed.information_sets.compute import information
from robotmodels.common.arrays import Array
from robotmodels.linear.noise import NoiseLaw
from robotmodels.linear.response import Elastic, frequency_response


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
