"""Fisher information of spring networks, eight frequencies at once.

A spring's derivative of the FRF is of rank one, dG/d ln k_s = w^2 k_s v_s v_s^T, and a damper's is
j w c_s/k_s times that. So with P_st the weighted product of v_s v_s^T and v_t v_t^T, the sums over
frequency of Re P, w Im P and w^2 Re P hold every spring and damper entry.
"""

# numba compiles what follows and infers its types:
# mypy: allow-untyped-decorators, allow-untyped-defs, allow-untyped-calls

from robotmodels.kernel_factor import compiled, entry, inlined, square
from robotmodels.kernel_solve import motor_response, pack_position, solve
from robotmodels.simd import (
    LANES,
    fma,
    fma_conjugate,
    integer,
    lane_sum,
    load,
    load_complex,
    maximum,
    pack,
    put,
    scalar,
    splat,
    store,
)


@compiled
def weigh(work, relative, floor, mask):
    """Write w^4 over the noise law's variance of each element of G, in which w^4 cancels."""
    n = work.n
    largest = splat(0.0)
    e = 0
    for i in range(n):
        for j in range(i, n):
            size = square(motor_response(work, i, j))
            largest = maximum(size, largest)
            store(work.weights, e, size)
            e += 1
    largest = largest * splat(floor * floor)
    e = 0
    for i in range(n):
        for j in range(i, n):
            variance = fma(load(work.weights, e), splat(relative * relative), largest)
            share = mask if i == j else mask + mask
            store(work.weights, e, share / variance)
            e += 1


@compiled
def elongate(work):
    """Write v = X^T a of every needed spring and the products v_i v_j."""
    n, driven, e = work.n, work.size - work.n, 0
    Y, v, wide = work.receptance, work.elongation, work.wide
    for s in range(work.m):
        a, b = integer(work.needed, 3 * s + 1), integer(work.needed, 3 * s + 2)
        for j in range(n):
            y = load_complex(Y, a * wide + 2 * j)
            if b >= 0:
                y = y - load_complex(Y, b * wide + 2 * j)
            if b == -2:
                y = y * load_complex(work.wind, 6 * (a - driven) + 2)
            y = y * load_complex(work.wind, 6 * j)
            if b == -2 and a == driven + j:
                y = y - load_complex(work.wind, 6 * j + 4)
            store(v, 2 * (s * n + j), y)
        for i in range(n):
            x = load_complex(v, 2 * (s * n + i))
            for j in range(i, n):
                store(work.products, 2 * e, x * load_complex(v, 2 * (s * n + j)))
                e += 1


