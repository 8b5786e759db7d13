"""Eight doubles, or eight complex numbers, in one register: vector types for numba.

numba vectorises loops only where LLVM sees how; a dense factorisation of small matrices is not
such a place. Here the vector is explicit: one lane is one frequency, real and imaginary parts are
vectors of their own, and every operation is one LLVM instruction or a few. A processor without
512-bit registers gets the same program in halves or quarters, from LLVM.

`Reals` and `Complexes` know + - * /, and comparison is left to `minimum` and `maximum`. Memory
is addressed: `load` and `store` take the integer address of an array from `aligned` and a place,
counted in vectors; a complex vector takes two places. An address costs nothing to hand around,
where numba counts references to arrays, one atomic operation each. Whoever takes an address
keeps the array. None of this checks bounds.
"""

# numba's extension interface comes without types:
# mypy: allow-untyped-decorators, allow-subclassing-any
# mypy: allow-untyped-defs, allow-incomplete-defs, allow-untyped-calls

import operator
from typing import Any

import numpy as np
from llvmlite import ir
from numba import extending
from numba.core import cgutils, types
from numba.core.typing.templates import ConcreteTemplate, infer_global, signature
from numba.extending import lower_builtin, make_attribute_wrapper, models, register_model

from robotmodels.arrays import Array, IntArray

intrinsic: Any = extending.intrinsic

LANES = 8
BYTES = 8 * LANES
_VECTOR = ir.VectorType(ir.DoubleType(), LANES)


def aligned(places: int) -> Array:
    """Return a zeroed buffer of `places` vectors that starts at a multiple of 64 bytes."""
    raw = np.zeros(places * LANES + LANES)
    start = (-raw.ctypes.data % BYTES) // 8
    return raw[start : start + places * LANES]


class RealsType(types.Type):
    """Eight doubles."""

    def __init__(self) -> None:
        super().__init__(name="Reals")


class ComplexesType(types.Type):
    """Eight complex numbers: a vector of real and a vector of imaginary parts."""

    def __init__(self) -> None:
        super().__init__(name="Complexes")


Reals, Complexes = RealsType(), ComplexesType()


@register_model(RealsType)
class _RealsModel(models.PrimitiveModel):
    def __init__(self, manager, fe_type) -> None:
        super().__init__(manager, fe_type, _VECTOR)


@register_model(ComplexesType)
class _ComplexesModel(models.StructModel):
    def __init__(self, manager, fe_type) -> None:
        super().__init__(manager, fe_type, [("real", Reals), ("imag", Reals)])


make_attribute_wrapper(ComplexesType, "real", "real")
make_attribute_wrapper(ComplexesType, "imag", "imag")


def _fma(builder, a, b, c):
    """Emit a b + c, fused where the processor can."""
    function = cgutils.get_or_insert_function(
        builder.module,
        ir.FunctionType(_VECTOR, [_VECTOR] * 3),
        f"llvm.fmuladd.v{LANES}f64",
    )
    return builder.call(function, [a, b, c])


def _parts(context, builder, value):
    z = cgutils.create_struct_proxy(Complexes)(context, builder, value=value)
    return z.real, z.imag


def _complex(context, builder, real, imag):
    z = cgutils.create_struct_proxy(Complexes)(context, builder)
    z.real, z.imag = real, imag
    return z._getvalue()


def _define(function, emit, result, *arguments) -> None:
    """Give `function` (an operator) a meaning for vector `arguments`."""

    def lower(context, builder, sig, args):
        return emit(context, builder, *args)

    lower_builtin(function, *arguments)(lower)
    _CASES.setdefault(function, []).append(signature(result, *arguments))


_CASES: dict[Any, list[object]] = {}


def _product(context, builder, a, b):
    (ar, ai), (br, bi) = _parts(context, builder, a), _parts(context, builder, b)
    real = _fma(builder, builder.fneg(ai), bi, builder.fmul(ar, br))
    return _complex(context, builder, real, _fma(builder, ai, br, builder.fmul(ar, bi)))


