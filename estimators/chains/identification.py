"""Inverse eigenvalue identification of coupled chains from FRFs, [HBH] in full, with covariance."""

from dataclasses import replace
from functools import partial
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from estimators.chains.identified_chains import ChainIdentification
from estimators.chains.inverse_estimate import inverse_estimate
from estimators.chains.modal_model import modal_response
from estimators.chains.mode_search import Shapes, fit_modes
from estimators.chains.model_order import (
    OrderProposal,
    WrongModeCount,
    check_not_too_few,
    check_not_too_many,
    propose_order,
)
from estimators.chains.modes import FittedModes, with_excess
from estimators.chains.parameter_maps import ChainLayout
from estimators.chains.structured_estimate import structured_cost, structured_estimate
from estimators.chains.whitened_frf import Data, prepared, unfrictioned
from estimators.frf.frf_estimate import FrfEstimate
from robotmodels.common.arrays import Array, ComplexArray, is_count, real_numbers
from robotmodels.common.errors import InvalidInput, NotIdentifiable, check_word
from robotmodels.linear.held_torques import held_torque_images
from robotmodels.linear.response import check_omega

Method = Literal["likelihood", "lanczos", "stepwise"]
"""How masses and springs follow from the modes; see `identify_chains`."""

# FRFs whose imaginary part is below this share are computed for undamped chains, not measured.
_ROUNDING = 1e-10
_MISFIT = 2.0  # over noise, from which on errors beyond the noise are allowed for


def identify_chains(
    omega: Array,
    response: ComplexArray,
    n_masses: int | None = None,
    *,
    covariance: NDArray[Any] | None = None,
    first_masses: Array | None = None,
    distortion: Array | None = None,
    method: Method = "likelihood",
) -> ChainIdentification:
    """Identify masses, springs and couplings of chains from their motors' FRFs.

    Parameters
    ----------
    omega : ndarray, (F,), rad/s
        Angular frequencies, increasing.
    response : ndarray of complex, (F, M, M)
        Motor torque to motor acceleration, no motor held.
    n_masses : int, optional
        N; proposed from the data where None.
    covariance : ndarray, optional
        (F, M, M) variances or (F, M M, M M) of vec(G), as the noise is declared to be; for one that
        was estimated see `chains_from_frf`. Without it the noise is taken to be relative, and its
        size from the misfit.
    first_masses : ndarray, (M,), optional
        Motor inertias, where a data sheet gives them: taken as exact, and the high-frequency gains
        (3) not used.
    distortion : ndarray, (F, M, M), optional
        Standard deviations of one block's FRF by nonlinear distortion, see `Distortion.level`:
        lines at the low end that friction distorts are left out, others count less.
    method : {"likelihood", "lanczos", "stepwise"}
        "lanczos" solves the inverse eigenvalue problem of the fitted modes by the Lanczos recursion
        to the end, "stepwise" as [HBH] section 3.4 prints it: couplings by (7) and (8), one or two
        masses at a time by (13) to (22). Both take just as many numbers as there are unknowns.
        "likelihood" goes on from there to the chains that are most likely by all data, with
        intervals and a verdict.

    Raises
    ------
    InvalidInput
        For shapes that do not fit, N < 2, or motors that answer to no torque.
    WrongModeCount
        If the FRFs show more or fewer modes than M (N - 1); an InvalidInput.
    NotIdentifiable
        If the order is too high for the data, naming parameters.
    """
    data = _checked(omega, response, n_masses, covariance)
    motors = None if first_masses is None else _checked_motors(first_masses, data.chains)
    data, left_out = unfrictioned(data, distortion)
    return _identified(data, n_masses, motors, left_out, method)


