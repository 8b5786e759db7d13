"""Factorise complex symmetric matrices, eight at a time, and take rows of their inverses.

A = L D L^T without pivoting, in register blocks of three rows by three columns. Triangles are
stored by row; entry i, j is the complex vector at index i (i + 1) + 2 j.
"""

# numba compiles what follows and infers its types:
# mypy: allow-untyped-decorators, allow-untyped-defs, allow-untyped-calls

import numpy as np

from robotmodels.kernel.compiling import compiled, inlined
from robotmodels.kernel.elimination_order import BLOCK
from robotmodels.kernel.memory import load, load_complex, scalar, store, store_scalar
from robotmodels.kernel.simd import BYTES, LANES, fma, maximum, minimum, pack, splat

SMALL_PIVOT = 1e-4
"""A pivot smaller than this share of its row's largest entry: solve with pivoting."""


@inlined
def square(z):
    """Return |z|^2."""
    return fma(z.real, z.real, z.imag * z.imag)


@inlined
def inverse(z, sign):
    """Return sign/z."""
    scale = splat(sign) / square(z)
    return pack(z.real * scale, (splat(0.0) - z.imag) * scale)


@inlined
def guard(worst, pivot, diagonal, off):
    """Return `worst`, below zero where |pivot| is small beside its row."""
    limit = maximum(off * off, diagonal) * splat(-SMALL_PIVOT * SMALL_PIVOT)
    return minimum(square(pivot) + limit, worst)


@compiled
def factor(work, source):
    """Factorise the matrix at `source`, its diagonal at `work.diagonal`; return the guard.

    In blocks of three columns from left to right; `work.matrix` (which may be `source`) gets L D,
    `work.inverse` -1/D. A lane of the guard below zero marks a small pivot. The next diagonal
    block is factorised, one long chain with three divisions, as early as it can be: the
    rows further down do not wait for it.
    """
    size = work.size
    here, there = work.panel, work.panel + BYTES * 6 * size
    worst, l10, l20, l21 = factor_diagonal(work, source, here, 0, splat(1.0))
    for b in range(3, size, 3):
        factor_below(work, source, here, b, b - 3, l10, l20, l21)
        worst, m10, m20, m21 = factor_diagonal(work, source, there, b, worst)
        for i in range(b + 3, size, 3):
            factor_below(work, source, here, i, b - 3, l10, l20, l21)
        l10, l20, l21 = m10, m20, m21
        here, there = there, here
    return worst


@inlined
def factor_diagonal(work, source, panel, b, worst):
    """Factorise the diagonal block at row `b` and prepare its panel; return what rows below need.

    Entries of L are negative here, as in the panel.
    """
    out = work.matrix
    r0 = b * (b + 1)
    r1 = r0 + 2 * (b + 1)
    r2 = r1 + 2 * (b + 2)
    x00 = load_complex(work.diagonal, 2 * b)
    x11 = load_complex(work.diagonal, 2 * b + 2)
    x22 = load_complex(work.diagonal, 2 * b + 4)
    big0, big1, big2 = square(x00), square(x11), square(x22)
    x10 = load_complex(source, r1 + 2 * b)
    x20 = load_complex(source, r2 + 2 * b)
    x21 = load_complex(source, r2 + 2 * b + 2)
    for k in range(work.pad, b):
        scale = load_complex(work.inverse, 2 * k)
        a0 = load_complex(out, r0 + 2 * k)
        a1 = load_complex(out, r1 + 2 * k)
        a2 = load_complex(out, r2 + 2 * k)
        p0, p1, p2 = a0 * scale, a1 * scale, a2 * scale
        store(panel, 6 * k, p0)
        store(panel, 6 * k + 2, p1)
        store(panel, 6 * k + 4, p2)
        x00, x11, x22 = fma(a0, p0, x00), fma(a1, p1, x11), fma(a2, p2, x22)
        x10, x20, x21 = fma(a1, p0, x10), fma(a2, p0, x20), fma(a2, p1, x21)
    i0 = inverse(x00, -1.0)
    l10, l20 = x10 * i0, x20 * i0
    x11, x21, x22 = fma(x10, l10, x11), fma(x20, l10, x21), fma(x20, l20, x22)
    i1 = inverse(x11, -1.0)
    l21 = x21 * i1
    x22 = fma(x21, l21, x22)
    store(work.inverse, 2 * b, i0)
    store(work.inverse, 2 * b + 2, i1)
    store(work.inverse, 2 * b + 4, inverse(x22, -1.0))
    store(out, r1 + 2 * b, x10)
    store(out, r2 + 2 * b, x20)
    store(out, r2 + 2 * b + 2, x21)
    worst = guard(worst, x00, big0, load(work.off, b))
    worst = guard(worst, x11, big1, load(work.off, b + 1))
    worst = guard(worst, x22, big2, load(work.off, b + 2))
    return worst, l10, l20, l21


