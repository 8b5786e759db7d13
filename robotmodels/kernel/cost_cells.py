"""Weighted squared residuals of FRFs at many parameter values at once.

What does not depend on the parameters is done once: coordinates without free springs are
eliminated from A at every position and frequency, and the two symmetric elements of a measured
FRF are merged where that is exact. Then, at each position and eight frequencies, the small
remaining matrix stays in the cache while one set of parameters after the other uses it.
"""

# numba compiles what follows and infers its types:
# mypy: allow-untyped-decorators, allow-untyped-defs, allow-untyped-calls

from typing import NamedTuple

import numpy as np

from robotmodels.common.arrays import Array, ComplexArray
from robotmodels.kernel.compiling import compiled, entry, inlined
from robotmodels.kernel.elimination_order import INERTANCE, MOTOR, MOTOR_INERTANCE
from robotmodels.kernel.ldlt import back_substitute, factor, solve_lane, square
from robotmodels.kernel.memory import (
    aligned,
    integer,
    load,
    load_complex,
    prefetch,
    scalar,
    store,
    store_scalar,
)
from robotmodels.kernel.run_cells import run_squares
from robotmodels.kernel.simd import LANES, any_negative, fma, lane_sum, pack, splat, where_greater
from robotmodels.kernel.solve import motor_response, motor_terms, pack_motors
from robotmodels.kernel.vector_math import angle, half_log, wrap

NLS, LLS, LLS_MAGNITUDE, SML, SML_ROW_WISE = range(5)
"""Residuals, as compiled code names them."""


class Cells(NamedTuple):
    """Addresses of what the cells (a position and eight frequencies each) keep, in vectors.

    Attributes
    ----------
    omega : int, (cells,)
        Frequencies.
    matrix : int
        (cells, entries of the triangle) A without free springs, reduced to the remaining rows.
    off : int, (cells, size)
        Largest off-diagonal magnitude of its rows.
    targets : int
        NLS: (cells, elements, 3) the merged measured motor response and its weight; LLS: (cells,
        elements, 6) merged ln magnitude and weight, then two angles and weights; magnitudes only:
        (cells, elements, 2) these alone. Runs: see `run_cells`.
    """

    omega: int
    matrix: int
    off: int
    targets: int


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


@inlined
def prefetch_cell(work, cells, cell):
    """Bring a cell's matrix near while another is worked on; none is too many."""
    entries = work.size * (work.size + 1)
    for e in range(entries):
        prefetch(cells.matrix, cell * entries + e)


@compiled
def subtract_springs(work, cells, cell, coupled, stiffness, damping):
    """Put the cell's matrix and the free springs where the factorisation looks for them."""
    size = work.size
    w = load(cells.omega, cell)
    start = cell * size * (size + 1)
    for i in range(size):
        store(work.diagonal, 2 * i, load_complex(cells.matrix, start + i * (i + 3)))
        store(work.off, i, load(cells.off, cell * size + i))
    if coupled:
        for e in range(size * (size + 1)):
            store(work.matrix, e, load(cells.matrix, start + e))
    for e in range(work.m):
        s = integer(work.needed, 3 * e)
        i, j = integer(work.needed, 3 * e + 1), integer(work.needed, 3 * e + 2)
        if j in (MOTOR, MOTOR_INERTANCE):
            continue
        spring = pack(splat(scalar(stiffness, s)), w * splat(scalar(damping, s)))
        if j == INERTANCE:
            spring = pack((splat(0.0) - w) * spring.imag, w * spring.real)
        store(work.diagonal, 2 * i, load_complex(work.diagonal, 2 * i) + spring)
        if j >= 0:
            store(work.diagonal, 2 * j, load_complex(work.diagonal, 2 * j) + spring)
            index = max(i, j) * (max(i, j) + 1) + 2 * min(i, j)
            store(work.matrix, index, load_complex(work.matrix, index) - spring)
            store(work.off, i, load(work.off, i) + spring.real + spring.imag)
            store(work.off, j, load(work.off, j) + spring.real + spring.imag)
    motor_terms(work, w, stiffness, damping)


