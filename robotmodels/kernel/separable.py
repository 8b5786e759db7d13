"""Information under Kronecker covariances: one factorisation of a position for all excitations."""

import numpy as np

from robotmodels.common.arrays import Array, ComplexArray
from robotmodels.kernel.elimination_order import EliminationPlan
from robotmodels.kernel.excitation_lines import excitation_informations
from robotmodels.kernel.memory import address, aligned
from robotmodels.kernel.simd import LANES
from robotmodels.kernel.threads import over_threads
from robotmodels.kernel.workspace import network_tables, workspace
from robotmodels.linear.spring_network import SpringNetwork, shared


def informations_of_factors(
    network: SpringNetwork,
    plan: EliminationPlan | None,
    omega: Array,
    powers: ComplexArray,
    sigma: ComplexArray,
) -> Array:
    """Return the informations, (Q, E, p, p), with the inverse covariances U kron inv(V).

    Parameters
    ----------
    network : SpringNetwork
        Robot at Q positions.
    plan : EliminationPlan or None
        Its layout; None takes the way of the reference.
    omega : ndarray, (F,), rad/s
        Angular frequencies.
    powers : ndarray of complex, (Q, F, n, n), or (E, Q, F, n, n)
        U of one or of E excitations; (E, 1, F, n, n) serves all positions.
    sigma : ndarray of complex, (Q, F, m, m)
        V.
    """
    powers = powers[None] if powers.ndim == 4 else powers
    powers = shared(powers.swapaxes(0, 1)).swapaxes(0, 1)
    sigma = shared(sigma)
    if plan is None:
        return _reference(network, omega, powers, np.asarray(np.linalg.inv(sigma)))
    # The kernel's sensitivities are those of motor accelerations, and lack w^2.
    if network.measurement is not None:
        scale = network.motor_factors(omega)
        powers = np.conj(scale)[:, :, None] * powers * scale[:, None, :]
    return _compiled(network, plan, omega, powers, sigma)


def _compiled(
    network: SpringNetwork,
    plan: EliminationPlan,
    omega: Array,
    powers: ComplexArray,
    sigma: ComplexArray,
) -> Array:
    """Return the informations by the kernel, where diagonal U come first."""
    diagonal = np.array([np.count_nonzero(x) == np.count_nonzero(_diagonals(x)) for x in powers])
    order = np.argsort(~diagonal, kind="stable")
    p, count, q = len(network.parameters), len(powers), len(network.mass)
    inputs, errors = (
        np.ascontiguousarray(x, dtype=complex).view(float) for x in (powers[order], sigma)
    )
    first = address(inputs), _step(inputs[0]), inputs[0].nbytes
    second = address(errors), _step(errors)
    frequencies, _ = padded_lines(omega)
    out, tables = np.empty((q, count, p, p)), network_tables(network)
    n, pairs, wide = len(plan.motors), (len(plan.needed) + 2) // 2, len(plan.motors) + 1
    sizes = 2 * n * n, 2 * wide * wide, n, count * n, 8 * pairs * (pairs + 1) * count

    def run(start: int, stop: int) -> None:
        space, buffers = workspace(plan, network, tables), [aligned(size) for size in sizes]
        arrays = first, second, address(order), tuple(map(address, buffers))
        lengths = (int(diagonal.sum()), count), omega.size, start, stop
        excitation_informations(space.at, address(frequencies), *arrays, *lengths, address(out))

    over_threads(run, q, work_per_item=2 * count * frequencies.size // LANES)
    return out


def _diagonals(matrices: ComplexArray) -> ComplexArray:
    """Return the diagonals of matrices (..., n, n), (..., n)."""
    return np.asarray(np.einsum("...ii->...i", matrices))


def _step(matrices: Array) -> int:
    """Return the bytes from one position's matrices (Q, ...) to the next; 0 if all share them."""
    return matrices[0].nbytes if len(matrices) > 1 else 0


def _reference(
    network: SpringNetwork, omega: Array, powers: ComplexArray, outputs: ComplexArray
) -> Array:
    """Return the informations by plain numpy."""
    _, J = network.sensitivity(omega)
    outputs = np.broadcast_to(outputs, (len(J), *outputs.shape[1:]))
    parts = []
    for power in powers:
        inputs = np.broadcast_to(power, (len(J), *power.shape[1:]))
        weighted = np.einsum("qfml,qflip,qfni->qfmnp", outputs, J, inputs, optimize=True)
        parts.append(2 * np.einsum("qfmnp,qfmnr->qpr", J.conj(), weighted, optimize=True).real)
    return np.stack(parts, axis=1)


def padded_lines(omega: Array) -> tuple[Array, Array]:
    """Return `omega` as whole vectors, the last frequency repeated, and ones where it is not."""
    blocks = -(-omega.size // LANES)
    filled, mask = aligned(blocks), aligned(blocks)
    if omega.size:
        filled[:] = np.pad(omega, (0, blocks * LANES - omega.size), mode="edge")
    mask[: omega.size] = 1.0
    return filled, mask