@inlined
def accumulate(total, s, t, product, w):
    """Add a pair's product to its three sums."""
    place = 3 * (s * (s + 1) // 2 + t)
    slope = product.real * w
    store(total, place, load(total, place) + product.real)
    store(total, place + 1, fma(product.imag, w, load(total, place + 1)))
    store(total, place + 2, fma(slope, w, load(total, place + 2)))


@compiled
def multiply(work, elements, w):
    """Add this vector of frequencies to the sums."""
    products, panel, total = work.products, work.weighted, work.sums
    zero = pack(splat(0.0), splat(0.0))
    m = work.m
    whole = m - m % 3
    for t in range(0, whole, 3):
        f0 = 2 * t * elements
        f1, f2 = f0 + 2 * elements, f0 + 4 * elements
        for e in range(elements):
            weight = load(work.weights, e)
            store(panel, 6 * e, load_complex(products, f0 + 2 * e) * weight)
            store(panel, 6 * e + 2, load_complex(products, f1 + 2 * e) * weight)
            store(panel, 6 * e + 4, load_complex(products, f2 + 2 * e) * weight)
        multiply_diagonal(work, t, elements, w)
        for s in range(t + 3, whole, 3):
            multiply_block(work, s, t, elements, w)
        for s in range(whole, m):
            x00, x01, x02 = zero, zero, zero
            for e in range(elements):
                a = load_complex(products, 2 * (s * elements + e))
                x00 = fma_conjugate(a, load_complex(panel, 6 * e), x00)
                x01 = fma_conjugate(a, load_complex(panel, 6 * e + 2), x01)
                x02 = fma_conjugate(a, load_complex(panel, 6 * e + 4), x02)
            accumulate(total, s, t, x00, w)
            accumulate(total, s, t + 1, x01, w)
            accumulate(total, s, t + 2, x02, w)
    for s in range(whole, m):
        for t in range(whole, s + 1):
            x00 = zero
            for e in range(elements):
                b = load_complex(products, 2 * (t * elements + e)) * load(work.weights, e)
                x00 = fma_conjugate(load_complex(products, 2 * (s * elements + e)), b, x00)
            accumulate(total, s, t, x00, w)


@inlined
def multiply_block(work, s, t, elements, w):
    """Add the products of three springs with three others, whose panel is ready."""
    products, panel, total = work.products, work.weighted, work.sums
    zero = pack(splat(0.0), splat(0.0))
    g0 = 2 * s * elements
    g1, g2 = g0 + 2 * elements, g0 + 4 * elements
    x00, x01, x02 = zero, zero, zero
    x10, x11, x12 = zero, zero, zero
    x20, x21, x22 = zero, zero, zero
    for e in range(elements):
        p0 = load_complex(panel, 6 * e)
        p1 = load_complex(panel, 6 * e + 2)
        p2 = load_complex(panel, 6 * e + 4)
        a = load_complex(products, g0 + 2 * e)
        x00 = fma_conjugate(a, p0, x00)
        x01 = fma_conjugate(a, p1, x01)
        x02 = fma_conjugate(a, p2, x02)
        a = load_complex(products, g1 + 2 * e)
        x10 = fma_conjugate(a, p0, x10)
        x11 = fma_conjugate(a, p1, x11)
        x12 = fma_conjugate(a, p2, x12)
        a = load_complex(products, g2 + 2 * e)
        x20 = fma_conjugate(a, p0, x20)
        x21 = fma_conjugate(a, p1, x21)
        x22 = fma_conjugate(a, p2, x22)
    accumulate(total, s, t, x00, w)
    accumulate(total, s, t + 1, x01, w)
    accumulate(total, s, t + 2, x02, w)
    accumulate(total, s + 1, t, x10, w)
    accumulate(total, s + 1, t + 1, x11, w)
    accumulate(total, s + 1, t + 2, x12, w)
    accumulate(total, s + 2, t, x20, w)
    accumulate(total, s + 2, t + 1, x21, w)
    accumulate(total, s + 2, t + 2, x22, w)


@inlined
def multiply_diagonal(work, t, elements, w):
    """Add the products of three springs among themselves, their panel being ready."""
    products, panel, total = work.products, work.weighted, work.sums
    zero = splat(0.0)
    x00, x11, x22 = zero, zero, zero
    x10, x20, x21 = pack(zero, zero), pack(zero, zero), pack(zero, zero)
    for e in range(elements):
        p0, p1 = load_complex(panel, 6 * e), load_complex(panel, 6 * e + 2)
        p2 = load_complex(panel, 6 * e + 4)
        a0 = load_complex(products, 2 * (t * elements + e))
        a1 = load_complex(products, 2 * ((t + 1) * elements + e))
        a2 = load_complex(products, 2 * ((t + 2) * elements + e))
        x00 = fma(a0.imag, p0.imag, fma(a0.real, p0.real, x00))
        x11 = fma(a1.imag, p1.imag, fma(a1.real, p1.real, x11))
        x22 = fma(a2.imag, p2.imag, fma(a2.real, p2.real, x22))
        x10, x20 = fma_conjugate(a1, p0, x10), fma_conjugate(a2, p0, x20)
        x21 = fma_conjugate(a2, p1, x21)
    accumulate(total, t, t, pack(x00, zero), w)
    accumulate(total, t + 1, t + 1, pack(x11, zero), w)
    accumulate(total, t + 2, t + 2, pack(x22, zero), w)
    accumulate(total, t + 1, t, x10, w)
    accumulate(total, t + 2, t, x20, w)
    accumulate(total, t + 2, t + 1, x21, w)


@compiled
def finish(work, q, information):
    """Turn the sums of position `q` into its (p, p) information at that address."""
    m, p, block = work.m, work.p, work.block
    stiffness = work.spring_stiffness + 8 * q * work.s
    damping = work.spring_damping + 8 * q * work.s
    for i in range(m):
        s = integer(work.needed, 3 * i)
        k, c = scalar(stiffness, s), scalar(damping, s)
        for j in range(i + 1):
            t = integer(work.needed, 3 * j)
            place = 3 * (i * (i + 1) // 2 + j)
            slope = 2.0 * lane_sum(load(work.sums, place + 1))
            springs = 2.0 * k * scalar(stiffness, t) * lane_sum(load(work.sums, place))
            dampers = 2.0 * c * scalar(damping, t) * lane_sum(load(work.sums, place + 2))
            put_pair(block, 2 * m, i, j, springs)
            put_pair(block, 2 * m, m + i, m + j, dampers)
            put_pair(block, 2 * m, i, m + j, -k * scalar(damping, t) * slope)
            if i != j:
                put_pair(block, 2 * m, j, m + i, scalar(stiffness, t) * c * slope)
    for e in range(2 * m * p):
        put(work.half, e, 0.0)
    for e in range(p * p):
        put(information, e, 0.0)
    for i in range(2 * m):
        row = exponent_row(work, q, i)
        for a in range(p):
            x = scalar(row, a)
            if x != 0.0:
                for j in range(2 * m):
                    old = scalar(work.half, j * p + a)
                    put(work.half, j * p + a, old + scalar(block, j * 2 * m + i) * x)
    for i in range(2 * m):
        row = exponent_row(work, q, i)
        for a in range(p):
            x = scalar(row, a)
            if x != 0.0:
                for b in range(p):
                    old = scalar(information, a * p + b)
                    put(information, a * p + b, old + x * scalar(work.half, i * p + b))


@inlined
def put_pair(matrix, width, i, j, x):
    """Write a symmetric entry."""
    put(matrix, i * width + j, x)
    put(matrix, j * width + i, x)


@inlined
def exponent_row(work, q, i):
    """Return the address of the exponents of needed stiffness `i`, or damping `i - m`."""
    spring = integer(work.needed, 3 * (i % work.m)) + (0 if i < work.m else work.s)
    return work.exponents + 8 * work.p * (2 * q * work.s + spring)


@entry
def informations(work, omega, mask, frequencies, relative, floor, start, stop, out):
    """Write the (p, p) information of positions `start` to `stop` to the address `out`."""
    for q in range(start, stop):
        pack_position(work, q)
        for place in range(3 * work.m * (work.m + 1) // 2):
            store(work.sums, place, splat(0.0))
        for b in range(-(-frequencies // LANES)):
            w = load(omega, b)
            solve(work, q, w)
            weigh(work, relative, floor, load(mask, b))
            elongate(work)
            multiply(work, work.n * (work.n + 1) // 2, w)
        finish(work, q, out + 8 * q * work.p * work.p)
