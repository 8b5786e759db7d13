"""The likelihood of runs with noisy torques and outputs, eight lines at once.

Of a line's response x = S^T A^-1 S, errors are W = [Y B] - x [U L], with L L^H the covariance of
the torques, B L^H that of outputs with them and K what outputs have beside (see `prepare_runs`):
the first columns are e, the last X, Sigma = K + X X^H. Runs were turned by a unitary matrix so
that U is a lower triangle, too.
"""

# numba compiles what follows and infers its types:
# mypy: allow-untyped-decorators, allow-untyped-defs, allow-untyped-calls

from robotmodels.kernel.ldlt import compiled, inlined, square
from robotmodels.kernel.memory import load, load_complex, store
from robotmodels.kernel.simd import BYTES, fma, fma_conjugate, pack, splat
from robotmodels.kernel.solve import motor_response


@inlined
def even(count):
    """Return the next even number: tiles are of two by two."""
    return count + count % 2


@inlined
def cell_length(n, runs):
    """Return the vectors that a cell keeps: which lines count, -[U L], [Y B] and K."""
    wide = even(n)
    return 2 + 2 * wide * (2 * (runs + wide) + wide)


@inlined
def corners(source, at, below):
    """Return two entries and the two below them."""
    first, second = load_complex(source, at), load_complex(source, at + 2)
    return first, second, load_complex(source, below), load_complex(source, below + 2)


@compiled
def write_response(work, target, wide):
    """Write x to `target`, (wide, wide)."""
    for i in range(work.n):
        for j in range(i, work.n):
            response = motor_response(work, i, j)
            store(target, 2 * (i * wide + j), response)
            store(target, 2 * (j * wide + i), response)


@compiled
def deviations(work, source, runs, target):
    """Write W to `target`, (wide, runs + wide); `source` is the address of a cell."""
    n, wide, x = work.n, even(work.n), work.scratch
    columns = runs + wide
    write_response(work, x, wide)
    right, left = source + 2 * BYTES, source + BYTES * (2 + 2 * wide * columns)
    for k in range(0, columns, 2):
        first = min(k if k < runs else k - runs, n)
        for i in range(0, wide, 2):
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
def error_covariance(work, source, runs, deviation, target):
    """Write the lower triangle of Sigma to `target`, (wide, wide)."""
    n, wide = work.n, even(work.n)
    columns = runs + wide
    beside, X = source + BYTES * (2 + 4 * wide * columns), deviation + 2 * BYTES * runs
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
def factor_covariance(work, sigma, inverse, row_wise):
    """Turn Sigma into minus the unit triangle below its diagonal, with 1/D at `inverse`."""
    n, wide = work.n, even(work.n)
    zero, one = splat(0.0), splat(1.0)
    for j in range(n):
        scale = one / load(sigma, 2 * j * (wide + 1))
        store(inverse, j, scale)
        if row_wise:
            continue
        for i in range(j + 1, n):
            lower = load_complex(sigma, 2 * (i * wide + j)) * (zero - scale)
            for k in range(j + 1, i + 1):
                at = 2 * (i * wide + k)
                column = load_complex(sigma, 2 * (k * wide + j))
                store(sigma, at, fma_conjugate(column, lower, load_complex(sigma, at)))
        for i in range(j + 1, n):
            at = 2 * (i * wide + j)
            store(sigma, at, load_complex(sigma, at) * (zero - scale))


@compiled
def whiten_down(n, wide, sigma, errors, columns, runs):
    """Solve L z = e in place, columns of `errors` (., columns)."""
    for j in range(n):
        for i in range(j + 1, n):
            lower = load_complex(sigma, 2 * (i * wide + j))
            for k in range(0, 2 * runs, 2):
                at = 2 * i * columns + k
                z = load_complex(errors, 2 * j * columns + k)
                store(errors, at, fma(lower, z, load_complex(errors, at)))


@compiled
def weigh_and_solve_up(n, wide, sigma, inverse, errors, columns, runs):
    """Solve L^H s = D^-1 z in place."""
    for j in range(n - 1, -1, -1):
        scale = load(inverse, j)
        for k in range(0, 2 * runs, 2):
            y = load_complex(errors, 2 * j * columns + k) * scale
            for i in range(j + 1, n):
                lower = load_complex(sigma, 2 * (i * wide + j))
                y = fma_conjugate(lower, load_complex(errors, 2 * i * columns + k), y)
            store(errors, 2 * j * columns + k, y)


@inlined
def buffers(work, runs):
    """Return where W, Sigma and 1/D are, and what comes after them."""
    wide = even(work.n)
    deviation = work.scratch + BYTES * 2 * wide * wide
    sigma = deviation + BYTES * 2 * wide * (runs + wide)
    inverse = sigma + BYTES * 2 * wide * wide
    return deviation, sigma, inverse, inverse + BYTES * 2 * wide


