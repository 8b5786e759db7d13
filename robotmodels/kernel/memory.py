"""Read and write vectors, doubles and integers by address.

`load` and `store` take the integer address of an array from `aligned` and an index in
vectors; a complex vector takes two. An address costs nothing to hand around, where numba
counts references to arrays, one atomic operation each. Whoever takes an address keeps the array.
None of this checks bounds.
"""

# numba's extension interface comes without types:
# mypy: allow-untyped-defs, allow-incomplete-defs, allow-untyped-calls

import numpy as np
from llvmlite import ir
from numba.core import cgutils, types

from robotmodels.common.arrays import Array, IntArray
from robotmodels.kernel.simd import (
    BYTES,
    LANES,
    VECTOR,
    Complexes,
    Reals,
    complex_of,
    intrinsic,
    parts_of,
)


def aligned(count: int) -> Array:
    """Return a zeroed buffer of `count` vectors that starts at a multiple of 64 bytes."""
    raw = np.zeros(count * LANES + LANES)
    start = (-raw.ctypes.data % BYTES) // 8
    return raw[start : start + count * LANES]


def address(array: Array | IntArray) -> int:
    """Return where the data of a contiguous array begin.

    Raises
    ------
    ValueError
        If the array is not contiguous.
    """
    if not array.flags.c_contiguous:
        raise ValueError("only a contiguous array can be used by its address")
    return int(array.ctypes.data)


def _pointer(builder, element, start, index):
    """Return a pointer to element `index` behind the address `start`."""
    return builder.gep(builder.inttoptr(start, element.as_pointer()), [index])


def _next(builder, pointer):
    return builder.gep(pointer, [ir.Constant(ir.IntType(64), 1)])


@intrinsic
def load(typingctx, start, index):
    """Return the real vector at `index`."""

    def codegen(context, builder, sig, args):
        return builder.load(_pointer(builder, VECTOR, *args), align=BYTES)

    return Reals(types.intp, types.intp), codegen


@intrinsic
def load_complex(typingctx, start, index):
    """Return the complex vector at `index` and the next."""

    def codegen(context, builder, sig, args):
        pointer = _pointer(builder, VECTOR, *args)
        real = builder.load(pointer, align=BYTES)
        imag = builder.load(_next(builder, pointer), align=BYTES)
        return complex_of(context, builder, real, imag)

    return Complexes(types.intp, types.intp), codegen


@intrinsic
def store(typingctx, start, index, value):
    """Write a real vector to `index`, or a complex one to `index` and the next."""

    def codegen(context, builder, sig, args):
        pointer = _pointer(builder, VECTOR, *args[:2])
        if sig.args[2] == Reals:
            builder.store(args[2], pointer, align=BYTES)
        else:
            real, imag = parts_of(context, builder, args[2])
            builder.store(real, pointer, align=BYTES)
            builder.store(imag, _next(builder, pointer), align=BYTES)
        return context.get_dummy_value()

    return types.void(types.intp, types.intp, value), codegen


@intrinsic
def prefetch(typingctx, start, index):
    """Ask for the vector at `index` to be brought to the nearest cache."""

    def codegen(context, builder, sig, args):
        pointer = builder.bitcast(_pointer(builder, VECTOR, *args), ir.IntType(8).as_pointer())
        i32 = ir.IntType(32)
        function = cgutils.get_or_insert_function(
            builder.module,
            ir.FunctionType(ir.VoidType(), [pointer.type, i32, i32, i32]),
            "llvm.prefetch.p0i8",
        )
        builder.call(function, [pointer, *(ir.Constant(i32, x) for x in (0, 3, 1))])
        return context.get_dummy_value()

    return types.void(types.intp, types.intp), codegen


@intrinsic
def scalar(typingctx, start, index):
    """Return the double at `index`, counted in doubles."""

    def codegen(context, builder, sig, args):
        return builder.load(_pointer(builder, ir.DoubleType(), *args))

    return types.float64(types.intp, types.intp), codegen


@intrinsic
def integer(typingctx, start, index):
    """Return the integer at `index`, counted in integers of 64 bits."""

    def codegen(context, builder, sig, args):
        return builder.load(_pointer(builder, ir.IntType(64), *args))

    return types.int64(types.intp, types.intp), codegen


@intrinsic
def store_scalar(typingctx, start, index, value):
    """Write a double to `index`, counted in doubles."""

    def codegen(context, builder, sig, args):
        builder.store(args[2], _pointer(builder, ir.DoubleType(), *args[:2]))
        return context.get_dummy_value()

    return types.void(types.intp, types.intp, types.float64), codegen
