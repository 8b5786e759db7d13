"""Fisher information of spring networks, eight frequencies at once."""

# numba compiles what follows and infers its types:
# mypy: allow-untyped-decorators, allow-untyped-defs, allow-untyped-calls

import numpy as np

from robotmodels.kernel.bits import inverse_root
from robotmodels.kernel.factor import SOURCES, compiled, entry, square
from robotmodels.kernel.gram import accumulate, clear, elongate, fill_block, project, spread
from robotmodels.kernel.memory import load, put, store
from robotmodels.kernel.simd import LANES, fma, maximum, splat
from robotmodels.kernel.six_motors import MOTORS, accumulate_six
from robotmodels.kernel.solve import motor_response, pack_position, solve

_TWICE = float(np.sqrt(2.0))


@compiled
def weigh(work, relative, floor, mask, squared):
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


@compiled
def _informations(work, omega, mask, frequencies, relative, floor, start, stop, out):
    """Write the (p, p) information of positions `start` to `stop` to the address `out`."""
    size, six = work.p * work.p, work.n == MOTORS
    for q in range(start, stop):
        pack_position(work, q)
        clear(work)
        for b in range(-(-frequencies // LANES)):
            w = load(omega, b)
            solve(work, q, w)
            weigh(work, relative, floor, load(mask, b), six)
            elongate(work, w)
            if six:
                accumulate_six(work, w)
            else:
                spread(work, True)
                accumulate(work, work.m, w, False)
        springs = 8 * q * work.s
        fill_block(work, work.spring_stiffness + springs, work.spring_damping + springs, False)
        for e in range(size):
            put(out, q * size + e, 0.0)
        project(work, q, out + 8 * q * size)


def _cached(sources):
    @entry
    def run(*arguments):
        if len(sources) > 0:
            _informations(*arguments)

    return run


informations = _cached(SOURCES)
