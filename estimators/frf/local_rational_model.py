"""FRFs from fewer runs than inputs: neighbouring lines stand in for missing runs.

Around each line G is a polynomial in frequency, or a ratio of polynomials with a common
denominator, whose value at the line is the estimate (Pintelon and Schoukens, System
Identification, 2nd ed. 2012, ch. 7; the ratio as in McKelvey and Guerin, SYSID 2012).
"""

from collections.abc import Callable, Iterable
from functools import partial

import numpy as np
from numpy.typing import NDArray

from estimators.frf.block_checks import check_excited, check_samples
from estimators.frf.estimate_frf import (
    PositionFrf,
    Transient,
    first_period,
    lines_of,
    over_positions,
    structured,
)
from estimators.frf.frf_estimate import FrfEstimate
from estimators.frf.input_rank import input_noise, input_rank, side_by_side
from estimators.frf.record_checks import check_periods
from estimators.frf.spectra import Spectra, spectra
from robotmodels.common.arrays import Array, ComplexArray, IntArray, check_count
from robotmodels.common.errors import InvalidInput, check_word
from robotmodels.records.records import Records

_AROUND = 6
_WILD = 10.0
_SINGULAR = 1e-9


def local_frf(
    records: Records | Iterable[Records],
    *,
    order: int = 2,
    denominator: int = 0,
    half_width: int | None = None,
    structure: str = "full",
    hold: bool = True,
    delay: float = 0.0,
    transient: Transient = "auto",
    lines: IntArray | None = None,
) -> FrfEstimate:
    """Estimate FRFs line by line from a window of lines, all blocks and runs together.

    The covariance comes from the residuals: noise and distortion alike, and the model's error if
    the window is too wide for the order. Windows of neighbouring lines share data:
    `FrfEstimate.line_correlation` says how far their errors are correlated. As with h1, noise that
    feedback brings to the torques biases the estimate.

    Parameters
    ----------
    order : int
        Order of the polynomials of G's elements, or of the numerators.
    denominator : int
        Order of the common denominator; 0 for polynomials, 2 to follow a resonance that is narrow
        against the window.
    half_width : int, optional
        Lines used to either side; the smallest that leaves four equations in excess per unknown of
        a row by default. Windows at the ends are shifted inwards.
    structure : str
        As in `estimators.estimate_frf`.
    hold : bool
        As in `estimators.estimate_frf`.
    delay : float
        As in `estimators.estimate_frf`.
    transient : Transient
        As in `estimators.estimate_frf`.
    lines : ndarray of int, optional
        As in `estimators.estimate_frf`.

    Raises
    ------
    InvalidInput
        If the window has too few equations, or they do not determine the FRF.
    """
    check_word("structure", structure, ("full", "diagonal"))
    check_count(order, "order", 0)
    check_count(denominator, "denominator", 0)

    def estimated(part: Records, who: str) -> PositionFrf:
        k = lines_of(part, lines)
        measured = _checked(part, who, k, transient, partial(spectra, hold=hold, delay=delay))
        Y, U = side_by_side(measured.output, measured), side_by_side(measured.input, measured)
        width = window_width(half_width, U.shape, order, denominator, who)
        noise = input_noise(part, measured, k)
        _, determined = window_excitation(measured, noise, who, order, denominator, half_width)
        if not determined.all():
            raise _undetermined(measured.omega[np.argmin(determined)], who)
        response, error, correlation = _all_lines(
            Y, U, measured.omega, (order, denominator, width), who
        )
        shaped = structured(_above_rounding(error, response), structure, response.shape[1])
        repetitions = int(measured.present.any(axis=1).sum())
        freedom = _degrees_of_freedom(
            width * U.shape[2], U.shape[1], Y.shape[1], order, denominator
        )
        return PositionFrf(
            measured.omega, response, shaped, repetitions, freedom, None, correlation
        )

    return over_positions(records, estimated)


def _checked(
    part: Records,
    who: str,
    lines: IntArray,
    transient: Transient,
    read: Callable[..., Spectra],
) -> Spectra:
    """Return the checked spectra of one position without its transient."""
    check_samples(part, who)
    measured = read(part, lines=lines)
    check_periods(measured, who)
    check_excited(measured, part, lines, who, 1)
    first = first_period(measured, transient, who)
    return read(part, lines=lines, first=first) if first else measured


