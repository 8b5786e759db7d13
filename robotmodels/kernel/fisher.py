"""Fisher information of spring networks, eight frequencies at once.

Where the noise covariance is a Kronecker product, with weights U over inputs and Y over outputs,
the product of the rank-one sensitivities of two springs is that of two small inner products:
v_s^H (U v_t) times v_s^H (Y v_t). Where six motors are measured, as on most robots, and the noise
is independent, h_i = conj(v_si) v_ti gives the product h^T W h, W the symmetric matrix of the
elements' weights: a tenth fewer operations than `sensitivity_products`, and nothing is stored on
the way, but the six h have to stay in registers, so they are spelled out.
"""

# numba compiles what follows and infers its types:
# mypy: allow-untyped-decorators, allow-untyped-defs, allow-untyped-calls

import numpy as np

from robotmodels.kernel.compiling import compiled, entry, inlined
from robotmodels.kernel.ldlt import square
from robotmodels.kernel.memory import load, load_complex, store, store_scalar
from robotmodels.kernel.sensitivity_products import (
    accumulate,
    add,
    fill_block,
    outer_products,
    pair_offset,
    project,
    spring_elongations,
    zero_sums,
)
from robotmodels.kernel.simd import BYTES, LANES, fma, fma_conjugate, maximum, pack, splat
from robotmodels.kernel.solve import motor_response, pack_position, solve
from robotmodels.kernel.vector_math import inverse_root

_TWICE = float(np.sqrt(2.0))


@compiled
def relative_weights(work, relative, floor, mask, squared):
    """Write w^2 over the noise law's standard deviation of each element of G, w^2 cancelled.

    Or its square. Element i, j > i counts for its mirror image too: `mask` is one, or zero to leave
    out a lane.
    """
    n = work.n
    largest, e = splat(0.0), 0
    for i in range(n):
        for j in range(i, n):
            size = square(motor_response(work, i, j))
            largest = maximum(size, largest)
            store(work.roots, e, size)
            e += 2
    largest, e = largest * splat(floor * floor), 0
    for i in range(n):
        for j in range(i, n):
            variance = fma(load(work.roots, e), splat(relative * relative), largest)
            share = mask if i == j else mask * splat(_TWICE)
            scale = inverse_root(variance) * share
            store(work.roots, e, scale * scale if squared else scale)
            e += 2