def _each_part(emit):
    """Return the complex form of a real operation that acts on both parts alike."""

    def both(context, builder, a, b):
        pairs = zip(_parts(context, builder, a), _parts(context, builder, b), strict=True)
        return _complex(context, builder, *(emit(builder, x, y) for x, y in pairs))

    return both


def _scaled(context, builder, a, b):
    return _complex(context, builder, *(builder.fmul(x, b) for x in _parts(context, builder, a)))


for _operator, _name in (
    (operator.add, "fadd"),
    (operator.sub, "fsub"),
    (operator.mul, "fmul"),
    (operator.truediv, "fdiv"),
):

    def _emit(context, builder, a, b, _name=_name):
        return getattr(builder, _name)(a, b)

    _define(_operator, _emit, Reals, Reals, Reals)
_define(operator.add, _each_part(ir.IRBuilder.fadd), Complexes, Complexes, Complexes)
_define(operator.sub, _each_part(ir.IRBuilder.fsub), Complexes, Complexes, Complexes)
_define(operator.mul, _product, Complexes, Complexes, Complexes)
_define(operator.mul, _scaled, Complexes, Complexes, Reals)
for _operator, _signatures in _CASES.items():
    infer_global(_operator)(type("_Template", (ConcreteTemplate,), {"cases": _signatures}))


def address(array: Array | IntArray) -> int:
    """Return where the data of a contiguous array begin.

    Raises
    ------
    ValueError : if the array is not contiguous.
    """
    if not array.flags.c_contiguous:
        raise ValueError("only a contiguous array can be used by its address")
    return int(array.ctypes.data)


def _pointer(builder, element, start, place):
    """Return a pointer to element `place` behind the address `start`."""
    return builder.gep(builder.inttoptr(start, element.as_pointer()), [place])


def _next(builder, pointer):
    return builder.gep(pointer, [ir.Constant(ir.IntType(64), 1)])


@intrinsic
def load(typingctx, start, place):
    """Return the real vector at `place`."""

    def codegen(context, builder, sig, args):
        return builder.load(_pointer(builder, _VECTOR, *args), align=BYTES)

    return Reals(types.intp, types.intp), codegen


@intrinsic
def load_complex(typingctx, start, place):
    """Return the complex vector at `place` and the next."""

    def codegen(context, builder, sig, args):
        pointer = _pointer(builder, _VECTOR, *args)
        real = builder.load(pointer, align=BYTES)
        imag = builder.load(_next(builder, pointer), align=BYTES)
        return _complex(context, builder, real, imag)

    return Complexes(types.intp, types.intp), codegen


@intrinsic
def store(typingctx, start, place, value):
    """Write a real vector to `place`, or a complex one to `place` and the next."""

    def codegen(context, builder, sig, args):
        pointer = _pointer(builder, _VECTOR, *args[:2])
        if sig.args[2] == Reals:
            builder.store(args[2], pointer, align=BYTES)
        else:
            real, imag = _parts(context, builder, args[2])
            builder.store(real, pointer, align=BYTES)
            builder.store(imag, _next(builder, pointer), align=BYTES)
        return context.get_dummy_value()

    return types.void(types.intp, types.intp, value), codegen


@intrinsic
def scalar(typingctx, start, place):
    """Return the double at `place`, counted in doubles."""

    def codegen(context, builder, sig, args):
        return builder.load(_pointer(builder, ir.DoubleType(), *args))

    return types.float64(types.intp, types.intp), codegen


@intrinsic
def integer(typingctx, start, place):
    """Return the integer at `place`, counted in integers of 64 bits."""

    def codegen(context, builder, sig, args):
        return builder.load(_pointer(builder, ir.IntType(64), *args))

    return types.int64(types.intp, types.intp), codegen


@intrinsic
def put(typingctx, start, place, value):
    """Write a double to `place`, counted in doubles."""

    def codegen(context, builder, sig, args):
        builder.store(args[2], _pointer(builder, ir.DoubleType(), *args[:2]))
        return context.get_dummy_value()

    return types.void(types.intp, types.intp, types.float64), codegen


