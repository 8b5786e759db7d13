"""Eight doubles, or eight complex numbers, in one register: vector types for numba.

numba vectorises loops only where LLVM sees how; a dense factorisation of small matrices is not
such a place. Here the vector is explicit: one lane is one frequency, real and imaginary parts are
vectors of their own, and every operation is one LLVM instruction or a few. A processor without
512-bit registers gets the same program in halves or quarters, from LLVM.

`Reals` and `Complexes` know + - * /, and comparison is left to `minimum` and `maximum`. They
are read from memory and written to it by `memory`.
"""

# numba's extension interface comes without types:
# mypy: allow-untyped-decorators, allow-subclassing-any
# mypy: allow-untyped-defs, allow-incomplete-defs, allow-untyped-calls

import operator
from typing import Any

from llvmlite import ir
from numba import extending
from numba.core import cgutils, types
from numba.core.typing.templates import ConcreteTemplate, infer_global, signature
from numba.extending import lower_builtin, make_attribute_wrapper, models, register_model

intrinsic: Any = extending.intrinsic

LANES = 8
BYTES = 8 * LANES
VECTOR = ir.VectorType(ir.DoubleType(), LANES)


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
        super().__init__(manager, fe_type, VECTOR)


@register_model(ComplexesType)
class _ComplexesModel(models.StructModel):
    def __init__(self, manager, fe_type) -> None:
        super().__init__(manager, fe_type, [("real", Reals), ("imag", Reals)])


make_attribute_wrapper(ComplexesType, "real", "real")
make_attribute_wrapper(ComplexesType, "imag", "imag")


def emit_fma(builder, a, b, c):
    """Emit a b + c, fused where the processor can."""
    function = cgutils.get_or_insert_function(
        builder.module,
        ir.FunctionType(VECTOR, [VECTOR] * 3),
        f"llvm.fmuladd.v{LANES}f64",
    )
    return builder.call(function, [a, b, c])


def parts_of(context, builder, value):
    """Emit the real and the imaginary vector of a complex one."""
    z = cgutils.create_struct_proxy(Complexes)(context, builder, value=value)
    return z.real, z.imag


def complex_of(context, builder, real, imag):
    """Emit the complex vector of two real ones."""
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
    (ar, ai), (br, bi) = parts_of(context, builder, a), parts_of(context, builder, b)
    real = emit_fma(builder, builder.fneg(ai), bi, builder.fmul(ar, br))
    return complex_of(context, builder, real, emit_fma(builder, ai, br, builder.fmul(ar, bi)))


def _each_part(emit):
    """Return the complex form of a real operation that acts on both parts alike."""

    def both(context, builder, a, b):
        pairs = zip(parts_of(context, builder, a), parts_of(context, builder, b), strict=True)
        return complex_of(context, builder, *(emit(builder, x, y) for x, y in pairs))

    return both


def _scaled(context, builder, a, b):
    return complex_of(
        context, builder, *(builder.fmul(x, b) for x in parts_of(context, builder, a))
    )


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


@intrinsic
def splat(typingctx, x):
    """Return a real vector with `x` in every lane."""

    def codegen(context, builder, sig, args):
        lane = builder.insert_element(
            ir.Constant(VECTOR, ir.Undefined), args[0], ir.Constant(ir.IntType(32), 0)
        )
        mask = ir.Constant(ir.VectorType(ir.IntType(32), LANES), [0] * LANES)
        return builder.shuffle_vector(lane, ir.Constant(VECTOR, ir.Undefined), mask)

    return Reals(types.float64), codegen


@intrinsic
def pack(typingctx, real, imag):
    """Return the complex vector of two real ones."""

    def codegen(context, builder, sig, args):
        return complex_of(context, builder, *args)

    return Complexes(Reals, Reals), codegen


@intrinsic
def fma(typingctx, a, b, c):
    """Return a b + c; a and c are both real or both complex, b is real or complex."""
    if Complexes not in (a, b, c):

        def real(context, builder, sig, args):
            return emit_fma(builder, *args)

        return Reals(Reals, Reals, Reals), real

    def codegen(context, builder, sig, args):
        (ar, ai), (cr, ci) = (parts_of(context, builder, args[i]) for i in (0, 2))
        if b == Reals:
            parts = emit_fma(builder, ar, args[1], cr), emit_fma(builder, ai, args[1], ci)
        else:
            br, bi = parts_of(context, builder, args[1])
            cr, ci = emit_fma(builder, ar, br, cr), emit_fma(builder, ar, bi, ci)
            parts = emit_fma(builder, builder.fneg(ai), bi, cr), emit_fma(builder, ai, br, ci)
        return complex_of(context, builder, *parts)

    return Complexes(Complexes, b, Complexes), codegen


@intrinsic
def fma_conjugate(typingctx, a, b, c):
    """Return conj(a) b + c for complex vectors."""

    def codegen(context, builder, sig, args):
        (ar, ai), (br, bi), (cr, ci) = (parts_of(context, builder, x) for x in args)
        cr, ci = emit_fma(builder, ar, br, cr), emit_fma(builder, ar, bi, ci)
        return complex_of(
            context,
            builder,
            emit_fma(builder, ai, bi, cr),
            emit_fma(builder, builder.fneg(ai), br, ci),
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
        sums, width = args[0], LANES
        while width > 1:
            width //= 2
            none = ir.Constant(sums.type, ir.Undefined)
            low, high = (
                ir.Constant(ir.VectorType(ir.IntType(32), width), list(range(at, at + width)))
                for at in (0, width)
            )
            sums = builder.fadd(
                builder.shuffle_vector(sums, none, low), builder.shuffle_vector(sums, none, high)
            )
        return builder.extract_element(sums, ir.Constant(ir.IntType(32), 0))

    return types.float64(Reals), codegen


@intrinsic
def root(typingctx, a):
    """Return the square root of each lane."""

    def codegen(context, builder, sig, args):
        function = cgutils.get_or_insert_function(
            builder.module, ir.FunctionType(VECTOR, [VECTOR]), f"llvm.sqrt.v{LANES}f64"
        )
        return builder.call(function, args)

    return Reals(Reals), codegen


@intrinsic
def any_negative(typingctx, a):
    """Return whether a lane is below zero."""

    def codegen(context, builder, sig, args):
        zero = ir.Constant(VECTOR, [0.0] * LANES)
        bits = builder.bitcast(builder.fcmp_ordered("<", args[0], zero), ir.IntType(LANES))
        return builder.icmp_unsigned("!=", bits, ir.Constant(ir.IntType(LANES), 0))

    return types.boolean(Reals), codegen


@intrinsic
def where_greater(typingctx, a, b, yes, no):
    """Return per lane `yes` where a > b, else `no`."""

    def codegen(context, builder, sig, args):
        return builder.select(builder.fcmp_ordered(">", *args[:2]), *args[2:])

    return Reals(Reals, Reals, Reals, Reals), codegen
