"""Cost, gradient and Gauss-Newton matrix of weighted squared residuals of FRFs.

To the rows a_s of `sensitivity_products` comes one more, the weighted residual; its products with
the others are the gradient, theirs among each other the Gauss-Newton matrix.
"""

# numba compiles what follows and infers its types:
# mypy: allow-untyped-decorators, allow-untyped-defs, allow-untyped-calls

from robotmodels.kernel.compiling import compiled, entry
from robotmodels.kernel.cost_cells import (
    LLS,
    LLS_MAGNITUDE,
    NLS,
    SML_ROW_WISE,
    one_without_weight,
    prefetch_cell,
    solve_cell,
)
from robotmodels.kernel.fisher import accumulate_pairs, apply_weights
from robotmodels.kernel.ldlt import inverse, square
from robotmodels.kernel.memory import integer, load, load_complex, scalar, store, store_scalar
from robotmodels.kernel.output_cells import own_torques
from robotmodels.kernel.run_cells import run_rows, run_weights
from robotmodels.kernel.sensitivity_products import (
    accumulate,
    accumulate_last,
    exponent_row,
    fill_block,
    outer_products,
    pair_offset,
    project,
    spring_elongations,
    zero_sums,
)
from robotmodels.kernel.simd import BYTES, fma, lane_sum, pack, root, splat, where_greater
from robotmodels.kernel.solve import motor_response, pack_motors
from robotmodels.kernel.vector_math import angle, half_log, wrap


@compiled
def nls_rows(work, cells, cell):
    """Write the weights' roots and the weighted residual; return the weighted squares."""
    n = work.n
    total = splat(0.0)
    elements = n * (n + 1) // 2
    t, e, first = 3 * cell * elements, 0, 2 * work.m * elements
    for i in range(n):
        for j in range(i, n):
            weight = load(cells.targets, t + 2)
            scale = root(weight)
            error = motor_response(work, i, j) - load_complex(cells.targets, t)
            total = fma(square(error), weight, total)
            store(work.roots, e, pack(scale, splat(0.0)))
            store(work.rows, first + e, error * scale)
            t += 3
            e += 2
    return total


@compiled
def lls_rows(work, cells, cell, phases):
    """Do the same for the log ratio, `phases` or magnitudes only; d ln x = dx/x."""
    n = work.n
    total, zero = splat(0.0), splat(0.0)
    elements, each = n * (n + 1) // 2, 6 if phases else 2
    t, e, first = each * cell * elements, 0, 2 * work.m * elements
    for i in range(n):
        for j in range(i, n):
            weight = load(cells.targets, t + 1)
            scale = root(weight)
            x = one_without_weight(motor_response(work, i, j), weight)
            error, phase_error = half_log(square(x)) - load(cells.targets, t), zero
            total = fma(error * error, weight, total)
            if phases:
                phase = angle(x)
                for k in range(t + 2, t + 6, 2):
                    shift = wrap(phase - load(cells.targets, k))
                    share = load(cells.targets, k + 1)
                    total = fma(shift * shift, share, total)
                    phase_error = fma(shift, share, phase_error)
                phase_error = where_greater(weight, zero, phase_error / scale, zero)
            store(work.roots, e, inverse(x, 1.0) * scale)
            store(work.rows, first + e, pack(error * scale, phase_error))
            t += each
            e += 2
    return total


@compiled
def residual_rows(work, cells, cell, stiffness, damping, residual, shape):
    """Do it for the residual that is asked for, see `cell_squares`."""
    if shape is not None:
        by_row = residual == SML_ROW_WISE
        return run_rows(work, cells, cell, stiffness, damping, shape, by_row)
    if residual == NLS:
        return nls_rows(work, cells, cell)
    return lls_rows(work, cells, cell, residual == LLS)


@compiled
def add_gradient(work, q, stiffness, damping, out):
    """Add what the sums of position `q` hold of the gradient to the (p,) doubles at `out`."""
    for i in range(2 * work.m):
        t = i % work.m
        s = integer(work.needed, 3 * t)
        offset = pair_offset(work.m, t)
        if i < work.m:
            x = -2.0 * scalar(stiffness, s) * lane_sum(load(work.sums, offset))
        else:
            x = 2.0 * scalar(damping, s) * lane_sum(load(work.sums, offset + 1))
        row = exponent_row(work, q, i)
        for a in range(work.p):
            store_scalar(out, a, scalar(out, a) + x * scalar(row, a))


@compiled
def accumulate_cell(work, cells, cell, matrix, residual, shape, w):
    """Add a cell's products of springs with the residual, and if `matrix` with each other."""
    real = residual == LLS_MAGNITUDE
    if shape is None:
        if matrix:
            accumulate(work, work.m + 1, w, real)
        else:
            accumulate_last(work, work.m, w, real)
        return
    accumulate_last(work, work.m, w, real)
    if matrix:
        for row in range(shape.outputs if residual == SML_ROW_WISE else 1):
            only = row if residual == SML_ROW_WISE else -1
            weights = run_weights(work, cells, cell, shape, only)
            apply_weights(work, weights, 0)
            apply_weights(work, weights + BYTES * 2 * work.n * work.n, 1)
            accumulate_pairs(work, w, work.sums)


@entry
def cell_normals(work, cells, stiffness, damping, matrix, options, start, stop, out):
    """Add the cost, gradient and, if `matrix`, Gauss-Newton's of some cells to doubles at `out`.

    Arguments as of `cost_cells`, of one set of parameters; `out` holds 1 + p (+ p^2) doubles.
    """
    _, blocks, coupled, residual, shape = options
    real = residual == LLS_MAGNITUDE
    for cell in range(start, stop):
        q = cell // blocks
        k, c = stiffness + 8 * work.s * q, damping + 8 * work.s * q
        if cell == start or cell % blocks == 0:
            pack_motors(work, q)
            zero_sums(work)
        prefetch_cell(work, cells, cell + 1)
        solve_cell(work, cells, cell, coupled, k, c, work.first)
        squares = residual_rows(work, cells, cell, k, c, residual, shape)
        store_scalar(out, 0, scalar(out, 0) + lane_sum(squares))
        w = load(cells.omega, cell)
        spring_elongations(work, w)
        own_torques(work, shape)
        outer_products(work, False)
        accumulate_cell(work, cells, cell, matrix, residual, shape, w)
        if cell == stop - 1 or (cell + 1) % blocks == 0:
            add_gradient(work, q, k, c, out + 8)
            if matrix:
                fill_block(work, k, c, real)
                project(work, q, out + 8 * (1 + work.p))
