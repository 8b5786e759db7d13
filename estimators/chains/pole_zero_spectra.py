"""Poles and zeros of one motor's response and the weights of its modes: [HBH] (13) and back.

With lambda = omega^2 the compliance theta_1/tau_1 of a motor is sum_r w_r/(lambda_r - lambda),
where lambda_r are the squared resonances of all chains together, one of them zero, and w = u^2/m_1
with u the first components of the eigenvectors. A mode that the motor hardly feels is a pole with a
zero next to it, whose distance says how much of it the motor feels: distances are kept apart from
the rounded frequencies.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from robotmodels.common.arrays import Array
from robotmodels.common.errors import InvalidInput

_SMALLEST = 600.0  # ln of an interval's length over the smallest distance looked for in it
_BISECTIONS = 75  # of that range of ln down to rounding


def first_components(poles: Array, zeros: Array, tolerance: float = 0.0) -> Array:
    """Return the first components of the eigenvectors, (k,), [HBH] (13).

    Parameters
    ----------
    poles : ndarray, (k,), rad^2/s^2
        Squared resonances lambda, the rigid mode's zero included.
    zeros : ndarray, (k - 1,), rad^2/s^2
        Squared anti-resonances lambda_0.
    tolerance : float, rad^2/s^2
        Error of poles and zeros: a pair that is out of order by no more counts as cancelled, with
        the component zero.

    Raises
    ------
    InvalidInput
        If poles and zeros do not interlace, naming the pair.
    """
    poles, zeros = np.sort(np.asarray(poles, float)), np.sort(np.asarray(zeros, float))
    check_interlacing(poles, zeros, tolerance)
    zeros = np.clip(zeros, poles[:-1], poles[1:])
    return np.asarray(np.sqrt(squared_components(poles, poles - zeros[:, None])))


def squared_components(poles: NDArray[Any], distances: NDArray[Any]) -> NDArray[Any]:
    """Return the squares of the first components, (..., k), of ordered poles and zeros, [HBH] (13).

    Analytic in its arguments, complex ones included.

    Parameters
    ----------
    poles : ndarray, (..., k), rad^2/s^2
        Squared resonances, no two of them equal; leading axes are cases.
    distances : ndarray, (..., k - 1, k), rad^2/s^2
        Of the poles above each squared anti-resonance: small ones may be known better than the
        difference of rounded numbers.
    """
    count = poles.shape[-1]
    squares = []
    for i in range(count):
        others = np.arange(count) != i
        # Products of ratios near one: those of the numbers themselves overflow for long chains.
        gaps = poles[..., i, None] - poles[..., others]
        squares.append(np.prod(distances[..., i] / gaps, axis=-1))
    return np.stack(squares, axis=-1)


def check_interlacing(poles: Array, zeros: Array, tolerance: float = 0.0) -> None:
    """Refuse spectra that no chain can have: lambda_1 <= lambda0_1 <= lambda_2 <= ...

    Parameters
    ----------
    poles, zeros : ndarray, (k,) and (k - 1,), rad^2/s^2
        In rising order.
    tolerance : float, rad^2/s^2
        By how much a pair may be out of order.

    Raises
    ------
    InvalidInput
        Naming the first pair out of order.
    """
    if zeros.shape != (len(poles) - 1,):
        raise InvalidInput(
            f"poles and zeros: {len(poles)} poles (the rigid one included) and {len(zeros)} zeros; "
            f"{max(len(poles) - 1, 0)} zeros, one between each two poles, are needed"
        )
    if not (np.isfinite(poles).all() and np.isfinite(zeros).all()):
        raise InvalidInput("poles and zeros: all must be finite numbers")
    for i, zero in enumerate(zeros):
        below, above = zero < poles[i] - tolerance, zero > poles[i + 1] + tolerance
        for j, wrong in ((i, below), (i + 1, above)):
            if wrong:
                raise InvalidInput(
                    f"poles and zeros do not interlace: anti-resonance {i + 1} at "
                    f"{_hertz(zero)} Hz lies {'below' if j == i else 'above'} the pole "
                    f"{j + 1} at {_hertz(poles[j])} Hz; one of the two is not of this chain, "
                    "or a mode was missed"
                )


def separated(poles: Array, zeros: Array, tolerance: float) -> tuple[Array, Array]:
    """Return ordered poles and zeros with the zeros moved between their poles, double poles single.

    Two poles nearer to each other than `tolerance` hold a zero that cancels one of them.
    """
    distinct = np.diff(poles) > tolerance
    poles, zeros = poles[np.concatenate([[True], distinct])], zeros[distinct]
    return poles, np.clip(zeros, poles[:-1], poles[1:])


def zeros_between(poles: Array, weights: Array) -> tuple[Array, Array]:
    """Return the zeros of sum_r w_r/(lambda_r - lambda), and their distances from the poles.

    They are the squared resonances with the motor locked (Ram and Elhay 1996). Each is found by
    bisection in the logarithm of its distance from the nearer pole, so that distances are right to
    rounding however small they are: the weights of what is left depend on them.

    Parameters
    ----------
    poles : ndarray, (k,), rad^2/s^2
        In rising order.
    weights : ndarray, (k,)
        Not negative; a pole without weight is a zero itself.

    Returns
    -------
    zeros : ndarray, (k - 1,), rad^2/s^2
        In rising order.
    distances : ndarray, (k - 1, k), rad^2/s^2
        lambda_r - zero.
    """
    gaps = np.diff(poles)
    inside = np.flatnonzero(gaps > 0)
    zeros, distances = poles[1:].copy(), poles - poles[1:, None]
    lengths = gaps[inside]
    # Poles as seen from the left end of each gap: the slope of the sum is positive everywhere.
    seen = poles - poles[inside, None]
    with np.errstate(divide="ignore"):
        middle = (weights / (seen - lengths[:, None] / 2)).sum(axis=1)
    right = middle < 0
    origin = inside + right
    seen = poles - poles[origin, None]
    sign = np.where(right, -1.0, 1.0)
    low, high = np.log(lengths) - _SMALLEST, np.log(lengths / 2)
    for _ in range(_BISECTIONS):
        trial = (low + high) / 2
        values = sign * (weights / (seen - (sign * np.exp(trial))[:, None])).sum(axis=1)
        high, low = np.where(values > 0, trial, high), np.where(values > 0, low, trial)
    # Beside a pole without weight the sign need not change: the zero ends at the pole then.
    steps = sign * np.exp((low + high) / 2)
    zeros[inside] = poles[origin] + steps
    distances[inside] = seen - steps[:, None]
    return zeros, distances


def _hertz(square: float) -> str:
    return f"{np.sqrt(max(square, 0.0)) / (2 * np.pi):.4g}"
