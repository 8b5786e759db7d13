"""How a cost changes with the stiffness and mass matrices of the model, by the adjoint.

With dx = -X^T dA X of the motors' response, dV = -2 Re sum_(i<=j) rho_ij (X^T dA X)_ij, which is
the inner product of dA and -2 Re(X P X^T), P symmetric: one product of small matrices per
frequency, whatever changes.
"""

# numba compiles what follows and infers its types:
# mypy: allow-untyped-decorators, allow-untyped-defs, allow-untyped-calls

from robotmodels.kernel.compiling import compiled, entry
from robotmodels.kernel.gauss_newton import residual_rows
from robotmodels.kernel.memory import integer, load, load_complex, scalar, store, store_scalar
from robotmodels.kernel.simd import BYTES, fma, fma_conjugate, lane_sum, pack, splat
from robotmodels.kernel.solve import motor_response, pack_position, solve


@compiled
def unit_responses(work, columns):
    """Write X, the answer of all coordinates to the motors' torques, row by row to `columns`."""
    n = work.n
    for r in range(work.pad, work.size):
        row = 2 * n * integer(work.order, r)
        for j in range(n):
            y = load_complex(work.receptance, r * work.wide + 2 * j)
            store(columns, row + 2 * j, y * load_complex(work.wind, 6 * j))
    for i in range(n):
        motor = integer(work.motors, 3 * i)
        if motor >= 0:
            back = splat(1.0 / scalar(work.gears, i))
            for j in range(n):
                response = motor_response(work, min(i, j), max(i, j))
                store(columns, 2 * (n * motor + j), response * back)


@compiled
def element_weights(work, symmetric):
    """Write P, half of rho off the diagonal, to `symmetric`."""
    n, zero = work.n, pack(splat(0.0), splat(0.0))
    offset, e = n * (n + 1) * work.m, 0
    for i in range(n):
        for j in range(i, n):
            scale = load_complex(work.roots, e)
            rho = fma_conjugate(load_complex(work.rows, offset + e), scale, zero)
            if i != j:
                rho = rho * splat(0.5)
            store(symmetric, 2 * (n * i + j), rho)
            store(symmetric, 2 * (n * j + i), rho)
            e += 2


@compiled
def add_products(work, columns, symmetric, sums, w):
    """Add -2 Re(X P X^T), and -w^2 times that, to the sums of coordinates a >= b."""
    n, zero, index = work.n, pack(splat(0.0), splat(0.0)), 0
    for a in range(work.d):
        for j in range(n):
            y = zero
            for i in range(n):
                x = load_complex(columns, 2 * (n * a + i))
                y = fma(x, load_complex(symmetric, 2 * (n * i + j)), y)
            store(work.elongation, 2 * j, y * splat(-2.0))
        for b in range(a + 1):
            total = splat(0.0)
            for j in range(n):
                y = load_complex(work.elongation, 2 * j)
                x = load_complex(columns, 2 * (n * b + j))
                total = fma(y.real, x.real, total) - y.imag * x.imag
            store(sums, index, load(sums, index) + total)
            store(sums, index + 1, load(sums, index + 1) - total * w * w)
            index += 2


@entry
def slopes(work, cells, options, columns, sums, start, stop, out):
    """Write dV/dK and dV/dM of positions `start` to `stop`, doubles (Q, 2, d, d) at `out`.

    `work` is of the full layout, all its rows needed; `columns` (2 n (d + n)) and `sums`
    (d (d + 1)) are buffers of vectors.
    """
    _, blocks, _, residual, shape = options
    d = work.d
    symmetric = columns + BYTES * 2 * d * work.n
    for q in range(start, stop):
        pack_position(work, q)
        k, c = work.spring_stiffness + 8 * work.s * q, work.spring_damping + 8 * work.s * q
        for index in range(d * (d + 1)):
            store(sums, index, splat(0.0))
        for cell in range(q * blocks, (q + 1) * blocks):
            w = load(cells.omega, cell)
            solve(work, q, w)
            residual_rows(work, cells, cell, k, c, residual, shape)
            unit_responses(work, columns)
            element_weights(work, symmetric)
            add_products(work, columns, symmetric, sums, w)
        index = 0
        for a in range(d):
            for b in range(a + 1):
                for part in range(2):
                    x = lane_sum(load(sums, index + part))
                    store_scalar(out, ((2 * q + part) * d + a) * d + b, x)
                    store_scalar(out, ((2 * q + part) * d + b) * d + a, x)
                index += 2