@compiled
def run_squares(work, cells, cell, runs, row_wise):
    """Return the squares of whitened errors, summed over outputs and runs; e becomes L^-1 e."""
    n, wide = work.n, even(work.n)
    columns = runs + wide
    source = cells.targets + BYTES * cell * cell_length(n, runs)
    deviation, sigma, inverse, _ = buffers(work, runs)
    deviations(work, source, runs, deviation)
    error_covariance(work, source, runs, deviation, sigma)
    factor_covariance(work, sigma, inverse, row_wise)
    if not row_wise:
        whiten_down(n, wide, sigma, deviation, columns, runs)
    total = splat(0.0)
    for i in range(n):
        part = splat(0.0)
        for k in range(0, 2 * runs, 2):
            part = part + square(load_complex(deviation, 2 * i * columns + k))
        total = fma(part, load(inverse, i), total)
    return total * load(source, 0)


@compiled
def run_rows(work, cells, cell, runs, row_wise):
    """Write the slope of V by the response as the residual's row, with roots of one; return V.

    dV = -2 Re sum dx_ij conj(P_ij), P = s U0^H, s = Sigma^-1 e, which takes the place of e.
    """
    n, columns = work.n, runs + even(work.n)
    source = cells.targets + BYTES * cell * cell_length(n, runs)
    squares = run_squares(work, cells, cell, runs, row_wise)
    deviation, sigma, inverse, inputs = buffers(work, runs)
    if row_wise:
        for i in range(n):
            for k in range(0, 2 * runs, 2):
                at = 2 * i * columns + k
                store(deviation, at, load_complex(deviation, at) * load(inverse, i))
    else:
        weigh_and_solve_up(n, columns - runs, sigma, inverse, deviation, columns, runs)
    elements = n * (n + 1) // 2
    slope = work.rows + BYTES * 2 * work.m * elements
    for e in range(0, 2 * elements, 2):
        store(slope, e, pack(splat(0.0), splat(0.0)))
        store(work.roots, e, pack(splat(1.0), splat(0.0)))
    for only in range(0 if row_wise else -1, n if row_wise else 0):
        estimate_inputs(work, source + 2 * BYTES, deviation, inputs, runs, only)
        add_slopes(work, deviation, inputs, runs, only, load(source, 0), slope)
    return squares


@compiled
def add_slopes(work, solved, inputs, runs, row, mask, target):
    """Subtract P, merged to elements i <= j, from `target`; one row of it if not negative."""
    n, columns = work.n, runs + even(work.n)
    for k in range(row if row >= 0 else 0, row + 1 if row >= 0 else n):
        for j in range(n):
            y = pack(splat(0.0), splat(0.0))
            for run in range(0, 2 * runs, 2):
                u = load_complex(inputs, 2 * j * runs + run)
                y = fma_conjugate(u, load_complex(solved, 2 * k * columns + run), y)
            low, high = min(j, k), max(j, k)
            at = 2 * (low * n - low * (low - 1) // 2 + high - low)
            store(target, at, load_complex(target, at) - y * mask)


@compiled
def estimate_inputs(work, right, deviation, inputs, runs, row):
    """Write U0 = U - L X^H s, (n, runs), to `inputs`; of one row of s if not negative."""
    n, columns = work.n, runs + even(work.n)
    factor = deviation + BYTES * 2 * runs
    zero = pack(splat(0.0), splat(0.0))
    low, high = (row, row + 1) if row >= 0 else (0, n)
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
def run_weights(work, cells, cell, runs, row):
    """Write conj(U0 U0^H) and Sigma^-1, (n, n) by row, after `run_rows`; return their address.

    They are what `apply_weights` takes. Of a row that is not negative its own U0, and 1/Sigma_ii in
    place of the inverse.
    """
    n, wide = work.n, even(work.n)
    source = cells.targets + BYTES * cell * cell_length(n, runs)
    deviation, sigma, inverse, inputs = buffers(work, runs)
    if row >= 0:
        estimate_inputs(work, source + 2 * BYTES, deviation, inputs, runs, row)
    power = inputs + BYTES * 2 * wide * runs
    inverses = power + BYTES * 2 * n * n
    zero, one = pack(splat(0.0), splat(0.0)), pack(splat(1.0), splat(0.0))
    for i in range(n):
        for j in range(n):
            y = row_product(inputs, runs, i, j)
            store(power, 2 * (i * n + j), y * load(source, 0))
            store(inverses, 2 * (i * n + j), one if i == j and row < 0 else zero)
    if row >= 0:
        store(inverses, 2 * row * (n + 1), one * load(inverse, row))
    else:
        whiten_down(n, wide, sigma, inverses, n, n)
        weigh_and_solve_up(n, wide, sigma, inverse, inverses, n, n)
    return power
