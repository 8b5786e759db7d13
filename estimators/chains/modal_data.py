"""FRFs of one position as a search for modes needs them: weighted, and their errors kept apart."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from estimators.frf.estimate import unvec, vec
from estimators.uncertainty.sandwich import sandwich
from robotmodels.arrays import Array, ComplexArray

_WIDTH = 5  # lines that variances are averaged over for the weights
_FLOOR = 0.3  # of guessed errors: a share of the largest element of a line


@dataclass(frozen=True, eq=False)
class Data:
    """FRFs of one position with weights element by element.

    Estimated covariances make poor weights: their inverses are too large by d/(d - k) in the mean
    for size k and d repetitions, and an estimate weighted by them looks more certain than it is.
    So weights are smooth in frequency and leave correlations out, and the covariance as it was
    estimated enters the uncertainty only, linearly.

    Attributes
    ----------
    omega : (F,) [rad/s].
    response : (F, M, M).
    deviations : (F, M, M) smooth standard deviations of the elements.
    covariance : (F, M, M) variances of independent elements, or (F, M M, M M) of vec(G).
    scaled : whether the errors are guessed, so that their size is to be taken from the misfit.
    undamped : whether the FRFs are real to rounding: computed, not measured.
    """

    omega: Array
    response: ComplexArray
    deviations: Array
    covariance: Array | ComplexArray
    scaled: bool
    undamped: bool

    @property
    def chains(self) -> int:
        """Number M of motors."""
        return int(self.response.shape[-1])

    @property
    def size(self) -> int:
        """Number of real data."""
        return 2 * self.response.size

    @property
    def variance(self) -> Array:
        """Variances of the elements as they were estimated, (F, M, M)."""
        return variance_of(self.covariance, self.response.shape)

    @property
    def expected(self) -> float:
        """Expectation of the cost, a sum of squares, were the model exact."""
        return float(np.sum(self.variance / self.deviations**2))

    @cached_property
    def correlation(self) -> NDArray[Any]:
        """Covariance over the weights' deviations, (F, M M) or (F, M M, M M)."""
        std = vec(self.deviations)
        if self.covariance.shape == self.response.shape:
            return np.asarray(vec(self.covariance) / std**2)
        return np.asarray(self.covariance / (std[:, :, None] * std[:, None, :]))

    def whitened(self, values: NDArray[Any]) -> Array:
        """Return values (F, M, M) or (F, M, M, p) over deviations, as real rows (size, 1 or p)."""
        columns = values.reshape(*self.response.shape, -1) / self.deviations[..., None]
        rows = np.swapaxes(columns, 1, 2).reshape(self.response.size, -1)
        return np.asarray(np.concatenate([rows.real, rows.imag]))

    def covariance_of(self, jacobian: Array, cost: float, names: tuple[str, ...]) -> Array:
        """Return the covariance (p, p) of what the whitened `jacobian` (size, p) is by.

        Raises
        ------
        NotIdentifiable : if the data do not say all of them.
        """
        bread = jacobian.T @ jacobian
        half, p = self.response.size, jacobian.shape[1]
        J = (jacobian[:half] + 1j * jacobian[half:]).reshape(len(self.omega), -1, p)
        R = self.correlation
        turned = R @ J if R.ndim == 3 else R[..., None] * J
        meat = np.einsum("fkp,fkq->pq", np.conj(J), turned).real / 2
        if self.scaled:
            meat = meat * 2 * cost / max(self.size - p, 1)
        return sandwich(bread, meat, names)

    def from_line(self, first: int) -> "Data":
        """Return the data without the lines before `first`."""
        return Data(
            self.omega[first:],
            self.response[first:],
            self.deviations[first:],
            self.covariance[first:],
            self.scaled,
            self.undamped,
        )

    def with_error(self, variance: Array) -> "Data":
        """Return the data with independent errors of `variance` (F, M, M) added to the noise."""
        covariance = self.covariance.copy()
        if covariance.shape == variance.shape:
            covariance += variance
        else:
            i = np.arange(covariance.shape[-1])
            covariance[:, i, i] += vec(variance)
        deviations = np.sqrt(self.deviations**2 + variance)
        return Data(self.omega, self.response, deviations, covariance, self.scaled, self.undamped)


def prepared(
    omega: Array, response: ComplexArray, covariance: NDArray[Any] | None, undamped: bool = False
) -> Data:
    """Return FRFs with their weights.

    Without a covariance the noise is taken to be relative, the same for all elements of a line
    but for a floor, and its size comes from the misfit.

    Parameters
    ----------
    omega, response, covariance : as in `identify_chains`.
    undamped : whether the FRFs are exact and of chains without damping.
    """
    if covariance is None:
        variance = relative_variance(response)
        return Data(omega, response, np.sqrt(variance), variance, True, undamped)
    full = covariance.shape != response.shape
    covariance = covariance.astype(complex) if full else covariance.real
    deviations = np.sqrt(_smooth(variance_of(covariance, response.shape), response))
    return Data(omega, response, deviations, covariance, False, undamped)


def variance_of(covariance: NDArray[Any], shape: tuple[int, ...]) -> Array:
    """Return the variances (F, M, M) of a covariance of either shape."""
    if covariance.shape == shape:
        return np.asarray(covariance.real)
    return np.asarray(unvec(np.diagonal(covariance, axis1=1, axis2=2).real, shape[-1]))


def _smooth(variance: Array, response: ComplexArray) -> Array:
    """Return variances averaged over neighbouring lines, in logarithms.

    Averaged are the variances themselves or relative ones, whichever is smoother: under feedback,
    errors have the resonances of the FRF.
    """
    relative = relative_variance(response)
    width = min(_WIDTH, len(variance) - 1 + len(variance) % 2)

    def averaged(logarithms: Array) -> tuple[Array, float]:
        ends = [(width // 2,) * 2, (0, 0), (0, 0)]
        windows = np.lib.stride_tricks.sliding_window_view(
            np.pad(logarithms, ends, mode="edge"), width, axis=0
        )
        mean = windows.mean(axis=-1)
        return mean, float(np.mean((logarithms - mean) ** 2))

    own, rough = averaged(np.log(variance))
    ratio, rougher = averaged(np.log(variance / relative))
    return np.asarray(np.exp(own) if rough < rougher else np.exp(ratio) * relative)


def relative_variance(response: ComplexArray) -> Array:
    """Return variances (F, M, M) of relative errors, but for a factor, with a floor per line."""
    size = np.abs(response)
    largest = size.max(axis=(1, 2), keepdims=True)
    return np.asarray(size**2 + (_FLOOR * largest) ** 2)
