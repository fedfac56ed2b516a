"""What Numba makes of ``registers``: a four is a vector of LLVM, an operation one or a few of its instructions."""

from __future__ import annotations

import operator
from collections.abc import Callable, Sequence
from typing import Any

from llvmlite import ir
from numba import types
from numba.extending import intrinsic, lower_builtin, models, register_model, type_callable

_VECTOR = ir.VectorType(ir.DoubleType(), 4)
_PLACE = ir.IntType(32)
_ALIGNED = 8
"""Bytes: those of one number, for fours begin anywhere."""


class FourType(types.Type):
    """The type of a four."""

    def __init__(self) -> None:
        super().__init__("four")


FOUR = FourType()


@register_model(FourType)
class _Model(models.PrimitiveModel):
    """A four is kept in a register."""

    def __init__(self, manager: Any, type_: Any) -> None:
        super().__init__(manager, type_, _VECTOR)


@intrinsic
def four(typing, array, place):  # type: ignore[no-untyped-def]
    """Load four numbers."""

    def generate(context: Any, builder: Any, sig: Any, args: Sequence[Any]) -> Any:
        begin = builder.bitcast(_address(context, builder, sig, args), _VECTOR.as_pointer())
        return builder.load(begin, align=_ALIGNED)

    return FOUR(array, place), generate


@intrinsic
def same(typing, number):  # type: ignore[no-untyped-def]
    """Spread a number."""
    return FOUR(types.float64), lambda context, builder, sig, args: _spread(builder, args[0])


@intrinsic
def each(typing, array, place):  # type: ignore[no-untyped-def]
    """Load a number and spread it."""

    def generate(context: Any, builder: Any, sig: Any, args: Sequence[Any]) -> Any:
        return _spread(builder, builder.load(_address(context, builder, sig, args)))

    return FOUR(array, place), generate


@intrinsic
def put(typing, array, place, numbers):  # type: ignore[no-untyped-def]
    """Store four numbers."""

    def generate(context: Any, builder: Any, sig: Any, args: Sequence[Any]) -> Any:
        begin = builder.bitcast(_address(context, builder, sig, args), _VECTOR.as_pointer())
        builder.store(args[2], begin, align=_ALIGNED)
        return context.get_dummy_value()

    return types.void(array, place, FOUR), generate


@intrinsic
def total(typing, numbers):  # type: ignore[no-untyped-def]
    """Add the four."""

    def generate(context: Any, builder: Any, sig: Any, args: Sequence[Any]) -> Any:
        a, b, c, d = (builder.extract_element(args[0], ir.Constant(_PLACE, k)) for k in range(4))
        return builder.fadd(builder.fadd(a, b), builder.fadd(c, d))

    return types.float64(FOUR), generate


@intrinsic
def fetch(typing, array, place):  # type: ignore[no-untyped-def]
    """Bring a number into the cache of the processor: to read, to be kept, data."""

    def generate(context: Any, builder: Any, sig: Any, args: Sequence[Any]) -> Any:
        byte = ir.IntType(8).as_pointer()
        kind = ir.FunctionType(ir.VoidType(), [byte, _PLACE, _PLACE, _PLACE])
        prefetch = builder.module.declare_intrinsic("llvm.prefetch", (byte,), kind)
        address = builder.bitcast(_address(context, builder, sig, args), byte)
        builder.call(prefetch, [address, *(ir.Constant(_PLACE, k) for k in (0, 3, 1))])
        return context.get_dummy_value()

    return types.void(array, place), generate


def _address(context: Any, builder: Any, sig: Any, args: Sequence[Any]) -> Any:
    array = context.make_array(sig.args[0])(context, builder, args[0])
    return builder.gep(array.data, [context.cast(builder, args[1], sig.args[1], types.intp)])


def _spread(builder: Any, number: Any) -> Any:
    nothing = ir.Constant(_VECTOR, ir.Undefined)
    first = builder.insert_element(nothing, number, ir.Constant(_PLACE, 0))
    return builder.shuffle_vector(first, nothing, ir.Constant(ir.VectorType(_PLACE, 4), [0] * 4))


def _define(operation: Callable[..., Any], instruction: str) -> None:
    """Let fours be added or multiplied, one of the two being a number or both fours."""
    kinds = ((FOUR, FOUR), (types.float64, FOUR), (FOUR, types.float64))

    @type_callable(operation)
    def _type(context: Any) -> Any:
        return lambda one, other: FOUR if (one, other) in kinds else None

    def lower(context: Any, builder: Any, sig: Any, args: Sequence[Any]) -> Any:
        pairs = zip(sig.args, args, strict=True)
        one, other = (value if type_ == FOUR else _spread(builder, value) for type_, value in pairs)
        return getattr(builder, instruction)(one, other)

    for kind in kinds:
        lower_builtin(operation, *kind)(lower)


for _operation, _instruction in ((operator.add, "fadd"), (operator.sub, "fsub"), (operator.mul, "fmul")):
    _define(_operation, _instruction)