@intrinsic
def splat(typingctx, x):
    """Return a real vector with `x` in every lane."""

    def codegen(context, builder, sig, args):
        lane = builder.insert_element(
            ir.Constant(_VECTOR, ir.Undefined), args[0], ir.Constant(ir.IntType(32), 0)
        )
        mask = ir.Constant(ir.VectorType(ir.IntType(32), LANES), [0] * LANES)
        return builder.shuffle_vector(lane, ir.Constant(_VECTOR, ir.Undefined), mask)

    return Reals(types.float64), codegen


@intrinsic
def pack(typingctx, real, imag):
    """Return the complex vector of two real ones."""

    def codegen(context, builder, sig, args):
        return _complex(context, builder, *args)

    return Complexes(Reals, Reals), codegen


@intrinsic
def fma(typingctx, a, b, c):
    """Return a b + c; a and c are both real or both complex, b is real or complex."""
    if Complexes not in (a, b, c):

        def real(context, builder, sig, args):
            return _fma(builder, *args)

        return Reals(Reals, Reals, Reals), real

    def codegen(context, builder, sig, args):
        (ar, ai), (cr, ci) = (_parts(context, builder, args[i]) for i in (0, 2))
        if b == Reals:
            parts = _fma(builder, ar, args[1], cr), _fma(builder, ai, args[1], ci)
        else:
            br, bi = _parts(context, builder, args[1])
            cr, ci = _fma(builder, ar, br, cr), _fma(builder, ar, bi, ci)
            parts = _fma(builder, builder.fneg(ai), bi, cr), _fma(builder, ai, br, ci)
        return _complex(context, builder, *parts)

    return Complexes(Complexes, b, Complexes), codegen


@intrinsic
def fma_conjugate(typingctx, a, b, c):
    """Return conj(a) b + c for complex vectors."""

    def codegen(context, builder, sig, args):
        (ar, ai), (br, bi), (cr, ci) = (_parts(context, builder, x) for x in args)
        cr, ci = _fma(builder, ar, br, cr), _fma(builder, ar, bi, ci)
        return _complex(
            context,
            builder,
            _fma(builder, ai, bi, cr),
            _fma(builder, builder.fneg(ai), br, ci),
        )

    return Complexes(Complexes, Complexes, Complexes), codegen


def _extreme(name, order):
    """Return an intrinsic that picks per lane; where one is not a number, the second."""

    @intrinsic
    def pick(typingctx, a, b):
        def codegen(context, builder, sig, args):
            return builder.select(builder.fcmp_ordered(order, *args), *args)

        return Reals(Reals, Reals), codegen

    pick.__name__ = name
    return pick


minimum = _extreme("minimum", "<")
maximum = _extreme("maximum", ">")


@intrinsic
def lane_sum(typingctx, a):
    """Return the sum of the eight lanes."""

    def codegen(context, builder, sig, args):
        lanes = [
            builder.extract_element(args[0], ir.Constant(ir.IntType(32), i)) for i in range(LANES)
        ]
        while len(lanes) > 1:
            lanes = [builder.fadd(x, y) for x, y in zip(lanes[::2], lanes[1::2], strict=True)]
        return lanes[0]

    return types.float64(Reals), codegen


@intrinsic
def any_negative(typingctx, a):
    """Return whether a lane is below zero."""

    def codegen(context, builder, sig, args):
        zero = ir.Constant(_VECTOR, [0.0] * LANES)
        bits = builder.bitcast(builder.fcmp_ordered("<", args[0], zero), ir.IntType(LANES))
        return builder.icmp_unsigned("!=", bits, ir.Constant(ir.IntType(LANES), 0))

    return types.boolean(Reals), codegen


@intrinsic
def where_greater(typingctx, a, b, yes, no):
    """Return per lane `yes` where a > b, else `no`."""

    def codegen(context, builder, sig, args):
        return builder.select(builder.fcmp_ordered(">", *args[:2]), *args[2:])

    return Reals(Reals, Reals, Reals, Reals), codegen


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
        return _complex(
            context,
            builder,
            builder.sitofp(exponent, _VECTOR),
            builder.bitcast(fraction, _VECTOR),
        )

    return Complexes(Reals), codegen