@inlined
def factor_below(work, source, panel, i, b, l10, l20, l21):
    """Compute the block of L D at rows `i` and columns `b`, three of each."""
    out = work.matrix
    r0 = i * (i + 1)
    r1 = r0 + 2 * (i + 1)
    r2 = r1 + 2 * (i + 2)
    c0, c1, c2 = 2 * b, 2 * b + 2, 2 * b + 4
    x00, x01 = load_complex(source, r0 + c0), load_complex(source, r0 + c1)
    x02, x10 = load_complex(source, r0 + c2), load_complex(source, r1 + c0)
    x11, x12 = load_complex(source, r1 + c1), load_complex(source, r1 + c2)
    x20, x21 = load_complex(source, r2 + c0), load_complex(source, r2 + c1)
    x22 = load_complex(source, r2 + c2)
    for k in range(work.pad, b):
        p0 = load_complex(panel, 6 * k)
        p1 = load_complex(panel, 6 * k + 2)
        p2 = load_complex(panel, 6 * k + 4)
        a = load_complex(out, r0 + 2 * k)
        x00, x01, x02 = fma(a, p0, x00), fma(a, p1, x01), fma(a, p2, x02)
        a = load_complex(out, r1 + 2 * k)
        x10, x11, x12 = fma(a, p0, x10), fma(a, p1, x11), fma(a, p2, x12)
        a = load_complex(out, r2 + 2 * k)
        x20, x21, x22 = fma(a, p0, x20), fma(a, p1, x21), fma(a, p2, x22)
    x01, x11, x21 = fma(x00, l10, x01), fma(x10, l10, x11), fma(x20, l10, x21)
    x02, x12, x22 = fma(x00, l20, x02), fma(x10, l20, x12), fma(x20, l20, x22)
    x02, x12, x22 = fma(x01, l21, x02), fma(x11, l21, x12), fma(x21, l21, x22)
    store(out, r0 + c0, x00)
    store(out, r0 + c1, x01)
    store(out, r0 + c2, x02)
    store(out, r1 + c0, x10)
    store(out, r1 + c1, x11)
    store(out, r1 + c2, x12)
    store(out, r2 + c0, x20)
    store(out, r2 + c1, x21)
    store(out, r2 + c2, x22)


