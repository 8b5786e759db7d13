"""The likelihood of runs with noisy torques and outputs, eight lines at once.

Of a line's FRF G, errors are W = [Y B] - G [U L], with L L^H the covariance of the torques, B L^H
that of outputs with them and K what outputs have beside (see `run_kernel`): the first columns are
e, the last X, Sigma = K + X X^H. Runs were turned by a unitary matrix so that U is a lower
triangle, too.
"""

# numba compiles what follows and infers its types:
# mypy: allow-untyped-decorators, allow-untyped-defs, allow-untyped-calls

from robotmodels.kernel.compiling import compiled, inlined
from robotmodels.kernel.ldlt import square
from robotmodels.kernel.memory import load, load_complex, store
from robotmodels.kernel.output_cells import copy_sensors, even, lift, write_response, write_sensors
from robotmodels.kernel.simd import BYTES, fma, fma_conjugate, pack, splat


@inlined
def cell_length(shape):
    """Return the vectors that a cell keeps: which lines count, -[U L], [Y B] and K."""
    n, m = even(shape.inputs), even(shape.outputs)
    return 2 + 2 * ((n + m) * (shape.runs + n) + m * m)


@inlined
def buffers(work, shape):
    """Return where W, Sigma, 1/D, U0, what slopes are made of, weights, and R are; G is before."""
    n, m = even(shape.inputs), even(shape.outputs)
    deviation = work.scratch + BYTES * 2 * m * n
    sigma = deviation + BYTES * 2 * m * (shape.runs + n)
    inverse = sigma + BYTES * 2 * m * m
    inputs = inverse + BYTES * 2 * m
    lifted = inputs + BYTES * 2 * n * shape.runs
    weights = lifted + BYTES * 2 * work.n * max(shape.runs, m)
    return deviation, sigma, inverse, inputs, lifted, weights, weights + BYTES * 4 * work.n**2


@inlined
def corners(source, at, below):
    """Return two entries and the two below them."""
    first, second = load_complex(source, at), load_complex(source, at + 2)
    return first, second, load_complex(source, below), load_complex(source, below + 2)


@compiled
def deviations(work, source, shape, target):
    """Write W to `target`; `source` is the address of a cell, G is at the scratch's begin."""
    n, x, runs = shape.inputs, work.scratch, shape.runs
    wide, high = even(n), even(shape.outputs)
    columns = runs + wide
    right, left = source + 2 * BYTES, source + BYTES * (2 + 2 * wide * columns)
    for k in range(0, columns, 2):
        first = min(k if k < runs else k - runs, n)
        for i in range(0, high, 2):
            at = 2 * (i * columns + k)
            below = at + 2 * columns
            p, q, r, u = corners(left, at, below)
            for j in range(first, n):
                a = load_complex(x, 2 * (i * wide + j))
                c = load_complex(x, 2 * ((i + 1) * wide + j))
                b = load_complex(right, 2 * (j * columns + k))
                d = load_complex(right, 2 * (j * columns + k) + 2)
                p, q, r, u = fma(a, b, p), fma(a, d, q), fma(c, b, r), fma(c, d, u)
            store(target, at, p)
            store(target, at + 2, q)
            store(target, below, r)
            store(target, below + 2, u)


@compiled
def error_covariance(source, shape, deviation, target):
    """Write the lower triangle of Sigma to `target`."""
    n, wide, runs = shape.inputs, even(shape.outputs), shape.runs
    columns = runs + even(n)
    beside = source + BYTES * (2 + 2 * (even(n) + wide) * columns)
    X = deviation + 2 * BYTES * runs
    for i in range(0, wide, 2):
        for j in range(0, i + 1, 2):
            at = 2 * (i * wide + j)
            below = at + 2 * wide
            p, q, r, u = corners(beside, at, below)
            for k in range(0, 2 * n, 2):
                a = load_complex(X, 2 * i * columns + k)
                c = load_complex(X, 2 * (i + 1) * columns + k)
                b = load_complex(X, 2 * j * columns + k)
                d = load_complex(X, 2 * (j + 1) * columns + k)
                p, q = fma_conjugate(b, a, p), fma_conjugate(d, a, q)
                r, u = fma_conjugate(b, c, r), fma_conjugate(d, c, u)
            store(target, at, p)
            store(target, at + 2, q)
            store(target, below, r)
            store(target, below + 2, u)


