"""FRF estimators over blocks of runs, and their jackknife covariance.

Y = G U holds in every block at every line; n runs with n inputs make U square. The
estimators differ in how noise on U and Y, correlated by the feedback, enters their average
(Pintelon and Schoukens 2001, sec. 2.7; Wernholt and Gunnarsson 2007, LiTH-ISY-R-2827).

Arrays are (..., B, m, E), (..., B, n, E) and (..., B, n, E) for output, input and reference.
"""

from collections.abc import Callable

import numpy as np

from estimators.frf.frf_estimate import vec
from robotmodels.common.arrays import Array, ComplexArray
from robotmodels.common.errors import check_word

Method = Callable[[ComplexArray, ComplexArray, ComplexArray], ComplexArray]

_BLOCKS = -3


def ari(output: ComplexArray, input: ComplexArray, reference: ComplexArray) -> ComplexArray:
    """Arithmetic mean: G = mean(Y U^-1)."""
    return np.asarray(per_block(output, input).mean(axis=_BLOCKS))


def har(output: ComplexArray, input: ComplexArray, reference: ComplexArray) -> ComplexArray:
    """Harmonic mean: G = (mean(U Y^-1))^-1, for as many outputs as inputs."""
    return np.asarray(np.linalg.inv(per_block(input, output).mean(axis=_BLOCKS)))


def log(output: ComplexArray, input: ComplexArray, reference: ComplexArray) -> ComplexArray:
    """Geometric mean of each element, phases taken relative to ARI's."""
    each = per_block(output, input)
    centre = each.mean(axis=_BLOCKS)
    ratio = each / np.expand_dims(np.where(centre == 0, 1.0, centre), _BLOCKS)
    with np.errstate(divide="ignore"):
        mean = np.exp(np.log(np.abs(ratio)).mean(axis=_BLOCKS))
    return np.asarray(centre * mean * np.exp(1j * np.angle(ratio).mean(axis=_BLOCKS)))


def h1(output: ComplexArray, input: ComplexArray, reference: ComplexArray) -> ComplexArray:
    """Least squares with noise on the output only: G = (sum Y U^H)(sum U U^H)^-1."""
    return _right_quotient(output, input, input)


def jio(output: ComplexArray, input: ComplexArray, reference: ComplexArray) -> ComplexArray:
    """Joint input-output, or instrumental variables: G = (sum Y R^H)(sum U R^H)^-1."""
    return _right_quotient(output, input, reference)


METHODS: dict[str, Method] = {"ari": ari, "har": har, "log": log, "h1": h1, "jio": jio}
# Methods that sum over runs; they can use the rest of a block that lacks some.
SUMMING = ("h1", "jio")


def needed_rank(method: str, motors: int) -> int:
    """Return how many torques of a line must be independent above their noise.

    The references of "jio" find torques in noise, one line's as well as another's.
    """
    return 1 if method == "jio" else motors


def find_method(name: str) -> Method:
    """Return the estimator called `name`.

    Raises
    ------
    InvalidInput
        If there is none.
    """
    check_word("method", name, METHODS)
    return METHODS[name]


def per_block(output: ComplexArray, input: ComplexArray) -> ComplexArray:
    """Return Y U^-1 of each block, (..., B, m, n)."""
    transposed = np.linalg.solve(np.swapaxes(input, -1, -2), np.swapaxes(output, -1, -2))
    return np.asarray(np.swapaxes(transposed, -1, -2))


def run_weights(method: str, input: ComplexArray, reference: ComplexArray) -> ComplexArray:
    """Return w, (..., B, E, n): to first order an error V of Y - G U moves G by sum V w.

    ARI, HAR and LOG agree to first order: w = U^-1/B. H1 and JIO weigh blocks by the sums in
    their definitions.
    """
    if method not in SUMMING:
        return np.asarray(np.linalg.inv(input) / input.shape[_BLOCKS])
    instrument = _adjoint(input if method == "h1" else reference)
    total = (input @ instrument).sum(axis=_BLOCKS)
    return np.asarray(instrument @ np.expand_dims(np.linalg.inv(total), _BLOCKS))


