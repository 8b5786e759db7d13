"""Exponents and roots of vectors, from the bits of their doubles."""

# numba's extension interface comes without types:
# mypy: allow-untyped-defs, allow-incomplete-defs, allow-untyped-calls

from llvmlite import ir

from robotmodels.kernel.simd import (
    LANES,
    VECTOR,
    Complexes,
    Reals,
    complex_of,
    emit_fma,
    intrinsic,
)


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