@compiled
def factor_covariance(m, sigma, inverse, row_wise):
    """Turn Sigma into minus the unit triangle below its diagonal, with 1/D at `inverse`."""
    wide = even(m)
    zero, one = splat(0.0), splat(1.0)
    for j in range(m):
        scale = one / load(sigma, 2 * j * (wide + 1))
        store(inverse, j, scale)
        if row_wise:
            continue
        for i in range(j + 1, m):
            lower = load_complex(sigma, 2 * (i * wide + j)) * (zero - scale)
            for k in range(j + 1, i + 1):
                at = 2 * (i * wide + k)
                column = load_complex(sigma, 2 * (k * wide + j))
                store(sigma, at, fma_conjugate(column, lower, load_complex(sigma, at)))
        for i in range(j + 1, m):
            at = 2 * (i * wide + j)
            store(sigma, at, load_complex(sigma, at) * (zero - scale))


@compiled
def whiten_down(m, sigma, errors, columns, count):
    """Solve L z = e in place, `count` columns of `errors` (m, columns)."""
    wide = even(m)
    for j in range(m):
        for i in range(j + 1, m):
            lower = load_complex(sigma, 2 * (i * wide + j))
            for k in range(0, 2 * count, 2):
                at = 2 * i * columns + k
                z = load_complex(errors, 2 * j * columns + k)
                store(errors, at, fma(lower, z, load_complex(errors, at)))


@compiled
def weigh_and_solve_up(m, sigma, inverse, errors, columns, count):
    """Solve L^H s = D^-1 z in place."""
    wide = even(m)
    for j in range(m - 1, -1, -1):
        scale = load(inverse, j)
        for k in range(0, 2 * count, 2):
            y = load_complex(errors, 2 * j * columns + k) * scale
            for i in range(j + 1, m):
                lower = load_complex(sigma, 2 * (i * wide + j))
                y = fma_conjugate(lower, load_complex(errors, 2 * i * columns + k), y)
            store(errors, 2 * j * columns + k, y)


@compiled
def run_squares(work, cells, cell, stiffness, damping, shape, row_wise):
    """Return the squares of whitened errors, summed over outputs and runs; e becomes L^-1 e.

    `stiffness` and `damping` are the addresses of a position's first and second coefficients.
    """
    m, columns = shape.outputs, shape.runs + even(shape.inputs)
    source = cells.targets + BYTES * cell * cell_length(shape)
    deviation, sigma, inverse, _, _, _, sensors = buffers(work, shape)
    if shape.readings != 0:
        write_sensors(work, cells, cell, stiffness, damping, shape, sensors)
    write_response(work, shape, sensors, work.scratch)
    deviations(work, source, shape, deviation)
    error_covariance(source, shape, deviation, sigma)
    factor_covariance(m, sigma, inverse, row_wise)
    if not row_wise:
        whiten_down(m, sigma, deviation, columns, shape.runs)
    total = splat(0.0)
    for i in range(m):
        part = splat(0.0)
        for k in range(0, 2 * shape.runs, 2):
            part = part + square(load_complex(deviation, 2 * i * columns + k))
        total = fma(part, load(inverse, i), total)
    return total * load(source, 0)


@compiled
def run_rows(work, cells, cell, stiffness, damping, shape, row_wise):
    """Write the slope of V by the response as the residual's row, with roots of one; return V.

    dV = -2 Re sum dG_ij conj(P_ij), P = s U0^H, s = Sigma^-1 e, which takes the place of e.
    """
    m, columns = shape.outputs, shape.runs + even(shape.inputs)
    source = cells.targets + BYTES * cell * cell_length(shape)
    squares = run_squares(work, cells, cell, stiffness, damping, shape, row_wise)
    deviation, sigma, inverse, inputs, lifted, _, sensors = buffers(work, shape)
    if row_wise:
        weigh_rows(m, inverse, deviation, columns, shape.runs)
    else:
        weigh_and_solve_up(m, sigma, inverse, deviation, columns, shape.runs)
    zero_slopes(work)
    for only in range(0 if row_wise else -1, m if row_wise else 0):
        low, high = (only, only + 1) if row_wise else (0, m)
        estimate_inputs(work, source + 2 * BYTES, deviation, inputs, shape, low, high)
        if shape.readings == 0:
            add_slopes(work, deviation, columns, low, high, inputs, shape, load(source, 0))
        else:
            lift(work, sensors, deviation, columns, low, high, shape.runs, lifted)
            add_slopes(work, lifted, shape.runs, 0, work.n, inputs, shape, load(source, 0))
    return squares


