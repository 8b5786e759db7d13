"""Fisher information of many excitations of a position, eight frequencies at once.

With weights U over inputs and the inverse of V over outputs, as in `fisher`. A position is solved
and V is factorised once for all of them, and so is what diagonal U share, motors in independent
phases: of springs s and t the products conj(v_si) v_ti v_s^H V^-1 v_t of every motor i.
"""

# numba compiles what follows and infers its types:
# mypy: allow-untyped-decorators, allow-untyped-defs, allow-untyped-calls

from robotmodels.kernel.compiling import compiled, entry, inlined
from robotmodels.kernel.fisher import accumulate_pairs, apply_weights
from robotmodels.kernel.memory import integer, load, load_complex, scalar, store, store_scalar
from robotmodels.kernel.output_cells import even
from robotmodels.kernel.run_cells import factor_covariance, weigh_and_solve_up, whiten_down
from robotmodels.kernel.sensitivity_products import (
    add,
    fill_block,
    pair_offset,
    project,
    spring_elongations,
)
from robotmodels.kernel.simd import BYTES, LANES, fma, fma_conjugate, pack, splat
from robotmodels.kernel.solve import pack_position, solve


@inlined
def sums_length(work):
    """Return the vectors of one excitation's sums."""
    pairs = (work.m + 2) // 2
    return 8 * pairs * (pairs + 1)


@inlined
def load_entry(source, entry, entries, at, frequencies, beyond, target):
    """Write an entry of eight frequencies' matrices as a vector; past the last its own or zero.

    `source` is the address of doubles (F, entries), `at` the index of the first of the eight.
    """
    for lane in range(LANES):
        x = scalar(source, min(at + lane, frequencies - 1) * entries + entry)
        store_scalar(target, lane, x if beyond or at + lane < frequencies else 0.0)


@compiled
def load_weights(work, source, at, frequencies, weights):
    """Write U, (n, n) complex, zero beyond the last frequency."""
    entries = 2 * work.n * work.n
    for e in range(entries):
        load_entry(source, e, entries, at, frequencies, False, weights + BYTES * e)


@compiled
def load_powers(work, source, at, frequencies, powers):
    """Write the diagonal of U, (n,) real, zero beyond the last frequency."""
    n = work.n
    for i in range(n):
        entry = 2 * i * (n + 1)
        load_entry(source, entry, 2 * n * n, at, frequencies, False, powers + BYTES * i)


@compiled
def load_inverse(work, source, at, frequencies, w, buffers):
    """Write w^4 V^-1, of Hermitian V: accelerations are w^2 times what `solve` has."""
    weights, sigma, inverse = buffers
    n = work.n
    fourth = w * w * w * w
    for i in range(n):
        for j in range(n):
            for part in range(2):
                entry, target = 2 * (i * n + j) + part, 2 * (i * even(n) + j) + part
                target = sigma + BYTES * target
                load_entry(source, entry, 2 * n * n, at, frequencies, True, target)
                unit = 1.0 if i == j and part == 0 else 0.0
                store(weights, entry, splat(unit))
    factor_covariance(n, sigma, inverse, False)
    for i in range(n):
        store(inverse, i, load(inverse, i) * fourth)
    whiten_down(n, sigma, weights, n, n)
    weigh_and_solve_up(n, sigma, inverse, weights, n, n)


@inlined
def motor_products(work, s, t):
    """Write the products of springs s and t for each motor, complex, to the panel."""
    n = work.n
    v, x = work.elongation + BYTES * s * work.wide, work.elongation + BYTES * t * work.wide
    y, p = work.rows + BYTES * 2 * n * (2 * t + 1), pack(splat(0.0), splat(0.0))
    for i in range(0, 2 * n, 2):
        p = fma_conjugate(load_complex(v, i), load_complex(y, i), p)
    for i in range(0, 2 * n, 2):
        h = fma_conjugate(load_complex(v, i), load_complex(x, i), pack(splat(0.0), splat(0.0)))
        store(work.panel, i, h * p)


@compiled
def accumulate_diagonal(work, w, powers, sums, count):
    """Add the products of all pairs of springs under `count` diagonal U to the sums of each."""
    n, length, zero = work.n, BYTES * sums_length(work), splat(0.0)
    for s in range(work.m):
        for t in range(s + 1):
            motor_products(work, s, t)
            target, at = sums + BYTES * pair_offset(s, t), powers
            for _ in range(count):
                real, imag = zero, zero
                for i in range(n):
                    u = load(at, i)
                    real = fma(u, load(work.panel, 2 * i), real)
                    imag = fma(u, load(work.panel, 2 * i + 1), imag)
                add(target, (real, imag, zero, zero), w, False)
                target += length
                at += BYTES * n


@compiled
def add_lines(work, q, b, omega, inputs, outputs, buffers, counts, frequencies):
    """Add what eight frequencies tell under each excitation to the sums in the buffers."""
    weights, sigma, inverse, powers, sums = buffers
    w, at, n = load(omega, b), b * LANES, work.n
    diagonal, excitations = counts
    solve(work, q, w)
    spring_elongations(work, w)
    errors = outputs[0] + outputs[1] * q
    load_inverse(work, errors, at, frequencies, w, (weights, sigma, inverse))
    apply_weights(work, weights, 1)
    for e in range(diagonal):
        source = inputs[0] + inputs[1] * q + inputs[2] * e
        load_powers(work, source, at, frequencies, powers + BYTES * n * e)
    if diagonal > 0:
        accumulate_diagonal(work, w, powers, sums, diagonal)
    for e in range(diagonal, excitations):
        source = inputs[0] + inputs[1] * q + inputs[2] * e
        load_weights(work, source, at, frequencies, weights)
        apply_weights(work, weights, 0)
        accumulate_pairs(work, w, sums + BYTES * sums_length(work) * e)


@compiled
def finish_information(work, q, sums, out):
    """Turn the sums of one excitation into its (p, p) information at the address `out`."""
    springs = 8 * q * work.s
    for index in range(sums_length(work)):
        store(work.sums, index, load(sums, index))
    fill_block(work, work.spring_stiffness + springs, work.spring_damping + springs, False)
    for index in range(work.p * work.p):
        store_scalar(out, index, 0.0)
    project(work, q, out)


@entry
def excitation_informations(
    work, omega, inputs, outputs, order, buffers, counts, frequencies, start, stop, out
):
    """Write the (E, p, p) information of positions `start` to `stop` to the address `out`.

    `inputs` and `outputs` are the addresses of complex U, (E, Q, F, n, n), and V, (Q, F, n, n),
    each with the bytes from one position to the next, the former also from one excitation to the
    next. `counts` are the numbers of diagonal U, which come first, and of all; `order` has the
    place of each in `out`.
    """
    size, length, sums = 8 * work.p * work.p, sums_length(work), buffers[4]
    excitations = counts[1]
    for q in range(start, stop):
        pack_position(work, q)
        for index in range(length * excitations):
            store(sums, index, splat(0.0))
        for b in range(-(-frequencies // LANES)):
            add_lines(work, q, b, omega, inputs, outputs, buffers, counts, frequencies)
        for e in range(excitations):
            target = out + size * (q * excitations + integer(order, e))
            finish_information(work, q, sums + BYTES * length * e, target)
