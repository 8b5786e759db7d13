"""Prepare the compiled likelihood of runs with noisy torques and outputs."""

import numpy as np

from robotmodels.common.arrays import Array, ComplexArray
from robotmodels.common.errors import InvalidInput
from robotmodels.kernel.cost_cells import SML, SML_ROW_WISE, parted, vectors
from robotmodels.kernel.cost_kernel import CostKernel, positive_frequencies
from robotmodels.kernel.elimination_order import layout
from robotmodels.kernel.simd import LANES
from robotmodels.linear.spring_network import SpringNetwork


class RunKernel(CostKernel):
    """The cost V = sum e^H Sigma^-1 e of runs as a function of theta, e = Y - G U.

    Of `CostKernel` it is the same but for the data.

    Parameters
    ----------
    network : SpringNetwork
        Q positions, the nominal parameters; motors are driven and their motion is measured.
    omega : ndarray, (F,), rad/s
        Angular frequencies.
    outputs, inputs : ndarray of complex, (Q, F, n, E)
        Spectra of E runs.
    root : ndarray of complex, (Q, F, 2 n, k)
        T with T T^H the covariance of the errors of outputs and inputs, outputs first.
    row_wise : bool
        Whether outputs are weighed one by one, by the diagonal of Sigma.

    Raises
    ------
    InvalidInput
        If there is no compiled code for the network.
    """

    def __init__(
        self,
        network: SpringNetwork,
        omega: Array,
        outputs: ComplexArray,
        inputs: ComplexArray,
        root: ComplexArray,
        row_wise: bool,
    ) -> None:
        if not run_kernel_suits(network):
            raise InvalidInput("runs: compiled code is for springs, dampers and motors only")
        self._omega = positive_frequencies(omega)
        self._blocks = -(-self._omega.size // LANES)
        self._made_of = outputs, inputs, root
        self._code = SML_ROW_WISE if row_wise else SML
        self._targets = None
        self._set(network)

    def _prepared(self) -> tuple[Array, Array, float]:
        outputs, inputs, root = self._made_of
        factor = -np.square(self._omega)[:, None] * self.network.motor_factors(self._omega)
        n = inputs.shape[2]
        scaled = root.copy()
        scaled[:, :, n:] *= factor[..., None]
        packed, self._runs = cell_data(outputs, inputs * factor[..., None], scaled)
        self._scratch = _scratch_length(n, self._runs)
        counting = np.arange(self._blocks * LANES) < self._omega.size
        data = vectors(packed, self._blocks).reshape(len(packed), self._blocks, -1, LANES)
        data[:, :, 0] = counting.reshape(self._blocks, LANES)
        w = np.broadcast_to(self._omega, (len(packed), self._omega.size))
        return vectors(w[..., None], self._blocks), data.reshape(-1), 0.0

    def __reduce__(self) -> tuple[type, tuple[object, ...]]:
        row_wise = self._code == SML_ROW_WISE
        return RunKernel, (self.network, self._omega, *self._made_of, row_wise)


def run_kernel_suits(network: SpringNetwork) -> bool:
    """Tell whether there is compiled code for runs of a network."""
    return network.only_springs and network.only_motors and layout(network) is not None


def _scratch_length(n: int, runs: int) -> int:
    """Return the vectors that `run_cells` needs beside a cell."""
    wide = _even(n)
    return 2 * wide * (5 * wide + 2 * runs + 1)


def _even(count: int) -> int:
    return count + count % 2


def cell_data(outputs: ComplexArray, inputs: ComplexArray, root: ComplexArray) -> tuple[Array, int]:
    """Return what cells keep of each line, (Q, F, numbers), see `run_cells`, and the columns of U.

    A unitary matrix over the runs leaves V as it is and makes a triangle of [U; Y]. Likewise the
    rows of the noise's root become [L 0; B R], of which K = R R^H.
    """
    n = inputs.shape[2]
    both = _lower(np.concatenate([inputs, outputs], axis=2))
    noise = _lower(np.concatenate([root[:, :, n:], root[:, :, :n]], axis=2))
    beside = noise[:, :, n:, n:] @ np.conj(np.swapaxes(noise[:, :, n:, n:], -1, -2))
    wide, columns = _even(n), _even(both.shape[3])
    right = np.zeros((*inputs.shape[:2], wide, columns + wide), dtype=complex)
    left, K = right.copy(), np.zeros((*inputs.shape[:2], wide, wide), dtype=complex)
    right[:, :, :n, : both.shape[3]] = -both[:, :, :n]
    right[:, :, :n, columns : columns + n] = -noise[:, :, :n, :n]
    left[:, :, :n, : both.shape[3]] = both[:, :, n:]
    left[:, :, :n, columns : columns + n] = noise[:, :, n:, :n]
    K[:, :, :n, :n] = beside
    arrays = [parted(x).reshape(*inputs.shape[:2], -1) for x in (right, left, K)]
    return np.concatenate([np.zeros((*inputs.shape[:2], 2)), *arrays], axis=-1), columns


def _lower(rows: ComplexArray) -> ComplexArray:
    """Return the lower triangle (..., r, min(r, k)) with the same products as rows (..., r, k)."""
    return _adjoint(np.asarray(np.linalg.qr(_adjoint(rows), mode="r")))


def _adjoint(matrices: ComplexArray) -> ComplexArray:
    return np.asarray(np.conj(np.swapaxes(matrices, -1, -2)))