def window_width(
    half_width: int | None, shape: tuple[int, ...], order: int, denominator: int, who: str
) -> int:
    """Return how many lines a window has."""
    lines, n, runs = shape
    unknown = n * (order + 1) + denominator
    least = -(-(unknown + 1) // runs)
    if half_width is None:
        needed = max(-(-(unknown + 4) // runs), order + denominator + 2)
        width = min(lines, needed + 1 - needed % 2)
    else:
        width = min(lines, 2 * half_width + 1)
    if width < max(least, order + 1):
        raise InvalidInput(
            f"{who}: {width} lines with {runs} runs give {width * runs} "
            f"equations for {unknown} unknowns in each row of G; use a half_width of at least "
            f"{max(least, order + 1) // 2}, a lower order, measure more runs, or fit the runs "
            "themselves (oed identify)"
        )
    return width


def window_excitation(
    measured: Spectra,
    noise: Array,
    who: str,
    order: int = 2,
    denominator: int = 0,
    half_width: int | None = None,
) -> tuple[Array, NDArray[np.bool_]]:
    """Return the condition numbers (F,) of windows' regressors, and whether torques tell G.

    They do where no regressor depends on others to rounding, and the torques of the window are
    independent above their noise, (F, n).
    """
    inputs = side_by_side(measured.input, measured)
    count, n, _ = inputs.shape
    width = window_width(half_width, inputs.shape, order, denominator, who)
    condition, rank = np.empty(count), np.empty(count)
    for k in range(count):
        window, step = _around(k, width, measured.omega)
        values = _scaled_svd(_regressors(inputs[window], step, order))[1]
        condition[k] = values[0] / values[-1] if values[-1] > _SINGULAR * values[0] else np.inf
        level = np.sqrt(np.mean(noise[window] ** 2, axis=0))
        rank[k] = input_rank(_columns(inputs[window])[None], level[None])[0]
    return condition, np.isfinite(condition) & (rank == n)


def _around(k: int, width: int, omega: Array) -> tuple[slice, Array]:
    """Return the window of line k, and its lines' distances from it, scaled to one."""
    start = int(np.clip(k - width // 2, 0, len(omega) - width))
    window = slice(start, start + width)
    step = omega[window] - omega[k]
    return window, step / np.abs(step).max() if width > 1 else step


def _undetermined(frequency: float, who: str) -> InvalidInput:
    """Return the error of a window [rad/s] whose torques depend on each other."""
    return InvalidInput(
        f"{who}: the torques around {frequency / (2 * np.pi):.6g} Hz do not determine the FRF; "
        "excite the motors independently, widen half_width, leave those lines out "
        "(estimators.excitation tells which are usable), or fit the runs (oed identify)"
    )


def _all_lines(
    outputs: ComplexArray,
    inputs: ComplexArray,
    omega: Array,
    shape: tuple[int, int, int],
    who: str,
) -> tuple[ComplexArray, ComplexArray, Array]:
    """Return FRFs (F, m, n), covariances (F, m n, m n), and the errors' correlation over lags."""
    order, denominator, width = shape
    responses, covariances = [], []
    lines, n, runs = inputs.shape
    weights = np.zeros((lines, lines, runs, n), dtype=complex)
    for k in range(lines):
        window, step = _around(k, width, omega)
        try:
            response, error, inverse = one_line(
                outputs[window], inputs[window], step, order, denominator
            )
        except np.linalg.LinAlgError:
            raise _undetermined(omega[k], who) from None
        responses.append(response)
        covariances.append(error)
        weights[k, window] = inverse.reshape(width, runs, n)
    return np.array(responses), np.array(covariances), _shared(weights.reshape(lines, -1, n), width)


def _shared(weights: ComplexArray, width: int) -> Array:
    """Return the correlation of errors at lags 1 to the width of the windows, on average.

    With independent errors of the data, those of G at lines k and l, inputs i alike, have the
    covariance sum conj(w_ki) w_li.
    """
    power = np.sum(np.abs(weights) ** 2, axis=1)
    result = []
    for lag in range(1, min(width, len(weights))):
        shared = np.sum(np.conj(weights[:-lag]) * weights[lag:], axis=1).real
        result.append(float(np.mean(shared / np.sqrt(power[:-lag] * power[lag:]))))
    return np.array(result)


def _degrees_of_freedom(
    data: int, inputs: int, outputs: int, order: int, denominator: int
) -> float:
    """Return the complex degrees of freedom that a window leaves each output for its noise."""
    return data - inputs * (order + 1) - denominator / outputs


def _above_rounding(covariance: ComplexArray, response: ComplexArray) -> ComplexArray:
    """Raise the variances (F, m n, m n) to those of rounding errors."""
    size = np.abs(response).max(axis=(-2, -1))
    i = np.arange(covariance.shape[-1])
    least = (4 * np.finfo(float).eps * size[:, None]) ** 2
    covariance[:, i, i] = np.maximum(covariance[:, i, i].real, least)
    return covariance


def one_line(
    outputs: ComplexArray, inputs: ComplexArray, step: Array, order: int, denominator: int
) -> tuple[ComplexArray, ComplexArray, ComplexArray]:
    """Return G (m, n) where step = 0, its covariance, and the weights (W E, n) of the data.

    From outputs (W, m, E) and inputs (W, n, E).

    Y (1 + sum_d a_d step^d) = sum_r G_r step^r U + V is linear in a and G_r. What the regressors
    of G_r span is projected out first, which leaves a small problem in a.
    """
    regressors = _regressors(inputs, step, order)
    inverse, span = _inverse(regressors)
    inverse = inverse[:, : inputs.shape[1]]  # G at the line itself
    Y = np.stack([_columns(outputs * step[:, None, None] ** d) for d in range(denominator + 1)])
    through = Y @ inverse
    remainder = Y - Y @ np.conj(span.T) @ span
    basis = remainder[1:].reshape(denominator, remainder[0].size).T
    gram = np.linalg.inv(np.conj(basis.T) @ basis)
    a = np.concatenate([[1.0], -gram @ np.conj(basis.T) @ remainder[0].reshape(-1)])
    error = np.tensordot(a, remainder, 1)
    data, m = regressors.shape[1], outputs.shape[1]
    freedom = _degrees_of_freedom(data, inputs.shape[1], m, order, denominator)
    noise = error @ np.conj(error.T) / freedom
    # vec(V W) has covariance conj(W^H W) kron noise; the denominator's errors add theirs.
    covariance = np.kron(np.conj(np.conj(inverse.T) @ inverse), noise)
    columns = np.swapaxes(through[1:], 1, 2).reshape(denominator, through[0].size).T
    middle = np.einsum("aic,ij,bjc->ab", np.conj(remainder[1:]), noise, remainder[1:])
    covariance = covariance + columns @ gram @ middle @ gram @ np.conj(columns.T)
    return np.asarray(np.tensordot(a, through, 1)), np.asarray(covariance), inverse


def _regressors(inputs: ComplexArray, step: Array, order: int) -> ComplexArray:
    """Return step^r U side by side, (n (order + 1), W E)."""
    powers = step[:, None] ** np.arange(order + 1)
    products = np.einsum("wr,wne->wrne", powers, inputs)
    return _columns(products.reshape(len(step), -1, inputs.shape[2]))


def _inverse(regressors: ComplexArray) -> tuple[ComplexArray, ComplexArray]:
    """Return the right inverse of (r, T) regressors, and orthonormal rows of their span."""
    left, values, right, size = _scaled_svd(regressors)
    if values[-1] <= _SINGULAR * values[0]:
        raise np.linalg.LinAlgError
    return np.asarray(((np.conj(right.T) / values) @ np.conj(left.T)) / size.T), right


def _scaled_svd(regressors: ComplexArray) -> tuple[ComplexArray, Array, ComplexArray, Array]:
    """Return the singular value decomposition of rows (r, T) of unit length, and their lengths."""
    size = np.sqrt(np.sum(np.abs(regressors) ** 2, axis=1, keepdims=True))
    scaled = regressors / np.where(size == 0, 1.0, size)
    return *np.linalg.svd(scaled, full_matrices=False), size


def _columns(matrices: ComplexArray) -> ComplexArray:
    """Put (W, c, E) matrices side by side, (c, W E)."""
    return np.asarray(np.moveaxis(matrices, 0, 1).reshape(matrices.shape[1], -1))


def interpolated(at: Array, omega: Array, response: ComplexArray) -> ComplexArray:
    """Return (F, m, n) FRFs at other frequencies between `omega`, by local ratios of order two.

    Six lines around each determine numerators and common denominator; a resonance narrower than
    the lines' distance is followed where a straight line would miss it. Fewer lines, or a pole
    that noise puts by chance next to the frequency, leave linear interpolation.
    """
    if len(omega) == 1:
        return np.asarray(np.broadcast_to(response, (len(at), *response.shape[1:])))
    right = np.clip(np.searchsorted(omega, at), 1, len(omega) - 1)
    step = np.clip((at - omega[right - 1]) / (omega[right] - omega[right - 1]), 0.0, 1.0)
    weight = step[:, None, None]
    values = (1 - weight) * response[right - 1] + weight * response[right]
    if len(omega) < _AROUND:
        return np.asarray(values)
    unit = np.broadcast_to(np.eye(response.shape[2]) + 0j, (_AROUND, *[response.shape[2]] * 2))
    for k, frequency in enumerate(at):
        start = int(np.clip(right[k] - _AROUND // 2, 0, len(omega) - _AROUND))
        window = slice(start, start + _AROUND)
        offset = (omega[window] - frequency) / np.abs(omega[window] - frequency).max()
        try:
            better, *_ = one_line(response[window], unit, offset, 2, 2)
        except np.linalg.LinAlgError:
            continue
        if np.abs(better).max() < _WILD * np.abs(response[window]).max():
            values[k] = better
    return np.asarray(values)