def effective_runs(method: str, input: ComplexArray, reference: ComplexArray) -> float:
    """Return of how many runs' noise errors are made, at most lines and motors.

    (sum |w|^2)^2 / sum |w|^4 over runs and blocks, see `run_weights`: as many as there are where
    all weigh alike, one of each block where a run tells its motor alone. The lowest decile over
    lines and motors, so that hardly any variance counts as more certain than it is.
    """
    power = np.abs(run_weights(method, input, reference)) ** 2
    axes = (_BLOCKS, _BLOCKS + 1)
    return float(np.quantile(power.sum(axis=axes) ** 2 / (power**2).sum(axis=axes), 0.1))


def jackknife(
    method: Method, output: ComplexArray, input: ComplexArray, reference: ComplexArray
) -> tuple[ComplexArray, ComplexArray]:
    """Return the estimate over all blocks and B - 1 independent draws of its error.

    Each block is omitted in turn. For ARI the outer products of the draws' vec add up to
    sum vec(G[b] - G) vec(.)^H / (B (B - 1)); for the others they follow what a block does to that
    very estimator. Orthogonal contrasts of the B deviations, whose sum is zero, are independent.

    Returns
    -------
    estimate : ndarray of complex, (..., m, n)
        Estimate over all blocks.
    deviations : ndarray of complex, (..., B - 1, m, n)
        Independent draws of its error.
    """
    B = input.shape[_BLOCKS]
    estimate = method(output, input, reference)
    without = np.stack(
        [
            method(*(np.delete(a, b, axis=_BLOCKS) for a in (output, input, reference)))
            for b in range(B)
        ],
        axis=-3,
    )
    draws = np.einsum("rb,...bij->...rij", contrasts(B), without) * np.sqrt((B - 1) / B)
    return estimate, np.asarray(draws)


def covariance_of(deviations: ComplexArray) -> ComplexArray:
    """Return the covariance (..., m n, m n) of vec(G) from draws (..., R, m, n) of its error."""
    columns = vec(deviations)
    return np.asarray(np.swapaxes(columns, -1, -2) @ np.conj(columns))


def contrasts(count: int) -> Array:
    """Return orthonormal rows (count - 1, count), each of sum zero (Helmert)."""
    rows = np.tril(np.ones((count, count)), -1)[1:]
    size = np.arange(1, count)
    rows[size - 1, size] = -size
    return np.asarray(rows / np.sqrt(size * (size + 1))[:, None])


def _right_quotient(
    output: ComplexArray, input: ComplexArray, instrument: ComplexArray
) -> ComplexArray:
    adjoint = _adjoint(instrument)
    above = (output @ adjoint).sum(axis=_BLOCKS)
    below = (input @ adjoint).sum(axis=_BLOCKS)
    transposed = np.linalg.solve(np.swapaxes(below, -1, -2), np.swapaxes(above, -1, -2))
    return np.asarray(np.swapaxes(transposed, -1, -2))


def _adjoint(matrices: ComplexArray) -> ComplexArray:
    return np.asarray(np.conj(np.swapaxes(matrices, -1, -2)))


def noise_deviations(
    method: str,
    estimate: ComplexArray,
    output: ComplexArray,
    input: ComplexArray,
    mean_input: ComplexArray,
    reference: ComplexArray,
) -> ComplexArray:
    """Return draws of the estimate's error by noise alone, (..., B E J, m, n).

    Errors V = Y - G U of different runs are independent; where there is no signal, J bins
    show V of each of them, and the estimate takes the error V w (see `run_weights`).

    Parameters
    ----------
    estimate : ndarray of complex, (..., m, n)
        G.
    output, input : ndarray of complex, (..., B, J, m, E) and (..., B, J, n, E)
        Without signal, see `Spectra`.
    mean_input, reference : ndarray of complex, (..., B, n, E)
        Averaged over the periods.
    """
    weights = run_weights(method, mean_input, reference)
    error = output - estimate[..., None, None, :, :] @ input
    draws = np.einsum("...bjie,...bek->...bejik", error, weights)
    count = np.sqrt(input.shape[_BLOCKS])
    m, n = draws.shape[-2:]
    return np.asarray(draws.reshape(*draws.shape[:-5], -1, m, n) / count)