def chains_from_frf(
    estimate: FrfEstimate,
    n_masses: int | None = None,
    *,
    position: int = 0,
    first_masses: Array | None = None,
    distortion: Array | None = None,
    sample_time: float | None = None,
    delay: float = 0.0,
    method: Method = "likelihood",
) -> ChainIdentification:
    """Identify chains as `identify_chains` does, from FRFs and the covariance of their errors.

    Degrees of freedom, draws and correlation along lines of the errors travel with the estimate.

    Parameters
    ----------
    estimate : FrfEstimate
        FRFs, motor torque to motor acceleration.
    position : int
        Index of the position among those of the estimate.
    sample_time : float, s, optional
        Time over which the torque was held: images of the hold are taken off the FRFs. None where
        no torque was held.
    delay : float, s
        Delay that the estimate was corrected for.
    method : {"likelihood", "lanczos", "stepwise"}
        As in `identify_chains`.

    Raises
    ------
    InvalidInput, WrongModeCount, NotIdentifiable
        As `identify_chains`, or if there is no such position.
    """
    if not 0 <= position < len(estimate.positions):
        raise InvalidInput(
            f"position {position}: the estimate has positions 0 to {len(estimate.positions) - 1}"
        )
    one = estimate.subset([position])
    checked = _checked(one.omega, one.response[0], n_masses, one.covariance[0])
    motors = None if first_masses is None else _checked_motors(first_masses, checked.chains)
    data, left_out = unfrictioned(replace(checked, estimate=one), distortion)
    if sample_time is not None and images_count(data, sample_time):
        errors = image_size(data, sample_time)
        rough = _modes(data.with_error(errors**2), _layout(data, n_masses)[0])[0]
        data = data.without(held_images(rough, sample_time, delay))
    return _identified(data, n_masses, motors, left_out, method)


def _identified(
    data: Data, n_masses: int | None, motors: Array | None, left_out: int, method: Method
) -> ChainIdentification:
    check_word("method:", method, get_args(Method))
    layout, order = _layout(data, n_masses)
    modes, excess = _modes(data, layout)
    inverse = inverse_estimate(modes, layout, motors, method == "stepwise")
    if method != "likelihood" or data.undamped:
        cost = structured_cost(modes, inverse)
        return ChainIdentification(modes, inverse, inverse, cost, order, left_out, excess)
    structured, cost = structured_estimate(modes, inverse, motors)
    return ChainIdentification(modes, inverse, structured, cost, order, left_out, excess)


def _layout(data: Data, n_masses: int | None) -> tuple[ChainLayout, OrderProposal | None]:
    """Return the layout of chains of N masses, and how N was proposed where it is not given."""
    order = propose_order(data) if n_masses is None else None
    return ChainLayout(data.chains, int(n_masses or 0) if order is None else order.n_masses), order


def _modes(data: Data, layout: ChainLayout) -> tuple[FittedModes, float]:
    """Return the modes, as many as the chains have, and the excess error, or refuse."""
    if data.undamped:
        from estimators.chains.rational_approximation import exact_poles

        squares = exact_poles(data.omega, data.response.real)
        if len(squares) != layout.modes:
            raise WrongModeCount(data, np.sqrt(squares), layout.modes, layout.masses)
        return fit_modes(data, layout.modes), 0.0
    if data.size < 2 * (layout.modal.size + 2 * layout.modes + data.chains):
        raise NotIdentifiable(
            (f"{layout.modes} modes",),
            f"{len(data.omega)} lines are too few; measure more, or give fewer masses",
        )
    # Dampers that couple modes turn their shapes; unlike a bias, allowing for it costs next to
    # nothing.
    enough = data.size >= 2 * (layout.modal.size + (2 + data.chains) * layout.modes + data.chains)
    kind: Shapes = "complex" if enough else "auto"
    modes = fit_modes(data, layout.modes, shapes=kind)
    check_not_too_many(modes, layout.masses)
    excess = 0.0
    if not data.scaled and modes.misfit > _MISFIT:
        for _ in range(2):
            enlarged, excess = with_excess(replace(modes, data=data))
            modes = fit_modes(enlarged, layout.modes, shapes=kind)
    check_not_too_few(modes, layout.masses)
    return modes, excess


