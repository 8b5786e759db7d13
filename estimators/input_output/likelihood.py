"""The likelihood of noisy inputs and outputs: [PS] chapters 9 and 12.

Of a run at one line, z = [Y; U] with errors of covariance C, the true input U0 eliminated:

    e = Y - G U,  A = Cov(N_U, e) = C_UY - C_UU G^H,  Sigma = [I -G] C [I -G]^H,
    V = sum over lines and runs of e^H Sigma^-1 e,  U0 = U - A Sigma^-1 e,
    dV = -2 Re sum (dG U0)^H Sigma^-1 e.

Pintelon and Schoukens, System Identification, 2nd edition.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from estimators.fitting.fit_problem import real_rows
from estimators.fitting.priors import Prior
from estimators.input_output.run_spectra import RunSpectra
from robotmodels.common.arrays import Array, ComplexArray
from robotmodels.common.errors import SolverFailed
from robotmodels.linear.response import Elastic, sensitivity


@dataclass(frozen=True, eq=False)
class Errors:
    """What the likelihood makes of an FRF: whitened errors, and the inputs by which it sees G.

    Attributes
    ----------
    root : ndarray of complex, (Q, F, m, m), or of float, (Q, F, m)
        L with L L^H = Sigma; row by row the standard deviations of e.
    whitened : ndarray of complex, (Q, F, m, E)
        L^-1 e.
    inputs : ndarray of complex, (Q, F, n, E), or (Q, F, m, n, E) row by row
        U0 as the likelihood estimates it.
    covariance : ndarray of complex, (Q, F, m, m)
        Sigma.
    gain : ndarray of complex, (Q, F, n, m)
        A L^-H, column by column A_i / L_i row by row: inputs are U less gain times `whitened`.
    """

    root: Array | ComplexArray
    whitened: ComplexArray
    inputs: ComplexArray
    covariance: ComplexArray
    gain: ComplexArray


@dataclass(frozen=True, eq=False)
class RunProblem:
    """The cost V over x = ln(theta/reference), for the searches of `estimators.fitting`.

    Attributes
    ----------
    model : Elastic
        Model whose FRF G maps inputs to outputs.
    data : RunSpectra
        Spectra of the runs.
    row_wise : bool
        Whether V = sum_i |e_i|^2 / Sigma_ii, output by output.
    bounds : ndarray, (2, p)
        Lowest and highest values.
    prior : Prior or None
        Prior knowledge of some parameters.
    """

    model: Elastic
    data: RunSpectra
    row_wise: bool
    bounds: Array
    prior: Prior | None = None

    @cached_property
    def _noise_root(self) -> ComplexArray:
        """T with T T^H = C, (Q, F, m + n, m + n); C may be singular."""
        covariance = self.data.covariance
        size = np.sqrt(np.diagonal(covariance, axis1=-2, axis2=-1).real)
        scale = np.where(size > 0, size, 1.0)
        unit = covariance / (scale[..., :, None] * scale[..., None, :])
        values, vectors = np.linalg.eigh(unit)
        root = scale[..., None] * vectors * np.sqrt(np.maximum(values, 0.0))[..., None, :]
        return np.asarray(root)

    @cached_property
    def _columns(self) -> tuple[ComplexArray, ComplexArray]:
        """Outputs (Q, F, m, E) and inputs (Q, F, n, E)."""
        outputs, inputs = (np.moveaxis(x, 1, 3) for x in (self.data.outputs, self.data.inputs))
        return outputs, inputs

    def errors(self, response: ComplexArray) -> Errors:
        """Return the errors of an FRF (Q, F, m, n).

        Raises
        ------
        SolverFailed
            If the errors of some line have no covariance.
        """
        Y, U = self._columns
        m, T = Y.shape[2], self._noise_root
        e = Y - response @ U
        X = T[..., :m, :] - response @ T[..., m:, :]
        A = T[..., m:, :] @ _adjoint(X)
        return (_row_by_row if self.row_wise else _jointly)(e, U, X, A)

    def whitened_changes(self, errors: Errors, changes: ComplexArray) -> ComplexArray:
        """Return L^-1 dG U0, (Q, F, m, E, r), of changes dG (Q, F, m, n, r) of the FRF."""
        if self.row_wise:
            through = np.einsum("qfmnr,qfmne->qfmer", changes, errors.inputs)
            return np.asarray(through / errors.root[..., None, None])
        through = np.einsum("qfmnr,qfne->qfmer", changes, errors.inputs)
        flat = through.reshape(*through.shape[:3], -1)
        return np.asarray(np.linalg.solve(errors.root, flat).reshape(through.shape))

    def evaluate(self, values: Array) -> tuple[Array, Array]:
        """Return residuals (r,) and their Jacobian (r, p) at `values` (p,); the prior's last."""
        G, J = self.sensitivities(values)
        errors = self.errors(G)
        slopes = -self.whitened_changes(errors, J)
        names = self.model.parameters.names
        return real_rows(errors.whitened, slopes, self.prior, names, values)

    def sensitivities(self, values: Array) -> tuple[ComplexArray, ComplexArray]:
        """Return the FRF (Q, F, m, n) and its derivatives by ln theta, (Q, F, m, n, p).

        Raises
        ------
        SolverFailed
            If they are not finite.
        """
        data = self.data
        G, J = sensitivity(self.model, data.positions, data.omega, values, equilibrium_shift=True)
        if not (np.isfinite(G).all() and np.isfinite(J).all()):
            raise SolverFailed("the model's FRF or its sensitivity is not finite")
        return G, J


def _jointly(
    error: ComplexArray, torque: ComplexArray, factor: ComplexArray, common: ComplexArray
) -> Errors:
    """Return the errors of outputs weighed together, with Sigma = X X^H of X = `factor`.

    Its root comes by orthogonal steps: squares would double the digits that noise spans.
    """
    L = _adjoint(np.asarray(np.linalg.qr(_adjoint(factor), mode="r")))
    diagonal = np.abs(np.diagonal(L, axis1=-2, axis2=-1))
    if not (diagonal > 1e-12 * diagonal.max(axis=-1, keepdims=True)).all():
        raise SolverFailed("runs: the noise of some outputs is exactly that of others at a line")
    whitened = np.asarray(np.linalg.solve(L, error), dtype=complex)
    gain = _adjoint(np.linalg.solve(L, _adjoint(common)))
    return Errors(L, whitened, torque - gain @ whitened, factor @ _adjoint(factor), gain)


def _row_by_row(
    error: ComplexArray, torque: ComplexArray, factor: ComplexArray, common: ComplexArray
) -> Errors:
    """Return the errors of outputs weighed one by one, by the diagonal of X X^H, X = `factor`."""
    std = np.linalg.norm(factor, axis=-1)
    if not (std > 0).all():
        raise SolverFailed("runs: an output and the inputs have no noise at a line")
    gain = np.asarray(common / std[..., None, :], dtype=complex)
    whitened = np.asarray(error / std[..., None], dtype=complex)
    pulled = gain.swapaxes(-1, -2)[..., None] * whitened[..., None, :]  # (Q, F, m, n, E)
    return Errors(std, whitened, torque[:, :, None] - pulled, factor @ _adjoint(factor), gain)


def _adjoint(matrices: NDArray[Any]) -> ComplexArray:
    return np.asarray(np.conj(np.swapaxes(matrices, -1, -2)), dtype=complex)
