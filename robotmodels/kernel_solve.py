"""Solve the elastic robot's equations at eight frequencies at once.

A = K - w^2 M + j w D is complex symmetric. With a positive real part of jw times it, its
factorisation A = L D L^T needs no pivoting; where a pivot comes out small all the same, that
frequency is solved again with pivoting. Only the rows of A^-1 that springs need are formed.
"""

# mypy: allow-untyped-decorators, allow-untyped-defs, allow-untyped-calls (numba has no types)

from typing import NamedTuple

import numpy as np
from numba import njit

from robotmodels.arrays import Array, ComplexArray, IntArray
from robotmodels.kernel_layout import BLOCK, Layout
from robotmodels.simd import (
    LANES,
    aligned,
    any_negative,
    fma,
    load,
    load_complex,
    maximum,
    minimum,
    pack,
    splat,
    store,
)

SMALL_PIVOT = 1e-4
"""A pivot smaller than this share of its row's largest entry: solve with pivoting."""


class Structure(NamedTuple):
    """A `Layout` as numba takes it."""

    order: IntArray
    pad: int
    first: int
    motors: IntArray
    gears: Array
    inner: IntArray
    needed: IntArray


class Skeleton(NamedTuple):
    """A network's arrays, positions first."""

    mass: Array
    damping: Array
    stiffness: Array
    spring_stiffness: Array
    spring_damping: Array


class Work(NamedTuple):
    """What one thread computes in; vectors but for `packed`, `bounds` and `dense`.

    packed : (3, rows of the triangle) mass, damping, stiffness of one position, by row.
    bounds : (3, size) largest off-diagonal entry of each row of the three.
    matrix : triangle of A, then of the unscaled factor L D.
    diagonal : A's diagonal.
    off : largest off-diagonal magnitude of each row.
    inverse : -1/D.
    panel : three columns of -L.
    receptance : rows of A^-1, columns of the driven coordinates.
    wind : per motor, gear * rho; 1 - rho; gear/z (see `motor_terms`).
    worst : the guard.
    dense : (size, size + n) the matrix of one lane and its right-hand sides.
    """

    packed: Array
    bounds: Array
    matrix: Array
    diagonal: Array
    off: Array
    inverse: Array
    panel: Array
    receptance: Array
    wind: Array
    worst: Array
    dense: ComplexArray


def structure(plan: Layout) -> Structure:
    """Return `plan` as numba takes it."""
    return Structure(
        plan.order, plan.pad, plan.first, plan.motors, plan.gears, plan.inner, plan.needed
    )


