"""FRFs, Fisher information, residual costs and their derivatives of spring networks, fast.

The formulas are those of `SpringNetwork`, which is the reference. Here one vector register holds
eight frequencies (`simd`), motors are eliminated by formula (`kernel_layout`), the arm is
factorised without pivoting (`kernel_solve`), and positions are shared out over threads.
"""

import numpy as np

from robotmodels.arrays import Array, ComplexArray
from robotmodels.kernel_cells import CostKernel, check_complete, positive_frequencies
from robotmodels.kernel_information import informations
from robotmodels.kernel_layout import layout
from robotmodels.kernel_memory import address, aligned
from robotmodels.kernel_solve import responses
from robotmodels.kernel_threads import over_threads
from robotmodels.kernel_work import network_tables, workspace
from robotmodels.noise import RelativeNoise
from robotmodels.normal_equations import NormalEquations, Residual
from robotmodels.simd import LANES
from robotmodels.spring_network import SpringNetwork

__all__ = ["CostKernel", "NormalEquations", "costs", "frequency_response", "information"]


def frequency_response(network: SpringNetwork, omega: Array) -> ComplexArray:
    """Return G, (Q, F, m, n), at `omega` [rad/s]; as a rule from motor torque to acceleration.

    Other outputs, and motors that act on several coordinates, take the way of the reference.

    Raises
    ------
    InvalidInput : if a frequency is not positive and finite.
    """
    w = positive_frequencies(omega)
    plan = layout(network)
    if plan is None:
        return network.frequency_response(w)
    n = len(plan.motors)
    out = np.empty((len(network.mass), w.size, n, n), dtype=complex)
    vectors, _ = _padded(w)
    tables = network_tables(network)

    def run(start: int, stop: int) -> None:
        space = workspace(plan, network, tables)
        responses(space.at, address(vectors), w.size, start, stop, address(out.view(float)))

    over_threads(run, len(out), work_per_item=vectors.size // LANES)
    return out


def information(network: SpringNetwork, omega: Array, noise: RelativeNoise) -> Array:
    """Return the Fisher information on ln theta, (Q, p, p), equilibria held fixed.

    2 sum_F Re(conj(Psi) Lambda^-1 Psi^T), with Lambda the noise law at the modelled FRF, and Psi
    the derivatives of vec G at the frequencies `omega` [rad/s].

    Raises
    ------
    InvalidInput : if a frequency is not positive and finite, or a free parameter acts on more than
        the network's terms.
    """
    w = positive_frequencies(omega)
    check_complete(network)
    plan = layout(network)
    if plan is None:
        return _reference_information(network, w, noise)
    p = len(network.parameters)
    out = np.empty((len(network.mass), p, p))
    vectors, mask = _padded(w)
    tables = network_tables(network)

    def run(start: int, stop: int) -> None:
        space = workspace(plan, network, tables)
        frequencies = address(vectors), address(mask), w.size
        law = float(noise.relative), float(noise.floor)
        informations(space.at, *frequencies, *law, start, stop, address(out))

    over_threads(run, len(out), work_per_item=2 * vectors.size // LANES)
    return out


def costs(
    network: SpringNetwork,
    omega: Array,
    measured: ComplexArray,
    weights: Array,
    parameters: Array,
    residual: Residual = "nls",
) -> Array:
    """Return the costs, (W,), of W sets of parameters, (W, p): a `CostKernel` used once."""
    return CostKernel(network, omega, measured, weights, residual)(parameters)


def _padded(omega: Array) -> tuple[Array, Array]:
    """Return `omega` as whole vectors, the last frequency repeated, and ones where it is not."""
    blocks = -(-omega.size // LANES)
    vectors, mask = aligned(blocks), aligned(blocks)
    if omega.size:
        vectors[:] = np.pad(omega, (0, blocks * LANES - omega.size), mode="edge")
    mask[: omega.size] = 1.0
    return vectors, mask


def _reference_information(network: SpringNetwork, omega: Array, noise: RelativeNoise) -> Array:
    """Return the information by plain numpy: what the kernel does not know."""
    G, J = network.sensitivity(omega)
    weights = 1.0 / noise.variance(G)
    return np.asarray(
        2 * np.einsum("qfmnp,qfmn,qfmnr->qpr", J.conj(), weights, J, optimize=True).real
    )
