"""What a `CostKernel` computes once: A without its free springs, and what is compared with."""

import numpy as np

from robotmodels.common.arrays import Array, ComplexArray
from robotmodels.kernel.cost_cells import parted, vectors
from robotmodels.kernel.elimination_order import INERTANCE, EliminationPlan
from robotmodels.kernel.memory import address, aligned
from robotmodels.kernel.reduce import reductions
from robotmodels.kernel.simd import LANES
from robotmodels.kernel.threads import over_threads
from robotmodels.kernel.workspace import network_tables, workspace
from robotmodels.linear.spring_network import SpringNetwork

# The columns of `targets` that hold weights.
_WEIGHTS = {"nls": [2], "lls": [1, 3, 5], "lls_magnitude": [1]}


def prepare_matrices(
    network: SpringNetwork, omega: Array, full: EliminationPlan, plan: EliminationPlan
) -> tuple[Array, Array]:
    """Return A without its free terms, rows before `full.first` eliminated, and rows' largest.

    As `Cells` wants them; `plan` is the reduced layout.
    """
    blocks, size = -(-omega.size // LANES), len(plan.order)
    cells = blocks * len(network.mass)
    matrix, off = aligned(cells * size * (size + 1)), aligned(cells * size)
    tables = network_tables(network)
    for coefficients in (3, 4):
        tables[coefficients] = tables[coefficients].copy()
        tables[coefficients][:, full.needed[:, 0]] = 0.0
    w = vectors(omega[None, :, None], blocks)
    went_well = []

    def run(start: int, stop: int) -> None:
        space = workspace(full, network, tables)
        out = address(matrix), address(off)
        well = reductions(space.at, address(w), blocks, plan.pad, start, stop, *out)
        went_well.append(well)

    over_threads(run, cells, work_per_item=1)
    if all(went_well):
        return matrix, off
    A = _remaining_matrix(network, omega, full, plan)  # with pivoting
    largest = np.abs(A * (1 - np.eye(size))).max(axis=-1)
    return vectors(parted(A[..., *np.tril_indices(size)]), blocks), vectors(largest, blocks)


def prepare_targets(
    omega: Array, measured: ComplexArray, weights: Array, residual: str
) -> tuple[Array, Array, float]:
    """Return omega and targets as `Cells` wants them, and the cost no model can undo."""
    blocks, positions = -(-omega.size // LANES), len(measured)
    w = np.broadcast_to(omega, (positions, omega.size))
    compared, constant = targets(omega, measured, weights, residual)
    inside = np.pad(np.ones(omega.size), (0, blocks * LANES - omega.size))
    packed = vectors(compared, blocks).reshape(positions, blocks, -1, compared.shape[-1], LANES)
    packed[..., _WEIGHTS[residual], :] *= inside.reshape(blocks, 1, 1, LANES)
    return vectors(w[..., None], blocks), packed.reshape(-1), constant


def targets(
    omega: Array, measured: ComplexArray, weights: Array, residual: str
) -> tuple[Array, float]:
    """Return what each element i <= j is compared with, and the cost no model can undo."""
    n, w2 = measured.shape[-1], omega[:, None] ** 2
    i, j = np.triu_indices(n)
    upper, lower = (
        measured.reshape(-1, omega.size, n * n).take(k, 2) for k in (i * n + j, j * n + i)
    )
    u, v = (weights.reshape(-1, omega.size, n * n).take(k, 2) for k in (i * n + j, j * n + i))
    v[..., i == j] = 0.0
    both = u + v
    share = v / np.where(both > 0, both, 1.0)
    if residual == "nls":
        difference = lower - upper
        constant = u * share * (difference.real**2 + difference.imag**2)
        means = [
            -(a + share * b) / w2
            for a, b in ((upper.real, difference.real), (upper.imag, difference.imag))
        ]
        return np.stack([*means, both * w2**2], axis=-1), float(np.sum(constant))
    a, b = np.log(np.abs(upper)), np.log(np.abs(lower))
    parts = [a + share * (b - a) - np.log(w2), both]
    if residual == "lls":
        parts += [np.angle(-upper), u, np.angle(-lower), v]
    return np.stack(parts, axis=-1), float(np.sum(u * share * (a - b) ** 2))


def _remaining_matrix(
    network: SpringNetwork, omega: Array, full: EliminationPlan, plan: EliminationPlan
) -> ComplexArray:
    """Return A without free and motor springs, (Q, F, size, size), other rows eliminated."""
    mass, damping, stiffness = (
        np.array(m, dtype=float) for m in (network.mass, network.damping, network.stiffness)
    )
    first, second = network.coefficients
    free = set(full.needed[:, 0])
    for s, i, j in full.inner:
        if s in free:
            continue
        a = np.zeros(mass.shape[-1])
        a[full.order[i]] = 1.0
        if j >= 0:
            a[full.order[j]] = -1.0
        lower, upper = (x[:, s, None, None] * np.outer(a, a) for x in (first, second))
        if j == INERTANCE:
            damping, mass = damping + lower, mass + upper
        else:
            stiffness, damping = stiffness + lower, damping + upper
    rows = full.order[full.pad :]
    w = omega[:, None, None]
    A = (
        stiffness[:, None, rows[:, None], rows]
        - w**2 * mass[:, None, rows[:, None], rows]
        + 1j * w * np.broadcast_to(damping, mass.shape)[:, None, rows[:, None], rows]
    )
    cut = full.first - full.pad
    if cut:
        A = A[..., cut:, cut:] - A[..., cut:, :cut] @ np.linalg.solve(
            A[..., :cut, :cut], A[..., :cut, cut:]
        )
    out = np.zeros((*A.shape[:2], len(plan.order), len(plan.order)), dtype=complex)
    out[..., range(plan.pad), range(plan.pad)] = 1.0
    out[..., plan.pad :, plan.pad :] = A
    return out
