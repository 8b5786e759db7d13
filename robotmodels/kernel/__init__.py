"""FRFs, Fisher information, residual costs and their derivatives of spring networks, fast.

The formulas are those of `SpringNetwork`, which is the reference. Here one vector register holds
eight frequencies (`simd`), motors are eliminated by formula (`elimination_order`), the arm is
factorised without pivoting (`ldlt`, `solve`), and positions are shared out over threads.
"""

import numpy as np

from robotmodels.common.arrays import Array, ComplexArray
from robotmodels.kernel.cost_kernel import (
    CostKernel,
    FitKernel,
    check_complete,
    positive_frequencies,
)
from robotmodels.kernel.elimination_order import EliminationPlan, layout
from robotmodels.kernel.fisher import informations, separable_informations
from robotmodels.kernel.memory import address, aligned
from robotmodels.kernel.run_kernel import RunKernel, run_kernel_suits
from robotmodels.kernel.simd import LANES
from robotmodels.kernel.solve import responses
from robotmodels.kernel.threads import over_threads
from robotmodels.kernel.workspace import Workspaces, network_tables, workspace
from robotmodels.linear.noise import NoiseLaw, RelativeNoise, SeparableNoise
from robotmodels.linear.normal_equations import NormalEquations
from robotmodels.linear.residuals import ResidualForm
from robotmodels.linear.spring_network import SpringNetwork, shared

__all__ = [
    "CostKernel",
    "FitKernel",
    "NormalEquations",
    "RunKernel",
    "costs",
    "frequency_response",
    "information",
    "run_kernel_suits",
]

_SHARES = 4
"""Pieces of the positions for each thread: one may be delayed, if only by the next network."""


