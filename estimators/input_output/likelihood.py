"""The likelihood of noisy inputs and outputs: [PS] chapters 9 and 12.

Of a run at one line, z = [Y; U] with errors of covariance C, the true input U0 eliminated:

    e = Y - G U,  A = Cov(N_U, e) = C_UY - C_UU G^H,  Sigma = [I -G] C [I -G]^H,
    V = sum over lines and runs of e^H Sigma^-1 e,  U0 = U - A Sigma^-1 e,
    dV = -2 Re sum (dG U0)^H Sigma^-1 e.

Pintelon and Schoukens, System Identification, 2nd edition.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from estimators.input_output.coulomb import CoulombPart
from estimators.input_output.free_response import FreePart, FreeResponse
from estimators.input_output.local_transient import LocalPolynomials, PolynomialPart
from estimators.input_output.run_spectra import RunSpectra
from robotmodels.common.arrays import Array, ComplexArray
from robotmodels.common.errors import SolverFailed


@dataclass(frozen=True, eq=False)
class Errors:
    """What the likelihood makes of an FRF: whitened errors, and the inputs by which it sees G.

    Attributes
    ----------
    root : ndarray of complex, (Q, F, m, m), or of float, (Q, F, m)
        L with L L^H = Sigma; row by row the standard deviations of e.
    whitened : ndarray of complex, (Q, F, m, E)
        L^-1 e, less the free response of the runs' states, if there is one.
    inputs : ndarray of complex, (Q, F, n, E), or (Q, F, m, n, E) row by row
        U0 as the likelihood estimates it.
    covariance : ndarray of complex, (Q, F, m, m)
        Sigma.
    gain : ndarray of complex, (Q, F, n, m)
        A L^-H, column by column A_i / L_i row by row: inputs are U less gain times `whitened`.
    eliminated : FreePart, PolynomialPart, CoulombPart or None
        The free response, or what friction does beside that of the data's levels.
    """

    root: Array | ComplexArray
    whitened: ComplexArray
    inputs: ComplexArray
    covariance: ComplexArray
    gain: ComplexArray
    eliminated: FreePart | PolynomialPart | CoulombPart | None = None

    def whiten(self, columns: ComplexArray) -> ComplexArray:
        """Return L^-1 of columns (Q, F, m, ...)."""
        if self.root.ndim < self.covariance.ndim:
            wide = self.root.reshape(*self.root.shape, *(1,) * (columns.ndim - self.root.ndim))
            return np.asarray(columns / wide)
        flat = columns.reshape(*self.root.shape[:-1], -1)
        return np.asarray(np.linalg.solve(self.root, flat).reshape(columns.shape))


@dataclass(frozen=True, eq=False)
class RunLikelihood:
    """The cost V of an FRF by the spectra of runs.

    Attributes
    ----------
    data : RunSpectra
        Spectra of the runs.
    row_wise : bool
        Whether V = sum_i |e_i|^2 / Sigma_ii, output by output.
    """

    data: RunSpectra
    row_wise: bool

    @cached_property
    def noise_root(self) -> ComplexArray:
        """T with T T^H = C, (Q, F, m + n, m + n); C may be singular."""
        covariance = self.data.covariance
        size = np.sqrt(np.diagonal(covariance, axis1=-2, axis2=-1).real)
        scale = np.where(size > 0, size, 1.0)
        unit = covariance / (scale[..., :, None] * scale[..., None, :])
        values, vectors = np.linalg.eigh(unit)
        root = scale[..., None] * vectors * np.sqrt(np.maximum(values, 0.0))[..., None, :]
        return np.asarray(root)

    @cached_property
    def columns(self) -> tuple[ComplexArray, ComplexArray]:
        """Outputs (Q, F, m, E) and inputs (Q, F, n, E)."""
        outputs, inputs = (np.moveaxis(x, 1, 3) for x in (self.data.outputs, self.data.inputs))
        return outputs, inputs

    def errors(
        self, response: ComplexArray, free: FreeResponse | LocalPolynomials | None = None
    ) -> Errors:
        """Return the errors of an FRF (..., Q, F, m, n).

        Parameters
        ----------
        free : FreeResponse or LocalPolynomials, optional
            What runs that do not end as they began add, whose size in each run is estimated along.

        Raises
        ------
        SolverFailed
            If the errors of some line have no covariance.
        """
        T = self.noise_root
        m = self.data.outputs.shape[3]
        X = T[..., :m, :] - response @ T[..., m:, :]
        A = T[..., m:, :] @ _adjoint(X)
        root = (_row_roots if self.row_wise else _joint_root)(X)
        if self.row_wise:
            gain = np.asarray(A / root[..., None, :], dtype=complex)
        else:
            gain = _adjoint(np.linalg.solve(root, _adjoint(A)))
        errors = Errors(root, X[..., :0], X[..., :0], X @ _adjoint(X), gain)
        whitened = errors.whiten(self.raw_errors(response))
        part = self._along(response, errors, whitened, free)
        if part is not None:
            whitened = part.taken_off(whitened)
        U = self.inputs(part)
        if self.row_wise:
            pulled = gain.swapaxes(-1, -2)[..., None] * whitened[..., None, :]  # (Q, F, m, n, E)
            inputs = U[..., None, :, :] - pulled
        else:
            inputs = U - gain @ whitened
        return replace(errors, whitened=whitened, inputs=inputs, eliminated=part)

    def _along(
        self,
        response: ComplexArray,
        errors: Errors,
        whitened: ComplexArray,
        free: FreeResponse | LocalPolynomials | None,
    ) -> FreePart | PolynomialPart | CoulombPart | None:
        """Return what is estimated along of whitened errors.

        Free responses, or other levels of friction, by e = Y - G (U - S c).
        """
        if free is not None:
            return _free_part(free, errors, whitened)
        if self.data.coulomb is None:
            return None
        moved = np.einsum("qfmn,qfne->qfmen", response, self._shares, optimize=True)
        return CoulombPart.of(-errors.whiten(moved), whitened)

    @cached_property
    def _shares(self) -> ComplexArray:
        """Spectra of friction at a level of one, (Q, F, n, E)."""
        assert self.data.coulomb is not None
        return np.moveaxis(self.data.coulomb.shares, 1, 3)

    def inputs(self, eliminated: FreePart | PolynomialPart | CoulombPart | None) -> ComplexArray:
        """Return the torques less what friction takes of them, (Q, F, n, E)."""
        U = self.columns[1]
        if isinstance(eliminated, CoulombPart):
            U = U - self._shares * eliminated.levels[:, None, :, None]
        return U

    def raw_errors(self, response: ComplexArray) -> ComplexArray:
        """Return Y - G U, (..., Q, F, m, E)."""
        Y, U = self.columns
        return np.asarray(Y - response @ U)

    def whitened_changes(self, errors: Errors, changes: ComplexArray) -> ComplexArray:
        """Return L^-1 dG U0, (Q, F, m, E, r), of changes dG (Q, F, m, n, r) of the FRF."""
        inputs = "qfmne" if self.row_wise else "qfne"
        through = np.einsum(f"qfmnr,{inputs}->qfmer", changes, errors.inputs, optimize=True)
        return errors.whiten(through)


def _free_part(
    free: FreeResponse | LocalPolynomials, errors: Errors, whitened: ComplexArray
) -> FreePart | PolynomialPart:
    """Return the span of whitened free responses, with what `whitened` errors have of it."""
    shape = (*errors.covariance.shape[:3], free.columns.shape[-1])
    return free.part(errors.whiten(np.broadcast_to(free.columns, shape)), whitened)


def _joint_root(factor: ComplexArray) -> ComplexArray:
    """Return the root of Sigma = X X^H of X = `factor`, of outputs weighed together.

    It comes by orthogonal steps: squares would double the digits that noise spans.
    """
    L = _adjoint(np.asarray(np.linalg.qr(_adjoint(factor), mode="r")))
    diagonal = np.abs(np.diagonal(L, axis1=-2, axis2=-1))
    if not (diagonal > 1e-12 * diagonal.max(axis=-1, keepdims=True)).all():
        raise SolverFailed("runs: the noise of some outputs is exactly that of others at a line")
    return L


def _row_roots(factor: ComplexArray) -> Array:
    """Return the standard deviations of outputs that are weighed one by one."""
    std = np.linalg.norm(factor, axis=-1)
    if not (std > 0).all():
        raise SolverFailed("runs: an output and the inputs have no noise at a line")
    return np.asarray(std)


def _adjoint(matrices: NDArray[Any]) -> ComplexArray:
    return np.asarray(np.conj(np.swapaxes(matrices, -1, -2)), dtype=complex)
