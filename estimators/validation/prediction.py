"""What a fit predicts elsewhere: bands of FRFs, resonances and anti-resonances."""

from dataclasses import dataclass
from functools import partial

import numpy as np

from estimators.uncertainty.covariance import Uncertainty
from estimators.validation.bands import (
    Spread,
    checked_spread,
    delta_band,
    draw_band,
    propagate,
    thinned,
)
from robotmodels.common.arrays import Array, ComplexArray, read_only
from robotmodels.common.progress import Progress, tell
from robotmodels.linear.modes import anti_resonances, resonances
from robotmodels.linear.response import Elastic, sensitivity


@dataclass(frozen=True, eq=False)
class FrfBand:
    """Predicted FRFs.

    Attributes
    ----------
    omega : ndarray, (F,), rad/s
        Angular frequencies.
    response : ndarray of complex, (Q, F, m, n)
        Response at the fit.
    magnitude_std : ndarray, (Q, F, m, n), dimensionless
        Standard deviations of ln |G|.
    phase_std : ndarray, (Q, F, m, n), rad
        Phase std.
    lower, upper : ndarray, (Q, F, m, n)
        Ends of the band of |G|.
    level : float
        Nominal coverage of each point of the band.
    """

    omega: Array
    response: ComplexArray
    magnitude_std: Array
    phase_std: Array
    lower: Array
    upper: Array
    level: float


@dataclass(frozen=True, eq=False)
class ModeBand:
    """Predicted resonances, or anti-resonances, lowest first.

    Attributes
    ----------
    frequencies : ndarray, (Q, k), rad/s
        Frequencies at the fit.
    std : ndarray, (Q, k), dimensionless
        Standard deviations of ln frequency.
    lower, upper : ndarray, (Q, k), rad/s
        Ends of the intervals.
    level : float
        Nominal coverage of each interval.
    """

    frequencies: Array
    std: Array
    lower: Array
    upper: Array
    level: float


def predict_frf(
    model: Elastic,
    values: Array,
    positions: Array,
    omega: Array,
    spread: Spread,
    level: float = 0.95,
) -> FrfBand:
    """Return FRFs in any positions with their uncertainty, that of the parameters alone.

    The delta method takes ln G as linear in ln theta; near lightly damped resonances that are not
    well known draws of a posterior are better.

    Parameters
    ----------
    model : Elastic
        Robot.
    values : ndarray, (p,)
        Fitted parameters [SI].
    positions : ndarray, (Q, n), rad
        Measured in or not.
    omega : ndarray, (F,), rad/s
        Angular frequencies.
    spread : Spread
        Covariance of ln theta, or draws (N, p) of it; of more than 400 draws every so many.
    level : float
        Level of the band.

    Raises
    ------
    InvalidInput
        For a level outside (0, 1), or a spread of other parameters.
    IdentificationError
        If the model has no FRF in a position.
    """
    spread = checked_spread(model.parameters.names, spread, level)
    G, J = sensitivity(model, positions, omega, values)
    if isinstance(spread, Uncertainty):
        band = delta_band(G, J, spread, level)
    else:
        band = draw_band(G, _responses(model, positions, omega, spread), level)
    return FrfBand(np.asarray(omega), G, band.std, band.phase_std, band.lower, band.upper, level)


def predict_modes(
    model: Elastic,
    values: Array,
    positions: Array,
    spread: Spread,
    *,
    motor: int | None = None,
    level: float = 0.95,
) -> ModeBand:
    """Return undamped resonances in any positions, or the zeros of one motor's own FRF.

    Parameters
    ----------
    motor : int, optional
        0 to n - 1 for the anti-resonances of that motor; None for resonances.
    model : Elastic
        As in `predict_frf`.
    values : ndarray
        As in `predict_frf`.
    positions : ndarray
        As in `predict_frf`.
    spread : Spread
        As in `predict_frf`.
    level : float
        As in `predict_frf`.

    Raises
    ------
    InvalidInput
        For a level outside (0, 1), a spread of other parameters, or no such motor.
    IdentificationError
        If the model has no equilibrium in a position.
    """
    spread = checked_spread(model.parameters.names, spread, level)
    modes = partial(_modes, model, np.asarray(positions, dtype=float), motor)
    frequencies, band = propagate(modes, np.asarray(values, dtype=float), spread, level)
    return ModeBand(frequencies, band.std, band.lower, band.upper, level)


@dataclass(frozen=True, eq=False)
class WorkspaceMap:
    """Standard deviations of FRFs and resonances all over the workspace.

    Attributes
    ----------
    positions : ndarray, (Q, n), rad
        Positions.
    frequencies : ndarray, (Q, k), rad/s
        Lowest resonances.
    mode_std : ndarray, (Q, k), dimensionless
        Standard deviations of ln frequency.
    response_std : ndarray, (Q,), dimensionless
        Root mean square of std ln |G| over frequencies and diagonal elements.
    worst_std : ndarray, (Q,), dimensionless
        Largest of them.
    """

    positions: Array
    frequencies: Array
    mode_std: Array
    response_std: Array
    worst_std: Array


def workspace_map(
    model: Elastic,
    values: Array,
    positions: Array,
    omega: Array,
    uncertainty: Uncertainty,
    *,
    modes: int = 3,
    chunk: int = 20,
    progress: Progress | None = None,
) -> WorkspaceMap:
    """Return the predicted uncertainty in many positions, by the delta method.

    Parameters
    ----------
    modes : int
        Lowest resonances to look at.
    chunk : int
        Positions at a time.
    progress : Progress, optional
        Called with the positions done and their number.
    model : Elastic
        As in `predict_frf`.
    values : ndarray
        As in `predict_frf`.
    positions : ndarray
        As in `predict_frf`.
    omega : ndarray
        As in `predict_frf`.
    uncertainty : Uncertainty
        As in `predict_frf`.

    Raises
    ------
    InvalidInput, IdentificationError
        As `predict_frf` and `predict_modes`.
    """
    positions = np.asarray(positions, dtype=float)
    rows = []
    for first in range(0, len(positions), chunk):
        some = positions[first : first + chunk]
        band = predict_frf(model, values, some, omega, uncertainty)
        predicted = predict_modes(model, values, some, uncertainty)
        diagonal = np.diagonal(band.magnitude_std, axis1=-2, axis2=-1)
        rows.append(
            (
                predicted.frequencies[:, :modes],
                predicted.std[:, :modes],
                np.sqrt(np.mean(diagonal**2, axis=(1, 2))),
                diagonal.max(axis=(1, 2)),
            )
        )
        tell(progress, min(first + chunk, len(positions)), len(positions))
    parts = (read_only(np.concatenate(part)) for part in zip(*rows, strict=True))
    return WorkspaceMap(read_only(positions), *parts)


def _modes(model: Elastic, positions: Array, motor: int | None, theta: Array) -> Array:
    linear = model.network(positions, theta).linear_model()
    return resonances(linear).frequencies if motor is None else anti_resonances(linear, motor)


def _responses(model: Elastic, positions: Array, omega: Array, draws: Array) -> ComplexArray:
    from robotmodels import kernel

    positions = np.asarray(positions, dtype=float)
    networks = (model.network(positions, np.exp(x)) for x in thinned(draws))
    return np.stack([kernel.frequency_response(network, omega) for network in networks])
