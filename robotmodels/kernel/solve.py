"""Solve the elastic robot's equations at eight frequencies at once.

A = K - w^2 M + j w D is complex symmetric, and damping keeps its leading blocks from being
singular, so it is factorised without pivoting; where a pivot comes out small all the same, that
frequency is solved again with pivoting. Only the rows of A^-1 that springs need are formed.
"""

# numba compiles what follows and infers its types:
# mypy: allow-untyped-decorators, allow-untyped-defs, allow-untyped-calls

from robotmodels.kernel.compiling import compiled, entry, inlined
from robotmodels.kernel.elimination_order import INERTANCE
from robotmodels.kernel.ldlt import back_substitute, factor, inverse, solve_lane
from robotmodels.kernel.memory import integer, load, load_complex, scalar, store, store_scalar
from robotmodels.kernel.simd import LANES, any_negative, fma, pack, splat


@compiled
def pack_position(work, q):
    """Write what one position's frequencies share: packed matrices, their bounds, motors."""
    d, triangle = work.d, work.size * (work.size + 1) // 2
    tables = (
        work.mass + 8 * q * d * d,
        work.damping + 8 * q * work.damping_step,
        work.stiffness + 8 * q * d * d,
    )
    for t in range(3):
        for i in range(work.size):
            a = integer(work.order, i)
            for j in range(i + 1):
                b = integer(work.order, j)
                x = 0.0
                if b >= 0:
                    x = scalar(tables[t], a * d + b)
                elif i == j and t == 2:
                    x = 1.0
                store_scalar(work.packed, t * triangle + i * (i + 1) // 2 + j, x)
    for e in range(work.n_inner):
        s, i, j = (
            integer(work.inner, 3 * e),
            integer(work.inner, 3 * e + 1),
            integer(work.inner, 3 * e + 2),
        )
        lower = 8 * triangle if j == INERTANCE else 16 * triangle
        upper = lower - 8 * triangle
        add_spring(work.packed + lower, scalar(work.spring_stiffness, q * work.s + s), i, j)
        add_spring(work.packed + upper, scalar(work.spring_damping, q * work.s + s), i, j)
    bound_rows(work)
    pack_motors(work, q)


@compiled
def pack_motors(work, q):
    """Write the eliminated motors' mass, damping and stiffness at position `q`."""
    for i in range(work.n):
        a = integer(work.motors, 3 * i)
        if a >= 0:
            diagonal = a * (work.d + 1)
            index = q * work.d * work.d + diagonal
            store_scalar(work.arms, 3 * i, scalar(work.mass, index))
            store_scalar(
                work.arms, 3 * i + 1, scalar(work.damping, q * work.damping_step + diagonal)
            )
            store_scalar(work.arms, 3 * i + 2, scalar(work.stiffness, index))


@compiled
def add_spring(triangle, x, i, j):
    """Add `x` to a packed symmetric matrix where a spring joins rows `i` and `j` (or ground)."""
    index = i * (i + 3) // 2
    store_scalar(triangle, index, scalar(triangle, index) + x)
    if j >= 0:
        index = j * (j + 3) // 2
        store_scalar(triangle, index, scalar(triangle, index) + x)
        index = max(i, j) * (max(i, j) + 1) // 2 + min(i, j)
        store_scalar(triangle, index, scalar(triangle, index) - x)


@compiled
def bound_rows(work):
    """Write the largest off-diagonal magnitude of each row of the packed matrices."""
    size, triangle = work.size, work.size * (work.size + 1) // 2
    for t in range(3):
        start = work.bounds + 8 * t * size
        for i in range(size):
            store_scalar(start, i, 0.0)
            for j in range(i):
                x = abs(scalar(work.packed, t * triangle + i * (i + 1) // 2 + j))
                store_scalar(start, i, max(scalar(start, i), x))
                store_scalar(start, j, max(scalar(start, j), x))


@inlined
def motor_terms(work, w, stiffness, damping):
    """Eliminate the motors and add the reduced stiffness of their springs to the diagonal.

    With b = -w^2 J + jwd of the motor, s = k + jwc of its spring and z = b + s, the motor is
    rho = s/z of its arm side, and the arm side feels s (1 - rho) = s b/z: no difference of
    nearly equal numbers. `stiffness` and `damping` are the addresses of a position's
    first and second coefficients.
    """
    minus = splat(0.0) - w * w
    zero = pack(splat(0.0), splat(0.0))
    for i in range(work.n):
        s, t = integer(work.motors, 3 * i + 1), integer(work.motors, 3 * i + 2)
        gear = splat(scalar(work.gears, i))
        if s < 0:
            store(work.wind, 6 * i, pack(gear, splat(0.0)))
            store(work.wind, 6 * i + 2, zero)
            store(work.wind, 6 * i + 4, zero)
            continue
        inertia, friction = scalar(work.arms, 3 * i), scalar(work.arms, 3 * i + 1)
        if t >= 0:
            inertia += scalar(damping, t)
            friction += scalar(stiffness, t)
        support = splat(scalar(work.arms, 3 * i + 2))
        shaft = pack(fma(minus, splat(inertia), support), w * splat(friction))
        spring = pack(splat(scalar(stiffness, s)), w * splat(scalar(damping, s)))
        z = inverse(shaft + spring, 1.0)
        slip = shaft * z
        row = 2 * (work.size - work.n + i)
        store(work.wind, 6 * i, spring * z * gear)
        store(work.wind, 6 * i + 2, slip)
        store(work.wind, 6 * i + 4, z * gear)
        store(work.diagonal, row, fma(spring, slip, load_complex(work.diagonal, row)))


@compiled
def assemble_arm(work, w):
    """Write A at the frequencies `w` (a vector), without motors and their springs."""
    size, triangle = work.size, work.size * (work.size + 1) // 2
    mass, damping = work.packed, work.packed + 8 * triangle
    stiffness = work.packed + 16 * triangle
    minus = splat(0.0) - w * w
    for i in range(size):
        start = i * (i + 1) // 2
        for e in range(start, start + i):
            real = fma(minus, splat(scalar(mass, e)), splat(scalar(stiffness, e)))
            store(work.matrix, 2 * e, pack(real, w * splat(scalar(damping, e))))
        e = start + i
        real = fma(minus, splat(scalar(mass, e)), splat(scalar(stiffness, e)))
        store(work.diagonal, 2 * i, pack(real, w * splat(scalar(damping, e))))
        off = fma(w, splat(scalar(work.bounds, size + i)), splat(scalar(work.bounds, 2 * size + i)))
        store(work.off, i, fma(w * w, splat(scalar(work.bounds, i)), off))


@inlined
def assemble(work, q, w):
    """Write A at the frequencies `w` (a vector) and eliminate the motors."""
    assemble_arm(work, w)
    springs = 8 * q * work.s
    motor_terms(work, w, work.spring_stiffness + springs, work.spring_damping + springs)


@compiled
def solve(work, q, w):
    """Write the needed rows of A^-1 at position `q` (packed before) and frequencies `w`."""
    assemble(work, q, w)
    worst = factor(work, work.matrix)
    back_substitute(work, work.first)
    if any_negative(worst):
        store(work.worst, 0, worst)
        assemble(work, q, w)
        for lane in range(LANES):
            if scalar(work.worst, lane) < 0.0:
                solve_lane(work, work.matrix, work.first, lane)


@inlined
def motor_response(work, i, j):
    """Return element i, j of S^T A^-1 S of the whole robot: motor angle per motor torque."""
    y = load_complex(work.receptance, (work.size - work.n + i) * work.wide + 2 * j)
    x = load_complex(work.wind, 6 * i) * y * load_complex(work.wind, 6 * j)
    if i == j:
        x = x + load_complex(work.wind, 6 * i + 4) * splat(scalar(work.gears, i))
    return x


@entry
def responses(work, omega, frequencies, start, stop, out):
    """Write G at positions `start` to `stop`, complex (Q, F, n, n) at `out`."""
    n = work.n
    for q in range(start, stop):
        pack_position(work, q)
        for b in range(-(-frequencies // LANES)):
            w = load(omega, b)
            solve(work, q, w)
            for i in range(n):
                for j in range(i + 1):
                    store(work.panel, 0, motor_response(work, i, j) * (splat(0.0) - w * w))
                    for lane in range(min(LANES, frequencies - b * LANES)):
                        row = (q * frequencies + b * LANES + lane) * n
                        for part in range(2):
                            x = scalar(work.panel, part * LANES + lane)
                            store_scalar(out, 2 * ((row + i) * n + j) + part, x)
                            store_scalar(out, 2 * ((row + j) * n + i) + part, x)