def frequency_response(network: SpringNetwork, omega: Array) -> ComplexArray:
    """Return G, (Q, F, m, n), at `omega` [rad/s]; as a rule from motor torque to acceleration.

    Other outputs than the motors' motion, and motors that act on several coordinates, take the way
    of the reference.

    Raises
    ------
    InvalidInput
        If a frequency is not positive and finite.
    """
    w = positive_frequencies(omega)
    plan = layout(network)
    if plan is None:
        return network.frequency_response(w)
    n = len(plan.motors)
    out = np.empty((len(network.mass), w.size, n, n), dtype=complex)
    frequencies, _ = _padded(w)
    tables = network_tables(network)

    def run(start: int, stop: int) -> None:
        space = workspace(plan, network, tables)
        responses(space.at, address(frequencies), w.size, start, stop, address(out.view(float)))

    over_threads(run, len(out), work_per_item=frequencies.size // LANES)
    if network.measurement is not None:
        out *= network.motor_factors(w)[:, None, :]
    return out


def information(network: SpringNetwork, omega: Array, noise: NoiseLaw | SeparableNoise) -> Array:
    """Return the Fisher information on ln theta, (Q, p, p), equilibria fixed.

    2 sum_F Re(conj(Psi) Lambda^-1 Psi^T), with Lambda the noise law at the modelled FRF, and Psi
    the derivatives of vec G at the frequencies `omega` [rad/s]. Of a separable law (such as
    `ClosedLoopNoise`) only the factors are used.

    Raises
    ------
    InvalidInput
        If a frequency is not positive and finite, or a free parameter acts on more than the
        network's terms.
    """
    w = positive_frequencies(omega)
    check_complete(network)
    plan = layout(network)
    p = len(network.parameters)
    out = np.empty((len(network.mass), p, p))
    if isinstance(noise, SeparableNoise):
        return _separable_information(network, plan, w, noise.factors(network, w), out)
    # A subclass may have another variance than the compiled one.
    if type(noise) is not RelativeNoise or noise.by_output:
        return _reference_information(network, w, noise)
    if plan is None or _differing_gains(network):
        return _reference_information(network, w, noise)
    frequencies, mask = _padded(w)
    spaces = Workspaces(plan, network, network_tables(network))
    lines = address(frequencies), address(mask), w.size
    law = float(noise.relative), float(noise.floor)

    def run(start: int, stop: int) -> None:
        with spaces.one() as work:
            informations(work, *lines, *law, start, stop, address(out))

    over_threads(run, len(out), work_per_item=2 * frequencies.size // LANES, shares=_SHARES)
    return out


def costs(
    network: SpringNetwork,
    omega: Array,
    measured: ComplexArray,
    weights: Array,
    parameters: Array,
    residual: str | ResidualForm = "nls",
) -> Array:
    """Return the costs, (W,), of W sets of parameters, (W, p): a `CostKernel` used once."""
    return CostKernel(network, omega, measured, weights, residual)(parameters)


def _separable_information(
    network: SpringNetwork,
    plan: EliminationPlan | None,
    omega: Array,
    factors: tuple[ComplexArray, ComplexArray],
    out: Array,
) -> Array:
    """Return the information with the inverse covariance U kron inv(V) of the factors U, V."""
    power, outputs = shared(factors[0]), _inverse(shared(factors[1]))
    if plan is None:
        power, outputs = (np.broadcast_to(x, (len(out), *x.shape[1:])) for x in (power, outputs))
        _, J = network.sensitivity(omega)
        weighted = np.einsum("qfml,qflip,qfni->qfmnp", outputs, J, power, optimize=True)
        return np.asarray(2 * np.einsum("qfmnp,qfmnr->qpr", J.conj(), weighted, optimize=True).real)
    # The kernel's sensitivities are those of motor accelerations, and lack w^2.
    if network.measurement is not None:
        scale = network.motor_factors(omega)
        power = np.conj(scale)[:, :, None] * power * scale[:, None, :]
    outputs *= omega[:, None, None] ** 4
    doubles = [np.ascontiguousarray(x, dtype=complex).view(float) for x in (power, outputs)]
    frequencies, _ = _padded(omega)
    tables = network_tables(network)

    def run(start: int, stop: int) -> None:
        space, buffer = workspace(plan, network, tables), aligned(4 * len(plan.motors) ** 2)
        weights = [(address(x), x[0].nbytes if len(x) > 1 else 0) for x in doubles]
        arrays = address(frequencies), *weights, address(buffer), omega.size
        separable_informations(space.at, *arrays, start, stop, address(out))

    over_threads(run, len(out), work_per_item=2 * frequencies.size // LANES)
    return out


def _differing_gains(network: SpringNetwork) -> bool:
    """Return whether a law relative to the FRF's elements sees more than motor accelerations.

    A factor of the whole FRF leaves the information as it is, one of each input does not.
    """
    if network.measurement is None:
        return False
    torque = network.measurement.torque
    return bool(np.ptp(torque.gain) > 0 or torque.lag.any())


def _inverse(matrices: ComplexArray) -> ComplexArray:
    """Return the inverses, (Q, F, m, m); of diagonal matrices, at the price of a division."""
    diagonal = np.einsum("qfii->qfi", matrices)
    if np.count_nonzero(matrices) > np.count_nonzero(diagonal):
        return np.asarray(np.linalg.inv(matrices), dtype=complex)
    inverses = np.zeros(matrices.shape, dtype=complex)
    np.einsum("qfii->qfi", inverses)[:] = 1.0 / diagonal
    return inverses


def _padded(omega: Array) -> tuple[Array, Array]:
    """Return `omega` as whole vectors, the last frequency repeated, and ones where it is not."""
    blocks = -(-omega.size // LANES)
    filled, mask = aligned(blocks), aligned(blocks)
    if omega.size:
        filled[:] = np.pad(omega, (0, blocks * LANES - omega.size), mode="edge")
    mask[: omega.size] = 1.0
    return filled, mask


def _reference_information(network: SpringNetwork, omega: Array, noise: NoiseLaw) -> Array:
    """Return the information by plain numpy: what the kernel does not know."""
    G, J = network.sensitivity(omega)
    weights = 1.0 / noise.variance(G)
    return np.asarray(
        2 * np.einsum("qfmnp,qfmn,qfmnr->qpr", J.conj(), weights, J, optimize=True).real
    )
