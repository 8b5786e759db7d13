"""Products of the sensitivities of all pairs of springs, eight frequencies at once.

A spring's derivative of the FRF is of rank one, dG/d ln k_s = w^2 k_s v_s v_s^T, and a damper's is
j w c_s/k_s times that. So with a_s the weighted elements of v_s v_s^T, the products of real and
imaginary parts of a_s and a_t, summed over frequency with powers of w, hold every entry that
springs and dampers have in a Fisher information or a Gauss-Newton matrix. Friction and inertia of
a coordinate are spring and damper of its rate.
"""

# numba compiles what follows and infers its types:
# mypy: allow-untyped-decorators, allow-untyped-defs, allow-untyped-calls

from robotmodels.kernel.compiling import compiled, inlined
from robotmodels.kernel.elimination_order import INERTANCE, MOTOR, MOTOR_INERTANCE
from robotmodels.kernel.memory import integer, load, load_complex, scalar, store, store_scalar
from robotmodels.kernel.simd import BYTES, fma, lane_sum, pack, root, splat
from robotmodels.kernel.solve import motor_response


@compiled
def spring_elongations(work, w):
    """Write v = X^T a of every needed spring, and of an inertance its rate, sqrt(j w) X^T e."""
    driven, wide = work.size - work.n, work.wide
    rate = root(splat(0.5) * w)
    for s in range(work.m):
        a, b = integer(work.needed, 3 * s + 1), integer(work.needed, 3 * s + 2)
        first, second, out = a * wide, b * wide, s * wide
        if b == MOTOR_INERTANCE:
            scale = rate * splat(1.0 / scalar(work.gears, a - driven))
            for j in range(work.n):
                response = motor_response(work, min(a - driven, j), max(a - driven, j))
                store(work.elongation, out + 2 * j, response * pack(scale, scale))
            continue
        factor = pack(splat(1.0), splat(0.0))
        if b == MOTOR:
            factor = load_complex(work.wind, 6 * (a - driven) + 2)
        elif b == INERTANCE:
            factor = pack(rate, rate)
        for j in range(0, 2 * work.n, 2):
            y = load_complex(work.receptance, first + j)
            if b >= 0:
                y = y - load_complex(work.receptance, second + j)
            y = y * load_complex(work.wind, 3 * j)
            store(work.elongation, out + j, y * factor)
        if b == MOTOR:
            index = out + 2 * (a - driven)
            gone = load_complex(work.wind, 6 * (a - driven) + 4)
            store(work.elongation, index, load_complex(work.elongation, index) - gone)


@inlined
def outer_products(work, real):
    """Write a_s, the elements i <= j of v_s v_s^T times the `roots` of their weights.

    If `real`, only the real part of each stored root is used.
    """
    n, v, entry = work.n, work.elongation, 0
    for s in range(work.m):
        e = 0
        for i in range(n):
            x = load_complex(v, s * work.wide + 2 * i)
            for j in range(i, n):
                y = x * load_complex(v, s * work.wide + 2 * j)
                y = y * load(work.roots, e) if real else y * load_complex(work.roots, e)
                store(work.rows, entry, y)
                entry += 2
                e += 2


@inlined
def tile(work, s, t):
    """Return the products of rows s and s + 1 with t and t + 1: real and imaginary parts, 4 each.

    Sixteen sums stay in registers, and no multiplication waits for the one before it.
    """
    length = work.n * (work.n + 1)
    a, b = work.rows + BYTES * length * s, work.rows + BYTES * length * t
    c, d = a + BYTES * length, b + BYTES * length
    o = splat(0.0)
    p0, p1, p2, p3, q0, q1, q2, q3 = o, o, o, o, o, o, o, o
    r0, r1, r2, r3, s0, s1, s2, s3 = o, o, o, o, o, o, o, o
    for e in range(0, length, 2):
        x, y = load(a, e), load(a, e + 1)
        f, g = load(b, e), load(b, e + 1)
        p0, p1, p2, p3 = fma(x, f, p0), fma(x, g, p1), fma(y, f, p2), fma(y, g, p3)
        h, k = load(d, e), load(d, e + 1)
        q0, q1, q2, q3 = fma(x, h, q0), fma(x, k, q1), fma(y, h, q2), fma(y, k, q3)
        x, y = load(c, e), load(c, e + 1)
        r0, r1, r2, r3 = fma(x, f, r0), fma(x, g, r1), fma(y, f, r2), fma(y, g, r3)
        s0, s1, s2, s3 = fma(x, h, s0), fma(x, k, s1), fma(y, h, s2), fma(y, k, s3)
    return (p0, p1, p2, p3), (q0, q1, q2, q3), (r0, r1, r2, r3), (s0, s1, s2, s3)


@inlined
def half_tile(work, s, t):
    """Return the products of row s with t and t + 1, as `tile` does."""
    length = work.n * (work.n + 1)
    a, b = work.rows + BYTES * length * s, work.rows + BYTES * length * t
    d = b + BYTES * length
    o = splat(0.0)
    p0, p1, p2, p3, q0, q1, q2, q3 = o, o, o, o, o, o, o, o
    for e in range(0, length, 2):
        x, y = load(a, e), load(a, e + 1)
        f, g = load(b, e), load(b, e + 1)
        p0, p1, p2, p3 = fma(x, f, p0), fma(x, g, p1), fma(y, f, p2), fma(y, g, p3)
        f, g = load(d, e), load(d, e + 1)
        q0, q1, q2, q3 = fma(x, f, q0), fma(x, g, q1), fma(y, f, q2), fma(y, g, q3)
    return (p0, p1, p2, p3), (q0, q1, q2, q3)


