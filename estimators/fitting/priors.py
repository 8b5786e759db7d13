"""Prior knowledge of some parameters: a normal distribution of ln theta."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.linalg import solve_triangular

from robotmodels.common.arrays import Array, read_only, real_numbers
from robotmodels.common.errors import InvalidInput, nearest


@dataclass(frozen=True, eq=False)
class Prior:
    """A normal prior of ln theta.

    A fit minimises V + |z|^2/2 with z = L^-1 ln(theta/value)/std and L L^T the correlations: what
    was measured before counts as k more data. That is the posterior's mode if the weights are the
    inverse noise covariance.

    Attributes
    ----------
    names : tuple of str
        Names of the k parameters.
    values : ndarray, (k,)
        Medians [SI].
    std : ndarray, (k,)
        Standard deviations of ln theta, so relative ones.
    correlation : ndarray, (k, k), or None
        Correlations of ln theta; None for independent priors.
    """

    names: tuple[str, ...]
    values: Array
    std: Array
    correlation: Array | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "names", tuple(self.names))
        k = len(self.names)
        if len(set(self.names)) < k or not k:
            raise InvalidInput(f"prior: names {self.names}; one or more different ones are needed")
        for field in ("values", "std"):
            array = real_numbers(getattr(self, field), f"prior.{field}")
            if array.shape != (k,):
                raise InvalidInput(f"prior.{field}: shape {array.shape} given; ({k},) is needed")
            wrong = ~(np.isfinite(array) & (array > 0))
            if wrong.any():
                i = int(np.argmax(wrong))
                raise InvalidInput(
                    f"prior.{field}: {array[i]:g} for {self.names[i]} is not a positive number"
                )
            object.__setattr__(self, field, read_only(array))
        if self.correlation is not None:
            object.__setattr__(self, "correlation", _checked_correlation(self.correlation, k))

    @cached_property
    def _whitening(self) -> Array:
        """The matrix that turns ln(theta/value) into z, (k, k)."""
        if self.correlation is None:
            return np.diag(1 / self.std)
        root = np.linalg.cholesky(self.correlation)
        return np.asarray(solve_triangular(root, np.diag(1 / self.std), lower=True))

    def columns(self, names: tuple[str, ...]) -> list[int]:
        """Return the indices of the prior's parameters among `names`.

        Raises
        ------
        InvalidInput
            If one is not among them.
        """
        for name in self.names:
            if name not in names:
                raise InvalidInput(f"prior: {name!r} is not a free parameter{nearest(name, names)}")
        return [names.index(name) for name in self.names]

    def standardised(self, names: tuple[str, ...], values: Array) -> Array:
        """Return z, (..., k), at `values` (..., p) of `names`."""
        selected = np.asarray(values)[..., self.columns(names)]
        return np.asarray(np.log(selected / self.values) @ self._whitening.T)

    def cost(self, names: tuple[str, ...], values: Array) -> Array:
        """Return sum z^2/2, (...), minus the log density but for a constant."""
        return np.asarray(np.sum(self.standardised(names, values) ** 2, axis=-1) / 2)

    def slope(self, names: tuple[str, ...]) -> Array:
        """Return dz/d ln theta, (k, p)."""
        result = np.zeros((len(self.names), len(names)))
        result[:, self.columns(names)] = self._whitening
        return result

    def information(self, names: tuple[str, ...]) -> Array:
        """Return what the prior adds to the information on ln theta, (p, p)."""
        slope = self.slope(names)
        return np.asarray(slope.T @ slope)


def _checked_correlation(matrix: Array, k: int) -> Array:
    """Return a correlation matrix (k, k), read-only.

    Raises
    ------
    InvalidInput
        If it is none.
    """
    array = real_numbers(matrix, "prior.correlation")
    if array.shape != (k, k) or not np.isfinite(array).all():
        raise InvalidInput(
            f"prior.correlation: shape {array.shape}; finite numbers of shape {(k, k)} are needed"
        )
    one = np.allclose(np.diag(array), 1.0, rtol=0, atol=1e-9)
    if not one or not np.allclose(array, array.T, rtol=0, atol=1e-9):
        raise InvalidInput(
            "prior.correlation: a symmetric matrix with ones on its diagonal is needed"
        )
    if np.linalg.eigvalsh(array)[0] <= 0:
        raise InvalidInput("prior.correlation: the matrix is not positive definite")
    return read_only(array)
