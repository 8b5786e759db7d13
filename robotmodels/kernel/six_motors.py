"""Products of the sensitivities of springs where six motors are measured: most robots.

With h_i = conj(v_si) v_ti of springs s and t, their product is h^T W h, W the symmetric matrix of
the elements' weights. That takes a tenth fewer operations than `gram` and nothing is stored on the
way, but the six h have to stay in registers: it is spelled out for their number.
"""

# numba compiles what follows and infers its types:
# mypy: allow-untyped-decorators, allow-untyped-defs, allow-untyped-calls

from robotmodels.kernel.factor import compiled, inlined
from robotmodels.kernel.gram import add, pair_place
from robotmodels.kernel.memory import load, load_complex
from robotmodels.kernel.simd import BYTES, fma, fma_conjugate, pack, splat

MOTORS = 6


@inlined
def product(a, b, weights):
    """Return h^T W h of the elongations at `a` and `b`.

    `weights` is the address of W by rows i <= j, twice off the diagonal, one place in two.
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
            add(work.sums + BYTES * pair_place(s, t), (p.real, p.imag, none, none), w, False)