@compiled
def solve_cell(work, cells, cell, coupled, stiffness, damping, first):
    """Write the rows of A^-1 from `first` on."""
    size = work.size
    subtract_springs(work, cells, cell, coupled, stiffness, damping)
    source = work.matrix if coupled else cells.matrix + 8 * LANES * cell * size * (size + 1)
    worst = factor(work, source)
    back_substitute(work, first)
    if any_negative(worst):
        store(work.worst, 0, worst)
        subtract_springs(work, cells, cell, coupled, stiffness, damping)
        for lane in range(LANES):
            if scalar(work.worst, lane) < 0.0:
                solve_lane(work, source, first, lane)


@compiled
def nls(work, cells, cell):
    """Return the weighted squares of the difference, merged elements."""
    n = work.n
    total = splat(0.0)
    t = 3 * cell * (n * (n + 1) // 2)
    for i in range(n):
        for j in range(i, n):
            error = motor_response(work, i, j) - load_complex(cells.targets, t)
            total = fma(square(error), load(cells.targets, t + 2), total)
            t += 3
    return total


@inlined
def one_without_weight(x, weight):
    """Return x, or one where it has no weight: there, a logarithm may not exist."""
    zero = splat(0.0)
    return pack(
        where_greater(weight, zero, x.real, splat(1.0)), where_greater(weight, zero, x.imag, zero)
    )


@compiled
def lls(work, cells, cell):
    """Return the weighted squares of the log ratio; angles differ by less than half a turn."""
    n = work.n
    total = splat(0.0)
    t = 6 * cell * (n * (n + 1) // 2)
    for i in range(n):
        for j in range(i, n):
            weight = load(cells.targets, t + 1)
            x = one_without_weight(motor_response(work, i, j), weight)
            error = half_log(square(x)) - load(cells.targets, t)
            total = fma(error * error, weight, total)
            phase = angle(x)
            error = wrap(phase - load(cells.targets, t + 2))
            total = fma(error * error, load(cells.targets, t + 3), total)
            if i != j:
                error = wrap(phase - load(cells.targets, t + 4))
                total = fma(error * error, load(cells.targets, t + 5), total)
            t += 6
    return total


@compiled
def magnitudes(work, cells, cell):
    """Return the weighted squares of the log ratio of magnitudes."""
    n = work.n
    total = splat(0.0)
    t = 2 * cell * (n * (n + 1) // 2)
    for i in range(n):
        for j in range(i, n):
            weight = load(cells.targets, t + 1)
            x = one_without_weight(motor_response(work, i, j), weight)
            error = half_log(square(x)) - load(cells.targets, t)
            total = fma(error * error, weight, total)
            t += 2
    return total


@compiled
def cell_squares(work, cells, cell, stiffness, damping, residual, shape):
    """Return the squares of the residual that is asked for; `shape` is None but for runs.

    So of each kind of data only its own residuals are compiled.
    """
    if shape is not None:
        by_row = residual == SML_ROW_WISE
        return run_squares(work, cells, cell, stiffness, damping, shape, by_row)
    if residual == NLS:
        return nls(work, cells, cell)
    if residual == LLS:
        return lls(work, cells, cell)
    return magnitudes(work, cells, cell)


@entry
def cell_costs(work, cells, stiffness, damping, walkers, options, start, stop, out):
    """Add the costs of cells `start` to `stop` to the (W,) doubles at `out`.

    `stiffness` and `damping` are the addresses of (W, Q, s); `options` are Q, the cells per
    position, whether a free spring joins two rows, which residual, and the `RunShape` or
    None.
    """
    positions, blocks, coupled, residual, shape = options
    for cell in range(start, stop):
        pack_motors(work, cell // blocks)
        for walker in range(walkers):
            springs = 8 * work.s * (walker * positions + cell // blocks)
            k, c = stiffness + springs, damping + springs
            solve_cell(work, cells, cell, coupled, k, c, work.size - work.n)
            squares = cell_squares(work, cells, cell, k, c, residual, shape)
            store_scalar(out, walker, scalar(out, walker) + lane_sum(squares))
