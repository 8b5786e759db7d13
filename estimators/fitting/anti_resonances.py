"""What anti-resonances say of gears: on which stiffness positions agree."""

import numpy as np

from estimators.fitting.weights import MINIMUM_SNR
from estimators.frf.frf_estimate import FrfEstimate
from robotmodels.common.arrays import Array
from robotmodels.linear.spring_network import SpringNetwork

# ln |G| that a dip must lie below its surroundings to be no noise.
PROMINENCE = 0.7
# Stiffnesses from two positions agree if their logarithms differ by about this: links that bend
# shift anti-resonances by as much.
AGREE = 0.3
# No dip is worth more than this in ln |G|: how deep it is depends on the grid of frequencies.
DEEP = 3.0


def gear_springs(network: SpringNetwork) -> dict[int, int]:
    """Return which spring joins each motor to the arm."""
    motors = {int(np.argmax(np.abs(column))): i for i, column in enumerate(network.selector.T)}
    return {
        motors[end]: s
        for s, ends in enumerate(network.nodes.tolist())
        for end in ends
        if end in motors and -1 not in ends
    }


def end_inertias(network: SpringNetwork) -> Array:
    """Return the rigid inertias at both ends of springs, (s, 2, Q); infinite at the ground."""
    inertia = np.diagonal(network.linear_model().mass, axis1=1, axis2=2).T
    ground = np.full((1, inertia.shape[1]), np.inf)
    return np.concatenate([inertia, ground])[network.nodes]  # the end -1 is the last


def dip_values(
    network: SpringNetwork, both: Array, estimate: FrfEstimate, motor: int, s: int
) -> list[tuple[Array, Array]]:
    """Return logarithms of a gear's stiffness from every dip, and its weights, by position.

    Parameters
    ----------
    both : ndarray, (2, Q)
        Inertias at its ends.
    """
    ends = network.nodes[s].tolist()
    shaft = int(np.argmax(np.abs(network.selector[:, motor])))
    rotor, arm = both[ends.index(shaft)], both[1 - ends.index(shaft)]
    dips = []
    # What lies below the noise shows no dips of its own.
    size = np.abs(estimate.response[:, :, motor, motor])
    noise = MINIMUM_SNR * np.sqrt(estimate.variance[:, :, motor, motor])
    for q, level in enumerate(np.log(np.maximum(size, noise))):
        inertia, (omega, depth) = arm[q], _dips(level, estimate.omega)
        if not omega.size:
            inertia = 1 / (1 / arm[q] + 1 / rotor[q])
            omega, depth = _dips(-level, estimate.omega)
        dips.append((np.log(inertia * omega**2), np.minimum(depth, DEEP)))
    return dips


def _dips(level: Array, omega: Array) -> tuple[Array, Array]:
    """Return frequencies and depths of the pronounced minima of (F,) levels."""
    from scipy.signal import find_peaks

    dips, shape = find_peaks(-level, prominence=PROMINENCE)
    return omega[dips], shape["prominences"]


def agreed(dips: list[tuple[Array, Array]]) -> float:
    """Return exp of the value that most positions have, or nearly; not a number without two.

    Parameters
    ----------
    dips : list of tuple of (ndarray, ndarray)
        Logarithms of candidates and their weights, for each position.
    """

    def support(value: float) -> Array:
        """Return the best weight for a value in each position, (Q,)."""
        return np.array(
            [np.max(w * np.exp(-(((x - value) / AGREE) ** 2) / 2), initial=0.0) for x, w in dips]
        )

    candidates = np.concatenate([x for x, _ in dips])
    if not candidates.size:
        return np.nan
    best = max(candidates.tolist(), key=lambda value: float(support(value).sum()))
    near = [x[np.argmin(np.abs(x - best))] for x, _ in dips if x.size]
    near = [x for x in near if abs(x - best) < 2 * AGREE]
    return float(np.exp(np.median(near))) if len(near) >= min(2, len(dips)) else np.nan
