"""A fit about its solution: what every statement on its uncertainty is computed from."""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from robotmodels.common.arrays import Array, ComplexArray, read_only
from robotmodels.common.errors import NotIdentifiable
from robotmodels.common.symmetric_matrices import ROUNDING, SPREAD, scaled_eigh, scaled_pinv

Lines = NDArray[Any]
"""An array (Q, F, k, ...) over positions, lines and elements of vec(G)."""


@dataclass(frozen=True, eq=False)
class LinearisedFit:
    """Residuals r = e - J Re(A e) of a weighted least-squares fit with circular errors e.

    A = N^-1 J^H W with N = Re(J^H W J) are the rows of the estimator: Re(A e) is the error of
    ln theta, to first order. Sums run over positions, lines and elements.

    Attributes
    ----------
    names : tuple of str
        The p parameters.
    residuals : ndarray or ndarray of complex, (Q, F, k)
        Measured less fitted; zero where an element is not used.
    jacobian : Lines, (Q, F, k, p)
        Derivatives of the fitted values with respect to ln theta.
    weights : Lines, (Q, F, k) or (Q, F, k, k)
        Those of the fit; zero for elements that are not used.
    noise_weights : ndarray, (Q, F, k)
        Inverse variances of the noise, estimated without the line itself; zero where not used.
    covariance : ndarray or ndarray of complex, (Q, F, k) or (Q, F, k, k)
        Variances or Hermitian covariances of the errors, as stated or estimated.
    deviations : ndarray of complex, (Q, R, F, k), optional
        Independent draws whose outer products add up to the covariance.
    degrees_of_freedom : ndarray, (Q,)
        Degrees of freedom of the covariance, complex ones; infinite where it is declared.
    line_correlation : ndarray, (L,)
        Correlation of errors 1 to L lines apart, where the estimator of the FRF makes one.
    prior : ndarray, (p, p)
        Information on ln theta from elsewhere.
    scatter_factor : ndarray or float, (Q, F, k)
        Factor by which squared deviations are enlarged before weights that fall with the power q of
        the line's own variance multiply them: nu/(nu - 2 q), as E[g^(1 - 2 q)] is (nu - 2 q)/nu
        times E[g^(-2 q)] for a variance g with nu complex degrees of freedom.
    sharing : float
        By how much more sums over a position scatter, as lines share estimates of their noise.
    real : bool
        Whether the residuals are real, as those of magnitudes.
    logarithmic : bool
        Whether they are logarithms of ratios.
    """

    names: tuple[str, ...]
    residuals: Lines
    jacobian: Lines
    weights: Lines
    noise_weights: Array
    covariance: Lines
    deviations: ComplexArray | None
    degrees_of_freedom: Array
    line_correlation: Array
    prior: Array
    scatter_factor: Array | float = 1.0
    sharing: float = 1.0
    real: bool = False
    logarithmic: bool = False

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if isinstance(value, np.ndarray):
                object.__setattr__(self, name, read_only(value))

    @property
    def parts(self) -> int:
        """Real numbers in one residual."""
        return 1 if self.real else 2

    @cached_property
    def used(self) -> NDArray[np.bool_]:
        """Which elements (Q, F, k) are used."""
        return np.asarray(self.noise_weights > 0)

    @property
    def data(self) -> int:
        """Real numbers that carry weight."""
        return self.parts * int(self.used.sum())

    @cached_property
    def rows(self) -> Lines:
        """Rows A (p, Q, F, k) of the estimator."""
        return self.estimator(self.jacobian, self.prior)

    @cached_property
    def undetermined(self) -> NDArray[np.bool_]:
        """Which parameters (p,) the data and the prior leave open: a singular information."""
        flat = self.jacobian.reshape(-1, len(self.names))
        weighted = self.weighted(self.jacobian).reshape(flat.shape)
        normal = (np.conj(flat).T @ weighted).real + self.prior / 2
        s, values, vectors = scaled_eigh(normal, SPREAD)
        null = np.abs(vectors[:, values < ROUNDING * values[-1]])
        share = null.max(axis=1, initial=0.0)
        return np.asarray((s == 0) | (share > 0.1 * max(float(share.max()), 1e-300)))

    def weighted(self, columns: Lines) -> Lines:
        """Return W times columns (Q, F, k, r)."""
        if self.weights.ndim == 4:
            return np.asarray(self.weights @ columns)
        return np.asarray(self.weights[..., None] * columns)

    def estimator(self, columns: Lines, prior: Array | None = None) -> Lines:
        """Return rows (r, Q, F, k) that estimate the coefficients of columns (Q, F, k, r)."""
        r = columns.shape[-1]
        flat = columns.reshape(-1, r)
        adjoint = np.conj(self.weighted(columns).reshape(-1, r)).T
        normal = (adjoint @ flat).real
        if prior is not None:
            normal = normal + prior / 2
        return np.asarray((scaled_pinv(normal, 1e-13) @ adjoint).reshape(r, *columns.shape[:3]))

    def off_parameters(self, columns: Lines) -> Lines:
        """Return columns (Q, F, k, r) less what the parameters can imitate of them."""
        return columns - self.jacobian @ self.shifts(columns)

    @cached_property
    def errors(self) -> Lines:
        """Residuals as the noise has them: normal also where their logarithm is not."""
        return np.asarray(np.expm1(self.residuals)) if self.logarithmic else self.residuals

    @cached_property
    def noise_fit(self) -> "LinearisedFit":
        """The fit with the noise's weights, one linear step away.

        With other weights the parameters' errors may be larger than the noise of precise elements,
        which then tells nothing of the residuals' size. This step takes those errors off.
        """
        return replace(self, weights=self.noise_weights, scatter_factor=1.0).after_step()

    def after_step(self) -> "LinearisedFit":
        """Return the fit after one linear step of its parameters."""
        step = self.estimates(self.rows, self.residuals)
        return replace(self, residuals=self.residuals - self.jacobian @ step)

    @cached_property
    def squares(self) -> float:
        """Sum of the squared errors, weighted by the noise."""
        return float((self.noise_weights * np.abs(self.errors) ** 2).sum())

    def squares_beside(self, columns: Lines, coefficients: Array) -> Array:
        """Return sums of squares (r,) after columns (Q, F, k, r) times coefficients are taken off.

        To first order; coefficients need not be those of least squares.
        """
        flat = columns.reshape(-1, columns.shape[-1])
        w = self.noise_weights.reshape(-1)
        common = (w * np.conj(self.errors.reshape(-1))) @ flat
        power = w @ np.abs(flat) ** 2
        return np.asarray(self.squares - 2 * coefficients * common.real + coefficients**2 * power)

    def shifts(self, columns: Lines) -> Array:
        """Return how far unit columns (Q, F, k, r) move ln theta if they are left out, (p, r)."""
        r = columns.shape[-1]
        return np.asarray((self.rows.reshape(len(self.names), -1) @ columns.reshape(-1, r)).real)

    def estimates(self, rows: Lines, errors: Lines) -> Array:
        """Return Re(A e), (..., r), of errors (..., Q, F, k)."""
        size = int(np.prod(rows.shape[1:]))
        flat = rows.reshape(len(rows), size)
        return np.asarray((errors.reshape(*errors.shape[:-3], size) @ flat.T).real)

    def line_variances(self, rows: Lines) -> Array:
        """Return what each line adds to the variances of Re(A e), (r, Q, F): A C A^H / 2."""
        if self.deviations is not None:
            return np.asarray((np.abs(self.line_scores(rows)) ** 2).sum(axis=2) / 2)
        rows = rows * np.sqrt(self.scatter_factor)
        if self.covariance.ndim == 3:
            return np.asarray((np.abs(rows) ** 2 * self.covariance).sum(axis=-1) / 2)
        through = np.einsum("aqfi,qfij->aqfj", rows, self.covariance)
        return np.asarray((through * np.conj(rows)).real.sum(axis=-1) / 2)

    def line_scores(self, rows: Lines) -> Lines:
        """Return A times the deviations, line by line, (r, Q, R, F)."""
        product = np.moveaxis(rows, 0, -2) @ self._moved  # (Q, F, r, R)
        return np.asarray(product.transpose(2, 0, 3, 1))

    @cached_property
    def _moved(self) -> Lines:
        """Deviations (Q, F, k, R) as large as weights leave them."""
        assert self.deviations is not None
        factor = np.sqrt(np.broadcast_to(self.scatter_factor, self.noise_weights.shape))
        return np.asarray(self.deviations.transpose(0, 2, 3, 1) * factor[..., None])

    @cached_property
    def error_root(self) -> Lines:
        """Standard deviations of the errors, (Q, F, k); W^-1/2, (Q, F, k, k), of full weights."""
        if self.weights.ndim == 3:
            return np.asarray(np.sqrt(self.element_variances) * self.used)
        values, vectors = np.linalg.eigh(self.weights)
        seen = values > ROUNDING * values.max(axis=-1, keepdims=True)
        root = np.where(seen, np.where(seen, values, 1.0) ** -0.5, 0.0)
        return np.asarray((vectors * root[..., None, :]) @ np.conj(np.swapaxes(vectors, -1, -2)))

    @cached_property
    def element_variances(self) -> Array:
        """Variances (Q, F, k) of the errors."""
        if self.covariance.ndim == 3:
            return np.asarray(self.covariance)
        return np.asarray(np.diagonal(self.covariance, axis1=-2, axis2=-1).real)


def sandwich(bread: Array, meat: Array, names: tuple[str, ...]) -> Array:
    """Return bread^-1 meat bread^-1, scaled to unit diagonals before inverting.

    Raises
    ------
    NotIdentifiable
        If the bread is singular, with every parameter that is in its null space.
    """
    # Sensitivities that are zero but for rounding count as zero.
    s, values, vectors = scaled_eigh(bread, SPREAD)
    # Without any information at all, all are blind and all eigenvalues zero.
    null = values <= ROUNDING * values[-1]
    if null.any():
        share = np.linalg.norm(vectors[:, null], axis=1)  # in any basis of the null space
        guilty = share > 0.1 * share.max()
        raise NotIdentifiable(
            tuple(name for name, one in zip(names, guilty, strict=True) if one),
            "add positions or frequencies, free fewer parameters, or fix one of them",
        )
    outer = np.outer(s, s)
    inverse = (vectors / values) @ vectors.T
    result = inverse @ (meat * outer) @ inverse * outer
    return np.asarray((result + result.T) / 2)
