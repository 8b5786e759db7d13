"""Fisher information where the noise covariance is a Kronecker product of inputs and outputs.

With the weights U over inputs and Y over outputs, the product of the rank-one sensitivities of two
springs is that of two small inner products: v_s^H (U v_t) times v_s^H (Y v_t).
"""

# numba compiles what follows and infers its types:
# mypy: allow-untyped-decorators, allow-untyped-defs, allow-untyped-calls

from robotmodels.kernel.factor import SOURCES, compiled, entry, inlined
from robotmodels.kernel.gram import add, clear, elongate, fill_block, project
from robotmodels.kernel.memory import load, load_complex, put, scalar, store
from robotmodels.kernel.simd import BYTES, LANES, fma, fma_conjugate, pack, splat
from robotmodels.kernel.solve import pack_position, solve


@compiled
def gather(work, source, at, frequencies, weights):
    """Write (n, n) complex matrices of eight frequencies as vectors, zero beyond the last one.

    `source` is where the doubles of (F, n, n, 2) begin, `at` the first of the eight.
    """
    entries = 2 * work.n * work.n
    for e in range(entries):
        for lane in range(LANES):
            f = at + lane
            x = scalar(source, f * entries + e) if f < frequencies else 0.0
            put(weights, e * LANES + lane, x)


@compiled
def turn(work, weights):
    """Write U v and Y v of every needed spring; U and Y, by row, are at `weights`."""
    n, zero = work.n, pack(splat(0.0), splat(0.0))
    for s in range(work.m):
        v, out = s * work.wide, 4 * n * s
        for i in range(2 * n):
            y = zero
            for j in range(n):
                weight = load_complex(weights, 2 * (n * i + j))
                y = fma(weight, load_complex(work.elongation, v + 2 * j), y)
            store(work.rows, out + 2 * i, y)


@inlined
def inner(work, s, t, part):
    """Return the inner products of springs s and s + 1 with the turned springs t and t + 1.

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
def accumulate_pairs(work, w):
    """Add the products of all pairs of springs at the frequencies `w` to their sums."""
    place = work.sums
    for s in range(0, work.m, 2):
        for t in range(0, s + 1, 2):
            p, q, r, u = inner(work, s, t, 0)
            e, f, g, h = inner(work, s, t, 1)
            add(place, parts(p, e), w, False)
            add(place + 4 * BYTES, parts(q, f), w, False)
            add(place + 8 * BYTES, parts(r, g), w, False)
            add(place + 12 * BYTES, parts(u, h), w, False)
            place += 16 * BYTES


@compiled
def _separable_informations(work, omega, inputs, outputs, weights, frequencies, start, stop, out):
    """Write the (p, p) information of positions `start` to `stop` to the address `out`.

    `inputs` and `outputs` are the addresses of complex (Q, F, n, n), each with the bytes from one
    position to the next; `weights` is that of a buffer of 4 n^2 vectors.
    """
    size, blocks = work.p * work.p, -(-frequencies // LANES)
    upper = weights + BYTES * 2 * work.n * work.n
    for q in range(start, stop):
        pack_position(work, q)
        clear(work)
        for b in range(blocks):
            w = load(omega, b)
            solve(work, q, w)
            elongate(work, w)
            gather(work, inputs[0] + inputs[1] * q, b * LANES, frequencies, weights)
            gather(work, outputs[0] + outputs[1] * q, b * LANES, frequencies, upper)
            turn(work, weights)
            accumulate_pairs(work, w)
        springs = 8 * q * work.s
        fill_block(work, work.spring_stiffness + springs, work.spring_damping + springs, False)
        for e in range(size):
            put(out, q * size + e, 0.0)
        project(work, q, out + 8 * q * size)


def _cached(sources):
    @entry
    def run(*arguments):
        if len(sources) > 0:
            _separable_informations(*arguments)

    return run


separable_informations = _cached(SOURCES)
