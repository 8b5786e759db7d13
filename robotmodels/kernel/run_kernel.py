"""Prepare the compiled likelihood of runs with noisy torques and outputs."""

import numpy as np

from robotmodels.common.arrays import Array, ComplexArray
from robotmodels.common.errors import InvalidInput
from robotmodels.kernel.cost_cells import SML, SML_ROW_WISE, parted, vectors
from robotmodels.kernel.cost_kernel import CostKernel, positive_frequencies
from robotmodels.kernel.elimination_order import EliminationPlan, layout
from robotmodels.kernel.memory import address
from robotmodels.kernel.output_cells import RunShape
from robotmodels.kernel.simd import LANES
from robotmodels.kernel.terminals import Terminals
from robotmodels.kernel.workspace import contiguous
from robotmodels.linear.spring_network import SpringNetwork


class RunKernel(CostKernel):
    """The cost V = sum e^H Sigma^-1 e of runs as a function of theta, e = Y - G U.

    Of `CostKernel` it is the same but for the data, and for the outputs: any may be measured.

    Parameters
    ----------
    network : SpringNetwork
        Q positions, the nominal parameters; each motor acts on one coordinate.
    omega : ndarray, (F,), rad/s
        Angular frequencies.
    outputs, inputs : ndarray of complex, (Q, F, m, E) and (Q, F, n, E)
        Spectra of E runs.
    root : ndarray of complex, (Q, F, m + n, k)
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
            raise InvalidInput(
                "runs: compiled code is for springs, dampers and motors that act on one coordinate"
            )
        self._omega = positive_frequencies(omega)
        self._blocks = -(-self._omega.size // LANES)
        self._made_of = outputs, inputs, root
        self._code = SML_ROW_WISE if row_wise else SML
        self._targets = None
        self._set(network)

    def _with_terminals(self, network: SpringNetwork) -> SpringNetwork:
        self._terminals = None if network.only_motors else Terminals(network)
        return network if self._terminals is None else self._terminals.system

    def _run_shape(self, plan: EliminationPlan) -> RunShape:
        outputs, inputs, _ = self._made_of
        m, n = outputs.shape[2], inputs.shape[2]
        shape = RunShape(self._runs, n, m, self._blocks)
        if self._terminals is not None:
            sensors = self._terminals.sensors(self._omega)[None].repeat(len(inputs), axis=0)
            readings = contiguous(self._terminals.readings)
            gains = vectors(parted(sensors), self._blocks)
            table = self._terminals.table(plan.needed[:, 0])
            self._read = readings, gains, table  # addresses are of what lives
            shape = shape._replace(
                torques=len(table),
                readings=address(readings),
                sensors=address(gains),
                table=address(table),
            )
        self._scratch = _scratch_length(shape, len(plan.motors))
        return shape

    def _prepared(self) -> tuple[Array, Array, float]:
        outputs, inputs, root = self._made_of
        m = outputs.shape[2]
        if self._terminals is None:
            factor = -np.square(self._omega)[:, None] * self.network.motor_factors(self._omega)
        else:
            measured = self._terminals.measurement
            factor, direct = measured.torque.response(self._omega), measured.direct(self._omega)
            if measured.feedthrough is not None:
                outputs = outputs - direct @ inputs
                root = np.concatenate([root[:, :, :m] - direct @ root[:, :, m:], root[:, :, m:]], 2)
        scaled = root.copy()
        scaled[:, :, m:] *= factor[..., None]
        packed, self._runs = cell_data(outputs, inputs * factor[..., None], scaled)
        counting = np.arange(self._blocks * LANES) < self._omega.size
        data = vectors(packed, self._blocks).reshape(len(packed), self._blocks, -1, LANES)
        data[:, :, 0] = counting.reshape(self._blocks, LANES)
        w = np.broadcast_to(self._omega, (len(packed), self._omega.size))
        return vectors(w[..., None], self._blocks), data.reshape(-1), 0.0

    def model_slopes(self) -> tuple[Array, Array]:
        """Return dV/dK and dV/dM, (Q, d, d) each, see `CostKernel`, outputs held fixed."""
        d = self.network.mass.shape[-1]
        by_stiffness, by_mass = super().model_slopes()
        return by_stiffness[:, :d, :d], by_mass[:, :d, :d]

    def __reduce__(self) -> tuple[type, tuple[object, ...]]:
        row_wise = self._code == SML_ROW_WISE
        return RunKernel, (self.network, self._omega, *self._made_of, row_wise)


def run_kernel_suits(network: SpringNetwork) -> bool:
    """Tell whether there is compiled code for runs of a network."""
    if not network.only_springs or np.any(np.count_nonzero(network.selector, axis=0) != 1):
        return False
    system = network if network.only_motors else Terminals(network).system
    return layout(system) is not None


def _scratch_length(shape: RunShape, terminals: int) -> int:
    """Return the vectors that `run_cells` needs beside a cell, see `buffers` there."""
    n, m, t, runs = _even(shape.inputs), _even(shape.outputs), terminals, shape.runs
    rows = m * (2 * n + runs + m + 1) + n * runs + t * (max(runs, m) + 2 * t)
    return 2 * (rows + shape.outputs * t)


def _even(count: int) -> int:
    return count + count % 2


def cell_data(outputs: ComplexArray, inputs: ComplexArray, root: ComplexArray) -> tuple[Array, int]:
    """Return what cells keep of each line, (Q, F, numbers), see `run_cells`, and the columns of U.

    A unitary matrix over the runs leaves V as it is and makes a triangle of [U; Y]. Likewise the
    rows of the noise's root become [L 0; B R], of which K = R R^H.
    """
    n, m = inputs.shape[2], outputs.shape[2]
    both = _lower(np.concatenate([inputs, outputs], axis=2))
    noise = _lower(np.concatenate([root[:, :, m:], root[:, :, :m]], axis=2))
    beside = noise[:, :, n:, n:] @ np.conj(np.swapaxes(noise[:, :, n:, n:], -1, -2))
    wide, high, columns = _even(n), _even(m), _even(both.shape[3])
    right = np.zeros((*inputs.shape[:2], wide, columns + wide), dtype=complex)
    left = np.zeros((*inputs.shape[:2], high, columns + wide), dtype=complex)
    K = np.zeros((*inputs.shape[:2], high, high), dtype=complex)
    right[:, :, :n, : both.shape[3]] = -both[:, :, :n]
    right[:, :, :n, columns : columns + n] = -noise[:, :, :n, :n]
    left[:, :, :m, : both.shape[3]] = both[:, :, n:]
    left[:, :, :m, columns : columns + n] = noise[:, :, n:, :n]
    K[:, :, :m, :m] = beside
    arrays = [parted(x).reshape(*inputs.shape[:2], -1) for x in (right, left, K)]
    return np.concatenate([np.zeros((*inputs.shape[:2], 2)), *arrays], axis=-1), columns


def _lower(rows: ComplexArray) -> ComplexArray:
    """Return the lower triangle (..., r, min(r, k)) with the same products as rows (..., r, k)."""
    return _adjoint(np.asarray(np.linalg.qr(_adjoint(rows), mode="r")))


def _adjoint(matrices: ComplexArray) -> ComplexArray:
    return np.asarray(np.conj(np.swapaxes(matrices, -1, -2)))
