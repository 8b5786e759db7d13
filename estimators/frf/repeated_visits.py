"""Visits of one position made one: FRFs measured there again and again, averaged."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from estimators.frf.distortion import Distortion
from estimators.frf.estimate_frf import stacked_deviations
from estimators.frf.frf_estimate import FrfEstimate
from robotmodels.common.arrays import Array, IntArray, equal_rows

_SAME = 1e-9
"""Visits of one position agree to well below it [rad or m]."""

_LEVELS = ("output", "odd", "even", "odd_noise", "even_noise", "odd_raw", "even_raw")


def visits_of(positions: Array) -> list[IntArray]:
    """Return for each distinct position the indices of its visits, in order of the first."""
    group = equal_rows(positions.T, _SAME)
    _, first = np.unique(group, return_index=True)
    return [np.flatnonzero(group == group[i]) for i in np.sort(first)]


def merge_visits(estimate: FrfEstimate) -> FrfEstimate:
    """Return one FRF per distinct position, the mean over its visits by number of experiments.

    Errors of different visits are independent: the mean sum_v w_v G_v has the covariance
    sum_v w_v^2 C_v and the degrees of freedom of all visits together: each visit's blocks tell
    the scatter about the mean of that visit. Estimated covariances are not used as weights, they
    scatter too much.
    """
    visits = visits_of(estimate.positions)
    if len(visits) == len(estimate.positions):
        return estimate
    weights = _shares(estimate.repetitions, visits)
    squares = [w**2 for w in weights]
    draws = estimate.deviations
    if draws is not None:
        draws = stacked_deviations(
            [
                np.concatenate([w * draws[i] for i, w in zip(v, shares, strict=True)])
                for v, shares in zip(visits, weights, strict=True)
            ]
        )
    return FrfEstimate(
        estimate.positions[[v[0] for v in visits]],
        estimate.omega,
        _sums(estimate.response, visits, weights),
        _sums(estimate.covariance, visits, squares),
        np.array([estimate.repetitions[v].sum() for v in visits]),
        np.array([estimate.degrees_of_freedom[v].sum() for v in visits]),
        draws,
        estimate.line_correlation,
    )


def merge_distortion(distortion: Distortion) -> Distortion:
    """Return noise and distortion levels of the FRFs that `merge_visits` gives.

    Variances are those of the mean; levels of motion are root mean squares over visits.
    """
    visits = visits_of(distortion.positions)
    if len(visits) == len(distortion.positions):
        return distortion
    weights = _shares(distortion.blocks, visits)
    squares = [w**2 for w in weights]
    levels: dict[str, Any] = {
        name: np.sqrt(_sums(getattr(distortion, name) ** 2, visits, weights)) for name in _LEVELS
    }
    return replace(
        distortion,
        positions=distortion.positions[[v[0] for v in visits]],
        noise=_sums(distortion.noise, visits, squares),
        total=_sums(distortion.total, visits, squares),
        blocks=np.array([distortion.blocks[v].sum() for v in visits]),
        **levels,
    )


def distortion_in(distortion: Distortion, positions: IntArray) -> Distortion:
    """Return the noise and distortion levels in some positions (k,), counted from 0."""
    levels: dict[str, Any] = {
        name: getattr(distortion, name)[positions]
        for name in ("positions", "noise", "total", "blocks", *_LEVELS)
    }
    return replace(distortion, **levels)


def _shares(counts: IntArray, visits: Sequence[IntArray]) -> list[Array]:
    return [counts[v] / counts[v].sum() for v in visits]


def _sums(
    values: NDArray[Any], visits: Sequence[IntArray], weights: Sequence[Array]
) -> NDArray[Any]:
    """Return the weighted sum over the visits of each position."""
    return np.stack(
        [np.tensordot(w, values[v], axes=1) for v, w in zip(visits, weights, strict=True)]
    )
