"""Responses with other chains held by position controllers, and gains read off them: [HBH] 3.1, 3.2.

Where run i moves motor i alone and position controllers hold the other motors, the response of
motor i to its own torque is that of condition (4). The runs of two motors together give their
2 x 2 response with the others held, condition (9), and all runs the unconstrained response.
"""

from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from estimators.frf.estimate_frf import estimate_frf
from robotmodels.common.arrays import Array, ComplexArray
from robotmodels.common.errors import InvalidInput
from robotmodels.records.records import Records

_TERMS = 3  # of a gain's series in the squared frequency
_NEAR = 0.6  # of the lowest anti-resonance, below which the series holds
_FAR = 1.3  # of the highest resonance, above which that in the inverse square holds


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


def held_responses(
    records: Records, lowest_zero: float, highest_pole: float, delay: float = 0.0
) -> HeldResponses:
    """Return the responses of single chains and pairs, the others held, and their gains.

    Gains are limits of series in the squared frequency, fitted below the resonances, and in its
    inverse above them.

    Parameters
    ----------
    records : Records
        One position; run i moves motor i alone.
    lowest_zero, highest_pole : float, rad/s
        Lowest anti-resonance of all chains, and highest resonance.
    delay : float, s
        Of the angles after the torques.

    Raises
    ------
    InvalidInput
        If a run moves another motor too, or there are too few lines below or above.
    """
    motors = records.torque.shape[-1]
    _check_runs(records, motors)
    direct, direct_std, cross, cross_std = [], [], [], []
    for i in range(motors):
        omega, response, std = _of_motors(records, (i,), delay)
        direct.append(response[:, 0, 0])
        direct_std.append(std[:, 0, 0])
    for pair in combinations(range(motors), 2):
        omega, response, std = _of_motors(records, pair, delay)
        cross.append(response[:, 0, 1])
        cross_std.append(std[:, 0, 1])
    below, above = omega < _NEAR * lowest_zero, omega > _FAR * highest_pole
    for lines, where in ((below, "below the anti-resonances"), (above, "above the resonances")):
        if np.count_nonzero(lines) <= _TERMS:
            raise InvalidInput(
                f"{np.count_nonzero(lines)} lines {where}; more than {_TERMS} are needed for the "
                "gains there: widen the band, or take a longer period"
            )
    low = _gains(omega, direct, direct_std, below, 2)
    high = _gains(omega, direct, direct_std, above, -2)
    between = _gains(omega, cross, cross_std, below, 2)
    crossed = np.array(cross).reshape(len(cross), len(omega)).T
    return HeldResponses(omega, np.array(direct).T, crossed, *low, *high, *between)


def _of_motors(
    records: Records, motors: tuple[int, ...], delay: float
) -> tuple[Array, ComplexArray, Array]:
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
    estimate = estimate_frf(part, covariance="noise", structure="diagonal", delay=delay)
    return estimate.omega, estimate.response[0], np.sqrt(estimate.variance[0])


def _gains(
    omega: Array, responses: list[ComplexArray], stds: list[Array], lines: Array, power: int
) -> tuple[Array, Array]:
    """Return the constants of series in omega^power, and their standard deviations."""
    scaled = (omega[lines] / omega[lines].mean()) ** power
    series = scaled[:, None] ** np.arange(_TERMS)
    values, deviations = [], []
    for response, std in zip(responses, stds, strict=True):
        # Real and imaginary errors are half of the variance each.
        weights = np.sqrt(2) / std[lines]
        inverse = np.linalg.pinv(series * weights[:, None])
        values.append(inverse[0] @ (weights * response[lines].real))
        deviations.append(np.linalg.norm(inverse[0]))
    return np.array(values), np.array(deviations)


def _check_runs(records: Records, motors: int) -> None:
    if records.torque.shape[2] != motors:
        raise InvalidInput(
            f"records: {records.torque.shape[2]} runs of {motors} motors; one run per motor, which "
            "moves it alone, is needed"
        )
    for i in range(motors):
        moved = records.reference[:, :, i].any(axis=(0, 1, 2, 3))
        if moved[np.arange(motors) != i].any():
            other = int(np.flatnonzero(moved & (np.arange(motors) != i))[0])
            raise InvalidInput(
                f"records: run {i + 1} moves motor {other + 1} too; the other chains must be held "
                "for these gains"
            )
