"""Rank-one sensitivities: the elongations of free springs by each motor, eight lines at once."""

# numba compiles what follows and infers its types:
# mypy: allow-untyped-decorators, allow-untyped-defs, allow-untyped-calls

from robotmodels.kernel.compiling import entry
from robotmodels.kernel.memory import load, scalar, store_scalar
from robotmodels.kernel.sensitivity_products import spring_elongations
from robotmodels.kernel.simd import LANES
from robotmodels.kernel.solve import pack_position, solve


@entry
def elongations(work, omega, frequencies, start, stop, out):
    """Write v of positions `start` to `stop`, complex (Q, F, m, n), to the address `out`."""
    m, n = work.m, work.n
    for q in range(start, stop):
        pack_position(work, q)
        for b in range(-(-frequencies // LANES)):
            w = load(omega, b)
            solve(work, q, w)
            spring_elongations(work, w)
            for lane in range(min(LANES, frequencies - b * LANES)):
                target = 2 * m * n * (q * frequencies + b * LANES + lane)
                for s in range(m):
                    for e in range(2 * n):
                        x = scalar(work.elongation, (s * work.wide + e) * LANES + lane)
                        store_scalar(out, target + 2 * n * s + e, x)