@compiled
def back_substitute(work, first):
    """Write rows `first` and later of A^-1, columns of the last n rows (the driven ones).

    Y = D^-1 L^-1 + (I - L^T) Y, from the last row up; the driven block is symmetric.
    """
    matrix, Y, wide, size = work.matrix, work.receptance, work.wide, work.size
    zero = pack(splat(0.0), splat(0.0))
    for i in range(size - 1, first - 1, -1):
        motor_row = i - (size - work.n)
        scale = load_complex(work.inverse, 2 * i)
        c = max(motor_row, 0) // BLOCK * 2 * BLOCK
        # The row just finished comes last: nothing waits for it until then.
        while c + 4 * BLOCK <= wide:
            y0, y1, y2, y3, y4, y5 = zero, zero, zero, zero, zero, zero
            for k in range(size - 1, i, -1):
                a = load_complex(matrix, k * (k + 1) + 2 * i)
                y0 = fma(a, load_complex(Y, k * wide + c), y0)
                y1 = fma(a, load_complex(Y, k * wide + c + 2), y1)
                y2 = fma(a, load_complex(Y, k * wide + c + 4), y2)
                y3 = fma(a, load_complex(Y, k * wide + c + 6), y3)
                y4 = fma(a, load_complex(Y, k * wide + c + 8), y4)
                y5 = fma(a, load_complex(Y, k * wide + c + 10), y5)
            store(Y, i * wide + c, y0 * scale)
            store(Y, i * wide + c + 2, y1 * scale)
            store(Y, i * wide + c + 4, y2 * scale)
            store(Y, i * wide + c + 6, y3 * scale)
            store(Y, i * wide + c + 8, y4 * scale)
            store(Y, i * wide + c + 10, y5 * scale)
            c += 4 * BLOCK
        if c < wide:
            y0, y1, y2 = zero, zero, zero
            for k in range(size - 1, i, -1):
                a = load_complex(matrix, k * (k + 1) + 2 * i)
                y0 = fma(a, load_complex(Y, k * wide + c), y0)
                y1 = fma(a, load_complex(Y, k * wide + c + 2), y1)
                y2 = fma(a, load_complex(Y, k * wide + c + 4), y2)
            store(Y, i * wide + c, y0 * scale)
            store(Y, i * wide + c + 2, y1 * scale)
            store(Y, i * wide + c + 4, y2 * scale)
        if motor_row >= 0:
            y0 = zero
            for j in range(motor_row + 1, work.n):
                k = size - work.n + j
                y1 = load_complex(Y, i * wide + 2 * j)
                store(Y, k * wide + 2 * motor_row, y1)
                y0 = fma(load_complex(matrix, k * (k + 1) + 2 * i), y1, y0)
            store(Y, i * wide + 2 * motor_row, y0 * scale - scale)


@compiled
def solve_lane(work, source, first, lane):
    """Solve one lane again, with pivoting; the diagonal is stored beside the triangle at `source`.

    Gauss with row pivoting, pivots judged relative to their row's largest entry.
    """
    size, n = work.size, work.n
    dense = np.zeros((size, size + n), dtype=np.complex128)
    for i in range(size):
        for j in range(i + 1):
            start = work.diagonal if i == j else source
            entry = LANES * (2 * i if i == j else i * (i + 1) + 2 * j) + lane
            dense[i, j] = complex(scalar(start, entry), scalar(start, entry + LANES))
            dense[j, i] = dense[i, j]
    for j in range(n):
        dense[size - n + j, size + j] = 1.0
    for i in range(size):
        largest = 0.0
        for c in range(size):
            largest = max(largest, abs(dense[i, c]))
        for c in range(size + n):
            dense[i, c] /= largest
    eliminate(dense, size)
    for i in range(size - 1, first - 1, -1):
        for j in range(n):
            y = dense[i, size + j]
            for k in range(i + 1, size):
                y -= dense[i, k] * dense[k, size + j]
            dense[i, size + j] = y / dense[i, i]
            entry = LANES * (i * work.wide + 2 * j) + lane
            store_scalar(work.receptance, entry, dense[i, size + j].real)
            store_scalar(work.receptance, entry + LANES, dense[i, size + j].imag)


@compiled
def eliminate(dense, size):
    """Bring the first `size` columns to upper triangular form, with row pivoting."""
    for k in range(size):
        best = k
        for i in range(k + 1, size):
            if abs(dense[i, k]) > abs(dense[best, k]):
                best = i
        for c in range(k, dense.shape[1]):
            dense[k, c], dense[best, c] = dense[best, c], dense[k, c]
        for i in range(k + 1, size):
            ratio = dense[i, k] / dense[k, k]
            for c in range(k, dense.shape[1]):
                dense[i, c] -= ratio * dense[k, c]