def _checked(
    omega: Array,
    response: ComplexArray,
    n_masses: int | None,
    covariance: NDArray[Any] | None,
) -> Data:
    omega = check_omega(omega)
    G = np.asarray(response, dtype=complex)
    if G.ndim != 3 or G.shape[0] != len(omega) or G.shape[1] != G.shape[2]:
        raise InvalidInput(
            f"response: shape {G.shape} given; ({len(omega)}, M, M), one row and column per motor, "
            "is needed"
        )
    if len(omega) < 2 or not (np.diff(omega) > 0).all():
        raise InvalidInput("omega: two or more increasing frequencies are needed")
    if n_masses is not None and not is_count(n_masses, 2):
        raise InvalidInput(
            f"n_masses: {n_masses!r}; a chain needs at least 2, a whole number (a single mass has "
            "no spring, and its FRF is 1/mass)"
        )
    _check_excited(G)
    undamped = covariance is None and bool(np.abs(G.imag).max() <= _ROUNDING * np.abs(G).max())
    if covariance is not None:
        covariance = _checked_covariance(np.asarray(covariance), G.shape)
    return prepared(omega, G, covariance, undamped)


def _check_excited(response: ComplexArray) -> None:
    for i in range(response.shape[1]):
        if not np.isfinite(response[:, :, i]).all():
            raise InvalidInput(f"response: not finite from motor {i + 1}; was it excited at all?")
        if not response[:, i, i].any():
            raise InvalidInput(f"response: zero from motor {i + 1} to itself; was it excited?")


def _checked_motors(first_masses: Array, count: int) -> Array:
    masses = real_numbers(first_masses, "first_masses")
    if masses.shape not in ((), (count,)) or not (np.isfinite(masses) & (masses > 0)).all():
        raise InvalidInput(f"first_masses: {masses.tolist()} are not {count} positive numbers")
    return np.broadcast_to(masses, (count,))


def _checked_covariance(covariance: NDArray[Any], shape: tuple[int, ...]) -> NDArray[Any]:
    lines, m, _ = shape
    if covariance.shape not in (shape, (lines, m * m, m * m)):
        raise InvalidInput(
            f"covariance: shape {covariance.shape}; {shape} or {(lines, m * m, m * m)} is needed"
        )
    variance = (
        covariance if covariance.shape == shape else np.diagonal(covariance, axis1=1, axis2=2)
    )
    wrong = ~(np.isfinite(variance) & (variance.real > 0)).reshape(lines, -1)
    if wrong.any():
        f, element = np.argwhere(wrong)[0]
        raise InvalidInput(
            f"covariance: the variance of frequency {f}, element {element} (counted from 0) is no "
            "positive number"
        )
    return covariance


_COUNTS = 0.02  # of a standard deviation, from which on images are taken off


def held_images(modes: FittedModes, sample_time: float, delay: float = 0.0) -> ComplexArray:
    """Return what images add to the FRFs (F, M, M) of fitted modes.

    Parameters
    ----------
    sample_time : float, s
        T.
    delay : float, s
        Delay that the FRFs were corrected for, beside that of the modes.
    """
    response = partial(modal_response, modes.x, modes.layout)
    return held_torque_images(response, modes.data.omega, sample_time, delay=delay)


def image_size(data: Data, sample_time: float) -> Array:
    """Return about how large images are, (F, M, M), at most: those of the largest gain of all."""
    half = data.omega * sample_time / 2
    gain = np.median(np.abs(data.response), axis=0).max()
    size = gain * half**3 / 15
    return np.asarray(np.broadcast_to(size[:, None, None], data.response.shape))


def images_count(data: Data, sample_time: float) -> bool:
    """Tell whether images are not negligible beside the noise."""
    return bool((image_size(data, sample_time) > _COUNTS * data.std).any())
