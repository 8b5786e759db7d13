"""Weighted squared residuals of FRFs at many parameter values at once.

What does not depend on the parameters is done once: coordinates without free springs are
eliminated from A at every position and frequency, and the two symmetric elements of a measured
FRF are merged where that is exact. Then, at each position and eight frequencies, the small
matrix that is left stays in the cache while one set of parameters after the other uses it.
"""

# mypy: allow-untyped-decorators, allow-untyped-defs, allow-untyped-calls (numba has no types)

from typing import NamedTuple

import numpy as np
from numba import njit

from robotmodels.arrays import Array, ComplexArray
from robotmodels.kernel_layout import BLOCK, Layout
from robotmodels.kernel_log import angle, half_log, wrap
from robotmodels.kernel_solve import (
    Skeleton,
    back_substitute,
    factor,
    motor_response,
    motor_terms,
    solve_lane,
    square,
)
from robotmodels.simd import (
    LANES,
    aligned,
    any_negative,
    fma,
    lane_sum,
    load,
    load_complex,
    maximum,
    pack,
    splat,
    store,
)


class Cells(NamedTuple):
    """What a cell (a position and eight frequencies) keeps, in vectors.

    omega : (cells,) frequencies.
    matrix : (cells, entries of the triangle) what is left of A without free springs.
    off : (cells, size) largest off-diagonal magnitude of its rows.
    targets : (cells, elements, 2) NLS: the merged measured motor response and its weight, three
        vectors; LLS: merged ln magnitude and weight, then the two angles and their weights.
    """

    omega: Array
    matrix: Array
    off: Array
    targets: Array


def vectors(values: Array, blocks: int) -> Array:
    """Return a buffer of `values`, (Q, F, ...), as vectors over frequency, (Q, blocks, ...).

    Frequencies that fill up the last vector repeat the last one.
    """
    frequencies = values.shape[1]
    last = np.minimum(np.arange(blocks * LANES), frequencies - 1)
    filled = values[:, last].reshape(len(values), blocks, LANES, -1)
    out = aligned(filled.size // LANES)
    out[:] = np.moveaxis(filled, 2, -1).ravel()
    return out


def parted(values: ComplexArray) -> Array:
    """Return real and imaginary parts along a new last axis."""
    return np.stack([values.real, values.imag], axis=-1)


@njit
def place_springs(network, plan, cells, work, q, cell, coupled):
    """Put the cell's matrix and the free springs where the factorisation looks for them."""
    size = len(plan.order)
    w = load(cells.omega, cell)
    start = cell * size * (size + 1)
    for i in range(size):
        store(work.diagonal, 2 * i, load_complex(cells.matrix, start + i * (i + 3)))
        store(work.off, i, load(cells.off, cell * size + i))
    if coupled:
        for e in range(size * (size + 1)):
            store(work.matrix, e, load(cells.matrix, start + e))
    for s, i, j in plan.needed:
        if j == -2:
            continue
        spring = pack(
            splat(network.spring_stiffness[q, s]), w * splat(network.spring_damping[q, s])
        )
        store(work.diagonal, 2 * i, load_complex(work.diagonal, 2 * i) + spring)
        if j >= 0:
            store(work.diagonal, 2 * j, load_complex(work.diagonal, 2 * j) + spring)
            high, low = max(i, j), min(i, j)
            e = high * (high + 1) + 2 * low
            store(work.matrix, e, load_complex(work.matrix, e) - spring)
            for r in (i, j):
                store(work.off, r, load(work.off, r) + spring.real + spring.imag)
    motor_terms(network, plan, work, q, w)


@njit
def solve_cell(network, plan, cells, work, q, cell, coupled):
    """Write the driven rows of A^-1."""
    size, n = len(plan.order), len(plan.motors)
    entries = size * (size + 1) * LANES
    place_springs(network, plan, cells, work, q, cell, coupled)
    source = work.matrix if coupled else cells.matrix[cell * entries : (cell + 1) * entries]
    worst = factor(source, size, plan.pad, work)
    back_substitute(size, size - n, n, work)
    if any_negative(worst):
        store(work.worst, 0, worst)
        place_springs(network, plan, cells, work, q, cell, coupled)
        for lane in range(LANES):
            if work.worst[lane] < 0.0:
                solve_lane(source, size, size - n, n, work, lane)


@njit
def nls(plan, cells, work, cell):
    """Return the weighted squares of the difference, merged elements."""
    n = len(plan.motors)
    total = splat(0.0)
    t = 3 * cell * (n * (n + 1) // 2)
    for i in range(n):
        for j in range(i, n):
            apart = motor_response(plan, work, i, j) - load_complex(cells.targets, t)
            total = fma(square(apart), load(cells.targets, t + 2), total)
            t += 3
    return total


@njit
def lls(plan, cells, work, cell):
    """Return the weighted squares of the log ratio; angles differ by less than half a turn."""
    n = len(plan.motors)
    total = splat(0.0)
    t = 6 * cell * (n * (n + 1) // 2)
    for i in range(n):
        for j in range(i, n):
            x = motor_response(plan, work, i, j)
            apart = half_log(square(x)) - load(cells.targets, t)
            total = fma(apart * apart, load(cells.targets, t + 1), total)
            phase = angle(x)
            apart = wrap(phase - load(cells.targets, t + 2))
            total = fma(apart * apart, load(cells.targets, t + 3), total)
            if i != j:
                apart = wrap(phase - load(cells.targets, t + 4))
                total = fma(apart * apart, load(cells.targets, t + 5), total)
            t += 6
    return total


@njit(cache=True, nogil=True)
def cell_costs(network, stiffness, damping, plan, cells, work, options, start, stop, out):
    """Add the costs of cells `start` to `stop` to `out`, (W,).

    `stiffness` and `damping` are (W, Q, s); `options` are the cells per position, whether a free
    spring joins two rows, and whether residuals are logarithmic.
    """
    blocks, coupled, logarithmic = options
    for cell in range(start, stop):
        q = cell // blocks
        for walker in range(len(out)):
            at = Skeleton(
                network.mass,
                network.damping,
                network.stiffness,
                stiffness[walker],
                damping[walker],
            )
            solve_cell(at, plan, cells, work, q, cell, coupled)
            if logarithmic:
                out[walker] += lane_sum(lls(plan, cells, work, cell))
            else:
                out[walker] += lane_sum(nls(plan, cells, work, cell))
