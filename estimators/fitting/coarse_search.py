"""Rough values of springs bettered a group at a time, by the magnitudes of measured FRFs alone.

Far from the truth a gradient leads astray: a resonance moves past those of other axes. What a few
values of each group come to is looked at instead, the others fixed.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from estimators.fitting.weights import user_weights
from estimators.frf.frf_estimate import FrfEstimate
from robotmodels.common.arrays import Array, IntArray
from robotmodels.common.errors import IdentificationError
from robotmodels.linear.spring_network import SpringNetwork

# Changes that each group is tried with.
_FACTORS = np.log([0.25, 0.5, 0.7, 0.85, 1.2, 1.4, 2.0, 4.0])
# Of frequencies, which is enough to tell resonances that lie wrong.
_LINES = 30
# Through all groups, unless one gains less than a fiftieth.
_SWEEPS, _GAIN = 3, 0.02


@dataclass(frozen=True, eq=False)
class ParameterGroup:
    """Coefficients that are changed by one factor.

    Attributes
    ----------
    rows : tuple of int
        Rows of the springs' stiffnesses and then dampings, as in `SpringNetwork.exponents`.
    candidates : tuple of float
        Logarithms of values the first of them may have, besides multiples of its own.
    """

    rows: tuple[int, ...]
    candidates: tuple[float, ...] = ()


def coarse_search(
    network: SpringNetwork, estimate: FrfEstimate, start: Array, groups: Sequence[ParameterGroup]
) -> Array:
    """Return values (p,) whose FRFs lie nearer to the measured ones in mean |ln |G||, or `start`.

    Elements off the diagonal count a tenth, those below 10 dB not at all; equilibria are those of
    the network.
    """
    error = _error(network, estimate)
    exponents = network.exponents.mean(axis=0)
    acting = exponents.any(axis=1)
    inverse = np.zeros(exponents.T.shape)
    inverse[:, acting] = np.linalg.pinv(exponents[acting])
    coefficients = np.concatenate([network.spring_stiffness, network.spring_damping], axis=1)
    with np.errstate(divide="ignore"):
        level = np.mean(np.log(coefficients), axis=0) - exponents @ np.log(
            network.parameters.values
        )
    x = np.log(start)
    least = error(x)
    for _ in range(_SWEEPS):
        before = least
        for group in groups:
            direction = inverse[:, list(group.rows)].sum(axis=1)
            first = group.rows[0]
            now = level[first] + exponents[first] @ x
            changes = [*(np.asarray(group.candidates) - now), *_FACTORS]
            tried = [(error(x + change * direction), change) for change in changes]
            best, change = min(tried)
            if best < least:
                least, x = best, x + change * direction
        if not least < (1 - _GAIN) * before:
            break
    return np.asarray(np.exp(x))


def _error(network: SpringNetwork, estimate: FrfEstimate) -> Callable[[Array], float]:
    """Return the mean |ln |G_measured/G|| as a function of ln theta, infinite without FRFs."""
    count = len(estimate.omega)
    lines: IntArray = np.unique(np.linspace(0, count - 1, min(count, _LINES)).round().astype(int))
    weights = user_weights(estimate)[:, lines]
    used = weights > 0
    with np.errstate(divide="ignore"):
        measured = np.log(np.abs(estimate.response[:, lines]))

    def error(ln_theta: Array) -> float:
        try:
            G = network.frequency_response(estimate.omega[lines], np.exp(ln_theta))
        except (IdentificationError, np.linalg.LinAlgError):
            return np.inf
        with np.errstate(divide="ignore", invalid="ignore"):
            deviation = np.abs(measured - np.log(np.abs(G)))[used]
        mean = float(np.sum(weights[used] * deviation) / np.sum(weights)) if used.any() else 0.0
        return mean if np.isfinite(mean) else np.inf

    return error