@inlined
def add(target, parts, w, real):
    """Add the products of two rows to their sums.

    With P the product that conjugates the first: Re P, w Im P and w^2 Re P, in the last of four
    places. Where only the real part of k a_s + j w c a_s counts (`real`): all four products, each
    on its own.
    """
    both, across, back, other = parts
    if real:
        store(target, 2, fma(back, w, load(target, 2)))
    else:
        both = both + other
        across, other = across - back, both
    store(target, 0, load(target, 0) + both)
    store(target, 1, fma(across, w, load(target, 1)))
    store(target, 3, fma(other * w, w, load(target, 3)))


@inlined
def pair_offset(s, t):
    """Return where the sums of rows s and t are; their tile must not lie above the diagonal."""
    a, b = s // 2, t // 2
    return 16 * (a * (a + 1) // 2 + b) + 8 * (s % 2) + 4 * (t % 2)


@compiled
def accumulate(work, count, w, real):
    """Add the products of all pairs of the first `count` rows at the frequencies `w`."""
    target = work.sums
    for s in range(0, count - 1, 2):
        for t in range(0, s + 1, 2):
            p, q, r, u = tile(work, s, t)
            add(target, p, w, real)
            add(target + 4 * BYTES, q, w, real)
            add(target + 8 * BYTES, r, w, real)
            add(target + 12 * BYTES, u, w, real)
            target += 16 * BYTES
    if count % 2 == 1:
        for t in range(0, count, 2):
            p, q = half_tile(work, count - 1, t)
            add(target, p, w, real)
            add(target + 4 * BYTES, q, w, real)
            target += 16 * BYTES


@compiled
def accumulate_last(work, last, w, real):
    """Add the products of row `last` with those before it, which is all a gradient needs."""
    for t in range(0, last, 2):
        p, q = half_tile(work, last, t)
        target = work.sums + BYTES * pair_offset(last, t)
        add(target, p, w, real)
        add(target + 4 * BYTES, q, w, real)


@compiled
def zero_sums(work):
    """Set the sums to zero."""
    pairs = (work.m + 2) // 2
    for index in range(8 * pairs * (pairs + 1)):
        store(work.sums, index, splat(0.0))


@compiled
def fill_block(work, stiffness, damping, real):
    """Turn the sums into twice the products by ln k and ln c, (2 m, 2 m).

    `real` as of `add`; `stiffness` and `damping` are the addresses of a position's first and
    second coefficients.
    """
    m, block = work.m, work.block
    for i in range(m):
        s = integer(work.needed, 3 * i)
        k, c = 2.0 * scalar(stiffness, s), 2.0 * scalar(damping, s)
        for j in range(i + 1):
            t = integer(work.needed, 3 * j)
            other_k, other_c = scalar(stiffness, t), scalar(damping, t)
            offset = pair_offset(i, j)
            store_pair(block, 2 * m, i, j, k * other_k * lane_sum(load(work.sums, offset)))
            across = lane_sum(load(work.sums, offset + 1))
            back = lane_sum(load(work.sums, offset + 2)) if real else -across
            store_pair(block, 2 * m, i, m + j, -k * other_c * across)
            if i != j:
                store_pair(block, 2 * m, j, m + i, -c * other_k * back)
            dampers = c * other_c * lane_sum(load(work.sums, offset + 3))
            store_pair(block, 2 * m, m + i, m + j, dampers)


@inlined
def store_pair(matrix, width, i, j, x):
    """Write a symmetric entry."""
    store_scalar(matrix, i * width + j, x)
    store_scalar(matrix, j * width + i, x)


@compiled
def list_exponents(work, q):
    """List the exponents that are not zero at position `q`: coefficient, parameter, value."""
    count = 0
    for i in range(2 * work.m):
        row = exponent_row(work, q, i)
        for a in range(work.p):
            x = scalar(row, a)
            if x != 0.0:
                store_scalar(work.listed, 3 * count, float(i))
                store_scalar(work.listed, 3 * count + 1, float(a))
                store_scalar(work.listed, 3 * count + 2, x)
                count += 1
    return count


@compiled
def project(work, q, out):
    """Add the block, taken from ln k and ln c to ln theta at position `q`, to the (p, p) `out`."""
    p, block, width = work.p, work.block, 2 * work.m
    for e in range(list_exponents(work, q)):
        i, a = int(scalar(work.listed, 3 * e)), int(scalar(work.listed, 3 * e + 1))
        x = scalar(work.listed, 3 * e + 2)
        entry = a * (p + 1)
        store_scalar(out, entry, scalar(out, entry) + x * x * scalar(block, i * (width + 1)))
        for f in range(e):
            j, b = int(scalar(work.listed, 3 * f)), int(scalar(work.listed, 3 * f + 1))
            y = x * scalar(work.listed, 3 * f + 2) * scalar(block, i * width + j)
            store_scalar(out, a * p + b, scalar(out, a * p + b) + y)
            store_scalar(out, b * p + a, scalar(out, b * p + a) + y)


@inlined
def exponent_row(work, q, i):
    """Return the address of the exponents of needed stiffness `i`, or damping `i - m`."""
    spring = integer(work.needed, 3 * (i % work.m)) + (0 if i < work.m else work.s)
    return work.exponents + 8 * (q * work.exponents_step + work.p * spring)