@compiled
def weigh_rows(m, inverse, errors, columns, count):
    """Divide rows by their variances in place, `count` columns of `errors` (m, columns)."""
    for i in range(m):
        for at in range(2 * i * columns, 2 * (i * columns + count), 2):
            store(errors, at, load_complex(errors, at) * load(inverse, i))


@inlined
def zero_slopes(work):
    """Set the residual's row to zero and the roots to one."""
    elements = work.n * (work.n + 1)
    slope = work.rows + BYTES * work.m * elements
    for e in range(0, elements, 2):
        store(slope, e, pack(splat(0.0), splat(0.0)))
        store(work.roots, e, pack(splat(1.0), splat(0.0)))


@compiled
def add_slopes(work, solved, columns, low, high, inputs, shape, mask):
    """Subtract s U0^H, merged to elements i <= j, of rows `low` to `high` of s (., columns)."""
    n, runs = work.n, shape.runs
    target = work.rows + BYTES * work.m * n * (n + 1)
    for k in range(low, high):
        for j in range(shape.inputs):
            y = pack(splat(0.0), splat(0.0))
            for run in range(0, 2 * runs, 2):
                u = load_complex(inputs, 2 * j * runs + run)
                y = fma_conjugate(u, load_complex(solved, 2 * k * columns + run), y)
            first, second = min(j, k), max(j, k)
            at = 2 * (first * n - first * (first - 1) // 2 + second - first)
            store(target, at, load_complex(target, at) - y * mask)


@compiled
def estimate_inputs(work, right, deviation, inputs, shape, low, high):
    """Write U0 = U - L X^H s, (n, runs), to `inputs`; of rows `low` to `high` of s."""
    n, runs = shape.inputs, shape.runs
    columns = runs + even(n)
    factor = deviation + BYTES * 2 * runs
    zero = pack(splat(0.0), splat(0.0))
    for run in range(0, 2 * runs, 2):
        for j in range(n):
            t = zero
            for i in range(low, high):
                x = load_complex(factor, 2 * (i * columns + j))
                t = fma_conjugate(x, load_complex(deviation, 2 * i * columns + run), t)
            store(work.panel, 2 * j, t)
        for i in range(n):
            u = zero - load_complex(right, 2 * i * columns + run)
            for j in range(i + 1):
                lower = load_complex(right, 2 * (i * columns + runs + j))
                u = fma(lower, load_complex(work.panel, 2 * j), u)
            store(inputs, 2 * i * runs + run, u)


@inlined
def row_product(inputs, runs, i, j):
    """Return the product of two rows of inputs, the first conjugate."""
    y = pack(splat(0.0), splat(0.0))
    for run in range(0, 2 * runs, 2):
        u = load_complex(inputs, 2 * i * runs + run)
        y = fma_conjugate(u, load_complex(inputs, 2 * j * runs + run), y)
    return y


@compiled
def run_weights(work, cells, cell, shape, row):
    """Write conj(U0 U0^H) and R^H Sigma^-1 R, by row, after `run_rows`; return their address.

    They are what `apply_weights` takes. Of a row that is not negative its own U0, and 1/Sigma_ii in
    place of the inverse.
    """
    t, m = work.n, shape.outputs
    source = cells.targets + BYTES * cell * cell_length(shape)
    deviation, sigma, inverse, inputs, lifted, power, sensors = buffers(work, shape)
    if row >= 0:
        estimate_inputs(work, source + 2 * BYTES, deviation, inputs, shape, row, row + 1)
    write_power(work, inputs, shape, load(source, 0), power)
    weights = power + BYTES * 2 * t * t
    solved = weights if shape.readings == 0 else lifted
    copy_sensors(work, sensors, shape, row, solved)
    if row < 0:
        whiten_down(m, sigma, solved, t, t)
        weigh_and_solve_up(m, sigma, inverse, solved, t, t)
    else:
        weigh_rows(m, inverse, solved, t, t)
    if shape.readings != 0:
        lift(work, sensors, solved, t, 0, m, t, weights)
    return power


@inlined
def write_power(work, inputs, shape, mask, power):
    """Write conj(U0 U0^H), (t, t), zero beyond the torques."""
    n, t = shape.inputs, work.n
    for i in range(t):
        for j in range(t):
            y = pack(splat(0.0), splat(0.0))
            if i < n and j < n:
                y = row_product(inputs, shape.runs, i, j) * mask
            store(power, 2 * (i * t + j), y)