def columns(n: int) -> int:
    """Return the number of right-hand sides, whole blocks, for `n` motors."""
    return -(-n // BLOCK) * BLOCK


def work(plan: Layout) -> Work:
    """Return buffers for one thread."""
    size, n = len(plan.order), len(plan.motors)
    entries = size * (size + 1) // 2
    return Work(
        packed=np.zeros((3, entries)),
        bounds=np.zeros((3, size)),
        matrix=aligned(2 * entries),
        diagonal=aligned(2 * size),
        off=aligned(size),
        inverse=aligned(2 * size),
        panel=aligned(2 * BLOCK * size),
        receptance=aligned(2 * size * columns(n)),
        wind=aligned(6 * n),
        worst=aligned(1),
        dense=np.zeros((size, size + n), dtype=complex),
    )


@njit
def square(z):
    """Return |z|^2."""
    return fma(z.real, z.real, z.imag * z.imag)


@njit
def negative_inverse(z):
    """Return -1/z."""
    scale = splat(-1.0) / square(z)
    return pack(z.real * scale, (splat(0.0) - z.imag) * scale)


@njit
def inverse(z):
    """Return 1/z."""
    scale = splat(1.0) / square(z)
    return pack(z.real * scale, (splat(0.0) - z.imag) * scale)


@njit
def pack_position(network, plan, work, q):
    """Write the triangles of mass, damping and stiffness at position `q`, inner springs added."""
    size = len(plan.order)
    packed = work.packed
    packed[:] = 0.0
    for i in range(size):
        a, start = plan.order[i], i * (i + 1) // 2
        if a < 0:
            packed[2, start + i] = 1.0
            continue
        for j in range(plan.pad, i + 1):
            b = plan.order[j]
            packed[0, start + j] = network.mass[q, a, b]
            packed[1, start + j] = network.damping[q, a, b]
            packed[2, start + j] = network.stiffness[q, a, b]
    for s, i, j in plan.inner:
        add_spring(packed[1], network.spring_damping[q, s], i, j)
        add_spring(packed[2], network.spring_stiffness[q, s], i, j)


@njit
def add_spring(triangle, x, i, j):
    """Add `x` to a packed symmetric matrix where a spring joins rows `i` and `j` (or ground)."""
    triangle[i * (i + 1) // 2 + i] += x
    if j >= 0:
        triangle[j * (j + 1) // 2 + j] += x
        high, low = max(i, j), min(i, j)
        triangle[high * (high + 1) // 2 + low] -= x


@njit
def bound_rows(packed, bounds, size):
    """Write the largest off-diagonal magnitude of each row of packed symmetric matrices."""
    bounds[:] = 0.0
    for t in range(3):
        for i in range(size):
            for j in range(i):
                x = abs(packed[t, i * (i + 1) // 2 + j])
                bounds[t, i] = max(bounds[t, i], x)
                bounds[t, j] = max(bounds[t, j], x)


@njit
def motor_terms(network, plan, work, q, w):
    """Eliminate the motors, and add what is left of their springs to the diagonal.

    With b = -w^2 J + jwd of the motor, s = k + jwc of its spring and z = b + s, the motor is
    rho = s/z of its arm side, and the arm side feels s (1 - rho) = s b/z: no difference of
    nearly equal numbers.
    """
    n = len(plan.motors)
    for i in range(n):
        m, s = plan.motors[i]
        gear = splat(plan.gears[i])
        if m < 0:
            store(work.wind, 6 * i, pack(gear, splat(0.0)))
            store(work.wind, 6 * i + 2, pack(splat(0.0), splat(0.0)))
            store(work.wind, 6 * i + 4, pack(splat(0.0), splat(0.0)))
            continue
        w2 = splat(0.0) - w * w
        rest = pack(
            fma(w2, splat(network.mass[q, m, m]), splat(network.stiffness[q, m, m])),
            w * splat(network.damping[q, m, m]),
        )
        spring = pack(
            splat(network.spring_stiffness[q, s]), w * splat(network.spring_damping[q, s])
        )
        z = inverse(rest + spring)
        slip = rest * z
        row = 2 * (len(plan.order) - n + i)
        store(work.wind, 6 * i, spring * z * gear)
        store(work.wind, 6 * i + 2, slip)
        store(work.wind, 6 * i + 4, z * gear)
        store(work.diagonal, row, fma(spring, slip, load_complex(work.diagonal, row)))


@njit
def assemble(network, plan, work, q, w):
    """Write A at the frequencies `w` (a vector) and eliminate the motors."""
    size, packed = len(plan.order), work.packed
    w2 = splat(0.0) - w * w
    for i in range(size):
        start = i * (i + 1) // 2
        for j in range(plan.pad, i + 1):
            e = start + j
            value = pack(fma(w2, splat(packed[0, e]), splat(packed[2, e])), w * splat(packed[1, e]))
            if i == j:
                store(work.diagonal, 2 * i, value)
            else:
                store(work.matrix, 2 * e, value)
        bounds = work.bounds
        stiff = fma(w * w, splat(bounds[0, i]), splat(bounds[2, i]))
        store(work.off, i, fma(w, splat(bounds[1, i]), stiff))
    for i in range(plan.pad):
        store(work.diagonal, 2 * i, pack(splat(1.0), splat(0.0)))
    motor_terms(network, plan, work, q, w)


@njit
def factor(source, size, pad, work):
    """Factorise the matrix `source` with the diagonal apart; return the guard.

    In blocks of three columns from left to right; `work.matrix` (which may be `source`) gets L D,
    `work.inverse` -1/D. A lane of the guard below zero marks a small pivot.
    """
    out, panel = work.matrix, work.panel
    worst = splat(1.0)
    for b in range(0, size, 3):
        worst, i0, l10, l20, l21 = factor_diagonal(source, b, pad, work, worst)
        for i in range(b + 3, size, 3):
            r0 = 2 * (i * (i + 1) // 2)
            r1 = r0 + 2 * (i + 1)
            r2 = r1 + 2 * (i + 2)
            c = 2 * b
            x00, x01, x02 = (
                load_complex(source, r0 + c),
                load_complex(source, r0 + c + 2),
                load_complex(source, r0 + c + 4),
            )
            x10, x11, x12 = (
                load_complex(source, r1 + c),
                load_complex(source, r1 + c + 2),
                load_complex(source, r1 + c + 4),
            )
            x20, x21, x22 = (
                load_complex(source, r2 + c),
                load_complex(source, r2 + c + 2),
                load_complex(source, r2 + c + 4),
            )
            for k in range(pad, b):
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
            store(out, r0 + c, x00)
            store(out, r0 + c + 2, x01)
            store(out, r0 + c + 4, x02)
            store(out, r1 + c, x10)
            store(out, r1 + c + 2, x11)
            store(out, r1 + c + 4, x12)
            store(out, r2 + c, x20)
            store(out, r2 + c + 2, x21)
            store(out, r2 + c + 4, x22)
    return worst


@njit
def factor_diagonal(source, b, pad, work, worst):
    """Factorise the diagonal block at row `b` and prepare its panel; return what rows below need.

    Entries of L are negative here, as in the panel.
    """
    out, panel = work.matrix, work.panel
    r0 = 2 * (b * (b + 1) // 2)
    r1 = r0 + 2 * (b + 1)
    r2 = r1 + 2 * (b + 2)
    x00 = load_complex(work.diagonal, 2 * b)
    x11 = load_complex(work.diagonal, 2 * b + 2)
    x22 = load_complex(work.diagonal, 2 * b + 4)
    big0, big1, big2 = square(x00), square(x11), square(x22)
    x10 = load_complex(source, r1 + 2 * b)
    x20 = load_complex(source, r2 + 2 * b)
    x21 = load_complex(source, r2 + 2 * b + 2)
    for k in range(pad, b):
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
    i0 = negative_inverse(x00)
    l10, l20 = x10 * i0, x20 * i0
    x11, x21, x22 = fma(x10, l10, x11), fma(x20, l10, x21), fma(x20, l20, x22)
    i1 = negative_inverse(x11)
    l21 = x21 * i1
    x22 = fma(x21, l21, x22)
    store(work.inverse, 2 * b, i0)
    store(work.inverse, 2 * b + 2, i1)
    store(work.inverse, 2 * b + 4, negative_inverse(x22))
    store(out, r1 + 2 * b, x10)
    store(out, r2 + 2 * b, x20)
    store(out, r2 + 2 * b + 2, x21)
    worst = guard(worst, x00, big0, load(work.off, b))
    worst = guard(worst, x11, big1, load(work.off, b + 1))
    worst = guard(worst, x22, big2, load(work.off, b + 2))
    return worst, i0, l10, l20, l21


@njit
def guard(worst, pivot, diagonal, off):
    """Return `worst`, below zero where |pivot| is small beside its row."""
    limit = maximum(off * off, diagonal) * splat(-SMALL_PIVOT * SMALL_PIVOT)
    return minimum(square(pivot) + limit, worst)


@njit
def back_substitute(size, first, n, work):
    """Write rows `first` and later of A^-1, columns of the last `n` rows (the driven ones).

    Y = D^-1 L^-1 + (I - L^T) Y, from the last row up; the driven block is symmetric.
    """
    matrix, Y = work.matrix, work.receptance
    wide = 2 * BLOCK * ((n + BLOCK - 1) // BLOCK)
    zero = pack(splat(0.0), splat(0.0))
    for i in range(size - 1, first - 1, -1):
        own = i - (size - n)
        scale = load_complex(work.inverse, 2 * i)
        start = max(own, 0) // BLOCK * 2 * BLOCK
        for c in range(start, wide, 2 * BLOCK):
            y0, y1, y2 = zero, zero, zero
            for k in range(i + 1, size):
                a = load_complex(matrix, k * (k + 1) + 2 * i)
                y0 = fma(a, load_complex(Y, k * wide + c), y0)
                y1 = fma(a, load_complex(Y, k * wide + c + 2), y1)
                y2 = fma(a, load_complex(Y, k * wide + c + 4), y2)
            store(Y, i * wide + c, y0 * scale)
            store(Y, i * wide + c + 2, y1 * scale)
            store(Y, i * wide + c + 4, y2 * scale)
        if own >= 0:
            y0 = zero
            for j in range(own + 1, n):
                k = size - n + j
                y1 = load_complex(Y, i * wide + 2 * j)
                store(Y, k * wide + 2 * own, y1)
                y0 = fma(load_complex(matrix, k * (k + 1) + 2 * i), y1, y0)
            store(Y, i * wide + 2 * own, y0 * scale - scale)


@njit
def solve_lane(source, size, first, n, work, lane):
    """Solve one lane again, `source` being A's triangle and the diagonal apart, with pivoting.

    Gauss with row pivoting, pivots judged relative to their row's largest entry.
    """
    dense = work.dense
    dense[:] = 0.0
    for i in range(size):
        for j in range(i + 1):
            place = LANES * (2 * j if i != j else 2 * i) + lane
            buffer = work.diagonal if i == j else source
            place += 0 if i == j else LANES * i * (i + 1)
            dense[i, j] = dense[j, i] = complex(buffer[place], buffer[place + LANES])
    for j in range(n):
        dense[size - n + j, size + j] = 1.0
    for i in range(size):
        largest = 0.0
        for c in range(size):
            largest = max(largest, abs(dense[i, c]))
        for c in range(size + n):
            dense[i, c] /= largest
    for k in range(size):
        best = k
        for i in range(k + 1, size):
            if abs(dense[i, k]) > abs(dense[best, k]):
                best = i
        for c in range(k, size + n):
            dense[k, c], dense[best, c] = dense[best, c], dense[k, c]
        for i in range(k + 1, size):
            ratio = dense[i, k] / dense[k, k]
            for c in range(k, size + n):
                dense[i, c] -= ratio * dense[k, c]
    wide = 2 * BLOCK * ((n + BLOCK - 1) // BLOCK)
    for i in range(size - 1, first - 1, -1):
        for j in range(n):
            y = dense[i, size + j]
            for k in range(i + 1, size):
                y -= dense[i, k] * dense[k, size + j]
            dense[i, size + j] = y / dense[i, i]
            place = LANES * (i * wide + 2 * j) + lane
            work.receptance[place] = dense[i, size + j].real
            work.receptance[place + LANES] = dense[i, size + j].imag


@njit
def solve(network, plan, work, q, w):
    """Write the needed rows of A^-1 at position `q` (packed before) and frequencies `w`."""
    size, n = len(plan.order), len(plan.motors)
    assemble(network, plan, work, q, w)
    worst = factor(work.matrix, size, plan.pad, work)
    back_substitute(size, plan.first, n, work)
    if any_negative(worst):
        store(work.worst, 0, worst)
        assemble(network, plan, work, q, w)
        for lane in range(LANES):
            if work.worst[lane] < 0.0:
                solve_lane(work.matrix, size, plan.first, n, work, lane)


@njit
def motor_response(plan, work, i, j):
    """Return element i, j of S^T A^-1 S of the whole robot: motor angle per motor torque."""
    n = len(plan.motors)
    wide = 2 * BLOCK * ((n + BLOCK - 1) // BLOCK)
    y = load_complex(work.receptance, (len(plan.order) - n + i) * wide + 2 * j)
    x = load_complex(work.wind, 6 * i) * y * load_complex(work.wind, 6 * j)
    if i == j:
        x = x + load_complex(work.wind, 6 * i + 4) * splat(plan.gears[i])
    return x


@njit(cache=True, nogil=True)
def responses(network, plan, omega, work, start, stop, out):
    """Write G at positions `start` to `stop`; `omega` holds whole vectors, `out` fewer if padded."""
    n, frequencies = len(plan.motors), out.shape[1]
    for q in range(start, stop):
        pack_position(network, plan, work, q)
        bound_rows(work.packed, work.bounds, len(plan.order))
        for b in range(len(omega) // LANES):
            w = load(omega, b)
            solve(network, plan, work, q, w)
            for i in range(n):
                for j in range(i + 1):
                    g = motor_response(plan, work, i, j) * (splat(0.0) - w * w)
                    store(work.panel, 0, g)
                    for lane in range(min(LANES, frequencies - b * LANES)):
                        value = complex(work.panel[lane], work.panel[LANES + lane])
                        out[q, b * LANES + lane, i, j] = value
                        out[q, b * LANES + lane, j, i] = value