@entry
def informations(work, omega, mask, frequencies, relative, floor, start, stop, out):
    """Write the (p, p) information of positions `start` to `stop` to the address `out`."""
    size, six = work.p * work.p, work.n == MOTORS
    for q in range(start, stop):
        pack_position(work, q)
        zero_sums(work)
        for b in range(-(-frequencies // LANES)):
            w = load(omega, b)
            solve(work, q, w)
            relative_weights(work, relative, floor, load(mask, b), six)
            spring_elongations(work, w)
            if six:
                accumulate_six(work, w)
            else:
                outer_products(work, True)
                accumulate(work, work.m, w, False)
        springs = 8 * q * work.s
        fill_block(work, work.spring_stiffness + springs, work.spring_damping + springs, False)
        for e in range(size):
            store_scalar(out, q * size + e, 0.0)
        project(work, q, out + 8 * q * size)


MOTORS = 6


@inlined
def product(a, b, weights):
    """Return h^T W h of the elongations at `a` and `b`.

    `weights` is the address of W by rows i <= j, twice off the diagonal, every second vector.
    """
    zero = pack(splat(0.0), splat(0.0))
    h0 = fma_conjugate(load_complex(a, 0), load_complex(b, 0), zero)
    h1 = fma_conjugate(load_complex(a, 2), load_complex(b, 2), zero)
    h2 = fma_conjugate(load_complex(a, 4), load_complex(b, 4), zero)
    h3 = fma_conjugate(load_complex(a, 6), load_complex(b, 6), zero)
    h4 = fma_conjugate(load_complex(a, 8), load_complex(b, 8), zero)
    h5 = fma_conjugate(load_complex(a, 10), load_complex(b, 10), zero)
    y0 = fma(h1, load(weights, 2), h0 * load(weights, 0))
    y0 = fma(h3, load(weights, 6), fma(h2, load(weights, 4), y0))
    y0 = fma(h5, load(weights, 10), fma(h4, load(weights, 8), y0))
    y1 = fma(h2, load(weights, 14), h1 * load(weights, 12))
    y1 = fma(h4, load(weights, 18), fma(h3, load(weights, 16), y1))
    y1 = fma(h5, load(weights, 20), y1)
    y2 = fma(h3, load(weights, 24), h2 * load(weights, 22))
    y2 = fma(h5, load(weights, 28), fma(h4, load(weights, 26), y2))
    y3 = fma(h4, load(weights, 32), h3 * load(weights, 30))
    y3 = fma(h5, load(weights, 34), y3)
    y4 = fma(h5, load(weights, 38), h4 * load(weights, 36))
    y5 = h5 * load(weights, 40)
    even = fma(h4, y4, fma(h2, y2, h0 * y0))
    odd = fma(h5, y5, fma(h3, y3, h1 * y1))
    return even + odd


@compiled
def accumulate_six(work, w):
    """Add the products of all pairs of springs at the frequencies `w`; `work.roots` holds W."""
    for s in range(work.m):
        a = work.elongation + BYTES * work.wide * s
        for t in range(s + 1):
            p = product(a, work.elongation + BYTES * work.wide * t, work.roots)
            none = splat(0.0)
            add(work.sums + BYTES * pair_offset(s, t), (p.real, p.imag, none, none), w, False)


@compiled
def apply_weights(work, weights, part):
    """Write U v (`part` 0) or Y v (1) of every needed spring; U or Y, by row, is at `weights`."""
    n, zero = work.n, pack(splat(0.0), splat(0.0))
    for s in range(work.m):
        v, out = s * work.wide, 4 * n * s + 2 * n * part
        for i in range(n):
            y = zero
            for j in range(n):
                weight = load_complex(weights, 2 * (n * i + j))
                y = fma(weight, load_complex(work.elongation, v + 2 * j), y)
            store(work.rows, out + 2 * i, y)


@inlined
def inner(work, s, t, part):
    """Return the inner products of springs s and s + 1 with the weighted springs t and t + 1.

    Four at once, as no multiplication then waits for the one before it.
    """
    n = work.n
    a, b = work.elongation + BYTES * s * work.wide, work.rows + BYTES * 2 * n * (2 * t + part)
    c, d = a + BYTES * work.wide, b + BYTES * 4 * n
    o = pack(splat(0.0), splat(0.0))
    p, q, r, u = o, o, o, o
    for i in range(0, 2 * n, 2):
        x, y = load_complex(a, i), load_complex(c, i)
        f, g = load_complex(b, i), load_complex(d, i)
        p, q = fma_conjugate(x, f, p), fma_conjugate(x, g, q)
        r, u = fma_conjugate(y, f, r), fma_conjugate(y, g, u)
    return p, q, r, u


@inlined
def parts(x, y):
    """Return the product of two inner products as `add` takes it."""
    z = x * y
    return z.real, z.imag, splat(0.0), splat(0.0)


@compiled
def accumulate_pairs(work, w, sums):
    """Add the products of all pairs of springs at the frequencies `w` to the sums there."""
    target = sums
    for s in range(0, work.m, 2):
        for t in range(0, s + 1, 2):
            p, q, r, u = inner(work, s, t, 0)
            e, f, g, h = inner(work, s, t, 1)
            add(target, parts(p, e), w, False)
            add(target + 4 * BYTES, parts(q, f), w, False)
            add(target + 8 * BYTES, parts(r, g), w, False)
            add(target + 12 * BYTES, parts(u, h), w, False)
            target += 16 * BYTES
