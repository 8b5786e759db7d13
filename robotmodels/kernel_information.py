"""Fisher information of spring networks, eight frequencies at once.

A spring's derivative of the FRF is of rank one, dG/d ln k_s = w^2 k_s v_s v_s^T, and a damper's is
j w c_s/k_s times that. So with P_st the weighted product of v_s v_s^T and v_t v_t^T, the sums over
frequency of Re P, w Im P and w^2 Re P hold every spring and damper entry.
"""

# numba compiles what follows and infers its types:
# mypy: allow-untyped-decorators, allow-untyped-defs, allow-untyped-calls

from robotmodels.kernel_factor import SOURCES, compiled, entry, inlined, square
from robotmodels.kernel_memory import integer, load, load_complex, put, scalar, store
from robotmodels.kernel_solve import motor_response, pack_position, solve
from robotmodels.simd import BYTES, LANES, fma, fma_conjugate, lane_sum, maximum, pack, splat


@compiled
def weigh(work, relative, floor, mask):
    """Write w^4 over the noise law's variance of each element of G, in which w^4 cancels.

    Element i, j > i counts for its mirror image too; i, j < i is never read.
    """
    n, wide = work.n, work.wide // 2
    largest = splat(0.0)
    for i in range(n):
        for j in range(i, n):
            size = square(motor_response(work, i, j))
            largest = maximum(size, largest)
            store(work.weights, i * wide + j, size)
    largest = largest * splat(floor * floor)
    for i in range(n):
        for j in range(i, n):
            variance = fma(load(work.weights, i * wide + j), splat(relative * relative), largest)
            share = mask if i == j else mask + mask
            store(work.weights, i * wide + j, share / variance)


@compiled
def elongate(work):
    """Write v = X^T a of every needed spring."""
    driven, wide = work.size - work.n, work.wide
    for s in range(work.m):
        a, b = integer(work.needed, 3 * s + 1), integer(work.needed, 3 * s + 2)
        first, second, out = a * wide, b * wide, s * wide
        for j in range(0, 2 * work.n, 2):
            y = load_complex(work.receptance, first + j)
            if b >= 0:
                y = y - load_complex(work.receptance, second + j)
            store(work.elongation, out + j, y * load_complex(work.wind, 3 * j))
        if b == -2:
            slip = load_complex(work.wind, 6 * (a - driven) + 2)
            for j in range(0, 2 * work.n, 2):
                store(work.elongation, out + j, load_complex(work.elongation, out + j) * slip)
            own = out + 2 * (a - driven)
            gone = load_complex(work.wind, 6 * (a - driven) + 4)
            store(work.elongation, own, load_complex(work.elongation, own) - gone)


@inlined
def mix(work, s, t):
    """Write conj(v_s) v_t and conj(v_s) v_(t + 1)."""
    wide, v = work.wide, work.elongation
    zero = pack(splat(0.0), splat(0.0))
    for j in range(0, wide, 2):
        x = load_complex(v, s * wide + j)
        store(work.mixed, 2 * j, fma_conjugate(x, load_complex(v, t * wide + j), zero))
        store(work.mixed, 2 * j + 2, fma_conjugate(x, load_complex(v, (t + 1) * wide + j), zero))


@inlined
def products(work):
    """Return P_st and P_s(t + 1), the weighted products of v_s v_s^T with two others, from `mix`.

    sum_ij W_ij conj(v_si v_sj) v_ti v_tj is a quadratic form in conj(v_s) v_t: the rank-one
    matrices themselves are never formed, and all that is read stays in the fastest cache. Two at
    a time keep both multipliers busy.
    """
    mixed, columns = work.mixed, work.wide // 2
    zero = pack(splat(0.0), splat(0.0))
    p, q = zero, zero
    for a in range(0, columns, 3):
        x0, y0 = load_complex(mixed, 4 * a), load_complex(mixed, 4 * a + 2)
        x1, y1 = load_complex(mixed, 4 * a + 4), load_complex(mixed, 4 * a + 6)
        x2, y2 = load_complex(mixed, 4 * a + 8), load_complex(mixed, 4 * a + 10)
        w0 = work.weights + BYTES * a * columns
        w1 = w0 + BYTES * columns
        w2 = w1 + BYTES * columns
        w = load(w0, a)
        u0, r0 = x0 * w, y0 * w
        w = load(w0, a + 1)
        u0, r0 = fma(x1, w, u0), fma(y1, w, r0)
        w = load(w0, a + 2)
        u0, r0 = fma(x2, w, u0), fma(y2, w, r0)
        w = load(w1, a + 1)
        u1, r1 = x1 * w, y1 * w
        w = load(w1, a + 2)
        u1, r1 = fma(x2, w, u1), fma(y2, w, r1)
        w = load(w2, a + 2)
        u2, r2 = x2 * w, y2 * w
        for b in range(a + 3, columns):
            x, y = load_complex(mixed, 4 * b), load_complex(mixed, 4 * b + 2)
            w = load(w0, b)
            u0, r0 = fma(x, w, u0), fma(y, w, r0)
            w = load(w1, b)
            u1, r1 = fma(x, w, u1), fma(y, w, r1)
            w = load(w2, b)
            u2, r2 = fma(x, w, u2), fma(y, w, r2)
        p, q = fma(x0, u0, p), fma(y0, r0, q)
        p, q = fma(x1, u1, p), fma(y1, r1, q)
        p, q = fma(x2, u2, p), fma(y2, r2, q)
    return p, q


@compiled
def accumulate(work, w):
    """Add the products of all pairs of springs at the frequencies `w` to their three sums.

    Rows of the triangle are filled up to even lengths; what is one too many is never read.
    """
    place = work.sums
    for s in range(work.m):
        for t in range(0, s + 1, 2):
            mix(work, s, t)
            p, q = products(work)
            add(place, p, w)
            add(place + 3 * BYTES, q, w)
            place += 6 * BYTES


@inlined
def add(place, p, w):
    """Add a product to its three sums."""
    slope = p.real * w
    store(place, 0, load(place, 0) + p.real)
    store(place, 1, fma(p.imag, w, load(place, 1)))
    store(place, 2, fma(slope, w, load(place, 2)))


@inlined
def row_start(s):
    """Return how many pairs come before row `s` of the triangle, rows of even length."""
    return 2 * ((s + 1) // 2) * ((s + 2) // 2)


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
            place = 3 * (row_start(i) + j)
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


@compiled
def _informations(work, omega, mask, frequencies, relative, floor, start, stop, out):
    """Write the (p, p) information of positions `start` to `stop` to the address `out`."""
    for q in range(start, stop):
        pack_position(work, q)
        for place in range(3 * row_start(work.m)):
            store(work.sums, place, splat(0.0))
        for b in range(-(-frequencies // LANES)):
            w = load(omega, b)
            solve(work, q, w)
            weigh(work, relative, floor, load(mask, b))
            elongate(work)
            accumulate(work, w)
        finish(work, q, out + 8 * q * work.p * work.p)


def _cached(sources):
    @entry
    def run(*arguments):
        if len(sources) > 0:
            _informations(*arguments)

    return run


informations = _cached(SOURCES)
