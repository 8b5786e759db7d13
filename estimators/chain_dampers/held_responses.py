"""Responses with other chains held, and gains read off them: [HBH] sections 3.1 and 3.2.

Where run i moves motor i alone and position controllers hold the other motors, the response of
motor i to its own torque is that of condition (4). The runs of two motors together give their
2 x 2 response with the others held, condition (9), and all runs the unconstrained response.
"""

from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from estimators.chains.modes import FittedModes
from estimators.frf.estimate_frf import estimate_frf
from robotmodels.common.arrays import Array, ComplexArray
from robotmodels.common.errors import InvalidInput
from robotmodels.records.records import Records

_TERMS = 3  # of a gain's series in the squared frequency
_NEAR = 0.25  # of the lowest anti-resonance, below which the series is used
_FAR = 1.2  # of the highest resonance, from which on a gain counts as high


@dataclass(frozen=True, eq=False)
class HeldResponses:
    """Direct and cross responses with all other chains held, and their gains.

    Attributes
    ----------
    omega : ndarray, (F,), rad/s
        Angular frequencies.
    direct : ndarray of complex, (F, M), 1/kg
        Acceleration of each motor per its own torque, all other chains held.
    cross : ndarray of complex, (F, M (M - 1)/2), 1/kg
        Acceleration of motor i per torque of motor j for each pair i < j, the others held.
    low, low_std : ndarray, (M,), 1/kg
        A_L of (2), with standard deviations.
    high, high_std : ndarray, (M,), 1/kg
        A_H of (3).
    cross_low, cross_std : ndarray, (M (M - 1)/2,), 1/kg
        A_C with its sign, the other chains held.
    """

    omega: Array
    direct: ComplexArray
    cross: ComplexArray
    low: Array
    low_std: Array
    high: Array
    high_std: Array
    cross_low: Array
    cross_std: Array


def held_responses(records: Records, modes: FittedModes) -> HeldResponses:
    """Return the responses of single chains and pairs, the others held, and their gains.

    Gains at low frequency are limits of series in the squared frequency. Those at high frequency
    are of the unconstrained response, less what the measured poles and zeros still add there.

    Parameters
    ----------
    records : Records
        One position; run i moves motor i alone.
    modes : FittedModes
        Modes fitted to the unconstrained response of the same records.

    Raises
    ------
    InvalidInput
        If a run moves another motor too, or there are too few lines below or above the resonances.
    """
    motors = records.torque.shape[-1]
    _check_runs(records, motors)
    direct = [_of_motors(records, (i,)) for i in range(motors)]
    pairs = [_of_motors(records, pair) for pair in combinations(range(motors), 2)]
    omega, lines = direct[0][0], len(direct[0][0])
    below = omega < _NEAR * modes.zeros.min()
    above = modes.data.omega > _FAR * modes.omega[-1]
    for inside, where in ((below, "below the anti-resonances"), (above, "above the resonances")):
        if np.count_nonzero(inside) <= _TERMS:
            raise InvalidInput(
                f"{np.count_nonzero(inside)} lines {where}; more than {_TERMS} are needed for the "
                "gains there: widen the band, or take a longer period"
            )
    low = [_low_gain(w[below], G[below, 0, 0], std[below, 0, 0]) for w, G, std in direct]
    between = [_low_gain(w[below], G[below, 0, 1], std[below, 0, 1]) for w, G, std in pairs]
    high = [_high_gain(modes, i, above) for i in range(motors)]
    gains = (np.reshape(part, (-1, 2)).T for part in (low, high, between))
    return HeldResponses(
        omega,
        np.stack([G[:, 0, 0] for _, G, _ in direct], axis=1),
        np.reshape([G[:, 0, 1] for _, G, _ in pairs], (-1, lines)).T,
        *(column for pair in gains for column in pair),
    )


def _of_motors(records: Records, motors: tuple[int, ...]) -> tuple[Array, ComplexArray, Array]:
    """Return frequencies, the response among these motors and its deviations, the others held."""
    index = list(motors)
    part = replace(
        records,
        positions=records.positions[:, index],
        **{
            name: getattr(records, name)[:, :, index][..., index]
            for name in ("reference", "torque", "angle", "saturated")
        },
    )
    estimate = estimate_frf(part, covariance="noise", structure="diagonal")
    return estimate.omega, estimate.response[0], np.sqrt(estimate.variance[0])


def _low_gain(omega: Array, response: ComplexArray, std: Array) -> tuple[float, float]:
    """Return the constant of a series in omega^2, and its standard deviation."""
    series = (omega / omega[-1])[:, None] ** (2 * np.arange(_TERMS))
    weights = np.sqrt(2) / std  # the real part has half of the variance
    inverse = np.linalg.pinv(series * weights[:, None])
    return float(inverse[0] @ (weights * response.real)), float(np.linalg.norm(inverse[0]))


def _high_gain(modes: FittedModes, chain: int, lines: NDArray[np.bool_]) -> tuple[float, float]:
    """Return A_H of a chain, (3), and its standard deviation.

    G is A_H prod (lambda - lambda_0)/(lambda - lambda_r) over zeros and poles.
    """
    data, square = modes.data, modes.data.omega[lines, None] ** 2
    factor = np.prod((1 - modes.omega**2 / square) / (1 - modes.zeros[chain] ** 2 / square), axis=1)
    weights = 2 / (data.std[lines, chain, chain] * factor) ** 2
    values = data.response[lines, chain, chain].real * factor
    return float(weights @ values / weights.sum()), float(weights.sum() ** -0.5)


def _check_runs(records: Records, motors: int) -> None:
    if records.torque.shape[2] != motors:
        raise InvalidInput(
            f"records: {records.torque.shape[2]} runs of {motors} motors; one run per motor, which "
            "moves it alone, is needed"
        )
    for i in range(motors):
        moved = np.flatnonzero(records.reference[:, :, i].any(axis=(0, 1, 2, 3)))
        others = moved[moved != i]
        if len(others):
            other = int(others[0])
            raise InvalidInput(
                f"records: run {i + 1} moves motor {other + 1} too; the other chains must be held "
                "for these gains"
            )
