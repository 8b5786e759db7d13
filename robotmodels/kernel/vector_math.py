"""Logarithms, angles and inverse roots of eight numbers at once."""

# numba compiles what follows and infers its types:
# mypy: allow-untyped-decorators, allow-untyped-defs, allow-untyped-calls, allow-incomplete-defs

from collections.abc import Callable

import numpy as np
from llvmlite import ir
from numpy.polynomial import Chebyshev, Polynomial

from robotmodels.common.arrays import Array
from robotmodels.kernel.compiling import inlined
from robotmodels.kernel.simd import (
    LANES,
    VECTOR,
    Complexes,
    Reals,
    complex_of,
    emit_fma,
    fma,
    intrinsic,
    maximum,
    minimum,
    pack,
    splat,
    where_greater,
)

_LN2 = float(np.log(2.0))
_PI = float(np.pi)
_EIGHTH = float(np.tan(np.pi / 8))
_ROUND = 1.5 * 2.0**52
"""Adding and subtracting this rounds a double to an integer."""


def _polynomial(function: Callable[[Array], Array], end: float, degree: int) -> tuple[float, ...]:
    """Return coefficients, highest first, that fit `function` on [0, end]."""
    fitted = Chebyshev.interpolate(function, degree, domain=[0.0, end])
    return tuple(float(x) for x in fitted.convert(kind=Polynomial).coef[::-1])


def _series(ratio: Callable[[Array], Array]) -> Callable[[Array], Array]:
    """Return z -> f(sqrt z)/sqrt z for an odd f with f'(0) = 1."""
    return lambda z: np.where(z > 0, ratio(np.sqrt(z)) / np.sqrt(np.where(z > 0, z, 1.0)), 1.0)


_ATAN = _polynomial(_series(np.arctan), _EIGHTH**2, 12)
_ATANH = _polynomial(_series(np.arctanh), 0.02944, 8)


@inlined
def _horner(coefficients, z):
    total = splat(coefficients[0])
    for i in range(1, len(coefficients)):
        total = fma(total, z, splat(coefficients[i]))
    return total


@inlined
def half_log(a):
    """Return ln(a)/2 for positive a."""
    parts = split_exponent(a)
    f = parts.imag - splat(1.0)
    s = f / (f + splat(2.0))
    return fma(parts.real, splat(0.5 * _LN2), s * _horner(_ATANH, s * s))


@inlined
def angle(z):
    """Return the angle of z in [-pi, pi]."""
    zero = splat(0.0)
    x, y = maximum(z.real, zero - z.real), maximum(z.imag, zero - z.imag)
    low, high = minimum(x, y), maximum(x, y)
    limit = high * splat(_EIGHTH)
    above = where_greater(low, limit, low - high, low)
    t = above / where_greater(low, limit, low + high, high)
    base = where_greater(low, limit, splat(0.25 * _PI), zero)
    a = fma(t, _horner(_ATAN, t * t), base)
    a = where_greater(y, x, splat(0.5 * _PI) - a, a)
    a = where_greater(zero, z.real, splat(_PI) - a, a)
    return where_greater(zero, z.imag, zero - a, a)


@inlined
def wrap(a):
    """Return the angle `a` less whole turns, in [-pi, pi]."""
    turns = fma(a, splat(0.5 / _PI), splat(_ROUND)) - splat(_ROUND)
    return fma(turns, splat(-2.0 * _PI), a)


@inlined
def log(z):
    """Return the principal logarithm of z."""
    return pack(half_log(fma(z.real, z.real, z.imag * z.imag)), angle(z))


@intrinsic
def inverse_root(typingctx, a):
    """Return 1/sqrt of each positive lane, to a few units in the last place.

    A guess from the exponent, good to 4 %, and four steps of Newton's method take a third of the
    time of a root and a division.
    """

    def codegen(context, builder, sig, args):
        integers = ir.VectorType(ir.IntType(64), LANES)
        halved = builder.lshr(
            builder.bitcast(args[0], integers), ir.Constant(integers, [1] * LANES)
        )
        guess = builder.sub(ir.Constant(integers, [0x5FE6EB50C7B537A9] * LANES), halved)
        y = builder.bitcast(guess, VECTOR)
        half = builder.fmul(args[0], ir.Constant(VECTOR, [-0.5] * LANES))
        for _ in range(4):
            factor = emit_fma(builder, half, builder.fmul(y, y), ir.Constant(VECTOR, [1.5] * LANES))
            y = builder.fmul(y, factor)
        return y

    return Reals(Reals), codegen


@intrinsic
def split_exponent(typingctx, a):
    """Return e and m, as real and imaginary part, with a = 2^e m and m in [0.707, 1.414)."""

    def codegen(context, builder, sig, args):
        integers = ir.VectorType(ir.IntType(64), LANES)

        def constant(x):
            return ir.Constant(integers, [x] * LANES)

        bits = builder.bitcast(args[0], integers)
        shifted = builder.sub(bits, constant(0x3FE6A09E667F3BCD))
        exponent = builder.ashr(shifted, constant(52))
        fraction = builder.sub(bits, builder.shl(exponent, constant(52)))
        return complex_of(
            context,
            builder,
            builder.sitofp(exponent, VECTOR),
            builder.bitcast(fraction, VECTOR),
        )

    return Complexes(Reals), codegen
