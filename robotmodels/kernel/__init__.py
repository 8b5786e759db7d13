"""FRFs, Fisher information, residual costs and their derivatives of spring networks, fast.

The formulas are those of `SpringNetwork`, which is the reference. Here one vector register holds
eight frequencies (`simd`), motors are eliminated by formula (`elimination_order`), the arm is
factorised without pivoting (`ldlt`, `solve`), and positions are shared out over threads.
"""

import numpy as np

from robotmodels.common.arrays import Array, ComplexArray
from robotmodels.kernel.compiling import is_stored
from robotmodels.kernel.cost_kernel import (
    CostKernel,
    FitKernel,
    check_complete,
    positive_frequencies,
)
from robotmodels.kernel.elimination_order import layout
from robotmodels.kernel.elongations import elongations
from robotmodels.kernel.fisher import informations
from robotmodels.kernel.gauss_newton import cell_normals
from robotmodels.kernel.memory import address
from robotmodels.kernel.run_kernel import RunKernel, run_kernel_suits
from robotmodels.kernel.separable import informations_of_factors, padded_lines
from robotmodels.kernel.simd import LANES
from robotmodels.kernel.solve import responses
from robotmodels.kernel.threads import over_threads
from robotmodels.kernel.workspace import Workspaces, network_tables, workspace
from robotmodels.linear.noise import NoiseLaw, OutputErrors, RelativeNoise, SeparableNoise
from robotmodels.linear.normal_equations import NormalEquations
from robotmodels.linear.residuals import ResidualForm
from robotmodels.linear.spring_network import SpringNetwork

__all__ = [
    "CostKernel",
    "FitKernel",
    "NormalEquations",
    "RunKernel",
    "costs",
    "excitation_informations",
    "frequency_response",
    "information",
    "is_compiled",
    "rank_one_sensitivity",
    "run_kernel_suits",
]

_SHARES = 4
"""Pieces of the positions for each thread: one may be delayed, if only by the next network."""


def is_compiled() -> bool:
    """Tell whether what designs and fits take most from is compiled, which happens once."""
    return all(map(is_stored, (informations, cell_normals)))


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
    frequencies, _ = padded_lines(w)
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
        return informations_of_factors(network, plan, w, *noise.factors(network, w))[:, 0]
    # A subclass may have another variance than the compiled one.
    if type(noise) is not RelativeNoise or noise.by_output:
        return _reference_information(network, w, noise)
    if plan is None or _differing_gains(network):
        return _reference_information(network, w, noise)
    frequencies, mask = padded_lines(w)
    spaces = Workspaces(plan, network, network_tables(network))
    lines = address(frequencies), address(mask), w.size
    law = float(noise.relative), float(noise.floor)

    def run(start: int, stop: int) -> None:
        with spaces.one() as work:
            informations(work, *lines, *law, start, stop, address(out))

    over_threads(run, len(out), work_per_item=2 * frequencies.size // LANES, shares=_SHARES)
    return out


def rank_one_sensitivity(
    network: SpringNetwork, omega: Array
) -> tuple[ComplexArray, ComplexArray, ComplexArray, ComplexArray]:
    """Return G and the factors y, v and w of its derivatives, see `SpringNetwork`.

    Raises
    ------
    InvalidInput
        If a frequency is not positive and finite.
    """
    w = positive_frequencies(omega)
    plan = layout(network)
    if plan is None or network.inertances is not None:
        return network.rank_one_sensitivity(w)
    out = np.empty((len(network.mass), w.size, len(plan.needed), len(plan.motors)), dtype=complex)
    frequencies, _ = padded_lines(w)
    tables = network_tables(network)

    def run(start: int, stop: int) -> None:
        space = workspace(plan, network, tables)
        elongations(space.at, address(frequencies), w.size, start, stop, address(out.view(float)))

    over_threads(run, len(out), work_per_item=frequencies.size // LANES)
    v = np.swapaxes(out, -1, -2)
    right = v * network.motor_factors(w)[..., None]
    weights = network.rank_one_weights(w)
    left: ComplexArray = np.asarray(-(w[:, None, None] ** 2) * v)
    return frequency_response(network, w), left, right, weights


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


def excitation_informations(
    network: SpringNetwork, omega: Array, spectra: ComplexArray, errors: OutputErrors
) -> Array:
    """Return the Fisher information of E excitations, (Q, E, p, p), equilibria fixed.

    That of `information` with the `ExcitationNoise` of each: a position is factorised once for
    all of them.

    Parameters
    ----------
    network : SpringNetwork
        Robot at Q positions.
    omega : ndarray, (F,), rad/s
        Angular frequencies.
    spectra : ndarray of complex, (E, F, n, n), N^2 m^2
        Spectral matrices.
    errors : OutputErrors
        Errors of outputs and torques.

    Raises
    ------
    InvalidInput
        As `information`.
    """
    w = positive_frequencies(omega)
    check_complete(network)
    plan = layout(network)
    G = frequency_response(network, w)
    sigma = errors.output_error(network, G, w)
    powers = np.swapaxes(np.asarray(spectra, dtype=complex), -1, -2)[:, None]
    return informations_of_factors(network, plan, w, powers, sigma)


def _differing_gains(network: SpringNetwork) -> bool:
    """Return whether a law relative to the FRF's elements sees more than motor accelerations.

    A factor of the whole FRF leaves the information as it is, one of each input does not.
    """
    if network.measurement is None:
        return False
    torque = network.measurement.torque
    return bool(np.ptp(torque.gain) > 0 or torque.lag.any())


def _reference_information(network: SpringNetwork, omega: Array, noise: NoiseLaw) -> Array:
    """Return the information by plain numpy: what the kernel does not know."""
    G, J = network.sensitivity(omega)
    weights = 1.0 / noise.variance(G)
    return np.asarray(
        2 * np.einsum("qfmnp,qfmn,qfmnr->qpr", J.conj(), weights, J, optimize=True).real
    )
